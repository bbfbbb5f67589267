//! The atoms of a centre: segments of all lengths and directions, with the weights of the taxels around them.
//!
//! Most taxels of a long atom are those of a shorter one with the same weights, so each direction lists them once.

use std::f64::consts::PI;

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, edges};
use crate::numeric::{Csr, narrow};

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

/// Normals of taxels that belong to an atom are within 78 degrees of that of its centre.
const LEAST_COSINE: f64 = 0.2;

/// Bounds of gains are as exact as this, relative.
const ROUNDING: f64 = 1e-6;

/// Where segments may lie on a patch.
#[derive(Debug, Clone)]
pub(super) struct Places {
    /// The number of the first centre among those of all patches.
    pub(super) first: usize,
    /// Taxels and middles of edges, with their normals.
    pub(super) centres: Vec<(DVec3, DVec3)>,
    /// The centres at or next to each taxel.
    pub(super) of_taxels: Csr<u32>,
    /// In m.
    width: f64,
}

impl Places {
    /// `first` centres are on other patches.
    pub(super) fn new(mesh: &TriMesh, normals: &IdVec<VertexId, DVec3>, first: usize) -> Self {
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
        Self { first, centres, of_taxels, width }
    }

    /// How far from its centre an atom has taxels, in m.
    pub(super) fn reach(&self) -> f64 {
        0.5 * LENGTHS[LENGTHS.len() - 1] + REACH * self.width
    }

    /// The number after that of its last centre.
    pub(super) fn end(&self) -> usize {
        self.first + self.centres.len()
    }
}

/// A taxel near the line of a direction through a centre.
#[derive(Debug, Clone, Copy)]
struct Beside {
    taxel: VertexId,
    /// The number of the shortest segment that it lies beside; their count if it is beyond all.
    shortest: u32,
    /// Its weight by its distance from the line, and that times its coordinate along the line.
    weight: f32,
    moment: f32,
}

/// The weights of one taxel in an atom: of the height, and of the slope.
#[derive(Debug, Clone, Copy)]
struct Entry {
    taxel: VertexId,
    height: f32,
    slope: f32,
}

/// A segment: the taxels beside it have the weights of its direction, those around its ends their own.
#[derive(Debug, Clone, Copy)]
struct Atom {
    /// The number after that of its last entry; the first is after those of the atom before.
    end: u32,
    /// One over the least sum of squares of weights with a slope that it may have.
    bound: f32,
}

/// The atoms of a centre: a point, then those of each direction, from the shortest on. Their lists are read as a whole for
/// each ridge, so they are as small as they can be.
#[derive(Debug, Clone, Default)]
pub(super) struct Fan {
    /// The number of the centre, and of the fit that has used it last.
    pub(super) centre: usize,
    pub(super) used: u64,
    pub(super) at: DVec3,
    beside: Vec<Beside>,
    /// For each direction the number after that of its last taxel.
    directions: Vec<usize>,
    ends: Vec<Entry>,
    atoms: Vec<Atom>,
    /// For each atom the sums of the products of weights.
    products: Vec<[f64; 3]>,
    /// For each length one over the coordinate along the line at which the slope has its full weight, in 1/m.
    units: [f64; LENGTHS.len()],
}

/// An atom with its height and slope, and by how much it lowers the squares.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ridge {
    pub(super) gain: f64,
    pub(super) fan: usize,
    pub(super) atom: usize,
    pub(super) height: f64,
    pub(super) slope: f64,
}

impl Fan {
    /// The number of entries of its lists.
    pub(super) fn len(&self) -> usize {
        self.beside.len() + self.ends.len()
    }

    /// The weights of the taxels of an atom.
    pub(super) fn entries(&self, atom: usize) -> impl Iterator<Item = (VertexId, [f64; 2])> {
        let (direction, number) = match atom.checked_sub(1) {
            None => (0, 0),
            Some(long) => (1 + long / LENGTHS.len(), long % LENGTHS.len()),
        };
        let before = |of: usize, end: &dyn Fn(usize) -> usize| of.checked_sub(1).map_or(0, end);
        let from = before(direction, &|k| self.directions[k]);
        let first = before(atom, &|k| self.atoms[k].end as usize);
        let unit = self.units[number];
        let beside = self.beside[from..self.directions[direction]].iter();
        let beside = beside
            .filter(move |beside| beside.shortest as usize <= number)
            .map(move |beside| (beside.taxel, [f64::from(beside.weight), unit * f64::from(beside.moment)]));
        let ends = self.ends[first..self.atoms[atom].end as usize].iter();
        beside.chain(ends.map(|entry| (entry.taxel, [f64::from(entry.height), f64::from(entry.slope)])))
    }

    /// The atom that lowers the squares of what is left most, by more than `least`; of several the first.
    pub(super) fn best(&self, left: &IdVec<VertexId, f64>, mut least: f64) -> Option<Ridge> {
        let mut best = None;
        let (mut from, mut first, mut atom) = (0, 0, 0);
        for &to in &self.directions {
            // The sums over the taxels beside a segment, but not beside a shorter one.
            let mut sums = [[0.0; 2]; LENGTHS.len() + 1];
            for beside in &self.beside[from..to] {
                let (left, sums) = (left[beside.taxel], &mut sums[beside.shortest as usize]);
                sums[0] += f64::from(beside.weight) * left;
                sums[1] += f64::from(beside.moment) * left;
            }
            from = to;
            let is_long = atom > 0;
            let (mut weights, mut moments) = (0.0, 0.0);
            for (sums, unit) in sums.iter().zip(&self.units).take(if is_long { LENGTHS.len() } else { 1 }) {
                let Atom { end, bound } = self.atoms[atom];
                weights += sums[0];
                moments += sums[1];
                let (mut h, mut s) = (weights, unit * moments);
                for entry in &self.ends[first..end as usize] {
                    let left = left[entry.taxel];
                    h += f64::from(entry.height) * left;
                    s += f64::from(entry.slope) * left;
                }
                // It cannot lower them by more than this.
                let most = (h + if is_long { TILT * s.abs() } else { 0.0 }).max(0.0);
                if most * most * f64::from(bound) > least
                    && let Some(ridge) = fitted([h, s], self.products[atom], is_long)
                    && ridge.gain > least
                {
                    least = ridge.gain;
                    best = Some(Ridge { atom, ..ridge });
                }
                (first, atom) = (end as usize, atom + 1);
            }
        }
        best
    }
}

