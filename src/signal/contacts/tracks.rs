//! Which region is which contact: regions of a frame joined to those of the last one.
//!
//! Pairs that share taxels are joined first, those that share most before others, so that of two
//! contacts that merge the one with the larger part in the merged one goes on, and of a contact that
//! splits the part with more of its taxels. Then pairs that share none, the nearest first. The older
//! contact comes first where pairs are equal.

use std::cmp::Reverse;

use crate::signal::contacts::{ContactRegion, find::Finder};

/// Joins regions; owns its lists.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracks {
    /// Taxels that a region shares with each of the regions found.
    shared: Vec<usize>,
    /// Pairs of a region of the last frame and one of those found: how many taxels they share, and how
    /// far apart they are.
    pairs: Vec<Pair>,
    /// The regions of both frames that have their pair.
    is_joined_last: Vec<bool>,
    is_joined_found: Vec<bool>,
}

#[derive(Debug, Clone, Copy)]
struct Pair {
    shared: usize,
    /// Square of the distance between the centres, in m^2.
    squared: f64,
    last: usize,
    found: usize,
}

impl Tracks {
    /// Passes track and age of the regions of the last frame on to those of the same contact, whose
    /// taxels are numbered in `finder`. Says for each region of the last frame whether it has gone on.
    pub(super) fn join(
        &mut self,
        last: &[ContactRegion],
        found: &mut [ContactRegion],
        finder: &Finder,
        reach: f64,
    ) -> &[bool] {
        self.list_pairs(last, found, finder, reach);
        self.pairs.sort_unstable_by(|a, b| {
            let order = |pair: &Pair| (Reverse(pair.shared), Reverse(last[pair.last].age));
            let ties = (a.last, a.found).cmp(&(b.last, b.found));
            order(a).0.cmp(&order(b).0).then(if a.shared > 0 {
                order(a).1.cmp(&order(b).1).then(ties)
            } else {
                a.squared.total_cmp(&b.squared).then(order(a).1.cmp(&order(b).1)).then(ties)
            })
        });
        self.is_joined_last.clear();
        self.is_joined_last.resize(last.len(), false);
        self.is_joined_found.clear();
        self.is_joined_found.resize(found.len(), false);
        for pair in &self.pairs {
            let (from, to) = (&mut self.is_joined_last[pair.last], &mut self.is_joined_found[pair.found]);
            if !*from && !*to {
                (*from, *to) = (true, true);
                found[pair.found].track = last[pair.last].track;
                found[pair.found].age = last[pair.last].age;
            }
        }
        &self.is_joined_last
    }

    fn list_pairs(&mut self, last: &[ContactRegion], found: &[ContactRegion], finder: &Finder, reach: f64) {
        self.pairs.clear();
        for (from, region) in last.iter().enumerate() {
            self.shared.clear();
            self.shared.resize(found.len(), 0);
            for &taxel in &region.taxels {
                if let Some(to) = finder.region_of(region.patch, taxel) {
                    self.shared[to] += 1;
                }
            }
            for (to, other) in found.iter().enumerate() {
                let (shared, squared) = (self.shared[to], region.centre.distance_squared(other.centre));
                let is_near = region.patch == other.patch && squared <= reach * reach;
                if shared > 0 || is_near {
                    self.pairs.push(Pair { shared, squared, last: from, found: to });
                }
            }
        }
    }
}
