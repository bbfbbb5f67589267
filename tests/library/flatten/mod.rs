//! Laws of flattening.

mod inputs;

use std::f64::consts::{PI, TAU};

use crate::altered::{renumbered, without};
use crate::common::data;
use dermatome::{
    flatten::{Boundary, Distortion, Energy, FlattenError, FlattenOptions, Method, Overlap, distortion},
    id::{FaceId, IdVec, VertexId},
    io::read_draft,
    mesh::{Adjacency, TriMesh, shapes},
    pyramid::{CoarsenOptions, LevelId, Pyramid, coarsen},
    run::Run,
    skin::{AssembleOptions, PatchId, TaxelError, TaxelId, Taxels, assemble},
};
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;

fn flatten(mesh: &TriMesh, options: &FlattenOptions) -> Result<IdVec<VertexId, DVec2>, FlattenError> {
    dermatome::flatten::flatten(mesh, None, options, Run::default()).map(|map| map.uv)
}

fn flatten_pyramid(
    pyramid: &Pyramid,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
) -> Result<IdVec<LevelId, IdVec<VertexId, DVec2>>, FlattenError> {
    let maps = dermatome::flatten::flatten_pyramid(pyramid, taxels, options, Run::default())?;
    Ok(maps.map(|map| map.uv.clone()))
}

const LINEAR: Method = Method::Linear { angle: 1.0, area: 1.0 };

fn sum(angle: f64, area: f64, perimeter: f64) -> FlattenOptions {
    Energy::Sum { angle, area, perimeter }.into()
}

/// The taxels of a mesh with these densities, in 1/m^2.
fn dense(mesh: &TriMesh, densities: IdVec<VertexId, f64>) -> Taxels {
    Taxels { densities: Some(densities), ..Taxels::from(mesh) }
}

fn magnified(energy: Energy, magnify: f64) -> FlattenOptions {
    Method::Intrinsic { energy, magnify }.into()
}

fn is_intrinsic(options: &FlattenOptions) -> bool {
    matches!(options.method, Method::Intrinsic { .. })
}

/// Every way to flatten that must reproduce what is flat already.
fn all_methods() -> [FlattenOptions; 5] {
    [
        FlattenOptions::default(),
        Energy::SymmetricDirichlet.into(),
        Method::Conformal.into(),
        LINEAR.into(),
        sum(1.0, 1.0, 1.0),
    ]
}

/// The two intrinsic energies.
fn energies() -> [FlattenOptions; 2] {
    [FlattenOptions::default(), Energy::SymmetricDirichlet.into()]
}

/// The maps of a pyramid, none of which flips a face or crosses itself on any level.
fn one_to_one(pyramid: &Pyramid, options: &FlattenOptions) -> IdVec<LevelId, IdVec<VertexId, DVec2>> {
    let maps = flatten_pyramid(pyramid, None, options).unwrap();
    for (level, uv) in maps.enumerate() {
        let d = distortion(&pyramid.levels[level].mesh, uv);
        assert_eq!((d.flips, d.crossings), (0, 0), "level {level} with {options:?}: {d:?}");
    }
    maps
}

fn centre_of(mesh: &TriMesh, face: FaceId) -> DVec3 {
    mesh.corners(face).iter().sum::<DVec3>() / 3.0
}

fn measure(mesh: &TriMesh, options: &FlattenOptions) -> Distortion {
    distortion(mesh, &flatten(mesh, options).unwrap())
}

fn pyramid_of(mesh: &TriMesh) -> Pyramid {
    coarsen(mesh, &Taxels::from(mesh), &CoarsenOptions::default(), Run::default()).unwrap()
}

/// A sheet with a bump and a dent, of heights `a` and `b`.
fn bumpy(columns: u32, rows: u32, a: f64, b: f64) -> TriMesh {
    let mut mesh = shapes::lattice(columns, rows, 0.01);
    let size = mesh.positions.iter().copied().fold(DVec3::ZERO, DVec3::max);
    for p in mesh.positions.iter_mut() {
        let q = p.truncate() / size.truncate();
        let bump = |at: DVec2, width: f64| (-(q - at).length_squared() / (width * width)).exp();
        p.z = size.y * (a * bump(DVec2::new(0.3, 0.4), 0.2) - b * bump(DVec2::new(0.7, 0.6), 0.15));
    }
    mesh
}

/// Rolled around a cylinder: every triangle keeps its sides if the lattice is fine, exactly here,
/// because each vertex moves on a polygon whose sides are the lattice's.
fn rolled(columns: u32, rows: u32) -> TriMesh {
    // Square cells cut along a diagonal, folded along whole columns only: a developable polyhedron.
    let turn = 4.0 * PI / 3.0 / f64::from(columns - 1);
    let mut at = DVec2::ZERO;
    let mut profile = vec![at];
    for i in 1..columns {
        at += DVec2::from_angle(turn * f64::from(i)) * 0.01;
        profile.push(at);
    }
    shapes::sheet(columns, rows, |i, j| profile[i as usize].extend(0.01 * f64::from(j)))
}

/// A spiral ramp of this many turns around a hole: nearly flat, so its turns overlap on a map.
fn ramp(columns: u32, rows: u32, turns: f64) -> TriMesh {
    shapes::sheet(columns, rows, |i, j| {
        let turn = 2.0 * PI * turns * f64::from(i) / f64::from(columns - 1);
        let radius = 0.05 + 0.05 * f64::from(j) / f64::from(rows - 1);
        (radius * DVec2::from_angle(-turn)).extend(0.004 * turn)
    })
}

/// A tube of equilateral triangles, `around` of them around, whose upper end is narrower by
/// `taper`.
fn sleeve(around: u32, radius: f64, height: f64, taper: f64) -> TriMesh {
    let side = 2.0 * PI * radius / f64::from(around);
    let rows = (2_u32..).find(|&n| f64::from(n - 1) * side * 3_f64.sqrt() / 2.0 >= height).unwrap();
    let mut mesh = shapes::tube(around, rows, radius, height);
    for p in mesh.positions.iter_mut() {
        let narrowed = p.truncate() * (1.0 - taper * p.z / height);
        *p = narrowed.extend(p.z);
    }
    mesh
}

