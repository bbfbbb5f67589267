//! Triangulating: taxels without triangles become a mesh.
//!
//! The method is the tangential Delaunay complex `(boissonnat2014)`: every taxel triangulates its
//! neighbours in its tangent plane, and the triangles on which corners agree form the mesh. The
//! files in the order of the algorithm:
//!
//! 1. `unique_points`: coincident taxels become one (the first that reads pressure), and so do taxels closer
//!    than a fiftieth of the spacing: one position, rounded differently. Empty slots are left out; thermal
//!    pads and dead taxels have a position, and are kept.
//! 2. `neighbours`: the spacing is the distance to the third nearest taxel, smoothed; edges are no longer
//!    than the gap times the spacing at their ends.
//! 3. `normals`: those of rigid modules ([`Sheet::modules`]), else planes of least squares, turned to one
//!    side along a spanning tree (`(hoppe1992)`, `(konig2009)`). Those of the file, where these are reliable (unit
//!    vectors along the planes of the neighbourhoods, not all the same on a curved surface), separate the
//!    sides of a thin body, guide the tree, and determine the outside.
//! 4. `candidates`: the triangles of the Delaunay triangulations in the tangent planes, by the votes of
//!    their corners.
//! 5. `growing_mesh`: takes those with two votes, then those of one that fit between them, unless a face
//!    would give an edge a third face, or overlap in the tangent plane of a corner.
//! 6. `repair`: small holes, touching fans, isolated taxels.
//! 7. `orient_outward`: where fewer than two thirds of a component's normals point to one side, the outside
//!    is away from the centre of the sheet.
//!
//! `triangulate_taxels` takes these steps sheet by sheet. Taxels keep the order of the file, and so do
//! arrays. The result does not depend on that order, up to numbering, nor on frame and unit, except for the
//! diagonals of squares, which each taxel decides by a small displacement of its own. Time and memory are near-linear.
//!
//! What each heuristic contributes, measured once with each switched off: pieces, holes and taxels left out,
//! summed over the shapes of each kind of cover that changes without it, and in how many edges; the last four
//! are body parts of the iCub.
//!
//! ```text
//! all                  noise 10/2/0  rough 10/43/9  dense 1/2/0  copies 1/0/45  tube 10/10/0  fold 7/0/0
//!                      noisy fold 10/6/0  plate 16/0/0  noisy plate 20/0/0  tip 10/0/0  modules 10/8/0
//!                      arm 4/0/418  forearm 2/0/236  hand 1/0/144  torso 1/0/321
//! without
//! MergeClose           copies 1/0/0 (220)
//! SmoothSpacing        rough 10/45/6 (203)  dense 1/0/0 (30)  fold (134)  noisy fold 10/7/0 (43)
//!                      modules 10/6/0 (49)  arm 1/2/418 (30)  forearm (12)  hand (12)  torso (10)
//! TwoSides             tube 10/0/0 (57)  plate 15/0/0 (5)  noisy plate 19/4/27 (667)  tip (2)
//! BentNormals          tip 2/0/0 8 refused (204)
//! ModulePlanes         modules (12)  arm (4)  forearm (8)  torso (10)
//! SteepLast            rough 15/39/12 (142)
//! DeniedLast           noisy fold 10/7/0 (3)
//! SameSide             tube (9); with TwoSides: tube 10/2/0  plate 10/18/0  noisy plate 10/58/30
//! WideCircles          fold (516)  modules 10/12/0 (44)  hand (2)
//! OneVote              noise 10/4/0 (11)  rough 10/73/9 (92)  dense 1/4/0 (12)  fold 7/8/0 (184)
//! SmallHoles           rough 10/53/9 (3)  dense 1/4/0 (0)  noisy fold 10/8/0 (2); with OneVote: torso 1/7/321
//! AttachIsolated       rough 10/43/17 (23)  forearm 2/0/237 (2)
//! SplitFace            rough 10/43/16 (21)
//! ```
//!
//! Not guaranteed: that the mesh is the surface between the taxels. Surfaces that are closer than the spacing
//! are joined if no normals distinguish them.

mod candidates;
mod growing_mesh;
mod neighbours;
mod normals;
mod orient_outward;
mod repair;
mod unique_points;

pub(super) use unique_points::UniquePoints;

