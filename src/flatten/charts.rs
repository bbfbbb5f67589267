//! Maps of a patch that is divided into charts: each is mapped on its own, and they are laid side by
//! side, on every level at the same places.
//!
//! Charts stand on shelves, the highest first, as wide as makes the rectangle around them smallest: a
//! *heuristic*, since the best layout takes exponential time. With the space between them 2 to 37 charts
//! of balls, caps, saddles, tori, tubes that meet and a glove fill 72 to 94 % of that rectangle.

use glam::DVec2;
use rayon::prelude::*;

use crate::{
    flatten::{
        Convergence, FlattenError, FlattenOptions,
        domain::{elements::Uv, magnification::Magnification},
        flatten::{flatten_pyramid_with_convergence, flatten_with_convergence},
    },
    id::{IdVec, VertexId},
    mesh::{Adjacency, Parts, TriMesh, mean_edge_length, rectangle_around},
    numeric::order_by,
    pyramid::{Level, LevelId, Prolongation, Pyramid, RemovalLog},
    skin::Taxels,
};

/// Space between two charts, in mean edges of level 0.
const GAP: f64 = 2.0;

/// As [`flatten_with_convergence`], for a mesh whose components are charts.
///
/// # Errors
/// As [`flatten_with_convergence`], for one of the charts.
pub(crate) fn flatten_charts(
    mesh: &TriMesh,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
) -> Result<(Uv, Convergence), FlattenError> {
    let parts = Parts::of_components(mesh);
    if parts.len() == 1 {
        return flatten_with_convergence(mesh, taxels, options);
    }
    let magnification = Magnification::new(options.method, taxels, &mesh.vertex_areas())?;
    let scales = chart_scales(mesh, &parts, &magnification);
    let meshes = parts.meshes(mesh);
    let charts: Vec<usize> = (0..parts.len()).collect();
    let map = |&chart: &usize| {
        let taxels = taxels.map(|taxels| taxels.select(&parts.vertices[chart]));
        let (uv, convergence) = flatten_with_convergence(&meshes[chart], taxels.as_ref(), options)?;
        Ok(vec![(uv.map(|&p| p * scales[chart]), convergence)])
    };
    let maps: Vec<_> = charts.par_iter().map(map).collect::<Result<_, FlattenError>>()?;
    let laid = lay_out(mesh, &[parts], maps)?;
    laid.into_iter().next().ok_or(FlattenError::Size { area: mesh.area() })
}

/// As [`flatten_pyramid_with_convergence`], for a pyramid whose levels have the same components:
/// charts.
///
/// # Errors
/// As [`flatten_pyramid_with_convergence`], for one of the charts.
pub(crate) fn flatten_chart_pyramid(
    pyramid: &Pyramid,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
) -> Result<IdVec<LevelId, (Uv, Convergence)>, FlattenError> {
    let Some(finest) = pyramid.levels.get(LevelId::new(0)) else { return Ok(IdVec::default()) };
    let charts = Parts::of_components(&finest.mesh);
    if charts.len() == 1 {
        return flatten_pyramid_with_convergence(pyramid, taxels, options);
    }
    let of_level = |level: &Level| Parts::new(level.origins.map(|&v| charts.of[v]), charts.len());
    let parts: Vec<Parts> = pyramid.levels.iter().map(of_level).collect();
    let magnification = Magnification::new(options.method, taxels, &finest.areas)?;
    let scales: Vec<Vec<f64>> = pyramid
        .levels
        .iter()
        .zip(&parts)
        .map(|(level, parts)| {
            chart_scales(&level.mesh, parts, &magnification.restricted(level, &finest.areas))
        })
        .collect();
    let pyramids = chart_pyramids(pyramid, &parts);
    let map = |(chart, pyramid): (usize, &Pyramid)| {
        let taxels = taxels.map(|taxels| taxels.select(&charts.vertices[chart]));
        let maps = flatten_pyramid_with_convergence(pyramid, taxels.as_ref(), options)?;
        let scaled =
            maps.into_iter().zip(&scales).map(|((uv, c), scales)| (uv.map(|&p| p * scales[chart]), c));
        Ok(scaled.collect())
    };
    let maps: Vec<_> = pyramids.par_iter().enumerate().map(map).collect::<Result<_, FlattenError>>()?;
    Ok(lay_out(&finest.mesh, &parts, maps)?.into())
}

/// How much longer lines of each chart shall be than on the skin.
fn chart_scales(mesh: &TriMesh, parts: &Parts, magnification: &Magnification) -> Vec<f64> {
    let Some(factors) = magnification.area_factors(mesh) else { return vec![1.0; parts.len()] };
    let mut sums = vec![(0.0, 0.0); parts.len()];
    for (face, corners) in mesh.triangles.enumerate() {
        let (skin, map) = &mut sums[parts.of[corners[0]]];
        *skin += mesh.face_area(face);
        *map += mesh.face_area(face) * factors[face];
    }
    sums.into_iter().map(|(skin, map)| if skin > 0.0 { (map / skin).sqrt() } else { 1.0 }).collect()
}

