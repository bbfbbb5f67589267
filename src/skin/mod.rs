//! Skins: calibrated taxels on patches, posed by the links of a robot.
//!
//! What a file holds is a [`Draft`]: sheets of triangles as they were written, with whatever is
//! wrong with them. [`assemble`] turns a draft into a [`Skin`], whose patches are oriented
//! manifold disks with holes, and says in [`Remark`]s what it changed; [`check`] lists everything
//! that is wrong with a draft, without changing it.

mod assemble;
mod triangulate;
mod check;
mod draft;
mod error;
mod unit_check;
mod link;
mod names;
mod normals;
mod patch;
mod remark;
mod welded;
mod taxels;
mod winding;

pub use crate::numeric::Covariance;
pub use assemble::{Assembled, assemble};
pub use check::{Element, Finding, FindingKind, check, check_with};
pub use draft::{Draft, Sheet};
pub use error::SkinError;
pub use link::{Link, LinkId, world_pose};
pub use patch::{Patch, PatchId, Skin};
pub use remark::{Remark, RemarkKind};
pub use taxels::{Presence, TaxelError, TaxelId, Taxels};
pub use triangulate::{MeshOptions, mesh_bare};
