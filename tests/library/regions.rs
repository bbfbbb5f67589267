//! Laws of regions that ask for more than others: weights and acuities, from their files to the map.

use std::fs;

use crate::common::{dermatome, refuses};
use dermatome::{
    flatten::{Boundary, Energy, FlattenOptions, Method, distortion, flatten_pyramid},
    id::{FaceId, IdVec, VertexId},
    io::{read_acuities, read_draft, read_map, write_map, write_skin},
    map::PatchMap,
    mesh::{TriMesh, shapes},
    pipeline::{BuildOptions, MagnifyOver, build},
    pyramid::{CoarsenOptions, LevelId, Pyramid, coarsen},
    run::Run,
    skin::{AssembleOptions, Link, Patch, PatchId, Skin, SkinError, TaxelError, TaxelId, Taxels, assemble},
};
use glam::{DAffine3, DVec2, DVec3};
use predicates::{prelude::PredicateBooleanExt, str::contains};

/// A flat sheet whose left half asks for `left` and whose right half for 1.
fn halves(columns: u32, left: f64) -> (TriMesh, IdVec<VertexId, f64>) {
    let mesh = shapes::lattice(columns, columns, 0.01);
    let middle = 0.5 * mesh.positions.iter().map(|p| p.x).fold(0.0, f64::max);
    let values = mesh.positions.map(|p| if p.x < middle { left } else { 1.0 });
    (mesh, values)
}

fn sharp(mesh: &TriMesh, acuities: &IdVec<VertexId, f64>) -> Taxels {
    Taxels { acuities: Some(acuities.clone()), ..Taxels::from(mesh) }
}

/// Levels of a pyramid as an acuity has them: where it is twice as high, fields are half as far
/// apart, so four of them are where else is one. Only ratios count.
#[test]
fn acuity_halves_the_spacing_of_fields() {
    let (mesh, acuities) = halves(90, 2.0);
    let middle = 0.5 * mesh.positions.iter().map(|p| p.x).fold(0.0, f64::max);
    let pyramid =
        |taxels: &Taxels| coarsen(&mesh, taxels, &CoarsenOptions::default(), Run::default()).unwrap();
    let counts = |pyramid: &Pyramid, level: usize| {
        let level = &pyramid.levels[LevelId::new(level)].mesh;
        let left = level.positions.iter().filter(|p| p.x < middle).count();
        (left as f64, (level.positions.len() - left) as f64)
    };
    let sharp_pyramid = pyramid(&sharp(&mesh, &acuities));
    for level in [2, 3] {
        let (left, right) = counts(&sharp_pyramid, level);
        assert!((3.2..4.8).contains(&(left / right)), "{left} fields to {right} on level {level}");
        let (left, right) = counts(&pyramid(&Taxels::from(&mesh)), level);
        assert!((0.8..1.25).contains(&(left / right)), "{left} fields to {right} without");
    }
    assert_eq!(sharp_pyramid, pyramid(&sharp(&mesh, &acuities.map(|a| 4.0 * a))));
}

/// Lengths on the map follow the acuity too, so that fields are equally large there: areas on the left
/// are four times those on the right. Near the middle angles would suffer: areas alone count here.
#[test]
fn acuity_doubles_lengths_on_the_map() {
    let (mesh, acuities) = halves(24, 2.0);
    let flat = |taxels: Taxels, angle: f64| {
        let energy = Energy::Sum { angle, area: 1.0, perimeter: 0.0 };
        let mut skin = Skin::from_mesh("halves", mesh.clone());
        skin.patches[PatchId::new(0)].taxels = taxels;
        let map = build(&skin, &BuildOptions { flatten: energy.into(), ..BuildOptions::default() }).unwrap();
        map.patches[PatchId::new(0)].levels[LevelId::new(0)].opened_uv()
    };
    let ratio = |uv: &IdVec<VertexId, DVec2>| {
        let map = TriMesh { positions: uv.map(|p| p.extend(0.0)), ..mesh.clone() };
        let mean = |wanted: f64| {
            let inside = mesh.triangles.enumerate().filter(|(_, t)| t.iter().all(|&v| acuities[v] == wanted));
            let sums = inside.map(|(f, _)| (map.face_cross(f).length(), mesh.face_cross(f).length()));
            let (on_map, on_skin) = sums.fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
            on_map / on_skin
        };
        mean(2.0) / mean(1.0)
    };
    let taxels = sharp(&mesh, &acuities);
    let found = ratio(&flat(taxels.clone(), 1e-3));
    assert!((3.6..4.1).contains(&found), "{found}");
    let balanced = ratio(&flat(taxels, 1.0));
    assert!((2.0..4.0).contains(&balanced), "{balanced} where angles count as much");
    let same = flat(sharp(&mesh, &acuities.map(|_| 3.0)), 1.0);
    let plain = flat(Taxels::from(&mesh), 1.0);
    let off = same.iter().zip(&plain).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
    assert!(off < 1e-9, "{off} m where all are as sharp");
}

