//! Level 0 of one patch with its tree, in the frame of its link.

use glam::DVec3;

use super::{
    fit::Points,
    frame::Frame,
    lanes::{Kernel, LANES, Lanes, Simd},
    rounding::LARGEST,
    tree::{MAX_PRIMITIVES, Primitive, Tree, distinct},
    triangle8::{Framing, Triangle8},
};
use crate::{
    bvh::Aabb,
    contact::ContactError,
    id::{FaceId, IdVec, VertexId},
    mesh::{Closest, TriMesh, VertexCorners, closest_point},
};

#[derive(Debug, Clone)]
pub(crate) struct PatchBvh {
    pub(crate) mesh: TriMesh,
    pub(crate) corners: VertexCorners,
    pub(super) tree: Tree,
    /// One for each packet of the tree.
    pub(super) triangles: Vec<Triangle8>,
    pub(super) frame: Frame,
    pub(super) simd: Simd,
}

/// What moving the vertices of a patch takes besides its tree, so that nothing is allocated then.
#[derive(Debug, Clone, Default)]
pub(in crate::contact) struct Refitting {
    /// For each packet the corners of its faces side by side, which lie scattered in the mesh.
    corners: Vec<[[VertexId; LANES]; 3]>,
    /// Room for the vertices in the tree's units, since each belongs to some six faces. The search's
    /// slack includes their rounding.
    local: Vec<[f32; 4]>,
    /// Whether a vertex belongs to no face.
    has_loose: bool,
}

impl PatchBvh {
    /// # Errors
    /// If there is no face, or one too many, or if a coordinate is too large or not a number.
    pub(crate) fn new(patch: &str, mesh: &TriMesh) -> Result<Self, ContactError> {
        let faces = mesh.triangles.len();
        if faces > MAX_PRIMITIVES {
            let last = FaceId::new(MAX_PRIMITIVES - 1);
            return Err(ContactError::TooManyFaces { patch: patch.to_owned(), faces, last });
        }
        check(patch, &mesh.positions)?;
        if faces == 0 {
            return Err(ContactError::NoSkin);
        }
        let corners = VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len());
        let frame = Frame::around(used(&mesh.positions, &corners));
        let primitives: Vec<_> = mesh.triangles.ids().map(|f| primitive(mesh, &frame, f)).collect();
        let tree = Tree::new(&primitives);
        let triangles = vec![Triangle8::default(); tree.packets.len()];
        let mut patch = Self { mesh: mesh.clone(), corners, tree, triangles, frame, simd: Simd::detect() };
        patch.fit(&mut patch.refitting());
        Ok(patch)
    }

    /// What [`Self::refit`] takes.
    pub(in crate::contact) fn refitting(&self) -> Refitting {
        let corners = |packet: &[u32; LANES]| {
            let faces = packet.map(|face| self.mesh.triangles[FaceId::from(face)]);
            [0, 1, 2].map(|k| faces.map(|corners| corners[k]))
        };
        let corners = self.tree.packets.iter().map(corners).collect();
        let vertices = self.mesh.positions.len();
        let has_loose = (0..vertices).any(|v| self.corners.range(VertexId::new(v)).is_empty());
        Refitting { corners, local: Vec::with_capacity(vertices), has_loose }
    }

    /// Moves the vertices, one position (m, in the link's frame; finite, at most [`LARGEST`]) per vertex
    /// of the mesh, and fits the tree to them: the faces stay in the packets they are in, which is
    /// cheaper than a new tree, and as fast to search as long as neighbours stay neighbours. Leaves the
    /// old positions in `positions`. Nothing is allocated.
    pub(in crate::contact) fn refit(
        &mut self,
        positions: &mut IdVec<VertexId, DVec3>,
        refitting: &mut Refitting,
    ) {
        debug_assert_eq!(positions.len(), self.mesh.positions.len());
        std::mem::swap(&mut self.mesh.positions, positions);
        self.frame = if refitting.has_loose {
            Frame::around(used(&self.mesh.positions, &self.corners))
        } else {
            Frame::around(self.mesh.positions.iter().copied())
        };
        self.fit(refitting);
    }

    /// Fits the tree to the mesh.
    fn fit(&mut self, Refitting { corners, local, .. }: &mut Refitting) {
        let Self { mesh, tree, triangles, frame, simd, .. } = self;
        local.clear();
        local.extend(mesh.positions.iter().map(|p| frame.point(*p).extend(0.0).as_vec4().to_array()));
        tree.fit(*simd, |packet, _, points| {
            simd.run(Setting { corners: &corners[packet], local, points, triangles: &mut triangles[packet] })
        });
    }

    /// The faces of a packet, each once.
    pub(super) fn faces<'a>(&self, packet: &'a [u32; 8]) -> impl Iterator<Item = FaceId> + 'a {
        distinct(packet).map(FaceId::from)
    }

    /// The box of its faces, in m in the link's frame.
    pub(in crate::contact) fn bounds(&self) -> Aabb {
        self.frame.bounds
    }

    /// The nearest point of one face, measured on the vertices of the map.
    #[inline(always)]
    pub(crate) fn measure(&self, q: DVec3, face: FaceId) -> Closest {
        closest_point(q, self.mesh.corners(face), self.mesh.triangles[face])
    }
}

