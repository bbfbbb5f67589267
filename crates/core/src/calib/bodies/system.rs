//! The normal equations of all bodies: blocks of six unknowns, one for each body that moves and one for the probe.

use glam::{DMat3, DVec3};

use super::options::{BodyLevel, BodyOptions};
use super::placement::{BodyId, Columns, Hierarchy, Placement, precision};
use super::touches::{Touch, TouchId, Touches};
use crate::calib::CalibError;
use crate::calib::pose::log;
use crate::id::IdVec;
use crate::least_squares::NormalEquations;
use crate::sparse::{BlockFactor, BlockSystem, Pattern, SparseError};

/// Unknowns of a block.
pub(super) const BLOCK: usize = 6;

/// The unknowns of a fit in blocks.
pub(super) struct BodySystem<'o> {
    pub(super) options: &'o BodyOptions,
    pub(super) hierarchy: &'o Hierarchy,
    pub(super) touches: &'o Touches,
    level: BodyLevel,
    /// Block row of each body that moves.
    rows: IdVec<BodyId, Option<usize>>,
    /// Block row of the probe's offset and the standoff.
    probe: Option<usize>,
    /// Standard deviations of the linear unknowns, and their block rows, six each.
    sigmas: Vec<f64>,
    linear: Vec<usize>,
    system: BlockSystem,
}

/// The weight of a touch, and the information of its error.
pub(super) type Weighted = (f64, DMat3);

impl<'o> BodySystem<'o> {
    pub(super) fn new(
        options: &'o BodyOptions,
        level: BodyLevel,
        hierarchy: &'o Hierarchy,
        touches: &'o Touches,
    ) -> Result<Self, CalibError> {
        let mut count = 0;
        let mut number = |moves: bool| {
            moves.then(|| {
                count += 1;
                count - 1
            })
        };
        let rows = hierarchy.levels.map(|of| number(*of <= level));
        let probe = number(options.probe.or(options.standoff).is_some());
        let sigmas = touches.linear(options);
        let linear: Vec<usize> = (0..sigmas.len().div_ceil(BLOCK)).filter_map(|_| number(true)).collect();
        let mut pairs = Vec::new();
        for chain in &hierarchy.chains {
            join(&mut pairs, chain.iter().filter_map(|&body| rows[body]).chain(probe).chain(linear.clone()));
        }
        for touch in touches.all.iter().filter(|touch| touch.taxels.len() > 1) {
            let bodies = touch.taxels.iter().flat_map(|&(v, _)| hierarchy.chain(v));
            join(&mut pairs, bodies.filter_map(|body| rows[body]));
        }
        let system = BlockSystem::new(Pattern::new(count, pairs), BLOCK).map_err(CalibError::Sparse)?;
        Ok(Self { options, hierarchy, touches, level, rows, probe, sigmas, linear, system })
    }

    pub(super) fn unknowns(&self) -> usize {
        BLOCK * self.system.blocks()
    }

    pub(super) fn row(&self, body: BodyId) -> Option<usize> {
        self.rows[body]
    }

    pub(super) fn probe_row(&self) -> Option<usize> {
        self.probe
    }

    pub(super) fn linear_rows(&self) -> &[usize] {
        &self.linear
    }

    /// The place of a linear unknown among all.
    fn unknown(&self, k: usize) -> usize {
        BLOCK * self.linear[k / BLOCK] + k % BLOCK
    }

