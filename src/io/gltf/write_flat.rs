//! Writes one flattened mesh as glTF.

use std::path::Path;

use glam::{DAffine3, DVec2};
use gltf::json::extras::RawValue;
use serde_json::json;

use crate::{
    id::{IdVec, VertexId},
    io::{
        error::Result,
        file::{cannot_write, kind, stem},
        gltf::{
            write_skin::{SheetWriter, mesh, node},
            writer::{Form, Hung, SceneWriter, narrow},
        },
    },
    mesh::TriMesh,
    skin::Link,
};

/// Writes a mesh with its map as texture coordinates from 0 to 1, downwards; where the map lies, in
/// m, is in `extras.dermatome_flat` of the mesh.
pub(crate) fn write_flat(path: &Path, flat: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<()> {
    let (low, high) = uv.iter().fold((DVec2::MAX, DVec2::MIN), |(l, h), &p| (l.min(p), h.max(p)));
    let size = (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    let mut writer = SceneWriter::new(path);
    let mut sheet = SheetWriter::new(&mut writer, "the mesh".into(), flat)?;
    let unit = |p: &DVec2| {
        let p = (*p - low) / size;
        [p.x, 1.0 - p.y].map(narrow)
    };
    sheet.insert("TEXCOORD_0", uv.iter().map(unit));
    let primitive = sheet.finish();
    let name = stem(path);
    let mut mesh = mesh(name.clone(), primitive);
    let place = json!({"dermatome_flat": {"origin": low.to_array(), "size": size.to_array()}});
    let raw = RawValue::from_string(place.to_string());
    mesh.extras = raw.map(Some).map_err(|e| cannot_write(path)(e.into()))?;
    let patch = node(name, writer.root.push(mesh));
    let link = Link { name: String::new(), parent: None, pose: DAffine3::IDENTITY };
    let links = IdVec::from(vec![link]);
    writer.add_scene(
        None,
        &links,
        &links.map(|_| true),
        vec![Hung { link: 0.into(), node: patch, joints: Vec::new() }],
    )?;
    writer.finish(if kind(path) == "gltf" { Form::Text } else { Form::Glb })
}
