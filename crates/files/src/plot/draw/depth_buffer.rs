//! Hidden surfaces: a depth buffer `(catmull1974)`, which finds the front face of each pixel.

use glam::{DVec2, DVec3};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, triangle_cross};

/// A pixel that no face covers.
const UNCOVERED: u32 = u32::MAX;

/// The face under the centre of each pixel that is nearest to the viewer; of several the one with
/// the smallest id.
///
/// Depths are not stored but computed from the planes of the faces, so that a picture takes four bytes a
/// pixel. Faces that intersect each other are shown correctly.
pub(crate) struct DepthBuffer {
    /// Upper left corner on the picture, and pixels of the buffer per pixel of the picture, in each
    /// direction.
    corner: DVec2,
    fineness: f64,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    faces: Vec<u32>,
    planes: IdVec<FaceId, Option<Plane>>,
}

impl DepthBuffer {
    /// Draws all faces; `places` are pixels of the picture to the right, down and towards the
    /// viewer. The buffer has its upper left corner at `corner`, `size` pixels and `fineness` of
    /// them for one of the picture in each direction.
    pub(crate) fn new(
        mesh: &TriMesh,
        places: &IdVec<VertexId, DVec3>,
        corner: DVec2,
        size: [usize; 2],
        fineness: f64,
    ) -> Self {
        let places = places.map(|p| fineness * (*p - corner.extend(0.0)));
        let planes = mesh.triangles.map(|t| Plane::new(t.map(|v| places[v])));
        let mut buffer = Self { corner, fineness, size, faces: vec![UNCOVERED; size[0] * size[1]], planes };
        for (face, t) in mesh.triangles.enumerate() {
            if let Some(plane) = buffer.planes[face] {
                buffer.draw(face, plane, t.map(|v| places[v].truncate()));
            }
        }
        buffer
    }

    /// Fills, row by row, the pixels whose centres lie between the face's edges.
    fn draw(&mut self, face: FaceId, plane: Plane, corners: [DVec2; 3]) {
        let ([width, height], [a, b, c]) = (self.size, corners);
        let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        for row in first_centre(top, height)..first_centre(bottom, height) {
            let y = row as f64 + 0.5;
            let (left, right) = span(corners, y);
            for column in first_centre(left, width)..first_centre(right, width) {
                let at = DVec2::new(column as f64 + 0.5, y);
                let pixel = &mut self.faces[row * width + column];
                let nearest = (*pixel != UNCOVERED).then(|| self.planes[FaceId::from(*pixel)]).flatten();
                if nearest.is_none_or(|nearest| nearest.at(at) < plane.at(at)) {
                    *pixel = face.raw();
                }
            }
        }
    }

    /// The face that each pixel shows and the pixel's centre on the picture, row by row.
    pub(crate) fn pixels(&self) -> impl Iterator<Item = (Option<FaceId>, DVec2)> {
        let width = self.size[0].max(1);
        self.faces.iter().enumerate().map(move |(k, &face)| {
            let centre = DVec2::new((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
            ((face != UNCOVERED).then(|| FaceId::from(face)), self.corner + centre / self.fineness)
        })
    }

    /// Whether no face is more than `slack` pixels of the picture in front of a point.
    pub(crate) fn shows(&self, place: DVec3, slack: f64) -> bool {
        let place = self.fineness * (place - self.corner.extend(0.0));
        #[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
        let [column, row] = [place.x as usize, place.y as usize];
        let face = self.faces.get(row.saturating_mul(self.size[0]).saturating_add(column));
        let face = face.filter(|&&face| column < self.size[0] && face != UNCOVERED);
        let front = face.and_then(|&face| self.planes[FaceId::from(face)]);
        front.is_none_or(|front| front.at(place.truncate()) <= place.z + self.fineness * slack)
    }
}

/// Depth of the plane of a face towards the viewer, as a function of the position.
#[derive(Debug, Clone, Copy)]
struct Plane {
    through: DVec3,
    slope: DVec2,
}

impl Plane {
    /// `None` if the face is edge-on.
    fn new(corners: [DVec3; 3]) -> Option<Self> {
        let normal = triangle_cross(corners);
        let slope = -normal.truncate() / normal.z;
        slope.is_finite().then_some(Self { through: corners[0], slope })
    }

    fn at(&self, place: DVec2) -> f64 {
        self.through.z + self.slope.dot(place - self.through.truncate())
    }
}

/// The first of `count` pixels whose centre is not before `x`; `count` if there is none.
fn first_centre(x: f64, count: usize) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
    let first = (x - 0.5).ceil().max(0.0) as usize;
    first.min(count)
}

/// The crossings of the edges of a triangle with a row; they are the same for faces that share an edge.
fn span([a, b, c]: [DVec2; 3], y: f64) -> (f64, f64) {
    let mut span = (f64::INFINITY, f64::NEG_INFINITY);
    for (p, q) in [(a, b), (b, c), (c, a)] {
        let (p, q) = if (p.y, p.x) <= (q.y, q.x) { (p, q) } else { (q, p) };
        if p.y <= y && y < q.y {
            let x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
            span = (span.0.min(x), span.1.max(x));
        }
    }
    span
}

#[cfg(test)]
mod tests {
    use crate::mesh::shapes;

