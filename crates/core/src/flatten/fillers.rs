//! Scaffold triangles in the holes of a map, and between its outer loop and a frame; they enter the energy
//! and its Hessian (`(jiang2017)`; *heuristic*: the weights).
//!
//! They may not flip, so that a rim can neither cross itself nor turn inside out. Their rest shape is their
//! current shape, so that they act only where they come close to a flip, and they are made anew every few
//! steps, so that rims may slide. A barrier on distances within the boundary ended at a symmetric Dirichlet
//! energy of 1812 on four tubes that meet; fillers end at 12.5.

use glam::DVec2;

use crate::delaunay::{DelaunayError, triangulate_region};
use crate::flatten::energy::elements::{Element, Uv, keeps_orientation};
use crate::id::VertexId;
use crate::mesh::{FlatTriangle, signed_area};

/// Least rest height of a filler over its longest edge: flatter ones get a rest shape of this height.
const LEAST_HEIGHT: f64 = 1e-2;

/// Largest ratio of the rest height of a filler to its current height, so that its energy stays finite.
const MOST_OPENING: f64 = 10.0;

/// Fixed posts of the frame.
const POSTS: usize = 24;

/// Side of the frame over the longer side of the map.
const FRAME: f64 = 1.6;

/// The fillers of one map. Posts are numbered after the vertices of the map.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fillers {
    pub(crate) triangles: Vec<[VertexId; 3]>,
    /// Positions of the posts, which do not move.
    pub(crate) posts: Vec<DVec2>,
}

impl Fillers {
    /// Fills all `loops` (faces on their left) but the first, and with `framed` the region around the
    /// first.
    ///
    /// # Errors
    /// If a loop crosses or touches itself.
    pub(crate) fn new(loops: &[Vec<VertexId>], uv: &Uv, framed: bool) -> Result<Self, DelaunayError> {
        let mut fillers = Self::default();
        for hole in loops.iter().skip(1) {
            fillers.fill(hole, uv)?;
        }
        if let (true, Some(outer)) = (framed, loops.first()) {
            let first = uv.len();
            fillers.posts = posts(outer, uv);
            let ids = (0..POSTS).map(|k| VertexId::new(first + k));
            let mut vertices: Vec<VertexId> = outer.iter().rev().copied().collect();
            let edges = ring(0, vertices.len()).chain(ring(vertices.len(), POSTS)).collect::<Vec<_>>();
            let places = vertices.iter().map(|&v| uv[v]).chain(fillers.posts.iter().copied());
            let triangles = triangulate_region(&places.collect::<Vec<_>>(), &edges)?;
            vertices.extend(ids);
            fillers.triangles.extend(triangles.iter().map(|t| t.map(|k| vertices[k])));
        }
        Ok(fillers)
    }

    fn fill(&mut self, hole: &[VertexId], uv: &Uv) -> Result<(), DelaunayError> {
        let rim: Vec<VertexId> = hole.iter().rev().copied().collect();
        let places: Vec<DVec2> = rim.iter().map(|&v| uv[v]).collect();
        let edges: Vec<[usize; 2]> = ring(0, rim.len()).collect();
        self.triangles.extend(triangulate_region(&places, &edges)?.iter().map(|t| t.map(|k| rim[k])));
        Ok(())
    }

    /// The map with the posts behind its vertices.
    pub(crate) fn with_posts(&self, uv: &Uv) -> Uv {
        uv.iter().chain(&self.posts).copied().collect()
    }

    /// The fillers as faces of total weight `weight`, with their shape on the map `uv`, which has the posts,
    /// as rest shape.
    pub(crate) fn elements(&self, uv: &Uv, weight: f64) -> Vec<Element> {
        let weight = weight / self.triangles.len().max(1) as f64;
        let element = |&corners: &[VertexId; 3]| {
            let at = corners.map(|v| uv[v]);
            let area = signed_area(at);
            // A filler that is open only by rounding gets no element.
            let longest = (0..3).map(|k| at[k].distance_squared(at[(k + 1) % 3])).fold(0.0, f64::max);
            if !keeps_orientation(at) || area.is_nan() || area / longest <= 0.0 {
                return None;
            }
            let height = 2.0 * area / longest;
            let space = at.map(|p| p.extend(0.0));
            let least = LEAST_HEIGHT.min(MOST_OPENING * height);
            let rest = FlatTriangle::new(space).healed(space, least)?;
            Some(Element { corners, gradients: rest.gradients(), weight })
        };
        self.triangles.iter().filter_map(element).collect()
    }
}

/// The edges of a polygon of `count` points from `first` on.
fn ring(first: usize, count: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..count).map(move |k| [first + k, first + (k + 1) % count])
}

/// Posts on a square around the outer loop, counter-clockwise.
fn posts(outer: &[VertexId], uv: &Uv) -> Vec<DVec2> {
    let (lo, hi) = outer
        .iter()
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi), &v| (lo.min(uv[v]), hi.max(uv[v])));
    let reach = 0.5 * FRAME * (hi - lo).max_element();
    let side = POSTS / 4;
    (0..POSTS)
        .map(|k| {
            let along = 2.0 * (k % side) as f64 / side as f64 - 1.0;
            let turn = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y][k / side];
            (lo + hi) / 2.0 + reach * turn.rotate(DVec2::new(along, -1.0))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{flatten::domain::FlattenDomain, mesh::shapes};

    /// A flat ring: its hole and the region around it.
    #[test]
    fn fillers_cover_the_hole_and_the_region_up_to_the_frame() {
        let mesh = shapes::tube(12, 3, 0.05, 0.1);
        let domain = FlattenDomain::new(&mesh).unwrap();
        let uv = mesh.positions.map(|p| p.truncate() * (1.0 + p.z));
        // Orientation on the map determines which loop is the outer one.
        let mut loops = domain.disk.loops.clone();
        let radius = |walk: &Vec<VertexId>| uv[walk[0]].length();
        loops.sort_by(|a, b| radius(b).total_cmp(&radius(a)));
        let twice = |uv: &Uv, t: &[VertexId; 3]| 2.0 * signed_area(t.map(|v| uv[v]));
        let faces: f64 = mesh.triangles.iter().map(|t| twice(&uv, t)).sum();
        if faces < 0.0 {
            loops.iter_mut().for_each(|walk| walk.reverse());
        }
        let holes = Fillers::new(&loops, &uv, false).unwrap();
        assert_eq!(holes.triangles.len(), loops[1].len() - 2);
        let framed = Fillers::new(&loops, &uv, true).unwrap();
        let with_posts = framed.with_posts(&uv);
        let sum: f64 = framed.triangles.iter().map(|t| twice(&with_posts, t)).sum();
        let side = with_posts[VertexId::new(uv.len())].distance(with_posts[VertexId::new(uv.len() + 6)]);
        assert!((sum + faces.abs() - 2.0 * side * side).abs() < 1e-12, "{sum} and {faces} fill {side}^2");
        assert!(framed.triangles.iter().all(|t| twice(&with_posts, t) > 0.0));
        let weight: f64 = framed.elements(&with_posts, 1e-2).iter().map(|e| e.weight).sum();
        assert!((weight - 1e-2).abs() < 1e-15);
    }

    #[test]
    fn a_rim_that_crosses_itself_has_no_fillers() {
        let rim: Vec<VertexId> = (0..4).map(VertexId::new).collect();
        let bow: Uv = [[0., 0.], [1., 1.], [1., 0.], [0., 1.]].map(DVec2::from_array).to_vec().into();
        assert!(Fillers::new(&[Vec::new(), rim], &bow, false).is_err());
    }
}
