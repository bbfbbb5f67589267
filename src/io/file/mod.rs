//! What every reader and writer needs of a file, whatever its format: [`source`] reads it whole,
//! [`lines`] line by line, [`replace`] writes it whole or not at all.

pub(super) mod lines;
pub(super) mod replace;
pub(super) mod source;

pub(super) use lines::{LONGEST, LineLocation, Lines, finite};
pub(super) use replace::{cannot_write, replace_file, write_file, write_to};
pub(super) use source::{Source, excerpt, file_kind, invalid, stem, unfit};
