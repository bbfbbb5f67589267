//! Divides a patch into charts whose maps keep an area ratio, where no cut within one chart does.
//!
//! A chart that does not keep it, with four slits at most, is divided in two along a short border
//! ([`Bisection`]) until all do; then charts that share a border are joined again, those with the
//! longest first, wherever their map keeps the ratio as one.
//!
//! *Heuristic*. For the ratios 1.5, 1.2 and 1.1 a cap, a saddle, a closed ball, a torus and four tubes
//! that meet become 65 charts in all this way, with seams of 67 square roots of the area. With two
//! slits they become 73 (69), without slits 95 (73), with two slits and without joining 145.

use std::collections::BTreeSet;

use rayon::prelude::*;

use crate::{
    Error,
    cut::{Bisection, Chart, CutError, CutMesh, Division},
    flatten::FlattenOptions,
    id::{FaceId, IdVec, VertexId},
    mesh::{Adjacency, mean_edge_length},
    pipeline::choose_cut::{Kept, decided_level, keep_ratio},
    pyramid::Level,
    skin::{Patch, Taxels},
};

/// Charts at most, before they are joined: a ratio that needs more is nearer to 1 than the curvature of
/// single vertices allows.
const MOST_CHARTS: usize = 64;

/// Slits into each of several charts, at most.
const SLITS: usize = 4;

/// A border on the skin lies within this many mean edges of the level on which it was found.
const REACH: f64 = 1.5;

/// A patch on its way to charts that keep an area ratio.
pub(super) struct Divider<'p> {
    taxels: &'p Taxels,
    division: Division<'p>,
    options: &'p FlattenOptions,
    wanted: f64,
}

/// Faces that are a chart, and the cut that keeps the ratio, or does not.
struct Candidate {
    faces: Vec<FaceId>,
    kept: Kept,
}

impl<'p> Divider<'p> {
    /// # Errors
    /// If the patch is not an oriented manifold.
    pub(super) fn new(patch: &'p Patch, options: &'p FlattenOptions, wanted: f64) -> Result<Self, Error> {
        Ok(Self { taxels: &patch.taxels, division: Division::new(&patch.mesh)?, options, wanted })
    }

    /// The patch cut into charts whose maps keep the ratio.
    ///
    /// # Errors
    /// If more than [`MOST_CHARTS`] would be needed, or a chart cannot be mapped.
    pub(super) fn divide(&self) -> Result<CutMesh, Error> {
        let mut charts = self.join(self.halve()?)?;
        charts.sort_by_key(|chart| chart.faces.first().copied());
        let charts: Vec<Chart> =
            charts.into_iter().map(|chart| Chart { faces: chart.faces, cut: chart.kept.cut }).collect();
        Ok(self.division.cut(&charts))
    }

    fn keeps(&self, chart: &Candidate) -> bool {
        chart.kept.is_within(self.wanted)
    }

    fn try_chart(&self, faces: Vec<FaceId>) -> Result<Candidate, Error> {
        let (mesh, origins) = self.division.mesh_of(&faces);
        let taxels = self.taxels.select(&origins);
        let kept = match keep_ratio(&mesh, &taxels, self.options, self.wanted, SLITS) {
            // Half of a surface with handles may be no disk after its cut: it is divided again.
            Err(Error::Cut(_)) => Kept { cut: None, area_ratio: f64::INFINITY },
            kept => kept?,
        };
        Ok(Candidate { faces, kept })
    }

    fn try_charts(&self, charts: Vec<Vec<FaceId>>) -> Result<Vec<Candidate>, Error> {
        charts.into_par_iter().map(|faces| self.try_chart(faces)).collect()
    }

