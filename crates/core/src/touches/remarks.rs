//! What is said of how contacts were found.

use crate::skin::sentence::{count, first_few};
use crate::touches::{LeftOutReading, LogDelay, LogOfRows, TouchContacts};

impl LogOfRows {
    /// What was not used, a sentence each.
    pub fn remarks(&self) -> Vec<String> {
        let mut said = Vec::new();
        for (number, what) in [
            (self.others, "of other links"),
            (self.silent, "without an active taxel"),
            (self.unposed, "in a pause of the poses"),
        ] {
            if number > 0 {
                said.push(format!("{} {what}, left out", count(number, "row is", "rows are")));
            }
        }
        said
    }
}

impl LogDelay {
    /// The delay in a sentence, if the touches say that there is one.
    pub fn remark(&self) -> Option<String> {
        let Self { seconds, sigma, removed } = *self;
        let rest = Self { seconds: seconds - removed, ..*self };
        let is_said = removed != 0.0 || self.is_significant();
        let late = if seconds < 0.0 { "early" } else { "late" };
        let taken = match (removed, rest.is_significant()) {
            (0.0, _) => String::new(),
            (_, false) => ", which is taken off".to_owned(),
            (removed, true) => format!(", of which {:.1} ms are taken off", 1e3 * removed),
        };
        is_said.then(|| {
            format!(
                "the readings are {late} by {:.1} ms, standard deviation {:.1} ms{taken}: the clock, or play of the joints",
                1e3 * seconds.abs(),
                1e3 * sigma
            )
        })
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
        if summary.lost_taxels > 0 {
            said.push(format!("{} no contact", count(summary.lost_taxels, "taxel has", "taxels have")));
        }
        if summary.touches_without_radius > 0 && summary.touches_without_radius < summary.touches {
            let touches = count(summary.touches_without_radius, "touch has", "touches have");
            said.push(format!("{touches} no radius of the body, others have one"));
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
        if summary.unlike_spheres {
            said.push(
                "the readings are not those of spheres of these radii; check the radius of the body in m and the poses, unless the \
                 noise of the arm is some millimetres"
                    .to_owned(),
            );
        }
        said.extend(summary.delay.and_then(|delay| delay.remark()));
        if summary.untimed > 0 {
            let frames = count(summary.untimed, "frame has", "frames have");
            said.push(format!("{frames} no pose at the time of the readings, left out"));
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
