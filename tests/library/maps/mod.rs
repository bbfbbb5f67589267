//! Maps made by hand from named shapes: what the rooms above `map` are tested on.
#![allow(dead_code, reason = "each test program uses a part of it")]

pub(crate) mod images;
pub(crate) mod zoo;

use std::sync::Arc;

use dermatome::atlas::{Atlas, AtlasOptions, Chart, skin_images};
use dermatome::id::{FaceId, IdVec, VertexId};
use dermatome::map::{MapLevel, PatchMap, SkinMap};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pyramid::{Level, LevelId, Prolongation, Pyramid};
use dermatome::skin::{Link, LinkId, Patch, PatchId, TaxelId, Taxels};
use glam::{DAffine3, DVec2, DVec3};

/// A level whose map is its shape seen from above; one that faces down is turned over, since its map
/// would be mirrored.
pub(crate) fn flat_level(mut mesh: TriMesh, pixel: f64) -> MapLevel {
    if mesh.triangles.ids().all(|face| mesh.face_cross(face).z < 0.0) {
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    let uv = mesh.positions.map(|p| p.truncate());
    mapped_level(mesh, uv, pixel)
}

/// A level with the given map.
pub(crate) fn mapped_level(mesh: TriMesh, uv: IdVec<VertexId, DVec2>, pixel: f64) -> MapLevel {
    let skin = Patch::from_mesh("", LinkId::default(), mesh.clone());
    let (origins, areas) = (mesh.positions.ids().collect(), flat_taxels(mesh.clone()).areas);
    let level = Level { mesh, origins, areas, ..Level::default() };
    let pyramid = Pyramid { levels: vec![level].into(), removals: IdVec::default() };
    PatchMap::new(&skin, pyramid, vec![uv].into(), pixel).levels[level_id(0)].clone()
}

/// Taxels of a mesh seen from above; ids count from 100.
fn flat_taxels(mesh: TriMesh) -> Taxels {
    let mut taxels = SkinMap::flat(mesh, 1.0).patches[PatchId::new(0)].taxels.clone();
    taxels.ids = taxels.ids.ids().map(|v| TaxelId(100 + v.raw())).collect();
    taxels
}

/// A patch of these levels; ids count from 100.
pub(crate) fn patch(name: &str, levels: Vec<MapLevel>) -> PatchMap {
    let taxels = flat_taxels(levels[0].level.mesh.clone());
    PatchMap {
        name: name.into(),
        link: LinkId::default(),
        filled: 0,
        taxels,
        levels: levels.into(),
        atlas: None,
    }
}

/// The image of level `k`.
pub(crate) fn image(patch: &PatchMap, k: usize) -> images::WholeImage {
    let map = Arc::new(skin(vec![patch.clone()]));
    images::WholeImage::of(&skin_images(&map).unwrap()).swap_remove(k)
}

/// The charts of all levels, each as its image.
pub(crate) fn charts(map: &SkinMap) -> Vec<Chart> {
    let parts = Atlas::new(map, &AtlasOptions::default()).unwrap().parts;
    parts.into_iter().flat_map(|part| part.charts).collect()
}

/// A patch of one level seen from above.
pub(crate) fn flat_patch(name: &str, mesh: TriMesh, pixel: f64) -> PatchMap {
    patch(name, vec![flat_level(mesh, pixel)])
}

/// The patches on one link at the origin.
pub(crate) fn skin(patches: Vec<PatchMap>) -> SkinMap {
    let link = Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY };
    SkinMap { links: vec![link].into(), patches: patches.into(), ..SkinMap::default() }
}

/// A square of `side` metres with a lattice of `columns[k]` columns on level `k`.
pub(crate) fn square_pyramid(name: &str, columns: &[u32], side: f64, pixel: f64) -> PatchMap {
    let mut levels: Vec<MapLevel> =
        columns.iter().map(|&n| flat_level(square_sheet(n, side), pixel)).collect();
    for k in 1..levels.len() {
        let to_finest = prolongation(&levels[0], &levels[k]);
        let from_coarser = prolongation(&levels[k - 1], &levels[k]);
        levels[k].level.origins = nearest(&levels[k], &levels[0]);
        levels[k].level.to_finest = Some(to_finest);
        levels[k - 1].level.from_coarser = Some(from_coarser);
    }
    patch(name, levels)
}

/// A square lattice cut along diagonals, all vertices of which stay within the square.
fn square_sheet(columns: u32, side: f64) -> TriMesh {
    let step = side / f64::from(columns - 1);
    shapes::sheet(columns, columns, |i, j| DVec3::new(f64::from(i) * step, f64::from(j) * step, 0.0))
}

fn nearest(of: &MapLevel, among: &MapLevel) -> IdVec<VertexId, VertexId> {
    let there = among.opened_uv();
    let closest = |p: &DVec2| {
        let d = |v: &VertexId| there[*v].distance_squared(*p);
        there.ids().min_by(|a, b| d(a).total_cmp(&d(b))).unwrap()
    };
    of.opened_uv().map(closest)
}

/// Barycentric location by trying every triangle.
fn prolongation(fine: &MapLevel, coarse: &MapLevel) -> Prolongation {
    let mut out =
        Prolongation { indices: IdVec::default(), weights: IdVec::default(), coarse_len: coarse.uv.len() };
    let uv = coarse.opened_uv();
    for &p in &fine.uv {
        let worst = |f: &FaceId| {
            barycentric(&coarse.level.mesh, &uv, *f, p).into_iter().fold(f64::INFINITY, f64::min)
        };
        let face = coarse.level.mesh.triangles.ids().max_by(|a, b| worst(a).total_cmp(&worst(b))).unwrap();
        out.indices.push(coarse.level.mesh.triangles[face]);
        out.weights.push(barycentric(&coarse.level.mesh, &uv, face, p).map(|w| w.max(0.0)));
    }
    out
}

/// Barycentric coordinates of a map position in a face; negative outside.
pub(crate) fn barycentric(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>, face: FaceId, p: DVec2) -> [f64; 3] {
    let [a, b, c] = mesh.triangles[face].map(|v| uv[v]);
    let area = (b - a).perp_dot(c - a);
    [(b - p).perp_dot(c - p) / area, (c - p).perp_dot(a - p) / area, (a - p).perp_dot(b - p) / area]
}

/// Level `k`.
pub(crate) fn level_id(k: usize) -> LevelId {
    LevelId::new(k)
}
