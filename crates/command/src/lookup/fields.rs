//! Contacts on the levels of the whole body and of modalities, which have fields and no map.

use dermatome::body::FieldLevel;
use dermatome::contact::Cell;
use dermatome::id::{IdVec, VertexId};
use dermatome::map::SkinMap;
use dermatome::pyramid::{LevelId, Prolongation};
use dermatome::skin::{PatchId, Presence, TaxelId};
use glam::DVec2;

/// A level without a mesh, for the patches that are chosen.
pub(super) struct Fields {
    pub(super) level: LevelId,
    pub(super) name: String,
    /// Of the chosen patches; `None` where it is not of the patch.
    rows: IdVec<PatchId, Option<Prolongation>>,
    /// The taxel at the centre of each field, and its region.
    fields: IdVec<VertexId, (TaxelId, Presence, Option<String>)>,
}

impl Fields {
    /// A level of a map, with the rows of the patches for which `is_chosen`.
    pub(super) fn new(
        map: &SkinMap,
        (at, name): (FieldLevel, String),
        is_chosen: impl Fn(PatchId) -> bool,
    ) -> Self {
        let (regions, rows) = (map.regions(), map.field_rows(at));
        let regions_of = regions.of_fields(&rows);
        let origins = map.fields_of(at).into_iter().flat_map(|fields| fields.origins.iter());
        let field = |(centre, region): (&dermatome::body::BodyTaxel, &Option<_>)| {
            let taxels = &map.patches[centre.patch].taxels;
            let region = region.map(|region| regions.names[region].to_string());
            (taxels.ids[centre.taxel], taxels.presence[centre.taxel], region)
        };
        let fields = origins.zip(&regions_of).map(field).collect();
        let of_patches = rows.enumerate().filter(|(patch, _)| is_chosen(*patch));
        Self { level: at.level, name, rows: of_patches.map(|(_, rows)| rows.clone()).collect(), fields }
    }

    /// The fields of a cell of level 0 of a patch, what the taxel at the centre of the strongest is, and its region; `None`
    /// if the patch has none.
    pub(super) fn cell(&self, patch: PatchId, finest: &Cell) -> Option<(Cell, Presence, Option<&str>)> {
        let rows = self.rows[patch].as_ref()?;
        let of_taxel = |(taxel, share)| rows.row(taxel).map(move |(field, weight)| (field, share * weight));
        let weights: dermatome::contact::FieldWeights = finest.weights.iter().flat_map(of_taxel).collect();
        let stronger = |a: (VertexId, f64), b: (VertexId, f64)| if b.1 > a.1 { b } else { a };
        let field = weights.iter().reduce(stronger).map_or(VertexId::default(), |(field, _)| field);
        let (taxel, presence, ref region) = self.fields[field];
        let cell = Cell { level: self.level, uv: DVec2::NAN, field, taxel, weights, ..*finest };
        Some((cell, presence, region.as_deref()))
    }
}
