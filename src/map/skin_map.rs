use crate::{
    id::{IdVec, LevelId, LinkId, PatchId, TaxelId, VertexId},
    map::MapLevel,
    skin::Link,
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