/// Where distortion weighs more there is less of it; only ratios count, and a weight of 0 does not
/// let a face flip.
#[test]
fn weights_move_distortion_to_where_it_counts_less() {
    let mesh = shapes::cap(900, 0.1, 1.9);
    let top = mesh.positions.iter().map(|p| p.z).fold(f64::MIN, f64::max);
    let is_near = |v: VertexId| mesh.positions[v].z > top - 0.05;
    let pyramid = coarsen(&mesh, &Taxels::from(&mesh), &CoarsenOptions::default(), Run::default()).unwrap();
    let flat = |near: f64, far: f64| {
        let weights = mesh.positions.ids().map(|v| if is_near(v) { near } else { far }).collect();
        let taxels = Taxels { weights: Some(weights), ..Taxels::from(&mesh) };
        let mut maps = flatten_pyramid(&pyramid, Some(&taxels), &FlattenOptions::default(), Run::default())
            .unwrap()
            .into_iter();
        maps.next().unwrap().uv
    };
    // Angle distortion and area distortion there, each 0 at an isometry.
    let near = |uv: &IdVec<VertexId, DVec2>| {
        let inside = mesh.triangles.iter().filter(|t| t.iter().all(|&v| is_near(v))).copied();
        let part = TriMesh { triangles: inside.collect(), ..mesh.clone() };
        let (mut sum, mut count) = (0.0, 0.0);
        for (face, t) in part.triangles.enumerate() {
            let [a, b, c] = t.map(|v| uv[v]);
            let on_map = 0.5 * (b - a).perp_dot(c - a);
            assert!(on_map > 0.0, "face {face} flips");
            let r = on_map / (0.5 * part.face_cross(face).length());
            sum += r.max(1.0 / r) - 1.0;
            count += 1.0;
        }
        sum / count + distortion(&part, uv).qc_mean - 1.0
    };
    let [even, heavy, all] = [(1.0, 1.0), (100.0, 1.0), (1.0, 0.0)].map(|(n, f)| near(&flat(n, f)));
    assert!(heavy < 0.7 * even, "{even} falls to {heavy}");
    assert!(all < 0.75 * even, "{even} falls to {all} where nothing else counts");
    let off = |a: &IdVec<VertexId, DVec2>, b: &IdVec<VertexId, DVec2>| {
        a.iter().zip(b).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max)
    };
    let scaled = off(&flat(100.0, 1.0), &flat(25.0, 0.25));
    assert!(scaled < 1e-9, "{scaled} m");
}

