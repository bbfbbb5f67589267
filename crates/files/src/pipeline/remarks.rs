//! What a user should know of a map that was built, as data: what was left out, what is poor, what was cut.

use std::fmt;

use crate::cut::Cut;
use crate::flatten::{Distortion, POOR_STRETCHES};
use crate::io::rounding_in_gltf;
use crate::pipeline::attempts::is_magnified;
use crate::pipeline::{BuildOptions, Built, Enlarged};
use crate::report::{LevelReport, PatchReport, measure};
use crate::skin::{PatchId, Skin, TaxelId};

/// A face of a coarse level with a larger s1/s2 is named: no face of a level has one without needles of the skin.
const EXTREME: f64 = 1000.0;

/// Names that a sentence quotes.
const NAMED: usize = 5;

/// One thing that a user should know of a skin or of its map; `Display` makes a sentence of it, without advice.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum BuildRemark {
    /// Positions of a patch are rounded in a `map.glb`, in m, as it is far from the origin of its link.
    Rounded {
        /// The patch.
        patch: String,
        /// How far at most, in m.
        moved: f64,
    },
    /// Taxels share an id that vendors write where they have none.
    Placeholders {
        /// How many have one.
        without: usize,
        /// Of how many.
        all: usize,
    },
    /// The map of a patch is cut open.
    Seam {
        /// The patch.
        patch: String,
        /// Length of the seam on the skin, in m.
        length: f64,
    },
    /// A patch could not be mapped and is not in the map.
    PatchLeftOut {
        /// Why, with its name.
        reason: String,
    },
    /// Coarse levels of a patch have no usable map.
    LevelsLeftOut {
        /// The patch.
        patch: String,
        /// How many, from the coarsest on.
        count: usize,
    },
    /// A patch has no usable map by the default energy, and one by the symmetric Dirichlet energy.
    OtherEnergy {
        /// The patch.
        patch: String,
    },
    /// Pixels are larger than 1 mm.
    LargePixels(Enlarged),
    /// Levels have flipped triangles, or a boundary that crosses itself.
    Overlap {
        /// The patch.
        patch: String,
        /// Number, flips and crossings of each such level.
        levels: Vec<[usize; 3]>,
    },
    /// Finest maps are poor.
    Poor {
        /// The patches, the worst first.
        patches: Vec<String>,
        /// The measures of the worst.
        worst: Distortion,
    },
    /// A coarse level has a face whose corners are almost on a line on the skin.
    Needle {
        /// The patch.
        patch: String,
        /// The level.
        level: usize,
        /// The largest s1/s2 of its faces.
        ratio: f64,
    },
    /// The map of a level is not at a minimum of its energy.
    NotAtMinimum {
        /// The patch.
        patch: String,
        /// The level.
        level: usize,
        /// The gradient at which the steps ended, over that at their begin.
        gradient: f64,
    },
    /// No cut gives the area ratio that was asked for.
    AreaRatio {
        /// The patch.
        patch: String,
        /// The largest area ratio of its map.
        ratio: f64,
        /// Whether the ratio is that without acuities and magnification, which change areas on purpose.
        is_unmagnified: bool,
        /// What was asked for.
        wanted: f64,
    },
}

impl BuildRemark {
    /// What a user should know of a skin before its map is written.
    pub fn of_skin(skin: &Skin) -> Vec<Self> {
        let ids = || skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
        let without = ids().filter(|id| TaxelId::PLACEHOLDERS.contains(id)).count();
        let placeholders = (without > 1).then(|| Self::Placeholders { without, all: ids().count() });
        let rounded = skin.patches.iter().filter_map(|patch| {
            Some(Self::Rounded { patch: patch.name.clone(), moved: rounding_in_gltf(&patch.mesh)? })
        });
        placeholders.into_iter().chain(rounded).collect()
    }

    /// Whether the map may be other than the user expects, and not as every map of such a skin.
    pub fn is_doubt(&self) -> bool {
        !matches!(self, Self::Seam { .. } | Self::LargePixels(_))
    }
}

