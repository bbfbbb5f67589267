//! From a calibration to a skin: the triangles that the displacements form, or given ones, turned outwards.

use std::collections::{HashMap, HashSet};

use glam::{DAffine3, DVec3};

use crate::{
    calib::{CalibError, Calibration, ContactMeasurement, DisplacementId, Model, Observations},
    id::{IdVec, VertexId},
    mesh::{Edges, TriMesh},
    skin::{Link, LinkId, Patch, Skin, TaxelId},
};

/// A skin made of calibrated taxels, and what became of the others.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedSkin {
    /// The skin: one patch for each connected sheet, on one link at the origin.
    pub skin: Skin,
    /// Taxels that no triangle uses: they are left out of the skin.
    pub left_out: Vec<VertexId>,
    /// What determined the outside, patch by patch.
    pub outside: Vec<Outside>,
    /// Patches whose given triangles were inside out and were reversed.
    pub turned: usize,
}

/// What determined which side of a calibrated skin is outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outside {
    /// The winding of the triangles given.
    Triangles,
    /// The z axes of the taxels' frames.
    Frames,
    /// The normals of contacts.
    Contacts,
    /// Nothing: away from the origin is assumed.
    Origin,
}

/// Meshes calibrated taxels with the triangles given, or with those that their edges form.
///
/// Normals are those of the triangles in the positions model, the z axes of the taxel frames in the poses model.
/// The outside of each sheet is where its taxel frames or contact normals point; without either, as given
/// triangles are wound; without these, away from the origin. Edges without information form no triangle.
/// Rejected edges do, unless the triangles are then not a surface.
///
/// ```
/// use dermatome::calib::{CalibOptions, SimulateOptions, calibrate, calibrated_skin, simulate};
///
/// let simulation = simulate(&SimulateOptions { taxels: 50, ..SimulateOptions::default() })?;
/// let observations = &simulation.observations;
/// let found = calibrate(observations, &CalibOptions::default(), &|_, _| {})?;
/// let made = calibrated_skin(&found, observations, None)?;
/// let patch = made.skin.patches.iter().next().expect("one sheet");
/// assert_eq!(patch.mesh.triangles.len(), simulation.mesh.triangles.len());
/// # Ok::<(), dermatome::calib::CalibError>(())
/// ```
///
/// # Errors
/// [`CalibError::BadTriangles`] and [`CalibError::NoTriangulation`] if given triangles, or those of the edges,
/// are not an oriented manifold or there are none; triangles of the edges must not close up either.
pub fn calibrated_skin(
    calibration: &Calibration,
    observations: &Observations,
    triangles: Option<&[[VertexId; 3]]>,
) -> Result<CalibratedSkin, CalibError> {
    let taxels = calibration.poses.len();
    let given = triangles.is_some();
    let faces: Vec<[VertexId; 3]> = match triangles {
        Some(given) => given.to_vec(),
        None => edge_triangles(calibration, observations)?,
    };
    if let Some(v) = faces.iter().flatten().find(|v| v.index() >= taxels) {
        return Err(CalibError::BadTriangles { what: format!("one names vertex {v} of {taxels} taxels") });
    }
    if faces.is_empty() {
        return Err(match given {
            true => CalibError::BadTriangles { what: "there are none".into() },
            false => CalibError::NoTriangulation { what: "no three taxels are joined by edges".into() },
        });
    }
    let (mut sheets, left_out) = sheets(taxels, &faces);
    let normals = known_normals(calibration, observations);
    let mut outside = Vec::with_capacity(sheets.len());
    let mut turned = 0;
    for sheet in &mut sheets {
        let known = sheet.taxels.iter().any(|&v| normals[v] != DVec3::ZERO);
        let decided_by = match calibration.model {
            _ if !known && given => Outside::Triangles,
            _ if !known => Outside::Origin,
            Model::Positions => Outside::Contacts,
            Model::Poses => Outside::Frames,
        };
        let was_inside_out = match decided_by {
            Outside::Triangles => false,
            Outside::Frames | Outside::Contacts => sheet.turn_to(calibration, |v| normals[v]),
            Outside::Origin => sheet.turn_to(calibration, |v| calibration.poses[v].position),
        };
        turned += usize::from(was_inside_out && given);
        outside.push(decided_by);
    }
    let mut skin = Skin::default();
    let link = skin.links.push(Link { name: String::new(), parent: None, pose: DAffine3::IDENTITY });
    let single = sheets.len() == 1;
    for (k, sheet) in sheets.iter().enumerate() {
        let name = if single { "skin".to_owned() } else { format!("skin{}", k + 1) };
        skin.patches.push(sheet.patch(calibration, name, link));
    }
    for patch in &skin.patches {
        match defect(patch) {
            Some(what) if given => return Err(CalibError::BadTriangles { what }),
            Some(what) => return Err(CalibError::NoTriangulation { what }),
            None => {}
        }
        // Which of the triangles is the boundary, edges do not tell.
        if !given
            && Edges::new(&patch.mesh.triangles, patch.mesh.positions.len()).iter().all(|e| e.len() == 2)
        {
            let what = format!("the triangles around taxel {} close up", patch.taxels.ids[VertexId::new(0)]);
            return Err(CalibError::NoTriangulation { what });
        }
    }
    Ok(CalibratedSkin { skin, left_out, outside, turned })
}

