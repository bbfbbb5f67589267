//! Which taxel of the second file is which of the first.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use crate::diff::{DiffError, MatchedBy};
use crate::skin::{Draft, Presence, Sheet, TaxelId};

/// A taxel of a file.
#[derive(Debug, Clone)]
pub(super) struct Place {
    /// Its id; 0 in a file without ids.
    pub(super) id: TaxelId,
    pub(super) link: String,
    pub(super) patch: String,
    row: usize,
    pub(super) module: Option<String>,
    pub(super) position: DVec3,
    /// The variance along an axis, in m^2: a third of the trace of its covariance.
    pub(super) variance: Option<f64>,
}

/// A taxel of both files.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub(super) before: Place,
    pub(super) after: Place,
}

impl Pair {
    /// Standard deviation of the difference along an axis, in m, where the files have it.
    pub(super) fn sigma(&self) -> Option<f64> {
        match (self.before.variance, self.after.variance) {
            (None, None) => None,
            (a, b) => Some((a.unwrap_or(0.0) + b.unwrap_or(0.0)).sqrt()).filter(|&sigma| sigma > 0.0),
        }
    }
}

/// What lies on a link of the first file.
#[derive(Debug, Clone, Default)]
pub(super) struct LinkPairs {
    pub(super) name: String,
    pub(super) pairs: Vec<Pair>,
    /// Taxels of the first file alone.
    pub(super) missing: Vec<Place>,
}

/// The taxels of two files.
pub(super) struct Pairs {
    pub(super) by: MatchedBy,
    pub(super) ambiguous: [usize; 2],
    /// In the order of the first file.
    pub(super) links: Vec<LinkPairs>,
    /// Taxels of the second file alone.
    pub(super) new: Vec<Place>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Key {
    Id(TaxelId),
    Row(String, usize),
}

impl Pairs {
    pub(super) fn new(
        before: &Draft,
        after: &Draft,
        modules: &[(TaxelId, String)],
    ) -> Result<Self, DiffError> {
        let has_ids = [before, after].iter().all(|draft| draft.sheets.iter().any(|s| s.ids.is_some()));
        let by = if has_ids { MatchedBy::Id } else { MatchedBy::Row };
        let modules: HashMap<TaxelId, &str> = modules.iter().map(|(id, name)| (*id, &**name)).collect();
        let [mut first, second] = [before, after].map(|draft| places(draft, &modules));
        let sizes = [first.len(), second.len()];
        let ambiguous = [ambiguous(&first, by), ambiguous(&second, by)];
        first.retain(|place| !ambiguous[0].contains(&key(place, by)));
        let mut keyed: HashMap<Key, Place> = HashMap::new();
        let mut order = Vec::new();
        for place in second {
            let key = key(&place, by);
            if !ambiguous[1].contains(&key) {
                order.push(key.clone());
                keyed.insert(key, place);
            }
        }
        let lost = [sizes[0] - first.len(), sizes[1] - order.len()];
        let mut links: Vec<LinkPairs> = Vec::new();
        for place in first {
            let number = links.iter().position(|link| link.name == place.link).unwrap_or_else(|| {
                links.push(LinkPairs { name: place.link.clone(), ..LinkPairs::default() });
                links.len() - 1
            });
            match keyed.remove(&key(&place, by)) {
                Some(after) => links[number].pairs.push(Pair { before: place, after }),
                None => links[number].missing.push(place),
            }
        }
        if links.iter().all(|link| link.pairs.is_empty()) {
            return Err(DiffError::NothingShared { before: sizes[0], after: sizes[1], by });
        }
        let new = order.iter().filter_map(|key| keyed.remove(key)).collect();
        Ok(Self { by, ambiguous: lost, links, new })
    }
}

fn key(place: &Place, by: MatchedBy) -> Key {
    match by {
        MatchedBy::Id => Key::Id(place.id),
        MatchedBy::Row => Key::Row(place.patch.clone(), place.row),
    }
}

/// Keys that are no name of one taxel.
fn ambiguous(places: &[Place], by: MatchedBy) -> HashSet<Key> {
    let mut seen = HashSet::new();
    places.iter().filter(|place| !seen.insert(key(place, by))).map(|place| key(place, by)).collect()
}

/// The taxels of a file: slots without a taxel, and positions that are not finite, are none.
fn places(draft: &Draft, modules: &HashMap<TaxelId, &str>) -> Vec<Place> {
    let of_sheet = |sheet: &Sheet| -> Vec<Place> {
        let link = sheet.link.map_or(String::new(), |link| draft.links[link].name.clone());
        let place = |row: usize| {
            let position = *sheet.positions.get(row)?;
            let presence = sheet.presence.as_ref().and_then(|all| all.get(row));
            if !position.is_finite() || presence == Some(&Presence::Absent) {
                return None;
            }
            let id = sheet.ids.as_ref().and_then(|all| all.get(row)).copied().unwrap_or_default();
            let own = || Some(sheet.modules.as_ref()?.get(row)?.to_string());
            let covariance = sheet.covariances.as_ref().and_then(|all| *all.get(row)?);
            let variance = covariance.map(|c| c.sigma().powi(2) / 3.0).filter(|v| v.is_finite());
            Some(Place {
                id,
                link: link.clone(),
                patch: sheet.name.clone(),
                row,
                module: modules.get(&id).map(|&name| name.to_owned()).or_else(own),
                position,
                variance,
            })
        };
        (0..sheet.positions.len()).filter_map(place).collect()
    };
    draft.sheets.iter().flat_map(of_sheet).collect()
}