/// The pyramid of each chart; `parts` are the charts of each level.
fn chart_pyramids(pyramid: &Pyramid, parts: &[Parts]) -> Vec<Pyramid> {
    let Some(charts) = parts.first() else { return Vec::new() };
    let mut pyramids = vec![Pyramid { levels: IdVec::default(), removals: IdVec::default() }; charts.len()];
    for (level, parts) in pyramid.levels.iter().zip(parts) {
        for (chart, mesh) in parts.meshes(&level.mesh).into_iter().enumerate() {
            let vertices = &parts.vertices[chart];
            let to_finest = level.to_finest.as_ref().map(|rows| Prolongation {
                indices: charts.vertices[chart].map(|&v| rows.indices[v].map(|at| parts.number[at])),
                weights: charts.vertices[chart].map(|&v| rows.weights[v]),
                coarse_len: vertices.len(),
            });
            pyramids[chart].levels.push(Level {
                mesh,
                origins: vertices.map(|&v| charts.number[level.origins[v]]),
                areas: vertices.map(|&v| level.areas[v]),
                from_coarser: None,
                to_finest,
            });
        }
    }
    for (log, parts) in pyramid.removals.iter().zip(parts) {
        let mut logs = vec![RemovalLog::default(); charts.len()];
        for mut removal in log.iter() {
            let ring: Vec<VertexId> = removal.ring.iter().map(|&v| parts.number[v]).collect();
            let chart = parts.of[removal.vertex];
            removal.vertex = parts.number[removal.vertex];
            removal.ring = &ring;
            logs[chart].push(&removal);
        }
        pyramids.iter_mut().zip(logs).for_each(|(pyramid, log)| {
            pyramid.removals.push(log);
        });
    }
    pyramids
}

/// The maps of all levels from those of the charts, whose vertices `parts` tells, level by level;
/// levels that a chart has not are left out. `mesh` is that of level 0.
fn lay_out(
    mesh: &TriMesh,
    parts: &[Parts],
    charts: Vec<Vec<(Uv, Convergence)>>,
) -> Result<Vec<(Uv, Convergence)>, FlattenError> {
    let levels = charts.iter().map(Vec::len).min().unwrap_or(0);
    let boxes: Vec<(DVec2, DVec2)> = charts
        .iter()
        .map(|maps| rectangle_around(maps.iter().take(levels).flat_map(|(uv, _)| uv.iter().copied())))
        .collect();
    let sizes: Vec<DVec2> = boxes.iter().map(|(lo, hi)| *hi - *lo).collect();
    let gap = GAP * mean_edge_length(mesh, &Adjacency::new(mesh)?);
    let places = shelves(&sizes, gap);
    let moves: Vec<DVec2> = places.iter().zip(&boxes).map(|(place, (lo, _))| *place - *lo).collect();
    let level = |k: usize| {
        let mut uv = Uv::filled(DVec2::ZERO, parts[k].of.len());
        let mut all = Convergence { converged: true, gradient: 0.0 };
        for (chart, maps) in charts.iter().enumerate() {
            let (of_chart, convergence) = &maps[k];
            for (&v, &at) in parts[k].vertices[chart].iter().zip(of_chart) {
                uv[v] = at + moves[chart];
            }
            all.converged &= convergence.converged;
            all.gradient = all.gradient.max(convergence.gradient);
        }
        (uv, all)
    };
    Ok((0..levels).map(level).collect())
}

/// Where rectangles of these sizes stand with `gap` between them, their lower left corners: on
/// shelves around the origin.
fn shelves(sizes: &[DVec2], gap: f64) -> Vec<DVec2> {
    let order = order_by(sizes.len(), &|a, b| sizes[b].y.total_cmp(&sizes[a].y));
    let stand = |width: f64| {
        let mut corners = vec![DVec2::ZERO; sizes.len()];
        let (mut at, mut next, mut right) = (DVec2::ZERO, 0.0_f64, 0.0_f64);
        for &k in &order {
            if at.x > 0.0 && at.x + sizes[k].x > width {
                at = DVec2::new(0.0, next);
            }
            corners[k] = at;
            right = right.max(at.x + sizes[k].x);
            next = next.max(at.y + sizes[k].y + gap);
            at.x += sizes[k].x + gap;
        }
        (corners, DVec2::new(right, next - gap))
    };
    let mut widths = Vec::new();
    order.iter().fold(0.0, |sum, &k| {
        widths.push((sum + sizes[k].x) * (1.0 + 1e-12));
        sum + sizes[k].x + gap
    });
    let longest = sizes.iter().map(|size| size.x).fold(0.0, f64::max);
    let tried = widths.into_iter().filter(|&width| width >= longest).map(stand);
    let best = tried.reduce(|a, b| {
        // An image of more than twice its height is costly too.
        let aspect = |size: DVec2| size.max_element() / size.min_element();
        let cost = |size: DVec2| size.x * size.y * (aspect(size) / 2.0).max(1.0);
        if cost(b.1) < cost(a.1) { b } else { a }
    });
    let (corners, size) = best.unwrap_or_default();
    corners.into_iter().map(|corner| corner - size / 2.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_on_shelves_do_not_touch() {
        let sizes: Vec<DVec2> =
            (1..12).map(|k| DVec2::new(f64::from(k * 7 % 5 + 1), f64::from(k * 3 % 4 + 1))).collect();
        let corners = shelves(&sizes, 0.5);
        for i in 0..sizes.len() {
            for j in 0..i {
                let apart = corners[i].cmpge(corners[j] + sizes[j] + 0.5 - 1e-12)
                    | corners[j].cmpge(corners[i] + sizes[i] + 0.5 - 1e-12);
                assert!(apart.any(), "{i} and {j}");
            }
        }
        let (lo, hi) = rectangle_around(corners.iter().zip(&sizes).flat_map(|(&c, &s)| [c, c + s]));
        let filled: f64 = sizes.iter().map(|s| s.x * s.y).sum();
        assert!((lo + hi).length() < 1e-9, "around the origin");
        assert!(filled > 0.5 * (hi - lo).x * (hi - lo).y, "{filled} of {}", hi - lo);
    }
}