use glam::{DAffine3, DVec3};

use crate::delaunay::smallest_first;
use crate::id::{FaceId, IdVec, VertexId};
use crate::numeric::median;
use crate::skin::remark::note;
use crate::skin::triangulate::candidates::candidates;
use crate::skin::triangulate::growing_mesh::GrowingMesh;
use crate::skin::triangulate::neighbours::{Neighbours, PointCloud};
use crate::skin::triangulate::normals::{PointNormals, orient_normals};
use crate::skin::triangulate::orient_outward::{Outside, World, orient_outward};
use crate::skin::triangulate::repair::{attach_isolated, fill_small_holes, remove_extra_fans};
use crate::skin::{Draft, Remark, RemarkKind, Sheet, SkinError, world_pose};

/// Allowed gaps: below 1 nothing is joined, and the work grows with the square.
const GAPS: std::ops::RangeInclusive<f64> = 1.0..=20.0;

/// A sheet whose median neighbourhood is at least this thick is a cloud: a noise of a third of the
/// spacing reaches 0.1, random points in a ball 0.5.
const MAX_THICKNESS: f64 = 0.25;

/// A smaller share of opposing normals than one in this many is not reported.
const MIN_REPORTED: usize = 20;

/// Joins the taxels of every bare sheet of a draft, and adds remarks on what was done. `gap` and
/// `outside` are those of [`crate::skin::AssembleOptions`]; the links are valid. Fails if the gap is out of range, or the taxels
/// of every sheet have fewer than three positions, lie in a cloud rather than on a surface, or have no
/// triangle within the gap. Such a sheet among others is left out, with a remark.
pub(super) fn triangulate_taxels(
    draft: &Draft,
    gap: f64,
    outside: Option<DVec3>,
) -> Result<Draft, SkinError> {
    for sheet in draft.sheets.iter().filter(|sheet| draft.is_bare() || sheet.is_to_join()) {
        sheet.validate(draft.links.len())?;
    }
    if !GAPS.contains(&gap) {
        return Err(SkinError::Gap { found: gap });
    }
    let mut result = Draft { sheets: Vec::new(), ..draft.clone() };
    let mut refused = None;
    for sheet in &draft.sheets {
        let mut kinds = Vec::new();
        if sheet.positions.is_empty() || !(draft.is_bare() || sheet.is_to_join()) {
            result.sheets.push(sheet.clone());
        } else {
            let pose = sheet.link.map_or(DAffine3::IDENTITY, |link| world_pose(&draft.links, link));
            match triangulate_sheet(sheet, gap, World { outside, turn: pose.matrix3 }, &mut kinds) {
                Ok(sheet) => result.sheets.push(sheet),
                Err(reason) => {
                    let taxels = sheet.positions.len();
                    kinds.push(RemarkKind::SheetLeftOut { taxels, reason: reason.clone() });
                    refused.get_or_insert(reason);
                }
            }
        }
        let remark = |kind| Remark { patch: sheet.title().to_owned(), kind };
        result.remarks.extend(kinds.into_iter().map(remark));
    }
    match refused {
        Some(why) if result.sheets.iter().all(|s| s.triangles.is_empty()) => Err(why),
        _ => Ok(result),
    }
}

fn triangulate_sheet(
    sheet: &Sheet,
    gap: f64,
    world: World,
    remarks: &mut Vec<RemarkKind>,
) -> Result<Sheet, SkinError> {
    let patch = || sheet.title().to_owned();
    let points = UniquePoints::new(sheet);
    let positions = &points.positions;
    let places = positions.len();
    if places < 3 {
        return Err(SkinError::TooFewPlaces { patch: patch(), found: places });
    }
    let mut neighbours = Neighbours::new(positions, gap);
    let mut normals = PointNormals::new(&points, &mut neighbours);
    if normals.thickness > MAX_THICKNESS && !normals.has_file() {
        return Err(SkinError::NoSurface { patch: patch(), thickness: normals.thickness });
    }
    orient_normals(&mut normals, positions, &neighbours);
    let cloud = PointCloud { positions, normals: &normals.normal, neighbours: &neighbours, gap };
    let mut triangles = grow(&cloud, &points.hashes());
    if triangles.is_empty() {
        return Err(SkinError::NoFace { patch: patch(), places });
    }
    let outside = orient_outward(&mut triangles, positions, &normals.file, world);
    let (mut result, left_out) = sheet_of(&points, &triangles);
    if normals.refused.is_some() {
        result.normals = None;
    }
    remarks.push(RemarkKind::Triangulated {
        taxels: result.positions.len(),
        triangles: triangles.len(),
        gap,
        longest: gap * points.unit * median(neighbours.spacing.iter().copied()).unwrap_or(0.0),
    });
    report(&points, &normals, &outside, remarks);
    note(remarks, left_out, |vertices| RemarkKind::LeftOut { vertices });
    Ok(result)
}

