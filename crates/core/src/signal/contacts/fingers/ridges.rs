//! How many straight ridges explain the readings of a region: a greedy fit of atoms, each improved in turn.
//!
//! A finger that lies on a skin leaves a ridge that is one or two taxels wide and up to a few centimetres long, not a
//! round bump. With `s` the square root of the readings, an atom is `(a + b u) exp(-d^2 / 2 w^2)`: `d` is the distance from
//! a segment of length 0 to 65 mm in the tangent plane of its centre, `u` the position along it from -1 to 1, `w` the
//! width, `a >= 0` and `|b| <= 0.7 a`. The atom that lowers the sum of squares of what is left most is added; then each
//! is taken out and the best one near it put back. The count is that of the first sum of atoms that leaves a quarter of
//! the squares of `s` or less.
//!
//! *Heuristic*: width, lengths and the quarter are from 336 recordings of 0 to 5 fingers on a cover of 642 taxels. Round
//! bumps of any width count up to 26 points fewer of these right; widths of 4 mm 2 to 6 points, shares of 0.22 to 0.28
//! the same.
//!
//! Of simulated fingers of 40 mm, laid down, with noise to 5 kPa, 47 of 48 are one ridge; 44 if gains vary by 40 % or 5 % of
//! the taxels are dead, 41 with both. Of 60 mm it is 39, 34 and 32, of palms of 40 mm 42, 36 and 41, and 35: uneven gains
//! leave valleys in them.

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::signal::contacts::fingers::fans::{Fan, FanBuilder, Places, Ridge};

/// Share of the squares that a fit leaves.
const LEFT: f64 = 0.25;

/// Most ridges of a region, and most rounds in which they are improved.
const MOST: usize = 7;
const SWEEPS: usize = 2;

/// A region with more centres is no hand; it is not split.
const MOST_CENTRES: usize = 1500;

/// The atoms of this many centres are kept from frame to frame, some 10 kB each if taxels are 7 mm apart: those of all of a
/// cover of 642 taxels.
const MOST_KEPT: usize = 2 * MOST_CENTRES;

/// More entries are kept only if one region needs them: those of taxels 1.5 mm apart are some fifty times as many.
/// Some 32 MB.
const MOST_ENTRIES: usize = 2_000_000;

/// A ridge is put back this close to where it was, in m. *Heuristic*: what is left is largest where it was. Counts of the
/// recordings are the same as with any place, for half of the time.
const NEAR: f64 = 0.03;

/// Fits ridges; owns its lists.
#[derive(Debug, Clone)]
pub(super) struct Ridges {
    /// The taxels that an atom may reach, and what is left of the readings of all.
    near: Vec<VertexId>,
    left: IdVec<VertexId, f64>,
    /// The atoms of the latest centres, and for each centre of all patches their number among these.
    fans: Vec<Fan>,
    /// The entries of all of them.
    entries: usize,
    fan_of: Vec<Option<usize>>,
    /// The number of this fit, and the place where the next centre is looked for whose atoms are given up.
    fit: u64,
    hand: usize,
    /// The centres of a region, and their fans.
    centres: Vec<u32>,
    of_region: Vec<usize>,
    chosen: Vec<Ridge>,
    builder: FanBuilder,
}

impl Ridges {
    /// For this many centres on all patches.
    pub(super) fn new(centres: usize) -> Self {
        Self {
            near: Vec::new(),
            left: IdVec::default(),
            fans: Vec::new(),
            entries: 0,
            fan_of: vec![None; centres],
            fit: 0,
            hand: 0,
            centres: Vec::new(),
            of_region: Vec::new(),
            chosen: Vec::new(),
            builder: FanBuilder::default(),
        }
    }

    /// Fits ridges to a region with these values of `s`, which are 0 outside of it. Lists for each of its taxels which
    /// ridge is the highest there, and returns the number of ridges; 1 if it is too large for fingers.
    pub(super) fn fit(
        &mut self,
        mesh: &TriMesh,
        normals: &IdVec<VertexId, DVec3>,
        places: &Places,
        root: &dyn Fn(VertexId) -> f64,
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
        self.list_near(mesh, places, region);
        self.list_fans(mesh, normals, places);
        if self.left.len() < mesh.positions.len() {
            self.left = IdVec::filled(0.0, mesh.positions.len());
        }
        self.near.iter().for_each(|&taxel| self.left[taxel] = root(taxel));
        let all = self.squares();
        self.chosen.clear();
        while self.chosen.len() < MOST && self.squares() > LEFT * all {
            let Some(ridge) = self.best(None) else { break };
            self.add(ridge, -1.0);
            self.chosen.push(ridge);
            self.improve();
        }
        self.label(region, labels);
        self.chosen.len()
    }

    fn squares(&self) -> f64 {
        self.near.iter().map(|&taxel| self.left[taxel] * self.left[taxel]).sum()
    }

    /// Takes each ridge out and puts the best one near it back.
    fn improve(&mut self) {
        for _ in 0..if self.chosen.len() > 1 { SWEEPS } else { 0 } {
            let mut has_changed = false;
            for k in 0..self.chosen.len() {
                let old = self.chosen[k];
                self.add(old, 1.0);
                let new = self.best(Some(self.fans[old.fan].at)).unwrap_or(old);
                has_changed |= (new.fan, new.atom) != (old.fan, old.atom);
                self.add(new, -1.0);
                self.chosen[k] = new;
            }
            if !has_changed {
                break;
            }
        }
    }

