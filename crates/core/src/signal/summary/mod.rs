//! Sums of a trial, as in pressure mapping: by region, patch, link, contact and of the whole skin.
//!
//! Every frame gives a [`Load`] for each group of taxels: its peak, mean, force, contact area and centre of pressure.
//! [`Summary`] adds them up over the frames: peaks, means, integrals over time and the path of the centre of pressure
//! (`totals`), and each loading of a group by itself (`steps`). A taxel is loaded if its reading is above the threshold; force and sum are of all readings.
//!
//! Integrals follow the trapezoidal rule between consecutive frames; the load of a contact is 0 in the frames before it
//! begins and after it has ended. Where times go back or frames are missing (`clock`) nothing is added, and contacts end;
//! [`Summary::gaps`] counts both.

mod load;
mod steps;
mod totals;

use std::collections::BTreeMap;

use crate::body::{BodyTaxel, FieldLevel};
use crate::id::{IdVec, VertexId};
use crate::map::{RegionId, Regions, SkinMap};
use crate::pyramid::{LevelId, Prolongation};
use crate::signal::contacts::ContactTracker;
use crate::signal::summary::load::Adder;
use crate::signal::summary::steps::Steps;
use crate::signal::{Channel, ContactEvent};
use crate::skin::{LinkId, PatchId};

pub use load::Load;
pub use totals::Totals;

/// What a sum is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum Group {
    /// The whole skin.
    Whole,
    /// The taxels on a link.
    Link(LinkId),
    /// The taxels of a patch.
    Patch(PatchId),
    /// The taxels of a named region.
    Region(RegionId),
    /// The taxels of a field of a level of the whole body, or of a modality, each by its weight.
    Field(VertexId),
    /// The taxels of a contact, by its track; they differ from frame to frame.
    Contact(u64),
}

/// A loading of a group by itself.
#[derive(Debug, Clone)]
pub struct LoadingStep {
    /// A patch or a region.
    pub group: Group,
    /// Its number among the steps of the group, from 0 on.
    pub number: usize,
    /// What the group felt meanwhile; [`Totals::first_contact`] is its begin, [`Totals::contact_time`] its duration.
    pub totals: Totals,
}

/// What a group felt outside its steps: with these its sums are those of the whole.
#[derive(Debug, Clone, PartialEq)]
pub struct OutsideSteps {
    /// A patch or a region.
    pub group: Group,
    /// Loadings of which the recording has only a part: cut off by its begin, its end or a gap.
    pub cut_off: usize,
    /// Loadings below 5 % of the largest force of the group.
    pub weak: usize,
    /// The impulse outside of steps, in N s, also of readings below the threshold.
    pub impulse: Option<f64>,
    /// The time of load outside of steps, in s.
    pub contact_time: Option<f64>,
}

/// Adds up a recording.
///
/// It allocates only when a contact begins.
#[derive(Debug, Clone)]
pub struct Summary {
    /// What is added up.
    pub channel: Channel,
    regions: Regions,
    links: IdVec<PatchId, LinkId>,
    adder: IdVec<PatchId, Adder>,
    /// The groups that do not change, and their loads in the last frame.
    loads: Vec<(Group, Load)>,
    /// Where patches, links and regions begin among them.
    starts: [usize; 3],
    /// The place of each link among them.
    link_places: IdVec<LinkId, Option<usize>>,
    totals: Vec<Totals>,
    contacts: BTreeMap<u64, (PatchId, Totals)>,
    /// The level without a mesh whose fields are among the groups, if one is asked for.
    fields: Option<Fields>,
    /// Of patches and regions, if they are asked for.
    steps: Option<Steps>,
    gaps: usize,
}

/// The fields of a level of the whole body, or of a modality.
#[derive(Debug, Clone)]
struct Fields {
    at: FieldLevel,
    rows: IdVec<PatchId, Option<Prolongation>>,
    /// The place of the first one among the groups.
    first: usize,
    /// Their numbers, and their regions.
    names: IdVec<VertexId, String>,
}

impl Summary {
    /// A summary of the readings of a channel on a map.
    pub fn new(map: &SkinMap, channel: &Channel) -> Self {
        let regions = map.regions();
        let links = map.patches.map(|patch| patch.link);
        let mut link_places = map.links.map(|_| None);
        let mut groups = vec![Group::Whole];
        for link in map.links.ids().filter(|link| links.iter().any(|of| of == link)) {
            link_places[link] = Some(groups.len());
            groups.push(Group::Link(link));
        }
        let patches = groups.len();
        groups.extend(map.patches.ids().map(Group::Patch));
        let first_region = groups.len();
        groups.extend(regions.names.ids().map(Group::Region));
        let adder = map.patches.map(|patch| {
            let positions = &patch.levels[LevelId::default()].level.mesh.positions;
            Adder::new(patch.link, channel, &patch.taxels, positions)
        });
        let mut this = Self {
            channel: channel.clone(),
            regions,
            links,
            adder,
            totals: vec![Totals::default(); groups.len()],
            loads: groups.into_iter().map(|group| (group, Load::default())).collect(),
            starts: [1, patches, first_region],
            link_places,
            contacts: BTreeMap::new(),
            fields: None,
            steps: None,
            gaps: 0,
        };
        this.count_taxels(map);
        this
    }

