//! The scale bar and the legend of the colours.

use glam::DVec2;

use crate::plot::Paint;
use crate::plot::colour::{Colour, DIVERGING, INK, SEQUENTIAL, Scale, ScaleLimits, hatch};
use crate::plot::layout::caption::width;
use crate::plot::layout::{Layout, round_down, short};
use crate::plot::picture::{Anchor, Path, Pixels, Shape, Stroke};

/// Width of the legend of the colours with its name, in heights of letters.
const WIDTH_OF_COLOURS: f64 = 20.0;

/// Room for the length of the scale bar and its distances, in heights of letters.
const WIDTH_OF_LENGTH: f64 = 6.0;

/// The values at the ends and in the middle, times `factor`, with marks where there are values
/// beyond an end.
fn ends(limits: &ScaleLimits, factor: f64, middle: Option<&str>) -> [String; 3] {
    let ([low, high], [below, above]) = (limits.range.map(|x| factor * x), limits.marks());
    let middle = middle.map_or_else(|| short(0.5 * (low + high)), str::to_owned);
    [format!("{below}{}", short(low)), middle, format!("{above}{}", short(high))]
}

impl Layout {
    /// A bar of a round length, at the lower left.
    pub(crate) fn scale_bar(&self) -> Vec<Shape> {
        self.scale_bar_before(f64::INFINITY)
    }

    /// The same, with its text to the left of `end`, in pixels, if that is possible.
    pub(crate) fn scale_bar_before(&self, end: f64) -> Vec<Shape> {
        let room = (end - self.margin - WIDTH_OF_LENGTH * self.em).max(self.em);
        let metres = round_down((0.4 * self.column).min(room) / self.scale);
        let (at, length) = (DVec2::new(self.margin, self.foot()), metres * self.scale);
        let bar = |dx: f64, dy: f64, width: f64, height: f64| Shape::Path {
            path: Path::rectangle(at + DVec2::new(dx, dy), DVec2::new(width, height)),
            fill: Some(INK),
            stroke: None,
        };
        let beside = at + DVec2::new(length + 0.6 * self.em, 0.35 * self.em);
        let label = Shape::text(format!("{} mm", short(1e3 * metres)), beside, Anchor::Start);
        let end = bar(length - 2.0, -7.0, 2.0, 14.0);
        vec![bar(0.0, -2.0, length, 4.0), bar(0.0, -7.0, 2.0, 14.0), end, label]
    }

    /// The legend of hollow dots, at the lower right, to the left of the legend of the colours.
    pub(crate) fn legend_of_hollow_dots(&self, paint: Paint) -> Vec<Shape> {
        let colours =
            if matches!(paint, Paint::Fields | Paint::Regions) { 0.0 } else { WIDTH_OF_COLOURS * self.em };
        let at = DVec2::new(f64::from(self.width) - self.margin - colours - 0.4 * self.em, self.foot());
        let dot =
            Shape::Dots { centres: vec![at], radius: 0.25 * self.em, colour: Colour::WHITE, has_rim: true };
        let beside = at + DVec2::new(-0.6 * self.em, 0.35 * self.em);
        vec![dot, Shape::text("absent taxel or thermal pad", beside, Anchor::End)]
    }

    /// The legend of the colours, at the lower right; nothing for colours that only distinguish fields.
    pub(crate) fn legend(&self, paint: Paint, limits: &ScaleLimits) -> Vec<Shape> {
        let (scale, name, labels): (Scale, _, [String; 3]) = match paint {
            Paint::Fields | Paint::Regions => return Vec::new(),
            Paint::Angle => (SEQUENTIAL, "s1/s2", ends(limits, 1.0, None)),
            Paint::Area => (DIVERGING, "area on map / on skin", ends(limits, 1.0, Some("1"))),
            Paint::Sigma => (SEQUENTIAL, "sigma, mm", ends(limits, 1e3, None)),
        };
        self.colour_bar(scale, name, &labels)
    }

