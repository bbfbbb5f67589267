//! A stream of frames that is open, and what is known of it.

use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use crate::io::IoError;
use crate::io::file::invalid;
use crate::io::layout::{Layout, Statement, StatementSource, StreamFacts};
use crate::skin::{Draft, Sheet as SkinSheet, TaxelId};

/// When a frame was taken, as its file has it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(in crate::io) enum FileTime {
    #[default]
    None,
    Whole(i64),
    Real(f64),
}

/// Frames of cells, one after the other.
pub(in crate::io) trait Frames: Send {
    /// Reads the next frame; false after the last one. A cell without a reading is NaN.
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError>;

    /// The zero of each cell of the frame that was read last, where the file has one of its own for it.
    fn zeros(&self) -> Option<&[f64]> {
        None
    }

    /// The episode of the frame that was read last.
    fn episode(&self) -> u64 {
        0
    }

    /// How many episodes are read.
    fn episodes(&self) -> u64 {
        1
    }

    /// What reading has shown so far.
    fn statements(&self) -> Vec<Statement> {
        Vec::new()
    }
}

/// Which stream of a file is wanted.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::io) struct Wanted<'a> {
    /// Its name; without one that of the layout, or the only one.
    pub(in crate::io) stream: Option<&'a str>,
    pub(in crate::io) layout: Option<&'a Layout>,
    /// The number of the episode that is read; without one that of the layout, or all.
    pub(in crate::io) episode: Option<u64>,
}

/// What the only stream of a file may be called.
const ONLY: [&str; 3] = ["frames", "values", "data.log"];

impl Wanted<'_> {
    /// The episodes that are read of `count`, which the facts state.
    pub(in crate::io) fn episodes(
        &self,
        path: &Path,
        count: usize,
        facts: &mut StreamFacts,
    ) -> Result<Range<usize>, IoError> {
        let Some(wanted) = self.episode.or(self.layout.and_then(Layout::episode)) else {
            if count > 1 {
                let value = format!("{count}, one after the other; times are those of each");
                facts.notes.push(Statement::new("episodes", value, StatementSource::File));
            }
            return Ok(0..count);
        };
        match usize::try_from(wanted).ok().filter(|wanted| *wanted < count) {
            Some(wanted) => {
                facts.notes.push(Statement::new("episode", wanted.to_string(), StatementSource::Argument));
                Ok(wanted..wanted + 1)
            }
            None => {
                let needed = format!("0 to {}, as the file has", count.saturating_sub(1));
                Err(invalid(path, "episode", wanted.to_string(), needed))
            }
        }
    }

    /// Chooses one of some streams, each with the shape of its frames.
    pub(in crate::io) fn choose(
        &self,
        path: &Path,
        streams: &[(String, Vec<usize>)],
    ) -> Result<usize, IoError> {
        let layout = self.layout.and_then(Layout::stream);
        let name = self.stream.or(layout).filter(|name| streams.len() > 1 || !ONLY.contains(name));
        let places = streams.iter().position(|(known, _)| Some(known.as_str()) == name);
        match (name, places, streams.len()) {
            (_, Some(place), _) => Ok(place),
            (None, _, 1) => Ok(0),
            // The layout may call the only stream of a text as it likes.
            (Some(_), None, 1) if self.stream.is_none() && streams[0].0.is_empty() => Ok(0),
            (name, ..) => {
                let list = streams.iter().map(|(name, shape)| format!("{name:?} of {shape:?}"));
                let found = match name {
                    Some(name) => format!("no stream {name:?}"),
                    None => format!("{} streams", streams.len()),
                };
                Err(IoError::Streams { path: path.into(), found, known: list.collect() })
            }
        }
    }
}

/// A stream that is open.
pub(in crate::io) struct OpenStream {
    pub(in crate::io) facts: StreamFacts,
    pub(in crate::io) frames: Option<u64>,
    /// Where its cells are.
    pub(in crate::io) sheet: Option<Sheet>,
    pub(in crate::io) source: Box<dyn Frames>,
}

/// The cells of a stream in the plane.
#[derive(Debug, Clone, Default)]
pub(in crate::io) struct Sheet {
    pub(in crate::io) ids: Vec<TaxelId>,
    /// In m.
    pub(in crate::io) centres: Vec<DVec3>,
    /// In m^2.
    pub(in crate::io) areas: Vec<f64>,
}

impl Sheet {
    /// The cells of a grid that have sensors, with ids from 1 on through all cells; rows go down.
    pub(super) fn grid([rows, cols]: [usize; 2], pitch: [f64; 2], sensors: &[bool]) -> Self {
        let mut sheet = Self::default();
        for cell in (0..rows * cols).filter(|&cell| sensors.get(cell).copied().unwrap_or(true)) {
            let (row, col) = (cell / cols, cell % cols);
            sheet.ids.push(TaxelId(u32::try_from(cell + 1).unwrap_or(u32::MAX)));
            sheet.centres.push(DVec3::new(col as f64 * pitch[1], -(row as f64 * pitch[0]), 0.0));
            sheet.areas.push(pitch[0] * pitch[1]);
        }
        sheet
    }

    /// What a file states of the height and width of a cell, in m.
    pub(super) fn pitch_note(pitch: [f64; 2]) -> Statement {
        let [height, width] = pitch.map(|side| 1e3 * side);
        Statement::new("pitch", format!("{height} x {width} mm"), StatementSource::File)
    }

    /// The taxels, without triangles.
    pub(in crate::io) fn into_draft(self) -> Draft {
        let sheet = SkinSheet {
            name: "skin".into(),
            normals: Some(vec![DVec3::Z; self.centres.len()]),
            positions: self.centres,
            ids: Some(self.ids),
            areas: Some(self.areas),
            ..SkinSheet::default()
        };
        Draft { sheets: vec![sheet], ..Draft::default() }
    }
}
