//! Laws of designed skins: modules that do not overlap, near the surface, wired across shared edges.

use std::f64::consts::PI;

use dermatome::design::{Design, DesignError, DesignOptions, Module, Wiring, design, strips};
use dermatome::id::{FaceId, VertexId};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::run::Run;
use glam::{DQuat, DVec2, DVec3};

/// Half of a tube of radius 71.6 mm and length 144 mm, as a robot's upper arm carries: columns around, rows along.
fn half_shell(columns: u32, rows: u32) -> TriMesh {
    shapes::sheet(columns, rows, |i, j| {
        let angle = PI * f64::from(i) / f64::from(columns - 1);
        let along = 0.144 * f64::from(j) / f64::from(rows - 1);
        DVec3::new(-0.0716 * angle.cos(), along, 0.0716 * angle.sin())
    })
}

/// The mesh with faces outward.
fn outward(mut mesh: TriMesh) -> TriMesh {
    let face = mesh.triangles.ids().next().unwrap();
    let [a, ..] = mesh.corners(face);
    if mesh.face_cross(face).dot(DVec3::new(a.x, 0.0, a.z)) < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

/// The mesh with its vertices and faces in another order.
fn shuffled(mesh: &TriMesh) -> TriMesh {
    // Strides that have no factor in common with the numbers of 60 x 40 vertices and their faces.
    let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
    let old: Vec<_> = (0..vertices).map(|k| (1 + 7 * k) % vertices).collect();
    let mut new = vec![VertexId::new(0); vertices];
    old.iter().enumerate().for_each(|(k, &from)| new[from] = VertexId::new(k));
    let face = |k: usize| mesh.triangles[FaceId::new((5 + 11 * k) % faces)].map(|v| new[v.index()]);
    TriMesh {
        positions: old.iter().map(|&from| mesh.positions[VertexId::new(from)]).collect(),
        triangles: (0..faces).map(face).collect(),
    }
}

fn flexible(tolerance: f64, most: usize) -> DesignOptions {
    DesignOptions { tolerance, bend_radius: Some(0.02), wiring: Wiring { most, has_branches: false } }
}

/// The largest distance of a dense outline and the taxels from a tube of this radius around y.
fn largest_gap(skin: &Design, module: &Module, radius: f64) -> f64 {
    let count = module.outline.len();
    let outline = (0..count).flat_map(|k| {
        let (a, b) = (module.outline[k], module.outline[(k + 1) % count]);
        (0..20).map(move |i| a.lerp(b, f64::from(i) / 20.0))
    });
    let points: Vec<DVec2> = outline.chain(module.taxels.iter().copied()).collect();
    let off = |p: DVec3| (p.x.hypot(p.z) - radius).abs();
    let gaps = skin.modules.iter().flat_map(|m| points.iter().map(|&at| off(m.plate.point(at))));
    gaps.fold(0.0, f64::max)
}

/// The shares of points of a tube around y that are under at least one module, and under more than one.
fn shares(skin: &Design, module: &Module, radius: f64, height: f64, angles: f64) -> [f64; 2] {
    let (mut once, mut twice, mut all) = (0.0, 0.0, 0.0);
    for i in 0..400 {
        for j in 0..200 {
            let (angle, y) = (angles * (f64::from(i) + 0.5) / 400.0, height * (f64::from(j) + 0.5) / 200.0);
            let p = DVec3::new(-radius * angle.cos(), y, radius * angle.sin());
            let is_under = |plate: &dermatome::design::Plate| {
                let (at, off) = plate.unbent(p);
                let count = module.outline.len();
                off.abs() < 0.004
                    && (0..count).all(|k| {
                        let (a, b) = (module.outline[k], module.outline[(k + 1) % count]);
                        (b - a).perp_dot(at - a) >= 0.0
                    })
            };
            let over = skin.modules.iter().filter(|m| is_under(&m.plate)).count();
            all += 1.0;
            once += f64::from(u8::from(over > 0));
            twice += f64::from(u8::from(over > 1));
        }
    }
    [once / all, twice / all]
}

/// How much longer or shorter the sides of modules are along their plates than in the drawing, in m.
fn side_errors<'a>(skin: &'a Design, module: &'a Module) -> impl Iterator<Item = f64> + 'a {
    let corners = &module.outline;
    skin.modules.iter().flat_map(move |m| {
        (0..corners.len()).map(move |k| {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            let at = |i: u32| m.plate.point(a.lerp(b, f64::from(i) / 400.0));
            let length: f64 = (0..400).map(|i| at(i).distance(at(i + 1))).sum();
            (length - a.distance(b)).abs()
        })
    })
}

/// The patch of the UR10e that 60 modules of CySkin cover: the same number, in one piece and five chains of twelve,
/// whatever its triangles are, in which order, and however it is turned.
#[test]
fn a_half_shell_has_the_sixty_modules_of_the_real_one() {
    let module = Module::triangle(0.0322);
    let options = flexible(5e-4, 12);
    let turn = DQuat::from_scaled_axis(DVec3::new(0.4, -0.3, 2.0));
    for (mesh, is_turned) in
        [(half_shell(60, 40), false), (half_shell(46, 30), false), (half_shell(60, 40), true)]
    {
        let mut mesh = outward(mesh);
        if is_turned {
            mesh = shuffled(&mesh);
            mesh.positions.iter_mut().for_each(|p| *p = turn * *p + DVec3::X);
        }
        let start = std::time::Instant::now();
        let skin = design(&mesh, &module, &options, Run::default()).unwrap();
        println!("{} modules in {:?}", skin.modules.len(), start.elapsed());
        assert_eq!((skin.modules.len(), skin.pieces, skin.bound, skin.chains.len()), (60, 1, 5, 5));
        assert!(skin.chains.iter().all(|chain| chain.modules.len() == 12));
        assert!(skin.gap() <= options.tolerance && skin.radius() > 0.06, "{} {}", skin.gap(), skin.radius());
        assert!(side_errors(&skin, &module).all(|error| error < 1e-6));
        if is_turned {
            continue;
        }
        assert!(largest_gap(&skin, &module, 0.0716) < 1.05 * options.tolerance);
        let [once, twice] = shares(&skin, &module, 0.0716, 0.144, PI);
        assert!(twice < 1e-3 && (once - skin.covered).abs() < 0.01, "{once} {twice} {}", skin.covered);
    }
}

/// A sphere can be unrolled nowhere: what would fit is told, and a larger module fits less.
#[test]
fn the_side_that_fits_a_sphere_is_that_of_its_curvature() {
    let ball = shapes::ball(24, 0.1);
    let skin = design(&ball, &Module::triangle(0.02), &flexible(1e-3, 16), Run::default()).unwrap();
    let side = (16.0 * 1e-3 * 0.1_f64).sqrt();
    assert!(
        skin.sides.iter().all(|found| (found / side - 1.0).abs() < 0.1),
        "{:?} is not {side}",
        skin.sides
    );
    assert!(skin.covered > 0.4, "{}", skin.covered);
    assert!(4 * skin.chains.len() <= 5 * skin.bound, "{} {}", skin.chains.len(), skin.bound);
    let error = design(&ball, &Module::triangle(0.08), &flexible(1e-3, 16), Run::default()).unwrap_err();
    assert!(matches!(error, DesignError::NothingFits { .. }), "{error}");
}

/// Every kind of module on a tube: wired once, strips edge to edge and not over themselves, whatever the number of threads.
#[test]
fn all_modules_tile_a_tube() {
    let mesh = shapes::tube(60, 16, 0.06, 0.09);
    for module in [Module::triangle(0.032), Module::hexagon(0.016), Module::rectangle(0.03, 0.02)] {
        let made = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| design(&mesh, &module, &flexible(1e-3, 8), Run::default()).unwrap())
        };
        let skin = made(2);
        if module.outline.len() == 6 {
            assert_eq!(skin, made(1));
        }
        assert!(skin.covered > 0.6, "{}", skin.covered);
        assert!(skin.chains.len() <= skin.bound + skin.pieces, "{} {}", skin.chains.len(), skin.bound);
        let mut wired: Vec<usize> = skin.chains.iter().flat_map(|chain| chain.modules.clone()).collect();
        assert!(wired.is_sorted());
        wired.dedup();
        assert_eq!(wired.len(), skin.modules.len());
        let place = |m: usize, k: usize| {
            let corners = [module.outline[k], module.outline[(k + 1) % module.outline.len()]];
            corners.map(|at| skin.modules[m].plate.point(at))
        };
        for step in skin.chains.iter().flat_map(|chain| &chain.steps) {
            let [[a, b], [c, d]] = [0, 1].map(|k| place(step.modules[k], step.edges[k]));
            assert!(a.distance(d).max(b.distance(c)) < 2.3e-3, "{step:?}");
        }
        let strips = strips(&skin, &module);
        let unrolled: usize = strips.iter().map(|strip| strip.modules.len()).sum();
        assert_eq!(unrolled, skin.modules.len());
        for strip in &strips {
            for pair in strip.modules.windows(2) {
                let [p, q] = [0, 1].map(|k| pair[k].1.transform_point2(DVec2::ZERO));
                assert!(p.distance(q) < module.diameter() * 1.1 && p.distance(q) > 0.01, "{p} {q}");
            }
        }
    }
}

