//! Laws of the module `skin`: what is repaired, what is refused, what is found.

mod drafts;
mod frames;
mod triangulate;

use std::collections::BTreeSet;

use dermatome::id::{FaceId, VertexId};
use dermatome::mesh::{FillHoles, TriMesh, shapes};
use dermatome::pipeline;
use dermatome::skin::{
    self, AssembleOptions, Draft, Finding, FindingKind, PatchId, Presence, RemarkKind, Severity, Sheet,
    SkinError, TaxelId, Taxels, Weld,
};
use drafts::{assemble, cover, draft_of, kinds, only, sheet_of, soup, topology};
use glam::{DVec3, swizzles::Vec3Swizzles};
use proptest::prelude::*;

/// The names of the kinds of findings.
fn found_in(draft: &Draft) -> Vec<String> {
    check(draft).iter().map(|f| f.kind.to_string()).collect()
}

/// The numbers of the elements of the only finding of one kind.
fn elements(draft: &Draft, kind: &str) -> Vec<u32> {
    let found: Vec<Finding> = check(draft).into_iter().filter(|f| f.kind.to_string() == kind).collect();
    assert_eq!(found.len(), 1, "one {kind}");
    found[0].elements.numbers()
}

fn check(draft: &Draft) -> Vec<Finding> {
    skin::check(draft, &AssembleOptions::default())
}

#[test]
fn a_healthy_sheet_is_unchanged_and_has_no_findings() {
    for mesh in [
        shapes::lattice(7, 5, 0.01),
        shapes::cap(500, 0.1, 1.0),
        shapes::tube(12, 5, 0.05, 0.1),
        shapes::saddle(20),
    ] {
        let draft = draft_of(sheet_of("s", &mesh));
        let assembled = assemble(&draft).unwrap();
        assert_eq!(only(&assembled).mesh, mesh, "same vertices, same faces");
        assert_eq!(assembled.remarks, [], "nothing was changed");
        assert_eq!(check(&draft), [], "nothing is wrong");
    }
}

#[test]
fn a_soup_of_triangles_is_welded_into_the_mesh_it_came_from() {
    let mesh = shapes::cap(300, 0.1, 1.0);
    let draft = draft_of(soup("s", &mesh));
    let assembled = assemble(&draft).unwrap();
    assert_eq!(only(&assembled).mesh.positions.len(), mesh.positions.len());
    assert_eq!(topology(&only(&assembled).mesh), topology(&mesh));
    assert_eq!(kinds(&assembled), ["Welded"].map(String::from).into());
    assert_eq!(check(&draft), [], "split vertices are healthy");
}

/// A split vertex keeps the mean of its copies' normals.
#[test]
fn welding_takes_the_mean_of_the_normals() {
    let mut sheet = soup("s", &shapes::cap(300, 0.1, 1.0));
    let normals = sheet.triangles.iter().flat_map(|t| {
        let [a, b, c] = t.map(|v| sheet.positions[v as usize]);
        [(b - a).cross(c - a).normalize(); 3]
    });
    sheet.normals = Some(normals.collect());
    let assembled = assemble(&draft_of(sheet)).unwrap();
    let patch = only(&assembled);
    for (v, n) in patch.taxels.normals.enumerate() {
        let outward = patch.mesh.positions[v].normalize();
        assert!(n.dot(outward) > 0.98, "normal of {v:?} is {n}, the sphere's is {outward}");
    }
}

#[test]
fn ids_alone_never_weld_and_different_ids_stay_apart() {
    let mut sheet = sheet_of("s", &shapes::lattice(3, 3, 0.01));
    sheet.ids = Some(vec![TaxelId(0); 9]);
    let assembled = assemble(&draft_of(sheet)).unwrap();
    assert_eq!(only(&assembled).mesh.positions.len(), 9, "placeholders name nine taxels");

    // Two squares whose shared side is written twice, with ids of their own: two patches with a
    // seam.
    let mut sheet = soup("s", &shapes::square());
    sheet.ids = Some((1..=6).map(TaxelId).collect());
    let draft = draft_of(sheet);
    assert_eq!(assemble(&draft).unwrap().skin.patches.len(), 2);
    let found = found_in(&draft);
    assert_eq!(found, ["several-components", "gap", "duplicate-position"]);
}

/// Two taxels at one place that a face joins: the edge between them has no length, so one must go.
#[test]
fn an_edge_without_length_is_welded_whatever_the_ids() {
    let mut mesh = shapes::square();
    let twin = mesh.positions.push(mesh.positions[VertexId::new(2)]);
    mesh.triangles[FaceId::new(1)][1] = twin;
    mesh.triangles.push([VertexId::new(0), VertexId::new(2), twin]);
    let mut sheet = sheet_of("s", &mesh);
    sheet.ids = Some((1..=5).map(TaxelId).collect());
    let assembled = assemble(&draft_of(sheet)).unwrap();
    assert_eq!(only(&assembled).mesh.positions.len(), 4);
    assert_eq!(kinds(&assembled), ["Welded", "RepeatedCorner"].map(String::from).into());
}

/// Two fans that touch in a point are two sheets: with the vertices of the file if it writes the
/// point twice, else with a copy, and a remark.
#[test]
fn a_weld_that_would_only_make_sheets_touch_is_undone() {
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let mesh = TriMesh::from_arrays(
        vec![p(0., 0.), p(1., 0.), p(0., 1.), p(0., 0.), p(-1., 0.), p(0., -1.)],
        &[[0, 1, 2], [3, 4, 5]],
    );
    let assembled = assemble(&draft_of(sheet_of("s", &mesh))).unwrap();
    let names: Vec<&str> = assembled.skin.patches.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["s", "s.1"]);

    let mut touching = mesh;
    touching.triangles[FaceId::new(1)][0] = VertexId::new(0);
    let draft = draft_of(sheet_of("s", &touching));
    let split = assemble(&draft).unwrap();
    let vertices = vec![VertexId::new(0)];
    assert_eq!(split.remarks[0].kind, RemarkKind::FansSplit { vertices });
    let sizes: Vec<usize> = split.skin.patches.iter().map(|p| p.mesh.positions.len()).collect();
    assert_eq!(sizes, [3, 3]);
    assert!(found_in(&draft).contains(&"non-manifold-vertex".to_owned()));
}

