//! Laws of the atlas: who owns a pixel, and what it shows.

use std::sync::Arc;

use crate::maps::{self, flat_patch, images::WholeImage, level_id, mapped_level, patch};
use dermatome::atlas::{Atlas, AtlasError, AtlasOptions, AtlasPart, Chart, Pack, Resolution, skin_images};
use dermatome::cut::PlaceId;
use dermatome::id::{FaceId, IdVec, VertexId};
use dermatome::map::{ImageFrame, MapLevel, PatchMap, SkinMap};
use dermatome::mesh::{SurfacePoint, TriMesh, shapes};
use dermatome::skin::{Link, LinkId, TaxelId};
use glam::{DAffine3, DVec2, DVec3};
use proptest::prelude::*;

/// The chart of level 0, with the map that it is of.
struct Drawn {
    map: SkinMap,
    chart: Chart,
}

fn chart(patch: &PatchMap) -> Drawn {
    level_chart(patch, 0)
}

fn level_chart(patch: &PatchMap, k: usize) -> Drawn {
    let map = maps::skin(vec![patch.clone()]);
    let chart = maps::charts(&map).swap_remove(k);
    Drawn { map, chart }
}

impl Drawn {
    fn point(&self, column: u32, row: u32) -> Option<SurfacePoint> {
        self.chart.point(&self.map, column, row)
    }
}

impl std::ops::Deref for Drawn {
    type Target = Chart;
    fn deref(&self) -> &Chart {
        &self.chart
    }
}

fn inside_of(patch: &PatchMap, face: FaceId, p: DVec2) -> [f64; 3] {
    let finest = &patch.levels[level_id(0)];
    maps::barycentric(&finest.level.mesh, &finest.opened_uv(), face, p)
}

/// The face that a pixel shows.
fn face(chart: &Drawn, column: u32, row: u32) -> Option<FaceId> {
    chart.point(column, row).map(|at| at.face)
}

/// Columns and rows of every pixel.
fn pixels(chart: &Chart) -> impl Iterator<Item = (u32, u32)> + use<> {
    let [width, height] = chart.frame.size_px;
    (0..height).flat_map(move |row| (0..width).map(move |column| (column, row)))
}

#[test]
fn a_covered_pixel_has_its_centre_in_its_face() {
    let cap = flat_patch("cap", shapes::cap(2000, 0.1, 1.0), 0.0007);
    let chart = chart(&cap);
    for (column, row) in pixels(&chart) {
        let Some(at) = chart.point(column, row) else { continue };
        let centre = chart.centre(column, row);
        let inside = inside_of(&cap, at.face, centre);
        // Snapping moves an edge by up to 2^-17 pixels, of triangles about six pixels high.
        assert!(inside.iter().all(|&w| w > -1e-5), "pixel {column}, {row} of face {:?}: {inside:?}", at.face);
        let MapLevel { level, uv, .. } = &cap.levels[level_id(0)];
        let [a, b, c] = level.mesh.triangles[at.face].map(|v| uv[PlaceId::of_opened(v)]);
        let back = a * at.barycentric[0] + b * at.barycentric[1] + c * at.barycentric[2];
        assert!(back.distance(centre) < 1e-5 * 0.0007, "the weights lead back to the centre");
        assert_eq!(chart.frame.pixel(centre), [column, row], "frame and chart agree on the pixel");
    }
}

#[test]
fn an_uncovered_pixel_has_its_centre_in_no_face() {
    let saddle = flat_patch("saddle", shapes::saddle(12), 0.004);
    let chart = chart(&saddle);
    for (column, row) in pixels(&chart).filter(|&(x, y)| face(&chart, x, y).is_none()) {
        let centre = chart.centre(column, row);
        for face in saddle.levels[level_id(0)].level.mesh.triangles.ids() {
            let inside = inside_of(&saddle, face, centre);
            assert!(inside.iter().any(|&w| w < 1e-5), "face {face} holds the centre of {column}, {row}");
        }
    }
}

#[test]
fn covered_pixels_have_the_area_of_the_chart() {
    let pixel = 0.0004;
    let cap = flat_patch("cap", shapes::cap(500, 0.1, 0.8), pixel);
    let chart = chart(&cap);
    let disk = std::f64::consts::PI * (0.1 * 0.8_f64.sin()).powi(2);
    let covered = chart.covered() as f64 * pixel * pixel;
    assert!((covered / disk - 1.0).abs() < 0.01, "{covered} m^2 covered of {disk} m^2");
    assert_eq!(chart.overlaps(), 0, "a cap seen from above does not overlap itself");
}