#[test]
fn invalid_weights_and_acuities_are_refused() {
    let mesh = shapes::square();
    let v = VertexId::new;
    let bad = |set: &dyn Fn(&mut Taxels)| {
        let mut skin = Skin::from_mesh("square", mesh.clone());
        set(&mut skin.patches[PatchId::new(0)].taxels);
        let Err(SkinError::Taxels { source, .. }) = skin.validate() else { panic!("it is kept") };
        source
    };
    let weights = |w: [f64; 4]| bad(&|taxels| taxels.weights = Some(w.to_vec().into()));
    assert_eq!(weights([1.0, -1.0, 0.0, 0.0]), TaxelError::Weight { vertex: v(1), found: -1.0 });
    assert!(matches!(weights([f64::NAN, 1.0, 0.0, 0.0]), TaxelError::Weight { .. }));
    assert!(matches!(weights([f64::INFINITY, 1.0, 0.0, 0.0]), TaxelError::Weight { .. }));
    assert_eq!(weights([0.0; 4]), TaxelError::NoWeight { found: 4 });
    let acuities = |a: Vec<f64>| bad(&|taxels| taxels.acuities = Some(a.clone().into()));
    assert_eq!(acuities(vec![1.0, 1.0, 0.0, 1.0]), TaxelError::Acuity { vertex: v(2), found: 0.0 });
    assert_eq!(acuities(vec![1.0, 1e9, 1.0, 1.0]), TaxelError::Acuity { vertex: v(1), found: 1e9 });
    assert_eq!(acuities(vec![1.0]), TaxelError::Length { what: "acuities", found: 1, needed: 4 });
}

/// Weights go through a skin file, both through a map file.
#[test]
fn weights_and_acuities_are_written_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, weights) = halves(12, 0.25);
    let mut skin = Skin::from_mesh("palm", mesh);
    let palm = PatchId::new(0);
    skin.patches[palm].taxels.weights = Some(weights.clone());
    for name in ["skin.glb", "skin.csv"] {
        let path = folder.path().join(name);
        write_skin(&path, &skin).unwrap();
        let back = assemble(&read_draft(&path).unwrap(), &AssembleOptions::default()).unwrap().skin;
        assert_eq!(back.patches[palm].taxels.weights, Some(weights.clone()), "{name}");
    }
    let table = folder.path().join("acuity.csv");
    fs::write(&table, "taxel_id,factor\n7,2\n9,0.5\n").unwrap();
    read_acuities(&table, &mut skin).unwrap();
    let acuities = skin.patches[palm].taxels.acuities.clone().unwrap();
    let expected = skin.patches[palm].taxels.ids.map(|id| match id {
        TaxelId(7) => 2.0,
        TaxelId(9) => 0.5,
        _ => 1.0,
    });
    assert_eq!(acuities, expected);
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let path = folder.path().join("map.glb");
    write_map(&path, &map).unwrap();
    let back = read_map(&path).unwrap();
    assert_eq!(back.patches[palm].taxels.weights, Some(weights));
    assert_eq!(back.patches[palm].taxels.acuities, Some(acuities));
}

/// A table of acuities with one bad line is refused with the file, the line and what is needed; the
/// others change fields and map.
#[test]
fn the_command_reads_acuities() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_skin(&path.join("skin.csv"), &Skin::from_mesh("s", shapes::cap(600, 0.05, 1.0))).unwrap();
    for (row, what) in [
        ("9999,2", "the id of a taxel of the skin"),
        ("3,2", "an id that no earlier line names"),
        ("4,-1", "a number from 0.01 to 100"),
        ("4,0", "a number from 0.01 to 100"),
        ("4,1e300", "a number from 0.01 to 100"),
        ("4,NaN", "a finite number"),
        ("x,1", "the number of a taxel"),
    ] {
        fs::write(path.join("a.csv"), format!("taxel_id,factor\n3,2\n{row}\n")).unwrap();
        for words in ["build skin.csv -o M", "coarsen skin.csv -o c.glb", "flatten skin.csv -o f.obj"] {
            let refused = dermatome(path, &format!("{words} --acuity a.csv")).assert().code(2);
            refused.stderr(contains("a.csv").and(contains("line 3")).and(contains(what)));
        }
    }
    let counts = |words: &str| {
        let made = dermatome(path, &format!("build skin.csv -o M --json -q {words}")).assert().success();
        let report: serde_json::Value = serde_json::from_slice(&made.get_output().stdout).unwrap();
        let level = |k: usize| report["patches"][0]["levels"][k].clone();
        (level(1)["vertices"].as_u64().unwrap(), level(0)["area_mean"].as_f64().unwrap())
    };
    let rows: String = (1..60).map(|id| format!("{id},3\n")).collect();
    fs::write(path.join("a.csv"), format!("taxel_id,factor\n{rows}")).unwrap();
    let (plain, sharp) = (counts(""), counts("--acuity a.csv"));
    assert!(sharp.0 > plain.0 && sharp.1 > plain.1 + 0.01, "{plain:?}, then {sharp:?}");
}

