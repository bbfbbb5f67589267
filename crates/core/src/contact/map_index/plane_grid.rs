//! The triangles of a map at a point: a grid over the plane with about one cell for twelve triangles, or more
//! cells if the density of the skin varies strongly.
//!
//! A cell lists the triangles that overlap it, each with its corners and with a bit for each of the 8 x 8
//! subcells that it overlaps: between the cell and the corners nothing else has to be loaded. Subcells are
//! computed with a margin for rounding, so that no triangle at a point is left out; the rest is measured in
//! `f64`. A cell with too many triangles lists none, and a tree must be searched.

use std::ops::Range;

use glam::{DVec2, DVec3};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::TriMesh;

/// The area of a cell, in mean areas of a triangle (*heuristic*: a triangle then lies in about two cells. In
/// smaller cells fewer triangles remain around a point, but the lists are longer, and loading them takes
/// longer on a large map).
const CELL_AREA: f64 = 12.0;

/// Most cells of a grid, for each triangle; reached if the map fills little of its rectangle.
const MOST_CELLS: f64 = 4.0;

/// Most overlaps of the rectangles around all triangles with cells, for each triangle: few large triangles
/// among many small ones must not fill the memory.
const MOST_OVERLAPS: f64 = 12.0;

/// Cells are made smaller while more than this share of the overlaps is in crowded cells, as on skin of
/// strongly varying density (*heuristic*).
const MOST_CROWDED: f64 = 0.02;

/// Most refinements of cells: by 2.25 in area each time, until there are [`MOST_CELLS`].
const REFINEMENTS: usize = 6;

/// A cell with more triangles lists none: the candidates at a point are bits of one word.
const MAX_LISTED: usize = 64;

/// Mark of the start of such a cell.
const CROWDED: u32 = 1 << 31;

/// Subcells along each side of a cell.
const SUBCELLS: usize = 8;

/// Bound of the rounding error of a barycentric coordinate, as a fraction of its gradient and of its value at
/// the corner of the cell.
const BARYCENTRIC_ROUNDING: f64 = 1.0 / 1_048_576.0;

/// The triangles of a map by position.
#[derive(Debug, Clone)]
pub(super) struct PlaneGrid {
    /// The corner of the first cell, in m.
    lo: DVec2,
    /// Cells per m.
    scale: f64,
    /// Columns and rows.
    size: [usize; 2],
    /// Their extent, in subcells.
    end: DVec2,
    /// The index of the first entry of each cell, with the mark [`CROWDED`] or not; then the number of all entries.
    cells: Vec<u32>,
    entries: Vec<Entry>,
}

/// A triangle in a cell, with one bit for each subcell that it overlaps.
#[derive(Debug, Clone, Copy)]
struct Entry {
    parts: u64,
    corners: [VertexId; 3],
    face: FaceId,
}

/// The barycentric coordinates of a triangle over the plane, in cells.
struct Affine {
    /// Of the first two: growth along both sides of a cell, and value in the corner of the first cell.
    rows: [DVec3; 2],
}

impl Affine {
    fn new([a, b, c]: [DVec2; 3]) -> Self {
        let area = (b - a).perp_dot(c - a);
        let row = |from: DVec2, to: DVec2| {
            let side = (to - from).perp() / area;
            side.extend(-side.dot(from))
        };
        Self { rows: [row(b, c), row(c, a)] }
    }

    /// The subcells that the triangle, enlarged by `margin` cells, overlaps; row by row.
    fn parts(&self, cell: [usize; 2], margin: f64) -> u64 {
        let corner = DVec2::from(cell.map(|k| k as f64));
        let rows = self.rows.map(|row| row.truncate().extend(row.z + row.truncate().dot(corner)));
        let size = |row: &DVec3| row.x.abs() + row.y.abs();
        let slack: f64 = rows
            .iter()
            .map(|row| {
                (margin + BARYCENTRIC_ROUNDING) * size(row) + BARYCENTRIC_ROUNDING * (row.z.abs() + 1.0)
            })
            .sum();
        // Slivers and triangles without area may contain every point.
        if slack.is_nan() || slack >= f64::from(f32::MAX) {
            return u64::MAX;
        }
        let rows = [rows[0], rows[1], DVec3::Z - rows[0] - rows[1]];
        // The largest value in a subcell: along its rows and columns.
        let most = |growth: f64, k: usize| {
            (growth * k as f64).max(growth * (k + 1) as f64) * (1.0 / SUBCELLS as f64)
        };
        let along: [_; SUBCELLS] = std::array::from_fn(|k| rows.map(|row| most(row.x, k) + row.z + slack));
        let mut parts = 0;
        for k in 0..SUBCELLS {
            let down = rows.map(|row| most(row.y, k));
            for (column, along) in along.iter().enumerate() {
                let least = (along[0] + down[0]).min(along[1] + down[1]).min(along[2] + down[2]);
                parts |= u64::from(least >= 0.0) << (k * SUBCELLS + column);
            }
        }
        parts
    }
}

