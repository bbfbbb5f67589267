//! Hands: a palm with five fingers whose tips are ten times denser than the palm, and one of a robot with other
//! proportions, another spacing, and a patch for the palm and for each finger.

use dermatome::{
    mesh::TriMesh,
    skin::{Link, Patch, Skin, TaxelId},
};
use glam::{DAffine3, DVec2, DVec3};

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

/// Spacing of the taxels of the robot's hand, in m.
const ROBOT_SPACING: f64 = 0.004;
/// Half the gap between the patches of the robot's hand, as a share of a finger.
const GAP: f64 = 0.02;
/// Where the fingers of the robot begin, as a share of their axis from within the palm.
const KNUCKLE: f64 = 0.28;

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

/// The outline of a hand, and how dense it is.
struct Shape {
    /// Middle of the palm and half its size less its rounding, in m.
    palm: (DVec2, DVec2),
    /// Thumb, index, middle, ring and little finger of a left hand, seen from the palm.
    fingers: [Finger; 5],
    /// Whether the tips are denser than the palm.
    has_dense_tips: bool,
}

const PERSON: Shape = Shape {
    palm: (DVec2::new(0.0, 0.042), DVec2::new(0.026, 0.030)),
    fingers: [
        finger([0.028, 0.035], [0.080, 0.078], 0.0100),
        finger([0.029, 0.075], [0.043, 0.146], 0.0085),
        finger([0.010, 0.078], [0.014, 0.158], 0.0085),
        finger([-0.010, 0.078], [-0.014, 0.152], 0.0085),
        finger([-0.029, 0.075], [-0.043, 0.133], 0.0080),
    ],
    has_dense_tips: true,
};

const ROBOT: Shape = Shape {
    palm: (DVec2::new(0.0, 0.038), DVec2::new(0.036, 0.026)),
    fingers: [
        finger([0.038, 0.030], [0.104, 0.072], 0.0125),
        finger([0.038, 0.066], [0.058, 0.166], 0.0115),
        finger([0.013, 0.068], [0.019, 0.174], 0.0115),
        finger([-0.013, 0.068], [-0.019, 0.170], 0.0115),
        finger([-0.038, 0.066], [-0.058, 0.158], 0.0110),
    ],
    has_dense_tips: false,
};

/// What the fingers are called.
const NAMES: [&str; 5] = ["thumb", "index", "middle", "ring", "little"];

/// Some thousand taxels on a cupped palm and five curled fingers, one disk.
pub fn hand() -> Skin {
    let (points, triangles) = PERSON.relaxed_disk();
    Skin::from_mesh("hand", PERSON.lifted(&points, &triangles))
}

/// A robot's hand with longer and wider fingers and a short palm: a patch for the palm and for each finger, a gap apart,
/// some 900 taxels.
pub fn robot_hand() -> Skin {
    let (points, triangles) = ROBOT.relaxed_disk();
    let part_of = |p: DVec2| {
        let found = (0..5).map(|k| (k, along(&ROBOT.fingers[k], p)));
        let nearest = found.min_by(|(_, (_, a)), (_, (_, b))| a.total_cmp(b));
        match nearest {
            Some((k, (share, _))) if share > KNUCKLE + GAP => Some(k + 1),
            Some((_, (share, _))) if share > KNUCKLE - GAP => None,
            _ => Some(0),
        }
    };
    let mut skin = Skin::default();
    let link = skin.links.push(Link { name: "hand".into(), parent: None, pose: DAffine3::IDENTITY });
    for (number, name) in ["palm"].into_iter().chain(NAMES).enumerate() {
        let is_in = |t: &&[usize; 3]| t.iter().all(|&v| part_of(points[v]) == Some(number));
        let chosen: Vec<[usize; 3]> = triangles.iter().filter(is_in).copied().collect();
        let mut used: Vec<usize> = chosen.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        let own: Vec<DVec2> = used.iter().map(|&v| points[v]).collect();
        let at = |v: usize| used.binary_search(&v).expect("a used point");
        let renumbered: Vec<[usize; 3]> = chosen.iter().map(|t| t.map(at)).collect();
        let mut patch = Patch::from_mesh(name, link, ROBOT.lifted(&own, &renumbered));
        // Hubs number their taxels with room to grow.
        let hub = 1000 * u32::try_from(number).expect("six patches");
        patch.taxels.ids = patch.taxels.ids.map(|id| TaxelId(hub + id.0));
        skin.patches.push(patch);
    }
    skin
}