/// The height and slope of an atom that lower the squares most, by the sums of its weights times what is left, and those of
/// their products.
fn fitted([h, s]: [f64; 2], [hh, hs, ss]: [f64; 3], is_long: bool) -> Option<Ridge> {
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
    (height > 0.0).then_some(Ridge { gain, height, slope, ..Ridge::default() })
}

/// Lists the atoms of a centre; owns its lists.
#[derive(Debug, Clone, Default)]
pub(super) struct FanBuilder {
    /// Taxels around a centre, and their coordinates in its tangent plane.
    plane: Vec<(VertexId, [f64; 2])>,
    /// Those near a line through it: along the line, and square of the distance across.
    along: Vec<[f64; 2]>,
}

impl FanBuilder {
    /// Lists the atoms of a centre at a point with a normal. The taxels that they may reach are among `near`.
    pub(super) fn build(
        &mut self,
        fan: &mut Fan,
        places: &Places,
        (centre, normal): (DVec3, DVec3),
        (mesh, normals, near): (&TriMesh, &IdVec<VertexId, DVec3>, &[VertexId]),
    ) {
        let (x_axis, y_axis) = normal.any_orthonormal_pair();
        self.plane.clear();
        for &taxel in near {
            let offset = mesh.positions[taxel] - centre;
            let distance = offset.length();
            if distance <= places.reach() && normals[taxel].dot(normal) > LEAST_COSINE {
                let (x, y) = (offset.dot(x_axis), offset.dot(y_axis));
                // Stretched to the distance in space, so that a curved skin does not shorten it.
                let stretch = distance / x.hypot(y).max(f64::MIN_POSITIVE);
                self.plane.push((taxel, [x * stretch, y * stretch]));
            }
        }
        fan.at = centre;
        fan.beside.clear();
        fan.ends.clear();
        fan.directions.clear();
        fan.atoms.clear();
        fan.products.clear();
        fan.units = LENGTHS.map(|length| (0.5 * length).max(places.width).recip());
        self.list_direction(fan, places.width, [1.0, 0.0], &[0.0]);
        for direction in 0..DIRECTIONS {
            let (sine, cosine) = (PI * f64::from(direction) / f64::from(DIRECTIONS)).sin_cos();
            self.list_direction(fan, places.width, [cosine, sine], &LENGTHS);
        }
    }

    /// Lists the atoms of these lengths along a direction in the tangent plane.
    #[expect(clippy::cast_possible_truncation, reason = "a fan has few taxels and lengths")]
    fn list_direction(&mut self, fan: &mut Fan, width: f64, [cosine, sine]: [f64; 2], lengths: &[f64]) {
        let (limit, scale) = (REACH * REACH * width * width, -0.5 / (width * width));
        let first = fan.beside.len();
        // Sums of products over the taxels beside a segment, but not beside a shorter one.
        let mut sums = [[0.0; 3]; LENGTHS.len() + 1];
        self.along.clear();
        for &(taxel, [x, y]) in &self.plane {
            let (along, across) = (x * cosine + y * sine, y * cosine - x * sine);
            let squared = across * across;
            if squared < limit {
                let shortest = lengths.iter().take_while(|&&length| along.abs() > 0.5 * length).count();
                let weight = (scale * squared).exp();
                let moment = weight * along;
                let products = [weight * weight, weight * moment, moment * moment];
                sums[shortest].iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
                let (shortest, weight, moment) = (shortest as u32, narrow(weight), narrow(moment));
                fan.beside.push(Beside { taxel, shortest, weight, moment });
                self.along.push([along, squared]);
            }
        }
        fan.directions.push(fan.beside.len());
        let mut beside = [0.0; 3];
        for ((&length, &unit), sums) in lengths.iter().zip(&fan.units).zip(&sums) {
            beside.iter_mut().zip(sums).for_each(|(sum, more)| *sum += more);
            // Not 0, so that an atom without taxels has no height.
            let mut products = [beside[0] + 1e-12, beside[1] * unit, beside[2] * unit * unit + 1e-12];
            for (Beside { taxel, weight, .. }, &[along, squared]) in
                fan.beside[first..].iter().zip(&self.along)
            {
                let beyond = along.abs() - 0.5 * length;
                if beyond > 0.0 && squared + beyond * beyond < limit {
                    let height = f64::from(*weight) * (scale * beyond * beyond).exp();
                    let slope = height * (along * unit).clamp(-1.0, 1.0);
                    products[0] += height * height;
                    products[1] += height * slope;
                    products[2] += slope * slope;
                    fan.ends.push(Entry { taxel: *taxel, height: narrow(height), slope: narrow(slope) });
                }
            }
            let [hh, hs, ss] = products;
            let tilt = if length > 0.0 { (-hs / ss).clamp(-TILT, TILT) } else { 0.0 };
            let bound = narrow((1.0 + ROUNDING) / (hh + tilt * (2.0 * hs + tilt * ss)));
            fan.atoms.push(Atom { end: fan.ends.len() as u32, bound });
            fan.products.push(products);
        }
    }
}
