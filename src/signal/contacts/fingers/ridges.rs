//! How many straight ridges explain the readings of a region: a greedy fit of atoms, each improved in turn.
//!
//! A finger that lies on a skin leaves a ridge that is one or two taxels wide and up to a few centimetres long, not a
//! round bump. With `s` the square root of the readings, an atom is `(a + b u) exp(-d^2 / 2 w^2)`: `d` is the distance from
//! a segment of length 0 to 50 mm in the tangent plane of its centre, `u` the position along it from -1 to 1, `w` the
//! width, `a >= 0` and `|b| <= 0.7 a`. The atom that lowers the sum of squares of what is left most is added; then each
//! is taken out and the best one put back. The count is that of the first sum of atoms that leaves a quarter of the
//! squares of `s` or less.
//!
//! *Heuristic*: width, lengths and the quarter are from 336 recordings of 0 to 5 fingers on a cover of 642 taxels. Round
//! bumps of any width count up to 26 points fewer of these right; widths of 4 mm 2 to 6 points, shares of 0.22 to 0.28
//! the same.

use std::f64::consts::PI;

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, edges};
use crate::numeric::Csr;

/// Width of a ridge of the square root of readings, in m, and in mean distances between taxels if those are far apart.
const WIDTH: f64 = 0.0026;
const WIDTH_OF_SPACING: f64 = 0.35;

/// Lengths of the segments other than a point, in m, and how many directions they have.
const LENGTHS: [f64; 6] = [0.01, 0.02, 0.03, 0.04, 0.05, 0.065];
const DIRECTIONS: u32 = 12;

/// An atom ends at this many widths.
const REACH: f64 = 3.0;

/// Most slope of an atom along its segment, over its height.
const TILT: f64 = 0.7;

/// Share of the squares that a fit leaves.
const LEFT: f64 = 0.25;

/// Most ridges of a region, and most rounds in which they are improved.
const MOST: usize = 7;
const SWEEPS: usize = 2;

/// A region with more centres is no hand; it is not split.
const MOST_CENTRES: usize = 1500;

/// Normals of taxels that belong to an atom are within 78 degrees of that of its centre.
const LEAST_COSINE: f64 = 0.2;

/// Where segments may lie on a patch.
#[derive(Debug, Clone)]
pub(super) struct Places {
    /// Taxels and middles of edges, with their normals.
    centres: Vec<(DVec3, DVec3)>,
    /// The centres at or next to each taxel.
    of_taxels: Csr<u32>,
    /// In m.
    width: f64,
}

impl Places {
    pub(super) fn new(mesh: &TriMesh, normals: &IdVec<VertexId, DVec3>) -> Self {
        let edges = edges(mesh);
        let at = |v: VertexId| mesh.positions[v];
        let length = edges.iter().map(|&[a, b]| at(a).distance(at(b))).sum::<f64>();
        let spacing = if edges.is_empty() { 0.0 } else { length / edges.len() as f64 };
        let width = WIDTH.max(WIDTH_OF_SPACING * spacing);
        let mut centres: Vec<_> = mesh.positions.iter().copied().zip(normals.iter().copied()).collect();
        let mut pairs: Vec<(usize, u32)> = mesh.positions.ids().map(|v| (v.index(), v.raw())).collect();
        // Where taxels are closer than a ridge is wide, middles between them add nothing.
        if spacing > width {
            for [a, b] in edges {
                let count = u32::try_from(centres.len()).unwrap_or(u32::MAX);
                pairs.extend([(a.index(), count), (b.index(), count)]);
                let normal = (normals[a] + normals[b]).try_normalize().unwrap_or(normals[a]);
                centres.push((0.5 * (at(a) + at(b)), normal));
            }
        }
        let of_taxels = Csr::from_pairs(mesh.positions.len(), pairs.iter().copied());
        Self { centres, of_taxels, width }
    }
}

/// The weights of one taxel in an atom: of the height, and of the slope.
#[derive(Debug, Clone, Copy)]
struct Entry {
    place: u32,
    height: f64,
    slope: f64,
}

/// A segment, as a list of entries, and the sums of their products.
#[derive(Debug, Clone, Copy)]
struct Atom {
    from: usize,
    to: usize,
    products: [f64; 3],
    is_long: bool,
}

