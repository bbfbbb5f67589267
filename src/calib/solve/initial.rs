use std::collections::VecDeque;

use glam::{DMat3, DQuat, DVec3};

use crate::{
    calib::{
        CalibError, ContactMeasurement, Displacement, DisplacementMeasurement, Information, Model,
        Observations, Pose, RelativePose,
        geometry::pose::outer,
        observations::graph::{component_of_taxels, components},
        solve::normal_equations::{State, number_rows, pair_of, row_pairs},
    },
    id::{IdVec, VertexId},
    numeric::symmetric_eigen,
    sparse::{BlockFactor, BlockSlot, BlockSystem, Pattern, SparseError},
};

/// Where the optimisation starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Initialization {
    /// Rotations as if they were free matrices, then projected, then translations: two linear systems (Martinec and
    /// Pajdla 2007, Carlone et al. 2015). Along a spanning tree where that has no solution.
    #[default]
    Chordal,
    /// Observations chained along a breadth-first spanning tree.
    SpanningTree,
    /// The initial values of the taxels.
    InitialValues,
}

/// Taxels that keep their place while the start is computed: fixed ones, and the gauge taxel of every component
/// without.
fn anchors(observations: &Observations) -> IdVec<VertexId, bool> {
    let mut anchors = observations.taxels.map(|t| t.fixed);
    for component in components(observations, |_| true) {
        if !component.fixed {
            anchors[component.gauge] = true;
        }
    }
    anchors
}

/// A start of the wanted kind. Positions are linear: they need none.
pub(crate) fn start(observations: &Observations, kind: Initialization) -> Result<State, CalibError> {
    let mut state = match kind {
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
            Ok(state) => state,
            // Rotations that nothing determines in the relaxed problem: chain them instead.
            Err(SparseError::NotPositiveDefinite { .. } | SparseError::NotFinite { .. }) => {
                spanning_tree(observations)
            }
            Err(other) => return Err(CalibError::Sparse(other)),
        },
        Initialization::SpanningTree => spanning_tree(observations),
    };
    align_to_contacts(observations, &mut state);
    Ok(state)
}

/// A start in which every taxel without initial value is at the origin.
fn initial_or_origin(observations: &Observations) -> State {
    observations.taxels.map(|t| {
        let pose = t.initial.unwrap_or(Pose::IDENTITY);
        match observations.model {
            Model::Positions => Pose { rotation: DQuat::IDENTITY, ..pose },
            Model::Poses => pose,
        }
    })
}

/// Chains observations breadth first, from the anchors outwards, in the order of the edges.
pub(crate) fn spanning_tree(observations: &Observations) -> State {
    let mut state = initial_or_origin(observations);
    let mut neighbours: IdVec<VertexId, Vec<_>> = observations.taxels.map(|_| Vec::new());
    for edge in observations.edges.iter().filter(|e| e.is_observed()) {
        neighbours[edge.from].push(edge);
        neighbours[edge.to].push(edge);
    }
    let mut reached = anchors(observations);
    let mut open: VecDeque<VertexId> = reached.enumerate().filter(|(_, a)| **a).map(|(v, _)| v).collect();
    while let Some(v) = open.pop_front() {
        for edge in &neighbours[v] {
            let other = if edge.from == v { edge.to } else { edge.from };
            if reached[other] {
                continue;
            }
            state[other] = match &edge.measurement {
                DisplacementMeasurement::Offset { offset, .. } => {
                    let sign = if edge.from == v { 1.0 } else { -1.0 };
                    Pose::at(state[v].position + sign * *offset)
                }
                DisplacementMeasurement::Relative(m) if edge.from == v => state[v] * m.pose,
                DisplacementMeasurement::Relative(m) => state[v] * m.pose.inverse(),
            };
            reached[other] = true;
            open.push_back(other);
        }
    }
    state
}

/// The two linear systems of a chordal start: both have one block row for every taxel that is no anchor.
fn chordal(observations: &Observations) -> Result<State, SparseError> {
    let mut state = initial_or_origin(observations);
    let anchors = anchors(observations);
    let (rows, count) = number_rows(observations, |v| !anchors[v]);
    if count == 0 {
        return Ok(state);
    }
    let edges = relative_edges(observations);
    let pattern = Pattern::new(count, row_pairs(observations, &rows));

    let system = BlockSystem::new(pattern.clone(), 3)?;
    let mut rhs = vec![0.0; 9 * count];
    rotations_system(&system, &edges, &rows, &state, &mut rhs)?.solve(&mut rhs, 3)?;
    for (v, row) in rows.enumerate() {
        if let Some(row) = row {
            let entry = |a: usize, b: usize| rhs[3 * count * a + 3 * *row as usize + b];
            let column = |b: usize| DVec3::new(entry(0, b), entry(1, b), entry(2, b));
            state[v].rotation = nearest_rotation(&DMat3::from_cols(column(0), column(1), column(2)));
        }
    }
    let system = BlockSystem::new(pattern, 1)?;
    let mut rhs = vec![0.0; 3 * count];
    translations_system(&system, &edges, &rows, &state, &mut rhs)?.solve(&mut rhs, 3)?;
    for (v, row) in rows.enumerate() {
        if let Some(row) = row {
            state[v].position = DVec3::from_array(std::array::from_fn(|c| rhs[count * c + *row as usize]));
        }
    }
    Ok(state)
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
    let weigh = |m: &RelativePose| [mean(&m.information, 3), mean(&m.information, 0)];
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

/// `sum w |R_j - R_i Z|^2`: the three rows of every `R` are unknown, each alike, so they are three right-hand sides.
fn rotations_system<'s>(
    system: &'s BlockSystem,
    edges: &[Weighted<'_>],
    rows: &IdVec<VertexId, Option<u32>>,
    state: &State,
    rhs: &mut [f64],
) -> Result<BlockFactor<'s>, SparseError> {
    let mut matrix = system.zero();
    let columns = rhs.len() / 3;
    // Adds `w M` to the right-hand side of a taxel: row `a` of the matrix belongs to right-hand side `a`.
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
            (None, Some(row)) => add(row, DMat3::from_quat(state[e.edge.from].rotation) * z, w),
            (Some(row), None) => add(row, DMat3::from_quat(state[e.edge.to].rotation) * z.transpose(), w),
            (None, None) => {}
        }
    }
    matrix.factor()
}

