//! How readings become pressures, as recordings show: passes them to the estimators of [`response`](crate::response).

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use crate::Error;
use crate::map::SkinMap;
use crate::recording::{Recording, same_unit};
use crate::response::{
    GainEstimator, GainReport, ResponseError, ScaleEstimator, ScaleReport, StepEstimator, StepReport,
};
use crate::run::Run;
use crate::signal::{ChannelKind, Frame, Response, Scale, SignalError, TaxelResponse, TaxelState};
use crate::skin::TaxelId;

/// What readings are compared with.
#[derive(Debug, Clone, Copy)]
pub enum Reference<'a> {
    /// Each other, in ordinary touches: relative gains.
    Touches,
    /// A pressure that is the same everywhere: rows of the time in s at which a step begins, and its pressure in Pa.
    Pressure(&'a [[f64; 2]]),
    /// Forces on the whole skin: rows of a time in s and a force in N; and the relative gains of which they are the scale.
    Force(&'a [[f64; 2]], &'a Response),
}

/// How a response was estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ResponseReport {
    /// By [`Reference::Touches`].
    Touches(GainReport),
    /// By [`Reference::Pressure`].
    Pressure(StepReport),
    /// By [`Reference::Force`].
    Force(ScaleReport),
}

/// What comes next of recordings that are gone through.
enum Next<'a> {
    Frame(&'a Frame),
    /// An episode, after which the same recording has another one.
    EpisodeEnds,
    RecordingEnds,
}

impl<'a> Next<'a> {
    fn into_frame(self) -> Option<&'a Frame> {
        if let Self::Frame(frame) = self { Some(frame) } else { None }
    }
}

/// Estimates the response of the taxels of a map by recordings.
///
/// `open` opens a recording, by its number; with the response, if there is one, that turns its readings into relative
/// pressures. `ended` sees each recording after its last frame. The first channel counts that measures touches and is not
/// tangential.
///
/// # Errors
/// Those of `open` and of reading; [`ResponseError`] if the recordings do not determine the response;
/// [`SignalError::NoTouch`] if no channel measures touches.
pub fn respond<E: From<Error>>(
    map: &Arc<SkinMap>,
    reference: Reference<'_>,
    recordings: usize,
    mut open: impl FnMut(usize, Option<&Response>) -> Result<Recording, E>,
    mut ended: impl FnMut(&Recording),
    run: Run<'_>,
) -> Result<(Response, ResponseReport), E> {
    let skin = map.skin();
    let fail = |error: ResponseError| E::from(Error::from(error));
    let (mut unit, mut zeros) = (None::<String>, Vec::new());
    // The channel that counts, if it has one name in all recordings.
    let mut channel = None::<String>;
    // The channel that counts, of frames with several.
    let mut one = Frame::new(map, 1);
    let shared = shared_id(map);
    // Passes all frames on, and what ends. Returns how many episodes there were.
    let mut each = |response: Option<&Response>, see: &mut dyn FnMut(Next<'_>)| -> Result<u64, E> {
        let mut episodes = 0;
        for number in 0..recordings {
            let mut recording = open(number, response)?;
            if let Some(taxel) = shared.filter(|_| !recording.has_ids()) {
                return Err(Error::from(SignalError::SharedIds { taxel })
                    .in_recording(number, recordings)
                    .into());
            }
            let channels = recording.channels();
            let Some(main) = channels.iter().position(|channel| channel.kind == ChannelKind::Touch) else {
                let known = channels.iter().map(|channel| channel.name.clone()).collect();
                return Err(Error::from(SignalError::NoTouch { known })
                    .in_recording(number, recordings)
                    .into());
            };
            same_unit(&mut unit, number, &channels[main])?;
            let name = &channels[main].name;
            let is_same = channel.as_ref().is_none_or(|known| known == name);
            channel = Some(if is_same { name.clone() } else { String::new() });
            let is_alone = channels.len() == 1;
            episodes += recording.each_frame(|frame| match frame {
                None => see(Next::EpisodeEnds),
                Some(frame) if is_alone => see(Next::Frame(frame)),
                Some(frame) => {
                    one.time = frame.time;
                    for (to, from) in one.values.iter_mut().zip(&frame.values) {
                        to[0].as_mut_slice().copy_from_slice(from[main].as_slice());
                    }
                    see(Next::Frame(&one));
                }
            })?;
            see(Next::RecordingEnds);
            zeros = recording.zeros();
            ended(&recording);
        }
        Ok(episodes)
    };
    match reference {
        Reference::Touches => {
            let mut estimator = GainEstimator::new(&skin).map_err(fail)?;
            each(None, &mut |next| match next {
                Next::Frame(frame) => estimator.see(frame),
                Next::EpisodeEnds => estimator.end_episode(),
                Next::RecordingEnds => estimator.end_recording(),
            })?;
            let (gains, report) = estimator.solve(run).map_err(fail)?;
            let known = gains.iter().flatten().map(|taxel| {
                let sigma = if taxel.presses > 0 { taxel.sigma } else { f64::NAN };
                ([taxel.gain, f64::NAN, sigma], TaxelState::Untested)
            });
            let method = format!("{} touches", report.presses);
            let response = Response {
                method,
                channel: channel.unwrap_or_default(),
                ..made(map, unit, &zeros, Scale::Relative, known)
            };
            Ok((response, ResponseReport::Touches(report)))
        }
        Reference::Pressure(rows) => {
            let several = |found: usize| fail(ResponseError::StepRecordings { found });
            if recordings != 1 {
                return Err(several(recordings));
            }
            let mut estimator = StepEstimator::new(&skin, rows).map_err(fail)?;
            let episodes =
                each(None, &mut |next| next.into_frame().into_iter().for_each(|frame| estimator.see(frame)))?;
            if episodes > 1 {
                return Err(several(usize::try_from(episodes).unwrap_or(usize::MAX)));
            }
            let (curves, report) = estimator.solve().map_err(fail)?;
            let known = curves.iter().flatten().map(|curve| {
                let state = if curve.is_dead { TaxelState::Dead } else { TaxelState::Untested };
                ([curve.gain, curve.exponent, curve.sigma], state)
            });
            let method = format!("{} steps of pressure", report.steps);
            let response = Response {
                method,
                channel: channel.unwrap_or_default(),
                ..made(map, unit, &zeros, Scale::Pascals, known)
            };
            Ok((response, ResponseReport::Pressure(report)))
        }
        Reference::Force(rows, relative) => {
            if relative.scale != Some(Scale::Relative) {
                return Err(fail(ResponseError::NotRelative));
            }
            let has_exponents = relative.taxels.iter().any(|taxel| taxel.exponent.is_some());
            let estimator = ScaleEstimator::new(&skin, !has_exponents, rows.to_vec());
            let mut estimator = estimator.map_err(fail)?;
            each(Some(relative), &mut |next| {
                next.into_frame().into_iter().for_each(|frame| estimator.see(frame))
            })?;
            let report = estimator.solve().map_err(fail)?;
            Ok((scaled(relative, &report), ResponseReport::Force(report)))
        }
    }
}