    /// A scale of colours at the lower right, with its name and the values at its ends and middle.
    pub(crate) fn colour_bar(&self, scale: Scale, name: &str, labels: &[String; 3]) -> Vec<Shape> {
        let (corner, size) = self.bar();
        let text =
            |text: &str, dx: f64, dy: f64, anchor| Shape::text(text, corner + DVec2::new(dx, dy), anchor);
        let colours = (0..=16).map(|k| scale.at(f64::from(k) / 16.0)).collect();
        let name = text(name, -0.6 * self.em, 0.7 * self.em, Anchor::End);
        let mut shapes = vec![Shape::Scale { corner, size, colours }, name];
        for (label, share) in labels.iter().zip([0.0, 0.5, 1.0]).filter(|(label, _)| !label.is_empty()) {
            shapes.push(text(label, share * size.x, 2.0 * self.em, Anchor::Middle));
        }
        shapes
    }

    /// A text on a white plate.
    pub(crate) fn plate(&self, text: &str, middle: DVec2) -> Vec<Shape> {
        let size = self.em * DVec2::new(width(text) + 0.4, 1.2);
        let path = Path::rectangle(middle - 0.5 * size, size);
        let stroke = Some(Stroke { colour: INK, width: 0.8, opacity: 1.0 });
        let base = middle + DVec2::new(0.0, 0.35 * self.em);
        vec![Shape::Path { path, fill: Some(Colour::WHITE), stroke }, Shape::text(text, base, Anchor::Middle)]
    }

    /// Colours with their names, from the lower right on to the left, after a text; and where it begins, in pixels.
    pub(crate) fn legend_of_colours(&self, text: &str, names: &[(Colour, String)]) -> (Vec<Shape>, f64) {
        let base = self.foot() + 0.35 * self.em;
        let mut right = f64::from(self.width) - self.margin;
        let mut shapes = Vec::new();
        for (colour, name) in names.iter().rev() {
            let left = right - width(name) * self.em;
            shapes.push(Shape::text(name.as_str(), DVec2::new(left, base), Anchor::Start));
            let centres = vec![DVec2::new(left - 0.6 * self.em, self.foot())];
            shapes.push(Shape::Dots { centres, radius: 0.35 * self.em, colour: *colour, has_rim: true });
            right = left - 1.6 * self.em;
        }
        if !text.is_empty() {
            shapes.push(Shape::text(text, DVec2::new(right, base), Anchor::End));
        }
        (shapes, right - width(text) * self.em)
    }

    /// Corner and size of the scale of colours.
    fn bar(&self) -> (DVec2, DVec2) {
        let size = self.em * DVec2::new(11.0, 0.8);
        let right = f64::from(self.width) - self.margin - 2.0 * self.em;
        (DVec2::new(right - size.x, self.foot() - 0.9 * self.em), size)
    }

    /// The legend of the hatch, to the left of a colour bar of this name.
    pub(crate) fn hatch_key(&self, name: &str) -> Vec<Shape> {
        const MEANING: &str = "no reading";
        let (corner, size) = self.bar();
        let right = corner.x - (1.6 + width(name)) * self.em;
        let size = DVec2::new(1.6 * self.em, size.y);
        let left = right - width(MEANING) * self.em - 0.4 * self.em - size.x;
        #[expect(clippy::cast_possible_truncation, reason = "a few letters wide")]
        let [columns, rows] = size.to_array().map(|x| (2.0 * x).round().max(1.0) as usize);
        let colours = (0..columns * rows).map(|k| hatch(k % columns + k / columns)).collect();
        let corner = DVec2::new(left.round(), corner.y.round());
        let text_at = DVec2::new(left + size.x + 0.4 * self.em, corner.y + 0.7 * self.em);
        vec![
            Shape::Image { corner, size, pixels: Pixels { size: [columns, rows], colours } },
            Shape::text(MEANING, text_at, Anchor::Start),
        ]
    }
}
