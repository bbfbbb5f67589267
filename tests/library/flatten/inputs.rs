//! Laws of flattening on bad input: needles, folds, spirals, sleeves, surfaces without area.

use super::*;

/// Largest distance between a map and the places `flat`, after the rotation and translation that fit
/// best, over the size of the map.
fn rigid_error(flat: &[DVec2], uv: &IdVec<VertexId, DVec2>) -> f64 {
    let centre = flat.iter().sum::<DVec2>() / flat.len() as f64;
    let size = flat.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
    fitted(flat, uv.as_slice()).into_iter().fold(0.0, f64::max) / size
}

/// Columns pushed against each other until the faces between them are needles of this aspect.
fn needles(columns: u32, rows: u32, aspect: f64) -> TriMesh {
    let cell = 0.01;
    let x = |i: u32| cell * (f64::from(i / 3) + [0.0, 0.5 / aspect, 0.5][i as usize % 3]);
    shapes::sheet(columns, rows, |i, j| DVec3::new(x(i), cell * f64::from(j), 0.0))
}

#[test]
fn a_plane_with_needles_of_ten_millions_flattens_to_itself() {
    for aspect in [1e3, 1e5, 1e7] {
        let mesh = needles(12, 9, aspect);
        let flat: Vec<DVec2> = mesh.positions.iter().map(|p| p.truncate()).collect();
        for options in energies() {
            let uv = flatten(&mesh, &options).unwrap();
            let error = rigid_error(&flat, &uv);
            assert!(error < 1e-9, "{error} at {aspect} with {options:?}");
            assert_eq!(distortion(&mesh, &uv).flips, 0, "at {aspect} with {options:?}");
        }
    }
}

