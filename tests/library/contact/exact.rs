//! Laws of contact lookup: the answer is that of brute force, for any shape, pose, order and
//! number of threads.

use std::f64::consts::TAU;

use dermatome::contact::{ContactError, ContactIndex, Hit, Query};
use dermatome::id::{FaceId, IdVec, VertexId};
use dermatome::map::{MapLevel, PatchMap, SkinMap};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::{LevelId, Prolongation};
use dermatome::run::Run;
use dermatome::skin::{Link, LinkId, PatchId, Skin, TaxelId, world_pose};
use glam::{DAffine3, DVec3};
use proptest::prelude::*;

use super::{any_pose, distance_to, finest, posed, soup};

// ---- maps made by hand ----

fn level_of(mesh: TriMesh) -> MapLevel {
    let map = SkinMap::flat(mesh, 0.001);
    map.patches.into_iter().next().unwrap().levels.into_iter().next().unwrap()
}

fn patch_of(name: &str, link: usize, levels: Vec<MapLevel>) -> PatchMap {
    let map = SkinMap::flat(levels[0].level.mesh.clone(), 0.001);
    let mut taxels = map.patches.into_iter().next().unwrap().taxels;
    taxels.ids = taxels.ids.ids().map(|v| TaxelId(1000 + v.raw())).collect();
    PatchMap {
        name: name.into(),
        link: LinkId::new(link),
        filled: 0,
        taxels,
        levels: levels.into(),
        atlas: None,
    }
}

fn link_of(name: &str, parent: Option<usize>, pose: DAffine3) -> Link {
    Link { name: name.into(), parent: parent.map(LinkId::new), pose }
}

/// One patch with one level on one link at the origin.
fn map_of(mesh: TriMesh) -> SkinMap {
    let links = vec![link_of("base", None, DAffine3::IDENTITY)].into();
    SkinMap { links, patches: vec![patch_of("skin", 0, vec![level_of(mesh)])].into(), ..SkinMap::default() }
}

/// The unit square in two triangles as the coarse level, its midpoint subdivision (nine vertices,
/// eight faces) as the fine one. Fine vertices 0 to 3 are the coarse ones.
fn square_and_its_midpoints() -> SkinMap {
    let coarse = shapes::square();
    let mut positions = coarse.positions.clone();
    let mut rows: Vec<([u32; 3], [f64; 3])> = (0..4).map(|v| ([v, v, v], [1.0, 0.0, 0.0])).collect();
    for (a, b) in [(0_u32, 1_u32), (1, 2), (0, 2), (2, 3), (0, 3)] {
        let at = |v: u32| coarse.positions[VertexId::from(v)];
        positions.push(at(a).midpoint(at(b)));
        rows.push(([a, b, b], [0.5, 0.5, 0.0]));
    }
    let triangles = [[0, 4, 6], [4, 1, 5], [4, 5, 6], [6, 5, 2], [0, 6, 8], [6, 7, 8], [6, 2, 7], [8, 7, 3]];
    let fine = TriMesh::from_arrays(positions.into(), &triangles);
    let to_finest = Prolongation {
        indices: rows.iter().map(|(i, _)| i.map(VertexId::from)).collect(),
        weights: rows.iter().map(|(_, w)| *w).collect(),
        coarse_len: 4,
    };
    let mut levels = vec![level_of(fine), level_of(coarse)];
    levels[0].level.from_coarser = Some(to_finest.clone());
    levels[1].level.to_finest = Some(to_finest);
    SkinMap {
        links: vec![link_of("base", None, DAffine3::IDENTITY)].into(),
        patches: vec![patch_of("square", 0, levels)].into(),
        ..SkinMap::default()
    }
}

// ---- brute force ----

/// The nearest distance on level 0 of those patches that `contact` may touch, in m.
fn brute(map: &SkinMap, poses: &IdVec<LinkId, DAffine3>, contact: &Query) -> f64 {
    let touched = map.patches.enumerate().filter(|(_, p)| contact.link.is_none_or(|link| link == p.link));
    let distances = touched.map(|(id, patch)| {
        let point = match contact.link {
            Some(_) => contact.point,
            None => poses[patch.link].inverse().transform_point3(contact.point),
        };
        distance_to(finest(map, id.index()), point)
    });
    distances.fold(f64::INFINITY, f64::min)
}

