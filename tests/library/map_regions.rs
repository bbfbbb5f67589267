//! Named regions: where they come from, that files keep them, and which are refused.

use std::fs;

use dermatome::id::VertexId;
use dermatome::io::{
    ReadParts, draft_from_bytes, map_from_bytes, map_to_bytes, read_draft, read_map, read_regions,
    skin_to_bytes, write_map, write_skin,
};
use dermatome::map::{FieldRegions, MapError, SkinMap};
use dermatome::mesh::shapes;
use dermatome::pyramid::LevelId;
use dermatome::signal::{Channel, GroupPool, Quantity};
use dermatome::skin::{AssembleOptions, PatchId, TaxelId, assemble};
use glam::DVec2;

/// 30 x 20 taxels, 4 mm apart, from the origin on.
fn sheet() -> SkinMap {
    SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3)
}

fn corners(all: &[[f64; 2]]) -> Vec<DVec2> {
    all.iter().map(|&at| DVec2::from_array(at)).collect()
}

fn names(map: &SkinMap) -> Vec<String> {
    map.regions().names.iter().map(ToString::to_string).collect()
}

fn count(map: &SkinMap, name: &str) -> usize {
    map.patches
        .iter()
        .flat_map(|p| p.taxels.regions.iter().flatten())
        .filter(|r| r.as_deref() == Some(name))
        .count()
}

/// Taxels in the polygon, and no others, are in the region; what it does not name keeps its region.
#[test]
fn a_polygon_names_the_taxels_inside() {
    let mut map = sheet();
    map.set_region_in(
        "skin",
        "left",
        &corners(&[[-1e-3, -1e-3], [0.041, -1e-3], [0.041, 0.07], [-1e-3, 0.07]]),
    )
    .unwrap();
    let positions = &map.patches[PatchId::new(0)].levels[LevelId::new(0)].level.mesh.positions;
    let expected = positions.iter().filter(|p| p.x < 0.041 && p.y < 0.07).count();
    assert_eq!(count(&map, "left"), expected);
    // A ring by the even-odd rule: a square with a square hole, joined by a slit.
    let ring = [
        [0.051, 0.011],
        [0.091, 0.011],
        [0.091, 0.051],
        [0.051, 0.051],
        [0.051, 0.011],
        [0.061, 0.021],
        [0.061, 0.041],
        [0.081, 0.041],
        [0.081, 0.021],
        [0.061, 0.021],
    ];
    map.set_region_in("skin", "ring", &corners(&ring)).unwrap();
    let in_box =
        |lo: f64, hi: f64, y: [f64; 2], p: &glam::DVec3| p.x > lo && p.x < hi && p.y > y[0] && p.y < y[1];
    let positions = &map.patches[PatchId::new(0)].levels[LevelId::new(0)].level.mesh.positions;
    let expected = positions
        .iter()
        .filter(|p| in_box(0.051, 0.091, [0.011, 0.051], p) && !in_box(0.061, 0.081, [0.021, 0.041], p))
        .count();
    assert_eq!(count(&map, "ring"), expected);
    assert_eq!(names(&map), ["left", "ring"], "in the order of their first taxels");
}

#[test]
fn polygons_that_cross_or_leave_or_miss_are_refused() {
    let square = [[0.0, 0.0], [0.02, 0.0], [0.02, 0.02], [0.0, 0.02]];
    let bow = [square[0], square[2], square[1], square[3]];
    let mut map = sheet();
    let mut set = |patch: &str, name: &str, all: &[[f64; 2]]| {
        map.set_region_in(patch, name, &corners(all)).unwrap_err()
    };
    assert!(matches!(set("skin", "a", &bow), MapError::Crosses { first: 0, second: 2, .. }));
    assert!(matches!(set("skin", "a", &square[..2]), MapError::Corners { found: 2, .. }));
    assert!(matches!(
        set("skin", "a", &[[0.0, 0.0], [0.3, 0.0], [0.0, 0.02]]),
        MapError::OutsideMap { corner: 1, .. }
    ));
    assert!(matches!(
        set("skin", "a", &[[0.0, 0.0], [f64::NAN, 0.0], [0.0, 0.02]]),
        MapError::OutsideMap { corner: 1, .. }
    ));
    assert!(matches!(
        set("skin", "a", &[[1e-3, 1e-3], [2e-3, 1e-3], [1e-3, 2e-3]]),
        MapError::NoTaxelInRegion { .. }
    ));
    assert!(matches!(set("palm", "a", &square), MapError::NoPatchOfRegion { .. }));
    assert!(matches!(set("skin", "", &square), MapError::RegionName { .. }));
    assert_eq!(map, sheet(), "what is refused changes nothing");
}

/// Maps and skins, binary, text and tables, have the regions that they were written with.
#[test]
fn files_keep_regions() {
    let mut map = sheet();
    map.set_region_in(
        "skin",
        "outer side",
        &corners(&[[-1e-3, -1e-3], [0.041, -1e-3], [0.041, 0.07], [-1e-3, 0.07]]),
    )
    .unwrap();
    map.set_regions([(PatchId::new(0), VertexId::new(0))], "corner, \"lower\"").unwrap();
    let of = |map: &SkinMap| map.patches[PatchId::new(0)].taxels.regions.clone();
    assert_eq!(of(&map_from_bytes(map_to_bytes(&map).unwrap()).unwrap()), of(&map));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.glb");
    write_map(&path, &map).unwrap();
    let as_skin = assemble(&read_draft(&path).unwrap(), &AssembleOptions::default()).unwrap().skin;
    assert_eq!(as_skin.patches[PatchId::new(0)].taxels.regions, of(&map), "a map is a skin, too");
    assert_eq!(of(&read_map(&path).unwrap()), of(&map));
    for name in ["skin.glb", "skin.gltf", "skin.csv"] {
        let path = folder.path().join(name);
        write_skin(&path, &map.skin()).unwrap();
        let skin = assemble(&read_draft(&path).unwrap(), &AssembleOptions::default()).unwrap().skin;
        assert_eq!(skin.patches[PatchId::new(0)].taxels.regions, of(&map), "{name}");
        let without_map = read_map(&path);
        assert!(
            name == "skin.csv" || matches!(without_map, Err(dermatome::io::IoError::NoMap { .. })),
            "{name}"
        );
    }
    let plain = sheet();
    assert!(of(&map_from_bytes(map_to_bytes(&plain).unwrap()).unwrap()).is_none(), "none are made up");
}

