//! Observations for the calibration: g2o text and CSV tables.

use std::{
    collections::{BTreeMap, HashMap},
    fmt,
    fs::File,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
};

use glam::{DQuat, DVec3};

use crate::{
    calib::{Contact, Displacement, Model, Motion, Observations, Pose, Touch, Unknown},
    id::{TaxelId, VertexId},
    io::{IoError, observations_csv, observations_g2o, replace_file},
};

/// Observations as a file tells them, and what had to be changed to read them.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadObservations {
    /// The observations.
    pub observations: Observations,
    /// What was changed, left out or assumed.
    pub remarks: Vec<ObservationRemark>,
}

/// Something about a file of observations that a user should know; `Display` tells it in a sentence.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ObservationRemark {
    /// Lines of a kind that is not known here.
    UnknownTag {
        /// First word of the lines.
        tag: String,
        /// How many there are.
        lines: usize,
    },
    /// Quaternions that were not of unit length.
    Normalised {
        /// How many.
        quaternions: usize,
        /// The length farthest from 1.
        worst: f64,
    },
    /// A table gives no uncertainty.
    AssumedSigma {
        /// The standard deviation assumed instead, in m.
        sigma: f64,
    },
}

impl fmt::Display for ObservationRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownTag { tag, lines } => {
                write!(f, "{lines} lines of the unknown kind {tag} were left out")
            }
            Self::Normalised { quaternions, worst } => {
                write!(f, "{quaternions} quaternions were normalised, the worst had length {worst}")
            }
            Self::AssumedSigma { sigma } => {
                write!(f, "the table gives no uncertainty; {} mm per axis was assumed", sigma * 1e3)
            }
        }
    }
}

/// What files of observations may end in.
const KINDS: &str = ".g2o, .csv";

/// Reads observations: `.g2o`, or `.csv` with the columns `i,j,dx,dy,dz` or `i,x,y,z`; `-` is standard input.
///
/// # Errors
/// The first line that breaks a rule of its format, with its number.
pub fn read_observations(path: &Path) -> Result<ReadObservations, IoError> {
    let fail = |source| IoError::Read { path: path.to_owned(), source };
    if path == Path::new("-") {
        let mut input = std::io::stdin().lock();
        // Every line of g2o begins with a capital; a header of a table with a small letter.
        let is_table = input.fill_buf().map_err(fail)?.first().is_some_and(u8::is_ascii_lowercase);
        return if is_table {
            observations_csv::read(input, path)
        } else {
            observations_g2o::read(input, path)
        };
    }
    let kind = path.extension().map(|e| e.to_ascii_lowercase());
    let open = || File::open(path).map(BufReader::new).map_err(fail);
    match kind.as_ref().and_then(|k| k.to_str()) {
        Some("g2o") => observations_g2o::read(open()?, path),
        Some("csv") => observations_csv::read(open()?, path),
        _ => Err(IoError::UnknownKind { path: path.to_owned(), known: KINDS }),
    }
}

/// Writes observations as g2o text with 17 digits, which read back to the same bits.
///
/// # Errors
/// [`IoError::Write`]; [`IoError::Unsupported`] for contacts with normals, which g2o has no line for.
pub fn write_observations(path: &Path, observations: &Observations) -> Result<(), IoError> {
    replace_file(path, |out| observations_g2o::write(out, observations, path))
}

/// Writes the contacts alone as a table `i,x,y,z[,nx,ny,nz],...`.
///
/// # Errors
/// [`IoError::Write`]; [`IoError::Unsupported`] for full poses, which the table has no columns for.
pub fn write_contacts(path: &Path, observations: &Observations) -> Result<(), IoError> {
    replace_file(path, |out| observations_csv::write_contacts(out, observations, path))
}

/// Appends the observations of another file, as contacts come in a table of their own.
///
/// # Errors
/// [`IoError::Invalid`] if it names a taxel that `into` does not have.
pub fn append_observations(
    into: &mut ReadObservations,
    other: ReadObservations,
    path: &Path,
) -> Result<(), IoError> {
    let known: HashMap<TaxelId, VertexId> =
        into.observations.taxels.enumerate().map(|(v, t)| (t.id, v)).collect();
    let taxels = &other.observations.taxels;
    let place = |v: VertexId| {
        known.get(&taxels[v].id).copied().ok_or_else(|| IoError::Invalid {
            path: path.to_owned(),
            element: format!("taxel {}", taxels[v].id),
            found: "an observation of it".into(),
            needed: "a taxel of the other file".into(),
        })
    };
    for contact in &other.observations.contacts {
        let taxel = place(contact.taxel)?;
        into.observations.contacts.push(Contact { taxel, touch: contact.touch.clone() });
    }
    for edge in &other.observations.edges {
        let (from, to) = (place(edge.from)?, place(edge.to)?);
        into.observations.edges.push(Displacement { from, to, motion: edge.motion.clone() });
    }
    into.remarks.extend(other.remarks);
    Ok(())
}

