//! Levels of fields without a mesh, by name: of the whole body, `body.L1`, and of modalities, `forearm.thermal.L1` and
//! `body.thermal.L1`.

use std::borrow::Cow;

use crate::body::{BodyLevel, FieldLevel, Modality, field_areas};
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::PatchId;

/// The name of the whole body among those of levels.
const BODY: &str = "body";

impl SkinMap {
    /// The levels without a mesh and their names. In these a patch called `body` next to levels of the whole body is
    /// `%62ody`, and one called `arm.thermal` next to a patch `arm` with that modality `arm%2ethermal`.
    pub fn field_levels(&self) -> impl Iterator<Item = (FieldLevel, String)> + '_ {
        let all = |name: String, modality: Option<usize>, levels: &IdVec<LevelId, BodyLevel>| {
            let named = |level| (FieldLevel { modality, level }, format!("{name}.L{level}"));
            levels.ids().map(named).collect::<Vec<_>>()
        };
        let modalities = self.body.modalities.iter().enumerate().flat_map(move |(number, modality)| {
            let of = self.name_in_levels(self.name_of(modality));
            let of = if modality.patch.is_some() { of } else { BODY.into() };
            all(format!("{of}.{}", modality.name), Some(number), &modality.levels)
        });
        all(BODY.into(), None, &self.body.levels).into_iter().chain(modalities)
    }

    /// The name of the patch of a modality, or of the body.
    fn name_of(&self, modality: &Modality) -> &str {
        modality.patch.map_or(BODY, |patch| &self.patches[patch].name)
    }

    /// The name of a patch in those of its levels.
    #[doc(hidden)]
    pub fn name_in_levels<'a>(&self, name: &'a str) -> Cow<'a, str> {
        let has_body = || self.body.modalities.iter().any(|modality| modality.patch.is_none());
        if name == BODY && (!self.body.levels.is_empty() || has_body()) {
            return "%62ody".into();
        }
        let is_taken = |(of, modality): (&str, &str)| {
            let mut all = self.body.modalities.iter();
            all.any(|other| other.name == modality && self.name_of(other) == of)
        };
        match name.rsplit_once('.').filter(|of| is_taken(*of)) {
            Some((of, modality)) => format!("{of}%2e{modality}").into(),
            None => name.into(),
        }
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
        let mut rows = IdVec::filled(None, self.patches.len());
        match at.modality {
            None => {
                let of_body = self.body_rows().0;
                let of_level =
                    of_body.get(at.level).into_iter().flat_map(|of_patches| of_patches.enumerate());
                of_level.for_each(|(patch, of_patch)| rows[patch] = Some(of_patch.clone()));
            }
            Some(number) => {
                let modality = self.body.modalities.get(number);
                for (patch, levels) in modality.into_iter().flat_map(|of| self.body.taxel_rows(of)) {
                    rows[patch] = levels.get(at.level).cloned();
                }
            }
        }
        rows
    }

    /// The areas of the fields of such a level, in m^2; none if the map has no such level.
    pub fn field_areas(&self, at: FieldLevel) -> IdVec<VertexId, f64> {
        if self.fields_of(at).is_none() {
            return IdVec::default();
        }
        if let Some(modality) = at.modality.and_then(|number| self.body.modalities.get(number)) {
            let mut areas = self.body.field_areas(modality, |patch| &self.patches[patch].taxels.areas);
            return std::mem::take(&mut areas[at.level]);
        }
        field_areas(&self.body_rows().0[at.level], self.patches.iter().map(|patch| &patch.taxels.areas))
    }
}
