//! The drawing of a skin that `calibrate --cad` reads: taxels with the names of their modules and patches.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use anyhow::Context;
use dermatome::Error;
use dermatome::calib::{BodyCalibration, CadSkin, CalibratedTaxel, NamedTaxel};
use dermatome::io::{TaxelTable, read_draft, read_modules, read_modules_if_any};
use dermatome::skin::{AssembleOptions, Draft, Sheet, Skin, TaxelId, assemble};

use crate::calibrate::cad_args::CadArgs;
use crate::console::errors::advise;
use crate::console::notes::{note_columns, note_remarks};
use crate::files::outputs;
use crate::options::Common;

/// A drawing as a file has it, and as bodies.
pub(super) struct Drawing {
    draft: Draft,
    pub(super) cad: CadSkin,
}

impl Drawing {
    pub(super) fn read(path: &Path, args: &CadArgs, common: &Common) -> anyhow::Result<Self> {
        let draft = read_draft(path).map_err(Error::from)?;
        outputs::add_inputs(&draft.files, &common.outputs);
        check_links(&draft, path)?;
        let patches = patch_names(&draft.sheets);
        let modules = Modules::find(path, args, &draft, common)?;
        let mut names = Vec::new();
        for (sheet, patch) in draft.sheets.iter().zip(&patches) {
            let ids = sheet.ids.as_deref().filter(|ids| ids.len() == sheet.positions.len());
            let ids = ids.ok_or_else(|| {
                let what = format!("{}: patch {patch} has no ids of taxels", path.display());
                advise(what, "give a drawing with ids: touches name the taxels that feel them")
            })?;
            for (k, &id) in ids.iter().enumerate() {
                let module = modules.of(sheet, patch, k, id).ok_or_else(|| {
                    let table = args.modules.as_deref().unwrap_or(path).display();
                    advise(format!("{table} has no module of taxel {id}"), "add a row for it")
                })?;
                let normal = sheet.normals.as_ref().and_then(|normals| normals.get(k)).copied();
                names.push((id, sheet.positions[k], normal, module, patch.as_str()));
            }
        }
        let taxels = names.iter().map(|(id, position, normal, module, patch)| NamedTaxel {
            id: *id,
            position: *position,
            normal: *normal,
            module,
            patch,
        });
        let cad = CadSkin::new(taxels).map_err(Error::from);
        let cad = cad.with_context(|| format!("the drawing {} cannot be used", path.display()))?;
        Ok(Self { draft, cad })
    }

    /// The skin of the drawing with its taxels where the fit places them.
    pub(super) fn calibrated(&self, found: &BodyCalibration, common: &Common) -> anyhow::Result<Skin> {
        let assembled = assemble(&self.draft, &AssembleOptions::default()).map_err(Error::from)?;
        note_remarks(&assembled.remarks, common);
        let mut skin = assembled.skin;
        let places: HashMap<TaxelId, &CalibratedTaxel> = found.taxels.iter().map(|t| (t.id, t)).collect();
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
            patch.taxels.covariances =
                Some(taxels.map(|taxel| taxel.map(|t| t.covariance).unwrap_or_default()));
        }
        Ok(skin)
    }
}

/// Touches are in the frame of one link.
fn check_links(draft: &Draft, path: &Path) -> anyhow::Result<()> {
    let first = draft.sheets.first().and_then(|sheet| sheet.link);
    if draft.sheets.iter().any(|sheet| sheet.link != first) {
        return Err(advise(
            format!("{} has patches on several links", path.display()),
            "calibrate the skin of one link at a time: touches are in its frame",
        ));
    }
    Ok(())
}

/// A name for each sheet, no two alike.
fn patch_names(sheets: &[Sheet]) -> Vec<String> {
    let mut seen = BTreeMap::new();
    let name = |sheet: &Sheet| {
        let name = if sheet.name.is_empty() { "skin" } else { &sheet.name };
        let count = seen.entry(name.to_owned()).or_insert(0);
        *count += 1;
        if *count == 1 { name.to_owned() } else { format!("{name}#{count}") }
    };
    sheets.iter().map(name).collect()
}

/// Where the modules of a drawing come from.
enum Modules {
    /// A table, or a column of the drawing.
    Named(HashMap<TaxelId, String>),
    /// Numbers in the drawing.
    Numbered,
    /// The pieces that are connected.
    Pieces(HashMap<TaxelId, String>),
}

impl Modules {
    fn find(path: &Path, args: &CadArgs, draft: &Draft, common: &Common) -> anyhow::Result<Self> {
        let of_table = |table: TaxelTable<_>| Self::Named(table.rows.into_iter().collect());
        if let Some(path) = &args.modules {
            let table = read_modules(path).map_err(Error::from)?;
            note_columns(path, &table.unused, common);
            return Ok(of_table(table));
        }
        if outputs::kind(path) == "csv"
            && let Some(table) = read_modules_if_any(path).map_err(Error::from)?
        {
            return Ok(of_table(table));
        }
        if draft.sheets.iter().all(|sheet| sheet.modules.is_some()) {
            return Ok(Self::Numbered);
        }
        let assembled = assemble(draft, &AssembleOptions::default()).map_err(Error::from)?;
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
