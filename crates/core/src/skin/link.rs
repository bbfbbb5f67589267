//! Links: the frames of a robot that patches are fixed to.

use std::collections::HashSet;

use glam::DAffine3;

use crate::id::{IdVec, define_id};

define_id!(
    /// A link of one robot.
    pub LinkId, "link"
);

/// A link of the robot: a frame that patches are fixed to.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name, as the robot's model gives it; may be empty.
    pub name: String,
    /// The link that carries it; always an earlier link.
    pub parent: Option<LinkId>,
    /// Its frame in that of its parent (or of the world), in m.
    pub pose: DAffine3,
}

/// The frame of `link` in the world.
pub fn world_pose(links: &IdVec<LinkId, Link>, link: LinkId) -> DAffine3 {
    let mut pose = links[link].pose;
    let mut at = links[link].parent;
    while let Some(parent) = at {
        pose = links[parent].pose * pose;
        at = links[parent].parent;
    }
    pose
}

/// The name that maps and queries use for each link: its own, or `link` and its number.
pub fn link_names(links: &IdVec<LinkId, Link>) -> IdVec<LinkId, String> {
    let taken: HashSet<&str> = links.iter().map(|link| &*link.name).collect();
    let name = |(id, link): (LinkId, &Link)| {
        let mut name = link.name.clone();
        if name.is_empty() {
            name = format!("link{}", id.raw());
            while taken.contains(&*name) {
                name.push('_');
            }
        }
        name
    };
    links.enumerate().map(name).collect()
}

/// The link of a name; otherwise how many links have it, none or several.
#[doc(hidden)]
pub fn link_named(links: &IdVec<LinkId, Link>, name: &str) -> Result<LinkId, usize> {
    let mut named = links.enumerate().filter(|(_, link)| link.name == name).map(|(id, _)| id);
    match (named.next(), named.count()) {
        (Some(link), 0) => Ok(link),
        (first, others) => Err(usize::from(first.is_some()) + others),
    }
}

/// Adds the links of another file, and returns what each is then: one that was there if name, parent and pose are equal
/// it has a name or is `moved` in neither file; each of those is at most one of the others. Panics if a parent is no
/// earlier link.
pub(super) fn append_links(
    links: &mut IdVec<LinkId, Link>,
    others: &IdVec<LinkId, Link>,
    [moved, moved_there]: [HashSet<LinkId>; 2],
) -> IdVec<LinkId, LinkId> {
    let earlier = links.len();
    let mut ids = IdVec::<LinkId, LinkId>::default();
    for (other, link) in others.enumerate() {
        let link = Link { parent: link.parent.map(|parent| ids[parent]), ..link.clone() };
        let is_same = |&(id, known): &(LinkId, &Link)| {
            let is_known = !link.name.is_empty() || !(moved.contains(&id) || moved_there.contains(&other));
            *known == link && is_known && ids.iter().all(|taken| *taken != id)
        };
        let known = links.enumerate().take(earlier).find(is_same).map(|(id, _)| id);
        ids.push(known.unwrap_or_else(|| links.push(link)));
    }
    ids
}

/// The links, with [`link_names`] as their names.
#[doc(hidden)]
pub fn named_links(links: &IdVec<LinkId, Link>) -> IdVec<LinkId, Link> {
    links.iter().zip(link_names(links)).map(|(link, name)| Link { name, ..link.clone() }).collect()
}

/// The links that do not come after their parent.
pub(super) fn before_parents(links: &IdVec<LinkId, Link>) -> impl Iterator<Item = LinkId> {
    links.enumerate().filter(|(id, link)| link.parent.is_some_and(|parent| parent >= *id)).map(|(id, _)| id)
}
