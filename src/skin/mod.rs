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
mod joining_gap;
mod link;
mod names;
mod normals;
mod patch;
mod remark;
mod welded;
mod taxels;
mod winding;

pub use crate::numeric::Covariance;
pub use assemble::{AssembleOptions, Assembled, assemble};
pub use check::{Element, Finding, FindingKind, check};
pub use draft::{Draft, Sheet};
pub use error::SkinError;
pub use joining_gap::joining_gap;
pub use link::{Link, LinkId, world_pose};
pub use patch::{Patch, PatchId, Skin};
pub(crate) use patch::{check_links, check_patches};
pub use remark::{OutsideFrom, Remark, RemarkKind, UnreliableNormals};
pub use taxels::{Presence, TaxelError, TaxelId, Taxels};
pub use triangulate::triangulate_taxels;
