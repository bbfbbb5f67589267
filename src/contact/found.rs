//! From what was found to where it lies on the map.

use crate::{
    contact::{Cell, ContactIndex, FieldHit, Hit, Reactive, cell::Anchor},
    pyramid::LevelId,
};

/// What has a place on the map: see [`ContactIndex::cell`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Found<'a> {
    /// A point of level 0.
    Hit(&'a Hit),
    /// A point of a coarse level.
    Reactive(&'a Reactive),
    /// The centre of a field.
    Field(&'a FieldHit),
}

impl<'a> From<&'a Hit> for Found<'a> {
    fn from(hit: &'a Hit) -> Self {
        Self::Hit(hit)
    }
}

impl<'a> From<&'a Reactive> for Found<'a> {
    fn from(answer: &'a Reactive) -> Self {
        Self::Reactive(answer)
    }
}

impl<'a> From<&'a FieldHit> for Found<'a> {
    fn from(field: &'a FieldHit) -> Self {
        Self::Field(field)
    }
}

impl ContactIndex {
    /// Where something found lies on the map of `level`: a hit on any level of its patch, a reactive answer
    /// and a field on their own. `None` if its patch does not reach up to that level, if it is on another
    /// one, if a field belongs to no face, or if it is not from this index.
    #[must_use]
    pub fn cell<'a>(&self, found: impl Into<Found<'a>>, level: LevelId) -> Option<Cell> {
        match found.into() {
            Found::Hit(hit) => {
                let patch = self.patches.get(hit.patch)?;
                patch.cells.cell(level, &Anchor::new(&patch.tree.mesh, &hit.point)?)
            }
            Found::Reactive(answer) => {
                let patch = self.patches.get(answer.patch).filter(|_| answer.level == level)?;
                patch.cells.own_cell(level, &answer.point)
            }
            Found::Field(field) => {
                let patch = self.patches.get(field.patch).filter(|_| field.level == level)?;
                patch.cells.field_cell(level, field.field)
            }
        }
    }
}