/// Bad weights of a file are named, by the vertex.
#[test]
fn the_command_refuses_bad_weights() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let table = |weights: [&str; 3]| {
        let [a, b, c] = weights;
        let rows = format!("id,x,y,z,weight\n1,0,0,0,{a}\n2,0.01,0,0,{b}\n3,0,0.01,0,{c}\n");
        fs::write(path.join("s.csv"), rows).unwrap();
        fs::write(path.join("s.triangles.csv"), "row0,row1,row2\n0,1,2\n").unwrap();
    };
    for (weights, what) in [
        (["1", "-2", "1"], "vertex 1 has a weight of -2"),
        (["0", "0", "0"], "all 3 weights are 0"),
        (["1", "nan", "1"], "a finite number"),
    ] {
        table(weights);
        refuses(path, "build s.csv -o M", &[what]);
    }
    table(["1", "0", "0"]);
    dermatome(path, "build s.csv -o M -q").assert().success();
    table(["1", "-2", "1"]);
    dermatome(path, "check s.csv").assert().code(1).stdout(contains("weight-unusable"));
}

/// Extreme but valid demands, on surfaces of one triangle, with handles, and within a boundary: a map
/// without flips every time.
#[test]
fn extreme_demands_still_make_a_map() {
    let meshes = [shapes::triangle(), shapes::cap(200, 0.05, 1.5), shapes::torus(16, 8, 0.05, 0.02)];
    let energies = [Energy::default(), Energy::SymmetricDirichlet];
    for mesh in meshes {
        for energy in energies {
            for boundary in [Boundary::Free, Boundary::Circle] {
                let mut skin = Skin::from_mesh("s", mesh.clone());
                let taxels = &mut skin.patches[PatchId::new(0)].taxels;
                taxels.weights = Some(taxels.ids.map(|id| if id.0 == 1 { 1e300 } else { 0.0 }));
                taxels.acuities = Some(taxels.ids.map(|id| if id.0 % 3 == 0 { 1e3 } else { 1e-3 }));
                let flatten = FlattenOptions {
                    method: Method::Intrinsic { energy, magnify: 1.0 },
                    boundary: boundary.clone(),
                    ..FlattenOptions::default()
                };
                let map = build(&skin, &BuildOptions { flatten, ..BuildOptions::default() }).unwrap();
                map.validate().unwrap();
                let all = map.patches.iter().flat_map(|patch| &patch.levels);
                let flips: usize = all.map(|level| level.distortion.flips).sum();
                assert_eq!(flips, 0, "{} taxels, {energy:?}, {boundary:?}", mesh.positions.len());
            }
        }
    }
}

