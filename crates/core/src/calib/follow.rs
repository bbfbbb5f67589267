//! On-line calibration: observations come touch by touch, and after each the taxels are solved anew.
//!
//! A touch is judged before it enters: its innovation, the difference between its measurements and what the last
//! solution predicts, is compared with its covariance `A P A' + R`, where `P` is the joint covariance of the taxels that
//! it names. A full solve of 500 positions takes milliseconds, so no factor is kept from touch to touch.
//!
//! The positions model only. What does not fit is not rejected here: the loss of the options decides in each solve.

use std::collections::HashMap;

use glam::{DMat3, DVec3};

use crate::calib::{
    CalibError, CalibOptions, Calibration, ContactMeasurement, DisplacementMeasurement, Information, Model,
    Observations, Pose, Problem, calibrate_with, free_under, normal_equations,
};
use crate::id::{IdVec, VertexId};
use crate::least_squares::{InverseColumns, NormalEquations};
use crate::numeric::quantile;
use crate::run::Run;
use crate::skin::TaxelId;
use crate::sparse::{BlockSystem, Pattern};

/// Share of the touches that fit if the stated noise is right.
const FITTING_SHARE: f64 = 0.999;

/// How a touch differs from what was known before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Squared difference over its covariance.
    pub chi2: f64,
    /// Numbers that are compared.
    pub degrees_of_freedom: usize,
}

impl Innovation {
    /// Whether the stated noise explains it: of true touches one in a thousand is not explained.
    pub fn fits(&self) -> bool {
        self.chi2 <= quantile(FITTING_SHARE, self.degrees_of_freedom as f64)
    }
}

/// What a touch changed.
#[derive(Debug, Clone, PartialEq)]
pub struct FollowedTouch {
    /// Number of the touch, from 1.
    pub touch: usize,
    /// The taxels that it names, ascending.
    pub taxels: Vec<TaxelId>,
    /// How it differs from what was known; `None` if nothing it measures was known.
    pub innovation: Option<Innovation>,
    /// The solve that followed; `None` if it was left to a later touch.
    pub solved: Option<FollowedSolve>,
}

/// A solve after a touch.
#[derive(Debug, Clone, PartialEq)]
pub enum FollowedSolve {
    /// The taxels were solved.
    Solved {
        /// Largest motion of a taxel that was known before, in m.
        moved: f64,
        /// The least certain taxel and its standard deviation, in m, if covariances are computed.
        worst: Option<(TaxelId, f64)>,
    },
    /// The observations so far do not determine this taxel.
    Undetermined(TaxelId),
}

/// The touches so far.
#[derive(Debug, Clone)]
pub(super) struct TouchStream {
    /// A fit is due after this many.
    every: usize,
    pub(super) observations: Observations,
    vertices: HashMap<TaxelId, VertexId>,
    pub(super) count: usize,
}

impl TouchStream {
    pub(super) fn new(every: usize) -> Self {
        let observations = Observations::default();
        Self { every: every.max(1), observations, vertices: HashMap::new(), count: 0 }
    }

    /// Adds a touch, and solves if it is time.
    pub(super) fn add(
        &mut self,
        touch: &Observations,
        innovation: Option<Innovation>,
        solve: impl FnOnce(&Self) -> Result<FollowedSolve, CalibError>,
    ) -> Result<FollowedTouch, CalibError> {
        self.observations.append(touch, &mut self.vertices);
        self.count += 1;
        let mut taxels: Vec<TaxelId> = touch.taxels.iter().map(|taxel| taxel.id).collect();
        taxels.sort_unstable();
        let solved = self.count.is_multiple_of(self.every).then(|| solve(self)).transpose()?;
        Ok(FollowedTouch { touch: self.count, taxels, innovation, solved })
    }
}

impl FollowedSolve {
    /// From the positions of the taxels that were known before, those after, and standard deviations.
    pub(super) fn of(
        before: impl Iterator<Item = DVec3>,
        after: impl Iterator<Item = DVec3>,
        sigmas: impl Iterator<Item = (TaxelId, f64)>,
    ) -> Self {
        let moved = before.zip(after).map(|(a, b)| a.distance(b)).fold(0.0, f64::max);
        Self::Solved { moved, worst: sigmas.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))) }
    }
}

/// Solves a growing set of observations; see [`Calibration::follow`].
#[derive(Debug, Clone)]
pub struct Follower {
    options: CalibOptions,
    stream: TouchStream,
    /// The observations of the last solve, from where it put the taxels, and its result.
    solution: Option<(Observations, Calibration)>,
}

