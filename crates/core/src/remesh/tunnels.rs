//! Tunnels and bridges: where three edges, or one between two rims, surround a part of the new mesh.
//!
//! CAD connects walls by tubes far thinner than the spacing, as where screws pass through them, and rims by a corner.
//! Collapses leave a loop of three edges around such a tube that no face fills, or an edge between two rims. Neither can
//! shrink without a change of topology, so taxels would stay nearer to each other than a third of the spacing, and
//! faces flat. The mesh is cut there; a face fills each side of a loop.
//!
//! *Heuristic*: of ten robots at 10 mm (Spot with its arm apart, Go1 twice, Kinova twice, Romeo, Talos, two Inspire hands)
//! 1869 edges were shorter than a third of the spacing and 102 faces lower than 2 % of it without the cuts, 271 and 2 with
//! them, for 0.07 % of the area. Where loops are cut in the rounds too, about as many are left.
//!
//! A loop that alone connects two parts stays, since a patch must be one piece, unless one of them is smaller than a
//! taxel, which is removed.

use std::collections::HashMap;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Adjacency, Halfedge, HalfedgeMesh, MeshError, TriMesh};
use crate::numeric::{DisjointSets, Labels};
use crate::remesh::necks::with_own_vertices;
use crate::remesh::rounds::Rounds;
use crate::remesh::thin::SHORTEST_EDGE;

/// Loops of three edges are cut if they are shorter than this multiple of the target: longer ones need no short edge.
const MAX_GIRTH: f64 = 3.0 * SHORTEST_EDGE;

/// They are also cut if one edge is shorter than this fraction of the target, as of a hair between two walls.
const NARROW: f64 = 0.1;

/// Most times that loops are cut: those of one pass share no vertex.
const MAX_CUTS: usize = 3;

/// Thin shells may shrink to nothing where their ends are cut: cuts that leave less than this fraction of the area are
/// undone.
const LEAST_LEFT: f64 = 0.9;

/// The loops that may be cut, by their lengths in m, and the area (m^2) of parts that are removed.
#[derive(Clone, Copy)]
struct Limits {
    /// An edge of a loop is shorter.
    shortest: f64,
    girth: f64,
    /// With an edge that is shorter than this a loop may have any length.
    narrow: f64,
    area: f64,
}

/// A mesh that was cut, with the vertices and faces of the old one; faces that fill a loop have none.
struct Opened {
    mesh: TriMesh,
    vertices: IdVec<VertexId, VertexId>,
    faces: IdVec<FaceId, Option<FaceId>>,
}

/// Edges that may be cut.
struct Loop {
    /// The vertices around a tube; none for an edge between two rims.
    around: Option<[VertexId; 3]>,
    /// The halfedges from each vertex to the next, and those back, where there are faces.
    sides: [Vec<Halfedge>; 2],
}

impl Rounds<'_> {
    /// Cuts tunnels and bridges, and removes the faces that are thin then.
    pub(super) fn cut_tunnels(&mut self) {
        for pass in 0..MAX_CUTS {
            let before = self.clone();
            // Each pass could remove one more end of a limb.
            let area = if pass == 0 { 0.75_f64.sqrt() * self.target * self.target } else { 0.0 };
            let [shortest, girth, narrow] = [SHORTEST_EDGE, MAX_GIRTH, NARROW].map(|part| part * self.target);
            if !self.cut_loops(Limits { shortest, girth, narrow, area }) {
                return;
            }
            self.remove_last_thin();
            if self.area() < LEAST_LEFT * before.area() {
                *self = before;
                return;
            }
        }
    }

    fn area(&self) -> f64 {
        let alive = self.mesh.face_ids().filter(|&face| self.mesh.is_alive(face));
        alive.map(|face| 0.5 * self.cross(face).length()).sum()
    }

    /// Returns whether there was a loop to cut.
    fn cut_loops(&mut self, limits: Limits) -> bool {
        self.compact();
        let mesh = TriMesh { triangles: self.mesh.triangles(), positions: self.positions.clone() };
        // Fails where two edges connect the same vertices, which are split later.
        let Ok(Some(Opened { mesh, vertices, faces })) = opened(&mesh, limits) else { return false };
        let Ok((halfedges, _)) = HalfedgeMesh::new(&mesh) else { return false };
        self.sharp = faces.map(|&old| old.map_or([false; 3], |old| self.sharp[old]));
        self.freedom = vertices.map(|&v| self.freedom[v]);
        self.near = vertices.map(|&v| self.near[v]);
        (self.positions, self.mesh) = (mesh.positions, halfedges);
        for h in self.mesh.halfedges().filter(|&h| self.mesh.twin(h) == Halfedge::NONE) {
            self.sharp[h.face()][h.side()] = true;
        }
        true
    }
}

