//! Patches and skins: the plain data from which all later steps start.

use std::{borrow::Cow, collections::HashSet};

use glam::DAffine3;

use crate::id::{IdVec, define_id};
use crate::mesh::{Adjacency, TriMesh, is_rigid, is_within_reach};
use crate::skin::link::{append_links, before_parents};
use crate::skin::motion::moved_links;
use crate::skin::names::Names;
use crate::skin::{Link, LinkId, Motion, Remark, RemarkKind, SkinError, TaxelError, Taxels, world_pose};

define_id!(
    /// A patch of one skin.
    pub PatchId, "p"
);

/// One connected sheet of taxels on one link.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// Name, unique within a skin.
    pub name: String,
    /// The link it is fixed to.
    pub link: LinkId,
    /// Taxel positions in the link's frame and triangles seen from outside: manifold, one
    /// component, no vertex without a face.
    pub mesh: TriMesh,
    /// How many of the last triangles fill holes: they are not skin, and no taxel lies in them.
    pub filled: usize,
    /// The properties of each vertex of the mesh.
    pub taxels: Taxels,
}

impl Patch {
    /// A patch of a bare mesh: ids count from 1, normals and areas come from the triangles.
    pub fn from_mesh(name: impl Into<String>, link: LinkId, mesh: TriMesh) -> Self {
        Self { name: name.into(), link, taxels: Taxels::from(&mesh), mesh, filled: 0 }
    }

    /// Checks every rule that concerns this patch alone.
    pub(super) fn validate(&self) -> Result<(), SkinError> {
        let patch = || self.name.clone();
        let adjacency =
            Adjacency::new(&self.mesh).map_err(|source| SkinError::Mesh { patch: patch(), source })?;
        let found = adjacency.topology().components;
        if found != 1 {
            return Err(SkinError::Components { patch: patch(), found });
        }
        let (found, faces) = (self.filled, self.mesh.triangles.len());
        if found > faces {
            return Err(SkinError::Filled { patch: patch(), found, faces });
        }
        self.taxels
            .validate(self.mesh.positions.len())
            .map_err(|source| SkinError::Taxels { patch: patch(), source })
    }

    /// The patch in another frame, transformed by a rigid pose.
    fn posed(&self, pose: &DAffine3) -> Self {
        let positions = self.mesh.positions.map(|x| pose.transform_point3(*x));
        let mesh = TriMesh { positions, triangles: self.mesh.triangles.clone() };
        Self {
            name: self.name.clone(),
            link: self.link,
            mesh,
            filled: self.filled,
            taxels: self.taxels.posed(pose),
        }
    }
}

/// All patches of a robot, with the frames of its links.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skin {
    /// The links; a parent comes before its children.
    pub links: IdVec<LinkId, Link>,
    /// The patches.
    pub patches: IdVec<PatchId, Patch>,
    /// Animations of the links.
    pub animations: Vec<Motion>,
}

impl Skin {
    /// A skin of one bare mesh on one link at the origin.
    pub fn from_mesh(name: &str, mesh: TriMesh) -> Self {
        let mut skin = Self::default();
        let link = skin.links.push(Link { name: String::new(), parent: None, pose: DAffine3::IDENTITY });
        skin.patches.push(Patch::from_mesh(name, link, mesh));
        skin
    }

    /// The skin without its acuities if there is one for all of its taxels, since only ratios matter.
    #[doc(hidden)]
    pub fn without_even_acuities(&self) -> Option<Self> {
        let acuities = || {
            self.patches.iter().flat_map(|patch| {
                let all = patch.taxels.acuities.as_ref();
                patch.taxels.ids.ids().map(move |v| all.map_or(1.0, |all| all[v]))
            })
        };
        let has_some = self.patches.iter().any(|patch| patch.taxels.acuities.is_some());
        let is_even = has_some && acuities().zip(acuities().skip(1)).all(|(a, b)| a == b);
        is_even.then(|| {
            let mut skin = self.clone();
            skin.patches.iter_mut().for_each(|patch| patch.taxels.acuities = None);
            skin
        })
    }