/// Sets the corners of the faces of a packet, and their triangles.
struct Setting<'a> {
    corners: &'a [[VertexId; LANES]; 3],
    local: &'a [[f32; 4]],
    points: &'a mut Points<3>,
    triangles: &'a mut Triangle8,
}

impl Kernel for Setting<'_> {
    type Output = DVec3;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> DVec3 {
        let Self { corners, local, points, triangles } = self;
        for k in 0..3 {
            let mut rows = [&[0.0; 4]; LANES];
            for lane in 0..LANES {
                rows[lane] = &local[corners[k][lane].index()];
            }
            let [x, y, z] = l.points(rows);
            points[k] = [l.store(x), l.store(y), l.store(z)];
        }
        Framing(points, triangles).run(l)
    }
}

fn primitive(mesh: &TriMesh, frame: &Frame, face: FaceId) -> Primitive {
    let [a, b, c] = mesh.corners(face).map(|p| frame.point(p));
    Primitive { centre: (a + b + c) / 3.0, area: (b - a).cross(c - a) }
}

/// The corners of all faces, each once.
fn used<'a>(
    positions: &'a IdVec<VertexId, DVec3>,
    corners: &'a VertexCorners,
) -> impl Iterator<Item = DVec3> + Clone + 'a {
    let vertices = (0..positions.len()).map(VertexId::new);
    vertices.filter(|&v| !corners.range(v).is_empty()).map(|v| positions[v])
}

/// Whether all coordinates are finite and small enough.
pub(in crate::contact) fn check(patch: &str, positions: &IdVec<VertexId, DVec3>) -> Result<(), ContactError> {
    // Also true for NaN.
    let far = |p: &DVec3| !(p.is_finite() && p.abs().max_element() <= LARGEST);
    let Some((vertex, position)) = positions.enumerate().find(|(_, p)| far(p)) else { return Ok(()) };
    Err(ContactError::TooLarge { patch: patch.to_owned(), vertex, position: position.to_array() })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        contact::{
            search::{Best, Search},
            soup,
        },
        mesh::shapes,
        skin::PatchId,
    };

    fn nearest(patch: &PatchBvh, q: DVec3) -> Option<(FaceId, Closest)> {
        let mut best: Option<Best> = None;
        Search::new(patch, PatchId::new(0), q).run(&mut best);
        best.map(|b| (b.face, b.closest))
    }

    /// A sheet rolled up: the tree of the sheet, fitted to the roll, answers as a tree of the roll.
    #[test]
    fn a_refitted_tree_answers_as_a_new_one() {
        let sheet = shapes::lattice(40, 30, 0.01);
        let rolled = TriMesh {
            positions: sheet.positions.map(|p| DVec3::new((8.0 * p.x).sin(), p.y + 7.0, (8.0 * p.x).cos())),
            ..sheet.clone()
        };
        let new = PatchBvh::new("roll", &rolled).unwrap();
        let mut fitted = PatchBvh::new("sheet", &sheet).unwrap();
        let (mut positions, mut refitting) = (rolled.positions.clone(), fitted.refitting());
        let allocated = allocation_counter::measure(|| fitted.refit(&mut positions, &mut refitting));
        assert_eq!(allocated.count_total, 0, "a refit allocates nothing");
        assert_eq!(positions, sheet.positions);
        for k in 0..500_u32 {
            let q = rolled.positions[VertexId::from(k)] * (1.0 + 0.01 * f64::from(k % 7)) - DVec3::X * 0.003;
            assert_eq!(nearest(&fitted, q), nearest(&new, q), "from {q}");
        }
    }

    proptest! {
        #![proptest_config(soup::fixed(100, 10))]

        /// However the triangles move, the answer is that of brute force; and moved back, that of
        /// before.
        #[test]
        fn a_refitted_tree_finds_the_nearest(
            before in prop::collection::vec(soup::triangle(), 70),
            after in prop::collection::vec(soup::triangle(), 70),
            size in prop_oneof![Just(1e-3), Just(1.0), Just(1e4)],
            directions in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 4),
        ) {
            let (before, mut after) = (soup::mesh(&before), soup::mesh(&after));
            after.positions = after.positions.map(|p| *p * size + DVec3::Y);
            let mut patch = PatchBvh::new("soup", &before).unwrap();
            let mut refitting = patch.refitting();
            for mesh in [&after, &before] {
                patch.refit(&mut mesh.positions.clone(), &mut refitting);
                for direction in &directions {
                    let q = mesh.positions[VertexId::new(0)] + DVec3::from(*direction) * size;
                    let each = mesh.triangles.ids().map(|f| (f, patch.measure(q, f)));
                    let first = |a: &(FaceId, Closest), b: &(FaceId, Closest)| {
                        a.1.squared.total_cmp(&b.1.squared).then(a.0.cmp(&b.0))
                    };
                    prop_assert_eq!(nearest(&patch, q), each.min_by(first), "from {}", q);
                }
            }
        }
    }
}
