//! Pictures of what changed between two files of one skin: on the map of the first, by kind, with arrows.
//!
//! The cell of each changed taxel has the colour of the kind of its change. An arrow goes from its place in the first
//! file towards that in the second: a motion of up to two distances between taxels by the differential of the map in the
//! triangle of its begin, so that no seam lengthens it; a longer one to the place of the map that is nearest to its end.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use crate::contact::{ContactIndex, Query};
use crate::diff::{Change, ChangeKind, Diff, Subject};
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::mesh::SurfacePoint;
use crate::plot::colour::{Colour, INK, SKIN};
use crate::plot::draw::Panel;
use crate::plot::layout::{Layout, View, lay_out, printable, round_down, short, slots};
use crate::plot::patch_view::PatchView;
use crate::plot::picture::{Path, Picture, Shape, Stroke};
use crate::plot::plot_map::{choose, title};
use crate::plot::{PlotError, PlotOptions};
use crate::pyramid::LevelId;
use crate::skin::{LinkId, PatchId, link_names};

/// The kinds that places have, in the order of the legend, with their colours; that of a link as a whole has none.
const KINDS: [(ChangeKind, Colour); 13] = [
    (ChangeKind::Moved, Colour::rgb(0xfd_ae6b)),
    (ChangeKind::Turned, Colour::rgb(0x9e_cae1)),
    (ChangeKind::Swapped, Colour::rgb(0xbc_bddc)),
    (ChangeKind::Mirrored, Colour::rgb(0xf7_b6d2)),
    (ChangeKind::Missing, Colour::rgb(0xa6_a6a6)),
    (ChangeKind::New, Colour::rgb(0x74_c476)),
    (ChangeKind::Renumbered, Colour::rgb(0xff_ed6f)),
    (ChangeKind::Relinked, Colour::rgb(0x80_b1d3)),
    (ChangeKind::Tilted, Colour::rgb(0xd9_b38c)),
    (ChangeKind::Resized, Colour::rgb(0xcc_ebc5)),
    (ChangeKind::Regrouped, Colour::rgb(0xe5_c494)),
    (ChangeKind::Modality, Colour::rgb(0xfb_8072)),
    (ChangeKind::Region, Colour::rgb(0xb3_de69)),
];

/// Motions up to this many distances between taxels follow the differential of the map.
const NEAR: f64 = 2.0;

/// The longest arrow has at most this many distances between taxels, if it is lengthened at all.
const LONGEST: f64 = 1.5;

/// Head of an arrow over the height of letters, and its largest share of the arrow.
const HEAD: f64 = 0.5;
const HEAD_SHARE: f64 = 0.4;

/// A taxel with a change, on the map of a patch.
#[derive(Clone, Copy)]
struct Mark {
    /// The change, and its kind among [`KINDS`], by number.
    change: usize,
    kind: usize,
    /// Whether it is that with which the change exchanged its place.
    is_other: bool,
    patch: PatchId,
    /// `None` of a new taxel, which has no cell.
    taxel: Option<VertexId>,
    at: DVec2,
    /// To its place in the second file.
    motion: DVec2,
    /// Motion over the distance between taxels.
    share: f64,
}

impl Mark {
    /// A taxel of a change, at no place yet.
    fn of(change: usize, kind: usize, patch: PatchId) -> Self {
        let (at, motion) = (DVec2::ZERO, DVec2::ZERO);
        Self { change, kind, is_other: false, patch, taxel: None, at, motion, share: 0.0 }
    }
}

