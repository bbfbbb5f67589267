//! The data of a map that a page needs.

use glam::{DVec2, DVec3};
use serde::Serialize;

use crate::Error;
use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, RegionId, SkinMap};
use crate::mesh::rectangle_around;
use crate::page::pack::{PackedRows, Packer, Region, Values, share};
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::{Covariance, PatchId, Presence, TOUCH, Taxels, link_names, world_pose};
use crate::unfold::{Unfolding, origins};

/// Space between the maps of patches on the sheet, as a share of the side of all of them.
const GAP: f64 = 0.03;

/// Intended width over height of the sheet.
const ASPECT: f64 = 0.8;

/// A skin and its map.
#[derive(Debug, Serialize)]
pub(super) struct SkinHeader {
    links: Vec<LinkHeader>,
    patches: Vec<PatchHeader>,
    /// The names of the regions, which patches count from 1 on.
    regions: Vec<String>,
    /// What taxels sense besides touch, which patches count from 1 on.
    modalities: Vec<String>,
    /// The number of fields of each level of the whole body.
    body: Vec<usize>,
}

#[derive(Debug, Serialize)]
struct LinkHeader {
    name: String,
    parent: Option<usize>,
}

/// A patch: numbers, and the indices of its arrays.
#[derive(Debug, Serialize)]
struct PatchHeader {
    name: String,
    link: usize,
    taxels: usize,
    filled: usize,
    /// The link in the world, and the map in the link: the columns of their matrices.
    pose: [f64; 12],
    sheet: [f64; 12],
    /// From the map to the common sheet, in m.
    offset: [f64; 2],
    space: Region,
    map: Region,
    between: Region,
    most_turn: f64,
    positions: usize,
    places: usize,
    triangles: usize,
    /// The taxels of further places, after the first place of every taxel.
    unsplit: usize,
    ids: usize,
    presence: usize,
    /// What each taxel senses, 0 for touch alone or nothing.
    senses: usize,
    /// The region of each taxel, 0 for none.
    region: usize,
    areas: Values,
    keys: usize,
    turns: usize,
    key_origins: usize,
    key_rows: Option<PackedRows>,
    values: Vec<Values>,
    levels: Vec<LevelHeader>,
    /// The taxels in terms of the fields of each level of the whole body.
    body: Vec<PackedRows>,
}

#[derive(Debug, Serialize)]
struct LevelHeader {
    vertices: usize,
    /// Pairs of places of level 0.
    edges: usize,
    origins: usize,
    direct: Option<PackedRows>,
}

/// Packs a map.
///
/// # Errors
/// If the system of an unfolding does not fit into memory.
pub(super) fn pack_skin(packer: &mut Packer, map: &SkinMap) -> Result<SkinHeader, Error> {
    let (offsets, regions) = (sheet_offsets(map), map.regions());
    let (modalities, rows) = (senses(map), map.body_rows().0);
    let mut patches = Vec::new();
    for (id, offset) in map.patches.ids().zip(offsets) {
        let patch = &map.patches[id];
        let unfolding = Unfolding::new(patch).map_err(|e| Error::from(e).in_patch(&patch.name))?;
        let mut header = pack_patch(packer, map, patch, (&unfolding, &regions.of_taxels[id]), offset);
        header.pack_body(packer, rows.iter().map(|of_patches| &of_patches[id]));
        header.pack_senses(packer, &patch.taxels, &modalities);
        patches.push(header);
    }
    let body = map.body.levels.iter().map(|level| level.origins.len()).collect();
    let links = map.links.iter().zip(link_names(&map.links));
    let links =
        links.map(|(link, name)| LinkHeader { name, parent: link.parent.map(|p| p.index()) }).collect();
    let regions = regions.names.iter().map(ToString::to_string).collect();
    Ok(SkinHeader { links, patches, regions, modalities, body })
}

