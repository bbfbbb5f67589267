//! Remarks on maps that lie over themselves, and what to do about it.

use dermatome::{
    flatten::{FlattenOptions, Method},
    report::PatchReport,
};

use crate::{Common, tables::plain};

/// Says which maps have flipped triangles or cross themselves, one line a patch: a user must hear of it.
pub(crate) fn note_overlaps(patches: &[PatchReport], options: &FlattenOptions, common: &Common) {
    for patch in patches.iter().filter(|_| !common.quiet) {
        let faulty = patch.levels.iter().filter(|l| l.distortion.flips + l.distortion.crossings > 0);
        let levels: Vec<String> = faulty
            .map(|l| {
                format!("L{}: flips {}, crossings {}", l.level, l.distortion.flips, l.distortion.crossings)
            })
            .collect();
        if !levels.is_empty() {
            let (name, cure) = (plain(&patch.name), cure(options));
            eprintln!("note: {name}: the map lies over itself ({}); {cure}", levels.join("; "));
        }
    }
}

fn cure(options: &FlattenOptions) -> &'static str {
    match options.method {
        Method::Intrinsic => "--bijective prevents that",
        Method::Linear if options.area > 0.0 => {
            "try --area 0, or --method intrinsic, which flips none; with --bijective nothing crosses either"
        }
        Method::Linear | Method::Conformal => {
            "--method intrinsic flips none; with --bijective nothing crosses either"
        }
    }
}
