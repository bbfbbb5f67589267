//! Where the optimisation starts: chordal relaxation (martinec2007), (carlone2015), a spanning
//! tree, or initial values; then every component is aligned to its contacts (wahba1965).

use std::collections::VecDeque;

use glam::{DMat3, DQuat, DVec3};

use crate::{
    calib::{
        CalibError, ContactMeasurement, Displacement, DisplacementMeasurement, Information, Initialization,
        Model, Observations, Pose, PoseMeasurement,
        geometry::align::{Correlation, nearest_rotation, outer},
        observations::graph::{Poses, component_of_taxels, components, edges_of_taxels, predicted_pose},
        solve::layout::{number_rows, pair_of, row_pairs},
    },
    id::{IdVec, VertexId},
    sparse::{BlockFactor, BlockMatrix, BlockSlot, BlockSystem, Pattern, SparseError},
};

/// Taxels that keep their pose while the start is computed: fixed ones, and the gauge taxel of
/// every component without.
fn anchors(observations: &Observations) -> IdVec<VertexId, bool> {
    let mut anchors = observations.taxels.map(|t| t.fixed);
    for component in components(observations, |_| true) {
        if !component.fixed {
            anchors[component.gauge] = true;
        }
    }
    anchors
}

/// Initial poses of the wanted kind. Positions are linear: they need none.
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
            // Rotations that nothing determines in the relaxed problem: chain them instead.
            Err(SparseError::NotPositiveDefinite { .. } | SparseError::NotFinite { .. }) => {
                spanning_tree(observations)
            }
            Err(other) => return Err(CalibError::Sparse(other)),
        },
        Initialization::SpanningTree => spanning_tree(observations),
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

/// The two linear systems of the chordal relaxation: both have a block row for every taxel that is
/// not an anchor.
fn chordal(observations: &Observations) -> Result<Poses, SparseError> {
    let mut poses = initial_or_origin(observations);
    let anchors = anchors(observations);
    let (rows, count) = number_rows(observations, |v| !anchors[v]);
    if count == 0 {
        return Ok(poses);
    }
    let edges = relative_edges(observations);
    let pattern = Pattern::new(count, row_pairs(observations, &rows));

    let system = BlockSystem::new(pattern.clone(), 3)?;
    let mut rhs = vec![0.0; 9 * count];
    rotations_system(&system, &edges, &rows, &poses, &mut rhs)?.solve(&mut rhs, 3)?;
    for (v, row) in rows.enumerate() {
        if let Some(row) = row {
            let entry = |a: usize, b: usize| rhs[3 * count * a + 3 * *row as usize + b];
            let column = |b: usize| DVec3::new(entry(0, b), entry(1, b), entry(2, b));
            poses[v].rotation = nearest_rotation(&DMat3::from_cols(column(0), column(1), column(2)));
        }
    }
    let system = BlockSystem::new(pattern, 1)?;
    let mut rhs = vec![0.0; 3 * count];
    translations_system(&system, &edges, &rows, &poses, &mut rhs)?.solve(&mut rhs, 3)?;
    for (v, row) in rows.enumerate() {
        if let Some(row) = row {
            poses[v].position = DVec3::from_array(std::array::from_fn(|c| rhs[count * c + *row as usize]));
        }
    }
    Ok(poses)
}

/// A relative pose with one weight for its rotation and one for its translation.
struct Weighted<'o> {
    edge: &'o Displacement,
    pose: &'o Pose,
    rotation: f64,
    translation: f64,
}

fn relative_edges(observations: &Observations) -> Vec<Weighted<'_>> {
    let mean = |info: &Information<6>, from: usize| (from..from + 3).map(|k| info.0[k][k]).sum::<f64>() / 3.0;
    let weigh = |m: &PoseMeasurement| [mean(&m.information, 3), mean(&m.information, 0)];
    let relative = observations.edges.iter().filter_map(|edge| match &edge.measurement {
        DisplacementMeasurement::Relative(m) => Some((edge, m)),
        DisplacementMeasurement::Offset { .. } => None,
    });
    relative
        .map(|(edge, m)| {
            let [rotation, translation] = weigh(m);
            Weighted { edge, pose: &m.pose, rotation, translation }
        })
        .collect()
}

