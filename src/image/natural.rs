//! Natural-neighbour weights: how much of each site's Voronoi cell a point would take over if it
//! were a site itself (sibson1981).
//!
//! The triangles of the Delaunay triangulation whose circumcircles hold the point form a star
//! around it. The cell that it would get has a corner for each edge `a b` of the star's rim, the
//! circumcentre of `a`, `b` and the point. What it takes from a site is the polygon between those
//! corners and the circumcentres of the site's triangles in the star; its area is summed edge by
//! edge. Weights that miss a linear field by rounding are corrected to reproduce it.
//!
//! Pixels find their triangle by rasterising the triangulation, so each is computed by itself, in
//! the same way with any number of threads.

use std::collections::HashMap;

use glam::{DMat2, DVec2};

use crate::delaunay::triangulate;

/// A point this close to a site or to an edge of the hull, in units of an edge, lies on it.
const ON_EDGE: f64 = 1e-9;

/// Weights below this after the correction are not those of a natural neighbour.
const NEGATIVE: f64 = -1e-6;

/// The Delaunay triangulation of sites that differ.
#[derive(Debug, Clone)]
pub(super) struct Neighbours {
    sites: Vec<DVec2>,
    /// Counter-clockwise.
    pub(super) triangles: Vec<[usize; 3]>,
    circumcentres: Vec<DVec2>,
    /// Across the edge opposite of each corner.
    across: Vec<[Option<usize>; 3]>,
    /// Sites that share an edge, of every site: ascending.
    neighbours: Vec<Vec<u32>>,
}

/// What is kept from point to point.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    star: Vec<usize>,
    open: Vec<usize>,
    /// The rim of the star: from, to, corner of the new cell.
    rim: Vec<(usize, usize, DVec2)>,
    /// Site and weight.
    pub(super) weights: Vec<(u32, f64)>,
}

