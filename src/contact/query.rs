//! What is asked of an index, and its answer.

use glam::DVec3;

use crate::{
    mesh::SurfacePoint,
    skin::{LinkId, PatchId},
};

/// A point whose nearest skin is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    /// Where, in m, in the frame of `link`.
    pub point: DVec3,
    /// The link in whose frame `point` is given, with skin or without; `None`: the world.
    pub link: Option<LinkId>,
    /// The link whose patches alone are searched; `None`: all patches.
    pub only_link: Option<LinkId>,
}

impl Query {
    /// A point in the frame of a link, in m.
    #[must_use]
    pub const fn in_link(link: LinkId, point: DVec3) -> Self {
        Self { point, link: Some(link), only_link: None }
    }

    /// A point in the frame of a link, in m, for which the patches of that link alone are searched.
    #[must_use]
    pub const fn on_link(link: LinkId, point: DVec3) -> Self {
        Self { point, link: Some(link), only_link: Some(link) }
    }
}

impl From<DVec3> for Query {
    /// A point in world coordinates, in m.
    fn from(point: DVec3) -> Self {
        Self { point, link: None, only_link: None }
    }
}

/// The point of the skin nearest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The patch it lies on.
    pub patch: PatchId,
    /// The link of that patch.
    pub link: LinkId,
    /// Where on level 0 of that patch.
    pub point: SurfacePoint,
    /// How far the query is outside the skin, in m; negative inside.
    ///
    /// The side is that of the angle-weighted pseudo-normal (baerentzen2005), which is
    /// right on edges and corners too. Beyond the boundary of an open patch it is the side of the
    /// skin's continuation.
    pub distance: f64,
    /// Where the point lies, in m, in the frame that the query was given in.
    pub position: DVec3,
    /// The outward unit normal of the skin there, in the same frame: that of the face, on edges and
    /// corners the angle-weighted pseudo-normal. Zero where all faces around are without area.
    pub normal: DVec3,
}
