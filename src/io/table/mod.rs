//! Tables with a line of column names (CSV).

pub(super) mod by_taxel;
pub(super) mod calibration;
pub(super) mod contacts;
pub(super) mod csv_table;
pub(super) mod lookups;
pub(super) mod motion;
pub(super) mod regions;
pub(super) mod touches;
pub(super) mod triangles;
