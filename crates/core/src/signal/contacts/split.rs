//! Splits a region with several peaks: clustering by persistence `(chazal2013)`.
//!
//! Readings are smoothed along the skin first: a half of each is the mean of those around it, so that uneven gains and
//! noise of single taxels are no peaks. Taxels are visited from the largest reading to the smallest. Each joins the
//! subregion of its largest neighbour. Where subregions meet in a taxel, the saddle between them, the subregion of the
//! highest peak absorbs every other one that is not a separate contact. A separate contact has a reading above the upper
//! threshold, a peak that rises above the saddle by a share of its height ([`TrackerOptions::prominence`]), and
//! enough taxels above the saddle ([`TrackerOptions::part`]). A higher peak with fewer taxels above the
//! saddle than a region needs is a spike at the flank of the subregion, and is not separated.
//!
//! Subregions that meet over a gap link are always one contact.
//!
//! *Heuristic*: 0.4 of the height, and four taxels. Of simulated touches with gains that vary by 40 %, 5 % of the taxels
//! dead and noise to 5 kPa (`tests/library/fingers.rs`), 95 % of laid fingers and all palms of 40 and 60 mm are one contact, 85 and
//! 75 % without smoothing; at 0.5 the same, but fewer fingers on a real cover of 642 taxels 7 mm apart are separated, which
//! [`Probe::Finger`](crate::signal::Probe::Finger) is for.

use crate::id::{IdVec, VertexId, define_id};
use crate::numeric::DisjointSets;
use crate::signal::TrackerOptions;
use crate::signal::contacts::joined::Joined;

define_id!(
    /// A subregion of a region, counted from the highest peak.
    pub(super) PartId, "part"
);

/// The readings of all taxels, and the criteria for a contact.
#[derive(Clone, Copy)]
pub(super) struct TaxelReadings<'a> {
    pub(super) joined: &'a Joined,
    pub(super) values: &'a IdVec<VertexId, f64>,
    pub(super) options: &'a TrackerOptions,
    /// The upper threshold.
    pub(super) high: f64,
    /// A region has a taxel above this: the upper threshold, or the lower one if the noise is known.
    pub(super) least_seed: f64,
}

impl TaxelReadings<'_> {
    /// Whether a region is more than noise: one of its taxels is above the upper threshold, or all of them together are
    /// as unlikely, whose sum of noise grows with the root of their number.
    pub(super) fn is_evident(&self, taxels: &[VertexId]) -> bool {
        let sum: f64 = taxels.iter().map(|&taxel| self.values[taxel]).sum();
        taxels.iter().any(|&taxel| self.values[taxel] > self.high)
            || (self.knows_noise() && sum > self.high * (taxels.len() as f64).sqrt())
    }

    pub(super) fn knows_noise(&self) -> bool {
        self.least_seed < self.high
    }
}

/// Splits regions; owns its lists.
#[derive(Debug, Clone, Default)]
pub(super) struct Splitter {
    order: Vec<VertexId>,
    /// Readings smoothed along the skin, of the taxels of the region.
    smooth: IdVec<VertexId, f64>,
    /// The subregion with the highest peak first.
    parts: IdVec<PartId, Part>,
    /// Merged subregions; the one with the highest peak is the root.
    sets: DisjointSets<PartId>,
    meeting: Vec<PartId>,
}

#[derive(Debug, Clone, Copy)]
struct Part {
    /// Of smoothed readings.
    peak: f64,
    /// The largest reading so far.
    largest: f64,
    taxels: usize,
}

impl Splitter {
    /// Splits the taxels of a region and marks each with its subregion; marks of other taxels
    /// must be at least the number of taxels. Lists the subregions, in order.
    pub(super) fn split(
        &mut self,
        readings: &TaxelReadings<'_>,
        taxels: &[VertexId],
        marks: &mut IdVec<VertexId, u32>,
    ) -> &[PartId] {
        self.smooth(readings, taxels);
        self.parts.clear();
        self.sets.clear();
        self.order.clear();
        self.order.extend_from_slice(taxels);
        let smooth = &self.smooth;
        self.order.sort_unstable_by(|&a, &b| smooth[b].total_cmp(&smooth[a]).then(a.cmp(&b)));
        let count = u32::try_from(taxels.len()).unwrap_or(u32::MAX);
        for k in 0..self.order.len() {
            let taxel = self.order[k];
            let largest = self.meet(readings, taxel, marks, count);
            let (saddle, value) = (self.smooth[taxel], readings.values[taxel]);
            self.merge(saddle, readings);
            let part = match largest {
                Some(neighbour) => self.sets.root(marks[neighbour].into()),
                None => self.start(saddle),
            };
            marks[taxel] = part.raw();
            self.parts[part].taxels += 1;
            self.parts[part].largest = self.parts[part].largest.max(value);
            self.merge_over_gaps(readings, taxel, marks, count);
        }
        for &taxel in taxels {
            marks[taxel] = self.sets.root(marks[taxel].into()).raw();
        }
        self.meeting.clear();
        self.meeting.extend(self.parts.ids().filter(|&part| self.sets.root(part) == part));
        &self.meeting
    }

