//! Rotations of charts in a packed image, by eighths of a turn.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DMat2, DVec2, DVec3};

use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::{ImageFrame, MapLevel, PatchMap, SkinMap, mirrored};
use crate::pyramid::LevelId;
use crate::skin::{PatchId, world_pose};

/// A full turn.
pub(super) const TURNS: u8 = 8;

/// `p` after `turns` eighths of a turn, counter-clockwise.
pub(super) fn turned(p: DVec2, turns: u8) -> DVec2 {
    let quarters = match turns / 2 % 4 {
        0 => p,
        1 => DVec2::new(-p.y, p.x),
        2 => -p,
        _ => DVec2::new(p.y, -p.x),
    };
    if turns.is_multiple_of(2) { quarters } else { FRAC_1_SQRT_2 * (quarters + quarters.perp()) }
}

/// `p` on a map that is mirrored, if it is, and then turned.
pub(super) fn in_image(p: DVec2, is_mirrored: bool, turns: u8) -> DVec2 {
    turned(if is_mirrored { mirrored(p) } else { p }, turns)
}

/// The largest face of a level on the map, and the pixel of a frame that its middle lies in, which shows it where no face
/// covers the centre of a pixel: every patch has one that its amounts go to. Column and row from the lower left; `None` if
/// no face has an area.
pub(super) fn stand_in(level: &MapLevel, turns: u8, frame: &ImageFrame) -> Option<(FaceId, [u32; 2])> {
    let area = |face: FaceId| {
        let [a, b, c] = level.uv_of(face);
        (b - a).perp_dot(c - a).abs()
    };
    let faces = level.level.mesh.triangles.ids();
    let face = faces
        .max_by(|&a, &b| area(a).total_cmp(&area(b)).then(b.cmp(&a)))
        .filter(|&face| area(face) > 0.0)?;
    let [a, b, c] = level.uv_of(face);
    let count = DVec2::from_array(frame.size_px.map(f64::from));
    let at = (turned((a + b + c) / 3.0, turns) - frame.origin) / frame.size * count;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image")]
    let pixel = at.floor().clamp(DVec2::ZERO, count - 1.0).to_array().map(|x| x as u32);
    Some((face, pixel))
}

/// A rectangle of a turned map, in m.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    pub(super) lo: DVec2,
    pub(super) hi: DVec2,
}

impl Extent {
    pub(super) fn around<'a>(positions: impl IntoIterator<Item = &'a DVec2>, turns: u8) -> Self {
        let start = Self { lo: DVec2::INFINITY, hi: DVec2::NEG_INFINITY };
        let grow = |Self { lo, hi }: Self, p: DVec2| Self { lo: lo.min(p), hi: hi.max(p) };
        positions.into_iter().map(|&p| turned(p, turns)).fold(start, grow)
    }

    /// The extent of all levels of a patch.
    pub(super) fn of(patch: &PatchMap, turns: u8) -> Self {
        Self::around(patch.levels.iter().flat_map(|level| &level.uv), turns)
    }

    /// Width and height; 0 for no positions.
    pub(super) fn size(&self) -> DVec2 {
        (self.hi - self.lo).max(DVec2::ZERO)
    }
}

/// The quarter turns, in eighths, that bring the distal end of each patch's link up on the map; 0 if the link has no
/// distal end.
///
/// Distal is the direction from the link's origin to the centre of the skin on its child links and their
/// descendants, or, if they have none, to that of the patch. A link without parent and without such skin has
/// no distal end.
pub(super) fn distal_turns(map: &SkinMap) -> IdVec<PatchId, u8> {
    // For the skin on each link, and on its descendants: area, and its product with the centre.
    let mut own = map.links.map(|_| (0.0, DVec3::ZERO));
    for patch in &map.patches {
        let level = &patch.levels[LevelId::new(0)].level;
        let pose = world_pose(&map.links, patch.link);
        for (p, area) in level.mesh.positions.iter().zip(&level.areas) {
            let (total, sum) = &mut own[patch.link];
            *total += area;
            *sum += pose.transform_point3(*p) * *area;
        }
    }
    let mut beyond = map.links.map(|_| (0.0, DVec3::ZERO));
    for (id, link) in map.links.enumerate().rev() {
        let Some(parent) = link.parent else { continue };
        let (area, sum) = (own[id].0 + beyond[id].0, own[id].1 + beyond[id].1);
        beyond[parent].0 += area;
        beyond[parent].1 += sum;
    }
    let turns = |patch: &PatchMap| {
        let pose = world_pose(&map.links, patch.link);
        let distal = match beyond[patch.link] {
            (area, sum) if area > 0.0 => pose.inverse().transform_point3(sum / area),
            _ if map.links[patch.link].parent.is_none() => return 0,
            _ => middle(&patch.levels[LevelId::new(0)].level.mesh.positions),
        };
        distal.try_normalize().map_or(0, |distal| turns_up(patch, distal))
    };
    map.patches.map(turns)
}

fn middle(positions: &IdVec<VertexId, DVec3>) -> DVec3 {
    positions.iter().sum::<DVec3>() / positions.len() as f64
}

/// The quarter turns, in eighths, that bring a direction in the frame of the link up.
fn turns_up(patch: &PatchMap, distal: DVec3) -> u8 {
    let finest = &patch.levels[LevelId::new(0)];
    let of_place = |(place, uv): (PlaceId, &DVec2)| {
        let v = finest.vertex_of(place);
        (*uv, finest.level.mesh.positions[v], finest.level.areas[v])
    };
    let places: Vec<(DVec2, DVec3, f64)> = finest.uv.enumerate().map(of_place).collect();
    let total: f64 = places.iter().map(|(.., area)| area).sum();
    let middle = places.iter().map(|(uv, _, area)| *uv * *area).sum::<DVec2>() / total;
    // The linear function of the map that is nearest to the distance along `distal`.
    let (mut matrix, mut right) = (DMat2::ZERO, DVec2::ZERO);
    for (uv, x, area) in places {
        let d = uv - middle;
        matrix += DMat2::from_cols(d * d.x, d * d.y) * area;
        right += d * x.dot(distal) * area;
    }
    let gradient = matrix.inverse() * right;
    if !gradient.is_finite() {
        return 0;
    }
    let up = |turns: u8| turned(gradient, turns).y;
    (2..TURNS).step_by(2).fold(0, |best, turns| if up(turns) > up(best) + 1e-9 { turns } else { best })
}
