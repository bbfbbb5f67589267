//! Necks: strips of the surface between two rims, far narrower than the spacing.
//!
//! CAD leaves a hair of sheet between two holes that nearly touch, and teeth where a wall lies twice and one copy
//! was dropped. Both sides of a strip are rims, whose vertices cannot merge across it: its faces would have no
//! height. The strip is removed: two holes become one, a tooth is lost.
//!
//! *Heuristic*: of a wall that hangs in 21 strips 0.4 to 1 mm wide (Unitree Go1, lower leg, 10 mm) 22 faces were lower
//! than 2 % of the spacing without it, 13 where only faces between two rims count, 9 as it is.
//!
//! A strip that alone connects two parts stays, since a patch must be one piece.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Adjacency, Halfedge, MeshError, TriMesh, joined_corners};
use crate::numeric::DisjointSets;
use crate::remesh::faces::height;

/// A strip has its rims along it: less than this share of its outline is connected to other faces.
const MAX_BORDER: f64 = 0.2;

/// Removes the strips narrower than `width` (m). A part smaller than `least` (m^2) that only strips connect to the
/// others is removed with them.
pub(super) fn open_necks(mesh: &mut TriMesh, width: f64, least: f64) -> Result<(), MeshError> {
    let adjacency = Adjacency::new(mesh)?;
    let rises_little = |h: Halfedge| {
        adjacency.twin(h).is_none() && mesh.face_cross(h.face()).length() < width * length(mesh, h)
    };
    // A broad strip has faces, and may have vertices, between its sides.
    let is_near = |&v: &VertexId| {
        let to_rim = |w: &VertexId| {
            adjacency.is_boundary(*w) && mesh.positions[v].distance(mesh.positions[*w]) < width
        };
        adjacency.is_boundary(v) || adjacency.ring(v).iter().any(to_rim)
    };
    let is_low =
        |face: FaceId| height(mesh.corners(face)) < width && mesh.triangles[face].iter().all(is_near);
    // Needles across the sheet may share edges with a neck. They are high above each rim, so they are not part of it.
    let is_above_rim = |face: FaceId| {
        mesh.triangles[face].iter().all(|&v| adjacency.is_boundary(v))
            && Halfedge::of_face(face).into_iter().any(rises_little)
    };
    let (low, above_rims) = (mesh.triangles.ids().map(is_low), mesh.triangles.ids().map(is_above_rim));
    let [mut is_removed, others] =
        [low.collect(), above_rims.collect()].map(|faces| strips(mesh, &adjacency, &faces, width));
    is_removed.iter_mut().zip(others).for_each(|(removed, other)| *removed |= other);
    if is_removed.iter().any(|&removed| removed) {
        keep_connected(mesh, &adjacency, &mut is_removed, least);
        let is_kept = is_removed.map(|removed| !removed);
        let across = |h: Halfedge| adjacency.twin(h).filter(|twin| is_kept[h.face()] && is_kept[twin.face()]);
        *mesh = with_own_vertices(&mesh.positions, &mesh.triangles, &is_kept, across).0;
    }
    Ok(())
}

/// Which of some faces, joined across their edges, are strips narrower than `width` (m).
fn strips(
    mesh: &TriMesh,
    adjacency: &Adjacency,
    faces: &IdVec<FaceId, bool>,
    width: f64,
) -> IdVec<FaceId, bool> {
    let mut sets = connected(faces, adjacency, true);
    let [mut areas, mut rims, mut borders] = [(); 3].map(|()| faces.map(|_| 0.0));
    for face in faces.ids().filter(|&face| faces[face]) {
        let strip = sets.root(face);
        areas[strip] += mesh.face_area(face);
        for h in Halfedge::of_face(face) {
            match adjacency.twin(h) {
                None => rims[strip] += length(mesh, h),
                Some(twin) if !faces[twin.face()] => borders[strip] += length(mesh, h),
                Some(_) => {}
            }
        }
    }
    let is_strip = |strip: FaceId| {
        borders[strip] < MAX_BORDER * (borders[strip] + rims[strip])
            && 2.0 * areas[strip] < width * rims[strip]
    };
    faces.ids().map(|face| faces[face] && is_strip(sets.root(face))).collect()
}

fn length(mesh: &TriMesh, h: Halfedge) -> f64 {
    mesh.positions[h.start(mesh)].distance(mesh.positions[h.end(mesh)])
}