#[test]
fn a_third_face_at_an_edge_is_refused_and_named() {
    let mut mesh = shapes::square();
    let top = mesh.positions.push(DVec3::Z);
    mesh.triangles.push([VertexId::new(0), VertexId::new(2), top]);
    let draft = draft_of(sheet_of("s", &mesh));
    let SkinError::NonManifoldEdges { edges, .. } = assemble(&draft).unwrap_err() else { panic!("an edge") };
    assert_eq!(
        edges.iter().map(|e| e.iter().map(|v| v.raw()).collect()).collect::<Vec<BTreeSet<u32>>>(),
        [[0, 2].into()]
    );
    assert_eq!(elements(&draft, "non-manifold-edge"), [2, 0]);
}

const REPAIR: AssembleOptions = AssembleOptions {
    repair: true,
    gap: 2.5,
    fill_holes: FillHoles::None,
    weld: Weld::Auto,
    outside: None,
    keep_going: false,
};

/// Assembled with these holes filled.
fn filled(draft: &Draft, fill_holes: FillHoles) -> skin::Assembled {
    skin::assemble(draft, &AssembleOptions { fill_holes, ..AssembleOptions::default() }).unwrap()
}

/// Without `repair` a strip with one side is refused; with it, it is cut open across.
#[test]
fn a_moebius_strip_is_refused_or_cut_open() {
    let mut triangles = Vec::new();
    for i in 0..5_u32 {
        let [a, b] = [2 * i, 2 * i + 1];
        let [c, d] = if i == 4 { [1, 0] } else { [a + 2, b + 2] };
        triangles.extend([[a, c, b], [c, d, b]]);
    }
    let positions = (0..10_u32).map(|i| {
        let turn = std::f64::consts::TAU * f64::from(i / 2) / 5.0;
        let out = DVec3::new(turn.cos(), turn.sin(), 0.0);
        let lean = out * (turn / 2.0).cos() + DVec3::Z * (turn / 2.0).sin();
        out + lean * if i % 2 == 0 { -0.3 } else { 0.3 }
    });
    let draft = draft_of(sheet_of("strip", &TriMesh::from_arrays(positions.collect(), &triangles)));
    assert!(matches!(assemble(&draft), Err(SkinError::NotOrientable { .. })));
    assert!(found_in(&draft).contains(&"not-orientable".to_owned()));
    let cut = skin::assemble(&draft, &REPAIR).unwrap();
    assert!(kinds(&cut).contains("OneSidedCut"), "{:?}", cut.remarks);
    let mesh = &only(&cut).mesh;
    assert_eq!((topology(mesh), mesh.triangles.len()), ((1, 1), 10), "a strip with all its faces");
}

/// Two wedges whose blades touch along an edge: faces of one wedge, wound alike, stay together, though
/// those of different wedges continue each other more smoothly.
#[test]
fn solids_that_touch_along_an_edge_are_taken_apart() {
    let wedge = |side: f64, first: u32| {
        let at = |x: f64, y: f64, z: f64| DVec3::new(side * x, y, side * z);
        let corners = [at(1.0, 0.0, 0.2), at(1.0, 0.0, -0.2), at(1.0, 1.0, 0.2), at(1.0, 1.0, -0.2)];
        let [a, b, c, d] = [first, first + 1, first + 2, first + 3];
        let faces = [[0, a, c], [0, c, 1], [0, 1, d], [0, d, b], [0, b, a], [1, c, d], [a, b, d], [a, d, c]];
        (corners, faces)
    };
    let ((left, of_left), (right, of_right)) = (wedge(1.0, 2), wedge(-1.0, 6));
    let positions = [DVec3::ZERO, DVec3::Y].into_iter().chain(left).chain(right).collect();
    let triangles: Vec<_> = of_left.into_iter().chain(of_right).collect();
    let draft = draft_of(sheet_of("s", &TriMesh::from_arrays(positions, &triangles)));
    assert!(matches!(assemble(&draft), Err(SkinError::NonManifoldEdges { .. })));
    let apart = skin::assemble(&draft, &REPAIR).unwrap();
    let shapes: Vec<_> =
        apart.skin.patches.iter().map(|p| (topology(&p.mesh), p.mesh.triangles.len())).collect();
    assert_eq!(shapes, [((2, 0), 8); 2], "two closed wedges: {:?}", apart.remarks);
}

/// The end of a tube of four sides is not a pin-hole, however few edges it has; a missing face is.
#[test]
fn pin_holes_continue_the_surface() {
    let mut tube = shapes::tube(4, 30, 0.01, 0.3);
    tube.triangles = tube.triangles.enumerate().filter(|(f, _)| f.index() != 100).map(|(_, t)| *t).collect();
    let draft = draft_of(sheet_of("tube", &tube));
    let loops = |holes| topology(&only(&filled(&draft, holes)).mesh).1;
    let kept = [FillHoles::None, FillHoles::PinHoles, FillHoles::UpTo(3), FillHoles::UpTo(4)].map(loops);
    assert_eq!(kept, [3, 2, 2, 1], "the longest loop stays");
}

/// A ball with a vertex on an edge of one of its faces alone: only a face without area could close this line, and no map
/// file holds one (`ur10_robot.urdf --outer --spacing 8mm`).
#[test]
fn the_only_hole_of_a_ball_stays_open_if_it_is_a_line() {
    let ball = shapes::ball(4, 0.1);
    let [a, b, c] = ball.triangles[FaceId::new(0)];
    let (middle, turned) =
        (ball.positions.len(), (ball.positions[a] - ball.positions[b]).any_orthonormal_vector());
    let on_edge = |off: f64| 0.5 * (ball.positions[a] + ball.positions[b]) + off * turned;
    for (off, loops) in [(0.0, 1), (0.005, 0)] {
        let mut mesh = ball.clone();
        mesh.positions.push(on_edge(off));
        let middle = VertexId::new(middle);
        mesh.triangles[FaceId::new(0)] = [a, middle, c];
        mesh.triangles.push([middle, b, c]);
        let assembled = filled(&draft_of(sheet_of("ball", &mesh)), FillHoles::PinHoles);
        assert_eq!(topology(&only(&assembled).mesh).1, loops, "{off}");
        let map = dermatome::build(&assembled.skin, &dermatome::BuildOptions::default()).unwrap();
        dermatome::io::map_to_bytes(&map).unwrap();
    }
}

