//! Where to cut one chart, decided by trial maps of a level of a few thousand vertices.

use crate::{
    Error,
    cut::{AreaLimit, Cut, CutMesh, TrialMaps, cut_along, decide, is_plain_disk, pairs_by_patch},
    flatten::{FlattenOptions, Method, Overlap, distortion, flatten_roughly, flatten_with_convergence},
    id::{IdVec, VertexId},
    mesh::TriMesh,
    pyramid::{CoarsenOptions, Level, coarsen},
    skin::Taxels,
};

/// Seams are decided on a level of about this many vertices: a trial map of it takes a tenth of a
/// second, and its seam differs little from that of the skin.
const DECIDED_ON: usize = 2000;

/// Slits are decided on a coarser level, whose map is a little better than that of the skin: by these
/// shares of the logarithm of an area ratio they aim lower until the map of the skin keeps it.
const AIMS: [f64; 3] = [0.95, 0.8, 0.6];

/// The map of a chart on its own keeps a ratio a little better, by this share of its logarithm: through
/// the pyramid of its patch it ends a little elsewhere.
const KEPT: f64 = 0.995;

/// The level of a mesh on which seams are decided; `None` where that is the mesh itself.
///
/// # Errors
/// As [`coarsen`].
pub(super) fn decided_level(mesh: &TriMesh, taxels: &Taxels) -> Result<Option<Level>, Error> {
    // In steps of a factor of about four.
    let factor = mesh.positions.len() as f64 / DECIDED_ON as f64;
    if factor < 1.6 {
        return Ok(None);
    }
    let steps = factor.log(4.0).ceil().max(1.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
    let options = CoarsenOptions {
        ratio: Some(factor.powf(steps.recip()).max(1.5)),
        levels: Some(steps as usize),
        coarsest: 1,
    };
    Ok(coarsen(mesh, taxels, &options)?.levels.into_iter().last())
}

/// Cuts one chart open where that is needed or worth it, from trial maps; `None` where it is mapped as
/// it is.
///
/// # Errors
/// If the mesh is not an oriented manifold in one piece, or not a disk with holes after the cut.
pub(super) fn choose_cut(
    mesh: &TriMesh,
    taxels: &Taxels,
    cut: &Cut,
    options: &FlattenOptions,
) -> Result<Option<CutMesh>, Error> {
    let cut = match cut {
        Cut::None => return Ok(None),
        Cut::Along(pairs) => {
            let edges = pairs_by_patch(pairs, std::iter::once(taxels))?;
            match edges.iter().next() {
                Some(edges) if !edges.is_empty() => return Ok(Some(cut_along(mesh, edges, &taxels.ids)?)),
                _ => &Cut::Auto,
            }
        }
        cut => cut,
    };
    // Nothing is decided on a disk, so it need not be coarsened for that.
    if is_plain_disk(mesh) {
        return Ok(None);
    }
    cut_below(mesh, taxels, cut, options, None).map(|(made, _)| made)
}

/// A chart cut open so that its map keeps an area ratio.
pub(super) struct Kept {
    pub(super) cut: Option<CutMesh>,
    /// The area ratio of its map; of a trial map where that was too large, infinite without one.
    pub(super) area_ratio: f64,
}

impl Kept {
    /// Whether the ratio is kept, in the map of the whole patch too.
    pub(super) fn is_within(&self, wanted: f64) -> bool {
        self.area_ratio <= wanted.powf(KEPT)
    }
}

/// Cuts one chart open, with at most this many slits, until the area ratio of its map is at most `wanted`
/// or no slit helps.
///
/// # Errors
/// As [`choose_cut`].
pub(super) fn keep_ratio(
    mesh: &TriMesh,
    taxels: &Taxels,
    options: &FlattenOptions,
    wanted: f64,
    slits: usize,
) -> Result<Kept, Error> {
    let mut best = Kept { cut: None, area_ratio: f64::INFINITY };
    for aim in AIMS {
        let limit = Some(Limit { ratio: wanted.powf(aim), slits });
        let (cut, on_trial) = cut_below(mesh, taxels, &Cut::AreaRatio(wanted), options, limit)?;
        if on_trial > wanted {
            // With a lower aim it would be no better.
            best.area_ratio = best.area_ratio.min(on_trial);
            break;
        }
        let opened = cut.as_ref().map(|cut| cut.mesh(&mesh.positions));
        let places = cut.as_ref().map(|cut| taxels.select(&cut.unsplit));
        let (opened, places) = (opened.as_ref().unwrap_or(mesh), places.as_ref().unwrap_or(taxels));
        // A chart without a map is too large.
        let Ok((uv, _)) = flatten_with_convergence(opened, Some(places), options) else { break };
        let area_ratio = distortion(opened, &uv).area_max;
        if area_ratio < best.area_ratio {
            best = Kept { cut, area_ratio };
        }
        if best.is_within(wanted) {
            break;
        }
    }
    Ok(best)
}

/// An area ratio to be kept, and the number of slits for it at most.
struct Limit {
    ratio: f64,
    slits: usize,
}

/// The cut that [`decide`] finds on a level, done on the mesh, and the area ratio of its trial map.
fn cut_below(
    mesh: &TriMesh,
    taxels: &Taxels,
    cut: &Cut,
    options: &FlattenOptions,
    limit: Option<Limit>,
) -> Result<(Option<CutMesh>, f64), Error> {
    // A seam is as good as the best map after it, which may overlap itself, at first.
    let free = |mesh: &TriMesh, _: &_, start: Option<&_>, most: f64| {
        flatten_roughly(mesh, start, Overlap::Allow, most).ok()
    };
    let apart = |mesh: &TriMesh, _: &_, start: Option<&_>, most: f64| {
        flatten_roughly(mesh, start, Overlap::Prevent, most).ok()
    };
    let is_apart = options.overlap == Overlap::Prevent && matches!(options.method, Method::Intrinsic { .. });
    let maps = TrialMaps { free: &free, apart: if is_apart { Some(&apart) } else { None } };
    let densities = taxels.wanted_densities();
    let level = decided_level(mesh, taxels)?;
    let taxels_there = level.as_ref().map(|level| taxels.select(&level.origins));
    let taxels_there = taxels_there.as_ref().unwrap_or(taxels);
    let judged = |mesh: &TriMesh, unsplit: &IdVec<VertexId, VertexId>, _: Option<&_>, _: f64| {
        flatten_with_convergence(mesh, Some(&taxels_there.select(unsplit)), options).ok().map(|(uv, _)| uv)
    };
    let limit = limit.map(|Limit { ratio, slits }| AreaLimit { ratio, slits, map: &judged });
    let recipe = match &level {
        None => decide(mesh, densities.as_ref(), cut, &maps, limit.as_ref())?,
        Some(level) => {
            let of_level = densities.as_ref().map(|all| level.origins.map(|&v| all[v]));
            decide(&level.mesh, of_level.as_ref(), cut, &maps, limit.as_ref())?.on_finer(&level.origins)
        }
    };
    Ok((recipe.cut(mesh, densities.as_ref())?, recipe.area_ratio))
}