/// What is wrong with the map of a disk with holes, if anything: at an inner vertex the angles must
/// add up to one turn, and one loop must run counter-clockwise, the others clockwise.
fn fold(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Option<String> {
    let adjacency = Adjacency::new(mesh).unwrap();
    let mut turn = uv.map(|_| 0.0);
    for &[a, b, c] in &mesh.triangles {
        for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            turn[v] += (uv[from] - uv[v]).angle_to(uv[to] - uv[v]);
        }
    }
    let mut inner = turn.enumerate().filter(|(v, _)| !adjacency.is_boundary(*v));
    if let Some((v, t)) = inner.find(|(_, t)| (**t - 2.0 * PI).abs() > 1e-6) {
        return Some(format!("{t} rad of faces around vertex {v}"));
    }
    let area = |walk: &Vec<VertexId>| -> f64 {
        (0..walk.len()).map(|k| uv[walk[k]].perp_dot(uv[walk[(k + 1) % walk.len()]])).sum()
    };
    let outer = adjacency.boundary_loops().iter().filter(|walk| area(walk) > 0.0).count();
    (outer != 1).then(|| format!("{outer} loops run counter-clockwise"))
}

fn free(options: FlattenOptions) -> FlattenOptions {
    FlattenOptions { overlap: Overlap::Allow, ..options }
}

/// Distances of map positions from places in the plane, after the rotation and translation that fit best.
fn fitted(flat: &[DVec2], uv: &[DVec2]) -> Vec<f64> {
    let n = uv.len() as f64;
    let (a, b) = (flat.iter().sum::<DVec2>() / n, uv.iter().sum::<DVec2>() / n);
    let turn = |(p, q): (&DVec2, &DVec2)| DVec2::new((p - a).dot(q - b), (p - a).perp_dot(q - b));
    let turn = flat.iter().zip(uv).map(turn).sum::<DVec2>().normalize();
    flat.iter().zip(uv).map(|(p, q)| turn.rotate(p - a).distance(q - b)).collect()
}

/// The largest of them, from the places of a flat mesh.
fn rigid_distance(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> f64 {
    let flat: Vec<DVec2> = mesh.positions.iter().map(|p| p.truncate()).collect();
    fitted(&flat, uv.as_slice()).into_iter().fold(0.0, f64::max)
}

#[test]
fn a_flat_patch_flattens_to_itself() {
    for mesh in [shapes::triangle(), shapes::square(), shapes::fan(7), shapes::lattice(14, 9, 0.01)] {
        for options in all_methods() {
            let uv = flatten(&mesh, &options).unwrap();
            let error = rigid_distance(&mesh, &uv);
            assert!(error < 1e-9, "{error} m with {options:?} on {} faces", mesh.triangles.len());
        }
    }
}

#[test]
fn a_flat_patch_with_slivers_flattens_to_itself() {
    let mut mesh = shapes::lattice(8, 6, 0.01);
    // One column pushed against the next: faces a ten-thousandth as wide as high.
    for (v, p) in mesh.positions.clone().enumerate() {
        if v.index() % 8 == 3 {
            mesh.positions[v].x = p.x + 0.009_999;
        }
    }
    for options in [FlattenOptions::default(), Energy::SymmetricDirichlet.into(), Method::Conformal.into()] {
        let error = rigid_distance(&mesh, &flatten(&mesh, &options).unwrap());
        assert!(error < 1e-9, "{error} m with {options:?}");
    }
}

#[test]
fn a_large_flat_patch_flattens_to_itself_through_its_pyramid() {
    let mesh = shapes::lattice(90, 70, 0.004);
    let error = rigid_distance(&mesh, &flatten(&mesh, &FlattenOptions::default()).unwrap());
    assert!(error < 1e-9, "{error} m");
}

#[test]
fn a_rolled_sheet_unrolls_without_distortion() {
    let mesh = rolled(40, 12);
    for options in all_methods() {
        let d = measure(&mesh, &options);
        assert!((d.symmetric_dirichlet - 4.0).abs() < 1e-6, "{d:?} with {options:?}");
        assert_eq!((d.flips, d.crossings), (0, 0));
    }
}

#[test]
fn moving_and_turning_the_skin_changes_nothing() {
    let mesh = bumpy(16, 12, 0.6, 0.4);
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
    let moved =
        TriMesh { positions: mesh.positions.map(|&p| turn * p + DVec3::new(0.4, -0.3, 1.2)), ..mesh.clone() };
    for options in all_methods() {
        let (a, b) = (flatten(&mesh, &options).unwrap(), flatten(&moved, &options).unwrap());
        let error = a.iter().zip(&b).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
        assert!(error < 1e-8, "{error} m with {options:?}");
    }
}

#[test]
fn a_larger_skin_has_a_larger_map() {
    let mesh = bumpy(16, 12, 0.6, 0.4);
    for scale in [1e-3, 1e4] {
        let scaled = TriMesh { positions: mesh.positions.map(|&p| p * scale), ..mesh.clone() };
        for options in all_methods() {
            let (a, b) = (flatten(&mesh, &options).unwrap(), flatten(&scaled, &options).unwrap());
            let error = a.iter().zip(&b).map(|(p, q)| (*p * scale).distance(*q)).fold(0.0, f64::max);
            assert!(error < 1e-8 * scale, "{error} m at {scale} with {options:?}");
        }
    }
}

#[test]
fn the_numbering_of_the_vertices_does_not_matter() {
    let mesh = bumpy(16, 12, 0.6, 0.4);
    let count = mesh.positions.len();
    let order: Vec<usize> = (0..count).map(|v| (v * 77 + 5) % count).collect();
    let other = renumbered(&mesh, &order);
    for options in all_methods() {
        let (a, b) = (measure(&mesh, &options), measure(&other, &options));
        // The linear map depends on which vertices are pinned, and those are found from the first
        // one.
        let tolerance = if options.method == LINEAR { 0.1 } else { 1e-9 };
        assert!((a.qc_mean - b.qc_mean).abs() < tolerance, "{a:?} is {b:?} with {options:?}");
        assert!((a.symmetric_dirichlet - b.symmetric_dirichlet).abs() < 10.0 * tolerance, "{a:?} is {b:?}");
    }
}

#[test]
fn a_map_is_as_large_as_the_skin_and_centred() {
    let mesh = shapes::saddle(14);
    for options in all_methods() {
        let uv = flatten(&mesh, &options).unwrap();
        let map = TriMesh { positions: uv.map(|p| p.extend(0.0)), ..mesh.clone() };
        assert!((map.area() / mesh.area() - 1.0).abs() < 1e-12, "area {} with {options:?}", map.area());
        let centre: DVec3 = mesh
            .triangles
            .ids()
            .map(|f| map.corners(f).iter().sum::<DVec3>() / 6.0 * mesh.face_cross(f).length())
            .sum();
        assert!(centre.length() / mesh.area() < 1e-12, "centre {centre} with {options:?}");
    }
}

/// The energies agree with what the metrics say: no other method comes closer to an isometry.
#[test]
fn the_intrinsic_map_of_a_cap_has_the_least_energy() {
    let mesh = shapes::cap(900, 0.1, 1.9);
    let best = measure(&mesh, &Energy::SymmetricDirichlet.into()).symmetric_dirichlet;
    for options in all_methods() {
        let d = measure(&mesh, &options);
        assert!(d.symmetric_dirichlet > best - 1e-9, "{d:?} with {options:?} beats {best}");
    }
    // The optimum of a fine cap of 110 degrees is 4.335; this one is coarse.
    assert!((4.30..4.37).contains(&best), "{best}");
}

#[test]
fn more_weight_on_an_aspect_means_less_distortion_of_it() {
    let mesh = shapes::saddle(18);
    let with = |angle: f64, area: f64| measure(&mesh, &sum(angle, area, 0.0));
    let (conformal, even, authalic) = (with(1.0, 0.1), with(1.0, 1.0), with(0.1, 1.0));
    assert!(conformal.qc_mean < even.qc_mean && even.qc_mean < authalic.qc_mean);
    assert!(conformal.area_mean > even.area_mean && even.area_mean > authalic.area_mean);
}

/// Without an area term nothing fixes the scale; it must neither drift nor flip.
#[test]
fn single_terms_keep_every_face() {
    for mesh in [shapes::saddle(14), shapes::cap(500, 0.1, 2.0), bumpy(16, 12, 0.8, 0.6)] {
        for (angle, area, perimeter) in
            [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0), (1e-9, 1e9, 0.0)]
        {
            let options = sum(angle, area, perimeter);
            let d = measure(&mesh, &options);
            assert_eq!(d.flips, 0, "{options:?}");
            assert!(d.symmetric_dirichlet.is_finite(), "{d:?} with {options:?}");
        }
    }
}

