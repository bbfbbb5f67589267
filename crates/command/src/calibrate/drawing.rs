//! The drawing of a skin that `calibrate --cad` reads: taxels with the names of their modules and patches.

use std::path::Path;

use dermatome::Error;
use dermatome::calib::{BodyCalibration, CadSkin, CalibError, ModuleNames};
use dermatome::io::{modules_of_skin, read_draft, read_modules};
use dermatome::skin::{AssembleOptions, Draft, Skin, assemble};

use crate::calibrate::cad_args::CadArgs;
use crate::console::errors::advise;
use crate::console::notes::{note, note_remarks, rows_of};
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
        let modules = module_names(path, args, common)?;
        let shown = path.display();
        let cad = CadSkin::of_draft(&draft, modules.as_ref()).map_err(|error| match error {
            CalibError::CadOnSeveralLinks => advise(
                format!("{shown} has patches on several links"),
                "calibrate the skin of one link at a time: touches are in its frame",
            ),
            CalibError::CadWithoutIds { patch } => advise(
                format!("{shown}: patch {patch} has no ids of taxels"),
                "give a drawing with ids: touches name the taxels that feel them",
            ),
            CalibError::NoModule { id } => {
                let table = args.modules.as_deref().unwrap_or(path).display();
                advise(format!("{table} has no module of taxel {id}"), "add a row for it")
            }
            other => {
                anyhow::Error::from(Error::from(other)).context(format!("the drawing {shown} cannot be used"))
            }
        })?;
        if let Some(remark) = modules.and_then(|modules| cad.remark_of_modules(&modules)) {
            note!(common, "{remark}");
        }
        Ok(Self { draft, cad })
    }

    /// The skin of the drawing with its taxels where the fit places them.
    pub(super) fn calibrated(&self, found: &BodyCalibration, common: &Common) -> anyhow::Result<Skin> {
        let assembled = assemble(&self.draft, &AssembleOptions::default()).map_err(Error::from)?;
        note_remarks(&assembled.remarks, common);
        let mut skin = assembled.skin;
        found.move_taxels(&mut skin);
        Ok(skin)
    }
}

/// The modules of a table, or of a column of the drawing.
fn module_names(path: &Path, args: &CadArgs, common: &Common) -> anyhow::Result<Option<ModuleNames>> {
    if let Some(path) = &args.modules {
        return Ok(Some(rows_of(path, read_modules(path), common)?.into_iter().collect()));
    }
    let rows = modules_of_skin(path).map_err(Error::from)?;
    Ok(rows.map(|rows| rows.into_iter().collect()))
}
