//! Contacts on the levels of the whole body and of modalities, which have fields and no map.

use dermatome::body::FieldLevel;
use dermatome::contact::{Cell, FieldCells};
use dermatome::id::{IdVec, VertexId};
use dermatome::map::SkinMap;
use dermatome::pyramid::LevelId;
use dermatome::skin::{PatchId, Presence};

/// A level without a mesh, for the patches that are chosen.
pub(super) struct Fields {
    pub(super) level: LevelId,
    pub(super) name: String,
    /// Whether it is of the whole body.
    pub(super) is_of_body: bool,
    cells: FieldCells,
    /// What the taxel at the centre of each field is, and the region of the field.
    fields: IdVec<VertexId, (Presence, Option<String>)>,
}

impl Fields {
    /// A level of a map, with the fields of the patches for which `is_chosen`.
    pub(super) fn new(
        map: &SkinMap,
        (at, name): (FieldLevel, String),
        is_chosen: impl Fn(PatchId) -> bool,
    ) -> Self {
        let regions = map.regions();
        let regions_of = regions.of_fields(&map.field_rows(at));
        let origins = map.fields_of(at).into_iter().flat_map(|fields| fields.origins.iter());
        let field = |(centre, region): (&dermatome::body::BodyTaxel, &Option<_>)| {
            let region = region.map(|region| regions.names[region].to_string());
            (map.patches[centre.patch].taxels.presence[centre.taxel], region)
        };
        let fields = origins.zip(&regions_of).map(field).collect();
        let cells = FieldCells::new(map, at, map.patches.ids().filter(|patch| is_chosen(*patch)));
        let is_of_body = at
            .modality
            .and_then(|number| map.body.modalities.get(number))
            .is_none_or(|modality| modality.patch.is_none());
        Self { level: at.level, name, is_of_body, cells, fields }
    }

    /// The fields of a cell of level 0 of a patch, what the taxel at the centre of the strongest is, and its region; `None`
    /// if the patch has none.
    pub(super) fn cell(&self, patch: PatchId, finest: &Cell) -> Option<(Cell, Presence, Option<&str>)> {
        let cell = self.cells.cell(patch, finest)?;
        let (presence, ref region) = self.fields[cell.field];
        Some((cell, presence, region.as_deref()))
    }
}