impl Calibration {
    /// Solves observations that come touch by touch, after every `every` touches.
    ///
    /// ```
    /// use dermatome::calib::{CalibOptions, Calibration, Displacement, Observations, SimulateOptions, simulate};
    /// use dermatome::{id::VertexId, run::Run};
    ///
    /// let all = simulate(&SimulateOptions { taxels: 20, ..SimulateOptions::default() })?.observations;
    /// let mut follower = Calibration::follow(&CalibOptions::default(), 1);
    /// for edge in &all.edges {
    ///     let taxels = vec![all.taxels[edge.from], all.taxels[edge.to]].into();
    ///     let (from, to) = (VertexId::new(0), VertexId::new(1));
    ///     let edges = vec![Displacement { from, to, ..edge.clone() }].into();
    ///     follower.push(&Observations { taxels, edges, ..Observations::default() }, Run::default())?;
    /// }
    /// let (_, found) = follower.finish(Run::default())?;
    /// assert_eq!(found.poses.len(), 20);
    /// # Ok::<(), dermatome::calib::CalibError>(())
    /// ```
    pub fn follow(options: &CalibOptions, every: usize) -> Follower {
        Follower { options: *options, stream: TouchStream::new(every), solution: None }
    }
}

impl Follower {
    /// Judges a touch, adds its observations, and solves if it is time. The taxels of `touch` may be new.
    ///
    /// # Errors
    /// If the touch breaks a rule ([`Observations::validate`]) or is not of the positions model, then it is not added; as
    /// [`calibrate`](crate::calib::calibrate()), but a taxel that is not determined yet is no error.
    pub fn push(&mut self, touch: &Observations, run: Run<'_>) -> Result<FollowedTouch, CalibError> {
        touch.validate()?;
        if touch.model != Model::Positions {
            return Err(CalibError::FollowedPoses);
        }
        let innovation = self.innovation(touch)?;
        let (options, last) = (&self.options, &mut self.solution);
        self.stream.add(touch, innovation, |stream| solve(&stream.observations, options, last, run))
    }

    /// The last solution.
    pub fn solution(&self) -> Option<&Calibration> {
        self.solution.as_ref().map(|(_, found)| found)
    }

    /// All observations, taxels by ascending id, and their batch calibration.
    ///
    /// # Errors
    /// As [`calibrate`](crate::calib::calibrate()).
    pub fn finish(&self, run: Run<'_>) -> Result<(Observations, Calibration), CalibError> {
        let all = &self.stream.observations;
        let mut order: Vec<VertexId> = all.taxels.ids().collect();
        order.sort_unstable_by_key(|&v| all.taxels[v].id);
        let mut sorted = Observations { model: all.model, ..Observations::default() };
        let mut vertices =
            order.iter().map(|&v| (all.taxels[v].id, sorted.taxels.push(all.taxels[v]))).collect();
        sorted.append(all, &mut vertices);
        let found = calibrate_with(&sorted, &self.options, run)?;
        Ok((sorted, found))
    }

    /// The innovation of what a touch measures of taxels that are known.
    fn innovation(&self, touch: &Observations) -> Result<Option<Innovation>, CalibError> {
        let Some((observations, last)) = &self.solution else { return Ok(None) };
        let weights = last.diagnostics.map(|d| d.weight);
        let problem = Problem::new(observations, self.options.residual)?;
        let free = free_under(&problem, &last.poses, &weights);
        // The free component of each taxel; `None` if its position is known.
        let mut component = last.poses.map(|_| None);
        for (number, body) in free.iter().enumerate() {
            body.component.taxels.iter().for_each(|&v| component[v] = Some(number));
        }
        let known = |v: VertexId| {
            let here = self.stream.vertices.get(&touch.taxels[v].id).copied();
            here.filter(|here| here.index() < component.len())
        };
        let terms = terms(touch, known, &component, &last.poses);
        if terms.is_empty() {
            return Ok(None);
        }
        let equations = normal_equations(&problem, &free, &last.poses, &weights);
        let joint = JointCovariance::of(&problem, &equations, &terms)?;
        joint.innovation(&terms).map(Some)
    }
}

/// Solves all observations from the last solution, which it replaces.
fn solve(
    observations: &Observations,
    options: &CalibOptions,
    last: &mut Option<(Observations, Calibration)>,
    run: Run<'_>,
) -> Result<FollowedSolve, CalibError> {
    let mut start = observations.clone();
    if let Some((_, last)) = last {
        // The gauge stays at the taxels that had it.
        for (taxel, pose) in start.taxels.iter_mut().zip(&last.poses).filter(|(taxel, _)| !taxel.fixed) {
            taxel.initial = Some(*pose);
        }
    }
    let found = match calibrate_with(&start, options, run) {
        Ok(found) => found,
        Err(CalibError::Undetermined { id }) => return Ok(FollowedSolve::Undetermined(id)),
        Err(other) => return Err(other),
    };
    let positions = |of: &Calibration| of.poses.iter().map(|pose| pose.position).collect::<Vec<_>>();
    let before = last.iter().flat_map(|(_, last)| positions(last));
    let sigmas = found.marginals.iter().flat_map(|m| m.positions.iter().map(|c| c.sigma()));
    let sigmas = found.ids.iter().copied().zip(sigmas);
    let solved = FollowedSolve::of(before, positions(&found).into_iter(), sigmas);
    *last = Some((start, found));
    Ok(solved)
}

