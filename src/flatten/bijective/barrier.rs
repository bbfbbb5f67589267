//! A barrier that keeps the boundary of a map from crossing itself (`(smith2015)`), and Newton
//! with it: a map that does not overlap stays so.
//!
//! Every pair of a boundary vertex and a boundary edge closer than a reach pays `w (r/d - 1)^2`; a
//! boundary that crosses itself, or a hole inside out, costs infinitely much, so that the line
//! search refuses it. It never ends an overlap that is already there.

use glam::{DMat2, DVec2};

use crate::{
    flatten::{
        Energy,
        bijective::crossings::{Segment, each_near_pair, meet},
        bijective::overlap::counter_clockwise_loops,
        domain::elements::{BoundaryEdge, ElementMesh, Uv},
        energy::{
            face_energy::outer,
            newton::{NewtonLimits, Solver},
            objective::{BoundaryTerm, Objective},
        },
    },
    id::{IdVec, VertexId},
    sparse::{Matrix, SparseError},
};

/// Parts of the boundary repel each other below this distance over the shortest edge there, on the
/// skin. At a quarter of it, edges on both sides of a corner leave each other alone down to angles
/// of 15 degrees.
const REACH: f64 = 0.25;

/// Weight of the repulsion, per mean edge length and length of boundary: the force on a length of
/// boundary then has the size of the stress of a face that is stretched by its own size, however
/// fine the mesh.
const STIFFNESS: f64 = 1.0;

/// Couplings of a vertex and an edge, at most, over the number of boundary edges. More are only met
/// where a hole starts out tiny, and all of its edges repel each other.
const MOST_COUPLINGS: usize = 8;

/// Newton steps between updates of the active set of close vertex-edge pairs; the set is stable for
/// about this many steps.
const ROUND: usize = 6;

/// Vertices are coupled in the Hessian up to this multiple of the distance at which they repel each
/// other, for those that come closer within a round.
const AHEAD: f64 = 2.0;

/// Relative decrease of the energy in a round at which the minimisation ends. With a changing
/// active set Newton does not converge quadratically; a smaller decrease is not visible.
const ENOUGH: f64 = 1e-7;

/// A map without flips whose boundary does not cross itself is one to one if just one loop runs
/// counter-clockwise, so it is enough to look at each map by itself; nothing follows the boundary
/// on its way from one to the next.
#[derive(Debug, Clone)]
pub(crate) struct Barrier {
    repellers: Vec<Repeller>,
    /// The boundary edges, loop by loop.
    edges: Vec<[VertexId; 2]>,
}

/// A boundary edge, which repels vertices, and its first vertex, which repels edges.
#[derive(Debug, Clone, Copy)]
struct Repeller {
    ends: [VertexId; 2],
    edge_reach: f64,
    /// No more than the reach of the edges on both sides.
    vertex_reach: f64,
    vertex_weight: f64,
}

/// A vertex within reach of an edge that does not end at it.
#[derive(Debug, Clone, Copy)]
struct ProximityPair {
    vertex: VertexId,
    edge: [VertexId; 2],
    /// Where the nearest point lies on the edge, from 0 to 1.
    along: f64,
    /// From there to the vertex: length 1.
    normal: DVec2,
    /// Reach over distance.
    ratio: f64,
    reach: f64,
    weight: f64,
}

impl ProximityPair {
    fn energy(&self) -> f64 {
        self.weight * (self.ratio - 1.0).powi(2)
    }

    /// First and second derivative of the energy by the distance `d`, with `q = r/d`, which changes
    /// by `-q^2/r`: `2 w (q - 1) (-q^2/r)`, and `-2 w/r (3 q^2 - 2 q) (-q^2/r)`.
    fn derivatives(&self) -> (f64, f64) {
        let (q, r) = (self.ratio, self.reach);
        let first = -2.0 * self.weight * (q - 1.0) * q * q / r;
        (first, self.weight * q * q * q * (6.0 * q - 4.0) / (r * r))
    }

    /// Derivatives of the distance by the three positions are these, times the normal.
    fn shares(&self) -> [f64; 3] {
        [1.0, self.along - 1.0, -self.along]
    }

    fn rows(&self) -> [usize; 3] {
        [self.vertex, self.edge[0], self.edge[1]].map(VertexId::index)
    }
}

