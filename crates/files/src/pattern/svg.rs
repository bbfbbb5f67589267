//! A drawing as SVG text at 1:1: width and height in mm, one unit of the `viewBox` one mm.
//!
//! Each layer is a group with the layer's name as its `id`, which Inkscape shows as a layer; machines that cut
//! choose by its colour.

use std::fmt::Write;

use glam::DVec2;
use strum::VariantArray;

use crate::pattern::drawing::{Anchor, Drawing, Layer, Shape, decimal};

/// The height of capitals over the size of the font, of Arial, Helvetica and Liberation Sans.
const CAPITAL: f64 = 0.716;

/// The radius of a point, in mm.
const POINT_RADIUS: f64 = 0.4;

/// The drawing as SVG text, with a title.
pub fn write_svg(drawing: &Drawing, title: &str) -> String {
    let mut svg = open(drawing.size, title);
    write_layers(&mut svg, &drawing.shapes, drawing.size.y);
    svg.push_str("</svg>\n");
    svg
}

/// The beginning of a document, up to what it shows.
pub(super) fn open(size: DVec2, title: &str) -> String {
    let [width, height] = size.to_array().map(decimal);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:inkscape=\"http://www.inkscape.org/namespaces/inkscape\" \
         width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"Arial, Helvetica, 'Liberation Sans', 'DejaVu Sans', sans-serif\" \
         stroke-linejoin=\"round\" stroke-linecap=\"round\">\n<title>{}</title>\n",
        escape(title)
    )
}

/// Writes shapes layer by layer; y = 0 of the drawing is `height` below the top.
pub(super) fn write_layers(svg: &mut String, shapes: &[Shape], height: f64) {
    for &layer in Layer::VARIANTS {
        let shapes: Vec<_> = shapes.iter().filter(|shape| shape.layer() == layer).collect();
        if !shapes.is_empty() {
            let name: &str = layer.into();
            // Writing to a string cannot fail.
            let _ = writeln!(
                svg,
                "<g id=\"{name}\" inkscape:groupmode=\"layer\" inkscape:label=\"{name}\" fill=\"none\" \
                 stroke=\"{}\" stroke-width=\"0.15\">",
                colour(layer)
            );
            let is_one_area = |a: &&Shape, b: &&Shape| fill(a).is_some() && fill(a) == fill(b);
            shapes.chunk_by(is_one_area).for_each(|same| write_one(svg, same, height));
            svg.push_str("</g>\n");
        }
    }
}

/// The colour of lines and texts of a layer.
fn colour(layer: Layer) -> &'static str {
    match layer {
        Layer::Cut => "#e00000",
        Layer::Seam => "#0030e0",
        Layer::Taxel => "#007890",
        Layer::Chain => "#008020",
        Layer::Strain | Layer::Module | Layer::Text => "#000000",
    }
}

/// Writes shapes of one layer without its group.
pub(super) fn write_shapes(svg: &mut String, shapes: &[Shape], height: f64) {
    shapes.iter().for_each(|shape| write_one(svg, &[shape], height));
}

/// The colour of an area.
fn fill(shape: &Shape) -> Option<[u8; 3]> {
    if let Shape::Fill { colour, .. } = shape { Some(*colour) } else { None }
}

/// Writes one shape, or areas of one colour as one element, which keeps files small.
fn write_one(svg: &mut String, shapes: &[&Shape], height: f64) {
    let Some(&shape) = shapes.first() else { return };
    let place = |p: DVec2| [p.x, height - p.y].map(decimal).join(" ");
    let path = |points: &[DVec2]| points.iter().map(|&p| place(p)).collect::<Vec<_>>().join("L");
    // Writing to a string cannot fail.
    let _ = match shape {
        Shape::Polyline { points, is_closed, .. } => {
            writeln!(svg, "<path d=\"M{}{}\"/>", path(points), if *is_closed { "Z" } else { "" })
        }
        Shape::Fill { colour: [r, g, b], .. } => {
            let area = |shape: &&Shape| match shape {
                Shape::Fill { points, .. } => format!("M{}Z", path(points)),
                _ => String::new(),
            };
            // A line of its own colour closes the gap to the next area, which a viewer would show.
            let (areas, colour): (String, _) =
                (shapes.iter().map(area).collect(), format!("#{r:02x}{g:02x}{b:02x}"));
            writeln!(svg, "<path d=\"{areas}\" fill=\"{colour}\" stroke=\"{colour}\" stroke-width=\"0.05\"/>")
        }
        Shape::Point { at, id, .. } => {
            let [x, y] = [at.x, height - at.y].map(decimal);
            let (r, id) = (decimal(POINT_RADIUS), escape(id));
            writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\"><title>{id}</title></circle>")
        }
        Shape::Text { layer, at, height: capitals, turn, anchor, text } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let (size, down) = (decimal(capitals / CAPITAL), decimal(0.5 * capitals));
            writeln!(
                svg,
                "<text transform=\"translate({}) rotate({})\" y=\"{down}\" font-size=\"{size}\" \
                 text-anchor=\"{anchor}\" fill=\"{}\" stroke=\"none\">{}</text>",
                place(*at),
                decimal(-turn.to_degrees()),
                colour(*layer),
                escape(text)
            )
        }
    };
}

/// Text as XML, in which control characters are not allowed.
fn escape(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    text.replace(|c: char| c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}'), " ")
}
