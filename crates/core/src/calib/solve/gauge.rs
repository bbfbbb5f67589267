//! Gauge freedom: rigid motions of whole components that the contacts do not determine, and how the solve
//! fixes them (section 9 of `(triggs2000)`).
//!
//! The gauge taxel of each such component gets stiffness along the free motions, which do not change the
//! cost. Covariances are transformed to the centroid gauge afterwards (`marginals`).

use glam::{DMat3, DVec3};

use crate::calib::{
    Component, ContactObservationId, Model, Observations, PerObservation, Pose, Poses, Problem, components,
};
use crate::id::VertexId;
use crate::least_squares::SMALLEST_WEIGHT;
use crate::numeric::{Matrix6, Twist, argsort, symmetric_eigen};
use crate::skin::TaxelId;
use crate::sparse::{BlockMatrix, BlockSlot};

/// Rigid motions that contacts correlate by more than 1 minus this count as one motion: their difference is
/// not determined.
const RANK_TOLERANCE: f64 = 1e-9;

/// Information about a motion below this share of the largest is the squared rounding error of positions far
/// from the origin.
const NO_INFORMATION: f64 = 1e-20;

/// A column that orthogonalisation shortens by more than this is spanned by the others.
const DEPENDENT: f64 = 1e-9;

/// A rigid motion of a whole component about a pivot: translation over [`FreeBody::length`], and
/// rotation vector.
pub(crate) type RigidMotion = [f64; 6];

/// A component of the graph whose absolute pose the contacts do not determine, or not in every
/// direction.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeComponent {
    /// The taxel that keeps its initial pose along the free motions.
    pub gauge: TaxelId,
    /// Number of its taxels.
    pub taxels: usize,
    /// Number of independent rigid motions of the component that no contact determines.
    pub free_motions: usize,
    /// Contacts of its taxels that were rejected and determine nothing.
    pub rejected_contacts: usize,
}

/// A component that is free to move as a rigid body.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FreeBody {
    pub(crate) component: Component,
    /// How many independent motions are free: up to 3 for positions, up to 6 for poses.
    pub(crate) free_motions: usize,
    /// Typical distance from the centroid, in m: makes translations and rotations comparable.
    pub(crate) length: f64,
    contacts: Vec<ContactObservationId>,
    /// Number of its contacts that do not count.
    pub(crate) rejected_contacts: usize,
}

/// The components that are free at `poses` under these weights: rejected contacts would anchor in rounding errors.
pub(crate) fn free_under(problem: &Problem<'_>, poses: &Poses, weights: &PerObservation) -> Vec<FreeBody> {
    free_components(problem, poses, |contact| weights.contacts[contact] > SMALLEST_WEIGHT)
}

/// The centroid of a component, and the typical distance from it, in m.
fn placement(taxels: &[VertexId], poses: &Poses) -> (DVec3, f64) {
    let count = taxels.len().max(1) as f64;
    let centroid = taxels.iter().map(|&v| poses[v].position).sum::<DVec3>() / count;
    let spread = taxels.iter().map(|&v| poses[v].position.distance_squared(centroid)).sum::<f64>() / count;
    (centroid, if spread > 0.0 { spread.sqrt() } else { 1.0 })
}

/// The motion of a taxel frame when its component moves as a whole: a column of `G`.
pub(crate) fn induced_motion(
    model: Model,
    pivot: DVec3,
    length: f64,
    at: &Pose,
    motion: &RigidMotion,
) -> Twist {
    let translation = length * DVec3::new(motion[0], motion[1], motion[2]);
    match model {
        Model::Positions => [translation, DVec3::ZERO],
        Model::Poses => {
            let turn = DVec3::new(motion[3], motion[4], motion[5]);
            let back = DMat3::from_quat(at.rotation).transpose();
            [back * (translation + turn.cross(at.position - pivot)), back * turn]
        }
    }
}

