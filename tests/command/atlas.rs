//! One image for two skins, as a user of the command meets it.

use std::fs;
use std::path::Path;

use crate::common::{dermatome, json, refuses};
use dermatome::io::{read_map, write_skin};
use dermatome::mesh::shapes;
use dermatome::pyramid::LevelId;
use dermatome::skin::{Patch, PatchId, Skin};
use predicates::str::contains;

/// A sheet of 15 x 9 taxels, `other.glb`, with its map; a wider one, `skin.glb`, in two patches, with a table of places that
/// both have; and a touch of it.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_skin(&at.join("other.glb"), &Skin::from_mesh("palm", shapes::lattice(15, 9, 0.005))).unwrap();
    let mut skin = Skin::from_mesh("left", shapes::lattice(10, 11, 0.006));
    let mut right =
        Patch::from_mesh("right", skin.patches[PatchId::new(0)].link, shapes::lattice(9, 11, 0.006));
    right.mesh.positions.iter_mut().for_each(|x| x.x += 0.066);
    right.taxels.ids.iter_mut().for_each(|id| id.0 += 1000);
    skin.patches.push(right);
    write_skin(&at.join("skin.glb"), &skin).unwrap();
    // A corner or a middle of the skin, and the taxel of the other sheet at the same share of its sides.
    let row = |first: usize, columns: usize, [i, j]: [usize; 2]| {
        let along = if first == 1 { i } else { i + 11 };
        let other = (4 * j / 5) * 15 + (along * 14 + 9) / 19 + 1;
        format!("{},{other}\n", first + j * columns + i)
    };
    let mut table = "taxel_id,atlas_taxel_id\n".to_owned();
    for (first, columns) in [(1, 10), (1001, 9)] {
        for (i, j) in [(0, 0), (columns - 1, 0), (0, 10), (columns - 1, 10), (4, 5)] {
            table += &row(first, columns, [i, j]);
        }
    }
    fs::write(at.join("places.csv"), table).unwrap();
    dermatome(at, "build other.glb -o other -q").assert().success();
    dermatome(at, "build skin.glb -o skin --atlas other/map.glb --landmarks places.csv").assert().success();
    dermatome(at, "touch skin.glb -o touch.csv --presses 2 --sphere-mm 15 --rate-hz 10 --seed 3 -q")
        .assert()
        .success();
    folder
}

/// The sum of the readings of each frame.
fn sums(file: &Path) -> Vec<f64> {
    let text = fs::read_to_string(file).unwrap();
    let sum = |line: &str| {
        line.split(',').skip(1).filter_map(|x| x.parse().ok()).filter(|x: &f64| x.is_finite()).sum()
    };
    text.lines().skip(1).map(sum).collect()
}

#[test]
fn two_skins_have_one_image() {
    let folder = folder();
    let at = folder.path();
    let map = read_map(&at.join("skin/map.glb")).unwrap();
    let on = map.atlas.as_ref().unwrap();
    assert_eq!((on.name.as_str(), on.is_mirrored), ("other", false));
    assert!(map.patches.iter().all(|patch| patch.atlas.as_ref().is_some_and(|on| on.patch == "palm")));
    for map in ["skin", "other"] {
        let readings = if map == "skin" { "touch.csv" } else { "carried.csv" };
        if map == "other" {
            let run = dermatome(at, "carry skin/map.glb touch.csv --to other/map.glb -o carried.csv --json");
            let said = json(&{ run }.output().unwrap().stdout);
            assert_eq!((&said["schema"], &said["taxels"]), (&"dermatome.carry/1".into(), &209.into()));
            let share = said["left_out"].as_f64().unwrap();
            let (before, after) = (sums(&at.join("touch.csv")), sums(&at.join("carried.csv")));
            let (before, after): (f64, f64) = (before.iter().sum(), after.iter().sum());
            assert!((before * (1.0 - share) - after).abs() < 1e-9 * before, "{before} {share} {after}");
        }
        let line =
            format!("render {map}/map.glb {readings} --atlas other/map.glb -o {map}_images --level 0 -q");
        dermatome(at, &line).assert().success();
    }
    // The same names, and the same size of files without compression differences: the same canvas.
    let names = |folder: &str| {
        let mut names: Vec<_> =
            fs::read_dir(at.join(folder)).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names("skin_images"), names("other_images"));
    // A map of one patch lies on itself.
    dermatome(at, "carry other/map.glb carried.csv --to other/map.glb -o again.csv -q").assert().success();
    let (once, again) = (sums(&at.join("carried.csv")), sums(&at.join("again.csv")));
    assert!(once.iter().zip(&again).all(|(a, b)| (a - b).abs() < 1e-9));
    // Landmarks may be regions; a patch without enough of them is left out by name.
    let finest = |map: &str| {
        read_map(&at.join(map).join("map.glb")).unwrap().patches[PatchId::new(0)].levels[LevelId::new(0)]
            .clone()
    };
    let few: String = fs::read_to_string(at.join("places.csv"))
        .unwrap()
        .lines()
        .take(8)
        .fold(String::new(), |a, b| a + b + "\n");
    fs::write(at.join("few.csv"), few).unwrap();
    let run =
        dermatome(at, "build skin.glb -o few --atlas other/map.glb --landmarks few.csv").assert().success();
    let said = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    let needed = "right: left out: it has 2 landmarks, and four are needed to place it on the atlas\n";
    assert!(said.contains(needed), "{said}");
    assert_eq!(finest("few").uv, finest("skin").uv, "the other patch is as before");
}

