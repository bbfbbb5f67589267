//! Laws of patches that are divided into charts, where no cut within one keeps the area ratio.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use dermatome::{
    Error,
    contact::{ContactIndex, MapIndex},
    cut::{Cut, CutError, CutMesh},
    flatten::{Boundary, Energy, FlattenOptions},
    id::{FaceId, IdVec, VertexId},
    io::{read_map, write_map},
    map::{MapLevel, SkinMap},
    mesh::{Adjacency, TriMesh, shapes},
    pipeline::{BuildOptions, build, cut_open, flatten_patch},
    pyramid::LevelId,
    report::measure,
    skin::{Patch, PatchId, Skin},
};
use glam::{DVec2, DVec3};

/// Shapes and ratios that one chart does not keep.
fn divided() -> Vec<(TriMesh, f64)> {
    vec![
        (shapes::ball(10, 0.1), 1.08),
        (shapes::cross(2, 0.01), 1.15),
        (shapes::torus(36, 14, 0.1, 0.04), 1.1),
        (shapes::frame(2, 3, 0.01), 1.3),
    ]
}

fn patch(mesh: &TriMesh) -> Patch {
    Skin::from_mesh("skin", mesh.clone()).patches[PatchId::new(0)].clone()
}

fn options(wanted: f64) -> BuildOptions {
    BuildOptions { cut: Cut::AreaRatio(wanted), ..BuildOptions::default() }
}

fn map_of(mesh: &TriMesh, wanted: f64) -> SkinMap {
    build(&Skin::from_mesh("skin", mesh.clone()), &options(wanted)).unwrap()
}

fn levels(map: &SkinMap) -> impl Iterator<Item = &MapLevel> {
    map.patches.iter().flat_map(|patch| &patch.levels)
}

/// The smallest place of the chart of each place.
fn charts(corners: &IdVec<FaceId, [VertexId; 3]>, places: usize) -> IdVec<VertexId, VertexId> {
    let mut of: IdVec<VertexId, VertexId> = (0..places).map(VertexId::new).collect();
    loop {
        let before = of.clone();
        for corners in corners {
            let least = corners.map(|v| of[v]).into_iter().min().unwrap();
            corners.iter().for_each(|&v| of[v] = least);
        }
        if of == before {
            return of;
        }
    }
}

/// Slits in flat skin do not open on the map: both sides were nearer to each other than 32-bit numbers are,
/// so that three pairs of edges of the file crossed.
#[test]
fn slits_in_flat_skin_stay_apart_in_a_file() {
    let map = map_of(&shapes::frame(3, 4, 0.0025), 1.2);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.glb");
    write_map(&path, &map).unwrap();
    for (level, back) in levels(&map).zip(levels(&read_map(&path).unwrap())) {
        assert_eq!((level.distortion.flips, level.distortion.crossings), (0, 0));
        assert_eq!(back.distortion, level.distortion);
    }
}

/// The ratio is kept, nothing flips or overlaps, and every level has the same charts: disks with
/// holes that lie side by side and hold every face once.
#[test]
fn every_level_is_the_same_charts_side_by_side() {
    for (mesh, wanted) in divided() {
        let map = map_of(&mesh, wanted);
        map.validate().unwrap();
        let report = &measure(&map)[0];
        assert!(report.levels[0].distortion.area_max <= wanted, "{:?}", report.levels[0]);
        assert!(report.levels.len() > 1);
        let count = report.levels[0].charts;
        assert!(count > 1 && count < 40, "{count}");
        let finest = levels(&map).next().unwrap();
        let first = charts(finest.corners(), finest.uv.len());
        for (level, reported) in levels(&map).zip(&report.levels) {
            assert_eq!((reported.distortion.flips, reported.distortion.crossings), (0, 0), "{reported:?}");
            assert_eq!(reported.charts, count, "level {}", reported.level);
            let cut = level.cut.as_ref().unwrap();
            for (corners, whole) in cut.triangles.iter().zip(&level.level.mesh.triangles) {
                assert_eq!(corners.map(|v| cut.unsplit[v]), *whole, "every face once");
            }
            let of = charts(level.corners(), level.uv.len());
            let mut boxes = Vec::new();
            for chart in of.ids().filter(|&v| of[v] == v) {
                let faces = level.corners().iter().filter(|t| of[t[0]] == chart).copied();
                let triangles: IdVec<FaceId, [VertexId; 3]> = faces.collect();
                let mut number = IdVec::<VertexId, Option<VertexId>>::from(vec![None; of.len()]);
                let mut positions = IdVec::default();
                let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
                for &v in triangles.iter().flatten() {
                    number[v]
                        .get_or_insert_with(|| positions.push(level.level.mesh.positions[cut.unsplit[v]]));
                    (lo, hi) = (lo.min(level.uv[v]), hi.max(level.uv[v]));
                }
                let triangles = triangles.map(|t| t.map(|v| number[v].unwrap()));
                let adjacency = Adjacency::new(&TriMesh { positions, triangles }).unwrap();
                let loops = i64::try_from(adjacency.boundary_loops().len()).unwrap();
                assert_eq!(adjacency.euler_characteristic(), 2 - loops, "a disk with holes");
                assert!(loops > 0);
                boxes.push((lo, hi));
            }
            for (k, (lo, hi)) in boxes.iter().enumerate() {
                for (other_lo, other_hi) in &boxes[..k] {
                    assert!((lo.cmpgt(*other_hi) | other_lo.cmpgt(*hi)).any(), "level {}", reported.level);
                }
            }
            // A place that is a taxel's is in the chart of one of that taxel's places.
            for (place, &field) in cut.unsplit.enumerate() {
                let taxel = level.level.origins[field];
                let unsplit = finest.cut.as_ref().unwrap().unsplit.enumerate();
                assert!(unsplit.filter(|(_, v)| **v == taxel).count() > 0, "{place}");
            }
        }
        assert!(first.ids().filter(|&v| first[v] == v).count() == count);
    }
}