/// A fan around a pixel centre, its rim on pixel centres too: every tie there is.
#[test]
fn edges_through_pixel_centres_are_owned_once() {
    let mut mesh = shapes::square();
    let rim = [(0, 0), (4, 0), (8, 0), (8, 4), (8, 8), (4, 8), (0, 8), (0, 4), (4, 4)];
    mesh.positions = rim.iter().map(|&(x, y)| DVec3::new(f64::from(x), f64::from(y), 0.0)).collect();
    let fan: Vec<[u32; 3]> = (0..8).map(|k| [8, k, (k + 1) % 8]).collect();
    mesh.triangles = fan.iter().map(|t| t.map(VertexId::from)).collect();
    let mut map = flat_patch("fan", mesh, 1.0);
    map.levels[level_id(0)].frame =
        ImageFrame { origin: DVec2::splat(-1.5), size: DVec2::splat(12.0), size_px: [12; 2] };
    let chart = chart(&map);
    assert_eq!(chart.overlaps(), 0, "no centre in two faces");
    assert_eq!(chart.covered(), 64, "8 x 8: two sides of the square belong to it, two do not");
    for (column, row) in pixels(&chart) {
        // A hair to the right and down of the centre: the left and the upper side belong to the
        // square.
        let inside = (1..9).contains(&column) && (2..10).contains(&row);
        assert_eq!(face(&chart, column, row).is_some(), inside, "pixel {column}, {row}");
    }
}

#[test]
fn a_linear_field_is_drawn_linear() {
    let field = |p: DVec2| 3.0 * p.x - 2.0 * p.y + 0.5;
    let mut mesh = shapes::cap(300, 0.1, 1.2);
    mesh.positions.iter_mut().for_each(|p| p.z = field(p.truncate()));
    let cap = flat_patch("cap", mesh, 0.001);
    let (chart, image) = (chart(&cap), maps::image(&cap, 0));
    for ((column, row), &value) in pixels(&chart).zip(image.floats("position.Z")) {
        let expected = face(&chart, column, row).map_or(0.0, |_| field(chart.centre(column, row)));
        assert!((f64::from(value) - expected).abs() < 1e-6, "pixel {column}, {row}: {value}, not {expected}");
    }
}

#[test]
fn the_first_row_is_the_top() {
    let map = flat_patch("lattice", shapes::lattice(8, 8, 0.01), 0.001);
    let chart = chart(&map);
    assert!(chart.centre(0, 0).y > chart.centre(0, 1).y, "rows run down the map");
    assert!(chart.centre(1, 0).x > chart.centre(0, 0).x, "columns run to the right");
    assert_eq!(face(&chart, 0, 0), None, "a pixel of margin");
    assert_eq!(face(&chart, u32::MAX, 0), None, "there is nothing outside");
}

#[test]
fn where_faces_overlap_the_smaller_id_wins() {
    let mesh = TriMesh::from_arrays(
        [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [0.0, 0.0], [4.0, 0.0], [0.0, 4.0]]
            .map(|[x, y]| DVec3::new(x, y, 0.0))
            .to_vec(),
        &[[0, 1, 2], [3, 5, 4]],
    );
    let map = flat_patch("twice", mesh, 1.0);
    let chart = chart(&map);
    assert!(pixels(&chart).all(|(x, y)| face(&chart, x, y).is_none_or(|f| f == FaceId::new(0))));
    assert_eq!(chart.overlaps(), chart.covered(), "every pixel is wanted once more, by the mirrored face");
    assert!(chart.covered() > 0);
}

/// A folded sliver between two faces must not tear a hole.
#[test]
fn thin_triangles_leave_no_holes() {
    let step = 1e-7;
    let columns = 40;
    let mesh = shapes::sheet(columns, 4, |i, j| {
        let x = if i < columns / 2 { f64::from(i) * step } else { 1.0 - f64::from(columns - 1 - i) * step };
        DVec3::new(x, f64::from(j) / 3.0, 0.0)
    });
    let map = flat_patch("slivers", mesh, 0.01);
    let chart = chart(&map);
    assert_eq!(chart.overlaps(), 0);
    let inside = |(x, y): &(u32, u32)| {
        let c = chart.centre(*x, *y);
        c.cmpgt(DVec2::splat(1e-6)).all() && c.cmplt(DVec2::splat(1.0 - 1e-6)).all()
    };
    assert!(
        pixels(&chart).filter(inside).all(|(x, y)| face(&chart, x, y).is_some()),
        "the unit square is covered"
    );
}

