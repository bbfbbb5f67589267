//! Many queries at once, in parallel.

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    contact::{ContactError, ContactIndex, Hit, Query, query::Cursor},
    numeric::along_curve,
};

/// Fewest contacts that one task answers: enough for the cache to hold what the next one needs.
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
        for (number, query) in contacts.iter().enumerate() {
            self.check(number, query)?;
        }
        let points: Vec<DVec3> = contacts.iter().map(|query| self.in_world(query)).collect();
        let order = along_curve(&points);
        let sorted: Vec<Hit> = order
            .par_iter()
            .with_min_len(RUN)
            .map_with(Cursor::default(), |cursor, &number| self.answer_along(cursor, &contacts[number]))
            .collect::<Result<_, _>>()?;
        let mut places = vec![0_usize; contacts.len()];
        order.iter().enumerate().for_each(|(place, &number)| places[number] = place);
        Ok(places.par_iter().map(|&place| sorted[place]).collect())
    }
}