/// Cuts a mesh along the loops that may be cut and need not stay.
fn opened(mesh: &TriMesh, limits: Limits) -> Result<Option<Opened>, MeshError> {
    let adjacency = Adjacency::new(mesh)?;
    let mut loops = loops(mesh, &adjacency, limits);
    let parts = parts(mesh, &adjacency, &loops);
    let mut areas = vec![0.0; parts.count];
    mesh.triangles.ids().for_each(|face| areas[parts.of[face]] += mesh.face_area(face));
    let connections = loops.iter().map(|l| [0, 1].map(|side| parts.of[l.sides[side][0].face()])).collect();
    let (stays, is_removed) = what_stays(connections, areas, limits.area);
    let mut stays = stays.into_iter();
    loops.retain(|_| stays.next() == Some(false));
    if loops.is_empty() {
        return Ok(None);
    }
    let (mut triangles, mut is_kept) = (mesh.triangles.clone(), parts.of.map(|&part| !is_removed[part]));
    let mut twins: HashMap<Halfedge, Option<Halfedge>> = HashMap::new();
    for Loop { around, sides } in &loops {
        twins.extend(sides.iter().flatten().map(|&h| (h, None)));
        let Some([a, b, c]) = *around else { continue };
        for (side, filling) in sides.iter().zip([[b, a, c], [a, b, c]]) {
            let face = triangles.push(filling);
            is_kept.push(is_kept[side[0].face()]);
            for (k, h) in Halfedge::of_face(face).into_iter().enumerate() {
                let ends = [filling[(k + 1) % 3], filling[k]];
                let twin = side.iter().copied().find(|&twin| [twin.start(mesh), twin.end(mesh)] == ends);
                twins.insert(h, twin);
                twin.into_iter().for_each(|twin| _ = twins.insert(twin, Some(h)));
            }
        }
    }
    let across = |h| twins.get(&h).copied().unwrap_or_else(|| adjacency.twin(h));
    let (cut, vertices) = with_own_vertices(&mesh.positions, &triangles, &is_kept, across);
    let old = |face: FaceId| (face.index() < mesh.triangles.len()).then_some(face);
    let faces = triangles.ids().filter(|&face| is_kept[face]).map(old).collect();
    Ok(Some(Opened { mesh: cut, vertices, faces }))
}

/// The parts of a mesh that is cut along all loops.
fn parts(mesh: &TriMesh, adjacency: &Adjacency, loops: &[Loop]) -> Labels<FaceId> {
    let mut is_cut = mesh.triangles.map(|_| [false; 3]);
    let mut sets = DisjointSets::<FaceId>::new(mesh.triangles.len());
    for side in loops.iter().flat_map(|l| &l.sides) {
        for h in side {
            is_cut[h.face()][h.side()] = true;
            sets.join(h.face(), side[0].face());
        }
    }
    for h in mesh.triangles.ids().flat_map(Halfedge::of_face).filter(|h| !is_cut[h.face()][h.side()]) {
        adjacency.twin(h).into_iter().for_each(|twin| sets.join(h.face(), twin.face()));
    }
    sets.labels()
}