/// The faces that are of a kind, joined across their edges.
fn connected(faces: &IdVec<FaceId, bool>, adjacency: &Adjacency, kind: bool) -> DisjointSets<FaceId> {
    let mut sets = DisjointSets::<FaceId>::new(faces.len());
    for face in faces.ids().filter(|&face| faces[face] == kind) {
        let neighbours = adjacency.neighbours(face).into_iter().flatten();
        neighbours.filter(|&other| faces[other] == kind).for_each(|other| sets.join(face, other));
    }
    sets
}

/// Puts back the strips that alone connect two parts of at least the area `least`, and removes the smaller parts that
/// only strips connect. Removes nothing if all parts are smaller.
fn keep_connected(mesh: &TriMesh, adjacency: &Adjacency, is_removed: &mut IdVec<FaceId, bool>, least: f64) {
    let mut strips = connected(is_removed, adjacency, true);
    let mut parts = connected(is_removed, adjacency, false);
    let mut areas = is_removed.map(|_| 0.0);
    for face in mesh.triangles.ids() {
        areas[parts.root(face)] += mesh.face_area(face);
    }
    let mut of_strip: Vec<(FaceId, FaceId)> =
        is_removed.ids().filter(|&face| is_removed[face]).map(|face| (strips.root(face), face)).collect();
    of_strip.sort_unstable();
    let mut loose = Vec::new();
    for strip in of_strip.chunk_by(|a, b| a.0 == b.0) {
        let around = strip.iter().flat_map(|&(_, face)| adjacency.neighbours(face)).flatten();
        let around: Vec<FaceId> = around.filter(|&face| !is_removed[face]).collect();
        let mut large: Vec<FaceId> = around.iter().map(|&face| parts.root(face)).collect();
        loose.extend(large.iter().copied().filter(|&part| areas[part] < least));
        large.retain(|&part| areas[part] >= least);
        large.sort_unstable();
        large.dedup();
        if large.len() > 1 {
            let faces = strip.iter().map(|&(_, face)| face);
            for part in faces.inspect(|&face| is_removed[face] = false).chain(around) {
                let [a, b] = [large[0], part].map(|face| parts.root(face));
                if a != b {
                    parts.join(a, b);
                    areas[a.min(b)] = areas[a] + areas[b];
                }
            }
        }
    }
    loose.iter_mut().for_each(|part| *part = parts.root(*part));
    loose.retain(|&part| areas[part] < least);
    loose.sort_unstable();
    for face in mesh.triangles.ids().filter(|&face| !is_removed[face]).collect::<Vec<_>>() {
        is_removed[face] = loose.binary_search(&parts.root(face)).is_ok();
    }
    if is_removed.iter().all(|&removed| removed) {
        is_removed.iter_mut().for_each(|removed| *removed = false);
    }
}

