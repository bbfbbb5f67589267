//! Skins: calibrated taxels on patches, posed by the links of a robot.
//!
//! What a file holds is a [`Draft`]: sheets of triangles as they were written, with whatever is
//! wrong with them. [`assemble`] turns a draft into a [`Skin`], whose patches are oriented
//! manifold disks with holes, and says in [`Remark`]s what it changed; [`check`] lists everything
//! that is wrong with a draft, without changing it.

mod assemble;
mod bare;
mod check;
mod draft;
mod error;
mod extent;
mod forest;
mod link;
mod names;
mod outward;
mod patch;
mod remark;
mod sides;
mod surface;
mod taxels;
mod winding;
mod zero_area;

pub use assemble::{Assembled, assemble};
pub use bare::{MeshOptions, mesh_bare};
pub use check::{Element, Finding, FindingKind, check, check_with};
pub use draft::{Draft, Sheet};
pub use error::SkinError;
pub use link::{Link, LinkId, world_pose};
pub use patch::{Patch, PatchId, Presence, Skin};
pub use remark::{Remark, RemarkKind};
pub use taxels::TaxelId;