/// An atom with its height and slope, and by how much it lowers the squares.
#[derive(Debug, Clone, Copy, Default)]
struct Ridge {
    gain: f64,
    atom: usize,
    height: f64,
    slope: f64,
}

/// Fits ridges; owns its lists.
#[derive(Debug, Clone, Default)]
pub(super) struct Ridges {
    /// The taxels that an atom may reach, and what is left of their readings.
    near: Vec<VertexId>,
    left: Vec<f64>,
    entries: Vec<Entry>,
    atoms: Vec<Atom>,
    chosen: Vec<Ridge>,
    centres: Vec<u32>,
    /// Taxels around a centre, and their coordinates in its tangent plane.
    plane: Vec<(u32, [f64; 2])>,
    /// Those near a line through it: along the line, weight across it, and square of the distance across.
    along: Vec<(u32, f64, f64, f64)>,
}

impl Ridges {
    /// Fits ridges to a region with these values of `s`, which are 0 outside of it. Lists for each of its taxels which
    /// ridge is the highest there, and returns the number of ridges; 1 if it is too large for fingers.
    pub(super) fn fit(
        &mut self,
        mesh: &TriMesh,
        normals: &IdVec<VertexId, DVec3>,
        places: &Places,
        roots: &IdVec<VertexId, f64>,
        region: &[VertexId],
        labels: &mut Vec<u32>,
    ) -> usize {
        labels.clear();
        labels.resize(region.len(), 0);
        self.centres.clear();
        self.centres.extend(region.iter().flat_map(|taxel| &places.of_taxels[taxel.index()]));
        self.centres.sort_unstable();
        self.centres.dedup();
        if self.centres.len() > MOST_CENTRES {
            return 1;
        }
        self.list_atoms(mesh, normals, places, region);
        self.left.clear();
        self.left.extend(self.near.iter().map(|&taxel| roots[taxel]));
        let all = self.squares();
        self.chosen.clear();
        while self.chosen.len() < MOST && self.squares() > LEFT * all {
            let Some(ridge) = self.best() else { break };
            self.add(ridge, -1.0);
            self.chosen.push(ridge);
            self.improve();
        }
        self.label(region, labels);
        self.chosen.len()
    }

    fn squares(&self) -> f64 {
        self.left.iter().map(|x| x * x).sum()
    }

    /// Takes each ridge out and puts the best one back.
    fn improve(&mut self) {
        for _ in 0..if self.chosen.len() > 1 { SWEEPS } else { 0 } {
            let mut has_changed = false;
            for k in 0..self.chosen.len() {
                let old = self.chosen[k];
                self.add(old, 1.0);
                let new = self.best().unwrap_or(old);
                has_changed |= new.atom != old.atom;
                self.add(new, -1.0);
                self.chosen[k] = new;
            }
            if !has_changed {
                break;
            }
        }
    }

    fn entries_of(&self, ridge: &Ridge) -> std::ops::Range<usize> {
        self.atoms[ridge.atom].from..self.atoms[ridge.atom].to
    }

    fn add(&mut self, ridge: Ridge, sign: f64) {
        for entry in &self.entries[self.entries_of(&ridge)] {
            self.left[entry.place as usize] +=
                sign * (ridge.height * entry.height + ridge.slope * entry.slope);
        }
    }

    /// The atom that lowers the squares most, with its height and slope; of several the first.
    fn best(&self) -> Option<Ridge> {
        let mut best: Option<Ridge> = None;
        for (atom, &Atom { from, to, products: [hh, hs, ss], is_long }) in self.atoms.iter().enumerate() {
            let (mut h, mut s) = (0.0, 0.0);
            for entry in &self.entries[from..to] {
                let left = self.left[entry.place as usize];
                h += entry.height * left;
                s += entry.slope * left;
            }
            let (mut height, mut slope) = (h / hh, 0.0);
            if is_long {
                let determinant = (hh * ss - hs * hs).max(1e-9);
                height = (ss * h - hs * s) / determinant;
                slope = (hh * s - hs * h) / determinant;
                let limit = TILT * height.max(0.0);
                slope = slope.clamp(-limit, limit);
                height = ((h - slope * hs) / hh).max(0.0);
                slope = slope.clamp(-TILT * height, TILT * height);
            }
            let squares = height * height * hh + 2.0 * height * slope * hs + slope * slope * ss;
            let gain = 2.0 * (height * h + slope * s) - squares;
            if height > 0.0 && gain > best.map_or(0.0, |best| best.gain) {
                best = Some(Ridge { gain, atom, height, slope });
            }
        }
        best
    }

