//! A start without flips for every disk with holes: the outer loop on a circle (`(tutte1963)`,
//! `(floater2003)`), solved again with springs divided by the stretch of their ends
//! (`(yoshizawa2004)`).
//!
//! In exact arithmetic no face flips and no vertex has more than one turn of faces, whatever the
//! positive springs. In 64 bits faces of a long thin tube may end without area. Departure from the
//! paper: each spring is divided by the stretch at both of its ends, which keeps the system
//! symmetric and is the same system with scaled rows.

use std::f64::consts::TAU;

use glam::DVec2;

use crate::flatten::FlattenError;
use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::Uv;
use crate::flatten::energy::objective::dirichlet;
use crate::flatten::start::conformal::circle;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::loop_length;
use crate::sparse::{Cholesky, Matrix, Pattern, SparseError};

/// Most solves. The least energy is found after 2 to 6 of them and is a tenth to a ten-thousandth of that of
/// the first (measured on tubes and balls with holes).
const MAX_SOLVES: usize = 8;

/// Ends after this many solves with more energy than the least so far.
const MAX_WORSE: usize = 2;

/// A map of more energy than this is crushed: parts of it are far too small, and a descent may leave them so. Of 4000
/// random mazes of strips (up to 2300 faces), springs by edges gave less energy for all 353 maps above it, most often a
/// tenth to a millionth, and for three in ten below it, most often the same to 2 %. Of 53 of those above it, on rough
/// ground and not cut, 7 ended at 4.0 to 84 instead of 9e4 and more or without a map, 2 at 329 and 2449 instead of 4.02.
const CRUSHED: f64 = 1e4;

/// Most solves with springs by edges, if equal springs crush the map or leave faces without area. For two thin plates
/// of CAD, where a thousand faces have none at first, the third solve is the first in which all faces have area and
/// the fifth the best.
const MAX_EDGE_SOLVES: usize = 16;

/// Exponent of the stretch by which the spring of an edge gets stiffer.
const EDGE_DAMPING: f64 = 0.5;

/// Least length of a spring, in units: some vertices coincide.
const LEAST_LENGTH: f64 = 1e-9;

/// Least stretch of an edge, also of one that is crushed below all numbers.
const LEAST_STRETCH: f64 = 1e-12;

/// Every vertex off the circle is at the weighted mean of its neighbours; holes are closed by a virtual
/// vertex at the centre of each. Equal springs first, then those that are too long on the map get stiffer;
/// the map of least energy is returned, at its best scale.
///
/// If that map is crushed, or equal springs leave faces without area, in long tubes, springs are also one over their
/// lengths, and then stiffer by the stretch of each edge alone (*heuristic*: the exponent): lengths can be measured
/// where areas are lost.
///
/// # Errors
/// [`FlattenError::NoStart`] when faces are too small for 64-bit numbers in every solve.
pub(crate) fn tutte(domain: &FlattenDomain<'_>) -> Result<Uv, FlattenError> {
    let net = Net::new(domain);
    let failed = |source| FlattenError::System { method: "convex", source };
    let cholesky = Cholesky::new(&net.pattern, &net.coordinates).map_err(failed)?;
    let mut best = BestMap { domain, map: None, worse: 0, collapsed: FaceId::default() };
    // Springs from the stretches of a nearly crushed map may be beyond 64 bits: the map before them stays.
    let solve = |weights: &[f64], best: &BestMap<'_>| match net.solve(&cholesky, weights) {
        Err(source) if best.map.is_none() => Err(failed(source)),
        solved => Ok(solved.ok()),
    };
    let mut weights = vec![1.0; net.springs.len()];
    for _ in 0..MAX_SOLVES {
        let Some(uv) = solve(&weights, &best)? else { break };
        if !best.takes(net.of_mesh(&uv)) || best.worse == MAX_WORSE {
            break;
        }
        soften(&mut weights, &net.springs, &stretches(domain, &uv));
    }
    if best.is_crushed() {
        best.worse = 0;
        weights = net.lengths.iter().map(|length| length.recip()).collect();
        for _ in 0..MAX_EDGE_SOLVES {
            let Some(uv) = solve(&weights, &best)? else { break };
            best.takes(net.of_mesh(&uv));
            if best.worse == MAX_WORSE {
                break;
            }
            net.stiffen(&mut weights, &uv);
        }
    }
    best.map.map(|(_, uv)| uv).ok_or(FlattenError::NoStart { face: best.collapsed })
}

