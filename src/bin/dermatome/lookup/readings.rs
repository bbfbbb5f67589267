//! The forces of contacts as a recording that `render` reads.

use std::{path::Path, sync::atomic::Ordering};

use dermatome::{
    contact::{Area, ContactIndex, Press, Query, Spreader},
    io::{IoError, ReadingsWriter},
    signal::{Channel, Frame},
};

use crate::lookup::{contacts::Contact, refusals::unanswered, robot::Robot};

/// A recording of forces, in N: contacts of one time in a row are a frame.
pub(super) struct Readings<'a> {
    writer: ReadingsWriter,
    spreader: Spreader<'a>,
    frame: Option<Frame>,
    untouched: u64,
}

impl<'a> Readings<'a> {
    /// Begins a .csv or .npz; taxels feel on discs of this radius, in m.
    pub(super) fn create(path: &Path, robot: &'a Robot, disc: f64) -> Result<Self, IoError> {
        let taxels = robot.map.patches.iter().map(|patch| &patch.taxels);
        let writer = ReadingsWriter::create(path, taxels, &Channel::new("force", "N"))?;
        Ok(Self { writer, spreader: Spreader { map: &robot.map, disc }, frame: None, untouched: 0 })
    }

    /// Adds contacts that are answered; those without a time are in the frame of time 0, those off the
    /// skin press nothing.
    pub(super) fn add(
        &mut self,
        index: &ContactIndex,
        contacts: &[Contact],
        queries: &[Query],
    ) -> Result<(), IoError> {
        for (contact, &Query { point, link }) in contacts.iter().zip(queries) {
            let time = contact.time.unwrap_or(0.0);
            if let Some(frame) = self.frame.take_if(|frame| frame.time != time) {
                self.writer.write(&frame)?;
            }
            let frame = self.frame.get_or_insert_with(|| self.spreader.frame(time));
            let Some(force) = contact.force.filter(|force| *force != 0.0) else { continue };
            if contact.is_off.load(Ordering::Relaxed) {
                self.untouched += 1;
                continue;
            }
            let sphere = |radius| Area::Sphere { centre: point, radius };
            let area = contact.radius.filter(|r| *r > 0.0).map_or(Area::Point(point), sphere);
            let press = Press { area, link, force };
            if !self.spreader.add(index, &press, frame).map_err(unanswered)? {
                self.untouched += 1;
            }
        }
        Ok(())
    }

    /// Contacts with a force that touched no taxel.
    pub(super) fn untouched(&self) -> u64 {
        self.untouched
    }

    pub(super) fn finish(mut self) -> Result<(), IoError> {
        if let Some(frame) = self.frame.take() {
            self.writer.write(&frame)?;
        }
        self.writer.finish()
    }
}
