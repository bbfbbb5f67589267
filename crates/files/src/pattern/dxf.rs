//! A drawing as DXF of AutoCAD Release 12 (`AC1009`), which programs for cutting read, at 1:1 in mm.
//!
//! Layers are those of the drawing but for [`Layer::Strain`]; lines are `POLYLINE`, points `POINT`, texts `TEXT`.
//! Written after the DXF reference of Release 12 by Autodesk; `$INSUNITS` is younger, and ignored by those who
//! do not know it.

use std::fmt::Display;

use glam::DVec2;
use strum::VariantArray;

use crate::pattern::drawing::{Anchor, Drawing, Layer, Shape, decimal};

/// The drawing as DXF text, in mm.
///
/// Characters beyond ASCII are written as `\U+` and four hexadecimal digits, those beyond 16 bits as `?`.
pub fn write_dxf(drawing: &Drawing) -> String {
    let is_written = |layer: &&Layer| **layer != Layer::Strain && drawing.on(**layer).next().is_some();
    let layers: Vec<Layer> = Layer::VARIANTS.iter().filter(is_written).copied().collect();
    let mut dxf = Dxf(String::new());
    dxf.header(drawing.size);
    dxf.tables(&layers);
    dxf.set(0, "SECTION").set(2, "ENTITIES");
    for &layer in &layers {
        drawing.on(layer).for_each(|shape| dxf.shape(shape, layer));
    }
    dxf.set(0, "ENDSEC").set(0, "EOF");
    dxf.0
}

/// DXF text: pairs of a group code and a value, on a line each.
struct Dxf(String);

impl Dxf {
    fn set(&mut self, code: u16, value: impl Display) -> &mut Self {
        use std::fmt::Write;
        // Writing to a string cannot fail.
        let _ = write!(self.0, "{code:3}\n{value}\n");
        self
    }

    /// A point, of which x has this group code.
    fn point(&mut self, code: u16, at: DVec2) -> &mut Self {
        self.set(code, real(at.x)).set(code + 10, real(at.y)).set(code + 20, "0.0")
    }

    fn header(&mut self, size: DVec2) {
        self.set(0, "SECTION").set(2, "HEADER");
        self.set(9, "$ACADVER").set(1, "AC1009");
        // Metric, and a unit is one mm.
        self.set(9, "$MEASUREMENT").set(70, 1).set(9, "$INSUNITS").set(70, 4);
        self.set(9, "$EXTMIN").point(10, DVec2::ZERO).set(9, "$EXTMAX").point(10, size);
        self.set(9, "$LIMMIN").set(10, "0.0").set(20, "0.0");
        self.set(9, "$LIMMAX").set(10, real(size.x)).set(20, real(size.y));
        // Points are shown as circles with a cross, of 0.8 mm.
        self.set(9, "$PDMODE").set(70, 34).set(9, "$PDSIZE").set(40, "0.8");
        self.set(0, "ENDSEC");
    }

    fn tables(&mut self, layers: &[Layer]) {
        self.set(0, "SECTION").set(2, "TABLES");
        self.set(0, "TABLE").set(2, "LTYPE").set(70, 1);
        self.set(0, "LTYPE").set(2, "CONTINUOUS").set(70, 0).set(3, "Solid line");
        self.set(72, 65).set(73, 0).set(40, "0.0").set(0, "ENDTAB");
        self.set(0, "TABLE").set(2, "LAYER").set(70, layers.len());
        for &layer in layers {
            self.set(0, "LAYER").set(2, name(layer)).set(70, 0).set(62, colour(layer)).set(6, "CONTINUOUS");
        }
        self.set(0, "ENDTAB").set(0, "TABLE").set(2, "STYLE").set(70, 1);
        self.set(0, "STYLE").set(2, "STANDARD").set(70, 0).set(40, "0.0").set(41, "1.0").set(50, "0.0");
        self.set(71, 0).set(42, "1.0").set(3, "txt").set(4, "").set(0, "ENDTAB").set(0, "ENDSEC");
    }

    fn shape(&mut self, shape: &Shape, layer: Layer) {
        let layer = name(layer);
        match shape {
            Shape::Polyline { points, is_closed, .. } => {
                self.set(0, "POLYLINE").set(8, layer).set(66, 1).point(10, DVec2::ZERO);
                self.set(70, u8::from(*is_closed));
                for &at in points {
                    self.set(0, "VERTEX").set(8, layer).point(10, at);
                }
                self.set(0, "SEQEND").set(8, layer);
            }
            Shape::Fill { .. } => {}
            Shape::Point { at, .. } => {
                self.set(0, "POINT").set(8, layer).point(10, *at);
            }
            Shape::Text { at, height, turn, anchor, text, .. } => {
                let anchor = match anchor {
                    Anchor::Start => 0,
                    Anchor::Middle => 1,
                    Anchor::End => 2,
                };
                // An aligned text is at its second point; the first is ignored.
                self.set(0, "TEXT").set(8, layer).point(10, *at).set(40, real(*height)).set(1, ascii(text));
                self.set(50, real(turn.to_degrees())).set(72, anchor).point(11, *at).set(73, 2);
            }
        }
    }
}

/// A number of DXF has a point.
fn real(x: f64) -> String {
    let text = decimal(x);
    if text.contains('.') { text } else { text + ".0" }
}

fn name(layer: Layer) -> &'static str {
    layer.into()
}

/// The number of the layer's colour in AutoCAD's list.
fn colour(layer: Layer) -> u8 {
    match layer {
        Layer::Cut => 1,
        Layer::Chain => 3,
        Layer::Taxel => 4,
        Layer::Seam => 5,
        Layer::Strain | Layer::Module | Layer::Text => 7,
    }
}

/// Text in the characters of Release 12. `%%`, `\` and `^` begin codes and are written as codes themselves.
fn ascii(text: &str) -> String {
    let text = if text.contains("%%") { text.replace('%', "%%%") } else { text.to_owned() };
    let mut ascii = String::with_capacity(text.len());
    for c in text.chars() {
        match u32::from(c) {
            _ if c.is_control() => ascii.push(' '),
            code if c == '\\' || c == '^' || (0x7f..=0xffff).contains(&code) => {
                ascii += &format!("\\U+{code:04X}")
            }
            0x20..0x7f => ascii.push(c),
            _ => ascii.push('?'),
        }
    }
    ascii
}
