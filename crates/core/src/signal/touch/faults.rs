//! Which simulated taxels are faulty, and from which place each reads.
//!
//! *Heuristic*: times of faults are those of the real recordings of CySkin that have some.

use crate::id::{IdVec, VertexId};
use crate::mesh::Adjacency;
use crate::numeric::{Random, argsort};
use crate::signal::touch::TouchOptions;
use crate::signal::{SignalError, TaxelState};
use crate::skin::{PatchId, Skin};

/// How many taxels have each fault: single ones, pairs of them (swapped, crosstalk) or groups: twelve near each other
/// (module steps), or one with those around it (turned).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultCounts([usize; SIMULATED.len()]);

/// The faults that are simulated, in the order in which taxels are chosen for them.
const SIMULATED: [TaxelState; 11] = [
    TaxelState::Dead,
    TaxelState::Silent,
    TaxelState::Stuck,
    TaxelState::Noisy,
    TaxelState::Jumping,
    TaxelState::Chattering,
    TaxelState::Saturated,
    TaxelState::Swapped,
    TaxelState::Crosstalk,
    TaxelState::ModuleStep,
    TaxelState::Turned,
];

impl FaultCounts {
    /// The faults that are simulated.
    pub fn kinds() -> &'static [TaxelState] {
        &SIMULATED
    }

    /// With this many of a fault; others than [`Self::kinds`] are not simulated, and nothing changes.
    #[must_use]
    pub fn with(mut self, fault: TaxelState, count: usize) -> Self {
        let known = SIMULATED.iter().position(|known| *known == fault);
        known.into_iter().for_each(|k| self.0[k] = count);
        self
    }
}

/// How many jumps there are in a recording, and how long they last at most, in presses.
const JUMPS: usize = 6;
const JUMP_PRESSES: f64 = 3.0;
/// How many jumps of one frame a chattering taxel has.
const CHATTERS: usize = 40;
/// Taxels of a module that has a step; and of one that is turned, at least.
const MODULE: usize = 12;
const TURNED: usize = 4;

/// The faults of the taxels that are read.
#[derive(Debug, Clone)]
pub(super) struct Faults {
    pub(super) states: Vec<TaxelState>,
    /// Frames from which on and before which a taxel jumps, is stuck or has a step.
    pub(super) events: Vec<Vec<[usize; 2]>>,
    /// The taxel at whose place each one feels pressure: itself, unless it is swapped or in a turned module.
    pub(super) sources: Vec<usize>,
    /// From which taxels and into which readings leak.
    pub(super) leaks: Vec<[usize; 2]>,
}

/// The taxels that faults are chosen from.
struct Places<'a> {
    skin: &'a Skin,
    adjacency: &'a IdVec<PatchId, Adjacency>,
    taxels: &'a [(PatchId, VertexId)],
}

