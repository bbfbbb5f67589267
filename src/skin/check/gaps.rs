//! *Heuristic*: boundaries so close that they look like a seam that was not joined.

use std::collections::{BTreeSet, HashMap, HashSet};

use glam::{DVec3, I64Vec3};

use crate::{
    id::{IdVec, VertexId},
    skin::check::{
        FindingKind,
        report::{Report, Subject, numbers},
    },
};

/// Two boundaries closer than this share of the local spacing look like a seam that was not joined.
/// Modules that are meant to stay apart keep at least one spacing.
const SEAM: f64 = 0.5;

/// Edges this much longer than a vertex's spacing (as a power of two) are not looked for around it.
const LEVELS_UP: i32 = 8;

/// Where more cells and edges than this crowd around one vertex the rest is not looked at: a heap
/// of coincident faces would take quadratic time. A seam has some ten edges around each vertex.
const MOST_CANDIDATES: usize = 2048;

/// A boundary edge.
type Ends = [VertexId; 2];

/// Notes vertices of the boundary that lie close to an edge of the boundary they are not joined
/// with.
pub(super) fn check_gaps(subject: &Subject<'_>, report: &mut Report<'_>) {
    let mesh = &subject.surface.mesh;
    // Both sides of a cut are one place.
    let place = |v| subject.surface.place_of(v);
    let mut boundary: Vec<Ends> = Vec::new();
    let mut on_boundary = IdVec::<VertexId, bool>::filled(false, mesh.positions.len());
    for uses in subject.surface.edges.iter() {
        if let &[h] = uses {
            let ends = [h.start(mesh), h.end(mesh)];
            ends.iter().for_each(|&v| on_boundary[v] = true);
            boundary.push(ends);
        }
    }
    // Mean length of the edges at each vertex of the boundary, and which of these vertices are
    // neighbours.
    let mut lengths = IdVec::<VertexId, (f64, u32)>::filled((0.0, 0), mesh.positions.len());
    let mut joined: HashSet<Ends> = HashSet::new();
    for uses in subject.surface.edges.iter() {
        let ends = [uses[0].start(mesh), uses[0].end(mesh)];
        let length = mesh.positions[ends[0]].distance(mesh.positions[ends[1]]);
        for v in ends {
            lengths[v].0 += length;
            lengths[v].1 += 1;
        }
        if ends.iter().all(|&v| on_boundary[v]) {
            let ends = ends.map(place);
            joined.insert(ends);
            joined.insert([ends[1], ends[0]]);
        }
    }
    let grid = Grid::new(&mesh.positions, &boundary);
    let mut close = Vec::new();
    let mut narrowest = f64::INFINITY;
    for v in mesh.positions.ids().filter(|&v| on_boundary[v]) {
        let reach = SEAM * lengths[v].0 / f64::from(lengths[v].1);
        let is_apart =
            |e: Ends| e.map(place).iter().all(|&w| w != place(v) && !joined.contains(&[place(v), w]));
        if let Some(distance) = grid.nearest(&mesh.positions, mesh.positions[v], reach, is_apart) {
            close.push(v);
            narrowest = narrowest.min(distance);
        }
    }
    report.add(FindingKind::Gap, numbers(close.iter().map(|&v| subject.surface.in_file(v).raw())), |n| {
        format!(
            "{n} boundary vertices lie within half the local spacing of a boundary they are not joined with, \
             the nearest at {:.3} mm: a seam that was not closed, or a part laid over another",
            1e3 * narrowest
        )
    });
}

/// Boundary edges by size and place: edges between `2^level` and twice that lie in cells of twice
/// that.
#[derive(Debug)]
struct Grid {
    cells: HashMap<(i32, I64Vec3), Vec<Ends>>,
    levels: BTreeSet<i32>,
}

impl Grid {
    fn new(positions: &IdVec<VertexId, DVec3>, edges: &[Ends]) -> Self {
        let mut cells: HashMap<_, Vec<Ends>> = HashMap::new();
        let mut levels = BTreeSet::new();
        for &[a, b] in edges {
            let (a_at, b_at) = (positions[a], positions[b]);
            if let Some(level) = level_of(a_at.distance(b_at)) {
                levels.insert(level);
                cells.entry((level, cell_of(a_at.midpoint(b_at), level))).or_default().push([a, b]);
            }
        }
        Self { cells, levels }
    }

    /// Distance of `point` to the nearest edge for which `allowed` holds, if that is below `reach`.
    fn nearest(
        &self,
        positions: &IdVec<VertexId, DVec3>,
        point: DVec3,
        reach: f64,
        allowed: impl Fn(Ends) -> bool,
    ) -> Option<f64> {
        let own = level_of(reach)?;
        let mut nearest = None;
        let mut candidates = 0;
        // Edges shorter than the reach belong to much denser skin, whose vertices find this place
        // from their side.
        for &level in self.levels.range(own..=own + LEVELS_UP) {
            let size = cell_size(level);
            let radius = reach + 0.5 * size;
            let (low, high) = (cell_of(point - radius, level), cell_of(point + radius, level));
            for cell in cells_between(low, high) {
                candidates += 1;
                for &[a, b] in self.cells.get(&(level, cell)).into_iter().flatten() {
                    candidates += 1;
                    if candidates > MOST_CANDIDATES {
                        return nearest;
                    }
                    let distance = distance_to_segment(point, positions[a], positions[b]);
                    if distance < nearest.unwrap_or(reach) && allowed([a, b]) {
                        nearest = Some(distance);
                    }
                }
            }
        }
        nearest
    }
}

/// The power of two below a length; `None` where there is no such thing.
fn level_of(length: f64) -> Option<i32> {
    // Outside of this range squares of lengths overflow or underflow.
    let is_usable = length > 1e-100 && length < 1e100;
    #[expect(clippy::cast_possible_truncation, reason = "the logarithm is within 333 of zero")]
    is_usable.then(|| length.log2().floor() as i32)
}

fn cell_size(level: i32) -> f64 {
    2.0 * f64::from(level).exp2()
}

fn cell_of(point: DVec3, level: i32) -> I64Vec3 {
    // Saturates where the part is more than 2^63 cells wide: far cells then fall together, and are
    // still searched.
    (point / cell_size(level)).floor().as_i64vec3()
}

fn cells_between(low: I64Vec3, high: I64Vec3) -> impl Iterator<Item = I64Vec3> {
    let column = move |x, y| (low.z..=high.z).map(move |z| I64Vec3::new(x, y, z));
    (low.x..=high.x).flat_map(move |x| (low.y..=high.y).flat_map(move |y| column(x, y)))
}

fn distance_to_segment(point: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let t = ((point - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    // NaN for edges without length, which then are near nothing.
    point.distance(a + t * along)
}
