//! Fingers: regions of smoothed readings, each split into straight ridges of the width that a finger leaves.
//!
//! `live` follows zero and noise and smooths readings; regions are found in these as always, with thresholds of 6 and
//! 3.75 `sigma`. A region that is weak next to others within 60 mm is none: what is left of the skin between fingers.
//! A region with a filled disc that is wider than two fingers is one contact, a palm. `ridges` splits the others, by atoms
//! that `fans` lists.
//!
//! A region on one patch is fitted in the frame of its link, on that patch alone. One that goes on over a gap is fitted on
//! all patches, with the links at rest.
//!
//! *Heuristic*, from 336 recordings of 0 to 5 fingers on a cover of 642 taxels. The number of the contacts of a region
//! depends on readings within 60 mm of it, and on the noise of the skin.

mod fans;
mod live;
mod ridges;

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::pyramid::LevelId;
use crate::signal::contacts::ContactRegion;
use crate::signal::contacts::find::Finder;
use crate::signal::contacts::joined::Joined;
use crate::signal::{Channel, Frame, Tick, TrackerOptions};
use crate::skin::{LinkId, PatchId};
use fans::Places;
pub(super) use live::HIGH;
use live::Live;
use ridges::Ridges;

/// From this many `sigma` on readings count in a fit, since noise is not part of a finger.
const FLOOR: f64 = 3.0;

/// A region with less than this share of the readings of all regions within this distance, in m, is no contact.
const WEAK: f64 = 0.08;
const NEIGHBOURHOOD: f64 = 0.06;

/// A palm: around a taxel above [`PALM_HIGH`] `sigma` lie, within [`PALM_RADIUS`] m, at least [`PALM_TAXELS`] taxels,
/// and no more than [`PALM_GAPS`] of them have less than [`PALM_LEVEL`] of the median of the roots of readings.
const PALM_HIGH: f64 = 4.5;
const PALM_FLOOR: f64 = 2.0;
const PALM_RADIUS: f64 = 0.018;
const PALM_TAXELS: usize = 9;
const PALM_GAPS: f64 = 0.12;
const PALM_LEVEL: f64 = 0.6;

/// Prepares readings, and splits regions; owns its buffers.
#[derive(Debug, Clone)]
pub(super) struct Fingers {
    live: Live,
    places: IdVec<PatchId, Places>,
    ridges: Ridges,
    /// Those of all patches, for regions that go on over gaps; `None` where there are no links.
    over_gaps: Option<(Places, Ridges)>,
    /// The square roots that are fitted; 0 but for one region at a time.
    roots: IdVec<VertexId, f64>,
    /// The taxels of a region, as its patch numbers them.
    own: Vec<VertexId>,
    /// Their taxels.
    rooted: Vec<VertexId>,
    /// For each region its link, the sum of its readings, and the box around it.
    extents: Vec<Extent>,
    labels: Vec<u32>,
    is_seen: IdVec<VertexId, bool>,
    disc: Vec<VertexId>,
    disc_roots: Vec<f64>,
    regions: Vec<ContactRegion>,
}

#[derive(Debug, Clone, Copy)]
struct Extent {
    link: LinkId,
    sum: f64,
    low: DVec3,
    high: DVec3,
}

/// Patches, alone and joined, the smoothed readings of all taxels, the lower threshold and `sigma`.
#[derive(Clone, Copy)]
pub(super) struct Limits<'a> {
    pub(super) patches: &'a IdVec<PatchId, PatchMap>,
    pub(super) joined: &'a Joined,
    pub(super) smooth: &'a IdVec<VertexId, f64>,
    pub(super) low: f64,
    pub(super) sigma: f64,
}