/// A middle taxel in line with two of the boundary: the face between them goes, and the boundary
/// runs through it.
#[test]
fn a_face_without_area_at_the_boundary_is_dropped() {
    let mut mesh = shapes::sheet(5, 4, |i, j| DVec3::new(f64::from(i), f64::from(j), 0.0));
    mesh.triangles.push([1, 0, 2].map(VertexId::from));
    let before = mesh.triangles.len();
    let draft = draft_of(sheet_of("s", &mesh));
    let assembled = assemble(&draft).unwrap();
    assert_eq!(only(&assembled).mesh.triangles.len(), before - 1);
    assert_eq!(topology(&only(&assembled).mesh), (1, 1));
    assert_eq!(kinds(&assembled), ["ZeroAreaDropped"].map(String::from).into());
    assert_eq!(found_in(&draft), ["zero-area-face"]);
}

/// Faces on a line, of which none can be dropped or flipped alone, beside a square: as CAD leaves them where edges pass through
/// each other.
#[test]
fn a_piece_without_area_is_dropped_and_named() {
    let line = |y: f64| DVec3::new(1.0, y, 0.0);
    let [a, b, c, d] = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]].map(|[x, y]| DVec3::new(x, y, 0.0));
    let positions = vec![a, b, c, d, line(0.0091), line(0.0093), line(0.0092), line(-0.0099), line(-0.009)];
    let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 6, 5], [7, 8, 4], [7, 4, 5]];
    let draft = draft_of(Sheet { name: "s".into(), positions, triangles, ..Sheet::default() });
    let assembled = assemble(&draft).unwrap();
    assert_eq!(only(&assembled).mesh.triangles.len(), 2);
    let dropped: Option<Vec<usize>> = assembled.remarks.iter().find_map(|remark| match &remark.kind {
        RemarkKind::ZeroAreaDropped { faces } => Some(faces.iter().map(|face| face.index()).collect()),
        _ => None,
    });
    assert_eq!(dropped, Some(vec![2, 3, 4]), "{:?}", assembled.remarks);
    assert!(!kinds(&assembled).contains("ZeroAreaKept"));
}

/// The same in the middle of a sheet: dropping the face would tear a slit, so its longest side is
/// flipped.
#[test]
fn a_face_without_area_inside_is_flipped_away() {
    // 3 lies in the middle of 0-1; the lower half sees 0-1 as one edge, the upper half as two.
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let mesh = TriMesh::from_arrays(
        vec![p(0., 0.), p(2., 0.), p(1., -1.), p(1., 0.), p(1., 1.)],
        &[[0, 2, 1], [0, 1, 3], [0, 3, 4], [3, 1, 4]],
    );
    let assembled = assemble(&draft_of(sheet_of("s", &mesh))).unwrap();
    let mesh = &only(&assembled).mesh;
    assert_eq!((topology(mesh), mesh.triangles.len()), ((1, 1), 4), "no slit, and no face is lost");
    assert!(mesh.triangles.ids().all(|f| mesh.face_cross(f).length() > 0.2));
}

/// A strip of faces without area, whose inner ones can move only after the outer ones.
#[test]
fn a_chain_of_faces_without_area_is_cleared_from_its_ends() {
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let mesh = TriMesh::from_arrays(
        vec![p(0., 0.), p(4., 0.), p(2., -1.), p(1., 0.), p(2., 0.), p(3., 0.), p(2., 1.)],
        &[[0, 2, 1], [0, 1, 3], [3, 1, 4], [4, 1, 5], [0, 3, 6], [3, 4, 6], [4, 5, 6], [5, 1, 6]],
    );
    let assembled = assemble(&draft_of(sheet_of("s", &mesh))).unwrap();
    assert_eq!(topology(&only(&assembled).mesh), (1, 1), "no slit");
    let mesh = &only(&assembled).mesh;
    assert!(mesh.triangles.ids().all(|f| mesh.face_cross(f).length() > 0.2));
    assert!((mesh.area() - 4.0).abs() < 1e-12, "the same surface");
}

#[test]
fn taxels_without_a_face_are_left_out_and_reported() {
    let mut mesh = shapes::triangle();
    mesh.positions.push(DVec3::Z);
    let mut sheet = sheet_of("s", &mesh);
    let draft = draft_of(sheet.clone());
    let assembled = assemble(&draft).unwrap();
    assert_eq!(only(&assembled).mesh.positions.len(), 3);
    assert_eq!(kinds(&assembled), ["LeftOut"].map(String::from).into());
    assert_eq!(elements(&draft, "isolated-taxel"), [3]);

    sheet.presence = Some(vec![Presence::Present, Presence::Present, Presence::Present, Presence::Absent]);
    assert_eq!(check(&draft_of(sheet)), [], "an absent slot without a face is the normal case");
}

#[test]
fn winding_follows_the_normals_and_is_reported() {
    let mesh = shapes::cap(300, 0.1, 1.0);
    let mut sheet = sheet_of("s", &mesh);
    sheet.normals = Some(Vec::from(Taxels::from(&mesh).normals));
    sheet.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let draft = draft_of(sheet.clone());
    let assembled = assemble(&draft).unwrap();
    assert!(only(&assembled).mesh.face_cross(FaceId::new(0)).dot(-DVec3::Z) > 0.0, "the cap looks down");
    assert_eq!(kinds(&assembled), ["Turned"].map(String::from).into());
    assert_eq!(found_in(&draft), ["winding-against-normals"]);
    assert_eq!(elements(&draft, "winding-against-normals").len(), sheet.triangles.len());
}

#[test]
fn without_reliable_normals_most_faces_decide() {
    let mesh = shapes::cap(300, 0.1, 1.2);
    for placeholder in [None, Some(DVec3::Z), Some(DVec3::ZERO), Some(DVec3::splat(f64::NAN))] {
        let mut sheet = sheet_of("s", &mesh);
        sheet.normals = placeholder.map(|n| vec![n; mesh.positions.len()]);
        for t in sheet.triangles.iter_mut().step_by(3) {
            t.swap(0, 1);
        }
        let draft = draft_of(sheet);
        let assembled = assemble(&draft).unwrap();
        let patch = only(&assembled);
        assert!(patch.mesh.face_cross(FaceId::new(1)).dot(-DVec3::Z) > 0.0, "as most faces of the file");
        let expected = Taxels::from(&patch.mesh).normals;
        assert!(
            patch.taxels.normals.iter().zip(&expected).all(|(n, m)| n.distance(*m) < 1e-12),
            "from the faces"
        );
        assert!(kinds(&assembled).contains("Turned"));
        assert_eq!(elements(&draft, "inconsistent-winding").len(), mesh.triangles.len().div_ceil(3));
        if placeholder.is_some() {
            assert!(kinds(&assembled).contains("NormalsIgnored"));
            let is_wrong = |kind: &String| ["constant-normals", "normal-not-unit"].contains(&kind.as_str());
            assert!(found_in(&draft).iter().any(is_wrong), "{:?}", found_in(&draft));
        }
    }
}

