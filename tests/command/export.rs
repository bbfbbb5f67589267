//! `export`: what other programs get of a map, read back.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use crate::common::{dermatome, json, listing, notes, refuses};
use dermatome::io::{read_draft, read_map, read_robot, write_map, write_skin};
use dermatome::map::{PatchMap, SkinMap};
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::skin::{Link, LinkId, PatchId, Skin};
use npyz::NpyFile;
use roxmltree::Document;
use tempfile::TempDir;
use zip::ZipArchive;

/// A folder with the map of a closed surface, which is cut, under a name that no format likes.
fn ball() -> (TempDir, SkinMap) {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("1 \"<b&ll>\"\n\\", shapes::ball(8, 0.05));
    write_map(&folder.path().join("map.glb"), &build(&skin, &BuildOptions::default()).unwrap()).unwrap();
    let map = read_map(&folder.path().join("map.glb")).unwrap();
    (folder, map)
}

fn text(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

fn first(map: &SkinMap) -> &PatchMap {
    &map.patches[PatchId::new(0)]
}

/// The elements of an array of USD: what stands between its brackets, at the commas that `between` leaves.
fn usd_array<'a>(usd: &'a str, name: &str, between: &'a str) -> Vec<&'a str> {
    let (_, rest) = usd.split_once(&format!(" {name} = [")).unwrap();
    rest.split_once(']').unwrap().0.split(between).collect()
}

/// Every vertex of the uncut level is there once, in its order, on every level and in every format.
#[test]
fn a_cut_map_is_exported_uncut() {
    let (folder, map) = ball();
    let at = folder.path();
    let patch = first(&map);
    for (level, of_level) in patch.levels.enumerate() {
        let (mesh, level) = (&of_level.level.mesh, level.index());
        let (n, faces) = (mesh.positions.len(), mesh.triangles.len());
        assert!(of_level.uv.len() > n, "level {level} is cut");
        for kind in ["xml", "usda", "csv", "npz", "json"] {
            notes(at, &format!("export map.glb -o x.{kind} --level {level}"), &[&format!("wrote x.{kind}")]);
        }
        let xml = text(at, "x.xml");
        let xml = Document::parse(&xml).unwrap();
        let of = |tag: &str| xml.descendants().find(|node| node.has_tag_name(tag)).unwrap();
        let count = |name: &str| of("mesh").attribute(name).unwrap().split_whitespace().count();
        assert_eq!([count("vertex"), count("normal"), count("face")], [3 * n, 9 * n, 3 * faces]);
        assert_eq!(of("tactile").attribute("mesh"), Some(&*patch.name));

        let usd = text(at, "x.usda");
        assert_eq!(usd_array(&usd, "points", "), ").len(), n);
        let places: Vec<usize> =
            usd_array(&usd, "primvars:st:indices", ", ").iter().map(|p| p.parse().unwrap()).collect();
        assert_eq!(places.len(), 3 * faces);
        assert_eq!(places.iter().max(), Some(&(of_level.uv.len() - 1)));
        assert_eq!(usd_array(&usd, "primvars:st", "), ").len(), of_level.uv.len());
        assert!(usd.contains(r#"displayName = "1 \"<b&ll>\"\x0a\\""#), "{}", &usd[..900]);

        let mut archive = ZipArchive::new(File::open(at.join("x.npz")).unwrap()).unwrap();
        let mut bytes = Vec::new();
        archive.by_name("positions.npy").unwrap().read_to_end(&mut bytes).unwrap();
        let array = NpyFile::new(&bytes[..]).unwrap();
        assert_eq!(array.shape(), [n as u64, 3]);
        let positions: Vec<f64> = array.into_vec().unwrap();
        assert!(positions.chunks(3).zip(&mesh.positions).all(|(row, p)| row == p.to_array()));

        let probes = &json(text(at, "x.json").as_bytes())["patches"][0];
        assert_eq!(probes["probes"]["probe_local_pos"].as_array().unwrap().len(), n);
        check_canvas(&probes["canvas"], of_level.level.areas.iter().sum::<f64>() / n as f64);
    }
}

/// A probe is off exactly where its pixel is outside of the map, and on the skin elsewhere.
fn check_canvas(canvas: &serde_json::Value, mean_area: f64) {
    let [height, width] = [0, 1].map(|k| canvas["pixels"][k].as_f64().unwrap());
    let pixel = canvas["size"][0].as_f64().unwrap() / width;
    assert!((pixel / mean_area.sqrt() - 1.0).abs() < 1e-9);
    let pixels = |name: &str| canvas[name].as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap());
    let length = |vector: &serde_json::Value| {
        vector.as_array().unwrap().iter().map(|x| x.as_f64().unwrap().powi(2)).sum::<f64>().sqrt()
    };
    let normals = pixels("probe_local_normal").map(length);
    assert!(normals.map(|length| (length - 1.0).abs()).fold(0.0, f64::max) < 1e-6);
    let (mut inside, mut all) = (0.0, 0.0);
    let radii = pixels("probe_radius").map(|radius| radius.as_f64().unwrap());
    for ((probe, at), radius) in pixels("probe").zip(pixels("probe_local_pos").map(length)).zip(radii) {
        let is_inside = probe.as_i64().unwrap() >= 0;
        assert_eq!(radius > 0.0, is_inside);
        assert!(!is_inside || at > 0.02, "a ball of 50 mm: {at}");
        (inside, all) = (inside + f64::from(is_inside), all + 1.0);
    }
    assert_eq!(all, width * height);
    assert!(inside > 20.0 && inside < all, "{inside} of {width} x {height}");
}

/// A row for each taxel, with its own numbers.
#[test]
fn a_table_has_what_is_known_of_the_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/robot.glb");
    fs::copy(robot, at.join("robot.glb")).unwrap();
    dermatome(at, "build robot.glb -o out --patch *pad --patch sh*").assert().success();
    let map = read_map(&at.join("out/map.glb")).unwrap();
    dermatome(at, "export out/map.glb -o t.csv").assert().success();
    let table = text(at, "t.csv");
    let mut rows = table.lines();
    assert_eq!(rows.next(), Some("patch,link,taxel_id,x,y,z,nx,ny,nz,tx,ty,tz,u,v,area,presence"));
    assert!(map.links.len() > 1 && map.patches.len() > 1, "{} patches", map.patches.len());
    for patch in &map.patches {
        for (v, &id) in patch.taxels.ids.enumerate() {
            let cells: Vec<&str> = rows.next().unwrap().split(',').collect();
            assert_eq!(cells[..3], [&*patch.name, &*map.links[patch.link].name, &*id.to_string()]);
            let numbers: Vec<f64> = cells[3..15].iter().map(|cell| cell.parse().unwrap()).collect();
            let of_level = &patch.levels[LevelId::new(0)];
            let vectors = [
                of_level.level.mesh.positions[v],
                patch.taxels.normals[v],
                patch.taxels.tangents.as_ref().unwrap()[v],
            ];
            assert_eq!(numbers[..9], vectors.map(|vector| vector.to_array()).concat());
            assert_eq!(numbers[11], patch.taxels.areas[v]);
        }
    }
    assert_eq!(rows.next(), None);
    let of_one = first(&map);
    dermatome(at, &format!("export out/map.glb -o one.csv --patch {} --level 1", of_one.name))
        .assert()
        .success();
    assert_eq!(text(at, "one.csv").lines().count(), 1 + of_one.levels[LevelId::new(1)].level.areas.len());
}

/// The sensors that a robot gets are the taxels of the map when they are read, and all else of it is kept.
#[test]
fn a_robot_gets_sensors_and_keeps_every_byte() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let arm = text(Path::new(env!("CARGO_MANIFEST_DIR")), "meshes/arm.urdf");
    fs::write(at.join("arm.urdf"), &arm).unwrap();
    dermatome(at, "build arm.urdf -o out --links *arm --outer --spacing 12mm").assert().success();
    let map = read_map(&at.join("out/map.glb")).unwrap();
    let robots = [
        ("a", arm.clone()),
        ("b", format!("\u{feff}{}<!-- </robot> -->", arm.trim_end())),
        // A declaration after a comment, which is not XML but is read.
        ("d", format!("<!-- arm -->\n{arm}")),
    ];
    assert!(arm.starts_with("<?xml"));
    for (name, robot) in robots {
        fs::write(at.join("robot.urdf"), &robot).unwrap();
        dermatome(at, &format!("export out/map.glb -o {name}.urdf --robot robot.urdf")).assert().success();
        let written = text(at, &format!("{name}.urdf"));
        let (before, rest) = written.split_once("  <sensor").unwrap();
        let (_, after) = rest.rsplit_once("</sensor>\n").unwrap();
        assert_eq!([before, after].concat(), robot);
        let sensors = read_robot(&at.join(format!("{name}.urdf"))).unwrap().sensors;
        assert_eq!(sensors.len(), map.patches.len());
        for (sensor, patch) in sensors.iter().zip(&map.patches) {
            let (taxels, mesh) = (&patch.taxels, &patch.levels[LevelId::new(0)].level.mesh);
            assert_eq!((&sensor.name, sensor.ids.as_deref()), (&patch.name, Some(taxels.ids.as_slice())));
            assert_eq!(sensor.positions, mesh.positions.as_slice());
            let read = [sensor.normals.as_ref().unwrap(), sensor.tangents.as_ref().unwrap()];
            for (read, known) in read.into_iter().zip([&taxels.normals, taxels.tangents.as_ref().unwrap()]) {
                assert!(read.iter().zip(known).all(|(a, b)| a.abs_diff_eq(*b, 1e-6)));
            }
        }
    }
    dermatome(at, "build a.urdf -o again").assert().success();
    let again = read_map(&at.join("again/map.glb")).unwrap();
    let taxels = |map: &SkinMap| map.patches.iter().map(|patch| patch.taxels.ids.len()).sum::<usize>();
    assert_eq!(taxels(&again), taxels(&map));
    refuses(
        at,
        "export out/map.glb -o c.urdf --robot a.urdf",
        &["line", "<sensor name=", "help: correct --robot"],
    );
    let without = arm.replace("forearm", "fore_arm");
    fs::write(at.join("robot.urdf"), without).unwrap();
    refuses(at, "export out/map.glb -o c.urdf --robot robot.urdf", &["link \"forearm\"", "--patch"]);
    refuses(at, "export out/map.glb -o c.urdf --robot out/map.glb", &["out/map.glb", "help:"]);
    let wide: Vec<u8> = "\u{feff}"
        .chars()
        .chain(arm.chars())
        .collect::<String>()
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    fs::write(at.join("wide.urdf"), wide).unwrap();
    refuses(at, "export out/map.glb -o c.urdf --robot wide.urdf", &["wide.urdf", "UTF-8"]);
    refuses(at, "export out/map.glb -o robot.urdf --robot robot.urdf", &["would replace an input"]);
    refuses(at, "export out/map.glb -o c.urdf", &["--robot ROBOT.urdf"]);
    refuses(at, "export out/map.glb -o c.csv --robot a.urdf", &["--robot ROBOT.urdf"]);
    assert!(!at.join("c.urdf").exists() && !at.join("c.csv").exists());
}