/// What a touch measures of known taxels: the sum of signed positions, its difference from the last solution, and its noise.
struct Term {
    parts: Vec<(VertexId, f64)>,
    difference: DVec3,
    noise: DMat3,
}

fn terms(
    touch: &Observations,
    known: impl Fn(VertexId) -> Option<VertexId>,
    component: &IdVec<VertexId, Option<usize>>,
    poses: &IdVec<VertexId, Pose>,
) -> Vec<Term> {
    // Information that leaves a direction open is not compared.
    let noise =
        |information: &Information<3>| (information.rank() == 3).then(|| information.matrix().inverse());
    let of_edges = touch.edges.iter().filter_map(|edge| {
        let DisplacementMeasurement::Offset { offset, information } = &edge.measurement else { return None };
        let (from, to) = (known(edge.from)?, known(edge.to)?);
        let difference = *offset - (poses[to].position - poses[from].position);
        let is_known = component[from] == component[to];
        is_known.then_some(Term {
            parts: vec![(from, -1.0), (to, 1.0)],
            difference,
            noise: noise(information)?,
        })
    });
    let of_contacts = touch.contacts.iter().filter_map(|contact| {
        let (ContactMeasurement::Position { position, information }
        | ContactMeasurement::PositionNormal { position, information, .. }) = &contact.measurement
        else {
            return None;
        };
        let taxel = known(contact.taxel)?;
        let difference = *position - poses[taxel].position;
        component[taxel].is_none().then_some(Term {
            parts: vec![(taxel, 1.0)],
            difference,
            noise: noise(information)?,
        })
    });
    of_edges.chain(of_contacts).collect()
}

/// The covariances of a few taxels with each other.
struct JointCovariance<'p> {
    problem: &'p Problem<'p>,
    taxels: Vec<VertexId>,
    columns: InverseColumns,
}

impl<'p> JointCovariance<'p> {
    fn of(
        problem: &'p Problem<'p>,
        equations: &NormalEquations<'_>,
        terms: &[Term],
    ) -> Result<Self, CalibError> {
        let mut taxels: Vec<VertexId> =
            terms.iter().flat_map(|term| term.parts.iter().map(|part| part.0)).collect();
        taxels.sort_unstable();
        taxels.dedup();
        let factor = equations.matrix.factor().map_err(|e| problem.explain(e))?;
        let size = (problem.moving() * problem.layout.unknowns(), problem.layout.columns());
        let unknowns: Vec<_> =
            taxels.iter().flat_map(|&v| (0..3).map(move |axis| problem.unknown(v, axis))).collect();
        let columns = InverseColumns::of(&factor, size, &unknowns).map_err(CalibError::Sparse)?;
        Ok(Self { problem, taxels, columns })
    }

    /// The covariance of two taxels; zero if one of them is fixed.
    fn block(&self, a: VertexId, b: VertexId) -> DMat3 {
        let (Ok(k), Some(_)) = (self.taxels.binary_search(&b), self.problem.rows[b]) else {
            return DMat3::ZERO;
        };
        let entry = |i: usize, axis: usize| {
            self.problem.unknown(a, i).map_or(0.0, |unknown| self.columns.entry(unknown, 3 * k + axis))
        };
        DMat3::from_cols_array_2d(&std::array::from_fn(|axis| std::array::from_fn(|i| entry(i, axis))))
    }

    fn innovation(&self, terms: &[Term]) -> Result<Innovation, CalibError> {
        let count = terms.len();
        let pairs = (0..count).flat_map(|i| (0..i).map(move |j| (i, j)));
        let system = BlockSystem::new(Pattern::new(count, pairs), 3).map_err(CalibError::Sparse)?;
        let mut matrix = system.zero();
        for (i, one) in terms.iter().enumerate() {
            for (j, other) in terms[..=i].iter().enumerate() {
                let mut sum = if i == j { one.noise } else { DMat3::ZERO };
                for &(a, sign_a) in &one.parts {
                    other.parts.iter().for_each(|&(b, sign_b)| sum += self.block(a, b) * (sign_a * sign_b));
                }
                if let Some(slot) = system.slot(i, j) {
                    matrix.add(slot, |a, b| sum.col(b)[a]);
                }
            }
        }
        let differences: Vec<f64> = terms.iter().flat_map(|term| term.difference.to_array()).collect();
        let mut solved = differences.clone();
        let factor = matrix.factor().map_err(CalibError::Sparse)?;
        factor.solve(&mut solved, 1).map_err(CalibError::Sparse)?;
        let chi2 = solved.iter().zip(&differences).map(|(x, y)| x * y).sum();
        Ok(Innovation { chi2, degrees_of_freedom: 3 * count })
    }
}