#[test]
fn holes_stay_holes() {
    let whole = shapes::lattice(24, 20, 0.01);
    let centre = whole.positions.iter().sum::<DVec3>() / 480.0;
    let mesh = without(&whole, |face| centre_of(&whole, face).distance(centre) <= 0.035);
    for options in all_methods() {
        let error = rigid_distance(&mesh, &flatten(&mesh, &options).unwrap());
        assert!(error < 1e-9, "{error} m with {options:?}");
    }
    // A tube has a hole too, and no flat map without distortion.
    let d = measure(&shapes::tube(20, 12, 0.05, 0.1), &FlattenOptions::default());
    assert_eq!((d.flips, d.crossings), (0, 0), "{d:?}");
}

#[test]
fn magnification_gives_dense_skin_a_larger_share() {
    let mesh = shapes::lattice(20, 20, 0.01);
    let is_dense = |p: &DVec3| p.x < 0.1;
    let densities = mesh.positions.map(|p| if is_dense(p) { 4e4 } else { 1e4 });
    let pyramid = pyramid_of(&mesh);
    let share = |magnify: f64| {
        let options = magnified(Energy::default(), magnify);
        let maps = flatten_pyramid(&pyramid, Some(&dense(&mesh, densities.clone())), &options).unwrap();
        let uv = &maps[LevelId::new(0)];
        assert_eq!(distortion(&mesh, uv).flips, 0);
        let map = TriMesh { positions: uv.map(|p| p.extend(0.0)), ..mesh.clone() };
        let inside = mesh.triangles.ids().filter(|&f| mesh.corners(f).iter().all(&is_dense));
        inside.map(|f| 0.5 * map.face_cross(f).length()).sum::<f64>() / map.area()
    };
    let (isometric, equal) = (share(0.0), share(1.0));
    assert!(equal > 1.4 * isometric, "{isometric} grows to {equal}");
}

/// The levels above only find the minimum sooner. Level 0 used to be magnified once for its way
/// down from level 1 and again for the map from nothing that is compared with it.
#[test]
fn magnification_does_not_depend_on_the_levels_above() {
    let mesh = bumpy(30, 24, 0.5, 0.3);
    let densities = mesh.positions.map(|p| 1e4 * (10.0 * p.x).exp());
    for energy in [Energy::default(), Energy::SymmetricDirichlet] {
        let options = magnified(energy, 1.0);
        let level_0 = |levels: Option<usize>| {
            let levels = CoarsenOptions { levels, ..CoarsenOptions::default() };
            let pyramid = coarsen(&mesh, &Taxels::from(&mesh), &levels, Run::default()).unwrap();
            let maps = flatten_pyramid(&pyramid, Some(&dense(&mesh, densities.clone())), &options).unwrap();
            (pyramid.levels.len(), maps[LevelId::new(0)].clone())
        };
        let (_, alone) = level_0(Some(0));
        for levels in [Some(1), Some(2), None] {
            let (count, below) = level_0(levels);
            let off = alone.iter().zip(&below).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
            assert!(off < 1e-6, "{off} m below {} levels with {energy:?}", count - 1);
        }
    }
}

#[test]
fn densities_are_checked() {
    let mesh = shapes::square();
    let pyramid = pyramid_of(&mesh);
    let options = magnified(Energy::default(), 1.0);
    let with = |d: Vec<f64>| flatten_pyramid(&pyramid, Some(&dense(&mesh, d.into())), &options).err();
    let refused = |e: TaxelError| Some(FlattenError::Taxels(e));
    let length = TaxelError::Length { what: "densities", found: 1, needed: 4 };
    assert_eq!(with(vec![1.0]), refused(length));
    let density = TaxelError::Density { vertex: VertexId::new(2), found: -2.0 };
    assert_eq!(with(vec![1.0, 1.0, -2.0, 1.0]), refused(density));
}

#[test]
fn what_is_not_a_disk_is_refused_with_its_numbers() {
    let refused = |mesh: &TriMesh| match flatten(mesh, &FlattenOptions::default()) {
        Err(FlattenError::NotADisk { euler, loops, components }) => (euler, loops, components),
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&shapes::tetrahedron()), (2, 0, 1));
    assert_eq!(refused(&shapes::torus(80, 60, 0.1, 0.03)), (0, 0, 1), "large meshes are refused alike");
    let mut torus = shapes::torus(8, 6, 0.1, 0.03);
    assert_eq!(refused(&torus), (0, 0, 1));
    torus.triangles = torus.triangles.into_iter().skip(1).collect();
    assert_eq!(refused(&torus), (-1, 1, 1), "one hole gives it a loop, but leaves the handle");
    let mut two = shapes::triangle();
    two.positions = two.positions.iter().flat_map(|&p| [p, p + 1.0]).collect();
    two.triangles = vec![[0, 2, 4].map(VertexId::new), [1, 3, 5].map(VertexId::new)].into();
    assert_eq!(refused(&two), (2, 2, 2));
    assert_eq!(refused(&TriMesh::default()), (0, 0, 0));
}