/// The map of least energy so far.
struct BestMap<'d> {
    domain: &'d FlattenDomain<'d>,
    /// Its energy, and the map at its best scale.
    map: Option<(f64, Uv)>,
    /// Maps since the first one that were worse.
    worse: usize,
    /// A face without area on the last map that had one.
    collapsed: FaceId,
}

impl BestMap<'_> {
    /// Whether there is no map, or a crushed one.
    fn is_crushed(&self) -> bool {
        self.map.as_ref().is_none_or(|(energy, _)| *energy > CRUSHED)
    }

    /// Keeps the map if it is better; returns whether all of its faces have areas.
    fn takes(&mut self, uv: Uv) -> bool {
        let elements = &self.domain.elements;
        if let Some(face) = elements.first_flip(&uv) {
            self.collapsed = face;
            self.worse += usize::from(self.map.is_some());
            return false;
        }
        let sums = dirichlet(elements, &uv);
        let (energy, scale) = (sums.energy(), sums.scale());
        if self.map.as_ref().is_none_or(|(least, _)| energy < *least) {
            let scale = if self.domain.prescribed.is_empty() { scale } else { 1.0 };
            self.map = Some((energy, uv.map(|&p| p * scale)));
        } else {
            self.worse += 1;
        }
        true
    }
}

/// The map of equal springs, which has flips where the boundary is not convex.
pub(crate) fn equal_springs(domain: &FlattenDomain<'_>) -> Result<Uv, SparseError> {
    let net = Net::new(domain);
    let cholesky = Cholesky::new(&net.pattern, &net.coordinates)?;
    net.solve(&cholesky, &vec![1.0; net.springs.len()]).map(|uv| net.of_mesh(&uv))
}

/// How much the skin around each vertex has shrunk on the map, virtual vertices behind the real
/// ones: the root of the mean of `1/s1^2 + 1/s2^2` over its faces.
fn stretches(domain: &FlattenDomain<'_>, uv: &Uv) -> Vec<f64> {
    let mut sums = IdVec::<VertexId, [f64; 2]>::filled([0.0; 2], domain.vertices());
    for e in &domain.elements.faces {
        let s = e.singular_values(uv);
        let inverse = (s.s1 * s.s1).recip() + (s.s2 * s.s2).recip();
        for v in e.corners {
            sums[v][0] += e.weight * inverse;
            sums[v][1] += e.weight;
        }
    }
    let mut stretch: Vec<f64> =
        sums.iter().map(|[sum, weight]| if *weight > 0.0 { (sum / weight).sqrt() } else { 1.0 }).collect();
    for hole in &domain.disk.loops[1..] {
        let logs: f64 = hole.iter().map(|v| stretch[v.index()].ln()).sum();
        stretch.push((logs / hole.len() as f64).exp());
    }
    stretch
}

/// Divides every spring by the stretch at its ends, and all by their geometric mean.
fn soften(weights: &mut [f64], springs: &[[usize; 2]], stretch: &[f64]) {
    for (w, &[i, j]) in weights.iter_mut().zip(springs) {
        *w /= stretch[i] * stretch[j];
    }
    normalise(weights);
}

/// Divides all by their geometric mean.
fn normalise(weights: &mut [f64]) {
    let logs: f64 = weights.iter().map(|w| w.ln()).sum();
    let mean = (logs / weights.len().max(1) as f64).exp();
    weights.iter_mut().for_each(|w| *w /= mean);
}

