//! Designed skins: from a surface to modules, chains, a skin that builds and a pattern at 1:1, and poses of modules back.

use std::f64::consts::PI;
use std::fs;
use std::path::Path;

use dermatome::io::{read_draft, write_skin};
use dermatome::mesh::shapes;
use dermatome::skin::{Patch, Skin};
use glam::DVec3;
use predicates::str::contains;
use tempfile::TempDir;

use crate::common::{data, dermatome, json, refuses};

const FLAGS: &str = "--module triangle:32.2mm --tolerance 0.5mm --bend-radius 20mm --chain 12";

/// A folder with half of a tube of radius 71.6 mm and length 144 mm.
fn folder_with_a_half_shell() -> TempDir {
    let mut mesh = shapes::sheet(60, 40, |i, j| {
        let (angle, along) = (PI * f64::from(i) / 59.0, 0.144 * f64::from(j) / 39.0);
        DVec3::new(-0.0716 * angle.cos(), along, 0.0716 * angle.sin())
    });
    let face = mesh.triangles.ids().next().unwrap();
    if mesh.face_cross(face).x > 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    let folder = tempfile::tempdir().unwrap();
    write_skin(&folder.path().join("shell.obj"), &Skin::from_mesh("shell", mesh)).unwrap();
    folder
}

fn lines(path: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn a_half_shell_becomes_sixty_modules_that_build_and_unroll() {
    let folder = folder_with_a_half_shell();
    let at = |name: &str| folder.path().join(name);
    let run = dermatome(&folder, &format!("design shell.obj -o d {FLAGS} --json")).assert().success();
    let report = json(&run.get_output().stdout);
    let patch = &report["patches"][0];
    let numbers =
        ["modules", "taxels", "pieces", "chains", "least_chains"].map(|key| patch[key].as_u64().unwrap());
    assert_eq!(numbers, [60, 600, 1, 5, 5], "{report}");

    // The wiring: chains of twelve, each step from the module before.
    let chains = lines(&at("d/chains.csv"));
    assert_eq!(chains.len(), 60);
    for row in &chains {
        let [place, module, from] = [1, 2, 3].map(|k| row[k].parse::<u32>().ok());
        assert_eq!(from, place.filter(|place| *place > 1).and(module.map(|module| module - 1)), "{row:?}");
    }

    // Modules are in the order of chains, and their poses give the taxels of the skin.
    dermatome(&folder, "convert d/modules.csv back.csv --module triangle:32.2mm").assert().success();
    let taxels = |name: &str| {
        let sheet = read_draft(&at(name)).unwrap().sheets.remove(0);
        let mut taxels: Vec<(u32, DVec3)> =
            sheet.ids.unwrap().iter().map(|id| id.0).zip(sheet.positions).collect();
        taxels.sort_by_key(|taxel| taxel.0);
        taxels
    };
    let (skin, back) = (taxels("d/skin.csv"), taxels("back.csv"));
    assert_eq!(skin.len(), 600);
    assert_eq!((skin[0].0, skin[9].0, skin[10].0), (17, 26, 33));
    for (a, b) in skin.iter().zip(&back) {
        assert_eq!(a.0, b.0);
        assert!(a.1.distance(b.1) < 1e-6, "{a:?} {b:?}");
    }

    // The skin goes on; its modules are congruent.
    dermatome(&folder, "check d/skin.csv").assert().success().stdout(contains("congruent").count(0));
    let built = dermatome(&folder, "build d/skin.csv -o map --json").assert().success();
    let level = &json(&built.get_output().stdout)["patches"][0]["levels"][0];
    assert_eq!((level["flips"].as_u64(), level["vertices"].as_u64()), (Some(0), Some(600)), "{level}");
    dermatome(&folder, "touch map/map.glb -o r.csv --presses 1 --rate-hz 5").assert().success();

    // Both patterns have sixty triangles of 32.2 mm.
    let svg = fs::read_to_string(at("d/pattern.svg")).unwrap();
    assert!(svg.contains("mm\"") && svg.contains("50 mm"), "{}", &svg[..300]);
    let dxf = fs::read_to_string(at("d/pattern.dxf")).unwrap();
    let sides = sides_of_modules(&dxf);
    assert_eq!(sides.len(), 180);
    assert!(sides.iter().all(|side| (side - 32.2).abs() < 0.01), "{sides:?}");
}

/// The sides of the closed polylines of the layer MODULE of a DXF file, in mm: pairs of lines of a code and its value.
fn sides_of_modules(dxf: &str) -> Vec<f64> {
    let words: Vec<&str> = dxf.lines().map(str::trim).collect();
    let (mut outlines, mut entity, mut layer) = (Vec::<Vec<[f64; 2]>>::new(), "", "");
    let mut x = 0.0;
    for pair in words.chunks(2) {
        match pair {
            ["0", name] => (entity, layer) = (name, ""),
            ["8", name] => {
                layer = name;
                if (entity, layer) == ("POLYLINE", "MODULE") {
                    outlines.push(Vec::new());
                }
            }
            ["10", number] => x = number.parse().unwrap(),
            ["20", number] if (entity, layer) == ("VERTEX", "MODULE") => {
                outlines.last_mut().unwrap().push([x, number.parse().unwrap()]);
            }
            _ => {}
        }
    }
    let side = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let sides =
        |o: &Vec<[f64; 2]>| (0..o.len()).map(|k| side(o[k], o[(k + 1) % o.len()])).collect::<Vec<_>>();
    outlines.iter().flat_map(sides).collect()
}

#[test]
fn a_drawing_of_a_module_is_read_and_its_faults_are_named() {
    let folder = folder_with_a_half_shell();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let square = "kind,x,y\noutline,0,0\noutline,0.03,0\noutline,0.03,0.03\noutline,0,0.03\ntaxel,0.01,0.01\ntaxel,0.02,0.02\n";
    write("square.csv", square);
    let run = dermatome(&folder, "design shell.obj -o d --module square.csv --bend-radius 20mm --json")
        .assert()
        .success();
    let report = json(&run.get_output().stdout);
    assert!(report["patches"][0]["covered"].as_f64().unwrap() > 0.7, "{report}");
    assert_eq!(report["taxels_per_module"], 2);
    for (name, text, needed) in [
        ("kind.csv", square.replace("taxel,", "pixel,"), "outline, taxel or port"),
        (
            "turned.csv",
            square.replace("0.03,0\n", "0,0.0301\n").replace("outline,0,0.03\n", "outline,0.03,0\n"),
            "counter-clockwise",
        ),
        ("outside.csv", square.replace("taxel,0.02,0.02", "taxel,0.02,-0.02"), "outside the outline"),
        ("bent.csv", square.replace("outline,0,0.03\n", "outline,0.025,0.02\noutline,0,0.03\n"), "convex"),
    ] {
        write(name, &text);
        refuses(&folder, &format!("design shell.obj -o d --module {name}"), &[needed]);
    }
}

#[test]
fn what_cannot_be_designed_says_what_would_do() {
    let folder = folder_with_a_half_shell();
    for (options, needed) in [
        ("--module triangle:32mm --tolerance 0.1mm", "would fit on half of the area"),
        ("--module triangle:32m", "below 10"),
        ("--module triangle:1m", "--unit mm"),
        ("--module triangle:0.1mm", "at most 100000"),
        ("--module circle:3mm", "triangle:L"),
        ("--module triangle:3mm --tolerance 0", "above 0"),
        ("--module triangle:32mm --tolerance 50mm", "a tolerance below that length"),
        ("--module hexagon:1e-9mm", "at least 1e-6 m"),
        ("--module triangle:3mm --bend-radius inf", "above 0"),
        ("--module triangle:3mm --chain 0", "from 1 to 100000"),
        ("--module none.csv", "none.csv"),
    ] {
        refuses(&folder, &format!("design shell.obj -o d {options}"), &[needed]);
        assert!(!folder.path().join("d").exists(), "{options}");
    }
    // One module, whose taxels are a row: no triangle joins them.
    let strip = "v 0 0 0\nv 0.003 0 0\nv 0.003 0.04 0\nv 0 0.04 0\nf 1 2 3 4\n";
    fs::write(folder.path().join("strip.obj"), strip).unwrap();
    refuses(
        &folder,
        "design strip.obj -o d --module rectangle:2mm:30mm",
        &["make no skin", "not on one line"],
    );
    assert!(!folder.path().join("d").exists());
}

#[test]
fn poses_of_modules_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let head = "module,x,y,z,qx,qy,qz,qw\n";
    let row = "4,0,0,0,0,0,0,1\n";
    for (rows, needed) in [
        (format!("{row}{row}"), "each module once"),
        ("4,0,0,0,0,0,0,0\n".to_owned(), "length 1"),
        ("-4,0,0,0,0,0,0,1\n".to_owned(), "a number from 0"),
        ("400000000,0,0,0,0,0,0,1\n".to_owned(), "a number from 0"),
        (String::new(), "one for each module"),
    ] {
        fs::write(folder.path().join("m.csv"), format!("{head}{rows}")).unwrap();
        refuses(&folder, "convert m.csv s.csv --module triangle:32mm", &[needed]);
    }
    fs::write(folder.path().join("m.csv"), format!("{head}{row}5,16,9.5,0,0,0,1,0\n")).unwrap();
    dermatome(&folder, "convert m.csv s.glb --module triangle:32mm --unit mm").assert().success();
    let draft = read_draft(&folder.path().join("s.glb")).unwrap();
    assert_eq!(draft.sheets[0].positions.len(), 20);
}

