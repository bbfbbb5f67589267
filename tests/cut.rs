//! Laws of cutting: what becomes a disk, what stays whole, and what changes nothing.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use dermatome::{
    Error,
    cut::{Cut, CutError, CutMesh},
    flatten::{Energy, distortion},
    id::{FaceId, IdVec, VertexId},
    mesh::{Adjacency, TriMesh, shapes},
    pipeline::{FlatMesh, cut_open, flatten_patch},
    skin::{Patch, PatchId, Skin, TaxelId},
};
use glam::{DAffine3, DQuat, DVec2, DVec3};

fn patch(mesh: TriMesh) -> Patch {
    Skin::from_mesh("skin", mesh).patches[PatchId::new(0)].clone()
}

fn auto(mesh: &TriMesh) -> Option<CutMesh> {
    cut_open(&patch(mesh.clone()), &Cut::Auto).unwrap()
}

fn flat(mesh: &TriMesh) -> FlatMesh {
    flatten_patch(&patch(mesh.clone()), &Cut::Auto, &Energy::SymmetricDirichlet.into()).unwrap()
}

/// Euler characteristic and boundary loops of the mesh after the cut.
fn shape(mesh: &TriMesh, cut: &CutMesh) -> (i64, usize) {
    let positions = cut.unsplit.map(|&v| mesh.positions[v]);
    let adjacency = Adjacency::new(&TriMesh { positions, triangles: cut.triangles.clone() }).unwrap();
    (adjacency.euler_characteristic(), adjacency.boundary_loops().len())
}

/// Seam length over the square root of the area.
fn seam(mesh: &TriMesh, flat: &FlatMesh) -> f64 {
    flat.seam / mesh.area().sqrt()
}

#[test]
fn a_closed_surface_becomes_a_disk() {
    let shapes = [
        shapes::tetrahedron(),
        shapes::ball(2, 0.1),
        shapes::ball(12, 0.1),
        shapes::torus(30, 14, 0.1, 0.04),
        shapes::frame(2, 3, 0.01),
        shapes::frame(3, 2, 0.01),
    ];
    for mesh in shapes {
        let faces = mesh.triangles.len();
        let cut = auto(&mesh).expect("a closed surface has no map");
        assert_eq!(shape(&mesh, &cut), (1, 1), "{faces} faces");
        for (corners, whole) in cut.triangles.iter().zip(&mesh.triangles) {
            assert_eq!(corners.map(|v| cut.unsplit[v]), *whole, "the faces are the same");
        }
        for v in mesh.positions.ids() {
            assert_eq!(cut.unsplit[v], v, "copies come last");
        }
    }
}

#[test]
fn a_disk_is_never_cut() {
    assert_eq!(auto(&shapes::cap(900, 0.1, 2.6)), None, "however round it is");
    assert_eq!(cut_open(&patch(shapes::cap(300, 0.1, 1.0)), &Cut::All).unwrap(), None);
    assert_eq!(cut_open(&patch(shapes::torus(12, 8, 0.1, 0.04)), &Cut::None).unwrap(), None);
}

/// A cylinder cut along a generator is its rectangle.
#[test]
fn a_cylinder_is_unrolled() {
    let (radius, height) = (0.04, 0.15);
    let mesh = shapes::tube(48, 24, radius, height);
    let flat = flat(&mesh);
    let measured = distortion(&flat.mesh, &flat.uv);
    assert!((measured.symmetric_dirichlet - 4.0).abs() < 1e-4, "{measured:?}");
    let (lo, hi) =
        flat.uv.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    assert!(flat.seam < 1.1 * height, "{} m", flat.seam);
    let sides = hi - lo;
    let area = sides.x * sides.y;
    assert!((area / mesh.area() - 1.0).abs() < 0.08, "a rectangle but for the zigzag of its sides: {sides}");
}

/// Cutting a torus once around and once through leaves it far from flat, but a map.
#[test]
fn a_torus_is_cut_both_ways() {
    let mesh = shapes::torus(60, 24, 0.1, 0.04);
    let flat = flat(&mesh);
    let measured = distortion(&flat.mesh, &flat.uv);
    assert_eq!(measured.flips, 0);
    assert!(measured.symmetric_dirichlet < 4.3, "{measured:?}");
    assert!(seam(&mesh, &flat) < 2.6, "{}", seam(&mesh, &flat));
}

#[test]
fn slits_let_a_ball_be_flat() {
    let mesh = shapes::ball(16, 0.05);
    let flat = flat(&mesh);
    let measured = distortion(&flat.mesh, &flat.uv);
    assert_eq!(measured.flips, 0);
    assert!(measured.symmetric_dirichlet < 4.3, "{measured:?}");
    assert!(seam(&mesh, &flat) < 2.4, "{}", seam(&mesh, &flat));
}

