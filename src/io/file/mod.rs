//! What every reader and writer needs of a file, whatever its format: [`source`] reads it whole,
//! [`lines`] line by line, [`replace`] writes it whole or not at all.

pub(super) mod lines;
pub(super) mod replace;
pub(super) mod source;
