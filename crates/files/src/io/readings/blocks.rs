//! A recording in memory, and blocks of one that another program reads, as they come.

use std::path::{Path, PathBuf};

use crate::io::IoError;
use crate::io::file::invalid;
use crate::io::layout::{KnownRest, Statement};
use crate::io::readings::header::About;
use crate::signal::Channel;
use crate::skin::TaxelId;

/// A whole recording in memory.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Readings {
    /// The taxel that each column is of; `None`: all taxels in the order of the map.
    pub ids: Option<Vec<TaxelId>>,
    /// What is read of each taxel.
    pub channels: Vec<Channel>,
    /// Number of columns: taxels of a frame.
    pub width: usize,
    /// When each frame was taken, in s; NaN where that is not known.
    pub times: Vec<f64>,
    /// Frame after frame, channel after channel: one number per column.
    pub values: Vec<f64>,
    /// What is known of readings where nothing touches.
    pub rest: KnownRest,
}

/// Some frames of one episode of a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Block {
    /// The number of the episode; those of blocks ascend. At its border all that follows frames begins anew.
    pub episode: u64,
    /// The frames; all blocks have the same ids, channels and columns.
    pub readings: Readings,
    /// What is known of the recording by now, and by whom.
    pub statements: Vec<Statement>,
}

/// What gives blocks, one after the other.
type Blocks = Box<dyn Iterator<Item = Result<Block, IoError>> + Send>;

pub(super) struct BlockReadings {
    path: PathBuf,
    blocks: Blocks,
    /// The block that is read, and which of its frames comes next.
    block: Block,
    next: usize,
    pub(super) episodes: u64,
}

impl BlockReadings {
    /// `lengths` are the frames of each episode; none if that is not known.
    pub(super) fn open(path: &Path, lengths: &[u64], mut blocks: Blocks) -> Result<(Self, About), IoError> {
        let Some(block) = blocks.next().transpose()? else {
            return Err(invalid(path, "frames", "none", "one or more"));
        };
        let Readings { ids, channels, width, .. } = &block.readings;
        let about = About {
            ids: ids.clone(),
            channels: channels.clone(),
            width: *width,
            frames: (!lengths.is_empty()).then(|| lengths.iter().sum()),
            has_times: block.readings.times.iter().any(|time| time.is_finite()),
            ..About::default()
        };
        let episodes = lengths.len().max(1) as u64;
        let this = Self { path: path.into(), blocks, block, next: 0, episodes };
        this.check(&this.block)?;
        Ok((this, about))
    }

    /// What is known of readings where nothing touches.
    pub(super) fn rest(&self) -> KnownRest {
        self.block.readings.rest.clone()
    }

    pub(super) fn episode(&self) -> u64 {
        self.block.episode
    }

    pub(super) fn statements(&self) -> &[Statement] {
        &self.block.statements
    }

    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        while self.next == self.block.readings.times.len() {
            let Some(block) = self.blocks.next().transpose()? else { return Ok(false) };
            self.check(&block)?;
            (self.block, self.next) = (block, 0);
        }
        let Readings { channels, width, times, values: all, .. } = &self.block.readings;
        let count = channels.len() * width;
        values.clear();
        values.extend_from_slice(&all[self.next * count..][..count]);
        (*time, self.next) = (times[self.next], self.next + 1);
        Ok(true)
    }

    /// Refuses a block that is not of the recording that the one before is of.
    fn check(&self, block: &Block) -> Result<(), IoError> {
        let fault =
            |element: &str, found: String, needed: String| Err(invalid(&self.path, element, found, needed));
        let (first, next) = (&self.block.readings, &block.readings);
        if block.episode < self.block.episode {
            let needed = "episodes in ascending order".to_owned();
            return fault("episodes", format!("{} after {}", block.episode, self.block.episode), needed);
        }
        if (&next.ids, &next.channels, next.width) != (&first.ids, &first.channels, first.width) {
            let found = format!("{} columns of {} channels", next.width, next.channels.len());
            let needed = format!(
                "the {} columns and {} channels of the first block",
                first.width,
                first.channels.len()
            );
            return fault("blocks", found, needed);
        }
        let needed = next.times.len().saturating_mul(next.channels.len()).saturating_mul(next.width);
        if next.values.len() != needed {
            return fault(
                "values",
                format!("{} numbers", next.values.len()),
                format!("{needed}, one for each frame, channel and column"),
            );
        }
        Ok(())
    }
}