/// Draws what changed on level 0 of a map of the first file, patch by patch.
///
/// Taxels have the colour of the kind of their change, modules their name; crosses are missing taxels, hollow dots new
/// ones. Arrows are drawn to scale, or lengthened by a round number that is stated, so that small motions are seen. A link
/// that moved as a whole is stated in the caption: it has no arrows. Of `options` the patches and the width are used.
///
/// # Errors
/// If there is no such patch, the map is not valid, or the picture is narrower than its panels need or larger than 16384
/// pixels a side.
///
/// ```
/// use dermatome::diff::{DiffOptions, diff};
/// use dermatome::map::SkinMap;
/// use dermatome::mesh::shapes;
/// use dermatome::plot::{PlotOptions, plot_diff};
/// use dermatome::skin::{Draft, Sheet, TaxelId};
///
/// let mesh = shapes::lattice(8, 8, 0.005);
/// let (positions, ids) = (mesh.positions.as_slice().to_vec(), Some((1..=64).map(TaxelId).collect()));
/// let before = Draft { sheets: vec![Sheet { positions, ids, ..Sheet::default() }], ..Draft::default() };
/// let mut after = before.clone();
/// after.sheets[0].positions[20].x += 0.002;
/// let found = diff(&before, &after, &DiffOptions::default())?;
/// let picture = plot_diff(&SkinMap::flat(mesh, 1e-3), &found, &PlotOptions::default())?;
/// assert!(picture.to_svg().contains("moved 1"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn plot_diff(map: &SkinMap, diff: &Diff, options: &PlotOptions) -> Result<Picture, PlotError> {
    let patches = choose(&map.patches, |patch| &patch.name, &options.patches)?;
    map.validate()?;
    let marks = marks(map, diff)?;
    let views: Vec<_> =
        patches.iter().map(|patch| PatchView::of_map(map, patch)).collect::<Result<_, _>>()?;
    let mut rows = Vec::new();
    for (patch, view) in patches.iter().zip(&views) {
        let id = map.patches.enumerate().find(|(_, p)| std::ptr::eq(*p, *patch)).map(|(id, _)| id);
        let mut panel = Panel::on_map(view, LevelId::default());
        if let Some(panel) = &mut panel {
            panel.slot.caption.about = about(diff, map, patch);
        }
        rows.push(vec![panel.zip(id)]);
    }
    let (rows, layout) = lay_out(rows, |(panel, _)| &panel.slot, options.width_px)?;
    let slots = slots(&rows, |(panel, _)| &panel.slot);
    let longest = marks.iter().map(|mark| mark.share).fold(0.0, f64::max);
    let factor = if longest > 0.0 { round_down(LONGEST / longest).max(1.0) } else { 1.0 };
    let mut colours = vec![SKIN];
    colours.extend(KINDS.map(|(_, colour)| colour));
    let mut groups = Vec::new();
    for ((panel, patch), view) in rows.iter().flatten().flatten().zip(layout.views(&slots)) {
        let own: Vec<&Mark> = marks.iter().filter(|mark| mark.patch == *patch).collect();
        let mut cells: IdVec<VertexId, u32> = map.patches[*patch].taxels.ids.map(|_| 0);
        for (mark, taxel) in own.iter().filter_map(|mark| Some((mark, mark.taxel?))) {
            cells[taxel] = 1 + u32::try_from(mark.kind).unwrap_or_default();
        }
        groups.push(layout.caption(&panel.slot.caption, &view));
        groups.push(panel.draw_cells(&view, cells, &colours));
        groups.push(own.iter().flat_map(|mark| draw(mark, factor, layout.em, &view)).collect());
        groups.push(names(diff, &own, &layout, &view));
    }
    let count = |kind| diff.changes.iter().filter(|change| change.kind == kind).count();
    let kinds = KINDS.map(|(kind, colour)| (colour, kind, count(kind)));
    let shown = kinds.iter().filter(|(.., count)| *count > 0);
    let shown: Vec<_> = shown.map(|(colour, kind, count)| (*colour, format!("{kind} {count}"))).collect();
    let has_arrows = longest > 0.0 && factor > 1.0;
    let scale = if has_arrows { format!("arrows x {}", short(factor)) } else { String::new() };
    let (legend, left) = layout.legend_of_colours(&scale, &shown);
    groups.extend([layout.scale_bar_before(left), legend]);
    Ok(Picture {
        title: title("What changed on", views.iter().map(|view| view.name)),
        size_px: [layout.width, layout.height],
        em: layout.em,
        groups,
    })
}

