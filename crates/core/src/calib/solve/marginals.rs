//! Marginal covariances of all taxels: blocks of the inverse by selected inversion `(takahashi1973)`,
//! transformed to the centroid gauge where a component is free (`(kanatani2001)`, `(triggs2000)`).
//!
//! First order: the covariance of the linearised problem at the solution, with the weights of the solution.
//! The uncertainty of the rejection of outliers is not included.

use glam::{DMat3, DVec3};

use crate::calib::pose::outer;
use crate::calib::solve::gauge::induced_motion;
use crate::calib::{
    BlockLayout, CalibError, FreeBody, Model, PerObservation, Pose, Poses, Problem, RigidMotion,
    normal_equations,
};
use crate::id::{IdVec, VertexId};
use crate::numeric::{Covariance, Twist, dot, symmetric_eigen};
use crate::sparse::BlockFactor;

/// Marginal covariances of all taxels.
///
/// If a component is free to move as a whole, the covariance is that in the centroid gauge: of the error
/// after the best rigid alignment (of positions) to the truth. In the positions model that alignment is a
/// translation only.
#[derive(Debug, Clone, PartialEq)]
pub struct Marginals {
    /// Covariance of positions, in m^2, in the common frame; zero for fixed taxels.
    pub positions: IdVec<VertexId, Covariance>,
    /// Covariance of rotation vectors, in rad^2, in the taxel's own frame; poses model only.
    pub rotations: Option<IdVec<VertexId, Covariance>>,
}

/// The covariance of the position of a taxel, and of its rotation, in its own frame.
type Block = [DMat3; 2];

/// Columns of six numbers, one for each free motion.
type TwistColumns = [Twist; 6];

/// Covariances at `poses`, for observations of the given weights.
pub(crate) fn marginals(
    problem: &Problem<'_>,
    free: &[FreeBody],
    poses: &Poses,
    weights: &PerObservation,
) -> Result<Marginals, CalibError> {
    let mut blocks: IdVec<VertexId, Block> = poses.map(|_| [DMat3::ZERO; 2]);
    if problem.moving() > 0 {
        let system = normal_equations(problem, free, poses, weights);
        let factor = system.matrix.factor().map_err(|e| problem.explain(e))?;
        let inverse = factor.selected_inverse();
        for (block, row) in blocks.iter_mut().zip(&problem.rows) {
            let Some(row) = row.map(|r| r as usize) else { continue };
            match problem.layout {
                BlockLayout::Scalar => block[0] = DMat3::IDENTITY * inverse.diagonal::<1>(row)[0][0],
                BlockLayout::Vector => {
                    block[0] = DMat3::from_cols_array_2d(&inverse.diagonal::<3>(row)).transpose();
                }
                BlockLayout::Pose => {
                    let rows = inverse.diagonal::<6>(row);
                    let part = |k: usize| {
                        let rows = std::array::from_fn(|a| std::array::from_fn(|b| rows[k + a][k + b]));
                        DMat3::from_cols_array_2d(&rows).transpose()
                    };
                    *block = [part(0), part(3)];
                }
            }
        }
        drop(inverse);
        to_centroid_gauge(problem, free, poses, &factor, &mut blocks)?;
    }
    let position = |(block, pose): (&Block, &Pose)| {
        let r = DMat3::from_quat(pose.rotation);
        Covariance::from(r * block[0] * r.transpose())
    };
    let has_rotations = problem.observations.model == Model::Poses;
    Ok(Marginals {
        positions: blocks.iter().zip(poses).map(position).collect(),
        rotations: has_rotations.then(|| blocks.map(|block| block[1].into())),
    })
}

/// The centroid gauge of one free component: excludes motions of its taxels that an alignment would undo.
///
/// With the free motions `G` and the conditions `A x = 0`, `A = (W G)'` with `W` selecting the coordinates
/// that are aligned, the projection is `P = 1 - G (A G)^-1 A`, and the covariance becomes `P C P'`.
struct CentroidGauge<'f> {
    body: &'f FreeBody,
    model: Model,
    pivot: DVec3,
    motions: Vec<RigidMotion>,
    /// The weight of rotations in `W`; that of positions is 1.
    weight: f64,
    /// `(A G)^-1`.
    inverse: [[f64; 6]; 6],
}

impl<'f> CentroidGauge<'f> {
    fn new(problem: &Problem<'_>, body: &'f FreeBody, poses: &Poses) -> Self {
        let (pivot, motions) = body.motions(problem, poses);
        let model = problem.observations.model;
        let inverse = [[0.0; 6]; 6];
        let at = |weight: f64| Self { body, model, pivot, motions: motions.clone(), weight, inverse };
        // Positions alone align a component, unless they leave a motion undetermined, as on a line: that one
        // is determined by rotations.
        let by_positions = at(0.0);
        let eigen = by_positions.overlap(poses);
        if aligned(&eigen.0).count() == motions.len() {
            return by_positions.with_inverse(&eigen);
        }
        let by_both = at(ROTATION_WEIGHT * body.length * body.length);
        let eigen = by_both.overlap(poses);
        by_both.with_inverse(&eigen)
    }

    /// A column of `G` for every free motion: the resulting motion of a taxel.
    fn motions_of(&self, at: &Pose) -> TwistColumns {
        let mut columns = [[DVec3::ZERO; 2]; 6];
        for (column, motion) in columns.iter_mut().zip(&self.motions) {
            *column = induced_motion(self.model, self.pivot, self.body.length, at, motion);
        }
        columns
    }

    /// `A'`.
    fn conditions(&self, at: &Pose) -> TwistColumns {
        self.motions_of(at).map(|[u, w]| [u, self.weight * w])
    }