fn own_poses(map: &SkinMap) -> IdVec<LinkId, DAffine3> {
    map.links.ids().map(|link| world_pose(&map.links, link)).collect()
}

/// The distance is that of brute force, and the hit lies where it says, within `tolerance` metres.
fn assert_exact(map: &SkinMap, index: &ContactIndex, contact: &Query, tolerance: f64) -> Hit {
    let hit = index.locate(*contact).unwrap();
    let expected = brute(map, &index.poses(), contact);
    let found = hit.distance.abs();
    assert!((found - expected).abs() <= tolerance, "{contact:?}: found {found}, brute force {expected}");
    let away = contact.point.distance(hit.position);
    assert!((away - found).abs() <= tolerance, "{contact:?}: the hit is {away} away, not {found}");
    let mesh = &map.patches[hit.patch].levels[LevelId::new(0)].level.mesh;
    let [a, b, c] = hit.point.barycentric;
    assert!(a >= 0.0 && b >= 0.0 && c >= 0.0 && (a + b + c - 1.0).abs() < 1e-12, "{:?}", hit.point);
    let local = mesh.point(&hit.point);
    let pose =
        if contact.link.is_some() { DAffine3::IDENTITY } else { index.poses()[map.patches[hit.patch].link] };
    assert!(pose.transform_point3(local).distance(hit.position) <= tolerance, "position of {:?}", hit.point);
    hit
}

fn any_shape() -> impl Strategy<Value = TriMesh> {
    prop_oneof![
        Just(shapes::triangle()),
        Just(shapes::square()),
        Just(shapes::tetrahedron()),
        (3_u32..9).prop_map(shapes::fan),
        (2_u32..12, 2_u32..12).prop_map(|(i, j)| shapes::lattice(i, j, 0.01)),
        (3_u32..12, 2_u32..12).prop_map(|(i, j)| shapes::tube(i, j, 0.05, 0.2)),
        (20_usize..2000).prop_map(|n| shapes::cap(n, 0.1, 1.9)),
        (3_u32..30).prop_map(shapes::saddle),
        scattered(),
    ]
}

/// Triangles without any order, slivers and needles among them.
fn scattered() -> impl Strategy<Value = TriMesh> {
    prop::collection::vec(soup::triangle(), 1..60).prop_map(|triangles| {
        let corners: Vec<_> =
            (0_u32..).take(triangles.len()).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        TriMesh::from_arrays(triangles.into_flattened(), &corners)
    })
}

/// A contact relative to a mesh: near a face, on it, at a corner, on a side, at the centre of the
/// box, far away.
#[derive(Debug, Clone)]
enum Aim {
    Near([f64; 3], f64, prop::sample::Index),
    Corner(prop::sample::Index),
    Side(prop::sample::Index, f64),
    Above(prop::sample::Index, f64),
    Centre,
    Anywhere([f64; 3]),
    Far([f64; 3]),
}

fn any_aim() -> impl Strategy<Value = Aim> {
    let unit = || prop::array::uniform3(-1.0_f64..1.0);
    let index = any::<prop::sample::Index>;
    prop_oneof![
        4 => (unit(), 0.0_f64..0.05, index()).prop_map(|(d, h, f)| Aim::Near(d, h, f)),
        2 => index().prop_map(Aim::Corner),
        2 => (index(), 0.0_f64..1.0).prop_map(|(f, t)| Aim::Side(f, t)),
        2 => (index(), -0.1_f64..0.1).prop_map(|(f, h)| Aim::Above(f, h)),
        1 => Just(Aim::Centre),
        2 => unit().prop_map(Aim::Anywhere),
        1 => unit().prop_map(Aim::Far),
    ]
}