/// Links of one name, and one that is called as the frame of the world of MuJoCo, are bodies with names of their own.
#[test]
fn links_get_names_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut map = SkinMap::default();
    for (name, link) in [("a", "world"), ("b", "tip"), ("c", "tip"), ("d", "tip_2")] {
        let one = SkinMap::flat(shapes::lattice(4, 3, 0.004), 1e-3);
        let link = map.links.push(Link { name: link.into(), ..one.links[LinkId::new(0)].clone() });
        map.patches.push(PatchMap { name: name.into(), link, ..first(&one).clone() });
    }
    write_map(&at.join("map.glb"), &map).unwrap();
    dermatome(at, "export map.glb -o x.xml").assert().success();
    let xml = text(at, "x.xml");
    let bodies = xml.split("<body name=\"").skip(1).map(|rest| rest.split('"').next().unwrap());
    assert_eq!(bodies.collect::<Vec<_>>(), ["world_2", "tip", "tip_2", "tip_2_2"]);
}

/// What cannot be exported is refused before anything is written.
#[test]
fn what_does_not_fit_is_refused() {
    let (folder, map) = ball();
    let at = folder.path();
    let write = |name: &str, map: &SkinMap| write_map(&at.join(name), map).unwrap();
    let mut odd = map.clone();
    odd.patches[PatchId::new(0)].name = "bell\u{7}".into();
    write("odd.glb", &odd);
    let tiny = Skin::from_mesh("tiny", shapes::triangle());
    write("tiny.glb", &build(&tiny, &BuildOptions::default()).unwrap());
    write_skin(&at.join("skin.glb"), &Skin::from_mesh("skin", shapes::ball(4, 0.05))).unwrap();
    let before = listing(at);
    let levels = first(&map).levels.len();
    for (words, said) in [
        ("map.glb -o x.stl", &["x.stl: unknown kind of file", ".usda"][..]),
        ("map.glb -o x", &["unknown kind of file"]),
        ("map.glb -o -", &["unknown kind of file"]),
        (
            &format!("map.glb -o x.csv --level {levels}"),
            &["levels 0 to", &format!("level {levels}"), "--level"],
        ),
        ("map.glb -o x.csv --level -1", &["--level"]),
        ("map.glb -o x.csv --patch palm", &["no patch of a name in --patch"]),
        ("map.glb -o map.glb", &["would replace an input"]),
        ("map.glb -o no/x.csv", &["there is no folder no"]),
        ("skin.glb -o x.csv", &["needed: a map"]),
        ("odd.glb -o x.xml", &["bell", "control character"]),
        ("tiny.glb -o x.xml", &["3 vertices", "at least 4"]),
    ] {
        refuses(at, &format!("export {words}"), said);
    }
    assert_eq!(listing(at), before);
    for kind in ["csv", "usda", "json"] {
        dermatome(at, &format!("export odd.glb -o odd.{kind}")).assert().success();
        dermatome(at, &format!("export tiny.glb -o tiny.{kind}")).assert().success();
    }
}

/// The taxels that `export` writes are a skin again, with their ids, by either table.
#[test]
fn exported_taxels_are_read_again() {
    let (folder, map) = ball();
    let patch = first(&map);
    for name in ["t.csv", "t.npz"] {
        notes(folder.path(), &format!("export map.glb -o {name}"), &[&format!("wrote {name}")]);
        let draft = read_draft(&folder.path().join(name)).unwrap();
        let [sheet] = &*draft.sheets else { panic!("{name}: {} sheets", draft.sheets.len()) };
        assert_eq!(sheet.ids.as_deref(), Some(patch.taxels.ids.as_slice()), "{name}");
        assert_eq!(sheet.presence.as_deref(), Some(patch.taxels.presence.as_slice()), "{name}");
        assert_eq!(sheet.positions, patch.levels[LevelId::new(0)].level.mesh.positions.as_slice(), "{name}");
    }
}
