//! Turns the components of a new mesh outward.
//!
//! *Heuristic*: normals of the file by majority, else away from the centre of the sheet, as the
//! skin of a limb faces.

use glam::{DMat3, DVec3};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{face_components, triangle_cross};

/// Smallest decisive mean cosine between the faces and the directions away from a centre: it is
/// 0 on a flat component and on a saddle, and 0.06 on a cap of 20 degrees across.
const MIN_DECISIVE: f64 = 0.02;

/// The file's normals determine the outside of a component if this share of them points to one side of its
/// faces.
const MAJORITY: f64 = 2.0 / 3.0;

/// How the outside of the components was determined.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Outside {
    /// Components that face away from the centre.
    pub centre: usize,
    /// Components that bulge to neither side; they are turned so that the largest coordinate of their vector
    /// area in the world is positive.
    pub arbitrary: usize,
    /// Normals of the file that point to the other side than most of their component.
    pub opposed: usize,
    /// Normals of the file.
    pub normals: usize,
}

/// The frame of the world, in which the outside may be given.
#[derive(Debug, Clone, Copy)]
pub(super) struct World {
    /// The direction of the outside, if it is given.
    pub outside: Option<DVec3>,
    /// Turns directions of the sheet into those of the world.
    pub turn: DMat3,
}

/// Sums over the faces of one component; areas are doubled.
#[derive(Debug, Clone, Default)]
struct Component {
    area: f64,
    /// Area times centroid.
    moment: DVec3,
    direction: DVec3,
    /// Normals of the file that point out of its faces, and into them.
    out: usize,
    inward: usize,
    /// Sum of area times cosine with the direction away from the centre of the sheet.
    from_sheet: f64,
    /// Sum of area times cosine with the direction away from its own centre.
    from_own: f64,
}

impl Component {
    fn centre(&self) -> DVec3 {
        self.moment / self.area
    }

    /// Whether its faces point inwards; counts in `outside` how this was determined.
    fn is_inside_out(&self, world: World, outside: &mut Outside) -> bool {
        let normals = self.out + self.inward;
        outside.normals += normals;
        outside.opposed += self.out.min(self.inward);
        if normals > 0 && self.out.max(self.inward) as f64 >= MAJORITY * normals as f64 {
            return self.inward > self.out;
        }
        let faces = world.turn * self.direction;
        if let Some(along) = world.outside.map(|given| given.dot(faces)).filter(|along| along.abs() > 0.0) {
            return along < 0.0;
        }
        let away = [self.from_sheet, self.from_own].map(|away| away / self.area);
        if let Some(away) = away.into_iter().find(|away| away.abs() >= MIN_DECISIVE) {
            outside.centre += 1;
            return away < 0.0;
        }
        outside.arbitrary += 1;
        let larger = |a: f64, b: f64| if b.abs() > a.abs() { b } else { a };
        faces.to_array().into_iter().fold(0.0, larger) < 0.0
    }
}

/// Turns over the components that are inside out, by the first rule that decides:
///
/// 1. two thirds of the file's normals point outward;
/// 2. the vector area points along the outside that is given in the world, if there is one;
/// 3. faces point away from the centre of the sheet;
/// 4. faces point away from the centre of the component;
/// 5. the vector area points to the positive side of its main axis in the world.
pub(super) fn orient_outward(
    triangles: &mut IdVec<FaceId, [VertexId; 3]>,
    positions: &IdVec<VertexId, DVec3>,
    file: &IdVec<VertexId, DVec3>,
    world: World,
) -> Outside {
    let pieces = face_components(triangles, positions.len());
    let mut components = vec![Component::default(); pieces.count];
    let mut sheet = Component::default();
    // Twice the vector area, and the centroid.
    let face = |t: &[VertexId; 3]| {
        let [a, b, c] = t.map(|v| positions[v]);
        (triangle_cross([a, b, c]), (a + b + c) / 3.0)
    };
    let mut taxels: IdVec<VertexId, (DVec3, Option<usize>)> =
        IdVec::filled((DVec3::ZERO, None), positions.len());
    for (f, t) in triangles.enumerate() {
        let (cross, middle) = face(t);
        for &v in t {
            taxels[v] = (taxels[v].0 + cross, Some(pieces.of[f]));
        }
        for component in [&mut components[pieces.of[f]], &mut sheet] {
            component.area += cross.length();
            component.moment += cross.length() * middle;
            component.direction += cross;
        }
    }
    for (f, t) in triangles.enumerate() {
        let (cross, middle) = face(t);
        let component = &mut components[pieces.of[f]];
        component.from_sheet += cross.dot((middle - sheet.centre()).normalize_or_zero());
        component.from_own += cross.dot((middle - component.centre()).normalize_or_zero());
    }
    for (&(cross, component), n) in taxels.iter().zip(file).filter(|(_, n)| **n != DVec3::ZERO) {
        if let Some(component) = component {
            let is_inward = cross.dot(*n) < 0.0;
            components[component].inward += usize::from(is_inward);
            components[component].out += usize::from(!is_inward);
        }
    }
    let mut outside = Outside::default();
    let turn: Vec<bool> =
        components.iter().map(|component| component.is_inside_out(world, &mut outside)).collect();
    for (t, &component) in triangles.iter_mut().zip(&pieces.of) {
        if turn[component] {
            t.swap(1, 2);
        }
    }
    outside
}
