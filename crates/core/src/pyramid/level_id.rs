//! The number of a level.

use crate::id::define_id;

define_id!(
    /// A level of one pyramid; 0 is the skin itself.
    pub LevelId, "L"
);
