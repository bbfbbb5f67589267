//! Remeshing: a surface as triangles of one size, whose vertices can be taxels.
//!
//! Triangles of CAD describe how a surface bends, not where taxels are. [`remesh`] covers the same surface
//! with nearly equilateral triangles, a given spacing apart, as taxels are arranged `(cannata)`: edges that are
//! too long are split, those that are too short collapsed, the others flipped until vertices have six
//! neighbours, and vertices moved to the centre of their neighbours and back to the surface, in rounds
//! `(botsch2004)`. Before, needles of the surface are divided along their sides.
//!
//! Sharp edges (of more than 40 degrees) and rims are preserved: their vertices move only along them, and
//! their corners not at all. Those nearer to each other than half the spacing are details, and may merge.
//! Holes too small to be surrounded by three taxels are closed, and pin-holes of the new mesh; handles that are less than
//! three spacings around may be cut.
//! Strips between two rims that are narrower than a tenth of the spacing are removed, and cut where taxels on both
//! sides would be nearer to each other than a third of it.
//!
//! Where vertices would slide off a thin wall or a rod, some are fixed, so that details alone are lost.
//!
//! Not guaranteed: that all triangles are well shaped where details are smaller than the spacing, or that
//! walls keep their thickness where a surface bends too much for the spacing.

mod clip;
mod crumbs;
mod divide;
mod faces;
mod holes;
mod joints;
mod lost;
mod moves;
mod necks;
mod needles;
mod outer;
mod rounds;
mod seen;
mod sight;
mod surface;
mod thin;
mod tunnels;

use glam::DVec3;
use rayon::prelude::*;

use crate::bvh::BvhError;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{
    FillHoles, Halfedge, HalfedgeMesh, MeshError, TriMesh, fill_holes, fill_shorter, triangle_cross,
};
use crate::remesh::faces::{FLAT, Thin, height};
use crate::remesh::holes::{Filled, fill_again, opened};
use crate::remesh::joints::follow_links;
use crate::remesh::lost::{lost, pin};
use crate::remesh::moves::sharp_neighbours;
use crate::remesh::necks::open_necks;
use crate::remesh::rounds::{Freedom, Rounds};
use crate::remesh::surface::Surface;
use crate::run::{Cancelled, Run};
use crate::skin::{Patch, Skin, TaxelId};

pub use clip::clip;
pub use crumbs::drop_crumbs;
pub use outer::{LeftOut, keep_outer};

/// Edges between faces that turn by more are sharp: the cosine of 40 degrees.
const SHARP: f64 = 0.766_044_443_118_978;

/// A line has a corner where it turns by more: the cosine of 45 degrees.
const CORNER: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Faces of the surface lower than this fraction of the spacing are cracks between other faces: they are
/// removed first.
const CRACK: f64 = 1e-3;

/// Strips of the surface between two rims that are narrower than this fraction of the spacing are removed.
const NECK: f64 = 0.1;

/// Most times that the rounds start again with more fixed vertices.
const MAX_RESTARTS: usize = 2;

/// Most taxels of a patch.
const MAX_TAXELS: f64 = 1e6;

/// Why a surface cannot be remeshed.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum RemeshError {
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The triangles are not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A spacing that is not a positive finite length.
    #[error("a spacing of {spacing} m; a finite length above 0 is needed")]
    Spacing { spacing: f64 },
    /// A spacing that is far too small for the surface.
    #[error("a spacing of {spacing} m makes some {taxels:.0} taxels; at most {MAX_TAXELS} are made")]
    TooFine { spacing: f64, taxels: f64 },
    /// Edges far longer than the surface is wide.
    #[error(
        "a spacing of {spacing} m makes some {vertices:.0} vertices along edges, for {taxels:.0} taxels on the surface: \
         faces are far longer than wide, as if a vertex were in a wrong place"
    )]
    Needles { spacing: f64, vertices: f64, taxels: f64 },
    /// Another of these errors, in a patch of a skin.
    #[error("patch {patch:?}: {source}")]
    Patch { patch: String, source: Box<RemeshError> },
    /// A surface too far from the origin to be searched.
    #[error("its surface cannot be searched: {0}")]
    Surface(#[from] BvhError),
}