/// Springs along the edges and to the centres of the holes, with the outer loop on a circle.
struct Net {
    /// Ends of the springs; virtual vertices behind the real ones.
    springs: Vec<[usize; 2]>,
    /// Their lengths on the skin; to the centre of a hole, as if it were a circle.
    lengths: Vec<f64>,
    vertices: usize,
    /// Positions of the outer loop's vertices.
    fixed: Vec<Option<DVec2>>,
    /// Row of each free vertex.
    row_of: Vec<usize>,
    pattern: Pattern,
    /// One per row: a virtual vertex is put near its hole.
    coordinates: Vec<glam::DVec3>,
}

impl Net {
    fn new(domain: &FlattenDomain<'_>) -> Self {
        let vertices = domain.vertices();
        let all = vertices + domain.disk.loops.len() - 1;
        let mesh_pattern = domain.elements.pattern();
        let below = |i: usize| mesh_pattern.columns(i).iter().map(|&j| j as usize).filter(move |&j| j < i);
        let mut springs: Vec<[usize; 2]> =
            (0..vertices).flat_map(|i| below(i).map(move |j| [i, j])).collect();
        let at = |i: usize| domain.position(VertexId::new(i));
        let mut lengths: Vec<f64> = springs.iter().map(|&[i, j]| at(i).distance(at(j))).collect();
        for (hole, walk) in domain.disk.loops[1..].iter().enumerate() {
            let radius = loop_length(domain.mesh, walk) / domain.unit / TAU;
            springs.extend(walk.iter().map(|v| [vertices + hole, v.index()]));
            lengths.resize(springs.len(), radius);
        }
        lengths.iter_mut().for_each(|length| *length = length.max(LEAST_LENGTH));
        let mut fixed = domain.prescribed.clone();
        fixed.resize(all, None);
        let free_loop = if domain.prescribed.is_empty() { &domain.disk.loops[0][..] } else { &[] };
        for (&v, at) in free_loop.iter().zip(circle(domain)) {
            fixed[v.index()] = Some(at);
        }
        let mut row_of = vec![usize::MAX; all];
        let mut coordinates = Vec::new();
        for i in (0..all).filter(|&i| fixed[i].is_none()) {
            row_of[i] = coordinates.len();
            let near = if i < vertices { VertexId::new(i) } else { domain.disk.loops[1 + i - vertices][0] };
            coordinates.push(domain.mesh.positions[near]);
        }
        let free = springs.iter().map(|&[i, j]| (row_of[i], row_of[j]));
        let pattern =
            Pattern::new(coordinates.len(), free.filter(|&(i, j)| i != usize::MAX && j != usize::MAX));
        Self { springs, lengths, vertices, fixed, row_of, pattern, coordinates }
    }

    /// Makes springs stiffer where they are stretched and softer where they are crushed, for the map
    /// `uv` of all vertices.
    fn stiffen(&self, weights: &mut [f64], uv: &Uv) {
        let place = |i: usize| uv[VertexId::new(i)];
        for ((w, &[i, j]), length) in weights.iter_mut().zip(&self.springs).zip(&self.lengths) {
            *w *= (place(i).distance(place(j)) / length).max(LEAST_STRETCH).powf(EDGE_DAMPING);
        }
        normalise(weights);
    }

    /// The positions of the mesh's vertices among those of all.
    fn of_mesh(&self, uv: &Uv) -> Uv {
        uv.iter().take(self.vertices).copied().collect()
    }