impl Aim {
    /// The point aimed at, and by how many sizes of the mesh it is off.
    fn at(&self, mesh: &TriMesh) -> DVec3 {
        let places = || mesh.positions.iter().copied();
        let (lo, hi) = (places().reduce(DVec3::min).unwrap(), places().reduce(DVec3::max).unwrap());
        let size = (hi - lo).max_element();
        let face = |f: &prop::sample::Index| FaceId::new(f.index(mesh.triangles.len()));
        match self {
            Self::Near(offset, height, f) => {
                let [a, b, c] = mesh.corners(face(f));
                (a + b + c) / 3.0 + DVec3::from(*offset) * *height * size
            }
            Self::Corner(f) => mesh.corners(face(f))[0],
            Self::Side(f, t) => mesh.corners(face(f))[1].lerp(mesh.corners(face(f))[2], *t),
            Self::Above(f, height) => {
                let [a, b, _] = mesh.corners(face(f));
                a.midpoint(b) + mesh.face_cross(face(f)).normalize_or_zero() * *height * size
            }
            Self::Centre => lo.midpoint(hi),
            Self::Anywhere(p) => lo.midpoint(hi) + DVec3::from(*p) * size,
            Self::Far(p) => lo.midpoint(hi) + DVec3::from(*p) * 10.0,
        }
    }
}

/// Three links in a chain, five patches, two of them on the second link and none on the first.
fn robot(shapes: [TriMesh; 4], poses: [DAffine3; 3]) -> SkinMap {
    let names = ["base", "arm", "hand"];
    let links = (0..3).map(|k| link_of(names[k], k.checked_sub(1), poses[k])).collect();
    let homes = [1, 2, 1, 2];
    let patches = shapes.into_iter().enumerate();
    let patches =
        patches.map(|(k, mesh)| patch_of(&format!("patch {k}"), homes[k], vec![level_of(mesh)])).collect();
    SkinMap { links, patches, ..SkinMap::default() }
}

// ---- exactness ----

