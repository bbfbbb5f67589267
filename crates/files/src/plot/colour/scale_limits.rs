//! The ends of the colour scale of a picture, shared by all of its panels.

use crate::atlas::face_stretch;
use crate::map::MapLevel;
use crate::numeric::second_digit;
use crate::plot::patch_view::PatchView;
use crate::plot::{Paint, PlotError};

/// The range of a scale, and the range of the values.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ScaleLimits {
    /// At the ends of the scale: `s1/s2`; the area on the map over that on the skin, the low end the
    /// inverse of the high one; a standard deviation in m.
    pub(crate) range: [f64; 2],
    /// Smallest and largest value drawn.
    pub(crate) extremes: [f64; 2],
}

impl ScaleLimits {
    /// The requested range, or the range of all but a hundredth of the values: of the triangles
    /// of the levels, or of the taxels' standard deviations (two hundredths above). Ends are rounded
    /// outwards to two digits.
    /// Fails if the patches lack the data of the paint, or the range does not rise.
    pub(crate) fn new(
        levels: &[&MapLevel],
        patches: &[PatchView<'_>],
        paint: Paint,
        asked: Option<[f64; 2]>,
    ) -> Result<Self, PlotError> {
        if let Some(range @ [low, high]) = asked {
            let is_scale = matches!(paint, Paint::Angle | Paint::Area | Paint::Sigma);
            let is_ratio = paint == Paint::Area && (low <= 0.0 || low >= 1.0 || high <= 1.0);
            if !is_scale || is_ratio || !(low.is_finite() && high.is_finite() && low < high) {
                return Err(PlotError::Range { range });
            }
        }
        let stretches =
            || levels.iter().flat_map(|l| l.level.mesh.triangles.ids().map(|f| face_stretch(l, f)));
        let (values, range) = match paint {
            Paint::Fields => (Vec::new(), [0.0, 1.0]),
            Paint::Regions => {
                let mut taxels =
                    patches.iter().flat_map(|patch| patch.mesh.positions.ids().map(|v| patch.region(v)));
                taxels.find_map(|region| region).ok_or(PlotError::NoRegions)?;
                (Vec::new(), [0.0, 1.0])
            }
            Paint::Angle => {
                let values = sorted(stretches().map(|s| s.angle.abs()));
                let most = share(&values, 99).unwrap_or(1.0).clamp(1.01, 100.0);
                (values, [1.0, 1.0 + round_up(most - 1.0)])
            }
            Paint::Area => {
                let values = sorted(stretches().map(|s| s.area.abs()));
                let ratios = sorted(values.iter().map(|x| x.max(x.recip())));
                let most = 1.0 + round_up(share(&ratios, 99).unwrap_or(1.0).clamp(1.01, 100.0) - 1.0);
                (values, [most.recip(), most])
            }
            Paint::Sigma => {
                let mut sigmas = Vec::new();
                for patch in patches {
                    sigmas.extend(patch.sigmas()?.into_iter().filter(|sigma| !sigma.is_nan()));
                }
                let values = sorted(sigmas.into_iter());
                // The scale of exactly known positions is a nanometre wide.
                let most = share(&values, 98).unwrap_or(0.0).max(1e-9);
                let least = share(&values, 1).unwrap_or(0.0).min(most);
                let digit = second_digit(most);
                let [low, high] = [(least / digit).floor() * digit, (most / digit).ceil() * digit];
                (values, [low, high.max(low + digit)])
            }
        };
        let ends = [values.first(), values.last()].map(|x| x.copied().unwrap_or(f64::NAN));
        Ok(Self { range: asked.unwrap_or(range), extremes: ends })
    }

    /// The position of a value on the scale, 0 to 1; of a ratio on both sides of 1 by its logarithm.
    pub(crate) fn place(&self, paint: Paint, value: f64) -> f64 {
        let [low, high] = self.range;
        match paint {
            Paint::Area if value < 1.0 => 0.5 - 0.5 * value.ln() / low.ln(),
            Paint::Area => 0.5 + 0.5 * value.ln() / high.ln(),
            _ => (value - low) / (high - low),
        }
    }

    /// Signs before the labels of the ends, if there are values beyond them.
    pub(crate) fn marks(&self) -> [&'static str; 2] {
        let [low, high] = self.range;
        // Values beyond an end by rounding alone do not count.
        let slack = 1e-9 * (high - low);
        [
            if self.extremes[0] < low - slack { "≤ " } else { "" },
            if self.extremes[1] > high + slack { "≥ " } else { "" },
        ]
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The percentile of ascending values; `None` without values.
fn share(values: &[f64], percent: usize) -> Option<f64> {
    values.get(values.len() * percent / 100).copied()
}

/// The least number of two digits that is not below a positive `x`, up to rounding.
fn round_up(x: f64) -> f64 {
    let digit = second_digit(x);
    (x / digit - 1e-9).ceil() * digit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_rounded_up_are_not_below() {
        for (x, expected) in [(0.371, 0.38), (5.0, 5.0), (99.1, 100.0), (0.01, 0.01)] {
            assert!((round_up(x) - expected).abs() < 1e-12, "{} for {x}", round_up(x));
        }
    }
}
