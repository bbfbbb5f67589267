//! A drawing in layers, in millimetres: what [`write_svg`](super::write_svg) and [`write_dxf`](super::write_dxf)
//! write at 1:1. It knows no map and no module.

use glam::DVec2;

/// The layers of a drawing, in the order in which they are drawn.
///
/// Their names in files are those of the variants in capitals: `CUT`, `SEAM`, ...
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr, strum::VariantArray)]
#[strum(serialize_all = "UPPERCASE")]
pub enum Layer {
    /// Colours with their scale; in SVG only, since a DXF is for a machine that cuts.
    Strain,
    /// Where the sheet is cut: rims.
    Cut,
    /// Where the sheet is cut and joined again: the two banks of each seam.
    Seam,
    /// Outlines of modules.
    Module,
    /// Taxels.
    Taxel,
    /// Wires from module to module.
    Chain,
    /// What is read and never cut: names, ticks of seams, the bar of 50 mm.
    Text,
}

/// A drawing of [`size`](Self::size), x to the right and y up, in mm, with its origin in the lower left corner.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Drawing {
    /// Width and height, in mm.
    pub size: DVec2,
    /// What is drawn; of one layer the later covers the earlier.
    pub shapes: Vec<Shape>,
}

/// An element of a drawing; lengths and positions in mm.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Straight lines from point to point, closed by one from the last to the first if `is_closed`.
    Polyline {
        /// The layer.
        layer: Layer,
        /// The corners.
        points: Vec<DVec2>,
        /// Whether the last point is joined to the first.
        is_closed: bool,
    },
    /// An area of one colour, on [`Layer::Strain`].
    Fill {
        /// Its corners.
        points: Vec<DVec2>,
        /// Red, green, blue.
        colour: [u8; 3],
    },
    /// A point, such as a taxel.
    Point {
        /// The layer.
        layer: Layer,
        /// The position.
        at: DVec2,
        /// Its name: a tooltip in SVG. In DXF points have no names; add a text.
        id: String,
    },
    /// A line of text.
    Text {
        /// The layer.
        layer: Layer,
        /// The position of the anchor.
        at: DVec2,
        /// Height of capital letters and figures.
        height: f64,
        /// Turn of the text, counter-clockwise, in radians.
        turn: f64,
        /// The point of the text that is at `at`.
        anchor: Anchor,
        /// The text itself.
        text: String,
    },
}

/// The point of a text that is at its position; all are half its height above its base line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Anchor {
    /// Its left end.
    Start,
    /// Its middle.
    #[default]
    Middle,
    /// Its right end.
    End,
}

/// Width of a letter over the height of capitals, with the space to the next; that of figures in common fonts.
const LETTER: f64 = 0.8;

impl Shape {
    /// The layer of the shape.
    pub fn layer(&self) -> Layer {
        match self {
            Self::Polyline { layer, .. } | Self::Point { layer, .. } | Self::Text { layer, .. } => *layer,
            Self::Fill { .. } => Layer::Strain,
        }
    }

    /// The lower left and the upper right corner of the smallest upright rectangle around the shape, of a text
    /// around what it covers in a common font; `None` without a point.
    pub fn bounds(&self) -> Option<[DVec2; 2]> {
        match self {
            Self::Polyline { points, .. } | Self::Fill { points, .. } => bounds(points.iter().copied()),
            Self::Point { at, .. } => Some([*at; 2]),
            Self::Text { at, height, turn, anchor, text, .. } => {
                let width = LETTER * height * text.chars().count() as f64;
                let left = match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => -0.5 * width,
                    Anchor::End => -width,
                };
                let (right, turn) = (left + width, DVec2::from_angle(*turn));
                let corners = [left, right].map(|x| [-0.5, 0.5].map(|y| DVec2::new(x, y * height)));
                bounds(corners.into_iter().flatten().map(|corner| *at + turn.rotate(corner)))
            }
        }
    }

    /// The same shape, moved.
    #[must_use]
    pub fn moved(mut self, by: DVec2) -> Self {
        match &mut self {
            Self::Polyline { points, .. } | Self::Fill { points, .. } => {
                points.iter_mut().for_each(|p| *p += by)
            }
            Self::Point { at, .. } | Self::Text { at, .. } => *at += by,
        }
        self
    }
}

impl Drawing {
    /// A drawing of these shapes, moved so that a margin is left on all sides, in mm.
    pub fn around(shapes: Vec<Shape>, margin: f64) -> Self {
        let corners = shapes.iter().filter_map(Shape::bounds).flatten();
        let [low, high] = bounds(corners).unwrap_or_default();
        let by = DVec2::splat(margin) - low;
        Self {
            size: high - low + 2.0 * margin,
            shapes: shapes.into_iter().map(|shape| shape.moved(by)).collect(),
        }
    }

    /// The shapes of a layer, in their order.
    pub fn on(&self, layer: Layer) -> impl Iterator<Item = &Shape> {
        self.shapes.iter().filter(move |shape| shape.layer() == layer)
    }
}

/// The lower left and the upper right corner of the smallest upright rectangle around points.
pub(crate) fn bounds(points: impl Iterator<Item = DVec2>) -> Option<[DVec2; 2]> {
    points.map(|p| [p; 2]).reduce(|[low, high], [p, _]| [low.min(p), high.max(p)])
}

/// A length with four decimals, a tenth of a micrometre, without superfluous zeros: the same text in all files.
pub(super) fn decimal(x: f64) -> String {
    let text = format!("{x:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}
