//! One contact in one frame.

use glam::{DVec2, DVec3};

use crate::{
    id::VertexId,
    skin::{LinkId, PatchId},
};

/// What happens to a contact in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactEvent {
    /// It is new.
    #[default]
    Onset,
    /// It was there in the last frame, too.
    Move,
    /// It is no longer there: the rest says how it was in the last frame.
    Release,
}

/// One contact in one frame: a region of the skin that is pressed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ContactRegion {
    /// Number of the contact, from 0 on: the same in all frames.
    pub track: u64,
    /// What happens to it.
    pub event: ContactEvent,
    /// For how many frames it has been there, 1 for a new one.
    pub age: usize,
    /// The patch.
    pub patch: PatchId,
    /// The link of the patch.
    pub link: LinkId,
    /// The taxels, by their number.
    pub taxels: Vec<VertexId>,
    /// Area of the taxels, in m^2.
    pub area: f64,
    /// Force on the taxels, in N: the sum of the readings of a force, and of readings times areas of a
    /// pressure. NaN where the unit of the channel is of neither.
    pub force: f64,
    /// Centre of pressure, in m in the frame of the link: the mean of the taxels' positions, weighted
    /// by their force, moved to the nearest point of the skin around them.
    pub centre: DVec3,
    /// Unit normal of the skin there, outward.
    pub normal: DVec3,
    /// The centre on the map, in m.
    pub map: DVec2,
    /// Standard deviation of the positions, weighted by their force, along the longer principal axis
    /// in the tangent plane of the centre, in m.
    pub major: f64,
    /// That along the shorter principal axis, in m.
    pub minor: f64,
    /// Direction of the longer principal axis on the map, in rad, above -pi/2 and at most pi/2.
    pub angle: f64,
    /// The taxel with the largest reading; the first of them.
    pub peak_taxel: VertexId,
    /// The largest reading.
    pub peak: f64,
}

impl ContactRegion {
    /// Order of regions in a frame: by patch, then by the first taxel.
    pub(super) fn place(&self) -> (PatchId, Option<VertexId>) {
        (self.patch, self.taxels.first().copied())
    }
}