#[test]
fn a_closed_surface_is_turned_outward_by_its_volume() {
    let mut mesh = shapes::tetrahedron();
    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let draft = draft_of(sheet_of("s", &mesh));
    let assembled = assemble(&draft).unwrap();
    let mesh = &only(&assembled).mesh;
    assert!(mesh.triangles.ids().all(|f| mesh.face_cross(f).dot(mesh.corners(f)[0]) > 0.0), "outward");
    assert!(found_in(&draft).contains(&"closed-patch".to_owned()));
    let torus = draft_of(sheet_of("t", &shapes::torus(12, 8, 1.0, 0.3)));
    assert_eq!(found_in(&torus), ["closed-patch", "handle"]);
}

#[test]
fn names_of_pieces_are_unique_and_follow_their_order() {
    let two = shapes::square();
    let apart = soup("a", &two);
    let mut apart = Sheet { ids: Some((1..=6).map(TaxelId).collect()), ..apart };
    apart.positions.iter_mut().skip(3).for_each(|p| p.z += 1.0);
    let sheets = vec![apart.clone(), sheet_of("a.1", &two), sheet_of("a", &two), sheet_of("", &two)];
    let assembled = assemble(&Draft { sheets, ..Draft::default() }).unwrap();
    let names: Vec<&str> = assembled.skin.patches.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["a", "a.2", "a.1", "a.3", "patch"]);
    assert_eq!(kinds(&assembled), ["Components", "Renamed"].map(String::from).into());
    assert_eq!(elements(&draft_of(apart), "several-components"), [0, 1]);
}

#[test]
fn tangents_lie_in_the_planes_of_the_normals_chosen() {
    let mesh = shapes::cap(300, 0.1, 1.0);
    let count = mesh.positions.len();
    let mut sheet = sheet_of("s", &mesh);
    // Placeholder normals are replaced by those of the faces; tangents follow.
    sheet.normals = Some(vec![DVec3::Z; count]);
    sheet.tangents = Some(vec![DVec3::X; count]);
    sheet.tangents.as_mut().unwrap()[7] = DVec3::ZERO;
    let draft = draft_of(sheet.clone());
    let assembled = assemble(&draft).unwrap();
    assert_eq!(kinds(&assembled), ["NormalsIgnored", "TangentsReplaced"].map(String::from).into());
    let taxels = &only(&assembled).taxels;
    for (v, t) in taxels.tangents.as_ref().unwrap().enumerate() {
        assert!(t.dot(taxels.normals[v]).abs() < 1e-12, "{v} in its plane");
        assert!(t.dot(DVec3::X) > 0.4, "{v} along x as far as its plane allows: {t}");
    }
    assert_eq!(elements(&draft, "unusable-tangent"), [7]);

    sheet.tangents = Some(vec![DVec3::splat(5.0); count]);
    let assembled = assemble(&draft_of(sheet)).unwrap();
    assert_eq!(kinds(&assembled), ["NormalsIgnored", "TangentsIgnored"].map(String::from).into());
    assert_eq!(only(&assembled).taxels.tangents, None, "the map will give them");
}

#[test]
fn missing_ids_are_counted_and_bad_areas_are_replaced() {
    let mesh = shapes::square();
    let mut areas = sheet_of("b", &mesh);
    areas.areas = Some(vec![0.5, 0.0, f64::NAN, -1.0]);
    let draft = Draft { sheets: vec![sheet_of("a", &mesh), areas], ..Draft::default() };
    let assembled = assemble(&draft).unwrap();
    let ids: Vec<u32> =
        assembled.skin.patches.iter().flat_map(|p| p.taxels.ids.iter().map(|id| id.0)).collect();
    assert_eq!(ids, (1..=8).collect::<Vec<_>>());
    let second = &assembled.skin.patches[PatchId::new(1)];
    assert_eq!(second.taxels.areas.as_slice(), [0.5, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0]);
    assert_eq!(kinds(&assembled), ["AreasReplaced"].map(String::from).into());
    assert_eq!(elements(&draft, "area-not-positive"), [1, 2, 3]);
}

/// Remarks name taxels by their numbers in the file, also of bare ones of which some slots are empty.
#[test]
fn bare_taxels_keep_the_numbers_of_the_file() {
    let grid = (0..9).map(|k| DVec3::new(0.01 * f64::from(k % 3 + 1), 0.01 * f64::from(k / 3 + 1), 0.0));
    let mut positions: Vec<DVec3> = grid.collect();
    positions.insert(1, DVec3::ZERO);
    let mut presence = vec![Presence::Present; 10];
    presence[1] = Presence::Absent;
    let mut areas = vec![1e-4; 10];
    areas[5] = 0.0;
    let sheet = Sheet { positions, presence: Some(presence), areas: Some(areas), ..Sheet::default() };
    let assembled = assemble(&Draft { sheets: vec![sheet], ..Draft::default() }).unwrap();
    let replaced = assembled.remarks.iter().find_map(|remark| match &remark.kind {
        RemarkKind::AreasReplaced { vertices } => Some(vertices.clone()),
        _ => None,
    });
    assert_eq!(replaced, Some(vec![VertexId::new(5)]), "{:?}", assembled.remarks);
}

