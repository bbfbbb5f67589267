//! The taxels of the regions of one frame: flood fill with two thresholds, then splitting.

use crate::body::BodyTaxel;
use crate::id::{IdVec, VertexId};
use crate::signal::contacts::ContactRegion;
use crate::signal::contacts::joined::Joined;
use crate::signal::contacts::split::{Splitter, TaxelReadings};

/// Mark of a taxel in no region.
const FREE: u32 = u32::MAX;
/// Mark of a taxel in a region that is not numbered yet or was too small.
const TAKEN: u32 = u32::MAX - 1;

/// Finds regions, whose taxels are numbered over all patches; owns marks for all taxels.
#[derive(Debug, Clone)]
pub(super) struct Finder {
    marks: IdVec<VertexId, u32>,
    /// The taxels that are not `FREE`.
    marked: Vec<VertexId>,
    open: Vec<VertexId>,
    /// The number, from 1 on, of the contact of the last frame that had each taxel; 0 for none.
    before: IdVec<VertexId, u32>,
    splitter: Splitter,
    /// Lists of earlier regions, for reuse.
    spare: Vec<Vec<VertexId>>,
    spare_beyond: Vec<Vec<BodyTaxel>>,
    /// Taxels of the largest region so far, and the capacity of all lists.
    largest: usize,
    room: usize,
}

impl Finder {
    /// For this many taxels.
    pub(super) fn new(taxels: usize) -> Self {
        Self {
            marks: IdVec::filled(FREE, taxels),
            marked: Vec::new(),
            before: IdVec::filled(0, taxels),
            open: Vec::new(),
            splitter: Splitter::default(),
            spare: Vec::new(),
            spare_beyond: Vec::new(),
            largest: 0,
            room: 0,
        }
    }

    /// Gives all lists, including those of these regions, capacity for the largest region so far, since any
    /// of them may get the next one of that size.
    pub(super) fn make_room(&mut self, found: &mut [ContactRegion], last: &mut [ContactRegion]) {
        if self.room < self.largest {
            self.room = self.largest;
            let lists = found.iter_mut().chain(last.iter_mut()).map(|region| &mut region.taxels);
            lists.chain(&mut self.spare).for_each(|list| list.reserve(self.room.saturating_sub(list.len())));
            let lists = found.iter_mut().chain(last).map(|region| &mut region.beyond);
            let used = lists.chain(&mut self.spare_beyond).filter(|list| list.capacity() > 0);
            used.for_each(|list| list.reserve(self.room.saturating_sub(list.len())));
        }
    }

    /// An empty list of taxels, which may have memory of an earlier one.
    pub(super) fn take_list(&mut self) -> Vec<VertexId> {
        self.spare.pop().unwrap_or_else(|| Vec::with_capacity(self.room))
    }

    /// Keeps the memory of a region for reuse.
    pub(super) fn recycle(&mut self, mut region: ContactRegion) {
        region.taxels.clear();
        self.spare.push(region.taxels);
        if region.beyond.capacity() > 0 {
            region.beyond.clear();
            self.spare_beyond.push(region.beyond);
        }
    }

    /// An empty list of taxels of other patches, which has memory if there was one before.
    pub(super) fn take_beyond(&mut self) -> Vec<BodyTaxel> {
        self.spare_beyond.pop().unwrap_or_else(|| Vec::with_capacity(self.room))
    }

    /// Takes the contacts of the last frame: where the noise is known, a contact goes on down to the lower threshold, or
    /// with one taxel above the upper one if nothing else is left of it.
    pub(super) fn follow(&mut self, last: &[ContactRegion], joined: &Joined) {
        self.before.as_mut_slice().fill(0);
        for (region, number) in last.iter().zip(1..) {
            joined.numbers(region).for_each(|taxel| self.before[taxel] = number);
        }
    }

