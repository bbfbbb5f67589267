//! Reading a skin as every subcommand does: draft, assembly, remarks.

use std::path::Path;

use anyhow::Context;
use dermatome::{
    Error,
    io::read_draft,
    mesh::fill_holes,
    skin::{Draft, MeshOptions, RemarkKind, Skin, assemble, mesh_bare},
};

use crate::{
    common::Common,
    options::BareArgs,
    print::{line, plain},
};

/// Reads and assembles a skin, bare taxels too; what had to be changed is told on standard error.
pub(crate) fn read_skin(path: &Path, bare: &BareArgs, common: &Common) -> anyhow::Result<Skin> {
    let mut draft = read_draft(path).map_err(Error::from)?;
    let unsound = || format!("{} holds no sound skin", path.display());
    let bare_draft = draft.is_bare().then(|| draft.clone());
    if let Some(bare_draft) = &bare_draft {
        draft = mesh_bare(bare_draft, &bare.options()).map_err(Error::from).with_context(unsound)?;
    }
    let assembled = assemble(&draft).map_err(Error::from).with_context(unsound)?;
    if !common.quiet {
        for remark in &assembled.remarks {
            eprintln!("note: {}", line(&remark.to_string()));
        }
        if let Some(bare_draft) = bare_draft
            && assembled.remarks.iter().any(|r| r.kind == RemarkKind::Components)
            && let Some((gap, pieces)) = joining_gap(&bare_draft, bare, assembled.skin.patches.len())
        {
            eprintln!(
                "note: --gap {gap} would join pieces: {pieces} instead of {}",
                assembled.skin.patches.len()
            );
        }
    }
    Ok(assembled.skin)
}

/// The smallest of some wider gaps that leaves fewer pieces than `now`, and how many; tried, since the mesh alone tells.
fn joining_gap(bare_draft: &Draft, bare: &BareArgs, now: usize) -> Option<(f64, usize)> {
    /// Trials on more taxels would be felt.
    const MOST_TAXELS: usize = 20_000;
    const WIDER: [f64; 6] = [3.0, 3.5, 4.0, 5.0, 6.0, 8.0];
    if bare_draft.sheets.iter().map(|s| s.positions.len()).sum::<usize>() > MOST_TAXELS {
        return None;
    }
    WIDER.into_iter().filter(|&gap| gap > bare.options().gap).find_map(|gap| {
        let meshed = mesh_bare(bare_draft, &MeshOptions { gap }).ok()?;
        let pieces = assemble(&meshed).ok()?.skin.patches.len();
        (pieces < now).then_some((gap, pieces))
    })
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