#[test]
fn invalid_sheets_are_refused_with_the_element() {
    let sheet = sheet_of("s", &shapes::square());
    let refused = |change: &dyn Fn(&mut Sheet)| {
        let mut sheet = sheet.clone();
        change(&mut sheet);
        let draft = draft_of(sheet);
        (assemble(&draft).unwrap_err().to_string(), found_in(&draft))
    };
    let (text, found) = refused(&|s| s.triangles[1][2] = 9);
    assert_eq!(text, r#"patch "s": face 1 names vertex 9, but there are 4 vertices"#);
    assert!(found.contains(&"corner-out-of-range".to_owned()));
    let (text, found) = refused(&|s| s.positions[2].y = f64::NAN);
    assert!(text.contains("vertex 2"), "{text}");
    assert!(found.contains(&"not-finite".to_owned()));
    let (text, found) = refused(&|s| s.normals = Some(vec![DVec3::Z]));
    assert!(text.contains("1 entries; 4 are needed"), "{text}");
    assert_eq!(found, ["array-length"]);
    let (text, found) = refused(&|s| s.densities = Some(vec![1.0, 1.0, 0.0, 1.0]));
    assert!(text.contains("vertex 2 has a density of 0"), "{text}");
    assert_eq!(found, ["density-not-positive"]);
    let (text, found) = refused(&|s| s.link = Some(3_u32.into()));
    assert!(text.contains("link 3"), "{text}");
    assert_eq!(found, ["unknown-link"]);
    let (text, found) = refused(&|s| *s = Sheet::default());
    assert!(text.contains("no triangle"), "{text}");
    assert!(found.contains(&"no-triangles".to_owned()));
}

#[test]
fn a_missing_face_is_a_pin_hole_and_a_missing_taxel_is_a_hole() {
    let mesh = shapes::lattice(9, 9, 0.01);
    let mut sheet = sheet_of("s", &mesh);
    let middle = 4 * 9 + 4;
    sheet.triangles.retain(|t| !t.contains(&middle));
    sheet.presence = Some(vec![Presence::Present; 81]);
    sheet.presence.as_mut().unwrap()[middle as usize] = Presence::Absent;
    assert_eq!(check(&draft_of(sheet)), [], "a hole of six edges is where a taxel is missing");

    let mut sheet = sheet_of("s", &mesh);
    let face = sheet.triangles.iter().position(|t| t.contains(&middle)).unwrap();
    let mut corners = sheet.triangles.remove(face);
    corners.sort_unstable();
    let draft = draft_of(sheet);
    let mut hole = elements(&draft, "pin-hole");
    hole.sort_unstable();
    assert_eq!((hole, found_in(&draft).len()), (corners.to_vec(), 1));
}

/// What is a pin-hole is one thing: what is found is what is filled.
#[test]
fn pin_holes_are_found_where_they_are_filled() {
    for edges in 4..7_u32 {
        // Two rings around the hole.
        let mesh = shapes::tube(edges, 2, 0.01, 1.0);
        let flat = |p: &DVec3| DVec3::new(p.x, p.y, 0.0) * (1.0 + 3.0 * p.z);
        let mesh = TriMesh { positions: mesh.positions.map(flat), ..mesh };
        let draft = draft_of(sheet_of("s", &mesh));
        let found = found_in(&draft).contains(&"pin-hole".to_owned());
        let is_filled = kinds(&filled(&draft, FillHoles::PinHoles)).contains("HolesFilled");
        assert_eq!((found, is_filled), (edges < 6, edges < 6), "{edges} edges");
    }
}

#[test]
fn joints_to_links_that_do_not_exist_are_refused() {
    let mut skin = skin::Skin::from_mesh("palm", shapes::square());
    let joints = [(0_u32.into(), 0.5), (7_u32.into(), 0.5), (0_u32.into(), 0.0), (0_u32.into(), 0.0)];
    let patch = &mut skin.patches[PatchId::new(0)];
    patch.taxels.joints = Some(patch.mesh.positions.map(|_| joints));
    let error = skin.validate().unwrap_err().to_string();
    assert!(error.contains("vertex 0 follows link 7, but there are 1 links"), "{error}");
}

#[test]
fn invalid_skins_are_not_built() {
    type Change = fn(&mut skin::Skin);
    let changes: [(Change, &str); 3] = [
        (|skin| skin.patches.iter_mut().for_each(|p| p.taxels.normals = vec![DVec3::Z].into()), "normals"),
        (|skin| skin.patches.iter_mut().for_each(|p| p.link = 9_u32.into()), "link 9"),
        (|skin| skin.patches.iter_mut().for_each(|p| p.filled = 3), "faces that fill holes is 3"),
    ];
    for (change, found) in changes {
        let mut skin = skin::Skin::from_mesh("palm", shapes::square());
        change(&mut skin);
        let options = pipeline::BuildOptions { seam_side: Some(DVec3::X), ..Default::default() };
        let error = pipeline::build(&skin, &options).unwrap_err().to_string();
        assert!(error.contains(found), "{error}");
    }
    let error = SkinError::NonManifoldEdges { patch: "palm".into(), edges: Vec::new() };
    assert!(error.to_string().contains("0 edges"), "any public value has a sentence");
}

/// Two faces with the same corners and no other neighbours close each other: no edge has more than two faces.
#[test]
fn a_face_alone_with_its_duplicate_is_refused() {
    for again in [[0, 1, 2], [2, 1, 0]] {
        let mut sheet = sheet_of("s", &shapes::triangle());
        sheet.triangles.push(again);
        let draft = draft_of(sheet);
        let error = assemble(&draft).unwrap_err();
        assert_eq!(error, SkinError::DuplicateFaces { patch: "s".into(), faces: vec![FaceId::new(1)] });
        assert_eq!(elements(&draft, "duplicate-face"), [1]);
        let repaired = skin::assemble(&draft, &REPAIR).unwrap().skin;
        assert_eq!(repaired.patches[PatchId::new(0)].mesh.triangles.len(), 1);
    }
}

/// Two squares, in one sheet, of which the second is the vertices 4 to 7.
fn two_squares() -> Sheet {
    let mut sheet = sheet_of("s", &shapes::square());
    sheet.positions.extend_from_within(..);
    sheet.positions[4..].iter_mut().for_each(|p| p.z += 9.0);
    sheet.triangles.extend_from_within(..);
    sheet.triangles[2..].iter_mut().flatten().for_each(|v| *v += 4);
    sheet
}

/// What nothing but assembling finds is a finding too, and concerns one patch.
#[test]
fn check_finds_what_assemble_refuses() {
    let second = |bad: f64, good: f64| (0..8).map(|v| if v < 4 { good } else { bad }).collect::<Vec<_>>();
    let variance = |x: f64| Some(skin::Covariance::from([x, 0.0, 0.0, 1.0, 0.0, 1.0]));
    let follows = |x: f64| [0.0, x, 0.0, 0.0].map(|w| (if w > 0.0 { 7_u32 } else { 0 }.into(), w));
    type Change<'a> = &'a dyn Fn(&mut Sheet);
    let changes: [(Change<'_>, &str); 3] = [
        (&|s| s.weights = Some(second(0.0, 1.0)), "all 4 weights are 0"),
        (
            &|s| s.covariances = Some(second(-1.0, 1.0).into_iter().map(variance).collect()),
            "vertex 4 has the cov",
        ),
        (&|s| s.joints = Some(second(0.0, 0.0).into_iter().map(follows).collect()), "vertex 0 follows"),
    ];
    for (change, text) in changes {
        let mut sheet = two_squares();
        change(&mut sheet);
        let draft = draft_of(sheet);
        assert_eq!(found_in(&draft).last().map(String::as_str), Some("no-skin"), "{text}");
        let error = assemble(&draft).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    }
    let flat = Sheet {
        positions: [0.0, 1.0, 2.0].map(|x| DVec3::X * x).to_vec(),
        triangles: vec![[0, 1, 2]],
        ..Sheet::default()
    };
    assert_eq!(found_in(&draft_of(flat)), ["zero-area-face", "no-skin"]);
}

/// The first square is turned over, and left out for its weights: what is told of it is not told of the other.
#[test]
fn a_component_that_is_left_out_leaves_no_trace() {
    let mut sheet = two_squares();
    sheet.normals = Some(vec![DVec3::Z; 8]);
    sheet.triangles[..2].iter_mut().for_each(|t| t.swap(1, 2));
    sheet.weights = Some((0..8).map(|v| f64::from(u8::from(v > 3))).collect());
    let options = AssembleOptions { keep_going: true, ..AssembleOptions::default() };
    let kept = skin::assemble(&draft_of(sheet), &options).unwrap();
    assert_eq!(
        (&*only(&kept).name, only(&kept).taxels.ids.as_slice()),
        ("s", &[1, 2, 3, 4].map(TaxelId)[..])
    );
    assert_eq!(kinds(&kept), ["DoubtfulUnit", "PatchLeftOut"].map(String::from).into());
}

/// `keep` is called for every face, whatever is wrong with its sheet.
#[test]
fn retain_counts_the_faces_of_invalid_sheets() {
    let (mut draft, good) = (draft_of(sheet_of("s", &shapes::square())), sheet_of("t", &shapes::square()));
    draft.sheets[0].areas = Some(Vec::new());
    draft.sheets.push(good);
    let mut flags = [false, false, true, false].into_iter();
    draft.retain(|_, _| flags.next().unwrap());
    assert_eq!(draft.sheets.iter().map(|s| s.triangles.len()).collect::<Vec<_>>(), [2, 1]);
}

/// A vertex without a face at the place of a used one is that taxel.
#[test]
fn every_vertex_is_welded_or_left_out() {
    let mut sheet = sheet_of("s", &shapes::square());
    sheet.positions.extend([sheet.positions[0], DVec3::splat(9.0)]);
    let assembled = assemble(&draft_of(sheet)).unwrap();
    let expected = [
        RemarkKind::Welded { vertices: 5, taxels: 4 },
        RemarkKind::LeftOut { vertices: vec![VertexId::new(5)] },
    ];
    assert_eq!(assembled.remarks.iter().map(|r| r.kind.clone()).collect::<Vec<_>>(), expected);
}

/// The arrays of a draft may have any length.
#[test]
fn a_draft_with_short_arrays_is_filtered_without_panic() {
    let change: [fn(&mut Sheet); 2] = [|s| s.materials = Some(Vec::new()), |s| s.areas = Some(vec![1.0])];
    for change in change {
        let mut sheet = sheet_of("s", &shapes::square());
        change(&mut sheet);
        let mut draft = draft_of(sheet);
        draft.retain(|_, face| face == 0);
        assert_eq!(found_in(&draft), ["array-length"]);
    }
}

/// Areas and normals come from the faces, so those that fill a hole count.
#[test]
fn holes_are_filled_before_areas_and_normals_are_computed() {
    let whole = shapes::lattice(9, 9, 0.01);
    let mut sheet = sheet_of("s", &whole);
    let face = sheet.triangles.iter().position(|t| t.contains(&40)).unwrap();
    sheet.triangles.remove(face);
    let draft = draft_of(sheet);
    let [open, closed] = [2, 3].map(|edges| filled(&draft, FillHoles::UpTo(edges)));
    assert_eq!((kinds(&open).len(), topology(&only(&open).mesh)), (0, (0, 2)));
    assert_eq!(kinds(&closed), ["HolesFilled".to_owned()].into());
    assert_eq!(topology(&only(&closed).mesh), (1, 1));
    for (v, &area) in Taxels::from(&whole).areas.enumerate() {
        assert!((only(&closed).taxels.areas[v] - area).abs() < 1e-15, "area of {v:?}: as without the hole");
    }
}

/// Of the triangles between its own vertices a hole gets those of least area, which on a plane is its
/// own; one with more edges than asked for stays open.
#[test]
fn the_hole_of_a_missing_taxel_is_filled_flat() {
    let whole = shapes::lattice(7, 7, 0.01);
    let mut sheet = sheet_of("s", &whole);
    sheet.triangles.retain(|t| !t.contains(&24));
    let draft = draft_of(sheet);
    for (edges, loops) in [(5, 2), (6, 1)] {
        let mesh = only(&filled(&draft, FillHoles::UpTo(edges))).mesh.clone();
        assert_eq!(topology(&mesh).1, loops, "at most {edges} edges; the outer boundary stays");
        assert_eq!((mesh.area() - whole.area()).abs() < 1e-12, loops == 1, "{}", mesh.area());
        let up = mesh.triangles.ids().all(|f| mesh.face_cross(f).z > 0.0);
        assert!(up, "the filling faces outward like the rest");
    }
}

/// A tube whose ends of each ring were written twice, a tenth of the spacing apart.
#[test]
fn an_open_seam_is_a_gap() {
    let mesh = shapes::sheet(21, 8, |i, j| {
        let turn = f64::from(i) / 20.2 * std::f64::consts::TAU;
        DVec3::new(turn.cos(), turn.sin(), 0.3 * f64::from(j))
    });
    let draft = draft_of(sheet_of("s", &mesh));
    assert_eq!(found_in(&draft), ["gap"]);
    assert_eq!(elements(&draft, "gap").len(), 16, "eight vertices on each side");
}

#[test]
fn slivers_and_repeated_faces_are_found() {
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let mesh = TriMesh::from_arrays(
        vec![p(0., 0.), p(1., 0.), p(0.5, 0.01), p(0.5, 1.)],
        &[[0, 1, 2], [0, 2, 3], [2, 1, 3]],
    );
    assert_eq!(elements(&draft_of(sheet_of("s", &mesh)), "sliver-face"), [0]);
    let mut twice = sheet_of("s", &shapes::square());
    twice.triangles.push([3, 0, 2]);
    assert!(found_in(&draft_of(twice)).contains(&"duplicate-face".to_owned()));
}

#[test]
fn placeholder_and_duplicate_ids_are_separate_findings() {
    let mut sheet = sheet_of("s", &shapes::lattice(3, 2, 0.01));
    sheet.ids = Some([0, 7, 7, 0, 5, 6].map(TaxelId).to_vec());
    let draft = draft_of(sheet);
    assert_eq!(elements(&draft, "duplicate-id"), [1, 2]);
    assert_eq!(elements(&draft, "placeholder-id"), [0, 3]);
}

/// Two pairs of triangles that touch in a point: in the file the first pair shares its vertex, the
/// second writes it twice. Both become two sheets; only the first is a finding.
#[test]
fn only_vertices_that_touch_in_the_file_are_findings() {
    let bow_tie =
        |x: f64| [[0., 0.], [1., 0.], [0., 1.], [-1., 0.], [0., -1.]].map(|[a, b]| DVec3::new(a + x, b, 0.0));
    let mut positions = [bow_tie(0.0), bow_tie(3.0)].concat();
    positions.push(positions[5]);
    let sheet =
        Sheet { positions, triangles: vec![[0, 1, 2], [0, 3, 4], [5, 6, 7], [10, 8, 9]], ..Sheet::default() };
    let draft = draft_of(sheet.clone());
    assert_eq!(elements(&draft, "non-manifold-vertex"), [0]);
    assert!(!found_in(&draft).contains(&"duplicate-position".to_owned()), "the second pair is one taxel");
    let assembled = assemble(&draft_of(sheet)).unwrap();
    assert_eq!(assembled.skin.patches.len(), 4);
    assert_eq!(assembled.remarks[0].kind, RemarkKind::FansSplit { vertices: vec![VertexId::new(0)] });
}

#[test]
fn real_covers_without_mistakes_have_no_findings() {
    for name in ["ur10e_link1_patch1_isomap.json", "ur10e_link1_patch2_isomap.json"] {
        let Some(draft) = cover(name) else { continue };
        // Its modules were drawn by stretching a lattice over the shell.
        let mut findings = check(&draft);
        findings.retain(|finding| !matches!(finding.kind, FindingKind::ModulesNotCongruent { .. }));
        assert_eq!(findings, [], "{name}");
        let assembled = assemble(&draft).unwrap();
        assert_eq!(assembled.remarks, [], "{name}");
        assert_eq!(topology(&only(&assembled).mesh), (1, 1), "{name}");
    }
}

#[test]
fn two_covers_merged_badly_are_refused_with_their_edges() {
    let Some(draft) = cover("broken_link1_patches_1_2.json") else { return };
    let SkinError::NonManifoldEdges { edges, .. } = assemble(&draft).unwrap_err() else { panic!("edges") };
    assert_eq!(edges.len(), 1831);
    assert_eq!(elements(&draft, "non-manifold-edge").len(), 2 * 1831);
    assert_eq!(elements(&draft, "isolated-taxel").len(), 642);
}

#[test]
fn two_covers_in_one_file_are_two_patches() {
    let Some(draft) = cover("two_components.json") else { return };
    let assembled = assemble(&draft).unwrap();
    let names: Vec<&str> = assembled.skin.patches.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["cover", "cover.1"]);
    assert_eq!(kinds(&assembled), ["Components", "Turned"].map(String::from).into());
}

#[test]
fn the_hexagon_cover_is_turned_over_and_loses_two_flat_faces() {
    let Some(draft) = cover("hexagon_isomap.json") else { return };
    let assembled = assemble(&draft).unwrap();
    let mesh = &only(&assembled).mesh;
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (61, 96), "no taxel is lost");
    assert_eq!(topology(mesh), (1, 1), "no slit");
    assert_eq!(kinds(&assembled), ["Turned", "ZeroAreaDropped"].map(String::from).into());
    assert_eq!(found_in(&draft), ["zero-area-face", "winding-against-normals"]);
}

