//! Pictures as SVG text.

use std::fmt::{Display, Write};

use base64::{Engine, engine::general_purpose::STANDARD};
use glam::DVec2;

use crate::plot::colour::Colour;
use crate::plot::picture::png::encode;
use crate::plot::picture::{Anchor, INK, Picture, Shape, Stroke};

impl Picture {
    /// The picture as SVG text. Texts are `<text>` elements, which an editor can change; images are
    /// embedded.
    pub fn to_svg(&self) -> String {
        let [width, height] = self.size_px;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"Ubuntu, 'DejaVu Sans', Arial, sans-serif\" \
             font-size=\"{}\" stroke-linejoin=\"round\" stroke-linecap=\"round\">\n\
             <title>{}</title>\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n",
            self.em,
            escape(&self.title)
        );
        for group in self.groups.iter().filter(|group| !group.is_empty()) {
            svg.push_str("<g>\n");
            group.iter().for_each(|shape| write_shape(&mut svg, shape, self.em));
            svg.push_str("</g>\n");
        }
        svg.push_str("</svg>\n");
        svg
    }
}

/// An element that is written attribute by attribute.
struct SvgElement<'a>(&'a mut String);

impl<'a> SvgElement<'a> {
    fn new(svg: &'a mut String, name: &str) -> Self {
        svg.push('<');
        svg.push_str(name);
        Self(svg)
    }

    fn set(self, name: &str, value: impl Display) -> Self {
        // Writing to a string cannot fail.
        let _ = write!(self.0, " {name}=\"{value}\"");
        self
    }

    fn corner_and_size(self, corner: DVec2, size: DVec2) -> Self {
        self.set("x", corner.x).set("y", corner.y).set("width", size.x).set("height", size.y)
    }

    fn stroke(self, stroke: &Stroke) -> Self {
        let element = self.set("stroke", stroke.colour.hex()).set("stroke-width", stroke.width);
        if stroke.opacity < 1.0 { element.set("stroke-opacity", stroke.opacity) } else { element }
    }

    fn end(self) {
        self.0.push_str("/>\n");
    }

    fn open(self) {
        self.0.push_str(">\n");
    }

    fn text(self, text: &str) {
        let name_end = format!(">{}</text>\n", escape(text));
        self.0.push_str(&name_end);
    }
}

fn write_shape(svg: &mut String, shape: &Shape, em: f64) {
    match shape {
        Shape::Path { path, fill, stroke } => {
            let fill = fill.map_or_else(|| "none".to_owned(), Colour::hex);
            let element = SvgElement::new(svg, "path").set("d", path.to_svg()).set("fill", fill);
            stroke.iter().fold(element, SvgElement::stroke).end();
        }
        Shape::Dots { centres, radius, colour, has_rim } => {
            let tenth = |x: f64| (10.0 * x).round() / 10.0;
            let group = SvgElement::new(svg, "g").set("fill", colour.hex());
            has_rim.then_some(Stroke::RIM).iter().fold(group, SvgElement::stroke).open();
            for at in centres {
                let dot = SvgElement::new(svg, "circle").set("cx", tenth(at.x)).set("cy", tenth(at.y));
                dot.set("r", tenth(*radius)).end();
            }
            svg.push_str("</g>\n");
        }
        Shape::Text { text, at, anchor, is_bold } => {
            let element = SvgElement::new(svg, "text").set("x", at.x).set("y", at.y).set("fill", INK.hex());
            let element = match anchor {
                Anchor::Start => element,
                Anchor::Middle => element.set("text-anchor", "middle"),
                Anchor::End => element.set("text-anchor", "end"),
            };
            let stroke = is_bold.then(|| Stroke::bold(em));
            stroke.iter().fold(element, SvgElement::stroke).text(text);
        }
        Shape::Image { corner, size, pixels } => {
            let data = STANDARD.encode(encode(pixels.size, &pixels.colours));
            let element = SvgElement::new(svg, "image").corner_and_size(*corner, *size);
            element.set("href", format_args!("data:image/png;base64,{data}")).end();
        }
        Shape::Scale { corner, size, colours } => {
            // Pictures on one page share their names: that of a scale is of its colours.
            let id = format!("scale-{:016x}", hash(colours));
            let _ = writeln!(svg, "<defs><linearGradient id=\"{id}\">");
            let last = colours.len().saturating_sub(1).max(1) as f64;
            for (k, colour) in colours.iter().enumerate() {
                let stop = SvgElement::new(svg, "stop").set("offset", k as f64 / last);
                stop.set("stop-color", colour.hex()).end();
            }
            svg.push_str("</linearGradient></defs>\n");
            let bar = SvgElement::new(svg, "rect").corner_and_size(*corner, *size);
            bar.set("fill", format_args!("url(#{id})")).stroke(&Stroke::FRAME).end();
        }
    }
}

/// A hash of colours: FNV-1a, of 64 bits.
fn hash(colours: &[Colour]) -> u64 {
    let bytes = colours.iter().flat_map(|colour| colour.hex().into_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
