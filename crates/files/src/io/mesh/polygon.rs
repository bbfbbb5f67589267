//! Polygons of any shape, cut into triangles: what OBJ, OFF, PLY and COLLADA have for faces.
//!
//! A polygon is judged in the plane in which its area is largest. Where its first corner sees all of it, it
//! becomes the fan around that corner, as other readers cut convex polygons; else the constrained Delaunay
//! triangulation between its edges. Bridges from an outline to its holes, edges that are walked both ways, are
//! allowed.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::delaunay::triangulate_region;
use crate::mesh::triangles_of_least_area;
use crate::numeric::bits;
use crate::skin::{Remark, RemarkKind};

/// A polygon is a line, without a plane, if the areas of its fan are below this share of its squared length; a
/// triangle of a fan has no area below this share of the polygon; areas add up to that of the polygon with this
/// relative error.
const MIN_SHARE: f64 = 1e-9;

pub(super) const CROSSED: &str = "a polygon that crosses or touches itself";

/// What is needed instead of a polygon that has no triangles.
pub(super) const POLYGON_NEEDED: &str =
    "a polygon whose edges meet at its corners alone; other programs triangulate faces on export";

/// A polygon is warped, and not flat, if a corner is farther from its plane than this share of its length.
const WARPED: f64 = 1e-4;

/// Most corners of a warped polygon: its triangles take time with their cube.
const MOST_WARPED: usize = 200;

/// The polygons of a file.
#[derive(Debug, Default)]
pub(super) struct Polygons {
    /// How many cross themselves when they are laid flat, but are not flat.
    warped: usize,
}

impl Polygons {
    /// The triangles of a polygon, as [`cut_polygon`]; those of least area where it is warped so much that it crosses itself
    /// in its plane only.
    pub(super) fn cut(&mut self, outline: &[DVec3], holes: &[Vec<DVec3>]) -> Option<Vec<[usize; 3]>> {
        let cut = cut_polygon(outline, holes);
        if cut.is_some() || !holes.is_empty() || outline.len() > MOST_WARPED || !is_warped(outline) {
            return cut;
        }
        self.warped += 1;
        triangles_of_least_area(outline, |_, _| true)
    }

    /// Says how many are warped.
    pub(super) fn remark(&self, patch: String) -> Option<Remark> {
        let what = match self.warped {
            0 => return None,
            1 => "1 face is not flat and crosses itself in its plane; it became the triangles of least area"
                .into(),
            n => format!(
                "{n} faces are not flat and cross themselves in their planes; they became the triangles of least area"
            ),
        };
        Some(Remark { patch, kind: RemarkKind::PassedOver { what } })
    }
}

/// Whether a polygon is not flat.
fn is_warped(outline: &[DVec3]) -> bool {
    let middle = outline.iter().sum::<DVec3>() / outline.len() as f64;
    let ends = || outline.iter().zip(outline.iter().cycle().skip(1));
    let normal: DVec3 = ends().map(|(a, b)| (a - middle).cross(b - middle)).sum();
    let length: f64 = ends().map(|(a, b)| a.distance(*b)).sum();
    let height = |p: &DVec3| (p - middle).dot(normal.normalize_or_zero()).abs();
    outline.iter().map(height).fold(0.0, f64::max) > WARPED * length
}

