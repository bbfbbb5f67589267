//! Laws of the pyramid: nested centres, convex prolongations that keep force, and levels that stay
//! manifolds of the same shape and can be undone.

use std::collections::{BTreeMap, BTreeSet};

use crate::altered::{renumbered, without};
use dermatome::id::{FaceId, IdVec, VertexId};
use dermatome::mesh::{Adjacency, MeshError, TriMesh, mean_edge_length, shapes};
use dermatome::pyramid::{
    CoarsenOptions, Level, LevelId, Prolongation, Pyramid, PyramidError, Removal, RemovalLog, coarsen,
};
use dermatome::remesh::remesh;
use dermatome::run::Run;
use dermatome::skin::{LinkId, Patch, Presence, TaxelError, TaxelId};
use glam::DVec3;
use proptest::prelude::*;

fn patch(mesh: TriMesh) -> Patch {
    Patch::from_mesh("patch", LinkId::new(0), mesh)
}

fn coarsen_patch(patch: &Patch, options: &CoarsenOptions) -> Result<Pyramid, PyramidError> {
    coarsen(&patch.mesh, &patch.taxels, options, Run::default())
}

fn pyramid(mesh: TriMesh) -> Pyramid {
    coarsen_patch(&patch(mesh), &CoarsenOptions::default()).unwrap()
}

/// Pairs of a level and the next coarser one.
fn steps(pyramid: &Pyramid) -> impl Iterator<Item = (&Level, &RemovalLog, &Level)> {
    let (fine, coarse) = (pyramid.levels.iter(), pyramid.levels.iter().skip(1));
    fine.zip(&pyramid.removals).zip(coarse).map(|((fine, log), coarse)| (fine, log, coarse))
}

fn cap(faces: usize) -> TriMesh {
    shapes::cap(faces, 0.1, 110_f64.to_radians())
}

/// The mesh without the faces around each of `centres`, and without those vertices.
fn punched(mesh: &TriMesh, centres: impl Fn(VertexId) -> bool) -> TriMesh {
    without(mesh, |face| mesh.triangles[face].into_iter().any(&centres))
}

/// A lattice with a hexagonal hole of one spacing at every `every`-th vertex in both directions.
fn sieve(columns: u32, rows: u32, every: u32) -> TriMesh {
    let hole = |at: u32, count: u32| at % every == every / 2 && at > 1 && at + 2 < count;
    punched(&shapes::lattice(columns, rows, 0.005), |v| {
        hole(v.raw() % columns, columns) && hole(v.raw() / columns, rows)
    })
}

/// Moves every vertex by up to `share` of its shortest edge in each coordinate.
fn jittered(mesh: &TriMesh, share: f64, seed: u64) -> TriMesh {
    let adjacency = Adjacency::new(mesh).unwrap();
    let mut state = seed;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let mut out = mesh.clone();
    for (v, p) in mesh.positions.enumerate() {
        let edges = adjacency.ring(v).iter().map(|&w| p.distance(mesh.positions[w]));
        let shortest = edges.fold(f64::INFINITY, f64::min);
        out.positions[v] = *p + DVec3::new(noise(), noise(), noise()) * (share * shortest);
    }
    out
}

/// Pairs of neighbouring faces that turn away from each other by more than a right angle.
fn folds(mesh: &TriMesh) -> usize {
    let adjacency = Adjacency::new(mesh).unwrap();
    let across = |f| adjacency.neighbours(f).into_iter().flatten().filter(move |other| *other > f);
    let pairs = mesh.triangles.ids().flat_map(|f| across(f).map(move |other| [f, other]));
    pairs.map(|pair| pair.map(|f| mesh.face_cross(f))).filter(|[a, b]| a.dot(*b) < 0.0).count()
}

