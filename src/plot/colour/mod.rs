//! Which colour each triangle or taxel has.

pub(crate) mod coloured_mesh;
pub(crate) mod scale_limits;
pub(crate) mod scales;