impl Fingers {
    pub(super) fn new(map: &SkinMap, joined: &Joined, channel: &Channel, options: &TrackerOptions) -> Self {
        let first_frames = options.threshold.is_none().then_some(options.noise_frames);
        let mut centres = 0;
        let places = map.patches.map(|patch| {
            let mesh = &patch.levels[LevelId::new(0)].level.mesh;
            let places = Places::new(mesh, &patch.taxels.normals, centres);
            centres = places.end();
            places
        });
        let over_gaps = joined.has_links().then(|| {
            let places = Places::new(&joined.mesh, &joined.normals, 0);
            let ridges = Ridges::new(places.end());
            (places, ridges)
        });
        let taxels = joined.mesh.positions.len();
        Self {
            live: Live::new(map, channel, first_frames, options.rest),
            places,
            ridges: Ridges::new(centres),
            over_gaps,
            roots: IdVec::filled(0.0, taxels),
            own: Vec::new(),
            rooted: Vec::new(),
            extents: Vec::new(),
            labels: Vec::new(),
            is_seen: IdVec::filled(false, taxels),
            disc: Vec::new(),
            disc_roots: Vec::new(),
            regions: Vec::new(),
        }
    }

    /// Takes the next frame; returns the threshold by now, if it is known.
    pub(super) fn see(
        &mut self,
        frame: &Frame,
        time: (Tick, f64),
        channel: usize,
        threshold: Option<f64>,
    ) -> Option<f64> {
        self.live.see(frame, time, channel, threshold);
        threshold.and_then(|_| self.live.sigma(threshold)).map(|sigma| HIGH * sigma)
    }

    /// The readings above zero, which is followed unless they are [at zero](crate::signal::Rest::AtZero) at rest, and these
    /// without faults, smoothed.
    pub(super) fn excess(&self, patch: PatchId) -> &IdVec<VertexId, f64> {
        &self.live.excess[patch]
    }

    pub(super) fn smooth(&self, patch: PatchId) -> &IdVec<VertexId, f64> {
        &self.live.smooth[patch]
    }

    /// Splits the regions of a frame, and removes those that are no contacts.
    pub(super) fn split(&mut self, limits: &Limits<'_>, found: &mut Vec<ContactRegion>, finder: &mut Finder) {
        self.extents.clear();
        for region in found.iter() {
            let positions = &limits.joined.mesh.positions;
            self.root(limits, region);
            let sum = self.rooted.iter().map(|&taxel| self.roots[taxel].powi(2)).sum();
            self.unroot();
            let places = || region.taxels.iter().map(|&taxel| positions[taxel]);
            let low = places().fold(DVec3::INFINITY, DVec3::min);
            let first = region.taxels.first().map(|&taxel| limits.joined.patch_of(taxel));
            let link = limits.patches[first.unwrap_or_default()].link;
            self.extents.push(Extent {
                link,
                sum,
                low,
                high: places().fold(DVec3::NEG_INFINITY, DVec3::max),
            });
        }
        self.regions.append(found);
        for k in 0..self.regions.len() {
            let sum: f64 = (0..self.regions.len())
                .filter(|&other| self.is_near(k, other))
                .map(|other| self.extents[other].sum)
                .sum();
            if self.extents[k].sum < WEAK * sum {
                continue;
            }
            let region = std::mem::take(&mut self.regions[k]);
            if self.is_palm(limits, &region) {
                found.push(region);
                continue;
            }
            self.root(limits, &region);
            let count = self.fit(limits, &region);
            self.unroot();
            for ridge in (0..count).map_while(|ridge| u32::try_from(ridge).ok()) {
                let mut taxels = finder.take_list();
                let of_ridge = region.taxels.iter().zip(&self.labels).filter(|(_, label)| **label == ridge);
                taxels.extend(of_ridge.map(|(taxel, _)| *taxel));
                let part = ContactRegion { taxels, ..ContactRegion::default() };
                if part.taxels.is_empty() { finder.recycle(part) } else { found.push(part) }
            }
            // Neighbours of later regions need its taxels.
            self.regions[k] = region;
        }
        // The regions that are palms have left an empty list, which has no memory to keep.
        let lists = self.regions.drain(..).filter(|region| !region.taxels.is_empty());
        lists.for_each(|region| finder.recycle(region));
    }

