//! Observations while they are read: what they name, what is out of range, and remarks.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use crate::calib::{
    ContactMeasurement, ContactObservation, Displacement, DisplacementMeasurement, Information, Model,
    Observations, Pose, TaxelVariable, TouchJoint, TouchRow,
};
use crate::id::VertexId;
use crate::io::error::Result;
use crate::io::file::{LineLocation, invalid};
use crate::mesh::FARTHEST;
use crate::skin::TaxelId;

/// Largest entry of an information matrix, in 1/m^2 or 1/rad^2: a standard deviation of 1 nm. With
/// [`FARTHEST`] a squared error stays below 1e43, so that sums are finite.
const MOST_INFORMATION: f64 = 1e18;

/// Standard deviations in m or rad: the smallest gives [`MOST_INFORMATION`], the largest means
/// nothing of what is within [`FARTHEST`].
pub(super) const SIGMA_RANGE: RangeInclusive<f64> = 1e-9..=1e9;

/// Observations while they are read: taxels may be declared after the lines that name them.
#[derive(Default)]
pub(super) struct ObservationsBuilder {
    path: PathBuf,
    observations: Observations,
    model_known: bool,
    index: HashMap<TaxelId, VertexId>,
    edges: Vec<(TaxelId, TaxelId, usize, DisplacementMeasurement)>,
    contacts: Vec<(TaxelId, usize, ContactMeasurement)>,
    fixed: Vec<(TaxelId, usize)>,
    unknown_tags: BTreeMap<String, usize>,
    normalised: usize,
    worst: f64,
    /// Line and name of the first indefinite information, and how many there are.
    indefinite: Option<(usize, String, usize)>,
    pub(super) assumed_sigma: Option<f64>,
}

impl ObservationsBuilder {
    pub(super) fn new(path: &Path) -> Self {
        Self { path: path.into(), worst: 1.0, ..Self::default() }
    }

    pub(super) fn set_model(&mut self, model: Model, at: &LineLocation<'_>) -> Result<()> {
        if self.model_known && self.observations.model != model {
            let needed = format!("{}, as the lines before: one model in a file", self.observations.model);
            return Err(at.invalid(format!("a line of the {} model", model), needed));
        }
        (self.observations.model, self.model_known) = (model, true);
        Ok(())
    }

    pub(super) fn taxel(&mut self, id: TaxelId, initial: Pose, at: &LineLocation<'_>) -> Result<()> {
        check_length(initial.position, at)?;
        let vertex =
            self.observations.taxels.push(TaxelVariable { id, initial: Some(initial), fixed: false });
        match self.index.insert(id, vertex) {
            Some(_) => Err(at.invalid(format!("taxel {id} a second time"), "every taxel declared once")),
            None => Ok(()),
        }
    }

    pub(super) fn edge(
        &mut self,
        [from, to]: [TaxelId; 2],
        motion: DisplacementMeasurement,
        at: &LineLocation<'_>,
    ) -> Result<()> {
        if from == to {
            return Err(at.invalid(format!("an edge from taxel {from} to itself"), "two different taxels"));
        }
        let name = || format!("edge {from} to {to}");
        match &motion {
            DisplacementMeasurement::Offset { offset, information } => {
                check_length(*offset, at)?;
                self.check_information(information, name, at)?;
            }
            DisplacementMeasurement::Relative(m) => self.check_information(&m.information, name, at)?,
        }
        self.edges.push((from, to, at.line, motion));
        Ok(())
    }

    /// Refuses information that is too large, and counts what is not positive semi-definite.
    fn check_information<const N: usize>(
        &mut self,
        information: &Information<N>,
        name: impl Fn() -> String,
        at: &LineLocation<'_>,
    ) -> Result<()> {
        let largest = information.upper().fold(0.0, |most: f64, x| most.max(x.abs()));
        if largest > MOST_INFORMATION {
            let found = format!("an information of {largest:e} for {}", name());
            let needed = format!("at most {MOST_INFORMATION:e}, a standard deviation of 1 nm or 1e-9 rad");
            return Err(at.invalid(found, needed));
        }
        if !information.is_positive_semidefinite() {
            self.indefinite.get_or_insert_with(|| (at.line, name(), 0)).2 += 1;
        }
        Ok(())
    }

