//! Loads added up over time.

use glam::DVec3;

use crate::id::VertexId;
use crate::signal::summary::Load;
use crate::skin::PatchId;

/// What a group of taxels felt in all frames; `None` where there was nothing to measure, or no times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Totals {
    /// Number of taxels that the channel is of; 0 of a contact.
    pub taxels: usize,
    /// Their area, in m^2.
    pub area: f64,
    /// Frames in which a taxel has a reading.
    pub frames: usize,
    /// Frames in which a taxel is loaded.
    pub loaded_frames: usize,
    /// The largest reading, its time and its taxel.
    pub peak: Option<f64>,
    /// Its time, in s.
    pub peak_time: Option<f64>,
    /// Its taxel.
    pub peak_taxel: Option<(PatchId, VertexId)>,
    /// The largest sum of the readings of a frame.
    pub sum_peak: Option<f64>,
    /// The largest force of a frame, in N.
    pub force_peak: Option<f64>,
    /// Its time, in s.
    pub force_peak_time: Option<f64>,
    /// The integral of the force over time, in N s.
    pub impulse: Option<f64>,
    /// The integral of the peak of each frame over time, in the unit of the channel times s.
    pub pressure_time_integral: Option<f64>,
    /// The largest contact area of a frame, in m^2.
    pub contact_area_peak: f64,
    /// How long a taxel was loaded, in s.
    pub contact_time: Option<f64>,
    /// Time of the first frame in which a taxel is loaded, in s.
    pub first_contact: Option<f64>,
    /// Time of the last one, in s.
    pub last_contact: Option<f64>,
    /// Length of the path of the centre of pressure, in m, without the jumps between contacts.
    pub path: Option<f64>,
    /// Its largest speed between two frames, in m/s.
    pub speed_peak: Option<f64>,
    /// How long the path took, in s.
    path_time: f64,
    /// Sums over the loaded frames of mean, force and contact area.
    sums: [f64; 3],
    /// The load of the frame before.
    last: Option<Kept>,
}

/// What is kept of a load for the next frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Kept {
    force: f64,
    peak: f64,
    is_loaded: bool,
    centre: Option<DVec3>,
}

impl Kept {
    pub(super) fn of(load: &Load) -> Self {
        Self { force: load.force, peak: load.peak, is_loaded: load.loaded > 0, centre: load.centre() }
    }
}

/// Nothing touches.
const AT_REST: Kept = Kept { force: 0.0, peak: 0.0, is_loaded: false, centre: None };

impl Totals {
    /// Those of something that begins to touch in the next frame.
    pub(super) fn enter() -> Self {
        Self::after(Some(AT_REST))
    }

    /// Those from a frame on, before which there was this load.
    pub(super) fn after(last: Option<Kept>) -> Self {
        Self { last, ..Self::default() }
    }

    /// Adds that it does not touch any more in a frame, `step` s after the one before.
    pub(super) fn leave(&mut self, step: Option<f64>) {
        if let (Some(last), Some(step)) = (self.last.take(), step) {
            self.integrate(&last, &AT_REST, step);
        }
    }

    /// Adds the load of a frame, `step` s after the frame before, if that is known and no gap.
    pub(super) fn add(&mut self, time: f64, step: Option<f64>, load: &Load) {
        if load.readings == 0 {
            self.last = None;
            return;
        }
        let known = Some(time).filter(|time| time.is_finite());
        self.frames += 1;
        if self.peak.is_none_or(|peak| load.peak > peak) {
            (self.peak, self.peak_time, self.peak_taxel) = (Some(load.peak), known, load.peak_taxel);
        }
        if self.sum_peak.is_none_or(|sum| load.sum > sum) {
            self.sum_peak = Some(load.sum);
        }
        if !load.force.is_nan() && self.force_peak.is_none_or(|force| load.force > force) {
            (self.force_peak, self.force_peak_time) = (Some(load.force), known);
        }
        self.contact_area_peak = self.contact_area_peak.max(load.area);
        if let Some(mean) = load.mean() {
            self.loaded_frames += 1;
            self.sums.iter_mut().zip([mean, load.force, load.area]).for_each(|(sum, x)| *sum += x);
            self.first_contact = self.first_contact.or(known);
            self.last_contact = known;
        }
        let now = Kept::of(load);
        if let (Some(last), Some(step)) = (self.last, step) {
            self.integrate(&last, &now, step);
        }
        self.last = Some(now);
    }

    /// Adds what lies between two frames, by the trapezoidal rule.
    fn integrate(&mut self, last: &Kept, now: &Kept, step: f64) {
        let add = |sum: &mut Option<f64>, a: f64, b: f64| {
            let part = 0.5 * step * (a + b);
            // Times that stand still measure nothing.
            if part.is_finite() && step > 0.0 {
                *sum.get_or_insert(0.0) += part;
            }
        };
        add(&mut self.impulse, last.force, now.force);
        add(&mut self.pressure_time_integral, last.peak, now.peak);
        let [a, b] = [last, now].map(|kept| f64::from(u8::from(kept.is_loaded)));
        add(&mut self.contact_time, a, b);
        if let (Some(from), Some(to)) = (last.centre, now.centre) {
            let length = from.distance(to);
            *self.path.get_or_insert(0.0) += length;
            self.path_time += step;
            if step > 0.0 {
                self.speed_peak = Some(self.speed_peak.unwrap_or(0.0).max(length / step));
            }
        }
    }

    fn mean_of(&self, k: usize) -> Option<f64> {
        let mean = self.sums[k] / self.loaded_frames as f64;
        (self.loaded_frames > 0 && !mean.is_nan()).then_some(mean)
    }

    /// The mean over the loaded frames of the mean reading of the loaded taxels.
    pub fn mean(&self) -> Option<f64> {
        self.mean_of(0)
    }

    /// The mean force of the loaded frames, in N.
    pub fn force_mean(&self) -> Option<f64> {
        self.mean_of(1)
    }

    /// The mean contact area of the loaded frames, in m^2.
    pub fn contact_area_mean(&self) -> Option<f64> {
        self.mean_of(2)
    }

    /// The mean speed of the centre of pressure along its path, in m/s.
    pub fn speed_mean(&self) -> Option<f64> {
        self.path.filter(|_| self.path_time > 0.0).map(|path| path / self.path_time)
    }
}