/// A connected sheet of triangles.
#[derive(Debug, Clone, Default)]
struct Sheet {
    /// Its taxels, ascending.
    taxels: Vec<VertexId>,
    faces: Vec<[VertexId; 3]>,
}

impl Sheet {
    /// Turns the sheet over if most of it is seen from inside; returns whether it was.
    fn turn_to(&mut self, calibration: &Calibration, outside: impl Fn(VertexId) -> DVec3) -> bool {
        let at = |v: VertexId| calibration.poses[v].position;
        let vote = |&[a, b, c]: &[VertexId; 3]| {
            (at(b) - at(a)).cross(at(c) - at(a)).dot(outside(a) + outside(b) + outside(c))
        };
        let inside_out = self.faces.iter().map(vote).sum::<f64>() < 0.0;
        if inside_out {
            self.faces.iter_mut().for_each(|f| f.swap(1, 2));
        }
        inside_out
    }

    fn patch(&self, calibration: &Calibration, name: String, link: LinkId) -> Patch {
        let taxels = || self.taxels.iter();
        let place: HashMap<VertexId, VertexId> =
            taxels().enumerate().map(|(k, &v)| (v, VertexId::new(k))).collect();
        let mesh = TriMesh {
            positions: taxels().map(|&v| calibration.poses[v].position).collect(),
            triangles: self.faces.iter().map(|f| f.map(|v| place[&v])).collect(),
        };
        let mut patch = Patch::from_mesh(name, link, mesh);
        patch.taxels.ids = taxels().map(|&v| calibration.ids[v]).collect();
        if calibration.model == Model::Poses {
            patch.taxels.normals = taxels().map(|&v| calibration.poses[v].rotation * DVec3::Z).collect();
        }
        patch.taxels.covariances =
            calibration.marginals.as_ref().map(|m| taxels().map(|&v| m.positions[v].to_array()).collect());
        patch
    }
}

/// The triangles that edges form, turned alike.
fn edge_triangles(
    calibration: &Calibration,
    observations: &Observations,
) -> Result<Vec<[VertexId; 3]>, CalibError> {
    let ids = &calibration.ids;
    let all = lattice_triangles(ids, observations, |_| true).and_then(|faces| oriented(ids, faces));
    let rejected: HashSet<DisplacementId> = calibration.rejected_edges().collect();
    if all.is_ok() || rejected.is_empty() {
        return all;
    }
    lattice_triangles(ids, observations, |e| !rejected.contains(&e)).and_then(|faces| oriented(ids, faces))
}

/// All triples of taxels that edges join pairwise that have information and that `counts` picks, each once, corners ascending.
fn lattice_triangles(
    ids: &IdVec<VertexId, TaxelId>,
    observations: &Observations,
    counts: impl Fn(DisplacementId) -> bool,
) -> Result<Vec<[VertexId; 3]>, CalibError> {
    // Later neighbours of every taxel, ascending.
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
                return Err(three_meet(ids[a], ids[b]));
            }
        }
    }
    Ok(triangles)
}

