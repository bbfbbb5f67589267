//! Modules that are not where the drawing has them: two whose cables were exchanged, so that each fits best in the
//! place of the other, and those mounted turned by a third of a turn.
//!
//! Each hypothesis places the taxels of one module elsewhere, fits a small motion of it within the tolerances of
//! patch and module, and is compared by twice its cost, of which a touch has a bounded part: under another loss one touch with
//! wrong ids, 50 mm away, costs much less where a turned module is 10 mm nearer to it. Only touches of one module are used.
//! *Heuristic*: the bounds are not derived; tests with and without such modules check them.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec3};

use super::cad::{CadSkin, ModuleId};
use super::options::{BodyLevel, BodyOptions, Misassembly};
use super::placement::{Hierarchy, Placement};
use super::solve::{Solved, solve};
use super::start::start;
use super::touches::Touches;
use crate::calib::CalibError;
use crate::calib::pose::{exp, hat, log};
use crate::id::{IdVec, VertexId};
use crate::least_squares::LossFunction;
use crate::numeric::{solve_system, symmetric_eigen};
use crate::run::Run;

/// How much lower the cost of a hypothesis must be: odds of 1 to e^12.
const LEAST_GAIN: f64 = 25.0;

/// Contacts of a module below which nothing is concluded.
const LEAST_CONTACTS: f64 = 4.0;

/// Steps of the fit of one hypothesis.
const STEPS: usize = 6;

/// A module that is turned about its outward normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnedModule {
    /// The module.
    pub module: ModuleId,
    /// By 120 or -120 degrees, anticlockwise seen from outside.
    pub degrees: f64,
}

/// What looks wrong with the assembly of the skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Misassembled {
    /// Pairs of modules that fit best in each other's place, ascending.
    pub exchanged: Vec<[ModuleId; 2]>,
    /// Modules that fit best turned, ascending.
    pub turned: Vec<TurnedModule>,
}

/// The drawing with modules where they look to be.
pub(super) struct Assembled {
    pub(super) hierarchy: Hierarchy,
    pub(super) misassembled: Misassembled,
    /// The fit of the mount.
    pub(super) mounted: Placement,
}

impl Assembled {
    pub(super) fn new(
        options: &BodyOptions,
        cad: &CadSkin,
        touches: &Touches,
        run: Run<'_>,
    ) -> Result<Self, CalibError> {
        let drawn = Hierarchy::new(cad, touches);
        let from = start(options, &drawn, touches, run)?;
        let mounted = solve(options, BodyLevel::Mount, &drawn, touches, from, run)?;
        let mut hierarchy = drawn.clone();
        let misassembled = correct(options, &cad.slots(), &mounted, touches, &mut hierarchy);
        match options.misassembly {
            Misassembly::Corrected => Ok(Self { hierarchy, misassembled, mounted: mounted.placement }),
            Misassembly::Reported => Ok(Self { hierarchy: drawn, misassembled, mounted: mounted.placement }),
        }
    }
}

/// A touch of one module, in the frame of the drawing.
struct OwnTouch {
    position: DVec3,
    /// Slot and weight of its taxels.
    slots: Vec<(usize, f64)>,
    weight: f64,
    /// Inverse variance per axis.
    precision: f64,
}

impl OwnTouch {
    /// The mean of its taxels at the positions of the slots.
    fn mean(&self, places: &[DVec3]) -> DVec3 {
        self.slots.iter().map(|&(slot, weight)| weight * places[slot]).sum()
    }
}