#[test]
fn ids_are_those_of_the_largest_weight() {
    let mut map = maps::square_pyramid("palm", &[9, 5], 0.08, 0.001);
    map.taxels.ids[VertexId::new(0)] = TaxelId(u32::MAX - 1);
    for k in 0..2 {
        let image = maps::image(&map, k);
        let chart = level_chart(&map, k);
        let mut seen = 0;
        for (i, (column, row)) in pixels(&chart).enumerate() {
            let Some(at) = chart.point(column, row) else {
                assert_eq!(image.ids("taxel.id")[i], u32::MAX, "no id where nothing is");
                assert_eq!(image.ids("face.id")[i], u32::MAX, "no face where nothing is");
                assert_eq!(image.floats("A")[i].to_bits(), 0, "no coverage where nothing is");
                continue;
            };
            seen += 1;
            let mesh = &map.levels[level_id(k)].level.mesh;
            let corners = mesh.triangles[at.face];
            let p: DVec3 = (0..3).map(|c| at.barycentric[c] * mesh.positions[corners[c]]).sum();
            let distance = |v: VertexId| p.distance(mesh.positions[v]);
            let nearest = mesh.positions.ids().map(distance).fold(f64::INFINITY, f64::min);
            let near = mesh.positions.ids().filter(|&v| distance(v) <= nearest + 1e-9);
            let mut expected = near.map(|v| if k == 0 { map.taxels.ids[v].0 } else { v.raw() });
            let id = image.ids("taxel.id")[i];
            assert!(expected.any(|near| near == id), "level {k}, pixel {column}, {row}");
            assert_eq!(image.ids("face.id")[i], at.face.raw());
            assert_eq!(image.floats("A")[i].to_bits(), 1.0_f32.to_bits());
        }
        assert_eq!(seen, chart.covered());
    }
}

#[test]
fn positions_normals_and_weights_are_those_of_the_point() {
    let mut mesh = shapes::cap(800, 0.1, 1.0);
    // Upwards, as a map along z shows it.
    mesh.positions.iter_mut().for_each(|p| *p = DVec3::new(p.x, -p.y, -p.z));
    let uv = mesh.positions.map(|p| 1.1 * p.truncate());
    let map = patch("cap", vec![mapped_level(mesh, uv, 0.001)]);
    let (chart, image) = (chart(&map), maps::image(&map, 0));
    let vector = |base: &str, i| {
        DVec3::from_array(["X", "Y", "Z"].map(|c| f64::from(image.floats(&format!("{base}.{c}"))[i])))
    };
    for (i, (column, row)) in pixels(&chart).enumerate() {
        let Some(at) = chart.point(column, row) else { continue };
        let p = map.levels[level_id(0)].level.mesh.point(&at);
        assert!(vector("position", i).distance(p) < 1e-7, "position of pixel {column}, {row}");
        let n = vector("normal", i);
        assert!((n.length() - 1.0).abs() < 1e-6, "unit normal");
        assert!(n.dot(p.normalize()) > 0.99, "the normal of a sphere");
        let [_, u, v] = at.barycentric;
        assert!((f64::from(image.floats("bary.U")[i]) - u).abs() < 1e-7);
        assert!((f64::from(image.floats("bary.V")[i]) - v).abs() < 1e-7);
    }
}

#[test]
fn an_image_that_is_too_large_is_refused_with_a_pixel_size_that_fits() {
    for (side, pixel) in [(2.0, 1e-4), (1e9, 1e-3), (1.0, 5e-5)] {
        let mut mesh = shapes::square();
        mesh.positions = mesh.positions.map(|&p| side * p);
        let map = maps::skin(vec![flat_patch("palm", mesh.clone(), pixel)]);
        let error = Atlas::new(&map, &AtlasOptions::default()).unwrap_err();
        let AtlasError::TooLarge { image, fits_mm, .. } = error else { panic!("{error}") };
        assert_eq!(image, "palm/L0");
        // A chart of the largest size takes a gigabyte: only its size is tried.
        let frame = flat_patch("", mesh, fits_mm * 1e-3).levels[level_id(0)].frame;
        assert!(frame.size_px.iter().all(|&n| n <= 16_384), "{fits_mm} mm fits a side of {side} m");
    }
}

