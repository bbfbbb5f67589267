//! Start maps: none needs another map.

pub(super) mod conformal;
pub(super) mod linear;
pub(super) mod tutte;
pub(super) mod untangle;