/// A patch of sixteen times as many taxels gets sixteen times as much map: densities count over their mean
/// over the skin, and the map of the whole skin is as large as the skin. Over the patch alone each map is as
/// large as its patch.
#[test]
fn magnification_compares_patches() {
    let mut skin = Skin::default();
    for (name, columns) in [("torso", 6), ("hand", 21)] {
        let link = skin.links.push(Link { name: name.into(), parent: None, pose: DAffine3::IDENTITY });
        let side = 0.1 / f64::from(columns - 1);
        let mesh = shapes::sheet(columns, columns, |i, k| side * DVec3::new(f64::from(i), f64::from(k), 0.0));
        let patch = Patch::from_mesh(name, link, mesh);
        let density = side.powi(-2);
        let taxels =
            Taxels { densities: Some(patch.mesh.positions.map(|_| density)), ..patch.taxels.clone() };
        skin.patches.push(Patch { taxels, ..patch });
    }
    let areas = |magnify: f64, magnify_over: MagnifyOver| -> Vec<f64> {
        let flatten = Method::Intrinsic { energy: Energy::default(), magnify }.into();
        let map = build(&skin, &BuildOptions { flatten, magnify_over, ..BuildOptions::default() }).unwrap();
        let area = |patch: &PatchMap| {
            let level = &patch.levels[LevelId::new(0)];
            let of = |face: FaceId| level.places(face).map(|place| level.uv[place]);
            let faces = level.level.mesh.triangles.ids().map(of);
            faces.map(|[a, b, c]| 0.5 * (b - a).perp_dot(c - a)).sum()
        };
        map.patches.iter().map(area).collect()
    };
    let over_skin = areas(1.0, MagnifyOver::Skin);
    assert!((over_skin[1] / over_skin[0] - 16.0).abs() < 1e-6, "{over_skin:?}");
    assert!((over_skin.iter().sum::<f64>() - 0.02).abs() < 1e-9, "{over_skin:?}");
    for same in [areas(1.0, MagnifyOver::Patch), areas(0.0, MagnifyOver::Skin)] {
        assert!(same.iter().all(|area| (area - 0.01).abs() < 1e-9), "{same:?}");
    }
}

/// Two patches: a closed rod of long faces, which needs several attempts at its map, and a flat sheet.
fn rod_and_sheet() -> Skin {
    let (around, radius, height) = (40_u32, 0.02, 0.4);
    let ring = |z: f64| {
        (0..around).map(move |k| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(around);
            DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
        })
    };
    let mut triangles = Vec::new();
    for k in 0..around {
        let next = (k + 1) % around;
        triangles.extend([[k, next, around + next], [k, around + next, around + k]]);
    }
    for k in 1..around - 1 {
        triangles.extend([[0, k + 1, k], [around, around + k, around + k + 1]]);
    }
    let rod = TriMesh::from_arrays(ring(0.0).chain(ring(height)).collect(), &triangles);
    let mut skin = Skin::from_mesh("rod", rod);
    let mut sheet =
        Patch::from_mesh("sheet", skin.patches[PatchId::new(0)].link, shapes::lattice(6, 6, 0.005));
    sheet.mesh.positions.iter_mut().for_each(|p| p.x += 1.0);
    sheet.taxels.ids.iter_mut().for_each(|id| id.0 += 1000);
    skin.patches.push(sheet);
    skin
}

/// How sharp one patch is changes only how large the map of another one is.
#[test]
fn an_acuity_of_one_patch_leaves_the_others_alone() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("acuity.csv");
    fs::write(&table, "taxel_id,factor\n1001,2\n").unwrap();
    let skin = rod_and_sheet();
    let mut sharp = skin.clone();
    read_acuities(&table, &mut sharp).unwrap();
    let acuities = |k: usize| sharp.patches[PatchId::new(k)].taxels.acuities.clone();
    assert!(acuities(0).is_none() && acuities(1).is_some());
    // As a file that has acuities for all of them.
    let mut all = sharp.clone();
    let rod = &mut all.patches[PatchId::new(0)].taxels;
    rod.acuities = Some(rod.ids.map(|_| 1.0));
    let expected = build(&skin, &BuildOptions::default()).unwrap();
    for skin in [sharp, all] {
        let found = build(&skin, &BuildOptions::default()).unwrap();
        let [expected, found] = [&expected, &found].map(|map| &map.patches[PatchId::new(0)]);
        assert_eq!(found.levels.len(), expected.levels.len());
        for (found, expected) in found.levels.iter().zip(&expected.levels) {
            assert_eq!(found.opened().triangles, expected.opened().triangles);
            let [a, b] = [found, expected].map(|level| level.distortion.symmetric_dirichlet);
            assert!((a / b - 1.0).abs() < 1e-4, "{a} in place of {b}");
        }
    }
    // One acuity for a whole skin, some of it by the default, is none.
    let mut one = skin.clone();
    fs::write(&table, "taxel_id,factor\n1001,1\n1002,1\n").unwrap();
    read_acuities(&table, &mut one).unwrap();
    assert_eq!(one, skin);
}
