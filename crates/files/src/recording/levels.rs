//! What of a recording is carried to every level: the readings, where they change, or how. Values of a level without a mesh
//! are carried down to the taxels and drawn there.

use crate::body::FieldLevel;
use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::pyramid::LevelId;
use crate::signal::{
    CarryDown, Channel, ChannelKind, Contrast, Edges, Frame, LevelFrame, Quantity, Restrictor, SignalError,
};
use crate::skin::PatchId;

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
    down: Option<Down>,
}

/// Values of a level without a mesh as those of level 0.
#[derive(Debug, Clone)]
struct Down {
    carry: CarryDown,
    /// The areas of the taxels, in m^2.
    areas: IdVec<PatchId, IdVec<VertexId, f64>>,
    drawn: LevelFrame,
}

impl Down {
    fn of(&mut self, levels: &LevelFrame, channels: &[Channel]) -> &LevelFrame {
        let Self { carry, areas, drawn } = self;
        drawn.time = levels.time;
        for (channel, Channel { quantity, .. }) in channels.iter().enumerate() {
            let Some(fields) = carry.fields(levels, channel) else { continue };
            for (patch, areas) in areas.enumerate() {
                let values = &mut drawn.values[patch][channel][LevelId::default()];
                for ((taxel, &area), value) in areas.enumerate().zip(values.iter_mut()) {
                    let density = carry.density((patch, taxel), fields, *quantity);
                    *value = quantity.extent(area) * density;
                }
            }
        }
        drawn
    }
}

/// Checks that a map has a level without a mesh, and that one of these channels has values of it.
pub(super) fn check_fields<'a>(
    map: &SkinMap,
    channels: impl Iterator<Item = &'a Channel> + Clone,
    at: FieldLevel,
) -> Result<(), SignalError> {
    let names = || channels.clone().map(|channel| channel.name.clone()).collect();
    let Some((_, level)) = map.field_levels().find(|(known, _)| *known == at) else {
        let known = map.field_levels().map(|(_, name)| name).collect();
        return Err(SignalError::NoFields { level: at.level, known });
    };
    let modality = at.modality.and_then(|number| map.body.modalities.get(number));
    match modality {
        Some(of) if !channels.clone().any(|channel| channel.has_fields(map, at)) => {
            Err(SignalError::NotOfModality { level, modality: of.name.clone(), known: names() })
        }
        _ => Ok(()),
    }
}

impl Levels {
    /// The readings on all levels, of which the one that is drawn has no mesh.
    pub(super) fn of_fields(map: &SkinMap, read: &[Channel], at: FieldLevel) -> Self {
        let down = Down {
            carry: CarryDown::new(map, at),
            areas: map.patches.map(|patch: &PatchMap| patch.taxels.areas.clone()),
            drawn: LevelFrame::new(map, read.len()),
        };
        Self { down: Some(down), ..Self::new(map, read, Carried::Values, None) }
    }

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
            down: None,
        }
    }

    /// A frame on every level, and what is drawn of it.
    pub(super) fn of(&mut self, frame: &Frame) -> [&LevelFrame; 2] {
        let levels = self.restrictor.restrict(frame);
        let carried = match (&mut self.contrast, &mut self.edges) {
            (Some(contrast), _) => contrast.of(levels),
            (_, Some(edges)) => edges.of(levels),
            _ => levels,
        };
        [carried, self.down.as_mut().map_or(carried, |down| down.of(carried, &self.channels))]
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