#[test]
fn broken_maps_are_refused_by_name() {
    let map = flat_patch("palm", shapes::square(), 0.1);
    let broken = |change: &dyn Fn(&mut PatchMap)| {
        let mut map = map.clone();
        change(&mut map);
        let map = Arc::new(maps::skin(vec![map]));
        let error = skin_images(&map).unwrap_err();
        assert_eq!(Atlas::new(&map, &AtlasOptions::default()).unwrap_err(), error);
        error
    };
    let zero = level_id(0);
    for at in [DVec2::new(1e11, 0.0), DVec2::new(0.0, -1e3)] {
        let error = broken(&|m| m.levels[zero].uv[PlaceId::new(2)] = at);
        let AtlasError::OutsideFrame { place, .. } = error else { panic!("{error}") };
        assert_eq!(place, PlaceId::new(2), "at {at}");
    }
    let error = broken(&|m| m.taxels.ids = IdVec::default());
    assert!(matches!(error, AtlasError::Map(_)), "data that is not a map: {error}");
}

#[test]
fn degenerate_faces_are_harmless() {
    let line = TriMesh::from_arrays(vec![DVec3::ZERO, DVec3::X, 2.0 * DVec3::X], &[[0, 1, 2]]);
    let map = flat_patch("line", line, 0.1);
    let image = maps::image(&map, 0);
    assert!(image.floats("A").iter().all(|&a| a == 0.0), "a line covers no pixel");
    // No area on the skin, some on the map.
    let mut map = flat_patch("point", shapes::triangle(), 0.1);
    map.levels[level_id(0)].level.mesh.positions = vec![DVec3::ZERO; 3].into();
    let image = maps::image(&map, 0);
    assert!(image.floats("A").contains(&1.0));
    for name in ["Y", "position.X", "normal.X", "bary.U", "stretch.angle", "stretch.area"] {
        assert!(image.floats(name).iter().all(|x| !x.is_nan()), "{name} is a number");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Moving a map by whole pixels moves its image: nothing depends on where the origin is.
    #[test]
    fn a_map_moved_by_whole_pixels_moves_its_image(dx in 0_i32..50, dy in 0_i32..50, corners in prop::collection::vec((0.0..20.0, 0.0..20.0), 3..12)) {
        let frame = |x: i32, y: i32| ImageFrame {
            origin: DVec2::new(f64::from(x), f64::from(y)),
            size: DVec2::splat(80.0),
            size_px: [80; 2],
        };
        // Snapped to the rasteriser's grid, so that the shift is exact.
        let snap = |x: f64| (x * 65536.0).round() / 65536.0;
        let positions: Vec<_> = corners.iter().map(|&(x, y)| DVec3::new(snap(x), snap(y), 0.0)).collect();
        let triangles: Vec<[u32; 3]> = (2_u32..).take(positions.len() - 2).map(|k| [k - 2, k - 1, k]).collect();
        let mut map = flat_patch("any", TriMesh::from_arrays(positions, &triangles), 1.0);
        map.levels[level_id(0)].frame = frame(-60, -60);
        let mut moved = map.clone();
        moved.levels[level_id(0)].frame = frame(dx - 60, dy - 60);
        let (here, there) = (chart(&map), chart(&moved));
        prop_assert_eq!((here.overlaps(), here.covered()), (there.overlaps(), there.covered()));
        for (column, row) in pixels(&here) {
            if let Some(found) = face(&here, column, row) {
                let [x, y] = [column.checked_add_signed(-dx).unwrap(), row.checked_add_signed(dy).unwrap()];
                prop_assert_eq!(face(&there, x, y), Some(found));
            }
        }
    }

    /// Triangulations of one polygon cover the same pixels, each once: shared edges are owned once.
    #[test]
    fn every_triangulation_of_a_polygon_covers_the_same_pixels(
        x in prop::array::uniform4(0.0..9.0_f64), y in prop::array::uniform4(0.0..9.0_f64),
    ) {
        // One corner per quadrant: star-shaped about (10, 10), maybe not convex.
        let corner = |k: usize| DVec3::new(
            10.0 + [1.0, -1.0, -1.0, 1.0][k] * (x[k] + 0.25).round(), 10.0 + [1.0, 1.0, -1.0, -1.0][k] * (y[k] + 0.25).round(), 0.0,
        );
        let centre = DVec3::new(10.0, 10.0, 0.0);
        let positions: Vec<_> = (0..4).map(corner).chain([centre]).collect();
        let star = TriMesh::from_arrays(positions.clone(), &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
        let area: f64 = star.area();
        prop_assume!(area > 0.5);
        let frame = ImageFrame { origin: DVec2::splat(-0.5), size: DVec2::splat(21.0), size_px: [21; 2] };
        let draw = |mesh: TriMesh| {
            let mut map = flat_patch("quad", mesh, 1.0);
            map.levels[level_id(0)].frame = frame;
            let chart = chart(&map);
            let covered: Vec<bool> = pixels(&chart).map(|(x, y)| face(&chart, x, y).is_some()).collect();
            (covered, chart.overlaps())
        };
        let (covered, overlaps) = draw(star);
        prop_assert_eq!(overlaps, 0);
        for cut in [[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]] {
            let cut = TriMesh::from_arrays(positions[..4].to_vec(), &cut);
            let turns = |t: FaceId| cut.face_cross(t).z;
            if cut.triangles.ids().all(|t| turns(t) > 0.0) {
                prop_assert_eq!(&draw(cut).0, &covered);
            }
        }
    }
}

/// A torso with two arms of two links each; every patch has two levels.
fn body() -> SkinMap {
    let square = |name: &str, side: f64| maps::square_pyramid(name, &[9, 5], side, 0.001);
    let mut map = maps::skin(vec![
        square("torso", 0.08),
        square("left hand", 0.03),
        square("left arm", 0.05),
        square("right hand", 0.03),
        square("right arm", 0.05),
    ]);
    let root = LinkId::new(0);
    let mut link = |parent, at: DVec3| {
        map.links.push(Link {
            name: "link".into(),
            parent: Some(parent),
            pose: DAffine3::from_translation(at),
        })
    };
    // Children of the torso above it, hands beside the arms: along x of the arm's frame, outwards.
    let (left, right) = (link(root, DVec3::new(-0.2, 0.3, 0.0)), link(root, DVec3::new(0.2, 0.3, 0.0)));
    let hands = [link(left, -0.2 * DVec3::X), link(right, 0.2 * DVec3::X)];
    for (patch, link) in map.patches.iter_mut().zip([root, hands[0], left, hands[1], right]) {
        patch.link = link;
    }
    map
}

fn atlas(map: &SkinMap, resolution: Resolution, pack: Option<Pack>) -> Atlas {
    Atlas::new(map, &AtlasOptions { resolution, pack }).unwrap()
}

/// Column and row of every covered pixel of an image, with the chart that it shows.
fn shown<'a>(map: &'a SkinMap, part: &'a AtlasPart) -> Vec<(u32, u32, &'a Chart)> {
    let [width, height] = part.frame.size_px;
    let of =
        |(x, y)| part.charts.iter().filter(move |c| c.point(map, x, y).is_some()).map(move |c| (x, y, c));
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(of).collect()
}

#[test]
fn a_canvas_holds_the_whole_patch_at_the_largest_scale() {
    let map = maps::skin(vec![
        flat_patch("cap", shapes::cap(300, 0.1, 1.0), 0.001),
        flat_patch("strip", shapes::lattice(20, 3, 0.005), 0.001),
    ]);
    for canvas in [[40, 64], [16, 16], [3, 3]] {
        let parts = atlas(&map, Resolution::Canvas(canvas), None).parts;
        for (part, patch) in parts.iter().zip(&map.patches) {
            assert_eq!(part.frame.size_px, [canvas[1], canvas[0]]);
            let pixel = part.frame.size / DVec2::new(f64::from(canvas[1]), f64::from(canvas[0]));
            assert!((pixel.x / pixel.y - 1.0).abs() < 1e-12, "square pixels");
            let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            for uv in &patch.levels[level_id(0)].uv {
                let px = (*uv - part.frame.origin) / pixel;
                (lo, hi) = (lo.min(px), hi.max(px));
            }
            let inside = DVec2::new(f64::from(canvas[1]), f64::from(canvas[0])) - 1.0;
            assert!(lo.cmpge(DVec2::splat(1.0 - 1e-9)).all() && hi.cmple(inside + 1e-9).all(), "{lo} {hi}");
            let filled = (hi - lo) / (inside - 1.0);
            assert!((filled.max_element() - 1.0).abs() < 1e-9, "one side is filled: {filled}");
        }
    }
}

#[test]
fn packed_charts_do_not_touch_and_show_no_pixel_twice() {
    let map = Arc::new(body());
    let margin = 1;
    let resolutions = [
        Resolution::Map,
        Resolution::Pixel(0.0017),
        Resolution::Pixel(0.0002),
        Resolution::Canvas([150, 90]),
        Resolution::Canvas([300, 500]),
    ];
    for (resolution, pack) in resolutions.into_iter().flat_map(|r| [(r, Pack::Body), (r, Pack::Tight)]) {
        let gap = if pack == Pack::Tight { 1 } else { 2 };
        let options = AtlasOptions { resolution, pack: Some(pack) };
        let atlas = Atlas::new(&map, &options).unwrap();
        assert_eq!(atlas.parts.len(), 2, "one image per level");
        assert_eq!(atlas, Atlas::new(&map, &options).unwrap(), "the same again");
        let images = WholeImage::of(&atlas.images(&map, None));
        for (part, image) in atlas.parts.iter().zip(&images) {
            let pixels = shown(&map, part);
            let mut owner = std::collections::BTreeMap::new();
            for &(x, y, chart) in &pixels {
                assert!(owner.insert((x, y), chart.patch).is_none(), "pixel {x}, {y} is shown twice");
            }
            let covered = image.floats("A").iter().filter(|c| **c == 1.0);
            assert_eq!(covered.count(), owner.len());
            assert_eq!(pixels.len(), part.charts.iter().map(|chart| chart.covered()).sum::<usize>());
            let [width, height] = part.frame.size_px;
            for (&(x, y), patch) in &owner {
                let free = |at: u32, side: u32| at >= margin && at + margin < side;
                assert!(free(x, width) && free(y, height), "pixel {x}, {y} lies in the margin");
                let around = (y.saturating_sub(gap)..=y + gap)
                    .flat_map(|row| (x.saturating_sub(gap)..=x + gap).map(move |column| (column, row)));
                let other = around.filter_map(|at| owner.get(&at)).find(|other| *other != patch);
                assert_eq!(other, None, "charts are {gap} pixels apart");
            }
        }
    }
}

/// A packed chart is the patch's own chart, turned and moved, not mirrored.
#[test]
fn packed_charts_agree_with_those_of_the_patches() {
    let map = body();
    let (packed, single) = (
        atlas(&map, Resolution::Pixel(0.001), Some(Pack::Body)),
        atlas(&map, Resolution::Pixel(0.001), None),
    );
    let mut seen = std::collections::BTreeSet::new();
    for part in &packed.parts {
        for chart in &part.charts {
            seen.insert(chart.turns);
            let alone = single.parts.iter().flat_map(|part| &part.charts);
            let alone = alone.clone().find(|c| c.patch == chart.patch && c.level == chart.level).unwrap();
            let (many, few) = (chart.covered() as f64, alone.covered() as f64);
            assert!((many / few - 1.0).abs() < 0.1, "{many} and {few} pixels of 1 mm");
            let level = &map.patches[chart.patch].levels[chart.level];
            let [left, top] = chart.corner_px;
            let step = |x, y| chart.centre(left + x, top + y) - chart.centre(left, top);
            assert!(step(1, 0).perp_dot(step(0, 1)) < 0.0, "rows run down where columns run right");
            for &(x, y, _) in shown(&map, part).iter().filter(|(_, _, c)| c.patch == chart.patch) {
                let at = chart.point(&map, x, y).unwrap();
                let [a, b, c] = level.places(at.face).map(|place| level.uv[place]);
                let back = a * at.barycentric[0] + b * at.barycentric[1] + c * at.barycentric[2];
                assert!(back.distance(chart.centre(x, y)) < 1e-7, "the pixel shows its place of the map");
            }
        }
    }
    assert_eq!(seen.into_iter().collect::<Vec<_>>(), [0, 2, 6], "torso and arms are turned as they need");
}

#[test]
fn neighbours_on_the_body_are_neighbours_in_the_image() {
    let map = body();
    for resolution in [Resolution::Map, Resolution::Canvas([200, 200])] {
        let part = &atlas(&map, resolution, Some(Pack::Body)).parts[0];
        let corner = |name: &str| {
            let chart = part.charts.iter().find(|c| map.patches[c.patch].name == name).unwrap();
            chart.corner_px
        };
        let above = |a: &str, b: &str| assert!(corner(a)[1] < corner(b)[1], "{a} lies above {b}");
        above("left arm", "torso");
        above("right arm", "torso");
        above("left hand", "left arm");
        above("right hand", "right arm");
        // The arm of the left hand has its hand against x: there the map, seen as it is drawn, is up.
        let arm = part.charts.iter().find(|c| map.patches[c.patch].name == "left arm").unwrap();
        let [left, top] = arm.corner_px;
        let up = arm.centre(left, top) - arm.centre(left, top + 1);
        assert!(up.x < 0.0 && up.y.abs() < 1e-12, "{up} is up");
    }
}

/// Triangles fill more than half of an image, the most that their rectangles can.
#[test]
fn charts_lie_in_the_gaps_of_others() {
    let corners =
        [DVec3::ZERO, DVec3::new(0.1, 0.0, 0.0), DVec3::new(0.1, 0.1, 0.0), DVec3::new(0.0, 0.1, 0.0)];
    let triangle = |k: usize| {
        let positions = [0, 1, 2].map(|j| corners[(k + j) % 4]).to_vec();
        flat_patch(&format!("{k}"), TriMesh::from_arrays(positions, &[[0, 1, 2]]), 0.001)
    };
    let map = maps::skin((0..24).map(triangle).collect());
    for (pack, least) in [(Pack::Body, 0.6), (Pack::Tight, 0.65)] {
        for resolution in [Resolution::Map, Resolution::Canvas([300, 300])] {
            let fill = atlas(&map, resolution, Some(pack)).parts[0].fill();
            assert!(fill > least, "{fill} of the image with {pack:?}");
        }
    }
}

#[test]
fn a_pixel_has_a_taxel_where_it_is_covered() {
    let map = Arc::new(body());
    let atlas = atlas(&map, Resolution::Pixel(0.002), Some(Pack::Body));
    let image = &WholeImage::of(&atlas.images(&map, None))[0];
    for (covered, id) in image.floats("A").iter().zip(image.ids("taxel.id")) {
        assert_eq!(*covered == 1.0, *id != u32::MAX, "a pixel has a taxel if it is covered");
    }
}

#[test]
fn invalid_pixels_and_canvases_are_refused() {
    let map = body();
    let refused = |resolution| {
        let options = AtlasOptions { resolution, pack: Some(Pack::Body) };
        let packed = Atlas::new(&map, &options).unwrap_err();
        let single = Atlas::new(&map, &AtlasOptions { pack: None, ..options }).unwrap_err();
        (packed, single)
    };
    for pixel in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(refused(Resolution::Pixel(pixel)).0, AtlasError::PixelSize { .. }));
    }
    let none = AtlasOptions { resolution: Resolution::Pixel(1.0), pack: None };
    assert_eq!(Atlas::new(&SkinMap::default(), &none).unwrap().parts, [], "no patch, no image");
    // Millimetres taken for metres.
    assert!(matches!(refused(Resolution::Pixel(1.0)).0, AtlasError::PixelBeyondPatches { found: 1.0, .. }));
    for canvas in [[0, 0], [2, 2], [100_000, 10], [u32::MAX; 2]] {
        let (packed, single) = refused(Resolution::Canvas(canvas));
        assert!(matches!(packed, AtlasError::Canvas { .. }), "{packed}");
        assert!(matches!(single, AtlasError::Canvas { .. }), "{single}");
    }
    let (packed, single) = refused(Resolution::Pixel(1e-7));
    assert!(matches!(packed, AtlasError::TooLarge { .. }), "{packed}");
    assert!(matches!(single, AtlasError::TooLarge { .. }), "{single}");
    assert_eq!(
        atlas(&SkinMap::default(), Resolution::Canvas([8, 8]), Some(Pack::Body)).parts,
        [],
        "no patch, no image"
    );
}
