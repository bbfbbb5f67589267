//! A coarse level with its own tree, and how far each of its faces and the skin are apart; `distance`
//! measures how far a triangle is from a mesh, `columns` how far the skin is from contacts over a part of a face.

mod columns;
mod distance;

use columns::{Columns, Lengths, Skin};
use distance::{DEEPEST, ROUND_UP, Target};
use glam::DVec3;

use crate::contact::ContactError;
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::id::{FaceId, IdVec};
use crate::map::PatchMap;
use crate::mesh::{Feature, TriMesh};
use crate::parallel::{par_collect, par_ids};

/// Part of the mean edge of the finer level below which a deviation does not matter.
const TOLERANCE: f64 = 0.01;

/// Contacts nearer than this part of a level's mean edge know which faces the skin near them may
/// belong to; farther ones are bounded by the largest deviation of the level.
const NEAR: f64 = 0.5;

/// Contacts up to this distance from the skin, in m, are known best, but for those farther than [`CLOSE_EDGES`]
/// from the level. The bounds of nearer contacts would be closer if it were less.
const CLOSE: f64 = 0.004;

/// In mean edges of a level.
const CLOSE_EDGES: f64 = 2.0;

/// A level of a patch that is searched alone.
#[derive(Debug, Clone)]
pub(in crate::contact) struct CoarseLevel {
    pub(in crate::contact) tree: PatchBvh,
    deviations: IdVec<FaceId, Deviation>,
    /// Largest distance from each face of the part of the skin that it stands for, in m.
    skins: IdVec<FaceId, f64>,
    /// Largest of `skins`, in m.
    pub(in crate::contact) most: f64,
    /// Up to which distance `around` holds, in m.
    near: f64,
}

/// How far a face and the skin are apart, in m, in one line of the cache. The parts of the skin that the faces of a level
/// stand for cover the skin.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Deviation {
    /// Largest distance of the face from the skin; at least that of its part of the skin from it.
    face: f64,
    /// The largest of `skins` of all faces whose skin may be nearest to a contact within `near` of this
    /// face.
    around: f64,
    columns: Columns,
    /// Up to which distance from the face the columns hold.
    close: f32,
}

impl CoarseLevel {
    /// The least and the largest distance from the skin of a point (m, in the frame of the tree) whose nearest
    /// face of the level is `best`.
    pub(in crate::contact) fn range(&self, q: DVec3, best: &Best) -> [f64; 2] {
        let Best { face, closest, .. } = *best;
        let (away, deviation) = (closest.squared.sqrt(), &self.deviations[face]);
        let nearer = if away <= self.near { deviation.around } else { self.most };
        let [mut least, mut most] = [away - nearer, away + deviation.face];
        if closest.feature == Feature::Inside && away <= f64::from(deviation.close) {
            let mesh = &self.tree.mesh;
            let side = (q - mesh.positions[mesh.triangles[face][0]]).dot(mesh.face_cross(face));
            let range = deviation.columns.range(closest.barycentric, away.copysign(side));
            (least, most) = (least.max(range[0]), most.min(range[1]));
        }
        [least.max(0.0), most]
    }

