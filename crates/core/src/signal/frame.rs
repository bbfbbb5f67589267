//! Readings at one time: on the taxels, and on every level.

use crate::body::{BodyLevel, Modality};
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::pyramid::LevelId;
use crate::skin::PatchId;

/// One frame of readings: `values[patch][channel][taxel]`, NaN where there is no reading.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Frame {
    /// Its time, in s.
    pub time: f64,
    /// The readings, in the unit of their channel.
    pub values: IdVec<PatchId, Vec<IdVec<VertexId, f64>>>,
    /// The taxels of each channel whose value was not measured but filled from its neighbours, in their order.
    pub filled: IdVec<PatchId, Vec<Vec<VertexId>>>,
}

impl Frame {
    /// A frame of the taxels of `map` without any reading.
    pub fn new(map: &SkinMap, channels: usize) -> Self {
        let patch = |taxels: usize| vec![IdVec::filled(f64::NAN, taxels); channels];
        Self {
            time: 0.0,
            values: map.patches.map(|p| patch(p.taxels.ids.len())),
            filled: map.patches.map(|_| vec![Vec::new(); channels]),
        }
    }
}

/// A stage of processing: gets the frames of a recording one after the other, each with its time, and passes
/// them on, changed or unchanged.
///
/// It may keep state, and allocates only while it learns. A missing reading stays missing, unless the stage
/// marks it as [filled](Frame::filled).
pub trait Stage {
    /// Number of first frames that it must learn from before it can pass on any.
    fn frames_to_learn(&self) -> usize {
        0
    }

    /// Learns from one of these.
    fn learn(&mut self, _frame: &Frame) {}

    /// Ends learning: there are no more of these frames, or the recording has no more.
    fn settle(&mut self) {}

    /// The next frame for the stages after this one.
    ///
    /// # Panics
    /// If it does not have the patches, channels and taxels that the stage was made for.
    fn apply<'f>(&'f mut self, frame: &'f Frame) -> &'f Frame;
}

/// The values of one channel of a patch on every level.
type ChannelLevels = IdVec<LevelId, IdVec<VertexId, f64>>;

/// A frame on every level: `values[patch][channel][level][vertex of that level]`, NaN where there is
/// no value. Level 0 is the frame itself.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LevelFrame {
    /// Its time, in s.
    pub time: f64,
    /// The values, in the unit of their channel.
    pub values: IdVec<PatchId, Vec<ChannelLevels>>,
    /// The area of each field that has readings, in m^2: [`Restrictor`](crate::signal::Restrictor)
    /// leaves out taxels without a reading.
    pub areas: IdVec<PatchId, Vec<ChannelLevels>>,
    /// The vertices of each level whose value is not measured: all of their readings are
    /// [filled](Frame::filled).
    pub unmeasured: IdVec<PatchId, Vec<IdVec<LevelId, Vec<VertexId>>>>,
    /// The values of each channel on the [levels of the whole body](crate::body), and whether each is measured: those of a
    /// [`Restrictor`](crate::signal::Restrictor) of all levels, else NaN.
    pub body: Vec<ChannelLevels>,
    /// Of each of these whether a reading of its taxels was measured, not [filled](Frame::filled).
    pub is_body_measured: Vec<IdVec<LevelId, IdVec<VertexId, bool>>>,
    /// Those of each [modality](crate::body::Modality) besides touch of the map; NaN in the channels of others.
    pub modalities: Vec<ModalityValues>,
}

/// The values of each channel on the levels of a modality.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ModalityValues {
    /// The values, as of [`LevelFrame::body`].
    pub values: Vec<ChannelLevels>,
    /// Whether each is measured.
    pub is_measured: Vec<IdVec<LevelId, IdVec<VertexId, bool>>>,
}

impl ModalityValues {
    /// No value on these levels.
    fn new<'a>(levels: impl Iterator<Item = &'a BodyLevel> + Clone, channels: usize) -> Self {
        let sizes = levels.map(|level| level.origins.len());
        let values = sizes.clone().map(|fields| IdVec::filled(f64::NAN, fields)).collect();
        let is_measured = sizes.map(|fields| IdVec::filled(false, fields)).collect();
        Self { values: vec![values; channels], is_measured: vec![is_measured; channels] }
    }
}

impl LevelFrame {
    /// A frame of all levels of `map` without any value; the areas are those of the whole fields.
    pub fn new(map: &SkinMap, channels: usize) -> Self {
        let values = map.patches.map(|patch| {
            let levels = patch.levels.map(|l| IdVec::filled(f64::NAN, l.level.mesh.positions.len()));
            vec![levels; channels]
        });
        let areas = map.patches.map(|patch| vec![patch.levels.map(|l| l.level.areas.clone()); channels]);
        let unmeasured = map.patches.map(|patch| vec![patch.levels.map(|_| Vec::new()); channels]);
        let ModalityValues { values: body, is_measured: is_body_measured } =
            ModalityValues::new(map.body.levels.iter(), channels);
        let of_modality = |modality: &Modality| ModalityValues::new(modality.levels.iter(), channels);
        let modalities = map.body.modalities.iter().map(of_modality).collect();
        Self { time: 0.0, values, areas, unmeasured, body, is_body_measured, modalities }
    }

    /// Panics if the number of patches differs, or that of the channels of a patch.
    pub(super) fn check(&self, patches: usize, channels: usize) {
        assert_eq!(self.values.len(), patches, "one entry per patch");
        assert!(self.values.iter().all(|values| values.len() == channels), "one array per channel");
    }
}