    /// A patch of this skin in the frame of the world, for formats without frames.
    #[doc(hidden)]
    pub fn in_world<'a>(&self, patch: &'a Patch) -> Cow<'a, Patch> {
        let pose = world_pose(&self.links, patch.link);
        if pose == DAffine3::IDENTITY { Cow::Borrowed(patch) } else { Cow::Owned(patch.posed(&pose)) }
    }

    /// Adds the patches of another valid skin. Links of each become one as in [`Draft::append`](crate::skin::Draft::append).
    /// A patch whose name is taken gets another one; the remarks say so.
    pub fn append(&mut self, other: &Self) -> Vec<Remark> {
        let links = append_links(
            &mut self.links,
            &other.links,
            [&self.animations, &other.animations].map(|all| moved_links(all)),
        );
        let all = self.patches.iter().chain(&other.patches);
        let mut names = Names::new(all.map(|patch| &*patch.name));
        for patch in &self.patches {
            names.next(&patch.name);
        }
        let mut remarks = Vec::new();
        for mut patch in other.patches.iter().cloned() {
            patch.link = links[patch.link];
            for (link, _) in patch.taxels.joints.iter_mut().flat_map(|joints| joints.iter_mut()).flatten() {
                *link = links.get(*link).copied().unwrap_or(*link);
            }
            for (link, _) in &mut patch.taxels.binds {
                *link = links.get(*link).copied().unwrap_or(*link);
            }
            let name = names.next(&patch.name);
            if name != patch.name {
                let kind = RemarkKind::Renamed { name: name.clone() };
                remarks.push(Remark { patch: std::mem::replace(&mut patch.name, name), kind });
            }
            self.patches.push(patch);
        }
        self.animations.extend(other.animations.iter().map(|motion| motion.of_links(&links)));
        remarks
    }

    /// Checks every rule of [`Patch`] and of the links.
    ///
    /// # Errors
    /// The first broken rule, with the patch's name.
    pub fn validate(&self) -> Result<(), SkinError> {
        check_patches(&self.links, self.patches.iter().map(|p| (p.name.as_str(), p.link, &p.taxels)))?;
        self.patches.iter().try_for_each(Patch::validate)
    }
}

/// Checks the links, and that patches have names of their own, and links and joints that exist.
pub(crate) fn check_patches<'a>(
    links: &IdVec<LinkId, Link>,
    patches: impl Iterator<Item = (&'a str, LinkId, &'a Taxels)>,
) -> Result<(), SkinError> {
    check_links(links)?;
    let mut names = HashSet::new();
    for (name, link, taxels) in patches {
        if link.index() >= links.len() {
            return Err(SkinError::UnknownLink { patch: name.to_owned(), link });
        }
        check_joints(name, taxels, links.len())?;
        if !names.insert(name) {
            return Err(SkinError::DuplicateName { patch: name.to_owned() });
        }
    }
    Ok(())
}

/// Checks that the taxels of a patch follow links that exist.
pub(super) fn check_joints(patch: &str, taxels: &Taxels, links: usize) -> Result<(), SkinError> {
    let mut joints = taxels.joints.iter().flat_map(IdVec::enumerate);
    let unknown =
        joints.find_map(|(v, all)| Some((v, all.iter().find(|j| j.1 > 0.0 && j.0.index() >= links)?.0)));
    let Some((vertex, link)) = unknown else { return Ok(()) };
    let source = TaxelError::UnknownJoint { vertex, link, links };
    Err(SkinError::Taxels { patch: patch.to_owned(), source })
}

/// Checks that links come after their parents and have rigid poses. Names may be empty or repeat: a
/// link is known by its id.
pub(crate) fn check_links(links: &IdVec<LinkId, Link>) -> Result<(), SkinError> {
    if let Some(link) = before_parents(links).next() {
        return Err(SkinError::LinkOrder { link });
    }
    let is_valid = |pose: &DAffine3| is_rigid(pose) && is_within_reach(pose.translation);
    match links.enumerate().find(|(_, link)| !is_valid(&link.pose)) {
        Some((link, _)) => Err(SkinError::LinkPose { link }),
        None => Ok(()),
    }
}