/// The faces that are kept; where those around a vertex are not one fan, each fan has its own vertex. `across` leads
/// from a halfedge to its twin, or nowhere where the surface ends. Returns the old vertex of each new one too.
pub(super) fn with_own_vertices(
    positions: &IdVec<VertexId, DVec3>,
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    is_kept: &IdVec<FaceId, bool>,
    across: impl Fn(Halfedge) -> Option<Halfedge>,
) -> (TriMesh, IdVec<VertexId, VertexId>) {
    let mut corners = joined_corners(triangles.len(), across);
    let (mut rest, mut old) = (TriMesh::default(), IdVec::default());
    let mut new = IdVec::<Halfedge, Option<VertexId>>::filled(None, 4 * triangles.len());
    for face in triangles.ids().filter(|&face| is_kept[face]) {
        let triangle = Halfedge::of_face(face).map(|corner| {
            let v = triangles[face][corner.side()];
            *new[corners.root(corner)].get_or_insert_with(|| {
                old.push(v);
                rest.positions.push(positions[v])
            })
        });
        rest.triangles.push(triangle);
    }
    (rest, old)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{separate, shapes};
    use crate::remesh::remesh;

    /// A sheet of cells of given widths and heights (m), two triangles each, without some cells.
    fn cells(widths: &[f64], heights: &[f64], is_hole: impl Fn(usize, usize) -> bool) -> TriMesh {
        let sum = |of: &[f64], n: u32| of.iter().take(n as usize).sum::<f64>();
        let [columns, rows] = [widths, heights].map(|all| u32::try_from(all.len()).unwrap());
        let at = |i: u32, j: u32| DVec3::new(sum(widths, i), sum(heights, j), 0.0);
        let mesh = shapes::sheet(columns + 1, rows + 1, at);
        let centre = |t: &[VertexId; 3]| t.iter().map(|&v| mesh.positions[v]).sum::<DVec3>() / 3.0;
        let cell =
            |of: &[f64], x: f64| (0..u32::try_from(of.len()).unwrap()).rposition(|k| sum(of, k) < x).unwrap();
        let part = mesh.triangles.map(|t| {
            let p = centre(t);
            (!is_hole(cell(widths, p.x), cell(heights, p.y))).then_some(0)
        });
        separate(&mesh, &part, 1).remove(0).mesh
    }

    fn faults(mesh: &TriMesh, spacing: f64) -> (usize, i64, usize, f64) {
        let made = remesh(mesh, spacing).unwrap();
        let low = made.triangles.ids().filter(|&face| height(made.corners(face)) < 0.02 * spacing).count();
        let topology = Adjacency::new(&made).unwrap().topology();
        (low, topology.euler, topology.components, made.area())
    }

    #[test]
    fn holes_that_nearly_touch_become_one() {
        let plate = |neck: f64| {
            cells(&[0.03, 0.04, neck, 0.04, 0.03], &[0.03, 0.04, 0.03], |i, j| j == 1 && (i == 1 || i == 3))
        };
        let (low, euler, components, area) = faults(&plate(1e-4), 0.01);
        assert_eq!((low, euler, components), (0, 0, 1), "one hole");
        assert!((area / (0.1401 * 0.1 - 0.0801 * 0.04) - 1.0).abs() < 0.01);
        let (low, euler, components, _) = faults(&plate(5e-3), 0.01);
        assert_eq!((low, euler, components), (0, -1, 1), "a wide neck stays");
        // Taxels on its two sides would be nearer to each other than a third of the spacing.
        let (low, euler, components, _) = faults(&plate(2e-3), 0.01);
        assert_eq!((low, euler, components), (0, 0, 1), "a bridge is cut");
    }

    #[test]
    fn teeth_of_a_rim_are_lost() {
        let widths: Vec<f64> = (0..100).map(|k| if k % 4 == 3 { 1e-4 } else { 1e-3 }).collect();
        let comb = cells(&widths, &[0.05, 0.014], |i, j| j == 1 && i % 4 != 3);
        let (low, euler, components, area) = faults(&comb, 0.01);
        assert_eq!((low, euler, components), (0, 1, 1));
        assert!((area / (0.05 * widths.iter().sum::<f64>()) - 1.0).abs() < 0.01);
    }

    /// A dumbbell, a ladder and a flag: the rung that is needed stays, the flag smaller than a taxel goes.
    #[test]
    fn a_strip_that_alone_connects_parts_stays() {
        let area = |mesh: &mut TriMesh| {
            open_necks(mesh, 5e-4, 2.6e-4).unwrap();
            (Adjacency::new(mesh).unwrap().topology().components, mesh.area())
        };
        let mut dumbbell = cells(&[0.05, 0.01, 0.05], &[0.02, 1e-4, 0.02], |i, j| i == 1 && j != 1);
        let whole = dumbbell.area();
        assert_eq!(area(&mut dumbbell), (1, whole));
        let mut ladder =
            cells(&[0.05, 0.01, 0.05], &[0.02, 1e-4, 0.02, 1e-4, 0.02], |i, j| i == 1 && j % 2 == 0);
        let whole = ladder.area();
        let (components, left) = area(&mut ladder);
        assert_eq!(components, 1);
        assert!((whole - left - 1e-6).abs() < 1e-12, "one of two rungs");
        let mut flag = cells(&[0.05, 0.01, 0.01], &[0.01, 1e-4, 0.01], |i, j| i == 1 && j != 1);
        let (components, left) = area(&mut flag);
        assert_eq!(components, 1);
        assert!((left - 0.05 * 0.0201).abs() < 1e-9, "{left}");
    }

    /// The low faces of a sheet of needles from rim to rim are not a strip.
    #[test]
    fn a_sheet_of_needles_stays() {
        let mut sheet = cells(&[1e-4; 50], &[0.03], |_, _| false);
        let whole = sheet.clone();
        open_necks(&mut sheet, 5e-4, 2.6e-5).unwrap();
        assert_eq!(sheet, whole);
    }
}
