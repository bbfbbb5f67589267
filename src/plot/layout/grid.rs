use glam::DVec2;
use svg::node::element::{Definitions, Group, LinearGradient, Rectangle, Stop, Text};

use crate::plot::{
    Paint, PlotError,
    colour::scale_limits::Range,
    colour::scales::{DIVERGING, ORDER, SEQUENTIAL, Scale},
    draw::panel::Panel,
    draw::view::View,
};

/// Largest width or height of a picture, in pixels.
pub(crate) const MAX_SIDE: u32 = 16_384;

/// Least width of a picture, in pixels: the letters still fit.
const MIN_WIDTH: u32 = 200;

/// Least width of a panel, in pixels: at six pixels high, a word of its caption still fits.
const MIN_COLUMN: f64 = 40.0;

/// Largest share of the width that is left between panels, and its part between two of few.
const MARGINS: f64 = 0.15;
const MARGIN: f64 = 0.015;

/// Letters are so high that lines this many times as wide fill a panel: the longest line of a caption, as a rule.
const CAPTION_EMS: f64 = 25.0;

/// Least height of letters, in pixels: smaller ones are not legible.
const MIN_LETTERS: f64 = 6.0;

/// From one line of a caption to the next, over the height of the letters: they are 1.13 from their tops to their tails.
const LINE_PITCH: f64 = 1.15;

/// Height of the letters over the width of the picture where few panels leave room for more.
const LARGEST_LETTERS: f64 = 0.016;

/// A panel is at most this much higher than the picture is wide: a finger is longer than a screen.
const TALLEST: f64 = 0.8;

/// The panels of a patch; a level that it lacks leaves its place empty.
pub(crate) type Row<'a> = Vec<Option<Panel<'a>>>;

/// Where everything stands: a row per patch, a column per level, one scale.
pub(crate) struct Layout {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Height of the letters.
    pub(crate) em: f64,
    margin: f64,
    column: f64,
    scale: f64,
    rows: Vec<RowPlace>,
}

/// Where a row of panels stands, in pixels.
struct RowPlace {
    /// Upper edge of its maps; the captions stand above.
    top: f64,
    /// Height of its maps.
    height: f64,
    /// Lines of its longest caption.
    lines: usize,
}

impl Layout {
    pub(crate) fn new(rows: &[Row<'_>], width: u32) -> Result<Self, PlotError> {
        let panels = rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
        let columns = panels as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
        let least = (columns * MIN_COLUMN / (1.0 - MARGINS)).ceil() as u32;
        let least = least.max(MIN_WIDTH);
        if !(least..=MAX_SIDE).contains(&width) {
            return Err(PlotError::Width { width, panels, least, most: MAX_SIDE });
        }
        let total = f64::from(width);
        let margin = (total * MARGIN.min(MARGINS / (columns + 1.0))).floor();
        let column = (total - margin * (columns + 1.0)) / columns;
        let em = (column / CAPTION_EMS).min(LARGEST_LETTERS * total).round().max(MIN_LETTERS);
        let extents: Vec<DVec2> = rows.iter().map(row_extent).collect();
        let fit = |e: &DVec2| (column / e.x).min(TALLEST * total / e.y);
        let scale = extents.iter().map(fit).fold(f64::INFINITY, f64::min);
        let mut y = margin;
        let mut places = Vec::new();
        let room = caption_room(column, margin, em);
        for (row, extent) in rows.iter().zip(&extents) {
            let lines =
                row.iter().flatten().map(|panel| panel.caption().lines(room).len()).max().unwrap_or(0);
            y += (0.75 * em).round() + pitch(em) * lines as f64;
            let height = (extent.y * scale).ceil();
            places.push(RowPlace { top: y, height, lines });
            y += height + margin;
        }
        let height = y + (2.6 * em).round() + margin;
        if height > f64::from(MAX_SIDE) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
            let height = height as u32;
            return Err(PlotError::Size { width, height, least: MIN_WIDTH, most: MAX_SIDE });
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MAX_SIDE")]
        let height = height as u32;
        Ok(Self { width, height, em, margin, column, scale, rows: places })
    }

    /// The panels row by row, each in the middle of its place.
    pub(crate) fn views<'r, 'a>(&self, rows: &'r [Row<'a>]) -> Vec<(&'r Panel<'a>, View)> {
        let mut views = Vec::new();
        for (row, &RowPlace { top, height, .. }) in rows.iter().zip(&self.rows) {
            for (column, panel) in row.iter().enumerate() {
                let Some(panel) = panel else { continue };
                let (lo, hi) = panel.bounds;
                let size = ((hi - lo) * self.scale).ceil().max(DVec2::ONE);
                let left = self.margin + column as f64 * (self.column + self.margin);
                let corner =
                    DVec2::new(left + 0.5 * (self.column - size.x), top + 0.5 * (height - size.y)).round();
                views.push((panel, View { scale: self.scale, corner, origin: DVec2::new(lo.x, hi.y), size }));
            }
        }
        views
    }

