//! Marginal covariances of all taxels: blocks of the inverse by selected inversion
//! (takahashi1973), taken to the centroid gauge where a component is free (kanatani2001),
//! (triggs2000).
//!
//! First order: the covariance of the linearised problem at the solution, for the weights it was
//! found with. That noise was rejected as an outlier, or not, is not part of it.

use glam::{DMat3, DVec3};

use crate::{
    calib::{
        CalibError, Model, Pose,
        observations::graph::{PerObservation, Poses},
        solve::{
            gauge::{FreeBody, RigidMotion, induced_motion},
            layout::BlockLayout,
            linear_system::LinearSystem,
            normal_equations::Problem,
        },
    },
    id::{IdVec, VertexId},
    numeric::{Covariance, Matrix6, Twist, dot, symmetric_eigen},
    sparse::BlockFactor,
};

/// How uncertain every taxel is: marginal covariances, all at once.
///
/// Where a component is free to move as a whole, the covariance is that in the centroid gauge: of
/// what is left after the best rigid alignment (of positions) to the truth. In the positions model
/// that alignment is a translation only.
#[derive(Debug, Clone, PartialEq)]
pub struct Marginals {
    /// Covariance of positions, in m^2, in the common frame; zero for fixed taxels.
    pub positions: IdVec<VertexId, Covariance>,
    /// Covariance of rotation vectors, in rad^2, in the taxel's own frame; poses model only.
    pub rotations: Option<IdVec<VertexId, Covariance>>,
}

impl Marginals {
    /// Square root of the trace of the position covariance of every taxel, in m.
    #[must_use]
    pub fn position_rms(&self) -> IdVec<VertexId, f64> {
        self.positions.map(|c| c.sigma())
    }
}

/// Covariances at `poses`, for observations of the given weights.
pub(crate) fn marginals(
    problem: &Problem<'_>,
    free: &[FreeBody],
    poses: &Poses,
    weights: &PerObservation,
) -> Result<Marginals, CalibError> {
    let mut blocks: IdVec<VertexId, Matrix6> = poses.map(|_| Matrix6::ZERO);
    if problem.moving() == 0 {
        return Ok(in_common_frame(problem, poses, &blocks));
    }
    let system = LinearSystem::new(problem, free, poses, weights);
    let factor = system.matrix.factor().map_err(|e| problem.explain(e))?;
    let inverse = factor.selected_inverse();
    for (block, row) in blocks.iter_mut().zip(&problem.rows) {
        let Some(row) = row.map(|r| r as usize) else { continue };
        *block = match problem.layout {
            BlockLayout::Scalar => {
                let variance = inverse.diagonal::<1>(row)[0][0];
                of_positions(DMat3::from_diagonal(DVec3::splat(variance)))
            }
            BlockLayout::Vector => {
                let [x, y, z] = inverse.diagonal::<3>(row);
                of_positions(DMat3::from_cols_array_2d(&[x, y, z]).transpose())
            }
            BlockLayout::Pose => Matrix6::from_rows(&inverse.diagonal::<6>(row)),
        };
    }
    drop(inverse);
    to_centroid_gauge(problem, free, poses, &factor, &mut blocks)?;
    Ok(in_common_frame(problem, poses, &blocks))
}

fn of_positions(covariance: DMat3) -> Matrix6 {
    Matrix6([[covariance, DMat3::ZERO], [DMat3::ZERO, DMat3::ZERO]])
}