    /// Smooths the readings of taxels along the skin: a half of each is the mean of those around it. Uneven gains and
    /// noise of single taxels are no peaks.
    fn smooth(&mut self, readings: &TaxelReadings<'_>, taxels: &[VertexId]) {
        let TaxelReadings { joined, values, .. } = *readings;
        if self.smooth.len() < values.len() {
            self.smooth = IdVec::filled(0.0, values.len());
        }
        for &taxel in taxels {
            let finite = joined.around(taxel).filter(|&next| next != taxel && values[next].is_finite());
            let (sum, count) =
                finite.fold((0.0, 0.0), |(sum, count), next| (sum + values[next], count + 1.0));
            let beside = if count > 0.0 { sum / count } else { values[taxel] };
            self.smooth[taxel] = 0.5 * (values[taxel] + beside);
        }
    }

    /// Lists the subregions around a taxel, the highest first; returns its largest neighbour.
    fn meet(
        &mut self,
        readings: &TaxelReadings<'_>,
        taxel: VertexId,
        marks: &IdVec<VertexId, u32>,
        count: u32,
    ) -> Option<VertexId> {
        let TaxelReadings { joined, values, .. } = *readings;
        let smooth = &self.smooth;
        let mut largest: Option<VertexId> = None;
        self.meeting.clear();
        let mut visit = |next: VertexId| {
            if marks[next] < count {
                self.meeting.push(marks[next].into());
                if largest.is_none_or(|other| (smooth[next], other) > (smooth[other], next)) {
                    largest = Some(next);
                }
            }
        };
        for next in joined.around(taxel) {
            visit(next);
            // A taxel without a reading connects those around it.
            if !values[next].is_finite() {
                joined.around(next).for_each(&mut visit);
            }
        }
        for part in &mut self.meeting {
            *part = self.sets.root(*part);
        }
        self.meeting.sort_unstable();
        self.meeting.dedup();
        largest
    }

    /// Merges the subregions at a saddle: those that are not separate contacts are merged into the highest.
    fn merge(&mut self, saddle: f64, readings: &TaxelReadings<'_>) {
        let TaxelReadings { options, high, .. } = *readings;
        let Some((&highest, others)) = self.meeting.split_first() else { return };
        for &other in others {
            let Part { peak, largest, taxels } = self.parts[other];
            let rises = largest > high && peak - saddle >= options.prominence * peak;
            let is_spike = self.parts[highest].taxels < options.least;
            if !rises || taxels < options.part || is_spike {
                self.sets.join(highest, other);
                self.parts[highest].taxels += taxels;
                self.parts[highest].largest = self.parts[highest].largest.max(largest);
            }
        }
    }

    /// Merges the subregions that a taxel joins over gaps, whatever the saddle: what presses the skin most may lie in a gap,
    /// where nothing feels it.
    fn merge_over_gaps(
        &mut self,
        readings: &TaxelReadings<'_>,
        taxel: VertexId,
        marks: &IdVec<VertexId, u32>,
        count: u32,
    ) {
        let TaxelReadings { joined, values, .. } = *readings;
        if !joined.has_links() {
            return;
        }
        let is_dead = |v: &VertexId| !values[*v].is_finite();
        let links = || joined.over_gaps(taxel).iter().copied();
        let beyond = links().filter(is_dead).flat_map(|dead| joined.around(dead));
        let beside =
            joined.around(taxel).filter(is_dead).flat_map(|dead| joined.over_gaps(dead).iter().copied());
        for next in links().chain(beyond).chain(beside).filter(|next| marks[*next] < count) {
            let [own, other] = [marks[taxel], marks[next]].map(|mark| self.sets.root(mark.into()));
            if own != other {
                let [highest, other] = [own.min(other), own.max(other)];
                let Part { taxels, largest, .. } = self.parts[other];
                self.sets.join(highest, other);
                self.parts[highest].taxels += taxels;
                self.parts[highest].largest = self.parts[highest].largest.max(largest);
            }
        }
    }

    fn start(&mut self, peak: f64) -> PartId {
        self.sets.push();
        self.parts.push(Part { peak, largest: f64::NEG_INFINITY, taxels: 0 })
    }
}
