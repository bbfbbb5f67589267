//! Reading a skin as every subcommand does: draft, assembly, remarks.

use std::path::Path;

use anyhow::Context;
use dermatome::{
    Error,
    io::read_draft,
    mesh::fill_holes,
    skin::{RemarkKind, Skin, assemble, mesh_bare},
};

use crate::{
    Common,
    options::BareArgs,
    tables::{line, plain},
};

/// Reads and assembles a skin, bare taxels too; what had to be changed is told on standard error.
pub(crate) fn read_skin(path: &Path, bare: &BareArgs, common: &Common) -> anyhow::Result<Skin> {
    let mut draft = read_draft(path).map_err(Error::from)?;
    let unsound = || format!("{} holds no sound skin", path.display());
    let is_bare = draft.is_bare();
    if is_bare {
        draft = mesh_bare(&draft, &bare.options()).map_err(Error::from).with_context(unsound)?;
    }
    let assembled = assemble(&draft).map_err(Error::from).with_context(unsound)?;
    if !common.quiet {
        for remark in &assembled.remarks {
            eprintln!("note: {}", line(&remark.to_string()));
        }
        if is_bare && assembled.remarks.iter().any(|r| r.kind == RemarkKind::Components) {
            eprintln!("note: a larger --gap bridges wider gaps between pieces");
        }
    }
    Ok(assembled.skin)
}

/// Closes the small holes of every patch; what was closed is told on standard error.
pub(crate) fn close_holes(skin: &mut Skin, max_edges: usize, common: &Common) -> anyhow::Result<()> {
    for patch in skin.patches.iter_mut() {
        let closed =
            fill_holes(&mut patch.mesh, max_edges).map_err(|e| Error::from(e).in_patch(&patch.name))?;
        if !closed.is_empty() && !common.quiet {
            eprintln!(
                "note: {}: {} holes of at most {max_edges} edges closed",
                plain(&patch.name),
                closed.len()
            );
        }
    }
    Ok(())
}
