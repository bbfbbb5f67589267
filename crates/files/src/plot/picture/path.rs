//! Straight lines, rounded to tenths of a pixel, both in SVG and in PNG.

use std::fmt::Write;

use glam::DVec2;

/// Lines and polygons; steps shorter than a tenth of a pixel are left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Path {
    pieces: Vec<Piece>,
}

#[derive(Debug, Clone, PartialEq)]
struct Piece {
    /// In tenths of a pixel.
    points: Vec<[i32; 2]>,
    is_closed: bool,
}

impl Path {
    pub(crate) fn move_to(&mut self, p: DVec2) {
        self.pieces.push(Piece { points: vec![tenths(p)], is_closed: false });
    }

    /// Continues the line that was started last.
    pub(crate) fn line_to(&mut self, p: DVec2) {
        let Some(piece) = self.pieces.last_mut() else { return self.move_to(p) };
        let to = tenths(p);
        if piece.points.last() != Some(&to) {
            piece.points.push(to);
        }
    }

    pub(crate) fn polygon(&mut self, points: impl IntoIterator<Item = DVec2>) {
        let mut points = points.into_iter();
        let Some(first) = points.next() else { return };
        self.move_to(first);
        points.for_each(|p| self.line_to(p));
        self.pieces.last_mut().into_iter().for_each(|piece| piece.is_closed = true);
    }

    pub(crate) fn rectangle(corner: DVec2, size: DVec2) -> Self {
        let [right, down] = [size.with_y(0.0), size.with_x(0.0)];
        let mut path = Self::default();
        path.polygon([corner, corner + right, corner + size, corner + down]);
        path
    }

    /// Each line's points, in pixels, and whether it is closed.
    pub(crate) fn pieces(&self) -> impl Iterator<Item = (impl Iterator<Item = DVec2>, bool)> {
        let pixels = |&[x, y]: &[i32; 2]| DVec2::new(f64::from(x), f64::from(y)) / 10.0;
        self.pieces.iter().map(move |piece| (piece.points.iter().map(pixels), piece.is_closed))
    }

    /// The attribute `d` of an SVG path: each point relative to the last, which gives short text.
    pub(crate) fn to_svg(&self) -> String {
        let mut text = String::new();
        for Piece { points, is_closed } in &self.pieces {
            let mut last = [0; 2];
            for (k, &point) in points.iter().enumerate() {
                text.push(if k == 0 { 'M' } else { 'l' });
                let [x, y] = [0, 1].map(|i| decimal(point[i].saturating_sub(last[i])));
                // A minus sign separates as well as a blank.
                let blank = if y.starts_with('-') { "" } else { " " };
                // Writing to a string cannot fail.
                let _ = write!(text, "{x}{blank}{y}");
                last = point;
            }
            text.push_str(if *is_closed { "z" } else { "" });
        }
        text
    }
}

/// Tenths as a decimal number without superfluous zeros.
fn decimal(tenths: i32) -> String {
    let sign = if tenths < 0 { "-" } else { "" };
    match (tenths.unsigned_abs() / 10, tenths.unsigned_abs() % 10) {
        (whole, 0) => format!("{sign}{whole}"),
        (0, rest) => format!("{sign}.{rest}"),
        (whole, rest) => format!("{sign}{whole}.{rest}"),
    }
}

fn tenths(p: DVec2) -> [i32; 2] {
    #[expect(clippy::cast_possible_truncation, reason = "`as` saturates; pictures are far smaller")]
    let round = |x: f64| (10.0 * x).round() as i32;
    [round(p.x), round(p.y)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_does_not_add_up() {
        let mut path = Path::default();
        path.polygon((0..=100).map(|k| DVec2::new(0.14 * f64::from(k), -0.05)));
        let text = path.to_svg();
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
        let mut path = Path::default();
        path.move_to(DVec2::new(12.0, 3.26));
        path.line_to(DVec2::new(11.5, 2.8));
        path.line_to(DVec2::new(11.51, 2.81));
        assert_eq!(path.to_svg(), "M12 3.3l-.5-.5", "no zeros before the point, no steps of nothing");
    }
}
