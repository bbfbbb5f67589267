//! Which colour each triangle or taxel has.

mod coloured_mesh;
mod field_colours;
mod scale_limits;
mod scales;

pub(crate) use coloured_mesh::{ColouredMesh, Fill, MeshOwner, mean_of_known};
pub(crate) use scale_limits::ScaleLimits;
pub(crate) use scales::{Colour, DIVERGING, INK, ORDER, SEQUENTIAL, Scale, UNKNOWN, WARNING, hatch};