impl Built {
    /// What a user should know of the map that was built with these options.
    pub fn remarks(&self, options: &BuildOptions) -> Vec<BuildRemark> {
        let patches = measure(&self.map);
        let mut remarks: Vec<BuildRemark> = patches.iter().filter_map(seam).collect();
        let reason = |error: &crate::Error| BuildRemark::PatchLeftOut { reason: error.to_string() };
        remarks.extend(self.failed.iter().map(reason));
        let left_out = patches.iter().zip(&self.left_out).filter(|(_, count)| **count > 0);
        remarks
            .extend(left_out.map(|(p, &count)| BuildRemark::LevelsLeftOut { patch: p.name.clone(), count }));
        let others = patches.iter().zip(&self.by_dirichlet).filter(|(_, by_dirichlet)| **by_dirichlet);
        remarks.extend(others.map(|(p, _)| BuildRemark::OtherEnergy { patch: p.name.clone() }));
        remarks.extend(self.enlarged.map(BuildRemark::LargePixels));
        remarks.extend(patches.iter().filter_map(overlap));
        // Where areas change on purpose, the ratios of stretches alone judge a map.
        let is_poor = |k: usize, finest: &Distortion| match self.map.patches.get(PatchId::new(k)) {
            Some(patch) if is_magnified(&patch.taxels, options) => finest.qc_max > POOR_STRETCHES,
            _ => finest.is_poor(),
        };
        remarks.extend(poor(&patches, is_poor));
        remarks.extend(patches.iter().flat_map(of_levels));
        if let Cut::AreaRatio(wanted) = options.cut {
            let ratios = patches.iter().zip(&self.unmagnified_ratios);
            remarks.extend(ratios.filter_map(|(patch, unmagnified)| area_ratio(patch, *unmagnified, wanted)));
        }
        remarks
    }
}

fn seam(patch: &PatchReport) -> Option<BuildRemark> {
    let length = patch.levels.first()?.seam;
    (length > 0.0).then(|| BuildRemark::Seam { patch: patch.name.clone(), length })
}

fn overlap(patch: &PatchReport) -> Option<BuildRemark> {
    let counts = |level: &LevelReport| [level.level, level.distortion.flips, level.distortion.crossings];
    let levels: Vec<_> =
        patch.levels.iter().map(counts).filter(|[_, flips, crossings]| flips + crossings > 0).collect();
    (!levels.is_empty()).then(|| BuildRemark::Overlap { patch: patch.name.clone(), levels })
}

fn poor(patches: &[PatchReport], is_poor: impl Fn(usize, &Distortion) -> bool) -> Option<BuildRemark> {
    let finest = |(k, patch): (usize, &PatchReport)| {
        let finest = patch.levels.first()?.distortion;
        is_poor(k, &finest).then(|| (patch.name.clone(), finest))
    };
    let mut poor: Vec<_> = patches.iter().enumerate().filter_map(finest).collect();
    poor.sort_by(|(_, a), (_, b)| b.symmetric_dirichlet.total_cmp(&a.symmetric_dirichlet));
    let worst = poor.first()?.1;
    Some(BuildRemark::Poor { patches: poor.into_iter().map(|(name, _)| name).collect(), worst })
}

fn of_levels(patch: &PatchReport) -> Vec<BuildRemark> {
    let name = || patch.name.clone();
    let coarse = patch.levels.iter().skip(1).map(|level| (level.level, level.distortion.qc_max));
    let worst = coarse.filter(|(_, ratio)| *ratio > EXTREME).max_by(|a, b| a.1.total_cmp(&b.1));
    let needle = worst.map(|(level, ratio)| BuildRemark::Needle { patch: name(), level, ratio });
    let short = patch.levels.iter().filter_map(|level| {
        let convergence = level.convergence.filter(|convergence| !convergence.converged)?;
        let gradient = convergence.gradient;
        Some(BuildRemark::NotAtMinimum { patch: name(), level: level.level, gradient })
    });
    needle.into_iter().chain(short).collect()
}