/// The components that are not determined by the contacts for which `counts` is true. It depends on `poses`:
/// contacts at one point leave rotations free, and the same contacts may not once their taxels have moved
/// apart.
pub(crate) fn free_components(
    problem: &Problem<'_>,
    poses: &Poses,
    counts: impl Fn(ContactObservationId) -> bool,
) -> Vec<FreeBody> {
    let observations = problem.observations;
    let (all, of_taxel) = components(observations, |_| true);
    let mut contacts = vec![(Vec::new(), 0); all.len()];
    for (id, contact) in observations.contacts.enumerate() {
        let (counting, rejected_contacts) = &mut contacts[of_taxel[contact.taxel]];
        if counts(id) {
            counting.push(id);
        } else {
            *rejected_contacts += 1;
        }
    }
    let mut free = Vec::new();
    for (component, (contacts, rejected_contacts)) in all.into_iter().zip(contacts) {
        if component.fixed {
            continue;
        }
        let length = placement(&component.taxels, poses).1;
        let mut candidate = FreeBody { component, free_motions: 0, length, contacts, rejected_contacts };
        let (_, values, _) = candidate.anchoring(problem, poses);
        let motions = observations.model.unknowns();
        // In the positions model the three rotations have no effect; their eigenvalues are zero.
        let determined = values.iter().filter(|&&x| x > RANK_TOLERANCE).count();
        candidate.free_motions = motions.saturating_sub(determined);
        if candidate.free_motions > 0 {
            free.push(candidate);
        }
    }
    free
}

impl FreeBody {
    pub(crate) fn describe(&self, observations: &Observations) -> FreeComponent {
        FreeComponent {
            gauge: observations.taxels[self.component.gauge].id,
            taxels: self.component.taxels.len(),
            free_motions: self.free_motions,
            rejected_contacts: self.rejected_contacts,
        }
    }

    /// The information of the contacts about each motion of the component: the pivot of the motions,
    /// eigenvalues, ascending, and motions.
    ///
    /// About the centre of the touched points translations and rotations are nearly uncorrelated, and every
    /// motion is scaled by its own unit: so a position known to a micrometre does not make a rotation known
    /// to a degree look unknown.
    fn anchoring(&self, problem: &Problem<'_>, poses: &Poses) -> (DVec3, [f64; 6], [RigidMotion; 6]) {
        let model = problem.observations.model;
        let terms: Vec<_> = self
            .contacts
            .iter()
            .map(|&id| {
                let contact = &problem.observations.contacts[id];
                let at = &poses[contact.taxel];
                (at, problem.contact_term(&contact.measurement, at).0)
            })
            .collect();
        let pull = |block: &Matrix6| (0..3).map(|a| block.entry(a, a)).sum::<f64>();
        let total: f64 = terms.iter().map(|(_, block)| pull(block)).sum();
        let pivot = if total > 0.0 {
            terms.iter().map(|(at, block)| at.position * (pull(block) / total)).sum()
        } else {
            placement(&self.component.taxels, poses).0
        };
        let mut sum = [[0.0; 6]; 6];
        for (at, block) in &terms {
            let moved: [Twist; 6] =
                std::array::from_fn(|k| induced_motion(model, pivot, self.length, at, &unit(k)));
            for (row, a) in sum.iter_mut().zip(&moved) {
                let pull = *block * *a;
                for (x, b) in row.iter_mut().zip(&moved) {
                    *x += pull[0].dot(b[0]) + pull[1].dot(b[1]);
                }
            }
        }
        let (values, motions) = scaled_eigen(&sum);
        (pivot, values, motions)
    }

    /// The free motions at `poses`, with their pivot.
    pub(crate) fn motions(&self, problem: &Problem<'_>, poses: &Poses) -> (DVec3, Vec<RigidMotion>) {
        if self.free_motions == problem.observations.model.unknowns() {
            let centroid = placement(&self.component.taxels, poses).0;
            return (centroid, (0..self.free_motions).map(unit).collect());
        }
        let (pivot, _, motions) = self.anchoring(problem, poses);
        // In the positions model rotations are among the free motions; they move no taxel and are
        // left out.
        let moves =
            |m: &RigidMotion| problem.observations.model == Model::Poses || m[..3].iter().any(|&x| x != 0.0);
        (pivot, motions.into_iter().filter(moves).take(self.free_motions).collect())
    }