/// A triangle from its smallest corner, so that equal triangles are equal.
fn rotated([a, b, c]: [VertexId; 3]) -> [VertexId; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

fn set(triangles: impl IntoIterator<Item = [VertexId; 3]>) -> BTreeSet<[VertexId; 3]> {
    triangles.into_iter().map(rotated).collect()
}

fn components(mesh: &TriMesh, adjacency: &Adjacency) -> usize {
    let (mut seen, mut count) = (mesh.positions.map(|_| false), 0);
    for seed in mesh.positions.ids() {
        count += usize::from(!seen[seed]);
        let mut stack = vec![seed];
        while let Some(v) = stack.pop() {
            if !std::mem::replace(&mut seen[v], true) {
                stack.extend(adjacency.ring(v));
            }
        }
    }
    count
}

/// The triangles that go with a removed vertex, around its whole ring or along an open chain.
fn star(removal: &Removal<'_>) -> Vec<[VertexId; 3]> {
    let Removal { vertex, ring, boundary, .. } = *removal;
    let count = ring.len() - usize::from(boundary);
    (0..count).map(|i| [vertex, ring[i], ring[(i + 1) % ring.len()]]).collect()
}

/// The triangles that take their place.
fn filling<'a>(removal: &Removal<'a>) -> impl Iterator<Item = [VertexId; 3]> + use<'a> {
    let ring = removal.ring;
    removal.triangles.iter().map(move |t| t.map(|i| ring[usize::from(i)]))
}

/// The triangles of `fine` after the first `count` removals, each of which must be there to go.
fn triangles_after(fine: &TriMesh, log: &RemovalLog, count: usize) -> BTreeSet<[VertexId; 3]> {
    let mut triangles = set(fine.triangles.iter().copied());
    for removal in log.iter().take(count) {
        assert!(removal.ring.len() >= 3, "a ring is a polygon");
        for t in star(&removal) {
            assert!(triangles.remove(&rotated(t)), "star {t:?} is there when it goes");
        }
        for t in filling(&removal) {
            assert!(triangles.insert(rotated(t)), "filling {t:?} is new");
        }
    }
    triangles
}

/// Every law that holds for the pyramid of any patch.
fn assert_laws(pyramid: &Pyramid) {
    pyramid.validate().unwrap();
    let ground = &pyramid.levels[LevelId::new(0)];
    let shape = |level: &Level| {
        let adjacency = Adjacency::new(&level.mesh).unwrap();
        (
            adjacency.euler_characteristic(),
            adjacency.boundary_loops().len(),
            components(&level.mesh, &adjacency),
        )
    };
    let total = |x: &IdVec<VertexId, f64>| x.iter().sum::<f64>();
    let forces: IdVec<VertexId, f64> =
        ground.mesh.positions.ids().map(|v| 0.1 + f64::from(v.raw() % 7)).collect();
    let unfolded = folds(&ground.mesh) == 0;
    for (id, level) in pyramid.levels.enumerate() {
        assert_eq!(shape(level), shape(ground), "Euler characteristic, loops and components of level {id}");
        assert!(!unfolded || folds(&level.mesh) == 0, "level {id} of a smooth skin has no folds");
        let (a, b) = (total(&level.areas), total(&ground.areas));
        assert!((a - b).abs() <= 1e-12 * b, "level {id} has the skin's area: {a} and {b}");
        for (v, &taxel) in level.origins.enumerate() {
            assert_eq!(level.mesh.positions[v], ground.mesh.positions[taxel], "a centre is a taxel");
        }
        let Some(direct) = &level.to_finest else { continue };
        let (a, b) = (total(&direct.restrict(&forces)), total(&forces));
        assert!((a - b).abs() <= 1e-12 * b, "level {id} has the skin's force: {a} and {b}");
        let faces = set(level.mesh.triangles.iter().copied());
        for (indices, weights) in direct.indices.iter().zip(&direct.weights) {
            assert!(faces.contains(&rotated(*indices)), "row {indices:?} is a face of level {id}");
            assert!(weights.iter().all(|w| *w >= 0.0), "weights {weights:?}");
            assert!((weights.iter().sum::<f64>() - 1.0).abs() <= 1e-12, "weights {weights:?}");
        }
        for (v, &taxel) in level.origins.enumerate() {
            assert_eq!((direct.indices[taxel][0], direct.weights[taxel]), (v, [1.0, 0.0, 0.0]), "a centre");
        }
    }
    for (fine, log, coarse) in steps(pyramid) {
        assert_step(fine, log, coarse);
    }
}