/// The first taxel id that several taxels of a map have.
fn shared_id(map: &SkinMap) -> Option<TaxelId> {
    let mut seen = HashSet::new();
    map.patches.iter().flat_map(|patch| patch.taxels.ids.iter().copied()).find(|id| !seen.insert(*id))
}

/// Sums and counts of zero, gain, exponent and sigma.
type Sums = [(f64, f64); 4];

/// A response of gains, exponents and sigmas in the order of the taxels; NaN is not known. Each has the state that it is in
/// if its gain is not known. Taxels of one id, which have the same readings, have the mean of what is known of each.
fn made(
    map: &SkinMap,
    unit: Option<String>,
    zeros: &[f64],
    scale: Scale,
    known: impl Iterator<Item = ([f64; 3], TaxelState)>,
) -> Response {
    let ids = map.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
    let zeros = zeros.iter().copied().chain(std::iter::repeat(f64::NAN));
    let mut places: HashMap<TaxelId, usize> = HashMap::new();
    let mut all: Vec<(TaxelId, Sums, TaxelState)> = Vec::new();
    for ((&id, ([gain, exponent, sigma], state)), zero) in ids.zip(known).zip(zeros) {
        let place = *places.entry(id).or_insert_with(|| {
            all.push((id, [(0.0, 0.0); 4], state));
            all.len() - 1
        });
        for ((sum, count), x) in all[place].1.iter_mut().zip([zero, gain, exponent, sigma]) {
            if x.is_finite() {
                (*sum, *count) = (*sum + x, *count + 1.0);
            }
        }
    }
    let taxel = |(id, sums, state): (TaxelId, Sums, TaxelState)| {
        let [zero, gain, exponent, sigma] =
            sums.map(|(sum, count)| Some(sum / count).filter(|mean| mean.is_finite()));
        let state = if gain.is_none() { state } else { TaxelState::Ok };
        TaxelResponse { zero, gain, exponent, sigma, state, ..TaxelResponse::unknown(id) }
    };
    Response {
        unit: unit.unwrap_or_default(),
        scale: Some(scale),
        taxels: all.into_iter().map(taxel).collect(),
        ..Response::default()
    }
}

/// Relative gains with their scale.
fn scaled(relative: &Response, report: &ScaleReport) -> Response {
    let exponent = Some(report.exponent).filter(|exponent| !exponent.is_nan());
    let power = exponent.unwrap_or(1.0);
    // The gain is a power of the relative one, and so its relative error is that many times larger.
    let scaled = |taxel: &TaxelResponse| TaxelResponse {
        gain: taxel.gain.map(|gain| report.scale * gain.abs().powf(power) * gain.signum()),
        sigma: taxel.sigma.map(|sigma| (power * sigma).hypot(report.sigma)),
        exponent: exponent.or(taxel.exponent),
        ..*taxel
    };
    Response {
        scale: Some(Scale::Pascals),
        method: format!("{}; {} known forces", relative.method, report.touches),
        taxels: relative.taxels.iter().map(scaled).collect(),
        unit: relative.unit.clone(),
        channel: relative.channel.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gain to the power of p has p times the relative error.
    #[test]
    fn the_sigma_of_a_scaled_gain_takes_its_exponent() {
        for exponent in [0.5, 1.0, 2.0] {
            let taxel =
                TaxelResponse { gain: Some(2.0), sigma: Some(0.1), ..TaxelResponse::unknown(TaxelId(1)) };
            let relative = Response { taxels: vec![taxel], ..Response::default() };
            let report = ScaleReport { scale: 3.0, exponent, sigma: 0.0, touches: 20 };
            let found = scaled(&relative, &report).taxels[0];
            assert_eq!(found.gain, Some(3.0 * 2.0_f64.powf(exponent)));
            assert!((found.sigma.unwrap() - 0.1 * exponent).abs() < 1e-12, "{found:?}");
        }
    }
}
