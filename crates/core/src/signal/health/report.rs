//! What a recording shows of the taxels.

use std::collections::HashMap;
use std::fmt;

use crate::id::VertexId;
use crate::signal::{Response, TaxelState};
use crate::skin::{PatchId, TaxelId, Taxels};

/// What recordings show of the taxels of a skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HealthReport {
    /// Faults, the kinds in the order of [`TaxelState`], the heaviest first.
    pub findings: Vec<HealthFinding>,
    /// Taxels that have readings.
    pub taxels: usize,
    /// How many of these were touched so often that they can be judged, or are faulty.
    pub tested: usize,
    /// Taxels of the skin that the recordings do not have.
    pub without_readings: usize,
    /// Frames of all recordings.
    pub frames: usize,
    /// Recordings.
    pub recordings: usize,
    /// A reading above it, less its zero, is a touch; in the unit of the readings.
    pub threshold: f64,
    /// Frames that are left out, since too many taxels were touched at once to judge single ones.
    pub crowded: usize,
    /// Whether more pairs of taxels were touched at once than can be compared.
    pub is_full: bool,
    /// The state of each taxel that is present.
    pub response: Response,
}

/// A fault of one taxel, or of a module.
#[derive(Debug, Clone, PartialEq)]
pub struct HealthFinding {
    /// The fault.
    pub kind: TaxelState,
    /// The patch.
    pub patch: PatchId,
    /// The taxels: one, or those of a module.
    pub vertices: Vec<VertexId>,
    /// Their ids.
    pub taxels: Vec<TaxelId>,
    /// The taxel whose place fits the signals of a swapped one, or whose signals leak into this one.
    pub other: Option<TaxelId>,
    /// The numbers that show it, with their names.
    pub evidence: Vec<(&'static str, f64)>,
}

impl HealthReport {
    /// A sentence for each finding, with its patch where several patches have the same id; `patches` are those of the skin,
    /// their names and taxels.
    pub fn sentences<'a>(&self, patches: impl IntoIterator<Item = (&'a str, &'a Taxels)>) -> Vec<String> {
        let patches: Vec<(&str, &Taxels)> = patches.into_iter().collect();
        let mut counts = HashMap::<TaxelId, usize>::new();
        let ids = patches.iter().flat_map(|(_, taxels)| taxels.ids.iter());
        ids.for_each(|id| *counts.entry(*id).or_default() += 1);
        let is_shared = |id: &TaxelId| counts.get(id).is_some_and(|count| *count > 1);
        let sentence = |finding: &HealthFinding| match finding.taxels.iter().any(is_shared) {
            true => format!("{}: {finding}", patches[finding.patch.index()].0),
            false => finding.to_string(),
        };
        self.findings.iter().map(sentence).collect()
    }
}

impl HealthFinding {
    /// A number that shows it.
    pub fn evidence(&self, name: &str) -> Option<f64> {
        self.evidence.iter().find(|(other, _)| *other == name).map(|(_, x)| *x)
    }
}

impl fmt::Display for HealthFinding {
    /// A sentence: `taxel 12 is swapped: its signals fit the place of taxel 40 (away 5, ...)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let first = self.taxels.first().copied().unwrap_or_default();
        let other = self.other.unwrap_or_default();
        match self.taxels.len() {
            1 => write!(f, "taxel {first} ")?,
            n => write!(f, "the module of taxel {first}, {n} taxels, ")?,
        }
        match self.kind {
            TaxelState::Dead => write!(f, "is dead: it has no reading, or always the same")?,
            TaxelState::Stuck => write!(f, "is stuck: it repeats one reading")?,
            TaxelState::Noisy => write!(f, "is noisy")?,
            TaxelState::Jumping => write!(f, "jumps while nothing touches around it")?,
            TaxelState::Chattering => write!(f, "chatters: it jumps alone from frame to frame")?,
            TaxelState::Saturated => {
                write!(f, "is saturated: it reaches its largest reading again and again")?
            }
            TaxelState::Silent => write!(f, "is silent where all around it react")?,
            TaxelState::Swapped => write!(f, "is swapped: its signals fit the place of taxel {other}")?,
            TaxelState::Turned => write!(f, "is turned")?,
            TaxelState::ModuleStep => write!(f, "is offset, and those around it are not")?,
            TaxelState::Crosstalk => write!(f, "has crosstalk: the signals of taxel {other} leak into it")?,
            TaxelState::Ok | TaxelState::Untested => write!(f, "is {}", self.kind)?,
        }
        let numbers = self.evidence.iter().map(|(name, x)| format!("{name} {}", (x * 1e4).round() / 1e4));
        write!(f, " ({})", numbers.collect::<Vec<_>>().join(", "))
    }
}
