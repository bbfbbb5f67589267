//! The outer faces of shells of CAD, without inner sides of walls, ribs and screws.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use crate::bvh::{Ray, TriangleTree};
use crate::id::FaceId;
use crate::mesh::triangle_cross;
use crate::numeric::DisjointSets;
use crate::remesh::SHARP;
use crate::skin::{Draft, LinkId, Remark, RemarkKind, Sheet};

/// Directions from which a point of a surface is viewed from far away.
const DIRECTIONS: u32 = 64;

/// Directions at a smaller angle to the surface are not tried: the cosine of 84 degrees.
const MIN_COSINE: f64 = 0.1;

/// A point is outside if this share of the directions on one of its sides is free. *Heuristic*: it is a tenth
/// in the middle of a tube twice as long as wide, a third at the bottom of a pocket as deep as wide.
const MIN_FREE_SHARE: f64 = 0.25;

/// Most points that are tested in a region, and about how many in all regions of a sheet: a region gets its
/// share by area, at least one. A region is outside if half of its points are.
const POINTS: usize = 16;
const ALL_POINTS: f64 = 1000.0;

/// Distance of the start of rays from the surface, over the size of the link.
const RAY_OFFSET: f64 = 1e-5;

/// Keeps the faces that can be seen from outside of their link, ignoring the other links; returns how many
/// were dropped. Faces that are connected without crossing a sharp edge stay together. Sheets of files without
/// links belong to one link; a remark names each sheet that is left out completely.
///
/// Faces with a corner out of range or not finite are kept; they are refused when the sheet is assembled.
pub fn keep_outer(draft: &mut Draft) -> usize {
    let mut links: BTreeMap<Option<LinkId>, Vec<usize>> = BTreeMap::new();
    for (k, sheet) in draft.sheets.iter().enumerate() {
        links.entry(sheet.link).or_default().push(k);
    }
    let mut kept: Vec<Vec<bool>> = draft.sheets.iter().map(|s| vec![true; s.triangles.len()]).collect();
    for sheets in links.into_values() {
        let Some(body) = LinkBody::new(sheets.iter().map(|&k| &draft.sheets[k])) else { continue };
        let is_outer: Vec<Vec<bool>> = sheets.par_iter().map(|&k| body.outer(&draft.sheets[k])).collect();
        for (&k, is_outer) in sheets.iter().zip(is_outer) {
            kept[k] = is_outer;
        }
    }
    let count = |draft: &Draft| draft.sheets.iter().map(|sheet| sheet.triangles.len()).sum::<usize>();
    let all = count(draft);
    for (sheet, _) in
        draft.sheets.iter().zip(&kept).filter(|(_, kept)| !kept.is_empty() && !kept.contains(&true))
    {
        let kind = RemarkKind::PassedOver { what: "inside the rest of its link, and left out".into() };
        draft.remarks.push(Remark { patch: sheet.title().to_owned(), kind });
    }
    // Sheets without triangles are kept.
    let mut kept = kept.into_iter().flatten();
    draft.retain(|sheet, _| sheet.triangles.is_empty() || kept.next().unwrap_or(true));
    all - count(draft)
}

/// All triangles of a link.
struct LinkBody {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    tree: TriangleTree,
    size: f64,
    directions: Vec<DVec3>,
}