/// The laws between a level and the next coarser one.
fn assert_step(fine: &Level, log: &RemovalLog, coarse: &Level) {
    let (before, after) = (fine.mesh.positions.len() as f64, coarse.mesh.positions.len() as f64);
    assert!(before >= 1.5 * after, "a level shrinks by 1.5 at least: {before} to {after}");
    let up = fine.from_coarser.as_ref().unwrap();
    let direct = coarse.to_finest.as_ref().unwrap();
    for (v, &taxel) in fine.origins.enumerate() {
        assert_eq!(up.indices[v], direct.indices[taxel], "up is direct's rows of surviving taxels");
        assert_eq!(up.weights[v], direct.weights[taxel], "up is direct's rows of surviving taxels");
    }
    let vertex_of: BTreeMap<_, _> = fine.origins.enumerate().map(|(v, &taxel)| (taxel, v)).collect();
    let finer = coarse.origins.map(|taxel| vertex_of[taxel]);
    let coarse_triangles = set(coarse.mesh.triangles.iter().map(|t| t.map(|v| finer[v])));
    assert_eq!(
        triangles_after(&fine.mesh, log, usize::MAX),
        coarse_triangles,
        "all removals give the coarse mesh"
    );
}

#[test]
fn the_laws_hold_on_named_shapes() {
    for mesh in [
        cap(4000),
        shapes::saddle(40),
        shapes::lattice(50, 30, 0.006),
        shapes::tube(30, 40, 0.04, 0.25),
        shapes::torus(60, 25, 0.1, 0.03),
        sieve(60, 40, 6),
        sieve(40, 40, 3),
        shapes::fan(500),
        shapes::square(),
        shapes::triangle(),
        shapes::tetrahedron(),
    ] {
        assert_laws(&pyramid(mesh));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_laws_hold_on_rough_shapes(
        shape in 0_usize..6,
        size in 4_u32..28,
        share in 0.0..0.35_f64,
        seed: u64,
        ratio in prop::option::of(1.5..9.0_f64),
    ) {
        let mesh = match shape {
            0 => cap(2 * (size * size) as usize),
            1 => shapes::saddle(size),
            2 => shapes::lattice(size, 2 + size / 2, 0.01),
            3 => shapes::tube(3 + size / 2, size, 0.03, 0.2),
            4 => sieve(size, size, 3 + size % 4),
            _ => shapes::torus(3 + size / 2, 3 + size / 3, 0.1, 0.04),
        };
        let patch = patch(jittered(&mesh, share, seed));
        let options = CoarsenOptions { ratio, coarsest: 8, ..CoarsenOptions::default() };
        assert_laws(&coarsen_patch(&patch, &options).unwrap());
    }

    /// Slivers, spikes and vertices on top of each other are all manifolds: they may stall a
    /// pyramid but not break it.
    #[test]
    fn degenerate_positions_neither_panic_nor_make_nan(
        size in 3_u32..12,
        places in prop::collection::vec((0_i8..4, 0_i8..4, 0_i8..2), 144),
    ) {
        let mesh = shapes::sheet(size, size, |i, j| {
            let (x, y, z) = places[(j * size + i) as usize];
            DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * 1e-3
        });
        let options = CoarsenOptions { coarsest: 3, ..CoarsenOptions::default() };
        assert_laws(&coarsen_patch(&patch(mesh), &options).unwrap());
    }
}

#[test]
fn the_same_bytes_for_any_number_of_threads() {
    let patch = patch(jittered(&cap(20_000), 0.2, 3));
    let options = CoarsenOptions { ratio: Some(4.0), ..CoarsenOptions::default() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| coarsen_patch(&patch, &options).unwrap())
    };
    let one = with(1);
    assert!(one == with(2), "one thread and two");
    assert!(one == with(7), "one thread and seven");
}

