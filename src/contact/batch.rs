use glam::DVec3;
use rayon::prelude::*;

use crate::contact::{Contact, ContactError, ContactIndex, Hit};

/// Contacts that one task answers, each search starting from the last hit: long enough to forget the first search,
/// short enough to share among threads.
const RUN: usize = 256;

/// Bits of a Morton code per axis.
const BITS: u32 = 21;

impl ContactIndex {
    /// Answers many contacts, in parallel; the same hits in the same order as one by one.
    ///
    /// They are visited along a Morton curve, so that each search finds in the cache what the last one used.
    ///
    /// # Errors
    /// The first contact that cannot be answered.
    pub fn locate_all(&self, contacts: &[Contact]) -> Result<Vec<Hit>, ContactError> {
        for (number, contact) in contacts.iter().enumerate() {
            self.check(number, contact)?;
        }
        let order = self.along_curve(contacts);
        let runs = order.par_chunks(RUN).map(|run| {
            let mut last: Option<Hit> = None;
            let hits = run.iter().map(|&(_, number)| {
                let near = last.map(|hit| (hit.patch, hit.point.face));
                let hit = self.answer(&contacts[number], near)?;
                last = Some(hit);
                Ok((number, hit))
            });
            hits.collect::<Result<Vec<_>, ContactError>>()
        });
        let mut hits: Vec<(usize, Hit)> =
            runs.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        hits.par_sort_unstable_by_key(|&(number, _)| number);
        Ok(hits.into_iter().map(|(_, hit)| hit).collect())
    }

    /// Morton code and number of each contact, sorted.
    fn along_curve(&self, contacts: &[Contact]) -> Vec<(u64, usize)> {
        let places: Vec<DVec3> = contacts.iter().map(|contact| self.in_world(contact)).collect();
        let bounds =
            places.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
        let mut order: Vec<_> =
            places.iter().enumerate().map(|(number, &p)| (morton(p, bounds), number)).collect();
        order.par_sort_unstable();
        order
    }
}

/// The place of `p` along the Morton curve through the box `(lo, hi)`.
fn morton(p: DVec3, (lo, hi): (DVec3, DVec3)) -> u64 {
    let steps = f64::from(1_u32 << BITS) - 1.0;
    // The box keeps its shape: the longest side has all steps.
    let unit = (p - lo) * (steps / (hi - lo).max_element().max(f64::MIN_POSITIVE));
    let spread = |x: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between 0 and 2^21, and `as` saturates"
        )]
        let mut x = x as u64 & ((1 << BITS) - 1);
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            x = (x | x << shift) & mask;
        }
        x
    };
    spread(unit.x) | spread(unit.y) << 1 | spread(unit.z) << 2
}
