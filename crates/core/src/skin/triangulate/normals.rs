//! The normal of every taxel before there are triangles: that of a plane of least squares or of a rigid
//! module, turned to one side of the surface `(hoppe1992)`, with the weights of `(konig2009)`.
//!
//! *Heuristic*: which normals of a file are reliable.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use crate::id::{IdVec, VertexId};
use crate::numeric::{DisjointSets, Relation, argsort, median, symmetric_eigen};
use crate::parallel::{par_collect, par_ids};
use crate::skin::UnreliableNormals;
use crate::skin::normals::{SAME_DIRECTION, is_unit};
use crate::skin::triangulate::neighbours::Neighbours;
use crate::skin::triangulate::unique_points::UniquePoints;

/// Neighbours to which a plane is fitted: two rings of a lattice have 18, but fewer follow a bend better.
const PLANE_NEIGHBOURS: usize = 12;

/// A module gives its taxels a plane if it has this many of them, ...
const MODULE_PLACES: usize = 4;

/// ... and they do not lie on a line: second over largest variance. The row of three of a trimmed
/// module has less.
const MODULE_BREADTH: f64 = 0.05;

/// Given normals are reliable if their mean cosine with the fitted planes is this large: taxels of
/// real covers have 0.95, and random directions 0.5.
const AGREEMENT: f64 = 0.75;

/// As [`AGREEMENT`], for normals that are all equal, as on a flat surface.
const FLAT_AGREEMENT: f64 = 0.99;

/// The chords of a bent surface are tested to this many nearest taxels.
const BENT_NEIGHBOURS: usize = 4;

/// Mean cosine between chords and mean normals up to which a surface bends with its normals: a
/// fingertip of 12 taxels has 0.05, random normals 0.5.
const MAX_BENT_COSINE: f64 = 0.15;

/// Normals of the file that differ by more than 135 degrees may belong to two sides of a thin body; across a
/// sharp edge the angle is smaller.
const OPPOSED: f64 = -0.7;

/// They do if each taxel is this far below, or each this far above, the tangent plane of the other, in
/// spacings. With one wrong normal one is above and one below.
const OPPOSED_HEIGHT: f64 = 0.25;

/// Taxels lie on two layers if each is more than 64 degrees (as a sine) above the tangent plane of the other.
const STACKED_SINE: f64 = 0.9;

#[derive(Debug)]
pub(super) struct PointNormals {
    /// Unit normals.
    pub normal: IdVec<VertexId, DVec3>,
    /// Reliable unit normals of the file; zero where there is none.
    pub file: IdVec<VertexId, DVec3>,
    /// Median of the smallest over the middle variance of a neighbourhood: 0 on a plane, about 0.5
    /// in a cloud.
    pub thickness: f64,
    /// Why the file's normals were not used; `None` if they were or there are none.
    pub refused: Option<UnreliableNormals>,
}

impl PointNormals {
    /// The normals of rigid modules, else of planes of least squares through the nearest neighbours
    /// `(hoppe1992)`, with the sign of the file's normals where these are reliable. Neighbours that reliable
    /// normals place on two sides of a thin body are removed from `neighbours`.
    pub(super) fn new(points: &UniquePoints<'_>, neighbours: &mut Neighbours) -> Self {
        let file = points.sheet.normals.as_ref().map(|n| points.taxel.map(|&k| unit_or_zero(n[k])));
        let mut refused = None;
        if let Some(file) = file {
            let same_side = neighbours.filtered(|v, w| !is_across(v, w, points, &file, neighbours));
            let (mut normal, thickness) = planes(points, &same_side);
            refused = defect(&file, &normal);
            if refused == Some(UnreliableNormals::Unrelated) && bend_with(&file, points, neighbours) {
                // Where a fitted plane and the file's normal disagree, the normal is taken.
                let is_known = |v: VertexId| file[v] != DVec3::ZERO;
                for v in file.ids().filter(|&v| is_known(v)) {
                    normal[v] = file[v];
                }
                *neighbours = same_side;
                return Self { normal, file, thickness, refused: None };
            }
            if refused.is_none() {
                *neighbours = same_side;
                for (n, &of_file) in normal.iter_mut().zip(&file) {
                    *n = if n.dot(of_file) < 0.0 { -*n } else { *n };
                }
                return Self { normal, file, thickness, refused };
            }
        }
        let (normal, thickness) = planes(points, neighbours);
        Self { file: IdVec::filled(DVec3::ZERO, normal.len()), normal, thickness, refused }
    }

