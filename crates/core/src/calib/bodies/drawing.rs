//! Drawings as files and skins have them: which module and which patch carries each taxel.

use std::collections::{HashMap, HashSet};

use super::cad::{CadSkin, ModuleId, NamedTaxel};
use super::result::{BodyCalibration, CalibratedTaxel};
use crate::calib::CalibError;
use crate::id::VertexId;
use crate::skin::sentence::first_few;
use crate::skin::{AssembleOptions, Draft, Names, Presence, Sheet, Skin, TaxelId, assemble};

/// The name of the module of each taxel, by its id.
pub type ModuleNames = HashMap<TaxelId, String>;

/// Where the modules of a drawing come from.
enum Modules<'m> {
    Named(&'m ModuleNames),
    /// Numbers in the drawing.
    Numbered,
    /// The pieces that are connected.
    Pieces(ModuleNames),
}

impl CadSkin {
    /// The bodies of a drawing as a file has it: its sheets are patches. Slots without a taxel, and those that share an id as a
    /// placeholder, are left out. Modules are those that are named, else those that the
    /// sheets count, else the pieces that are connected.
    ///
    /// # Errors
    /// If there are patches on several links, a patch without ids, a taxel without a module where modules are named, or the
    /// pieces cannot be assembled; as [`CadSkin::validate`].
    pub fn of_draft(draft: &Draft, modules: Option<&ModuleNames>) -> Result<Self, CalibError> {
        let first = draft.sheets.first().and_then(|sheet| sheet.link);
        if draft.sheets.iter().any(|sheet| sheet.link != first) {
            return Err(CalibError::CadOnSeveralLinks);
        }
        let mut names = Names::new(draft.sheets.iter().map(Sheet::title));
        let patches: Vec<String> = draft.sheets.iter().map(|sheet| names.next(sheet.title())).collect();
        let modules = Modules::find(draft, modules)?;
        let shared =
            shared_placeholders(draft.sheets.iter().filter_map(|sheet| sheet.ids.as_deref()).flatten());
        let mut taxels = Vec::new();
        for (sheet, patch) in draft.sheets.iter().zip(&patches) {
            let ids = sheet.ids.as_deref().filter(|ids| ids.len() == sheet.positions.len());
            let ids = ids.ok_or_else(|| CalibError::CadWithoutIds { patch: patch.clone() })?;
            let presence = |k: usize| sheet.presence.as_ref().and_then(|all| all.get(k));
            let is_taxel = |k: usize, id| presence(k) != Some(&Presence::Absent) && !shared.contains(&id);
            for (k, &id) in ids.iter().enumerate().filter(|&(k, id)| is_taxel(k, *id)) {
                let module = modules.of(sheet, patch, k, id).ok_or(CalibError::NoModule { id })?;
                let normal = sheet.normals.as_ref().and_then(|normals| normals.get(k)).copied();
                taxels.push((id, sheet.positions[k], normal, module, patch));
            }
        }
        Self::new(taxels.iter().map(|(id, position, normal, module, patch)| NamedTaxel {
            id: *id,
            position: *position,
            normal: *normal,
            module,
            patch,
        }))
    }

    /// The bodies of a skin: its patches, and the modules that are named; without names a patch is one module.
    ///
    /// # Errors
    /// If there are patches on several links, or a taxel without a module where modules are named; as [`CadSkin::validate`].
    pub fn of_skin(skin: &Skin, modules: Option<&ModuleNames>) -> Result<Self, CalibError> {
        let first = skin.patches.iter().next().map(|patch| patch.link);
        if skin.patches.iter().any(|patch| Some(patch.link) != first) {
            return Err(CalibError::CadOnSeveralLinks);
        }
        let shared = shared_placeholders(skin.patches.iter().flat_map(|patch| &patch.taxels.ids));
        let mut taxels = Vec::new();
        for patch in &skin.patches {
            let is_taxel =
                |v: VertexId, id| patch.taxels.presence[v] != Presence::Absent && !shared.contains(&id);
            for (v, &id) in patch.taxels.ids.enumerate().filter(|&(v, id)| is_taxel(v, *id)) {
                let module = match modules {
                    Some(names) => names.get(&id).ok_or(CalibError::NoModule { id })?,
                    None => &patch.name,
                };
                let (position, normal) = (patch.mesh.positions[v], patch.taxels.normals[v]);
                taxels.push(NamedTaxel { id, position, normal: Some(normal), module, patch: &patch.name });
            }
        }
        Self::new(taxels)
    }

