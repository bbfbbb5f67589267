//! What of a recording is carried to every level: the readings, where they change, or how.

use crate::map::SkinMap;
use crate::pyramid::LevelId;
use crate::signal::{Channel, ChannelKind, Contrast, Edges, Frame, LevelFrame, Quantity, Restrictor};

/// What is carried to every level, and drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Carried {
    /// The readings.
    #[default]
    Values,
    /// What each level shows beyond the next coarser one.
    Contrast,
    /// The gradient of the readings on the map, along its u and its v axis.
    Edges,
}

#[derive(Debug, Clone)]
pub(super) struct Levels {
    pub(super) restrictor: Restrictor,
    contrast: Option<Contrast>,
    edges: Option<Edges>,
    pub(super) channels: Vec<Channel>,
    pub(super) level: Option<LevelId>,
}

impl Levels {
    pub(super) fn new(map: &SkinMap, read: &[Channel], carried: Carried, level: Option<LevelId>) -> Self {
        let restrictor = match level {
            Some(level) if carried == Carried::Values => Restrictor::to_level(map, read, level),
            _ => Restrictor::new(map, read),
        };
        Self {
            restrictor,
            contrast: (carried == Carried::Contrast).then(|| Contrast::new(map, read)),
            edges: (carried == Carried::Edges).then(|| Edges::new(map, read)),
            channels: match carried {
                Carried::Edges => read.iter().flat_map(gradients).collect(),
                Carried::Values | Carried::Contrast => read.to_vec(),
            },
            level,
        }
    }

    pub(super) fn of(&mut self, frame: &Frame) -> &LevelFrame {
        let levels = self.restrictor.restrict(frame);
        match (&mut self.contrast, &mut self.edges) {
            (Some(contrast), _) => contrast.of(levels),
            (_, Some(edges)) => edges.of(levels),
            _ => levels,
        }
    }
}

/// The channels of the gradient of a channel: along u and along v.
fn gradients(channel: &Channel) -> [Channel; 2] {
    let unit = channel.pixel_unit();
    let unit = if unit.is_empty() { unit } else { format!("{unit}/m") };
    ["u", "v"].map(|axis| Channel {
        name: format!("{}.gradient.{axis}", channel.name),
        unit: unit.clone(),
        quantity: Quantity::Intensive,
        kind: ChannelKind::Other,
    })
}