impl Faults {
    /// Chooses the faulty ones of these taxels at random.
    pub(super) fn choose(
        skin: &Skin,
        adjacency: &IdVec<PatchId, Adjacency>,
        taxels: &[(PatchId, VertexId)],
        options: &TouchOptions,
        frames: usize,
        mut random: Random,
    ) -> Result<Self, SignalError> {
        let FaultCounts(counts) = options.readout.faults;
        let places = Places { skin, adjacency, taxels };
        let of_a_fault = |fault: TaxelState| match fault {
            TaxelState::Swapped | TaxelState::Crosstalk => 2,
            TaxelState::ModuleStep => MODULE,
            TaxelState::Turned => TURNED,
            _ => 1,
        };
        let sizes =
            SIMULATED.iter().zip(counts).map(|(&fault, count)| count.saturating_mul(of_a_fault(fault)));
        let needed = sizes.fold(0, usize::saturating_add);
        let most = taxels.len();
        if needed > most {
            let limit = format!("at most {most}, the number of working taxels,");
            return Err(SignalError::option("the number of faulty taxels", needed as f64, limit));
        }
        let mut order: Vec<usize> = (0..most).collect();
        for k in (1..most).rev() {
            order.swap(k, random.below(k + 1));
        }
        let mut all = Self {
            states: vec![TaxelState::Ok; most],
            events: vec![Vec::new(); most],
            sources: (0..most).collect(),
            leaks: Vec::new(),
        };
        let press_frames = JUMP_PRESSES * (options.duration + options.pause) * options.rate;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 1e7")]
        let longest = press_frames as usize;
        let mut order = order.into_iter();
        for (&fault, count) in SIMULATED.iter().zip(counts) {
            for number in 0..count {
                if fault == TaxelState::Turned {
                    let Some(ring) = order.find_map(|k| all.ring(k, &places)) else {
                        let limit =
                            format!("at most {number}, those whose neighbours all have no other fault,");
                        return Err(SignalError::option("the number of turned modules", count as f64, limit));
                    };
                    let by = 1 + random.below(ring.len() - 1);
                    for (k, &member) in ring.iter().enumerate() {
                        all.sources[member] = ring[(k + by) % ring.len()];
                    }
                    continue;
                }
                let Some(k) = order.find(|&k| all.states[k] == TaxelState::Ok) else { break };
                all.states[k] = fault;
                let mut begin = || random.below(frames);
                match fault {
                    TaxelState::Stuck => all.events[k] = vec![[frames / 2, frames]],
                    TaxelState::Chattering => {
                        all.events[k] = (0..CHATTERS).map(|_| begin()).map(|f| [f, f + 1]).collect();
                    }
                    TaxelState::Jumping => {
                        let events = (0..JUMPS).map(|_| [begin(), begin()]);
                        let events = events.map(|[a, b]| [a.min(b), a.max(b).min(a.min(b) + longest)]);
                        all.events[k] = events.collect();
                    }
                    TaxelState::Swapped | TaxelState::Crosstalk => {
                        let Some(other) = order.find(|&k| all.states[k] == TaxelState::Ok) else { break };
                        if fault == TaxelState::Swapped {
                            all.states[other] = fault;
                            all.sources.swap(k, other);
                        } else {
                            all.leaks.push([other, k]);
                        }
                    }
                    TaxelState::ModuleStep => {
                        let from = frames / 3 + random.below(frames / 3);
                        for member in all.module_around(k, &places) {
                            all.states[member] = fault;
                            all.events[member] = vec![[from, frames]];
                        }
                    }
                    _ => {}
                }
            }
        }
        Ok(all)
    }

    /// The nearest taxels without a fault on the same patch as one, and itself.
    fn module_around(&self, seed: usize, places: &Places<'_>) -> Vec<usize> {
        let Places { skin, taxels, .. } = places;
        let place = |k: usize| skin.patches[taxels[k].0].mesh.positions[taxels[k].1];
        let is_free =
            |&k: &usize| taxels[k].0 == taxels[seed].0 && (k == seed || self.states[k] == TaxelState::Ok);
        let near: Vec<usize> = (0..taxels.len()).filter(is_free).collect();
        let distances: Vec<f64> = near.iter().map(|&k| place(k).distance_squared(place(seed))).collect();
        argsort(&distances).into_iter().take(MODULE).map(|k| near[k]).collect()
    }

    /// Makes a taxel and those all around it a turned module, and gives the latter in their order. `None` if one of them
    /// is faulty or not read, or the taxel is at the boundary.
    fn ring(&mut self, centre: usize, places: &Places<'_>) -> Option<Vec<usize>> {
        let (patch, taxel) = places.taxels[centre];
        let adjacency = &places.adjacency[patch];
        if adjacency.is_boundary(taxel) {
            return None;
        }
        let number = |&v: &VertexId| places.taxels.iter().position(|place| *place == (patch, v));
        let ring: Vec<usize> = adjacency.ring(taxel).iter().map(number).collect::<Option<_>>()?;
        let is_free = |&k: &usize| self.states[k] == TaxelState::Ok;
        if !ring.iter().chain([&centre]).all(is_free) {
            return None;
        }
        ring.iter().chain([&centre]).for_each(|&k| self.states[k] = TaxelState::Turned);
        Some(ring)
    }
}