    fn add(&mut self, ridge: Ridge, sign: f64) {
        for (taxel, [height, slope]) in self.fans[ridge.fan].entries(ridge.atom) {
            self.left[taxel] += sign * (ridge.height * height + ridge.slope * slope);
        }
    }

    /// The atom that lowers the squares most, with its height and slope; of several the first. With a point, of the centres
    /// near it.
    fn best(&self, near: Option<DVec3>) -> Option<Ridge> {
        let is_near = |fan: &Fan| near.is_none_or(|at| fan.at.distance_squared(at) <= NEAR * NEAR);
        let mut best: Option<Ridge> = None;
        for &fan in self.of_region.iter().filter(|&&fan| is_near(&self.fans[fan])) {
            let found = self.fans[fan].best(&self.left, best.map_or(0.0, |best| best.gain));
            best = found.map(|ridge| Ridge { fan, ..ridge }).or(best);
        }
        best
    }

    fn label(&mut self, region: &[VertexId], labels: &mut [u32]) {
        self.near.iter().for_each(|&taxel| self.left[taxel] = 0.0);
        for (k, ridge) in (0_u32..).zip(&self.chosen) {
            for (taxel, [height, slope]) in self.fans[ridge.fan].entries(ridge.atom) {
                let value = ridge.height * height + ridge.slope * slope;
                if value > self.left[taxel] {
                    self.left[taxel] = value;
                    if let Ok(at) = region.binary_search(&taxel) {
                        labels[at] = k;
                    }
                }
            }
        }
    }

    /// Lists the taxels that atoms of a region may reach.
    fn list_near(&mut self, mesh: &TriMesh, places: &Places, region: &[VertexId]) {
        debug_assert!(!region.is_empty(), "a region has taxels");
        let reach = places.reach();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &centre in &self.centres {
            let (at, _) = places.centres[centre as usize];
            (low, high) = (low.min(at - reach), high.max(at + reach));
        }
        let is_near = |p: DVec3| p.cmpge(low).all() && p.cmple(high).all();
        self.near.clear();
        self.near.extend(mesh.positions.enumerate().filter(|(_, p)| is_near(**p)).map(|(taxel, _)| taxel));
    }

    /// Lists the fans of the centres of a region; builds those that are not kept.
    fn list_fans(&mut self, mesh: &TriMesh, normals: &IdVec<VertexId, DVec3>, places: &Places) {
        self.fit += 1;
        self.of_region.clear();
        for k in 0..self.centres.len() {
            let centre = self.centres[k] as usize;
            let number = places.first + centre;
            let fan = match self.fan_of[number] {
                Some(fan) => fan,
                None => {
                    let fan = self.free_fan();
                    self.fan_of[number] = Some(fan);
                    self.fans[fan].centre = number;
                    let at = places.centres[centre];
                    self.entries -= self.fans[fan].len();
                    self.builder.build(&mut self.fans[fan], places, at, (mesh, normals, &self.near));
                    self.entries += self.fans[fan].len();
                    fan
                }
            };
            self.fans[fan].used = self.fit;
            self.of_region.push(fan);
        }
        let mut tried = 0;
        while self.entries > MOST_ENTRIES && tried < self.fans.len() {
            if self.fans[self.hand].used != self.fit {
                self.give_up();
            }
            self.hand = (self.hand + 1) % self.fans.len();
            tried += 1;
        }
    }

    /// A new fan, or one that this fit does not use.
    fn free_fan(&mut self) -> usize {
        let is_full = self.fans.len() >= MOST_KEPT || self.entries >= MOST_ENTRIES;
        let mut tried = 0;
        while is_full && tried < self.fans.len() && self.fans[self.hand].used == self.fit {
            self.hand = (self.hand + 1) % self.fans.len();
            tried += 1;
        }
        if !is_full || tried == self.fans.len() {
            self.fans.push(Fan::default());
            return self.fans.len() - 1;
        }
        self.give_up();
        self.hand
    }

    /// Gives up the atoms of a centre.
    fn give_up(&mut self) {
        let fan = std::mem::take(&mut self.fans[self.hand]);
        self.entries -= fan.len();
        if let Some(number) = self.fan_of.get_mut(fan.centre).filter(|number| **number == Some(self.hand)) {
            *number = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Presses of three taxels all over a skin with taxels 1.5 mm apart.
    #[test]
    fn atoms_of_dense_skins_are_given_up_and_change_nothing() {
        let mesh = shapes::lattice(40, 40, 0.0015);
        let normals = mesh.positions.map(|_| DVec3::Z);
        let places = Places::new(&mesh, &normals, 0);
        let fit = |ridges: &mut Ridges, first: usize| {
            let region = [0, 1, 2].map(|k| VertexId::new(first + k));
            let mut roots = mesh.positions.map(|_| 0.0);
            region.iter().for_each(|&v| roots[v] = 1.0);
            let mut labels = Vec::new();
            (ridges.fit(&mesh, &normals, &places, &|v| roots[v], &region, &mut labels), labels)
        };
        let mut kept = Ridges::new(places.end());
        for first in (0..mesh.positions.len() - 3).step_by(5) {
            assert_eq!(fit(&mut kept, first), fit(&mut Ridges::new(places.end()), first), "{first}");
        }
        let range = MOST_ENTRIES / 4 * 3..=MOST_ENTRIES;
        assert!(range.contains(&kept.entries), "{} entries", kept.entries);
    }
}