/// Patches may share ids: then the table says in which one a taxel is. Landmarks have the names that it gives them.
#[test]
fn landmarks_of_patches_that_share_ids_name_the_patch() {
    let folder = folder();
    let at = folder.path();
    let mut skin = read_map(&at.join("skin/map.glb")).unwrap().skin();
    skin.patches[PatchId::new(1)].taxels.ids.iter_mut().for_each(|id| id.0 -= 1000);
    write_skin(&at.join("shared.glb"), &skin).unwrap();
    let build = "build shared.glb -o shared --atlas other/map.glb --landmarks";
    refuses(at, &format!("{build} places.csv"), &["line 2", "taxel_id", "1", "not of 2"]);
    let places = fs::read_to_string(at.join("places.csv")).unwrap();
    let table: Vec<String> = places
        .lines()
        .enumerate()
        .map(|(k, line)| match line.split_once(',').unwrap() {
            _ if k == 0 => format!("name,patch,atlas_patch,{line}"),
            (id, other) if id.len() > 3 => {
                format!("n{k},right,,{},{other}", &id[1..].trim_start_matches('0'))
            }
            _ => format!("n{k},left,palm,{line}"),
        })
        .collect();
    fs::write(at.join("named.csv"), table.join("\n") + "\n").unwrap();
    dermatome(at, &format!("{build} named.csv")).assert().success();
    let uv = |map: &str| {
        let map = read_map(&at.join(map).join("map.glb")).unwrap();
        map.patches.iter().map(|patch| patch.levels[LevelId::new(0)].uv.clone()).collect::<Vec<_>>()
    };
    assert!(uv("shared") == uv("skin"), "the same landmarks");
    let wrong = table.join("\n").replace("n3,left", "n3,middle");
    fs::write(at.join("named.csv"), wrong).unwrap();
    refuses(at, &format!("{build} named.csv"), &["line 4", "patch", "middle"]);
    let twice = table.join("\n") + "\nthumb,left,,1,2\n";
    fs::write(at.join("named.csv"), twice).unwrap();
    refuses(at, &format!("{build} named.csv"), &["(\"n1\")", "(\"thumb\")", "one place"]);
}

/// A table of landmarks is of the whole file: rows of patches that were not chosen are counted, and not used.
#[test]
fn landmarks_of_patches_that_are_not_chosen_are_counted() {
    let folder = folder();
    let at = folder.path();
    let build = "build skin.glb -o left --patch left --atlas other/map.glb --landmarks places.csv";
    dermatome(at, build).assert().success().stderr(contains("5 rows"));
    let places = fs::read_to_string(at.join("places.csv")).unwrap();
    fs::write(at.join("places.csv"), places + "9999,1\n").unwrap();
    refuses(at, build, &["line 12", "taxel_id", "9999"]);
}

