//! Reading a skin as every subcommand does: draft, assembly, remarks.

use std::path::Path;

use anyhow::Context;
use dermatome::{
    Error,
    io::{IoError, read_draft, read_map},
    map::SkinMap,
    skin::{AssembleOptions, Skin, assemble, joining_gap},
};

use crate::{common::Common, notes::note, outputs};

/// Reads and assembles a skin, bare taxels too; prints on standard error what had to be changed.
pub(crate) fn read_skin(path: &Path, options: &AssembleOptions, common: &Common) -> anyhow::Result<Skin> {
    let draft = read_draft(path).map_err(Error::from)?;
    let assembled = assemble(&draft, options)
        .map_err(Error::from)
        .with_context(|| format!("{} holds no sound skin", path.display()))?;
    assembled.remarks.iter().for_each(|remark| note(common, remark));
    // Trials take time, so there are none for a quiet run.
    if !common.quiet
        && let Some((gap, patches)) = joining_gap(&draft, &assembled, options)
    {
        let now = assembled.skin.patches.len();
        note(common, format_args!("--gap {gap} would join pieces: {patches} instead of {now}"));
    }
    Ok(assembled.skin)
}

/// The map of a file, if it has one; otherwise it may be a skin.
pub(crate) fn read_map_if_any(path: &Path) -> Result<Option<SkinMap>, Error> {
    if !matches!(outputs::kind(path).as_str(), "glb" | "gltf") {
        return Ok(None);
    }
    match read_map(path) {
        Ok(map) => Ok(Some(map)),
        Err(IoError::NoMap { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}
