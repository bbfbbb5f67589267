//! What a user should know of a file of observations.

use std::fmt;

/// Something about a file of observations that a user should know; `Display` is a sentence.
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
    /// Information matrices that are not positive semi-definite.
    Indefinite {
        /// Line of the first one, from 1.
        line: usize,
        /// What it is the information of.
        name: String,
        /// How many there are.
        count: usize,
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
