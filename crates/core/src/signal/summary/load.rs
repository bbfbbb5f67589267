//! What presses on a group of taxels in one frame.

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::signal::{Channel, Quantity};
use crate::skin::{LinkId, PatchId, Taxels};

/// What presses on a group of taxels in one frame; a taxel without a reading is left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Number of readings.
    pub readings: usize,
    /// Their sum, in the unit of the channel.
    pub sum: f64,
    /// Their force in N: the sum of forces, or of pressures times areas. NaN if the unit is neither.
    pub force: f64,
    /// The largest reading; NaN without one.
    pub peak: f64,
    /// The taxel that has it; the first of them.
    pub peak_taxel: Option<(PatchId, VertexId)>,
    /// Number of loaded taxels.
    pub loaded: usize,
    /// Area of the loaded taxels, in m^2: the contact area.
    pub area: f64,
    /// Sum of the readings of the loaded taxels times their areas.
    loaded_sum: f64,
    /// Sum of the positive amounts of the loaded taxels, and of these times their positions.
    weight: f64,
    moment: DVec3,
    /// The link of the loaded taxels; `None` inside where they are on several.
    link: Option<Option<LinkId>>,
}

impl Default for Load {
    fn default() -> Self {
        Self {
            readings: 0,
            sum: 0.0,
            force: 0.0,
            peak: f64::NAN,
            peak_taxel: None,
            loaded: 0,
            area: 0.0,
            loaded_sum: 0.0,
            weight: 0.0,
            moment: DVec3::ZERO,
            link: None,
        }
    }
}

impl Load {
    /// Adds the load of other taxels.
    pub(super) fn merge(&mut self, other: &Self) {
        if other.readings == 0 {
            return;
        }
        self.readings += other.readings;
        self.sum += other.sum;
        self.force += other.force;
        if self.peak.is_nan() || other.peak > self.peak {
            (self.peak, self.peak_taxel) = (other.peak, other.peak_taxel);
        }
        self.loaded += other.loaded;
        self.area += other.area;
        self.loaded_sum += other.loaded_sum;
        self.weight += other.weight;
        self.moment += other.moment;
        self.link = match (self.link, other.link) {
            (None, link) | (link, None) => link,
            (Some(a), Some(b)) => Some(a.filter(|a| Some(*a) == b)),
        };
    }

    /// The share of it that a field has in which its taxels have this weight.
    pub(super) fn share(&self, weight: f64) -> Self {
        Self {
            sum: weight * self.sum,
            force: weight * self.force,
            area: weight * self.area,
            loaded_sum: weight * self.loaded_sum,
            weight: weight * self.weight,
            moment: weight * self.moment,
            ..*self
        }
    }

    /// The mean reading of the loaded taxels, weighted by their areas; `None` if none is loaded.
    pub fn mean(&self) -> Option<f64> {
        (self.loaded > 0).then(|| self.loaded_sum / self.area)
    }

    /// The centre of pressure of the loaded taxels, in m in the frame of their link; `None` if none is loaded, or they
    /// are on several links.
    pub fn centre(&self) -> Option<DVec3> {
        self.link.flatten().filter(|_| self.weight > 0.0).map(|_| self.moment / self.weight)
    }
}

/// Loads of single taxels of a patch.
#[derive(Debug, Clone)]
pub(super) struct Adder {
    link: LinkId,
    areas: IdVec<VertexId, f64>,
    positions: IdVec<VertexId, DVec3>,
    quantity: Quantity,
    newtons: f64,
}

impl Adder {
    pub(super) fn new(
        link: LinkId,
        channel: &Channel,
        taxels: &Taxels,
        positions: &IdVec<VertexId, DVec3>,
    ) -> Self {
        let newtons = channel.newtons().unwrap_or(f64::NAN);
        let (areas, positions) = (taxels.areas.clone(), positions.clone());
        Self { link, areas, positions, quantity: channel.quantity, newtons }
    }

    /// The load of a taxel, if it has a reading.
    pub(super) fn load(&self, patch: PatchId, taxel: VertexId, value: f64, threshold: f64) -> Option<Load> {
        if value.is_nan() {
            return None;
        }
        let area = self.areas[taxel];
        let amount = self.quantity.weight(area) * value;
        let load = Load {
            readings: 1,
            sum: value,
            force: self.newtons * amount,
            peak: value,
            peak_taxel: Some((patch, taxel)),
            ..Load::default()
        };
        if value <= threshold {
            return Some(load);
        }
        let weight = amount.max(0.0);
        Some(Load {
            loaded: 1,
            area,
            loaded_sum: value * area,
            weight,
            moment: weight * self.positions[taxel],
            link: Some(Some(self.link)),
            ..load
        })
    }
}