impl LinkBody {
    /// `None` if there is nothing to search.
    fn new<'a>(sheets: impl Iterator<Item = &'a Sheet>) -> Option<Self> {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for (sheet, triangle) in sheets.flat_map(|sheet| sheet.triangles.iter().map(move |t| (sheet, t))) {
            if let Some(corners) = corners(sheet, triangle) {
                let first = u32::try_from(positions.len()).ok()?;
                positions.extend(corners);
                triangles.push([first, first + 1, first + 2]);
            }
        }
        let tree = TriangleTree::new(&positions, triangles.iter().copied()).ok()?;
        let low = positions.iter().copied().reduce(DVec3::min)?;
        let size = low.distance(positions.iter().copied().reduce(DVec3::max)?);
        Some(Self { positions, triangles, tree, size, directions: directions() })
    }

    /// Which faces of one of its sheets are outside.
    fn outer(&self, sheet: &Sheet) -> Vec<bool> {
        let cross = |t| corners(sheet, t).map_or(DVec3::ZERO, triangle_cross);
        let crosses: Vec<DVec3> = sheet.triangles.iter().map(cross).collect();
        let total: f64 = crosses.iter().map(|cross| cross.length()).sum();
        let mut is_outer = vec![false; sheet.triangles.len()];
        for region in regions(sheet, &crosses) {
            let area: f64 = region.iter().map(|&face| crosses[face].length()).sum();
            let points = (1..POINTS).take_while(|&k| k as f64 * total < ALL_POINTS * area).count() + 1;
            let step = region.len().div_ceil(points);
            // The largest faces first.
            let mut largest = region.clone();
            largest.sort_by(|&f, &g| {
                crosses[g].length_squared().total_cmp(&crosses[f].length_squared()).then(f.cmp(&g))
            });
            let tried: Vec<usize> = largest.into_iter().step_by(step).collect();
            let seen = tried.iter().filter(|&&face| {
                corners(sheet, &sheet.triangles[face]).is_none_or(|[a, b, c]| {
                    self.is_seen((a + b + c) / 3.0, crosses[face].normalize_or_zero())
                })
            });
            let is_seen = 2 * seen.count() >= tried.len();
            region.into_iter().for_each(|face| is_outer[face] = is_seen);
        }
        is_outer
    }

    /// Whether a point can be seen from far away on one side of its face.
    fn is_seen(&self, point: DVec3, normal: DVec3) -> bool {
        [normal, -normal].into_iter().any(|normal| {
            let start = point + normal * (RAY_OFFSET * self.size);
            let directions: Vec<DVec3> =
                self.directions.iter().copied().filter(|d| d.dot(normal) > MIN_COSINE).collect();
            let is_free = |direction: &&DVec3| {
                let ray = Ray::new(start, **direction, 2.0 * self.size);
                ray.is_none_or(|ray| self.tree.first_hit(&ray, |face| self.corners(face)).is_none())
            };
            // Stops once enough free directions are found.
            let needed =
                (1..=directions.len()).find(|&k| k as f64 >= MIN_FREE_SHARE * directions.len() as f64);
            needed.is_some_and(|needed| directions.iter().filter(is_free).take(needed).count() == needed)
        })
    }

    fn corners(&self, face: u32) -> [DVec3; 3] {
        self.triangles[face as usize].map(|v| self.positions[v as usize])
    }
}

/// The corners of a triangle, if all exist and are finite.
fn corners(sheet: &Sheet, triangle: &[u32; 3]) -> Option<[DVec3; 3]> {
    let [a, b, c] = triangle.map(|v| sheet.positions.get(v as usize).copied().filter(|p| p.is_finite()));
    Some([a?, b?, c?])
}

/// Evenly distributed directions: a Fibonacci spiral on the sphere.
fn directions() -> Vec<DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let direction = |k: u32| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(DIRECTIONS);
        let (sin, cos) = (golden * f64::from(k)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    };
    (0..DIRECTIONS).map(direction).collect()
}

/// The faces that are connected across edges that are not sharp, in the order of their first faces.
fn regions(sheet: &Sheet, crosses: &[DVec3]) -> Vec<Vec<usize>> {
    let sides = sheet
        .triangles
        .iter()
        .enumerate()
        .flat_map(|(face, &[a, b, c])| [[a, b], [b, c], [c, a]].map(|[p, q]| (p.min(q), p.max(q), face)));
    let mut sides: Vec<(u32, u32, usize)> = sides.collect();
    sides.sort_unstable();
    let mut sets = DisjointSets::<FaceId>::new(crosses.len());
    for pair in sides.windows(2) {
        let [(a, b, f), (c, d, g)] = [pair[0], pair[1]];
        let [n, m] = [f, g].map(|face| crosses[face].normalize_or_zero());
        let is_even = n == DVec3::ZERO || m == DVec3::ZERO || n.dot(m).abs() >= SHARP;
        if (a, b) == (c, d) && is_even {
            sets.join(FaceId::new(f), FaceId::new(g));
        }
    }
    let labels = sets.labels();
    let mut regions = vec![Vec::new(); labels.count];
    for (face, &region) in labels.of.enumerate() {
        regions[region].push(face.index());
    }
    regions
}