    /// What a panel is and how faithful, above it.
    pub(crate) fn caption(&self, panel: &Panel<'_>, view: &View) -> Group {
        let x = view.corner.x + 0.5 * view.size.x;
        let row = self.rows.iter().rev().find(|row| row.top <= view.corner.y + 1.0);
        let (top, lines) = row.map_or((self.margin, 1), |row| (row.top, row.lines));
        let mut y = top - (0.8 * self.em).round() - pitch(self.em) * lines as f64;
        let mut group = Group::new().set("text-anchor", "middle").set("fill", "#222");
        for (k, text) in
            panel.caption().lines(caption_room(self.column, self.margin, self.em)).into_iter().enumerate()
        {
            y += pitch(self.em);
            let line = Text::new(text).set("x", x).set("y", y);
            let is_name = k == 0;
            group = group.add(if is_name {
                line.set("stroke", "#222").set("stroke-width", 0.03 * self.em)
            } else {
                line
            });
        }
        group
    }

    /// A bar of a round length, at the lower left.
    pub(crate) fn scale_bar(&self) -> Group {
        let metres = round_down(0.4 * self.column / self.scale);
        let (x, y) = (self.margin, self.foot());
        let bar = |x: f64, y: f64, w: f64, h: f64| {
            Rectangle::new().set("x", x).set("y", y).set("width", w).set("height", h).set("fill", "#222")
        };
        let length = metres * self.scale;
        let label = format!("{} mm", short(1e3 * metres));
        Group::new()
            .add(bar(x, y - 2.0, length, 4.0))
            .add(bar(x, y - 7.0, 2.0, 14.0))
            .add(bar(x + length - 2.0, y - 7.0, 2.0, 14.0))
            .add(
                Text::new(label)
                    .set("x", x + length + 0.6 * self.em)
                    .set("y", y + 0.35 * self.em)
                    .set("fill", "#222"),
            )
    }

    /// Middle of the last line.
    fn foot(&self) -> f64 {
        (f64::from(self.height) - self.margin - 1.3 * self.em).round()
    }

