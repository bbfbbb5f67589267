//! JSON of robotskinlib, version 2: one rigid body of skin with its taxels, faces and frame.

use std::{borrow::Cow, io::Write, path::Path};

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::io::error::Result;
use crate::io::file::{Source, excerpt, stem, write_to};
use crate::mesh::{is_rotation, rotation_defect};
use crate::skin::{Draft, Link, Patch, Presence, Sheet, Skin, TaxelId, world_pose};

/// How far a frame's matrix may be from a rotation. Real files round the sine of 45 degrees to
/// 0.7071, which leaves 1e-5; a matrix that scales or shears by more than this is not a frame.
const FRAME_TOLERANCE: f64 = 1e-3;

#[derive(Serialize, Deserialize)]
struct File<'a> {
    #[serde(default)]
    info: Info,
    #[serde(borrow)]
    skin: SkinBody<'a>,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct Info {
    file_version: Value,
    #[serde(rename = "type", skip_deserializing)]
    kind: &'static str,
    name: String,
    #[serde(skip_deserializing)]
    application: &'static str,
    #[serde(skip_deserializing)]
    description: &'static str,
}

#[derive(Serialize, Deserialize)]
struct SkinBody<'a> {
    n_taxels: Option<usize>,
    n_faces: Option<usize>,
    #[serde(default)]
    parent_frames: Vec<ParentFrame>,
    #[serde(borrow)]
    taxels: Vec<Taxel<'a>>,
    faces: Vec<[u32; 3]>,
}

#[derive(Serialize, Deserialize)]
struct ParentFrame {
    #[serde(default)]
    key: i64,
    #[serde(default)]
    id: i64,
    #[serde(rename = "type", skip_deserializing)]
    kind: &'static str,
    #[serde(default)]
    name: String,
    /// Column by column; the translation is the last column.
    tf_matrix: [f64; 16],
}

#[derive(Serialize, Deserialize)]
struct Taxel<'a> {
    id: i64,
    x: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    n: Option<[f64; 3]>,
    #[serde(rename = "type", borrow, default = "pressure")]
    kind: Cow<'a, str>,
    /// Whether the laboratory's own map is cut open here; not used.
    #[serde(skip_deserializing)]
    cut: u8,
}

fn pressure() -> Cow<'static, str> {
    presence_name(Presence::Present).into()
}

fn presence_name(presence: Presence) -> &'static str {
    match presence {
        Presence::Present => "pressure",
        Presence::Absent => "absent",
        Presence::ThermalPad => "thermal",
        Presence::Other => "other",
    }
}

/// The content of a slot of this type; a type that has no name here counts as no taxel.
fn presence(kind: &str) -> Presence {
    match kind {
        "pressure" => Presence::Present,
        "thermal" | "temperature" => Presence::ThermalPad,
        "other" => Presence::Other,
        _ => Presence::Absent,
    }
}

/// Reads a robotskinlib file: one sheet, named as the body is, on the first of its frames.
///
/// Every frame becomes a link; taxels name none, so further frames only count. Negative
/// ids, the placeholder of some tools, become [`u32::MAX`]. The `tactile_maps` are left out: they
/// are made anew here.
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let file: File<'_> = serde_json::from_slice(source.bytes()).map_err(|e| {
        let found = e.to_string();
        let found = found.rsplit_once(" at line ").map_or(found.as_str(), |(found, _)| found);
        source.invalid((e.line(), format!("column {}", e.column())), found, "robotskinlib JSON, version 2")
    })?;
    let body = file.skin;
    check_version(source, &file.info.file_version)?;
    check_counts(source, &body)?;
    let mut draft = Draft::default();
    for (k, frame) in body.parent_frames.iter().enumerate() {
        let pose = read_pose(source, k, &frame.tf_matrix)?;
        draft.links.push(Link { name: frame.name.clone(), parent: None, pose });
    }
    draft.sheets.push(Sheet {
        name: if file.info.name.is_empty() { source.stem() } else { file.info.name },
        link: draft.links.ids().next(),
        ids: Some(read_ids(source, &body.taxels)?),
        normals: read_normals(source, &body.taxels)?,
        presence: Some(body.taxels.iter().map(|t| presence(&t.kind)).collect()),
        positions: body.taxels.iter().map(|t| t.x.into()).collect(),
        triangles: body.faces,
        ..Sheet::default()
    });
    Ok(draft)
}

fn check_version(source: &Source, version: &Value) -> Result<()> {
    let is_known = match version {
        Value::Null => true,
        Value::String(text) => text == "2",
        other => other.as_u64() == Some(2),
    };
    let refuse = || {
        source.invalid("info.file_version", excerpt(&version.to_string()), "2, the only version known here")
    };
    if is_known { Ok(()) } else { Err(refuse()) }
}

fn check_counts(source: &Source, body: &SkinBody<'_>) -> Result<()> {
    let counts =
        [("n_taxels", body.n_taxels, body.taxels.len()), ("n_faces", body.n_faces, body.faces.len())];
    for (name, declared, counted) in counts {
        if let Some(declared) = declared.filter(|&n| n != counted) {
            let needed = format!("{counted}, the true count");
            return Err(source.invalid(format!("skin.{name}"), declared.to_string(), needed));
        }
    }
    for (k, face) in body.faces.iter().enumerate() {
        if let Some(corner) = face.iter().find(|&&v| v as usize >= body.taxels.len()) {
            let needed = format!("the index of one of {} taxels, counted from 0", body.taxels.len());
            return Err(source.invalid(format!("skin.faces[{k}]"), format!("taxel {corner}"), needed));
        }
    }
    Ok(())
}

