//! Which taxel of the second file is which of the first, and which link.

use std::collections::{BTreeMap, HashMap, HashSet};

use glam::{DAffine3, DVec3};

use crate::diff::{DiffError, MatchedBy};
use crate::id::IdVec;
use crate::mesh::is_within_reach;
use crate::numeric::median;
use crate::skin::{
    Draft, Link, LinkId, Presence, Sheet, SkinError, THERMAL, TOUCH, TaxelId, check_links, link_names,
    world_pose,
};

/// A taxel of a file.
#[derive(Debug, Clone)]
pub(super) struct Place {
    /// Its id; 0 in a sheet without ids.
    pub(super) id: TaxelId,
    key: Key,
    /// The number of its link among the [`FileLink`]s of its file.
    pub(super) link: usize,
    pub(super) patch: String,
    pub(super) module: Option<String>,
    /// What it senses; without a word on it, touch.
    pub(super) senses: String,
    /// Its region, empty without one; `None` if the file has no regions.
    pub(super) region: Option<String>,
    /// In the frame of its link, in m.
    pub(super) position: DVec3,
    /// A unit normal.
    pub(super) normal: Option<DVec3>,
    pub(super) area: Option<f64>,
    /// The variance along an axis, in m^2: a third of the trace of its covariance. 0 is exact.
    pub(super) variance: Option<f64>,
}

/// A link of a file.
#[derive(Debug, Clone)]
pub(super) struct FileLink {
    /// Its name, or `link` and its number; links that share a name have it with their count: `finger (2)`.
    pub(super) name: String,
    /// Whether the file names it.
    is_named: bool,
    /// Its frame in the world.
    pub(super) pose: DAffine3,
}

/// A taxel of both files.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub(super) before: Place,
    pub(super) after: Place,
    /// Standard deviation of the difference along an axis, in m, where the files state it; 0 is exact.
    pub(super) sigma: Option<f64>,
}

impl Pair {
    fn new(before: Place, after: Place) -> Self {
        let sigma = match (before.variance, after.variance) {
            (None, None) => None,
            (a, b) => Some((a.unwrap_or(0.0) + b.unwrap_or(0.0)).sqrt()),
        };
        Self { before, after, sigma }
    }
}

/// What lies on a link of the first file.
#[derive(Debug, Clone)]
pub(super) struct LinkPairs {
    /// Taxels of both files, on this link in both.
    pub(super) pairs: Vec<Pair>,
    /// Taxels that are on another link in the second file.
    pub(super) relinked: Vec<Pair>,
    /// Taxels of the first file alone.
    pub(super) missing: Vec<Place>,
    /// The number of the link in the second file.
    pub(super) there: Option<usize>,
}

/// The taxels of two files.
pub(super) struct Pairs {
    pub(super) by: MatchedBy,
    pub(super) ambiguous: [usize; 2],
    /// The links of both files.
    pub(super) names: [Vec<FileLink>; 2],
    /// By the number of the link in the first file.
    pub(super) links: BTreeMap<usize, LinkPairs>,
    /// Taxels of the second file alone.
    pub(super) new: Vec<Place>,
    /// The median of the standard deviations that the files state, without those of exact taxels, in m.
    pub(super) typical_sigma: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Key {
    Id(TaxelId),
    /// An id that several taxels of a file share, on the link of this name.
    OnLink(String, TaxelId),
    /// The same on a link and patch of these names.
    OnPatch(String, String, TaxelId),
    Row(String, usize),
}

impl Key {
    /// The link, and patch, of an id that is shared.
    fn place(&self) -> Option<(&str, Option<&str>)> {
        match self {
            Self::OnLink(link, _) => Some((link, None)),
            Self::OnPatch(link, patch, _) => Some((link, Some(patch))),
            Self::Id(_) | Self::Row(..) => None,
        }
    }