/// Prisms whose edges are columns or rays of the mesh: developable polyhedra.
#[test]
fn pieces_of_cylinders_and_cones_unroll_to_themselves() {
    let (columns, rows) = (30, 9);
    let step = 1.4 * PI / f64::from(columns - 1);
    // A chord of the polygon is as long on the map.
    let (radius, turn) = (0.05, |i: u32| step * f64::from(i));
    let chord = 2.0 * radius * (step / 2.0).sin();
    let height = |j: u32| 0.01 * f64::from(j);
    let cylinder =
        shapes::sheet(columns, rows, |i, j| (radius * DVec2::from_angle(-turn(i))).extend(height(j)));
    let flat_cylinder = |i: u32, j: u32| DVec2::new(chord * f64::from(i), height(j));
    // Rays from the tip at the slant of 30 degrees: neighbours enclose the angle of the chord.
    let slant = 0.5_f64;
    let along = |j: u32| 0.03 + 0.01 * f64::from(j);
    let cone = shapes::sheet(columns, rows, |i, j| {
        (along(j) * slant.sin() * DVec2::from_angle(-turn(i))).extend(along(j) * slant.cos())
    });
    let opening = 2.0 * ((step / 2.0).sin() * slant.sin()).asin();
    let flat_cone = |i: u32, j: u32| along(j) * DVec2::from_angle(-opening * f64::from(i));
    type Place<'a> = &'a dyn Fn(u32, u32) -> DVec2;
    let shapes: [(&TriMesh, Place<'_>); 2] = [(&cylinder, &flat_cylinder), (&cone, &flat_cone)];
    for (mesh, place) in shapes {
        let flat: Vec<DVec2> = (0..columns * rows).map(|k| place(k % columns, k / columns)).collect();
        for options in energies() {
            let uv = flatten(mesh, &options).unwrap();
            let mirrored: Vec<DVec2> = flat.iter().map(|p| DVec2::new(-p.x, p.y)).collect();
            let error = rigid_error(&flat, &uv).min(rigid_error(&mirrored, &uv));
            assert!(error < 1e-9, "{error} with {options:?}");
        }
    }
}

/// The same needles, some of their vertices first in number.
#[test]
fn edges_of_a_millionth_of_the_longest_are_mapped() {
    let mesh = shapes::sheet(9, 9, |i, j| {
        let place = |k: u32| if k < 4 { 0.1 * 1e-6 * f64::from(k) } else { 0.1 * f64::from(k - 3) };
        let (x, y) = (place(i), place(j));
        DVec3::new(x, y, 0.2 * x * y)
    });
    for options in energies() {
        let uv = flatten(&mesh, &options).unwrap();
        let d = distortion(&mesh, &uv);
        assert_eq!((d.flips, d.crossings), (0, 0), "{d:?} with {options:?}");
        assert!(d.symmetric_dirichlet < 4.1, "{d:?} with {options:?}");
    }
}

#[test]
fn one_and_two_triangles_are_mapped_however_they_lie() {
    for mesh in [shapes::triangle(), shapes::square()] {
        for scale in [DVec3::ONE, DVec3::new(1.0, 1e-5, 1.0), DVec3::splat(1e-6), DVec3::splat(1e6)] {
            let mut mesh = mesh.clone();
            mesh.positions.iter_mut().for_each(|p| *p *= scale);
            let flat: Vec<DVec2> = mesh.positions.iter().map(|p| p.truncate()).collect();
            for options in energies() {
                let uv = flatten(&mesh, &options).unwrap();
                let error = rigid_error(&flat, &uv);
                assert!(error < 1e-9, "{error} at {scale} with {options:?}");
            }
        }
    }
}

/// A mesh on a line has no area to be as large as.
#[test]
fn a_mesh_without_area_is_refused_by_name() {
    for mesh in [shapes::triangle(), shapes::square(), shapes::lattice(6, 5, 0.01)] {
        for direction in [DVec3::X, DVec3::new(0.3, -0.7, 0.1)] {
            let mut mesh = mesh.clone();
            mesh.positions.iter_mut().for_each(|p| *p = direction * (p.x + 0.37 * p.y));
            for options in energies() {
                let found = flatten(&mesh, &options);
                assert!(matches!(found, Err(FlattenError::Size { area }) if area < 1e-12), "{found:?}");
            }
            mesh.positions.iter_mut().for_each(|p| *p = DVec3::ONE);
            let found = flatten(&mesh, &FlattenOptions::default());
            assert!(matches!(found, Err(FlattenError::PointFace { .. })), "{found:?}");
        }
    }
}

/// Two squares that share one corner: the boundary runs through it twice.
#[test]
fn a_boundary_that_touches_itself_in_a_vertex_is_refused_by_name() {
    let at = [[0., 0.], [1., 0.], [1., 1.], [0., 1.], [2., 1.], [2., 2.], [1., 2.]];
    let positions = at.iter().map(|p| DVec3::new(p[0], p[1], 0.0)).collect();
    let mesh = TriMesh::from_arrays(positions, &[[0, 1, 2], [0, 2, 3], [2, 4, 5], [2, 5, 6]]);
    let found = flatten(&mesh, &FlattenOptions::default());
    assert!(matches!(found, Err(FlattenError::Mesh(_))), "{found:?}");
}

/// A sheet `f` of the unit square.
fn sheet(columns: u32, rows: u32, f: impl Fn(f64, f64) -> DVec3) -> TriMesh {
    let at = |i: u32, n: u32| f64::from(i) / f64::from(n - 1);
    shapes::sheet(columns, rows, |i, j| f(at(i, columns), at(j, rows)))
}

/// A tube of `rings` rings, at the `place` of an angle and a height from 0 to 1.
fn tube(around: u32, rings: u32, place: impl Fn(f64, f64) -> DVec3) -> TriMesh {
    let mut mesh = shapes::tube(around, rings, 1.0, 1.0);
    for p in mesh.positions.iter_mut() {
        *p = place(p.y.atan2(p.x), p.z);
    }
    mesh
}

/// Uniform numbers from 0 to 1: the fractions of multiples of the golden ratio and the like.
fn numbers(seed: u32) -> [f64; 5] {
    [0.618_033_988_75, 0.754_877_666_25, 0.569_840_290_99, 0.819_172_513_40, 0.671_043_606_70]
        .map(|step| (f64::from(seed + 1) * step).fract())
}

/// The name and the mesh of the shape number `seed`: spiral ramps that overlap themselves on a map,
/// tapered and dented sleeves, folded sheets, rolled and twisted bands, each with any size and
/// number of faces.
fn random_shape(seed: u32) -> (&'static str, TriMesh) {
    let [a, h, s, c, r] = numbers(seed);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
    let count = |from: f64, to: f64, x: f64| (from + (to - from) * x) as u32;
    let (columns, rows) = (count(20.0, 140.0, c), count(3.0, 12.0, r));
    match seed % 4 {
        0 => {
            let turns = TAU * (1.0 + 1.8 * a);
            let ramp = |x: f64, y: f64| {
                let ripple = 0.02 * h * (60.0 * x).sin() * (9.0 * y).cos();
                ((0.05 + 0.05 * y) * DVec2::from_angle(-turns * x)).extend(0.005 * turns * x + ripple)
            };
            ("spiral", sheet(columns, rows, ramp))
        }
        1 => {
            let sleeve = |angle: f64, y: f64| {
                let radius = 0.04 * (1.0 - 0.7 * s * y + 0.3 * h * (7.0 * y).sin());
                let dent = DVec2::new(1.0, 1.0 + 0.4 * a * (3.0 * y).cos());
                (radius * DVec2::from_angle(angle) * dent).extend(0.25 * y * (0.3 + a))
            };
            ("sleeve", tube(8.max(columns / 3), rows + 4, sleeve))
        }
        2 => {
            let fold = |x: f64, y: f64| {
                let bump = 0.1 * s * (-((x - 0.5).powi(2) + (y - 0.4).powi(2)) / 0.03).exp();
                let wave = 0.12 * (a - 0.3) * (9.0 * x + 3.0 * h).sin() * (7.0 * y).cos();
                DVec3::new(0.2 * x, 0.15 * y, wave + bump)
            };
            ("fold", sheet(12.max(columns / 2), 4 * rows, fold))
        }
        _ => {
            let roll = |x: f64, y: f64| {
                let place = 0.1 * (-2.0 * h * x).exp() * DVec2::from_angle(9.0 * x * (1.0 + a));
                place.extend(0.06 * y + 0.05 * s * (12.0 * x).sin() * y)
            };
            ("roll", sheet(columns, rows, roll))
        }
    }
}

/// No face flipped and nothing crossed, by exact predicates, at an energy that is a number.
///
/// `DERMATOME_SHAPES` is how many shapes are tried.
#[test]
fn random_folds_spirals_and_sleeves_do_not_overlap() {
    let count = std::env::var("DERMATOME_SHAPES").ok().and_then(|n| n.parse().ok()).unwrap_or(12);
    for seed in 0..count {
        let (name, mesh) = random_shape(seed);
        let options = energies()[seed as usize / 4 % 2].clone();
        let uv = flatten(&mesh, &options).unwrap_or_else(|e| panic!("{name} {seed}: {e}"));
        let Distortion { flips, crossings, symmetric_dirichlet, .. } = distortion(&mesh, &uv);
        assert_eq!((flips, crossings), (0, 0), "{name} {seed} of {} faces", mesh.triangles.len());
        assert!(symmetric_dirichlet.is_finite(), "{name} {seed}: {symmetric_dirichlet}");
    }
}
