//! A hand: a palm with five fingers whose tips are ten times denser than the palm.

use dermatome::{mesh::TriMesh, skin::Skin};
use glam::{DVec2, DVec3};

use crate::{
    delaunay::triangulate,
    grid::{STEP, snapped},
};

/// Spacing of the taxels on the palm, in m.
const PALM_SPACING: f64 = 0.0034;
/// How much denser the fingertips are, in taxels per area.
const DENSITY: f64 = 10.0;
/// Length of the dense part of each finger, in m.
const TIP: f64 = 0.020;
/// Where the fingertip's density has faded to the palm's, in m from the end.
const FADED: f64 = 0.055;

/// Middle of the palm and half its size less its rounding, in m.
const PALM: (DVec2, DVec2) = (DVec2::new(0.0, 0.042), DVec2::new(0.026, 0.030));
/// Rounding of the palm's corners, in m.
const ROUNDING: f64 = 0.014;

/// One finger: a strip with a round end.
struct Finger {
    /// Where its axis starts, within the palm, in m.
    root: DVec2,
    /// Where its axis ends, in m.
    tip: DVec2,
    /// Half its width, in m.
    radius: f64,
}

const fn finger(root: [f64; 2], tip: [f64; 2], radius: f64) -> Finger {
    Finger { root: DVec2::from_array(root), tip: DVec2::from_array(tip), radius }
}

/// Thumb, index, middle, ring and little finger of a left hand, seen from the palm.
const FINGERS: [Finger; 5] = [
    finger([0.028, 0.035], [0.080, 0.078], 0.0100),
    finger([0.029, 0.075], [0.043, 0.146], 0.0085),
    finger([0.010, 0.078], [0.014, 0.158], 0.0085),
    finger([-0.010, 0.078], [-0.014, 0.152], 0.0085),
    finger([-0.029, 0.075], [-0.043, 0.133], 0.0080),
];

/// Some thousand taxels on a cupped palm and five curled fingers, one disk.
pub fn hand() -> Skin {
    let (points, triangles) = relaxed_disk();
    let triangles: Vec<[u32; 3]> =
        triangles.iter().map(|t| t.map(|v| u32::try_from(v).expect("some thousand points"))).collect();
    Skin::from_mesh(
        "hand",
        snapped(TriMesh::from_arrays(points.iter().map(|&p| lift(p)).collect(), &triangles)),
    )
}