    pub(super) fn has_file(&self) -> bool {
        self.file.iter().any(|n| *n != DVec3::ZERO)
    }
}

/// Whether the file's normals show that `v` and `w` lie on different sides, or layers, of the body.
fn is_across(
    v: VertexId,
    w: VertexId,
    points: &UniquePoints<'_>,
    file: &IdVec<VertexId, DVec3>,
    neighbours: &Neighbours,
) -> bool {
    let d = points.positions[w] - points.positions[v];
    let [seen, back] = [d.dot(file[v]), -d.dot(file[w])];
    let apart = OPPOSED_HEIGHT * 0.5 * (neighbours.spacing[v] + neighbours.spacing[w]);
    let least = seen.abs().min(back.abs());
    let is_behind = seen * back > 0.0 && least > apart && file[v].dot(file[w]) < OPPOSED;
    is_behind || least > STACKED_SINE * d.length()
}

/// A unit normal unchanged, any other vector as zero.
fn unit_or_zero(n: DVec3) -> DVec3 {
    if is_unit(n) { n.normalize() } else { DVec3::ZERO }
}

/// Whether the normals of the file belong to a surface that is bent between few taxels, as that of a
/// fingertip: on a circle the chord between two points is perpendicular to the mean of their
/// normals.
fn bend_with(file: &IdVec<VertexId, DVec3>, points: &UniquePoints<'_>, neighbours: &Neighbours) -> bool {
    let (mut sum, mut count) = (0.0, 0_usize);
    for v in file.ids() {
        for &w in neighbours.of(v).iter().take(BENT_NEIGHBOURS) {
            let mean = (file[v] + file[w]).normalize_or_zero();
            let chord = (points.positions[w] - points.positions[v]).normalize_or_zero();
            // Normals of two sides give no information on the surface between them.
            if file[v].dot(file[w]) > -0.2 {
                sum += chord.dot(mean).abs();
                count += 1;
            }
        }
    }
    2 * count > file.len() && sum < MAX_BENT_COSINE * count as f64
}

/// The planes of all taxels, those of modules where there are any, and the median of the thickness.
fn planes(points: &UniquePoints<'_>, neighbours: &Neighbours) -> (IdVec<VertexId, DVec3>, f64) {
    // Plane of least squares through a taxel and its nearest neighbours; any if there are too few.
    let plane = |v: VertexId| {
        let near = neighbours.of(v).iter().take(PLANE_NEIGHBOURS);
        let (normal, [least, middle, _]) =
            fit(near.chain([&v]).map(|&w| points.positions[w])).unwrap_or((DVec3::Z, [0.0; 3]));
        (normal, if middle > 0.0 { least / middle } else { 0.0 })
    };
    let planes = par_ids(points.positions.len(), plane);
    let thickness = median(planes.iter().map(|plane| plane.1)).unwrap_or(0.0);
    let mut normal = planes.map(|plane| plane.0);
    for (v, plane) in module_planes(points) {
        normal[v] = plane;
    }
    (normal, thickness)
}

/// Why the file's normals cannot be used; `None` if they can.
fn defect(file: &IdVec<VertexId, DVec3>, planes: &IdVec<VertexId, DVec3>) -> Option<UnreliableNormals> {
    let mut units = 0_usize;
    let (mut agreement, mut differs) = (0.0, false);
    let mut first = None;
    for (n, plane) in file.iter().zip(planes).filter(|(n, _)| **n != DVec3::ZERO) {
        units += 1;
        agreement += n.dot(*plane).abs();
        differs |= first.get_or_insert(*n).dot(*n) < SAME_DIRECTION;
    }
    let mean = agreement / units as f64;
    if 2 * units < file.len() {
        Some(UnreliableNormals::NotUnit)
    } else if !differs && mean < FLAT_AGREEMENT {
        Some(UnreliableNormals::Constant)
    } else if mean < AGREEMENT {
        Some(UnreliableNormals::Unrelated)
    } else {
        None
    }
}