#[test]
fn weights_that_mean_nothing_are_refused_by_name() {
    let refused = |options: FlattenOptions| match flatten(&shapes::square(), &options) {
        Err(FlattenError::Option { name, .. }) => Some(name),
        _ => None,
    };
    assert_eq!(refused(FlattenOptions::default()), None);
    assert_eq!(refused(sum(1.0, -1.0, 0.0)), Some("area"));
    assert_eq!(refused(sum(1.0, 1.0, f64::NAN)), Some("perimeter"));
    assert_eq!(refused(magnified(Energy::default(), f64::INFINITY)), Some("magnify"));
    assert_eq!(refused(sum(0.0, 0.0, 1.0)), Some("angle"));
    assert_eq!(refused(Method::Linear { angle: 0.0, area: 0.0 }.into()), Some("angle"));
}

/// The distortion of a map of the unit square.
fn measured(map: impl Fn(DVec2) -> DVec2) -> Distortion {
    let mesh = shapes::square();
    let uv = mesh.positions.map(|p| map(p.truncate()));
    distortion(&mesh, &uv)
}

#[test]
fn an_isometry_has_no_distortion() {
    let d = measured(|p| DVec2::from_angle(0.7).rotate(p) + DVec2::splat(3.0));
    assert_eq!((d.flips, d.crossings), (0, 0));
    for x in [d.qc_mean, d.qc_max, d.area_mean, d.area_max, d.symmetric_dirichlet / 4.0] {
        assert!((x - 1.0).abs() < 1e-14, "{d:?}");
    }
}

#[test]
fn a_stretch_by_two_has_ratio_two_and_energy_five() {
    let d = measured(|p| p * DVec2::new(2.0, 1.0));
    assert!((d.qc_mean - 2.0).abs() < 1e-14 && (d.area_max - 1.0).abs() < 1e-14, "{d:?}");
    assert!((d.symmetric_dirichlet - 5.0).abs() < 1e-14, "{d:?}");
}

#[test]
fn a_mirrored_or_collapsed_map_is_all_flips() {
    assert_eq!(measured(|p| p * DVec2::new(-1.0, 1.0)).flips, 2);
    let d = measured(|_| DVec2::ZERO);
    assert_eq!(d.flips, 2);
    assert_eq!(d.symmetric_dirichlet, f64::INFINITY);
    assert!(d.qc_max.is_finite() && d.area_max.is_finite(), "{d:?}");
}

#[test]
fn a_fan_wound_twice_overlaps_itself_however_it_is_turned() {
    let mesh = shapes::fan(9);
    let wound = |turns: f64, by: f64| {
        let place = |v: VertexId| match v.index() {
            0 => DVec2::new(0.2, -0.1),
            k => DVec2::from_angle(2.0 * PI * turns * (k - 1) as f64 / 9.0 + 0.3),
        };
        let uv = mesh.positions.ids().map(|v| DVec2::from_angle(by).rotate(place(v))).collect();
        let Distortion { flips, crossings, .. } = distortion(&mesh, &uv);
        assert_eq!(flips, 0, "nothing is flipped, wound {turns} times and turned by {by}");
        crossings
    };
    for k in 0..40 {
        let by = f64::from(k) * PI / 20.0;
        assert_eq!(wound(1.0, by), 0);
        assert!(wound(2.0, by) > 0, "turned by {by}");
    }
}

/// Where the faces at a boundary vertex take more than a turn, a rim crosses a side of the fan, and
/// the vertex itself is a second place.
#[test]
fn more_than_a_full_turn_at_a_boundary_vertex_is_an_overlap() {
    // Vertex 0 with five faces along an open chain.
    let mesh = TriMesh::from_arrays(
        (0..7).map(|k| DVec3::new(f64::from(k), f64::from(k * k), 0.0)).collect(),
        &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 6]],
    );
    let with = |turns: f64| {
        let place = |v: VertexId| match v.index() {
            0 => DVec2::ZERO,
            k => DVec2::from_angle(2.0 * PI * turns * (k - 1) as f64 / 5.0) * (1.0 + 0.2 * k as f64),
        };
        distortion(&mesh, &mesh.positions.ids().map(place).collect()).crossings
    };
    assert_eq!((with(0.9), with(1.1)), (0, 2));
}

#[test]
fn a_symmetric_shape_turns_to_its_first_vertex_off_the_centre() {
    let uv = flatten(&shapes::fan(6), &FlattenOptions::default()).unwrap();
    let first = uv[VertexId::new(1)];
    assert!((first - DVec2::X).length() < 1e-9, "vertex 0 is the centre, vertex 1 at {first}");
}

#[test]
fn a_point_face_is_refused_by_name_and_a_flat_face_is_kept() {
    let mut mesh = shapes::lattice(5, 5, 0.01);
    let [a, b, c] = mesh.triangles[FaceId::new(7)];
    // A face on a line: the corner moves onto the opposite side.
    mesh.positions[c] = (mesh.positions[a] + mesh.positions[b]) / 2.0;
    for options in all_methods() {
        let uv = flatten(&mesh, &options).unwrap();
        assert!(uv.iter().all(|p| p.is_finite()), "{options:?}");
        assert!(
            !is_intrinsic(&options) || distortion(&mesh, &uv).flips == 0,
            "it keeps its orientation: {options:?}"
        );
    }
    // A vertex whose faces have no area has no density of its own.
    let mut flat = shapes::square();
    flat.positions[VertexId::new(1)] =
        flat.positions[VertexId::new(0)].midpoint(flat.positions[VertexId::new(2)]);
    let found = flatten(&flat, &magnified(Energy::default(), 1.0));
    assert!(found.is_ok(), "{found:?}");
    mesh.positions[b] = mesh.positions[a];
    mesh.positions[c] = mesh.positions[a];
    let found = flatten(&mesh, &FlattenOptions::default());
    assert!(matches!(found, Err(FlattenError::PointFace { .. })), "{found:?}");
}

