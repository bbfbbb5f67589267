//! Columns with names: which one is of which taxel and component, by a pattern or a table of a layout.

use std::collections::HashMap;
use std::path::Path;

use crate::io::IoError;
use crate::io::file::times::time_column;
use crate::io::file::{Source, invalid};
use crate::io::layout::facts::{StreamFacts, TimeUnit};
use crate::io::layout::keys::Layout;
use crate::io::layout::rules::TaxelRule;
use crate::io::table::Table;
use crate::skin::TaxelId;

/// Which columns of a table of another program are readings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NamedColumns {
    /// The taxels, in ascending order of their ids.
    pub ids: Vec<TaxelId>,
    /// How many numbers each of them has.
    pub components: usize,
    /// Of each column its component and the place of its taxel in `ids`; none if it is not read.
    pub places: Vec<Option<[usize; 2]>>,
}

impl Layout {
    /// Which of some columns are readings, where the layout joins columns to taxels by their names; `None` if it does not.
    ///
    /// # Errors
    /// If none is, if two are of one taxel and component, or if a taxel lacks a component.
    pub fn named_columns(&self, file: &Path, names: &[&str]) -> Result<Option<NamedColumns>, IoError> {
        let Some(given) = self.columns_of(file, names)? else { return Ok(None) };
        let column = |k: usize| format!("column {} ({})", k + 1, names[k]);
        let mut seen = HashMap::new();
        for (k, key) in given.iter().enumerate().filter_map(|(k, key)| Some((k, (*key)?))) {
            if let Some(first) = seen.insert(key, k) {
                let found = format!("taxel {} again, which {} has", key.1, names[first]);
                return Err(invalid(file, column(k), found, "one column for each taxel"));
            }
        }
        let mut ids: Vec<TaxelId> = seen.keys().map(|(_, id)| *id).collect();
        ids.sort_unstable();
        ids.dedup();
        if ids.is_empty() {
            let found = format!("columns {}", listed(names));
            return Err(invalid(file, "taxels", found, format!("columns called {}", self.taxels.describe())));
        }
        let components = seen.keys().map(|(component, _)| component + 1).max().unwrap_or(1);
        for (component, &id) in (0..components).flat_map(|c| ids.iter().map(move |id| (c, id))) {
            if !seen.contains_key(&(component, id)) {
                let found = format!("no column of component {component} of taxel {id}");
                return Err(invalid(file, "taxels", found, "a column for each component of each taxel"));
            }
        }
        let place = |(component, id): (usize, TaxelId)| Some([component, ids.binary_search(&id).ok()?]);
        let places = given.iter().map(|key| key.and_then(place)).collect();
        Ok(Some(NamedColumns { ids, components, places }))
    }

    /// Component and taxel of each column.
    #[expect(clippy::type_complexity, reason = "of each column, if it is read")]
    fn columns_of(
        &self,
        file: &Path,
        names: &[&str],
    ) -> Result<Option<Vec<Option<(usize, TaxelId)>>>, IoError> {
        let table = match &self.taxels {
            TaxelRule::Columns(patterns) => {
                let of = |name: &&str| {
                    let mut hits = patterns.iter().enumerate();
                    hits.find_map(|(k, pattern)| Some((k, pattern.id_in(name)?)))
                };
                return Ok(Some(names.iter().map(of).collect()));
            }
            TaxelRule::Table(table) if !self.axes.iter().any(|axis| axis == "column") => table,
            _ => return Ok(None),
        };
        let source = Source::open(&self.beside(table))?;
        let table = Table::of(&source)?;
        let Some(name) = table.columns.find("column") else { return Ok(None) };
        let known = ["column", "taxel_id", "component"];
        if let Some((k, name)) = table.columns.unknown(&known).next() {
            let part = format!("column {}", k + 1);
            return Err(table.columns.at().invalid_part(part, name, format!("one of {}", known.join(","))));
        }
        let (id, component) = (table.columns.need("taxel_id")?, table.columns.find("component"));
        // Of two columns of one name, the first.
        let places: HashMap<&str, usize> =
            names.iter().enumerate().rev().map(|(k, name)| (&**name, k)).collect();
        let mut given = vec![None; names.len()];
        let mut seen = vec![false; names.len()];
        table.each_row(&mut |row| {
            let Some(&k) = places.get(row.text(name)) else {
                return Err(row.invalid(name, format!("a column of {}: {}", file.display(), listed(names))));
            };
            if std::mem::replace(&mut seen[k], true) {
                return Err(row.invalid(name, "each column once"));
            }
            // Columns without a taxel are left out.
            if row.text(id).is_empty() {
                return Ok(());
            }
            let at = match component {
                Some(column) => row.text(column).parse().ok().filter(|at: &usize| *at < names.len()),
                None => Some(0),
            };
            let needed = "the number of a component, counted from 0";
            let at = at.ok_or_else(|| row.invalid(component.unwrap_or_default(), needed))?;
            given[k] = Some((at, row.taxel(id)?));
            Ok(())
        })?;
        Ok(Some(given))
    }
}