    fn label(&mut self, region: &[VertexId], labels: &mut [u32]) {
        self.left.iter_mut().for_each(|x| *x = 0.0);
        for (k, ridge) in (0_u32..).zip(&self.chosen) {
            for entry in &self.entries[self.entries_of(ridge)] {
                let value = ridge.height * entry.height + ridge.slope * entry.slope;
                let place = entry.place as usize;
                if value > self.left[place] {
                    self.left[place] = value;
                    if let Ok(at) = region.binary_search(&self.near[place]) {
                        labels[at] = k;
                    }
                }
            }
        }
    }

    /// Lists the atoms of all centres of a region.
    fn list_atoms(
        &mut self,
        mesh: &TriMesh,
        normals: &IdVec<VertexId, DVec3>,
        places: &Places,
        region: &[VertexId],
    ) {
        let reach = 0.5 * LENGTHS[LENGTHS.len() - 1] + REACH * places.width;
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &centre in &self.centres {
            let (at, _) = places.centres[centre as usize];
            (low, high) = (low.min(at - reach), high.max(at + reach));
        }
        debug_assert!(!region.is_empty(), "a region has taxels");
        let is_near = |p: DVec3| p.cmpge(low).all() && p.cmple(high).all();
        self.near.clear();
        self.near.extend(mesh.positions.enumerate().filter(|(_, p)| is_near(**p)).map(|(taxel, _)| taxel));
        self.entries.clear();
        self.atoms.clear();
        for k in 0..self.centres.len() {
            let (centre, normal) = places.centres[self.centres[k] as usize];
            let (x_axis, y_axis) = normal.any_orthonormal_pair();
            self.plane.clear();
            for (place, &taxel) in (0_u32..).zip(&self.near) {
                let offset = mesh.positions[taxel] - centre;
                let distance = offset.length();
                if distance <= reach && normals[taxel].dot(normal) > LEAST_COSINE {
                    let (x, y) = (offset.dot(x_axis), offset.dot(y_axis));
                    // Stretched to the distance in space, so that a curved skin does not shorten it.
                    let stretch = distance / x.hypot(y).max(f64::MIN_POSITIVE);
                    self.plane.push((place, [x * stretch, y * stretch]));
                }
            }
            self.list_direction(places.width, [1.0, 0.0], &[0.0]);
            for direction in 0..DIRECTIONS {
                let (sine, cosine) = (PI * f64::from(direction) / f64::from(DIRECTIONS)).sin_cos();
                self.list_direction(places.width, [cosine, sine], &LENGTHS);
            }
        }
    }

    /// Lists the atoms of these lengths along a direction in the tangent plane.
    fn list_direction(&mut self, width: f64, [cosine, sine]: [f64; 2], lengths: &[f64]) {
        let (limit, scale) = (REACH * REACH * width * width, -0.5 / (width * width));
        self.along.clear();
        for &(place, [x, y]) in &self.plane {
            let (along, across) = (x * cosine + y * sine, y * cosine - x * sine);
            let squared = across * across;
            if squared < limit {
                self.along.push((place, along, (scale * squared).exp(), squared));
            }
        }
        for &length in lengths {
            let from = self.entries.len();
            let unit = (0.5 * length).max(width).recip();
            // Not 0, so that an atom without taxels has no height.
            let mut products = [1e-12, 0.0, 1e-12];
            for &(place, along, weight, squared) in &self.along {
                let beyond = along.abs() - 0.5 * length;
                let height = if beyond <= 0.0 {
                    weight
                } else if squared + beyond * beyond < limit {
                    weight * (scale * beyond * beyond).exp()
                } else {
                    continue;
                };
                let slope = height * (along * unit).clamp(-1.0, 1.0);
                products[0] += height * height;
                products[1] += height * slope;
                products[2] += slope * slope;
                self.entries.push(Entry { place, height, slope });
            }
            let to = self.entries.len();
            self.atoms.push(Atom { from, to, products, is_long: length > 0.0 });
        }
    }
}