impl Barrier {
    pub(crate) fn new(elements: &ElementMesh) -> Self {
        let mut before = IdVec::<VertexId, f64>::filled(f64::INFINITY, elements.free());
        for &BoundaryEdge { ends: [_, to], length } in &elements.boundary {
            before[to] = before[to].min(length);
        }
        let repeller = |&BoundaryEdge { ends, length }: &BoundaryEdge| Repeller {
            ends,
            edge_reach: REACH * length,
            vertex_reach: REACH * length.min(before[ends[0]]),
            vertex_weight: STIFFNESS * elements.mean_edge * length,
        };
        Self {
            repellers: elements.boundary.iter().map(repeller).collect(),
            edges: elements.boundary.iter().map(|b| b.ends).collect(),
        }
    }

    /// Calls `f` with everything within `factor` times its reach, and says whether the boundary
    /// does not cross itself and has no hole inside out.
    fn each_proximity(&self, uv: &Uv, factor: f64, f: &mut dyn FnMut(ProximityPair)) -> bool {
        let mut segments: Vec<Segment> = self
            .repellers
            .iter()
            .enumerate()
            .map(|(k, p)| Segment::new(k, p.ends, uv, 0.5 * factor * p.edge_reach))
            .collect();
        let mut simple = counter_clockwise_loops(&self.edges, uv) == 1;
        each_near_pair(&mut segments, &mut |s, t| {
            simple &= !meet(s, t);
            for (s, t) in [(s, t), (t, s)] {
                if let Some(contact) = self.contact(s, t, factor) {
                    f(contact);
                }
            }
        });
        simple
    }

    /// The first vertex of `s` near `t`.
    fn contact(&self, s: &Segment, t: &Segment, factor: f64) -> Option<ProximityPair> {
        let (own, other) = (self.repellers[s.edge], self.repellers[t.edge]);
        let reach = own.vertex_reach.min(other.edge_reach);
        let (way, to) = (t.to - t.from, s.from - t.from);
        let along = (to.dot(way) / way.length_squared()).clamp(0.0, 1.0);
        let off = to - along * way;
        let distance = off.length();
        (distance > 0.0 && distance < factor * reach).then(|| ProximityPair {
            vertex: own.ends[0],
            edge: other.ends,
            along,
            normal: off / distance,
            ratio: reach / distance,
            reach,
            weight: own.vertex_weight,
        })
    }

    /// Vertices that repel each other, or would at `factor` times their reach; none if they are too
    /// many.
    pub(crate) fn couplings(&self, uv: &Uv, factor: f64) -> Vec<[VertexId; 2]> {
        let most = MOST_COUPLINGS * self.repellers.len();
        let (mut pairs, mut count) = (Vec::new(), 0);
        self.each_proximity(uv, factor, &mut |c| {
            count += 1;
            if count <= most {
                pairs.extend(c.edge.map(|end| [c.vertex, end]));
            }
        });
        if count <= most { pairs } else { Vec::new() }
    }
}

impl BoundaryTerm for Barrier {
    /// The energy; infinite if the boundary crosses itself or a hole is turned inside out.
    fn energy(&self, uv: &Uv) -> f64 {
        let mut sum = 0.0;
        if self.each_proximity(uv, 1.0, &mut |c| sum += c.energy()) { sum } else { f64::INFINITY }
    }

    /// Adds gradient and a convex model of the Hessian (Gauss-Newton: distances are taken as
    /// linear).
    ///
    /// Where the pattern has no room for a vertex and an edge to be coupled, each of them is held
    /// by twice the curvature instead, which is never less: `(x - y)^2 <= 2 x^2 + 2 y^2`.
    fn add(&self, uv: &Uv, gradient: &mut [DVec2], hessian: &mut Matrix<'_, DMat2>) {
        let pattern = hessian.pattern();
        self.each_proximity(uv, 1.0, &mut |c| {
            let (slope, curvature) = c.derivatives();
            let (rows, shares) = (c.rows(), c.shares());
            let coupled = rows[1..].iter().all(|&end| pattern.slot(rows[0], end).is_some());
            let scale = if coupled { curvature } else { 2.0 * curvature };
            let block = outer(c.normal, c.normal) * scale;
            for k in 0..3 {
                gradient[rows[k]] += slope * shares[k] * c.normal;
                for l in 0..3 {
                    if coupled || (k == 0) == (l == 0) {
                        *hessian.at(rows[k], rows[l]) += block * (shares[k] * shares[l]);
                    }
                }
            }
        });
    }
}