/// A sheet large enough for the levels that are not factored, where sums run side by side, and one that is
/// pulled apart.
#[test]
fn one_thread_or_seven_give_the_same_bits() {
    for mesh in [bumpy(120, 100, 0.2, 0.2), ramp(241, 13, 1.5)] {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let uv = pool.install(|| flatten(&mesh, &FlattenOptions::default()).unwrap());
            uv.iter().flat_map(|p| p.to_array()).map(f64::to_bits).collect::<Vec<_>>()
        };
        let one = with(1);
        assert!(one == with(2) && one == with(7), "{} faces", mesh.triangles.len());
    }
}

#[test]
fn a_ramp_that_winds_over_itself_is_pulled_apart() {
    for (mesh, energy) in [
        (ramp(61, 6, 1.5), Energy::default()),
        (ramp(61, 6, 1.5), Energy::SymmetricDirichlet),
        (ramp(80, 5, 2.2), Energy::SymmetricDirichlet),
    ] {
        let with_overlaps = measure(&mesh, &free(energy.into()));
        assert!(with_overlaps.flips == 0 && with_overlaps.crossings > 0, "{with_overlaps:?}");
        let apart = measure(&mesh, &energy.into());
        assert_eq!((apart.flips, apart.crossings), (0, 0), "{apart:?}");
        assert!(
            apart.symmetric_dirichlet > with_overlaps.symmetric_dirichlet,
            "{apart:?} costs more than {with_overlaps:?}"
        );
    }
}

#[test]
fn no_level_of_a_ramp_crosses_itself() {
    one_to_one(&pyramid_of(&ramp(241, 13, 1.5)), &FlattenOptions::default());
}

/// Two turns with a hole in the middle of the strip: its loop must not cross itself or the outer
/// one either.
#[test]
fn a_ramp_with_a_hole_is_pulled_apart() {
    let whole = ramp(81, 7, 2.0);
    let middle = VertexId::new(3 * 81 + 40);
    let mesh = without(&whole, |face| whole.triangles[face].contains(&middle));
    assert!(measure(&mesh, &free(FlattenOptions::default())).crossings > 0);
    let d = measure(&mesh, &FlattenOptions::default());
    assert_eq!((d.flips, d.crossings), (0, 0), "{d:?}");
}

#[test]
fn a_map_that_does_not_cross_itself_stays_as_it_is() {
    for mesh in [bumpy(16, 12, 0.6, 0.4), shapes::tube(20, 12, 0.05, 0.1), ramp(40, 6, 0.8)] {
        for options in all_methods() {
            let with_overlaps = flatten(&mesh, &free(options.clone())).unwrap();
            let crossings = distortion(&mesh, &with_overlaps).crossings;
            if crossings == 0 {
                assert_eq!(flatten(&mesh, &options), Ok(with_overlaps), "{options:?}");
            } else {
                // A conformal or linear map of a bump may cross itself; the others have no reason
                // to here.
                assert!(!is_intrinsic(&options), "{crossings} crossings with {options:?}");
            }
        }
    }
}

/// Conformal and linear maps are what they are: they cannot be pulled apart.
#[test]
fn the_other_methods_keep_their_overlaps() {
    let mesh = ramp(61, 6, 1.5);
    for method in [Method::Conformal, LINEAR] {
        assert!(measure(&mesh, &method.into()).crossings > 0, "{method:?}");
        assert_eq!(flatten(&mesh, &method.into()), flatten(&mesh, &free(method.into())), "{method:?}");
    }
}

#[test]
fn every_level_lies_like_the_finest() {
    let pyramid = pyramid_of(&bumpy(40, 25, 0.4, 0.3));
    for options in [FlattenOptions::default(), Method::Conformal.into()] {
        let maps = flatten_pyramid(&pyramid, None, &options).unwrap();
        let finest = &maps[LevelId::new(0)];
        for (level, uv) in maps.enumerate().skip(1) {
            let off = pyramid.levels[level].origins.enumerate().map(|(v, &o)| uv[v].distance(finest[o]));
            let mean = off.sum::<f64>() / uv.len() as f64;
            assert!(mean < 0.02, "level {level}: {mean} m of a 0.4 m map with {options:?}");
        }
    }
}

/// The real cover: numbers from the issue of a good free-boundary map.
#[test]
fn the_real_cover_flattens_almost_isometrically() {
    let Some(path) = data("cyskin/ur10e_link1_patch1_isomap.json") else { return };
    let skin = assemble(&read_draft(&path).unwrap(), &AssembleOptions::default()).unwrap().skin;
    let mesh = &skin.patches[PatchId::new(0)].mesh;
    let pyramid = pyramid_of(mesh);
    for options in energies() {
        let d = distortion(mesh, &one_to_one(&pyramid, &options)[LevelId::new(0)]);
        assert!(d.qc_mean <= 1.005 && d.qc_max <= 1.1 && d.area_mean <= 1.01, "{d:?}");
    }
}

/// The conformal map of a coarse tube may wind twice about two vertices, untangling may make such
/// vertices, and the rim of a hole slides through itself: each of them turned the hole inside out,
/// without a flip and without a crossing.
#[test]
fn the_hole_of_a_sleeve_stays_a_hole_on_every_level() {
    for (around, radius, height, taper) in
        [(24, 0.04, 0.25, 0.0), (24, 0.04, 0.25, 0.3), (20, 0.05, 0.3, 0.2), (14, 0.02, 0.3, 0.0)]
    {
        let pyramid = pyramid_of(&sleeve(around, radius, height, taper));
        let sum = FlattenOptions::default();
        for options in [sum.clone(), free(sum), Energy::SymmetricDirichlet.into()] {
            for (level, uv) in one_to_one(&pyramid, &options).enumerate() {
                let what = format!("level {level} of {radius} x {height}, {taper}, {options:?}");
                assert_eq!(fold(&pyramid.levels[level].mesh, uv), None, "{what}");
            }
        }
    }
}

/// Large enough for level 0 not to be mapped from nothing, too.
#[test]
fn the_hole_of_a_large_sleeve_stays_a_hole() {
    let mesh = sleeve(60, 0.05, 0.25, 0.2);
    let uv = flatten(&mesh, &FlattenOptions::default()).unwrap();
    assert_eq!(fold(&mesh, &uv), None);
    assert_eq!(distortion(&mesh, &uv).crossings, 0);
}

