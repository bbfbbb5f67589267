//! Covariances of the bodies, and of the modules and taxels that follow from the joint covariance of the bodies
//! that carry them. First order, at the weights of the solution.

use glam::{DMat3, DVec3};

use super::cad::ModuleId;
use super::placement::{BodyId, Hierarchy, Placement};
use super::system::{BLOCK, BodySystem};
use crate::calib::CalibError;
use crate::calib::pose::hat;
use crate::id::IdVec;
use crate::least_squares::InverseColumns;
use crate::numeric::{Covariance, Matrix6};
use crate::sparse::BlockFactor;

/// The covariances that a fit gives.
pub(super) struct BodyCovariances {
    /// Of the motion of each body relative to its parent; `None` for a body that does not move.
    pub(super) bodies: IdVec<BodyId, Option<Matrix6>>,
    /// Of the centre of each module in the link's frame and of its rotation vector.
    pub(super) modules: IdVec<ModuleId, Matrix6>,
    /// Of the offset of the probe, and the variance of the standoff.
    pub(super) probe: (DMat3, f64),
    /// The variances of the linear unknowns, in blocks of six.
    pub(super) linear: Vec<f64>,
}

/// The block of a row among the columns of one block.
fn block(columns: &InverseColumns, row: usize) -> Matrix6 {
    let entry = |a: usize, b: usize| columns.entry(BLOCK * row + a, b);
    Matrix6::from_rows(&std::array::from_fn(|a| std::array::from_fn(|b| entry(a, b))))
}

pub(super) fn covariances(
    system: &BodySystem<'_>,
    factor: &BlockFactor<'_>,
    at: &Placement,
) -> Result<BodyCovariances, CalibError> {
    let hierarchy = system.hierarchy;
    let columns = |row: usize| {
        let wanted: [Option<usize>; BLOCK] = std::array::from_fn(|k| Some(BLOCK * row + k));
        InverseColumns::of(factor, (system.unknowns(), 1), &wanted).map_err(CalibError::Sparse)
    };
    let mut bodies = hierarchy.levels.map(|_| None);
    // The bodies that carry modules, which many modules need.
    let carriers: IdVec<BodyId, Option<InverseColumns>> = {
        let is_module: Vec<BodyId> = hierarchy.chains.iter().map(|chain| chain[2]).collect();
        let of = |body: BodyId| {
            let row = system.row(body).filter(|_| is_module.binary_search(&body).is_err());
            row.map(columns).transpose()
        };
        hierarchy.levels.ids().map(of).collect::<Result<_, _>>()?
    };
    for (body, found) in carriers.enumerate() {
        bodies[body] = found.as_ref().zip(system.row(body)).map(|(found, row)| block(found, row));
    }
    let mut modules = IdVec::default();
    for chain in &hierarchy.chains {
        let own = system.row(chain[2]).map(columns).transpose()?;
        if let (Some(own), Some(row)) = (&own, system.row(chain[2])) {
            bodies[chain[2]] = Some(block(own, row));
        }
        let derivatives = derivatives(hierarchy, at, *chain);
        let mut sum = Matrix6::ZERO;
        for (j, &of_column) in chain.iter().enumerate() {
            let Some(found) = carriers[of_column].as_ref().or(own.as_ref().filter(|_| j == 2)) else {
                continue;
            };
            for (i, &of_row) in chain.iter().enumerate() {
                let Some(row) = system.row(of_row) else { continue };
                let product = derivatives[i] * block(found, row) * derivatives[j].transpose();
                sum = added(&sum, &product);
            }
        }
        modules.push(sum);
    }
    let probe = system.probe_row().map(|row| columns(row).map(|found| block(&found, row))).transpose()?;
    let probe = probe.map_or((DMat3::ZERO, 0.0), |block| (block.0[0][0], block.entry(3, 3)));
    let mut linear = Vec::new();
    for &row in system.linear_rows() {
        let found = block(&columns(row)?, row);
        linear.extend((0..BLOCK).map(|k| found.entry(k, k)));
    }
    Ok(BodyCovariances { bodies, modules, probe, linear })
}

/// How the centre and the rotation of a module change with the motions of the bodies that carry it.
pub(super) fn derivatives(hierarchy: &Hierarchy, at: &Placement, chain: [BodyId; 3]) -> [Matrix6; 3] {
    let mut position = hierarchy.centres[chain[2]];
    let mut arms = [DVec3::ZERO; 3];
    for (arm, body) in arms.iter_mut().zip(chain).rev() {
        let (motion, centre) = (at.motions[body], hierarchy.centres[body]);
        *arm = motion.rotation * (position - centre);
        position = centre + motion.translation + *arm;
    }
    std::array::from_fn(|depth| {
        let parent = at.parent_rotation(chain, depth);
        Matrix6([[parent, parent * hat(arms[depth]) * -1.0], [DMat3::ZERO, parent]])
    })
}

pub(super) fn added(a: &Matrix6, b: &Matrix6) -> Matrix6 {
    Matrix6(std::array::from_fn(|i| std::array::from_fn(|j| a.0[i][j] + b.0[i][j])))
}

/// The covariance of a taxel that is `arm` from the centre of its module, in the link's frame.
pub(super) fn of_taxel(module: &Matrix6, arm: DVec3) -> Covariance {
    let [[tt, tr], [rt, rr]] = module.0;
    let k = hat(arm);
    // x = c + r: dx = dc - hat(arm) dr.
    Covariance::from(tt - tr * k.transpose() - k * rt + k * rr * k.transpose())
}
