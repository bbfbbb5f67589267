//! Opens a patch for its map, and maps one patch without a pyramid.

use crate::{
    Error,
    cut::{Cut, CutError, CutMesh, MOST_SLITS, seam_length},
    flatten::{Boundary, Convergence, FlattenOptions, demanded_area_ratio, flatten_charts},
    id::{IdVec, VertexId},
    mesh::{Parts, TriMesh},
    pipeline::{
        charts::Divider,
        choose_cut::{choose_cut, keep_ratio},
    },
    skin::Patch,
};

/// Cuts a patch open where that is needed or worth it, from trial maps; `None` for a patch that is
/// mapped as it is. `options` are those of its map, for [`Cut::AreaRatio`], which may cut it into
/// several pieces, its charts.
///
/// # Errors
/// If the mesh is not an oriented manifold in one piece, not a disk with holes after the cut, or no
/// cut keeps the area ratio asked for.
pub fn cut_open(patch: &Patch, cut: &Cut, options: &FlattenOptions) -> Result<Option<CutMesh>, Error> {
    let Patch { mesh, taxels, .. } = patch;
    let Cut::AreaRatio(wanted) = *cut else { return choose_cut(mesh, taxels, cut, options) };
    let asked = demanded_area_ratio(mesh, taxels, options)?;
    if asked > wanted {
        return Err(CutError::AreasAsked { asked, wanted }.into());
    }
    let whole = keep_ratio(mesh, taxels, options, wanted, MOST_SLITS)?;
    if whole.is_within(wanted) {
        return Ok(whole.cut);
    }
    if options.boundary != Boundary::Free {
        return Err(CutError::AreaRatio { found: whole.area_ratio, charts: 1, wanted }.into());
    }
    Divider::new(patch, options, wanted)?.divide().map(Some)
}

/// A mesh with its map, cut open where that was needed.
#[derive(Debug, Clone, PartialEq)]
pub struct FlatMesh {
    /// The mesh; where it was cut, the vertices of the seam are there once for each of their places
    /// on the map: the copies come last.
    pub mesh: TriMesh,
    /// The vertex of the uncut mesh that each vertex is.
    pub unsplit: IdVec<VertexId, VertexId>,
    /// Map positions, in m.
    pub uv: IdVec<VertexId, glam::DVec2>,
    /// Length of the seam, in m.
    pub seam: f64,
    /// Number of charts: the pieces of the mesh.
    pub charts: usize,
    /// How near the map is to a minimum of its energy.
    pub convergence: Convergence,
}

/// Flattens one patch at full precision, without a pyramid.
///
/// ```
/// use dermatome::{cut::Cut, mesh::shapes, pipeline::flatten_patch, skin::{PatchId, Skin}};
///
/// // A torus has no map before it is cut open.
/// let skin = Skin::from_mesh("ring", shapes::torus(24, 12, 0.05, 0.02));
/// let flat = flatten_patch(&skin.patches[PatchId::new(0)], &Cut::Auto, &Default::default())?;
/// assert!(flat.seam > 0.0 && flat.uv.len() > flat.unsplit.len() - 80);
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Errors
/// If the patch cannot be cut as asked, or not be flattened.
pub fn flatten_patch(patch: &Patch, cut: &Cut, options: &FlattenOptions) -> Result<FlatMesh, Error> {
    options.validate()?;
    let opened = cut_open(patch, cut, options)?;
    let (mesh, unsplit, seam) = match opened {
        None => (patch.mesh.clone(), patch.mesh.positions.ids().collect(), 0.0),
        Some(cut) => {
            let seam = seam_length(&patch.mesh, &cut.seam(&patch.mesh)?);
            (cut.mesh(&patch.mesh.positions), cut.unsplit, seam)
        }
    };
    let taxels = patch.taxels.select(&unsplit);
    let (uv, convergence) = flatten_charts(&mesh, Some(&taxels), options)?;
    let charts = Parts::of_components(&mesh).len();
    Ok(FlatMesh { mesh, unsplit, uv, seam, charts, convergence })
}
