//! Contacts on the levels of the whole body, which have fields and no map.

use dermatome::contact::Cell;
use dermatome::id::{IdVec, VertexId};
use dermatome::map::SkinMap;
use dermatome::pyramid::{LevelId, Prolongation};
use dermatome::skin::{PatchId, Presence, TaxelId};
use glam::DVec2;

/// A level of the whole body, for the patches that are chosen.
pub(super) struct BodyFields {
    pub(super) level: LevelId,
    rows: IdVec<PatchId, Prolongation>,
    /// The taxel at the centre of each field, and its region.
    fields: IdVec<VertexId, (TaxelId, Presence, Option<String>)>,
}

impl BodyFields {
    /// Some levels of a map, with the rows of the patches for which `is_chosen`.
    pub(super) fn new(map: &SkinMap, levels: &[LevelId], is_chosen: impl Fn(PatchId) -> bool) -> Vec<Self> {
        let (regions, rows) = (map.regions(), map.body_rows().0);
        let of_level = |&level: &LevelId| {
            let regions_of = regions.of_body_level(&rows[level]);
            let field = |field: VertexId| {
                let centre = map.body.levels[level].origins[field];
                let taxels = &map.patches[centre.patch].taxels;
                let region = regions_of[field].map(|region| regions.names[region].to_string());
                (taxels.ids[centre.taxel], taxels.presence[centre.taxel], region)
            };
            let of_patches = rows[level].enumerate().filter(|(patch, _)| is_chosen(*patch));
            Self {
                level,
                rows: of_patches.map(|(_, rows)| rows.clone()).collect(),
                fields: regions_of.ids().map(field).collect(),
            }
        };
        levels.iter().map(of_level).collect()
    }

    /// The fields of a cell of level 0 of a patch, what the taxel at the centre of the strongest is, and its region.
    pub(super) fn cell(&self, patch: PatchId, finest: &Cell) -> (Cell, Presence, Option<&str>) {
        let rows = &self.rows[patch];
        let of_taxel = |(taxel, share)| rows.row(taxel).map(move |(field, weight)| (field, share * weight));
        let weights: dermatome::contact::FieldWeights = finest.weights.iter().flat_map(of_taxel).collect();
        let stronger = |a: (VertexId, f64), b: (VertexId, f64)| if b.1 > a.1 { b } else { a };
        let field = weights.iter().reduce(stronger).map_or(VertexId::default(), |(field, _)| field);
        let (taxel, presence, ref region) = self.fields[field];
        let uv = DVec2::NAN;
        (Cell { level: self.level, uv, field, taxel, weights, ..*finest }, presence, region.as_deref())
    }
}
