//! A map in the 32-bit numbers of a map file: measured there, so that a report describes what readers of the
//! file find; and kept one to one.

use glam::DVec2;

use crate::cut::PlaceId;
use crate::flatten::{crossing_vertices, distortion};
use crate::id::{IdVec, VertexId};
use crate::io::as_in_map_file;
use crate::map::{MapError, MapLevel};
use crate::mesh::{TriMesh, VertexCorners, boundary_edges};

/// Spacing of 32-bit numbers just below 1, the longer side of an image.
const UNIT: f64 = f32::EPSILON as f64 / 2.0;

/// How often the two sides of a slit are moved apart: by two units first, then by twice as many each time.
const TRIES: i32 = 8;

/// Measures a map in the numbers of a map file.
///
/// The two sides of a slit in flat skin may be nearer to each other than rounding. *Heuristic*: if rounding
/// makes them touch and the map itself is one to one, their vertices move inwards by a few units.
pub(super) fn measure_as_written(level: &mut MapLevel) -> Result<(), MapError> {
    let (mesh, uv) = as_in_map_file(level)?;
    level.distortion = distortion(&mesh, &uv);
    if level.distortion.crossings > 0 {
        let edges = boundary_edges(&mesh);
        if crossing_vertices(&edges, &level.opened_uv()).is_empty() {
            move_apart(level, &mesh, &edges, uv);
        }
    }
    Ok(())
}

/// Moves boundaries apart that meet on the rounded map `uv`; the map is unchanged if that does not help.
fn move_apart(level: &mut MapLevel, mesh: &TriMesh, edges: &[[VertexId; 2]], mut uv: IdVec<VertexId, DVec2>) {
    let corners = VertexCorners::new(level.corners().into_iter(), level.uv.len());
    let mut shifted = level.clone();
    for power in 1..=TRIES {
        let step = UNIT * level.frame.size.max_element() * f64::from(1 << power);
        for place in crossing_vertices(edges, &uv).into_iter().map(PlaceId::of_opened) {
            let around = corners.faces(place).flat_map(|face| shifted.places(face));
            let inwards: DVec2 =
                around.map(|other| (shifted.uv[other] - shifted.uv[place]).normalize_or_zero()).sum();
            let before = shifted.uv[place];
            shifted.uv[place] += step * inwards.normalize_or_zero();
            let mut faces = corners.faces(place).map(|face| shifted.uv_of(face));
            if faces.any(|[a, b, c]| (b - a).perp_dot(c - a) <= 0.0) {
                shifted.uv[place] = before;
            }
        }
        let Ok((_, rounded)) = as_in_map_file(&shifted) else { return };
        shifted.distortion = distortion(mesh, &rounded);
        if shifted.distortion.crossings == 0 {
            *level = shifted;
            return;
        }
        uv = rounded;
    }
}
