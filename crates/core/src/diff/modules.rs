//! Rigid modules: which moved relative to those around them, and how.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::f64::consts::FRAC_PI_6;

use glam::{DMat3, DVec3};

use crate::calib::{Pose, outer};
use crate::diff::align::common_motion;
use crate::diff::comparison::{Comparison, Test};
use crate::diff::pairs::Pair;
use crate::diff::spread::{Spread, shared, spread, uneven_spread};
use crate::diff::{AlignedLink, Change, ChangeKind, Subject};
use crate::numeric::{quantile, symmetric_eigen};

/// Modules are tested twice: those that moved are no neighbours to compare with.
const ROUNDS: usize = 2;

/// The pairs of each module, by its patch and name.
pub(super) fn members_of_modules(pairs: &[Pair]) -> BTreeMap<(&str, &str), Vec<usize>> {
    let mut modules: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (k, pair) in pairs.iter().enumerate() {
        if let Some(name) = &pair.before.module {
            modules.entry((&*pair.before.patch, &**name)).or_default().push(k);
        }
    }
    modules
}

/// A module, its motion relative to that of its neighbours, and whether that is more than noise.
pub(super) struct Module<'p> {
    pub(super) name: &'p str,
    pub(super) members: Vec<usize>,
    pub(super) centre: DVec3,
    pub(super) motion: Pose,
    pub(super) shift: DVec3,
    /// Root mean squares of how far its turn moves its taxels, for the part of the turn about each principal axis, in m.
    pub(super) turn: DVec3,
    /// Standard deviations of shift and turn, up to a common factor each.
    pub(super) expected: [f64; 2],
    pub(super) shift_test: Test,
    pub(super) turn_test: Test,
    pub(super) is_changed: bool,
}

