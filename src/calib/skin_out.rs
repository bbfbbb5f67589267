use std::collections::HashMap;

use glam::{DAffine3, DVec3};

use crate::{
    calib::{CalibError, Calibration, Model, Observations, Touch},
    id::{IdVec, VertexId},
    mesh::TriMesh,
    skin::{Link, Patch, Skin},
};

/// A skin made of calibrated taxels, and what became of the others.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedSkin {
    /// The skin: one patch for each connected sheet, on one link at the origin.
    pub skin: Skin,
    /// Taxels that no triangle uses: they are left out of the skin.
    pub left_out: Vec<VertexId>,
    /// Whether the whole skin was turned over because its triangles were seen from inside.
    pub turned: bool,
}

/// Meshes calibrated taxels with the triangles given, or with those that their edges form.
///
/// Normals are those of the triangles in the positions model, the z axes of the taxel frames in the poses model.
/// Without given triangles, outside is where taxel frames and touched normals point, or away from the frame's
/// origin where neither is known.
///
/// # Errors
/// [`CalibError::NoTriangulation`] if the triangles are no oriented manifold or there are none.
pub fn calibrated_skin(
    calibration: &Calibration,
    observations: &Observations,
    triangles: Option<&[[VertexId; 3]]>,
) -> Result<CalibratedSkin, CalibError> {
    let taxels = calibration.poses.len();
    let mut faces: Vec<[VertexId; 3]> = match triangles {
        Some(given) => given.to_vec(),
        None => oriented(lattice_triangles(observations))?,
    };
    if let Some(v) = faces.iter().flatten().find(|v| v.index() >= taxels) {
        let what = format!("a triangle names vertex {v}, but there are {taxels} taxels");
        return Err(CalibError::NoTriangulation { what });
    }
    if faces.is_empty() {
        return Err(CalibError::NoTriangulation { what: "no three taxels are joined by edges".into() });
    }
    let turned = triangles.is_none() && outwardness(calibration, observations, &faces) < 0.0;
    if turned {
        faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    let mut skin = Skin::default();
    let link = skin.links.push(Link { name: String::new(), parent: None, pose: DAffine3::IDENTITY });
    let (sheets, left_out) = sheets(taxels, &faces);
    let single = sheets.len() == 1;
    for (k, sheet) in sheets.iter().enumerate() {
        let name = if single { "skin".to_owned() } else { format!("skin{}", k + 1) };
        skin.patches.push(patch(calibration, sheet, &faces, name, link));
    }
    skin.validate().map_err(|e| CalibError::NoTriangulation { what: e.to_string() })?;
    Ok(CalibratedSkin { skin, left_out, turned })
}

fn patch(
    calibration: &Calibration,
    sheet: &[VertexId],
    faces: &[[VertexId; 3]],
    name: String,
    link: crate::id::LinkId,
) -> Patch {
    let place: HashMap<VertexId, VertexId> =
        sheet.iter().enumerate().map(|(k, &v)| (v, VertexId::new(k))).collect();
    let triangles =
        faces.iter().filter_map(|f| Some([*place.get(&f[0])?, *place.get(&f[1])?, *place.get(&f[2])?]));
    let mesh = TriMesh {
        positions: sheet.iter().map(|&v| calibration.poses[v].position).collect(),
        triangles: triangles.collect(),
    };
    let mut patch = Patch::from_mesh(name, link, mesh);
    patch.ids = sheet.iter().map(|&v| calibration.ids[v]).collect();
    if calibration.model == Model::Poses {
        patch.normals = sheet.iter().map(|&v| calibration.poses[v].rotation * DVec3::Z).collect();
    }
    patch.covariances =
        calibration.marginals.as_ref().map(|m| sheet.iter().map(|&v| m.positions[v]).collect());
    patch
}

/// All triples of taxels that edges join pairwise, each once, corners ascending.
fn lattice_triangles(observations: &Observations) -> Vec<[VertexId; 3]> {
    // Later neighbours of every taxel, ascending.
    let mut later: IdVec<VertexId, Vec<VertexId>> = observations.taxels.map(|_| Vec::new());
    for edge in &observations.edges {
        later[edge.from.min(edge.to)].push(edge.from.max(edge.to));
    }
    for list in later.iter_mut() {
        list.sort_unstable();
        list.dedup();
    }
    let mut triangles = Vec::new();
    for (a, list) in later.enumerate() {
        for (k, &b) in list.iter().enumerate() {
            let closing = list[k + 1..].iter().filter(|c| later[b].binary_search(c).is_ok());
            triangles.extend(closing.map(|&c| [a, b, c]));
        }
    }
    triangles
}

/// Turns triangles so that neighbours run along their common edge in opposite directions; the first of every sheet
/// stays as it is.
fn oriented(mut faces: Vec<[VertexId; 3]>) -> Result<Vec<[VertexId; 3]>, CalibError> {
    let mut sides: HashMap<[VertexId; 2], Vec<usize>> = HashMap::with_capacity(3 * faces.len() / 2);
    for (k, f) in faces.iter().enumerate() {
        for [a, b] in directed(f) {
            let around = sides.entry([a.min(b), a.max(b)]).or_default();
            around.push(k);
            if around.len() > 2 {
                let what = format!("three triangles meet at the edge between vertices {a} and {b}");
                return Err(CalibError::NoTriangulation { what });
            }
        }
    }
    let mut done = vec![false; faces.len()];
    for first in 0..faces.len() {
        let mut open = if done[first] { Vec::new() } else { vec![first] };
        done[first] = true;
        while let Some(k) = open.pop() {
            for [a, b] in directed(&faces[k]) {
                for &other in sides[&[a.min(b), a.max(b)]].iter().filter(|&&o| o != k) {
                    let clash = directed(&faces[other]).contains(&[a, b]);
                    if done[other] && clash {
                        let what = format!("the triangles around vertices {a} and {b} have no two sides");
                        return Err(CalibError::NoTriangulation { what });
                    }
                    if !done[other] {
                        done[other] = true;
                        if clash {
                            faces[other].swap(1, 2);
                        }
                        open.push(other);
                    }
                }
            }
        }
    }
    Ok(faces)
}

fn directed(f: &[VertexId; 3]) -> [[VertexId; 2]; 3] {
    [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]]
}

