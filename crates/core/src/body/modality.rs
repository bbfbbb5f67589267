//! The fields of a modality on a patch or on the whole body, and the taxels and sensors in terms of them.

use std::iter::successors;

use crate::body::rows::{is_valid, own_rows, product, shifted, shrinks};
use crate::body::{Body, BodyLevel, BodyTaxel};
use crate::id::{IdVec, VertexId};
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::{PatchId, TOUCH, are_modalities};

/// Which level without a mesh: of the whole body, or of a modality by its number among those of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldLevel {
    /// The number of the modality; `None`: the whole body.
    pub modality: Option<usize>,
    /// The level.
    pub level: LevelId,
}

/// The fields of a modality besides touch on a patch, or on all patches that have sensors of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Modality {
    /// The patch; `None`: the whole body.
    pub patch: Option<PatchId>,
    /// The modality, such as `thermal`.
    pub name: String,
    /// The levels, finest first. Level 0 of a patch has a field for each sensor, in ascending order, and rows for the taxels
    /// of the patch. Level 0 of the body has rows for all sensors, patch after patch.
    pub levels: IdVec<LevelId, BodyLevel>,
}

impl Modality {
    /// The sensors in terms of the fields of each level, of the body those of its patches, patch after patch. A product of rows
    /// has its three largest weights, over their sum.
    pub fn sensor_rows(&self) -> IdVec<LevelId, Prolongation> {
        self.products(self.levels.iter().next().map(|level| match self.patch {
            Some(_) => own_rows(level.origins.len()),
            None => level.rows.clone(),
        }))
    }

    /// Rows for the fields of each level, from those for level 0.
    fn products(&self, finest: Option<Prolongation>) -> IdVec<LevelId, Prolongation> {
        let mut coarser = self.levels.iter().skip(1);
        successors(finest, |rows| Some(product(rows, &coarser.next()?.rows))).collect()
    }

    /// The sensors of a patch.
    pub(crate) fn sensors(&self) -> impl Iterator<Item = BodyTaxel> + '_ {
        self.levels.iter().take(1).flat_map(|finest| finest.origins.iter().copied())
    }

    /// Checks the fields: each level has a row for each field of the level before, level 0 for each of `before`, and fewer
    /// fields, whose centres `exist`; those of level 0 of a patch ascend, and may be as many. Else the first level that is
    /// wrong.
    pub(crate) fn wrong_level(
        &self,
        mut before: usize,
        exists: impl Fn(&BodyTaxel) -> bool,
    ) -> Option<LevelId> {
        let is_there = |at: &BodyTaxel| self.patch.is_none_or(|patch| patch == at.patch) && exists(at);
        let is_wrong = |(number, level): &(LevelId, &BodyLevel)| {
            let has_fields = match (number.index(), self.patch) {
                (0, Some(_)) => {
                    !level.origins.is_empty() && level.origins.as_slice().is_sorted_by(|a, b| a < b)
                }
                _ => shrinks(&level.origins, before),
            };
            let is_right = has_fields && is_valid(level, before, is_there);
            before = level.origins.len();
            !is_right
        };
        let is_name = are_modalities(&self.name) && !self.name.contains('+') && self.name != TOUCH;
        if self.levels.is_empty() || !is_name {
            return Some(LevelId::default());
        }
        self.levels.enumerate().find(is_wrong).map(|(number, _)| number)
    }
}

impl Body {
    /// The modalities of patches whose sensors a modality is of: itself, or those of its name if it is of the whole body.
    pub fn parts<'b>(&'b self, whole: &'b Modality) -> impl Iterator<Item = (PatchId, &'b Modality)> {
        self.modalities.iter().filter_map(|part| {
            let patch = part.patch?;
            let is_part = part.name == whole.name && whole.patch.is_none_or(|of| of == patch);
            is_part.then_some((patch, part))
        })
    }

    /// The taxels of each patch that has sensors of a modality in terms of the fields of each of its levels. A product of
    /// rows has its three largest weights, over their sum.
    pub fn taxel_rows(&self, whole: &Modality) -> Vec<(PatchId, IdVec<LevelId, Prolongation>)> {
        let mut first = 0;
        let of_patch = |(patch, part): (PatchId, &Modality)| {
            let to_sensors = part.levels.iter().next().map(|finest| {
                let rows = shifted(&finest.rows, first);
                first += finest.origins.len();
                rows
            });
            let finest = match whole.patch {
                Some(_) => to_sensors,
                None => to_sensors
                    .zip(whole.levels.iter().next())
                    .map(|(rows, level)| product(&rows, &level.rows)),
            };
            (patch, whole.products(finest))
        };
        self.parts(whole).map(of_patch).collect()
    }

    /// The areas of the sensors of a modality, patch after patch, in m^2, from those of the taxels: each sensor stands for the
    /// taxels of its patch that are near it.
    ///
    /// # Panics
    /// If there is not one area for each taxel of a patch.
    pub fn sensor_areas<'a>(
        &self,
        modality: &Modality,
        taxels: impl Fn(PatchId) -> &'a IdVec<VertexId, f64>,
    ) -> IdVec<VertexId, f64> {
        let of_patch = |(patch, part): (PatchId, &Modality)| {
            let finest = part.levels.iter().next();
            finest.map(|finest| finest.rows.restrict(taxels(patch)))
        };
        self.parts(modality).filter_map(of_patch).flatten().collect()
    }

    /// The areas of the fields of each level of a modality, in m^2. Their sum is that of its patches.
    ///
    /// # Panics
    /// As [`Self::sensor_areas`].
    pub fn field_areas<'a>(
        &self,
        modality: &Modality,
        taxels: impl Fn(PatchId) -> &'a IdVec<VertexId, f64>,
    ) -> IdVec<LevelId, IdVec<VertexId, f64>> {
        let sensors = self.sensor_areas(modality, taxels);
        modality.sensor_rows().iter().map(|rows| rows.restrict(&sensors)).collect()
    }
}
