//! Questions to an index besides the nearest point: on a coarse level alone and from there to the exact
//! answer, for fields and along rays, and for the forces on taxels.

mod area;
mod press;
mod reactive;
mod refine;

pub use area::{Area, FieldHit, Filter};
pub use press::{ON_SKIN_SPACINGS, Press, Spreader};
pub use reactive::Reactive;
pub use refine::Refined;