/// Landmarks of both hands: places by palm and finger, and for each the taxel of [`robot_hand`] and the one of [`hand`].
pub fn landmarks() -> Vec<[TaxelId; 2]> {
    /// Along a finger from its knuckle to its end, and across it, in shares of its length and its radius.
    const ON_FINGER: [[f64; 2]; 5] = [[0.12, -0.6], [0.12, 0.6], [0.55, -0.6], [0.55, 0.6], [0.97, 0.0]];
    /// On the palm, in shares of half its size.
    const ON_PALM: [[f64; 2]; 5] = [[-0.9, -1.1], [0.9, -1.1], [-0.9, 0.9], [0.9, 0.9], [0.0, 0.0]];
    let places = |shape: &Shape| -> Vec<DVec2> {
        let (middle, half) = shape.palm;
        let palm = ON_PALM.map(|share| middle + half * DVec2::from_array(share));
        let of_finger = |finger: &Finger| {
            let axis = finger.tip - finger.root;
            let across = finger.radius * axis.normalize().perp();
            ON_FINGER
                .map(|[share, side]| finger.root + (KNUCKLE + (1.0 - KNUCKLE) * share) * axis + side * across)
        };
        palm.into_iter().chain(shape.fingers.iter().flat_map(of_finger)).collect()
    };
    // Seen from above, where `lift` changes neither x nor y.
    let nearest = |skin: &Skin, at: DVec2| {
        let taxels = skin.patches.iter().flat_map(|patch| patch.mesh.positions.iter().zip(&patch.taxels.ids));
        let far = |p: &DVec3| p.truncate().distance_squared(at);
        let found = taxels.min_by(|(a, _), (b, _)| far(a).total_cmp(&far(b)));
        *found.expect("a skin has taxels").1
    };
    let [robot, person] = [robot_hand(), hand()];
    let pairs = places(&ROBOT).into_iter().zip(places(&PERSON));
    pairs.map(|(a, b)| [nearest(&robot, a), nearest(&person, b)]).collect()
}

