//! The forces of contacts as a recording that `render` reads.

use std::path::Path;

use dermatome::contact::{ContactIndex, Query};
use dermatome::io::{IoError, KnownRest, OutPath, ReadingsColumns, ReadingsWriter};
use dermatome::map::SkinMap;
use dermatome::signal::{Channel, ChannelKind, Frame, Press, Quantity, Spreader};

use crate::console::notes::{note, note_count};
use crate::lookup::contacts::Contact;
use crate::lookup::refusals::unanswered;
use crate::options::Common;

/// The force above which a taxel is loaded: above all rounding of a share, and far below any touch.
const LEAST_FORCE_N: f64 = 1e-6;

/// A recording of forces, in N: contacts of one time in a row are a frame.
pub(super) struct Readings {
    writer: ReadingsWriter,
    spreader: Spreader,
    frame: Option<Frame>,
    counts: Counts,
}

/// What of the contacts is not in the recording, or not in order.
#[derive(Debug, Default)]
pub(super) struct Counts {
    forces: u64,
    /// Those of them that touched no taxel.
    untouched: u64,
    /// Frames that are earlier than the one before.
    backwards: u64,
}

impl Counts {
    pub(super) fn note(&self, common: &Common) {
        let Self { forces, untouched, backwards } = self;
        if *forces == 0 {
            note!(common, "no contact has a force (column `force`): all readings are 0");
        }
        note_count(common, *untouched, "contacts", "off all taxels: such a force is in no reading");
        let how = "earlier in the readings than the one before: sort the contacts by time";
        note_count(common, *backwards, "frames", how);
    }
}

impl Readings {
    /// Begins a .csv or .npz.
    pub(super) fn create(path: OutPath, map: &SkinMap, spreader: Spreader) -> Result<Self, IoError> {
        let taxels = map.patches.iter().map(|patch| &patch.taxels);
        let channel = Channel {
            name: "force".into(),
            unit: "N".into(),
            quantity: Quantity::Extensive,
            kind: ChannelKind::Touch,
        };
        let columns = ReadingsColumns { channels: std::slice::from_ref(&channel), has_times: true };
        let mut writer = ReadingsWriter::create(path, taxels, columns)?;
        // A taxel without a contact has the force 0, without noise.
        let rest = KnownRest::tared(std::slice::from_ref(&channel));
        writer.state_rest(&KnownRest { threshold: Some(LEAST_FORCE_N), ..rest })?;
        Ok(Self { writer, spreader, frame: None, counts: Counts::default() })
    }

    /// Adds contacts that are answered; those without a time are in the frame of time 0.
    pub(super) fn add(
        &mut self,
        index: &ContactIndex,
        contacts: &[Contact],
        queries: &[Query],
    ) -> Result<(), IoError> {
        for (contact, &at) in contacts.iter().zip(queries) {
            let time = contact.time.unwrap_or(0.0);
            if let Some(frame) = self.frame.take_if(|frame| frame.time != time) {
                self.counts.backwards += u64::from(time < frame.time);
                self.writer.write(&frame)?;
            }
            let frame = self.frame.get_or_insert_with(|| self.spreader.frame(index, time));
            self.counts.forces += u64::from(contact.force.is_some());
            let Some(force) = contact.force.filter(|force| *force != 0.0) else { continue };
            let press = Press { at, radius: contact.radius.unwrap_or(0.0).max(0.0), force };
            if !self.spreader.add(index, &press, frame).map_err(unanswered)? {
                self.counts.untouched += 1;
            }
        }
        Ok(())
    }

    /// Ends the recording of the contacts of this table.
    /// Fails if it has none: a recording needs a frame.
    pub(super) fn finish(mut self, contacts: &Path) -> Result<Counts, IoError> {
        let Some(frame) = self.frame.take() else {
            let (found, needed) =
                ("no contact".into(), "a contact for the first frame of the readings".into());
            return Err(IoError::Invalid {
                path: contacts.into(),
                element: "the table".into(),
                found,
                needed,
            });
        };
        self.writer.write(&frame)?;
        self.writer.finish()?;
        Ok(self.counts)
    }
}
