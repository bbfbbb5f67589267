//! Many queries at once, in parallel.

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    contact::{ContactError, ContactIndex, Hit, Query},
    numeric::morton,
};

/// Contacts that one task answers, each search starting from the last hit: long enough to forget
/// the first search, short enough to share among threads.
const RUN: usize = 256;

impl ContactIndex {
    /// Answers many contacts, in parallel; the same hits in the same order as one by one.
    ///
    /// They are visited along a Morton curve, so that each search finds in the cache what the last
    /// one used.
    ///
    /// # Errors
    /// The first contact that cannot be answered.
    pub fn locate_all(&self, contacts: &[Query]) -> Result<Vec<Hit>, ContactError> {
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
    fn along_curve(&self, contacts: &[Query]) -> Vec<(u64, usize)> {
        let places: Vec<DVec3> = contacts.iter().map(|contact| self.in_world(contact)).collect();
        let (lo, hi) =
            places.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
        // The box keeps its shape: the longest side has all steps.
        let side = (hi - lo).max_element().max(f64::MIN_POSITIVE);
        let mut order: Vec<_> =
            places.iter().enumerate().map(|(number, &p)| (morton((p - lo) / side), number)).collect();
        order.par_sort_unstable();
        order
    }
}
