//! Observations for the calibration: g2o text and CSV tables.

mod builder;
mod csv;
mod g2o;
pub(super) mod read_write;
pub(super) mod remark;
