//! Files: the only disk access.
//!
//! The kind of a file follows from its extension.
//!
//! | folder | reads | writes |
//! |---|---|---|
//! | `gltf` | [`read_map`], skins | [`write_map`], [`write_pyramids`], skins |
//! | `draft` | [`read_draft`]: skins of every format | |
//! | `robot` | [`read_robot`], [`robot_draft`]: robot descriptions | |
//! | `mesh` | skins and meshes | [`write_skin`], [`write_flat`] |
//! | `observations` | [`read_observations`] | [`write_observations`] |
//! | `table` | [`read_contacts`], [`read_motion`], [`read_gains`], ... | [`LookupWriter`], [`write_calibration`], ... |
//! | `layout` | [`Layout`]: what the numbers of recordings mean | |
//! | `streams` | recordings of other programs, for [`ReadingsReader`] | |
//! | `readings` | [`ReadingsReader`] | [`ReadingsWriter`] |
//! | `arrays` | | [`RecordingWriter`]: `.npz`, `.npy` |
//! | `export` | | [`export_map`]: simulators, robots, tables |
//! | `image` | | [`write_images`], [`write_frame`]: OpenEXR |
//! | `file` | what all of them need: whole files, lines, replacing | |
//!
//! What every reader keeps:
//! - No count, index, offset or size of a file is trusted before it was checked against the bytes
//!   that are there, and memory is bounded by the size of the file.
//! - Every number that comes out is finite, but for readings that are missing (NaN), every corner
//!   exists; whatever else a file claims is judged by [`crate::skin`], [`crate::map`] and
//!   [`crate::calib`].
//! - Bad input is an error that names the element, what was found and what is needed
//!   ([`IoError::Invalid`]); nothing panics, nothing is repaired in silence.
//!
//! What every writer keeps:
//! - A file is replaced whole or not at all, several files together ([`Outputs`]).
//! - What a format cannot express is refused before anything is written ([`IoError::Unfit`]).
//! - The same input gives the same bytes.
//!
//! ```
//! use dermatome::{
//!     io::{read_map, write_map},
//!     mesh::shapes,
//!     pipeline::{BuildOptions, build},
//!     skin::Skin,
//! };
//!
//! let palm = Skin::from_mesh("palm", shapes::cap(200, 0.1, 0.5));
//! let map = build(&palm, &BuildOptions::default())?;
//! let path = std::env::temp_dir().join("dermatome-io-map.glb");
//! write_map(&path, &map)?;
//! assert_eq!(read_map(&path)?.patches.len(), map.patches.len());
//! # std::fs::remove_file(&path)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod arrays;
mod draft;
mod error;
mod export;
mod file;
mod gltf;
mod image;
mod layout;
mod mesh;
mod observations;
mod readings;
#[cfg(feature = "robots")]
mod robot;
mod streams;
mod table;

pub(crate) use self::gltf::as_in_map_file;
pub use self::gltf::{
    map_from_bytes, map_hash, map_to_bytes, read_map, rounding_in_gltf, share_plane, write_map,
    write_pyramids,
};
pub use arrays::recording::{RecordingLayout, RecordingWriter};
#[cfg(feature = "robots")]
pub use draft::is_robot;
pub use draft::{draft_from_bytes, read_draft, read_draft_of_stream, read_draft_with};
pub use error::{Feature, FileElement, IoError};
pub use export::{ExportOptions, export_map};
pub use file::file_kind;
pub use file::outputs::{OutPath, Outputs, replace_file};
pub use image::{FrameContent, write_frame, write_images, write_raw_frame};
pub use layout::{
    Decoder, KnownRest, Layout, NamedColumns, Statement, StatementSource, StreamFacts, TimeUnit, Times,
};
pub use mesh::parts::ReadParts;
pub use mesh::skin_csv::triangles_path;
pub use mesh::{lost_in, skin_to_bytes, write_flat, write_skin};
pub use observations::{
    TouchStream, builder::ObservationRemark, observations_from_stream, observations_to_stream,
    read_observations, touches_from_stream, write_observations,
};
pub use readings::{
    ReadOptions, ReadingsReader,
    arrays::ReadingsLayout,
    blocks::{Block, Readings},
    writer::{ReadingsColumns, ReadingsWriter},
};
#[cfg(feature = "robots")]
pub use robot::{Packages, RobotSurface, read_robot, robot_draft};
pub use table::TableRows;
pub use table::body_words::read_body_words;
pub use table::by_taxel::{
    NotInSkin, TaxelTable, Unused, modules_of_skin, read_acuities, read_acuities_with, read_boundary,
    read_gains, read_modules, read_seams,
};
pub use table::calibration::{
    read_triangles, read_truth, write_bodies, write_calibration, write_inliers, write_triangles, write_truth,
};
pub use table::contacts::{
    ContactRow, ContactRows, MapCoordinates, MapPlaceRow, MapPlaceRows, read_contacts, read_map_places,
};
pub use table::design::{
    ModuleRow, PlacedModules, read_module, read_placed_modules, write_chains, write_placed_modules,
};
pub use table::diff::write_diff;
#[cfg(feature = "robots")]
pub use table::joints::{JointTable, read_joint_values, write_joint_values};
pub use table::landmarks::{read_landmarks, read_landmarks_with};
pub use table::lookups::{LookupPlace, LookupRow, LookupWriter};
pub use table::motion::{MotionFile, read_link_names, read_motion};
pub use table::order::{read_order, write_order};
pub use table::region_writer::{RegionWriter, write_steps, write_touches};
pub use table::regions::{check_regions, read_regions, read_regions_with};
pub use table::response::{read_response, write_response};
pub use table::series::{Series, read_series};
pub use table::summary::{
    EpisodeSummary, LoadWriter, SummaryCell, SummaryRow, summary_rows, summary_step_rows, write_summary,
    write_summary_steps,
};
pub use table::touch_log::{
    TouchRows, is_touch_log, read_touches, touches_from_bytes, write_touch_contacts, write_touch_log,
};