/// Positive if the triangles are seen from outside.
fn outwardness(calibration: &Calibration, observations: &Observations, faces: &[[VertexId; 3]]) -> f64 {
    let mut outside: IdVec<VertexId, DVec3> = calibration.poses.map(|p| match calibration.model {
        Model::Poses => p.rotation * DVec3::Z,
        Model::Positions => DVec3::ZERO,
    });
    if calibration.model == Model::Positions {
        for contact in &observations.contacts {
            if let Touch::PositionNormal { normal, .. } = contact.touch {
                outside[contact.taxel] += normal;
            }
        }
        if outside.iter().all(|n| *n == DVec3::ZERO) {
            outside = calibration.poses.map(|p| p.position);
        }
    }
    let at = |v: VertexId| calibration.poses[v].position;
    let vote = |&[a, b, c]: &[VertexId; 3]| {
        (at(b) - at(a)).cross(at(c) - at(a)).dot(outside[a] + outside[b] + outside[c])
    };
    faces.iter().map(vote).sum()
}

/// The taxels of every connected sheet of triangles, ascending, and the taxels without triangle.
fn sheets(taxels: usize, faces: &[[VertexId; 3]]) -> (Vec<Vec<VertexId>>, Vec<VertexId>) {
    let mut around: IdVec<VertexId, Vec<VertexId>> = IdVec::filled(Vec::new(), taxels);
    for f in faces {
        for [a, b] in directed(f) {
            around[a].push(b);
            around[b].push(a);
        }
    }
    let mut reached = around.map(Vec::is_empty);
    let left_out = reached.enumerate().filter(|(_, r)| **r).map(|(v, _)| v).collect();
    let mut sheets = Vec::new();
    for first in around.ids() {
        if reached[first] {
            continue;
        }
        reached[first] = true;
        let (mut sheet, mut open) = (Vec::new(), vec![first]);
        while let Some(v) = open.pop() {
            sheet.push(v);
            for &next in &around[v] {
                if !reached[next] {
                    reached[next] = true;
                    open.push(next);
                }
            }
        }
        sheet.sort_unstable();
        sheets.push(sheet);
    }
    (sheets, left_out)
}