/// A number without a name in the list is refused, with its row.
#[test]
fn numbers_without_a_name_are_refused() {
    let mut map = sheet();
    map.set_regions([(PatchId::new(0), VertexId::new(7))], "thumb").unwrap();
    let bytes = skin_to_bytes("skin.gltf".as_ref(), &map.skin()).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    assert!(text.contains("\"regions\":[\"thumb\"]"), "{}", &text[..300]);
    let without = text.replace("\"regions\":[\"thumb\"]", "\"regions\":[]");
    let read = draft_from_bytes("skin.gltf".as_ref(), without.into_bytes(), ReadParts::default());
    let error = read.map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("_REGION 1 in row 7") && error.contains("0 to 0"), "{error}");
}

#[test]
fn tables_and_polygons_are_read_and_bad_ones_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut map = sheet();
    let mut read = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        read_regions(&path, &mut map).map_err(|e| e.to_string())
    };
    assert_eq!(read("a.csv", "taxel_id,region,note\n1,thumb,x\n2,thumb,\n").unwrap(), ["note"]);
    read("a.json", r#"[{"patch": "skin", "region": "right", "uv": [[0.05, -0.001], [0.12, -0.001], [0.12, 0.07], [0.05, 0.07]]}]"#).unwrap();
    for (name, text, said) in [
        ("b.csv", "taxel_id,region\n9999,thumb\n", "line 2, column `taxel_id`: found \"9999\""),
        ("b.csv", "taxel_id,region\n1,thumb\n1,palm\n", "line 3"),
        ("b.csv", "taxel_id,region\n1,\n", "the name of a region"),
        ("b.csv", "taxel_id,region\n", "no row"),
        ("b.csv", "taxel_id\n1\n", "a column `region`"),
        ("b.json", "[]", "no polygon"),
        ("b.json", r#"[{"patch": "skin", "region": "x", "uv": [[0, 0]], "colour": 1}]"#, "colour"),
        (
            "b.json",
            r#"[{"patch": "skin", "region": "x", "uv": [[0, 0], [1, 0], [0, 1]]}]"#,
            "polygon 0: found region \"x\": corner 1",
        ),
        ("b.json", r#"[{"patch": "skin", "region": "", "uv": []}]"#, "the name of a region"),
        ("b.txt", "", ".csv, .json"),
    ] {
        let error = read(name, text).unwrap_err();
        assert!(error.contains(said), "{text}: {error}");
    }
    assert_eq!(names(&map)[0], "thumb");
    assert_eq!(count(&map, "thumb"), 2);
}

/// Links with a name are regions; a later name wins.
#[test]
fn links_are_regions() {
    let mut map = sheet();
    map.set_regions_by_link().unwrap();
    assert_eq!((names(&map), count(&map, "base")), (vec!["base".to_owned()], 600));
    map.set_regions([(PatchId::new(0), VertexId::new(5))], "tip").unwrap();
    assert_eq!((count(&map, "base"), count(&map, "tip")), (599, 1));
}

/// A field has the region of most of its weight; pooled amounts are sums, pooled averages are weighted by area.
#[test]
fn fields_and_pools_follow_the_taxels() {
    let skin = dermatome::skin::Skin::from_mesh("cap", shapes::cap(500, 0.1, 1.0));
    let mut map = dermatome::build(&skin, &dermatome::BuildOptions::default()).unwrap();
    let id = PatchId::new(0);
    let positions = map.patches[id].levels[LevelId::new(0)].level.mesh.positions.clone();
    let left: Vec<_> = positions.enumerate().filter(|(_, p)| p.x < 0.0).map(|(v, _)| (id, v)).collect();
    map.set_regions(left.clone(), "left").unwrap();
    let fields = FieldRegions::new(&map);
    let patch = &map.patches[id];
    for level in patch.levels.ids() {
        let mesh = &patch.levels[level].level.mesh;
        for (v, p) in mesh.positions.enumerate().filter(|(_, p)| p.x.abs() > 0.04) {
            assert_eq!(fields.name(id, level, v).is_some(), p.x < 0.0, "level {level}, field {v}");
        }
    }
    let pool = GroupPool::of_regions(&map, &Channel::default());
    let ones = vec![1.0; positions.len()];
    assert_eq!(pool.pool(&ones, Quantity::Extensive), [left.len() as f64]);
    let mut some = vec![f64::NAN; positions.len()];
    (some[left[0].1.index()], some[left[1].1.index()]) = (1.0, 4.0);
    let [a, b] = [left[0], left[1]].map(|(_, v)| patch.taxels.areas[v]);
    assert!((pool.pool(&some, Quantity::Intensive)[0] - (a + 4.0 * b) / (a + b)).abs() < 1e-12);
    assert!(pool.pool(&vec![f64::NAN; positions.len()], Quantity::Extensive)[0].is_nan(), "nothing is known");
    assert_eq!(map.patches[id].taxels.ids[VertexId::new(0)], TaxelId(1));
}