/// Longest line that is read: a line of an edge has 31 numbers of at most 25 characters.
const LONGEST_LINE: u64 = 1 << 16;

/// Reads one line without its end; `false` at the end of the file.
pub(super) fn next_line(
    input: &mut impl BufRead,
    line: &mut String,
    at: &Place<'_>,
) -> Result<bool, IoError> {
    line.clear();
    let mut bytes = std::mem::take(line).into_bytes();
    let read = std::io::Read::take(&mut *input, LONGEST_LINE).read_until(b'\n', &mut bytes);
    let read = read.map_err(|source| IoError::Read { path: at.path.to_owned(), source })?;
    if read as u64 == LONGEST_LINE {
        return Err(at.invalid("a line of more than 65536 bytes", "a line of text"));
    }
    *line = String::from_utf8(bytes).map_err(|_| at.invalid("bytes that are no text", "text in UTF-8"))?;
    Ok(read > 0)
}

/// A line of a file, for messages.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) path: &'a Path,
    pub(super) line: usize,
}

impl Place<'_> {
    pub(super) fn invalid(&self, found: impl Into<String>, needed: impl Into<String>) -> IoError {
        IoError::Invalid {
            path: PathBuf::from(self.path),
            element: format!("line {}", self.line),
            found: found.into(),
            needed: needed.into(),
        }
    }

    /// A finite number.
    pub(super) fn number(&self, word: &str) -> Result<f64, IoError> {
        match word.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(self.invalid(format!("{word:?}"), "a finite number")),
        }
    }

    /// The number of a taxel.
    pub(super) fn taxel(&self, word: &str) -> Result<TaxelId, IoError> {
        let needed = "the number of a taxel, 0 to 4294967295";
        word.parse().map(TaxelId).map_err(|_| self.invalid(format!("{word:?}"), needed))
    }
}

/// Observations while they are read: taxels may be declared after the lines that name them.
pub(super) struct Builder<'a> {
    path: &'a Path,
    observations: Observations,
    model_known: bool,
    index: HashMap<TaxelId, VertexId>,
    edges: Vec<(TaxelId, TaxelId, usize, Motion)>,
    contacts: Vec<(TaxelId, usize, Touch)>,
    fixed: Vec<(TaxelId, usize)>,
    unknown_tags: BTreeMap<String, usize>,
    normalised: usize,
    worst: f64,
    pub(super) assumed_sigma: Option<f64>,
}

impl<'a> Builder<'a> {
    pub(super) fn new(path: &'a Path) -> Self {
        Self {
            path,
            observations: Observations::default(),
            model_known: false,
            index: HashMap::new(),
            edges: Vec::new(),
            contacts: Vec::new(),
            fixed: Vec::new(),
            unknown_tags: BTreeMap::new(),
            normalised: 0,
            worst: 1.0,
            assumed_sigma: None,
        }
    }

    /// One file has one model.
    pub(super) fn set_model(&mut self, model: Model, at: &Place<'_>) -> Result<(), IoError> {
        if self.model_known && self.observations.model != model {
            let needed =
                format!("{}, as the lines before: one model in a file", self.observations.model.name());
            return Err(at.invalid(format!("a line of the {} model", model.name()), needed));
        }
        (self.observations.model, self.model_known) = (model, true);
        Ok(())
    }

    pub(super) fn taxel(&mut self, id: TaxelId, initial: Pose, at: &Place<'_>) -> Result<(), IoError> {
        let vertex = self.observations.taxels.push(Unknown { id, initial: Some(initial), fixed: false });
        match self.index.insert(id, vertex) {
            Some(_) => Err(at.invalid(format!("taxel {id} a second time"), "every taxel declared once")),
            None => Ok(()),
        }
    }

    pub(super) fn edge(
        &mut self,
        [from, to]: [TaxelId; 2],
        motion: Motion,
        at: &Place<'_>,
    ) -> Result<(), IoError> {
        if from == to {
            return Err(at.invalid(format!("an edge from taxel {from} to itself"), "two different taxels"));
        }
        let definite = match &motion {
            Motion::Offset { information, .. } => information.is_positive_semidefinite(),
            Motion::Relative(m) => m.information.is_positive_semidefinite(),
        };
        if !definite {
            return Err(at.invalid(
                format!("an information matrix of edge {from} to {to} with a negative eigenvalue"),
                "a positive semi-definite matrix, upper triangle row by row",
            ));
        }
        self.edges.push((from, to, at.line, motion));
        Ok(())
    }

