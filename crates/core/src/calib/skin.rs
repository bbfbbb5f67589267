//! From a calibration to a skin: the triangles that the displacements form, or given ones,
//! assembled by `skin::assemble` and turned outwards.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use crate::{
    calib::{CalibError, Calibration, ContactMeasurement, DisplacementId, Model, Observations, SheetDefect},
    id::{FaceId, IdVec, VertexId},
    mesh::Edges,
    skin::{
        AssembleOptions, Assembled, Draft, Patch, Remark, RemarkKind, Sheet, Skin, SkinError, TaxelId, Weld,
        assemble,
    },
};

/// A skin of calibrated taxels, and the taxels that are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedSkin {
    /// The skin: one patch for each connected sheet, on one link at the origin.
    pub skin: Skin,
    /// Taxels that no triangle uses: they are left out of the skin.
    pub left_out: Vec<VertexId>,
    /// Other changes by [`assemble`]; vertices are those of the observations.
    pub remarks: Vec<Remark>,
    /// Patches whose outside is not determined: it is assumed away from the origin.
    pub assumed: usize,
    /// Patches whose given triangles were inside out and were reversed.
    pub turned: usize,
}

/// Meshes calibrated taxels with given triangles, or with those that their edges form.
///
/// Normals are those of the triangles in the positions model, which gives no tangents; in the poses model
/// they are the z axes of the taxel frames, and tangents the x axes. The outside of each sheet is where its
/// taxel frames or contact normals point; without either, the outside of given triangles; without these, away
/// from the origin. Edges without information form no triangle. Rejected edges do, unless the triangles are
/// not a surface then.
///
/// ```
/// use dermatome::calib::{CalibOptions, SimulateOptions, calibrate, calibrated_skin, simulate};
///
/// let simulation = simulate(&SimulateOptions { taxels: 50, ..SimulateOptions::default() })?;
/// let observations = &simulation.observations;
/// let found = calibrate(observations, &CalibOptions::default())?;
/// let made = calibrated_skin(&found, observations, None)?;
/// let patch = made.skin.patches.iter().next().expect("one sheet");
/// assert_eq!(patch.mesh.triangles.len(), simulation.mesh.triangles.len());
/// # Ok::<(), dermatome::calib::CalibError>(())
/// ```
///
/// # Errors
/// [`CalibError::BadTriangles`] and [`CalibError::NoTriangulation`] if given triangles, or those of the
/// edges, are not an orientable manifold or there are none; triangles of the edges must not form a closed
/// surface either.
pub fn calibrated_skin(
    calibration: &Calibration,
    observations: &Observations,
    triangles: Option<&[[VertexId; 3]]>,
) -> Result<CalibratedSkin, CalibError> {
    let Assembled { mut skin, remarks } = match triangles {
        Some(given) => assembled(calibration, given).map_err(CalibError::BadTriangles)?,
        None => of_edges(calibration, observations).map_err(CalibError::NoTriangulation)?,
    };
    let places: HashMap<TaxelId, VertexId> = calibration.ids.enumerate().map(|(v, &id)| (id, v)).collect();
    let normals = known_normals(calibration, observations);
    let (mut assumed, mut turned) = (0, 0);
    let is_single = skin.patches.len() == 1;
    for (k, patch) in skin.patches.iter_mut().enumerate() {
        let taxels: IdVec<VertexId, VertexId> = patch.taxels.ids.map(|id| places[id]);
        let is_known = taxels.iter().any(|&v| normals[v] != DVec3::ZERO);
        let was_turned = if is_known {
            turn_to(patch, &taxels.map(|&v| normals[v]))
        } else if triangles.is_some() {
            false
        } else {
            assumed += 1;
            let away_from_origin = patch.mesh.positions.clone();
            turn_to(patch, &away_from_origin)
        };
        turned += usize::from(was_turned && triangles.is_some());
        if calibration.model == Model::Poses {
            patch.taxels.normals = taxels.map(|&v| normals[v]);
            patch.taxels.tangents = Some(taxels.map(|&v| calibration.poses[v].rotation * DVec3::X));
        }
        if !is_single {
            patch.name = format!("skin{}", k + 1);
        }
    }
    let mut made = CalibratedSkin { skin, left_out: Vec::new(), remarks: Vec::new(), assumed, turned };
    for remark in remarks {
        match remark.kind {
            RemarkKind::LeftOut { vertices } => made.left_out.extend(vertices),
            RemarkKind::Components { .. } => {}
            // Edges have no winding.
            RemarkKind::Turned { .. } if triangles.is_none() => {}
            _ => made.remarks.push(remark),
        }
    }
    Ok(made)
}

/// Reverses a patch if most of it is inside out; returns whether it was.
fn turn_to(patch: &mut Patch, outside: &IdVec<VertexId, DVec3>) -> bool {
    let mesh = &mut patch.mesh;
    let vote = |face: FaceId| {
        let [a, b, c] = mesh.triangles[face];
        mesh.face_cross(face).dot(outside[a] + outside[b] + outside[c])
    };
    let is_inside_out = mesh.triangles.ids().map(vote).sum::<f64>() < 0.0;
    if is_inside_out {
        mesh.triangles.iter_mut().for_each(|f| f.swap(1, 2));
        for (normal, turned) in patch.taxels.normals.iter_mut().zip(mesh.vertex_normals()) {
            *normal = if turned == DVec3::ZERO { -*normal } else { turned };
        }
    }
    is_inside_out
}

