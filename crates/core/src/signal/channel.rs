//! The meaning of one number per taxel.

use crate::body::FieldLevel;
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::signal::SignalError;
use crate::signal::unit::{ChannelKind, Quantity, Unit, nearest_unit, parse_unit};
use crate::skin::{PatchId, Presence, THERMAL};

/// Names of channels of temperatures begin so.
const HEAT: [&str; 3] = ["temp", "therm", "heat"];

/// One number per taxel: its name, unit and kind.
///
/// A vector per taxel is one channel for each component: `force.N` along the normal, `force.T` along
/// the tangent and `force.B` along the binormal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Its name, as `pressure` or `force.N`.
    pub name: String,
    /// Its unit, as `Pa`, `N` or `count`; empty if unknown.
    pub unit: String,
    /// How it is transferred between levels.
    pub quantity: Quantity,
    /// What it measures.
    pub kind: ChannelKind,
}

impl Channel {
    /// A channel of this name and unit, extensive if the unit is one of force or charge (`N`, `gf`, `lbf`,
    /// `C`, with or without a prefix such as `m`), or if there is no unit and the name is `force`, `force.N`
    /// or `charge`. The default name is `force` if it is extensive, else `pressure`.
    ///
    /// Its kind follows from its unit, whatever the prefix, and its name: without a unit, or in one that touches are
    /// measured in, it is of touch, but for names that begin with `temp`, `therm`, `heat` or `acc`; of these channels
    /// `shear` and those whose name ends in `.x`, `.y`, `.T` or `.B` are tangential. Of names with several dots, as `tip.force.x`,
    /// the part before the direction counts as the first one does.
    ///
    /// # Errors
    /// [`SignalError::Unit`] if the unit is not known, or is `C` in a channel that is not called `charge`: it may be
    /// a temperature.
    pub fn new(name: &str, unit: &str) -> Result<Self, SignalError> {
        let lower = name.to_ascii_lowercase();
        let first = lower.split('.').next().unwrap_or_default();
        let direction = name.rsplit_once('.').map_or("", |(_, last)| last);
        // What has the direction: the `force` of `tip.force.x`.
        let base = match lower.rsplit_once('.') {
            Some((before, _)) if ["x", "y", "z", "N", "T", "B"].contains(&direction) => {
                before.rsplit_once('.').map_or(before, |(_, base)| base)
            }
            _ => first,
        };
        let is_called = |names: &[&str]| names.contains(&first) || names.contains(&base);
        let refused = || SignalError::Unit {
            channel: name.into(),
            unit: unit.into(),
            nearest: nearest_unit(if unit == "C" { "degC" } else { unit }),
        };
        let is_temperature = first.starts_with("temp") || first == "thermal";
        let (unit, quantity, kind) = match unit {
            "" if is_called(&["force", "charge"]) => (String::new(), Quantity::Extensive, ChannelKind::Touch),
            "" => (String::new(), Quantity::Intensive, ChannelKind::Touch),
            "C" if is_temperature => (unit.to_owned(), Quantity::Intensive, ChannelKind::Other),
            "C" if !is_called(&["charge"]) => return Err(refused()),
            _ => {
                let Unit { name, quantity, kind, .. } = parse_unit(unit).ok_or_else(refused)?;
                (name, quantity, kind)
            }
        };
        let is_other = |part: &str| HEAT.iter().chain(&["acc"]).any(|other| part.starts_with(other));
        let is_other = is_other(&lower) || is_other(base);
        let kind = match kind {
            ChannelKind::Touch if is_other => ChannelKind::Other,
            ChannelKind::Touch if is_called(&["shear"]) || ["x", "y", "T", "B"].contains(&direction) => {
                ChannelKind::Tangential
            }
            kind => kind,
        };
        let name = match (name, quantity) {
            ("", Quantity::Extensive) => "force",
            ("", Quantity::Intensive) => "pressure",
            _ => name,
        };
        Ok(Self { name: name.into(), unit, quantity, kind })
    }