/// Coordinates of few values, so that vertices coincide and lie in line, and now and then what is
/// no number.
fn coordinate() -> impl Strategy<Value = f64> {
    let odd = prop::sample::select(vec![f64::NAN, f64::INFINITY, 1e300, -1e300, 1e-300, 1e18, -0.0]);
    prop_oneof![40 => (-2_i32..3).prop_map(f64::from), 1 => odd]
}

/// Any sheet at all: corners out of range, arrays of any length, positions that are no numbers.
fn any_sheet() -> impl Strategy<Value = Sheet> {
    let position = || [coordinate(), coordinate(), coordinate()].prop_map(DVec3::from_array);
    let vertices = prop::collection::vec(position(), 0..14);
    let triangles = prop::collection::vec([0_u32..15, 0..14, 0..14], 0..24);
    (vertices, triangles, prop::collection::vec((0_u32..4, position(), coordinate()), 13..15), 0_u8..64)
        .prop_map(|(positions, triangles, taxels, has)| {
            let count = if has & 32 == 0 { positions.len() } else { taxels.len() };
            let taxels = &taxels[..count.min(taxels.len())];
            let numbers = || taxels.iter().map(|t| t.2).collect();
            Sheet {
                name: String::new(),
                link: (has & 48 == 48).then_some(0_u32.into()),
                positions,
                triangles,
                ids: (has & 1 > 0).then(|| taxels.iter().map(|t| TaxelId(t.0)).collect()),
                normals: (has & 2 > 0).then(|| taxels.iter().map(|t| t.1).collect()),
                tangents: (has & 6 > 0).then(|| taxels.iter().map(|t| t.1.zxy()).collect()),
                areas: (has & 4 > 0).then(numbers),
                densities: (has & 8 > 0).then(numbers),
                presence: (has & 16 > 0).then(|| vec![Presence::Absent; taxels.len()]),
                ..Sheet::default()
            }
        })
}

