//! A link of both files, aligned: what differs between them.

use glam::DVec3;

use crate::calib::Pose;
use crate::diff::align::common_motion;
use crate::diff::pairs::{LinkPairs, Pair};
use crate::diff::spread::{neighbours, shared, spread};
use crate::diff::{Change, ChangeKind, DiffOptions, Subject};
use crate::numeric::chi_square_tail;

/// The standard deviation of differences is at least this, in m: many files round positions to 0.1 mm.
pub(super) const LEAST: f64 = 3e-5;

/// A reflection that leaves less than this share of what the best rotation leaves.
const REFLECTED: f64 = 0.25;

/// A link of both files.
pub(super) struct Comparison<'p> {
    pub(super) link: &'p LinkPairs,
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
    /// Standard deviation of each difference as the files state it, or 1.
    pub(super) stated: Vec<f64>,
    pub(super) neighbours: Vec<Vec<usize>>,
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
    pub(super) fn new(
        link: &'p LinkPairs,
        options: &'p DiffOptions,
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
        let stated = link.pairs.iter().map(|pair| pair.sigma().unwrap_or(1.0)).collect();
        let neighbours = neighbours(&expected);
        Self {
            link,
            options,
            chance,
            chance_of_taxel,
            motion,
            is_mirrored,
            expected,
            differences,
            stated,
            neighbours,
        }
    }

    /// A place in the second file, moved back by the motion of the link.
    pub(super) fn back(&self, place: DVec3) -> DVec3 {
        let back = self.motion.inverse().apply(place);
        if self.is_mirrored { mirror(back) } else { back }
    }

    /// The standard deviation of a difference that is expected to be `stated`, if the differences that are given spread
    /// as they do.
    pub(super) fn sigma(&self, stated: f64, spread: Option<f64>) -> f64 {
        let known = || (self.link.pairs.iter().any(|pair| pair.sigma().is_some())).then_some(1.0);
        let estimated = || spread.or_else(known).map_or(LEAST, |factor| (factor * stated).max(LEAST));
        self.options.sigma.unwrap_or_else(estimated)
    }

    /// Typical difference of a taxel from those around it, along an axis, in m.
    pub(super) fn noise(&self) -> f64 {
        self.options.sigma.unwrap_or_else(|| {
            let left = (0..self.expected.len()).map(|k| (self.beside_neighbours(k, |_| true), 1.0));
            spread(left).unwrap_or(0.0).max(LEAST)
        })
    }

    /// The difference of a taxel beyond that of the neighbours that count.
    pub(super) fn beside_neighbours(&self, k: usize, counts: impl Fn(usize) -> bool) -> DVec3 {
        let around = self.neighbours[k].iter().copied().filter(|&other| counts(other));
        let around: Vec<DVec3> = around.map(|other| self.differences[other]).collect();
        self.differences[k] - shared(around.iter().copied())
    }

    /// Whether the link moved as a whole: its error is that of one taxel, since taxels share it.
    pub(super) fn of_link(&self) -> Option<Change> {
        let count = self.expected.len() as f64;
        let before = self.link.pairs.iter().map(|pair| pair.before.position);
        let centre = before.clone().sum::<DVec3>() / count;
        let stated = self.stated.iter().sum::<f64>() / count;
        let radius = (before.map(|x| x.distance_squared(centre)).sum::<f64>() / count).sqrt();
        let sigma = self.sigma(stated, None);
        let shift = Test::new(self.motion.apply(centre) - centre, sigma);
        let turn = self.motion.rotation.to_scaled_axis();
        let turn_test = Test::new(turn * radius, sigma);
        let is_moved = shift.p.min(turn_test.p) < self.chance;
        if !is_moved && !self.is_mirrored {
            return None;
        }
        let largest = if shift.sigmas > turn_test.sigmas { shift } else { turn_test };
        let kind = if self.is_mirrored { ChangeKind::Mirrored } else { ChangeKind::Frame };
        let distance = if self.is_mirrored { 0.0 } else { (self.motion.apply(centre) - centre).length() };
        let angle = if self.is_mirrored { 0.0 } else { turn.length() };
        let all: Vec<usize> = (0..self.expected.len()).collect();
        Some(Change { distance, angle, ..self.change(kind, Subject::Link, &self.link.name, &all, largest) })
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
            link: self.link.name.clone(),
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