    /// Eigenvalues and vectors of `A G = sum G' W G`.
    fn overlap(&self, poses: &Poses) -> ([f64; 6], [[f64; 6]; 6]) {
        let mut sum = [[0.0; 6]; 6];
        for &v in &self.body.component.taxels {
            let g = self.motions_of(&poses[v]);
            let g = &g[..self.motions.len()];
            for (row, x) in sum.iter_mut().zip(g) {
                for (s, y) in row.iter_mut().zip(g) {
                    *s += x[0].dot(y[0]) + self.weight * x[1].dot(y[1]);
                }
            }
        }
        symmetric_eigen(&sum)
    }

    fn with_inverse(mut self, (values, vectors): &([f64; 6], [[f64; 6]; 6])) -> Self {
        for k in aligned(values) {
            for (i, row) in self.inverse.iter_mut().enumerate() {
                for (j, x) in row.iter_mut().enumerate() {
                    *x += vectors[i][k] * vectors[j][k] / values[k];
                }
            }
        }
        self
    }

    /// Transforms the covariances `C` of the component's taxels into this gauge, given the columns `X =
    /// C A'`: for every taxel `C - B X' - X B' + B (A X) B'` with `B = G (A G)^-1`.
    fn project(
        &self,
        poses: &Poses,
        solution: impl Fn(VertexId) -> TwistColumns,
        blocks: &mut IdVec<VertexId, Block>,
    ) {
        let count = self.motions.len();
        let mut ax = [[0.0; 6]; 6];
        for &v in &self.body.component.taxels {
            let (a, x) = (self.conditions(&poses[v]), solution(v));
            for (row, a) in ax.iter_mut().zip(&a[..count]) {
                for (sum, x) in row.iter_mut().zip(&x[..count]) {
                    *sum += dot(*a, *x);
                }
            }
        }
        let parts = self.model.unknowns() / 3;
        for &v in &self.body.component.taxels {
            let (g, x) = (self.motions_of(&poses[v]), solution(v));
            let b = combined(count, &g, |l, k| self.inverse[l][k]);
            let b_ax = combined(count, &b, |l, k| ax[k][l]);
            for (part, block) in blocks[v][..parts].iter_mut().enumerate() {
                let product = |m: &TwistColumns, n: &TwistColumns| {
                    m[..count].iter().zip(n).fold(DMat3::ZERO, |sum, (m, n)| sum + outer(m[part], n[part]))
                };
                let bx = product(&b, &x);
                *block += product(&b_ax, &b) - bx - bx.transpose();
            }
        }
    }
}

/// An alignment undoes motions whose eigenvalue is above this share of the largest.
const MIN_ALIGNED: f64 = 1e-9;

/// Weight of rotations where positions leave a motion undetermined: too small to affect the other motions,
/// but large enough to exceed [`MIN_ALIGNED`].
const ROTATION_WEIGHT: f64 = 1e-5;

/// The eigenvalues of motions that the alignment undoes.
fn aligned(values: &[f64; 6]) -> impl Iterator<Item = usize> {
    let least = MIN_ALIGNED * values.iter().fold(0.0_f64, |m, &x| m.max(x));
    values.iter().enumerate().filter(move |(_, x)| **x > least).map(|(k, _)| k)
}

/// The first `count` columns of `M F`, for a matrix of as many columns.
fn combined(count: usize, m: &TwistColumns, factor: impl Fn(usize, usize) -> f64) -> TwistColumns {
    let mut product = [[DVec3::ZERO; 2]; 6];
    for (k, column) in product[..count].iter_mut().enumerate() {
        for (l, m) in m[..count].iter().enumerate() {
            column[0] += m[0] * factor(l, k);
            column[1] += m[1] * factor(l, k);
        }
    }
    product
}

/// Transforms the covariances of all free components from the gauge of their gauge taxels to the centroid
/// gauge.
///
/// Components are not connected, so one solve for each of at most six conditions serves all of them.
fn to_centroid_gauge(
    problem: &Problem<'_>,
    free: &[FreeBody],
    poses: &Poses,
    factor: &BlockFactor<'_>,
    blocks: &mut IdVec<VertexId, Block>,
) -> Result<(), CalibError> {
    let gauges: Vec<CentroidGauge<'_>> =
        free.iter().map(|body| CentroidGauge::new(problem, body, poses)).collect();
    let Some(columns) = gauges.iter().map(|g| g.motions.len()).max() else { return Ok(()) };
    let (layout, moving) = (problem.layout, problem.moving());
    let unknowns = moving * layout.unknowns();
    let mut solved = vec![0.0; columns * unknowns];
    for gauge in &gauges {
        for &v in &gauge.body.component.taxels {
            let Some(row) = problem.rows[v] else { continue };
            for (k, twist) in gauge.conditions(&poses[v]).iter().take(gauge.motions.len()).enumerate() {
                for a in 0..layout.unknowns() {
                    solved[k * unknowns + layout.index(moving, row, a)] = twist[a / 3][a % 3];
                }
            }
        }
    }
    factor.solve(&mut solved, columns * layout.columns()).map_err(CalibError::Sparse)?;
    for gauge in &gauges {
        let solution = |v: VertexId| {
            let mut x = [[DVec3::ZERO; 2]; 6];
            let Some(row) = problem.rows[v] else { return x };
            for (k, twist) in x[..gauge.motions.len()].iter_mut().enumerate() {
                for a in 0..layout.unknowns() {
                    twist[a / 3][a % 3] = solved[k * unknowns + layout.index(moving, row, a)];
                }
            }
            x
        };
        gauge.project(poses, solution, blocks);
    }
    Ok(())
}