#[test]
fn what_cannot_be_designed_is_refused() {
    let mesh = shapes::tube(90, 40, 0.06, 0.12);
    let kind = |module: &Module, options: &DesignOptions| {
        design(&mesh, module, options, Run::default()).unwrap_err().kind()
    };
    let module = Module::triangle(0.032);
    assert_eq!(kind(&Module::triangle(0.5), &flexible(1e-3, 8)), "too_large");
    assert_eq!(kind(&Module::triangle(2e-4), &flexible(1e-3, 8)), "too_many");
    assert_eq!(kind(&module, &flexible(f64::NAN, 8)), "option");
    assert_eq!(kind(&module, &flexible(0.033, 8)), "too_loose");
    assert_eq!(kind(&module, &flexible(1e-3, 0)), "option");
    assert_eq!(kind(&module, &DesignOptions { bend_radius: Some(-1.0), ..flexible(1e-3, 8) }), "option");
    // Rigid modules lie 32^2 / 16 / 60 mm from a tube.
    assert_eq!(kind(&module, &DesignOptions { bend_radius: None, ..flexible(1e-4, 8) }), "nothing_fits");
    let stop = std::sync::atomic::AtomicBool::new(true);
    let run = Run::default().cancelled_by(&stop);
    assert_eq!(design(&mesh, &module, &flexible(1e-3, 8), run).unwrap_err().kind(), "cancelled");
}