proptest! {
    #![proptest_config(soup::fixed(300, 6))]

    #[test]
    fn a_contact_is_where_brute_force_finds_it(
        mesh in any_shape(),
        aims in prop::collection::vec(any_aim(), 1..20),
    ) {
        let map = map_of(mesh.clone());
        let index = ContactIndex::new(&map).unwrap();
        for aim in aims {
            assert_exact(&map, &index, &Query::from(aim.at(&mesh)), 1e-9);
        }
    }

    /// Millimetres or kilometres: the rounding grows with the shape and nothing else.
    #[test]
    fn any_scale_and_place_is_exact(
        mesh in any_shape(),
        aims in prop::collection::vec(any_aim(), 1..10),
        exponent in -9_i32..=6,
        offset in prop::array::uniform3(-1000.0_f64..1000.0),
    ) {
        let scale = 10_f64.powi(exponent);
        let mut moved = mesh.clone();
        for p in moved.positions.iter_mut() {
            *p = *p * scale + DVec3::from(offset);
        }
        let map = map_of(moved.clone());
        let index = ContactIndex::new(&map).unwrap();
        for aim in aims {
            let contact = Query::from(aim.at(&moved));
            assert_exact(&map, &index, &contact, 1e-9 * scale.max(1.0));
        }
    }

    #[test]
    fn posed_links_are_exact_in_the_world_and_in_their_frames(
        shapes in [any_shape(), any_shape(), any_shape(), any_shape()],
        poses in [any_pose(3.0), any_pose(3.0), any_pose(3.0)],
        moved in [any_pose(3.0), any_pose(3.0), any_pose(3.0)],
        aims in prop::collection::vec((any_aim(), 0..4_usize), 1..12),
    ) {
        let map = robot(shapes, poses);
        let mut index = ContactIndex::new(&map).unwrap();
        for round in 0..2 {
            for (aim, patch) in &aims {
                let patch = &map.patches[PatchId::new(*patch)];
                let local = aim.at(&patch.levels[LevelId::new(0)].level.mesh);
                let world = index.poses()[patch.link].transform_point3(local);
                assert_exact(&map, &index, &Query::from(world), 1e-9);
                let hit = assert_exact(&map, &index, &Query::on_link(patch.link, local), 1e-9);
                prop_assert_eq!(map.patches[hit.patch].link, patch.link);
                // The frame is that of a link, and the skin that of any.
                let exact = index.locate(world).unwrap();
                for (link, pose) in index.poses().enumerate() {
                    let back = pose.inverse();
                    let hit = index.locate(Query::in_link(link, back.transform_point3(world))).unwrap();
                    prop_assert!((hit.distance.abs() - exact.distance.abs()).abs() < 1e-9);
                    let found = &map.patches[hit.patch];
                    let local = found.levels[LevelId::new(0)].level.mesh.point(&hit.point);
                    let on_skin = back.transform_point3(index.poses()[found.link].transform_point3(local));
                    prop_assert!(hit.position.distance(on_skin) < 1e-9);
                }
            }
            if round == 0 {
                for (own, given) in index.poses().iter().zip(&own_poses(&map)) {
                    prop_assert!(own.abs_diff_eq(*given, 1e-12), "poses of the map are the start");
                }
                index.set_motion(&posed([0, 1, 2].map(|k| (LinkId::new(k), moved[k]))), 0.0).unwrap();
            }
        }
    }

    #[test]
    fn a_batch_and_single_contacts_agree_in_every_bit(
        shapes in [any_shape(), any_shape(), any_shape(), any_shape()],
        poses in [any_pose(3.0), any_pose(3.0), any_pose(3.0)],
        aims in prop::collection::vec((any_aim(), 0..4_usize, prop::bool::ANY), 1..600),
    ) {
        let map = robot(shapes, poses);
        let index = ContactIndex::new(&map).unwrap();
        let contacts: Vec<Query> = aims.iter().map(|(aim, patch, local)| {
            let patch = &map.patches[PatchId::new(*patch)];
            let at = aim.at(&patch.levels[LevelId::new(0)].level.mesh);
            if *local {
                Query::on_link(patch.link, at)
            } else {
                Query::from(index.poses()[patch.link].transform_point3(at))
            }
        }).collect();
        let single: Vec<Hit> = contacts.iter().map(|c| index.locate(*c).unwrap()).collect();
        let all = index.locate_all(&contacts, Run::default()).unwrap();
        prop_assert!(all.iter().eq(single.iter().copied()));
        prop_assert_eq!(all.get(single.len()), None);
        let backwards: Vec<Query> = contacts.iter().rev().copied().collect();
        let mut hits: Vec<Hit> = index.locate_all(&backwards, Run::default()).unwrap().iter().collect();
        hits.reverse();
        prop_assert_eq!(&hits, &single, "the order of the contacts does not matter");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        prop_assert_eq!(pool.install(|| index.locate_all(&contacts, Run::default())).unwrap(), all, "one thread");
    }
}

// ---- ties, hostile shapes ----

/// On a shared side or corner all its faces are equally near, and the smallest id decides.
#[test]
fn on_a_shared_corner_or_side_the_smallest_face_is_hit() {
    for n in 3..9 {
        let map = map_of(shapes::fan(n));
        let index = ContactIndex::new(&map).unwrap();
        let above = index.locate(DVec3::new(0.0, 0.0, 0.3)).unwrap();
        assert_eq!(
            (above.point.face, above.point.barycentric),
            (FaceId::new(0), [1.0, 0.0, 0.0]),
            "fan of {n}"
        );
        // The spoke to rim vertex 1 is shared by the first face and the last.
        let on_spoke = index.locate(DVec3::new(0.3, 0.0, 0.0)).unwrap();
        assert_eq!(on_spoke.point.face, FaceId::new(0), "fan of {n}");
    }
}