    /// Whether its kind is the one that its name and unit tell, so that these are enough to state it.
    pub fn is_usual(&self) -> bool {
        Self::new(&self.name, &self.unit).is_ok_and(|usual| usual.kind == self.kind)
    }

    /// Which modality besides touch of a map its readings are of: the one that its name begins with, up to a dot, else the
    /// one of its quantity, if the map has sensors of it: `thermal` of temperatures, `acceleration` of accelerations,
    /// `proximity` of lengths.
    pub fn modality<'m>(&self, map: &'m SkinMap) -> Option<&'m str> {
        let lower = self.name.to_ascii_lowercase();
        let first = lower.split('.').next().unwrap_or_default();
        let base = parse_unit(&self.unit).filter(|unit| unit.kind == ChannelKind::Other);
        let quantity = match (self.kind, first, base.map_or("", |unit| unit.base)) {
            (ChannelKind::Other, _, "K" | "degC" | "degF") => THERMAL,
            (ChannelKind::Other, _, "m/s^2") => "acceleration",
            (ChannelKind::Other, _, "m") => "proximity",
            (ChannelKind::Other, name, "") if name.starts_with("acc") => "acceleration",
            (ChannelKind::Other, name, "") if HEAT.iter().any(|heat| name.starts_with(heat)) => THERMAL,
            _ => "",
        };
        let known = || map.body.modalities.iter().map(|modality| &*modality.name);
        known().find(|name| *name == first).or_else(|| known().find(|name| *name == quantity))
    }

    /// Whether a level without a mesh has values of it: one of the whole body, or of its [modality](Self::modality).
    pub fn has_fields(&self, map: &SkinMap, at: FieldLevel) -> bool {
        let Some(number) = at.modality else { return true };
        map.body.modalities.get(number).is_some_and(|of| self.modality(map) == Some(&*of.name))
    }

    /// Which taxels of a map its readings are of: on a patch with sensors of its [modality](Self::modality) these, else those
    /// that read pressure.
    pub fn taxels(&self, map: &SkinMap) -> IdVec<PatchId, IdVec<VertexId, bool>> {
        let modality = self.modality(map);
        let of_patch = |id: PatchId| {
            let presence = &map.patches[id].taxels.presence;
            let mut parts = map.body.modalities.iter();
            match parts.find(|part| part.patch == Some(id) && Some(&*part.name) == modality) {
                Some(part) => {
                    let mut is_read = presence.map(|_| false);
                    let sensors = part.sensors().filter(|at| presence[at.taxel] != Presence::Absent);
                    sensors.for_each(|at| is_read[at.taxel] = true);
                    is_read
                }
                None => presence.map(|presence| presence.reads_pressure()),
            }
        };
        map.patches.ids().map(of_patch).collect()
    }

    /// Newtons in one unit of an amount, or of a value times an area in m^2; `None` if its unit is neither
    /// one of force nor one of pressure.
    pub fn newtons(&self) -> Option<f64> {
        let is_it = |unit: &Unit| ["N", "Pa"].contains(&unit.base) && unit.quantity == self.quantity;
        parse_unit(&self.unit).filter(is_it).map(|unit| unit.factor)
    }

    /// The unit of its pixels: amounts are drawn per area of the map, as `N/m^2`; without a unit
    /// `1/m^2`.
    pub fn pixel_unit(&self) -> String {
        match (self.quantity, self.unit.as_str()) {
            (Quantity::Intensive, unit) => unit.to_owned(),
            (Quantity::Extensive, "") => "1/m^2".to_owned(),
            (Quantity::Extensive, unit) => format!("{unit}/m^2"),
        }
    }
}

/// The number of the channel that is meant where none is named: the first of touch, other than tangential, else the first
/// of touch, else the first.
pub fn main_channel(kinds: impl Iterator<Item = ChannelKind> + Clone) -> usize {
    let is_touch = |kind| kind == ChannelKind::Touch;
    kinds.clone().position(is_touch).or_else(|| kinds.clone().position(ChannelKind::is_of_touch)).unwrap_or(0)
}

