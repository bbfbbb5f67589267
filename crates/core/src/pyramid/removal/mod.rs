//! Removing the vertices of a level that are not kept, star by independent star.

mod queue;
mod remover;
mod retriangulation;
mod seam;
mod star;
mod taxel_locations;

pub(super) use remover::Remover;
pub(super) use seam::{SeamRole, SeamedLevel};
pub(super) use taxel_locations::TaxelLocations;
