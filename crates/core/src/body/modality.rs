//! The fields of a modality on a patch, and the taxels and sensors in terms of them.

use std::iter::successors;

use crate::body::rows::{is_valid, product, shrinks};
use crate::body::{BodyLevel, BodyTaxel};
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

/// The fields of a modality besides touch on a patch.
#[derive(Debug, Clone, PartialEq)]
pub struct Modality {
    /// The patch.
    pub patch: PatchId,
    /// The modality, such as `thermal`.
    pub name: String,
    /// The levels, finest first: level 0 has a field for each sensor, in ascending order, and rows for the taxels of
    /// the patch.
    pub levels: IdVec<LevelId, BodyLevel>,
}

impl Modality {
    /// The taxels of the patch in terms of the fields of each level. A product of rows has its three largest weights, over
    /// their sum.
    pub fn taxel_rows(&self) -> IdVec<LevelId, Prolongation> {
        self.products(self.levels.iter().next().map(|level| level.rows.clone()))
    }

    /// The sensors in terms of the fields of each level, as [those of taxels](Self::taxel_rows).
    pub fn sensor_rows(&self) -> IdVec<LevelId, Prolongation> {
        let own = |level: &BodyLevel| Prolongation {
            indices: level.origins.ids().map(|field| [field; 3]).collect(),
            weights: level.origins.map(|_| [1.0, 0.0, 0.0]),
            coarse_len: level.origins.len(),
        };
        self.products(self.levels.iter().next().map(own))
    }

    /// The areas of the fields of each level, in m^2, from those of the taxels of the patch: each sensor stands for the
    /// taxels near it. Their sum is that of the patch.
    ///
    /// # Panics
    /// If there is not one area for each taxel.
    pub fn field_areas(&self, taxels: &IdVec<VertexId, f64>) -> IdVec<LevelId, IdVec<VertexId, f64>> {
        let Some(finest) = self.levels.iter().next() else { return IdVec::default() };
        let sensors = finest.rows.restrict(taxels);
        self.sensor_rows().iter().map(|rows| rows.restrict(&sensors)).collect()
    }

    /// Rows for the fields of each level, from those for level 0.
    fn products(&self, finest: Option<Prolongation>) -> IdVec<LevelId, Prolongation> {
        let mut coarser = self.levels.iter().skip(1);
        successors(finest, |rows| Some(product(rows, &coarser.next()?.rows))).collect()
    }

    /// Checks the fields against the number of taxels of their patch: each level has a row for each field of the level
    /// before, or for the taxels, and fewer fields, which lie on the patch; those of level 0 ascend. Else the first level
    /// that is wrong.
    pub(crate) fn wrong_level(&self, taxels: usize) -> Option<LevelId> {
        let mut before = taxels;
        let is_wrong = |(number, level): &(LevelId, &BodyLevel)| {
            let on_patch = |at: &BodyTaxel| at.patch == self.patch && at.taxel.index() < taxels;
            let has_fields = match number.index() {
                0 => !level.origins.is_empty() && level.origins.as_slice().is_sorted_by(|a, b| a < b),
                _ => shrinks(&level.origins, before),
            };
            let is_right = has_fields && is_valid(level, before, on_patch);
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