/// Positions are a linear field, so they prolong to nearly themselves where the surface is nearly
/// flat.
#[test]
fn a_linear_field_is_reproduced_to_a_tenth_of_the_spacing_on_the_cap() {
    let pyramid = pyramid(cap(10_000));
    let ground = &pyramid.levels[LevelId::new(0)].mesh;
    let (fine, _, coarse) = steps(&pyramid).next().unwrap();
    let spacing = mean_edge_length(ground, &Adjacency::new(ground).unwrap());
    let prolonged = fine.from_coarser.as_ref().unwrap().apply(&coarse.mesh.positions);
    let squares: f64 = prolonged.iter().zip(&ground.positions).map(|(a, b)| a.distance_squared(*b)).sum();
    let rms = (squares / ground.positions.len() as f64).sqrt();
    assert!(rms < 0.1 * spacing, "rms error {rms} of {spacing}");
}

/// On a plane every star is flat already: inside the boundary, positions prolong to themselves.
#[test]
fn a_linear_field_is_exact_on_a_plane() {
    let mesh = shapes::lattice(40, 40, 0.01);
    let inside = |p: &DVec3| (p - DVec3::new(0.2, 0.17, 0.0)).abs().max_element() < 0.12;
    let pyramid = pyramid(mesh);
    for (fine, _, coarse) in steps(&pyramid).take(1) {
        let prolonged = fine.from_coarser.as_ref().unwrap().apply(&coarse.mesh.positions);
        for (p, q) in fine.mesh.positions.iter().zip(&prolonged).filter(|(p, _)| inside(p)) {
            assert!(p.distance(*q) < 1e-12, "{p} became {q}");
        }
    }
}

#[test]
fn a_ratio_is_met_and_the_top_is_about_as_small_as_asked() {
    let patch = patch(cap(20_000));
    for ratio in [2.0, 3.0, 4.0, 8.0] {
        let options = CoarsenOptions { ratio: Some(ratio), ..CoarsenOptions::default() };
        let pyramid = coarsen_patch(&patch, &options).unwrap();
        for (fine, _, coarse) in steps(&pyramid) {
            let (before, after) = (fine.mesh.positions.len() as f64, coarse.mesh.positions.len() as f64);
            if after > 500.0 {
                assert!((before / after / ratio - 1.0).abs() < 0.03, "{before} to {after} for {ratio}");
            }
        }
        let top = pyramid.levels.iter().last().unwrap().mesh.positions.len() as f64;
        let missed = (top / 32.0).ln().abs();
        assert!(missed < 0.6 * ratio.ln(), "{top} vertices at the top for ratio {ratio}");
    }
}

#[test]
fn levels_are_as_many_as_asked_for() {
    let patch = patch(cap(5_000));
    for levels in [0, 1, 2] {
        let options = CoarsenOptions { levels: Some(levels), ..CoarsenOptions::default() };
        assert_eq!(
            coarsen_patch(&patch, &options).unwrap().levels.len(),
            levels + 1,
            "level 0 is always there"
        );
    }
}

#[test]
fn every_hole_keeps_a_rim_of_three() {
    let pyramid = pyramid(sieve(90, 70, 10));
    assert!(pyramid.levels.len() >= 3, "few holes do not stall a pyramid");
    for level in &pyramid.levels {
        let loops = Adjacency::new(&level.mesh).unwrap().boundary_loops();
        assert!(loops.iter().all(|rim| rim.len() >= 3), "a rim of three");
    }
}

/// A hole shrinks with its rim's polygon (a hexagon's inscribed triangle has half its area) but
/// does not wander.
#[test]
fn holes_stay_where_they_are() {
    let radius = 0.005;
    let pyramid = pyramid(sieve(90, 70, 10));
    // The middle of every rim but the outer one, which is the longest.
    let holes = |level: &Level| -> Vec<DVec3> {
        let mut loops = Adjacency::new(&level.mesh).unwrap().boundary_loops();
        let extent = |rim: &[VertexId]| {
            let start = level.mesh.positions[rim[0]];
            rim.iter().map(|&v| start.distance(level.mesh.positions[v])).fold(0.0, f64::max)
        };
        loops.retain(|rim| extent(rim) < 4.0 * radius);
        let middle = |rim: &Vec<VertexId>| {
            rim.iter().map(|&v| level.mesh.positions[v]).sum::<DVec3>() / rim.len() as f64
        };
        loops.iter().map(middle).collect()
    };
    let first = holes(&pyramid.levels[LevelId::new(0)]);
    for level in &pyramid.levels {
        let now = holes(level);
        assert_eq!(now.len(), first.len(), "every hole is still a small one");
        for at in now {
            let moved = first.iter().map(|h| h.distance(at)).fold(f64::INFINITY, f64::min);
            assert!(moved < 0.5 * radius, "a hole of radius {radius} m moved by {moved} m");
        }
    }
}