    /// A level above a finer one, which is `None` above level 0.
    #[expect(clippy::cast_possible_truncation, reason = "columns are made for the rounded length")]
    fn new(patch: &str, mesh: &TriMesh, skin: &Skin<'_>, finer: Option<&Self>) -> Result<Self, ContactError> {
        let tree = PatchBvh::new(patch, mesh)?;
        let below = finer.map_or(skin.tree, |level| &level.tree);
        let (edge, finer_edge) = (mean_side(mesh), mean_side(&below.mesh));
        let size = mesh.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let (tolerance, rounding) = (TOLERANCE * finer_edge, ROUND_UP * size);
        let skin_of = |f: FaceId| finer.map_or(0.0, |level| level.skins[f]);
        let face_of = |f: FaceId| finer.map_or(0.0, |level| level.deviations[f].face);

        let target = Target { tree: &tree, more: &|_| 0.0, tolerance };
        // Which face a part of a finer face belongs to, and how far from it the skin there is.
        let parts = par_collect(below.mesh.triangles.len(), |range, parts: &mut Vec<(FaceId, f64)>| {
            for child in range.map(FaceId::new) {
                let first = parts.len();
                let part = target.part(below.mesh.corners(child));
                target.measure(&part, DEEPEST, &mut |face, bound, is_last| {
                    let bound = bound + skin_of(child) + rounding;
                    let known = parts[first..].iter_mut().find(|(f, _)| *f == face);
                    if known.as_ref().is_some_and(|(_, old)| bound <= *old) {
                        return true;
                    }
                    if is_last {
                        match known {
                            Some((_, old)) => *old = bound,
                            None => parts.push((face, bound)),
                        }
                    }
                    false
                });
            }
        });
        let mut skins = IdVec::<FaceId, f64>::filled(0.0, mesh.triangles.len());
        for (face, bound) in parts {
            skins[face] = skins[face].max(bound);
        }
        let target = Target { tree: below, more: &face_of, tolerance };
        let cuts = DEEPEST + 2 * halvings(edge / finer_edge);
        let faces = par_collect(mesh.triangles.len(), |range, faces: &mut Vec<f64>| {
            faces.extend(range.map(FaceId::new).map(|face| {
                // Answers are as inexact as `skins` anyway.
                let mut most = skins[face];
                let part = target.part(mesh.corners(face));
                target.measure(&part, cuts, &mut |_, bound, is_last| {
                    let is_known = bound + rounding <= most;
                    if is_last {
                        most = most.max(bound + rounding);
                    }
                    is_known
                });
                most
            }));
        });
        let faces = IdVec::<FaceId, f64>::from(faces);
        let most = skins.iter().copied().fold(0.0, f64::max);
        let near = NEAR * edge;
        let deviations = par_ids(mesh.triangles.len(), |id| {
            let (corners, face) = (mesh.corners(id), faces[id]);
            let around = most_around(&tree, &skins, id, 2.0 * near + face + most);
            let close = (CLOSE + face).min(CLOSE_EDGES * edge) as f32;
            let lengths = Lengths { near: close.into(), away: face, rounding, most: around.max(face) };
            Deviation { face, around, columns: skin.columns(corners, &lengths), close }
        });
        Ok(Self { tree, deviations, skins, most, near })
    }
}

/// The largest of `skins` of all faces no farther than `reach` (m) from one. The skin nearest to a contact at most `near`
/// from a face is at most `near + face` from it, and belongs to a face at most `most` farther from there: no
/// farther than `2 near + face + most` from the first.
fn most_around(tree: &PatchBvh, skins: &IdVec<FaceId, f64>, face: FaceId, reach: f64) -> f64 {
    let corners = tree.mesh.corners(face);
    let centre = corners.into_iter().sum::<DVec3>() / 3.0;
    let radius = corners.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
    let mut most = skins[face];
    tree.each_around(centre, (radius + reach) * (1.0 + 1e-9), |other| most = most.max(skins[other]));
    most
}

/// How often a length must be halved to be at most 1.
fn halvings(ratio: f64) -> u32 {
    (0..16).find(|&n| ratio <= f64::from(1 << n)).unwrap_or(16)
}

/// The levels of a patch above level 0, finest first.
pub(in crate::contact) fn coarse_levels(
    patch: &PatchMap,
    finest: &PatchBvh,
) -> Result<Vec<CoarseLevel>, ContactError> {
    let mut levels: Vec<CoarseLevel> = Vec::new();
    let skin = Skin::new(finest);
    for map in patch.levels.iter().skip(1) {
        levels.push(CoarseLevel::new(&patch.name, &map.level.mesh, &skin, levels.last())?);
    }
    Ok(levels)
}

/// Mean length of the sides of all faces, in m.
pub(in crate::contact) fn mean_side(mesh: &TriMesh) -> f64 {
    let around = |f: FaceId| {
        let [a, b, c] = mesh.corners(f);
        a.distance(b) + b.distance(c) + c.distance(a)
    };
    mesh.triangles.ids().map(around).sum::<f64>() / (3 * mesh.triangles.len()) as f64
}
