//! Contacts on the levels of the whole body and of modalities, which have fields and no map.

use glam::DVec2;

use crate::body::FieldLevel;
use crate::contact::{Cell, FieldWeights};
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::{PatchId, TaxelId};

/// The fields of a level without a mesh, for contacts. They are those of the links at rest, wherever the links are.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldCells {
    level: LevelId,
    /// Of each patch; `None` where it has no such fields.
    rows: IdVec<PatchId, Option<Prolongation>>,
    /// The taxel at the centre of each field.
    centres: IdVec<VertexId, TaxelId>,
}

impl FieldCells {
    /// Those of a level of a map, for some of its patches, which are numbered in this order from 0 on. Without such a level no
    /// patch has fields.
    ///
    /// ```
    /// use dermatome::{body::FieldLevel, contact::{ContactIndex, FieldCells}, mesh::shapes, pipeline::{BuildOptions, build}};
    /// use dermatome::{pyramid::LevelId, skin::{LinkId, Patch, Skin}};
    /// use glam::DVec3;
    ///
    /// // Two sheets with a gap of 10 mm between them.
    /// let mut skin = Skin::from_mesh("left", shapes::lattice(8, 8, 0.005));
    /// let mut right = shapes::lattice(8, 8, 0.005);
    /// right.positions.iter_mut().for_each(|x| x.x += 0.045);
    /// skin.patches.push(Patch::from_mesh("right", LinkId::new(0), right));
    /// let map = build(&skin, &BuildOptions::default())?;
    /// let level = FieldLevel { modality: None, level: LevelId::new(0) };
    /// let (index, cells) = (ContactIndex::new(&map)?, FieldCells::new(&map, level, map.patches.ids()));
    /// let hit = index.locate(DVec3::new(0.034, 0.02, 0.001))?;
    /// let cell = index.cell(&hit, LevelId::new(0)).and_then(|finest| cells.cell(hit.patch, &finest));
    /// let weights: f64 = cell.iter().flat_map(|cell| cell.weights.iter()).map(|(_, weight)| weight).sum();
    /// assert!((weights - 1.0).abs() < 1e-12);
    /// # Ok::<(), dermatome::Error>(())
    /// ```
    ///
    /// # Panics
    /// If the map has no such patch.
    pub fn new(map: &SkinMap, at: FieldLevel, patches: impl IntoIterator<Item = PatchId>) -> Self {
        let rows = map.field_rows(at);
        let centres = map.fields_of(at).into_iter().flat_map(|fields| fields.origins.iter());
        Self {
            level: at.level,
            rows: patches.into_iter().map(|patch| rows[patch].clone()).collect(),
            centres: centres.map(|centre| map.patches[centre.patch].taxels.ids[centre.taxel]).collect(),
        }
    }

    /// Number of fields.
    pub fn count(&self) -> usize {
        self.centres.len()
    }

    /// The fields of a contact by its cell on level 0 of a patch: the face is that of level 0, and there is no place on a map.
    /// `None` if the patch has no such fields.
    ///
    /// # Panics
    /// If there is no such patch.
    pub fn cell(&self, patch: PatchId, finest: &Cell) -> Option<Cell> {
        let rows = self.rows[patch].as_ref()?;
        let of_taxel = |(taxel, share)| rows.row(taxel).map(move |(field, weight)| (field, share * weight));
        let weights: FieldWeights = finest.weights.iter().flat_map(of_taxel).collect();
        let stronger = |a: (VertexId, f64), b: (VertexId, f64)| if b.1 > a.1 { b } else { a };
        let field = weights.iter().reduce(stronger).map_or(VertexId::default(), |(field, _)| field);
        Some(Cell {
            level: self.level,
            uv: DVec2::NAN,
            pixel: [u32::MAX; 2],
            field,
            taxel: self.centres[field],
            weights,
            ..*finest
        })
    }
}
