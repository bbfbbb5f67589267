//! The contact regions of a recording as a table: `render --contacts`.

use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{IoError, RegionWriter};
use dermatome::map::SkinMap;
use dermatome::recording::{Recording, Step};
use dermatome::signal::{ContactEvent, TrackerOptions};

use crate::options::{Common, OutFile};
use crate::readings::positive;

/// Which contacts are found.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Contacts")]
#[group(requires = "contacts")]
pub(super) struct ContactsArgs {
    /// Also find contact regions and follow them from frame to frame: a table, .csv
    #[arg(long, value_name = "OUT.csv")]
    contacts: Option<OutFile>,
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
    writer: RegionWriter,
    onsets: usize,
}

impl ContactsArgs {
    pub(super) fn open(
        &self,
        map: &Arc<SkinMap>,
        recording: &mut Recording,
        common: &Common,
    ) -> Result<Option<Contacts>, Error> {
        let Some(path) = &self.contacts else { return Ok(None) };
        let channel = recording.channel(self.channel.as_deref())?;
        recording.follow_contacts(&TrackerOptions {
            threshold: self.threshold,
            low: self.low,
            least: self.least,
            prominence: self.prominence,
            ..recording.tracker_options(channel)
        })?;
        let writer = RegionWriter::create(common.outputs.file(path), map)?;
        Ok(Some(Contacts { writer, onsets: 0 }))
    }
}

impl Contacts {
    /// Writes the regions of a frame.
    pub(super) fn write(&mut self, step: &Step<'_>) -> Result<(), Error> {
        self.onsets += step.contacts.iter().filter(|region| region.event == ContactEvent::Onset).count();
        Ok(self.writer.write(step.number as u64, step.frame.time, step.contacts)?)
    }

    /// Completes the table, and counts the contacts.
    pub(super) fn finish(self) -> Result<usize, IoError> {
        self.writer.finish()?;
        Ok(self.onsets)
    }
}