    /// Positions of all vertices, the virtual ones after the real ones.
    fn solve(&self, cholesky: &Cholesky, weights: &[f64]) -> Result<Uv, SparseError> {
        let rows = self.coordinates.len();
        let mut matrix = Matrix::<f64>::zero(&self.pattern);
        let mut rhs = [vec![0.0; rows], vec![0.0; rows]];
        for (&[i, j], &w) in self.springs.iter().zip(weights) {
            for (i, j) in [(i, j), (j, i)] {
                let row = self.row_of[i];
                if row == usize::MAX {
                    continue;
                }
                *matrix.at(row, row) += w;
                match self.fixed[j] {
                    Some(at) => {
                        rhs[0][row] += w * at.x;
                        rhs[1][row] += w * at.y;
                    }
                    None => *matrix.at(row, self.row_of[j]) -= w,
                }
            }
        }
        if rows > 0 {
            let factor = cholesky.factor(&matrix)?;
            factor.solve(&mut rhs[0])?;
            factor.solve(&mut rhs[1])?;
        }
        let at = |i: usize| DVec2::new(rhs[0][self.row_of[i]], rhs[1][self.row_of[i]]);
        Ok((0..self.fixed.len()).map(|i| self.fixed[i].unwrap_or_else(|| at(i))).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TriMesh, shapes};

    fn energy(mesh: &TriMesh) -> [f64; 2] {
        let domain = FlattenDomain::new(mesh).unwrap();
        let uv = tutte(&domain).unwrap();
        assert!(domain.elements.is_flip_free(&uv), "{} faces", mesh.triangles.len());
        let net = Net::new(&domain);
        let cholesky = Cholesky::new(&net.pattern, &net.coordinates).unwrap();
        let first = net.solve(&cholesky, &vec![1.0; net.springs.len()]).unwrap();
        [first, uv].map(|uv| dirichlet(&domain.elements, &uv).energy())
    }

    #[test]
    fn nothing_flips_inside_a_circle() {
        for mesh in [shapes::triangle(), shapes::square(), shapes::cap(900, 0.1, 2.5), shapes::saddle(20)] {
            let [first, last] = energy(&mesh);
            assert!(last <= first * (1.0 + 1e-12), "{last} is not above {first}");
        }
    }

    /// A tube four radii long: equal springs crush its far end.
    #[test]
    fn solving_again_lets_the_far_end_of_a_tube_grow() {
        let [first, last] = energy(&shapes::tube(16, 16, 0.05, 0.4));
        assert!(last < 0.25 * first, "{last} is far below {first}");
    }

    /// Two loops that are near each other everywhere.
    #[test]
    fn springs_by_edges_are_better_in_a_maze_that_equal_springs_crush() {
        let maze = [
            "#######.###.",
            "#.....#.#...",
            "#####.#####.",
            "#...#.....#.",
            "###.#.###.#.",
            "#.#...#.#.#.",
            "#.#####.###.",
            "#...#...#...",
            "#.###.#.###.",
            "....#.#.#.#.",
            "#######.#.#.",
        ];
        let is_solid = |[x, y, z]: [i32; 3]| {
            let at = usize::try_from(x).ok().zip(usize::try_from(y).ok());
            let is_strip = |(x, y): (usize, usize)| maze.get(y).is_some_and(|row| row[x..].starts_with('#'));
            z == 0 && x < 12 && at.is_some_and(is_strip)
        };
        let mesh = shapes::blocks([12, 11, 1], 0.01, is_solid, |[_, _, z]| z < 1);
        let domain = FlattenDomain::new(&mesh).unwrap();
        assert_eq!(domain.disk.loops.len(), 2);
        let uv = tutte(&domain).unwrap();
        assert!(domain.elements.is_flip_free(&uv));
        // Equal springs, solved again, end at 1.0e5.
        let energy = dirichlet(&domain.elements, &uv).energy();
        assert!(energy < 500.0, "{energy}");
    }

    /// Forty radii long: equal springs shrink its far end to no area in 64-bit numbers.
    #[test]
    fn springs_by_edges_keep_what_equal_springs_crush() {
        let mesh = shapes::tube(5, 70, 0.01, 1.0);
        let domain = FlattenDomain::new(&mesh).unwrap();
        assert!(!domain.elements.is_flip_free(&equal_springs(&domain).unwrap()));
        assert!(domain.elements.is_flip_free(&tutte(&domain).unwrap()));
    }
}