/// The changed taxels. Those of changes that no link of the map has are left out.
fn marks(map: &SkinMap, diff: &Diff) -> Result<Vec<Mark>, PlotError> {
    let index = ContactIndex::new(map).map_err(|source| PlotError::Places { source: Box::new(source) })?;
    let mut marks = Vec::new();
    for (number, change) in diff.changes.iter().enumerate().filter(|(_, c)| c.subject != Subject::Link) {
        let Some(kind) = KINDS.iter().position(|(kind, _)| *kind == change.kind) else { continue };
        let Some(link) = link_of(map, change) else { continue };
        // A link without skin has no place.
        let locate = |at: DVec3| {
            let hit = index.locate(Query::on_link(link, at)).ok()?;
            Some((hit, map.patches[hit.patch].levels.get(LevelId::default())?))
        };
        if change.kind == ChangeKind::New {
            for (hit, level) in change.after.iter().filter_map(|&at| locate(at)) {
                marks.push(Mark { at: level.uv_at(&hit.point), ..Mark::of(number, kind, hit.patch) });
            }
            continue;
        }
        for (k, &before) in change.before.iter().enumerate() {
            let Some((hit, level)) = locate(before) else { continue };
            let spacing = index.spacing(hit.patch).unwrap_or(0.0);
            let moved = change.after.get(k).map_or(DVec3::ZERO, |after| *after - before);
            let there = || {
                let found = locate(before + moved).filter(|(there, _)| there.patch == hit.patch);
                found.map(|(there, _)| there.point)
            };
            let at = level.uv_at(&hit.point);
            let motion = if moved.length() <= NEAR * spacing {
                differential(level, &hit.point, moved)
            } else {
                there().map_or(DVec2::ZERO, |there| level.uv_at(&there) - at)
            };
            let share = if spacing > 0.0 { motion.length() / spacing } else { 0.0 };
            let taxel = nearest_corner(level, &hit.point);
            let mark = Mark { taxel, at, motion, share, ..Mark::of(number, kind, hit.patch) };
            // Of two that exchanged their places the change lists the taxels of one.
            if let Some(there) = (change.kind == ChangeKind::Swapped).then(there).flatten() {
                let (taxel, at) = (nearest_corner(level, &there), level.uv_at(&there));
                marks.push(Mark { is_other: true, taxel, at, motion: -motion, ..mark });
            }
            marks.push(mark);
        }
    }
    Ok(marks)
}

/// The link of a change: that of its patch, or that of its name; a map of one link has all.
fn link_of(map: &SkinMap, change: &Change) -> Option<LinkId> {
    let by_patch = map.patches.iter().find(|patch| patch.name == change.patch).map(|patch| patch.link);
    let mut named = map.links.ids().zip(link_names(&map.links));
    let by_name = || named.find(|(_, name)| *name == change.link).map(|(id, _)| id);
    let only = || map.links.ids().next().filter(|_| map.links.len() == 1);
    by_patch.or_else(by_name).or_else(only)
}

/// The taxel of the largest weight at a point of the skin.
fn nearest_corner(level: &MapLevel, point: &SurfacePoint) -> Option<VertexId> {
    let corners = level.level.mesh.triangles[point.face].into_iter().zip(point.barycentric);
    corners.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(corner, _)| corner)
}

/// What the map makes of a small motion from a point of the skin: the least-squares solution in the plane of its
/// triangle; zero where that has no area.
fn differential(level: &MapLevel, point: &SurfacePoint, motion: DVec3) -> DVec2 {
    let corners = level.level.mesh.corners(point.face);
    let (e, f) = (corners[1] - corners[0], corners[2] - corners[0]);
    let (ee, ef, ff) = (e.dot(e), e.dot(f), f.dot(f));
    let determinant = ee * ff - ef * ef;
    if determinant <= 0.0 {
        return DVec2::ZERO;
    }
    let (me, mf) = (motion.dot(e), motion.dot(f));
    let [a, b] = [(ff * me - ef * mf) / determinant, (ee * mf - ef * me) / determinant];
    let uv = level.uv_of(point.face);
    a * (uv[1] - uv[0]) + b * (uv[2] - uv[0])
}

/// An arrow, a cross of a missing taxel, or a hollow dot of a new one.
fn draw(mark: &Mark, factor: f64, em: f64, view: &View) -> Vec<Shape> {
    let at = view.to_pixels(mark.at);
    let line = |path| {
        let stroke = |colour, width| Some(Stroke { colour, width, opacity: 1.0 });
        let (halo, ink) = (stroke(Colour::WHITE, 0.24 * em), stroke(INK, 0.1 * em));
        let shape = |stroke| Shape::Path { path: Clone::clone(&path), fill: None, stroke };
        vec![shape(halo), shape(ink)]
    };
    let mut path = Path::default();
    match KINDS[mark.kind].0 {
        ChangeKind::New => {
            let (radius, colour) = (0.35 * em, KINDS[mark.kind].1);
            return vec![Shape::Dots { centres: vec![at], radius, colour, has_rim: true }];
        }
        ChangeKind::Missing => {
            for d in [DVec2::new(0.25, 0.25), DVec2::new(0.25, -0.25)].map(|d| d * em) {
                path.move_to(at - d);
                path.line_to(at + d);
            }
        }
        _ => {
            let tip = view.to_pixels(mark.at + factor * mark.motion);
            let along = tip - at;
            // An arrow shorter than a pixel is not seen.
            if along.length() < 1.0 {
                return Vec::new();
            }
            let head = along.normalize() * (HEAD * em).min(HEAD_SHARE * along.length());
            path.move_to(at);
            path.line_to(tip);
            for side in [-0.5, 0.5] {
                path.move_to(tip);
                path.line_to(tip - head + side * head.perp());
            }
        }
    }
    line(path)
}

