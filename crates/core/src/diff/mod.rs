//! What changed between two files of one skin: after a repair, a new calibration, or a new version of its CAD file.
//!
//! Taxels are matched by id. The frames of each link are aligned by a robust rigid motion, since a calibration
//! determines its frame only as well as its contacts do. What is left over, `d = b - T a`, is compared with that of the
//! neighbours, so that an error which a whole region shares is no change, and tested against its spread over the link:
//! first whole modules, which are rigid, then single taxels. A change has a chance below [`DiffOptions::chance`] in the
//! whole file if nothing changed (Bonferroni). Where differences do not depend on those of the neighbours, as white
//! noise, taxels and modules are compared with the whole link by chi-square and F tests (`independent`). Links are matched by name, those without by their taxels; normals,
//! areas, modules, modalities and regions of taxels are compared, too; weights, densities and acuities are not. Taxels that share an id are
//! told apart by the names of their links and patches.
//!
//! ```
//! use dermatome::diff::{ChangeKind, DiffOptions, diff};
//! use dermatome::mesh::shapes;
//! use dermatome::skin::{Draft, Sheet, TaxelId};
//!
//! let positions = shapes::lattice(8, 8, 0.005).positions.as_slice().to_vec();
//! let ids = Some((1..=64).map(TaxelId).collect());
//! let before = Draft { sheets: vec![Sheet { positions, ids, ..Sheet::default() }], ..Draft::default() };
//! let mut after = before.clone();
//! after.sheets[0].positions[20].x += 0.002;
//! let found = diff(&before, &after, &DiffOptions::default())?;
//! assert_eq!(found.changes.len(), 1);
//! assert_eq!((found.changes[0].kind, &found.changes[0].taxels[..]), (ChangeKind::Moved, &[TaxelId(21)][..]));
//! # Ok::<(), dermatome::diff::DiffError>(())
//! ```
//!
//! Not guaranteed: where more than half of a link changed, the rest is reported instead. The spread is an estimate from
//! the differences themselves: of 100 pairs of calibrations of one skin with 47 modules, none showed a change.

mod align;
mod attributes;
mod change;
mod comparison;
mod explain;
mod independent;
mod modules;
mod pairs;
mod spread;
mod taxels;

pub use change::{AlignedLink, Change, ChangeKind, Diff, DiffError, DiffOptions, MatchedBy, Subject};

use crate::skin::Draft;
use pairs::Pairs;

/// Compares two files of one skin.
///
/// # Errors
/// [`DiffError`] if no taxel is in both, a link is missing or not rigid, or an option is out of range.
pub fn diff(before: &Draft, after: &Draft, options: &DiffOptions) -> Result<Diff, DiffError> {
    if let Some(sigma) = options.sigma.filter(|sigma| !(1e-9..=1.0).contains(sigma)) {
        return Err(DiffError::Option { name: "sigma", found: sigma, needed: "of m from 1e-9 to 1" });
    }
    if !(options.chance > 0.0 && options.chance < 1.0) {
        return Err(DiffError::Option { name: "chance", found: options.chance, needed: "between 0 and 1" });
    }
    let pairs = Pairs::new([before, after], &options.modules)?;
    let (links, changes) = explain::explain(&pairs, options);
    Ok(Diff {
        by: pairs.by,
        matched: pairs.links.values().map(|link| link.pairs.len() + link.relinked.len()).sum(),
        ambiguous: pairs.ambiguous,
        links,
        changes,
    })
}