    /// Adds the frame that a tracker of the same map and channel has seen last; nothing while it knows no threshold.
    ///
    /// # Panics
    /// If the tracker is of another map.
    pub fn add(&mut self, time: f64, tracker: &ContactTracker) {
        let Some(threshold) = tracker.threshold() else { return };
        let [first_link, first_patch, first_region] = self.starts;
        self.loads.iter_mut().for_each(|(_, load)| *load = Load::default());
        for (patch, values) in tracker.values().enumerate() {
            let adder = &self.adder[patch];
            let mut of_patch = Load::default();
            for (taxel, &value) in values.enumerate() {
                let Some(load) = adder.load(patch, taxel, value, threshold) else { continue };
                of_patch.merge(&load);
                if let Some(region) = self.regions.of_taxels[patch][taxel] {
                    self.loads[first_region + region.index()].1.merge(&load);
                }
                if let Some(Fields { first, rows, .. }) = &self.fields {
                    for (field, weight) in rows[patch].iter().flat_map(|rows| rows.row(taxel)) {
                        self.loads[first + field.index()].1.merge(&load.share(weight));
                    }
                }
            }
            self.loads[first_patch + patch.index()].1 = of_patch;
            if let Some(place) = self.link_places[self.links[patch]] {
                self.loads[place].1.merge(&of_patch);
            }
        }
        debug_assert!(first_link <= first_patch, "links come before patches");
        let mut whole = Load::default();
        self.loads[first_link..first_patch].iter().for_each(|(_, load)| whole.merge(load));
        self.loads[0].1 = whole;

        let tick = tracker.tick();
        self.gaps += usize::from(tick.is_cut());
        let step = tick.step();
        if let Some(steps) = &mut self.steps {
            steps.add(time, tick, self.loads[first_patch..].iter().map(|(_, load)| load));
        }
        for (totals, (_, load)) in self.totals.iter_mut().zip(&self.loads) {
            totals.add(time, step, load);
        }
        for region in tracker.contacts() {
            if region.event == ContactEvent::Release {
                if let Some((_, totals)) = self.contacts.get_mut(&region.track) {
                    totals.leave(step);
                }
                continue;
            }
            let mut load = Load::default();
            for BodyTaxel { patch, taxel } in region.all_taxels() {
                let value = tracker.values()[patch][taxel];
                // All taxels of a contact are loaded, also those between its two thresholds.
                let adder = &self.adder[patch];
                if let Some(of_taxel) = adder.load(patch, taxel, value, f64::NEG_INFINITY) {
                    load.merge(&of_taxel);
                }
            }
            let entry = self.contacts.entry(region.track);
            entry.or_insert_with(|| (region.patch, Totals::enter())).1.add(time, step, &load);
        }
    }

    /// From now on also adds up the fields of a level of the whole body, or of a modality: a taxel counts in each by its
    /// weight, so that forces and areas of the fields add up to those of the whole skin, or of the patches with sensors.
    ///
    /// # Panics
    /// If the map is another one.
    pub fn follow_fields(&mut self, map: &SkinMap, at: FieldLevel) {
        let (rows, first) = (map.field_rows(at), self.loads.len());
        let regions = self.regions.of_fields(&rows);
        let name = |(field, region): (VertexId, &Option<RegionId>)| match region {
            Some(region) => format!("{field} {}", self.regions.names[*region]),
            None => field.to_string(),
        };
        let names: IdVec<VertexId, String> = regions.enumerate().map(name).collect();
        let mut totals: IdVec<VertexId, Totals> = names.map(|_| Totals::default());
        for ((patch, rows), is_read) in map.patches.iter().zip(&rows).zip(&self.channel.taxels(map)) {
            let Some(rows) = rows else { continue };
            for (taxel, _) in is_read.enumerate().filter(|(_, is_read)| **is_read) {
                for (field, weight) in rows.row(taxel) {
                    totals[field].taxels += 1;
                    totals[field].area += weight * patch.taxels.areas[taxel];
                }
            }
        }
        self.loads.extend(names.ids().map(|field| (Group::Field(field), Load::default())));
        self.totals.extend(totals);
        self.fields = Some(Fields { at, rows, first, names });
    }

