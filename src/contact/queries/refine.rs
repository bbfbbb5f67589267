//! From the answer of a coarse level to the exact one.
//!
//! The coarse answer says where to begin: with the packet of level 0 at the nearest corner of its face, as
//! a path does with that of the last contact. The nearest face there bounds the search, which is exact
//! from any start.

use super::Reactive;
use crate::contact::{ContactError, ContactIndex, Cursor, Hit, Query};

impl ContactIndex {
    /// The exact answer to a query whose answer on a coarse level is known: the same as
    /// [`ContactIndex::locate`] gives. The search begins near the coarse answer, which saves time where
    /// the level is not much coarser than level 0.
    ///
    /// # Errors
    /// As [`ContactIndex::reactive`].
    pub fn refine(&self, query: impl Into<Query>, answer: &Reactive) -> Result<Hit, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        self.answer_along(&mut self.start(answer), &query)
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
