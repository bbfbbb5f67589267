//! The pattern of designed modules: each chain unrolled, one below the other.

use glam::{DAffine2, DVec2};

use crate::design::{Module, Strip};
use crate::pattern::draw::bar;
use crate::pattern::{Anchor, Drawing, Layer, Shape};

/// Room around the drawing and between strips, in mm.
const MARGIN: f64 = 8.0;

/// Height of the numbers of modules and of the names of strips, in mm.
const TEXT: f64 = 3.0;

/// Draws strips of modules with the numbers that `number` gives them and a name for each strip: outlines, taxels, and a
/// line along each chain.
pub fn strip_drawing(
    strips: &[(String, Strip)],
    module: &Module,
    number: impl Fn(usize) -> String,
) -> Drawing {
    let mut shapes = Vec::new();
    let mut top = 0.0;
    let text = |at: DVec2, anchor: Anchor, text: String| Shape::Text {
        layer: Layer::Text,
        at,
        height: TEXT,
        turn: 0.0,
        anchor,
        text,
    };
    for (name, strip) in strips {
        let scaled = |place: &DAffine2, p: &DVec2| place.transform_point2(*p) * 1e3;
        let mut own = Vec::new();
        let mut wire = Vec::new();
        for (k, place) in &strip.modules {
            let points: Vec<DVec2> = module.outline.iter().map(|p| scaled(place, p)).collect();
            let centre = points.iter().sum::<DVec2>() / points.len() as f64;
            wire.push(centre);
            own.push(Shape::Polyline { layer: Layer::Module, points, is_closed: true });
            let taxel = |(j, p): (usize, &DVec2)| Shape::Point {
                layer: Layer::Taxel,
                at: scaled(place, p),
                id: format!("{}.{}", number(*k), j + 1),
            };
            own.extend(module.taxels.iter().enumerate().map(taxel));
            own.push(text(centre + DVec2::Y * TEXT, Anchor::Middle, number(*k)));
        }
        if wire.len() > 1 {
            own.push(Shape::Polyline { layer: Layer::Chain, points: wire, is_closed: false });
        }
        let bounds = own.iter().filter_map(Shape::bounds).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
        let Some([low, high]) = bounds else { continue };
        let by = DVec2::new(-low.x, top - MARGIN - high.y);
        shapes.push(text(DVec2::new(0.0, top - 0.5 * TEXT), Anchor::Start, name.clone()));
        shapes.extend(own.into_iter().map(|shape| shape.moved(by)));
        top += low.y - high.y - 2.0 * MARGIN;
    }
    shapes.extend(bar(DVec2::new(0.0, top)));
    Drawing::around(shapes, MARGIN)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sides of modules are as long as those of the drawing, in mm.
    #[test]
    fn strips_are_true_to_size() {
        let module = Module::triangle(0.0322);
        let place = DAffine2::from_angle_translation(0.3, DVec2::new(0.1, 0.2));
        let strip = Strip { chain: 0, modules: vec![(0, place), (1, DAffine2::IDENTITY)] };
        let drawing = strip_drawing(&[("chain 1".into(), strip)], &module, |k| (k + 1).to_string());
        let sides = drawing.on(Layer::Module).flat_map(|shape| match shape {
            Shape::Polyline { points, .. } => {
                vec![points[0].distance(points[1]), points[2].distance(points[0])]
            }
            _ => Vec::new(),
        });
        let sides: Vec<f64> = sides.collect();
        assert_eq!(sides.len(), 4);
        assert!(sides.iter().all(|side| (side - 32.2).abs() < 1e-9), "{sides:?}");
        assert_eq!(drawing.on(Layer::Taxel).count(), 20);
        let inside = |p: DVec2| p.min_element() > 0.0 && (drawing.size - p).min_element() > 0.0;
        assert!(drawing.shapes.iter().filter_map(Shape::bounds).flatten().all(inside));
    }
}