    /// What the colours mean, at the lower right.
    pub(crate) fn legend(&self, paint: Paint, range: &Range) -> Option<(Definitions, Group)> {
        let (scale, name, labels): (Scale, _, [String; 3]) = match paint {
            Paint::Fields => return None,
            Paint::Angle => {
                let middle = 0.5 * (1.0 + range.angle);
                (SEQUENTIAL, "s1/s2", ["1".into(), short(middle), format!("≥ {}", short(range.angle))])
            }
            Paint::Area => {
                let low = format!("≤ {}", short(1.0 / range.area));
                (DIVERGING, "area ratio", [low, "1".into(), format!("≥ {}", short(range.area))])
            }
            Paint::Sigma => {
                let [low, high] = range.sigma.map(|s| 1e3 * s);
                let labels =
                    [format!("≤ {}", short(low)), short(0.5 * (low + high)), format!("≥ {}", short(high))];
                (SEQUENTIAL, "sigma, mm", labels)
            }
            Paint::Taxel => (ORDER, "taxel id", ["lowest".into(), String::new(), "highest".into()]),
        };
        let stop = |k: i32| {
            let t = f64::from(k) / 16.0;
            Stop::new().set("offset", t).set("stop-color", scale.at(t).hex())
        };
        let gradient = (0..=16).fold(LinearGradient::new().set("id", "scale"), |g, k| g.add(stop(k)));
        let width = 11.0 * self.em;
        let (x, y) =
            (f64::from(self.width) - self.margin - width - 2.0 * self.em, self.foot() - 0.9 * self.em);
        let text = |text: &str, x: f64, y: f64| Text::new(text).set("x", x).set("y", y);
        let bar = Rectangle::new()
            .set("x", x)
            .set("y", y)
            .set("width", width)
            .set("height", 0.8 * self.em)
            .set("fill", "url(#scale)")
            .set("stroke", "#222")
            .set("stroke-width", 0.8);
        let below = y + 2.0 * self.em;
        let group = Group::new()
            .set("fill", "#222")
            .set("text-anchor", "middle")
            .add(bar)
            .add(text(name, x - 0.6 * self.em, y + 0.7 * self.em).set("text-anchor", "end"))
            .add(text(&labels[0], x, below))
            .add(text(&labels[1], x + 0.5 * width, below))
            .add(text(&labels[2], x + width, below));
        Some((Definitions::new().add(gradient), group))
    }
}

/// From one line of a caption to the next, in whole pixels.
fn pitch(em: f64) -> f64 {
    (LINE_PITCH * em).ceil()
}

/// How wide a caption may be, over the height of its letters: half the space between panels is left.
fn caption_room(column: f64, margin: f64, em: f64) -> f64 {
    (column + 0.5 * margin) / em
}

/// Width and height that hold each panel of a row, in m.
fn row_extent(row: &Row<'_>) -> DVec2 {
    let extent = |panel: &Panel<'_>| panel.bounds.1 - panel.bounds.0;
    let extent = row.iter().flatten().map(extent).fold(DVec2::ZERO, DVec2::max);
    // A point and a line, too, have a place on the picture.
    let least = if extent == DVec2::ZERO { 1e-6 } else { 1e-6 * extent.max_element() };
    extent.max(DVec2::splat(least))
}

/// XML has no control characters, not even escaped.
pub(crate) fn printable(name: &str) -> String {
    let is_drawn = |c: char| {
        // What turns the direction of writing would turn the rest of the caption, too.
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

/// No panel has room for more.
const LONGEST_NAME: usize = 60;

/// The largest of 1, 2 and 5 times a power of ten that is not above a positive `x`.
fn round_down(x: f64) -> f64 {
    let power = 10_f64.powf(x.log10().floor());
    let digit = [5.0, 2.0, 1.0].into_iter().find(|d| d * power <= x).unwrap_or(1.0);
    digit * power
}

/// Three significant digits, without zeros at the end.
fn short(x: f64) -> String {
    if x >= 1e5 || (x > 0.0 && x < 1e-3) {
        let text = format!("{x:.2e}");
        let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{power}", digits.trim_end_matches('0').trim_end_matches('.'));
    }
    let decimals = [100.0, 10.0, 1.0].into_iter().position(|limit| x >= limit).unwrap_or(3);
    let text = format!("{x:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use crate::plot::colour::scale_limits::round_up;

    use super::*;

    #[test]
    fn round_numbers() {
        assert_eq!([0.37, 5.0, 99.0].map(|x| short(round_down(x))), ["0.2", "5", "50"]);
        assert_eq!([0.37, 5.0, 99.0].map(|x| short(round_up(x))), ["0.5", "5", "100"]);
        assert_eq!([1.0, 1.05, 12.34, 123.4, 0.012].map(short), ["1", "1.05", "12.3", "123", "0.012"]);
        assert_eq!([5e-18, 1.234e-4, 2e7].map(short), ["5e-18", "1.23e-4", "2e7"]);
    }
}
