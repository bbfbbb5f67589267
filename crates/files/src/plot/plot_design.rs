//! Pictures of designed skins: modules in space from two sides, coloured by chain, next to their strips.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec2, DVec3};

use crate::design::{Design, Module, Plate, Strip, strips};
use crate::mesh::{TriMesh, rectangle_around};
use crate::plot::colour::{Colour, INK, SKIN};
use crate::plot::draw::Camera;
use crate::plot::layout::printable;
use crate::plot::picture::{Anchor, MAX_SIDE, Path, Picture, Shape, Stroke};
use crate::plot::{PlotError, Viewpoint};

/// A patch and the modules on it.
#[derive(Debug, Clone, Copy)]
pub struct DesignedPatch<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its surface.
    pub mesh: &'a TriMesh,
    /// The frame of the surface in the world.
    pub pose: DAffine3,
    /// The modules.
    pub design: &'a Design,
}

/// Width of the picture and of a view, room between them, and height of letters, in pixels.
const WIDTH: u32 = 1600;
const VIEW: f64 = 380.0;
const ROOM: f64 = 24.0;
const EM: f64 = 15.0;

/// Draws the modules of each patch in space, from outside and from the other side, and its chains unrolled, all in the colours
/// of the chains.
///
/// # Errors
/// If there is no patch, or the picture would be higher than 16384 pixels.
pub fn plot_design(patches: &[DesignedPatch<'_>], module: &Module) -> Result<Picture, PlotError> {
    if patches.is_empty() {
        return Err(PlotError::Empty);
    }
    let mut groups = Vec::new();
    let mut top = ROOM;
    for patch in patches {
        let (shapes, height) = row(patch, module, top);
        groups.push(shapes);
        top += height + ROOM;
    }
    let (width, height, least) = (WIDTH, top.ceil(), 1);
    if height > f64::from(MAX_SIDE) {
        return Err(PlotError::Size { width, height: MAX_SIDE + 1, least, most: MAX_SIDE });
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked just above")]
    let size_px = [WIDTH, height as u32];
    Ok(Picture { title: "modules of a designed skin".into(), size_px, em: EM, groups })
}

/// The colours of chains: around the wheel in steps of the golden section, so that neighbours differ.
fn colour(chain: usize) -> Colour {
    let hue = (chain as f64 * 0.618_034).fract();
    let tone = |k: f64| {
        let wave = 0.5 + 0.5 * (TAU * (hue + k / 3.0)).cos();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 110 to 240")]
        let tone = (110.0 + 130.0 * wave).round() as u8;
        tone
    };
    Colour(tone(0.0), tone(1.0), tone(2.0))
}

const LINE: Stroke = Stroke { colour: INK, width: 0.8, opacity: 1.0 };

/// One patch; with its height in pixels.
fn row(patch: &DesignedPatch<'_>, module: &Module, top: f64) -> (Vec<Shape>, f64) {
    let design = patch.design;
    let name = printable(patch.name);
    let title = format!("{name}: {} modules, {} chains", design.modules.len(), design.chains.len());
    let at = DVec2::new(ROOM, top + EM);
    let mut shapes = vec![Shape::Text { text: title, at, anchor: Anchor::Start, is_bold: true }];
    let camera = Camera::new(Viewpoint::Outside, patch.mesh, patch.pose, &[]);
    let bounds = rectangle_around(patch.mesh.positions.iter().map(|p| camera.project(*p)));
    let size = bounds.1 - bounds.0;
    let scale = VIEW / size.max_element().max(1e-9);
    let below = top + 2.0 * EM;
    let middle = module.centre();
    let shows = |side: &f64| design.modules.iter().any(|m| camera.sees(m.plate.normal(middle) * *side));
    let sides: Vec<f64> = [1.0, -1.0].into_iter().filter(shows).collect();
    for (k, &side) in sides.iter().enumerate() {
        let corner = DVec2::new(ROOM + k as f64 * (VIEW + ROOM), below);
        let place = |p: DVec3| {
            let at = camera.project(p);
            let x = if side > 0.0 { at.x - bounds.0.x } else { bounds.1.x - at.x };
            corner + DVec2::new(x, bounds.1.y - at.y) * scale
        };
        draw_side(&mut shapes, patch, module, &camera, side, &place);
    }
    let corner = DVec2::new(ROOM + sides.len() as f64 * (VIEW + ROOM), below);
    let strips = draw_strips(&mut shapes, &strips(design, module), module, corner, scale);
    (shapes, 2.0 * EM + strips.max(size.y * scale))
}

/// The surface from one side, then its modules, the farthest first.
fn draw_side(
    shapes: &mut Vec<Shape>,
    patch: &DesignedPatch<'_>,
    module: &Module,
    camera: &Camera,
    side: f64,
    place: &dyn Fn(DVec3) -> DVec2,
) {
    let mesh = patch.mesh;
    let mut faces = Path::default();
    for face in mesh.triangles.ids().filter(|&face| camera.sees(mesh.face_cross(face) * side)) {
        faces.polygon(mesh.corners(face).map(place));
    }
    // Faces of one surface have no lines between them.
    let stroke = Some(Stroke { colour: SKIN, width: 0.5, opacity: 1.0 });
    shapes.push(Shape::Path { path: faces, fill: Some(SKIN), stroke });
    let (rim, _) = module.rim();
    let middle = module.centre();
    let mut modules: Vec<(f64, usize, &Plate)> = Vec::new();
    for (number, chain) in patch.design.chains.iter().enumerate() {
        let plates = chain.modules.iter().map(|&m| &patch.design.modules[m].plate);
        let seen = plates.filter(|plate| camera.sees(plate.normal(middle) * side));
        modules.extend(seen.map(|plate| (side * camera.nearness(plate.point(middle)), number, plate)));
    }
    modules.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, chain, plate) in modules {
        let mut path = Path::default();
        path.polygon(rim.iter().map(|&at| place(plate.point(at))));
        shapes.push(Shape::Path { path, fill: Some(colour(chain)), stroke: Some(LINE) });
    }
}

/// The strips one below the other, in as many columns as fit; returns their height in pixels.
fn draw_strips(shapes: &mut Vec<Shape>, strips: &[Strip], module: &Module, corner: DVec2, scale: f64) -> f64 {
    let width = f64::from(WIDTH) - ROOM - corner.x;
    let corners = |strip: &Strip| -> Vec<DVec2> {
        let of = |place: &glam::DAffine2| {
            module.outline.iter().map(|p| place.transform_point2(*p)).collect::<Vec<_>>()
        };
        strip.modules.iter().flat_map(|(_, place)| of(place)).collect()
    };
    let boxes: Vec<(DVec2, DVec2)> =
        strips.iter().map(|strip| rectangle_around(corners(strip).into_iter())).collect();
    let widest = boxes.iter().map(|(low, high)| high.x - low.x).fold(1e-9, f64::max);
    let scale = scale.min((width - 3.0 * EM) / widest);
    let (mut at, mut height) = (DVec2::ZERO, 0.0_f64);
    for (strip, (low, high)) in strips.iter().zip(boxes) {
        let size = (high - low) * scale + DVec2::new(3.0 * EM, 0.0);
        if at.x + size.x > width && at.x > 0.0 {
            at = DVec2::new(0.0, at.y + height + 0.5 * EM);
            height = 0.0;
        }
        height = height.max(size.y);
        let origin = corner + at;
        let name = (strip.chain + 1).to_string();
        shapes.push(Shape::text(name, origin + DVec2::new(0.0, 0.5 * size.y + 0.3 * EM), Anchor::Start));
        let mut path = Path::default();
        for (_, place) in &strip.modules {
            let pixel = |p: &DVec2| {
                let q = place.transform_point2(*p);
                origin + DVec2::new(2.0 * EM + (q.x - low.x) * scale, (high.y - q.y) * scale)
            };
            path.polygon(module.outline.iter().map(pixel));
        }
        shapes.push(Shape::Path { path, fill: Some(colour(strip.chain)), stroke: Some(LINE) });
        at.x += size.x + EM;
    }
    at.y + height
}