/// Every point of a plane midway between two parallel sheets is as near to one as to the other.
#[test]
fn on_the_medial_axis_the_first_patch_is_hit() {
    let sheet = |z: f64| shapes::sheet(5, 5, |i, j| DVec3::new(f64::from(i), f64::from(j), z));
    let links = vec![link_of("base", None, DAffine3::IDENTITY)];
    for (first, second) in [(1.0, -1.0), (-1.0, 1.0)] {
        let patches = vec![
            patch_of("a", 0, vec![level_of(sheet(first))]),
            patch_of("b", 0, vec![level_of(sheet(second))]),
        ];
        let map = SkinMap { links: links.clone().into(), patches: patches.into(), ..SkinMap::default() };
        let index = ContactIndex::new(&map).unwrap();
        for k in 0..40 {
            let point = DVec3::new(0.1 * f64::from(k), 1.7, 0.0);
            assert_eq!(index.locate(point).unwrap().patch, PatchId::new(0), "at {point}");
            assert_eq!(
                index.locate(Query::on_link(LinkId::new(0), point)).unwrap().patch,
                PatchId::new(0),
                "at {point}"
            );
        }
    }
}

/// A triangle without area is as far away as the segment or point that it is, and never nearer.
#[test]
fn a_degenerate_triangle_is_measured_as_its_segment() {
    let positions = vec![
        DVec3::ZERO,
        DVec3::X,
        DVec3::new(0.5, 0.0, 0.0), // a segment
        DVec3::new(0.0, 5.0, 0.0),
        DVec3::new(0.0, 5.0, 0.0),
        DVec3::new(0.0, 5.0, 0.0), // a point
        DVec3::new(-9.0, -9.0, -1.0),
        DVec3::new(9.0, -9.0, -1.0),
        DVec3::new(0.0, 9.0, -1.0),
    ];
    let map = map_of(TriMesh::from_arrays(positions, &[[0, 1, 2], [3, 4, 5], [6, 7, 8]]));
    let index = ContactIndex::new(&map).unwrap();
    for (point, face) in [
        (DVec3::new(0.5, 0.2, 0.0), 0),
        (DVec3::new(0.0, 4.9, 0.0), 1),
        (DVec3::new(0.5, 0.2, -0.9), 2),
        (DVec3::new(0.5, 0.0, -0.6), 2),
    ] {
        let hit = assert_exact(&map, &index, &Query::from(point), 1e-12);
        assert_eq!(hit.point.face, FaceId::new(face), "at {point}");
    }
}

/// Of equally near faces one with area is the answer, also where one without area comes first.
#[test]
fn a_degenerate_triangle_is_never_hit_before_a_better_one() {
    let positions = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.5, 0.0, 0.0), DVec3::Y];
    let map = map_of(TriMesh::from_arrays(positions, &[[0, 1, 2], [0, 1, 3]]));
    let index = ContactIndex::new(&map).unwrap();
    for x in [-0.2, 0.0, 0.3, 0.5, 0.75, 1.0, 1.4] {
        let hit = index.locate(Query::from(DVec3::new(x, -0.2, 0.1))).unwrap();
        assert_eq!(hit.point.face, FaceId::new(1), "at {x}");
    }
}

/// From so far away that the slack of `f32` exceeds the shape, only `f64` tells its faces apart.
#[test]
fn contacts_far_beyond_single_precision_are_exact() {
    let map = map_of(shapes::cap(2000, 0.1, 1.9));
    let index = ContactIndex::new(&map).unwrap();
    for exponent in 0..=9 {
        let away = 10_f64.powi(exponent);
        for k in 0..20 {
            let direction = DVec3::new(
                (f64::from(k) * 1.7).sin(),
                (f64::from(k) * 0.9).cos(),
                (TAU * 0.13 * f64::from(k)).sin(),
            );
            assert_exact(&map, &index, &Query::from(direction * away), 1e-9 + 1e-15 * away);
        }
    }
    let edge = DVec3::new(1e12, -1e12, 1e12);
    assert!(index.locate(edge).unwrap().distance > 1e12, "the largest coordinates are answered");
}

// ---- sign ----