/// Share of the way along a finger's axis nearest to `p`, and the distance from there, in m.
fn along(finger: &Finger, p: DVec2) -> (f64, f64) {
    let axis = finger.tip - finger.root;
    let share = ((p - finger.root).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    (share, p.distance(finger.root + share * axis))
}

/// Signed distance to the outline of the hand, in m, negative inside; rounded in the corners
/// between the fingers.
fn outline(p: DVec2) -> f64 {
    let (middle, half) = PALM;
    let beyond = (p - middle).abs() - half;
    let palm = beyond.max(DVec2::ZERO).length() + beyond.max_element().min(0.0) - ROUNDING;
    FINGERS.iter().map(|f| along(f, p).1 - f.radius).fold(palm, rounded_union)
}

/// Distance to the union of two shapes with the corner between them rounded (polynomial smooth
/// minimum, Quilez 2013).
fn rounded_union(a: f64, b: f64) -> f64 {
    /// About the width of the rounding, in m.
    const WIDTH: f64 = 0.004;
    let h = (WIDTH - (a - b).abs()).max(0.0) / WIDTH;
    a.min(b) - 0.25 * WIDTH * h * h
}

/// Wanted spacing of the taxels at `p`, in m.
fn spacing(p: DVec2) -> f64 {
    let fine = PALM_SPACING / DENSITY.sqrt();
    FINGERS
        .iter()
        .map(|f| {
            let (share, away) = along(f, p);
            let from_end = (1.0 - share) * f.root.distance(f.tip) + (away - f.radius).max(0.0);
            fine + ((from_end - TIP) / (FADED - TIP)).clamp(0.0, 1.0) * (PALM_SPACING - fine)
        })
        .fold(PALM_SPACING, f64::min)
}

/// Numbers between 0 and 1 from a fixed start (xorshift, Marsaglia 2003).
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        // The upper 53 bits are a fraction in f64.
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Points within the outline at the wanted spacing and their triangles (Persson and Strang 2004):
/// edges that are shorter than wanted push, and what is pushed out comes back to the outline.
fn relaxed_disk() -> (Vec<DVec2>, Vec<[usize; 3]>) {
    /// Edges push up to this much over their wanted length, so that points fill the outline.
    const PRESSURE: f64 = 1.2;
    /// Share of the force that moves a point in one step.
    const STEP_SIZE: f64 = 0.2;
    /// After so many steps the mesh no longer gets better.
    const STEPS: usize = 160;
    let mut points = scattered();
    let mut triangles = Vec::new();
    for step in 0..=STEPS {
        points.iter_mut().for_each(|p| *p = (*p / STEP).round() * STEP);
        triangles = inside(&points);
        if step == STEPS {
            break;
        }
        let edges = edges(&triangles);
        let wanted: Vec<f64> = edges.iter().map(|&[a, b]| spacing(points[a].midpoint(points[b]))).collect();
        let squares = |lengths: &mut dyn Iterator<Item = f64>| lengths.map(|l| l * l).sum::<f64>();
        let found = squares(&mut edges.iter().map(|&[a, b]| points[a].distance(points[b])));
        let scale = PRESSURE * (found / squares(&mut wanted.iter().copied())).sqrt();
        let mut forces = vec![DVec2::ZERO; points.len()];
        for (&[a, b], wanted) in edges.iter().zip(wanted) {
            let edge = points[a] - points[b];
            let length = edge.length();
            let push = (scale * wanted - length).max(0.0) / length * edge;
            forces[a] += push;
            forces[b] -= push;
        }
        for (p, force) in points.iter_mut().zip(forces) {
            *p += STEP_SIZE * force;
            *p = pulled_in(*p);
        }
    }
    (points, triangles)
}

/// A point outside the outline is brought back to it, along the steepest way.
fn pulled_in(mut p: DVec2) -> DVec2 {
    /// For the slope of the outline's distance, in m.
    const DELTA: f64 = 1e-6;
    // The distance is not exact where shapes are joined: three times comes close enough.
    for _ in 0..3 {
        let distance = outline(p);
        if distance <= 0.0 {
            break;
        }
        let slope =
            DVec2::new(outline(p + DELTA * DVec2::X) - distance, outline(p + DELTA * DVec2::Y) - distance);
        p -= distance * slope.normalize_or_zero();
    }
    p
}

/// Points of a fine lattice, each kept with a probability that gives the wanted density.
fn scattered() -> Vec<DVec2> {
    let fine = PALM_SPACING / DENSITY.sqrt();
    let mut dice = Dice(0x2545_F491_4F6C_DD1D);
    let mut points = Vec::new();
    for j in 0..200_i32 {
        for i in -120..120_i32 {
            let x = f64::from(i) + 0.5 * f64::from(j % 2);
            let p = fine * DVec2::new(x, 0.75_f64.sqrt() * f64::from(j));
            let share = fine / spacing(p);
            if outline(p) < 0.0 && dice.roll() < share * share {
                points.push(p);
            }
        }
    }
    points
}

/// The Delaunay triangles whose middle lies within the outline.
fn inside(points: &[DVec2]) -> Vec<[usize; 3]> {
    let mut triangles = triangulate(points);
    triangles.retain(|t| {
        let middle = t.iter().map(|&v| points[v]).sum::<DVec2>() / 3.0;
        // Slivers between points of the outline have their middle just within it.
        outline(middle) < -0.1 * spacing(middle)
    });
    triangles
}

/// Every edge once, in order.
fn edges(triangles: &[[usize; 3]]) -> Vec<[usize; 2]> {
    let sides = |t: &[usize; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let mut edges: Vec<[usize; 2]> =
        triangles.iter().flat_map(sides).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// Cups the palm and curls the fingers: the outside of the skin, with the hand behind it, looks up.
fn lift(p: DVec2) -> DVec3 {
    /// Depth of the cup at 0.1 m from the middle of the palm, in m.
    const CUP: f64 = 0.030;
    /// Curvature across a finger, in 1/m: half a turn around the thumb.
    const ACROSS: f64 = 110.0;
    let q = p - PALM.0;
    let cup = CUP * q.length_squared() / 0.01;
    // How far across the finger nearest by, faded in from its root to its first half.
    let round = FINGERS
        .iter()
        .map(|f| {
            let (share, away) = along(f, p);
            let faded = (2.0 * share - 0.4).clamp(0.0, 1.0);
            let within = away.min(1.2 * f.radius);
            0.5 * ACROSS * faded * faded * (3.0 - 2.0 * faded) * within * within
        })
        .fold(0.0, f64::max);
    DVec3::new(p.x, p.y, cup - round)
}
