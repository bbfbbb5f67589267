//! The first modules of a skin: along rims, and where a surface is flat.
//!
//! *Heuristic*: rows that begin at a straight rim fill a half shell, as a lattice would; on links that bend everywhere the
//! flattest places are better. Random starts gave 48 to 50 modules on a half shell of 60.

use std::f64::consts::FRAC_PI_2;

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::design::fit::{Anchors, Fitted, Shape};
use crate::design::{Module, Plate};
use crate::numeric::Random;
use crate::parallel::par_map;

/// Starts along all rims, and those that are tried and kept within the surface. *Heuristic*: with ten, two or three are on
/// each side of a half shell, of which two in three begin rows that fill it; more cost time.
const ALONG_RIMS: usize = 10;
const TRIED_WITHIN: usize = 60;
const KEPT_WITHIN: usize = 8;

/// Distance of the first row from a rim, in m: more than rounding, less than any cut.
const MARGIN: f64 = 2e-5;

/// How strongly a first module is held where it began, relative to its distance from the surface.
const WEIGHT: f64 = 0.02;

/// A first module on the surface; it stays about where `plate` is.
pub(super) fn settle(shape: &Shape<'_>, plate: Plate) -> Option<Fitted> {
    shape.fit(plate, &Anchors { strong: &[], weak: WEIGHT })
}

/// A flat plate whose drawing is turned by `turn` from `x` and has `at` of it at `place`.
fn flat(place: DVec3, normal: DVec3, x: DVec3, turn: f64, at: DVec2) -> Option<Plate> {
    let x = x.reject_from_normalized(normal).try_normalize()?;
    let (sin, cos) = turn.sin_cos();
    let y = normal.cross(x);
    let matrix3 = DMat3::from_cols(x * cos + y * sin, y * cos - x * sin, normal);
    let frame = DAffine3 { matrix3, translation: place - matrix3 * at.extend(0.0) };
    Some(Plate { frame, curvature: 0.0, direction: 0.0 })
}

/// Plates to begin with, settled: along the rims, then within the surface, the flattest first.
pub(super) fn starts(module: &Module, shape: &Shape<'_>) -> Vec<Fitted> {
    let settled = |plates: Vec<Plate>| par_map(&plates, |plate| settle(shape, *plate)).into_iter().flatten();
    let mut along: Vec<Fitted> = settled(at_rims(module, shape)).collect();
    let mut within: Vec<Fitted> = settled(on_area(module, shape, TRIED_WITHIN, 0)).collect();
    within.sort_by(|a, b| a.gap.total_cmp(&b.gap));
    within.truncate(KEPT_WITHIN);
    along.append(&mut within);
    along
}

/// Plates at places spread evenly over the area, in two turns of the direction in which the surface bends most.
pub(super) fn on_area(module: &Module, shape: &Shape<'_>, count: usize, seed: u64) -> Vec<Plate> {
    let mut random = Random::new(seed, 5);
    let edge = edge_angle(module);
    let mut plates = Vec::new();
    for (k, (place, normal)) in shape.surface.samples(count, seed).into_iter().enumerate() {
        let x = random.direction();
        let Some(plate) = flat(place, normal, x, 0.0, module.centre()) else { continue };
        let bends = shape.surface.curvature(&plate, &shape.points).map_or(0.0, |found| found.direction);
        let turn = bends - edge + if k % 2 == 0 { 0.0 } else { FRAC_PI_2 };
        plates.extend(flat(place, normal, plate.frame.matrix3.x_axis, turn, module.centre()));
    }
    plates
}

/// The direction of the first edge in the drawing.
fn edge_angle(module: &Module) -> f64 {
    let [a, b] = module.edge(0);
    (b - a).to_angle()
}

/// Plates with an edge along a rim, or perpendicular to it; more of them along longer rims.
fn at_rims(module: &Module, shape: &Shape<'_>) -> Vec<Plate> {
    let loops = shape.surface.rim_loops();
    let length =
        |walk: &[DVec3]| (0..walk.len()).map(|k| walk[k].distance(walk[(k + 1) % walk.len()])).sum::<f64>();
    let whole: f64 = loops.iter().map(|walk| length(walk)).sum();
    let [a, b] = module.edge(0);
    let side = a.distance(b);
    let mut plates = Vec::new();
    let mut done = 0.0;
    let mut next = 0.5;
    for walk in &loops {
        let own = length(walk);
        // Shorter than three modules: a hole of a screw.
        while next * whole / (ALONG_RIMS as f64) < done + own {
            let s = next * whole / ALONG_RIMS as f64 - done;
            next += 1.0;
            if own < 3.0 * side {
                continue;
            }
            let [from, to] = [s - 0.5 * side, s + 0.5 * side].map(|s| along(walk, s.rem_euclid(own)));
            let place = from.midpoint(to);
            let Some(chord) = (to - from).try_normalize() else { continue };
            let Some(foot) = shape.surface.nearest(along(walk, s), DVec3::ZERO, &mut None) else { continue };
            let edge = edge_angle(module);
            for turn in [-edge, FRAC_PI_2 - edge] {
                // The lowest point of the turned drawing comes to the rim.
                let low = |p: &DVec2| DVec2::from_angle(turn).rotate(*p).y;
                let lowest = module.outline.iter().map(low).fold(f64::INFINITY, f64::min);
                let middle = DVec2::from_angle(turn).rotate(a.midpoint(b)).x;
                let at = DVec2::from_angle(-turn).rotate(DVec2::new(middle, lowest - MARGIN));
                plates.extend(flat(place, foot.normal, chord, turn, at));
            }
        }
        done += own;
    }
    plates
}

/// The point of a closed walk at this distance from its beginning.
fn along(walk: &[DVec3], mut s: f64) -> DVec3 {
    for k in 0..walk.len() {
        let (from, to) = (walk[k], walk[(k + 1) % walk.len()]);
        let length = from.distance(to);
        if s <= length && length > 0.0 {
            return from.lerp(to, s / length);
        }
        s -= length;
    }
    walk[0]
}