/// Joins the taxels: first by triangles with two or three votes, then by those of one vote in the gaps that
/// are left, and last by triangles that attach isolated taxels.
fn grow(cloud: &PointCloud<'_>, hashes: &IdVec<VertexId, u64>) -> IdVec<FaceId, [VertexId; 3]> {
    let candidates = candidates(cloud, hashes);
    let (agreed, doubtful) = candidates.split_at(candidates.partition_point(|c| c.votes > 1));
    let mut mesh = GrowingMesh::new(cloud);
    for candidate in agreed {
        mesh.try_insert(candidate.corners);
    }
    // Passes repeat until none fits, those with two sides first. A face that does not fit never will.
    let mut doubtful: Vec<[VertexId; 3]> = doubtful.iter().map(|candidate| candidate.corners).collect();
    let mut pass = |adjacent: usize| {
        let mut is_larger = false;
        doubtful.retain(|&t| {
            let is_next = mesh.adjacent_faces(t) >= adjacent;
            is_larger |= is_next && mesh.try_insert(t);
            !is_next
        });
        is_larger
    };
    while pass(2) || pass(1) {}
    fill_small_holes(&mut mesh, cloud);
    remove_extra_fans(&mut mesh, cloud);
    attach_isolated(&mut mesh, cloud);
    mesh.into_triangles()
}

fn report(
    points: &UniquePoints<'_>,
    normals: &PointNormals,
    outside: &Outside,
    remarks: &mut Vec<RemarkKind>,
) {
    let UniquePoints { merged, distance, absent, .. } = points;
    if *absent > 0 {
        remarks.push(RemarkKind::EmptySlots { slots: *absent });
    }
    note(remarks, merged.clone(), |vertices| RemarkKind::Merged { vertices, distance: *distance });
    if let Some(reason) = normals.refused {
        remarks.push(RemarkKind::NormalsIgnored { reason });
    }
    let &Outside { centre, arbitrary, opposed, normals: of } = outside;
    if opposed > of / MIN_REPORTED {
        remarks.push(RemarkKind::NormalsOpposed { opposed, of });
    }
    if centre > 0 {
        remarks.push(RemarkKind::OutsideFromCentre { components: centre });
    }
    if arbitrary > 0 {
        remarks.push(RemarkKind::OutsideFromAxis { components: arbitrary });
    }
}

/// The taxels that have a face, in the order of the file, with their faces; and the taxels left
/// out.
fn sheet_of(points: &UniquePoints<'_>, triangles: &IdVec<FaceId, [VertexId; 3]>) -> (Sheet, Vec<VertexId>) {
    let mut used = vec![false; points.sheet.positions.len()];
    for &v in triangles.iter().flatten() {
        used[points.taxel[v]] = true;
    }
    let unused = points.taxel.iter().filter(|&&k| !used[k]);
    let mut left_out: Vec<VertexId> = unused.map(|&k| VertexId::new(k)).collect();
    left_out.sort_unstable();
    let kept: Vec<usize> = (0..used.len()).filter(|&k| used[k]).collect();
    let mut number = vec![0_u32; used.len()];
    (0..).zip(&kept).for_each(|(new, &k)| number[k] = new);
    let faces = triangles.iter().map(|t| smallest_first(t.map(|v| number[points.taxel[v]])));
    let in_file = |&k: &usize| points.sheet.numbers.as_ref().map_or(VertexId::new(k).raw(), |all| all[k]);
    let numbers = Some(kept.iter().map(in_file).collect());
    let mut sheet = Sheet { triangles: faces.collect(), numbers, ..points.sheet.select(&kept) };
    sheet.triangles.sort_unstable();
    (sheet, left_out)
}
