//! Growth of a skin in space: from one module across its free edges, without a map.
//!
//! A new module lies at first on the cylinder of its neighbour, turned by half a turn about the middle of the edge, as in
//! a lattice of triangles, quadrilaterals or hexagons; then it is fitted to the surface with that edge held.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use crate::design::fit::{Anchors, Fitted, Shape};
use crate::design::surface::Foot;
use crate::design::{Module, Plate};
use crate::run::{Cancelled, Run};

/// Most modules of a patch.
pub(super) const MOST_MODULES: usize = 100_000;

/// Distance of the edges of neighbours, in m: room for a cut.
pub(super) const GAP: f64 = 5e-4;

/// Modules may overlap by this much at an edge, in m: less than a thousandth of their area.
const MAX_OVERLAP: f64 = 1e-4;

/// Where a module that overlaps others or is too far from the surface is tried next: how much farther from the edge, and
/// how far along it, in units of [`GAP`]. *Heuristic*: both ends of the edge stay within reach of a wire; not varied.
const TRIED: [[f64; 2]; 8] =
    [[0.0, 0.0], [0.8, 0.0], [0.0, 1.0], [0.0, -1.0], [1.6, 0.0], [1.2, 1.2], [1.2, -1.2], [2.4, 0.0]];

/// Modules that overlap by more than this cannot be shifted apart by the tried places, in m.
const MAX_SHIFT: f64 = 5.0 * GAP;

/// How strongly the edge is held, and the other points at where they began, relative to the distance from the surface.
const EDGE_WEIGHT: f64 = 0.3;
const OTHER_WEIGHT: f64 = 0.003;

/// A module in its place.
#[derive(Debug, Clone)]
pub(super) struct Accepted {
    pub(super) plate: Plate,
    /// Largest distance from the surface, in m.
    pub(super) gap: f64,
    /// Its corners, and points along its outline.
    pub(super) corners: Vec<DVec3>,
    outline: Vec<DVec3>,
    pub(super) centre: DVec3,
    pub(super) normal: DVec3,
}

/// Modules that do not overlap, and the cells of space where their centres are.
#[derive(Clone)]
pub(super) struct Layout<'a> {
    pub(super) module: &'a Module,
    shape: &'a Shape<'a>,
    pub(super) all: Vec<Accepted>,
    cells: BTreeMap<[i64; 3], Vec<usize>>,
    /// A side of a cell, in m: centres farther apart cannot overlap.
    reach: f64,
    /// Two centres that are nearer are of one place, in m.
    same: f64,
}

impl<'a> Layout<'a> {
    pub(super) fn new(module: &'a Module, shape: &'a Shape<'a>) -> Self {
        // Centres of neighbours are twice the depth of the centre apart.
        let same = 1.4 * module.depth(module.centre());
        Self {
            module,
            shape,
            all: Vec::new(),
            cells: BTreeMap::new(),
            reach: 1.05 * module.diameter() * 1.2,
            same,
        }
    }

    /// Adds a plate if it is clear of all others; returns its number.
    pub(super) fn add(&mut self, fitted: &Fitted) -> Option<usize> {
        let new = self.placed(fitted.plate, fitted.gap);
        let (centre, normal) = (new.centre, new.normal);
        let is_clear = self.near(centre).all(|k| {
            let other = &self.all[k];
            // The other side of a wall.
            other.normal.dot(normal) < -0.2
                || (other.centre.distance(centre) > self.same && separation(&new, other) > -MAX_OVERLAP)
        });
        is_clear.then(|| {
            self.cells.entry(self.cell(centre)).or_default().push(self.all.len());
            self.all.push(new);
            self.all.len() - 1
        })
    }

    fn placed(&self, plate: Plate, gap: f64) -> Accepted {
        let (rim, firsts) = self.module.rim();
        let outline: Vec<DVec3> = rim.iter().map(|&at| plate.point(at)).collect();
        let corners = firsts.iter().map(|&k| outline[k]).collect();
        let middle = self.module.centre();
        Accepted { plate, gap, corners, outline, centre: plate.point(middle), normal: plate.normal(middle) }
    }

    /// Whether a fit from this place cannot end well: the place is beyond a rim, or deep in another module.
    fn is_hopeless(&self, start: Plate) -> bool {
        let new = self.placed(start, 0.0);
        let beyond = |foot: Foot| foot.is_on_rim && foot.point.distance(new.centre) > 0.3 * self.same;
        self.shape.surface.nearest(new.centre, new.normal, &mut None).is_none_or(beyond)
            || self.near(new.centre).any(|k| {
                let other = &self.all[k];
                other.normal.dot(new.normal) > -0.2 && separation(&new, other) < -MAX_SHIFT
            })
    }