#[test]
fn dense_skin_keeps_small_fields() {
    let mut patch = patch(shapes::lattice(60, 60, 0.01));
    // Twice the density in the right half: that many more of its taxels stay.
    let right = |p: &DVec3| p.x > 0.3;
    patch.taxels.densities = Some(patch.mesh.positions.map(|p| if right(p) { 4e4 } else { 1e4 }));
    let options = CoarsenOptions { levels: Some(2), ..CoarsenOptions::default() };
    for level in coarsen_patch(&patch, &options).unwrap().levels.iter().skip(1) {
        let dense = level.mesh.positions.iter().filter(|p| right(p)).count() as f64;
        let sparse = level.mesh.positions.len() as f64 - dense;
        assert!(
            (2.0..6.0).contains(&(dense / sparse)),
            "{dense} and {sparse} fields, 4 times as many wanted"
        );
    }
}

/// The taxels that are the vertices of level 1.
fn centres(mesh: TriMesh) -> Vec<VertexId> {
    let options = CoarsenOptions { levels: Some(1), ..CoarsenOptions::default() };
    let pyramid = coarsen_patch(&patch(mesh), &options).unwrap();
    pyramid.levels[LevelId::new(1)].origins.as_slice().to_vec()
}

/// No two centres are within 1.35 spacings of each other, and every other taxel is within that of
/// one. On the boundary of a lattice a centre is one of the boundary, which comes before the inside,
/// and its two sharp corners come before all.
#[test]
fn centres_are_independent_and_maximal_and_corners_and_boundaries_come_first() {
    for (columns, rows) in [(30, 30), (9, 9)] {
        let mesh = shapes::lattice(columns, rows, 0.01);
        let adjacency = Adjacency::new(&mesh).unwrap();
        let is_near = |a: VertexId, b: VertexId| mesh.positions[a].distance(mesh.positions[b]) <= 0.0135;
        let centres = centres(mesh.clone());
        for v in mesh.positions.ids() {
            let blockers = centres.iter().filter(|&&c| c != v && is_near(v, c)).count();
            assert_eq!(centres.contains(&v), blockers == 0, "{v} has {blockers} centres around");
            let on_boundary = centres.iter().filter(|&&c| adjacency.is_boundary(c) && is_near(v, c)).count();
            assert!(!adjacency.is_boundary(v) || on_boundary > 0, "{v} has no centre on the boundary");
        }
        let corners = mesh.positions.ids().filter(|&v| adjacency.ring(v).len() == 2);
        assert_eq!(corners.filter(|v| centres.contains(v)).count(), 2);
    }
}

/// The two sheets of a fold are near in space but far on the skin.
#[test]
fn sheets_of_a_fold_do_not_see_each_other() {
    let gap = 0.001;
    let folded = shapes::sheet(21, 9, |i, j| {
        let turned = if i > 10 { (20.0 - f64::from(i), gap) } else { (f64::from(i), 0.0) };
        DVec3::new(0.01 * turned.0, 0.01 * f64::from(j), turned.1)
    });
    let centres = centres(folded.clone());
    let on = |z: f64| centres.iter().filter(|&&v| (folded.positions[v].z - z).abs() < 1e-9).count();
    assert!(on(0.0) >= 15 && on(gap) >= 15, "{} and {} centres", on(0.0), on(gap));
}