/// Share of the way along a finger's axis nearest to `p`, and the distance from there, in m.
fn along(finger: &Finger, p: DVec2) -> (f64, f64) {
    let axis = finger.tip - finger.root;
    let share = ((p - finger.root).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    (share, p.distance(finger.root + share * axis))
}

/// Distance to the union of two shapes with the corner between them rounded (polynomial smooth
/// minimum, Quilez 2013).
fn rounded_union(a: f64, b: f64) -> f64 {
    /// About the width of the rounding, in m.
    const WIDTH: f64 = 0.004;
    let h = (WIDTH - (a - b).abs()).max(0.0) / WIDTH;
    a.min(b) - 0.25 * WIDTH * h * h
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

/// Every edge once, in order.
fn edges(triangles: &[[usize; 3]]) -> Vec<[usize; 2]> {
    let sides = |t: &[usize; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let mut edges: Vec<[usize; 2]> =
        triangles.iter().flat_map(sides).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

impl Shape {
    /// Points and triangles, lifted into space.
    fn lifted(&self, points: &[DVec2], triangles: &[[usize; 3]]) -> TriMesh {
        let triangles: Vec<[u32; 3]> =
            triangles.iter().map(|t| t.map(|v| u32::try_from(v).expect("some thousand points"))).collect();
        snapped(TriMesh::from_arrays(points.iter().map(|&p| self.lift(p)).collect(), &triangles))
    }

    /// Signed distance to the outline of the hand, in m, negative inside; rounded in the corners
    /// between the fingers.
    fn outline(&self, p: DVec2) -> f64 {
        let (middle, half) = self.palm;
        let beyond = (p - middle).abs() - half;
        let palm = beyond.max(DVec2::ZERO).length() + beyond.max_element().min(0.0) - ROUNDING;
        self.fingers.iter().map(|f| along(f, p).1 - f.radius).fold(palm, rounded_union)
    }

    /// Wanted spacing of the taxels at `p`, in m.
    fn spacing(&self, p: DVec2) -> f64 {
        if !self.has_dense_tips {
            return ROBOT_SPACING;
        }
        let fine = PALM_SPACING / DENSITY.sqrt();
        self.fingers
            .iter()
            .map(|f| {
                let (share, away) = along(f, p);
                let from_end = (1.0 - share) * f.root.distance(f.tip) + (away - f.radius).max(0.0);
                fine + ((from_end - TIP) / (FADED - TIP)).clamp(0.0, 1.0) * (PALM_SPACING - fine)
            })
            .fold(PALM_SPACING, f64::min)
    }

    /// Points within the outline at the wanted spacing and their triangles (Persson and Strang 2004):
    /// edges that are shorter than wanted push, and what is pushed out comes back to the outline.
    fn relaxed_disk(&self) -> (Vec<DVec2>, Vec<[usize; 3]>) {
        /// Edges push up to this much over their wanted length, so that points fill the outline.
        const PRESSURE: f64 = 1.2;
        /// Share of the force that moves a point in one step.
        const STEP_SIZE: f64 = 0.2;
        /// After so many steps the mesh no longer gets better.
        const STEPS: usize = 160;
        let mut points = self.scattered();
        let mut triangles = Vec::new();
        for step in 0..=STEPS {
            points.iter_mut().for_each(|p| *p = (*p / STEP).round() * STEP);
            triangles = self.inside(&points);
            if step == STEPS {
                break;
            }
            let edges = edges(&triangles);
            let wanted: Vec<f64> =
                edges.iter().map(|&[a, b]| self.spacing(points[a].midpoint(points[b]))).collect();
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
                *p = self.pulled_in(*p);
            }
        }
        (points, triangles)
    }

    /// A point outside the outline is brought back to it, along the steepest way.
    fn pulled_in(&self, mut p: DVec2) -> DVec2 {
        /// For the slope of the outline's distance, in m.
        const DELTA: f64 = 1e-6;
        // The distance is not exact where shapes are joined: three times comes close enough.
        for _ in 0..3 {
            let distance = self.outline(p);
            if distance <= 0.0 {
                break;
            }
            let slope = DVec2::new(
                self.outline(p + DELTA * DVec2::X) - distance,
                self.outline(p + DELTA * DVec2::Y) - distance,
            );
            p -= distance * slope.normalize_or_zero();
        }
        p
    }

    /// Points of a fine lattice, each kept with a probability that gives the wanted density.
    fn scattered(&self) -> Vec<DVec2> {
        let fine = PALM_SPACING / DENSITY.sqrt();
        let mut dice = Dice(0x2545_F491_4F6C_DD1D);
        let mut points = Vec::new();
        for j in 0..200_i32 {
            for i in -120..120_i32 {
                let x = f64::from(i) + 0.5 * f64::from(j % 2);
                let p = fine * DVec2::new(x, 0.75_f64.sqrt() * f64::from(j));
                let share = fine / self.spacing(p);
                if self.outline(p) < 0.0 && dice.roll() < share * share {
                    points.push(p);
                }
            }
        }
        points
    }

    /// The Delaunay triangles whose middle lies within the outline.
    fn inside(&self, points: &[DVec2]) -> Vec<[usize; 3]> {
        let mut triangles = triangulate(points);
        triangles.retain(|t| {
            let middle = t.iter().map(|&v| points[v]).sum::<DVec2>() / 3.0;
            // Slivers between points of the outline have their middle just within it.
            self.outline(middle) < -0.1 * self.spacing(middle)
        });
        triangles
    }

    /// Cups the palm and curls the fingers: the outside of the skin, with the hand behind it, looks up.
    fn lift(&self, p: DVec2) -> DVec3 {
        /// Depth of the cup at 0.1 m from the middle of the palm, in m.
        const CUP: f64 = 0.030;
        /// Curvature across a finger, in 1/m: half a turn around the thumb.
        const ACROSS: f64 = 110.0;
        let q = p - self.palm.0;
        let cup = CUP * q.length_squared() / 0.01;
        // How far across the finger nearest by, faded in from its root to its first half.
        let round = self
            .fingers
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
}