/// `sum w |p_j - p_i - R_i z|^2` with the rotations of `state`.
fn translations_system<'s>(
    system: &'s BlockSystem,
    edges: &[Weighted<'_>],
    rows: &IdVec<VertexId, Option<u32>>,
    state: &State,
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
        let offset = state[from].rotation * e.pose.position;
        for (row, sign, other) in [(rows[from], -1.0, to), (rows[to], 1.0, from)] {
            if let Some(row) = row {
                matrix.add(BlockSlot::diagonal(row), |_, _| w);
                let known = if rows[other].is_none() { state[other].position } else { DVec3::ZERO };
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
    matrix: &mut crate::sparse::BlockMatrix<'_>,
    edge: &Displacement,
    rows: &IdVec<VertexId, Option<u32>>,
    entry: impl Fn(usize, usize) -> f64,
) {
    let Some((from, to)) = pair_of(edge, rows) else { return };
    let Some(slot) = system.slot(from.max(to), from.min(to)) else { return };
    if from > to { matrix.add(slot, entry) } else { matrix.add(slot, |a, b| entry(b, a)) }
}

/// The rotation nearest to a matrix in the sum of squares: the largest eigenvector of Horn's matrix (1987), which
/// cannot become a reflection.
pub(crate) fn nearest_rotation(m: &DMat3) -> DQuat {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let (xx, xy, xz) = (x.x, y.x, z.x);
    let (yx, yy, yz) = (x.y, y.y, z.y);
    let (zx, zy, zz) = (x.z, y.z, z.z);
    let k = [
        [xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, yy - xx - zz, yz + zy, xz - zx],
        [xz + zx, yz + zy, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ];
    let (values, vectors) = symmetric_eigen(&k);
    let best = (0..4).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(3);
    let q = DQuat::from_xyzw(vectors[0][best], vectors[1][best], vectors[2][best], vectors[3][best]);
    if q.w < 0.0 { -q } else { q }.normalize()
}

/// Moves every component without a fixed taxel as a whole to where its contacts say it is (Wahba 1965): the
/// directions between touched points, touched normals and observed orientations vote for the rotation.
fn align_to_contacts(observations: &Observations, state: &mut State) {
    let components = components(observations, |_| true);
    let mut touches_of = vec![Vec::new(); components.len()];
    let of_taxel = component_of_taxels(&components, observations.taxels.len());
    for contact in observations.contacts.iter().filter(|c| pulls(&c.measurement)) {
        touches_of[of_taxel[contact.taxel]].push(contact);
    }
    for (component, touches) in components.iter().zip(&touches_of) {
        if component.fixed || touches.is_empty() {
            continue;
        }
        let count = touches.len() as f64;
        let pairs: Vec<_> =
            touches.iter().map(|c| (state[c.taxel].position, observed_position(&c.measurement))).collect();
        let from = pairs.iter().map(|p| p.0).sum::<DVec3>() / count;
        let to = pairs.iter().map(|p| p.1).sum::<DVec3>() / count;
        let mut votes: DMat3 =
            pairs.iter().map(|p| outer(p.1 - to, p.0 - from)).fold(DMat3::ZERO, |sum, m| sum + m);
        // Points vote with their squared distance; directions as if they were as far apart as the points.
        let spread = pairs.iter().map(|p| p.0.distance_squared(from)).sum::<f64>() / count;
        let scale = if spread > 0.0 { spread } else { 1.0 };
        for contact in touches {
            let at = state[contact.taxel].rotation;
            match &contact.measurement {
                ContactMeasurement::PositionNormal { normal, .. } => {
                    votes += outer(*normal, at * DVec3::Z) * scale
                }
                ContactMeasurement::Pose(prior) => {
                    let seen = prior.pose.rotation * prior.offset.rotation.conjugate();
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
            let pose = &mut state[v];
            pose.position = rotation * (pose.position - from) + to;
            pose.rotation = (rotation * pose.rotation).normalize();
        }
    }
}

fn pulls(touch: &ContactMeasurement) -> bool {
    match touch {
        ContactMeasurement::Position { information, .. }
        | ContactMeasurement::PositionNormal { information, .. } => information.rank() > 0,
        ContactMeasurement::Pose(prior) => prior.information.rank() > 0,
    }
}

/// Where a contact puts its taxel.
fn observed_position(touch: &ContactMeasurement) -> DVec3 {
    match touch {
        ContactMeasurement::Position { position, .. }
        | ContactMeasurement::PositionNormal { position, .. } => *position,
        ContactMeasurement::Pose(prior) => (prior.pose * prior.offset.inverse()).position,
    }
}
