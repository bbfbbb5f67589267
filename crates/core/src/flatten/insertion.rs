//! Puts the vertices of a finer level on the map of a coarser one: the removals of the pyramid are
//! undone on the map.
//!
//! Every vertex is placed by its mean value coordinates (`(floater2003mvc)`) in its ring on the skin, if no
//! face around it flips there; else in the kernel of its ring, the set of points from which all of it is
//! visible. A kernel may be empty: then the vertex is counted as unplaced, and the caller repairs the flips.
//! *Heuristic*: the share of area that counts as well inside.
//!
//! Next to a filler the ring of a boundary vertex is closed by the third corner of that filler, which
//! the vertex then splits: so a rim never starts to cross itself.

use std::{collections::HashMap, f64::consts::TAU};

use glam::DVec2;

use crate::flatten::energy::elements::Uv;
use crate::flatten::fillers::Fillers;
use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, angle};
use crate::parallel::par_collect;
use crate::pyramid::{Level, PyramidError, Removal, RemovalLog};

/// A vertex is well inside its star if every new face has at least this share of the mean area, or of its own
/// area on the skin.
const LEAST_SHARE: f64 = 0.02;

/// A map of a coarser level that becomes the map of `level`: removals are undone on it one by one, last to
/// first, and each vertex is placed in its own ring again.
#[derive(Debug, Clone)]
pub(crate) struct Insertion<'l> {
    mesh: &'l TriMesh,
    removals: &'l RemovalLog,
    /// Removals not yet undone.
    pub(crate) left: usize,
    present: IdVec<VertexId, bool>,
    /// Map positions of the vertices, in m, and of the posts of the fillers.
    pub(crate) map: Uv,
    /// The third corner of the filler on the left of each of its sides.
    apex: HashMap<[VertexId; 2], VertexId>,
}

impl<'l> Insertion<'l> {
    /// Starts from the map `uv` of the next coarser level, which `removals` made of `level`, and its
    /// fillers.
    ///
    /// # Errors
    /// If the vertices of the coarser level are not all vertices of this one.
    pub(crate) fn new(
        level: &'l Level,
        removals: &'l RemovalLog,
        coarse: &Level,
        uv: &Uv,
        fillers: &Fillers,
    ) -> Result<Self, PyramidError> {
        let count = level.mesh.positions.len();
        let mut present = IdVec::filled(false, count);
        let map = IdVec::filled(DVec2::ZERO, count);
        let vertices = coarse.finer_vertices(level)?;
        vertices.iter().for_each(|&v| present[v] = true);
        let mut insertion =
            Self { mesh: &level.mesh, removals, left: removals.len(), present, map, apex: HashMap::new() };
        insertion.place(vertices.as_slice(), uv, fillers);
        Ok(insertion)
    }

    /// Moves `vertices`, which are all on the map, to `uv`, and takes the fillers of that map.
    pub(crate) fn place(&mut self, vertices: &[VertexId], uv: &Uv, fillers: &Fillers) {
        let count = self.mesh.positions.len();
        for (&vertex, &at) in vertices.iter().zip(uv) {
            self.map[vertex] = at;
        }
        self.map = self.map.iter().take(count).chain(&fillers.posts).copied().collect();
        let id = |v: VertexId| {
            let post = v.index().checked_sub(vertices.len());
            post.map_or_else(|| vertices[v.index()], |k| VertexId::new(count + k))
        };
        self.apex.clear();
        fillers.triangles.iter().for_each(|t| self.add_filler(t.map(id)));
    }

    fn add_filler(&mut self, [a, b, c]: [VertexId; 3]) {
        self.apex.extend([([a, b], c), ([b, c], a), ([c, a], b)]);
    }