/// Densities weigh places against each other, in whichever unit; and that of a lattice of spacing
/// `h`, `2 / (sqrt3 h^2)`, says what the lattice shows.
#[test]
fn densities_only_weigh_places_against_each_other() {
    let mesh = jittered(&cap(3_000), 0.1, 1);
    let pyramid_of = |mesh: &TriMesh, density: &dyn Fn(&DVec3) -> f64| {
        let mut patch = patch(mesh.clone());
        patch.taxels.densities = Some(mesh.positions.map(density));
        coarsen_patch(&patch, &CoarsenOptions::default()).unwrap()
    };
    let one = pyramid_of(&mesh, &|p| 1.0 + 100.0 * p.x * p.x);
    let other = pyramid_of(&mesh, &|p| 1e4 + 1e6 * p.x * p.x);
    assert_eq!(one.removals, other.removals);
    let lattice = shapes::lattice(30, 20, 0.006);
    let stated = pyramid_of(&lattice, &|_| 2.0 / (3.0_f64.sqrt() * 0.006 * 0.006));
    assert_eq!(stated.removals[LevelId::new(0)], pyramid(lattice).removals[LevelId::new(0)]);
}

/// On a regular lattice neighbours conflict and others do not: a dead centre inside is one only
/// where every live neighbour has another centre next to it.
#[test]
fn a_dead_taxel_is_a_centre_only_where_no_live_one_can_be() {
    let mesh = shapes::lattice(40, 40, 0.005);
    let adjacency = Adjacency::new(&mesh).unwrap();
    let mut patch = patch(mesh.clone());
    let whole = coarsen_patch(&patch, &CoarsenOptions::default()).unwrap();
    let is_dead = |v: VertexId| v.raw().wrapping_mul(2_654_435_761) >> 30 == 0;
    for presence in [Presence::Absent, Presence::ThermalPad] {
        patch.taxels.presence =
            mesh.positions.ids().map(|v| if is_dead(v) { presence } else { Presence::Present }).collect();
        let pyramid = coarsen_patch(&patch, &CoarsenOptions::default()).unwrap();
        assert_laws(&pyramid);
        let dead = |pyramid: &Pyramid| {
            let level = &pyramid.levels[LevelId::new(1)];
            level.origins.iter().copied().filter(|&v| is_dead(v)).collect::<Vec<_>>()
        };
        let centres: BTreeSet<_> = pyramid.levels[LevelId::new(1)].origins.iter().copied().collect();
        let inside = |v: VertexId| adjacency.ring(v).len() == 6;
        for centre in dead(&pyramid).into_iter().filter(|&v| inside(v)) {
            for &live in adjacency.ring(centre).iter().filter(|&&v| inside(v) && !is_dead(v)) {
                let has_other = adjacency.ring(live).iter().any(|&v| v != centre && centres.contains(&v));
                assert!(has_other, "{live} could be a centre instead of {centre}");
            }
        }
        let [some, most] = [&pyramid, &whole].map(|pyramid| dead(pyramid).len());
        assert!(2 * some < most, "{some} dead centres, {most} without a preference");
    }
}

/// Levels follow from the taxels' ids and places: another order of the vertices and faces of a file gives
/// the same.
#[test]
fn the_order_of_a_file_does_not_matter() {
    let mesh = jittered(&cap(3_000), 0.1, 1);
    let count = mesh.positions.len();
    let order: Vec<usize> = (0..count).map(|v| (v * 1_009 + 17) % count).collect();
    let to = |v: VertexId| VertexId::new(order[v.index()]);
    let mut shuffled = renumbered(&mesh, &order);
    shuffled.triangles = shuffled.triangles.iter().rev().map(|&[a, b, c]| [b, c, a]).collect();
    let mut other = patch(shuffled);
    for v in mesh.positions.ids() {
        other.taxels.ids[to(v)] = TaxelId(v.raw() + 1);
    }
    let [made, again] = [&patch(mesh), &other].map(|patch| coarsen_patch(patch, &CoarsenOptions::default()));
    let (made, again) = (made.unwrap(), again.unwrap());
    assert!(made.levels.len() > 2 && made.levels.len() == again.levels.len());
    for (level, same) in made.levels.iter().zip(&again.levels).skip(1) {
        assert_eq!(level.mesh, same.mesh);
        assert_eq!(level.origins.map(|&v| to(v)), same.origins);
        let [rows, others] = [level, same].map(|level| level.to_finest.as_ref().unwrap());
        for v in rows.indices.ids() {
            assert_eq!((rows.indices[v], rows.weights[v]), (others.indices[to(v)], others.weights[to(v)]));
        }
    }
}

