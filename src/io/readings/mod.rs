//! Recordings and live streams of readings, frame by frame, in memory that does not depend on their
//! length.
//!
//! In reading order: `text` reads lines of numbers (CySkin's text and CSV, from a file or a pipe),
//! `header` says what their columns are; `long` reads tables with a row for each reading; `arrays` reads recordings of numpy's arrays; `reader` is the
//! one type for all of them. `writer` writes recordings that it reads.

pub(super) mod arrays;
mod header;
mod long;
pub(super) mod reader;
mod text;
pub(super) mod writer;
