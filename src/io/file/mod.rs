//! What every reader and writer needs of a file, whatever its format.

pub(super) mod extension;
pub(super) mod json;
pub(super) mod lines;
pub(super) mod replace;
pub(super) mod source;