/// Ids that count through a skin give each patch the pyramid that it has alone.
#[test]
fn other_patches_do_not_matter() {
    let mut patch = patch(cap(3_000));
    let made = coarsen_patch(&patch, &CoarsenOptions::default()).unwrap();
    patch.taxels.ids = patch.taxels.ids.map(|id| TaxelId(id.0 + 5_000));
    assert_eq!(coarsen_patch(&patch, &CoarsenOptions::default()).unwrap(), made);
}

#[test]
fn placeholder_ids_do_no_harm() {
    let mut patch = patch(cap(3_000));
    patch.taxels.ids = patch.taxels.ids.map(|_| TaxelId(0));
    assert_laws(&coarsen_patch(&patch, &CoarsenOptions::default()).unwrap());
}

/// Half-way meshes, on which maps are refined, are manifolds of the same shape too.
#[test]
fn removals_can_be_undone_in_part() {
    let pyramid = pyramid(sieve(30, 30, 7));
    let (fine, log, _) = steps(&pyramid).next().unwrap();
    let removals = log.iter().len();
    for count in [0, 1, removals / 2, removals - 1] {
        let triangles = triangles_after(&fine.mesh, log, count).into_iter().collect();
        let mesh = TriMesh { positions: fine.mesh.positions.clone(), triangles };
        let gone: BTreeSet<_> = log.iter().take(count).map(|r| r.vertex).collect();
        let left = punched(&mesh, |v| gone.contains(&v));
        let euler = |mesh: &TriMesh| Adjacency::new(mesh).unwrap().euler_characteristic();
        assert_eq!(euler(&left), euler(&fine.mesh), "after {count} removals");
        assert_eq!(left.positions.len() + count, fine.mesh.positions.len(), "nobody else is gone");
    }
}

/// Two hubs share every spoke: asking whether they are neighbours must not cost a walk each time.
#[test]
fn hubs_do_not_make_it_slow() {
    let spokes = 40_000;
    let rim = (0..spokes).map(|i| DVec3::new(0.0, 1e-4 * f64::from(i), 0.0));
    let positions = [DVec3::new(-1.0, 2.0, 0.0), DVec3::new(1.0, 2.0, 0.0)].into_iter().chain(rim);
    let triangles: Vec<_> = (2..spokes + 1).flat_map(|i| [[0, i, i + 1], [1, i + 1, i]]).collect();
    assert_laws(&pyramid(TriMesh::from_arrays(positions.collect(), &triangles)));
}

#[test]
fn bad_patches_are_refused_by_name() {
    let coarsen = |patch: &Patch| coarsen_patch(patch, &CoarsenOptions::default()).unwrap_err();
    let doubled =
        TriMesh::from_arrays(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z], &[[0, 1, 2], [0, 1, 3]]);
    let edge = MeshError::NonManifoldEdge {
        from: VertexId::new(0),
        to: VertexId::new(1),
        first: FaceId::new(0),
        second: FaceId::new(1),
    };
    assert_eq!(coarsen(&patch(doubled)), PyramidError::Mesh(edge));

    let mut short = patch(shapes::square());
    short.taxels.ids = IdVec::default();
    assert_eq!(coarsen(&short), PyramidError::Length { what: "ids", found: 0, needed: 4 });

    let mut silent = patch(shapes::square());
    silent.taxels.presence = IdVec::default();
    assert_eq!(coarsen(&silent), PyramidError::Length { what: "presence", found: 0, needed: 4 });

    let mut negative = patch(shapes::square());
    negative.taxels.areas[VertexId::new(2)] = -1.0;
    assert_eq!(coarsen(&negative), PyramidError::Area { vertex: VertexId::new(2), found: -1.0 });

    let mut empty = patch(shapes::square());
    empty.taxels.densities = Some(vec![0.0; 4].into());
    assert_eq!(coarsen(&empty), TaxelError::Density { vertex: VertexId::new(0), found: 0.0 }.into());
}