fn three_meet(a: TaxelId, b: TaxelId) -> CalibError {
    CalibError::NoTriangulation {
        what: format!("three triangles meet at the edge between taxels {a} and {b}"),
    }
}

/// What keeps a patch from being a skin, in the ids of its taxels.
fn defect(patch: &Patch) -> Option<String> {
    for uses in Edges::new(&patch.mesh.triangles, patch.mesh.positions.len()).iter() {
        let start = |k: usize| uses[k].start(&patch.mesh);
        if uses.len() > 2 || uses.len() == 2 && start(0) == start(1) {
            let (a, b) = (patch.taxels.ids[start(0)], patch.taxels.ids[uses[0].end(&patch.mesh)]);
            let more = if uses.len() > 2 {
                "more than two triangles meet"
            } else {
                "both triangles run the same way"
            };
            return Some(format!("{more} at the edge between taxels {a} and {b}"));
        }
    }
    patch.validate().err().map(|e| e.to_string())
}

/// Turns triangles so that neighbours run along their common edge in opposite directions; the first of every sheet
/// stays as it is.
fn oriented(
    ids: &IdVec<VertexId, TaxelId>,
    mut faces: Vec<[VertexId; 3]>,
) -> Result<Vec<[VertexId; 3]>, CalibError> {
    let mut sides: HashMap<[VertexId; 2], Vec<usize>> = HashMap::with_capacity(3 * faces.len() / 2);
    for (k, f) in faces.iter().enumerate() {
        for [a, b] in directed(f) {
            let around = sides.entry([a.min(b), a.max(b)]).or_default();
            around.push(k);
            if around.len() > 2 {
                return Err(three_meet(ids[a], ids[b]));
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
                        let what = format!(
                            "the triangles around taxels {} and {} have no two sides",
                            ids[a], ids[b]
                        );
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

/// The outward direction of every taxel; zero where none is known.
fn known_normals(calibration: &Calibration, observations: &Observations) -> IdVec<VertexId, DVec3> {
    if calibration.model == Model::Poses {
        return calibration.poses.map(|p| p.rotation * DVec3::Z);
    }
    let mut touched = calibration.poses.map(|_| DVec3::ZERO);
    for contact in &observations.contacts {
        if let ContactMeasurement::PositionNormal { normal, .. } = contact.measurement {
            touched[contact.taxel] += normal;
        }
    }
    touched
}

/// The connected sheets of triangles in the order of their first taxels, and the taxels without triangle.
fn sheets(taxels: usize, faces: &[[VertexId; 3]]) -> (Vec<Sheet>, Vec<VertexId>) {
    let mut around: IdVec<VertexId, Vec<VertexId>> = IdVec::filled(Vec::new(), taxels);
    for f in faces {
        for [a, b] in directed(f) {
            around[a].push(b);
            around[b].push(a);
        }
    }
    let mut sheet_of: IdVec<VertexId, Option<usize>> = around.map(|_| None);
    let mut sheets: Vec<Sheet> = Vec::new();
    let mut left_out = Vec::new();
    for first in around.ids() {
        if around[first].is_empty() {
            left_out.push(first);
        }
        if around[first].is_empty() || sheet_of[first].is_some() {
            continue;
        }
        let number = Some(sheets.len());
        sheet_of[first] = number;
        let (mut sheet, mut open) = (Sheet::default(), vec![first]);
        while let Some(v) = open.pop() {
            sheet.taxels.push(v);
            for &next in &around[v] {
                if sheet_of[next].is_none() {
                    sheet_of[next] = number;
                    open.push(next);
                }
            }
        }
        sheet.taxels.sort_unstable();
        sheets.push(sheet);
    }
    for &f in faces {
        if let Some(number) = sheet_of[f[0]] {
            sheets[number].faces.push(f);
        }
    }
    (sheets, left_out)
}
