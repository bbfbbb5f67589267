use glam::{DMat3, DVec3};

use crate::{
    calib::{
        CalibError, Model, Pose,
        solve::gauge::{Free, RigidMotion, carried},
        solve::levenberg_marquardt::Linear,
        solve::normal_equations::{PerObservation, Problem, Shape, State},
    },
    id::{IdVec, VertexId},
    numeric::{Twist, dot, symmetric_eigen},
    sparse::BlockFactor,
};

/// How uncertain every taxel is: marginal covariances, all at once.
///
/// Where the observations leave a component free to move as a whole, the covariance is that in the centroid gauge: what is
/// left after the best rigid alignment (of positions) to the truth. In the positions model that alignment is a
/// translation only.
#[derive(Debug, Clone, PartialEq)]
pub struct Marginals {
    /// Covariance of positions `xx xy xz yy yz zz`, in m^2, in the common frame; zero for fixed taxels.
    pub positions: IdVec<VertexId, [f64; 6]>,
    /// Covariance of rotation vectors in the taxel's own frame, in rad^2, ordered alike; poses model only.
    pub rotations: Option<IdVec<VertexId, [f64; 6]>>,
}

impl Marginals {
    /// Square root of the trace of the position covariance of every taxel, in m.
    #[must_use]
    pub fn position_rms(&self) -> IdVec<VertexId, f64> {
        self.positions.map(|c| (c[0] + c[3] + c[5]).max(0.0).sqrt())
    }
}

/// Symmetric blocks of translation and rotation; `Scalar` and `Vector` use the first alone.
type Block = [[f64; 6]; 6];

/// Covariances at `state`, for observations of the given weights.
pub(crate) fn marginals(
    problem: &Problem<'_>,
    free: &[Free],
    state: &State,
    weights: &PerObservation,
) -> Result<Marginals, CalibError> {
    let zero: IdVec<VertexId, Block> = state.map(|_| [[0.0; 6]; 6]);
    if problem.moving() == 0 {
        return Ok(in_common_frame(problem, state, &zero));
    }
    let linear = Linear::new(problem, free, state, weights);
    let factor = linear.matrix.factor().map_err(|e| problem.explain(e))?;
    let inverse = factor.selected_inverse();
    let mut blocks = zero;
    for (v, row) in problem.rows.enumerate() {
        let Some(row) = row.map(|r| r as usize) else { continue };
        let block = &mut blocks[v];
        match problem.shape {
            Shape::Scalar => {
                let variance = inverse.diagonal::<1>(row)[0][0];
                (0..3).for_each(|k| block[k][k] = variance);
            }
            Shape::Vector => {
                let found = inverse.diagonal::<3>(row);
                for (out, found) in block.iter_mut().zip(found) {
                    out[..3].copy_from_slice(&found);
                }
            }
            Shape::Pose => *block = inverse.diagonal::<6>(row),
        }
    }
    drop(inverse);
    project(problem, free, state, &factor, &mut blocks)?;
    Ok(in_common_frame(problem, state, &blocks))
}

/// The gauge that the covariance of one free component is told in: that of its centroid, after the best alignment.
struct Alignment<'f> {
    free: &'f Free,
    model: Model,
    pivot: DVec3,
    motions: Vec<RigidMotion>,
    /// What rotations count beside positions.
    weight: f64,
    /// The inverse of `A G`.
    inverse: Block,
}

impl<'f> Alignment<'f> {
    fn new(problem: &Problem<'_>, free: &'f Free, state: &State) -> Self {
        let (pivot, motions) = free.motions(problem, state);
        let model = problem.observations.model;
        let mut this = Self { free, model, pivot, motions, weight: 0.0, inverse: [[0.0; 6]; 6] };
        this.weigh(state);
        this
    }

    /// `G`: how a taxel moves with each free motion.
    fn carry(&self, at: &Pose) -> Vec<Twist> {
        let carried = |m| carried(self.model, self.pivot, self.free.length, at, m);
        self.motions.iter().map(carried).collect()
    }

    /// `A'`.
    fn conditions(&self, at: &Pose) -> Vec<Twist> {
        self.carry(at).into_iter().map(|[u, w]| [u, self.weight * w]).collect()
    }

