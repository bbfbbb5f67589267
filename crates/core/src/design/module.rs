//! The drawing of a module: its outline, its taxels, and the edges over which it is wired.

use glam::DVec2;

use crate::delaunay::segments_meet;
use crate::design::DesignError;

/// A module as it lies flat, in m: all modules of a skin are congruent with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Module {
    /// Its corners, counter-clockwise seen from outside; convex.
    pub outline: Vec<DVec2>,
    /// Its taxels, in the order of their ids.
    pub taxels: Vec<DVec2>,
    /// Points on the edges over which wires may go to the next module; every edge where there are none.
    pub ports: Vec<DVec2>,
}

/// Distance of the taxels of rectangles, in m, about: that of iCub and CySkin.
const PITCH: f64 = 6.5e-3;

/// Least size of a module, in m: far below any taxel, far above rounding.
const LEAST: f64 = 1e-6;

/// Most corners and most taxels of a module; ids are in blocks of a power of two.
const MOST: usize = 4096;

impl Module {
    /// The equilateral triangle of iCub and CySkin, with ten taxels a fifth of its side (m) apart
    /// `(cannata)`. Its first corner is at -y.
    pub fn triangle(side: f64) -> Self {
        let h = 0.75_f64.sqrt();
        let at = |points: &[[f64; 2]], unit: f64| -> Vec<DVec2> {
            points.iter().map(|&[x, y]| DVec2::new(x, y * h) * unit).collect()
        };
        Self {
            outline: at(&[[0.0, -2.0 / 3.0], [0.5, 1.0 / 3.0], [-0.5, 1.0 / 3.0]], side),
            taxels: at(
                &[
                    [0.0, -2.0],
                    [0.5, -1.0],
                    [1.0, 0.0],
                    [1.5, 1.0],
                    [0.5, 1.0],
                    [-0.5, 1.0],
                    [-1.5, 1.0],
                    [-1.0, 0.0],
                    [-0.5, -1.0],
                    [0.0, 0.0],
                ],
                side / 5.0,
            ),
            ports: Vec::new(),
        }
    }

    /// A regular hexagon of this side, in m, with a taxel at its centre and one halfway to each corner.
    pub fn hexagon(side: f64) -> Self {
        let corner = |k: u32| DVec2::from_angle(f64::from(k) * std::f64::consts::FRAC_PI_3) * side;
        let ring = (0..6).map(|k| corner(k) * 0.5);
        let outline = (0..6).map(corner).collect();
        Self { outline, taxels: std::iter::once(DVec2::ZERO).chain(ring).collect(), ports: Vec::new() }
    }

    /// A rectangle of this width and height, in m, with taxels in rows some 6.5 mm apart.
    pub fn rectangle(width: f64, height: f64) -> Self {
        let half = DVec2::new(width, height) * 0.5;
        let corners = [DVec2::new(-1.0, -1.0), DVec2::new(1.0, -1.0), DVec2::ONE, DVec2::new(-1.0, 1.0)];
        let count = |side: f64| (side / PITCH).round().clamp(1.0, MOST as f64);
        let (columns, rows) = (count(width), count(height));
        // A module with more taxels is refused later.
        let step = DVec2::new(width / columns, height / rows);
        let mut taxels = Vec::new();
        let mut y = -half.y + 0.5 * step.y;
        while y < half.y && taxels.len() <= MOST {
            let mut x = -half.x + 0.5 * step.x;
            while x < half.x && taxels.len() <= MOST {
                taxels.push(DVec2::new(x, y));
                x += step.x;
            }
            y += step.y;
        }
        Self { outline: corners.map(|c| c * half).to_vec(), taxels, ports: Vec::new() }
    }

