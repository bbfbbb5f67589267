//! A link of both files, aligned: what differs between them.

use glam::DVec3;

use crate::calib::Pose;
use crate::diff::align::common_motion;
use crate::diff::pairs::{LinkPairs, Pair};
use crate::diff::spread::{Spread, neighbours, shared, spread, variance_of_shared};
use crate::diff::{Change, ChangeKind, DiffOptions, Subject};
use crate::numeric::chi_square_tail;

/// The standard deviation of differences is at least this, in m: many files round positions to 0.1 mm.
pub(super) const LEAST: f64 = 3e-5;

/// A reflection that leaves less than this share of what the best rotation leaves.
const REFLECTED: f64 = 0.25;

/// Differences that spread by at most this factor more than those beside the neighbours share nothing with these: they
/// are white noise. The estimate of the factor is good to a tenth for 50 taxels.
const WHITE: f64 = 1.15;

/// A link of both files.
pub(super) struct Comparison<'p> {
    pub(super) link: &'p LinkPairs,
    pub(super) name: &'p str,
    pub(super) options: &'p DiffOptions,
    /// Chance below which a test of a link or module shows a change.
    pub(super) chance: f64,
    /// The same of a taxel.
    pub(super) chance_of_taxel: f64,
    pub(super) motion: Pose,
    pub(super) is_mirrored: bool,
    /// Of the first file, moved as most of them did.
    pub(super) expected: Vec<DVec3>,
    pub(super) differences: Vec<DVec3>,
    /// Standard deviation of each difference as the files or the options state it, in m, or 1.
    pub(super) stated: Vec<f64>,
    is_stated: bool,
    pub(super) neighbours: Vec<Vec<usize>>,
    /// How much taxels differ from their neighbours, over what independent ones would.
    pub(super) local: Option<Spread>,
    /// How much they differ in all, over what is stated.
    pub(super) total: Option<Spread>,
}

/// A difference in standard deviations, and the chance of it.
#[derive(Clone, Copy)]
pub(super) struct Test {
    pub(super) sigmas: f64,
    pub(super) p: f64,
}

impl Test {
    pub(super) fn new(difference: DVec3, sigma: f64) -> Self {
        let chi2 = difference.length_squared() / (sigma * sigma);
        Self { sigmas: chi2.sqrt(), p: chi_square_tail(chi2, 3.0) }
    }
}

impl<'p> Comparison<'p> {
    /// `typical_sigma` stands for the sigma of taxels that have none, or 0.
    pub(super) fn new(
        (link, name): (&'p LinkPairs, &'p str),
        options: &'p DiffOptions,
        typical_sigma: Option<f64>,
        [chance, chance_of_taxel]: [f64; 2],
    ) -> Self {
        let ends = |pair: &Pair| (pair.before.position, pair.after.position);
        let pairs: Vec<(DVec3, DVec3)> = link.pairs.iter().map(ends).collect();
        let least = options.sigma.unwrap_or(LEAST);
        let (mut motion, left) = common_motion(&pairs, least);
        let reflected: Vec<_> = pairs.iter().map(|&(from, to)| (mirror(from), to)).collect();
        let (other, other_left) = common_motion(&reflected, least);
        let is_mirrored = left > 3.0 * least && other_left < REFLECTED * left;
        let moved = if is_mirrored { &reflected } else { &pairs };
        if is_mirrored {
            motion = other;
        }
        let expected: Vec<DVec3> = moved.iter().map(|&(from, _)| motion.apply(from)).collect();
        let differences = expected.iter().zip(&pairs).map(|(from, (_, to))| *to - *from).collect();
        let typical = typical_sigma.unwrap_or(1.0);
        let stated = |pair: &Pair| {
            let own = pair.sigma.filter(|&sigma| sigma > 0.0);
            options.sigma.or(own).unwrap_or(typical)
        };
        let neighbours = neighbours(&expected);
        let mut comparison = Self {
            link,
            name,
            options,
            chance,
            chance_of_taxel,
            motion,
            is_mirrored,
            expected,
            differences,
            stated: link.pairs.iter().map(stated).collect(),
            is_stated: options.sigma.or(typical_sigma).is_some(),
            neighbours,
            local: None,
            total: None,
        };
        comparison.local = spread(comparison.beside_all_neighbours());
        comparison.total = spread(comparison.differences_over_stated());
        comparison
    }

    /// The difference of each taxel from those of its neighbours, and its standard deviation if they are independent.
    pub(super) fn beside_all_neighbours(&self) -> impl Iterator<Item = (DVec3, f64)> {
        (0..self.expected.len()).map(|k| (self.beside_neighbours(k, |_| true), self.if_independent(k)))
    }

    /// The standard deviation of the difference of a taxel from independent neighbours.
    pub(super) fn if_independent(&self, k: usize) -> f64 {
        self.stated[k] * (1.0 + variance_of_shared(self.neighbours[k].len())).sqrt()
    }

    pub(super) fn differences_over_stated(&self) -> impl Iterator<Item = (DVec3, f64)> {
        self.differences.iter().copied().zip(self.stated.iter().copied())
    }

