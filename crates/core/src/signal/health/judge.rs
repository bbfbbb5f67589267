//! The rules: what the sums say of each taxel.

use std::collections::{HashMap, HashSet};

use crate::signal::health::around::Around;
use crate::signal::health::modules::Module;
use crate::signal::health::survey::Seen;
use crate::signal::health::touches::ABSENT_SHARE;
use crate::signal::health::{Health, HealthFinding, HealthReport};
use crate::signal::{Response, TaxelResponse, TaxelState};
use crate::skin::{PatchId, TaxelId};

/// Numbers with their names.
type Evidence = Vec<(&'static str, f64)>;

/// Touches that a taxel, or those around it, must have had to be judged.
const TOUCHES: u32 = 3;

/// Neighbours that must work.
const NEIGHBOURS: usize = 3;

/// Swapped: the least number of strong touches away from the ring, alone and with the touches around it that it does
/// not feel; the least share of them, and the largest share of touches at home. Likeness at the other place, at least, and over that at its own.
const AWAY: u32 = 2;
const AWAY_OR_ABSENT: u32 = 3;
const AWAY_SHARE: f64 = 0.7;
const HOME_SHARE: f64 = 0.2;
const LIKE: f64 = 0.15;
const LIKE_TIMES: f64 = 3.0;

/// Silent: touches all around it, at least; the share of them that it has no strong reaction elsewhere for.
const SURROUNDED: u32 = 3;
const NOT_ELSEWHERE: f64 = 0.9;

/// Jumping: contacts that begin with a jump, at least, and of all; the likeness at another place that explains them.
const JUMPS: u32 = 3;
const JUMP_SHARE: f64 = 0.2;
const JUMP_LIKE: f64 = 0.3;

/// Crosstalk: a taxel that seems to leak into more than this many reads what is common to them.
const MOST_INTO: usize = 3;

/// Chattering: lone changes; recordings without faults have up to 16.
const LONE: u32 = 30;

/// What the second pass says.
pub(super) struct Judged {
    /// Whether taxels, or those around them, were touched often enough.
    is_judged: Vec<bool>,
    is_ok: Vec<bool>,
    own_like: Vec<f64>,
    /// The place, beyond two rings, around which signals are most alike, and how much.
    best: Vec<Option<(usize, f64)>>,
    pub(super) is_swapped: Vec<bool>,
    is_jumping: Vec<bool>,
    is_chattering: Vec<bool>,
    is_silent: Vec<bool>,
    turns: Vec<Option<(f64, f64)>>,
}

impl Judged {
    /// Whether the readings of one taxel may leak into another one, as far as the other rules go.
    pub(super) fn may_leak(&self, from: usize, into: usize) -> bool {
        let jumps = |k: usize| self.is_jumping[k] || self.is_chattering[k];
        // What leaks in changes alone too.
        self.is_ok[from]
            && self.is_ok[into]
            && !jumps(from)
            && !self.is_jumping[into]
            && !self.is_swapped[from]
    }
}

impl Health {
    /// Judges by the sums of the second pass.
    pub(super) fn judge(&self) -> Judged {
        let (around, survey, sight) = (&self.around, &self.survey, &self.sight);
        let count = around.len();
        let is_judged: Vec<bool> =
            (0..count).map(|k| survey.is_ok[k] && sight.touches[k].all >= TOUCHES).collect();
        let judged_ring = |k: usize| around.of(k).filter(|&other| is_judged[other]);
        let rings: Vec<usize> = (0..count).map(|k| judged_ring(k).count()).collect();
        let (mut own_like, mut best) = (vec![0.0; count], vec![None; count]);
        let mut sums = vec![0.0; count];
        for k in 0..count {
            for &(other, like) in sight.likeness[k].iter().filter(|(other, _)| is_judged[*other as usize]) {
                around.of(other as usize).for_each(|place| sums[place] += like);
            }
            own_like[k] = sums[k] / rings[k].max(1) as f64;
            // The places that were added to, each set back to 0 when it was looked at.
            for &(other, _) in sight.likeness[k].iter() {
                for place in around.of(other as usize) {
                    let like = std::mem::take(&mut sums[place]) / rings[place].max(1) as f64;
                    let is_far = rings[place] >= NEIGHBOURS
                        && !around.is_near(
                            u32::try_from(k).unwrap_or(u32::MAX),
                            u32::try_from(place).unwrap_or(u32::MAX),
                        );
                    if like > 0.0 && is_far && best[k].is_none_or(|(_, most)| like > most) {
                        best[k] = Some((place, like));
                    }
                }
            }
        }
        let is_enough = |k: usize| {
            survey.is_ok[k] && around.of(k).filter(|&other| survey.is_ok[other]).count() >= NEIGHBOURS
        };
        let best_like = |k: usize| best[k].map_or(0.0, |(_, like)| like);
        let share = |part: u32, whole: u32, least: f64| f64::from(part) >= least * f64::from(whole);
        let is_swapped: Vec<bool> = (0..count)
            .map(|k| {
                let touches = &sight.touches[k];
                is_enough(k)
                    && touches.away >= AWAY
                    && touches.away + touches.absent >= AWAY_OR_ABSENT
                    && share(touches.away, touches.own, AWAY_SHARE)
                    && f64::from(touches.home) <= HOME_SHARE * f64::from(touches.own)
                    && best_like(k) >= LIKE.max(LIKE_TIMES * own_like[k])
            })
            .collect();
        let is_chattering = |k: usize| is_enough(k) && sight.touches[k].lone >= LONE && !is_swapped[k];
        let is_jumping = |k: usize| {
            let touches = &sight.touches[k];
            is_enough(k)
                && touches.jumps >= JUMPS
                && f64::from(touches.jumps) > JUMP_SHARE * f64::from(touches.contacts)
                && !is_swapped[k]
                && !is_chattering(k)
                && best_like(k) < JUMP_LIKE
        };
        let is_silent = |k: usize| {
            let touches = &sight.touches[k];
            survey.is_ok[k]
                && touches.surrounded >= SURROUNDED
                && touches.share(survey.sigma[k]) < ABSENT_SHARE
                // What reacts elsewhere is not silent.
                && share(
                    touches.surrounded.saturating_sub(touches.own - touches.weak),
                    touches.surrounded,
                    NOT_ELSEWHERE,
                )
                && !is_swapped[k]
        };
        let turn = |module: &Module| module.turn(around, &sight.likeness, &is_judged);
        Judged {
            is_jumping: (0..count).map(is_jumping).collect(),
            is_chattering: (0..count).map(is_chattering).collect(),
            is_silent: (0..count).map(is_silent).collect(),
            turns: sight.modules.iter().map(turn).collect(),
            is_ok: survey.is_ok.clone(),
            is_judged,
            own_like,
            best,
            is_swapped,
        }
    }

    /// What the recordings show, after [`Self::PASSES`] passes.
    pub fn report(&self) -> HealthReport {
        let (survey, sight) = (&self.survey, &self.sight);
        let mut judged = self.judge();
        let mut leaks = sight.leaks.found(&survey.sigma, &sight.energy, &judged.is_swapped);
        let stepped =
            sight.modules.iter().filter(|module| module.steps > 0).flat_map(|module| &module.taxels);
        let stepped: HashSet<usize> = stepped.copied().collect();
        leaks.retain(|leak| ![leak.from, leak.into].iter().any(|&k| stepped.contains(&(k as usize))));
        let mut into = HashMap::<u32, usize>::new();
        leaks.iter().for_each(|leak| *into.entry(leak.from).or_default() += 1);
        leaks.retain(|leak| into[&leak.from] <= MOST_INTO);
        for leak in &leaks {
            let into = leak.into as usize;
            (judged.is_swapped[into], judged.is_chattering[into]) = (false, false);
        }
        let (mut findings, mut in_module) = (Vec::new(), vec![false; self.around.len()]);
        for (module, turn) in sight.modules.iter().zip(&judged.turns) {
            let (kind, evidence) = if module.steps > 0 {
                let [steps, all] = [module.steps, module.recordings].map(f64::from);
                (TaxelState::ModuleStep, vec![("recordings", steps), ("of", all)])
            } else if let &Some((degrees, won)) = turn {
                (TaxelState::Turned, vec![("degrees", degrees), ("likeness_won", won)])
            } else {
                continue;
            };
            module.taxels.iter().for_each(|&k| in_module[k] = true);
            findings.push(self.finding(kind, &module.taxels, None, evidence));
        }
        for k in (0..self.around.len()).filter(|&k| self.is_read[k]) {
            let faults = self.faults_of(k, &judged, in_module[k]);
            findings.extend(faults.into_iter().map(|(kind, other, of)| self.finding(kind, &[k], other, of)));
        }
        for leak in &leaks {
            let evidence =
                vec![("share", leak.share), ("sigmas", leak.errors), ("touches", f64::from(leak.touches))];
            let (from, into) = (leak.from as usize, leak.into as usize);
            findings.push(self.finding(TaxelState::Crosstalk, &[into], Some(from), evidence));
        }
        findings.sort_by_key(|finding| std::cmp::Reverse(finding.kind));
        self.summary(findings, &judged)
    }

    fn finding(
        &self,
        kind: TaxelState,
        taxels: &[usize],
        other: Option<usize>,
        evidence: Evidence,
    ) -> HealthFinding {
        let Around { taxels: places, ids, .. } = &self.around;
        HealthFinding {
            kind,
            patch: taxels.first().map_or_else(PatchId::default, |&k| places[k].0),
            vertices: taxels.iter().map(|&k| places[k].1).collect(),
            taxels: taxels.iter().map(|&k| ids[k]).collect(),
            other: other.map(|k| ids[k]),
            evidence,
        }
    }

    /// The faults of one taxel but for crosstalk, each with the other taxel that it names and the numbers that show it.
    fn faults_of(
        &self,
        k: usize,
        judged: &Judged,
        in_module: bool,
    ) -> Vec<(TaxelState, Option<usize>, Evidence)> {
        let (survey, touches) = (&self.survey, &self.sight.touches[k]);
        let Seen { frames, most, repeated, longest_run, at_most, .. } = survey.seen[k];
        let number = f64::from;
        if survey.is_dead[k] {
            return vec![(TaxelState::Dead, None, vec![("frames", number(frames))])];
        } else if survey.is_stuck[k] {
            let evidence = vec![("frames", number(longest_run)), ("reading", repeated)];
            return vec![(TaxelState::Stuck, None, evidence)];
        } else if survey.is_noisy[k] {
            let sigma = survey.sigma[k];
            let evidence = vec![("noise", sigma), ("times_median", sigma / survey.median_sigma)];
            return vec![(TaxelState::Noisy, None, evidence)];
        } else if in_module {
            return Vec::new();
        }
        let mut faults = Vec::new();
        if survey.is_saturated[k] {
            let evidence = vec![("frames", number(at_most)), ("reading", most)];
            faults.push((TaxelState::Saturated, None, evidence));
        }
        if judged.is_chattering[k] {
            faults.push((TaxelState::Chattering, None, vec![("lone_changes", number(touches.lone))]));
        } else if judged.is_jumping[k] {
            let evidence = vec![("jumps", number(touches.jumps)), ("contacts", number(touches.contacts))];
            faults.push((TaxelState::Jumping, None, evidence));
        }
        if judged.is_silent[k] {
            let share = touches.share(survey.sigma[k]);
            let evidence = vec![("share", share), ("touches", number(touches.surrounded))];
            faults.push((TaxelState::Silent, None, evidence));
        }
        if let (true, Some((place, like))) = (judged.is_swapped[k], judged.best[k]) {
            let evidence = vec![
                ("away", number(touches.away)),
                ("touches", number(touches.own)),
                ("absent", number(touches.absent)),
                ("likeness", like),
                ("likeness_here", judged.own_like[k]),
            ];
            faults.push((TaxelState::Swapped, Some(place), evidence));
        }
        faults
    }

    fn summary(&self, findings: Vec<HealthFinding>, judged: &Judged) -> HealthReport {
        let is_tested = |k: usize| {
            let touches = &self.sight.touches[k];
            judged.is_judged[k] || (self.survey.is_ok[k] && touches.surrounded >= TOUCHES)
        };
        let mut heaviest = HashMap::<TaxelId, &HealthFinding>::new();
        for finding in &findings {
            for &id in &finding.taxels {
                let known = heaviest.entry(id).or_insert(finding);
                if finding.kind >= known.kind {
                    *known = finding;
                }
            }
        }
        // A response names an id once: of taxels of one id in several patches, the worst counts.
        let (mut taxels, mut places) = (Vec::<TaxelResponse>::new(), HashMap::<TaxelId, usize>::new());
        let mut untested = 0;
        for k in (0..self.around.len()).filter(|&k| self.around.is_present[k]) {
            let id = self.around.ids[k];
            let is_ok = self.is_read[k] && is_tested(k);
            let (state, other) = match heaviest.get(&id) {
                Some(finding) => (finding.kind, finding.other),
                None => (if is_ok { TaxelState::Ok } else { TaxelState::Untested }, None),
            };
            untested += usize::from(state == TaxelState::Untested);
            let place = *places.entry(id).or_insert(taxels.len());
            if place == taxels.len() {
                taxels.push(TaxelResponse { state, other, ..TaxelResponse::unknown(id) });
            } else if state == TaxelState::Untested {
                taxels[place].state = state;
            }
        }
        let read = self.is_read.iter().filter(|is_read| **is_read).count();
        let present = self.around.is_present.iter().filter(|is_present| **is_present).count();
        HealthReport {
            taxels: read,
            tested: present - untested,
            without_readings: present - read,
            frames: self.frames,
            recordings: self.recordings,
            threshold: self.survey.threshold,
            crowded: self.sight.pairs.crowded as usize,
            is_full: self.sight.pairs.is_full,
            response: Response { method: "health".into(), taxels, ..Response::default() },
            findings,
        }
    }
}