impl Neighbours {
    /// The neighbours of sites that are finite and differ.
    pub(super) fn new(sites: Vec<DVec2>) -> Self {
        // Such sites have a triangulation; without one every point has the nearest site.
        let triangles = triangulate(&sites).unwrap_or_default();
        let mut edges = HashMap::with_capacity(3 * triangles.len());
        for (t, [a, b, c]) in triangles.iter().enumerate() {
            edges.extend([((*b, *c), t), ((*c, *a), t), ((*a, *b), t)]);
        }
        let beyond = |from: usize, to: usize| edges.get(&(to, from)).copied();
        let across = triangles.iter().map(|&[a, b, c]| [beyond(b, c), beyond(c, a), beyond(a, b)]).collect();
        let mut neighbours = vec![Vec::new(); sites.len()];
        for (a, b) in triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]) {
            neighbours[a].push(u32::try_from(b).unwrap_or(u32::MAX));
            neighbours[b].push(u32::try_from(a).unwrap_or(u32::MAX));
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        let circumcentres = triangles
            .iter()
            .map(|&[a, b, c]| sites[a] + circumcentre(sites[b] - sites[a], sites[c] - sites[a]))
            .collect();
        Self { sites, triangles, circumcentres, across, neighbours }
    }

    /// The site nearest to a point, walking from `start`: the first that none of its neighbours
    /// beats.
    pub(super) fn nearest(&self, p: DVec2, start: usize) -> usize {
        if self.triangles.is_empty() {
            let distance = |&s: &usize| self.sites[s].distance_squared(p);
            let all = 0..self.sites.len();
            return all.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(start);
        }
        let mut at = start;
        loop {
            let distance = |s: usize| self.sites[s].distance_squared(p);
            let around = self.neighbours[at].iter().map(|&s| s as usize);
            let best = around.fold(at, |best, s| if distance(s) < distance(best) { s } else { best });
            if best == at {
                return at;
            }
            at = best;
        }
    }

    /// The weights of a point that lies in `triangle`, in `scratch.weights`: sum 1.
    pub(super) fn weights(&self, p: DVec2, triangle: usize, scratch: &mut Scratch) {
        let Scratch { star, open, rim, weights } = scratch;
        weights.clear();
        let corners = self.triangles[triangle];
        let size = self.sites[corners[0]].distance(self.sites[corners[1]]);
        if let Some(&site) = corners.iter().find(|&&s| self.sites[s].distance(p) <= ON_EDGE * size) {
            weights.push((index(site), 1.0));
            return;
        }
        self.find_star(p, triangle, star, open);
        rim.clear();
        for &t in &*star {
            for k in 0..3 {
                let (from, to) = (self.triangles[t][(k + 1) % 3], self.triangles[t][(k + 2) % 3]);
                if self.across[t][k].is_some_and(|other| star.contains(&other)) {
                    continue;
                }
                let (a, b) = (self.sites[from] - p, self.sites[to] - p);
                if a.perp_dot(b) <= ON_EDGE * (b - a).length_squared() {
                    let along = (-a).dot(b - a) / (b - a).length_squared();
                    let along = along.clamp(0.0, 1.0);
                    weights.extend([(index(from), 1.0 - along), (index(to), along)]);
                    return;
                }
                rim.push((from, to, circumcentre(a, b)));
            }
        }
        self.areas(p, star, rim, weights);
        if !correct(weights, &self.sites, p) {
            self.barycentric(p, triangle, weights);
        }
    }

    /// The triangles whose circumcircles hold `p`, from the one that `p` lies in.
    fn find_star(&self, p: DVec2, triangle: usize, star: &mut Vec<usize>, open: &mut Vec<usize>) {
        star.clear();
        open.clear();
        star.push(triangle);
        open.push(triangle);
        while let Some(t) = open.pop() {
            for next in self.across[t].into_iter().flatten() {
                let centre = self.circumcentres[next];
                let corner = self.sites[self.triangles[next][0]];
                let inside = centre.distance_squared(p) < centre.distance_squared(corner);
                if inside && !star.contains(&next) {
                    star.push(next);
                    open.push(next);
                }
            }
        }
    }

    /// The areas that `p` takes from the sites of the rim.
    fn areas(&self, p: DVec2, star: &[usize], rim: &[(usize, usize, DVec2)], weights: &mut Vec<(u32, f64)>) {
        // Of every site the edges of the polygon that is taken from it, counter-clockwise.
        for &(site, _, corner) in rim {
            let before = rim.iter().find(|(_, to, _)| *to == site);
            let mut area = before.map_or(0.0, |(_, _, other)| corner.perp_dot(*other));
            for &t in star {
                let corners = self.triangles[t];
                let Some(k) = corners.iter().position(|&s| s == site) else { continue };
                let centre = self.circumcentres[t] - p;
                // Across the edge that leaves the site, and the one that comes to it.
                let beyond = |edge: usize| self.across[t][edge].filter(|other| star.contains(other));
                let (leaves, comes) = (beyond((k + 2) % 3), beyond((k + 1) % 3));
                if leaves.is_none() {
                    area += centre.perp_dot(corner);
                }
                match (comes, before) {
                    (Some(next), _) => area += (self.circumcentres[next] - p).perp_dot(centre),
                    (None, Some((_, _, first))) => area += first.perp_dot(centre),
                    (None, None) => {}
                }
            }
            weights.push((index(site), -area));
        }
    }

    fn barycentric(&self, p: DVec2, triangle: usize, weights: &mut Vec<(u32, f64)>) {
        let [a, b, c] = self.triangles[triangle].map(|s| self.sites[s] - p);
        let areas = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)].map(|x| x.max(0.0));
        let sum: f64 = areas.iter().sum();
        weights.clear();
        weights.extend(self.triangles[triangle].iter().zip(areas).map(|(&s, area)| (index(s), area / sum)));
    }
}

fn index(site: usize) -> u32 {
    u32::try_from(site).unwrap_or(u32::MAX)
}

/// The centre of the circle through the origin, `a` and `b`.
fn circumcentre(a: DVec2, b: DVec2) -> DVec2 {
    (b.perp() * a.length_squared() - a.perp() * b.length_squared()) / (-2.0 * a.perp_dot(b))
}