/// The centroid gauge of one free component: no motion of its taxels that an alignment would undo.
///
/// With the free motions `G` and the conditions `A x = 0`, `A = (W G)'` with `W` picking what the
/// alignment looks at, the projection is `P = 1 - G (A G)^-1 A`, and the covariance becomes `P C
/// P'`.
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
        let at = |weight: f64| Self {
            body,
            model,
            pivot,
            motions: motions.clone(),
            weight,
            inverse: [[0.0; 6]; 6],
        };
        // Positions alone align a component, unless they leave a motion open, as on a line: that
        // one follows rotations.
        let by_positions = at(0.0);
        let eigen = by_positions.overlap(poses);
        if aligned(&eigen.0).count() == motions.len() {
            return by_positions.with_inverse(&eigen);
        }
        let by_both = at(SLIGHT * body.length * body.length);
        let eigen = by_both.overlap(poses);
        by_both.with_inverse(&eigen)
    }

    /// A column of `G` for every free motion: how it moves a taxel.
    fn motions_of(&self, at: &Pose) -> Vec<Twist> {
        let induced = |m| induced_motion(self.model, self.pivot, self.body.length, at, m);
        self.motions.iter().map(induced).collect()
    }

    /// `A'`.
    fn conditions(&self, at: &Pose) -> Vec<Twist> {
        self.motions_of(at).into_iter().map(|[u, w]| [u, self.weight * w]).collect()
    }

    /// Eigenvalues and vectors of `A G = sum G' W G`.
    fn overlap(&self, poses: &Poses) -> ([f64; 6], [[f64; 6]; 6]) {
        let mut sum = [[0.0; 6]; 6];
        for &v in &self.body.component.taxels {
            let g = self.motions_of(&poses[v]);
            for (row, x) in sum.iter_mut().zip(&g) {
                for (s, y) in row.iter_mut().zip(&g) {
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

    /// Takes the covariances `C` of the component's taxels into this gauge, given the columns `X =
    /// C A'`: for every taxel `C - B X' - X B' + B (A X) B'` with `B = G (A G)^-1`.
    fn project(
        &self,
        poses: &Poses,
        solution: impl Fn(VertexId) -> Vec<Twist>,
        blocks: &mut IdVec<VertexId, Matrix6>,
    ) {
        let mut ax = [[0.0; 6]; 6];
        for &v in &self.body.component.taxels {
            let x = solution(v);
            for (row, a) in ax.iter_mut().zip(self.conditions(&poses[v])) {
                for (sum, &x) in row.iter_mut().zip(&x) {
                    *sum += dot(a, x);
                }
            }
        }
        for &v in &self.body.component.taxels {
            let (g, x) = (self.motions_of(&poses[v]), solution(v));
            let b = combined(&g, |l, k| self.inverse[l][k]);
            let bx = product_transposed(&b, &x);
            let b_ax = combined(&b, |l, k| ax[k][l]);
            blocks[v] += product_transposed(&b_ax, &b) - bx - bx.transpose();
        }
    }
}

/// Motions that an alignment undoes are those with an eigenvalue above this share of the largest.
const OPEN: f64 = 1e-9;

/// What rotations count where positions leave a motion open: so little that the other motions are
/// not affected, and enough to stand out from [`OPEN`].
const SLIGHT: f64 = 1e-5;

/// The eigenvalues of motions that the alignment undoes.
fn aligned(values: &[f64; 6]) -> impl Iterator<Item = usize> {
    let least = OPEN * values.iter().fold(0.0_f64, |m, &x| m.max(x));
    values.iter().enumerate().filter(move |(_, x)| **x > least).map(|(k, _)| k)
}

/// The columns of `M F`, for a matrix of the given columns.
fn combined(columns: &[Twist], factor: impl Fn(usize, usize) -> f64) -> Vec<Twist> {
    let column = |k: usize| {
        let term = |(l, m): (usize, &Twist)| m.map(|x| x * factor(l, k));
        columns.iter().enumerate().map(term).fold([DVec3::ZERO; 2], |sum, x| [sum[0] + x[0], sum[1] + x[1]])
    };
    (0..columns.len()).map(column).collect()
}

/// `M N'` for two matrices of the given columns.
fn product_transposed(m: &[Twist], n: &[Twist]) -> Matrix6 {
    m.iter().zip(n).fold(Matrix6::ZERO, |sum, (&x, &y)| sum + Matrix6::outer(x, y))
}

/// Takes the covariances of all free components from the gauges of their gauge taxels to those of
/// their centroids.
///
/// Components do not touch each other, so one solve for each of at most six conditions serves all
/// of them.
fn to_centroid_gauge(
    problem: &Problem<'_>,
    free: &[FreeBody],
    poses: &Poses,
    factor: &BlockFactor<'_>,
    blocks: &mut IdVec<VertexId, Matrix6>,
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
            for (k, twist) in gauge.conditions(&poses[v]).iter().enumerate() {
                for a in 0..layout.unknowns() {
                    solved[k * unknowns + layout.index(moving, row, a)] = twist[a / 3][a % 3];
                }
            }
        }
    }
    factor.solve(&mut solved, columns * layout.columns()).map_err(CalibError::Sparse)?;
    for gauge in &gauges {
        let solution = |v: VertexId| {
            let mut x = vec![[DVec3::ZERO; 2]; gauge.motions.len()];
            let Some(row) = problem.rows[v] else { return x };
            for (k, twist) in x.iter_mut().enumerate() {
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

fn in_common_frame(problem: &Problem<'_>, poses: &Poses, blocks: &IdVec<VertexId, Matrix6>) -> Marginals {
    let position = |(block, pose): (&Matrix6, &Pose)| {
        let r = DMat3::from_quat(pose.rotation);
        Covariance::from_matrix(&(r * block.0[0][0] * r.transpose()))
    };
    let has_rotations = problem.observations.model == Model::Poses;
    Marginals {
        positions: blocks.iter().zip(poses).map(position).collect(),
        rotations: has_rotations.then(|| blocks.map(|block| Covariance::from_matrix(&block.0[1][1]))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calib::{
        Initialization, ResidualConvention, SimulateOptions, simulate, solve::gauge::GaugeFreedom,
        solve::initial::initial_poses,
    };

    type Dense = Vec<Vec<f64>>;

    fn product(x: &Dense, y: &Dense) -> Dense {
        let columns = y[0].len();
        x.iter()
            .map(|row| (0..columns).map(|j| row.iter().zip(y).map(|(a, b)| a * b[j]).sum()).collect())
            .collect()
    }

    fn transposed(x: &Dense) -> Dense {
        (0..x[0].len()).map(|j| x.iter().map(|row| row[j]).collect()).collect()
    }

    /// Gauss-Jordan with pivots.
    fn inverse(x: &Dense) -> Dense {
        let n = x.len();
        let unit = |i: usize| (0..n).map(move |j| f64::from(u8::from(i == j)));
        let mut m: Dense =
            x.iter().enumerate().map(|(i, row)| row.iter().copied().chain(unit(i)).collect()).collect();
        for k in 0..n {
            let best = (k..n).max_by(|&a, &b| m[a][k].abs().total_cmp(&m[b][k].abs())).unwrap();
            m.swap(k, best);
            let pivot: Vec<f64> = m[k].iter().map(|x| x / m[k][k]).collect();
            for (i, row) in m.iter_mut().enumerate() {
                let factor = row[k];
                let target = if i == k { 0.0 } else { 1.0 };
                row.iter_mut()
                    .zip(&pivot)
                    .for_each(|(x, p)| *x = target * (*x - factor * p) + (1.0 - target) * p);
            }
        }
        m.into_iter().map(|row| row[n..].to_vec()).collect()
    }

    /// `P C P'` with `P = 1 - G (A G)^-1 A`, all matrices written out.
    fn aligned(c: &Dense, gauge: &CentroidGauge<'_>, poses: &Poses) -> Dense {
        let flat = |twists: Vec<Twist>| -> Vec<[f64; 6]> {
            twists.iter().map(|t| std::array::from_fn(|k| t[k / 3][k % 3])).collect()
        };
        let stacked = |of: &dyn Fn(&Pose) -> Vec<Twist>| -> Dense {
            let blocks: Vec<_> = poses.iter().map(|at| flat(of(at))).collect();
            let count = gauge.motions.len();
            (0..count).map(|k| blocks.iter().flat_map(|b| b[k]).collect()).collect()
        };
        let g = transposed(&stacked(&|at| gauge.motions_of(at)));
        let a = stacked(&|at| gauge.conditions(at));
        let away = product(&product(&g, &inverse(&product(&a, &g))), &a);
        let p: Dense = away
            .iter()
            .enumerate()
            .map(|(i, row)| row.iter().enumerate().map(|(j, x)| f64::from(u8::from(i == j)) - x).collect())
            .collect();
        product(&product(&p, c), &transposed(&p))
    }

    /// Selected inversion and projection taxel by taxel, against dense matrices.
    #[test]
    fn covariances_are_those_of_the_dense_inverse() {
        for (model, anchors) in
            [Model::Positions, Model::Poses].into_iter().flat_map(|m| [(m, 0), (m, 1), (m, 4)])
        {
            let options = SimulateOptions { model, taxels: 12, anchors, ..SimulateOptions::default() };
            let mut observations = simulate(&options).unwrap().observations;
            if let Some(crate::calib::DisplacementMeasurement::Offset { information, .. }) =
                observations.edges.as_mut_slice().first_mut().map(|e| &mut e.measurement)
            {
                // Different in every direction: blocks of three.
                information.0[0][0] *= 2.0;
            }
            let poses = initial_poses(&observations, Initialization::Chordal).unwrap();
            let problem = Problem::new(&observations, ResidualConvention::Split).unwrap();
            let free = GaugeFreedom::new(&problem, &poses).free(&problem, &poses, |_| true).into_owned();
            let ones = problem.chi2(&poses).map(|_| 1.0);
            let found = marginals(&problem, &free, &poses, &ones).unwrap();

            let linear = LinearSystem::new(&problem, &free, &poses, &ones);
            let n = linear.gradient.len();
            let column = |k: usize| {
                let unit: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i == k))).collect();
                linear.matrix.multiply(&unit)
            };
            let mut c = inverse(&(0..n).map(column).collect());
            if model == Model::Poses && !free.is_empty() {
                c = aligned(&c, &CentroidGauge::new(&problem, &free[0], &poses), &poses);
            } else if !free.is_empty() {
                // Translations alone are free: what is left of every column is its distance from
                // the mean.
                let mean = |x: &Dense| -> Dense {
                    let centred = |row: &Vec<f64>| -> Vec<f64> {
                        let mean =
                            |axis: usize| row.iter().skip(axis).step_by(3).sum::<f64>() * 3.0 / n as f64;
                        row.iter().enumerate().map(|(i, x)| x - mean(i % 3)).collect()
                    };
                    x.iter().map(centred).collect()
                };
                c = mean(&transposed(&mean(&c)));
            }
            let size = problem.layout.size();
            for (v, found) in found.positions.enumerate() {
                let block = |i: usize, j: usize| c[size * v.index() + i][size * v.index() + j];
                let local = DMat3::from_cols_array(&std::array::from_fn(|k| block(k % 3, k / 3)));
                let r = DMat3::from_quat(poses[v].rotation);
                let m = r * local * r.transpose();
                let expected = [m.x_axis.x, m.y_axis.x, m.z_axis.x, m.y_axis.y, m.z_axis.y, m.z_axis.z];
                let scale = m.x_axis.x + m.y_axis.y + m.z_axis.z;
                for (a, b) in found.to_array().into_iter().zip(expected) {
                    assert!(
                        (a - b).abs() < 1e-9 * scale,
                        "{model:?}, {anchors} anchors, {v:?}: {a} is not {b}"
                    );
                }
            }
        }
    }
}