    /// The Gauss-Newton matrix and the gradient at a placement.
    pub(super) fn linearise(
        &self,
        at: &Placement,
        weights: &IdVec<TouchId, Weighted>,
    ) -> NormalEquations<'_> {
        let (mut matrix, mut gradient) = (self.system.zero(), vec![0.0; self.unknowns()]);
        for (touch, &(weight, information)) in self.touches.all.iter().zip(weights) {
            let (error, blocks) = self.linearised(at, touch);
            let information = information * weight;
            let weighted_error = information * error;
            for (k, (row, columns)) in blocks.iter().enumerate() {
                let weighted = columns.map(|column| information * column);
                for (sum, column) in gradient[BLOCK * row..].iter_mut().zip(columns) {
                    *sum += column.dot(weighted_error);
                }
                for (below, others) in &blocks[k..] {
                    if let Some(slot) = self.system.slot(*below, *row) {
                        matrix.add(slot, |a, b| others[a].dot(weighted[b]));
                    }
                }
            }
        }
        for (row, precision, deviation) in self.priors(at) {
            if let Some(slot) = self.system.slot(row, row) {
                matrix.add(slot, |a, b| if a == b { precision[a] } else { 0.0 });
            }
            for (k, (p, d)) in precision.into_iter().zip(deviation).enumerate() {
                gradient[BLOCK * row + k] += p * d;
            }
        }
        NormalEquations { matrix, gradient, columns: 1 }
    }

    pub(super) fn factor<'m>(&self, equations: &NormalEquations<'m>) -> Result<BlockFactor<'m>, CalibError> {
        equations.matrix.factor().map_err(Self::explain)
    }

    /// Tolerances determine every motion, so that only rounding makes the matrix singular.
    pub(super) fn explain(error: SparseError) -> CalibError {
        match error {
            SparseError::NotPositiveDefinite { .. } => CalibError::UnlikeTolerances,
            other => CalibError::Sparse(other),
        }
    }

    /// The error of a touch and its derivatives, by ascending block rows.
    fn linearised(&self, at: &Placement, touch: &Touch) -> (DVec3, Vec<(usize, Columns)>) {
        let linear = at.linearised(self.hierarchy, touch, self.level);
        let rows = linear.bodies.iter().filter_map(|&(body, columns)| Some((self.rows[body]?, columns)));
        let mut blocks: Vec<_> =
            rows.chain(self.probe.map(|row| (row, self.of_probe(linear.probe)))).collect();
        let known = |k: &usize| *k < self.sigmas.len();
        let column = |k: usize| Some(k).filter(known).map_or(DVec3::ZERO, |k| touch.columns[k]);
        for (k, &row) in self.linear.iter().enumerate() {
            blocks.push((row, std::array::from_fn(|own| column(BLOCK * k + own))));
        }
        blocks.sort_unstable_by_key(|block| block.0);
        (linear.error, blocks)
    }

    /// The covariance `J C J'` of what a solution of covariance `C` predicts for a touch.
    pub(super) fn prediction(
        &self,
        factor: &BlockFactor<'_>,
        at: &Placement,
        touch: &Touch,
    ) -> Result<DMat3, CalibError> {
        let unknowns = self.unknowns();
        let mut rows = vec![0.0; 3 * unknowns];
        for (row, columns) in self.linearised(at, touch).1 {
            for (k, column) in columns.into_iter().enumerate() {
                (0..3).for_each(|axis| rows[axis * unknowns + BLOCK * row + k] += column[axis]);
            }
        }
        let mut solved = rows.clone();
        factor.solve(&mut solved, 3).map_err(CalibError::Sparse)?;
        let entry = |a: usize, b: usize| {
            let pairs = rows[a * unknowns..].iter().zip(&solved[b * unknowns..]).take(unknowns);
            pairs.map(|(x, y)| x * y).sum()
        };
        Ok(DMat3::from_cols_array_2d(&std::array::from_fn(|b| std::array::from_fn(|a| entry(a, b)))))
    }

    /// The standard deviation of a linear unknown by the scatter of the touches: each has errors of its own, whatever is stated.
    pub(super) fn scatter(
        &self,
        factor: &BlockFactor<'_>,
        at: &Placement,
        weights: &IdVec<TouchId, Weighted>,
        unknown: usize,
    ) -> Result<f64, CalibError> {
        let mut column = vec![0.0; self.unknowns()];
        column[self.unknown(unknown)] = 1.0;
        factor.solve(&mut column, 1).map_err(CalibError::Sparse)?;
        let mut squares = 0.0;
        for (touch, &(weight, information)) in self.touches.all.iter().zip(weights) {
            let (error, blocks) = self.linearised(at, touch);
            let of_block = |(row, columns): &(usize, Columns)| {
                columns.iter().zip(&column[BLOCK * row..]).map(|(column, x)| *column * *x).sum::<DVec3>()
            };
            let along: DVec3 = blocks.iter().map(of_block).sum();
            squares += (weight * along.dot(information * error)).powi(2);
        }
        Ok(squares.sqrt())
    }

    /// The columns of the unknowns that are fitted; zero for others.
    fn of_probe(&self, mut columns: Columns) -> Columns {
        if self.options.probe.is_none() {
            columns[..3].fill(DVec3::ZERO);
        }
        if self.options.standoff.is_none() {
            columns[3] = DVec3::ZERO;
        }
        columns
    }

    /// Block row, inverse variances and deviations of every prior. What is not fitted has any precision: it stays 0.
    fn priors(&self, at: &Placement) -> Vec<(usize, [f64; BLOCK], [f64; BLOCK])> {
        let of_body = |(body, row): (BodyId, &Option<usize>)| {
            let precision = precision(self.options, self.hierarchy.levels[body]);
            row.map(|row| (row, precision, deviation(at, body)))
        };
        let precision = |sigma: Option<f64>| sigma.map_or(1.0, |sigma| sigma.powi(-2));
        let (offset, standoff) = (precision(self.options.probe), precision(self.options.standoff));
        let (o, h) = (at.offset, at.standoff);
        let of_probe = self
            .probe
            .map(|row| (row, [offset, offset, offset, standoff, 1.0, 1.0], [o.x, o.y, o.z, h, 0.0, 0.0]));
        let of_linear = self.linear.iter().enumerate().map(|(k, &row)| {
            let own = |j: usize| (self.sigmas.get(BLOCK * k + j), at.linear.get(BLOCK * k + j));
            let block: [_; BLOCK] = std::array::from_fn(own);
            let precisions = block.map(|(sigma, _)| precision(sigma.copied()));
            (row, precisions, block.map(|(_, x)| x.copied().unwrap_or(0.0)))
        });
        self.rows.enumerate().filter_map(of_body).chain(of_probe).chain(of_linear).collect()
    }

    /// Twice the cost of the priors.
    pub(super) fn prior_chi2(&self, at: &Placement) -> f64 {
        let squares = |(_, precision, deviation): (usize, [f64; BLOCK], [f64; BLOCK])| {
            precision.into_iter().zip(deviation).map(|(p, d)| p * d * d).sum::<f64>()
        };
        self.priors(at).into_iter().map(squares).sum()
    }

    /// A placement moved by a step.
    pub(super) fn advanced(&self, at: &Placement, step: &[f64]) -> Placement {
        let mut next = at.clone();
        for (body, row) in self.rows.enumerate() {
            if let Some(row) = *row {
                next.advance(body, &step[BLOCK * row..]);
            }
        }
        if let Some(row) = self.probe {
            let step = &step[BLOCK * row..];
            next.offset += DVec3::from_slice(step);
            next.standoff += step[3];
        }
        next.linear.resize(self.sigmas.len(), 0.0);
        for (k, x) in next.linear.iter_mut().enumerate() {
            *x += step[self.unknown(k)];
        }
        next
    }
}

/// The six numbers of a motion: translation and rotation vector.
pub(super) fn deviation(at: &Placement, body: BodyId) -> [f64; BLOCK] {
    let (t, r) = (at.motions[body].translation, log(at.motions[body].rotation));
    [t.x, t.y, t.z, r.x, r.y, r.z]
}

/// Appends all pairs of some rows.
fn join(pairs: &mut Vec<(usize, usize)>, rows: impl Iterator<Item = usize>) {
    let mut rows: Vec<usize> = rows.collect();
    rows.sort_unstable();
    rows.dedup();
    for (k, &row) in rows.iter().enumerate() {
        pairs.extend(rows[k + 1..].iter().map(|&other| (row, other)));
    }
}
