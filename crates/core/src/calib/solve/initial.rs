//! The start of the optimisation: chordal relaxation (`(martinec2007)`, `(carlone2015)`), a spanning tree, or initial
//! values; then every component is aligned to its contacts `(wahba1965)`.

use std::collections::VecDeque;

use glam::{DMat3, DQuat, DVec3};

use crate::calib::pose::outer;
use crate::calib::solve::normal_equations::{number_rows, pair_of, row_pairs};
use crate::calib::{
    CalibError, ContactMeasurement, Displacement, DisplacementId, DisplacementMeasurement, Initialization,
    Model, Observations, Pose, PoseMeasurement, Poses, components,
};
use crate::calib::{Correlation, nearest_rotation};
use crate::id::{IdVec, VertexId};
use crate::sparse::{BlockSlot, BlockSystem, Pattern, SparseError};

/// Taxels that keep their pose while the start is computed: fixed ones, and the gauge taxel of every
/// component without fixed taxels.
fn anchors(observations: &Observations) -> IdVec<VertexId, bool> {
    let mut anchors = observations.taxels.map(|t| t.fixed);
    for component in components(observations, |_| true).0 {
        if !component.fixed {
            anchors[component.gauge] = true;
        }
    }
    anchors
}

/// Initial poses of the given kind. The positions model is linear and needs none.
pub(crate) fn initial_poses(observations: &Observations, kind: Initialization) -> Result<Poses, CalibError> {
    let mut poses = match kind {
        Initialization::InitialValues => {
            return match observations.taxels.iter().find(|t| t.initial.is_none()) {
                Some(t) => Err(CalibError::NoInitialValue { id: t.id }),
                None => Ok(initial_or_origin(observations)),
            };
        }
        Initialization::Chordal if observations.model == Model::Positions => {
            return Ok(initial_or_origin(observations));
        }
        Initialization::Chordal => match chordal(observations) {
            Ok(poses) => poses,
            // The relaxed problem does not determine all rotations: chain them instead.
            Err(SparseError::NotPositiveDefinite { .. } | SparseError::NotFinite { .. }) => {
                spanning_tree(observations)
            }
            Err(other) => return Err(CalibError::Sparse(other)),
        },
    };
    align_to_contacts(observations, &mut poses);
    Ok(poses)
}

/// A start in which every taxel without initial value is at the origin.
fn initial_or_origin(observations: &Observations) -> Poses {
    observations.taxels.map(|t| {
        let pose = t.initial.unwrap_or(Pose::default());
        match observations.model {
            Model::Positions => Pose { rotation: DQuat::IDENTITY, ..pose },
            Model::Poses => pose,
        }
    })
}

/// The edges of every taxel, ascending.
fn edges_of_taxels(observations: &Observations) -> IdVec<VertexId, Vec<DisplacementId>> {
    let mut edges_of: IdVec<VertexId, Vec<DisplacementId>> = observations.taxels.map(|_| Vec::new());
    for (id, edge) in observations.edges.enumerate() {
        edges_of[edge.from].push(id);
        edges_of[edge.to].push(id);
    }
    edges_of
}

/// The pose of `v` that `edge` predicts from its other end.
fn predicted_pose(observations: &Observations, edge: DisplacementId, v: VertexId, poses: &Poses) -> Pose {
    let edge = &observations.edges[edge];
    let is_forward = edge.to == v;
    let other = &poses[if is_forward { edge.from } else { edge.to }];
    match &edge.measurement {
        DisplacementMeasurement::Offset { offset, .. } => {
            Pose { position: other.position + if is_forward { *offset } else { -*offset }, ..*other }
        }
        DisplacementMeasurement::Relative(m) => *other * if is_forward { m.pose } else { m.pose.inverse() },
    }
}

/// Chains observations breadth first, from the anchors outwards, in the order of the edges.
pub(crate) fn spanning_tree(observations: &Observations) -> Poses {
    let mut poses = initial_or_origin(observations);
    let edges_of = edges_of_taxels(observations);
    let mut reached = anchors(observations);
    let mut open: VecDeque<VertexId> = reached.enumerate().filter(|(_, a)| **a).map(|(v, _)| v).collect();
    while let Some(v) = open.pop_front() {
        for &e in &edges_of[v] {
            let edge = &observations.edges[e];
            let other = if edge.from == v { edge.to } else { edge.from };
            if !reached[other] && edge.is_observed() {
                poses[other] = predicted_pose(observations, e, other, &poses);
                reached[other] = true;
                open.push_back(other);
            }
        }
    }
    poses
}