    /// Adds stiffness against the free motions at the gauge taxel.
    ///
    /// The cost does not change along a free motion, so its gradient is orthogonal to all of them,
    /// and the step of the stiffened system is the one step of least squares that does not move the
    /// gauge taxel along them: the stiffness does not change the result.
    pub(crate) fn fix_gauge(&self, problem: &Problem<'_>, poses: &Poses, matrix: &mut BlockMatrix<'_>) {
        let gauge = self.component.gauge;
        let Some(row) = problem.rows[gauge] else { return };
        let size = problem.layout.size();
        let mut diagonal = matrix.diagonal_of(row);
        // A direction that nothing at the taxel determines gets the same stiffness as the others.
        let largest = diagonal.iter().fold(0.0_f64, |m, &d| m.max(d));
        let firm = if largest > 0.0 { largest } else { 1.0 };
        diagonal.iter_mut().filter(|d| **d <= 0.0).for_each(|d| *d = firm);
        if self.free_motions == problem.observations.model.unknowns() {
            matrix.add(BlockSlot::diagonal(row), |a, b| if a == b { diagonal[a] } else { 0.0 });
            return;
        }
        let (pivot, motions) = self.motions(problem, poses);
        let model = problem.observations.model;
        let scale: Vec<f64> = diagonal.iter().map(|d| d.sqrt()).collect();
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for motion in &motions {
            let twist = induced_motion(model, pivot, self.length, &poses[gauge], motion);
            let mut column: Vec<f64> = (0..size).map(|a| scale[a] * twist[a / 3][a % 3]).collect();
            orthogonalise(&mut column, &basis);
            basis.push(column);
        }
        matrix.add(BlockSlot::diagonal(row), |a, b| {
            basis.iter().map(|c| c[a] * c[b]).sum::<f64>() * scale[a] * scale[b]
        });
    }
}

/// Eigenvalues, ascending, of a matrix scaled to ones on its diagonal, and its eigenvectors in the
/// unscaled motions.
fn scaled_eigen(sum: &[[f64; 6]; 6]) -> ([f64; 6], [RigidMotion; 6]) {
    let largest = (0..6).fold(0.0_f64, |m, k| m.max(sum[k][k]));
    let holds = |k: usize| sum[k][k] > NO_INFORMATION * largest;
    let scale: [f64; 6] = std::array::from_fn(|k| if holds(k) { sum[k][k].sqrt().recip() } else { 0.0 });
    let scaled = std::array::from_fn(|i| std::array::from_fn(|j| sum[i][j] * scale[i] * scale[j]));
    let (values, vectors) = symmetric_eigen::<6>(&scaled);
    let order = argsort(&values);
    let motion = |k: usize| -> RigidMotion {
        let unscaled: RigidMotion =
            std::array::from_fn(|i| vectors[i][k] * if holds(i) { scale[i] } else { 1.0 });
        let length = unscaled.iter().map(|x| x * x).sum::<f64>().sqrt();
        unscaled.map(|x| x / length)
    };
    (std::array::from_fn(|k| values[order[k]]), std::array::from_fn(|k| motion(order[k])))
}

/// Gram and Schmidt; a column that is spanned by the others becomes zero.
fn orthogonalise(column: &mut [f64], basis: &[Vec<f64>]) {
    let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let before = norm(column);
    for other in basis {
        let along: f64 = column.iter().zip(other).map(|(x, y)| x * y).sum();
        column.iter_mut().zip(other).for_each(|(x, y)| *x -= along * y);
    }
    let after = norm(column);
    let factor = if after > DEPENDENT * before { after.recip() } else { 0.0 };
    column.iter_mut().for_each(|x| *x *= factor);
}

fn unit(k: usize) -> RigidMotion {
    std::array::from_fn(|i| f64::from(u8::from(i == k)))
}