/// Scales weights to the sum 1, and turns them by the least linear factor so that the sites' mean
/// is `p`. Says whether that gave weights that are not negative.
fn correct(weights: &mut [(u32, f64)], sites: &[DVec2], p: DVec2) -> bool {
    weights.iter_mut().for_each(|(_, w)| *w = w.max(0.0));
    let sum: f64 = weights.iter().map(|(_, w)| w).sum();
    weights.iter_mut().for_each(|(_, w)| *w /= sum);
    let at = |site: u32| sites[site as usize] - p;
    let mean: DVec2 = weights.iter().map(|(site, w)| at(*site) * *w).sum();
    let spread = weights.iter().fold(DMat2::ZERO, |m, (site, w)| {
        let d = at(*site) - mean;
        m + DMat2::from_cols(d * d.x, d * d.y) * *w
    });
    let slope = -(spread.inverse() * mean);
    weights.iter_mut().for_each(|(site, w)| *w *= 1.0 + slope.dot(sites[*site as usize] - p - mean));
    weights.iter().all(|(_, w)| *w >= NEGATIVE)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn inside(neighbours: &Neighbours, p: DVec2) -> Option<usize> {
        let holds = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|s| neighbours.sites[s] - p);
            a.perp_dot(b) >= 0.0 && b.perp_dot(c) >= 0.0 && c.perp_dot(a) >= 0.0
        };
        neighbours.triangles.iter().position(holds)
    }

    /// What a fine grid of points says: the share of the new cell that each site had.
    fn by_counting(sites: &[DVec2], p: DVec2, span: f64) -> Vec<f64> {
        let mut taken = vec![0.0; sites.len()];
        let n = 400;
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let step = |k: i32| (f64::from(k) + 0.5) / f64::from(n) * 2.0 - 1.0;
            let q = p + DVec2::new(step(i), step(j)) * span;
            let d = |s: &DVec2| s.distance_squared(q);
            let nearest = (0..sites.len()).min_by(|&a, &b| d(&sites[a]).total_cmp(&d(&sites[b]))).unwrap();
            if q.distance_squared(p) < d(&sites[nearest]) {
                taken[nearest] += 1.0;
            }
        }
        let sum: f64 = taken.iter().sum();
        taken.iter().map(|t| t / sum).collect()
    }

    #[test]
    fn weights_are_the_areas_taken_from_voronoi_cells() {
        let place = |k: i32| {
            let turn = f64::from(k) * 2.4;
            DVec2::new(turn.cos(), turn.sin()) * (f64::from(k) / 30.0).sqrt()
        };
        let sites: Vec<DVec2> = (0..30).map(place).collect();
        let neighbours = Neighbours::new(sites.clone());
        let mut scratch = Scratch::default();
        for p in [DVec2::new(0.1, 0.05), DVec2::new(-0.3, 0.2), DVec2::new(0.02, -0.4)] {
            neighbours.weights(p, inside(&neighbours, p).unwrap(), &mut scratch);
            let counted = by_counting(&sites, p, 0.6);
            for (site, counted) in counted.iter().enumerate() {
                let found =
                    scratch.weights.iter().find(|(s, _)| *s as usize == site).map_or(0.0, |(_, w)| *w);
                assert!((found - counted).abs() < 5e-3, "site {site} at {p}: {found}, counted {counted}");
            }
        }
    }

    proptest! {
        /// Integer coordinates put many points on common lines and circles.
        #[test]
        fn linear_fields_are_reproduced(
            places in prop::collection::btree_set((-6_i32..6, -6_i32..6), 4..50),
            at in prop::collection::vec((-6.0..6.0_f64, -6.0..6.0_f64), 20),
            on_grid in any::<bool>(),
        ) {
            let sites: Vec<DVec2> = places.into_iter().map(|(x, y)| DVec2::new(x.into(), y.into())).collect();
            let neighbours = Neighbours::new(sites.clone());
            let mut scratch = Scratch::default();
            for (x, y) in at {
                let p = if on_grid { DVec2::new((2.0 * x).round() / 2.0, y.round()) } else { DVec2::new(x, y) };
                let Some(triangle) = inside(&neighbours, p) else { continue };
                neighbours.weights(p, triangle, &mut scratch);
                let sum: f64 = scratch.weights.iter().map(|(_, w)| w).sum();
                let mean: DVec2 = scratch.weights.iter().map(|(s, w)| sites[*s as usize] * *w).sum();
                prop_assert!((sum - 1.0).abs() < 1e-12 && scratch.weights.iter().all(|(_, w)| *w > -1e-6));
                prop_assert!(mean.distance(p) < 1e-9 * 12.0, "{mean} is not {p}");
            }
        }

        /// The walk finds what a search through all sites finds.
        #[test]
        fn the_nearest_site_is_found(
            places in prop::collection::btree_set((-6_i32..6, -6_i32..6), 1..50), x in -9.0..9.0_f64, y in -9.0..9.0_f64,
        ) {
            let sites: Vec<DVec2> = places.into_iter().map(|(x, y)| DVec2::new(x.into(), y.into())).collect();
            let p = DVec2::new(x, y);
            let found = Neighbours::new(sites.clone()).nearest(p, 0);
            let least = sites.iter().map(|s| s.distance(p)).fold(f64::INFINITY, f64::min);
            prop_assert!((sites[found].distance(p) - least).abs() < 1e-12);
        }
    }
}