/// The chordal relaxation: rotations as if they were free matrices, projected to rotations, then
/// translations.
fn chordal(observations: &Observations) -> Result<Poses, SparseError> {
    let mut poses = initial_or_origin(observations);
    let anchors = anchors(observations);
    let (rows, count) = number_rows(observations, |v| !anchors[v]);
    if count == 0 {
        return Ok(poses);
    }
    let pattern = Pattern::new(count, row_pairs(observations, &rows));
    let mean = |m: &PoseMeasurement, k: usize| (k..k + 3).map(|k| m.information.0[k][k]).sum::<f64>() / 3.0;

    // `sum w |R_j - R_i Z|^2`: the three rows of every `R` are unknown, with one matrix.
    let solved = relaxed(&BlockSystem::new(pattern.clone(), 3)?, observations, &rows, |edge, m| {
        let z = DMat3::from_quat(m.pose.rotation);
        let known = |v: VertexId, z: DMat3| match rows[v] {
            Some(_) => DMat3::ZERO,
            None => DMat3::from_quat(poses[v].rotation) * z,
        };
        let (from, to) = (known(edge.to, z.transpose()), known(edge.from, z));
        Term { weight: mean(m, 3), coupling: z, from, to }
    })?;
    for (pose, row) in poses.iter_mut().zip(&rows) {
        if let Some(row) = *row {
            let entry = |a: usize, b: usize| solved[3 * count * a + 3 * row as usize + b];
            let column = |b: usize| DVec3::new(entry(0, b), entry(1, b), entry(2, b));
            pose.rotation = nearest_rotation(&DMat3::from_cols(column(0), column(1), column(2)));
        }
    }
    // `sum w |p_j - p_i - R_i z|^2` with these rotations.
    let solved = relaxed(&BlockSystem::new(pattern, 1)?, observations, &rows, |edge, m| {
        let offset = poses[edge.from].rotation * m.pose.position;
        let known = |v: VertexId| if rows[v].is_none() { poses[v].position } else { DVec3::ZERO };
        let side = |x: DVec3| DMat3::from_cols(x, DVec3::ZERO, DVec3::ZERO);
        let (from, to) = (side(-offset + known(edge.to)), side(offset + known(edge.from)));
        Term { weight: mean(m, 0), coupling: DMat3::IDENTITY, from, to }
    })?;
    for (pose, row) in poses.iter_mut().zip(&rows) {
        if let Some(row) = *row {
            pose.position = DVec3::from_array(std::array::from_fn(|c| solved[count * c + row as usize]));
        }
    }
    Ok(poses)
}

/// The contribution of one edge to a relaxed problem.
struct Term {
    weight: f64,
    /// Its block of (from, to) is minus this.
    coupling: DMat3,
    /// The right-hand sides of its two taxels: one in each row.
    from: DMat3,
    to: DMat3,
}

/// The solution of a relaxed problem for three right-hand sides, one after the other.
fn relaxed(
    system: &BlockSystem,
    observations: &Observations,
    rows: &IdVec<VertexId, Option<u32>>,
    term: impl Fn(&Displacement, &PoseMeasurement) -> Term,
) -> Result<Vec<f64>, SparseError> {
    let (size, unknowns) = (system.size(), system.size() * system.blocks());
    let mut matrix = system.zero();
    let mut rhs = vec![0.0; 3 * unknowns];
    for edge in &observations.edges {
        let DisplacementMeasurement::Relative(m) = &edge.measurement else { continue };
        let Term { weight: w, coupling, from, to } = term(edge, m);
        for (v, side) in [(edge.from, from), (edge.to, to)] {
            let Some(row) = rows[v] else { continue };
            matrix.add(BlockSlot::diagonal(row), |a, b| if a == b { w } else { 0.0 });
            for a in 0..3 {
                for b in 0..size {
                    rhs[unknowns * a + size * row as usize + b] += w * side.col(b)[a];
                }
            }
        }
        if let Some((from, to)) = pair_of(edge, rows)
            && let Some(slot) = system.slot(from.max(to), from.min(to))
        {
            let block = if from > to { coupling } else { coupling.transpose() };
            matrix.add(slot, |a, b| -w * block.col(b)[a]);
        }
    }
    matrix.factor()?.solve(&mut rhs, 3)?;
    Ok(rhs)
}

/// Aligns every component without a fixed taxel with its contacts `(wahba1965)`: the rotation follows from the
/// directions between touched points, touched normals and observed orientations.
fn align_to_contacts(observations: &Observations, poses: &mut Poses) {
    let (components, of_taxel) = components(observations, |_| true);
    let mut touches_of = vec![Vec::new(); components.len()];
    for contact in observations.contacts.iter().filter(|c| c.measurement.rank(Model::Positions) > 0) {
        touches_of[of_taxel[contact.taxel]].push(contact);
    }
    for (component, touches) in components.iter().zip(&touches_of) {
        if component.fixed || touches.is_empty() {
            continue;
        }
        let pairs: Vec<(DVec3, DVec3)> =
            touches.iter().map(|c| (poses[c.taxel].position, observed_position(&c.measurement))).collect();
        let Correlation { from, to, matrix: mut votes } = Correlation::new(&pairs, None);
        // Points are weighted by their squared distance, directions as if they were as far apart as the
        // points.
        let spread = pairs.iter().map(|p| p.0.distance_squared(from)).sum::<f64>() / pairs.len() as f64;
        let scale = if spread > 0.0 { spread } else { 1.0 };
        for contact in touches {
            let at = poses[contact.taxel].rotation;
            match &contact.measurement {
                ContactMeasurement::PositionNormal { normal, .. } => {
                    votes += outer(*normal, at * DVec3::Z) * scale
                }
                ContactMeasurement::Pose { offset, seen } => {
                    let seen = seen.pose.rotation * offset.rotation.conjugate();
                    votes += DMat3::from_quat(seen * at.conjugate()) * scale;
                }
                ContactMeasurement::Position { .. } => {}
            }
        }
        let rotation = match observations.model {
            Model::Poses if votes != DMat3::ZERO => nearest_rotation(&votes),
            _ => DQuat::IDENTITY,
        };
        for &v in &component.taxels {
            let pose = &mut poses[v];
            pose.position = rotation * (pose.position - from) + to;
            pose.rotation = (rotation * pose.rotation).normalize();
        }
    }
}

/// The observed position of the taxel of a contact.
fn observed_position(touch: &ContactMeasurement) -> DVec3 {
    match touch {
        ContactMeasurement::Position { position, .. }
        | ContactMeasurement::PositionNormal { position, .. } => *position,
        ContactMeasurement::Pose { offset, seen } => (seen.pose * offset.inverse()).position,
    }
}