/// Covers the surface of a mesh with triangles whose edges are `spacing` metres long on average.
///
/// ```
/// use dermatome::{
///     mesh::{Adjacency, mean_edge_length, shapes},
///     remesh::remesh,
/// };
///
/// let coarse = shapes::ball(4, 0.1);
/// let fine = remesh(&coarse, 0.005)?;
/// let length = mean_edge_length(&fine, &Adjacency::new(&fine)?);
/// assert!((length / 0.005 - 1.0).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the mesh is not an oriented manifold, or the spacing is not a positive finite length or too small for it.
pub fn remesh(mesh: &TriMesh, spacing: f64) -> Result<TriMesh, RemeshError> {
    cover(mesh, spacing).map(|covered| covered.mesh)
}

/// A new mesh of a surface.
struct Covered {
    mesh: TriMesh,
    /// How many places apart from each other it lost, and how far the farthest point is from it, in m.
    lost: (usize, f64),
}

fn cover(mesh: &TriMesh, spacing: f64) -> Result<Covered, RemeshError> {
    if !(spacing.is_finite() && spacing > 0.0) {
        return Err(RemeshError::Spacing { spacing });
    }
    let mut mesh = mesh.clone();
    fill_shorter(&mut mesh, 3.0 * spacing)?;
    open_necks(&mut mesh, NECK * spacing, least_area(spacing))?;
    let (halfedges, _) = HalfedgeMesh::new(&mesh)?;
    check_count(&mesh, &halfedges, spacing)?;
    let positions = mesh.positions.clone();
    let surface = Surface::new(mesh)?;
    let mut rounds = Rounds::new(halfedges, positions, &surface, spacing);
    // Removes coincident vertices and vertices on edges, which many programs write.
    let height = CRACK * spacing;
    rounds.remove_thin(Thin { height, short: 5.0 * height, longest: f64::INFINITY, is_last: false });
    rounds.compact();
    rounds.sharp = sharp_edges(&rounds.mesh, &rounds.positions, spacing);
    let is_line = |h: &Halfedge| rounds.mesh.is_edge(*h) && rounds.is_sharp(*h);
    let ends = |h: Halfedge| [rounds.mesh.origin(h), rounds.mesh.target(h)];
    let segments: Vec<[VertexId; 2]> = rounds.mesh.halfedges().filter(is_line).map(ends).collect();
    let lines = Surface::of_segments(&rounds.positions, &segments);
    rounds.lines = lines.as_ref();
    rounds.freedom = freedoms(&rounds);
    rounds.divide_needles();
    rounds.split_surface();
    run_rounds(&rounds)
}

/// Runs the rounds, and again with more vertices fixed while parts of the surface are lost; takes the mesh that lost least.
fn run_rounds(start: &Rounds<'_>) -> Result<Covered, RemeshError> {
    let points = &start.positions;
    let mut pins = Vec::new();
    let mut trial = || -> Result<Covered, RemeshError> {
        let mut rounds = start.clone();
        pins.iter().for_each(|&pin| rounds.freedom[pin] = Freedom::Fixed);
        rounds.run();
        let mesh = without_pin_holes(rounds)?;
        let lost = lost(points, &mesh, start.spacing)?;
        let places = pin(&mut pins, &lost, points, start.spacing);
        Ok(Covered { mesh, lost: (places, lost.first().map_or(0.0, |&(_, distance)| distance)) })
    };
    let mut best = trial()?;
    let mut places = best.lost.0;
    for _ in 0..MAX_RESTARTS {
        if places == 0 {
            break;
        }
        // One that fails costs nothing that was reached before.
        let Ok(covered) = trial() else { break };
        places = covered.lost.0;
        if places < best.lost.0 {
            best = covered;
        }
    }
    Ok(best)
}

/// The mesh of the rounds, its pin-holes filled as of a mesh that is read from a file. A face that fills a corner between
/// three vertices in line has no height, and a map may give it any area at almost no energy.
fn without_pin_holes(mut rounds: Rounds<'_>) -> Result<TriMesh, RemeshError> {
    let mut mesh = TriMesh { triangles: rounds.mesh.triangles(), positions: rounds.positions.clone() };
    if fill_holes(&mut mesh, FillHoles::PinHoles)? == 0 {
        return Ok(mesh);
    }
    (rounds.mesh, _) = HalfedgeMesh::new(&mesh)?;
    rounds.sharp = sharp_edges(&rounds.mesh, &rounds.positions, rounds.spacing);
    rounds.remove_last_thin();
    rounds.compact();
    Ok(TriMesh { triangles: rounds.mesh.triangles(), positions: rounds.positions })
}