/// A sleeve laid on both sides of a circle: two of its vertices have two turns of faces.
#[test]
fn a_hole_inside_out_is_counted_with_the_crossings() {
    let mesh = shapes::tube(24, 9, 0.05, 0.1);
    // The Joukowski map w + 1/w winds twice about the images of 1 and -1, which are vertices in the
    // middle of the tube.
    let uv = mesh.positions.map(|p| {
        let up = 0.05 - p.z;
        let w = p.truncate() / 0.05 * (20.0 * up + 100.0 * up * up).exp2();
        w + DVec2::new(w.x, -w.y) / w.length_squared()
    });
    let found = distortion(&mesh, &uv);
    assert_eq!((found.flips, found.crossings), (0, 3), "two vertices and a loop: {found:?}");
    assert!(fold(&mesh, &uv).is_some(), "the law of the tests above sees it, too");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Ramps of any length and with any bumps, with every energy.
    #[test]
    fn no_level_of_any_ramp_crosses_itself(
        columns in 20_u32..90, rows in 2_u32..9, turns in 0.5..2.5_f64, bumps in 0.0..0.02_f64,
        angle in 0.0..2.0_f64, perimeter in 0.0..1.0_f64,
    ) {
        let mut mesh = ramp(columns, rows, turns);
        for p in mesh.positions.iter_mut() {
            p.z += bumps * (p.x * 90.0).sin() * (p.y * 80.0).cos();
        }
        one_to_one(&pyramid_of(&mesh), &sum(angle, 1.0, perimeter));
    }

    #[test]
    fn no_level_of_a_bumpy_sheet_flips(
        columns in 3_u32..40, rows in 3_u32..30, a in 0.0..1.5_f64, b in 0.0..1.5_f64, energy in 0..2_usize,
    ) {
        let pyramid = pyramid_of(&bumpy(columns, rows, a, b));
        let maps = flatten_pyramid(&pyramid, None, &energies()[energy]).unwrap();
        for (level, uv) in maps.enumerate() {
            let d = distortion(&pyramid.levels[level].mesh, uv);
            prop_assert_eq!(d.flips, 0, "level {}: {:?}", level, d);
        }
    }

    #[test]
    fn no_hole_of_any_sleeve_is_turned_inside_out(
        around in 3_u32..24, slenderness in 0.2..12.0_f64, taper in 0.0..0.6_f64, energy in 0..2_usize,
    ) {
        let pyramid = pyramid_of(&sleeve(around, 0.03, 0.03 * slenderness, taper));
        let maps = flatten_pyramid(&pyramid, None, &energies()[energy]).unwrap();
        for (level, uv) in maps.enumerate() {
            let mesh = &pyramid.levels[level].mesh;
            prop_assert_eq!(distortion(mesh, uv).flips, 0, "level {}", level);
            prop_assert_eq!(fold(mesh, uv), None, "level {}", level);
        }
    }

    /// Noise makes slivers, needles and folded faces in space; the map has none.
    #[test]
    fn noise_on_the_skin_does_not_flip_the_map(
        noise in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 80), size in 0.0..0.01_f64,
    ) {
        let mut mesh = shapes::lattice(10, 8, 0.01);
        for (p, n) in mesh.positions.iter_mut().zip(&noise) {
            *p += size * DVec3::from_array(*n);
        }
        for options in energies() {
            let d = measure(&mesh, &options);
            prop_assert_eq!(d.flips, 0, "{:?}", d);
        }
    }
}

/// The coarsest level of this short wide tube folds onto itself, and finer levels used to inherit
/// the fold.
#[test]
fn a_tube_is_mapped_through_a_pyramid_as_well_as_at_once() {
    let mesh = shapes::tube(60, 10, 0.05, 0.03);
    let options = FlattenOptions::default();
    let at_once = distortion(&mesh, &flatten(&mesh, &options).unwrap());
    let pyramid = pyramid_of(&mesh);
    let levels = flatten_pyramid(&pyramid, None, &options).unwrap();
    let through = distortion(&mesh, &levels[LevelId::new(0)]);
    assert_eq!((at_once.crossings, through.crossings), (0, 0), "neither map crosses itself");
    let limit = at_once.symmetric_dirichlet * 1.001;
    assert!(through.symmetric_dirichlet <= limit, "{} > {limit}", through.symmetric_dirichlet);
}

/// The posts of the frame that holds a coarse map apart are no vertices of the next level.
#[test]
fn a_level_after_a_framed_one_has_one_position_per_vertex() {
    let pyramid = pyramid_of(&bumpy(7, 28, 0.9677245898833673, 0.0));
    let maps = flatten_pyramid(&pyramid, None, &FlattenOptions::default()).unwrap();
    for (level, uv) in maps.enumerate() {
        assert_eq!(uv.len(), pyramid.levels[level].mesh.positions.len(), "level {level}");
    }
}