/// Outside is positive at faces, sides and corners alike: on a sharp tetrahedron a face normal
/// alone would be wrong beside most corners.
#[test]
fn the_sign_tells_outside_from_inside() {
    let mesh = shapes::tetrahedron();
    let map = map_of(mesh.clone());
    let index = ContactIndex::new(&map).unwrap();
    assert!(index.locate(DVec3::ZERO).unwrap().distance < 0.0, "the centre is inside");
    for i in -20..=20 {
        for j in -20..=20 {
            for k in -20..=20 {
                let q = DVec3::new(f64::from(i), f64::from(j), f64::from(k)) / 10.0 + DVec3::splat(0.0123);
                let inside =
                    mesh.triangles.ids().all(|f| mesh.face_cross(f).dot(q - mesh.corners(f)[0]) < 0.0);
                let distance = index.locate(q).unwrap().distance;
                assert_eq!(distance < 0.0, inside, "at {q}, distance {distance}");
            }
        }
    }
}

// ---- levels ----

#[test]
fn at_a_vertex_one_field_has_all_the_weight() {
    let map = square_and_its_midpoints();
    let index = ContactIndex::new(&map).unwrap();
    let fine = &map.patches[PatchId::new(0)].levels[LevelId::new(0)];
    for (v, &p) in fine.level.mesh.positions.enumerate() {
        let hit = index.locate(p + DVec3::Z * 0.1).unwrap();
        assert!((hit.distance - 0.1).abs() < 1e-15);
        let cell = index.cell(&hit, LevelId::new(0)).unwrap();
        assert_eq!((cell.field, cell.weights.iter().collect::<Vec<_>>()), (v, vec![(v, 1.0)]));
        assert_eq!((cell.uv, cell.taxel), (fine.opened_uv()[v], TaxelId(1000 + v.raw())));
        assert_eq!(cell.pixel, fine.frame.pixel(fine.opened_uv()[v]));
        if v.index() < 4 {
            let cell = index.cell(&hit, LevelId::new(1)).unwrap();
            assert!(cell.weights.iter().eq([(v, 1.0)]), "a centre's row is its own field");
            let corners =
                map.patches[PatchId::new(0)].levels[LevelId::new(1)].level.mesh.triangles[cell.point.face];
            let at = corners.iter().position(|&c| c == v).unwrap();
            assert_eq!(cell.point.barycentric[at], 1.0, "the face holds the centre");
            let smaller = if v.index() == 3 { 1 } else { 0 };
            assert_eq!(cell.point.face, FaceId::new(smaller), "of several faces the smallest");
        }
    }
}

/// The prolongation of the subdivision is linear interpolation, so level 1 puts a contact exactly
/// where level 0 does.
#[test]
fn on_a_subdivided_square_both_levels_agree() {
    let map = square_and_its_midpoints();
    let index = ContactIndex::new(&map).unwrap();
    let coarse = &map.patches[PatchId::new(0)].levels[LevelId::new(1)];
    for i in 0..=20 {
        for j in 0..=20 {
            let point = DVec3::new(f64::from(i) / 20.0, f64::from(j) / 20.0, -0.01);
            let hit = index.locate(point).unwrap();
            assert!((hit.distance + 0.01).abs() < 1e-15, "below the square is inside");
            let cells: Vec<_> = (0..).map_while(|k| index.cell(&hit, LevelId::new(k))).collect();
            assert_eq!(cells.len(), 2);
            for cell in &cells {
                assert!(cell.uv.distance(point.truncate()) < 1e-12, "{cell:?}");
                let sum: f64 = cell.weights.iter().map(|(_, w)| w).sum();
                assert!((sum - 1.0).abs() < 1e-12);
                let strongest = cell.weights.iter().map(|(_, w)| w).fold(0.0, f64::max);
                let first = cell.weights.iter().find(|&(_, w)| w == strongest).unwrap().0;
                assert_eq!(cell.field, first, "the largest weight, the smallest field of several");
            }
            let place = coarse.level.mesh.point(&cells[1].point);
            assert!(place.distance(hit.position) < 1e-12, "{place} for {}", hit.position);
        }
    }
}