/// Refuses a spacing that would make too many vertices, on the surface or along its edges: all longer ones are split
/// before faces are merged. Faces as long as wide have at most three times as many there as on the surface.
fn check_count(mesh: &TriMesh, halfedges: &HalfedgeMesh, spacing: f64) -> Result<(), RemeshError> {
    // There are two triangles for each taxel.
    let taxels = mesh.area() / (0.75_f64.sqrt() * spacing * spacing);
    let edges = halfedges.halfedges().filter(|&h| halfedges.is_edge(h));
    let length = |h: Halfedge| mesh.positions[h.start(mesh)].distance(mesh.positions[h.end(mesh)]);
    let vertices = edges.map(length).filter(|length| *length > spacing).sum::<f64>() / spacing;
    if taxels > MAX_TAXELS {
        Err(RemeshError::TooFine { spacing, taxels })
    } else if vertices > 4.0 * taxels + 0.1 * MAX_TAXELS {
        Err(RemeshError::Needles { spacing, vertices, taxels })
    } else {
        Ok(())
    }
}

/// Whether each halfedge is on a sharp edge or a rim.
fn sharp_edges(
    mesh: &HalfedgeMesh,
    positions: &IdVec<VertexId, DVec3>,
    spacing: f64,
) -> IdVec<FaceId, [bool; 3]> {
    let normal = |face: FaceId| {
        let corners = mesh.corners(face).map(|v| positions[v]);
        // The normal of a face without height is rounding noise.
        let is_flat = height(corners) < FLAT * spacing;
        if is_flat { DVec3::ZERO } else { triangle_cross(corners).normalize_or_zero() }
    };
    let normals: IdVec<FaceId, DVec3> = mesh.face_ids().map(normal).collect();
    let is_sharp = |h: Halfedge| {
        let twin = mesh.twin(h);
        twin == Halfedge::NONE || {
            let [a, b] = [h, twin].map(|h| normals[h.face()]);
            a.dot(b) < SHARP && a != DVec3::ZERO && b != DVec3::ZERO
        }
    };
    mesh.face_ids().map(|face| [0, 1, 2].map(|side| is_sharp(Halfedge::new(face, side)))).collect()
}

/// A vertex between two sharp edges of about one direction may move along them; others with sharp edges are fixed.
fn freedoms(rounds: &Rounds<'_>) -> IdVec<VertexId, Freedom> {
    let at = &rounds.positions;
    let freedom = |v: VertexId| {
        let directions: Vec<DVec3> = sharp_neighbours(&rounds.mesh, &rounds.sharp, v)
            .map(|w| (at[w] - at[v]).normalize_or_zero())
            .collect();
        match directions[..] {
            [] => Freedom::Surface,
            [a, b] if -a.dot(b) > CORNER => Freedom::Line,
            _ => Freedom::Fixed,
        }
    };
    at.ids().map(freedom).collect()
}

/// The area of the hexagon around a taxel, in m^2: six triangles.
fn least_area(spacing: f64) -> f64 {
    6.0 * 0.75_f64.sqrt() / 2.0 * spacing * spacing
}

/// A remeshed skin.
#[derive(Debug, Clone, PartialEq)]
pub struct Remeshed {
    /// The skin. Ids count from 1 through all its taxels.
    pub skin: Skin,
    /// The names of the patches that are left out, since they are smaller than the hexagon around one taxel.
    pub left_out: Vec<String>,
    /// The patches with points of the surface farther than a spacing from the new mesh, and how far the farthest is,
    /// in m: parts thinner than the spacing may be lost.
    pub shrunk: Vec<(String, f64)>,
    /// The patches with holes that were filled and are open now, since more than 1000 taxels are around them or each
    /// triangulation needs an edge that is there already, and how many.
    pub unfilled: Vec<(String, usize)>,
}

