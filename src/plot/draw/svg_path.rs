use std::fmt::Write;

use glam::DVec2;

/// Path data of SVG: points rounded to a tenth of a pixel and written relative to the last, which is short and does
/// not drift.
#[derive(Debug, Clone, Default)]
pub(crate) struct PathData {
    text: String,
    at: [i64; 2],
}

impl PathData {
    /// Starts a subpath.
    pub(crate) fn move_to(&mut self, p: DVec2) {
        let to = tenths(p);
        self.put('M', to);
        self.at = to;
    }

    /// A straight line, unless it is shorter than the rounding.
    pub(crate) fn line_to(&mut self, p: DVec2) {
        let to = tenths(p);
        if to != self.at {
            self.put('l', [to[0] - self.at[0], to[1] - self.at[1]]);
            self.at = to;
        }
    }

    /// A closed polygon.
    pub(crate) fn polygon(&mut self, points: impl IntoIterator<Item = DVec2>) {
        let mut points = points.into_iter();
        let Some(first) = points.next() else { return };
        self.move_to(first);
        points.for_each(|p| self.line_to(p));
        self.text.push('z');
        // Closing moves back to the start.
        self.at = tenths(first);
    }

    /// A rectangle of whole pixels, one pixel high.
    pub(crate) fn run(&mut self, corner: DVec2, columns: usize) {
        self.move_to(corner);
        // Writing to a string cannot fail.
        let _ = write!(self.text, "h{columns}v1h-{columns}z");
    }

    /// The text of the attribute `d`.
    pub(crate) fn into_text(self) -> String {
        self.text
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.text.is_empty()
    }

    fn put(&mut self, command: char, [x, y]: [i64; 2]) {
        self.text.push(command);
        self.number(x);
        // A minus sign separates as well as a blank.
        if y >= 0 {
            self.text.push(' ');
        }
        self.number(y);
    }

    fn number(&mut self, tenths: i64) {
        let sign = if tenths < 0 { "-" } else { "" };
        let (whole, rest) = (tenths.unsigned_abs() / 10, tenths.unsigned_abs() % 10);
        let _ = match (whole, rest) {
            (_, 0) => write!(self.text, "{sign}{whole}"),
            (0, _) => write!(self.text, "{sign}.{rest}"),
            _ => write!(self.text, "{sign}{whole}.{rest}"),
        };
    }
}

fn tenths(p: DVec2) -> [i64; 2] {
    #[expect(clippy::cast_possible_truncation, reason = "`as` saturates; pictures are far smaller")]
    let round = |x: f64| (10.0 * x).round() as i64;
    [round(p.x), round(p.y)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_does_not_add_up() {
        let mut path = PathData::default();
        path.polygon((0..=100).map(|k| DVec2::new(0.14 * f64::from(k), -0.05)));
        let text = path.into_text();
        let x: f64 = text
            .trim_start_matches("M0-.1")
            .trim_end_matches('z')
            .split('l')
            .filter_map(|s| s.split([' ', '-']).next()?.parse::<f64>().ok())
            .sum();
        assert!((x - 14.0).abs() < 1e-9, "100 steps of 0.14 end at 14, not at {x}: {text}");
    }

    #[test]
    fn numbers_are_short() {
        let mut path = PathData::default();
        path.move_to(DVec2::new(12.0, 3.26));
        path.line_to(DVec2::new(11.5, 2.8));
        path.line_to(DVec2::new(11.51, 2.81));
        assert_eq!(path.into_text(), "M12 3.3l-.5-.5", "no zeros before the point, no steps of nothing");
    }
}
