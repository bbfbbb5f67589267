//! What `render` shows of the readings: themselves, their contrast or their edges.

use dermatome::{
    map::SkinMap,
    signal::{Channel, Contrast, Edges, Frame, LevelFrame, Quantity, Restrictor},
};

/// What is drawn of the readings.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shown {
    Readings,
    Contrast,
    Edges,
}

/// Values on all levels: the readings, their contrast or their edges.
pub(super) struct Values<'a> {
    restrictor: Restrictor<'a>,
    derived: Derived<'a>,
}

/// What is computed of the readings on all levels.
enum Derived<'a> {
    Readings,
    Contrast(Contrast<'a>),
    Edges(Edges<'a>),
}

impl<'a> Values<'a> {
    pub(super) fn new(map: &'a SkinMap, channels: &[Channel], shown: Shown) -> Self {
        let derived = match shown {
            Shown::Readings => Derived::Readings,
            Shown::Contrast => Derived::Contrast(Contrast::new(map, channels)),
            Shown::Edges => Derived::Edges(Edges::new(map, channels)),
        };
        Self { restrictor: Restrictor::new(map, channels), derived }
    }

    pub(super) fn of(&mut self, frame: &Frame) -> &LevelFrame {
        let levels = self.restrictor.restrict(frame);
        match &mut self.derived {
            Derived::Readings => levels,
            Derived::Contrast(contrast) => contrast.of(levels),
            Derived::Edges(edges) => edges.of(levels),
        }
    }
}

/// The channels of what is drawn: edges have two for each channel, their size and direction.
pub(super) fn shown_channels(channels: &[Channel], shown: Shown) -> Vec<Channel> {
    let Shown::Edges = shown else { return channels.to_vec() };
    let of_edges = |channel: &Channel| {
        let part = |part: &str, unit: String, quantity: Quantity| Channel {
            name: format!("{}.{part}", channel.name),
            unit,
            quantity,
        };
        let unit = channel.pixel_unit();
        let size = if unit.is_empty() { unit } else { format!("{unit}/m") };
        [part("edge", size, Quantity::Intensive), part("direction", "rad".into(), Quantity::Direction)]
    };
    channels.iter().flat_map(of_edges).collect()
}