/// Remeshes every patch of a skin, each with its spacing (m); see [`remesh`]. The taxels are new ones at
/// other positions; of the old ones only the links that they follow are kept, with weights interpolated linearly. Holes
/// that are filled ([`Patch::filled`]) are filled again, without taxels in them.
///
/// # Errors
/// As [`remesh`], with the name of the first such patch, and if it is cancelled.
///
/// # Panics
/// If there are fewer spacings than patches.
pub fn remesh_skin(skin: &Skin, spacings: &[f64], run: Run<'_>) -> Result<Remeshed, RemeshError> {
    let patches: Vec<(&Patch, f64)> =
        skin.patches.enumerate().map(|(id, patch)| (patch, spacings[id.index()])).collect();
    let (large, small): (Vec<_>, Vec<_>) =
        patches.into_iter().partition(|(patch, spacing)| patch.mesh.area() >= least_area(*spacing));
    let fresh = |&(patch, spacing): &(&Patch, f64)| {
        run.check()?;
        let Covered { mut mesh, lost } = cover(&opened(patch), spacing)?;
        let Filled { faces, open } = fill_again(&mut mesh, patch, spacing)?;
        let mut fresh = Patch { filled: faces, ..Patch::from_mesh(patch.name.clone(), patch.link, mesh) };
        follow_links(&mut fresh, patch)?;
        Ok((fresh, lost.1, open))
    };
    let made: Vec<Result<(Patch, f64, usize), RemeshError>> = large.par_iter().map(fresh).collect();
    run.check()?;
    let mut left_out: Vec<String> = small.iter().map(|(patch, _)| patch.name.clone()).collect();
    let (mut patches, mut shrunk, mut unfilled) = (IdVec::default(), Vec::new(), Vec::new());
    let mut id = 0_u32;
    for (made, (old, spacing)) in made.into_iter().zip(&large) {
        let in_patch = |e| RemeshError::Patch { patch: old.name.clone(), source: Box::new(e) };
        let (mut patch, farthest, open) = made.map_err(in_patch)?;
        if patch.mesh.area() < least_area(*spacing) {
            left_out.push(patch.name);
            continue;
        }
        if farthest > *spacing {
            shrunk.push((patch.name.clone(), farthest));
        }
        if open > 0 {
            unfilled.push((patch.name.clone(), open));
        }
        for own in patch.taxels.ids.iter_mut() {
            id = id.saturating_add(1);
            *own = TaxelId(id);
        }
        patches.push(patch);
    }
    Ok(Remeshed { skin: Skin { patches, ..skin.clone() }, left_out, shrunk, unfilled })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Adjacency, shapes};

    /// A lattice without one face, with a vertex in the middle of a side of the hole.
    #[test]
    fn a_hole_with_three_vertices_in_line_is_closed_without_a_flat_face() {
        let spacing = 0.01;
        let mut mesh = shapes::lattice(6, 6, spacing);
        let adjacency = Adjacency::new(&mesh).unwrap();
        let is_inner = |&face: &FaceId| mesh.triangles[face].iter().all(|&v| !adjacency.is_boundary(v));
        let face = mesh.triangles.ids().find(is_inner).unwrap();
        let across = adjacency.twin(Halfedge::new(face, 0)).unwrap();
        let [a, b, c] = [across, across.next(), across.previous()].map(|h| h.start(&mesh));
        let middle = mesh.positions.push(mesh.positions[a].midpoint(mesh.positions[b]));
        mesh.triangles[across.face()] = [a, middle, c];
        mesh.triangles[face] = [middle, b, c];
        let surface = Surface::new(mesh.clone()).unwrap();
        let (halfedges, _) = HalfedgeMesh::new(&mesh).unwrap();
        let sharp = sharp_edges(&halfedges, &mesh.positions, spacing);
        let rounds = Rounds { sharp, ..Rounds::new(halfedges, mesh.positions.clone(), &surface, spacing) };
        let closed = without_pin_holes(rounds).unwrap();
        assert_eq!(Adjacency::new(&closed).unwrap().boundary_loops().len(), 1);
        let lowest = closed.triangles.ids().map(|face| height(closed.corners(face))).fold(1.0, f64::min);
        assert!(lowest > 0.1 * spacing, "a face is {lowest} m high");
    }
}
