//! What a map says as a whole, `extras.dermatome` of the document: what joins its patches, and the map of another skin that
//! it is drawn on.

use serde::{Deserialize, Serialize};

use crate::body::{Body, BodyLevel, BodyTaxel, Modality, field_areas};
use crate::id::{IdVec, VertexId};
use crate::io::error::Result;
use crate::io::file::excerpt;
use crate::io::gltf::document::Document;
use crate::io::gltf::rows::{add_rows, read_rows};
use crate::io::gltf::writer::SceneWriter;
use crate::io::gltf::{RowsExtras, content};
use crate::map::{OnAtlas, SkinMap};
use crate::numeric::narrow;
use crate::skin::PatchId;

/// `extras.dermatome` of the document.
#[derive(Debug, Serialize, Deserialize)]
struct DocumentExtras {
    #[serde(skip_serializing_if = "Option::is_none")]
    body: Option<BodyExtras>,
    #[serde(skip_serializing_if = "Option::is_none")]
    atlas: Option<OnAtlas>,
}

#[derive(Debug, Serialize, Deserialize)]
struct BodyExtras {
    /// Accessor of the gap links: patch, vertex, patch, vertex.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    links: Option<usize>,
    /// The levels of the whole body, finest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    levels: Vec<BodyLevelExtras>,
    /// The fields of modalities besides touch.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    modalities: Vec<ModalityExtras>,
}

#[derive(Debug, Serialize, Deserialize)]
struct ModalityExtras {
    /// The number of the patch, in the order of their meshes; of the whole body without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    patch: Option<u32>,
    /// Its name, such as `thermal`.
    name: String,
    /// Its levels, finest first; level 0 has the taxels of the patch, of the body all sensors, in terms of its fields.
    levels: Vec<BodyLevelExtras>,
}

#[derive(Debug, Serialize, Deserialize)]
struct BodyLevelExtras {
    /// Accessor of the taxels at the centres of fields: patch, vertex.
    origins: usize,
    /// Accessor of the areas of fields, in m^2, for other programs.
    area: usize,
    /// The fields of the level before in terms of these.
    up: RowsExtras,
}

/// Writes the body, if it is not empty, and the atlas, if there is one.
pub(super) fn write_extras(writer: &mut SceneWriter<'_>, map: &SkinMap) -> Result<()> {
    let atlas = map.atlas.clone();
    let body = (map.body != Body::default()).then(|| body_extras(writer, map));
    if body.is_some() || atlas.is_some() {
        writer.root.extras = writer.extras(&DocumentExtras { body, atlas })?;
    }
    Ok(())
}

fn body_extras(writer: &mut SceneWriter<'_>, map: &SkinMap) -> BodyExtras {
    let body = &map.body;
    let row = |[a, b]: &[BodyTaxel; 2]| [a.patch.raw(), a.taxel.raw(), b.patch.raw(), b.taxel.raw()];
    let links = (!body.links.is_empty()).then(|| writer.array(None, body.links.iter().map(row)).value());
    let areas = |rows| field_areas(rows, map.patches.iter().map(|patch| &patch.taxels.areas));
    let rows = map.body_rows().0;
    let levels =
        body.levels.iter().zip(&rows).map(|(level, rows)| add_level(writer, level, &areas(rows))).collect();
    let mut modalities = Vec::new();
    for modality in &body.modalities {
        let areas = body.field_areas(modality, |patch| &map.patches[patch].taxels.areas);
        let levels = modality.levels.iter().zip(&areas).map(|(level, areas)| add_level(writer, level, areas));
        let (patch, name) = (modality.patch.map(PatchId::raw), modality.name.clone());
        modalities.push(ModalityExtras { patch, name, levels: levels.collect() });
    }
    BodyExtras { links, levels, modalities }
}

fn add_level(
    writer: &mut SceneWriter<'_>,
    level: &BodyLevel,
    areas: &IdVec<VertexId, f64>,
) -> BodyLevelExtras {
    let origins = level.origins.iter().map(|at| [at.patch.raw(), at.taxel.raw()]);
    BodyLevelExtras {
        origins: writer.array(None, origins).value(),
        area: writer.array(None, areas.iter().map(|&area| [narrow(area)])).value(),
        up: add_rows(writer, &level.rows),
    }
}

fn read_level(document: &Document, name: &str, level: &BodyLevelExtras) -> Result<BodyLevel> {
    let name = |what| format!("extras.dermatome.body {name} {what}");
    let origins = document.accessor(level.origins, &name("origins"))?.integers::<2>()?;
    let taxel =
        |[patch, taxel]: [u32; 2]| BodyTaxel { patch: PatchId::from(patch), taxel: VertexId::from(taxel) };
    let origins: IdVec<VertexId, BodyTaxel> = origins.into_iter().map(taxel).collect();
    let rows = read_rows(document, &name("up"), level.up, origins.len())?;
    Ok(BodyLevel { origins, rows })
}

/// Reads the body and the atlas of a map; an empty body from a file that has none, as older ones.
pub(super) fn read_extras(document: &Document) -> Result<(Body, Option<OnAtlas>)> {
    let extras = content(&document.root().extras);
    let part = |name| extras.as_ref().and_then(|extras| extras.get(name)).cloned();
    let (body, atlas) = (part("body"), part("atlas"));
    Ok((read_body(document, body)?, atlas.map(|atlas| read_atlas(document, atlas)).transpose()?))
}

fn read_atlas(document: &Document, extras: serde_json::Value) -> Result<OnAtlas> {
    let invalid = |found: String| {
        document.invalid(
            "extras.dermatome.atlas",
            found,
            "name, hash of 16 hexadecimal digits and mirrored, true or false",
        )
    };
    OnAtlas::deserialize(extras).map_err(|e| invalid(e.to_string()))
}

fn read_body(document: &Document, extras: Option<serde_json::Value>) -> Result<Body> {
    let Some(extras) = extras else { return Ok(Body::default()) };
    const ELEMENT: &str = "extras.dermatome.body";
    let extras = BodyExtras::deserialize(extras).map_err(|e| {
        document.invalid(
            ELEMENT,
            e.to_string(),
            "links, levels and modalities, their levels with origins, area and up as numbers of accessors",
        )
    })?;
    let mut body = Body::default();
    if let Some(links) = extras.links {
        let rows = document.accessor(links, "extras.dermatome.body links")?.integers::<4>()?;
        let taxel =
            |patch: u32, taxel: u32| BodyTaxel { patch: PatchId::from(patch), taxel: VertexId::from(taxel) };
        body.links = rows.into_iter().map(|[p, v, q, w]| [taxel(p, v), taxel(q, w)]).collect();
    }
    for (number, level) in extras.levels.iter().enumerate() {
        body.levels.push(read_level(document, &format!("level {number}"), level)?);
    }
    for ModalityExtras { patch, name, levels } in extras.modalities {
        let of_level = |(number, level): (usize, &BodyLevelExtras)| {
            read_level(document, &format!("modality {} level {number}", excerpt(&name)), level)
        };
        let levels = levels.iter().enumerate().map(of_level).collect::<Result<_>>()?;
        body.modalities.push(Modality { patch: patch.map(PatchId::from), name, levels });
    }
    Ok(body)
}
