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
    /// `force.N` or `charge`. A temperature is intensive, though its unit be `C`.
    #[must_use]
    pub fn new(name: &str, unit: &str) -> Self {
        let first = name.split('.').next().unwrap_or_default().to_ascii_lowercase();
        let base =
            unit.strip_prefix(['p', 'n', 'u', '\u{b5}', '\u{3bc}', 'm', 'c', 'd', 'k']).unwrap_or(unit);
        let is_amount = match unit {
            "" => ["force", "charge"].contains(&first.as_str()),
            _ => ["N", "gf", "lbf", "C"].contains(&base) && !first.starts_with("temp"),
        };
        let quantity = if is_amount { Quantity::Extensive } else { Quantity::Intensive };
        Self { name: name.into(), unit: unit.into(), quantity }
    }

    /// The unit of its pixels: amounts are drawn per area of the map, as `N/m^2`; without a unit
    /// `1/m^2`.
    #[must_use]
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
        Self { name: "pressure".into(), unit: String::new(), quantity: Quantity::Intensive }
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
        assert_eq!(Channel::new("pressure", ""), Channel::default());
    }
}
