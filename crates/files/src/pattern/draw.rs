//! The pattern of a map: what is cut, joined and marked on a flat sheet, in mm.

use glam::DVec2;

use crate::id::VertexId;
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::pattern::PatternError;
use crate::pattern::drawing::{Anchor, Drawing, Layer, Shape, bounds};
use crate::pattern::outline::{BankPoint, Outline};
use crate::pattern::strain::{STRAINS, SheetStrain};
use crate::plot::{DIVERGING, number, printable};
use crate::pyramid::LevelId;
use crate::skin::Presence;

/// Millimetres in a metre.
const MM: f64 = 1e3;

/// Free space around the drawing and between patches, in mm.
const MARGIN: f64 = 10.0;

/// Height of the name of a patch, in mm.
const TITLE: f64 = 4.0;

/// Height of other lines of text, in mm.
const TEXT: f64 = 2.5;

/// Height of the texts at taxels and ticks where there is room, in mm: the smallest that office printers print
/// legibly.
const SMALL: f64 = 1.5;

/// Distance of the ticks of a seam on the skin, in mm: every seam gets one, and ten fit along a finger.
const TICK_DISTANCE: f64 = 10.0;

/// Length of a tick, in mm.
const TICK: f64 = 2.0;

/// Colours of the scale of strains: as many as eyes distinguish on paper.
const COLOURS: u8 = 20;

/// The ends of the scale of strains; the first beyond which lies at most a hundredth of the area is taken.
const SCALES: [f64; 4] = [0.05, 0.1, 0.2, 0.5];

/// Length of the bar, in mm.
const BAR: f64 = 50.0;

/// Draws the pattern of the finest maps of patches with these names, or of all if there are none, at 1:1 and as
/// seen from outside of the skin.
///
/// Rims are on [`Layer::Cut`], the two banks of each seam on [`Layer::Seam`]: together closed outlines. Ticks on
/// both banks mark the same points of the skin; they have the letters of the seam and a number that grows along
/// it, and lie on [`Layer::Text`], so that they are not cut. Taxels and thermal pads that are present are points
/// with their ids. Each patch has its name, its area, and the share of it that is strained beyond 1, 5, 10 and
/// 20 % ([`SheetStrain`]), which colours show.
///
/// ```
/// use dermatome::{mesh::shapes, pattern, pipeline, skin::Skin};
///
/// let skin = Skin::from_mesh("sleeve", shapes::tube(40, 20, 0.03, 0.1));
/// let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
/// let drawing = pattern::draw_pattern(&map, &[])?;
/// assert!(pattern::write_svg(&drawing, "sleeve").contains("mm\" viewBox="));
/// assert!(pattern::write_dxf(&drawing).contains("AC1009"));
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Errors
/// If there is no patch, or none of a name; the data are not a valid map; or a map has no area.
pub fn draw_pattern(map: &SkinMap, names: &[String]) -> Result<Drawing, PatternError> {
    map.validate()?;
    if let Some(patch) = names.iter().find(|name| map.patches.iter().all(|patch| patch.name != **name)) {
        let known = map.patches.iter().map(|patch| patch.name.clone()).collect();
        return Err(PatternError::UnknownPatch { patch: patch.clone(), known });
    }
    let is_chosen = |patch: &&PatchMap| names.is_empty() || names.contains(&patch.name);
    let finest = |patch: &PatchMap| patch.levels.iter().next().is_some();
    let patches: Vec<_> = map.patches.iter().filter(is_chosen).filter(|patch| finest(patch)).collect();
    if patches.is_empty() {
        return Err(PatternError::Empty);
    }
    let strains: Vec<_> =
        patches.iter().map(|patch| SheetStrain::new(patch, &patch.levels[LevelId::default()])).collect();
    let scale = scale_of(&strains);
    let mut seams = 0;
    let panels = patches
        .iter()
        .zip(&strains)
        .map(|(patch, strain)| panel(patch, strain, scale, &mut seams))
        .collect::<Result<_, _>>()?;
    let mut shapes = arrange(panels);
    let low = bounds(shapes.iter().filter_map(Shape::bounds).flatten()).map_or(DVec2::ZERO, |[low, _]| low);
    shapes.extend(legend(scale).into_iter().map(|shape| shape.moved(low - DVec2::new(0.0, MARGIN))));
    Ok(Drawing::around(shapes, MARGIN))
}