/// The skin of all taxels with these triangles, or why they are not one, in the ids of the taxels.
fn assembled(calibration: &Calibration, faces: &[[VertexId; 3]]) -> Result<Assembled, SheetDefect> {
    let (ids, taxels) = (&calibration.ids, calibration.ids.len());
    if let Some(&vertex) = faces.iter().flatten().find(|v| v.index() >= taxels) {
        return Err(SheetDefect::Dangling { vertex, taxels });
    }
    if faces.is_empty() {
        return Err(SheetDefect::Empty);
    }
    let covariances = calibration.marginals.as_ref().map(|m| m.positions.iter().copied().map(Some).collect());
    let sheet = Sheet {
        name: "skin".into(),
        positions: calibration.poses.iter().map(|p| p.position).collect(),
        triangles: faces.iter().map(|f| f.map(VertexId::raw)).collect(),
        ids: Some(ids.as_slice().to_vec()),
        covariances,
        ..Sheet::default()
    };
    let draft = Draft { sheets: vec![sheet], ..Draft::default() };
    let options = AssembleOptions { weld: Weld::All, ..AssembleOptions::default() };
    let made = assemble(&draft, &options).map_err(|error| match error {
        SkinError::NonManifoldEdges { edges, .. } => {
            SheetDefect::NonManifoldEdge { edge: edges[0].map(|v| ids[v]) }
        }
        SkinError::NotOrientable { edge, .. } => SheetDefect::OneSided { edge: edge.map(|v| ids[v]) },
        other => SheetDefect::Skin(Box::new(other)),
    })?;
    let touching = made.remarks.iter().find_map(|remark| match &remark.kind {
        RemarkKind::FansSplit { vertices } => vertices.first(),
        _ => None,
    });
    match touching {
        Some(&v) => Err(SheetDefect::SeveralFans { id: ids[v] }),
        None => Ok(made),
    }
}

/// The skin of the triangles that edges form: of all, or without the rejected ones if that is not a
/// surface.
fn of_edges(calibration: &Calibration, observations: &Observations) -> Result<Assembled, SheetDefect> {
    let of = |counts: &dyn Fn(DisplacementId) -> bool| -> Result<Assembled, SheetDefect> {
        let made = assembled(calibration, &edge_triangles(&calibration.ids, observations, counts)?)?;
        // Edges do not determine which of the triangles is the boundary.
        let is_closed = |patch: &&Patch| {
            Edges::new(&patch.mesh.triangles, patch.mesh.positions.len()).iter().all(|e| e.len() == 2)
        };
        match made.skin.patches.iter().find(is_closed) {
            Some(patch) => Err(SheetDefect::Closed { id: patch.taxels.ids[VertexId::new(0)] }),
            None => Ok(made),
        }
    };
    let all = of(&|_| true);
    let rejected: HashSet<DisplacementId> = calibration.rejected().0.into_iter().collect();
    if all.is_ok() || rejected.is_empty() { all } else { of(&|e| !rejected.contains(&e)) }
}

/// All triples of taxels that are joined pairwise by edges with information for which `counts` is true, each
/// once, corners ascending.
fn edge_triangles(
    ids: &IdVec<VertexId, TaxelId>,
    observations: &Observations,
    counts: impl Fn(DisplacementId) -> bool,
) -> Result<Vec<[VertexId; 3]>, SheetDefect> {
    // Neighbours of every taxel with larger ids, ascending.
    let mut later: IdVec<VertexId, Vec<VertexId>> = observations.taxels.map(|_| Vec::new());
    for (_, edge) in observations.edges.enumerate().filter(|(id, e)| counts(*id) && e.is_observed()) {
        later[edge.from.min(edge.to)].push(edge.from.max(edge.to));
    }
    for list in later.iter_mut() {
        list.sort_unstable();
        list.dedup();
    }
    let mut triangles = Vec::new();
    for (a, of_a) in later.enumerate() {
        for (k, &b) in of_a.iter().enumerate() {
            let (some, others) = (&of_a[k + 1..], &later[b]);
            let (few, many) =
                if some.len() < others.len() { (some, &others[..]) } else { (&others[..], some) };
            let mut closing = few.iter().filter(|c| many.binary_search(c).is_ok());
            triangles.extend(closing.by_ref().take(2).map(|&c| [a, b, c]));
            // A graph of many triangles is not a surface: do not list them all.
            if closing.next().is_some() {
                return Err(SheetDefect::NonManifoldEdge { edge: [ids[a], ids[b]] });
            }
        }
    }
    Ok(triangles)
}

/// The outward direction of every taxel; zero if unknown.
fn known_normals(calibration: &Calibration, observations: &Observations) -> IdVec<VertexId, DVec3> {
    if calibration.model == Model::Poses {
        return calibration.poses.map(|p| p.rotation * DVec3::Z);
    }
    let mut normals = calibration.poses.map(|_| DVec3::ZERO);
    for contact in &observations.contacts {
        if let ContactMeasurement::PositionNormal { normal, .. } = contact.measurement {
            normals[contact.taxel] += normal;
        }
    }
    normals
}