fn read_ids(source: &Source, taxels: &[Taxel<'_>]) -> Result<Vec<TaxelId>> {
    let id = |(k, taxel): (usize, &Taxel<'_>)| match taxel.id {
        ..0 => Ok(TaxelId(u32::MAX)),
        id => u32::try_from(id).map(TaxelId).map_err(|_| {
            source.invalid(format!("skin.taxels[{k}].id"), id.to_string(), format!("at most {}", u32::MAX))
        }),
    };
    taxels.iter().enumerate().map(id).collect()
}

fn read_normals(source: &Source, taxels: &[Taxel<'_>]) -> Result<Option<Vec<DVec3>>> {
    let normals: Vec<DVec3> = taxels.iter().filter_map(|t| t.n).map(DVec3::from).collect();
    match taxels.iter().position(|t| t.n.is_none()) {
        None => Ok(Some(normals)),
        Some(_) if normals.is_empty() => Ok(None),
        Some(k) => {
            Err(source.invalid(format!("skin.taxels[{k}]"), "no normal `n`", "one, as other taxels have one"))
        }
    }
}

/// The pose of frame `k`. Printed digits make a rotation slightly wrong, which would shrink the
/// skin a little and make poses that should undo each other not do so: the nearest rotation is
/// taken.
fn read_pose(source: &Source, k: usize, columns: &[f64; 16]) -> Result<DAffine3> {
    let refuse = |found: String, needed: &str| {
        Err(source.invalid(format!("skin.parent_frames[{k}].tf_matrix"), found, needed))
    };
    let [xx, xy, xz, xw, yx, yy, yz, yw, zx, zy, zz, zw, tx, ty, tz, tw] = *columns;
    if [xw, yw, zw, tw] != [0.0, 0.0, 0.0, 1.0] {
        let found = format!("{:?} as its last row", [xw, yw, zw, tw]);
        return refuse(found, "[0, 0, 0, 1]: column by column, translation last");
    }
    let matrix = DMat3::from_cols_array(&[xx, xy, xz, yx, yy, yz, zx, zy, zz]);
    let defect = rotation_defect(&matrix);
    if !(defect <= FRAME_TOLERANCE && matrix.determinant() > 0.0) {
        let found = format!("determinant {:?}, columns off by {defect:.1e}", matrix.determinant());
        return refuse(found, "a rotation: unit columns at right angles, right-handed");
    }
    let rotation = if is_rotation(&matrix) { matrix } else { nearest_rotation(matrix) };
    Ok(DAffine3::from_mat3_translation(rotation, DVec3::new(tx, ty, tz)))
}

/// The rotation nearest to an almost orthonormal matrix: its polar factor (higham1986).
fn nearest_rotation(mut matrix: DMat3) -> DMat3 {
    for _ in 0..6 {
        matrix = (matrix + matrix.inverse().transpose()) * 0.5;
    }
    matrix
}

/// Writes a robotskinlib file: one body with all taxels. Areas and densities are lost.
pub(crate) fn write(output: &mut dyn Write, path: &Path, skin: &Skin) -> Result<()> {
    let (frame, patches) = framed(skin);
    let mut taxels = Vec::new();
    let mut faces = Vec::new();
    for patch in &patches {
        // Faces of a validated skin fit into 32 bits patch by patch, so saturation is never reached
        // in practice, and would be noticed as a face past the end.
        let before = u32::try_from(taxels.len()).unwrap_or(u32::MAX);
        faces.extend(patch.mesh.triangles.iter().map(|t| t.map(|v| before.saturating_add(v.raw()))));
        taxels.extend(patch.taxels.ids.enumerate().map(|(v, id)| Taxel {
            id: if id.0 == u32::MAX { -1 } else { i64::from(id.0) },
            x: patch.mesh.positions[v].to_array(),
            n: Some(patch.taxels.normals[v].to_array()),
            kind: presence_name(patch.taxels.presence[v]).into(),
            cut: 0,
        }));
    }
    let name = match patches.as_slice() {
        [patch] => patch.name.clone(),
        _ => stem(path),
    };
    let info = Info { file_version: "2".into(), kind: "rigid_body", name, ..Info::default() };
    let (n_taxels, n_faces) = (Some(taxels.len()), Some(faces.len()));
    let body = SkinBody { n_taxels, n_faces, parent_frames: vec![frame], taxels, faces };
    write_to(output, path, |out| {
        serde_json::to_writer_pretty(&mut *out, &File { info, skin: body })?;
        out.write_all(b"\n")
    })
}

/// The frame of the whole skin, and the patches in it: that of the link that carries them all, if
/// there is one and it neither scales nor mirrors, else the world.
fn framed(skin: &Skin) -> (ParentFrame, Vec<Cow<'_, Patch>>) {
    let first = skin.patches.iter().next().map(|patch| (patch.link, world_pose(&skin.links, patch.link)));
    let only = first.filter(|(link, pose)| {
        is_rotation(&pose.matrix3) && skin.patches.iter().all(|patch| patch.link == *link)
    });
    let (name, pose, patches) = match only {
        Some((link, pose)) => {
            (skin.links[link].name.clone(), pose, skin.patches.iter().map(Cow::Borrowed).collect())
        }
        None => (String::new(), DAffine3::IDENTITY, skin.patches.iter().map(|p| skin.in_world(p)).collect()),
    };
    let [[a, b, c], [d, e, f], [g, h, i], [x, y, z]] = pose.to_cols_array_2d();
    let tf_matrix = [a, b, c, 0.0, d, e, f, 0.0, g, h, i, 0.0, x, y, z, 1.0];
    (ParentFrame { key: 0, id: 0, kind: "", name, tf_matrix }, patches)
}
