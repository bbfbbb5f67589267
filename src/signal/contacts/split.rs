//! Splits a region with several peaks: clustering by persistence `(chazal2013)`.
//!
//! Taxels are visited from the largest reading to the smallest. Each joins the subregion of its largest
//! neighbour. Where subregions meet in a taxel, the saddle between them, the subregion of the highest peak
//! absorbs every other one that is not a separate contact. A separate contact has a peak above the upper
//! threshold that rises above the saddle by a share of its height ([`TrackerOptions::prominence`]), and
//! enough taxels above the saddle ([`TrackerOptions::part`]). A higher peak with fewer taxels above the
//! saddle than a region needs is a spike at the flank of the subregion, and is not separated.
//!
//! *Heuristic*: half of the height, and four taxels. On recordings of 1 to 5 fingers on a cover of 642 taxels
//! 7 mm apart, 28 of 54 frames have as many contacts as fingers, 17 without splitting; shares from 0.3 to
//! 0.65 give the same, except in one frame. One finger has a second peak of up to three taxels that rises by
//! 0.8 of its height, so the share alone does not separate fingers.

use crate::id::{IdVec, VertexId, define_id};
use crate::mesh::{TriMesh, VertexCorners};
use crate::numeric::DisjointSets;
use crate::signal::TrackerOptions;

define_id!(
    /// A subregion of a region, counted from the highest peak.
    pub(super) PartId, "p"
);

/// The readings of one patch, and the criteria for a contact.
#[derive(Clone, Copy)]
pub(super) struct PatchReadings<'a> {
    pub(super) mesh: &'a TriMesh,
    /// The faces around each taxel.
    pub(super) around: &'a VertexCorners,
    pub(super) values: &'a IdVec<VertexId, f64>,
    pub(super) options: &'a TrackerOptions,
    /// The upper threshold.
    pub(super) high: f64,
}

/// Splits regions; owns its lists.
#[derive(Debug, Clone, Default)]
pub(super) struct Splitter {
    order: Vec<VertexId>,
    /// The subregion with the highest peak first.
    parts: IdVec<PartId, Part>,
    /// Merged subregions; the one with the highest peak is the root.
    sets: DisjointSets<PartId>,
    meeting: Vec<PartId>,
}

#[derive(Debug, Clone, Copy)]
struct Part {
    peak: f64,
    taxels: usize,
}

impl Splitter {
    /// Splits the taxels of a region and marks each with its subregion; marks of other taxels of the patch
    /// must be at least the number of taxels. Lists the subregions, in order.
    pub(super) fn split(
        &mut self,
        readings: &PatchReadings<'_>,
        taxels: &[VertexId],
        marks: &mut IdVec<VertexId, u32>,
    ) -> &[PartId] {
        let values = readings.values;
        self.parts.clear();
        self.sets.clear();
        self.order.clear();
        self.order.extend_from_slice(taxels);
        self.order.sort_unstable_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
        let count = u32::try_from(taxels.len()).unwrap_or(u32::MAX);
        for k in 0..self.order.len() {
            let taxel = self.order[k];
            let largest = self.meet(readings, taxel, marks, count);
            self.merge(values[taxel], readings);
            let part = match largest {
                Some(neighbour) => self.sets.root(marks[neighbour].into()),
                None => self.start(values[taxel]),
            };
            marks[taxel] = part.raw();
            self.parts[part].taxels += 1;
        }
        for &taxel in taxels {
            marks[taxel] = self.sets.root(marks[taxel].into()).raw();
        }
        self.meeting.clear();
        self.meeting.extend(self.parts.ids().filter(|&part| self.sets.root(part) == part));
        &self.meeting
    }

    /// Lists the subregions around a taxel, the highest first; returns its largest neighbour.
    fn meet(
        &mut self,
        readings: &PatchReadings<'_>,
        taxel: VertexId,
        marks: &IdVec<VertexId, u32>,
        count: u32,
    ) -> Option<VertexId> {
        let PatchReadings { mesh, around, values, .. } = *readings;
        let mut largest: Option<VertexId> = None;
        self.meeting.clear();
        let mut visit = |next: VertexId| {
            if marks[next] < count {
                self.meeting.push(marks[next].into());
                if largest.is_none_or(|other| (values[next], other) > (values[other], next)) {
                    largest = Some(next);
                }
            }
        };
        let corners = |v: VertexId| around.faces(v).flat_map(|face| mesh.triangles[face]);
        for next in corners(taxel) {
            visit(next);
            // A taxel without a reading connects those around it.
            if !values[next].is_finite() {
                corners(next).for_each(&mut visit);
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
    fn merge(&mut self, saddle: f64, readings: &PatchReadings<'_>) {
        let PatchReadings { options, high, .. } = *readings;
        let Some((&highest, others)) = self.meeting.split_first() else { return };
        for &other in others {
            let Part { peak, taxels } = self.parts[other];
            let rises = peak > high && peak - saddle >= options.prominence * peak;
            let is_spike = self.parts[highest].taxels < options.least;
            if !rises || taxels < options.part || is_spike {
                self.sets.join(highest, other);
                self.parts[highest].taxels += taxels;
            }
        }
    }

    fn start(&mut self, peak: f64) -> PartId {
        self.sets.push();
        self.parts.push(Part { peak, taxels: 0 })
    }
}
