//! Steps: each loading of a patch or a named region by itself, as the steps of a gait.
//!
//! A loading goes from the first frame with a loaded taxel to the last one. Less than [`PAUSE_S`] without load does not end it. Its
//! integrals reach halfway into the frames without load before and after it. What is cut off by the begin or the end of the
//! recording, or by a gap, is no step, and neither is what never reaches [`LEAST`] of the largest force of its group.

use crate::signal::Tick;
use crate::signal::clock::SAME_S;
use crate::signal::summary::load::Load;
use crate::signal::summary::totals::{Kept, Totals};

/// Time without load that ends a step, in s: that after which no track continues a contact of events.
const PAUSE_S: f64 = 0.15;

/// Largest force over that of the strongest loading of the group, below which a loading is no step: a sock that brushes an
/// insole while the foot swings loads some cells with 0.2 % of the weight.
const LEAST: f64 = 0.05;

/// The loadings of each group so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Steps {
    groups: Vec<OfGroup>,
}

#[derive(Debug, Clone, Default)]
struct OfGroup {
    /// The load of the last frame.
    last: Option<Kept>,
    open: Option<Loading>,
    whole: Vec<Totals>,
    /// The largest force of all loadings, and the number of those that are cut off.
    strongest: f64,
    cut_off: usize,
}

#[derive(Debug, Clone)]
struct Loading {
    totals: Totals,
    is_begin_known: bool,
    /// The time of its last frame with readings.
    seen: f64,
    /// At the first frame without load: the totals then, and its time.
    ended: Option<(Totals, f64)>,
}

impl Steps {
    pub(super) fn new(groups: usize) -> Self {
        Self { groups: vec![OfGroup::default(); groups] }
    }

    /// Takes the load of each group in a frame.
    pub(super) fn add<'l>(&mut self, time: f64, tick: Tick, loads: impl Iterator<Item = &'l Load>) {
        for (group, load) in self.groups.iter_mut().zip(loads) {
            group.add(time, tick, load);
        }
    }

    /// The steps of each of these groups, by their begin, each with its number among those of its group.
    pub(super) fn list<G: Copy + Ord>(&self, groups: impl Iterator<Item = G>) -> Vec<(G, usize, Totals)> {
        let mut all = Vec::new();
        for (of, group) in self.groups.iter().zip(groups) {
            let (ended, least) = of.ended();
            let steps = of.whole.iter().chain(&ended).filter(|totals| largest(totals) >= least);
            all.extend(steps.enumerate().map(|(number, totals)| (group, number, totals.clone())));
        }
        let begin = |totals: &Totals| totals.first_contact.unwrap_or(f64::NEG_INFINITY);
        all.sort_by(|(a, _, of_a), (b, _, of_b)| begin(of_a).total_cmp(&begin(of_b)).then(a.cmp(b)));
        all
    }

    /// How many loadings are cut off by the begin or the end of the recording, or by a gap.
    pub(super) fn cut_off(&self) -> usize {
        self.left_out().map(|[cut_off, _]| cut_off).sum()
    }

    /// Of each group the loadings that are cut off, and those that are too weak.
    pub(super) fn left_out(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        self.groups.iter().map(|of| {
            let is_open = of.open.as_ref().is_some_and(|open| open.whole().is_none());
            let (ended, least) = of.ended();
            let weak = of.whole.iter().chain(&ended).filter(|totals| largest(totals) < least);
            [of.cut_off + usize::from(is_open), weak.count()]
        })
    }
}

/// The largest force, or sum of readings.
fn largest(totals: &Totals) -> f64 {
    totals.force_peak.or(totals.sum_peak).unwrap_or(0.0)
}

impl Loading {
    /// Its totals, if both its ends are known.
    fn whole(&self) -> Option<Totals> {
        let (totals, _) = self.ended.as_ref()?;
        self.is_begin_known.then(|| totals.clone())
    }
}

impl OfGroup {
    /// The last loading, if it has ended, and the least force of a step.
    fn ended(&self) -> (Option<Totals>, f64) {
        let ended = self.open.as_ref().and_then(Loading::whole);
        let last = ended.as_ref().map_or(0.0, largest);
        (ended, LEAST * self.strongest.max(last))
    }

    fn add(&mut self, time: f64, tick: Tick, load: &Load) {
        if tick.is_cut() {
            self.end();
            self.last = None;
        }
        let (is_loaded, step) = (load.loaded > 0, tick.step());
        if let Some(open) = &mut self.open {
            open.totals.add(time, step, load);
            if load.readings > 0 {
                open.seen = time;
            }
            match &open.ended {
                _ if is_loaded => open.ended = None,
                // Without readings nobody knows whether it goes on.
                None if load.readings == 0 => {
                    if time - open.seen >= PAUSE_S - SAME_S {
                        self.end();
                    }
                }
                None => open.ended = Some((open.totals.clone(), time)),
                Some((_, since)) if time - since >= PAUSE_S - SAME_S => self.end(),
                Some(_) => {}
            }
        } else if is_loaded {
            let mut totals = Totals::after(self.last);
            totals.add(time, step, load);
            self.open =
                Some(Loading { totals, is_begin_known: self.last.is_some(), seen: time, ended: None });
        }
        self.last = (load.readings > 0).then(|| Kept::of(load));
    }

    fn end(&mut self) {
        let Some(open) = self.open.take() else { return };
        self.strongest = self.strongest.max(largest(&open.totals));
        match open.whole() {
            Some(totals) => self.whole.push(totals),
            None => self.cut_off += 1,
        }
    }
}