/// Continuity: as a smooth surface is meshed finer, its maps converge.
#[test]
fn maps_of_finer_meshes_come_closer_at_least_linearly() {
    let cap = |x: f64, y: f64| DVec3::new(x, y, (1.6 - x * x - y * y).sqrt());
    let saddle = |x: f64, y: f64| DVec3::new(x, y, 0.5 * (x * x - y * y) + 0.1 * (3.0 * x).sin() * y);
    type Surface<'a> = &'a dyn Fn(f64, f64) -> DVec3;
    let surfaces: [(&str, Surface<'_>); 2] = [("cap", &cap), ("saddle", &saddle)];
    for (name, surface) in surfaces {
        for options in energies() {
            let map = |cells: u32| {
                // Not a square: its direction on the map is that of its longer side.
                let at = |i: u32| f64::from(i) / f64::from(cells);
                let mesh = shapes::sheet(cells + 1, cells + 1, |i, j| {
                    0.1 * surface(1.6 * at(i) - 0.8, 1.2 * at(j) - 0.6)
                });
                flatten(&mesh, &options).unwrap()
            };
            let common = |uv: &IdVec<VertexId, DVec2>, cells: u32| -> Vec<DVec2> {
                let step = cells / 22;
                let place = |k: u32| VertexId::from((k / 23) * step * (cells + 1) + (k % 23) * step);
                (0..23 * 23).map(|k| uv[place(k)]).collect()
            };
            let maps = [22, 44, 88].map(|cells| common(&map(cells), cells));
            let apart = |a: &[DVec2], b: &[DVec2]| {
                (fitted(a, b).iter().map(|off| off * off).sum::<f64>() / a.len() as f64).sqrt()
            };
            let (first, second) = (apart(&maps[0], &maps[1]), apart(&maps[1], &maps[2]));
            assert!(second <= 0.5 * first && first < 2e-3, "{name}, {options:?}: {first} m, then {second} m");
        }
    }
}

/// A ball with small round holes: nearly closed, so that its rims are pressed together.
fn holed_ball(faces: usize, holes: &[DVec3], radius: f64) -> TriMesh {
    let ball = shapes::cap(faces, 0.05, 2.9);
    let is_near = |c: DVec3| holes.iter().any(|h| c.normalize().distance(h.normalize()) < radius);
    without(&ball, |face| is_near(centre_of(&ball, face)))
}

/// The rims of these holes turned inside out, or were crushed behind a wall: energies of 10 to 2000
/// instead of 7 to 9.
#[test]
fn the_holes_of_a_ball_stay_holes_at_little_energy() {
    let corners = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y, DVec3::new(1.0, 1.0, 1.0)];
    for (faces, holes) in [(4000, &corners[..2]), (4000, &corners[..]), (7000, &corners[..3])] {
        let mesh = holed_ball(faces, holes, 0.25);
        assert_eq!(Adjacency::new(&mesh).unwrap().boundary_loops().len(), holes.len() + 1);
        for overlap in [Overlap::Prevent, Overlap::Allow] {
            let d = measure(&mesh, &FlattenOptions { overlap, ..Energy::SymmetricDirichlet.into() });
            assert_eq!((d.flips, d.crossings), (0, 0), "{faces}, {overlap:?}: {d:?}");
            assert!(d.symmetric_dirichlet < 12.0, "{faces}, {overlap:?}: {d:?}");
        }
    }
}

/// One vertex with thousands of faces around it: no level is coarser, and the map is far from its
/// start.
#[test]
fn a_star_of_many_faces_is_mapped() {
    let mut mesh = shapes::fan(20_000);
    for (k, p) in mesh.positions.iter_mut().enumerate().skip(1) {
        p.z += 0.1 * (9.0 * 2.0 * PI * k as f64 / 20_000.0).sin() * p.truncate().length();
    }
    for options in [Energy::SymmetricDirichlet.into(), Method::Conformal.into()] {
        let d = measure(&mesh, &options);
        assert_eq!(d.flips, 0, "{d:?}");
        assert!(!is_intrinsic(&options) || d.crossings == 0, "{d:?}");
    }
}

fn bounded(boundary: Boundary) -> FlattenOptions {
    FlattenOptions { boundary, ..FlattenOptions::default() }
}

#[test]
fn a_prescribed_circle_holds_the_outer_loop() {
    for mesh in [bumpy(30, 20, 0.4, 0.3), shapes::tube(24, 8, 0.05, 0.1), shapes::cap(5000, 0.05, 2.0)] {
        let uv = flatten(&mesh, &bounded(Boundary::Circle)).unwrap();
        let d = distortion(&mesh, &uv);
        assert_eq!((d.flips, d.crossings), (0, 0), "{d:?}");
        let area = mesh.area();
        let radius = (area / PI).sqrt();
        let loops = Adjacency::new(&mesh).unwrap().boundary_loops();
        let off =
            |walk: &Vec<VertexId>| walk.iter().map(|&v| (uv[v].length() - radius).abs()).fold(0.0, f64::max);
        let least = loops.iter().map(off).fold(f64::INFINITY, f64::min);
        assert!(least < 1e-12 * radius, "{least} m off the circle");
    }
}

#[test]
fn every_level_keeps_the_prescribed_places_of_its_taxels() {
    let pyramid = pyramid_of(&bumpy(40, 25, 0.4, 0.3));
    for method in [Method::default(), LINEAR] {
        let options = FlattenOptions { method, ..bounded(Boundary::Circle) };
        let maps = flatten_pyramid(&pyramid, None, &options).unwrap();
        for (level, uv) in maps.enumerate().skip(1) {
            let level = &pyramid.levels[level];
            let adjacency = Adjacency::new(&level.mesh).unwrap();
            for &v in &adjacency.boundary_loops()[0] {
                assert!(uv[v].distance(maps[LevelId::new(0)][level.origins[v]]) < 1e-12);
            }
        }
    }
}

/// Equation (2) of the source paper with (6) and (8): between its own boundary what is flat is its own map, and a
/// curved skin lies inside the circle without a flip.
#[test]
fn linear_maps_keep_a_prescribed_boundary() {
    let place = |column: u32, row: u32| {
        let (x, y) = (f64::from(column), f64::from(row));
        0.01 * DVec3::new(x + 0.3 * (3.0 * x + 2.0 * y).sin(), y + 0.2 * (5.0 * x - y).cos(), 0.0)
    };
    let mesh = shapes::sheet(13, 9, place);
    let adjacency = Adjacency::new(&mesh).unwrap();
    let places = mesh.positions.ids().map(|v| adjacency.is_boundary(v).then(|| mesh.positions[v].truncate()));
    let own = Boundary::Places(places.collect());
    for (angle, area) in [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let method = Method::Linear { angle, area };
        let uv = flatten(&mesh, &FlattenOptions { method, ..bounded(own.clone()) }).unwrap();
        let off = mesh.positions.enumerate().map(|(v, p)| uv[v].distance(p.truncate())).fold(0.0, f64::max);
        assert!(off < 1e-12, "{angle} : {area}: {off} m");
        let cap = shapes::cap(1000, 0.05, 1.0);
        let uv = flatten(&cap, &FlattenOptions { method, ..bounded(Boundary::Circle) }).unwrap();
        let most = uv.iter().map(|p| p.length()).fold(0.0, f64::max);
        assert!(
            (most - (cap.area() / PI).sqrt()).abs() < 1e-12 && distortion(&cap, &uv).flips == 0,
            "{most}"
        );
    }
}

/// The boundary of the free map, given as places of taxels, gives the free map again.
#[test]
fn the_boundary_of_a_map_gives_that_map() {
    let mesh = bumpy(20, 14, 0.3, 0.2);
    let ids: IdVec<VertexId, TaxelId> = mesh.positions.ids().map(|v| TaxelId(1000 + v.raw())).collect();
    let free = flatten(&mesh, &FlattenOptions::default()).unwrap();
    let walk = Adjacency::new(&mesh).unwrap().boundary_loops().concat();
    let boundary = Boundary::through(&ids, walk.iter().map(|&v| (ids[v], free[v]))).unwrap();
    let uv = flatten(&mesh, &bounded(boundary)).unwrap();
    for (v, at) in uv.enumerate() {
        assert!(at.distance(free[v]) < 1e-4 * mesh.area().sqrt(), "{v}: {at} is not {}", free[v]);
    }
}

/// A sheet pushed into an L: springs alone would pull faces over the corner.
#[test]
fn a_boundary_that_is_not_convex_holds_a_map_without_flips() {
    let mesh = shapes::sheet(21, 11, |column, row| 0.01 * DVec3::new(column.into(), row.into(), 0.0));
    let ids: IdVec<VertexId, TaxelId> = mesh.positions.ids().map(|v| TaxelId(v.raw())).collect();
    // Columns beyond the tenth go up instead of to the right.
    let place = |v: VertexId| {
        let (x, y) = (mesh.positions[v].x - 0.1, mesh.positions[v].y);
        if x <= 0.0 {
            DVec2::new(x, y)
        } else {
            DVec2::from_angle(x / 0.06).rotate(DVec2::new(0.0, y - 0.15)) + DVec2::new(0.0, 0.15)
        }
    };
    let walk = Adjacency::new(&mesh).unwrap().boundary_loops().concat();
    let boundary = Boundary::through(&ids, walk.iter().map(|&v| (ids[v], place(v)))).unwrap();
    let uv = flatten(&mesh, &bounded(boundary.clone())).unwrap();
    let d = distortion(&mesh, &uv);
    assert_eq!((d.flips, d.crossings), (0, 0), "{d:?}");
    assert!(walk.iter().all(|&v| uv[v].distance(place(v)) < 1e-12));
    // The same on every level.
    let maps = flatten_pyramid(&pyramid_of(&mesh), None, &bounded(boundary)).unwrap();
    assert!(walk.iter().all(|&v| maps[LevelId::new(0)][v].distance(place(v)) < 1e-12));
}

#[test]
fn invalid_boundary_places_are_refused() {
    let mesh = shapes::lattice(5, 4, 0.01);
    let ids: IdVec<VertexId, TaxelId> = mesh.positions.ids().map(|v| TaxelId(v.raw())).collect();
    let walk = Adjacency::new(&mesh).unwrap().boundary_loops().concat();
    let inner = mesh.positions.ids().find(|v| !walk.contains(v)).unwrap();
    let places = |at: &dyn Fn(usize, VertexId) -> DVec2| -> Vec<(TaxelId, DVec2)> {
        walk.iter().enumerate().map(|(k, &v)| (ids[v], at(k, v))).collect()
    };
    let flat =
        |places: Vec<(TaxelId, DVec2)>| flatten(&mesh, &bounded(Boundary::through(&ids, places).unwrap()));
    let own = |v: VertexId| mesh.positions[v].truncate();
    assert!(flat(places(&|_, v| own(v))).is_ok());
    assert_eq!(
        flat(places(&|_, v| own(v))[1..].to_vec()),
        Err(FlattenError::BoundaryPlace { vertex: walk[0] })
    );
    let nan = |k: usize, v| if k == 3 { DVec2::NAN } else { own(v) };
    assert_eq!(flat(places(&nan)), Err(FlattenError::BoundaryPlace { vertex: walk[3] }));
    let mut more = places(&|_, v| own(v));
    more.push((ids[inner], DVec2::ZERO));
    assert_eq!(flat(more), Err(FlattenError::BoundaryPlace { vertex: inner }));
    let mirrored = flat(places(&|_, v| own(v) * DVec2::new(-1.0, 1.0)));
    assert!(
        matches!(mirrored, Err(FlattenError::BoundaryShape { crossings: 0, area }) if area < 0.0),
        "{mirrored:?}"
    );
    let swapped = flat(places(&|k, v| {
        own(if k == 2 {
            walk[6]
        } else if k == 6 {
            walk[2]
        } else {
            v
        })
    }));
    assert!(matches!(swapped, Err(FlattenError::BoundaryShape { crossings: 1.., .. })), "{swapped:?}");
    let found = Boundary::through(&ids, [(TaxelId(999), DVec2::ZERO)]);
    assert_eq!(found, Err(FlattenError::BoundaryTaxel { id: TaxelId(999), taxels: 0, places: 1 }));
    let found = Boundary::through(&ids, [(ids[inner], DVec2::ZERO); 2]);
    assert_eq!(found, Err(FlattenError::BoundaryTaxel { id: ids[inner], taxels: 1, places: 2 }));
    let other = Boundary::Places(vec![None; 3].into());
    assert!(matches!(flatten(&mesh, &bounded(other)), Err(FlattenError::BoundaryPlace { .. })));
}

/// An ear in the middle of a straight side has no area there, whatever the inside does.
#[test]
fn a_face_without_room_on_a_straight_side_is_named() {
    let mesh = shapes::lattice(6, 5, 0.01);
    let ids: IdVec<VertexId, TaxelId> = mesh.positions.ids().map(|v| TaxelId(v.raw())).collect();
    let loops = Adjacency::new(&mesh).unwrap().boundary_loops();
    let walk = &loops[0];
    let side = walk.len() / 4;
    let ear = mesh.triangles.iter().find(|t| t.iter().all(|v| walk.contains(v))).unwrap();
    let tip = walk.iter().position(|v| {
        let before = walk[(walk.iter().position(|w| w == v).unwrap() + walk.len() - 1) % walk.len()];
        let after = walk[(walk.iter().position(|w| w == v).unwrap() + 1) % walk.len()];
        ear.contains(v) && ear.contains(&before) && ear.contains(&after)
    });
    let (half, count) = (0.025, walk.len());
    // Corners of a square two edges after the tip, and every quarter of the loop from there.
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|p| half * DVec2::from_array(p));
    let place = |k: usize| {
        let along = (k + 2 * count - tip.unwrap() - 2) % count;
        let (corner, share) = ((along / side).min(3), along - (along / side).min(3) * side);
        let length = if corner == 3 { count - 3 * side } else { side };
        corners[corner].lerp(corners[(corner + 1) % 4], share as f64 / length as f64)
    };
    let places = walk.iter().enumerate().map(|(k, &v)| (ids[v], place(k)));
    let boundary = Boundary::through(&ids, places).unwrap();
    let found = flatten(&mesh, &bounded(boundary));
    assert!(matches!(found, Err(FlattenError::NoRoom { .. })), "{found:?}");
}

/// Forty radii long: on coarse levels a map inside a circle has faces without area in 64 bits.
#[test]
fn coarse_levels_of_a_long_tube_are_mapped_or_left_out() {
    let mesh = shapes::tube(24, 80, 0.01, 0.4);
    let pyramid = pyramid_of(&mesh);
    let maps = flatten_pyramid(&pyramid, None, &FlattenOptions::default()).unwrap();
    assert!(!maps.is_empty() && maps.len() <= pyramid.levels.len());
    for (level, uv) in maps.enumerate() {
        let mesh = &pyramid.levels[level].mesh;
        assert_eq!((distortion(mesh, uv).flips, fold(mesh, uv)), (0, None), "level {level}");
    }
}
