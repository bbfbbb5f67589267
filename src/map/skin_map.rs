use crate::{
    id::{IdVec, VertexId},
    map::MapLevel,
    pyramid::LevelId,
    skin::{Link, LinkId, PatchId, TaxelId},
};

/// One patch with the maps of its levels.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchMap {
    /// Name of the patch.
    pub name: String,
    /// The link it is fixed to.
    pub link: LinkId,
    /// Vendor ids of the taxels of level 0.
    pub ids: IdVec<VertexId, TaxelId>,
    /// How uncertain the positions of the taxels are: covariances `xx xy xz yy yz zz` in m^2, in the link's frame; `None`:
    /// unknown.
    pub covariances: Option<IdVec<VertexId, [f64; 6]>>,
    /// The levels, finest first; at least one.
    pub levels: IdVec<LevelId, MapLevel>,
}

/// The maps of a whole skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SkinMap {
    /// The links; a parent comes before its children.
    pub links: IdVec<LinkId, Link>,
    /// The patches.
    pub patches: IdVec<PatchId, PatchMap>,
}