/// The triangles of a polygon: numbers of corners, of the outline and then of each hole. A polygon without area
/// becomes a fan, and one of one or two corners, a point or a line in some files, a triangle with a corner twice, which
/// is left out later with a note. `None` if it crosses or touches itself.
fn cut_polygon(outline: &[DVec3], holes: &[Vec<DVec3>]) -> Option<Vec<[usize; 3]>> {
    if outline.len() < 3 {
        let last = outline.len().checked_sub(1)?;
        return Some(vec![[0, last, last]]);
    }
    let fan = || (2..outline.len()).map(|k| [0, k - 1, k]);
    let start = outline[0];
    let cross = |[a, b, c]: [usize; 3]| (outline[b] - outline[a]).cross(outline[c] - outline[a]);
    let normal: DVec3 = fan().map(cross).sum();
    let size: f64 = fan().map(|t| cross(t).length()).sum();
    let length: f64 = (0..outline.len()).map(|k| outline[k].distance(outline[(k + 1) % outline.len()])).sum();
    let area = normal.length();
    if holes.is_empty() && (outline.len() == 3 || !size.is_finite() || size <= MIN_SHARE * length * length) {
        return Some(fan().collect());
    }
    if area <= MIN_SHARE * size {
        return None;
    }
    let (x, y) = normal.try_normalize()?.any_orthonormal_pair();
    let flat = |p: &DVec3| DVec2::new((p - start).dot(x), (p - start).dot(y));
    let rings: Vec<Vec<DVec2>> = std::iter::once(outline)
        .chain(holes.iter().map(Vec::as_slice))
        .map(|r| r.iter().map(flat).collect())
        .collect();
    if holes.is_empty() && is_seen_from_first(&rings[0], area) {
        return Some(fan().collect());
    }
    between(&rings)
}

