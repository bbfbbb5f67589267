//! Tables with a line of column names (CSV).

pub(super) mod calibration;
pub(super) mod columns;
pub(super) mod contacts;
pub(super) mod lookups;
pub(super) mod poses;
