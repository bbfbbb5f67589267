//! The meaning of one number per taxel.

use crate::signal::SignalError;

/// How a channel is transferred between levels and to pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quantity {
    /// An average over the receptive area: pressure, temperature, a raw count. A receptive field has
    /// the mean of its taxels, weighted by their areas.
    #[default]
    Intensive,
    /// An amount: force, charge. A receptive field has the sum of its taxels' shares.
    Extensive,
}

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
}

/// Units of force, pressure and charge that take prefixes, with their value in N or in Pa, NaN for charges.
const MEASURES: [(&str, f64, Quantity); 16] = [
    ("N", 1.0, Quantity::Extensive),
    ("gf", 9.806_65e-3, Quantity::Extensive),
    ("lbf", 4.448_221_615_260_5, Quantity::Extensive),
    ("C", f64::NAN, Quantity::Extensive),
    ("Pa", 1.0, Quantity::Intensive),
    ("bar", 1e5, Quantity::Intensive),
    ("N/m^2", 1.0, Quantity::Intensive),
    ("N/cm^2", 1e4, Quantity::Intensive),
    ("N/mm^2", 1e6, Quantity::Intensive),
    ("gf/cm^2", 98.0665, Quantity::Intensive),
    ("gf/mm^2", 9806.65, Quantity::Intensive),
    ("psi", 6_894.757_293_168_361, Quantity::Intensive),
    ("mmHg", 133.322_387_415, Quantity::Intensive),
    ("cmH2O", 98.0665, Quantity::Intensive),
    ("mmH2O", 9.806_65, Quantity::Intensive),
    ("atm", 101_325.0, Quantity::Intensive),
];

const PREFIXES: [(&str, f64); 12] = [
    ("", 1.0),
    ("p", 1e-12),
    ("n", 1e-9),
    ("u", 1e-6),
    ("\u{b5}", 1e-6),
    ("\u{3bc}", 1e-6),
    ("m", 1e-3),
    ("c", 1e-2),
    ("d", 1e-1),
    ("h", 1e2),
    ("k", 1e3),
    ("M", 1e6),
];

/// Other units, all of averages, with or without a prefix; counts, and the temperature in degrees.
const AVERAGES: &str = "count counts raw LSB digit digits adc bit 1 % K degC \u{b0}C degF V A F Ohm ohm Hz m rad deg s m/s m/s^2 T \
                        lx N/m Pa*s \u{3a9}";

/// The value of a unit in newtons or pascals, and how its quantity is transferred.
fn measure(unit: &str) -> Option<(f64, Quantity)> {
    let bases = || PREFIXES.iter().filter_map(|(prefix, x)| Some((unit.strip_prefix(prefix)?, x)));
    let known = |(base, x): (&str, &f64)| {
        MEASURES.iter().find(|(name, ..)| *name == base).map(|(_, y, quantity)| (x * y, *quantity))
    };
    let average =
        |(base, _): (&str, &f64)| !base.is_empty() && AVERAGES.split_whitespace().any(|name| name == base);
    bases().find_map(known).or_else(|| bases().any(average).then_some((f64::NAN, Quantity::Intensive)))
}

/// The factor from the unit `from` to the unit `to`; `None` if they do not measure the same quantity. Vendors
/// write `KPa` and `PSI`, and have several names for counts.
pub(crate) fn unit_ratio(from: &str, to: &str) -> Option<f64> {
    let spelled = |unit: &str| match unit {
        "KPa" | "kpa" => "kPa".to_owned(),
        "PSI" => "psi".to_owned(),
        "counts" | "raw" | "LSB" | "digit" | "digits" | "adc" => "count".to_owned(),
        other => other.to_owned(),
    };
    let (from, to) = (spelled(from), spelled(to));
    if from == to {
        return Some(1.0);
    }
    let ((x, of), (y, other)) = (measure(&from)?, measure(&to)?);
    Some(x / y).filter(|ratio| of == other && ratio.is_finite())
}

impl Channel {
    /// A channel of this name and unit, extensive if the unit is one of force or charge (`N`, `gf`, `lbf`,
    /// `C`, with or without a prefix such as `m`), or if there is no unit and the name is `force`, `force.N`
    /// or `charge`. The default name is `force` if it is extensive, else `pressure`.
    ///
    /// # Errors
    /// [`SignalError::Unit`] if the unit is not known, or is `C` in a channel that is not called `charge`: it may be
    /// a temperature.
    pub fn new(name: &str, unit: &str) -> Result<Self, SignalError> {
        let first = name.split('.').next().unwrap_or_default().to_ascii_lowercase();
        let refused = || SignalError::Unit { channel: name.into(), unit: unit.into() };
        let quantity = match unit {
            "" if ["force", "charge"].contains(&first.as_str()) => Quantity::Extensive,
            "" => Quantity::Intensive,
            "C" if first.starts_with("temp") || first == "thermal" => Quantity::Intensive,
            "C" if first != "charge" => return Err(refused()),
            _ => measure(unit).ok_or_else(refused)?.1,
        };
        let name = match (name, quantity) {
            ("", Quantity::Extensive) => "force",
            ("", Quantity::Intensive) => "pressure",
            _ => name,
        };
        Ok(Self { name: name.into(), unit: unit.into(), quantity })
    }

    /// Whether it measures touches: a force, pressure or charge, or counts of a sensor of them. Its readings are near a
    /// zero where nothing touches, unlike a temperature.
    pub(crate) fn is_of_touch(&self) -> bool {
        const COUNTS: [&str; 14] =
            ["", "count", "counts", "raw", "LSB", "digit", "digits", "adc", "bit", "1", "%", "V", "F", "Ohm"];
        let name = self.name.to_ascii_lowercase();
        let is_other = ["temp", "therm", "heat", "acc"].iter().any(|other| name.starts_with(other));
        let is_measured = MEASURES.iter().any(|(base, ..)| {
            let prefix = self.unit.strip_suffix(base);
            prefix.is_some_and(|prefix| PREFIXES.iter().any(|(known, _)| *known == prefix))
        });
        !is_other && (is_measured || COUNTS.contains(&self.unit.as_str()))
    }

    /// Whether it is along a direction within the skin, where touches have either sign: `shear.x`, `force.T`.
    pub(crate) fn is_tangential(&self) -> bool {
        let (first, last) = self.name.split_once('.').unwrap_or((&self.name, ""));
        first.eq_ignore_ascii_case("shear") || ["x", "y", "T", "B"].contains(&last)
    }

    /// Newtons in one unit of an amount, or of a value times an area in m^2; `None` if its unit is neither
    /// one of force nor one of pressure.
    pub fn newtons(&self) -> Option<f64> {
        measure(&self.unit)
            .filter(|(newtons, of)| !newtons.is_nan() && *of == self.quantity)
            .map(|(newtons, _)| newtons)
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

impl Default for Channel {
    /// A pressure of unknown unit.
    fn default() -> Self {
        Self { name: "pressure".into(), unit: String::new(), quantity: Quantity::Intensive }
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
}