    use super::*;

    fn buffer_of(mesh: &TriMesh, places: &IdVec<VertexId, DVec3>, size: [usize; 2]) -> DepthBuffer {
        DepthBuffer::new(mesh, places, DVec2::ZERO, size, 1.0)
    }

    fn face_at(buffer: &DepthBuffer, column: usize, row: usize) -> Option<usize> {
        Some(buffer.pixels().nth(row * buffer.size[0] + column)?.0?.index())
    }

    /// Two triangles that overlap, the second nearer on the left and farther on the right: they intersect
    /// each other.
    #[test]
    fn the_nearer_face_is_shown_pixel_by_pixel() {
        let mesh = TriMesh::from_arrays(vec![DVec3::ZERO; 6], &[[0, 1, 2], [3, 4, 5]]);
        let flat = [(0.0, 0.0, 0.0), (20.0, 0.0, 0.0), (10.0, 20.0, 0.0)];
        let tilted = [(0.0, 0.0, 5.0), (20.0, 0.0, -5.0), (10.0, 20.0, 0.0)];
        let places = flat.iter().chain(&tilted).map(|&p| DVec3::from(p)).collect();
        let buffer = buffer_of(&mesh, &places, [20, 20]);
        assert_eq!(face_at(&buffer, 5, 2), Some(1));
        assert_eq!(face_at(&buffer, 14, 2), Some(0));
        assert_eq!(face_at(&buffer, 0, 19), None);
        assert!(buffer.shows(DVec3::new(14.5, 2.5, 0.0), 1e-9), "on the nearest face");
        assert!(!buffer.shows(DVec3::new(5.5, 2.5, 0.0), 1e-9), "behind the tilted face");
    }

    /// A buffer twice as fine shows the same at the same positions.
    #[test]
    fn positions_are_those_of_the_picture() {
        let mesh = shapes::triangle();
        let corner = DVec2::new(100.0, 50.0);
        let at = |x: f64, y: f64| DVec3::new(100.0 + x, 50.0 + y, 3.0);
        let places = vec![at(0.0, 0.0), at(8.0, 0.0), at(0.0, 8.0)].into();
        let buffer = DepthBuffer::new(&mesh, &places, corner, [20, 20], 2.0);
        for (face, centre) in buffer.pixels() {
            let inside = (centre - corner).element_sum() < 8.0;
            assert_eq!(face.is_some(), inside, "{centre}");
        }
        assert!(!buffer.shows(at(2.0, 2.0) - DVec3::Z, 0.9) && buffer.shows(at(2.0, 2.0) - DVec3::Z, 1.1));
    }

    /// Every pixel belongs to exactly one of neighbouring faces.
    #[test]
    fn a_sheet_covers_what_its_outline_encloses() {
        let mesh = shapes::lattice(7, 9, 1.0);
        let places: IdVec<_, _> = mesh.positions.map(|p| (5.3 * *p).with_z(0.0));
        let buffer = buffer_of(&mesh, &places, [60, 60]);
        let covered = buffer.faces.iter().filter(|&&f| f != UNCOVERED).count();
        let alone: usize = mesh
            .triangles
            .iter()
            .map(|&t| {
                let one = TriMesh { positions: mesh.positions.clone(), triangles: vec![t].into() };
                let alone = buffer_of(&one, &places, [60, 60]);
                alone.faces.iter().filter(|&&f| f != UNCOVERED).count()
            })
            .sum();
        assert_eq!(covered, alone, "each pixel once");
        assert!((covered as f64 / (5.3 * 5.3 * mesh.area()) - 1.0).abs() < 0.01, "{covered} pixels");
    }

    #[test]
    fn faces_without_extent_are_ignored() {
        for corners in [
            [DVec3::ZERO; 3],
            [DVec3::X, DVec3::Y, DVec3::NAN],
            [DVec3::X * 1e300; 3],
            [DVec3::NEG_INFINITY, DVec3::X, DVec3::Y],
        ] {
            let buffer = buffer_of(&shapes::triangle(), &corners.to_vec().into(), [4, 4]);
            assert!(buffer.pixels().all(|(face, _)| face.is_none()), "{corners:?}");
            assert!(corners.iter().all(|&corner| buffer.shows(corner, 0.0)), "{corners:?}");
        }
    }
}