    pub(super) fn contact(
        &mut self,
        id: TaxelId,
        touch: ContactMeasurement,
        at: &LineLocation<'_>,
    ) -> Result<()> {
        let name = || format!("taxel {id}");
        match &touch {
            ContactMeasurement::Position { position, information }
            | ContactMeasurement::PositionNormal { position, information, .. } => {
                check_length(*position, at)?;
                self.check_information(information, name, at)?;
            }
            ContactMeasurement::Pose { seen, .. } => self.check_information(&seen.information, name, at)?,
        }
        self.contacts.push((id, at.line, touch));
        Ok(())
    }

    /// Whether no observation was read.
    pub(super) fn is_empty(&self) -> bool {
        self.edges.is_empty() && self.contacts.is_empty()
    }

    /// The touch of the next contact, with the joints of the table.
    pub(super) fn touch(&mut self, row: TouchRow, joints: &[TouchJoint]) {
        if self.observations.touches.is_empty() {
            self.observations.joints = joints.to_vec();
        }
        self.observations.touches.push(row);
    }

    pub(super) fn fix(&mut self, id: TaxelId, at: &LineLocation<'_>) {
        self.fixed.push((id, at.line));
    }

    pub(super) fn unknown_tag(&mut self, tag: &str) {
        // A damaged file could have a different tag in every line, and a line may be all one word.
        const MOST_TAGS: usize = 64;
        const LONGEST_TAG: usize = 60;
        if let Some(lines) = self.unknown_tags.get_mut(tag) {
            *lines += 1;
        } else if self.unknown_tags.len() < MOST_TAGS && tag.len() <= LONGEST_TAG {
            self.unknown_tags.insert(tag.to_owned(), 1);
        } else {
            *self.unknown_tags.entry("(other)".to_owned()).or_default() += 1;
        }
    }

    /// A pose from `x y z qx qy qz qw`; the quaternion is normalised.
    pub(super) fn pose(&mut self, numbers: &[f64], at: &LineLocation<'_>) -> Result<Pose> {
        let &[x, y, z, qx, qy, qz, qw] = numbers else {
            return Err(at.invalid(format!("{} numbers", numbers.len()), "x y z qx qy qz qw"));
        };
        let position = DVec3::new(x, y, z);
        check_length(position, at)?;
        let q = DQuat::from_xyzw(qx, qy, qz, qw);
        let length = q.length();
        if !(length > SHORTEST_QUATERNION && length.is_finite()) {
            return Err(at.invalid(format!("a quaternion of length {length}"), "a unit quaternion"));
        }
        // Files round to six digits; only what is farther off is worth a remark.
        if (length - 1.0).abs() > FILE_ROUNDING {
            self.normalised += 1;
            if (length - 1.0).abs() > (self.worst - 1.0).abs() {
                self.worst = length;
            }
        }
        // A unit quaternion of 17 digits must read back to the same bits.
        let rotation = if (length - 1.0).abs() > 4.0 * f64::EPSILON { q / length } else { q };
        Ok(Pose { position, rotation })
    }

    pub(super) fn finish(mut self) -> Result<ReadObservations> {
        let declared = !self.observations.taxels.is_empty();
        if !declared {
            self.declare_named_taxels();
        }
        let left_out = left_out(&self.unknown_tags);
        let Self { path, mut observations, index, .. } = self;
        let find = |id: TaxelId, line: usize| {
            index.get(&id).copied().ok_or_else(|| {
                let needed = "a taxel that a VERTEX line declares";
                LineLocation { path: &path, line }.invalid(format!("taxel {id}{left_out}"), needed)
            })
        };
        for (id, line) in self.fixed {
            if !declared {
                let found = format!("FIX {id}{left_out}");
                return Err(
                    LineLocation { path: &path, line }.invalid(found, "a VERTEX line with its fixed pose")
                );
            }
            observations.taxels[find(id, line)?].fixed = true;
        }
        for (from, to, line, motion) in self.edges {
            let (from, to) = (find(from, line)?, find(to, line)?);
            observations.edges.push(Displacement { from, to, measurement: motion });
        }
        for (id, line, touch) in self.contacts {
            let taxel = find(id, line)?;
            observations.contacts.push(ContactObservation { taxel, measurement: touch });
        }
        if observations.edges.is_empty() && observations.contacts.is_empty() {
            let found = format!("{} taxels and no observation{left_out}", observations.taxels.len());
            return Err(invalid(&path, "the file", found, "edges between taxels, or contacts"));
        }
        let unknown = |(tag, lines)| ObservationRemark::UnknownTag { tag, lines };
        let mut remarks: Vec<_> = self.unknown_tags.into_iter().map(unknown).collect();
        if self.normalised > 0 {
            remarks.push(ObservationRemark::Normalised { quaternions: self.normalised, worst: self.worst });
        }
        remarks.extend(self.indefinite.map(|(line, name, count)| ObservationRemark::Indefinite {
            line,
            name,
            count,
        }));
        remarks.extend(self.assumed_sigma.map(|sigma| ObservationRemark::AssumedSigma { sigma }));
        Ok((observations, remarks))
    }