fn area_ratio(patch: &PatchReport, unmagnified: Option<f64>, wanted: f64) -> Option<BuildRemark> {
    let (ratio, is_unmagnified) = match unmagnified {
        Some(ratio) => (ratio, true),
        None => (patch.levels.first()?.distortion.area_max, false),
    };
    let name = || patch.name.clone();
    (ratio > wanted).then(|| BuildRemark::AreaRatio { patch: name(), ratio, is_unmagnified, wanted })
}

/// The first few names, and how many there are besides.
fn first_names(names: &[String]) -> String {
    let named: Vec<_> = names.iter().take(NAMED).map(|name| format!("`{name}`")).collect();
    let others = names.len().saturating_sub(NAMED);
    let more = if others > 0 { format!(" and {others} more") } else { String::new() };
    named.join(", ") + &more
}

impl fmt::Display for BuildRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rounded { patch, moved } => write!(
                f,
                "{patch}: so far from the origin of its link, positions are rounded by up to {:.3} mm in a .glb, \
                 which keeps seven digits: move the origin near",
                1e3 * moved
            ),
            Self::Placeholders { without, all } => write!(
                f,
                "{without} of {all} taxels have a placeholder id, 0 or {}: those of one id share its readings",
                u32::MAX
            ),
            Self::Seam { patch, length } => {
                write!(f, "{patch}: the map is cut open along a seam of {:.0} mm", 1e3 * length)
            }
            Self::PatchLeftOut { reason } => write!(f, "{reason}; left out"),
            Self::LevelsLeftOut { patch, count } => write!(
                f,
                "{patch}: left out the coarsest levels, {count} in number: much too distorted, or too long and thin for \
                 a map in 64-bit numbers or the 32-bit ones of its file"
            ),
            Self::OtherEnergy { patch } => write!(
                f,
                "{patch}: no usable map by the default energy, so the symmetric Dirichlet energy was used"
            ),
            Self::LargePixels(Enlarged { pixel_mm, pixels }) => write!(
                f,
                "the images have pixels of {pixel_mm} mm: at 1 mm they would have {:.0} megapixels, more than 256 a taxel or 4 in all",
                *pixels as f64 / 1e6
            ),
            Self::Overlap { patch, levels } => {
                let counts = levels.iter().map(|[level, flips, crossings]| {
                    format!("L{level}: flips {flips}, crossings {crossings}")
                });
                let counts: Vec<String> = counts.collect();
                write!(f, "{patch}: the map overlaps itself ({})", counts.join("; "))
            }
            Self::Poor { patches, worst } => {
                let (maps, the) =
                    if patches.len() == 1 { ("map is", "") } else { ("maps are", "the first: ") };
                let (count, names) = (patches.len(), first_names(patches));
                let (energy, ratio) = (worst.symmetric_dirichlet, worst.qc_max);
                write!(
                    f,
                    "{count} {maps} poor, {names} ({the}symmetric Dirichlet {energy:.1}, largest s1/s2 {ratio:.1})"
                )
            }
            Self::Needle { patch, level, ratio } => write!(
                f,
                "{patch}: the map of level {level} has a face with s1/s2 of {ratio:.1e}: its corners are almost on a line \
                 on the skin"
            ),
            Self::NotAtMinimum { patch, level, gradient } => write!(
                f,
                "{patch}: the map of level {level} is not at a minimum: its steps ended at a relative gradient of \
                 {gradient:.1e}"
            ),
            Self::AreaRatio { patch, ratio, is_unmagnified, wanted } => write!(
                f,
                "{patch}: the largest area ratio of the map{} is {ratio:.4}; no cut into a map of one piece was found that \
                 keeps {wanted}",
                if *is_unmagnified { " without acuities and magnification" } else { "" }
            ),
        }
    }
}