    /// The level that is [followed](Self::follow_fields).
    pub fn field_level(&self) -> Option<FieldLevel> {
        self.fields.as_ref().map(|fields| fields.at)
    }

    /// From now on also follows each loading of a patch or a region.
    pub fn follow_steps(&mut self) {
        self.steps = Some(Steps::new(self.loads.len() - self.starts[1]));
    }

    /// Whether each loading is followed.
    pub fn follows_steps(&self) -> bool {
        self.steps.is_some()
    }

    /// What the whole of each patch and region has beyond its steps; those that have nothing are left out, and all unless
    /// steps are [followed](Self::follow_steps).
    pub fn outside_steps(&self) -> Vec<OutsideSteps> {
        let Some((steps, _)) = self.steps() else { return Vec::new() };
        let [_, first, _] = self.starts;
        let left_out = self.steps.iter().flat_map(Steps::left_out);
        let outside = self.loads[first..].iter().zip(&self.totals[first..]).zip(left_out);
        let outside = outside.map(|(((group, _), whole), [cut_off, weak])| {
            let of_group = || steps.iter().filter(|step| step.group == *group).map(|step| &step.totals);
            let beyond = |of: &dyn Fn(&Totals) -> Option<f64>| {
                Some(of(whole)? - of_group().filter_map(of).sum::<f64>())
            };
            OutsideSteps {
                group: *group,
                cut_off,
                weak,
                impulse: beyond(&|totals| totals.impulse),
                contact_time: beyond(&|totals| totals.contact_time),
            }
        });
        outside.filter(|outside| outside.cut_off + outside.weak > 0).collect()
    }

    /// The steps so far, by their begin, and how many loadings are none because the recording has only a part of them; `None`
    /// unless they are [followed](Self::follow_steps).
    pub fn steps(&self) -> Option<(Vec<LoadingStep>, usize)> {
        let groups = self.loads[self.starts[1]..].iter().map(|(group, _)| *group);
        let step = |(group, number, totals)| LoadingStep { group, number, totals };
        self.steps.as_ref().map(|steps| (steps.list(groups).into_iter().map(step).collect(), steps.cut_off()))
    }

    /// How often times went back or frames were missing.
    pub fn gaps(&self) -> usize {
        self.gaps
    }

    /// The loads of the last frame, but for those of contacts.
    pub fn loads(&self) -> &[(Group, Load)] {
        &self.loads
    }

    /// What was added up, in the order of [`Group`]: contacts come last.
    pub fn totals(&self) -> impl Iterator<Item = (Group, &Totals)> {
        let groups = self.loads.iter().map(|(group, _)| *group).zip(&self.totals);
        groups.chain(self.contacts.iter().map(|(track, (_, totals))| (Group::Contact(*track), totals)))
    }

    /// Names of what a group is of: of its patch, its link and itself; the first two are empty where it may have several.
    pub fn names<'a>(&'a self, map: &'a SkinMap, group: Group) -> [std::borrow::Cow<'a, str>; 3] {
        let of_patch =
            |id: PatchId| [map.patches[id].name.as_str(), map.links[map.patches[id].link].name.as_str()];
        let ([patch, link], name) = match group {
            Group::Whole => (["", ""], "".into()),
            Group::Link(id) => (["", map.links[id].name.as_str()], map.links[id].name.as_str().into()),
            Group::Patch(id) => (of_patch(id), map.patches[id].name.as_str().into()),
            Group::Region(id) => (["", ""], (&*self.regions.names[id]).into()),
            Group::Field(id) => {
                (["", ""], self.fields.as_ref().map_or_else(Default::default, |of| (&*of.names[id]).into()))
            }
            Group::Contact(track) => {
                let patch = self.contacts.get(&track).map(|(patch, _)| of_patch(*patch));
                (patch.unwrap_or_default(), track.to_string().into())
            }
        };
        [patch.into(), link.into(), name]
    }

    /// Counts the taxels of each group that the channel [is of](Channel::taxels), and their areas.
    fn count_taxels(&mut self, map: &SkinMap) {
        let is_read = self.channel.taxels(map);
        for (id, patch) in map.patches.enumerate() {
            for (taxel, is_read) in is_read[id].enumerate() {
                let region = self.regions.of_taxels[id][taxel];
                for (totals, (group, _)) in self.totals.iter_mut().zip(&self.loads) {
                    let is_in = match *group {
                        Group::Whole => true,
                        Group::Link(link) => link == patch.link,
                        Group::Patch(of) => of == id,
                        Group::Region(of) => Some(of) == region,
                        Group::Field(_) | Group::Contact(_) => false,
                    };
                    if is_in && *is_read {
                        totals.taxels += 1;
                        totals.area += patch.taxels.areas[taxel];
                    }
                }
            }
        }
    }
}
