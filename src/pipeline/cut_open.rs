//! Where to cut a patch, decided by trial maps of a level of a few thousand vertices.

use crate::{
    Error,
    cut::{AreaLimit, Cut, CutMesh, PlaceId, TrialMaps, decide, is_plain_disk},
    flatten::{FlattenOptions, Method, Overlap, distortion, flatten, flatten_roughly},
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

/// A map without a pyramid keeps a ratio a little better, by this share of its logarithm: through the
/// pyramid it ends a little elsewhere.
const KEPT: f64 = 0.995;

/// The level of a mesh on which seams are decided; `None` where that is the mesh itself.
///
/// # Errors
/// As [`coarsen`].
fn decided_level(mesh: &TriMesh, taxels: &Taxels) -> Result<Option<Level>, Error> {
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

/// Cuts a mesh open where that is needed or worth it, from trial maps; `None` where it is mapped as it is.
/// `options` are those of its map.
///
/// # Errors
/// If the mesh is not an oriented manifold in one piece, or not a disk with holes after the cut.
pub(super) fn cut_open(
    mesh: &TriMesh,
    taxels: &Taxels,
    cut: &Cut,
    options: &FlattenOptions,
) -> Result<Option<CutMesh>, Error> {
    match cut {
        Cut::None => Ok(None),
        Cut::AreaRatio(wanted) => keep_ratio(mesh, taxels, options, *wanted),
        // Nothing is decided on a disk, so it need not be coarsened for that.
        _ if is_plain_disk(mesh) => Ok(None),
        cut => cut_below(mesh, taxels, cut, options, None).map(|(made, _)| made),
    }
}

/// Cuts a mesh open until the area ratio of its map is at most `wanted` or no slit helps.
///
/// # Errors
/// As [`cut_open`].
fn keep_ratio(
    mesh: &TriMesh,
    taxels: &Taxels,
    options: &FlattenOptions,
    wanted: f64,
) -> Result<Option<CutMesh>, Error> {
    let mut best: Option<(f64, Option<CutMesh>)> = None;
    for aim in AIMS {
        let (cut, on_trial) =
            cut_below(mesh, taxels, &Cut::AreaRatio(wanted), options, Some(wanted.powf(aim)))?;
        let opened = cut.as_ref().map(|cut| cut.mesh(&mesh.positions));
        let places = cut.as_ref().map(|cut| taxels.select(&cut.opened_vertices()));
        let (opened, places) = (opened.as_ref().unwrap_or(mesh), places.as_ref().unwrap_or(taxels));
        let map = flatten(opened, Some(places), options);
        let area_ratio = map.map_or(f64::INFINITY, |map| distortion(opened, &map.uv).area_max);
        if best.as_ref().is_none_or(|best| area_ratio < best.0) {
            best = Some((area_ratio, cut));
        }
        // Where the trial map does not keep the ratio, a lower aim changes nothing.
        if area_ratio <= wanted.powf(KEPT) || on_trial > wanted || area_ratio.is_infinite() {
            break;
        }
    }
    Ok(best.and_then(|(_, cut)| cut))
}

/// The cut that [`decide`] finds on a level, done on the mesh, and the area ratio of its trial map.
fn cut_below(
    mesh: &TriMesh,
    taxels: &Taxels,
    cut: &Cut,
    options: &FlattenOptions,
    area_ratio: Option<f64>,
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
    let judged = |mesh: &TriMesh, unsplit: &IdVec<PlaceId, VertexId>, _: Option<&_>, _: f64| {
        flatten(mesh, Some(&taxels_there.select(&unsplit.iter().copied().collect())), options)
            .ok()
            .map(|map| map.uv)
    };
    let limit = area_ratio.map(|ratio| AreaLimit { ratio, map: &judged });
    let recipe = match &level {
        None => decide(mesh, densities.as_ref(), cut, &maps, limit.as_ref())?,
        Some(level) => {
            let of_level = densities.as_ref().map(|all| level.origins.map(|&v| all[v]));
            decide(&level.mesh, of_level.as_ref(), cut, &maps, limit.as_ref())?.on_finer(&level.origins)
        }
    };
    Ok((recipe.cut(mesh, densities.as_ref())?, recipe.area_ratio))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::mesh::Adjacency;

    /// Both sides of a rectangle, 150 times as long as it is wide: the shortest seam is one edge, which
    /// opens nothing.
    #[test]
    fn a_flat_closed_needle_is_opened() {
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let corners = vec![at(0.0, 0.0), at(4.53e-4, 0.0), at(4.53e-4, 3e-6), at(0.0, 3e-6)];
        let mesh = TriMesh::from_arrays(corners, &[[1, 0, 2], [2, 0, 3], [2, 3, 1], [1, 3, 0]]);
        let cut = cut_open(&mesh, &Taxels::from(&mesh), &Cut::Auto, &FlattenOptions::default()).unwrap();
        let opened = Adjacency::new(&cut.unwrap().mesh(&mesh.positions)).unwrap();
        assert_eq!((opened.euler_characteristic(), opened.boundary_loops().len()), (1, 1));
    }
}