    fn id(&self) -> Option<TaxelId> {
        match self {
            Self::Id(id) | Self::OnLink(_, id) | Self::OnPatch(.., id) => Some(*id),
            Self::Row(..) => None,
        }
    }
}

impl Pairs {
    /// `modules` are those of the first and of the second file, where these do not have them.
    pub(super) fn new(
        [before, after]: [&Draft; 2],
        modules: &[Vec<(TaxelId, String)>; 2],
    ) -> Result<Self, DiffError> {
        let has_ids = [before, after].iter().all(|draft| draft.sheets.iter().any(|s| s.ids.is_some()));
        let by = if has_ids { MatchedBy::Id } else { MatchedBy::Row };
        let is_alone = |draft: &Draft| draft.sheets.iter().filter(|s| !s.positions.is_empty()).count() == 1;
        // One sheet each are a pair, whatever their names, which are those of files.
        let are_alone = is_alone(before) && is_alone(after);
        let names = [file_links(before)?, file_links(after)?];
        let mut first = places(before, &modules[0], by, are_alone)?;
        let mut second = places(after, &modules[1], by, are_alone)?;
        let sizes = [first.len(), second.len()];
        name_shared([&mut first, &mut second], &names);
        drop_unclear([&mut first, &mut second], &names);
        let mut keyed: HashMap<Key, Place> = HashMap::new();
        let mut order = Vec::new();
        for place in second {
            order.push(place.key.clone());
            keyed.insert(place.key.clone(), place);
        }
        let lost = [sizes[0] - first.len(), sizes[1] - order.len()];
        let mut links: BTreeMap<usize, LinkPairs> = BTreeMap::new();
        for place in first {
            let link = links.entry(place.link).or_insert_with(|| LinkPairs {
                pairs: Vec::new(),
                relinked: Vec::new(),
                missing: Vec::new(),
                there: None,
            });
            match keyed.remove(&place.key) {
                Some(after) => link.pairs.push(Pair::new(place, after)),
                None => link.missing.push(place),
            }
        }
        let pairs = || links.values().flat_map(|link| &link.pairs);
        if pairs().next().is_none() {
            return Err(DiffError::NothingShared { before: sizes[0], after: sizes[1], by });
        }
        let typical_sigma = median(pairs().filter_map(|pair| pair.sigma).filter(|&sigma| sigma > 0.0));
        for (&number, link) in &mut links {
            link.there = counterpart(&names, number, &link.pairs);
            let is_there = |pair: &Pair| Some(pair.after.link) == link.there;
            (link.pairs, link.relinked) = link.pairs.drain(..).partition(is_there);
        }
        let new = order.iter().filter_map(|key| keyed.remove(key)).collect();
        Ok(Self { by, ambiguous: lost, names, links, new, typical_sigma })
    }
}

/// The link of the second file that one of the first is: that of its name if it has a pair, else that with most pairs.
fn counterpart([before, after]: &[Vec<FileLink>; 2], link: usize, pairs: &[Pair]) -> Option<usize> {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    pairs.iter().for_each(|pair| *counts.entry(pair.after.link).or_default() += 1);
    let own = &before[link];
    let is_namesake = |there: &&usize| own.is_named && after[**there].name == own.name;
    let namesake = counts.keys().find(is_namesake).copied();
    // Of as many the one with the number of the link, else the first.
    let most = counts.iter().max_by_key(|&(&there, &count)| (count, there == link, usize::MAX - there));
    namesake.or(most.map(|(there, _)| *there))
}

/// Whether the names of two links say that they are two.
pub(super) fn differ(before: &FileLink, after: &FileLink) -> bool {
    before.is_named && after.is_named && before.name != after.name
}

/// Names taxels whose id several of a file share by link and id, and where that is not enough by patch, too.
fn name_shared(files: [&mut Vec<Place>; 2], names: &[Vec<FileLink>; 2]) {
    let mut files = files;
    for by_patch in [false, true] {
        let shared: HashSet<TaxelId> =
            files.iter().flat_map(|places| ambiguous(places)).filter_map(|key| key.id()).collect();
        for (places, links) in files.iter_mut().zip(names) {
            for place in places.iter_mut() {
                let Some(id) = place.key.id().filter(|id| shared.contains(id)) else { continue };
                let link = links[place.link].name.clone();
                place.key = match by_patch {
                    false => Key::OnLink(link, id),
                    true => Key::OnPatch(link, place.patch.clone(), id),
                };
            }
        }
    }
}

/// Drops taxels of which it is not known which of the other file they are: those whose name is still shared in a file, and those with a
/// shared id on a link or patch that the other file does not have.
fn drop_unclear([first, second]: [&mut Vec<Place>; 2], [names, names_there]: &[Vec<FileLink>; 2]) {
    let shared: HashSet<Key> = ambiguous(first).union(&ambiguous(second)).cloned().collect();
    let of = |places: &[Place], links: &[FileLink]| -> HashSet<(String, String)> {
        places.iter().map(|place| (links[place.link].name.clone(), place.patch.clone())).collect()
    };
    let there = [of(second, names_there), of(first, names)];
    for (places, there) in [first, second].into_iter().zip(there) {
        let is_there = |(link, patch): (&str, Option<&str>)| {
            there.iter().any(|(other, on)| other == link && patch.is_none_or(|patch| patch == on))
        };
        places.retain(|place| !shared.contains(&place.key) && place.key.place().is_none_or(is_there));
    }
}

/// Keys that are no name of one taxel.
fn ambiguous(places: &[Place]) -> HashSet<Key> {
    let mut seen = HashSet::new();
    places.iter().map(|place| &place.key).filter(|key| !seen.insert(*key)).cloned().collect()
}

/// The links of a file; one without a name at the origin stands at the end, for sheets without a link.
fn file_links(draft: &Draft) -> Result<Vec<FileLink>, SkinError> {
    check_links(&draft.links)?;
    let mut uses: HashMap<String, usize> = HashMap::new();
    let names: IdVec<LinkId, String> = link_names(&draft.links);
    let of = |(id, link): (LinkId, &Link)| {
        let count = uses.entry(names[id].clone()).or_default();
        *count += 1;
        let name = if *count > 1 { format!("{} ({count})", names[id]) } else { names[id].clone() };
        FileLink { name, is_named: !link.name.is_empty(), pose: world_pose(&draft.links, id) }
    };
    let mut links: Vec<FileLink> = draft.links.enumerate().map(of).collect();
    links.push(FileLink { name: String::new(), is_named: false, pose: DAffine3::IDENTITY });
    Ok(links)
}

/// The taxels of a file: slots without a taxel, and positions that are not finite or beyond reach, are none.
fn places(
    draft: &Draft,
    modules: &[(TaxelId, String)],
    by: MatchedBy,
    is_alone: bool,
) -> Result<Vec<Place>, SkinError> {
    let modules: HashMap<TaxelId, &str> = modules.iter().map(|(id, name)| (*id, &**name)).collect();
    let of_sheet = |sheet: &Sheet| -> Result<Vec<Place>, SkinError> {
        if let Some(link) = sheet.link.filter(|link| link.index() >= draft.links.len()) {
            return Err(SkinError::UnknownLink { patch: sheet.title().to_owned(), link });
        }
        let place = |row: usize| {
            let position = *sheet.positions.get(row)?;
            let presence = sheet.presence.as_ref().and_then(|all| all.get(row));
            if !is_within_reach(position) || presence == Some(&Presence::Absent) {
                return None;
            }
            let given = sheet.ids.as_ref().and_then(|all| all.get(row)).copied();
            let id = given.unwrap_or_default();
            let own = || Some(sheet.modules.as_ref()?.get(row)?.to_string());
            let covariance = sheet.covariances.as_ref().and_then(|all| *all.get(row)?);
            let normal = sheet.normals.as_ref().and_then(|all| all.get(row));
            let area = sheet.areas.as_ref().and_then(|all| all.get(row)).copied();
            Some(Place {
                id,
                key: match (by, given) {
                    (MatchedBy::Id, Some(id)) => Key::Id(id),
                    _ if is_alone => Key::Row(String::new(), row),
                    _ => Key::Row(sheet.name.clone(), row),
                },
                link: sheet.link.map_or(draft.links.len(), LinkId::index),
                patch: sheet.name.clone(),
                module: modules.get(&id).map(|&name| name.to_owned()).or_else(own),
                senses: senses(sheet, row, presence),
                region: sheet.regions.as_ref().map(|all| {
                    all.get(row).and_then(Option::as_ref).map_or_else(String::new, ToString::to_string)
                }),
                position,
                normal: normal.and_then(|normal| normal.try_normalize()),
                area: area.filter(|&area| area.is_finite() && area > 0.0),
                variance: covariance.map(|c| c.sigma().powi(2) / 3.0).filter(|v| v.is_finite()),
            })
        };
        Ok((0..sheet.positions.len()).filter_map(place).collect())
    };
    Ok(draft.sheets.iter().map(of_sheet).collect::<Result<Vec<_>, _>>()?.concat())
}

/// What a taxel senses: its modalities, or else what its presence says.
fn senses(sheet: &Sheet, row: usize, presence: Option<&Presence>) -> String {
    let given = sheet.modalities.as_ref().and_then(|all| all.get(row)?.clone());
    let by_presence = match presence {
        Some(Presence::ThermalPad) => THERMAL,
        Some(Presence::Other) => "other",
        _ => TOUCH,
    };
    given.map_or_else(|| by_presence.to_owned(), |given| given.to_string())
}