    pub(super) fn contact(&mut self, id: TaxelId, touch: Touch, at: &Place<'_>) -> Result<(), IoError> {
        let definite = match &touch {
            Touch::Position { information, .. } | Touch::PositionNormal { information, .. } => {
                information.is_positive_semidefinite()
            }
            Touch::Pose(prior) => prior.information.is_positive_semidefinite(),
        };
        if !definite {
            return Err(at.invalid(
                format!("an information matrix of taxel {id} with a negative eigenvalue"),
                "a positive semi-definite matrix, upper triangle row by row",
            ));
        }
        self.contacts.push((id, at.line, touch));
        Ok(())
    }

    pub(super) fn fix(&mut self, id: TaxelId, at: &Place<'_>) {
        self.fixed.push((id, at.line));
    }

    pub(super) fn unknown_tag(&mut self, tag: &str) {
        // A damaged file could hold a different tag in every line.
        const MOST_TAGS: usize = 64;
        if let Some(lines) = self.unknown_tags.get_mut(tag) {
            *lines += 1;
        } else if self.unknown_tags.len() < MOST_TAGS {
            self.unknown_tags.insert(tag.to_owned(), 1);
        } else {
            *self.unknown_tags.entry("(other)".to_owned()).or_default() += 1;
        }
    }

    /// A pose from `x y z qx qy qz qw`; the quaternion is normalised.
    pub(super) fn pose(&mut self, numbers: &[f64], at: &Place<'_>) -> Result<Pose, IoError> {
        let &[x, y, z, qx, qy, qz, qw] = numbers else {
            return Err(at.invalid(format!("{} numbers", numbers.len()), "x y z qx qy qz qw"));
        };
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
        Ok(Pose { position: DVec3::new(x, y, z), rotation })
    }

    pub(super) fn finish(mut self) -> Result<ReadObservations, IoError> {
        let declared = !self.observations.taxels.is_empty();
        if !declared {
            self.declare_named_taxels();
        }
        let Self { path, mut observations, index, .. } = self;
        let find = |id: TaxelId, line: usize| {
            index.get(&id).copied().ok_or_else(|| {
                Place { path, line }.invalid(format!("taxel {id}"), "a taxel that a VERTEX line declares")
            })
        };
        for (id, line) in self.fixed {
            let vertex = find(id, line)?;
            if !declared {
                let place = Place { path, line };
                return Err(place.invalid(format!("FIX {id}"), "a VERTEX line that says where it is fixed"));
            }
            observations.taxels[vertex].fixed = true;
        }
        for (from, to, line, motion) in self.edges {
            let (from, to) = (find(from, line)?, find(to, line)?);
            observations.edges.push(Displacement { from, to, motion });
        }
        for (id, line, touch) in self.contacts {
            let taxel = find(id, line)?;
            observations.contacts.push(Contact { taxel, touch });
        }
        if observations.edges.is_empty() && observations.contacts.is_empty() {
            return Err(IoError::Invalid {
                path: path.to_owned(),
                element: "the file".into(),
                found: format!("{} taxels and no observation", observations.taxels.len()),
                needed: "edges between taxels, or contacts".into(),
            });
        }
        let mut remarks: Vec<_> = self
            .unknown_tags
            .into_iter()
            .map(|(tag, lines)| ObservationRemark::UnknownTag { tag, lines })
            .collect();
        if self.normalised > 0 {
            remarks.push(ObservationRemark::Normalised { quaternions: self.normalised, worst: self.worst });
        }
        remarks.extend(self.assumed_sigma.map(|sigma| ObservationRemark::AssumedSigma { sigma }));
        Ok(ReadObservations { observations, remarks })
    }

    /// Without declarations the taxels are those that are named, in ascending order.
    fn declare_named_taxels(&mut self) {
        let mut ids: Vec<TaxelId> = self.edges.iter().flat_map(|e| [e.0, e.1]).collect();
        ids.extend(self.contacts.iter().map(|c| c.0));
        ids.sort_unstable();
        ids.dedup();
        for id in ids {
            let vertex = self.observations.taxels.push(Unknown { id, initial: None, fixed: false });
            self.index.insert(id, vertex);
        }
    }
}

/// Below this length a quaternion has no direction that could be trusted.
const SHORTEST_QUATERNION: f64 = 1e-3;

/// Quaternions written with six digits are off by this much.
const FILE_ROUNDING: f64 = 3e-6;