/// The name of each changed module, above its topmost taxel.
fn names(diff: &Diff, marks: &[&Mark], layout: &Layout, view: &View) -> Vec<Shape> {
    let mut spans: BTreeMap<(usize, bool), (DVec2, DVec2)> = BTreeMap::new();
    for mark in marks {
        let at = view.to_pixels(mark.at);
        let span = spans.entry((mark.change, mark.is_other)).or_insert((at, at));
        *span = (span.0.min(at), span.1.max(at));
    }
    let name = |(&(change, is_other), &(low, high)): (&(usize, bool), &(DVec2, DVec2))| {
        let change = diff.changes.get(change).filter(|change| change.subject == Subject::Module)?;
        let name = if is_other { change.other.as_deref()? } else { &change.name };
        let at = DVec2::new(0.5 * (low.x + high.x), low.y - layout.em);
        (!name.is_empty()).then(|| layout.plate(&printable(name), at))
    };
    spans.iter().filter_map(name).flatten().collect()
}

/// The changes of a patch by number, and how its link moved as a whole.
fn about(diff: &Diff, map: &SkinMap, patch: &PatchMap) -> [String; 2] {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    let own = diff.changes.iter().filter(|change| change.patch == patch.name);
    for change in own.filter(|change| change.subject != Subject::Link) {
        if let Some(kind) = KINDS.iter().position(|(kind, _)| *kind == change.kind) {
            *counts.entry(kind).or_default() += change.taxels.len();
        }
    }
    let counts: Vec<String> =
        counts.iter().map(|(&kind, count)| format!("{count} {}", KINDS[kind].0)).collect();
    let taxels = match &counts[..] {
        [] => "no taxel changed".to_owned(),
        some => format!("{} taxels: {}", patch.taxels.ids.len(), some.join(", ")),
    };
    let whole = diff
        .changes
        .iter()
        .find(|change| change.subject == Subject::Link && link_of(map, change) == Some(patch.link));
    let whole = whole.map_or(String::new(), |change| match change.kind {
        ChangeKind::Mirrored => "ids mirrored".to_owned(),
        _ => format!(
            "link moved by {} mm and {}\u{b0}",
            short(1e3 * change.distance),
            short(change.angle.to_degrees())
        ),
    });
    [taxels, whole]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diff::{DiffOptions, diff};
    use crate::mesh::shapes;
    use crate::skin::{Draft, Sheet, TaxelId};

    /// The marks of a flat skin of 10 x 10 taxels, 5 mm apart, of which some moved.
    fn marks_of(moves: &[(usize, DVec3)]) -> Vec<Mark> {
        let mesh = shapes::lattice(10, 10, 0.005);
        let (positions, ids) = (mesh.positions.as_slice().to_vec(), Some((1..=100).map(TaxelId).collect()));
        let before = Draft { sheets: vec![Sheet { positions, ids, ..Sheet::default() }], ..Draft::default() };
        let mut after = before.clone();
        moves.iter().for_each(|&(k, motion)| after.sheets[0].positions[k] += motion);
        let found = diff(&before, &after, &DiffOptions::default()).unwrap();
        marks(&SkinMap::flat(mesh, 1e-3), &found).unwrap()
    }

    #[test]
    fn an_arrow_on_a_flat_map_is_the_motion_in_its_plane() {
        let motion = DVec3::new(0.002, -0.001, 0.003);
        // In the middle, on the boundary and at a corner, from where it leaves the skin.
        for taxel in [44, 40, 0] {
            let marks = marks_of(&[(taxel, -motion)]);
            assert_eq!((marks.len(), marks[0].taxel), (1, Some(VertexId::new(taxel))));
            assert!(marks[0].motion.distance(-motion.truncate()) < 1e-9, "{:?}", marks[0].motion);
        }
    }

    #[test]
    fn taxels_that_exchanged_their_places_have_arrows_both_ways() {
        let mesh = shapes::lattice(10, 10, 0.005);
        let way = mesh.positions[VertexId::new(78)] - mesh.positions[VertexId::new(12)];
        let marks = marks_of(&[(12, way), (78, -way)]);
        let mut taxels: Vec<_> = marks.iter().map(|mark| (mark.taxel, mark.is_other)).collect();
        taxels.sort_unstable();
        assert_eq!(taxels, [(Some(VertexId::new(12)), false), (Some(VertexId::new(78)), true)]);
        for mark in &marks {
            let expected = if mark.is_other { -way } else { way };
            assert!(mark.motion.distance(expected.truncate()) < 1e-9, "{:?}", mark.motion);
        }
    }
}