/// Finds modules that are exchanged or turned, from a fit of the mount alone, and moves the taxels of the hierarchy to
/// where they are then.
fn correct(
    options: &BodyOptions,
    slots: &IdVec<ModuleId, Vec<VertexId>>,
    mounted: &Solved,
    touches: &Touches,
    hierarchy: &mut Hierarchy,
) -> Misassembled {
    let own = own_touches(slots, mounted, touches, hierarchy);
    let places = slots.map(|list| list.iter().map(|&v| hierarchy.positions[v]).collect::<Vec<_>>());
    let exchanged = exchanged(options, &own, &places);
    let drawn = hierarchy.clone();
    for &[a, b] in &exchanged {
        // Each is on the patch of the other, too.
        let patches = [a, b].map(|module| drawn.chains[module][1]);
        (hierarchy.chains[a][1], hierarchy.chains[b][1]) = (patches[1], patches[0]);
        for (&v, &w) in slots[a].iter().zip(&slots[b]) {
            (hierarchy.positions[v], hierarchy.normals[v]) = (drawn.positions[w], drawn.normals[w]);
            (hierarchy.positions[w], hierarchy.normals[w]) = (drawn.positions[v], drawn.normals[v]);
        }
    }
    let mut turned = Vec::new();
    for (module, list) in slots.enumerate() {
        let places: Vec<DVec3> = list.iter().map(|&v| hierarchy.positions[v]).collect();
        let normal = outward(list, hierarchy, &places);
        let Some(degrees) = normal.and_then(|normal| turn(options, &own[module], &places, normal)) else {
            continue;
        };
        turned.push(TurnedModule { module, degrees });
        let (centre, turn) = (mean(&places), normal.map(|n| DQuat::from_axis_angle(n, degrees.to_radians())));
        for (&v, place) in list.iter().zip(&places) {
            let turn = turn.unwrap_or_default();
            hierarchy.positions[v] = centre + turn * (*place - centre);
            hierarchy.normals[v] = turn * hierarchy.normals[v];
        }
    }
    hierarchy.find_centres();
    Misassembled { exchanged, turned }
}

/// The touches of every module that no other feels, moved back to the drawing.
fn own_touches(
    slots: &IdVec<ModuleId, Vec<VertexId>>,
    mounted: &Solved,
    touches: &Touches,
    hierarchy: &Hierarchy,
) -> IdVec<ModuleId, Vec<OwnTouch>> {
    let mut own = slots.map(|_| Vec::new());
    let at = &mounted.placement;
    for (touch, &(_, information)) in touches.all.iter().zip(&mounted.weights) {
        let module = hierarchy.module_of(touch.taxels[0].0);
        if touch.taxels.iter().any(|&(v, _)| hierarchy.module_of(v) != module) {
            continue;
        }
        let mount = hierarchy.chains[module][0];
        let (motion, centre) = (at.motions[mount], hierarchy.centres[mount]);
        let normal: DVec3 = touch.taxels.iter().map(|&(v, w)| w * hierarchy.normals[v]).sum();
        let seen = touch.position + touch.probe * at.offset - centre - motion.translation;
        let position = centre + motion.rotation.conjugate() * seen - (at.standoff + touch.lift) * normal;
        let slot = |v: VertexId| slots[module].iter().position(|&other| other == v);
        let slots = touch.taxels.iter().filter_map(|&(v, w)| Some((slot(v)?, w))).collect();
        let precision = (information.x_axis.x + information.y_axis.y + information.z_axis.z) / 3.0;
        own[module].push(OwnTouch { position, slots, weight: touch.weight, precision });
    }
    own
}

/// Pairs of modules, each of which fits best in the place of the other.
fn exchanged(
    options: &BodyOptions,
    own: &IdVec<ModuleId, Vec<OwnTouch>>,
    places: &IdVec<ModuleId, Vec<DVec3>>,
) -> Vec<[ModuleId; 2]> {
    // Not squared: wrong touches are far from every place.
    let distance = |touches: &[OwnTouch], places: &[DVec3]| {
        touches.iter().map(|t| t.weight * t.position.distance(t.mean(places))).sum::<f64>()
    };
    // The place with the nearest slots, among those with as many.
    let nearest = own.enumerate().map(|(module, touches)| {
        let count: f64 = touches.iter().map(|t| t.weight).sum();
        let others = places.enumerate().filter(|(_, slots)| slots.len() == places[module].len());
        let scored = others.map(|(place, slots)| (distance(touches, slots), place));
        let best = scored.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        best.filter(|_| count >= LEAST_CONTACTS).map_or(module, |(_, place)| place)
    });
    let nearest: IdVec<ModuleId, ModuleId> = nearest.collect();
    let gain =
        |a: ModuleId, b: ModuleId| cost(options, &own[a], &places[a]) - cost(options, &own[a], &places[b]);
    let mutual = nearest.enumerate().filter(|(a, b)| a < b && nearest[**b] == *a);
    let pairs = mutual.map(|(a, &b)| [a, b]);
    pairs.filter(|&[a, b]| gain(a, b) > LEAST_GAIN && gain(b, a) > LEAST_GAIN).collect()
}

