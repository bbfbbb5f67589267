//! What a drawing of the skin says of the taxels of a log: their normals and neighbours, and which column is of which taxel.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::skin::{Draft, Link, LinkId, Patch, Presence, Skin, TaxelId};
use crate::touches::{TouchReadings, TouchesError};

/// A drawing of a skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Drawing {
    /// Positions of the taxels, in m. Only their distances move contacts.
    pub positions: BTreeMap<TaxelId, DVec3>,
    /// Normals of the taxels, which point outwards; of all taxels that it has.
    pub normals: BTreeMap<TaxelId, DVec3>,
    /// Pairs of neighbours.
    pub neighbours: BTreeSet<[TaxelId; 2]>,
}

impl Drawing {
    /// The normals and neighbours of a skin, in the frame of the link of a log: of the taxels on the link of that name, or
    /// of all if no link has that name and one alone has taxels, or the name is empty. An id that several taxels have as a placeholder is of none of them.
    ///
    /// # Errors
    /// [`TouchesError::SharedId`] if working taxels share another id, [`TouchesError::SharedLink`] if links share the name,
    /// [`TouchesError::UnknownLink`] if several links have taxels and none has the name.
    pub fn of_link(skin: &Skin, link: &str) -> Result<Self, TouchesError> {
        let mut drawing = Self::default();
        for (_, patch, v) in taxels_of(skin, link)? {
            let id = patch.taxels.ids[v];
            let is_working = patch.taxels.presence[v] == Presence::Present;
            if is_working || !drawing.normals.contains_key(&id) {
                drawing.positions.insert(id, patch.mesh.positions[v]);
                drawing.normals.insert(id, patch.taxels.normals[v]);
            }
        }
        for patch in skin.patches.iter().filter(on_link(skin, link)?) {
            let ids = &patch.taxels.ids;
            for corners in &patch.mesh.triangles {
                for k in 0..3 {
                    let pair = [ids[corners[k]], ids[corners[(k + 1) % 3]]];
                    drawing.neighbours.insert([pair[0].min(pair[1]), pair[0].max(pair[1])]);
                }
            }
        }
        Ok(drawing)
    }

    /// Adds the taxels of a file that are in no triangle, and so not in its skin: those of the link of that name, or of all
    /// links if none has it.
    ///
    /// # Errors
    /// [`TouchesError::SharedLink`] if several links of the name have taxels.
    pub fn add_bare(&mut self, draft: &Draft, link: &str) -> Result<(), TouchesError> {
        let known = one_of_name(&draft.links, link, |id| draft.sheets.iter().any(|s| s.link == Some(*id)))?;
        for sheet in draft.sheets.iter().filter(|sheet| known.is_none() || sheet.link == known) {
            for (k, id) in sheet.ids.iter().flatten().enumerate() {
                let normal = sheet.normals.as_ref().and_then(|normals| normals.get(k));
                let Some((&position, &normal)) = sheet.positions.get(k).zip(normal) else { continue };
                if !TaxelId::PLACEHOLDERS.contains(id) && !self.normals.contains_key(id) {
                    self.positions.insert(*id, position);
                    self.normals.insert(*id, normal);
                }
            }
        }
        Ok(())
    }
}

impl TouchReadings {
    /// Readings without ids, one column for each taxel of a skin in its order: keeps those of the working taxels of the link
    /// of a log, as [`Drawing::of_link`] takes them, with their ids. Readings with ids stay as they are.
    ///
    /// # Errors
    /// [`TouchesError::Columns`] if there is not one column for each taxel; [`TouchesError::SharedId`];
    /// [`TouchesError::SharedLink`].
    pub fn assign(&mut self, skin: &Skin, link: &str) -> Result<(), TouchesError> {
        if !self.ids.is_empty() || self.times.is_empty() {
            return Ok(());
        }
        let found = self.values.len() / self.times.len();
        let needed = skin.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        if found != needed {
            return Err(TouchesError::Columns { found, needed });
        }
        let mut taxels = taxels_of(skin, link)?;
        taxels.retain(|(_, patch, v)| patch.taxels.presence[*v] == Presence::Present);
        self.ids = taxels.iter().map(|(_, patch, v)| patch.taxels.ids[*v]).collect();
        let row = |row: &[f64]| taxels.iter().map(|(column, ..)| row[*column]).collect::<Vec<f64>>();
        self.values = self.values.chunks_exact(found.max(1)).flat_map(row).collect();
        Ok(())
    }
}

/// The link of a name: the one that has taxels, if one has.
fn one_of_name(
    links: &IdVec<LinkId, Link>,
    name: &str,
    has_taxels: impl Fn(&LinkId) -> bool,
) -> Result<Option<LinkId>, TouchesError> {
    let named = || links.enumerate().filter(|(_, link)| link.name == name).map(|(id, _)| id);
    match named().filter(&has_taxels).count() {
        links @ 2.. => Err(TouchesError::SharedLink { link: name.to_owned(), links }),
        _ => Ok(named().find(has_taxels).or_else(|| named().next())),
    }
}

/// Whether a patch is on the link of a name; each is if no link has that name and one alone has patches, or the name is empty.
fn on_link<'a>(skin: &Skin, link: &str) -> Result<impl Fn(&&'a Patch) -> bool + use<'a>, TouchesError> {
    let has_patch = |id: &LinkId| skin.patches.iter().any(|patch| patch.link == *id);
    let known = one_of_name(&skin.links, link, has_patch)?;
    let with_patches: Vec<String> =
        skin.links.enumerate().filter(|(id, _)| has_patch(id)).map(|(_, link)| link.name.clone()).collect();
    if known.is_none() && !link.is_empty() && with_patches.len() > 1 {
        return Err(TouchesError::UnknownLink { link: link.to_owned(), names: with_patches });
    }
    Ok(move |patch: &&'a Patch| known.is_none_or(|link| patch.link == link))
}

/// The taxels of a skin that a log of this link may name, with their numbers in the skin.
fn taxels_of<'a>(skin: &'a Skin, link: &str) -> Result<Vec<(usize, &'a Patch, VertexId)>, TouchesError> {
    let on_link = on_link(skin, link)?;
    let all = || skin.patches.iter().flat_map(|patch| patch.taxels.ids.ids().map(move |v| (patch, v)));
    let mut seen: BTreeMap<TaxelId, Vec<(&Patch, VertexId)>> = BTreeMap::new();
    let mut taxels = Vec::new();
    for (number, (patch, v)) in all().enumerate() {
        if on_link(&patch) {
            taxels.push((number, patch, v));
            seen.entry(patch.taxels.ids[v]).or_default().push((patch, v));
        }
    }
    let is_placeholder = |id: &TaxelId| TaxelId::PLACEHOLDERS.contains(id) && seen[id].len() > 1;
    let is_working = |(patch, v): &&(&Patch, VertexId)| patch.taxels.presence[*v] == Presence::Present;
    for (&id, own) in seen.iter().filter(|(id, _)| !is_placeholder(id)) {
        let mut working = own.iter().filter(is_working);
        if let (Some((first, _)), Some((second, _))) = (working.next(), working.next()) {
            let patches = [first.name.clone(), second.name.clone()];
            return Err(TouchesError::SharedId { id, patches });
        }
    }
    taxels.retain(|(_, patch, v)| !is_placeholder(&patch.taxels.ids[*v]));
    Ok(taxels)
}