    /// Whether a module is at this place.
    pub(super) fn is_taken(&self, centre: DVec3, distance: f64) -> bool {
        self.near(centre).any(|k| self.all[k].centre.distance(centre) < distance)
    }

    #[expect(clippy::cast_possible_truncation, reason = "a float as large as 2^63 cells saturates")]
    fn cell(&self, at: DVec3) -> [i64; 3] {
        (at / self.reach).floor().to_array().map(|x| x as i64)
    }

    /// The modules in the cells around a place, in the order of the cells.
    pub(super) fn near(&self, at: DVec3) -> impl Iterator<Item = usize> {
        let [x, y, z] = self.cell(at);
        let around = (-1..=1).flat_map(move |i| (-1..=1).map(move |j| [x + i, y + j, z]));
        around
            .flat_map(|[x, y, z]| self.cells.range([x, y, z - 1]..=[x, y, z + 1]))
            .flat_map(|(_, members)| members.iter().copied())
    }

    /// Grows from the modules from `first` on across their free edges.
    pub(super) fn grow(&mut self, first: usize, run: Run<'_>) -> Result<(), Cancelled> {
        let (rim, firsts) = self.module.rim();
        let mut queue: Vec<usize> = (first..self.all.len()).collect();
        while !queue.is_empty() && self.all.len() < MOST_MODULES {
            run.check()?;
            let mut open: Vec<(usize, usize)> =
                queue.iter().flat_map(|&k| (0..firsts.len()).map(move |edge| (k, edge))).collect();
            queue.clear();
            for tried in TRIED {
                let mut again = Vec::new();
                for (k, edge) in open {
                    let [from, to] = self.module.edge(edge);
                    let along = (to - from).normalize();
                    let shift =
                        DVec2::new(along.y, -along.x) * (GAP * (1.0 + tried[0])) + along * (GAP * tried[1]);
                    let origin = from + to + shift;
                    let start = self.all[k].plate.moved(origin, PI);
                    if self.is_taken(start.point(self.module.centre()), self.same) || self.is_hopeless(start)
                    {
                        continue;
                    }
                    let end = firsts.get(edge + 1).copied().unwrap_or(rim.len());
                    let strong: Vec<(usize, DVec3, f64)> = (firsts[edge]..end)
                        .chain([firsts[(edge + 1) % firsts.len()]])
                        .map(|k| (k, start.point(rim[k]), EDGE_WEIGHT))
                        .collect();
                    let anchors = Anchors { strong: &strong, weak: OTHER_WEIGHT };
                    let Some(fitted) = self.shape.fit(start, &anchors) else { continue };
                    let added = if self.shape.accepts(&fitted) { self.add(&fitted) } else { None };
                    match added {
                        Some(new) => queue.push(new),
                        None if fitted.gap < 1.5 * self.shape.tolerance => again.push((k, edge)),
                        None => {}
                    }
                }
                open = again;
            }
        }
        Ok(())
    }

    /// The layout of some of its modules, in this order.
    pub(super) fn of(&self, kept: &[usize]) -> Self {
        let mut layout = Self { all: Vec::new(), cells: BTreeMap::new(), ..self.clone() };
        for &k in kept {
            let member = self.all[k].clone();
            layout.cells.entry(layout.cell(member.centre)).or_default().push(layout.all.len());
            layout.all.push(member);
        }
        layout
    }
}

/// Signed distance of two outlines in the plane of the mean of their normals, in m: below 0 they overlap by that depth.
fn separation(a: &Accepted, b: &Accepted) -> f64 {
    let (x, y) = (a.normal + b.normal).normalize_or(a.normal).any_orthonormal_pair();
    let flat = |m: &Accepted| -> Vec<DVec2> {
        m.outline.iter().map(|p| *p - a.centre).map(|p| DVec2::new(p.dot(x), p.dot(y))).collect()
    };
    outline_separation(&flat(a), &flat(b))
}

/// Signed distance of two convex outlines, over the lines along their edges.
pub(super) fn outline_separation(p: &[DVec2], q: &[DVec2]) -> f64 {
    let beyond = |of: &[DVec2], other: &[DVec2]| {
        let middle = of.iter().sum::<DVec2>() / of.len() as f64;
        let side = |k: usize| {
            let (from, to) = (of[k], of[(k + 1) % of.len()]);
            let out = (to - from).perp().normalize_or_zero();
            let out = if (middle - from).dot(out) > 0.0 { -out } else { out };
            other.iter().map(|r| (*r - from).dot(out)).fold(f64::INFINITY, f64::min)
        };
        (0..of.len()).map(side).fold(f64::NEG_INFINITY, f64::max)
    };
    beyond(p, q).max(beyond(q, p))
}