    /// Charts that keep the ratio, each from a half of one that does not.
    fn halve(&self) -> Result<Vec<Candidate>, Error> {
        let mut good = Vec::new();
        let mut bad = vec![self.division.faces()];
        while !bad.is_empty() {
            let halves: Vec<_> =
                bad.par_iter().map(|faces| self.halves(faces)).collect::<Result<_, Error>>()?;
            let tried = self.try_charts(halves.into_iter().flatten().collect())?;
            let found = tried.iter().map(|chart| chart.kept.area_ratio).fold(1.0, f64::max);
            let (kept, others): (Vec<_>, Vec<_>) = tried.into_iter().partition(|chart| self.keeps(chart));
            good.extend(kept);
            bad = others.into_iter().map(|chart| chart.faces).collect();
            let is_divisible = bad.iter().all(|faces| faces.len() > 1);
            if !is_divisible || good.len() + 2 * bad.len() > MOST_CHARTS {
                return Err(CutError::AreaRatio { found, charts: MOST_CHARTS, wanted: self.wanted }.into());
            }
        }
        Ok(good)
    }

    /// The same with neighbours joined where they keep the ratio as one chart.
    fn join(&self, mut charts: Vec<Candidate>) -> Result<Vec<Candidate>, Error> {
        let mut tried = BTreeSet::new();
        loop {
            let faces: Vec<&[FaceId]> = charts.iter().map(|chart| chart.faces.as_slice()).collect();
            let mut is_taken = vec![false; charts.len()];
            let mut pairs = Vec::new();
            for [a, b] in self.division.borders(&faces) {
                let mut both = [faces[a], faces[b]].concat();
                both.sort_unstable();
                if !is_taken[a] && !is_taken[b] && tried.insert(both.clone()) {
                    is_taken[a] = true;
                    is_taken[b] = true;
                    pairs.push(([a, b], both));
                }
            }
            if pairs.is_empty() {
                return Ok(charts);
            }
            let (places, faces): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
            let joined = self.try_charts(faces)?;
            let mut is_gone = vec![false; charts.len()];
            let mut new = Vec::new();
            for ([a, b], chart) in places.into_iter().zip(joined) {
                if self.keeps(&chart) {
                    is_gone[a] = true;
                    is_gone[b] = true;
                    new.push(chart);
                }
            }
            let stay = charts.into_iter().zip(is_gone).filter(|(_, is_gone)| !is_gone);
            charts = stay.map(|(chart, _)| chart).chain(new).collect();
        }
    }

    /// The faces of a chart in two pieces or more.
    fn halves(&self, faces: &[FaceId]) -> Result<Vec<Vec<FaceId>>, Error> {
        let (mesh, origins) = self.division.mesh_of(faces);
        let taxels = self.taxels.select(&origins);
        let densities = taxels.wanted_densities();
        let fine = Bisection::new(&mesh, densities.as_ref())?;
        let is_second = match decided_level(&mesh, &taxels)? {
            None => fine.halves(),
            Some(level) => {
                let there = densities.as_ref().map(|all| level.origins.map(|&v| all[v]));
                let coarse = Bisection::new(&level.mesh, there.as_ref())?.halves();
                let carried = carried(&level, &coarse);
                let sum = |corners: &[VertexId; 3]| corners.iter().map(|&v| carried[v]).sum::<f64>();
                let reach = REACH * mean_edge_length(&level.mesh, &Adjacency::new(&level.mesh)?);
                fine.straightened(mesh.triangles.map(|corners| sum(corners) > 0.0), reach)
            }
        };
        let half = |side: bool| {
            let of_side = is_second.enumerate().filter(|(_, other)| **other == side);
            of_side.map(|(face, _)| faces[face.index()]).collect::<Vec<_>>()
        };
        Ok([false, true].into_iter().flat_map(|side| self.division.pieces(&half(side))).collect())
    }
}

/// In which half of a level each taxel of level 0 lies: from -1, the first one, to 1.
fn carried(level: &Level, is_second: &IdVec<FaceId, bool>) -> IdVec<VertexId, f64> {
    let mut sums = IdVec::<VertexId, [f64; 2]>::filled([0.0; 2], level.mesh.positions.len());
    for (face, corners) in level.mesh.triangles.enumerate() {
        let area = level.mesh.face_area(face);
        for &v in corners {
            sums[v][0] += if is_second[face] { area } else { -area };
            sums[v][1] += area;
        }
    }
    let of_vertex = sums.map(|&[sum, area]| if area > 0.0 { sum / area } else { 0.0 });
    level.to_finest.as_ref().map_or_else(|| of_vertex.clone(), |rows| rows.apply(&of_vertex))
}
