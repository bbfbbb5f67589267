//! Laws of the room `mesh`: who borders whom.

use std::collections::{BTreeMap, BTreeSet};

use crate::altered::renumbered;
use dermatome::id::{FaceId, IdVec, VertexId};
use dermatome::mesh::{Adjacency, MeshError, TriMesh, shapes};
use glam::DVec3;
use proptest::prelude::*;

fn named_shapes() -> Vec<(&'static str, TriMesh, i64, usize)> {
    vec![
        ("triangle", shapes::triangle(), 1, 1),
        ("square", shapes::square(), 1, 1),
        ("fan", shapes::fan(7), 1, 1),
        ("tetrahedron", shapes::tetrahedron(), 2, 0),
        ("lattice", shapes::lattice(5, 4, 0.01), 1, 1),
        ("tube", shapes::tube(8, 4, 1.0, 2.0), 0, 2),
        ("torus", shapes::torus(9, 7, 1.0, 0.3), 0, 0),
        ("cap", shapes::cap(200, 0.1, 1.0), 1, 1),
        ("saddle", shapes::saddle(9), 1, 1),
    ]
}

/// The sides of all faces: the face, its side, and the vertices that this runs from and to.
fn sides(mesh: &TriMesh) -> impl Iterator<Item = (FaceId, usize, [VertexId; 2])> {
    let of_face = |(f, t): (FaceId, &[VertexId; 3])| {
        let t = *t;
        (0..3).map(move |side| (f, side, [t[side], t[(side + 1) % 3]]))
    };
    mesh.triangles.enumerate().flat_map(of_face)
}

fn v(i: usize) -> VertexId {
    VertexId::new(i)
}

#[test]
fn an_element_is_found_under_the_id_its_push_returned() {
    let mut names = IdVec::<VertexId, &str>::default();
    let (a, b) = (names.push("a"), names.push("b"));
    assert_eq!((names[a], names[b]), ("a", "b"));
    assert_eq!(names.ids().collect::<Vec<_>>(), [a, b]);
    assert_eq!(format!("{a:?} {b}"), "v0 1", "debug names the kind, display the number");
}

#[test]
fn named_shapes_have_their_euler_characteristic_and_loops() {
    for (name, mesh, euler, loops) in named_shapes() {
        let adjacency = Adjacency::new(&mesh).unwrap();
        assert_eq!(adjacency.euler_characteristic(), euler, "{name}");
        assert_eq!(adjacency.boundary_loops().len(), loops, "{name}");
    }
}

#[test]
fn the_face_across_a_side_runs_along_it_the_other_way() {
    for (name, mesh, ..) in named_shapes() {
        let adjacency = Adjacency::new(&mesh).unwrap();
        let by_edge: BTreeMap<_, _> = sides(&mesh).map(|(face, _, edge)| (edge, face)).collect();
        for (face, side, [from, to]) in sides(&mesh) {
            let across = by_edge.get(&[to, from]).copied();
            assert_eq!(adjacency.neighbours(face)[side], across, "{name}: side {side} of {face}");
        }
    }
}

/// Every two consecutive entries of a ring make a face with its vertex, in this order; all faces
/// occur.
#[test]
fn rings_run_counter_clockwise_through_all_faces() {
    for (name, mesh, ..) in named_shapes() {
        let adjacency = Adjacency::new(&mesh).unwrap();
        let corners: BTreeSet<_> =
            mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]]).collect();
        let mut seen = 0;
        for v in mesh.positions.ids() {
            let ring = adjacency.ring(v);
            let pairs = if adjacency.is_boundary(v) { ring.len() - 1 } else { ring.len() };
            for i in 0..pairs {
                let face = [v, ring[i], ring[(i + 1) % ring.len()]];
                assert!(corners.contains(&face), "{name}: {face:?} is a face");
            }
            seen += pairs;
        }
        assert_eq!(seen, 3 * mesh.triangles.len(), "{name}: every corner once");
    }
}

#[test]
fn boundary_loops_follow_the_sides_without_a_neighbour() {
    for (name, mesh, ..) in named_shapes() {
        let adjacency = Adjacency::new(&mesh).unwrap();
        let open = sides(&mesh).filter(|&(face, side, _)| adjacency.neighbours(face)[side].is_none());
        let open: BTreeSet<_> = open.map(|(.., [from, to])| (from, to)).collect();
        let walked: BTreeSet<_> = adjacency
            .boundary_loops()
            .iter()
            .flat_map(|l| (0..l.len()).map(|i| (l[i], l[(i + 1) % l.len()])).collect::<Vec<_>>())
            .collect();
        assert_eq!(walked, open, "{name}");
        let loops = adjacency.boundary_loops();
        assert!(loops.iter().all(|l| l.iter().min() == l.first()), "{name}: from the smallest vertex");
        assert!(loops.is_sorted_by_key(|l| l[0]), "{name}: in the order of these");
    }
}