    /// Whether neighbours share no error: then all taxels of the link are as good to compare with as the neighbours.
    pub(super) fn is_white(&self) -> bool {
        self.total.zip(self.local).is_some_and(|(total, local)| total.sigma <= WHITE * local.sigma)
    }

    /// A place in the second file, moved back by the motion of the link.
    pub(super) fn back(&self, place: DVec3) -> DVec3 {
        let back = self.motion.inverse().apply(place);
        if self.is_mirrored { mirror(back) } else { back }
    }

    /// The standard deviation of a difference that is expected to be `stated`, times the factor by which such differences
    /// spread more, unless the options give it. Without a factor that of the files.
    pub(super) fn sigma(&self, stated: f64, factor: Option<f64>) -> f64 {
        if self.options.sigma.is_some() {
            return stated;
        }
        factor.or(self.is_stated.then_some(1.0)).map_or(LEAST, |factor| (factor * stated).max(LEAST))
    }

    /// Typical difference of a taxel from those around it, along an axis, in m.
    pub(super) fn noise(&self) -> f64 {
        let stated = self.stated.iter().sum::<f64>() / self.stated.len().max(1) as f64;
        self.sigma(stated, self.local.map(|local| local.sigma))
    }

    /// The difference of a taxel beyond that of the neighbours that count.
    pub(super) fn beside_neighbours(&self, k: usize, counts: impl Fn(usize) -> bool) -> DVec3 {
        let around = self.neighbours[k].iter().copied().filter(|&other| counts(other));
        let around: Vec<DVec3> = around.map(|other| self.differences[other]).collect();
        self.differences[k] - shared(around.iter().copied())
    }

    /// Whether the skin moved on its link as a whole: its error is that of one taxel, since taxels may share it. `frames`
    /// are those of the link in the world, if they differ.
    pub(super) fn of_link(&self, frames: Option<[Pose; 2]>) -> Option<Change> {
        let count = self.expected.len() as f64;
        let before = self.link.pairs.iter().map(|pair| pair.before.position);
        let centre = before.clone().sum::<DVec3>() / count;
        let stated = self.stated.iter().sum::<f64>() / count;
        let radius = (before.map(|x| x.distance_squared(centre)).sum::<f64>() / count).sqrt();
        let least = if self.is_stated { 1.0 } else { 0.0 };
        // Differences that neighbours share are those of a skin that changed its shape, not of its noise.
        let spread = if self.is_white() { self.total } else { self.local };
        let sigma = self.sigma(stated, spread.map(|spread| spread.enlarged().max(least)));
        let [from, to] = frames.unwrap_or_default();
        let shift = to.apply(self.motion.apply(centre)) - from.apply(centre);
        let turn = (to.rotation * self.motion.rotation * from.rotation.inverse()).to_scaled_axis();
        // Frames are exact.
        let sigma = if frames.is_some() && self.is_at_rest(centre, radius, sigma) { LEAST } else { sigma };
        let (shift_test, turn_test) = (Test::new(shift, sigma), Test::new(turn * radius, sigma));
        let is_moved = shift_test.p.min(turn_test.p) < self.chance;
        if !is_moved && !self.is_mirrored {
            return None;
        }
        let largest = if shift_test.sigmas > turn_test.sigmas { shift_test } else { turn_test };
        let kind = if self.is_mirrored { ChangeKind::Mirrored } else { ChangeKind::Frame };
        let distance = if self.is_mirrored { 0.0 } else { shift.length() };
        let angle = if self.is_mirrored { 0.0 } else { turn.length() };
        let all: Vec<usize> = (0..self.expected.len()).collect();
        Some(Change { distance, angle, ..self.change(kind, Subject::Link, self.name, &all, largest) })
    }

    /// Whether the skin did not move on its link.
    fn is_at_rest(&self, centre: DVec3, radius: f64, sigma: f64) -> bool {
        let shift = Test::new(self.motion.apply(centre) - centre, sigma);
        shift.p.min(Test::new(self.motion.rotation.to_scaled_axis() * radius, sigma).p) >= self.chance
    }

    pub(super) fn change(
        &self,
        kind: ChangeKind,
        subject: Subject,
        name: &str,
        pairs: &[usize],
        test: Test,
    ) -> Change {
        Change {
            kind,
            subject,
            name: name.to_owned(),
            other: None,
            link: self.name.to_owned(),
            patch: pairs.first().map_or(String::new(), |&k| self.link.pairs[k].before.patch.clone()),
            taxels: pairs.iter().map(|&k| self.link.pairs[k].before.id).collect(),
            others: Vec::new(),
            before: pairs.iter().map(|&k| self.link.pairs[k].before.position).collect(),
            after: pairs.iter().map(|&k| self.back(self.link.pairs[k].after.position)).collect(),
            distance: 0.0,
            angle: 0.0,
            sigmas: test.sigmas,
            p: test.p,
        }
    }
}

/// The mirror image of a point in the plane `x = 0`; a rigid motion takes it to any other mirror image.
pub(super) fn mirror(x: DVec3) -> DVec3 {
    DVec3::new(-x.x, x.y, x.z)
}