/// A lattice with some faces gone, some turned, some vertices moved onto others: close to a skin.
fn damaged_sheet() -> impl Strategy<Value = Sheet> {
    let mesh = shapes::sheet(5, 5, |i, j| DVec3::new(f64::from(i), f64::from(j), 0.0));
    let sheet = sheet_of("damaged", &mesh);
    (prop::collection::vec(0_u8..12, 32), prop::collection::vec((0_usize..25, 0_usize..25), 0..3), 0_u32..7)
        .prop_map(move |(fates, moves, split)| {
            let mut sheet = sheet.clone();
            for (from, to) in moves {
                sheet.positions[from] = 0.5 * (sheet.positions[to] + sheet.positions[(to + 2) % 25]);
            }
            let mut triangles = Vec::new();
            for (t, fate) in sheet.triangles.iter().zip(fates) {
                match fate {
                    0 => {}
                    1 => triangles.push([t[0], t[2], t[1]]),
                    _ => triangles.push(*t),
                }
            }
            // Every seventh corner or so gets a vertex of its own.
            for corner in triangles.iter_mut().flatten().filter(|v| **v % 7 == split) {
                sheet.positions.push(sheet.positions[*corner as usize]);
                *corner = u32::try_from(sheet.positions.len() - 1).unwrap();
            }
            sheet.triangles = triangles;
            sheet
        })
}