    /// Fits ridges to the roots of a region, and labels its taxels; returns their number.
    fn fit(&mut self, limits: &Limits<'_>, region: &ContactRegion) -> usize {
        let Self { places, ridges, over_gaps, roots, own, labels, .. } = self;
        let joined = limits.joined;
        let ends = [region.taxels.first(), region.taxels.last()].map(|end| end.map(|&v| joined.patch_of(v)));
        match (over_gaps, ends) {
            (Some((places, ridges)), [first, last]) if first != last => {
                let (mesh, normals) = (&joined.mesh, &joined.normals);
                ridges.fit(mesh, normals, places, &|v| roots[v], &region.taxels, labels)
            }
            (_, [first, _]) => {
                let id = first.unwrap_or_default();
                let (patch, start) = (&limits.patches[id], joined.start(id));
                own.clear();
                own.extend(region.taxels.iter().map(|v| VertexId::new(v.index() - start)));
                let root = |v: VertexId| roots[VertexId::new(start + v.index())];
                let (mesh, normals) = (&patch.levels[LevelId::new(0)].level.mesh, &patch.taxels.normals);
                ridges.fit(mesh, normals, &places[id], &root, own, labels)
            }
        }
    }

    /// Lists the square roots of the readings of a region and of the taxels around it that are in no region.
    fn root(&mut self, limits: &Limits<'_>, region: &ContactRegion) {
        let (smooth, roots) = (limits.smooth, &mut self.roots);
        let mut add = |taxel: VertexId| {
            let beyond = smooth[taxel] - FLOOR * limits.sigma;
            if beyond > 0.0 && roots[taxel] == 0.0 {
                roots[taxel] = beyond.sqrt();
                self.rooted.push(taxel);
            }
        };
        for &taxel in &region.taxels {
            add(taxel);
            for &next in &limits.joined.next[taxel.index()] {
                if smooth[next.into()] <= limits.low {
                    add(next.into());
                }
            }
        }
    }

    fn unroot(&mut self) {
        for taxel in self.rooted.drain(..) {
            self.roots[taxel] = 0.0;
        }
    }

    /// Whether the boxes around two regions of a link are near each other; also of a region and itself.
    fn is_near(&self, a: usize, b: usize) -> bool {
        let (of_a, of_b) = (&self.extents[a], &self.extents[b]);
        let gap = (of_a.low - of_b.high).max(of_b.low - of_a.high).max(DVec3::ZERO);
        a == b || (gap.length_squared() <= NEIGHBOURHOOD * NEIGHBOURHOOD && of_a.link == of_b.link)
    }

    /// Whether a region has a filled disc that is wider than two fingers.
    fn is_palm(&mut self, limits: &Limits<'_>, region: &ContactRegion) -> bool {
        let (mesh, normals, smooth) = (&limits.joined.mesh, &limits.joined.normals, limits.smooth);
        let is_seen = &mut self.is_seen;
        for &centre in &region.taxels {
            if smooth[centre] <= PALM_HIGH * limits.sigma {
                continue;
            }
            let at = mesh.positions[centre];
            let is_in = |taxel: VertexId| {
                mesh.positions[taxel].distance_squared(at) <= PALM_RADIUS * PALM_RADIUS
                    && normals[taxel].dot(normals[centre]) > 0.2
            };
            self.disc.clear();
            self.disc.push(centre);
            is_seen[centre] = true;
            let mut next = 0;
            while let Some(&taxel) = self.disc.get(next) {
                next += 1;
                for &v in &limits.joined.next[taxel.index()] {
                    let v: VertexId = v.into();
                    if !is_seen[v] && is_in(v) {
                        is_seen[v] = true;
                        self.disc.push(v);
                    }
                }
            }
            self.disc_roots.clear();
            let root = |&v: &VertexId| (smooth[v] - PALM_FLOOR * limits.sigma).max(0.0).sqrt();
            self.disc_roots.extend(self.disc.iter().map(root));
            self.disc.iter().for_each(|&v| is_seen[v] = false);
            let count = self.disc_roots.len();
            let median = crate::numeric::median_of(&mut self.disc_roots).unwrap_or(0.0);
            let gaps = self.disc_roots.iter().filter(|&&x| x < PALM_LEVEL * median).count();
            if count >= PALM_TAXELS && median > 0.0 && gaps as f64 <= PALM_GAPS * count as f64 {
                return true;
            }
        }
        false
    }
}
