//! The skin as it was drawn: taxels, the modules that carry them, and the patches that carry the modules.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use crate::calib::CalibError;
use crate::id::{IdVec, VertexId, define_id};
use crate::mesh::is_within_reach;
use crate::skin::{PatchId, TaxelId};

define_id!(
    /// A module: taxels on one rigid board.
    pub ModuleId, "module"
);

/// A taxel of the drawing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CadTaxel {
    /// The vendor's id; unique here.
    pub id: TaxelId,
    /// Its position, in m.
    pub position: DVec3,
    /// Its outward unit normal, if the drawing has one.
    pub normal: Option<DVec3>,
    /// The module that carries it.
    pub module: ModuleId,
}

/// A module of the drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct CadModule {
    /// Its name.
    pub name: String,
    /// The patch that carries it.
    pub patch: PatchId,
}

/// A taxel with the names of its module and patch, as files have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NamedTaxel<'n> {
    /// The vendor's id.
    pub id: TaxelId,
    /// Its position, in m.
    pub position: DVec3,
    /// Its outward normal, of any length; `None` or zero: unknown.
    pub normal: Option<DVec3>,
    /// Name of its module; a name may stand for one module in each patch.
    pub module: &'n str,
    /// Name of its patch.
    pub patch: &'n str,
}

/// A skin as it was drawn, in the frame of its link.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CadSkin {
    /// The taxels.
    pub taxels: IdVec<VertexId, CadTaxel>,
    /// The modules, in the order of their first taxels.
    pub modules: IdVec<ModuleId, CadModule>,
    /// Names of the patches, in the order of their first taxels.
    pub patches: IdVec<PatchId, String>,
}

impl CadSkin {
    /// The skin of taxels with names.
    ///
    /// # Errors
    /// As [`CadSkin::validate`].
    pub fn new<'n>(taxels: impl IntoIterator<Item = NamedTaxel<'n>>) -> Result<Self, CalibError> {
        let mut skin = Self::default();
        let (mut patches, mut modules) = (HashMap::new(), HashMap::new());
        for taxel in taxels {
            let patch =
                *patches.entry(taxel.patch).or_insert_with(|| skin.patches.push(taxel.patch.to_owned()));
            let module = *modules
                .entry((patch, taxel.module))
                .or_insert_with(|| skin.modules.push(CadModule { name: taxel.module.to_owned(), patch }));
            let normal = taxel.normal.and_then(DVec3::try_normalize);
            skin.taxels.push(CadTaxel { id: taxel.id, position: taxel.position, normal, module });
        }
        skin.validate()?;
        Ok(skin)
    }

    /// Checks everything that [`fit_bodies`](crate::calib::fit_bodies()) relies on.
    ///
    /// # Errors
    /// If there is no taxel, an id comes twice, a number is not finite, or a module or patch does not exist or
    /// has no taxel.
    pub fn validate(&self) -> Result<(), CalibError> {
        if self.taxels.is_empty() {
            return Err(CalibError::EmptyCad);
        }
        let (mut seen, mut carried) =
            (HashSet::new(), IdVec::<ModuleId, bool>::filled(false, self.modules.len()));
        for (vertex, taxel) in self.taxels.enumerate() {
            let id = taxel.id;
            if !seen.insert(id) {
                return Err(CalibError::DuplicateTaxel { id });
            }
            // Also refuses NaN.
            let is_unit = |n: DVec3| (n.length_squared() - 1.0).abs() < 1e-6;
            if !is_within_reach(taxel.position) || taxel.normal.is_some_and(|n| !is_unit(n)) {
                return Err(CalibError::InvalidCadTaxel { id });
            }
            let module = self.modules.get(taxel.module);
            if module.is_none_or(|m| self.patches.get(m.patch).is_none()) {
                return Err(CalibError::UnknownModule { id, vertex });
            }
            carried[taxel.module] = true;
        }
        match carried.enumerate().find(|(_, carries)| !**carries) {
            Some((module, _)) => Err(CalibError::EmptyModule { name: self.modules[module].name.clone() }),
            None => Ok(()),
        }
    }

    /// The taxels of every module, by ascending id: the order of their slots.
    pub(super) fn slots(&self) -> IdVec<ModuleId, Vec<VertexId>> {
        let mut slots = self.modules.map(|_| Vec::new());
        for (vertex, taxel) in self.taxels.enumerate() {
            slots[taxel.module].push(vertex);
        }
        slots.iter_mut().for_each(|list: &mut Vec<VertexId>| list.sort_by_key(|&v| self.taxels[v].id));
        slots
    }
}
