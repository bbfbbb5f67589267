//! Closes small holes with triangles of least area.

use std::{collections::HashMap, f64::consts::PI};

use glam::DVec3;

use crate::id::VertexId;
use crate::mesh::{Adjacency, Halfedge, MeshError, TriMesh, boundary_loops, loop_length, triangle_cross};

/// A loop is not an outer boundary if its squared length is below this share of the area: a disk has at least
/// 12.6 times its area, the open end of a finger 0.3 times if the finger is ten times as long as thick.
const NEARLY_CLOSED: f64 = 0.1;

/// Which holes of a surface are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FillHoles {
    /// None.
    #[default]
    None,
    /// Pin-holes: of at most five edges, where the triangles continue the surface and are not needles, such
    /// as a face that is missing in a scan; not the end of a tube. The only hole of a closed body counts,
    /// whatever its shape, unless it is a line.
    PinHoles,
    /// All of at most this many edges.
    UpTo(usize),
}

impl FillHoles {
    /// The largest number of edges of a hole that may be filled.
    pub(crate) const fn most_edges(self) -> usize {
        match self {
            Self::None => 0,
            Self::PinHoles => 5,
            Self::UpTo(edges) => edges,
        }
    }
}

/// A hole is a slit, which only needles can fill, if its roundness is below this: 1 is a circle, 0.79 a
/// square, 0.1 a rectangle 30 times as long as it is wide.
const MIN_ROUNDNESS: f64 = 0.1;

/// The only hole of a closed body is a line, which faces without area would fill, if its roundness is below this.
const MIN_ROUNDNESS_OF_ONLY: f64 = 1e-5;

/// Cosine of the angle, 60 degrees, by which the triangles of a pin-hole may bend the surface along half
/// of its rim: a cap of a tube bends it by 90.
const MIN_BEND_COSINE: f64 = 0.5;

/// A hole, and the triangles between its vertices that close it.
#[derive(Debug, Clone)]
pub(crate) struct Filling {
    /// The boundary loop, faces on the left.
    pub(crate) hole: Vec<VertexId>,
    pub(crate) triangles: Vec<[VertexId; 3]>,
}

/// Closes the holes that `which` selects; returns how many.
pub(crate) fn fill_holes(mesh: &mut TriMesh, which: FillHoles) -> Result<usize, MeshError> {
    let fillings = fillings(mesh, which)?;
    for &t in fillings.iter().flat_map(|filling| &filling.triangles) {
        mesh.triangles.push(t);
    }
    Ok(fillings.len())
}

/// [`fill_shorter`] closes no hole of more edges: time grows with their cube.
#[cfg(feature = "robots")]
const MOST_EDGES: usize = 100;

/// Closes the holes whose rims are shorter than `length` (m).
#[cfg(feature = "robots")]
pub(crate) fn fill_shorter(mesh: &mut TriMesh, length: f64) -> Result<(), MeshError> {
    let mut fillings = fillings(mesh, FillHoles::UpTo(MOST_EDGES))?;
    fillings.retain(|filling| loop_length(mesh, &filling.hole) < length);
    fillings.iter().flat_map(|filling| &filling.triangles).for_each(|&t| _ = mesh.triangles.push(t));
    Ok(())
}

/// Closes these boundary loops, with faces lower than `lowest` (m) only where there are no others; returns how many.
#[cfg(feature = "robots")]
pub(crate) fn fill_loops(
    mesh: &mut TriMesh,
    loops: Vec<Vec<VertexId>>,
    lowest: f64,
) -> Result<usize, MeshError> {
    let adjacency = Adjacency::new(mesh)?;
    let filled = |walk: Vec<VertexId>| {
        // Any other triangulation is cheaper than one with a low face more.
        let low = loop_length(mesh, &walk).powi(2);
        let cost = |corners: [DVec3; 3]| {
            let (area, [a, b, c]) = (area(corners), corners);
            let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
            area + if 2.0 * area < lowest * longest { low } else { 0.0 }
        };
        least(mesh, &adjacency, &walk, cost)
    };
    let all: Vec<_> = loops.into_iter().filter_map(filled).collect();
    all.iter().flatten().for_each(|&t| _ = mesh.triangles.push(t));
    Ok(all.len())
}

/// The holes that `which` selects, with their triangulations of least area `(barequet1995)` without edges of
/// the mesh; a hole without such a triangulation stays open.
///
/// The longest loop is the outer boundary, not a hole, unless the surface is closed but for it. Time
/// grows with the cube of the edges of a hole.
pub(crate) fn fillings(mesh: &TriMesh, which: FillHoles) -> Result<Vec<Filling>, MeshError> {
    let mut loops = boundary_loops(mesh);
    let is_only = loops.len() == 1;
    let length = |i: usize| loop_length(mesh, &loops[i]);
    let outer = (0..loops.len()).max_by(|&i, &j| length(i).total_cmp(&length(j)).then(j.cmp(&i)));
    if let Some(outer) = outer.filter(|&i| length(i).powi(2) >= NEARLY_CLOSED * mesh.area()) {
        loops.remove(outer);
    }
    loops.retain(|walk| walk.len() <= which.most_edges());
    if loops.is_empty() {
        return Ok(Vec::new());
    }
    let adjacency = Adjacency::new(mesh)?;
    let mut inside = HashMap::new();
    for (face, corners) in mesh.triangles.enumerate() {
        let at_rim = |&side: &usize| adjacency.twin(Halfedge::new(face, side)).is_none();
        inside.extend((0..3).filter(at_rim).map(|side| (corners[side], *corners)));
    }
    let filling = |hole: Vec<VertexId>| {
        let triangles = least_area(mesh, &adjacency, &hole)?;
        let is_round = |least: f64| roundness(mesh, &hole, &triangles) >= least;
        let is_wanted = which != FillHoles::PinHoles
            || is_only && is_round(MIN_ROUNDNESS_OF_ONLY)
            || is_round(MIN_ROUNDNESS) && continues_surface(mesh, &inside, &hole, &triangles);
        is_wanted.then_some(Filling { hole, triangles })
    };
    Ok(loops.into_iter().filter_map(filling).collect())
}