/// The normal of its module for every taxel whose module has one.
fn module_planes(points: &UniquePoints<'_>) -> Vec<(VertexId, DVec3)> {
    let Some(modules) = &points.sheet.modules else { return Vec::new() };
    let mut members: BTreeMap<u32, Vec<VertexId>> = BTreeMap::new();
    for (v, &k) in points.taxel.enumerate() {
        members.entry(modules[k]).or_default().push(v);
    }
    let mut planes = Vec::new();
    for members in members.values().filter(|m| m.len() >= MODULE_PLACES) {
        if let Some((normal, variance)) = fit(members.iter().map(|&v| points.positions[v]))
            && variance[1] > MODULE_BREADTH * variance[2]
        {
            planes.extend(members.iter().map(|&v| (v, normal)));
        }
    }
    planes
}

/// Normal of the plane of least squares, and the variances along the principal axes, the smallest
/// first.
fn fit(points: impl Iterator<Item = DVec3> + Clone) -> Option<(DVec3, [f64; 3])> {
    let count = points.clone().count();
    if count < 3 {
        return None;
    }
    let mean = points.clone().sum::<DVec3>() / count as f64;
    let size = points.clone().fold(0.0, |most: f64, p| most.max(p.distance(mean)));
    if size == 0.0 {
        return None;
    }
    let mut moments = [[0.0; 3]; 3];
    for p in points {
        let d = ((p - mean) / size).to_array();
        for (row, x) in moments.iter_mut().zip(d) {
            row.iter_mut().zip(d).for_each(|(sum, y)| *sum += x * y);
        }
    }
    Some(smallest_axis(&moments))
}

fn smallest_axis(moments: &[[f64; 3]; 3]) -> (DVec3, [f64; 3]) {
    let (variances, axes) = symmetric_eigen(moments);
    let order = argsort(&variances);
    let normal = DVec3::from(axes.map(|row| row[order[0]])).normalize_or(DVec3::Z);
    (normal, std::array::from_fn(|k| variances[order[k]].max(0.0)))
}

/// Orientation spreads along the edges to this many nearest neighbours; more only cost time.
const SPREAD_NEIGHBOURS: usize = 10;

/// An edge steeper than this over a tangent plane, as a sine, comes after all others: it may join the two
/// sides of a thin body, or two taxels that noise put above each other. Along a chord of 90 degrees it is
/// 0.7.
const STEEP_EDGE: f64 = 0.75;

/// Turns normals that are known up to sign so that those of neighbours agree: along the spanning
/// tree of the edges on which this is clearest `(hoppe1992)`.
///
/// Weight and sign of an edge are computed as if both taxels were on one circle `(konig2009)`: then a tight
/// bend is clear, and an edge across a thin body is not. Edges that contradict the file's normals come last,
/// so that the tree follows correct normals and avoids a few wrong ones.
pub(super) fn orient_normals(
    normals: &mut PointNormals,
    positions: &IdVec<VertexId, DVec3>,
    neighbours: &Neighbours,
) {
    let PointNormals { normal, file, .. } = normals;
    let has_side = |v: VertexId| file[v] != DVec3::ZERO;
    let mut edges: Vec<(f64, VertexId, VertexId, bool)> = par_collect(positions.len(), |range, edges| {
        for v in range.map(VertexId::new) {
            edges.extend(neighbours.of(v).iter().take(SPREAD_NEIGHBOURS).map(|&w| {
                let along = (positions[w] - positions[v]).normalize_or_zero();
                let carried = normal[w] - 2.0 * normal[w].dot(along) * along;
                let agreement = normal[v].dot(carried);
                let is_steep = [v, w].iter().any(|&u| normal[u].dot(along).abs() > STEEP_EDGE);
                let is_denied = agreement < 0.0 && has_side(v) && has_side(w);
                let doubt = 1.0 - agreement.abs() + f64::from(u8::from(is_steep) + 2 * u8::from(is_denied));
                (doubt, v, w, agreement < 0.0)
            }));
        }
    });
    edges.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut sets = DisjointSets::<VertexId, Relation>::new(positions.len());
    for (_, v, w, is_reversed) in edges {
        // Edges that close a cycle are ignored, whether they agree or not.
        let _ = sets.join(v, w, Relation::reversed_if(is_reversed));
    }
    // The file's normals choose the side of a set.
    let mut votes = IdVec::<VertexId, i32>::filled(0, positions.len());
    for v in positions.ids().filter(|&v| has_side(v)) {
        let (root, relation) = sets.root(v);
        votes[root] += if relation.is_reversed() { -1 } else { 1 };
    }
    for v in positions.ids() {
        let (root, relation) = sets.root(v);
        if relation.is_reversed() != (votes[root] < 0) {
            normal[v] = -normal[v];
        }
    }
}