/// A map on an atlas says so, and by what.
#[test]
fn a_map_says_its_atlas() {
    let folder = folder();
    let at = folder.path();
    let said = String::from_utf8(dermatome(at, "info skin/map.glb").output().unwrap().stdout).unwrap();
    for part in
        ["on the map of other\n", "left: on its patch palm by 5 landmarks; symmetric Dirichlet energy"]
    {
        assert!(said.contains(part), "{said}");
    }
    let info = json(&dermatome(at, "info skin/map.glb --json").output().unwrap().stdout);
    let report = json(&fs::read(at.join("skin/report.json")).unwrap());
    for of in [&info, &report] {
        assert_eq!((&of["atlas"]["name"], &of["atlas"]["mirrored"]), (&"other".into(), &false.into()));
        let on = &of["patches"][1]["atlas"];
        assert_eq!((&on["patch"], &on["landmarks"], &on["left_out"]), (&"palm".into(), &5.into(), &0.into()));
        assert!(on["free_dirichlet"].as_f64().unwrap() >= 4.0);
    }
    let bent = &report["patches"][0]["levels"][0]["symmetric_dirichlet"];
    assert_eq!(&info["patches"][0]["atlas"]["symmetric_dirichlet"], bent);
    assert!(fs::read_to_string(at.join("skin/report.html")).unwrap().contains("<p>on the map of other</p>"));
    assert!(
        !String::from_utf8(dermatome(at, "info other/map.glb").output().unwrap().stdout)
            .unwrap()
            .contains("on the map")
    );
}

/// A page of two skins, which takes landmarks.
#[test]
fn a_page_shows_the_skin_and_its_atlas() {
    let folder = folder();
    let at = folder.path();
    dermatome(at, "report skin/map.glb --atlas other/map.glb -o page.html -q").assert().success();
    dermatome(at, "report skin/map.glb -o alone.html -q").assert().success();
    let size = |name: &str| fs::metadata(at.join(name)).unwrap().len();
    assert!(size("page.html") > size("alone.html") + 500, "the data of both");
    refuses(at, "report skin/map.glb --atlas other.glb -o x.html", &["other.glb"]);
    refuses(at, "report skin/map.glb --atlas other/map.glb --live", &["--atlas", "--live"]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = folder();
    let at = folder.path();
    let build = "build skin.glb -o x --atlas other/map.glb";
    refuses(at, build, &["--landmarks"]);
    refuses(at, "build skin.glb -o x --landmarks places.csv", &["--atlas"]);
    refuses(at, &format!("{build} --landmarks places.txt"), &["regions", ".csv"]);
    refuses(at, &format!("{build} --landmarks regions"), &["no named region", "--regions"]);
    refuses(at, &format!("{build} --landmarks places.csv --mirror"), &["other hand", "--mirror"]);
    fs::write(at.join("twice.csv"), "taxel_id,atlas_taxel_id\n1,1\n1,5\n9,9\n100,100\n").unwrap();
    refuses(at, &format!("{build} --landmarks twice.csv"), &["line 2 of", "line 3 of", "one place"]);
    fs::write(at.join("unknown.csv"), "taxel_id,atlas_taxel_id\n1,1\n777,5\n").unwrap();
    refuses(at, &format!("{build} --landmarks unknown.csv"), &["line 3", "taxel_id", "777", "of the skin"]);
    fs::write(at.join("unknown.csv"), "taxel_id,atlas_taxel_id\n1,1\n5,777\n").unwrap();
    refuses(at, &format!("{build} --landmarks unknown.csv"), &["line 3", "777", "of the atlas"]);
    fs::write(at.join("none.csv"), "taxel_id,atlas_taxel_id\n").unwrap();
    refuses(at, &format!("{build} --landmarks none.csv"), &["no row"]);
    dermatome(at, "build skin.glb -o free -q").assert().success();
    refuses(at, "render free/map.glb touch.csv --atlas other/map.glb -o y.npz", &["itself", "build --atlas"]);
    refuses(at, "carry free/map.glb touch.csv --to other/map.glb -o y.csv", &["itself", "build --atlas"]);
    refuses(at, "carry skin/map.glb touch.csv --to other/map.glb -o y.txt", &[".csv", ".npz"]);
    assert!(!at.join("x/map.glb").exists() && !at.join("y.csv").exists() && !at.join("y.npz").exists());
}