/// The name of a column and the unit behind it, as in `ele1[kPa]`.
pub(in crate::io) fn name_and_unit(word: &str) -> (&str, &str) {
    match word.strip_suffix(']').and_then(|text| text.split_once('[')) {
        Some((name, unit)) => (name.trim(), unit.trim()),
        None => (word.trim(), ""),
    }
}

impl StreamFacts {
    /// What a draft of a layout has of columns with names, as `time` and `ele1[kPa]`; `None` if no two of them differ by a
    /// number.
    pub fn of_columns(words: &[&str]) -> Option<Self> {
        let names: Vec<&str> = words.iter().map(|word| name_and_unit(word).0).collect();
        let (columns, width) = patterns_of(&names);
        let time = words.iter().position(|word| time_column(word).is_some());
        (!columns.is_empty()).then(|| Self {
            cells: if columns.len() == 1 { vec![width] } else { vec![width, columns.len()] },
            usual_axes: if columns.len() == 1 { vec!["taxel"] } else { vec!["taxel", "component"] },
            time_names: time.map(|k| names[k].to_owned()).into_iter().collect(),
            time_unit: time.and_then(|k| TimeUnit::named(name_and_unit(words[k]).1)),
            columns,
            ..Self::default()
        })
    }
}

/// Some names, for messages.
pub(in crate::io) fn listed(names: &[&str]) -> String {
    /// Names that an error lists.
    const LISTED: usize = 12;
    let more = if names.len() > LISTED { ", ..." } else { "" };
    names[..names.len().min(LISTED)].join(", ") + more
}

/// The patterns of the names that differ by a number, of which there are most: one, or one for each component; and how many
/// names have each.
fn patterns_of(names: &[&str]) -> (Vec<String>, usize) {
    let mut numbers: Vec<(String, Vec<&str>)> = Vec::new();
    for name in names {
        let Some(start) = name.find(|c: char| c.is_ascii_digit()) else { continue };
        let rest = name[start..].trim_start_matches(|c: char| c.is_ascii_digit());
        let pattern = format!("{}{{id}}{rest}", &name[..start]);
        let number = &name[start..name.len() - rest.len()];
        match numbers.iter_mut().find(|(known, _)| *known == pattern) {
            Some((_, all)) => all.push(number),
            None => numbers.push((pattern, vec![number])),
        }
    }
    let most = numbers.iter().map(|(_, all)| all.len()).max().unwrap_or(0);
    let Some(first) = numbers.iter().find(|(_, all)| all.len() == most && most > 1) else {
        return (Vec::new(), 0);
    };
    let alike = numbers.iter().filter(|(_, all)| *all == first.1);
    (alike.map(|(pattern, _)| pattern.clone()).collect(), most)
}
