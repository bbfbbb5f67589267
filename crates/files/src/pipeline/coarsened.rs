//! A patch coarsened, cut open or not, and the maps of its levels.

use crate::cut::CutMesh;
use crate::flatten::{FlattenError, FlattenOptions, Flattening, flatten_pyramid};
use crate::id::IdVec;
use crate::mesh::TriMesh;
use crate::pyramid::{
    CoarsenOptions, CutPyramid, Level, LevelId, Pyramid, PyramidError, coarsen, coarsen_cut,
};
use crate::run::Run;
use crate::skin::Taxels;

/// A pyramid, of a patch that is cut or not.
pub(super) enum Coarsened {
    Whole(Pyramid),
    Cut(Box<CutPyramid>),
}

/// Levels, each with its cut, and their maps.
pub(super) struct Flattened {
    pub(super) levels: Vec<(Level, Option<CutMesh>)>,
    pub(super) maps: IdVec<LevelId, Flattening>,
}

impl Coarsened {
    pub(super) fn new(
        mesh: &TriMesh,
        taxels: &Taxels,
        cut: Option<&CutMesh>,
        options: &CoarsenOptions,
        run: Run<'_>,
    ) -> Result<Self, PyramidError> {
        Ok(match cut {
            Some(cut) => Self::Cut(Box::new(coarsen_cut(mesh, taxels, cut, options, run)?)),
            None => Self::Whole(coarsen(mesh, taxels, options, run)?),
        })
    }

    /// The maps of its levels; `taxels` are those of the patch.
    pub(super) fn flattened(
        self,
        taxels: &Taxels,
        options: &FlattenOptions,
        run: Run<'_>,
    ) -> Result<Flattened, FlattenError> {
        match self {
            Self::Whole(pyramid) => {
                let maps = flatten_pyramid(&pyramid, Some(taxels), options, run)?;
                Ok(Flattened {
                    levels: pyramid.levels.into_iter().map(|level| (level, None)).collect(),
                    maps,
                })
            }
            Self::Cut(pyramid) => {
                let CutPyramid { pyramid, opened, cuts } = *pyramid;
                let taxels = cuts.iter().next().map(|cut| taxels.select(&cut.unsplit));
                let maps = flatten_pyramid(&opened, taxels.as_ref(), options, run)?;
                let levels = pyramid.levels.into_iter().zip(cuts.into_iter().map(Some)).collect();
                Ok(Flattened { levels, maps })
            }
        }
    }
}
