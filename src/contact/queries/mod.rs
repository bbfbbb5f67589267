//! Questions to an index besides the nearest point: on a coarse level alone, for fields and
//! along rays, and for the forces on taxels.

mod area;
mod press;
mod reactive;

pub use area::FieldHit;
pub use press::{ON_SKIN_SPACINGS, Press, Spreader};
pub use reactive::Reactive;
