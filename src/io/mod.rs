//! Files: the only disk access.
//!
//! The kind of a file follows from its extension. Readers trust no count, index or offset of a file before they have
//! checked it; writers replace a file whole or not at all ([`replace_file`]).

mod calibration_table;
mod columns;
mod contact_table;
mod draft;
mod error;
mod exr;
mod exr_zip;
mod flat_out;
mod icub;
mod json;
mod kind;
mod lookup_table;
mod memory;
mod observations;
mod observations_builder;
mod observations_csv;
mod observations_g2o;
mod observations_lines;
mod obj;
mod ply;
mod pose_table;
mod presence;
mod replace;
mod robotskin;
mod scene;
mod skin_out;
mod skin_table;
mod source;
mod stl;
mod world;

pub use calibration_table::{
    read_triangles, read_truth, write_calibration, write_inliers, write_triangles, write_truth,
};
pub use contact_table::{ContactReader, ContactRow};
pub use draft::read_draft;
pub use error::IoError;
pub use exr::{part_name, write_images};
pub use flat_out::write_flat;
pub use json::write_json;
pub use kind::kind;
pub use lookup_table::{LookupRow, LookupWriter};
pub use memory::peak_memory_bytes;
pub use observations::{
    ObservationRemark, ReadObservations, append_observations, read_observations, write_contacts,
    write_observations,
};
pub use pose_table::{LinkPose, read_poses};
pub use replace::{replace_file, temporary_prefix};
pub use scene::{
    read_gltf, read_map, read_map_if_any, write_map, write_pyramids, write_skin_glb, write_skin_gltf,
};
pub use skin_out::write_skin;