/// From the skin to the map and back, on every level and chart; and charts of all levels lie at the
/// same places.
#[test]
fn from_the_skin_to_the_map_and_back() {
    for (mesh, wanted) in divided() {
        let map = map_of(&mesh, wanted);
        let back = MapIndex::new(&map).unwrap();
        let (patch, size) = (PatchId::new(0), mesh.area().sqrt());
        for (k, level) in levels(&map).enumerate() {
            let id = LevelId::new(k);
            for (face, corners) in level.corners().enumerate() {
                let at = |of: [DVec3; 3]| 0.5 * of[0] + 0.3 * of[1] + 0.2 * of[2];
                let uv = at(corners.map(|v| level.uv[v].extend(0.0))).truncate();
                let mut found = Vec::new();
                back.places(patch, id, uv, &mut found).unwrap();
                assert_eq!(found.len(), 1, "one place for {uv}");
                assert!(found[0].position.distance(at(level.level.mesh.corners(face))) < 1e-9 * size);
            }
        }
        let index = ContactIndex::new(&map).unwrap();
        for face in mesh.triangles.ids() {
            let [a, b, c] = mesh.corners(face);
            let hit = index.locate(0.5 * a + 0.3 * b + 0.2 * c).unwrap();
            let cells: Vec<_> = index.cells(&hit).collect();
            for cell in &cells {
                assert!(
                    cell.uv.distance(cells[0].uv) < 0.5 * size,
                    "{face}: {} and {}",
                    cell.uv,
                    cells[0].uv
                );
                let mut found = Vec::new();
                back.places(patch, cell.level, cell.uv, &mut found).unwrap();
                assert!(found[0].off_chart < 0.05 * size, "{face} on level {}", cell.level);
            }
        }
    }
}

#[test]
fn charts_survive_their_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.glb");
    for (mesh, wanted) in divided() {
        let map = map_of(&mesh, wanted);
        write_map(&path, &map).unwrap();
        let again = read_map(&path).unwrap();
        for (before, after) in levels(&map).zip(levels(&again)) {
            assert_eq!(after.cut, before.cut);
            assert_eq!(after.level.origins, before.level.origins);
            assert!(after.uv.iter().zip(&before.uv).all(|(a, b)| a.distance(*b) < 1e-6), "rounded to f32");
            // Both sides of a slit in flat skin may meet at f32.
            assert_eq!(after.distortion.flips, 0);
        }
        let charts = |map| measure(map)[0].levels.iter().map(|level| level.charts).collect::<Vec<_>>();
        assert_eq!(charts(&again), charts(&map));
    }
}

fn cut(mesh: &TriMesh, wanted: f64) -> Result<Option<CutMesh>, Error> {
    cut_open(&patch(mesh), &Cut::AreaRatio(wanted), &FlattenOptions::default())
}

#[test]
fn threads_change_nothing() {
    let (mesh, wanted) = divided().swap_remove(1);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| build(&Skin::from_mesh("skin", mesh.clone()), &options(wanted)).unwrap())
    };
    assert_eq!(with(1), with(3));
}

/// A patch that one chart suffices for stays one.
#[test]
fn one_chart_is_kept_where_slits_suffice() {
    let mesh = shapes::cap(600, 0.05, 2.0);
    let flat = flatten_patch(&patch(&mesh), &Cut::AreaRatio(1.3), &FlattenOptions::default()).unwrap();
    assert_eq!(flat.charts, 1);
    assert!(flat.seam > 0.0);
}

/// A ratio near 1 would take more charts than are tried, and a prescribed boundary is that of one.
#[test]
fn what_charts_do_not_keep_is_refused() {
    let mesh = shapes::ball(20, 0.1);
    match cut(&mesh, 1.0001) {
        Err(Error::Cut(CutError::AreaRatio { found, charts, wanted })) => {
            assert!(found > 1.0001 && charts == 64 && wanted == 1.0001, "{found} {charts}");
        }
        other => panic!("{other:?}"),
    }
    let circle = FlattenOptions { boundary: Boundary::Circle, ..FlattenOptions::default() };
    let within = cut_open(&patch(&shapes::cap(600, 0.05, 2.0)), &Cut::AreaRatio(1.05), &circle);
    assert!(matches!(within, Err(Error::Cut(CutError::AreaRatio { charts: 1, .. }))), "{within:?}");
}

/// Acuities ask for areas that the limit forbids; within it they scale the charts.
#[test]
fn acuities_may_contradict_the_ratio() {
    let mesh = shapes::ball(8, 0.1);
    let mut patch = patch(&mesh);
    let acuity = |most: f64| Some(mesh.positions.map(|p| 1.0 + (most - 1.0) * (0.5 + 5.0 * p.z)));
    let options = FlattenOptions::from(Energy::SymmetricDirichlet);
    patch.taxels.acuities = acuity(3.0);
    let made = cut_open(&patch, &Cut::AreaRatio(1.5), &options);
    assert!(matches!(made, Err(Error::Cut(CutError::AreasAsked { asked, .. })) if asked > 1.5), "{made:?}");
}
