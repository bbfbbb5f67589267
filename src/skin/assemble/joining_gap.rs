//! Which gap would join the patches that bare taxels fall into.

use crate::{
    mesh::FillHoles,
    skin::{AssembleOptions, Assembled, Draft, Remark, RemarkKind, assemble},
};

/// Trials on more taxels would be felt: 20 000 take a second.
const MOST_TAXELS: usize = 20_000;

/// Gaps that are tried.
const WIDER: [f64; 6] = [3.0, 3.5, 4.0, 5.0, 6.0, 8.0];

/// The smallest of some gaps wider than [`AssembleOptions::gap`] that leaves fewer patches, and how
/// many.
///
/// `assembled` is what `options` made of `draft`. `None` if no wider gap helps, and without trial
/// for drafts with triangles, for bare sheets that are one patch each, and for more than 20 000
/// taxels. The gap is found by trying some.
#[must_use]
pub fn joining_gap(draft: &Draft, assembled: &Assembled, options: &AssembleOptions) -> Option<(f64, usize)> {
    let is_split = |r: &Remark| matches!(r.kind, RemarkKind::Components { .. });
    let taxels: usize = draft.sheets.iter().map(|s| s.positions.len()).sum();
    if !draft.is_bare() || taxels > MOST_TAXELS || !assembled.remarks.iter().any(is_split) {
        return None;
    }
    WIDER.into_iter().filter(|&gap| gap > options.gap).find_map(|gap| {
        let patches = assemble(draft, &AssembleOptions { gap, fill_holes: FillHoles::None, ..*options })
            .ok()?
            .skin
            .patches
            .len();
        (patches < assembled.skin.patches.len()).then_some((gap, patches))
    })
}