    /// Checks that it is a module.
    ///
    /// # Errors
    /// If the outline has less than three corners, is clockwise, crosses itself or is not convex; if there is no taxel,
    /// one lies outside or two at one place; if a port lies on no edge.
    pub fn validate(&self) -> Result<(), DesignError> {
        let fail = |found: String, needed: &'static str| Err(DesignError::Module { found, needed });
        let at = |p: DVec2| format!("({:.2}, {:.2}) mm", 1e3 * p.x, 1e3 * p.y);
        let corners = &self.outline;
        let count = corners.len();
        if !(3..=MOST).contains(&count) || self.taxels.is_empty() || self.taxels.len() > MOST {
            let found = format!("an outline of {count} corners and {} taxels", self.taxels.len());
            return fail(found, "3 to 4096 corners and 1 to 4096 taxels");
        }
        let all = corners.iter().chain(&self.taxels).chain(&self.ports);
        if let Some(p) = all.clone().find(|p| !p.is_finite() || p.length() > 10.0) {
            return fail(format!("a point at ({}, {}) m", p.x, p.y), "finite numbers, in m, below 10");
        }
        let size = self.diameter();
        if size < LEAST {
            return fail(format!("a size of {size} m"), "at least 1e-6 m");
        }
        let edge = |k: usize| corners[(k + 1) % count] - corners[k];
        if let Some(k) = (0..count).find(|&k| edge(k).length() < 1e-6 * size || edge(k) == DVec2::ZERO) {
            return fail(format!("corner {} of the outline twice, {}", k + 1, at(corners[k])), "each once");
        }
        let along = edge(0).normalize();
        if corners.iter().all(|p| along.perp_dot(*p - corners[0]).abs() < 1e-6 * size) {
            return fail("an outline whose corners lie on a line".into(), "one with an area");
        }
        for k in 0..count {
            // Edges that share a corner meet there.
            if let Some(j) = (k + 2..count)
                .filter(|j| (j + 1) % count != k)
                .find(|&j| segments_meet(self.edge(k), self.edge(j)))
            {
                let found = format!("an outline whose edges {} and {} cross", k + 1, j + 1);
                return fail(found, "one that does not cross itself");
            }
        }
        if self.area() < 0.0 {
            return fail(
                "an outline that runs clockwise".into(),
                "its corners counter-clockwise, seen from outside",
            );
        }
        let bends = |k: usize| edge(k).perp_dot(edge((k + 1) % count));
        if let Some(k) = (0..count).find(|&k| bends(k) < -1e-9 * size * size) {
            return fail(format!("an inward corner at {}", at(corners[(k + 1) % count])), "a convex outline");
        }
        if let Some((k, p)) = self.taxels.iter().enumerate().find(|(_, p)| self.depth(**p) < -1e-6 * size) {
            return fail(format!("taxel {} at {}, outside the outline", k + 1, at(*p)), "all inside");
        }
        for (k, p) in self.taxels.iter().enumerate() {
            if let Some(j) = self.taxels[..k].iter().position(|q| q.distance(*p) < 1e-6 * size) {
                return fail(
                    format!("taxels {} and {} at one place, {}", j + 1, k + 1, at(*p)),
                    "each at its own",
                );
            }
        }
        if let Some(p) = self.ports.iter().find(|p| self.depth(**p).abs() > 0.05 * size) {
            return fail(format!("a port at {}, on no edge", at(*p)), "ports in the middle of edges");
        }
        Ok(())
    }

    /// Area inside the outline, in m^2.
    pub fn area(&self) -> f64 {
        let count = self.outline.len();
        0.5 * (0..count).map(|k| self.outline[k].perp_dot(self.outline[(k + 1) % count])).sum::<f64>()
    }

    /// Largest distance of two corners, in m.
    pub fn diameter(&self) -> f64 {
        let of = |p: &DVec2| self.outline.iter().map(|q| p.distance(*q)).fold(0.0, f64::max);
        self.outline.iter().map(of).fold(0.0, f64::max)
    }

    /// The ids of taxels: those of module `m` are `m * block + 1`, `+ 2` and so on. 16 with up to 15 taxels, as CySkin's.
    pub fn block(&self) -> u32 {
        u32::try_from((self.taxels.len() + 1).next_power_of_two()).unwrap_or(u32::MAX).max(16)
    }

    /// Mean of the corners.
    #[doc(hidden)]
    pub fn centre(&self) -> DVec2 {
        self.outline.iter().sum::<DVec2>() / self.outline.len() as f64
    }

    /// The ends of edge `k`.
    pub(super) fn edge(&self, k: usize) -> [DVec2; 2] {
        [self.outline[k], self.outline[(k + 1) % self.outline.len()]]
    }