impl Default for Channel {
    /// A pressure of unknown unit.
    fn default() -> Self {
        Self {
            name: "pressure".into(),
            unit: String::new(),
            quantity: Quantity::Intensive,
            kind: ChannelKind::Touch,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Amounts are summed, averages are not; other units are refused, not guessed.
    #[test]
    fn the_unit_determines_whether_values_add_up() {
        let (sum, mean) = (Some(Quantity::Extensive), Some(Quantity::Intensive));
        for (name, unit, expected, newtons) in [
            ("force.N", "N", sum, Some(1.0)),
            ("load", "mN", sum, Some(1e-3)),
            ("load", "kgf", sum, Some(9.80665)),
            ("force", "", sum, None),
            ("tip.force.x", "", sum, None),
            ("charge", "pC", sum, None),
            ("charge", "C", sum, None),
            ("force", "count", mean, None),
            ("pressure", "Pa", mean, Some(1.0)),
            ("pressure", "hPa", mean, Some(100.0)),
            ("pressure", "MPa", mean, Some(1e6)),
            ("pressure", "mbar", mean, Some(100.0)),
            ("pressure", "N/m^2", mean, Some(1.0)),
            ("pressure", "N/cm^2", mean, Some(1e4)),
            ("pressure", "N/mm^2", mean, Some(1e6)),
            ("pressure", "kgf/cm^2", mean, Some(98_066.5)),
            ("pressure", "psi", mean, Some(6_894.757_293_168)),
            ("pressure", "mmHg", mean, Some(133.322_387_415)),
            ("pressure", "cmH2O", mean, Some(98.0665)),
            ("temperature", "C", mean, None),
            ("thermal", "C", mean, None),
            ("heat", "degC", mean, None),
            ("heat", "mK", mean, None),
            ("", "", mean, None),
            ("", "C", None, None),
            ("heat", "C", None, None),
            ("load", "stone", None, None),
            ("load", "m", mean, None),
            ("load", "k", None, None),
        ] {
            let found = Channel::new(name, unit);
            assert_eq!(found.as_ref().ok().map(|channel| channel.quantity), expected, "{name} in {unit:?}");
            let found = found.ok().and_then(|channel| channel.newtons());
            let is_same = found.zip(newtons).map_or(found == newtons, |(a, b)| (a / b - 1.0).abs() < 1e-12);
            assert!(is_same, "{unit}: {found:?}");
        }
        let new = |name, unit| Channel::new(name, unit).unwrap();
        assert_eq!(new("", ""), Channel::default());
        assert_eq!(new("", "mN"), new("force", "mN"));
        assert_eq!(new("", "kPa"), new("pressure", "kPa"));
    }

    /// The kind is that of the unit, whatever its prefix, unless the name says otherwise.
    #[test]
    fn name_and_unit_determine_the_kind() {
        use ChannelKind::{Other, Tangential, Touch};
        for (name, kinds) in [
            ("pressure", [Touch, Other]),
            ("cap.z", [Touch, Other]),
            ("shear", [Tangential, Other]),
            ("force.x", [Tangential, Other]),
            ("tip.force.x", [Tangential, Other]),
            ("tip.force.z", [Touch, Other]),
            ("tip.shear.z", [Tangential, Other]),
            ("tip.acc.x", [Other; 2]),
            ("temp", [Other; 2]),
            ("acc.x", [Other; 2]),
        ] {
            for unit in ["V", "mV", "uV", "F", "pF", "Ohm", "kOhm", "count", "N", "mN", "kPa", ""] {
                assert_eq!(Channel::new(name, unit).unwrap().kind, kinds[0], "{name} in {unit:?}");
            }
            for unit in ["degC", "mK", "m/s^2", "mm", "Hz"] {
                assert_eq!(Channel::new(name, unit).unwrap().kind, kinds[1], "{name} in {unit:?}");
            }
        }
    }
}