/// Twice the area of a triangle, negative if it runs clockwise.
fn twice_area([a, b, c]: [DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Whether the fan around the first corner covers a polygon of twice this `area` once.
fn is_seen_from_first(ring: &[DVec2], area: f64) -> bool {
    let first = ring[0];
    let angle = |pair: &[DVec2]| (pair[0] - first).angle_to(pair[1] - first);
    ring[1..].windows(2).all(|pair| twice_area([first, pair[0], pair[1]]) > MIN_SHARE * area)
        && ring[1..].windows(2).map(angle).sum::<f64>() < TAU
}

/// The triangles between an outline and its holes.
fn between(rings: &[Vec<DVec2>]) -> Option<Vec<[usize; 3]>> {
    let (mut points, mut corners, mut edges) = (Vec::new(), Vec::new(), Vec::new());
    let (mut known, mut before, mut area) = (HashMap::new(), 0, 0.0);
    for (k, ring) in rings.iter().enumerate() {
        let signed: f64 = ring.windows(2).map(|pair| twice_area([ring[0], pair[0], pair[1]])).sum();
        let is_turned = (signed > 0.0) != (k == 0);
        area += if k == 0 { signed } else { -signed.abs() };
        let site = |(corner, p): (usize, &DVec2)| {
            *known.entry(bits(p.to_array())).or_insert_with(|| {
                points.push(*p);
                corners.push(before + corner);
                points.len() - 1
            })
        };
        let mut sites: Vec<usize> = ring.iter().enumerate().map(site).collect();
        if is_turned {
            sites.reverse();
        }
        let ends = sites.iter().zip(sites.iter().cycle().skip(1));
        edges.extend(ends.filter(|(from, to)| from != to).map(|(&from, &to)| [from, to]));
        before += ring.len();
    }
    let triangles = triangulate_region(&points, &edges).ok()?;
    let covered: f64 = triangles.iter().map(|t| twice_area(t.map(|site| points[site]))).sum();
    let is_covered = (covered - area).abs() <= MIN_SHARE * area;
    is_covered.then(|| triangles.into_iter().map(|t| t.map(|site| corners[site])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(points: &[[f64; 2]]) -> Vec<DVec3> {
        // In a slanted plane.
        points.iter().map(|&[x, y]| DVec3::new(x, y, 0.3 * x - 2.0 * y)).collect()
    }

    const SQUARE: [[f64; 2]; 4] = [[0., 0.], [4., 0.], [4., 4.], [0., 4.]];
    const INNER: [[f64; 2]; 4] = [[1., 1.], [2., 1.], [2., 2.], [1., 2.]];

    #[test]
    fn areas_are_those_of_the_polygons() {
        let reverse = |ring: &[[f64; 2]]| ring.iter().rev().copied().collect::<Vec<_>>();
        // The outline, then to the hole along a bridge, around it and back.
        let bridged =
            [&SQUARE[..], &SQUARE[..1], &[[1., 1.], [1., 2.], [2., 2.], [2., 1.], [1., 1.]]].concat();
        type Ring = Vec<[f64; 2]>;
        let cases: [(&str, Ring, Ring, f64); 9] = [
            ("square", SQUARE.to_vec(), vec![], 16.0),
            ("L", vec![[3., 1.], [1., 1.], [1., 3.], [0., 3.], [0., 0.], [3., 0.]], vec![], 5.0),
            ("arrow", vec![[1., 0.], [4., 0.], [0., 0.5], [0., -1.]], vec![], 1.5),
            (
                "a corner on a straight edge",
                vec![[0., 0.], [1., 0.], [4., 0.], [4., 4.], [0., 4.]],
                vec![],
                16.0,
            ),
            ("a corner twice", vec![[0., 0.], [4., 0.], [4., 0.], [4., 4.], [0., 4.]], vec![], 16.0),
            ("a hole", SQUARE.to_vec(), INNER.to_vec(), 15.0),
            ("a hole that runs as its outline", SQUARE.to_vec(), reverse(&INNER), 15.0),
            ("a bridge", bridged, vec![], 15.0),
            ("a line", vec![[0., 0.], [1., 0.], [2., 0.], [3., 0.]], vec![], 0.0),
        ];
        for (name, outline, hole, area) in cases {
            let holes = if hole.is_empty() { vec![] } else { vec![at(&hole)] };
            let all = [outline.clone(), hole].concat();
            let triangles = cut_polygon(&at(&outline), &holes).expect(name);
            let twice = |t: &[usize; 3]| twice_area(t.map(|k| DVec2::from_array(all[k])));
            let total: f64 = triangles.iter().map(twice).sum();
            let sizes: f64 = triangles.iter().map(|t| twice(t).abs()).sum();
            assert!((total.abs() / 2.0 - area).abs() < 1e-12 && (sizes / 2.0 - area).abs() < 1e-12, "{name}");
        }
    }

    #[test]
    fn what_is_convex_stays_a_fan() {
        assert_eq!(cut_polygon(&at(&SQUARE), &[]).unwrap(), [[0, 1, 2], [0, 2, 3]]);
    }

    /// A strip of 35 x 0.7 mm that bends by 0.45 mm out of its plane, in which it crosses itself.
    #[test]
    fn a_warped_polygon_becomes_triangles() {
        let strip = [
            [0.026925, -0.346435, 0.030275],
            [0.02692, -0.346434, 0.030272],
            [0.026429, -0.346403, 0.030146],
            [0.026034, -0.336713, 0.033096],
            [0.02472, -0.322218, 0.036134],
            [0.02393, -0.316661, 0.036882],
            [0.024419, -0.316601, 0.037021],
        ]
        .map(DVec3::from_array);
        assert_eq!(cut_polygon(&strip, &[]), None);
        let mut polygons = Polygons::default();
        let triangles = polygons.cut(&strip, &[]).unwrap();
        let area = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|k| strip[k]);
            (b - a).cross(c - a).length() / 2.0
        };
        let total: f64 = triangles.iter().map(area).sum();
        assert!(triangles.len() == 5 && (1.5e-5..2.5e-5).contains(&total), "{total} m^2");
        assert!(polygons.remark("a".into()).is_some());
        let bow: Vec<DVec3> = at(&[[0., 0.], [4., 4.], [4., 0.], [0., 1.]]);
        assert_eq!(Polygons::default().cut(&bow, &[]), None, "it is flat");
    }

    #[test]
    fn crossed_polygons_are_refused() {
        let bow = [[0., 0.], [4., 4.], [4., 0.], [0., 1.]];
        let even = [[0., 0.], [4., 4.], [4., 0.], [0., 4.]];
        let star = [0., 2., 4., 1., 3.].map(|k: f64| [(k * TAU / 5.0).cos(), (k * TAU / 5.0).sin()]);
        let twice_around = [&SQUARE[..], &INNER.map(|[x, y]| [x - 0.5, y - 0.5])].concat();
        for (name, ring) in [
            ("bow", &bow[..]),
            ("a bow of two halves alike", &even),
            ("star", &star),
            ("around twice", &twice_around),
        ] {
            assert_eq!(cut_polygon(&at(ring), &[]), None, "{name}");
        }
        assert_eq!(
            cut_polygon(&at(&SQUARE), &[at(&[[3., 3.], [5., 3.], [5., 5.]])]),
            None,
            "a hole that crosses"
        );
    }
}
