//! The layout of panels, captions, scale bar and legend on a picture, and the text of names and numbers.

mod caption;
mod grid;
mod legend;

pub(crate) use caption::Caption;
pub(crate) use grid::{Layout, Slot, View, lay_out, slots};

/// A name without characters that XML does not allow even escaped, cut to the length that fits a panel.
pub(crate) fn printable(name: &str) -> String {
    let is_drawn = |c: char| {
        // These would change the direction of writing of the rest of the caption.
        let turns = matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        !(c.is_control() || turns || matches!(c, '\u{fffe}' | '\u{ffff}'))
    };
    let mut short: String =
        name.chars().take(LONGEST_NAME).map(|c| if is_drawn(c) { c } else { '\u{fffd}' }).collect();
    if name.chars().nth(LONGEST_NAME).is_some() {
        short.push('\u{2026}');
    }
    short
}

/// Letters of the longest name that fits a panel.
const LONGEST_NAME: usize = 60;

/// A number with this many decimals, or as a power of ten if that would be long.
pub(crate) fn number(x: f64, decimals: usize) -> String {
    if x.abs() < 1e4 { format!("{x:.decimals$}") } else { format!("{x:.1e}") }
}

/// The largest of 1, 2 and 5 times a power of ten that is not above a positive `x`.
pub(crate) fn round_down(x: f64) -> f64 {
    let power = 10_f64.powf(x.log10().floor());
    let digit = [5.0, 2.0, 1.0].into_iter().find(|d| d * power <= x).unwrap_or(1.0);
    digit * power
}

/// Three significant digits, without zeros at the end.
pub(crate) fn short(x: f64) -> String {
    if x >= 1e5 || (x > 0.0 && x < 1e-3) {
        let text = format!("{x:.2e}");
        let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{power}", digits.trim_end_matches('0').trim_end_matches('.'));
    }
    let decimals = [100.0, 10.0, 1.0].into_iter().position(|limit| x >= limit).unwrap_or(3);
    let text = format!("{x:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A minus sign as wide as a digit before a negative number.
pub(crate) fn minus(x: f64) -> &'static str {
    if x < 0.0 { "\u{2212}" } else { "" }
}

/// [`short`] of any sign.
pub(crate) fn signed(x: f64) -> String {
    format!("{}{}", minus(x), short(x.abs()))
}

/// The values at both ends and in the middle of a range, over `factor`.
pub(crate) fn ticks([low, high]: [f64; 2], factor: f64) -> [String; 3] {
    // Zero in the middle of a symmetric range may be off by rounding.
    let exact = |x: f64| if x.abs() < 1e-12 * (high - low) { 0.0 } else { x / factor };
    [low, 0.5 * (low + high), high].map(|x| signed(exact(x)))
}