/// By how many degrees a module is turned, if it is.
fn turn(options: &BodyOptions, touches: &[OwnTouch], places: &[DVec3], normal: DVec3) -> Option<f64> {
    let count: f64 = touches.iter().map(|t| t.weight).sum();
    if count < LEAST_CONTACTS || places.len() < 3 {
        return None;
    }
    let centre = mean(places);
    let of = |thirds: f64| {
        let turn = DQuat::from_axis_angle(normal, thirds * TAU / 3.0);
        let turned: Vec<DVec3> = places.iter().map(|&p| centre + turn * (p - centre)).collect();
        cost(options, touches, &turned)
    };
    let [drawn, left, right] = [0.0, 1.0, -1.0].map(of);
    let (best, degrees) = if left <= right { (left, 120.0) } else { (right, -120.0) };
    (drawn - best > LEAST_GAIN).then_some(degrees)
}

/// The outward normal of a module: of its taxels, else that of the plane through them.
fn outward(list: &[VertexId], hierarchy: &Hierarchy, places: &[DVec3]) -> Option<DVec3> {
    let known: DVec3 = list.iter().map(|&v| hierarchy.normals[v]).sum();
    known.try_normalize().or_else(|| {
        let centre = mean(places);
        let mut scatter = [[0.0; 3]; 3];
        for place in places {
            let arm = (*place - centre).to_array();
            for (i, row) in scatter.iter_mut().enumerate() {
                row.iter_mut().zip(arm).for_each(|(sum, x)| *sum += arm[i] * x);
            }
        }
        let (values, vectors) = symmetric_eigen(&scatter);
        let least = (0..3).min_by(|&a, &b| values[a].total_cmp(&values[b]))?;
        DVec3::from_array(vectors.map(|row| row[least])).try_normalize()
    })
}

fn mean(places: &[DVec3]) -> DVec3 {
    places.iter().sum::<DVec3>() / places.len() as f64
}

/// Twice the truncated cost of the best small motion of a module whose slots are at `places`, by Huber's loss.
fn cost(options: &BodyOptions, touches: &[OwnTouch], places: &[DVec3]) -> f64 {
    let centre = mean(places);
    let [patch, module] = [BodyLevel::Patch, BodyLevel::Module].map(|level| options.tolerance(level));
    let prior = [
        (patch.translation.powi(2) + module.translation.powi(2)).recip(),
        (patch.rotation.powi(2) + module.rotation.powi(2)).recip(),
    ];
    let (huber, truncated) = (LossFunction::huber(3), LossFunction::truncated(3));
    let (mut shift, mut rotation) = (DVec3::ZERO, DQuat::IDENTITY);
    for _ in 0..STEPS {
        let turn = log(rotation);
        // The right side is the last column.
        let mut system = [[0.0; 7]; 6];
        for (k, line) in system.iter_mut().enumerate() {
            line[k] = prior[k / 3];
            line[6] = if k < 3 { prior[0] * shift[k] } else { prior[1] * turn[k - 3] };
        }
        for touch in touches {
            let arm = rotation * (touch.mean(places) - centre);
            let error = touch.position - (centre + shift + arm);
            let weight =
                touch.weight * touch.precision * huber.weight(touch.precision * error.length_squared());
            let (t, r) = (DMat3::IDENTITY * -1.0, hat(arm));
            let columns = [t.x_axis, t.y_axis, t.z_axis, r.x_axis, r.y_axis, r.z_axis];
            for (line, one) in system.iter_mut().zip(columns) {
                line[6] += weight * one.dot(error);
                line.iter_mut().zip(columns).for_each(|(sum, other)| *sum += weight * one.dot(other));
            }
        }
        let Some(step) = solve_system(system) else { break };
        shift -= DVec3::from_slice(&step);
        rotation = (exp(-DVec3::from_slice(&step[3..])) * rotation).normalize();
    }
    let errors = touches.iter().map(|touch| {
        let error = touch.position - (centre + shift + rotation * (touch.mean(places) - centre));
        touch.weight * truncated.cost(touch.precision * error.length_squared())
    });
    errors.sum::<f64>() + prior[0] * shift.length_squared() + prior[1] * log(rotation).length_squared()
}
