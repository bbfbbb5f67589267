//! Names of patches.

use std::collections::{HashMap, HashSet};

use crate::skin::Sheet;

/// Gives every patch a unique name.
#[derive(Debug)]
pub(super) struct Names {
    /// Names of sheets: a component of another sheet must not take them.
    of_sheets: HashSet<String>,
    taken: HashSet<String>,
    /// The last number given to a component, by the name of its sheet.
    last: HashMap<String, usize>,
}

impl Names {
    pub(super) fn new(sheets: &[Sheet]) -> Self {
        let of_sheets = sheets.iter().map(|s| s.title().to_owned()).collect();
        Self { of_sheets, taken: HashSet::new(), last: HashMap::new() }
    }

    /// The next free one of `name`, `name.1`, `name.2`, ...
    pub(super) fn next(&mut self, name: &str) -> String {
        if self.taken.insert(name.to_owned()) {
            return name.to_owned();
        }
        let last = self.last.entry(name.to_owned()).or_insert(0);
        loop {
            *last += 1;
            let numbered = format!("{name}.{last}");
            if !self.of_sheets.contains(&numbered) && self.taken.insert(numbered.clone()) {
                return numbered;
            }
        }
    }
}
