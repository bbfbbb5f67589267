//! Questions to an index besides the nearest point: on a coarse level alone, for fields and
//! along rays.

mod area;
mod reactive;

pub use area::FieldHit;
pub use reactive::Reactive;