/// A triangle and the columns and rows of the cells that the rectangle around it overlaps.
type Placed = (Affine, [Range<usize>; 2]);

impl PlaneGrid {
    /// A grid over at least one triangle of finite coordinates, in m, in the plane of the first two; points
    /// no farther than `margin` (m) from a triangle are on it.
    pub(super) fn new(plane: &TriMesh, margin: f64) -> Self {
        let triangles = &plane.triangles;
        let corners = |face: FaceId| plane.corners(face).map(|corner| corner.truncate());
        let around = |face: FaceId| {
            let [a, b, c] = corners(face);
            (a.min(b).min(c) - margin, a.max(b).max(c) + margin)
        };
        let empty = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let join = |(lo, hi): (DVec2, DVec2), b: (DVec2, DVec2)| (lo.min(b.0), hi.max(b.1));
        let (lo, hi) = triangles.ids().map(around).fold(empty, join);
        let (extent, count) = ((hi - lo).max(DVec2::ZERO), triangles.len().max(1) as f64);
        let doubled = |[a, b, c]: [DVec2; 3]| (b - a).perp_dot(c - a).abs();
        let mean = triangles.ids().map(|face| doubled(corners(face))).sum::<f64>() / (2.0 * count);
        let area = CELL_AREA * mean;
        let most = MOST_CELLS * count;
        let side = area.max(extent.element_product() / most).sqrt().max(extent.max_element() / most);
        let scale = Some(side.recip()).filter(|scale| scale.is_finite()).unwrap_or(1.0);
        let mut grid =
            Self { lo, scale, size: [1, 1], end: DVec2::ZERO, cells: Vec::new(), entries: Vec::new() };
        grid.resize(extent);
        let overlaps = |grid: &Self| -> f64 {
            let count = |[columns, rows]: [Range<usize>; 2]| columns.len() as f64 * rows.len() as f64;
            triangles.ids().map(|face| count(grid.range(around(face)))).sum()
        };
        while grid.size != [1, 1] && overlaps(&grid) > MOST_OVERLAPS * count {
            grid.scale *= 0.5;
            grid.resize(extent);
        }
        for _ in 0..REFINEMENTS {
            if grid.crowded(triangles.ids().map(around)) <= MOST_CROWDED {
                break;
            }
            let mut finer = Self { scale: 1.5 * grid.scale, ..grid.clone() };
            finer.resize(extent);
            let cells = finer.size[0] as f64 * finer.size[1] as f64;
            if cells > most || overlaps(&finer) > MOST_OVERLAPS * count {
                break;
            }
            grid = finer;
        }
        let place = |face: FaceId| {
            let in_cells = corners(face).map(|p| (p - grid.lo) * grid.scale);
            (Affine::new(in_cells), grid.range(around(face)))
        };
        let placed: Vec<Placed> = triangles.ids().map(place).collect();
        grid.fill(triangles, &placed, margin * grid.scale);
        grid
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive, and few")]
    fn resize(&mut self, extent: DVec2) {
        self.size = (extent * self.scale).to_array().map(|n| n as usize + 1);
        self.end = DVec2::from(self.size.map(|n| (n * SUBCELLS) as f64));
    }

    /// Columns and rows of the cells that a rectangle overlaps.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
    fn range(&self, (lo, hi): (DVec2, DVec2)) -> [Range<usize>; 2] {
        let at = |p: DVec2, k: usize| ((p - self.lo) * self.scale)[k].max(0.0) as usize;
        [0, 1].map(|k| at(lo, k).min(self.size[k] - 1)..at(hi, k).min(self.size[k] - 1) + 1)
    }

    /// The share of the overlaps of rectangles with cells that is in crowded cells.
    fn crowded(&self, rectangles: impl Iterator<Item = (DVec2, DVec2)>) -> f64 {
        let mut counts = vec![0_usize; self.size[0] * self.size[1]];
        for rectangle in rectangles {
            let [columns, rows] = self.range(rectangle);
            rows.for_each(|row| columns.clone().for_each(|column| counts[row * self.size[0] + column] += 1));
        }
        let crowded: usize = counts.iter().filter(|count| **count > MAX_LISTED).sum();
        crowded as f64 / counts.iter().sum::<usize>().max(1) as f64
    }

    /// Lists the triangles of each cell, in the order of the faces.
    #[expect(clippy::cast_possible_truncation, reason = "MOST_OVERLAPS a triangle, and few of these")]
    fn fill(&mut self, triangles: &IdVec<FaceId, [VertexId; 3]>, placed: &[Placed], margin: f64) {
        let [columns, rows] = self.size;
        let mut found: Vec<(usize, Entry)> = Vec::with_capacity(4 * placed.len());
        let mut counts = vec![0_usize; columns * rows];
        for ((face, &corners), (affine, [across, down])) in triangles.enumerate().zip(placed) {
            for (row, column) in down.clone().flat_map(|row| across.clone().map(move |k| (row, k))) {
                let parts = affine.parts([column, row], margin);
                if parts != 0 {
                    let cell = row * columns + column;
                    counts[cell] += 1;
                    found.push((cell, Entry { parts, corners, face }));
                }
            }
        }
        let mut end = 0;
        for count in counts {
            let is_crowded = count > MAX_LISTED;
            self.cells.push(end as u32 | if is_crowded { CROWDED } else { 0 });
            end += if is_crowded { 0 } else { count };
        }
        self.cells.push(end as u32);
        let mut next = self.cells.clone();
        let none = Entry { parts: 0, corners: [VertexId::new(0); 3], face: FaceId::new(0) };
        self.entries = vec![none; end];
        for (cell, entry) in found {
            if next[cell] & CROWDED == 0 {
                self.entries[next[cell] as usize] = entry;
                next[cell] += 1;
            }
        }
    }

    /// Calls `visit` with every triangle that may contain a point (m), and some near it, and with their
    /// corners, in the order of the faces; `false`, without a call, if the cell is crowded.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside of the grid")]
    pub(super) fn each_at(&self, at: DVec2, mut visit: impl FnMut(FaceId, [VertexId; 3])) -> bool {
        let p = (at - self.lo) * (self.scale * SUBCELLS as f64);
        if !(p.min_element() >= 0.0 && p.x < self.end.x && p.y < self.end.y) {
            return true;
        }
        let [x, y] = [p.x as usize, p.y as usize];
        let cell = y / SUBCELLS * self.size[0] + x / SUBCELLS;
        let [first, end] = [self.cells[cell], self.cells[cell + 1] & !CROWDED];
        if first & CROWDED != 0 {
            return false;
        }
        let part = y % SUBCELLS * SUBCELLS + x % SUBCELLS;
        let entries = &self.entries[first as usize..end as usize];
        // Without a branch for each: which of them contain the point is unpredictable.
        let bit = |(k, entry): (usize, &Entry)| (entry.parts >> part & 1) << k;
        let mut holding =
            entries.iter().take(MAX_LISTED).enumerate().map(bit).fold(0, std::ops::BitOr::bitor);
        while holding != 0 {
            let Entry { face, corners, .. } = entries[holding.trailing_zeros() as usize];
            visit(face, corners);
            holding &= holding - 1;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;
    use crate::mesh::{TriMesh, closest_point, shapes};

    /// The triangles as a mesh, no two of which share a vertex.
    fn mesh(triangles: &[[DVec3; 3]]) -> TriMesh {
        let faces: Vec<_> = (0_u32..).take(triangles.len()).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        TriMesh::from_arrays(triangles.iter().flatten().copied().collect(), &faces)
    }

    /// The triangles that contain a point.
    fn brute(mesh: &TriMesh, at: DVec2, margin: f64) -> Vec<FaceId> {
        let plane = mesh.positions.map(|p| p.truncate().extend(0.0));
        let squared = |face: FaceId| {
            let ids = mesh.triangles[face];
            closest_point(at.extend(0.0), ids.map(|v| plane[v]), ids).squared
        };
        mesh.triangles.ids().filter(|&face| squared(face) <= margin * margin).collect()
    }

    /// The number of triangles visited at a thousand points of an ellipse around `centre` that touches both
    /// axes; no cell there is crowded.
    fn visited(grid: &PlaneGrid, centre: DVec2) -> usize {
        let mut visited = 0;
        for k in 0..1000_u32 {
            let (sin, cos) = f64::from(k).sin_cos();
            assert!(grid.each_at(centre * DVec2::new(1.0 + sin, 1.0 + cos), |_, _| visited += 1));
        }
        visited
    }

    proptest! {
        #![proptest_config(soup::fixed(300, 51))]

        /// No triangle at a point is left out, even if it is a sliver, a point or far larger than the others.
        #[test]
        fn every_triangle_at_a_point_is_visited(
            triangles in prop::collection::vec(soup::triangle(), 1..60),
            scale in prop_oneof![Just(1e-6), Just(1.0), Just(1e6)],
            large in prop::bool::ANY,
            places in prop::collection::vec((any::<prop::sample::Index>(), 0.0_f64..1.0, 0.0_f64..1.0), 40),
        ) {
            let mut mesh = mesh(&triangles);
            if large {
                mesh.positions[VertexId::new(0)] *= 200.0;
            }
            mesh.positions.iter_mut().for_each(|p| *p *= scale);
            let margin = 1e-12 * scale;
            let grid = PlaneGrid::new(&mesh, margin);
            for (face, s, t) in places {
                let [a, b, c] = mesh.corners(FaceId::new(face.index(triangles.len())));
                let at = (a * (1.0 - s.max(t)) + b * (s - t).abs() + c * s.min(t)).truncate();
                let mut found = Vec::new();
                let is_listed = grid.each_at(at, |face, corners| {
                    assert_eq!(corners, mesh.triangles[face]);
                    found.push(face);
                });
                prop_assert!(is_listed || triangles.len() > MAX_LISTED);
                for face in brute(&mesh, at, margin) {
                    prop_assert!(!is_listed || found.contains(&face), "{face:?} at {at} in {found:?}");
                }
            }
        }
    }

    /// On a map few triangles remain to be measured, and the grid is not much larger than the map.
    #[test]
    fn few_triangles_are_visited_at_a_point() {
        let mesh = shapes::lattice(60, 40, 0.004);
        let grid = PlaneGrid::new(&mesh, 1e-12);
        let visited = visited(&grid, DVec2::new(0.1, 0.05));
        assert!((1000..3000).contains(&visited), "{visited} for 1000 places");
        assert!(grid.entries.len() < 3 * mesh.triangles.len(), "{} entries", grid.entries.len());
        assert!(grid.each_at(DVec2::splat(-1.0), |face, _| panic!("{face:?} is not off the map")));
    }

    /// Skin with taxels 1 mm apart next to skin with 8 mm: the cells are small enough for the dense region.
    #[test]
    fn dense_regions_of_a_map_are_not_crowded() {
        let at = |k: u32| 0.001 * f64::from(k) + 0.007 * f64::from(k.saturating_sub(40));
        let mesh = shapes::sheet(60, 60, |i, j| DVec3::new(at(i), at(j), 0.0));
        let grid = PlaneGrid::new(&mesh, 1e-12);
        let visited = visited(&grid, DVec2::splat(0.02));
        assert!((1000..4000).contains(&visited), "{visited} for 1000 places");
        assert!(grid.entries.len() < 5 * mesh.triangles.len(), "{} entries", grid.entries.len());
    }

    /// Grids of coincident triangles, and of many small ones under a large one, are built quickly.
    #[test]
    fn crowded_cells_are_left_to_the_tree() {
        let mut stacked = shapes::triangle();
        stacked.triangles = vec![[0, 1, 2].map(VertexId::new); 20_000].into();
        let grid = PlaneGrid::new(&stacked, 1e-12);
        assert!(!grid.each_at(DVec2::splat(0.2), |_, _| ()) && grid.entries.is_empty());
        let grid = PlaneGrid::new(&TriMesh::from_arrays(vec![DVec3::ONE; 3], &[[0, 1, 2]]), 0.0);
        let mut found = 0;
        assert!(grid.each_at(DVec2::ONE, |_, _| found += 1) && found == 1, "a map that is one point");
        assert!(grid.cells.len() < 10);
    }
}