/// Which loops stay, of those that connect two parts each, so that the parts remain one piece; and which parts are
/// removed: the ends of the piece that are smaller than `least` with all that was removed behind them.
fn what_stays(connections: Vec<[usize; 2]>, mut areas: Vec<f64>, least: f64) -> (Vec<bool>, Vec<bool>) {
    let mut sets = DisjointSets::<FaceId>::new(areas.len());
    let mut degrees = vec![0_usize; areas.len()];
    let connects = |&[a, b]: &[usize; 2]| {
        let [p, q] = [a, b].map(|part| sets.root(FaceId::new(part)));
        if p != q {
            sets.join(p, q);
            [a, b].into_iter().for_each(|part| degrees[part] += 1);
        }
        p != q
    };
    // The longest stay.
    let mut stays: Vec<bool> = connections.iter().rev().map(connects).collect();
    stays.reverse();
    let mut is_removed = vec![false; areas.len()];
    loop {
        let mut is_changed = false;
        for (stays, &[a, b]) in stays.iter_mut().zip(&connections).filter(|(stays, _)| **stays) {
            let [end, rest] = if (degrees[a], areas[a]) < (degrees[b], areas[b]) { [a, b] } else { [b, a] };
            if degrees[end] == 1 && areas[end] < least {
                (*stays, is_removed[end], is_changed) = (false, true, true);
                areas[rest] += areas[end];
                [end, rest].into_iter().for_each(|part| degrees[part] -= 1);
            }
        }
        if !is_changed {
            return (stays, is_removed);
        }
    }
}