    /// Names the taxels whose modules are given, but that this skin does not have, if there are some.
    pub fn remark_of_modules(&self, modules: &ModuleNames) -> Option<String> {
        let drawn: HashSet<TaxelId> = self.taxels.iter().map(|taxel| taxel.id).collect();
        let mut others: Vec<TaxelId> = modules.keys().copied().filter(|id| !drawn.contains(id)).collect();
        others.sort_unstable();
        let named = first_few(&others);
        (!others.is_empty())
            .then(|| format!("modules of taxels that are not in the drawing are passed over: {named}"))
    }
}

impl BodyCalibration {
    /// What looks wrong and what was not used, a sentence each; `cad` is the drawing that was fitted.
    pub fn remarks(&self, cad: &CadSkin) -> Vec<String> {
        let name = |module: ModuleId| format!("`{}`", cad.modules[module].name);
        let mut said = Vec::new();
        for &[a, b] in &self.misassembled.exchanged {
            let (a, b) = (name(a), name(b));
            said.push(format!("modules {a} and {b} look exchanged: each fits best in the other's place"));
        }
        for turned in &self.misassembled.turned {
            let (module, degrees) = (name(turned.module), turned.degrees);
            said.push(format!("module {module} looks turned by {degrees} degrees about its normal"));
        }
        if !self.rejected.is_empty() {
            let (rejected, touches) = (self.rejected.len(), self.counts[0]);
            said.push(format!("{rejected} of {touches} touches were rejected as outliers"));
        }
        if !self.untouched.is_empty() {
            let names: Vec<String> = self.untouched.iter().map(|&module| name(module)).collect();
            let names = first_few(&names);
            said.push(format!("without a touch, a module keeps its drawn pose on its patch: {names}"));
        }
        if self.assumed_radii > 0 {
            let touches = self.assumed_radii;
            said.push(format!("{touches} touches have no radius of the body: it is taken from the others"));
        }
        said.extend(self.doubts());
        said
    }

    /// Moves the taxels of a skin to where the fit places them, with their covariances. A taxel that is not in the fit
    /// stays, and its covariance is unknown.
    pub fn move_taxels(&self, skin: &mut Skin) {
        let places: HashMap<TaxelId, &CalibratedTaxel> = self.taxels.iter().map(|t| (t.id, t)).collect();
        for patch in skin.patches.iter_mut() {
            let taxels = patch.taxels.ids.map(|id| places.get(id).copied());
            for ((position, normal), taxel) in
                patch.mesh.positions.iter_mut().zip(patch.taxels.normals.iter_mut()).zip(&taxels)
            {
                if let Some(taxel) = taxel {
                    *position = taxel.position;
                    *normal = taxel.normal.unwrap_or(*normal);
                }
            }
            // Tangents of the drawing are not perpendicular to normals that turned.
            patch.taxels.tangents = None;
            patch.taxels.covariances = Some(taxels.map(|taxel| taxel.map(|t| t.covariance)));
        }
    }
}

/// The placeholders that several slots have as their id.
fn shared_placeholders<'i>(ids: impl Iterator<Item = &'i TaxelId> + Clone) -> Vec<TaxelId> {
    let is_shared = |id: &TaxelId| ids.clone().filter(|other| *other == id).count() > 1;
    TaxelId::PLACEHOLDERS.into_iter().filter(is_shared).collect()
}

impl<'m> Modules<'m> {
    fn find(draft: &Draft, named: Option<&'m ModuleNames>) -> Result<Self, CalibError> {
        if let Some(named) = named {
            return Ok(Self::Named(named));
        }
        if draft.sheets.iter().all(|sheet| sheet.modules.is_some()) {
            return Ok(Self::Numbered);
        }
        let assembled = assemble(draft, &AssembleOptions::default())
            .map_err(|error| CalibError::CadPieces(Box::new(error)))?;
        let pieces = assembled.skin.patches.iter();
        let named = pieces.flat_map(|patch| patch.taxels.ids.iter().map(|id| (*id, patch.name.clone())));
        Ok(Self::Pieces(named.collect()))
    }

    /// The name of the module of a taxel.
    fn of(&self, sheet: &Sheet, patch: &str, vertex: usize, id: TaxelId) -> Option<String> {
        match self {
            Self::Named(names) => names.get(&id).cloned(),
            Self::Numbered => sheet.modules.as_ref()?.get(vertex).map(u32::to_string),
            // Taxels that no triangle uses move with their patch.
            Self::Pieces(names) => Some(names.get(&id).cloned().unwrap_or_else(|| patch.to_owned())),
        }
    }
}