/// Packs a patch and the regions of its taxels; its map lies at `offset` on the sheet.
fn pack_patch(
    packer: &mut Packer,
    map: &SkinMap,
    patch: &PatchMap,
    (unfolding, of_taxels): (&Unfolding, &IdVec<VertexId, Option<RegionId>>),
    offset: DVec2,
) -> PatchHeader {
    let finest = &patch.levels[LevelId::default()];
    let taxels = finest.level.mesh.positions.len();
    let (positions, space) = packer.points(&[finest.level.mesh.positions.as_slice()]);
    let (places, of_map) = packer.places(finest.uv.as_slice());
    let corner = |k: usize| finest.corners().iter().map(|c| c[k].raw()).collect();
    let triangles = packer.planes(&[corner(0), corner(1), corner(2)]);
    let unsplit = finest.unsplit().map(|all| all.iter().skip(taxels).map(|v| v.raw()).collect());
    let unsplit = packer.planes(&[unsplit.unwrap_or_default()]);
    let of = &patch.taxels;
    let ids = packer.planes(&[of.ids.iter().map(|id| id.0).collect()]);
    let presence = of.presence.iter().map(|presence| match presence {
        Presence::Absent => 0,
        Presence::Present => 1,
        Presence::ThermalPad => 2,
        Presence::Other => 3,
    });
    let presence = packer.planes(&[presence.collect()]);
    let region = of_taxels.iter().map(|region| region.map_or(0, |region| region.raw() + 1));
    let region = packer.planes(&[region.collect()]);
    let areas = packer.values("area", "m²", of.areas.as_slice());
    let [a, b, c] = &unfolding.keys;
    let (keys, between) = packer.points(&[a.as_slice(), b.as_slice(), c.as_slice()]);
    let most_turn = unfolding.turns.iter().map(|turn| turn.abs().max_element()).fold(1e-9, f64::max);
    let turn = |axis: usize| -> Vec<u32> {
        let of = |turn: &DVec3| share(turn[axis] + most_turn, 2.0 * most_turn);
        unfolding.turns.iter().map(of).collect()
    };
    let turns = packer.planes(&[turn(0), turn(1), turn(2)]);
    let key_origins = packer.planes(&[unfolding.origins.iter().map(|place| place.raw()).collect()]);
    let mut values = Vec::new();
    // The page has no colour for an unknown number.
    let sigma = |c: &Option<Covariance>| c.map(|c| 1e3 * c.sigma());
    let sigmas = of.covariances.as_ref().and_then(|all| all.iter().map(sigma).collect::<Option<Vec<f64>>>());
    if let Some(sigmas) = sigmas {
        values.push(packer.values("sigma", "mm", &sigmas));
    }
    if let Some(densities) = &of.densities {
        let per_cm2: Vec<f64> = densities.iter().map(|d| 1e-4 * d).collect();
        values.push(packer.values("density", "1/cm²", &per_cm2));
    }
    if let Some(acuities) = &of.acuities {
        values.push(packer.values("acuity", "", acuities.as_slice()));
    }
    let levels: Vec<LevelHeader> = patch.levels.ids().map(|level| pack_level(packer, patch, level)).collect();
    let key_rows = match &unfolding.rows {
        // The rows are the same where places are taxels.
        Some(_) if finest.cut.is_none() => levels[unfolding.level.index()].direct.clone(),
        rows => rows.as_ref().map(|rows| {
            packer.rows(rows.iter().map(|(named, weights)| (named.map(PlaceId::raw), *weights)), 255)
        }),
    };
    PatchHeader {
        name: patch.name.clone(),
        link: patch.link.index(),
        taxels,
        filled: patch.filled,
        pose: world_pose(&map.links, patch.link).to_cols_array(),
        sheet: unfolding.sheet.to_cols_array(),
        offset: offset.to_array(),
        space,
        map: of_map,
        between,
        most_turn,
        positions,
        places,
        triangles,
        unsplit,
        ids,
        presence,
        senses: 0,
        region,
        areas,
        keys,
        turns,
        key_origins,
        key_rows,
        values,
        levels,
        body: Vec::new(),
    }
}

/// What taxels of a map sense besides touch, in the order of their first ones.
fn senses(map: &SkinMap) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for of in map.patches.iter().map(|patch| &patch.taxels) {
        for name in
            of.ids.ids().map(|taxel| of.modalities_of(taxel)).filter(|name| !["", TOUCH].contains(name))
        {
            if !all.iter().any(|known| known == name) {
                all.push(name.to_owned());
            }
        }
    }
    all
}

impl PatchHeader {
    /// Packs what its taxels sense, as numbers in a list of [`senses`].
    pub(super) fn pack_senses(&mut self, packer: &mut Packer, taxels: &Taxels, known: &[String]) {
        let number = |taxel| {
            let name = taxels.modalities_of(taxel);
            (1..).zip(known).find(|(_, known)| *known == name).map_or(0, |(number, _)| number)
        };
        self.senses = packer.planes(&[taxels.ids.ids().map(number).collect()]);
    }

