//! Tables with a line of column names (CSV).

pub(super) mod acuity;
pub(super) mod boundary;
pub(super) mod calibration;
pub(super) mod contacts;
pub(super) mod csv_table;
pub(super) mod faces;
pub(super) mod lookups;
pub(super) mod poses;
pub(super) mod regions;
pub(super) mod seams;
pub(super) mod touches;
pub(super) mod triangles;
pub(super) mod values;