/// Shells of CAD have inner sides, where no skin goes.
#[test]
fn inner_sides_are_hinted_at() {
    let folder = tempfile::tempdir().unwrap();
    let arm = "<link name='arm'><visual><geometry><mesh filename='shell.obj'/></geometry></visual></link>";
    fs::write(folder.path().join("r.urdf"), format!("<robot name='r'>{arm}</robot>")).unwrap();
    let mut shell = Skin::from_mesh("outer", shapes::ball(8, 0.04));
    let mut inner = shapes::ball(8, 0.037);
    inner.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let link = shell.patches.iter().next().unwrap().link;
    shell.patches.push(Patch::from_mesh("inner", link, inner));
    write_skin(&folder.path().join("shell.obj"), &shell).unwrap();
    let flags = "--module triangle:16mm --tolerance 2mm";
    dermatome(&folder, &format!("design r.urdf -o d {flags}")).assert().success().stderr(contains("--outer"));
    let run = dermatome(&folder, &format!("design r.urdf -o d {flags} --outer --json")).assert().success();
    assert_eq!(json(&run.get_output().stdout)["patches"].as_array().unwrap().len(), 1);
}

/// The modules of the UR10e were drawn by stretching a lattice over the shell.
#[test]
fn modules_of_the_real_file_are_found_not_to_be_congruent() {
    let Some(file) = data("cyskin/ur10e_link1_patch1_isomap.json") else { return };
    let folder = tempfile::tempdir().unwrap();
    let words = format!("check {}", file.display());
    dermatome(&folder, &words).assert().stdout(contains("not congruent"));
}