    /// Splits the filler next to a boundary vertex that has been inserted.
    fn split_filler(&mut self, removal: &Removal<'_>, apex: VertexId) {
        if let (Some(&next), Some(&previous)) = (removal.ring.first(), removal.ring.last()) {
            self.apex.remove(&[next, previous]);
            self.add_filler([next, removal.vertex, apex]);
            self.add_filler([removal.vertex, previous, apex]);
        }
    }

    /// The third corner of the filler next to a boundary vertex that is to be inserted.
    fn apex_of(&self, removal: &Removal<'_>) -> Option<VertexId> {
        let sides = [*removal.ring.first()?, *removal.ring.last()?];
        self.apex.get(&sides).copied().filter(|_| removal.boundary)
    }

    /// The map of all vertices, after all are inserted.
    pub(crate) fn finished(self) -> Uv {
        self.map.iter().take(self.mesh.positions.len()).copied().collect()
    }

    /// Number of vertices on the map.
    pub(crate) fn present(&self) -> usize {
        self.mesh.positions.len() - self.left
    }

    /// Undoes removals until this many are left, and returns how many vertices could not be placed without a
    /// flip.
    pub(crate) fn undo_until(&mut self, left: usize) -> usize {
        let mut unplaced = 0;
        let mut removals = self.removals.iter().take(self.left).skip(left).rev().peekable();
        while let Some(first) = removals.next() {
            // Vertices whose rings are on the map are placed in parallel, unless two may split one filler.
            let mut together = vec![first];
            let is_ready = |next: &Removal<'_>| next.ring.iter().all(|&v| self.present[v]);
            while let Some(next) = removals.next_if(|next| self.apex.is_empty() && is_ready(next)) {
                together.push(next);
            }
            let places = par_collect(together.len(), |range, out| {
                let mut ring = RingMap::default();
                out.extend(together[range].iter().map(|removal| self.place_of(removal, &mut ring)));
            });
            for (removal, (at, is_placed)) in together.iter().zip(places) {
                unplaced += usize::from(!is_placed);
                self.map[removal.vertex] = at;
                self.present[removal.vertex] = true;
                if let Some(apex) = self.apex_of(removal) {
                    self.split_filler(removal, apex);
                }
            }
        }
        self.left = self.left.min(left);
        unplaced
    }

    /// The position of a vertex whose ring is on the map, and whether it flips no face.
    fn place_of(&self, removal: &Removal<'_>, ring: &mut RingMap) -> (DVec2, bool) {
        ring.take(self.mesh, &self.map, removal, self.apex_of(removal));
        let wanted = ring.transplanted();
        let at = if ring.fits(wanted) { Some(wanted) } else { ring.kernel_centre(wanted) };
        (at.unwrap_or(wanted), at.is_some())
    }

    /// The mesh of the vertices on the map, and for each of them its vertex of the level.
    pub(crate) fn mesh(&self) -> (TriMesh, Vec<VertexId>) {
        let vertices: Vec<VertexId> = self.present.ids().filter(|&v| self.present[v]).collect();
        let mut number = IdVec::<VertexId, VertexId>::filled(VertexId::default(), self.present.len());
        for (k, &v) in vertices.iter().enumerate() {
            number[v] = VertexId::new(k);
        }
        let triangles = self.removals.triangles_after(&self.mesh.triangles, self.left);
        let mesh = TriMesh {
            positions: vertices.iter().map(|&v| self.mesh.positions[v]).collect(),
            triangles: triangles.map(|t| t.map(|v| number[v])),
        };
        (mesh, vertices)
    }
}

/// An open ring, around a boundary vertex, is narrowed to this share of a turn if its angles add up to more,
/// since its first and last vertex would meet or change sides.
const WIDEST_OPEN: f64 = 0.9;

/// The ring of a removed vertex, on the skin around the vertex and on the map; its buffers are reused for the
/// next one.
#[derive(Default)]
struct RingMap {
    /// The ring laid flat around the vertex: true lengths, angles scaled to a full turn inside.
    skin: Vec<DVec2>,
    map: Vec<DVec2>,
    boundary: bool,
    /// The corner of the filler that closes the ring of a boundary vertex, if there is one.
    apex: Option<DVec2>,
    angles: Vec<f64>,
}