    /// Adds all regions to `found`, with their taxels only.
    pub(super) fn find(&mut self, readings: &TaxelReadings<'_>, found: &mut Vec<ContactRegion>) {
        /// Taxels compared at once.
        const BLOCK: usize = 16;
        let TaxelReadings { values, options, least_seed, .. } = *readings;
        let first = found.len();
        for (block, of_block) in values.as_slice().chunks(BLOCK).enumerate() {
            if !of_block.iter().fold(false, |any, &x| any | (x > least_seed)) {
                continue;
            }
            for at in block * BLOCK..block * BLOCK + of_block.len() {
                let seed = VertexId::new(at);
                let is_seed = values[seed] > least_seed && values[seed].is_finite();
                if !is_seed || self.marks[seed] != FREE {
                    continue;
                }
                let mut taxels = self.take_list();
                self.flood(readings, seed, &mut taxels);
                let goes_on = readings.knows_noise() && taxels.iter().any(|&v| self.before[v] > 0);
                let least = if goes_on { 1 } else { options.least };
                if taxels.len() < least || !(readings.is_evident(&taxels) || goes_on && taxels.len() > 1) {
                    self.recycle(ContactRegion { taxels, ..ContactRegion::default() });
                    continue;
                }
                self.largest = self.largest.max(taxels.len());
                taxels.sort_unstable();
                let region = ContactRegion { taxels, ..ContactRegion::default() };
                if options.prominence < 1.0 && region.taxels.len() > options.part {
                    self.add_parts(readings, region, least, found);
                } else {
                    found.push(region);
                }
            }
        }
        for at in (first..found.len()).rev().filter(|_| options.least > 1) {
            let &[taxel] = &found[at].taxels[..] else { continue };
            let number = self.before[taxel];
            // A larger one, or an earlier one.
            let is_of_it = |(k, region): (usize, &ContactRegion)| {
                (region.taxels.len() > 1 || k < at) && region.taxels.iter().any(|&v| self.before[v] == number)
            };
            if found.iter().enumerate().skip(first).any(is_of_it) {
                let region = found.remove(at);
                self.recycle(region);
            }
        }
    }

    /// Adds the subregions of a region that are separate contacts, or the region if there is only one.
    fn add_parts(
        &mut self,
        readings: &TaxelReadings<'_>,
        region: ContactRegion,
        least: usize,
        found: &mut Vec<ContactRegion>,
    ) {
        let marks = &mut self.marks;
        let parts = self.splitter.split(readings, &region.taxels, marks);
        let has_parts = parts.len() > 1;
        if has_parts {
            for part in parts {
                let mut taxels = self.spare.pop().unwrap_or_else(|| Vec::with_capacity(self.room));
                let of_part = |taxel: &&VertexId| marks[**taxel] == part.raw();
                taxels.extend(region.taxels.iter().filter(of_part));
                if taxels.len() >= least {
                    found.push(ContactRegion { taxels, ..ContactRegion::default() });
                } else {
                    taxels.clear();
                    self.spare.push(taxels);
                }
            }
        }
        region.taxels.iter().for_each(|&taxel| marks[taxel] = TAKEN);
        if has_parts { self.recycle(region) } else { found.push(region) }
    }

    /// Lists the taxels above the lower threshold that are connected to `seed`.
    fn flood(&mut self, readings: &TaxelReadings<'_>, seed: VertexId, taxels: &mut Vec<VertexId>) {
        let TaxelReadings { joined, values, options, high, .. } = *readings;
        let (low, marks) = (options.low * high, &mut self.marks);
        marks[seed] = TAKEN;
        self.marked.push(seed);
        self.open.push(seed);
        while let Some(taxel) = self.open.pop() {
            let is_live = values[taxel].is_finite();
            if is_live {
                taxels.push(taxel);
            }
            for next in joined.around(taxel) {
                // A taxel without a reading connects those around it, but not through other such taxels.
                let is_joined = if values[next].is_finite() { values[next] > low } else { is_live };
                if is_joined && marks[next] == FREE {
                    marks[next] = TAKEN;
                    self.marked.push(next);
                    self.open.push(next);
                }
            }
        }
    }

    /// Marks the taxels of the regions with the index in `found`.
    pub(super) fn number(&mut self, found: &[ContactRegion], joined: &Joined) {
        for (region, number) in found.iter().zip(0..) {
            joined.numbers(region).for_each(|taxel| self.marks[taxel] = number);
        }
    }

    /// The index in `found` of the region of a taxel.
    pub(super) fn region_of(&self, taxel: VertexId) -> Option<usize> {
        let mark = self.marks[taxel];
        (mark < TAKEN).then_some(mark as usize)
    }

    /// Frees all taxels.
    pub(super) fn clear(&mut self) {
        for taxel in self.marked.drain(..) {
            self.marks[taxel] = FREE;
        }
    }
}
