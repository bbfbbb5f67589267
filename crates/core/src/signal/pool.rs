//! Values of groups of taxels: the law of receptive fields, with whole taxels.

use crate::map::SkinMap;
use crate::numeric::storable;
use crate::signal::{Channel, Quantity};

/// Pools readings over groups of taxels, such as named regions.
#[derive(Debug, Clone)]
pub struct GroupPool {
    groups: Vec<Option<usize>>,
    areas: Vec<f64>,
    count: usize,
}

impl GroupPool {
    /// Groups of the taxels of a map: the number of each, below `count`, in the order of the map; `None` for none. Taxels
    /// that the readings of the channel [are not of](Channel::taxels) are in none.
    ///
    /// # Panics
    /// If there is not one for each taxel.
    pub fn new(
        map: &SkinMap,
        channel: &Channel,
        groups: impl IntoIterator<Item = Option<usize>>,
        count: usize,
    ) -> Self {
        let mut groups: Vec<_> = groups.into_iter().collect();
        let is_read: Vec<_> = channel.taxels(map).iter().flatten().copied().collect();
        assert_eq!(groups.len(), is_read.len(), "one group for each taxel");
        for (group, is_read) in groups.iter_mut().zip(is_read) {
            *group = group.filter(|&group| group < count && is_read);
        }
        let areas = map.patches.iter().flat_map(|patch| patch.taxels.areas.iter().copied()).collect();
        Self { groups, areas, count }
    }

    /// The named regions of a map.
    pub fn of_regions(map: &SkinMap, channel: &Channel) -> Self {
        let regions = map.regions();
        let groups = regions.of_taxels.iter().flat_map(|of| of.iter()).map(|region| Some((*region)?.index()));
        Self::new(map, channel, groups.collect::<Vec<_>>(), regions.names.len())
    }

    /// Number of groups.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The value of each group: the sum of amounts, the mean of averages weighted by the areas of taxels; NaN where no
    /// taxel has a reading, or where it is beyond the range of 32-bit floats.
    ///
    /// # Panics
    /// If there is not one value for each taxel, in the order of the map.
    pub fn pool(&self, values: &[f64], quantity: Quantity) -> Vec<f64> {
        assert_eq!(values.len(), self.groups.len(), "one reading for each taxel");
        let mut sums = vec![(0.0, 0.0); self.count];
        for ((group, area), value) in self.groups.iter().zip(&self.areas).zip(values) {
            let Some(group) = group.filter(|_| !storable(*value).is_nan()) else { continue };
            let weight = quantity.weight(*area);
            let (sum, total) = &mut sums[group];
            *sum += weight * value;
            *total += weight;
        }
        sums.into_iter().map(|(sum, total)| quantity.of_sums(sum, total)).collect()
    }
}
