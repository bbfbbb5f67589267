//! Levels of fields without a mesh, by name: of the whole body, `body.L1`, and of modalities, `forearm.thermal.L1`.

use crate::body::{BodyLevel, FieldLevel};
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::PatchId;

impl SkinMap {
    /// The levels without a mesh and their names.
    pub fn field_levels(&self) -> impl Iterator<Item = (FieldLevel, String)> + '_ {
        let all = |name: String, modality: Option<usize>, levels: &IdVec<LevelId, BodyLevel>| {
            let named = |level| (FieldLevel { modality, level }, format!("{name}.L{level}"));
            levels.ids().map(named).collect::<Vec<_>>()
        };
        let modalities = self.body.modalities.iter().enumerate().flat_map(move |(number, modality)| {
            let name = format!("{}.{}", self.patches[modality.patch].name, modality.name);
            all(name, Some(number), &modality.levels)
        });
        all("body".into(), None, &self.body.levels).into_iter().chain(modalities)
    }

    /// The fields of a level without a mesh; `None` if the map has no such level.
    pub fn fields_of(&self, at: FieldLevel) -> Option<&BodyLevel> {
        match at.modality {
            None => self.body.levels.get(at.level),
            Some(number) => self.body.modalities.get(number)?.levels.get(at.level),
        }
    }

    /// The taxels of each patch in terms of the fields of such a level; `None` for a patch without fields, and for all if
    /// the map has no such level.
    pub fn field_rows(&self, at: FieldLevel) -> IdVec<PatchId, Option<Prolongation>> {
        let modality = at.modality.and_then(|number| self.body.modalities.get(number));
        let mut rows = match (at.modality, modality) {
            (None, _) => {
                let of_body = self.body_rows().0;
                return self.patches.ids().map(|patch| Some(of_body.get(at.level)?[patch].clone())).collect();
            }
            (_, found) => found.map(|modality| (modality.patch, modality.taxel_rows())),
        };
        let of_patch = |id| {
            let (_, levels) = rows.take_if(|(patch, _)| *patch == id)?;
            levels.get(at.level).cloned()
        };
        self.patches.ids().map(of_patch).collect()
    }

    /// The areas of the fields of such a level, in m^2; none if the map has no such level.
    pub fn field_areas(&self, at: FieldLevel) -> IdVec<VertexId, f64> {
        let Some(fields) = self.fields_of(at) else { return IdVec::default() };
        if let Some(modality) = at.modality.and_then(|number| self.body.modalities.get(number)) {
            let mut areas = modality.field_areas(&self.patches[modality.patch].taxels.areas);
            return std::mem::take(&mut areas[at.level]);
        }
        let mut sums = IdVec::filled(0.0, fields.origins.len());
        for (rows, patch) in self.field_rows(at).iter().zip(&self.patches) {
            let areas = rows.as_ref().map(|rows| rows.restrict(&patch.taxels.areas));
            sums.iter_mut().zip(areas.iter().flatten()).for_each(|(sum, area)| *sum += area);
        }
        sums
    }
}
