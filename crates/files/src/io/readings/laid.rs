//! Frames of cells as readings, through a layout.

use std::path::Path;

use crate::io::IoError;
use crate::io::layout::{Decoder, KnownRest, Layout, Statement, StreamFacts, Times};
use crate::io::readings::header::About;
use crate::io::streams::{FileTime, Frames, OpenStream, layout_of};

/// Most numbers of the frames that are decoded at once, and most of these frames.
const MAX_NUMBERS: usize = 1 << 16;
const MAX_FRAMES: usize = 64;

pub(super) struct LaidReadings {
    frames: Box<dyn Frames>,
    decoder: Decoder,
    pub(super) facts: StreamFacts,
    /// Most frames that are decoded at once: each of a stream, which may be a live one, by itself.
    most: usize,
    /// The readings and times of some frames, and which of these comes next.
    values: Vec<f64>,
    seconds: Vec<f64>,
    next: usize,
    has_begun: bool,
    has_ended: bool,
    raw: Vec<f64>,
    /// The zeros beside these frames, if they have any.
    zeros: Vec<f64>,
    cells: Vec<f64>,
    /// The episode and the time of the frame in `cells`, if it comes next.
    ahead: Option<(u64, FileTime)>,
    /// The episode of the frames that were decoded.
    pub(super) episode: u64,
}

impl LaidReadings {
    /// Reads a stream by a layout, or by what its file states.
    pub(super) fn open(
        path: &Path,
        stream: OpenStream,
        layout: Option<&Layout>,
    ) -> Result<(Self, About), IoError> {
        let layout = layout_of(path, &stream, layout)?;
        let decoder = Decoder::new(&layout, path, &stream.facts)?;
        let about = About {
            ids: Some(decoder.ids().to_vec()),
            channels: decoder.channels().to_vec(),
            width: decoder.ids().len(),
            frames: stream.frames,
            has_times: true,
            ..About::default()
        };
        let laid = Self {
            frames: stream.source,
            decoder,
            most: if stream.frames.is_some() { MAX_FRAMES } else { 1 },
            facts: stream.facts,
            values: Vec::new(),
            seconds: Vec::new(),
            next: 0,
            has_begun: false,
            has_ended: false,
            raw: Vec::new(),
            zeros: Vec::new(),
            cells: Vec::new(),
            ahead: None,
            episode: 0,
        };
        Ok((laid, about))
    }

    /// Reads the next frame; false after the last one.
    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        if self.next == self.seconds.len() && !self.decode()? {
            return Ok(false);
        }
        let count = self.decoder.ids().len() * self.decoder.channels().len();
        values.clear();
        values.extend_from_slice(&self.values[self.next * count..][..count]);
        *time = self.seconds[self.next];
        self.next += 1;
        Ok(true)
    }

    /// Decodes the next frames; false if there are none.
    fn decode(&mut self) -> Result<bool, IoError> {
        let width: usize = self.facts.cells.iter().product();
        let few = (MAX_NUMBERS / width.max(1)).clamp(1, self.most);
        let mut wanted = few;
        self.raw.clear();
        self.zeros.clear();
        let (mut whole, mut real, mut count) = (Vec::new(), Vec::new(), 0);
        let mut tick = FileTime::None;
        let mut episode = self.episode;
        while count < wanted && !self.has_ended {
            if self.ahead.is_none() {
                if !self.frames.read(&mut self.cells, &mut tick)? {
                    self.has_ended = true;
                    break;
                }
                self.ahead = Some((self.frames.episode(), tick));
            }
            // A frame of another episode waits for the next call.
            let (of, at) = self.ahead.unwrap_or_default();
            if of != episode && count > 0 {
                break;
            }
            // The zero of an episode may be that of its first frames.
            if count == 0 && (of != self.episode || !self.has_begun) {
                wanted = self.decoder.frames_to_learn();
            }
            (self.ahead, episode, tick) = (None, of, at);
            self.raw.extend_from_slice(&self.cells);
            self.zeros.extend_from_slice(self.frames.zeros().unwrap_or_default());
            match tick {
                FileTime::None => {}
                FileTime::Whole(time) => whole.push(time),
                FileTime::Real(time) => real.push(time),
            }
            count += 1;
        }
        if count == 0 {
            return Ok(false);
        }
        let times = match (whole.is_empty(), real.is_empty()) {
            (false, _) => Times::Whole(&whole),
            (_, false) => Times::Real(&real),
            _ => Times::None,
        };
        self.values.clear();
        self.seconds.clear();
        self.episode = episode;
        let Self { decoder, raw, zeros, values, seconds, .. } = self;
        decoder.decode_beside(raw, zeros, times, episode, values, seconds)?;
        (self.next, self.has_begun) = (0, true);
        Ok(true)
    }

    /// What is known of readings where nothing touches.
    pub(super) fn rest(&self) -> KnownRest {
        self.decoder.rest(&self.facts)
    }

    /// How many episodes are read.
    pub(super) fn episodes(&self) -> u64 {
        self.frames.episodes()
    }

    /// What is known so far.
    pub(super) fn statements(&self) -> Vec<Statement> {
        let mut all = self.decoder.statements();
        all.extend(self.frames.statements());
        all
    }
}
