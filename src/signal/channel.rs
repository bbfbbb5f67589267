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

impl Default for Channel {
    /// A pressure in no known unit.
    fn default() -> Self {
        Self { name: "pressure".into(), unit: String::new(), quantity: Quantity::Intensive }
    }
}
