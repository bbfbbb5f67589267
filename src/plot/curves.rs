//! Curves over two logarithmic axes, as a benchmark shows them: error against time.

use glam::DVec2;

use crate::plot::{
    Picture,
    colour::{Colour, INK},
    picture::{Anchor, Path, Shape, Stroke},
};

/// A curve, or several points that a line joins.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// What it shows, written at its last point.
    pub name: String,
    /// Positive values along both axes.
    pub points: Vec<[f64; 2]>,
}

/// Colours of curves, one after the other.
const COLOURS: [Colour; 8] = [
    Colour(68, 1, 84),
    Colour(59, 82, 139),
    Colour(33, 145, 140),
    Colour(94, 170, 60),
    Colour(204, 120, 20),
    Colour(180, 40, 60),
    Colour(120, 120, 120),
    Colour(20, 20, 20),
];

/// Size of the picture and of the margins left of, above, right of and below the axes, in pixels.
const SIZE: [u32; 2] = [900, 560];
const MARGINS: [f64; 4] = [90.0, 56.0, 120.0, 64.0];
const EM: f64 = 15.0;

/// Draws curves over two logarithmic axes with these names. Points that are not positive are left
/// out.
#[must_use]
pub fn plot_curves(title: &str, axes: [&str; 2], curves: &[Curve]) -> Picture {
    let is_drawn = |p: &&[f64; 2]| p.iter().all(|x| x.is_finite() && *x > 0.0);
    let logs = |curve: &Curve| -> Vec<DVec2> {
        curve.points.iter().filter(is_drawn).map(|p| DVec2::from_array(p.map(f64::log10))).collect()
    };
    let all: Vec<DVec2> = curves.iter().flat_map(logs).collect();
    let least = all.iter().copied().reduce(DVec2::min).unwrap_or_default().floor();
    let most = all.iter().copied().reduce(DVec2::max).unwrap_or_default().ceil().max(least + 1.0);
    let [left, top, right, bottom] = MARGINS;
    let size = DVec2::new(f64::from(SIZE[0]) - left - right, f64::from(SIZE[1]) - top - bottom);
    let place = |p: DVec2| {
        let share = (p - least) / (most - least);
        DVec2::new(left + share.x * size.x, top + (1.0 - share.y) * size.y)
    };
    let text = |text: &str, at: DVec2, anchor: Anchor, is_bold: bool| Shape::Text {
        text: text.into(),
        at,
        anchor,
        is_bold,
    };
    let line = |path: Path, colour: Colour, width: f64, opacity: f64| Shape::Path {
        path,
        fill: None,
        stroke: Some(Stroke { colour, width, opacity }),
    };
    let mut frame = vec![text(title, DVec2::new(left, 30.0), Anchor::Start, true)];
    for axis in 0..2 {
        let mut decade = least[axis];
        while decade <= most[axis] {
            let mut from = least;
            from[axis] = decade;
            let mut to = most;
            to[axis] = decade;
            let mut path = Path::default();
            path.move_to(place(from));
            path.line_to(place(to));
            frame.push(line(path, INK, 0.8, 0.25));
            let (offset, anchor) = match axis {
                0 => (DVec2::new(0.0, 1.4 * EM), Anchor::Middle),
                _ => (DVec2::new(-0.5 * EM, 0.35 * EM), Anchor::End),
            };
            frame.push(text(&format!("{}", 10_f64.powf(decade)), place(from) + offset, anchor, false));
            decade += 1.0;
        }
    }
    frame.push(text(
        axes[0],
        place(DVec2::new(most.x, least.y)) + DVec2::new(0.0, 3.0 * EM),
        Anchor::End,
        false,
    ));
    frame.push(text(
        axes[1],
        place(DVec2::new(least.x, most.y)) - DVec2::new(0.0, 0.5 * EM),
        Anchor::Start,
        false,
    ));
    let mut groups = vec![frame];
    for (curve, colour) in curves.iter().zip(COLOURS.into_iter().cycle()) {
        let centres: Vec<DVec2> = logs(curve).into_iter().map(place).collect();
        let Some(&last) = centres.last() else { continue };
        let mut path = Path::default();
        path.move_to(centres[0]);
        centres[1..].iter().for_each(|p| path.line_to(*p));
        let name = text(&curve.name, last + DVec2::new(0.7 * EM, 0.35 * EM), Anchor::Start, false);
        let dots = Shape::Dots { centres, radius: 4.0, colour, has_rim: false };
        groups.push(vec![line(path, colour, 2.0, 1.0), dots, name]);
    }
    Picture { title: title.into(), size_px: SIZE, em: EM, groups }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_and_names_are_written_and_odd_points_left_out() {
        let curve = Curve { name: "level 2".into(), points: vec![[100.0, 0.2], [3000.0, 5.0], [0.0, 1.0]] };
        let picture = plot_curves("errors", ["ns", "mm"], &[curve]);
        let svg = picture.to_svg();
        for text in ["errors", "ns", "mm", "level 2", ">100<", ">10000<", ">0.1<", ">10<"] {
            assert!(svg.contains(text), "{text} in {svg}");
        }
        assert!(picture.to_png().is_ok());
        assert!(plot_curves("", ["", ""], &[]).to_png().is_ok());
    }
}
