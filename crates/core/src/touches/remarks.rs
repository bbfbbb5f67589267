//! What is said of how contacts were found.

use crate::skin::sentence::{count, first_few};
use crate::touches::{LeftOutReading, LogOfRows, TouchContacts};

impl LogOfRows {
    /// What was not used, a sentence each.
    pub fn remarks(&self) -> Vec<String> {
        let mut said = Vec::new();
        for (number, what) in [(self.others, "of other links"), (self.silent, "without an active taxel")] {
            if number > 0 {
                said.push(format!("{} {what}, left out", count(number, "row is", "rows are")));
            }
        }
        said
    }
}

impl TouchContacts {
    /// What was left out and how well the rest is known, a sentence each.
    pub fn remarks(&self) -> Vec<String> {
        let (summary, mut said) = (&self.summary, Vec::new());
        if summary.empty_touches > 0 {
            let touches = count(summary.empty_touches, "touch is", "touches are");
            said.push(format!("{touches} without a taxel that is used, left out"));
        }
        if summary.lone > 0 {
            let readings = count(summary.lone, "reading is", "readings are");
            said.push(format!("{readings} without an active neighbour, left out"));
        }
        if !summary.spikes.is_empty() {
            let readings = count(summary.spikes.len(), "reading is", "readings are");
            let place = |spike: &LeftOutReading| format!("taxel {} in line {}", spike.taxel, spike.row);
            let places: Vec<String> = summary.spikes.iter().map(place).collect();
            said.push(format!("{readings} not what the taxel gives there, left out: {}", first_few(&places)));
        }
        if let Some(first) = summary.inside.first() {
            let frames = count(summary.inside.len(), "frame", "frames");
            said.push(format!(
                "in {frames}, first in line {first}, the centre of the sphere is inside the skin as drawn; check the poses, \
                 px,py,pz and the normals of the drawing"
            ));
        }
        let (touches, taxels) = (count(summary.touches, "touch", "touches"), summary.taxels);
        said.push(format!(
            "{touches} of {} in {}: {}",
            count(taxels, "taxel", "taxels"),
            count(summary.frames, "frame", "frames"),
            count(self.contacts.len(), "contact", "contacts")
        ));
        if summary.fitted < taxels {
            said.push(format!(
                "{} of {taxels} taxels are the means of where the body was: they have too few readings, or no radius of the \
                 body is given",
                taxels - summary.fitted
            ));
        }
        let arm = summary.arm_noise * 1e3;
        said.push(match summary.reading_noise {
            Some(noise) => format!("noise: {arm:.3} mm of the arm's position, {noise:.3e} of a reading"),
            None => format!("noise of the arm's position: {arm:.3} mm, as given or assumed"),
        });
        said
    }
}
