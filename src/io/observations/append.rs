//! Joining the observations of two files.

use std::{collections::HashMap, path::Path};

use crate::{
    calib::{ContactMeasurement, ContactObservation, Displacement, Observations},
    id::VertexId,
    io::{IoError, file::source::invalid, observations::types::ReadObservations},
    skin::TaxelId,
};

/// Appends the observations of another file, as contacts come in a table of their own.
///
/// Taxel data are merged: a pose fixed in `other` is fixed in the result; an initial value from
/// `other` is used if `into` has none.
///
/// # Errors
/// [`IoError::Invalid`] if it observes or fixes a taxel that `into` does not have, fixes one
/// elsewhere than `into` does, or has another model.
pub fn append_observations(
    into: &mut ReadObservations,
    other: ReadObservations,
    path: &Path,
) -> Result<(), IoError> {
    check_model(&into.observations, &other.observations, path)?;
    let known: HashMap<TaxelId, VertexId> =
        into.observations.taxels.enumerate().map(|(v, t)| (t.id, v)).collect();
    let taxels = &other.observations.taxels;
    let place = |v: VertexId| {
        let id = taxels[v].id;
        let needed = "a taxel of the other file";
        known
            .get(&id)
            .copied()
            .ok_or_else(|| invalid(path, format!("taxel {id}"), "an observation of it", needed))
    };
    for (v, taxel) in taxels.enumerate().filter(|(_, t)| t.initial.is_some()) {
        let Some(here) = known.get(&taxel.id).map(|&v| &mut into.observations.taxels[v]) else {
            if taxel.fixed {
                place(v)?;
            }
            continue;
        };
        if taxel.fixed && here.fixed && here.initial != taxel.initial {
            let needed = "the place where the other file fixes it";
            return Err(invalid(
                path,
                format!("taxel {}", taxel.id),
                "another place where it is fixed",
                needed,
            ));
        }
        // Where a taxel is fixed it is known; any other value is a guess, and the first one counts.
        if taxel.fixed || here.initial.is_none() {
            here.initial = taxel.initial;
        }
        here.fixed |= taxel.fixed;
    }
    for contact in &other.observations.contacts {
        let taxel = place(contact.taxel)?;
        into.observations
            .contacts
            .push(ContactObservation { taxel, measurement: contact.measurement.clone() });
    }
    for edge in &other.observations.edges {
        let (from, to) = (place(edge.from)?, place(edge.to)?);
        into.observations.edges.push(Displacement { from, to, measurement: edge.measurement.clone() });
    }
    into.remarks.extend(other.remarks);
    Ok(())
}

/// Contacts with positions fit every model; all else has one.
fn check_model(into: &Observations, other: &Observations, path: &Path) -> Result<(), IoError> {
    let has_model = !other.edges.is_empty()
        || other.taxels.iter().any(|t| t.initial.is_some())
        || other.contacts.iter().any(|c| matches!(c.measurement, ContactMeasurement::Pose { .. }));
    if has_model && other.model != into.model {
        let found = format!("observations of the {} model", other.model);
        let needed = format!("{}, as in the other file", into.model);
        return Err(invalid(path, "the file", found, needed));
    }
    Ok(())
}