impl RingMap {
    fn take(&mut self, mesh: &TriMesh, uv: &Uv, removal: &Removal<'_>, apex: Option<VertexId>) {
        self.boundary = removal.boundary;
        self.apex = apex.map(|v| uv[v]);
        self.map.clear();
        self.map.extend(removal.ring.iter().map(|&v| uv[v]));
        self.lay_flat(mesh, removal);
    }

    /// Lays the ring around the removed vertex in the plane, the vertex at the origin: true distances,
    /// angles added up; those of a closed ring scaled to a full turn.
    ///
    /// An open ring keeps its angles: the vertex must return to its old position, outside of an edge between
    /// its first and last neighbour. (The star that `pyramid::removal` retriangulates is scaled to half a
    /// turn instead, because there the boundary must run straight past the removed vertex.)
    fn lay_flat(&mut self, mesh: &TriMesh, removal: &Removal<'_>) {
        let centre = mesh.positions[removal.vertex];
        let count = removal.ring.len();
        let at = |k: usize| mesh.positions[removal.ring[if k == count { 0 } else { k }]];
        let gaps = count - usize::from(removal.boundary);
        self.angles.clear();
        self.angles.extend((0..gaps).map(|k| angle(centre, at(k), at(k + 1))));
        let sum: f64 = self.angles.iter().sum();
        let scale = match removal.boundary {
            false if sum > 0.0 => TAU / sum,
            true if sum > WIDEST_OPEN * TAU => WIDEST_OPEN * TAU / sum,
            _ => 1.0,
        };
        let mut turn = 0.0;
        self.skin.clear();
        for k in 0..count {
            self.skin.push(DVec2::from_angle(turn) * centre.distance(at(k)));
            turn += scale * self.angles.get(k).copied().unwrap_or(0.0);
        }
    }

