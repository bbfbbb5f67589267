//! Tables of taxels and fields: as text, and as arrays of numpy.

use glam::DVec3;

use crate::io::arrays::npy::Elements;
use crate::io::arrays::write::ArrayWriter;
use crate::io::error::Result;
use crate::io::export::part::{ExportPart, Vertex};
use crate::io::file::OutPath;
use crate::io::table::writer::write_table;

const COLUMNS: &str = "patch,link,taxel_id,x,y,z,nx,ny,nz,tx,ty,tz,u,v,area,presence";

pub(super) fn write_csv(path: &OutPath, parts: &[ExportPart<'_>]) -> Result<()> {
    write_table(path, COLUMNS, |table| {
        for (part, v) in vertices(parts) {
            table.cell(&part.patch.name);
            table.cell(&part.link);
            table.whole(v.id.0);
            for vector in [v.position, v.normal, v.tangent] {
                table.numbers(vector.to_array());
            }
            table.numbers(v.uv.to_array().into_iter().chain([v.area]));
            table.cell(v.presence.word());
            table.end_row()?;
        }
        Ok(())
    })
}

pub(super) fn write_npz(path: &OutPath, parts: &[ExportPart<'_>]) -> Result<()> {
    let count = vertices(parts).count();
    let names: Vec<String> = parts.iter().map(|part| part.patch.name.clone()).collect();
    let links: Vec<String> = parts.iter().map(|part| part.link.clone()).collect();
    let patch_of: Vec<u32> = vertices(parts).map(|(part, _)| part.id.raw()).collect();
    let ids: Vec<u32> = vertices(parts).map(|(_, v)| v.id.0).collect();
    let present: Vec<u8> = vertices(parts).map(|(_, v)| v.presence.code()).collect();
    let areas: Vec<f64> = vertices(parts).map(|(_, v)| v.area).collect();
    let uv: Vec<f64> = vertices(parts).flat_map(|(_, v)| v.uv.to_array()).collect();
    let mut file = ArrayWriter::create(path)?;
    file.constant("patches", &[parts.len()], Elements::Text(&names))?;
    file.constant("links", &[parts.len()], Elements::Text(&links))?;
    file.constant("patch_of", &[count], Elements::U32(&patch_of))?;
    file.constant("taxel_ids", &[count], Elements::U32(&ids))?;
    let vectors = |of: fn(Vertex) -> DVec3| -> Vec<f64> {
        vertices(parts).flat_map(|(_, v)| of(v).to_array()).collect()
    };
    file.constant("positions", &[count, 3], Elements::F64(&vectors(|v| v.position)))?;
    file.constant("normals", &[count, 3], Elements::F64(&vectors(|v| v.normal)))?;
    file.constant("tangents", &[count, 3], Elements::F64(&vectors(|v| v.tangent)))?;
    file.constant("uv", &[count, 2], Elements::F64(&uv))?;
    file.constant("areas", &[count], Elements::F64(&areas))?;
    file.constant("present", &[count], Elements::U8(&present))?;
    file.finish()
}

/// The vertices of all parts.
fn vertices<'p, 'a>(parts: &'p [ExportPart<'a>]) -> impl Iterator<Item = (&'p ExportPart<'a>, Vertex)> {
    parts.iter().flat_map(|part| part.vertices().map(move |v| (part, v)))
}
