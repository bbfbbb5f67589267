//! A drawing on several sheets of paper, which are joined at their crosses.

use std::fmt::Write;

use glam::DVec2;

use crate::pattern::draw::bar;
use crate::pattern::drawing::{Anchor, Drawing, Layer, Shape, decimal};
use crate::pattern::{PatternError, svg};

/// Width and height of a sheet of paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// In mm.
    pub size: DVec2,
    /// Whether it may lie on its side where fewer are needed then.
    pub can_turn: bool,
}

impl Sheet {
    /// ISO A4, upright or on its side.
    pub const A4: Self = Self { size: DVec2::new(210.0, 297.0), can_turn: true };

    /// ISO A3, upright or on its side.
    pub const A3: Self = Self { size: DVec2::new(297.0, 420.0), can_turn: true };
}

/// Margin of a sheet, in mm: printers leave some 5 mm white, and the rest has crosses and a line of text.
const MARGIN: f64 = 10.0;

/// Least side of a sheet, in mm: the bar of 50 mm and what it says must fit between the margins.
const LEAST_SIDE: f64 = 100.0;

/// Largest side of a sheet, in mm: no roll is wider, and numbers stay exact.
const LARGEST_SIDE: f64 = 1e5;

/// Most sheets: of A4 they cover 10 m^2, five times the skin of a human.
const MOST_SHEETS: usize = 200;

/// Arm of a cross, in mm.
const ARM: f64 = 4.0;

/// The drawing as SVG text on sheets, row by row from the upper left.
///
/// Each sheet shows a rectangle of the drawing within margins of 10 mm, with a cross at each of its corners, which
/// are those of the next sheets too; the margin names the sheet and has a bar of 50 mm.
///
/// # Errors
/// If a side of a sheet is not 100 to 100000 mm, or more than 200 sheets are needed.
pub fn write_sheets(drawing: &Drawing, title: &str, sheet: Sheet) -> Result<Vec<String>, PatternError> {
    let size = sheet.size;
    if !(size.min_element() >= LEAST_SIDE && size.max_element() <= LARGEST_SIDE) {
        return Err(PatternError::Sheet {
            size: size.to_array(),
            margin: MARGIN,
            least: LEAST_SIDE,
            most: LARGEST_SIDE,
        });
    }
    // Numbers of sheets that are not finite are too many.
    let counts = |size: DVec2| (drawing.size / (size - 2.0 * MARGIN)).ceil().max(DVec2::ONE);
    let needed = |size: &DVec2| counts(*size).element_product();
    let turned = DVec2::new(size.y, size.x);
    let size = if sheet.can_turn && needed(&turned) < needed(&size) { turned } else { size };
    if needed(&size).is_nan() || needed(&size) > MOST_SHEETS as f64 {
        let tenth = |x: f64| (10.0 * x).round() / 10.0;
        return Err(PatternError::TooManySheets {
            size: drawing.size.to_array().map(tenth),
            needed: needed(&size),
            most: MOST_SHEETS,
        });
    }
    #[expect(clippy::cast_possible_truncation, reason = "at most 200")]
    let [columns, rows] = counts(size).to_array().map(|count| count as u32);
    let page = |row: u32, column: u32| {
        let number = row * columns + column + 1;
        let label = format!(
            "{title}: sheet {number} of {}, row {} of {rows}, column {} of {columns}",
            rows * columns,
            row + 1,
            column + 1
        );
        one(drawing, size, DVec2::new(f64::from(column), f64::from(row)), &label)
    };
    Ok((0..rows)
        .flat_map(|row| (0..columns).map(move |column| (row, column)))
        .map(|(r, c)| page(r, c))
        .collect())
}

/// One sheet, at this column and row from the upper left.
fn one(drawing: &Drawing, size: DVec2, at: DVec2, label: &str) -> String {
    let window = size - 2.0 * MARGIN;
    let low = DVec2::new(at.x * window.x, drawing.size.y - (at.y + 1.0) * window.y);
    let high = low + window;
    let is_seen = |shape: &&Shape| {
        // A line of the width of its layer may reach over the border by itself.
        let bounds = shape.bounds();
        bounds.is_some_and(|[from, to]| to.cmpge(low - 1.0).all() && from.cmple(high + 1.0).all())
    };
    let by = DVec2::splat(MARGIN) - low;
    let shapes: Vec<_> = drawing.shapes.iter().filter(is_seen).map(|shape| shape.clone().moved(by)).collect();
    let mut svg = svg::open(size, label);
    let [width, height, margin] = [window.x, window.y, MARGIN].map(decimal);
    // Writing to a string cannot fail.
    let _ = writeln!(
        svg,
        "<clipPath id=\"window\"><rect x=\"{margin}\" y=\"{margin}\" width=\"{width}\" height=\"{height}\"/></clipPath>\n\
         <g clip-path=\"url(#window)\">"
    );
    svg::write_layers(&mut svg, &shapes, size.y);
    svg.push_str("</g>\n<g id=\"SHEET\" fill=\"none\" stroke=\"#000000\" stroke-width=\"0.15\">\n");
    svg::write_shapes(&mut svg, &marks(size, label), size.y);
    svg.push_str("</g>\n</svg>\n");
    svg
}

/// Crosses, a bar and the name of a sheet.
fn marks(size: DVec2, label: &str) -> Vec<Shape> {
    let line = |from: DVec2, to: DVec2| Shape::Polyline {
        layer: Layer::Text,
        points: vec![from, to],
        is_closed: false,
    };
    let mut marks = Vec::new();
    for x in [MARGIN, size.x - MARGIN] {
        for y in [MARGIN, size.y - MARGIN] {
            let at = DVec2::new(x, y);
            marks.extend([DVec2::X, DVec2::Y].map(|axis| line(at - ARM * axis, at + ARM * axis)));
        }
    }
    marks.extend(bar(DVec2::new(MARGIN + 2.0 * ARM, 0.5 * MARGIN)));
    marks.push(Shape::Text {
        layer: Layer::Text,
        at: DVec2::new(MARGIN + 2.0 * ARM, size.y - 0.5 * MARGIN),
        height: 2.5,
        turn: 0.0,
        anchor: Anchor::Start,
        text: label.to_owned(),
    });
    marks
}