/// `sum w |R_j - R_i Z|^2`: the three rows of every `R` are unknown, each alike, so they are three
/// right-hand sides.
fn rotations_system<'s>(
    system: &'s BlockSystem,
    edges: &[Weighted<'_>],
    rows: &IdVec<VertexId, Option<u32>>,
    poses: &Poses,
    rhs: &mut [f64],
) -> Result<BlockFactor<'s>, SparseError> {
    let mut matrix = system.zero();
    let columns = rhs.len() / 3;
    // Adds `w M` to the right-hand side of a taxel: row `a` of the matrix belongs to right-hand
    // side `a`.
    let mut add = |row: u32, m: DMat3, w: f64| {
        for a in 0..3 {
            for b in 0..3 {
                rhs[columns * a + 3 * row as usize + b] += w * m.col(b)[a];
            }
        }
    };
    for e in edges {
        let w = e.rotation;
        let z = DMat3::from_quat(e.pose.rotation);
        let (from, to) = (rows[e.edge.from], rows[e.edge.to]);
        for row in [from, to].into_iter().flatten() {
            matrix.add(BlockSlot::diagonal(row), |a, b| if a == b { w } else { 0.0 });
        }
        match (from, to) {
            (Some(_), Some(_)) => add_pair(system, &mut matrix, e.edge, rows, |a, b| -w * z.col(b)[a]),
            (None, Some(row)) => add(row, DMat3::from_quat(poses[e.edge.from].rotation) * z, w),
            (Some(row), None) => add(row, DMat3::from_quat(poses[e.edge.to].rotation) * z.transpose(), w),
            (None, None) => {}
        }
    }
    matrix.factor()
}

/// `sum w |p_j - p_i - R_i z|^2` with the rotations of `poses`.
fn translations_system<'s>(
    system: &'s BlockSystem,
    edges: &[Weighted<'_>],
    rows: &IdVec<VertexId, Option<u32>>,
    poses: &Poses,
    rhs: &mut [f64],
) -> Result<BlockFactor<'s>, SparseError> {
    let mut matrix = system.zero();
    let columns = rhs.len() / 3;
    let mut add = |row: u32, x: DVec3| {
        for (c, x) in x.to_array().into_iter().enumerate() {
            rhs[columns * c + row as usize] += x;
        }
    };
    for e in edges {
        let (w, from, to) = (e.translation, e.edge.from, e.edge.to);
        let offset = poses[from].rotation * e.pose.position;
        for (row, sign, other) in [(rows[from], -1.0, to), (rows[to], 1.0, from)] {
            if let Some(row) = row {
                matrix.add(BlockSlot::diagonal(row), |_, _| w);
                let known = if rows[other].is_none() { poses[other].position } else { DVec3::ZERO };
                add(row, w * (sign * offset + known));
            }
        }
        add_pair(system, &mut matrix, e.edge, rows, |_, _| -w);
    }
    matrix.factor()
}

/// Adds the block of (from, to), whichever triangle it is in.
fn add_pair(
    system: &BlockSystem,
    matrix: &mut BlockMatrix<'_>,
    edge: &Displacement,
    rows: &IdVec<VertexId, Option<u32>>,
    entry: impl Fn(usize, usize) -> f64,
) {
    let Some((from, to)) = pair_of(edge, rows) else { return };
    let Some(slot) = system.slot(from.max(to), from.min(to)) else { return };
    if from > to { matrix.add(slot, entry) } else { matrix.add(slot, |a, b| entry(b, a)) }
}

/// Moves every component without a fixed taxel as a whole to where its contacts say it is (Wahba
/// 1965): the directions between touched points, touched normals and observed orientations vote for
/// the rotation.
fn align_to_contacts(observations: &Observations, poses: &mut Poses) {
    let components = components(observations, |_| true);
    let mut touches_of = vec![Vec::new(); components.len()];
    let of_taxel = component_of_taxels(&components, observations.taxels.len());
    for contact in observations.contacts.iter().filter(|c| c.measurement.rank(Model::Positions) > 0) {
        touches_of[of_taxel[contact.taxel]].push(contact);
    }
    for (component, touches) in components.iter().zip(&touches_of) {
        if component.fixed || touches.is_empty() {
            continue;
        }
        let pairs: Vec<(DVec3, DVec3)> =
            touches.iter().map(|c| (poses[c.taxel].position, observed_position(&c.measurement))).collect();
        let Correlation { from, to, matrix: mut votes } = Correlation::new(&pairs);
        // Points vote with their squared distance; directions as if they were as far apart as the
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

/// Where a contact puts its taxel.
fn observed_position(touch: &ContactMeasurement) -> DVec3 {
    match touch {
        ContactMeasurement::Position { position, .. }
        | ContactMeasurement::PositionNormal { position, .. } => *position,
        ContactMeasurement::Pose { offset, seen } => (seen.pose * offset.inverse()).position,
    }
}
