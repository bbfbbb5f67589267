//! What is known before: taxels, robot and drawing.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::id::VertexId;
use crate::skin::TaxelId;
use crate::touches::TouchesError;
use crate::touches::delay::MOST_DELAY;
use crate::touches::drawing::Drawing;
use crate::touches::estimate::Known;
use crate::touches::gather::Samples;
use crate::touches::log::{TouchFrame, TouchLog};
use crate::touches::surface;

/// What is known about the taxels and the robot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TouchesOptions {
    /// Radius of the disc on which a taxel feels, in m; `None`: 2 mm.
    pub taxel_radius: Option<f64>,
    /// Readings over mean depths, in 1/m: the stiffness times the area of a taxel for forces, the
    /// stiffness for pressures. `None`: estimated.
    pub gain: Option<f64>,
    /// Standard deviation of the position of the arm, per axis, in m; `None`: estimated from the fit, or else 1 mm.
    pub arm_noise: Option<f64>,
    /// How late the readings are, in s: each frame has the readings of this much earlier. `None`: estimated, and taken off beyond
    /// five standard deviations.
    pub delay: Option<f64>,
    /// A drawing of the skin: where taxels should be, and their normals, in the frame of the link.
    pub drawing: Option<Drawing>,
    /// Taxels that are left out, such as faulty ones.
    pub left_out: BTreeSet<TaxelId>,
}

/// The radius of the disc on which a taxel feels, unless another is given, in m.
pub(super) const TAXEL_RADIUS: f64 = 2e-3;

/// The noise of the arm where it is neither given nor can be estimated, in m.
pub(super) const ARM_NOISE: f64 = 1e-3;

impl TouchesOptions {
    /// Without the taxels to be left out that neither the log nor the drawing has, as a list for several links has.
    #[must_use]
    pub fn left_out_of(mut self, log: &TouchLog) -> Self {
        let left_out = std::mem::take(&mut self.left_out);
        self.left_out = left_out.into_iter().filter(|id| self.is_known(*id, log)).collect();
        self
    }

    fn is_known(&self, id: TaxelId, log: &TouchLog) -> bool {
        let is_drawn = self.drawing.as_ref().is_some_and(|drawing| drawing.normals.contains_key(&id));
        is_drawn || log.frames.iter().flat_map(|frame| &frame.felt).any(|(felt, _)| *felt == id)
    }

    pub(super) fn validate(&self, log: &TouchLog) -> Result<(), TouchesError> {
        for (option, range, found) in [
            ("the radius of a taxel in m", 1e-6..=1e3, self.taxel_radius),
            ("the gain", 1e-15..=1e15, self.gain),
            ("the noise of the arm in m", 0.0..=1e3, self.arm_noise),
            ("the delay of the readings in s", -MOST_DELAY..=MOST_DELAY, self.delay),
        ] {
            if let Some(found) = found.filter(|found| !range.contains(found)) {
                return Err(TouchesError::BadOption { option, found, range: [*range.start(), *range.end()] });
            }
        }
        if let Some(&id) = self.left_out.iter().find(|id| !self.is_known(**id, log)) {
            return Err(TouchesError::UnknownLeftOut { id });
        }
        let Some(drawing) = &self.drawing else { return Ok(()) };
        for frame in &log.frames {
            let is_unknown = |id: &TaxelId| !drawing.normals.contains_key(id) && !self.left_out.contains(id);
            if let Some(id) = frame.felt.iter().map(|(id, _)| *id).find(is_unknown) {
                return Err(TouchesError::UnknownTaxel { row: frame.row, id });
            }
        }
        Ok(())
    }

    /// The rows in which the centre of the sphere is below the drawn taxel of the largest reading.
    pub(super) fn rows_inside(&self, log: &TouchLog) -> Vec<usize> {
        let Some(drawing) = &self.drawing else { return Vec::new() };
        let is_inside = |frame: &&TouchFrame| {
            let strongest = frame.felt.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|felt| felt.0);
            let drawn = strongest.and_then(|id| drawing.positions.get(&id).zip(drawing.normals.get(&id)));
            let centre = frame.link.rotation.conjugate() * (frame.body.point() - frame.link.position);
            frame.body.radius() > 0.0 && drawn.is_some_and(|(&at, normal)| (centre - at).dot(*normal) < 0.0)
        };
        log.frames.iter().filter(is_inside).map(|frame| frame.row).collect()
    }

    /// What is known of the taxels of some samples.
    pub(super) fn known(&self, samples: &Samples) -> Known {
        let ids = &samples.ids;
        let index: BTreeMap<TaxelId, VertexId> = ids.enumerate().map(|(v, &id)| (id, v)).collect();
        let normals = self
            .drawing
            .as_ref()
            .map(|drawing| ids.map(|id| drawing.normals.get(id).copied().unwrap_or(DVec3::ZERO)));
        let neighbours =
            self.drawing.as_ref().filter(|drawing| !drawing.neighbours.is_empty()).map(|drawing| {
                let mut lists = ids.map(|_| Vec::new());
                for pair in &drawing.neighbours {
                    if let [Some(&a), Some(&b)] = pair.map(|id| index.get(&id)) {
                        lists[a].push(b);
                        lists[b].push(a);
                    }
                }
                lists
            });
        let spacing = self
            .drawing
            .as_ref()
            .and_then(|drawing| surface::spacing(&drawing.positions.values().copied().collect()));
        Known {
            spacing,
            normals,
            neighbours,
            taxel_radius: self.taxel_radius.unwrap_or(TAXEL_RADIUS),
            gain: self.gain,
            arm_noise: self.arm_noise,
        }
    }
}
