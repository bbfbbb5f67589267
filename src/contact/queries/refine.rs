//! From the answer of a coarse level to the exact one.
//!
//! The certificate: a contact at most `c` from a coarse face, none of whose points is farther than `d` from
//! the skin, has its nearest skin within `2 c + d` of that face. For each coarse face the index knows the
//! lowest boxes in the tree of level 0 that hold all skin so near, and searches these alone.

use super::Reactive;
use crate::contact::{ContactError, ContactIndex, Hit, Query, search::Start};

/// An exact answer that was found from the answer of a coarse level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// The answer that [`ContactIndex::locate`] gives.
    pub hit: Hit,
    /// Whether the coarse face certified that the answer lies in a part of its patch, so that no more of
    /// the patch was searched; else all of it was.
    pub is_certified: bool,
}

impl ContactIndex {
    /// The exact answer to a query whose answer on a coarse level is known. Where the contact is near the
    /// coarse face, a part of level 0 is searched that is certain to hold the nearest face; elsewhere all
    /// of it.
    ///
    /// # Errors
    /// As [`ContactIndex::reactive`].
    pub fn refine(&self, query: impl Into<Query>, answer: &Reactive) -> Result<Refined, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        let Some(start) = self.certificate(&query, answer) else {
            return Ok(Refined { hit: self.answer(&query)?, is_certified: false });
        };
        let hit = self.answer_from(Some((answer.patch, start)), &query, |_, _| ())?;
        Ok(Refined { hit, is_certified: true })
    }

    fn certificate(&self, query: &Query, answer: &Reactive) -> Option<Start<'_>> {
        let patch = self.patches.get(answer.patch)?;
        if query.link.is_some_and(|link| link != patch.link) {
            return None;
        }
        let level = patch.on_level(answer.level).1?;
        level.certificate(self.in_link(patch.link, query), answer.point.face)
    }
}
