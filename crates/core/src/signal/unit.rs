//! Units of readings, each parsed once: what it measures, and how many of its base unit it is.

use crate::numeric::storable;

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

impl Quantity {
    /// The weight of a reading in a sum over taxels: 1 of an amount, the area of the taxel of an average.
    #[doc(hidden)]
    pub fn weight(self, area: f64) -> f64 {
        if self == Self::Extensive { 1.0 } else { area }
    }

    /// What a value is divided by to compare fields of several sizes: the area of an amount, 1 of an average.
    #[doc(hidden)]
    pub fn extent(self, area: f64) -> f64 {
        if self == Self::Extensive { area } else { 1.0 }
    }

    /// The value of a field or group from the sum of its readings by [weight](Self::weight) and the sum of the weights or
    /// areas; NaN where nothing has a reading.
    pub(crate) fn of_sums(self, sum: f64, total: f64) -> f64 {
        storable(match self {
            // 0 / 0 is NaN.
            Self::Intensive => sum / total,
            Self::Extensive if total > 0.0 => sum,
            Self::Extensive => f64::NAN,
        })
    }
}

/// What a channel measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, strum::Display, strum::EnumString)]
#[strum(serialize_all = "lowercase")]
pub enum ChannelKind {
    /// Touches: a force, pressure or charge, or what a sensor of them reads, as counts, V, F or Ohm. Readings are near a
    /// zero where nothing touches.
    #[default]
    Touch,
    /// Touches along a direction within the skin, where they have either sign: `shear.x`, `force.T`.
    Tangential,
    /// Something else, as a temperature, an acceleration or a strain. It has no zero, no response and no contacts.
    Other,
}

impl ChannelKind {
    /// Whether touches are measured, in any direction.
    pub fn is_of_touch(self) -> bool {
        self != Self::Other
    }
}

/// A unit with its prefix.
#[derive(Debug, Clone, PartialEq)]
#[doc(hidden)]
pub struct Unit {
    /// How it is usually written: vendors write `KPa` and `PSI`.
    #[doc(hidden)]
    pub name: String,
    /// The unit without prefix that it is a multiple of, as `Pa` of `psi`. Units of one base convert to each other.
    pub(crate) base: &'static str,
    /// How many of the base one of it is.
    pub(crate) factor: f64,
    /// How values are transferred between levels.
    pub(crate) quantity: Quantity,
    /// Whether touches are measured in it.
    pub(crate) kind: ChannelKind,
}

