//! The contact regions of a recording as a table: `render --contacts`.

use std::{path::PathBuf, sync::Arc};

use dermatome::Error;
use dermatome::io::{IoError, RegionWriter};
use dermatome::map::SkinMap;
use dermatome::signal::{Channel, ContactEvent, ContactTracker, Frame, TrackerOptions};

use crate::options::Common;
use crate::readings::{ReadingsArgs, find_channel, positive};

/// Which contacts are found.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Contacts")]
#[group(requires = "contacts")]
pub(super) struct ContactsArgs {
    /// Also find contact regions and follow them from frame to frame: a table, .csv
    #[arg(long, value_name = "OUT.csv")]
    contacts: Option<PathBuf>,
    /// A region holds a taxel above this, in the unit of the channel [default: estimated
    /// from the first frames, during which the skin must be untouched]
    #[arg(long, value_name = "X", value_parser = positive)]
    threshold: Option<f64>,
    /// The other taxels of a region are above this share of the threshold
    #[arg(long, value_name = "F", default_value_t = TrackerOptions::default().low)]
    low: f64,
    /// Least number of taxels of a region
    #[arg(long, value_name = "N", default_value_t = TrackerOptions::default().least)]
    least: usize,
    /// Split a region with several peaks: a part is a contact of its own if its peak, with more than
    /// three taxels, rises above the saddle to the next by this share of its height; 1: never
    #[arg(long, value_name = "F", default_value_t = TrackerOptions::default().prominence)]
    prominence: f64,
    /// Channel whose regions are found [default: the first]
    #[arg(long, value_name = "NAME")]
    channel: Option<String>,
}

pub(super) struct Contacts {
    tracker: ContactTracker,
    writer: RegionWriter,
    onsets: usize,
}

impl ContactsArgs {
    pub(super) fn open(
        &self,
        map: &Arc<SkinMap>,
        channels: &[Channel],
        readings: &ReadingsArgs,
        common: &Common,
    ) -> anyhow::Result<Option<Contacts>> {
        let Some(path) = &self.contacts else { return Ok(None) };
        let channel = self.channel.as_deref().map_or(Ok(0), |name| find_channel(channels, name))?;
        let defaults = TrackerOptions::default();
        let noise_frames = match readings.baseline {
            0 => defaults.noise_frames,
            frames => frames.max(2),
        };
        let options = TrackerOptions {
            channel,
            threshold: self.threshold,
            low: self.low,
            least: self.least,
            prominence: self.prominence,
            noise_frames,
            ..defaults
        };
        let tracker = ContactTracker::new(map, &channels[channel], &options).map_err(Error::from)?;
        let writer = RegionWriter::create(common.outputs.file(path), map).map_err(Error::from)?;
        Ok(Some(Contacts { tracker, writer, onsets: 0 }))
    }
}

impl Contacts {
    /// Finds the regions of frame `number`.
    pub(super) fn track(&mut self, number: usize, frame: &Frame) -> Result<(), Error> {
        let regions = self.tracker.track(frame);
        self.onsets += regions.iter().filter(|region| region.event == ContactEvent::Onset).count();
        Ok(self.writer.write(number as u64, frame.time, regions)?)
    }

    /// Completes the table: the number of contacts, and the threshold that was used.
    pub(super) fn finish(self) -> Result<(usize, Option<f64>), IoError> {
        let threshold = self.tracker.threshold();
        self.writer.finish()?;
        Ok((self.onsets, threshold))
    }
}