    /// Distance to the nearest line along an edge, in m; negative outside.
    pub(super) fn depth(&self, p: DVec2) -> f64 {
        let depth = |k: usize| {
            let [a, b] = self.edge(k);
            (b - a).normalize().perp_dot(p - a)
        };
        (0..self.outline.len()).map(depth).fold(f64::INFINITY, f64::min)
    }

    /// Whether wires may cross edge `k`.
    pub(super) fn has_port(&self, k: usize) -> bool {
        let on = |p: &&DVec2| {
            let [a, b] = self.edge(k);
            a.midpoint(b).distance(**p) < 0.5 * a.distance(b)
                && (b - a).normalize().perp_dot(**p - a).abs() < 0.05 * self.diameter()
        };
        self.ports.is_empty() || self.ports.iter().any(|p| on(&p))
    }

    /// Points along the outline from corner to corner, and the first of each edge. *Heuristic*: twelve in all or a few
    /// more, as four on each side of a triangle, show how a plate bends.
    #[doc(hidden)]
    pub fn rim(&self) -> (Vec<DVec2>, Vec<usize>) {
        self.along(12)
    }

    /// Points as near to each other as a robot's shell has details, which show how far a fitted plate is from it.
    pub(super) fn fine_rim(&self) -> Vec<DVec2> {
        self.along(90).0
    }

    /// At least this many points along the outline, evenly on each edge, and the first of each edge.
    fn along(&self, parts: u32) -> (Vec<DVec2>, Vec<usize>) {
        let count = self.outline.len();
        let length = |k: usize| self.edge(k)[0].distance(self.edge(k)[1]);
        let whole: f64 = (0..count).map(length).sum();
        let (mut points, mut firsts) = (Vec::new(), Vec::new());
        for k in 0..count {
            firsts.push(points.len());
            let [a, b] = self.edge(k);
            let own = (f64::from(parts) * length(k) / whole - 1e-9).ceil().max(1.0);
            points.extend((0..parts).map(f64::from).take_while(|i| *i < own).map(|i| a.lerp(b, i / own)));
        }
        (points, firsts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_of_makers_are_valid() {
        for module in [Module::triangle(0.032), Module::hexagon(0.02), Module::rectangle(0.03, 0.02)] {
            module.validate().unwrap();
        }
        assert_eq!(Module::triangle(0.032).block(), 16);
        assert_eq!(Module::rectangle(0.03, 0.02).taxels.len(), 15);
    }

    /// Corners that a drawing program adds along a straight side.
    #[test]
    fn a_side_may_have_corners_in_line() {
        let mut module = Module::rectangle(0.03, 0.02);
        let [a, b] = module.edge(0);
        module.outline.splice(1..1, [a.lerp(b, 0.25), a.lerp(b, 0.5)]);
        module.validate().unwrap();
    }

    #[test]
    fn faults_of_a_module_are_named() {
        let good = Module::rectangle(0.03, 0.02);
        let fault = |change: &dyn Fn(&mut Module)| {
            let mut module = good.clone();
            change(&mut module);
            module.validate().unwrap_err().to_string()
        };
        assert!(fault(&|m| m.outline.reverse()).contains("clockwise"));
        assert!(fault(&|m| m.outline.swap(1, 2)).contains("1 and 3 cross"));
        assert!(
            fault(&|m| m.outline.iter_mut().for_each(|p| *p = DVec2::new(p.x + p.y, 0.0)))
                .contains("on a line")
        );
        assert!(fault(&|m| m.outline.iter_mut().for_each(|p| *p *= 1e-9)).contains("at least 1e-6 m"));
        assert!(fault(&|m| m.outline.insert(1, DVec2::ZERO)).contains("inward corner"));
        assert!(fault(&|m| m.taxels[3] = DVec2::new(0.02, 0.0)).contains("taxel 4"));
        assert!(fault(&|m| m.taxels[3] = m.taxels[1]).contains("taxels 2 and 4"));
        assert!(fault(&|m| m.ports.push(DVec2::ZERO)).contains("on no edge"));
        assert!(fault(&|m| m.taxels.clear()).contains("0 taxels"));
        assert!(fault(&|m| m.outline[0].x = f64::NAN).contains("finite"));
    }
}
