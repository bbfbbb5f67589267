//! What is wrong with a file, but touches no triangle: noted where a skin is read, refused where a
//! map is.
//!
//! Faults of positions, indices, counts and buffers are never noted, always refused.

use std::cell::{Cell, RefCell};

use crate::io::{IoError, error::Result};

/// More notes than this are only counted: a file may have one for every vertex.
const MOST_NOTES: usize = 12;

/// The faults of a file that were passed over.
#[derive(Debug, Default)]
pub(super) struct Notes {
    is_strict: bool,
    texts: RefCell<Vec<String>>,
    more: Cell<usize>,
}

impl Notes {
    /// Passes over nothing if `is_strict`.
    pub(super) fn new(is_strict: bool) -> Self {
        Self { is_strict, ..Self::default() }
    }

    /// Notes a fault and goes on without what has it; where maps are read it is an error.
    pub(super) fn pass(&self, fault: IoError) -> Result<()> {
        self.settle(fault, "it touches no triangle and was passed over")
    }

    /// Notes a fault and what was done about it; where maps are read it is an error.
    pub(super) fn settle(&self, fault: IoError, what: &str) -> Result<()> {
        if self.is_strict {
            return Err(fault);
        }
        let text = match fault {
            IoError::Invalid { element, found, needed, .. } => {
                format!("{element}: found {found}; needed: {needed}; {what}")
            }
            other => other.to_string(),
        };
        let mut texts = self.texts.borrow_mut();
        if texts.len() < MOST_NOTES && !texts.contains(&text) {
            texts.push(text);
        } else if !texts.contains(&text) {
            self.more.set(self.more.get() + 1);
        }
        Ok(())
    }

    /// All notes, for the remarks of a draft.
    pub(super) fn texts(&self) -> Vec<String> {
        let more = match self.more.get() {
            0 => None,
            more => Some(format!("{more} more faults that touch no triangle")),
        };
        self.texts.borrow().iter().cloned().chain(more).collect()
    }
}