/// Triangles that share a vertex alone, or a closed surface that touches one.
#[test]
fn fans_are_counted() {
    let p = DVec3::new;
    let touching = |n: u32| {
        let triangles: Vec<[u32; 3]> = (0..n).map(|k| [0, 1 + 2 * k, 2 + 2 * k]).collect();
        let positions = (0..=2 * n).map(|i| p(f64::from(i), f64::from(i * i), 0.0)).collect();
        Adjacency::new(&TriMesh::from_arrays(positions, &triangles)).unwrap_err()
    };
    for n in 2..6 {
        assert_eq!(touching(n), MeshError::NonManifoldVertex { vertex: v(0), fans: n as usize });
    }
    let mut closed = shapes::tetrahedron();
    let [a, b] = [closed.positions.push(p(2., 0., 0.)), closed.positions.push(p(2., 1., 0.))];
    closed.triangles.push([v(0), a, b]);
    assert_eq!(Adjacency::new(&closed), Err(MeshError::NonManifoldVertex { vertex: v(0), fans: 2 }));

    let (mut two, offset) = (shapes::tetrahedron(), 3);
    let other = shapes::tetrahedron();
    for &q in other.positions.iter().skip(1) {
        two.positions.push(q + DVec3::splat(9.0));
    }
    for t in &other.triangles {
        two.triangles.push(t.map(|w| if w == v(0) { w } else { v(w.index() + offset) }));
    }
    assert_eq!(Adjacency::new(&two), Err(MeshError::NonManifoldVertex { vertex: v(0), fans: 2 }));
    // Two open fans, by whose sums of neighbours they might be one closed fan.
    let bow = TriMesh::from_arrays(vec![DVec3::ZERO; 5], &[[0, 2, 1], [2, 3, 4]]);
    assert_eq!(Adjacency::new(&bow), Err(MeshError::NonManifoldVertex { vertex: v(2), fans: 2 }));
}

#[test]
fn edges_that_are_not_manifold_are_named() {
    let mut mesh = shapes::square();
    let top = mesh.positions.push(DVec3::Z);
    mesh.triangles.push([v(0), v(2), top]);
    let [from, to] = [v(0), v(2)];
    let [first, second] = [FaceId::new(1), FaceId::new(2)];
    assert_eq!(Adjacency::new(&mesh), Err(MeshError::NonManifoldEdge { from, to, first, second }));
    let mut mesh = shapes::square();
    mesh.triangles[first].swap(1, 2);
    assert!(matches!(Adjacency::new(&mesh), Err(MeshError::NonManifoldEdge { .. })), "wound both ways");
    let mut mesh = shapes::square();
    mesh.positions.push(DVec3::Z);
    assert_eq!(Adjacency::new(&mesh), Err(MeshError::IsolatedVertex { vertex: v(4) }));
}

/// The plain definition: every directed edge once, the faces around each vertex one chain.
fn is_manifold(mesh: &TriMesh) -> bool {
    let mut directed = BTreeMap::new();
    for (face, _, [from, to]) in sides(mesh) {
        if directed.insert((from, to), face).is_some() {
            return false;
        }
    }
    mesh.positions.ids().all(|v| {
        let star: Vec<FaceId> =
            mesh.triangles.enumerate().filter(|(_, t)| t.contains(&v)).map(|(f, _)| f).collect();
        let Some(&first) = star.first() else { return false };
        let mut reached = BTreeSet::from([first]);
        loop {
            let before = reached.len();
            for &face in &star {
                let touches = mesh.triangles[face].iter().filter(|&&w| w != v).any(|&w| {
                    [(v, w), (w, v)].iter().all(|edge| directed.contains_key(edge))
                        && [(v, w), (w, v)].iter().any(|edge| directed[edge] == face)
                        && [(v, w), (w, v)].iter().any(|edge| reached.contains(&directed[edge]))
                });
                if touches {
                    reached.insert(face);
                }
            }
            if reached.len() == before {
                break reached.len() == star.len();
            }
        }
    })
}

proptest! {
    #[test]
    fn any_triangles_have_neighbours_or_a_named_fault(
        triangles in prop::collection::vec([0_u32..6, 0..6, 0..6], 1..9),
    ) {
        let used: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
        let place = |v: &u32| u32::try_from(used.iter().position(|u| u == v).unwrap()).unwrap();
        let triangles: Vec<_> = triangles.iter().map(|t| t.each_ref().map(place)).collect();
        let mesh = TriMesh::from_arrays(vec![DVec3::ZERO; used.len()], &triangles);
        match Adjacency::new(&mesh) {
            Err(MeshError::RepeatedCorner { .. }) => {
                prop_assert!(triangles.iter().any(|[a, b, c]| a == b || b == c || c == a));
            }
            result => prop_assert_eq!(result.is_ok(), is_manifold(&mesh), "{:?}", result),
        }
    }

    /// The neighbours of a vertex do not depend on the numbers of the vertices.
    #[test]
    fn rings_follow_a_renumbering(keys in prop::collection::vec(any::<u32>(), 20)) {
        let mesh = shapes::lattice(5, 4, 1.0);
        let mut order: Vec<usize> = (0..20).collect();
        order.sort_by_key(|&i| keys[i]);
        let [before, after] = [&mesh, &renumbered(&mesh, &order)].map(|m| Adjacency::new(m).unwrap());
        for w in mesh.positions.ids() {
            let renamed: Vec<VertexId> = before.ring(w).iter().map(|n| v(order[n.index()])).collect();
            let now = after.ring(v(order[w.index()]));
            let turn = now.iter().position(|n| *n == renamed[0]).unwrap();
            let turned: Vec<VertexId> = (0..now.len()).map(|i| now[(i + turn) % now.len()]).collect();
            prop_assert_eq!(renamed, turned);
        }
    }
}