#[test]
fn a_ratio_that_makes_no_levels_is_refused() {
    for found in [1.0, 0.0, -4.0, f64::INFINITY] {
        let options = CoarsenOptions { ratio: Some(found), ..CoarsenOptions::default() };
        let error = coarsen_patch(&patch(shapes::square()), &options).unwrap_err();
        assert_eq!(error, PyramidError::Ratio { found, least: 1.5 });
    }
}

/// Two fine vertices: one is coarse vertex 0, the other the middle of 0 and 2.
fn middle() -> Prolongation {
    Prolongation {
        indices: vec![[0, 1, 2].map(VertexId::new); 2].into(),
        weights: vec![[1.0, 0.0, 0.0], [0.5, 0.0, 0.5]].into(),
        coarse_len: 3,
    }
}

#[test]
fn values_are_blended_and_amounts_are_shared() {
    let p = middle();
    assert_eq!(p.apply(&vec![2.0, 7.0, 4.0].into()).as_slice(), [2.0, 3.0]);
    assert_eq!(p.restrict(&vec![1.0, 8.0].into()).as_slice(), [5.0, 0.0, 4.0]);
    let row: Vec<_> = p.row(VertexId::new(1)).collect();
    assert_eq!(row, [(VertexId::new(0), 0.5), (VertexId::new(2), 0.5)], "unused slots are left out");
}

#[test]
fn rows_that_are_not_a_convex_combination_are_named() {
    let (row, good) = (VertexId::new(1), pyramid(shapes::lattice(9, 8, 0.005)));
    let refused = |spoil: &dyn Fn(&mut Prolongation)| {
        let mut bad = good.clone();
        spoil(bad.levels[LevelId::new(0)].from_coarser.as_mut().unwrap());
        let Err(PyramidError::AtLevel { source, .. }) = bad.validate() else { panic!("a bad row is kept") };
        let PyramidError::Rows { source, .. } = *source else { panic!("{source}") };
        *source
    };
    for weights in [[0.5, 0.5, 0.5], [1.5, -0.5, 0.0], [f64::NAN, 0.5, 0.5]] {
        let error = refused(&|p| p.weights[row] = weights);
        assert!(matches!(error, PyramidError::Weights { row: found, .. } if found == row), "{error}");
    }
    let count = good.levels[LevelId::new(1)].mesh.positions.len();
    let found = VertexId::new(count);
    assert_eq!(refused(&|p| p.indices[row][1] = found), PyramidError::OutOfRange { row, found, count });
}

/// On a plate that is thinner than two taxels are apart, faces between three corners of one edge came about: a map gave one
/// an s1/s2 of 3.9 million.
#[test]
fn no_level_has_a_face_with_its_corners_on_a_line() {
    let plate = |size: DVec3| {
        let corner = |k: u32| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)) * size;
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriMesh::from_arrays((0..8).map(corner).collect(), &triangles)
    };
    for (size, spacing) in
        [([0.117, 0.068, 0.0035], 0.002), ([0.06, 0.06, 0.002], 0.002), ([0.1, 0.004, 0.004], 0.0015)]
    {
        let mesh = remesh(&plate(DVec3::from_array(size)), spacing).unwrap();
        let least = |mesh: &TriMesh| {
            let sine = |[a, b, c]: [DVec3; 3]| {
                let mut sides = [a.distance(b), b.distance(c), c.distance(a)];
                sides.sort_by(f64::total_cmp);
                (b - a).cross(c - a).length() / (sides[1] * sides[2])
            };
            mesh.triangles.ids().map(|face| sine(mesh.corners(face))).fold(1.0, f64::min)
        };
        for (k, level) in pyramid(mesh).levels.iter().enumerate() {
            let found = least(&level.mesh);
            assert!(found >= 0.0099, "{size:?} m, level {k}: the sine of an angle is {found}");
        }
    }
}
