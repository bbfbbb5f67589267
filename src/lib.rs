//! From the taxels of a robot's skin to flat, faithful, hierarchical maps of it, and back.

pub mod id;
pub mod mesh;
pub mod delaunay;
pub mod sparse;
pub mod skin;
pub mod calib;
pub mod pyramid;
pub mod flatten;
pub mod map;
pub mod atlas;
pub mod contact;
pub mod io;
pub mod report;
