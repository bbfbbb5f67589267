//! Matches the regions of a frame with the contacts of the last one.
//!
//! Pairs that share taxels are matched first, in the order of the number of shared taxels: of two contacts
//! that merge, the one with more taxels in the merged region continues, and a contact that splits continues
//! in the region with more of its taxels. Then pairs without shared taxels are matched, the nearest first. Of
//! equal pairs the older contact comes first.

use std::cmp::Reverse;

use crate::signal::contacts::{ContactRegion, find::Finder, joined::Joined};

/// Matches regions; owns its lists.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracks {
    /// Number of taxels that a region shares with each of the found regions.
    shared: Vec<usize>,
    /// Pairs of a region of the last frame and a found one: the number of shared taxels, and the distance.
    pairs: Vec<Pair>,
    /// The matched regions of both frames.
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
    /// Passes track and age of the regions of the last frame to the found regions of the same contact, whose
    /// taxels are numbered in `finder`.
    pub(super) fn join(
        &mut self,
        last: &[ContactRegion],
        found: &mut [ContactRegion],
        (finder, joined): (&Finder, &Joined),
        reach: f64,
    ) {
        self.list_pairs(last, found, (finder, joined), reach);
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
    }

    /// For each region of the last frame whether it continues, after [`Self::join`].
    pub(super) fn goes_on(&self) -> &[bool] {
        &self.is_joined_last
    }

    /// Whether a found region is of no contact of the last frame, after [`Self::join`].
    pub(super) fn is_new(&self, found: usize) -> bool {
        !self.is_joined_found[found]
    }

    fn list_pairs(
        &mut self,
        last: &[ContactRegion],
        found: &[ContactRegion],
        (finder, joined): (&Finder, &Joined),
        reach: f64,
    ) {
        self.pairs.clear();
        for (from, region) in last.iter().enumerate() {
            self.shared.clear();
            self.shared.resize(found.len(), 0);
            for taxel in joined.numbers(region) {
                if let Some(to) = finder.region_of(taxel) {
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