#[test]
fn rotation_and_scale_change_nothing() {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0);
    let moved =
        DAffine3::from_scale_rotation_translation(DVec3::splat(37.0), turn, DVec3::new(5.0, -3.0, 2.0));
    for mesh in [shapes::ball(9, 0.1), shapes::torus(30, 14, 0.1, 0.04), shapes::tube(24, 16, 0.05, 0.2)] {
        let other = TriMesh { positions: mesh.positions.map(|&p| moved.transform_point3(p)), ..mesh.clone() };
        assert_eq!(auto(&mesh), auto(&other), "{} faces", mesh.triangles.len());
    }
}

#[test]
fn threads_change_nothing() {
    let mesh = shapes::ball(10, 0.1);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| auto(&mesh))
    };
    assert_eq!(with(1), with(3));
}

/// Seams keep away from where taxels are dense.
#[test]
fn a_seam_avoids_dense_taxels() {
    let mesh = shapes::tube(32, 16, 0.05, 0.2);
    let mut patch = patch(mesh.clone());
    let is_dense = |p: DVec3| p.x > 0.02;
    patch.taxels.densities = Some(mesh.positions.map(|&p| if is_dense(p) { 1e6 } else { 1e4 }));
    let cut = cut_open(&patch, &Cut::Auto).unwrap().unwrap();
    let copies = cut.unsplit.iter().skip(mesh.positions.len());
    assert!(copies.copied().all(|v| !is_dense(mesh.positions[v])), "the seam runs through none of them");
}

/// Vendor ids of the taxels along a line of a tube, bottom to top.
fn line(mesh: &TriMesh, columns: usize) -> Vec<TaxelId> {
    let ids = patch(mesh.clone()).taxels.ids;
    (0..mesh.positions.len() / columns).map(|row| ids[VertexId::new(row * columns)]).collect()
}

fn along(mesh: &TriMesh, pairs: Vec<[TaxelId; 2]>) -> Result<Option<CutMesh>, Error> {
    cut_open(&patch(mesh.clone()), &Cut::Along(pairs))
}

#[test]
fn a_given_seam_is_cut() {
    let mesh = shapes::tube(12, 8, 0.05, 0.2);
    let line = line(&mesh, 12);
    let pairs: Vec<_> = line.windows(2).map(|p| [p[0], p[1]]).collect();
    let cut = along(&mesh, pairs).unwrap().unwrap();
    assert_eq!(shape(&mesh, &cut), (1, 1));
    let copies: Vec<_> = cut.unsplit.iter().skip(mesh.positions.len()).copied().collect();
    assert_eq!(copies.len(), line.len(), "every vertex of the line twice");
}

#[test]
fn a_bad_seam_is_refused_by_name() {
    let mesh = shapes::tube(12, 8, 0.05, 0.2);
    let ids = patch(mesh.clone()).taxels.ids;
    let id = |k: usize| ids[VertexId::new(k)];
    let refused = |pairs| match along(&mesh, pairs) {
        Err(Error::Cut(error)) => error,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(vec![[id(0), id(50)]]), CutError::NotAnEdge { from: id(0), to: id(50) });
    assert_eq!(refused(vec![[id(0), id(1)]]), CutError::OnBoundary { from: id(0), to: id(1) });
    let nobody = TaxelId(4_000_000);
    assert_eq!(refused(vec![[id(0), nobody]]), CutError::Taxel { id: nobody, found: 0 });
    let around = (0..12).map(|k| [id(36 + k), id(36 + (k + 1) % 12)]).collect();
    assert!(matches!(refused(around), CutError::Disconnects { components: 2, .. }));
    let torus = shapes::torus(12, 8, 0.1, 0.04);
    let ids = patch(torus.clone()).taxels.ids;
    let once = (0..12).map(|k| [ids[VertexId::new(k)], ids[VertexId::new((k + 1) % 12)]]).collect();
    let half = along(&torus, once).unwrap().unwrap();
    assert_eq!(shape(&torus, &half), (0, 2), "cut once around, a torus is a ring");
}

#[test]
fn several_pieces_are_refused() {
    let mut mesh = shapes::ball(3, 0.1);
    let (count, triangles) = (mesh.positions.len(), mesh.triangles.clone());
    for p in mesh.positions.clone().iter() {
        mesh.positions.push(*p + DVec3::X);
    }
    for t in &triangles {
        let moved: [VertexId; 3] = t.map(|v| VertexId::new(v.index() + count));
        let _: FaceId = mesh.triangles.push(moved);
    }
    let ids: IdVec<VertexId, TaxelId> = mesh.positions.ids().map(|v| TaxelId(v.raw())).collect();
    let mut both = patch(shapes::triangle());
    both.taxels = dermatome::skin::Taxels::of_mesh(&mesh);
    (both.taxels.ids, both.mesh) = (ids, mesh);
    assert!(cut_open(&both, &Cut::Auto).is_err(), "a patch is one piece");
}

#[test]
fn all_joins_every_loop() {
    let mesh = shapes::tube(24, 10, 0.03, 0.01);
    let made = |cut| cut_open(&patch(mesh.clone()), &cut).unwrap();
    let all = made(Cut::All).unwrap();
    assert_eq!(shape(&mesh, &all), (1, 1));
}
