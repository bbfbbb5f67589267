//! How to coarsen, and where the skin is finer than elsewhere.

use dermatome::Error;
use dermatome::io::{NotInSkin, read_acuities_with};
use dermatome::mesh::FillHoles;
use dermatome::pyramid::CoarsenOptions;
use dermatome::skin::Skin;

use crate::console::notes::note_unused;
use crate::options::{Common, InPath};

/// How to coarsen.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Pyramid")]
pub(crate) struct CoarsenArgs {
    /// At most this many levels above level 0 [default: as many as --coarsest allows]
    #[arg(long, value_name = "N")]
    levels: Option<usize>,
    /// Stop at about this many vertices per patch
    #[arg(long, value_name = "N", default_value_t = CoarsenOptions::default().coarsest)]
    coarsest: usize,
    /// Fill holes of at most this many edges first, 0 for none; the outer boundary stays, but for a
    /// pin-hole of a closed body [default: holes of at most 5 edges, round and flat in the surface]
    #[arg(long, value_name = "N", value_parser = hole)]
    fill_holes: Option<usize>,
}

/// Where the skin is finer than elsewhere.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Pyramid")]
pub(crate) struct AcuityArgs {
    /// Where fields are finer and lengths on the map longer than elsewhere, as at fingertips: a table
    /// with the columns taxel_id,factor; taxels that it does not name have the factor 1
    #[arg(long, value_name = "FILE.csv")]
    acuity: Option<InPath>,
}

impl AcuityArgs {
    /// Reads the table, if one is named, into the taxels of a skin.
    pub(crate) fn apply(&self, skin: &mut Skin, others: &NotInSkin, common: &Common) -> Result<(), Error> {
        let Some(path) = &self.acuity else { return Ok(()) };
        note_unused(path, &read_acuities_with(path, skin, others)?, common);
        Ok(())
    }
}

impl CoarsenArgs {
    pub(crate) fn options(&self) -> CoarsenOptions {
        CoarsenOptions { levels: self.levels, coarsest: self.coarsest, ..CoarsenOptions::default() }
    }

    pub(crate) fn fill_holes(&self) -> FillHoles {
        self.fill_holes.map_or(FillHoles::PinHoles, FillHoles::UpTo)
    }
}

/// Larger holes are intended boundaries, and filling one costs the cube of its number of edges.
const LARGEST_HOLE: usize = 200;

fn hole(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if n <= LARGEST_HOLE => Ok(n),
        _ => Err(format!("needed: a number of edges from 0 to {LARGEST_HOLE}")),
    }
}