/// Some CAD files have strips of points that rounding put on a line: the faces around the one in the
/// middle have no area, and none of their edges can be flipped. It is a taxel all the same.
#[test]
fn a_taxel_between_faces_without_area_is_kept() {
    let mm = |x: f64, y: f64, z: f64| 1e-3 * DVec3::new(x, y, z);
    let around = [(0.0, -0.9, 5.8), (0.0, 5.9, -9.9), (2.2, 9.8, -3.1)].map(|(x, y, z)| mm(x, y, z));
    let beyond = [(-4.0, -7.3, 5.7), (-4.0, -6.2, -1.8), (-4.0, -3.2, -8.7)].map(|(x, y, z)| mm(x, y, z));
    let strip = [-1.0, 0.0, 1.0, 1.6, 2.0].map(|z| mm(0.0, 0.0, 1e-5 * z));
    let positions: Vec<DVec3> =
        beyond.into_iter().chain([around[0]]).chain(strip).chain([around[1], around[2]]).collect();
    let corners = [
        3, 8, 10, 5, 8, 7, 5, 4, 8, 9, 10, 4, 4, 10, 8, 4, 5, 6, 6, 5, 7, 8, 0, 7, 0, 8, 3, 9, 4, 2, 6, 2, 4,
        6, 7, 2, 1, 7, 0, 7, 1, 2,
    ];
    let mesh = TriMesh::from_arrays(positions, corners.as_chunks().0);
    let assembled = assemble(&draft_of(sheet_of("strip", &mesh))).unwrap();
    assert!(kinds(&assembled).contains("ZeroAreaKept"), "{:?}", assembled.remarks);
    let taxels = &assembled.skin.patches[PatchId::new(0)].taxels;
    assert_eq!(taxels.ids.len(), 11);
    assert!(taxels.areas.iter().any(|area| *area < 1e-20), "one has next to nothing");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// What is assembled is a valid skin, and no error was found in it; what is refused has findings.
    #[test]
    fn any_draft_without_errors_is_a_valid_skin(sheet in any_sheet(), other in any_sheet()) {
        let sheets = [("a", sheet), ("b", other)].map(|(name, sheet)| Sheet { name: name.into(), ..sheet });
        let draft = Draft { sheets: sheets.to_vec(), ..Draft::default() };
        let findings = check(&draft);
        let is_error = |finding: &&Finding| finding.severity() == Severity::Error;
        match assemble(&draft) {
            Ok(assembled) => {
                prop_assert_eq!(assembled.skin.validate(), Ok(()));
                // A sheet may have errors where all of its faces are left out.
                let is_kept = |finding: &&Finding| {
                    let patches = assembled.skin.patches.iter();
                    patches.clone().any(|patch| patch.name.starts_with(&finding.patch))
                };
                prop_assert_eq!(findings.iter().filter(is_kept).find(is_error), None);
            }
            Err(error) => prop_assert!(findings.iter().any(|found| is_error(&found)), "{} without an error", error),
        }
        let told: BTreeSet<_> = findings.iter().map(|f| (f.kind.to_string(), &f.patch)).collect();
        prop_assert_eq!(told.len(), findings.len(), "one finding of each kind and sheet: {:?}", findings);
    }

    /// What is assembled once is taken as it is the second time.
    #[test]
    fn assembling_twice_changes_nothing_more(sheet in damaged_sheet()) {
        let Ok(first) = assemble(&draft_of(sheet)) else { return Ok(()) };
        let sheets = first.skin.patches.iter().map(|p| Sheet {
            link: Some(p.link),
            ids: Some(p.taxels.ids.as_slice().to_vec()),
            normals: Some(p.taxels.normals.as_slice().to_vec()),
            areas: Some(p.taxels.areas.as_slice().to_vec()),
            ..sheet_of(&p.name, &p.mesh)
        });
        let again = assemble(&Draft { links: first.skin.links.clone(), sheets: sheets.collect(), ..Draft::default() }).unwrap();
        let told = kinds(&again);
        // Damage may fold a sheet: flat normals on it look like a placeholder, and some faces stay
        // without area.
        let tolerated = ["ZeroAreaDropped", "ZeroAreaFlipped", "ZeroAreaKept", "NormalsReplaced", "NormalsIgnored"].map(String::from).into();
        prop_assert!(told.is_subset(&tolerated), "{:?}", again.remarks);
        if told.is_empty() {
            for (now, then) in again.skin.patches.iter().zip(&first.skin.patches) {
                prop_assert_eq!((&now.name, &now.mesh, &now.taxels.ids), (&then.name, &then.mesh, &then.taxels.ids));
                let turned = now.taxels.normals.iter().zip(&then.taxels.normals).map(|(n, m)| n.distance(*m));
                prop_assert!(turned.fold(0.0, f64::max) < 1e-12, "normals");
            }
        }
    }

    /// Faces without area are cleared without tearing the sheet: its Euler characteristic per piece
    /// stays.
    #[test]
    fn clearing_faces_without_area_opens_no_hole(places in prop::collection::vec((0_usize..16, 0_u8..3), 1..6)) {
        // Vertices of a lattice slid along its lines make faces without area, all in one plane.
        let mut mesh = shapes::sheet(4, 4, |i, j| DVec3::new(f64::from(i), f64::from(j), 0.0));
        for (v, way) in places {
            let p = &mut mesh.positions[VertexId::new(v)];
            match way {
                0 => p.x += 1e-9,
                1 => p.y += 1.0,
                _ => p.x = 1.5,
            }
        }
        // Ids of their own: only taxels joined by an edge without length are welded.
        let sheet = Sheet { ids: Some((1..=16).map(TaxelId).collect()), ..sheet_of("s", &mesh) };
        if let Ok(assembled) = assemble(&draft_of(sheet)) {
            for patch in &assembled.skin.patches {
                prop_assert_eq!(topology(&patch.mesh), (1, 1));
            }
        }
    }
}
