//! Finds outliers and fits the others.

pub(crate) mod ambiguity;
pub(crate) mod automatic;
pub(crate) mod coordinate_descent;
pub(crate) mod goodness_of_fit;
pub(crate) mod length_prior;
