//! Names of which no two are alike.

use std::collections::{HashMap, HashSet};

/// Gives every patch a unique name.
#[derive(Debug)]
pub(crate) struct Names {
    /// Names that are given only to those that ask for them.
    wanted: HashSet<String>,
    taken: HashSet<String>,
    /// The last number given, by name.
    last: HashMap<String, usize>,
}

impl Names {
    /// For patches that want these names.
    pub(crate) fn new<'a>(wanted: impl Iterator<Item = &'a str>) -> Self {
        Self { wanted: wanted.map(str::to_owned).collect(), taken: HashSet::new(), last: HashMap::new() }
    }

    /// The next free name of `name`, `name.1`, `name.2`, ...
    pub(crate) fn next(&mut self, name: &str) -> String {
        if self.taken.insert(name.to_owned()) {
            return name.to_owned();
        }
        let last = self.last.entry(name.to_owned()).or_insert(0);
        loop {
            *last += 1;
            let numbered = format!("{name}.{last}");
            if !self.wanted.contains(&numbered) && self.taken.insert(numbered.clone()) {
                return numbered;
            }
        }
    }
}