impl<'p> Comparison<'p> {
    /// The modules, tested against those around them.
    pub(super) fn modules(&self) -> Vec<Module<'p>> {
        if self.is_independent() {
            return self.independent_modules();
        }
        let noise = self.noise();
        let named = members_of_modules(&self.link.pairs).into_iter();
        let mut modules: Vec<Module<'p>> =
            named.map(|((_, name), members)| self.module(name, members, noise)).collect();
        for _ in 0..ROUNDS {
            let is_changed = self.is_in_changed(&modules);
            for module in &mut modules {
                let members: HashSet<usize> = module.members.iter().copied().collect();
                let near = module.members.iter().flat_map(|&k| &self.neighbours[k]).copied();
                let counts = |k: &usize| !is_changed[*k] && !members.contains(k);
                let around: BTreeSet<usize> = near.filter(counts).collect();
                let background = shared(around.iter().map(|&k| self.differences[k]));
                module.shift = module.motion.apply(module.centre) - module.centre - background;
                // Of two means of independent numbers.
                let share = module.members.len() as f64 / around.len().max(1) as f64;
                module.expected[0] = module.expected[1] * (1.0 + share).sqrt();
            }
            let still = || modules.iter().filter(|module| !module.is_changed);
            let shifts = spread(still().map(|module| (module.shift, module.expected[0])));
            let turns = uneven_spread(still().map(|module| (module.turn, module.expected[1])));
            for module in &mut modules {
                let factor = |spread| self.factor(spread, module.members.len());
                module.shift_test = Test::new(module.shift, self.sigma(module.expected[0], factor(shifts)));
                module.turn_test = Test::new(module.turn, self.sigma(module.expected[1], factor(turns)));
                module.is_changed = module.shift_test.p.min(module.turn_test.p) < self.chance;
            }
        }
        modules
    }

    /// By what the differences of modules, of which this one has this many taxels, spread more than the means of independent
    /// numbers: as those of other modules; of fewer as one taxel, whose error all may share.
    fn factor(&self, spread: Option<Spread>, count: usize) -> Option<f64> {
        let of_one = || self.total.map(|total| total.enlarged() * (count as f64).sqrt());
        spread.map(Spread::enlarged).or_else(of_one)
    }

    pub(super) fn module(&self, name: &'p str, members: Vec<usize>, noise: f64) -> Module<'p> {
        let count = members.len() as f64;
        let pairs: Vec<(DVec3, DVec3)> =
            members.iter().map(|&k| (self.expected[k], self.link.pairs[k].after.position)).collect();
        let (motion, _) = common_motion(&pairs, noise);
        let centre = pairs.iter().map(|(from, _)| *from).sum::<DVec3>() / count;
        let stated = members.iter().map(|&k| self.stated[k]).sum::<f64>() / count;
        let (moments, axes) = self.moments(&members, centre);
        let turn = axes.transpose() * motion.rotation.to_scaled_axis();
        let across = DVec3::splat(moments.element_sum()) - moments;
        const NONE: Test = Test { sigmas: 0.0, p: 1.0 };
        Module {
            name,
            centre,
            motion,
            shift: motion.apply(centre) - centre,
            turn: turn * across.max(DVec3::ZERO).map(f64::sqrt),
            expected: [stated / count.sqrt(); 2],
            members,
            shift_test: NONE,
            turn_test: NONE,
            is_changed: false,
        }
    }

    /// Mean squares of the distances from the centre along each principal axis, and these axes.
    fn moments(&self, members: &[usize], centre: DVec3) -> (DVec3, DMat3) {
        let away = |&k: &usize| self.expected[k] - centre;
        let sum = members.iter().map(away).fold(DMat3::ZERO, |sum, x| sum + outer(x, x));
        let (values, vectors) = symmetric_eigen(&sum.to_cols_array_2d());
        let axes = DMat3::from_cols_array_2d(&vectors).transpose();
        (DVec3::from_array(values) / members.len() as f64, axes)
    }

    pub(super) fn of_modules(&self, modules: &[Module<'_>]) -> Vec<Change> {
        // The module at whose place each is now.
        let place = |module: &Module<'_>| {
            let now = module.motion.apply(module.centre);
            let distance = |other: &usize| modules[*other].centre.distance_squared(now);
            (0..modules.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
        };
        let places: Vec<usize> = modules.iter().map(place).collect();
        let mut changes = Vec::new();
        for (number, module) in modules.iter().enumerate().filter(|(_, module)| module.is_changed) {
            let now = places[number];
            let is_swapped = now != number && places[now] == number;
            if is_swapped && now < number {
                continue;
            }
            let is_moved = module.shift_test.p < self.chance;
            let kind = match () {
                () if is_swapped => ChangeKind::Swapped,
                () if self.is_flipped(module) => ChangeKind::Mirrored,
                () if is_moved => ChangeKind::Moved,
                () => ChangeKind::Turned,
            };
            let test = if module.shift_test.sigmas > module.turn_test.sigmas {
                module.shift_test
            } else {
                module.turn_test
            };
            changes.push(Change {
                other: (now != number).then(|| modules[now].name.to_owned()),
                distance: module.shift.length(),
                angle: module.motion.rotation.to_scaled_axis().length(),
                ..self.change(kind, Subject::Module, module.name, &module.members, test)
            });
        }
        changes
    }

    /// Whether a flat module lies on its face: no repair does that, so its ids run the other way round.
    fn is_flipped(&self, module: &Module<'_>) -> bool {
        let (moments, axes) = self.moments(&module.members, module.centre);
        let least = moments.min_position();
        let normal = axes.col(least);
        let is_flat = module.members.len() > 3 && moments[least] < 0.01 * moments.element_sum();
        is_flat && normal.dot(module.motion.rotation * normal) < -FRAC_PI_6.cos()
    }

    /// Whether each taxel is in a changed module.
    pub(super) fn is_in_changed(&self, modules: &[Module<'_>]) -> Vec<bool> {
        let mut is_changed = vec![false; self.expected.len()];
        let members = modules.iter().filter(|module| module.is_changed).flat_map(|module| &module.members);
        members.for_each(|&k| is_changed[k] = true);
        is_changed
    }

    pub(super) fn aligned(&self, modules: &[Module<'_>]) -> AlignedLink {
        let is_changed = self.is_in_changed(modules);
        let limit = quantile(0.999, 3.0).sqrt();
        let factor = self.total.map(Spread::enlarged);
        let is_unchanged = |&k: &usize| {
            !is_changed[k] && self.differences[k].length() < limit * self.sigma(self.stated[k], factor)
        };
        AlignedLink {
            name: self.name.to_owned(),
            taxels: self.expected.len(),
            motion: self.motion,
            unchanged: (0..self.expected.len()).filter(is_unchanged).count(),
        }
    }
}
