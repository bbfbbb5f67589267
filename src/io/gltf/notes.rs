//! What is wrong with a file, but touches no triangle: noted where a skin is read, refused where a
//! map is.
//!
//! Faults of positions, indices, counts and buffers are never noted, always refused.

use std::{
    cell::{Cell, RefCell},
    collections::BTreeMap,
};

use crate::io::{IoError, error::Result, file::Source};

/// More notes than this are only counted: a file may have one for every vertex.
const MOST_NOTES: usize = 12;

/// An element of a top-level array that is broken: its error counts when it is used.
type Broken = [String; 3];

/// The faults of a file that were passed over.
#[derive(Debug, Default)]
pub(super) struct Notes {
    is_strict: bool,
    texts: RefCell<Vec<String>>,
    more: Cell<usize>,
    broken: RefCell<BTreeMap<(&'static str, usize), Broken>>,
}

impl Notes {
    /// Passes over nothing if `is_strict`.
    pub(super) fn new(is_strict: bool) -> Self {
        Self { is_strict, ..Self::default() }
    }

    /// Notes a fault and goes on; where maps are read it is an error.
    pub(super) fn pass(&self, fault: IoError) -> Result<()> {
        if self.is_strict {
            return Err(fault);
        }
        let text = match fault {
            IoError::Invalid { element, found, needed, .. } => {
                format!(
                    "{element}: found {found}; needed: {needed}; it touches no triangle and was passed over"
                )
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

    /// Keeps a fault of element `index` of a top-level array until the element is used.
    pub(super) fn hold(&self, array: &'static str, index: usize, fault: IoError) -> Result<()> {
        match fault {
            IoError::Invalid { element, found, needed, .. } if !self.is_strict => {
                self.broken.borrow_mut().insert((array, index), [element, found, needed]);
                Ok(())
            }
            other => Err(other),
        }
    }

    /// The fault of an element that is used, if it has one.
    pub(super) fn check(&self, source: &Source, array: &'static str, index: usize) -> Result<()> {
        match self.broken.borrow().get(&(array, index)) {
            None => Ok(()),
            Some([element, found, needed]) => Err(source.invalid(element, found, needed)),
        }
    }

    /// All notes, for the remarks of a draft.
    pub(super) fn texts(&self) -> Vec<String> {
        let mut texts = self.texts.borrow().clone();
        for ((array, index), [_, found, _]) in self.broken.borrow().iter().take(MOST_NOTES) {
            texts.push(format!("{array}[{index}], which nothing uses, is broken: {found}"));
        }
        match self.more.get() {
            0 => {}
            more => texts.push(format!("{more} more faults that touch no triangle")),
        }
        texts
    }
}