    /// Takes the component's covariances `C` into this gauge, given the columns `X = C A'`.
    ///
    /// With the free motions `G` and the conditions `A x = 0`, `A = (W G)'` with `W` picking what the alignment looks at,
    /// the projection is `P = 1 - G (A G)^-1 A` and the covariance becomes `P C P'`: for every taxel
    /// `C - B X' - X B' + B (A X) B'` with `B = G (A G)^-1`.
    fn project(
        &self,
        state: &State,
        solution: &dyn Fn(VertexId, usize) -> Twist,
        blocks: &mut IdVec<VertexId, Block>,
    ) {
        let count = self.motions.len();
        let mut conditioned = [[0.0; 6]; 6];
        for &v in &self.free.component.taxels {
            let at = self.conditions(&state[v]);
            for (k, row) in conditioned.iter_mut().enumerate().take(count) {
                for (l, sum) in row.iter_mut().enumerate().take(count) {
                    *sum += dot(at[k], solution(v, l));
                }
            }
        }
        for &v in &self.free.component.taxels {
            let g = self.carry(&state[v]);
            let (mut b, mut x) = ([[0.0; 6]; 6], [[0.0; 6]; 6]);
            for a in 0..6 {
                for k in 0..count {
                    b[a][k] = (0..count).map(|l| g[l][a / 3][a % 3] * self.inverse[l][k]).sum();
                    x[a][k] = solution(v, k)[a / 3][a % 3];
                }
            }
            let (bx, bs) = (times_transposed(&b, &x), times_transposed(&b, &conditioned));
            let bsb = times_transposed(&bs, &b);
            for (i, row) in blocks[v].iter_mut().enumerate() {
                for (j, c) in row.iter_mut().enumerate() {
                    *c += bsb[i][j] - bx[i][j] - bx[j][i];
                }
            }
        }
    }
}

/// Takes the covariances of all free components from the gauges of their gauge taxels to those of their centroids.
///
/// Components do not touch each other, so one solve for each of at most six conditions serves all of them.
fn project(
    problem: &Problem<'_>,
    free: &[Free],
    state: &State,
    factor: &BlockFactor<'_>,
    blocks: &mut IdVec<VertexId, Block>,
) -> Result<(), CalibError> {
    if free.is_empty() {
        return Ok(());
    }
    let alignments: Vec<Alignment<'_>> = free.iter().map(|f| Alignment::new(problem, f, state)).collect();
    let unknowns = problem.moving() * problem.shape.size() * problem.shape.columns();
    let columns = alignments.iter().map(|a| a.motions.len()).max().unwrap_or(0);
    let mut solved = vec![0.0; columns * unknowns];
    for alignment in &alignments {
        for &v in &alignment.free.component.taxels {
            let Some(row) = problem.rows[v] else { continue };
            for (k, twist) in alignment.conditions(&state[v]).iter().enumerate() {
                for (a, at) in places(problem, row).enumerate() {
                    solved[k * unknowns + at] = twist[a / 3][a % 3];
                }
            }
        }
    }
    factor.solve(&mut solved, columns * problem.shape.columns()).map_err(CalibError::Sparse)?;
    let solution = |v: VertexId, k: usize| {
        let mut twist = [DVec3::ZERO; 2];
        if let Some(row) = problem.rows[v] {
            for (a, at) in places(problem, row).enumerate() {
                twist[a / 3][a % 3] = solved[k * unknowns + at];
            }
        }
        twist
    };
    alignments.iter().for_each(|alignment| alignment.project(state, &solution, blocks));
    Ok(())
}

impl Alignment<'_> {
    /// Positions alone align a component, unless they leave a motion open, as on a line: that one follows rotations.
    fn weigh(&mut self, state: &State) {
        let count = self.motions.len();
        let mut eigen = self.overlap(state, 0.0);
        let determined = |(values, _): &([f64; 6], Block)| {
            let largest = values.iter().fold(0.0_f64, |m, &x| m.max(x));
            values.iter().filter(|&&x| x > OPEN * largest).count()
        };
        if determined(&eigen) < count {
            self.weight = SLIGHT * self.free.length * self.free.length;
            eigen = self.overlap(state, self.weight);
        }
        let (values, vectors) = eigen;
        let largest = values.iter().fold(0.0_f64, |m, &x| m.max(x));
        for (k, &value) in values.iter().enumerate().filter(|(_, v)| **v > OPEN * largest) {
            for (i, row) in self.inverse.iter_mut().enumerate() {
                for (j, x) in row.iter_mut().enumerate() {
                    *x += vectors[i][k] * vectors[j][k] / value;
                }
            }
        }
    }

    /// Eigenvalues and vectors of `A G = sum G' W G`.
    fn overlap(&self, state: &State, weight: f64) -> ([f64; 6], Block) {
        let mut sum = [[0.0; 6]; 6];
        for &v in &self.free.component.taxels {
            let g = self.carry(&state[v]);
            for (row, x) in sum.iter_mut().zip(&g) {
                for (s, y) in row.iter_mut().zip(&g) {
                    *s += x[0].dot(y[0]) + weight * x[1].dot(y[1]);
                }
            }
        }
        symmetric_eigen(&sum)
    }
}

