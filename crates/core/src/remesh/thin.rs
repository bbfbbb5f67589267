//! Thin faces: which changes avoid them, and their removal.
//!
//! A face much lower than the spacing has a normal of rounding noise, which may forbid every change around it, and a
//! map of it is a needle.

use glam::DVec3;

use crate::id::{FaceId, VertexId};
use crate::mesh::{Halfedge, triangle_cross};
use crate::remesh::faces::{FLAT, THIN, Thin, height, keeps_side, keeps_side_around};
use crate::remesh::rounds::Rounds;

/// At the end, edges shorter than this fraction of the target are collapsed where possible.
pub(super) const SHORTEST_EDGE: f64 = 1.0 / 3.0;

/// Most passes over all faces.
const MAX_PASSES: usize = 16;

/// A change that removes a thin face.
#[derive(Clone, Copy)]
enum Change {
    Collapse(Halfedge),
    Flip(Halfedge),
}

impl Rounds<'_> {
    /// Whether a vertex of a face may move: the face stays on its side, if it has one, and does not become
    /// lower than `THIN` times the target unless it was.
    pub(super) fn fits(&self, old: [DVec3; 3], new: [DVec3; 3]) -> bool {
        let was = height(old);
        let has_side = was >= FLAT * self.target;
        height(new) >= was.min(THIN * self.target)
            && (!has_side || keeps_side(triangle_cross(old), triangle_cross(new)))
    }

    /// Collapses or flips an edge of every thin face or of a face next to it, sharp or not, whichever leaves
    /// the highest faces. Thin faces arise between three vertices of one line, where lines have merged or
    /// bend little. A face without height at a rim is removed if there is no such change.
    pub(super) fn remove_thin(&mut self, thin: Thin) {
        for _ in 0..MAX_PASSES {
            let mut is_changed = false;
            for face in self.mesh.face_ids().filter(|&face| self.mesh.is_alive(face)).collect::<Vec<_>>() {
                let was = self.height(face);
                if self.mesh.is_alive(face) && was < thin.height {
                    is_changed |= self.remove_thin_face(face, was, thin);
                }
            }
            if thin.is_last {
                is_changed |= self.remove_short(thin);
            }
            if !is_changed {
                return;
            }
        }
    }

    /// Collapses the edges below a third of the target that leave no thin face.
    fn remove_short(&mut self, thin: Thin) -> bool {
        let mut is_changed = false;
        for h in self.mesh.halfedges() {
            if self.mesh.is_edge(h) && self.length(h) < SHORTEST_EDGE * self.target {
                let sides = [h, self.mesh.twin(h)].into_iter().filter(|&h| h != Halfedge::NONE);
                let heights = sides.filter_map(|h| Some((self.height_collapsed(h, thin)?, h)));
                let highest = heights.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|best| best.0 >= thin.height);
                highest.iter().for_each(|&(_, h)| self.remove_origin(h));
                is_changed |= highest.is_some();
            }
        }
        is_changed
    }

    fn remove_thin_face(&mut self, face: FaceId, was: f64, thin: Thin) -> bool {
        let sides = [0, 1, 2].map(|side| Halfedge::new(face, side));
        let both = sides.into_iter().flat_map(|h| [h, self.mesh.twin(h)]).filter(|&h| h != Halfedge::NONE);
        let collapses = both.filter_map(|h| Some((self.height_collapsed(h, thin)?, Change::Collapse(h))));
        let flips = sides.into_iter().filter_map(|h| Some((self.height_flipped(h)?, Change::Flip(h))));
        // Removing a vertex counts as an improvement even if a face stays as low: the next pass handles it.
        let mut best = (was, None);
        for (height, change) in collapses.chain(flips) {
            // With one vertex less the next pass may find more, even if a face stays as low.
            let is_flat = height.max(was) < FLAT * self.target;
            if height > best.0 || is_flat && best.1.is_none() && matches!(change, Change::Collapse(_)) {
                best = (height, Some(change));
            }
        }
        match best.1 {
            Some(Change::Collapse(h)) => self.remove_origin(h),
            Some(Change::Flip(h)) => self.flip_inner(h),
            None => {
                let on_rim = |h: &Halfedge| {
                    self.mesh.twin(*h) == Halfedge::NONE && !self.mesh.on_boundary[self.mesh.apex(*h)]
                };
                let rim = sides.into_iter().find(on_rim).filter(|_| was < 0.1 * thin.height);
                rim.into_iter().for_each(|h| self.remove_face(h));
                return rim.is_some();
            }
        }
        true
    }

    /// Moves the corner opposite to the longest side of each face lower than `least` (m) away from that side,
    /// by up to `least`, if that leaves no lower face.
    pub(super) fn raise_thin(&mut self, least: f64) {
        for face in self.mesh.face_ids().filter(|&face| self.mesh.is_alive(face)).collect::<Vec<_>>() {
            let sides = [0, 1, 2].map(|side| Halfedge::new(face, side));
            let was = self.height(face);
            let longest = sides.into_iter().max_by(|&a, &b| self.length(a).total_cmp(&self.length(b)));
            let Some(h) = longest.filter(|_| was < least) else { continue };
            let [a, b, c] = [self.mesh.origin(h), self.mesh.target(h), self.mesh.apex(h)];
            let along = (self.positions[b] - self.positions[a]).normalize_or_zero();
            let (sum, around) =
                (self.mesh.ring(c).map(|v| self.positions[v] - self.positions[c]).sum(), self.normal(c));
            let aside = [sum, around.cross(along)].map(|way: DVec3| way - along * along.dot(way));
            let best = aside.into_iter().flat_map(|way| [way, -way]).filter_map(|way| {
                let to = self.positions[c] + (least - was) * way.try_normalize()?;
                Some((self.height_moved(c, to, around)?, to))
            });
            let best = best.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|best| best.0 > was);
            best.into_iter().for_each(|(_, to)| self.positions[c] = to);
        }
    }

    /// The least height of the faces around a vertex after it has moved, if none turns over.
    fn height_moved(&self, v: VertexId, to: DVec3, around: DVec3) -> Option<f64> {
        let mut least = f64::INFINITY;
        for h in self.mesh.leaving(v) {
            let [p, q] = [self.mesh.target(h), self.mesh.apex(h)].map(|v| self.positions[v]);
            let [old, new] = [self.positions[v], to].map(|at| [at, p, q]);
            if !keeps_side_around(old, new, FLAT * self.target, around) {
                return None;
            }
            least = least.min(height(new));
        }
        Some(least)
    }

    fn height(&self, face: FaceId) -> f64 {
        height(self.mesh.corners(face).map(|v| self.positions[v]))
    }

    /// The least height of the faces around the origin of `h` after a collapse, if that is allowed: the edge
    /// is short, or its origin has the least degree.
    fn height_collapsed(&self, h: Halfedge, thin: Thin) -> Option<f64> {
        let (a, b) = (self.mesh.origin(h), self.mesh.target(h));
        let is_short = self.length(h) < thin.short;
        if !(is_short || thin.is_last && self.has_least_degree(a)) || !self.mesh.can_collapse(h) {
            return None;
        }
        let (from, to, mut least) = (self.positions[a], self.positions[b], f64::INFINITY);
        let around = self.normal(a);
        for leaving in self.mesh.leaving(a) {
            let ends = [self.mesh.target(leaving), self.mesh.apex(leaving)];
            if !ends.contains(&b) {
                let [p, q] = ends.map(|v| self.positions[v]);
                let [old, new] = [[from, p, q], [to, p, q]];
                let farthest = |at: DVec3| at.distance(p).max(at.distance(q));
                let is_long = farthest(to) > thin.longest.max(1.1 * farthest(from));
                let is_flat = height(new) < FLAT * self.target;
                if is_long || !(is_flat || keeps_side_around(old, new, thin.height, around)) {
                    return None;
                }
                least = least.min(height(new));
            }
        }
        Some(least)
    }

    /// The least height of the two faces of an edge after a flip, if that is possible.
    fn height_flipped(&self, h: Halfedge) -> Option<f64> {
        let twin = self.mesh.twin(h);
        if twin == Halfedge::NONE {
            return None;
        }
        let ends = [self.mesh.origin(h), self.mesh.target(h)];
        let [a, b, c, d] = self.mesh.diamond(h).map(|v| self.positions[v]);
        let new = [[c, a, d], [d, b, c]];
        // The other face gives the normal of the surface.
        let across = self.cross(twin.face());
        let has_side =
            height(self.mesh.corners(twin.face()).map(|v| self.positions[v])) >= FLAT * self.target;
        let may_flip = has_side
            && self.mesh.can_flip(h)
            && !ends.iter().any(|&v| self.has_least_degree(v))
            && new.iter().all(|&face| keeps_side(across, triangle_cross(face)));
        may_flip.then(|| new.map(height).into_iter().fold(f64::INFINITY, f64::min))
    }

    /// The sum of the normals of the faces around a vertex, each twice as long as its area.
    pub(super) fn normal(&self, v: VertexId) -> DVec3 {
        self.mesh.leaving(v).map(|h| self.cross(h.face())).sum()
    }

    fn has_least_degree(&self, v: VertexId) -> bool {
        self.mesh.degree[v] <= if self.mesh.on_boundary[v] { 2 } else { 3 }
    }

    /// Removes the face of a rim's halfedge, whose apex is on no rim.
    fn remove_face(&mut self, h: Halfedge) {
        for side in [h.next(), h.previous()] {
            let twin = self.mesh.twin(side);
            self.sharp[twin.face()][twin.side()] = true;
        }
        self.mesh.remove_face(h);
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::mesh::{Adjacency, HalfedgeMesh, TriMesh, shapes};
    use crate::remesh::remesh;
    use crate::remesh::surface::Surface;

    /// An extruded outline, as CAD writes it: sides of two triangles, its ends fans around an inner point.
    fn prism(outline: &[[f64; 2]], thickness: f64) -> TriMesh {
        let n = u32::try_from(outline.len()).unwrap();
        let mut positions = vec![DVec3::ZERO, DVec3::Z * thickness];
        for &[x, y] in outline {
            positions.extend([0.0, thickness].map(|z| DVec3::new(x, y, z)));
        }
        let mut triangles = Vec::new();
        for i in 0..n {
            let [a, b] = [2 + 2 * i, 2 + 2 * ((i + 1) % n)];
            triangles.extend([[0, b, a], [1, a + 1, b + 1], [a, b, b + 1], [a, b + 1, a + 1]]);
        }
        TriMesh::from_arrays(positions, &triangles)
    }

    fn circle(n: u32, radius: impl Fn(u32) -> f64) -> Vec<[f64; 2]> {
        let at = |k: u32| (TAU * f64::from(k) / f64::from(n)).sin_cos();
        (0..n).map(|k| (at(k), radius(k))).map(|((y, x), r)| [r * x, r * y]).collect()
    }

    /// The same surface with edges split at points that a hash chooses: near an end, exactly at one or anywhere.
    fn split_anywhere(mesh: &TriMesh, times: u64, seed: u64) -> TriMesh {
        let (mut edited, _) = HalfedgeMesh::new(mesh).unwrap();
        let mut positions = mesh.positions.clone();
        for k in 0..times {
            let hash = (seed * 1000 + k + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let edges: Vec<Halfedge> = edited.halfedges().filter(|&h| edited.is_edge(h)).collect();
            let h = edges[usize::try_from(hash >> 33).unwrap() % edges.len()];
            let t = [0.0, 1e-16, 1e-9, 1e-6, 1e-4, 0.5, 0.37, 1.0][usize::try_from(hash >> 29 & 7).unwrap()];
            positions.push(positions[edited.origin(h)].lerp(positions[edited.target(h)], t));
            edited.split(h);
        }
        TriMesh { triangles: edited.triangles(), positions }
    }

    /// Faces lower than 2 % of the spacing, vertices farther from the surface than 5 %, and edges below a third.
    fn faults(mesh: &TriMesh, made: &TriMesh, spacing: f64) -> [usize; 3] {
        let surface = Surface::new(mesh.clone()).unwrap();
        let low = made.triangles.ids().filter(|&face| height(made.corners(face)) < 0.02 * spacing);
        let is_off = |p: &&DVec3| {
            surface.nearest(**p, DVec3::ZERO, None).unwrap().point.distance(**p) > 0.05 * spacing
        };
        let (edges, _) = HalfedgeMesh::new(made).unwrap();
        let length = |h: Halfedge| made.positions[edges.origin(h)].distance(made.positions[edges.target(h)]);
        let short = edges.halfedges().filter(|&h| edges.is_edge(h) && length(h) < spacing / 3.0);
        [low.count(), made.positions.iter().filter(is_off).count(), short.count()]
    }

    /// Inputs that once left faces without height, taxels off the surface, or coincident taxels.
    #[test]
    fn faces_have_height_and_vertices_lie_on_the_surface() {
        let ribs = |i: u32, j: u32| {
            DVec3::new(0.0016 * f64::from(i), 0.005 * f64::from(j), if i % 4 < 2 { 0.003 } else { 0.0 })
        };
        let bumps = |i: u32, j: u32| {
            let [x, y] = [i, j].map(|k| 0.001 * f64::from(k));
            DVec3::new(x, y, 0.004 * (x * 300.0).sin() * (y * 300.0).sin())
        };
        let tube = shapes::tube(32, 2, 0.03, 0.1);
        for (name, mesh, spacing) in [
            ("coincident vertices", split_anywhere(&tube, 40, 3), 0.008),
            ("lines that merge", shapes::sheet(60, 20, ribs), 0.01),
            (
                "gaps between teeth",
                prism(&circle(96, |k| if k / 2 % 2 == 0 { 0.05 } else { 0.035 }), 0.02),
                0.006,
            ),
            ("bends as narrow as the spacing", shapes::sheet(100, 100, bumps), 0.012),
        ] {
            let made = remesh(&mesh, spacing).unwrap();
            assert_eq!(faults(&mesh, &made, spacing)[..2], [0, 0], "{name}");
        }
    }

    /// Boxes, cylinders, gears and rings at several spacings, with edges split anywhere.
    #[test]
    fn soups_of_cad_are_meshed_without_thin_faces() {
        let (mut all, mut low, mut short) = (0, 0, 0);
        for seed in 0..12 {
            let size = |k: u64| 0.004 + 0.1 * ((seed * 7 + k * 3) % 11) as f64 / 10.0;
            let [a, b] = [size(1), size(2)];
            let shapes: [TriMesh; 4] = [
                prism(&[[a, b], [-a, b], [-a, -b], [a, -b]], size(3)),
                prism(&circle(24, |_| a), size(4)),
                prism(&circle(40, |k| if k % 4 < 2 { a } else { 0.7 * a }), b),
                shapes::torus(24, 10, 0.05 + a, 0.2 * a + 0.005),
            ];
            for (k, mesh) in shapes.into_iter().enumerate() {
                let mesh = split_anywhere(&mesh, 30, seed);
                for spacing in [0.005, 0.012, 0.03].into_iter().filter(|&s: &f64| s * s < 0.2 * mesh.area()) {
                    let made = remesh(&mesh, spacing).unwrap();
                    let [thin, off, close] = faults(&mesh, &made, spacing);
                    assert_eq!(off, 0, "shape {k} of seed {seed} at {spacing} m");
                    let euler = |mesh| Adjacency::new(mesh).unwrap().euler_characteristic();
                    // A tube that is less than two spacings around may be cut.
                    let may_be_cut = k == 3 && TAU * (0.2 * a + 0.005) < 2.0 * spacing;
                    let is_kept = euler(&made) == euler(&mesh) || may_be_cut && euler(&made) == 2;
                    assert!(is_kept, "shape {k} of seed {seed} at {spacing} m");
                    (all, low, short) = (all + made.triangles.len(), low + thin, short + close);
                }
            }
        }
        assert!(low * 10_000 < all, "{low} of {all} faces are thin");
        assert!(short * 1000 < all, "{short} edges below a third of the spacing, {all} faces");
    }
}