/// The shapes of a patch with its texts below.
fn panel(
    patch: &PatchMap,
    strain: &SheetStrain,
    scale: f64,
    seams: &mut usize,
) -> Result<Vec<Shape>, PatternError> {
    let level = &patch.levels[LevelId::default()];
    let outline = Outline::new(patch, level);
    let corners = bounds(outline.pieces.iter().flat_map(|piece| piece.points.iter().map(|&p| MM * p)));
    let [low, high] = corners.unwrap_or_default();
    let size = high - low;
    if !(size.min_element() > 0.0 && size.is_finite()) {
        let (patch, [width_mm, height_mm]) = (patch.name.clone(), size.to_array());
        return Err(PatternError::NoArea { patch, width_mm, height_mm });
    }
    let mut shapes = coloured(level, strain, scale);
    for piece in &outline.pieces {
        let points = piece.points.iter().map(|&p| MM * p).collect();
        shapes.push(Shape::Polyline { layer: piece.layer, points, is_closed: piece.is_closed });
    }
    for seam in &outline.seams {
        ticks(&outline, seam, &letters(*seams), &mut shapes);
        *seams += 1;
    }
    taxels(patch, level, strain.area(), &mut shapes);
    let share = |x: &f64| number(100.0 * strain.area_beyond(*x) / strain.area(), 1);
    let shares: Vec<_> =
        STRAINS.iter().map(|x| format!("{} %: {} %", number(100.0 * x, 0), share(x))).collect();
    let lines = [
        (TITLE, printable(&patch.name)),
        (TEXT, format!("{} cm2", number(1e4 * strain.area(), 1))),
        (TEXT, "share of the area that is strained beyond".to_owned()),
        (TEXT, shares.join(", ")),
    ];
    let mut at = low;
    for (height, text) in lines {
        at.y -= 0.9 * height;
        shapes.push(Shape::Text { layer: Layer::Text, at, height, turn: 0.0, anchor: Anchor::Start, text });
        at.y -= 0.9 * height;
    }
    Ok(shapes)
}

/// The faces in the colours of their strain, those of one colour after each other.
fn coloured(level: &MapLevel, strain: &SheetStrain, scale: f64) -> Vec<Shape> {
    let mut faces: Vec<_> = strain.faces.iter().map(|&(face, _, found)| (step(found, scale), face)).collect();
    faces.sort_unstable();
    let fill = |(step, face)| Shape::Fill {
        points: level.uv_of(face).map(|p| MM * p).to_vec(),
        colour: colour(step),
    };
    faces.into_iter().map(fill).collect()
}

/// The number of the colour of a strain.
fn step(strain: f64, scale: f64) -> u8 {
    let part = (0.5 + 0.5 * strain / scale).clamp(0.0, 1.0);
    #[expect(clippy::cast_possible_truncation, reason = "between 0 and 20")]
    let step = (f64::from(COLOURS) * part).round() as u8;
    step
}

fn colour(step: u8) -> [u8; 3] {
    let colour = DIVERGING.at(f64::from(step) / f64::from(COLOURS));
    [colour.0, colour.1, colour.2]
}

/// The strain at the ends of the scale of colours.
fn scale_of(strains: &[SheetStrain]) -> f64 {
    let area: f64 = strains.iter().map(SheetStrain::area).sum();
    let is_enough =
        |&scale: &f64| strains.iter().map(|strain| strain.area_beyond(scale)).sum::<f64>() <= 0.01 * area;
    SCALES.into_iter().find(is_enough).unwrap_or(SCALES[SCALES.len() - 1])
}

/// The marks of a seam, at the same points of the skin on both banks.
fn ticks(outline: &Outline, seam: &[VertexId], name: &str, shapes: &mut Vec<Shape>) {
    let length = outline.length(seam);
    let count = (MM * length / TICK_DISTANCE).round().max(1.0);
    let distance = length / count;
    let height = SMALL.min(0.3 * MM * distance);
    let mut number = 1.0;
    while number <= count {
        for BankPoint { at, along } in outline.on_banks(seam, (number - 0.5) * distance).into_iter().flatten()
        {
            let (at, inward) = (MM * at, along.perp());
            let tick = TICK.min(0.3 * MM * distance);
            shapes.push(Shape::Polyline {
                layer: Layer::Text,
                points: vec![at, at + tick * inward],
                is_closed: false,
            });
            // Texts are read along the bank, and never upside down.
            let upright = if along.x < -1e-9 { -along } else { along };
            shapes.push(Shape::Text {
                layer: Layer::Text,
                at: at + (tick + 0.8 * height) * inward,
                height,
                turn: upright.to_angle(),
                anchor: Anchor::Middle,
                text: format!("{name}{number}"),
            });
        }
        number += 1.0;
    }
}

/// A, B, ..., Z, AA, AB, ...
fn letters(mut number: usize) -> String {
    let mut letters = Vec::new();
    loop {
        letters.push(b"ABCDEFGHIJKLMNOPQRSTUVWXYZ"[number % 26]);
        let Some(rest) = (number / 26).checked_sub(1) else { break };
        number = rest;
    }
    letters.iter().rev().map(|&letter| char::from(letter)).collect()
}

