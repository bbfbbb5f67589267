//! Probes as Genesis takes them: one at each vertex, and one at each pixel of a regular grid over the map.

use std::f64::consts::PI;
use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use crate::atlas::{Chart, NearestVertices};
use crate::io::error::Result;
use crate::io::export::part::{ExportPart, narrowed};
use crate::io::file::{OutPath, unfit, write_file};
use crate::map::SkinMap;
use crate::numeric::narrow;

#[derive(Serialize)]
struct File<'a> {
    schema: &'static str,
    level: usize,
    patches: Vec<Patch<'a>>,
}

#[derive(Serialize)]
struct Patch<'a> {
    patch: &'a str,
    link: &'a str,
    taxel_ids: Vec<u32>,
    probes: Probes,
    canvas: Canvas,
}

/// Options of a sensor, by their names.
#[derive(Serialize)]
struct Probes {
    probe_local_pos: Vec<[f32; 3]>,
    probe_local_normal: Vec<[f32; 3]>,
    probe_radius: f32,
}

/// Row by row from the top.
#[derive(Serialize)]
struct Canvas {
    origin: [f64; 2],
    size: [f64; 2],
    /// Height and width.
    pixels: [u32; 2],
    /// The nearest probe of each pixel; -1 outside.
    probe: Vec<Vec<i64>>,
    probe_local_pos: Vec<Vec<[f32; 3]>>,
    probe_local_normal: Vec<Vec<[f32; 3]>>,
    probe_radius: Vec<Vec<f32>>,
}

pub(super) fn write(path: &OutPath, map: &SkinMap, parts: &[ExportPart<'_>]) -> Result<()> {
    let patches = parts.iter().map(|part| patch(path, map, part)).collect::<Result<_>>()?;
    let level = parts.iter().map(|part| part.level.index()).max().unwrap_or(0);
    let file = File { schema: "dermatome.probes/1", level, patches };
    write_file(path, |out| Ok(serde_json::to_writer(out, &file)?))
}

fn patch<'a>(path: &Path, map: &SkinMap, part: &'a ExportPart<'_>) -> Result<Patch<'a>> {
    let areas = &part.at.level.areas;
    let mean = areas.iter().sum::<f64>() / areas.len() as f64;
    let radius = narrow((mean / PI).sqrt());
    Ok(Patch {
        patch: &part.patch.name,
        link: &part.link,
        taxel_ids: part.vertices().map(|v| v.id.0).collect(),
        probes: Probes {
            probe_local_pos: part.vertices().map(|v| narrowed(v.position)).collect(),
            probe_local_normal: part.vertices().map(|v| narrowed(v.normal)).collect(),
            probe_radius: radius,
        },
        canvas: canvas(path, map, part, mean.sqrt(), radius)?,
    })
}

/// The grid whose pixels have the side `pixel`; those outside of the map have a probe that measures nothing.
fn canvas(path: &Path, map: &SkinMap, part: &ExportPart<'_>, pixel: f64, radius: f32) -> Result<Canvas> {
    let chart = Chart::of_level(map, part.id, part.level, pixel).map_err(|e| {
        let element = format!("the canvas of patch {:?}", part.patch.name);
        unfit(path, element, e.to_string(), "a map that fits into an image")
    })?;
    let [width, height] = chart.frame.size_px;
    let mut canvas = Canvas {
        origin: chart.frame.origin.to_array(),
        size: chart.frame.size.to_array(),
        pixels: [height, width],
        probe: Vec::new(),
        probe_local_pos: Vec::new(),
        probe_local_normal: Vec::new(),
        probe_radius: Vec::new(),
    };
    let (level, normals) = (&part.at.level, part.patch.normals(&part.at.level));
    let (nearest, mut seen) = (NearestVertices::new(&level.mesh), Vec::new());
    for row in 0..height {
        let points = (0..width).map(|column| chart.point(map, column, row));
        let pixels: Vec<_> = points
            .map(|point| {
                let Some(point) = point else { return (-1, [0.0; 3], narrowed(DVec3::Z), 0.0) };
                let corners = level.mesh.triangles[point.face];
                let mean =
                    |of: &dyn Fn(usize) -> DVec3| (0..3).map(|k| of(k) * point.barycentric[k]).sum::<DVec3>();
                let normal = mean(&|k| normals[corners[k]]).normalize_or(normals[corners[0]]);
                let nearest = nearest.find(corners, point.barycentric, &mut seen);
                let position = mean(&|k| level.mesh.positions[corners[k]]);
                (i64::from(nearest.raw()), narrowed(position), narrowed(normal), radius)
            })
            .collect();
        canvas.probe.push(pixels.iter().map(|pixel| pixel.0).collect());
        canvas.probe_local_pos.push(pixels.iter().map(|pixel| pixel.1).collect());
        canvas.probe_local_normal.push(pixels.iter().map(|pixel| pixel.2).collect());
        canvas.probe_radius.push(pixels.iter().map(|pixel| pixel.3).collect());
    }
    Ok(canvas)
}