/// `face` and `b0..b2` of a coarse level are where `u,v` lie on its map, also along a cut and around holes; off the
/// map a place at its rim.
#[test]
fn a_coarse_cell_lies_where_its_map_position_says() {
    let map = |mesh: TriMesh| build(&Skin::from_mesh("skin", mesh), &BuildOptions::default()).unwrap();
    for (name, map) in [
        ("cap", map(shapes::cap(2000, 0.1, 1.2))),
        ("tube", map(shapes::tube(40, 30, 0.03, 0.1))),
        ("frame", map(shapes::frame(2, 6, 0.01))),
    ] {
        let index = ContactIndex::new(&map).unwrap();
        let patch = &map.patches[PatchId::new(0)];
        let mesh = finest(&map, 0);
        let (mut inside, mut all) = (0, 0);
        for face in mesh.triangles.ids().step_by(3) {
            let [a, b, c] = mesh.corners(face);
            let hit = index.locate(0.5 * a + 0.3 * b + 0.2 * c).unwrap();
            for (id, level) in patch.levels.enumerate().skip(1) {
                let cell = index.cell(&hit, id).unwrap();
                let corners = level.places(cell.point.face).map(|place| level.uv[place]);
                let [a, b, c] = cell.point.barycentric;
                assert!(cell.point.barycentric.iter().all(|&b| (0.0..=1.0).contains(&b)), "{name}: {cell:?}");
                let place = corners[0] * a + corners[1] * b + corners[2] * c;
                // No face of the map has a position that is said to be off it.
                let is_in = |face: FaceId| {
                    let [p, q, r] = level.places(face).map(|place| level.uv[place] - cell.uv);
                    [p.perp_dot(q), q.perp_dot(r), r.perp_dot(p)].iter().all(|&x| x > 0.0)
                };
                let is_off = place.distance(cell.uv) > 1e-12;
                assert!(
                    !is_off || !level.level.mesh.triangles.ids().any(is_in),
                    "{name}: {cell:?} at {place}"
                );
                (inside, all) = (inside + usize::from(!is_off), all + 1);
            }
        }
        assert!(inside * 10 > all * 9, "{name}: {inside} of {all} lie on their maps");
    }
}

#[test]
fn a_level_that_does_not_exist_has_no_cell() {
    let index = ContactIndex::new(&square_and_its_midpoints()).unwrap();
    let hit = index.locate(DVec3::ZERO).unwrap();
    assert!(index.cell(&hit, LevelId::new(2)).is_none());
    let foreign = Hit { patch: PatchId::new(7), ..hit };
    assert!(index.cell(&foreign, LevelId::new(0)).is_none());
    let mut beyond = hit;
    beyond.point.face = FaceId::new(1 << 20);
    assert!(index.cell(&beyond, LevelId::new(0)).is_none());
}

// ---- refusals ----

#[test]
fn queries_that_are_not_finite_are_refused() {
    let map = robot(
        [shapes::square(), shapes::square(), shapes::triangle(), shapes::fan(5)],
        [DAffine3::IDENTITY; 3],
    );
    let index = ContactIndex::new(&map).unwrap();
    let good = Query::from(DVec3::ZERO);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e13] {
        for axis in 0..3 {
            let mut point = DVec3::ZERO;
            point[axis] = bad;
            let batch = [good, good, Query::from(point), Query::from(DVec3::NAN)];
            let error = index.locate_all(&batch, Run::default()).unwrap_err();
            assert!(matches!(error, ContactError::NotFinite { contact: 2, .. }), "{error}");
            assert!(index.locate(point).is_err());
            assert!(index.locate(Query::on_link(LinkId::new(1), point)).is_err());
        }
    }
    let error = index.locate(Query::on_link(LinkId::new(3), DVec3::ZERO)).unwrap_err();
    assert!(matches!(error, ContactError::UnknownLink { count: 3, .. }), "{error}");
    assert!(
        index.locate(Query::in_link(LinkId::new(0), DVec3::ZERO)).is_ok(),
        "the frame of a link without skin"
    );
    let error = index.locate(Query::on_link(LinkId::new(0), DVec3::ZERO)).unwrap_err();
    assert!(matches!(&error, ContactError::BareLink { name, .. } if name == "base"), "{error}");
    assert_eq!(index.locate_all(&[], Run::default()).unwrap().iter().count(), 0, "no contacts, no hits");
}

