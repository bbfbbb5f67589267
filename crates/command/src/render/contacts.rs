//! The contact regions of a recording as a table: `render --contacts`.

use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{IoError, RegionWriter};
use dermatome::map::SkinMap;
use dermatome::recording::{Recording, Step};
use dermatome::signal::ContactEvent;

use crate::options::{Common, OutFile};
use crate::readings::TouchArgs;
use crate::render::events::EventsArgs;

/// Which contacts are found.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Contacts")]
#[group(requires = "found")]
#[command(group(clap::ArgGroup::new("found").args(["contacts", "events"]).multiple(true)))]
pub(super) struct ContactsArgs {
    /// Also find contact regions and follow them from frame to frame: a table, .csv
    #[arg(long, value_name = "OUT.csv")]
    contacts: Option<OutFile>,
    #[command(flatten)]
    touch: TouchArgs,
    /// Channel whose regions are found [default: the first that measures touches]
    #[arg(long, value_name = "NAME")]
    channel: Option<String>,
}

pub(super) struct Contacts {
    writer: Option<RegionWriter>,
    onsets: usize,
}

impl ContactsArgs {
    pub(super) fn open(
        &self,
        map: &Arc<SkinMap>,
        recording: &mut Recording,
        events: &EventsArgs,
        common: &Common,
    ) -> Result<Option<Contacts>, Error> {
        if self.contacts.is_none() && !events.is_given() {
            return Ok(None);
        }
        let channel = recording.channel(self.channel.as_deref())?;
        recording.follow_contacts(&self.touch.options(recording, channel))?;
        let create = |path: &OutFile| RegionWriter::create(common.outputs.file(path), map);
        let writer = self.contacts.as_ref().map(create).transpose()?;
        Ok(Some(Contacts { writer, onsets: 0 }))
    }

    /// Notes about the threshold and zero of contacts.
    pub(super) fn remark(&self, recording: &Recording, common: &Common) -> Result<(), Error> {
        self.touch.remark(recording, recording.channel(self.channel.as_deref())?, common);
        Ok(())
    }
}

impl Contacts {
    /// The frames that follow are of this episode.
    pub(super) fn begin_episode(&mut self, number: u64) {
        self.writer.iter_mut().for_each(|writer| writer.begin_episode(number));
    }

    /// Writes the regions of a frame.
    pub(super) fn write(&mut self, step: &Step<'_>) -> Result<(), Error> {
        self.onsets += step.contacts.iter().filter(|region| region.event == ContactEvent::Onset).count();
        match &mut self.writer {
            Some(writer) => Ok(writer.write(step.number as u64, step.frame.time, step.contacts)?),
            None => Ok(()),
        }
    }

    /// Completes the table, and counts the contacts.
    pub(super) fn finish(self) -> Result<usize, IoError> {
        self.writer.map_or(Ok(()), RegionWriter::finish)?;
        Ok(self.onsets)
    }
}