/// The area of the triangles in a hole over that of a circle with the same rim.
fn roundness(mesh: &TriMesh, walk: &[VertexId], fill: &[[VertexId; 3]]) -> f64 {
    let area = |t: &[VertexId; 3]| 0.5 * triangle_cross(t.map(|v| mesh.positions[v])).length();
    4.0 * PI * fill.iter().map(area).sum::<f64>() / loop_length(mesh, walk).powi(2)
}

/// Whether the triangles in a hole continue the surface along half of its rim.
///
/// `inside` has the face at the boundary edge that leaves each vertex of a loop.
fn continues_surface(
    mesh: &TriMesh,
    inside: &HashMap<VertexId, [VertexId; 3]>,
    walk: &[VertexId],
    fill: &[[VertexId; 3]],
) -> bool {
    let cross = |t: &[VertexId; 3]| triangle_cross(t.map(|v| mesh.positions[v]));
    let rim = loop_length(mesh, walk);
    let direction = |t: &[VertexId; 3]| cross(t).normalize_or_zero();
    let smooth = walk.iter().zip(walk.iter().cycle().skip(1)).filter(|&(a, b)| {
        let of_edge = |t: &&[VertexId; 3]| t.contains(a) && t.contains(b);
        let outside = fill.iter().find(of_edge).map_or(DVec3::ZERO, direction);
        inside.get(a).is_some_and(|t| direction(t).dot(outside) >= MIN_BEND_COSINE)
    });
    let length = smooth.map(|(&a, &b)| mesh.positions[a].distance(mesh.positions[b])).sum::<f64>();
    length >= 0.5 * rim
}

/// The triangles of least total area that close a loop; `None` if each needs an edge the mesh
/// already has.
fn least_area(mesh: &TriMesh, adjacency: &Adjacency, walk: &[VertexId]) -> Option<Vec<[VertexId; 3]>> {
    least(mesh, adjacency, walk, area)
}

fn area(corners: [DVec3; 3]) -> f64 {
    0.5 * triangle_cross(corners).length()
}

/// The triangles of least total cost that close a loop.
fn least(
    mesh: &TriMesh,
    adjacency: &Adjacency,
    walk: &[VertexId],
    cost: impl Fn([DVec3; 3]) -> f64,
) -> Option<Vec<[VertexId; 3]>> {
    // The mesh is on the left of the loop, so the hole is walked in reverse.
    let rim: Vec<VertexId> = walk.iter().rev().copied().collect();
    let n = rim.len();
    let is_free = |i: usize, j: usize| {
        j == i + 1 || (i == 0 && j == n - 1) || !adjacency.ring(rim[i]).contains(&rim[j])
    };
    let at: Vec<DVec3> = rim.iter().map(|&v| mesh.positions[v]).collect();
    let triangles = triangles_of_least(&at, is_free, cost)?;
    Some(triangles.into_iter().map(|t| t.map(|k| rim[k])).collect())
}

/// The triangles of least total area between the corners of a closed line, from edges that are free, by the numbers of their
/// ends, the smaller first; `None` if there are none. Takes time with the cube of the number of corners.
#[doc(hidden)]
pub fn triangles_of_least_area(
    at: &[DVec3],
    is_free: impl Fn(usize, usize) -> bool,
) -> Option<Vec<[usize; 3]>> {
    triangles_of_least(at, is_free, area)
}

fn triangles_of_least(
    at: &[DVec3],
    is_free: impl Fn(usize, usize) -> bool,
    cost_of: impl Fn([DVec3; 3]) -> f64,
) -> Option<Vec<[usize; 3]>> {
    let n = at.len();
    let mut cost = vec![f64::INFINITY; n * n];
    let mut apex = vec![usize::MAX; n * n];
    for i in 0..n - 1 {
        cost[i * n + i + 1] = 0.0;
    }
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            if !is_free(i, j) {
                continue;
            }
            for k in i + 1..j {
                let total = cost[i * n + k] + cost[k * n + j] + cost_of([at[i], at[k], at[j]]);
                if total < cost[i * n + j] {
                    (cost[i * n + j], apex[i * n + j]) = (total, k);
                }
            }
        }
    }
    if !cost[n - 1].is_finite() {
        return None;
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut spans = vec![(0, n - 1)];
    while let Some((i, j)) = spans.pop() {
        if j > i + 1 {
            let k = apex[i * n + j];
            triangles.push([i, k, j]);
            spans.extend([(i, k), (k, j)]);
        }
    }
    Some(triangles)
}
