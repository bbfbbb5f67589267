//! Maps to start from, none of which needs another one.

pub(super) mod conformal;
pub(super) mod linear;
pub(super) mod tutte;
pub(super) mod untangle;