    /// The ring's edges on the map; the vertex must be on their left.
    fn edges(&self) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
        let count = self.map.len() - usize::from(self.boundary);
        let ends = self.map.first().zip(self.map.last()).zip(self.apex);
        let closing = ends.map(|((&first, &last), apex)| [(last, apex), (apex, first)]);
        let chain = (0..count).map(|k| (self.map[k], self.map[(k + 1) % self.map.len()]));
        chain.chain(closing.into_iter().flatten())
    }

    /// The position of the vertex if the star on the skin is transformed by the affine map (inside) or the
    /// similarity (on a boundary, where the vertex is outside of its ring) that fits the ring best.
    fn transplanted(&self) -> DVec2 {
        let count = self.skin.len() as f64;
        let from = self.skin.iter().sum::<DVec2>() / count;
        let to = self.map.iter().sum::<DVec2>() / count;
        // Least squares for the similarity: a complex factor.
        let (mut factor, mut square) = (DVec2::ZERO, 0.0);
        for (s, m) in self.skin.iter().zip(&self.map) {
            let (s, m) = (*s - from, *m - to);
            factor += DVec2::new(s.dot(m), s.perp_dot(m));
            square += s.length_squared();
        }
        let similar = if square > 0.0 { factor / square } else { DVec2::ZERO };
        if self.boundary {
            return to + similar.rotate(-from);
        }
        // Mean value coordinates of the centre: exact for affine maps, and smooth.
        let (mut sum, mut total) = (DVec2::ZERO, 0.0);
        for (k, weight) in mean_value_weights(&self.skin).enumerate() {
            sum += weight * self.map[k];
            total += weight;
        }
        if total > 0.0 && (sum / total).is_finite() { sum / total } else { to + similar.rotate(-from) }
    }

    /// Whether every face of the star with the vertex at `p` has its share of the area, which is small if the
    /// face is a needle on the skin.
    fn fits(&self, p: DVec2) -> bool {
        let areas = || self.edges().map(|(a, b)| (a - p).perp_dot(b - p));
        let (sum, count) = areas().fold((0.0, 0.0), |(sum, count), a| (sum + a.abs(), count + 1.0));
        let faces = self.skin.len() - usize::from(self.boundary);
        // At the tip of a cone an angle that is scaled to its share of a turn may exceed half a turn.
        let on_skin = |k: usize| self.skin[k].perp_dot(self.skin[(k + 1) % self.skin.len()]).max(0.0);
        let total: f64 = (0..faces).map(on_skin).sum();
        let share = |k: usize| if k < faces { on_skin(k) / total } else { 1.0 };
        areas().enumerate().all(|(k, a)| a > LEAST_SHARE * sum * share(k).min(1.0 / count))
    }

    /// The centre of the kernel, the positions from which the whole ring is visible; `None` if there are none.
    fn kernel_centre(&self, wanted: DVec2) -> Option<DVec2> {
        let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for &p in self.map.iter().chain(&self.apex) {
            (lo, hi) = (lo.min(p), hi.max(p));
        }
        if self.boundary && self.apex.is_none() && wanted.is_finite() {
            // There the kernel extends beyond the ring: it is bounded by the distance to the wanted position.
            let reach = DVec2::splat(wanted.distance((lo + hi) / 2.0).max((hi - lo).length()));
            (lo, hi) = (lo - reach, hi + reach);
        }
        let mut kernel = vec![lo, DVec2::new(hi.x, lo.y), hi, DVec2::new(lo.x, hi.y)];
        for (a, b) in self.edges() {
            kernel = left_of(&kernel, a, b);
        }
        let centre = centroid(&kernel)?;
        // From the centre towards the wanted position as far as the faces allow.
        let keep = |p: &DVec2| self.edges().all(|(a, b)| (a - *p).perp_dot(b - *p) > 0.0);
        [0.75, 0.5, 0.25]
            .into_iter()
            .map(|t| centre.lerp(wanted, t))
            .find(|&p| self.fits(p))
            .or(Some(centre).filter(keep))
    }
}

/// Mean value weights of the origin in a polygon around it.
fn mean_value_weights(ring: &[DVec2]) -> impl Iterator<Item = f64> {
    let count = ring.len();
    // tan(a/2) = (1 - cos a) / sin a, with lengths kept in.
    let half_tangent = move |k: usize| {
        let (p, q) = (ring[k], ring[(k + 1) % count]);
        let sine = p.perp_dot(q);
        (p.length() * q.length() - p.dot(q)) / sine
    };
    (0..count).map(move |k| (half_tangent((k + count - 1) % count) + half_tangent(k)) / ring[k].length())
}

/// A convex polygon clipped to the left of the line from `a` to `b`.
fn left_of(polygon: &[DVec2], a: DVec2, b: DVec2) -> Vec<DVec2> {
    let side = |p: DVec2| (b - a).perp_dot(p - a);
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    let before = polygon.iter().cycle().skip(polygon.len().saturating_sub(1));
    for (&p, &q) in before.zip(polygon) {
        if (side(p) >= 0.0) != (side(q) >= 0.0) {
            kept.push(p + (q - p) * (side(p) / (side(p) - side(q))));
        }
        if side(q) >= 0.0 {
            kept.push(q);
        }
    }
    kept
}

