//! From the answer of a coarse level to the exact one.
//!
//! The coarse answer says where to begin: with the packet of level 0 at the nearest corner of its face, as
//! a path does with that of the last contact. The nearest face there bounds the search, which is exact
//! from any start.

use super::Reactive;
use crate::contact::{ContactError, ContactIndex, Cursor, Hit, Query};

/// What rounding may add to the distances that are compared, as a part of them.
const ROUNDING: f64 = 1e-9;

/// An exact answer, and whether the coarse one was right about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// The same as [`ContactIndex::locate`] answers.
    pub hit: Hit,
    /// Whether the skin is as near as the coarse answer certified: no farther than its distance and its
    /// error. It is not for an answer to another query, or in another pose of the links.
    pub certified: bool,
}

impl ContactIndex {
    /// The exact answer to a query whose answer on a coarse level is known.
    ///
    /// # Errors
    /// As [`ContactIndex::reactive`].
    pub fn refine(&self, query: impl Into<Query>, answer: &Reactive) -> Result<Refined, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        let hit = self.answer_along(&mut self.start(answer), &query)?;
        let reach = (answer.distance.abs() + answer.error) * (1.0 + ROUNDING);
        Ok(Refined { hit, certified: hit.distance.abs() <= reach })
    }

    /// Where a search near a coarse answer begins.
    fn start(&self, answer: &Reactive) -> Cursor {
        let start = || {
            let coarse = self.patches.get(answer.patch)?.on_level(answer.level).1?;
            coarse.packet_near(&answer.point)
        };
        Cursor { last: start().map(|packet| (answer.patch, packet)) }
    }
}