    /// Without declarations the taxels are those that are named, in ascending order.
    fn declare_named_taxels(&mut self) {
        let mut ids: Vec<TaxelId> = self.edges.iter().flat_map(|e| [e.0, e.1]).collect();
        ids.extend(self.contacts.iter().map(|c| c.0));
        ids.sort_unstable();
        ids.dedup();
        for id in ids {
            let vertex = self.observations.taxels.push(TaxelVariable { id, initial: None, fixed: false });
            self.index.insert(id, vertex);
        }
    }
}

/// Below this length a quaternion has no direction that could be trusted.
const SHORTEST_QUATERNION: f64 = 1e-3;

/// Quaternions written with six digits are off by this much.
const FILE_ROUNDING: f64 = 3e-6;

/// The end of an error message: lines of unknown kinds, which may be why something is missing.
fn left_out(tags: &BTreeMap<String, usize>) -> String {
    // More would hide the error itself.
    const MOST_NAMED: usize = 3;
    let Some(lines) = tags.values().copied().reduce(|a, b| a + b) else { return String::new() };
    let named: Vec<String> =
        tags.iter().take(MOST_NAMED).map(|(tag, lines)| format!("{tag} ({lines})")).collect();
    let (s, named) = (if lines == 1 { "" } else { "s" }, named.join(", "));
    let more = match tags.len().saturating_sub(MOST_NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    format!("; {lines} line{s} of unknown tags: {named}{more}")
}

fn check_length(vector: DVec3, at: &LineLocation<'_>) -> Result<()> {
    match vector.abs().max_element() {
        x if x <= FARTHEST => Ok(()),
        x => Err(at.invalid(format!("a length of {x:e} m"), format!("metres, at most {FARTHEST:e}"))),
    }
}

/// The information of a standard deviation in m or rad, if that is within [`SIGMA_RANGE`].
pub(super) fn information_of(sigma: f64) -> Option<f64> {
    // 1e-9 squared and inverted is not quite 1e18.
    SIGMA_RANGE.contains(&sigma).then(|| sigma.powi(-2).min(MOST_INFORMATION))
}

/// Observations of a file, and what was changed, left out or assumed to read them.
pub(super) type ReadObservations = (Observations, Vec<ObservationRemark>);

/// A remark on a file of observations; `Display` is a sentence.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages explain the fields")]
pub enum ObservationRemark {
    /// Lines of a kind that is not known here.
    UnknownTag { tag: String, lines: usize },
    /// Quaternions that were not of unit length.
    Normalised {
        quaternions: usize,
        /// The length farthest from 1.
        worst: f64,
    },
    /// Information matrices that are not positive semi-definite.
    Indefinite { line: usize, name: String, count: usize },
    /// A table gives no uncertainty.
    AssumedSigma { sigma: f64 },
}

impl fmt::Display for ObservationRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownTag { tag, lines } => {
                let (s, were) = if *lines == 1 { ("", "was") } else { ("s", "were") };
                write!(f, "{lines} line{s} of the unknown kind {tag} {were} left out")
            }
            Self::Normalised { quaternions, worst } => {
                write!(f, "{quaternions} quaternions were normalised, the worst had length {worst}")
            }
            Self::Indefinite { line, name, count } => {
                write!(f, "line {line}: the information of {name} is not positive semi-definite")?;
                match count {
                    1 => Ok(()),
                    2 => write!(f, "; 1 more is not"),
                    _ => write!(f, "; {} more are not", count - 1),
                }
            }
            Self::AssumedSigma { sigma } => {
                write!(f, "the table gives no uncertainty; {} mm per axis was assumed", sigma * 1e3)
            }
        }
    }
}