/// Centre of area; `None` without area.
fn centroid(polygon: &[DVec2]) -> Option<DVec2> {
    let &origin = polygon.first()?;
    let (mut sum, mut area) = (DVec2::ZERO, 0.0);
    for pair in polygon.windows(2) {
        let (p, q) = (pair[0] - origin, pair[1] - origin);
        let twice = p.perp_dot(q);
        sum += twice * (p + q) / 3.0;
        area += twice;
    }
    (area > 0.0).then(|| origin + sum / area)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn star(map: &[[f64; 2]], boundary: bool) -> RingMap {
        let map: Vec<DVec2> = map.iter().map(|&p| p.into()).collect();
        RingMap { skin: map.clone(), map, boundary, ..RingMap::default() }
    }

    #[test]
    fn an_affine_map_carries_the_vertex_with_it() {
        let mut s = star(&[[1.0, -0.2], [0.8, 0.9], [-0.5, 1.1], [-0.9, -0.3], [0.1, -1.0]], false);
        let affine = glam::DAffine2::from_cols_array(&[2.0, 0.3, -0.1, 0.8, 5.0, -4.0]);
        s.map = s.skin.iter().map(|&p| affine.transform_point2(p)).collect();
        assert!(s.transplanted().distance(affine.translation) < 1e-14, "the origin goes to the translation");
    }

    /// A needle that is widened when it is inserted slows every Newton step down: one of 2 um by 3 mm on a
    /// body with legs became a gap of 3 mm on its map.
    #[test]
    fn a_needle_stays_one() {
        let mut s = star(&[[1.0, 0.0], [0.9, 1e-4], [-0.5, 0.8], [-0.5, -0.8]], false);
        s.map = s.skin.iter().map(|&p| 3.0 * p + DVec2::X).collect();
        assert!(s.fits(s.transplanted()));
        assert!(!s.fits(s.transplanted() + 0.1 * DVec2::Y), "it turns over there");
    }

    /// A ring of three around the tip of a cone, one of whose angles is scaled to more than half a turn.
    #[test]
    fn a_flipped_face_never_fits() {
        let mut s = star(&[[1.0, 0.0], [0.0, 1.0], [0.7, -0.8]], false);
        s.map = vec![DVec2::X, DVec2::Y, DVec2::new(0.02, -1.0)];
        assert!(!s.fits(DVec2::ZERO), "the face between the last two is flipped");
    }

    #[test]
    fn on_a_boundary_a_similarity_carries_the_vertex_with_it() {
        let mut s = star(&[[1.0, 0.0], [0.2, 0.9], [-1.0, 0.1]], true);
        s.map = s.skin.iter().map(|&p| DVec2::new(0.0, 2.0).rotate(p) + DVec2::X).collect();
        assert!(s.transplanted().distance(DVec2::X) < 1e-15);
    }

    /// An L: the far end is not visible from the corner behind the bend; the kernel is the square at the
    /// bend.
    #[test]
    fn a_position_outside_of_the_kernel_moves_into_it() {
        let l = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
        let s = star(&l, false);
        let p = s.kernel_centre(DVec2::new(2.5, 0.5)).unwrap();
        assert!(p.cmpgt(DVec2::ZERO).all() && p.cmplt(DVec2::ONE).all(), "{p} in the unit square");
    }

    /// The wanted position is beyond the filler above the ring: the vertex is placed inside the filler instead.
    #[test]
    fn a_filler_keeps_a_boundary_vertex_inside() {
        let mut s = star(&[[1.0, 0.0], [0.0, 0.2], [-1.0, 0.0]], true);
        s.skin = vec![DVec2::new(1.0, 2.0), DVec2::new(0.0, 2.2), DVec2::new(-1.0, 2.0)];
        assert!(s.fits(s.transplanted()), "no filler limits it");
        s.apex = Some(DVec2::new(0.0, -0.5));
        let wanted = s.transplanted();
        let p = s.kernel_centre(wanted).unwrap();
        assert!(wanted.y < -1.0 && !s.fits(wanted) && s.fits(p) && p.y > -0.5, "{p} instead of {wanted}");
    }

    /// All of a U is visible from no position.
    #[test]
    fn an_empty_kernel_has_no_centre() {
        let u =
            [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [2.0, 3.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
        assert_eq!(star(&u, false).kernel_centre(DVec2::new(0.5, 2.0)), None);
    }
}
