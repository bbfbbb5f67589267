//! What one number per taxel means.

/// How a channel is carried between levels and to pixels.
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
    /// Its unit, as `Pa`, `N` or `count`; empty where it is not known.
    pub unit: String,
    /// How it is carried between levels.
    pub quantity: Quantity,
}

impl Channel {
    /// A channel of this name and unit, extensive if the unit is one of force or charge (`N`, `gf`,
    /// `lbf`, `C`, with a prefix such as `m` or not), or if it has none and is called `force`,
    /// `force.N` or `charge`. A temperature is intensive, though its unit be `C`. Without a name it is
    /// called `force` if it is extensive, else `pressure`.
    pub fn new(name: &str, unit: &str) -> Self {
        let first = name.split('.').next().unwrap_or_default().to_ascii_lowercase();
        let base =
            unit.strip_prefix(['p', 'n', 'u', '\u{b5}', '\u{3bc}', 'm', 'c', 'd', 'k']).unwrap_or(unit);
        let is_amount = match unit {
            "" => ["force", "charge"].contains(&first.as_str()),
            _ => ["N", "gf", "lbf", "C"].contains(&base) && !first.starts_with("temp"),
        };
        let quantity = if is_amount { Quantity::Extensive } else { Quantity::Intensive };
        let name = match (name, quantity) {
            ("", Quantity::Extensive) => "force",
            ("", Quantity::Intensive) => "pressure",
            _ => name,
        };
        Self { name: name.into(), unit: unit.into(), quantity }
    }

    /// What an amount of it, or its value times an area in m^2, is in N; `None` if its unit is neither one
    /// of force nor one of pressure.
    pub(crate) fn newtons(&self) -> Option<f64> {
        /// Units that take prefixes, and what they are in N or in Pa.
        const UNITS: [(&str, f64, Quantity); 6] = [
            ("N", 1.0, Quantity::Extensive),
            ("gf", 9.80665e-3, Quantity::Extensive),
            ("lbf", 4.448_221_615_260_5, Quantity::Extensive),
            ("Pa", 1.0, Quantity::Intensive),
            ("N/m^2", 1.0, Quantity::Intensive),
            ("bar", 1e5, Quantity::Intensive),
        ];
        const PREFIXES: [(&str, f64); 11] = [
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
        ];
        let prefixed = PREFIXES.iter().filter_map(|(prefix, x)| Some((self.unit.strip_prefix(prefix)?, x)));
        let known = prefixed.flat_map(|(base, x)| {
            let same = move |(unit, ..): &&(&str, f64, Quantity)| *unit == base;
            UNITS.iter().filter(same).map(move |(_, y, quantity)| (x * y, *quantity))
        });
        let mega =
            self.unit.strip_prefix('M').filter(|base| *base == "Pa").map(|_| (1e6, Quantity::Intensive));
        known.chain(mega).find(|(_, quantity)| *quantity == self.quantity).map(|(newtons, _)| newtons)
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
    /// A pressure in no known unit.
    fn default() -> Self {
        Self::new("", "")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_says_whether_values_add_up() {
        for (name, unit, is_amount) in [
            ("force.N", "N", true),
            ("load", "mN", true),
            ("load", "kgf", true),
            ("force", "", true),
            ("charge", "pC", true),
            ("force", "count", false),
            ("pressure", "Pa", false),
            ("pressure", "N/m^2", false),
            ("temperature", "C", false),
            ("heat", "degC", false),
            ("", "", false),
        ] {
            let found = Channel::new(name, unit).quantity == Quantity::Extensive;
            assert_eq!(found, is_amount, "{name} in {unit:?}");
        }
        assert_eq!(Channel::new("", ""), Channel::default());
        assert_eq!(Channel::new("", "mN"), Channel::new("force", "mN"));
        assert_eq!(Channel::new("", "kPa"), Channel::new("pressure", "kPa"));
        for (unit, newtons) in [
            ("N", Some(1.0)),
            ("mN", Some(1e-3)),
            ("kPa", Some(1e3)),
            ("MPa", Some(1e6)),
            ("hPa", Some(100.0)),
            ("mbar", Some(100.0)),
            ("", None),
            ("count", None),
            ("mm", None),
        ] {
            let found = Channel::new("load", unit).newtons();
            assert!(
                found.zip(newtons).map_or(found == newtons, |(a, b)| (a / b - 1.0).abs() < 1e-12),
                "{unit}"
            );
        }
    }
}