/// Share of the best aligned motion below which a motion counts as not aligned at all.
const OPEN: f64 = 1e-9;

/// What rotations count where positions leave a motion open: so little that the other motions do not feel it, and enough to
/// stand out from [`OPEN`].
const SLIGHT: f64 = 1e-5;

/// Where the unknowns of a block row are in a right-hand side.
fn places(problem: &Problem<'_>, row: u32) -> impl Iterator<Item = usize> + use<> {
    let (shape, moving, row) = (problem.shape, problem.moving(), row as usize);
    let count = if shape == Shape::Pose { 6 } else { 3 };
    (0..count).map(move |a| if shape == Shape::Scalar { a * moving + row } else { shape.size() * row + a })
}

fn times_transposed(x: &Block, y: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..6).map(|k| x[i][k] * y[j][k]).sum()))
}

fn in_common_frame(problem: &Problem<'_>, state: &State, blocks: &IdVec<VertexId, Block>) -> Marginals {
    let quarter = |block: &Block, from: usize| {
        let column = |b: usize| {
            DVec3::new(block[from][from + b], block[from + 1][from + b], block[from + 2][from + b])
        };
        DMat3::from_cols(column(0), column(1), column(2))
    };
    let upper = |m: DMat3| [m.x_axis.x, m.y_axis.x, m.z_axis.x, m.y_axis.y, m.z_axis.y, m.z_axis.z];
    let positions = blocks
        .iter()
        .zip(state)
        .map(|(block, pose)| {
            let r = DMat3::from_quat(pose.rotation);
            upper(r * quarter(block, 0) * r.transpose())
        })
        .collect();
    let poses = problem.observations.model == Model::Poses;
    let rotations = poses.then(|| blocks.map(|block| upper(quarter(block, 3))));
    Marginals { positions, rotations }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calib::{
        Initialization, ResidualConvention, SimulateOptions, simulate, solve::gauge::Anchoring,
        solve::initial::start,
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
    fn aligned(c: &Dense, alignment: &Alignment<'_>, state: &State) -> Dense {
        let flat = |twists: Vec<Twist>| -> Vec<[f64; 6]> {
            twists.iter().map(|t| std::array::from_fn(|k| t[k / 3][k % 3])).collect()
        };
        let stacked = |of: &dyn Fn(&Pose) -> Vec<Twist>| -> Dense {
            let blocks: Vec<_> = state.iter().map(|at| flat(of(at))).collect();
            let count = alignment.motions.len();
            (0..count).map(|k| blocks.iter().flat_map(|b| b[k]).collect()).collect()
        };
        let g = transposed(&stacked(&|at| alignment.carry(at)));
        let a = stacked(&|at| alignment.conditions(at));
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
            let state = start(&observations, Initialization::Chordal).unwrap();
            let problem = Problem::new(&observations, ResidualConvention::Split).unwrap();
            let free = Anchoring::new(&problem, &state).free(&problem, &state, |_| true).into_owned();
            let ones = problem.squares(&state).map(|_| 1.0);
            let found = marginals(&problem, &free, &state, &ones).unwrap();

            let linear = Linear::new(&problem, &free, &state, &ones);
            let n = linear.gradient.len();
            let column = |k: usize| {
                let unit: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i == k))).collect();
                linear.matrix.multiply(&unit)
            };
            let mut c = inverse(&(0..n).map(column).collect());
            if model == Model::Poses && !free.is_empty() {
                c = aligned(&c, &Alignment::new(&problem, &free[0], &state), &state);
            } else if !free.is_empty() {
                // Translations alone are free: what is left of every column is its distance from the mean.
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
            let size = problem.shape.size();
            for (v, told) in found.positions.enumerate() {
                let block = |i: usize, j: usize| c[size * v.index() + i][size * v.index() + j];
                let local = DMat3::from_cols_array(&std::array::from_fn(|k| block(k % 3, k / 3)));
                let r = DMat3::from_quat(state[v].rotation);
                let m = r * local * r.transpose();
                let expected = [m.x_axis.x, m.y_axis.x, m.z_axis.x, m.y_axis.y, m.z_axis.y, m.z_axis.z];
                let scale = m.x_axis.x + m.y_axis.y + m.z_axis.z;
                for (a, b) in told.iter().zip(expected) {
                    assert!(
                        (a - b).abs() < 1e-9 * scale,
                        "{model:?}, {anchors} anchors, {v:?}: {a} is not {b}"
                    );
                }
            }
        }
    }
}