/// Names, base, and how many of the base one is; first amounts of touches, then averages of touches, then others.
const UNITS: [&[(&str, &str, f64)]; 3] = [
    &[("N", "N", 1.0), ("gf", "N", 9.806_65e-3), ("lbf", "N", 4.448_221_615_260_5), ("C", "C", 1.0)],
    &[
        ("Pa N/m^2", "Pa", 1.0),
        ("bar", "Pa", 1e5),
        ("N/cm^2", "Pa", 1e4),
        ("N/mm^2", "Pa", 1e6),
        ("gf/cm^2", "Pa", 98.0665),
        ("gf/mm^2", "Pa", 9806.65),
        ("psi", "Pa", 6_894.757_293_168_361),
        ("mmHg", "Pa", 133.322_387_415),
        ("cmH2O", "Pa", 98.0665),
        ("mmH2O", "Pa", 9.806_65),
        ("atm", "Pa", 101_325.0),
        ("count counts raw LSB digit digits adc", "count", 1.0),
        ("bit", "bit", 1.0),
        ("1", "1", 1.0),
        ("%", "1", 0.01),
        ("V", "V", 1.0),
        ("A", "A", 1.0),
        ("F", "F", 1.0),
        ("Ohm ohm \u{3a9} \u{2126}", "Ohm", 1.0),
    ],
    &[
        ("K", "K", 1.0),
        ("degC \u{b0}C", "degC", 1.0),
        ("degF", "degF", 1.0),
        ("Hz", "Hz", 1.0),
        ("m", "m", 1.0),
        ("rad", "rad", 1.0),
        ("deg", "rad", std::f64::consts::PI / 180.0),
        ("s", "s", 1.0),
        ("m/s", "m/s", 1.0),
        ("m/s^2", "m/s^2", 1.0),
        ("T", "T", 1.0),
        ("lx", "lx", 1.0),
        ("N/m", "N/m", 1.0),
        ("Pa*s", "Pa*s", 1.0),
    ],
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

/// All units with all prefixes, those without a prefix first.
fn all() -> impl Iterator<Item = Unit> {
    PREFIXES.into_iter().flat_map(|(prefix, multiple)| {
        (0..).zip(UNITS).flat_map(move |(group, units)| {
            let quantity = if group == 0 { Quantity::Extensive } else { Quantity::Intensive };
            let kind = if group == 2 { ChannelKind::Other } else { ChannelKind::Touch };
            let names = units.iter().flat_map(move |&(names, base, factor)| {
                names.split(' ').map(move |name| (name, base, factor * multiple))
            });
            let takes_it = move |name: &str| prefix.is_empty() || name.starts_with(char::is_alphabetic);
            names.filter(move |(name, ..)| takes_it(name)).map(move |(name, base, factor)| Unit {
                name: format!("{prefix}{name}"),
                base,
                factor,
                quantity,
                kind,
            })
        })
    })
}

/// The unit that a text names, as it stands, or, of force, pressure and counts, in other letters of small or large
/// case that fit one unit alone: `mpa` may be two. `None` if there is none.
#[doc(hidden)]
pub fn parse_unit(text: &str) -> Option<Unit> {
    if let Some(unit) = all().find(|unit| unit.name == text) {
        return Some(unit);
    }
    let is_it =
        |unit: &Unit| ["N", "Pa", "count"].contains(&unit.base) && unit.name.eq_ignore_ascii_case(text);
    let mut found = all().filter(is_it);
    found.next().filter(|_| found.next().is_none())
}

/// The known unit whose name is nearest to a text: with the fewest letters changed.
pub(crate) fn nearest_unit(text: &str) -> String {
    let lower = text.to_lowercase();
    let distance = |unit: &Unit| (edits(&unit.name.to_lowercase(), &lower), edits(&unit.name, text));
    all().min_by_key(distance).map_or_else(String::new, |unit| unit.name)
}

/// The least number of letters to insert, leave out or change to get from one text to another (Levenshtein 1966).
fn edits(from: &str, to: &str) -> usize {
    let mut row: Vec<usize> = (0..=to.chars().count()).collect();
    for (k, a) in from.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], k + 1);
        for (j, b) in to.chars().enumerate() {
            let changed = diagonal + usize::from(a != b);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row.last().copied().unwrap_or(0)
}

/// The factor from the unit `from` to the unit `to`; `None` if they do not measure the same quantity.
#[doc(hidden)]
pub fn unit_ratio(from: &str, to: &str) -> Option<f64> {
    if from == to {
        return Some(1.0);
    }
    let (from, to) = (parse_unit(from)?, parse_unit(to)?);
    (from.base == to.base).then(|| from.factor / to.factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A prefix changes the factor of a unit and nothing else; no name is that of two units.
    #[test]
    fn a_prefix_changes_the_factor_alone() {
        for unit in all() {
            assert_eq!(parse_unit(&unit.name), Some(unit.clone()), "{}", unit.name);
        }
        for (name, base, factor) in UNITS
            .into_iter()
            .flatten()
            .flat_map(|(names, base, factor)| names.split(' ').map(move |name| (name, *base, *factor)))
        {
            let plain = parse_unit(name).unwrap();
            for (prefix, multiple) in PREFIXES {
                let Some(found) = parse_unit(&format!("{prefix}{name}")) else {
                    assert!(["1", "%", "\u{b0}C"].contains(&name), "{prefix}{name} is not known");
                    continue;
                };
                assert_eq!(
                    (found.base, found.quantity, found.kind),
                    (base, plain.quantity, plain.kind),
                    "{prefix}{name}"
                );
                assert!((found.factor / (factor * multiple) - 1.0).abs() < 1e-12, "{prefix}{name}");
            }
        }
    }

    #[test]
    fn units_are_known_as_vendors_spell_them() {
        for (text, name) in
            [("KPa", "kPa"), ("PSI", "psi"), ("mmhg", "mmHg"), ("RAW", "raw"), ("n", "N"), ("kpa", "kPa")]
        {
            assert_eq!(parse_unit(text).unwrap().name, name);
        }
        for text in ["", "k", "v", "mpa", "stone", "kdeg C"] {
            assert_eq!(parse_unit(text), None, "{text:?}");
        }
        assert_eq!(unit_ratio("adc", "count"), Some(1.0));
        assert!((unit_ratio("mV", "V").unwrap() - 1e-3).abs() < 1e-15);
        assert_eq!(unit_ratio("V", "count"), None);
        for (text, near) in [("coumt", "count"), ("kPascal", "kPa"), ("Ohms", "Ohm"), ("mmHG.", "mmHg")] {
            assert_eq!(nearest_unit(text), near, "{text}");
        }
    }
}
