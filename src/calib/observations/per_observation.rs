//! One value for every observation.

use crate::{
    calib::{ContactObservationId, DisplacementId},
    id::IdVec,
};

/// One value for every observation.
#[derive(Debug, Clone, PartialEq)]
pub struct PerObservation<T = f64> {
    /// Of every displacement.
    pub edges: IdVec<DisplacementId, T>,
    /// Of every contact.
    pub contacts: IdVec<ContactObservationId, T>,
}

impl<T: Copy> PerObservation<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U) -> PerObservation<U> {
        PerObservation { edges: self.edges.map(|&x| f(x)), contacts: self.contacts.map(|&x| f(x)) }
    }

    pub(crate) fn zip<S: Copy, U>(
        &self,
        other: &PerObservation<S>,
        of: impl Fn(T, S) -> U,
    ) -> PerObservation<U> {
        PerObservation {
            edges: self.edges.iter().zip(&other.edges).map(|(&x, &y)| of(x, y)).collect(),
            contacts: self.contacts.iter().zip(&other.contacts).map(|(&x, &y)| of(x, y)).collect(),
        }
    }

    /// Edges first, then contacts.
    pub(crate) fn iter(&self) -> impl Iterator<Item = T> {
        self.edges.iter().chain(&self.contacts).copied()
    }
}
