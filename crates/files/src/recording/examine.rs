//! Which taxels can be trusted: recordings, passed as often as [`Health`] needs them.

use std::sync::Arc;

use crate::Error;
use crate::map::SkinMap;
use crate::recording::{Recording, same_unit};
#[cfg(doc)]
use crate::signal::Response;
use crate::signal::{Health, HealthOptions, HealthReport, SignalError, Zero};

/// The pressure of touches at which lines take the place of the curves of a response, where no threshold is given, in Pa: that
/// of a finger.
const USUAL_PRESSURE: f64 = 1e4;

/// Judges the taxels of a skin by recordings of ordinary touches.
///
/// Of a response with exponents lines take the place of curves ([`Response::linear_at`] the threshold): what a curve makes of
/// readings depends on their zeros, which the first pass does not have.
///
/// `open` opens a recording, by its number, with a zero; each of the `recordings` is opened [`Health::PASSES`] times,
/// so that memory does not depend on their length. The [channel](Recording::channel) without a name is judged.
///
/// ```
/// use std::sync::Arc;
///
/// use dermatome::io::{Readings, ReadingsReader};
/// use dermatome::map::SkinMap;
/// use dermatome::mesh::shapes;
/// use dermatome::recording::{Recording, RecordingOptions, examine};
/// use dermatome::signal::{Channel, ConditionOptions, HealthOptions};
///
/// let map = Arc::new(SkinMap::flat(shapes::lattice(6, 6, 0.004), 1e-3));
/// // Noise, but for one taxel, which always reads 7.
/// let value = |k: usize| if k % 36 == 20 { 7.0 } else { ((k * 7919) % 101) as f64 };
/// let readings = Readings {
///     channels: vec![Channel::default()],
///     width: 36,
///     times: (0..50).map(|k| 0.05 * f64::from(k)).collect(),
///     values: (0..50 * 36).map(value).collect(),
///     ..Readings::default()
/// };
/// let report = examine(&map, &HealthOptions::default(), 1, |_, zero| {
///     let condition = ConditionOptions { zero, ..ConditionOptions::default() };
///     let options = RecordingOptions { condition, ..RecordingOptions::default() };
///     Ok::<_, dermatome::Error>(Recording::open(&map, ReadingsReader::memory(readings.clone())?, &options)?)
/// })?;
/// assert_eq!(report.findings.len(), 1);
/// println!("{}", report.findings[0]);
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Errors
/// Those of `open` and of reading; [`SignalError::NoFrames`] if no recording has a frame, [`SignalError::NoTouch`] if no
/// channel measures touches, or the options are not usable.
pub fn examine<E: From<Error> + From<SignalError>>(
    map: &Arc<SkinMap>,
    options: &HealthOptions,
    recordings: usize,
    mut open: impl FnMut(usize, Zero) -> Result<Recording, E>,
) -> Result<HealthReport, E> {
    let mut health: Option<Health> = None;
    let mut unit = None;
    let pressure = options.threshold.filter(|x| x.is_finite() && *x > 0.0).unwrap_or(USUAL_PRESSURE);
    for _ in 0..Health::PASSES {
        for number in 0..recordings {
            let zero = health.as_ref().map_or(Zero::AS_READ, Health::zero);
            let mut recording = open(number, zero)?;
            recording.linearise(pressure)?;
            let channel = recording.touch_channel();
            let channel = channel.map_err(|error| Error::from(error).in_recording(number, recordings))?;
            same_unit(&mut unit, number, &recording.channels()[channel])?;
            let health = match &mut health {
                Some(health) => health,
                None => health.insert(Health::new(map, options)?),
            };
            health.begin_recording(channel, recording.has_readings());
            recording.each_frame(|frame| match frame {
                Some(frame) => health.see(frame),
                None => health.end_recording(),
            })?;
            health.end_recording();
        }
        health.iter_mut().for_each(Health::end_pass);
    }
    let report = health.map(|health| health.report());
    Ok(report.filter(|report| report.frames > 0).ok_or(SignalError::NoFrames)?)
}