    /// Packs its taxels in terms of the fields of the levels of the whole body.
    pub(super) fn pack_body<'a>(
        &mut self,
        packer: &mut Packer,
        levels: impl Iterator<Item = &'a Prolongation>,
    ) {
        for rows in levels {
            let rows = rows.indices.iter().zip(&rows.weights);
            self.body
                .push(packer.rows(rows.map(|(named, weights)| (named.map(VertexId::raw), *weights)), 255));
        }
    }
}

fn pack_level(packer: &mut Packer, patch: &PatchMap, id: LevelId) -> LevelHeader {
    let (finest, map) = (&patch.levels[LevelId::default()], &patch.levels[id]);
    let origins = origins(finest, map);
    let mut edges: Vec<[PlaceId; 2]> = Vec::new();
    for corners in map.corners().iter() {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]].map(|place| origins[place]);
            edges.push([a.min(b), a.max(b)]);
        }
    }
    edges.sort_unstable();
    edges.dedup();
    let end = |k: usize| edges.iter().map(|edge| edge[k].raw()).collect();
    let edges = packer.planes(&[end(0), end(1)]);
    let origins = packer.planes(&[map.level.origins.iter().map(|v| v.raw()).collect()]);
    let direct = map.level.to_finest.as_ref().map(|rows| {
        let rows = rows.indices.iter().zip(&rows.weights);
        packer.rows(rows.map(|(named, weights)| (named.map(VertexId::raw), *weights)), 255)
    });
    LevelHeader { vertices: map.level.mesh.positions.len(), edges, origins, direct }
}

/// The offset of the map of each patch on the sheet, in m: on shelves, in their order.
fn sheet_offsets(map: &SkinMap) -> IdVec<PatchId, DVec2> {
    let boxes = map.patches.map(|patch| {
        let uv = &patch.levels[LevelId::default()].uv;
        rectangle_around(uv.iter().copied())
    });
    let area: f64 = boxes.iter().map(|(lo, hi)| (hi.x - lo.x) * (hi.y - lo.y)).sum();
    let gap = if boxes.len() > 1 { GAP * area.sqrt() } else { 0.0 };
    let widest = boxes.iter().map(|(lo, hi)| hi.x - lo.x).fold(0.0, f64::max);
    let width = widest.max((ASPECT * area).sqrt() * 1.1 + gap);
    let (mut shelf, mut high, mut x) = (0.0, 0.0_f64, 0.0);
    let mut corners = Vec::new();
    for (lo, hi) in &boxes {
        let size = *hi - *lo;
        if x > 0.0 && x + size.x > width {
            (shelf, high, x) = (shelf + high + gap, 0.0, 0.0);
        }
        corners.push((DVec2::new(x, shelf), size.y));
        (x, high) = (x + size.x + gap, high.max(size.y));
    }
    // Shelves are filled from the top down.
    let top = shelf + high;
    let place = |((lo, _), (corner, height)): (&(DVec2, DVec2), (DVec2, f64))| {
        DVec2::new(corner.x, top - corner.y - height) - *lo
    };
    boxes.iter().zip(corners).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn maps_on_the_sheet_do_not_overlap() {
        let one = SkinMap::flat(shapes::lattice(9, 5, 0.01), 1e-3);
        let mut map = SkinMap { patches: IdVec::default(), ..one.clone() };
        for _ in 0..7 {
            map.patches.push(one.patches[PatchId::new(0)].clone());
        }
        let boxes: Vec<(DVec2, DVec2)> = sheet_offsets(&map)
            .iter()
            .zip(&map.patches)
            .map(|(&offset, patch)| {
                let uv = patch.levels[LevelId::default()].uv.iter();
                rectangle_around(uv.map(|&at| at + offset))
            })
            .collect();
        for (k, (lo, hi)) in boxes.iter().enumerate() {
            assert!(lo.min_element() > -1e-12, "{lo} is on the sheet");
            for (other_lo, other_hi) in &boxes[..k] {
                let apart = lo.x > other_hi.x || other_lo.x > hi.x || lo.y > other_hi.y || other_lo.y > hi.y;
                assert!(apart, "{lo} to {hi} meets {other_lo} to {other_hi}");
            }
        }
    }
}