/// Minimises the energy as [`Objective::minimise`] does, with a boundary that never crosses itself.
///
/// The map to start from must have no flips and a boundary that does not cross itself. The
/// resulting map has neither, even where `limits` end before the optimum.
pub(crate) fn minimise_bijective(
    elements: &ElementMesh,
    energy: Energy,
    uv: &mut Uv,
    solver: Solver,
    limits: NewtonLimits,
) -> Result<(), SparseError> {
    let barrier = Barrier::new(elements);
    let mut last = f64::INFINITY;
    for _ in 0..limits.steps.div_ceil(ROUND) {
        let coupled = elements.coupled(&barrier.couplings(uv, AHEAD));
        let objective = Objective::new(&coupled, energy).with_boundary_term(&barrier);
        objective.minimise(uv, solver, NewtonLimits { steps: ROUND, ..limits })?;
        let reached = objective.energy(uv);
        if !reached.is_finite() || last - reached <= ENOUGH.max(limits.decrement) * reached {
            break;
        }
        last = reached;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{flatten::domain::flatten_domain::FlattenDomain, mesh::shapes};

    /// A strip bent until its ends nearly meet, and a barrier around it.
    fn nearly_closed(gap: f64) -> (ElementMesh, Uv) {
        let mesh = shapes::sheet(24, 3, |i, j| glam::DVec3::new(f64::from(i), f64::from(j), 0.0));
        let uv = mesh
            .positions
            .map(|p| DVec2::from_angle((std::f64::consts::TAU - gap) * p.x / 23.0) * (5.0 - p.y) / 8.0);
        (FlattenDomain::new(&mesh).unwrap().elements, uv)
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_energy() {
        let (net, mut uv) = nearly_closed(0.04);
        let barrier = Barrier::new(&net);
        let pairs = barrier.couplings(&uv, 1.0);
        assert!(!pairs.is_empty(), "the ends are within reach");
        let coupled = net.coupled(&pairs);
        let mut hessian = Matrix::zero(&coupled.pattern);
        let mut gradient = vec![DVec2::ZERO; net.free()];
        barrier.add(&uv, &mut gradient, &mut hessian);
        let scale = gradient.iter().map(|g| g.length()).fold(0.0, f64::max);
        assert!(scale > 0.0);
        let step = 1e-7;
        for v in uv.ids() {
            for axis in [DVec2::X, DVec2::Y] {
                let at = uv[v];
                uv[v] = at + step * axis;
                let above = barrier.energy(&uv);
                uv[v] = at - step * axis;
                let below = barrier.energy(&uv);
                uv[v] = at;
                let slope = (above - below) / (2.0 * step);
                let found = gradient[v.index()].dot(axis);
                assert!((slope - found).abs() < 1e-5 * scale, "{found} is {slope} at {v}");
            }
        }
    }

    /// Without room for couplings the model must be at least as stiff in every direction.
    #[test]
    fn a_pattern_without_couplings_gets_a_stiffer_model() {
        let (net, uv) = nearly_closed(0.04);
        let barrier = Barrier::new(&net);
        let coupled = net.coupled(&barrier.couplings(&uv, 1.0));
        let curvature = |net: &ElementMesh, x: &[DVec2]| -> f64 {
            let mut hessian = Matrix::zero(&net.pattern);
            barrier.add(&uv, &mut vec![DVec2::ZERO; net.free()], &mut hessian);
            let mut out = vec![DVec2::ZERO; net.free()];
            hessian.multiply(x, &mut out);
            crate::sparse::dot(x, &out)
        };
        for k in 1..20_usize {
            let x: Vec<DVec2> = (0..net.free()).map(|i| DVec2::from_angle((i * k) as f64)).collect();
            let (with, without) = (curvature(&coupled, &x), curvature(&net, &x));
            assert!(with > 0.0 && without >= with * (1.0 - 1e-12), "{without} is not below {with}");
        }
    }

    #[test]
    fn a_boundary_far_from_itself_costs_nothing_and_a_crossing_everything() {
        let (net, apart) = nearly_closed(1.0);
        assert_eq!(Barrier::new(&net).energy(&apart), 0.0);
        let (net, over) = nearly_closed(-0.1);
        assert_eq!(Barrier::new(&net).energy(&over), f64::INFINITY);
    }
}
