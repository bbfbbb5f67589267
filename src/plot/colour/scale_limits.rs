//! Ends of the colour scales of a picture, which all of its panels share.

use crate::{
    atlas::face_stretch,
    map::MapLevel,
    plot::{Paint, PlotError, patch_view::PatchView},
};

#[derive(Debug, Clone, Copy)]
pub(crate) struct ScaleLimits {
    /// Largest `s1/s2` shown.
    pub(crate) angle: f64,
    /// Largest area ratio shown; its inverse is the smallest.
    pub(crate) area: f64,
    /// Smallest and largest standard deviation shown, in m.
    pub(crate) sigma: [f64; 2],
}

impl ScaleLimits {
    /// What all but a hundredth of the triangles of the levels stay below, rounded; of the taxels'
    /// standard deviations, if they are shown, all but a hundredth below and two above, rounded to
    /// two digits.
    pub(crate) fn new(
        levels: &[&MapLevel],
        patches: &[PatchView<'_>],
        paint: Paint,
    ) -> Result<Self, PlotError> {
        let stretches =
            || levels.iter().flat_map(|l| l.level.mesh.triangles.ids().map(|f| face_stretch(l, f)));
        let angle = share(stretches().map(|s| s.angle.abs() - 1.0).collect(), 99);
        let area = share(stretches().map(|s| s.area.abs().ln().abs()).collect(), 99);
        Ok(Self {
            angle: 1.0 + round_up(angle.clamp(0.02, 100.0)),
            area: 1.0 + round_up(area.clamp(0.02, 5.0).exp_m1()),
            sigma: if paint == Paint::Sigma { limits_of_sigma(patches)? } else { [0.0, 1.0] },
        })
    }
}

fn limits_of_sigma(patches: &[PatchView<'_>]) -> Result<[f64; 2], PlotError> {
    let mut sigmas = Vec::new();
    for patch in patches {
        sigmas.extend(patch.sigmas()?);
    }
    // The scale of exactly known positions is a nanometre wide.
    let most = share(sigmas.clone(), 98).max(1e-9);
    let least = share(sigmas, 1).min(most);
    let digit = 10_f64.powf(most.log10().floor() - 1.0);
    let [low, high] = [(least / digit).floor() * digit, (most / digit).ceil() * digit];
    Ok([low, high.max(low + digit)])
}

/// The value that this percentage of the values stays below; 0 without values.
fn share(values: Vec<f64>, percent: usize) -> f64 {
    let mut values: Vec<f64> = values.into_iter().filter(|x| x.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() * percent / 100).map_or(0.0, |x| *x)
}

/// The smallest of 1, 2, 5 and 10 times a power of ten that is not below a positive `x`.
fn round_up(x: f64) -> f64 {
    let power = 10_f64.powf(x.log10().floor());
    let digit = [1.0, 2.0, 5.0].into_iter().find(|d| d * power >= x).unwrap_or(10.0);
    digit * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_numbers_are_not_below() {
        assert_eq!([0.37, 5.0, 99.0].map(round_up), [0.5, 5.0, 100.0]);
    }
}