/// The loops within the limits, the shortest first; no two share a vertex.
fn loops(mesh: &TriMesh, adjacency: &Adjacency, limits: Limits) -> Vec<Loop> {
    let length = |a: VertexId, b: VertexId| mesh.positions[a].distance(mesh.positions[b]);
    let mut halfedges: HashMap<[VertexId; 2], Halfedge> = HashMap::new();
    let mut found: Vec<(f64, [VertexId; 2], Option<VertexId>)> = Vec::new();
    for h in mesh.triangles.ids().flat_map(Halfedge::of_face) {
        let (ends @ [a, b], twin) = ([h.start(mesh), h.end(mesh)], adjacency.twin(h));
        halfedges.insert(ends, h);
        if twin.is_some_and(|twin| twin < h) || length(a, b) >= limits.shortest {
            continue;
        }
        if twin.is_some() && ends.iter().all(|&v| adjacency.is_boundary(v)) {
            found.push((2.0 * length(a, b), ends, None));
        }
        let apexes = [Some(h), twin].map(|h| h.map(|h| h.previous().start(mesh)));
        let around = adjacency.ring(a).iter().filter(|v| adjacency.ring(b).contains(v));
        let lengths = around
            .filter(|&&v| !apexes.contains(&Some(v)))
            .map(|&v| (length(a, b) + length(b, v) + length(v, a), ends, Some(v)));
        let is_narrow = length(a, b) < limits.narrow;
        found.extend(lengths.filter(|(girth, ..)| is_narrow || *girth < limits.girth));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut is_used, mut loops) = (mesh.positions.map(|_| false), Vec::new());
    for (_, [a, b], apex) in found {
        let edges = apex.map_or(vec![[a, b]], |c| vec![[a, b], [b, c], [c, a]]);
        let there = edges.iter().filter_map(|ends| halfedges.get(ends).copied()).collect::<Vec<_>>();
        let back = edges.iter().filter_map(|&[p, q]| halfedges.get(&[q, p]).copied()).collect::<Vec<_>>();
        // A loop without faces on one side is a hole.
        if edges.iter().flatten().all(|&v| !is_used[v]) && !there.is_empty() && !back.is_empty() {
            edges.iter().flatten().for_each(|&v| is_used[v] = true);
            loops.push(Loop { around: apex.map(|c| [a, b, c]), sides: [there, back] });
        }
    }
    loops
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::DVec3;

    use super::*;
    use crate::mesh::{Topology, shapes};
    use crate::remesh::faces::height;
    use crate::remesh::remesh;

    /// Faces lower than 2 % of the spacing, edges below a third, and the topology.
    fn measures(mesh: &TriMesh, spacing: f64) -> (usize, usize, Topology) {
        let (edges, _) = HalfedgeMesh::new(mesh).unwrap();
        let length = |h: Halfedge| mesh.positions[edges.origin(h)].distance(mesh.positions[edges.target(h)]);
        let short = edges.halfedges().filter(|&h| edges.is_edge(h) && length(h) < spacing / 3.0).count();
        let low = mesh.triangles.ids().filter(|&face| height(mesh.corners(face)) < 0.02 * spacing).count();
        (low, short, Adjacency::new(mesh).unwrap().topology())
    }

    /// A ring whose tube has the radius `thin` (m) at one place.
    fn pinched_ring(thin: f64) -> TriMesh {
        let mut ring = shapes::torus(96, 24, 0.1, 0.03);
        for p in ring.positions.iter_mut() {
            let axis = DVec3::new(p.x, p.y, 0.0).normalize() * 0.1;
            let share = (p.y.atan2(p.x).abs() / PI).min(1.0);
            *p = axis + (*p - axis) * (thin / 0.03 + (1.0 - thin / 0.03) * (PI * share / 2.0).sin());
        }
        ring
    }

    /// Without the cut five and seven edges are short.
    #[test]
    fn a_ring_is_cut_where_taxels_cannot_surround_it() {
        for (thin, euler, most_short) in [(1e-5, 2, 3), (2e-4, 2, 3), (0.01, 0, 0)] {
            let ring = pinched_ring(thin);
            let made = remesh(&ring, 0.01).unwrap();
            let (low, short, topology) = measures(&made, 0.01);
            assert_eq!((low, topology.euler, topology.components), (0, euler, 1), "{thin} m");
            assert!(short <= most_short, "{thin} m: {short} short edges");
            assert!((made.area() / ring.area() - 1.0).abs() < 0.02, "{thin} m: {} m^2", made.area());
        }
    }

    /// Two sheets, one over the other, joined by tubes of square sections, 0.1 mm wide.
    fn joined_plates(tubes: u32) -> TriMesh {
        let (wide, thin) = (0.04, 1e-4);
        let at = |k: u32| f64::from(k.div_ceil(2)) * wide + f64::from(k / 2) * thin;
        let columns = 2 * tubes + 2;
        let id = |i: u32, j: u32, k: u32| (k * 4 + j) * columns + i;
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for k in 0..2 {
            for (j, i) in (0..4).flat_map(|j| (0..columns).map(move |i| (j, i))) {
                positions.push(DVec3::new(at(i), at(j), 0.01 * f64::from(k)));
            }
        }
        let mut quad = |[a, b, c, d]: [u32; 4]| triangles.extend([[a, b, c], [a, c, d]]);
        for (j, i) in (0..3).flat_map(|j| (0..columns - 1).map(move |i| (j, i))) {
            let around = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            if j == 1 && i % 2 == 1 {
                for side in 0..4 {
                    let [(i, j), (p, q)] = [around[side], around[(side + 1) % 4]];
                    quad([id(i, j, 1), id(p, q, 1), id(p, q, 0), id(i, j, 0)]);
                }
            } else {
                quad(around.map(|(i, j)| id(i, j, 1)));
                let [a, b, c, d] = around.map(|(i, j)| id(i, j, 0));
                quad([d, c, b, a]);
            }
        }
        TriMesh::from_arrays(positions, &triangles)
    }

    /// Each of the tubes had two short edges.
    #[test]
    fn of_hairs_between_two_plates_one_stays() {
        for tubes in 1..5 {
            let plates = joined_plates(tubes);
            let euler = |mesh| Adjacency::new(mesh).unwrap().euler_characteristic();
            assert_eq!(euler(&plates), 2 - 2 * i64::from(tubes));
            let made = remesh(&plates, 0.01).unwrap();
            let (low, short, topology) = measures(&made, 0.01);
            assert_eq!((low, short, topology.euler, topology.components), (0, 2, 0, 1), "{tubes} tubes");
            assert!((made.area() / plates.area() - 1.0).abs() < 0.05, "{tubes} tubes: {} m^2", made.area());
        }
    }

    /// Two large parts with a crumb between them, another crumb on one of them, and a limb of two crumbs.
    #[test]
    fn connected_parts_lose_crumbs_at_their_ends() {
        let connections = vec![[0, 1], [1, 2], [0, 1], [2, 3], [0, 4], [5, 4]];
        let areas = vec![10.0, 0.1, 10.0, 0.2, 0.6, 0.6];
        let (stays, is_removed) = what_stays(connections.clone(), areas.clone(), 1.0);
        assert_eq!(stays, [false, true, true, false, true, false]);
        assert_eq!(is_removed, [false, false, false, true, false, true]);
        let (stays, is_removed) = what_stays(connections, areas, 0.0);
        assert_eq!(stays, [false, true, true, true, true, true]);
        assert_eq!(is_removed, [false; 6]);
    }
}
