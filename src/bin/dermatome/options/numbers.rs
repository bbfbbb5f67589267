//! Numbers within a range.

/// A number within a range that `wanted` describes.
pub(super) fn number(text: &str, wanted: &str, ok: impl Fn(f64) -> bool) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && ok(x) => Ok(x),
        _ => Err(format!("needed: {wanted}")),
    }
}

pub(crate) fn length_mm(text: &str) -> Result<f64, String> {
    number(text, "a length in mm above 0", |x| x > 0.0)
}
