use std::collections::HashSet;

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId, define_id},
    mesh::{Adjacency, TriMesh},
    skin::{Link, LinkId, SkinError, TaxelId},
};

define_id!(
    /// A patch of one skin.
    PatchId, "p"
);

/// What a slot of the skin holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Presence {
    /// A working taxel.
    #[default]
    Present,
    /// No taxel, or a dead one.
    Absent,
    /// A thermal pad: it has a place but no pressure reading.
    ThermalPad,
}

/// One connected sheet of taxels on one link.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// Name, unique within a skin.
    pub name: String,
    /// The link it is fixed to.
    pub link: LinkId,
    /// Taxel positions in the link's frame and triangles seen from outside: manifold, one component, no
    /// vertex without a face.
    pub mesh: TriMesh,
    /// Vendor ids; not unique.
    pub ids: IdVec<VertexId, TaxelId>,
    /// Unit normals in the link's frame, outward.
    pub normals: IdVec<VertexId, DVec3>,
    /// Receptive areas in m^2, positive.
    pub areas: IdVec<VertexId, f64>,
    /// Taxels per m^2, positive; `None`: as the spacing says.
    pub densities: Option<IdVec<VertexId, f64>>,
    /// What each slot holds.
    pub presence: IdVec<VertexId, Presence>,
    /// How uncertain the positions are: covariances `xx xy xz yy yz zz` in m^2, in the link's frame; `None`: unknown.
    pub covariances: Option<IdVec<VertexId, [f64; 6]>>,
}

impl Patch {
    /// A patch of a bare mesh: ids count from 1, normals and areas come from the triangles.
    #[must_use]
    pub fn from_mesh(name: impl Into<String>, link: LinkId, mesh: TriMesh) -> Self {
        let count = mesh.positions.len();
        Self {
            name: name.into(),
            link,
            ids: mesh.positions.ids().map(|v| TaxelId(v.raw() + 1)).collect(),
            normals: mesh.vertex_normals(),
            areas: mesh.vertex_areas(),
            densities: None,
            presence: IdVec::filled(Presence::Present, count),
            covariances: None,
            mesh,
        }
    }

    /// Checks every promise that concerns this patch alone.
    ///
    /// # Errors
    /// The first broken promise.
    pub fn validate(&self) -> Result<(), SkinError> {
        let patch = || self.name.clone();
        let needed = self.mesh.positions.len();
        let lengths = [
            self.ids.len(),
            self.normals.len(),
            self.areas.len(),
            self.presence.len(),
            self.densities.as_ref().map_or(needed, IdVec::len),
            self.covariances.as_ref().map_or(needed, IdVec::len),
        ];
        if let Some(&found) = lengths.iter().find(|&&n| n != needed) {
            return Err(SkinError::Lengths { patch: patch(), found, needed });
        }
        let adjacency =
            Adjacency::new(&self.mesh).map_err(|source| SkinError::Mesh { patch: patch(), source })?;
        let (_, found) = adjacency.components();
        if found != 1 {
            return Err(SkinError::Components { patch: patch(), found });
        }
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        if let Some((vertex, &found)) = self.areas.enumerate().find(|&(_, &a)| !is_positive(a)) {
            return Err(SkinError::Area { patch: patch(), vertex, found });
        }
        for (vertex, n) in self.normals.enumerate() {
            let found = n.length();
            if found.is_nan() || (found - 1.0).abs() > UNIT_TOLERANCE {
                return Err(SkinError::Normal { patch: patch(), vertex, found });
            }
        }
        let mut densities = self.densities.iter().flat_map(IdVec::enumerate);
        if let Some((vertex, &found)) = densities.find(|&(_, &d)| !is_positive(d)) {
            return Err(SkinError::Density { patch: patch(), vertex, found });
        }
        Ok(())
    }
}

/// Normals go through `f32` in files, which keeps seven digits.
const UNIT_TOLERANCE: f64 = 1e-5;

/// All patches of a robot, with the frames of its links.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skin {
    /// The links; a parent comes before its children.
    pub links: IdVec<LinkId, Link>,
    /// The patches.
    pub patches: IdVec<PatchId, Patch>,
}

impl Skin {
    /// A skin of one bare mesh on one link at the origin.
    #[must_use]
    pub fn from_mesh(name: &str, mesh: TriMesh) -> Self {
        let mut skin = Self::default();
        let link =
            skin.links.push(Link { name: String::new(), parent: None, pose: glam::DAffine3::IDENTITY });
        skin.patches.push(Patch::from_mesh(name, link, mesh));
        skin
    }

    /// Checks every promise of [`Patch`] and of the links.
    ///
    /// # Errors
    /// The first broken promise, with the patch's name.
    pub fn validate(&self) -> Result<(), SkinError> {
        for (link, Link { parent, .. }) in self.links.enumerate() {
            if parent.is_some_and(|p| p >= link) {
                return Err(SkinError::LinkOrder { link });
            }
        }
        let mut names = HashSet::new();
        for patch in &self.patches {
            if patch.link.index() >= self.links.len() {
                return Err(SkinError::UnknownLink { patch: patch.name.clone(), link: patch.link });
            }
            if !names.insert(&patch.name) {
                return Err(SkinError::DuplicateName { patch: patch.name.clone() });
            }
            patch.validate()?;
        }
        Ok(())
    }
}