#[test]
fn poses_that_change_lengths_are_refused() {
    let map = map_of(shapes::square());
    let mut index = ContactIndex::new(&map).unwrap();
    let before = index.locate(DVec3::ONE).unwrap();
    for pose in [
        DAffine3::from_scale(DVec3::splat(1.001)),
        DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0)),
        DAffine3::from_translation(DVec3::NAN),
        DAffine3::ZERO,
    ] {
        let mut posed = map.clone();
        posed.links[LinkId::new(0)].pose = pose;
        let error = ContactIndex::new(&posed).unwrap_err();
        let is_named = matches!(&error, ContactError::NotRigid { name } if name == "base");
        assert!(is_named || matches!(error, ContactError::Map(_)), "{error}");
    }
    let far = posed([(LinkId::new(0), DAffine3::from_translation(DVec3::splat(1e13)))]);
    let error = index.set_motion(&far, 0.0).unwrap_err();
    assert!(matches!(&error, ContactError::NotRigid { name } if name == "base"), "{error}");
    assert_eq!(index.locate(DVec3::ONE).unwrap(), before, "a refused pose moves nothing");
}

#[test]
fn broken_maps_are_refused_by_name() {
    let check = |what: &str, spoil: &dyn Fn(&mut SkinMap)| {
        let mut map = square_and_its_midpoints();
        spoil(&mut map);
        let error = ContactIndex::new(&map).unwrap_err();
        assert!(error.to_string().contains(what), "{error} should speak of {what}");
    };
    fn patch(map: &mut SkinMap) -> &mut PatchMap {
        &mut map.patches[PatchId::new(0)]
    }
    fn level(map: &mut SkinMap, k: usize) -> &mut MapLevel {
        &mut patch(map).levels[LevelId::new(k)]
    }
    let v = VertexId::new;
    check("no triangle", &|map| *map = SkinMap::default());
    check("no triangle", &|map| level(map, 0).level.mesh.triangles = IdVec::default());
    check("patch \"bare\" has no triangle", &|map| {
        let mut bare = PatchMap { name: "bare".into(), ..patch(map).clone() };
        bare.levels[LevelId::new(0)].level.mesh.triangles = IdVec::default();
        map.patches.push(bare);
    });
    check("finite coordinates", &|map| level(map, 0).level.mesh.positions[v(0)] = DVec3::NAN);
    check("1e12", &|map| level(map, 0).level.mesh.positions[v(0)] = DVec3::X * 1e20);
    check("vertex 99", &|map| level(map, 0).level.mesh.triangles[FaceId::new(0)][0] = v(99));
    check("L1", &|map| level(map, 1).level.mesh.triangles[FaceId::new(0)][0] = v(99));
    check("link 5", &|map| patch(map).link = LinkId::new(5));
    check("without levels", &|map| patch(map).levels = IdVec::default());
    check("ids: an array of 1", &|map| patch(map).taxels.ids = vec![TaxelId(0)].into());
    check("uv has 0", &|map| level(map, 1).uv = IdVec::default());
    check("to_finest has 0", &|map| level(map, 1).level.to_finest = None);
    check("after its parent", &|map| map.links[LinkId::new(0)].parent = Some(LinkId::new(0)));
    check("vertex 99 of level 0", &|map| level(map, 1).level.origins[v(2)] = v(99));
    check("row 5", &|map| level(map, 1).level.to_finest.as_mut().unwrap().indices[v(5)][1] = v(40));
    check("row 5", &|map| level(map, 1).level.to_finest.as_mut().unwrap().weights[v(5)][1] = f64::NAN);
    check("row 4", &|map| {
        let far = [v(1), v(3), v(3)];
        level(map, 1).level.to_finest.as_mut().unwrap().indices[v(4)] = far;
        level(map, 0).level.from_coarser.as_mut().unwrap().indices[v(4)] = far;
    });
}