/// Taxels and thermal pads at each of their places, with their ids.
fn taxels(patch: &PatchMap, level: &MapLevel, area: f64, shapes: &mut Vec<Shape>) {
    let spacing = MM * (area / patch.taxels.ids.len().max(1) as f64).sqrt();
    let height = SMALL.min(0.25 * spacing);
    for (place, &at) in level.uv.enumerate() {
        let taxel = level.vertex_of(place);
        if patch.taxels.presence[taxel] == Presence::Absent {
            continue;
        }
        let (at, id) = (MM * at, patch.taxels.ids[taxel].to_string());
        shapes.push(Shape::Point { layer: Layer::Taxel, at, id: id.clone() });
        shapes.push(Shape::Text {
            layer: Layer::Taxel,
            at: at + DVec2::splat(0.6 * height),
            height,
            turn: 0.0,
            anchor: Anchor::Start,
            text: id,
        });
    }
}

/// Places panels next to each other from left to right, in rows from top to bottom, about as wide as high.
fn arrange(panels: Vec<Vec<Shape>>) -> Vec<Shape> {
    let sized: Vec<_> = panels
        .into_iter()
        .map(|shapes| (bounds(shapes.iter().filter_map(Shape::bounds).flatten()).unwrap_or_default(), shapes))
        .collect();
    let sizes = || sized.iter().map(|([low, high], _)| *high - *low + MARGIN);
    let area: f64 = sizes().map(|size| size.x * size.y).sum();
    let widest = sizes().map(|size| size.x).fold(area.sqrt(), f64::max);
    let (mut all, mut corner, mut row) = (Vec::new(), DVec2::ZERO, 0.0_f64);
    for ([low, high], shapes) in sized {
        let size = high - low + MARGIN;
        // Half a micrometre: rounding must not break a row of the widest alone.
        if corner.x + size.x > widest + 5e-4 {
            (corner, row) = (DVec2::new(0.0, corner.y - row), 0.0);
        }
        let by = corner - DVec2::new(low.x, high.y);
        all.extend(shapes.into_iter().map(|shape| shape.moved(by)));
        (corner.x, row) = (corner.x + size.x, row.max(size.y));
    }
    all
}

/// The bar of 50 mm and the scale of strains, downward from the origin.
fn legend(scale: f64) -> Vec<Shape> {
    let text = |layer, x: f64, y: f64, anchor, text: String| Shape::Text {
        layer,
        at: DVec2::new(x, y),
        height: TEXT,
        turn: 0.0,
        anchor,
        text,
    };
    let mut shapes = bar(DVec2::new(0.0, -TEXT));
    let (step, top, bottom) = (BAR / (f64::from(COLOURS) + 1.0), -3.0 * TEXT, -4.5 * TEXT);
    for k in 0..=COLOURS {
        let (left, right) = (f64::from(k) * step, f64::from(k + 1) * step);
        let points = [(left, bottom), (right, bottom), (right, top), (left, top)].map(DVec2::from).to_vec();
        shapes.push(Shape::Fill { points, colour: colour(k) });
    }
    let end = number(100.0 * scale, 0);
    let below = bottom - TEXT;
    shapes.push(text(Layer::Strain, 0.0, below, Anchor::Start, format!("-{end} %")));
    shapes.push(text(Layer::Strain, 0.5 * BAR, below, Anchor::Middle, "0".to_owned()));
    shapes.push(text(Layer::Strain, BAR, below, Anchor::End, format!("+{end} %")));
    let about = "strain of the sheet on the skin: + stretched, - compressed".to_owned();
    shapes.push(text(Layer::Strain, 0.0, below - 1.7 * TEXT, Anchor::Start, about));
    shapes
}

/// A bar of 50 mm to the right of a point, with its length.
pub(super) fn bar(at: DVec2) -> Vec<Shape> {
    let line = |from: [f64; 2], to: [f64; 2]| Shape::Polyline {
        layer: Layer::Text,
        points: [from, to].map(|p| at + DVec2::from(p)).to_vec(),
        is_closed: false,
    };
    let label = Shape::Text {
        layer: Layer::Text,
        at: at + DVec2::new(BAR + TEXT, 0.0),
        height: TEXT,
        turn: 0.0,
        anchor: Anchor::Start,
        text: format!("{BAR} mm"),
    };
    vec![line([0.0, 0.0], [BAR, 0.0]), line([0.0, -1.0], [0.0, 1.0]), line([BAR, -1.0], [BAR, 1.0]), label]
}
