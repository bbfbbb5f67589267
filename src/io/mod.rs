//! Files: the only disk access.
//!
//! The kind of a file follows from its extension. Readers trust no count, index or offset of a file before they have
//! checked it; writers replace a file whole or not at all ([`replace_file`]).

mod error;
mod file;
mod gltf;
mod image;
mod mesh;
mod observations;
mod table;

pub use self::gltf::{
    read_gltf, read_map, read_map_if_any, write_map, write_pyramids, write_skin_glb, write_skin_gltf,
};
pub use error::IoError;
pub use file::{
    extension::kind,
    json::write_json,
    replace::{replace_file, temporary_prefix},
};
pub use image::exr::{part_name, write_images};
pub use mesh::{flat::write_flat, read::read_draft, write::write_skin};
pub use observations::read_write::{
    ObservationRemark, ReadObservations, append_observations, read_observations, write_contacts,
    write_observations,
};
pub use table::{
    calibration::{
        read_triangles, read_truth, write_calibration, write_inliers, write_triangles, write_truth,
    },
    contacts::{ContactReader, ContactRow},
    lookups::{LookupRow, LookupWriter},
    poses::{LinkPose, read_poses},
};
