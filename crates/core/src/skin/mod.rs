//! Skins: calibrated taxels on patches, posed by the links of a robot.
//!
//! A file contains a [`Draft`]: sheets of triangles as they were written, with all their faults. [`assemble`]
//! turns a draft into a [`Skin`], whose patches are oriented manifold disks with holes, and reports in
//! [`Remark`]s what it changed. [`check`] lists everything that is wrong with a draft, without changing it.
//! Bare taxels, a draft without any triangle, are joined first (`triangulate`).
//!
//! ```
//! use dermatome::{
//!     mesh::shapes,
//!     skin::{AssembleOptions, Draft, FindingKind, RemarkKind, Sheet, assemble, check},
//! };
//!
//! // The taxels of a lattice, without triangles.
//! let taxels = shapes::lattice(8, 8, 0.005).positions.as_slice().to_vec();
//! let sheet = Sheet { name: "palm".into(), positions: taxels, ..Sheet::default() };
//! let draft = Draft { sheets: vec![sheet], ..Draft::default() };
//! let options = AssembleOptions { gap: 3.0, ..AssembleOptions::default() };
//!
//! let findings = check(&draft, &options);
//! assert_eq!(findings[0].kind, FindingKind::Bare);
//!
//! let assembled = assemble(&draft, &options)?;
//! assert_eq!(assembled.skin.patches.len(), 1);
//! assert!(matches!(assembled.remarks[0].kind, RemarkKind::Triangulated { taxels: 64, .. }));
//! # Ok::<(), dermatome::Error>(())
//! ```
//!
//! Not guaranteed: that patches are disks ([`check`] finds closed ones and handles), that the unit is right
//! (sizes beyond 5 m are reported), or that the outside is right where neither normals nor shape determine
//! it.

mod assemble;
mod triangulate;
mod check;
mod columns;
mod draft;
mod error;
mod link;
mod modality;
mod motion;
mod names;
mod normals;
mod patch;
mod remark;
pub(crate) mod sentence;
mod weld;
mod taxels;

pub use crate::numeric::Covariance;
pub use assemble::{AssembleOptions, Assembled, Oriented, assemble, orient};
pub use check::{Elements, Finding, FindingKind, Severity, check};
pub use draft::{Draft, Sheet};
pub use error::SkinError;
#[doc(hidden)]
pub use link::link_named;
pub use link::named_links;
pub use link::{Link, LinkId, link_names, world_pose};
pub use modality::{Modalities, NAMES_OF_MODALITIES, Presence, THERMAL, TOUCH, are_modalities};
pub use motion::{Curve, Track};
pub use motion::{Motion, MotionFrame};
pub(crate) use names::Names;
pub use normals::in_tangent_plane;
pub(crate) use normals::tangents_along;
pub use patch::{Patch, PatchId, Skin};
pub(crate) use patch::{check_links, check_patches};
pub use remark::{OutsideFrom, Remark, RemarkKind, UnreliableNormals};
pub use taxels::{
    Joints, RegionName, TaxelError, TaxelId, Taxels, bind_of, blended, is_region_name, names_of,
    scaled_joints,
};
pub use weld::Weld;
