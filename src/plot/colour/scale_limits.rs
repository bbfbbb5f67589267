use crate::{
    atlas::face_stretch,
    map::MapLevel,
    plot::{PlotError, patch_view::Subject},
};

/// Ends of the scales, common to all panels of a picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range {
    /// Largest `s1/s2` shown.
    pub(crate) angle: f64,
    /// Largest area ratio shown; its inverse is the smallest.
    pub(crate) area: f64,
    /// Smallest and largest standard deviation shown, in m.
    pub(crate) sigma: [f64; 2],
}

impl Range {
    /// What all but a hundredth of the triangles of the levels stay below, rounded.
    pub(crate) fn new(levels: &[&MapLevel]) -> Self {
        let stretches = || levels.iter().flat_map(|l| l.mesh.triangles.ids().map(|f| face_stretch(l, f)));
        let angle = share(stretches().map(|s| s.angle.abs() - 1.0).collect(), 99);
        let area = share(stretches().map(|s| s.area.abs().ln().abs()).collect(), 99);
        Self {
            angle: 1.0 + round_up(angle.clamp(0.02, 100.0)),
            area: 1.0 + round_up(area.clamp(0.02, 5.0).exp_m1()),
            sigma: [0.0, 1.0],
        }
    }

    /// The same with the range of the taxels' standard deviations, but for a hundredth below and two above, rounded to two
    /// digits.
    pub(crate) fn with_sigmas(self, subjects: &[Subject<'_>]) -> Result<Self, PlotError> {
        let mut sigmas = Vec::new();
        for subject in subjects {
            sigmas.extend(subject.sigmas()?);
        }
        // Exact knowledge, too, has a scale: a nanometre wide.
        let most = share(sigmas.clone(), 98).max(1e-9);
        let least = share(sigmas, 1).min(most);
        let digit = 10_f64.powf(most.log10().floor() - 1.0);
        let [low, high] = [(least / digit).floor() * digit, (most / digit).ceil() * digit];
        Ok(Self { sigma: [low, high.max(low + digit)], ..self })
    }
}

/// The value that so many of a hundred stay below; 0 without one.
fn share(values: Vec<f64>, percent: usize) -> f64 {
    let mut values: Vec<f64> = values.into_iter().filter(|x| x.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() * percent / 100).map_or(0.0, |x| *x)
}

/// The smallest of 1, 2, 5 and 10 times a power of ten that is not below a positive `x`.
pub(crate) fn round_up(x: f64) -> f64 {
    let power = 10_f64.powf(x.log10().floor());
    let digit = [1.0, 2.0, 5.0].into_iter().find(|d| d * power >= x).unwrap_or(10.0);
    digit * power
}
