//! `simulate --arm`, `touches` and `calibrate` as a user runs them: from the log of a robot to a skin.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use crate::common::{self, dermatome, json, notes, refuses};
use dermatome::io::{read_truth, write_skin};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::{Link, LinkId, Skin, TaxelId};
use glam::{DAffine3, DVec3};

/// The cells of a table by the names of its columns.
fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        names.iter().zip(line.split(',')).map(|(name, cell)| ((*name).into(), cell.into())).collect()
    };
    lines.map(row).collect()
}

fn rmse(run: &assert_cmd::assert::Assert) -> f64 {
    json(&run.get_output().stdout)["rmse_mm"].as_f64().unwrap()
}

/// The source paper's experiment from readings: log, contacts, skin, map.
#[test]
fn the_log_of_an_arm_becomes_a_skin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    notes(
        folder,
        "simulate --arm --taxels 80 --indentation-mm 1 -o log.csv --truth t.csv --triangles tri.csv",
        &["80 taxels", "1.000 mm deep"],
    );
    notes(folder, "touches log.csv -o contacts.csv", &["contacts", "noise:"]);
    let words = "calibrate contacts.csv -o skin.glb -o skin.csv --truth t.csv --triangles tri.csv --json";
    let error = rmse(&dermatome(folder, words).assert().success());
    assert!(error < 0.05, "{error} mm");
    dermatome(folder, "build skin.glb -o map").assert().success();

    dermatome(folder, "simulate --arm --taxels 80 --arm-noise-mm 1 --seed 3 -o noisy.csv --truth t.csv")
        .assert()
        .success();
    dermatome(folder, "touches noisy.csv -o contacts.csv --skip 7,9").assert().success();
    let ids: Vec<String> =
        table(&folder.join("contacts.csv")).into_iter().map(|row| row["i"].clone()).collect();
    assert!(!ids.contains(&"7".into()) && ids.contains(&"8".into()), "taxels of --skip are left out");
    let words = "calibrate contacts.csv -o skin.csv --truth t.csv --json";
    let error = rmse(&dermatome(folder, words).assert().success());
    assert!(error < 0.4, "{error} mm");
}

/// A recording of a sheet that a sphere touches, the true positions of the sphere as its log.
fn recording(folder: &Path) {
    let skin = Skin::from_mesh("sheet", shapes::lattice(8, 8, 0.006));
    write_skin(&folder.join("sheet.glb"), &skin).unwrap();
    let words =
        "touch sheet.glb -o readings.csv --truth truth.csv --presses 25 --rate-hz 20 --noise-kpa 1 --seed 2";
    dermatome(folder, words).assert().success();
}

/// The log of the recording; `place` turns the position of the sphere into cells.
fn log_of(folder: &Path, header: &str, place: impl Fn(&BTreeMap<String, String>, DVec3) -> String) {
    let mut log = format!("time,touch,link,radius,{header}\n");
    for row in table(&folder.join("truth.csv")) {
        let number = |name: &str| row[name].parse::<f64>().unwrap();
        let sphere = DVec3::new(number("sphere_x"), number("sphere_y"), number("sphere_z"));
        writeln!(log, "{},{},arm,0.015,{}", row["time"], row["press"], place(&row, sphere)).unwrap();
    }
    fs::write(folder.join("log.csv"), log).unwrap();
}

/// Distances of calibrated taxels with five touches or more from the vertices where they are, in m.
fn distances(folder: &Path, mesh: &TriMesh) -> Vec<f64> {
    let mut touches: BTreeMap<u32, usize> = BTreeMap::new();
    for row in table(&folder.join("contacts.csv")) {
        *touches.entry(row["i"].parse().unwrap()).or_default() += 1;
    }
    let found = read_truth(&folder.join("skin.csv")).unwrap();
    let known = found.iter().filter(|(id, _)| touches[&id.0] >= 5);
    // Ids count from 1.
    known.map(|&(TaxelId(id), pose)| pose.position.distance(mesh.positions[(id - 1).into()])).collect()
}

/// Readings may be a recording, and poses a table: of the link that carries the skin, and of one that carries the body.
#[test]
fn poses_and_readings_may_be_files_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder);
    // The skin stands at (1, 2, 3), turned by a half turn about z; the finger is a link at (1, 2, 4), not turned.
    log_of(folder, "px,py,pz,probe_link", |_, p| {
        let world = DVec3::new(1.0 - p.x, 2.0 - p.y, 3.0 + p.z);
        let q = world - DVec3::new(1.0, 2.0, 4.0);
        format!("{},{},{},finger", q.x, q.y, q.z)
    });
    fs::write(folder.join("poses.csv"), "link,x,y,z,qx,qy,qz,qw\narm,1,2,3,0,0,1,0\nfinger,1,2,4,0,0,0,1\n")
        .unwrap();
    let words = "touches log.csv -o contacts.csv --readings readings.csv --pose poses.csv --skin sheet.glb";
    notes(folder, words, &["taxels are active above", "25 touches"]);
    dermatome(folder, "calibrate contacts.csv -o skin.csv").assert().success();
    let away = distances(folder, &shapes::lattice(8, 8, 0.006)).into_iter().fold(0.0, f64::max);
    println!("farthest {:.3} mm", away * 1e3);
    assert!(away < 1.5e-3, "{away} m");

    refuses(
        folder,
        "touches log.csv -o c.csv --readings readings.csv",
        &["line 3", "\"arm\" has no pose", "--pose"],
    );
    log_of(folder, "px,py,pz", |_, p| format!("{},{},{}", p.x, p.y, p.z));
    refuses(folder, "touches log.csv -o c.csv --pose poses.csv", &["no taxels", "--readings"]);
    let late = fs::read_to_string(folder.join("log.csv")).unwrap().replacen("\n0.", "\n9000.", 1);
    fs::write(folder.join("late.csv"), late).unwrap();
    let words = "touches late.csv -o c.csv --readings readings.csv --pose poses.csv";
    refuses(folder, words, &["line 2", "9000", "the readings are from 0 to", "one clock"]);
    // Two runs of the clock are not one motion.
    let pose = |time: f64| format!("{time},arm,1,2,3,0,0,1,0\n");
    let rows: String = [0.0, 1.0, 2.0, 0.5, 1.5].map(pose).concat();
    fs::write(folder.join("twice.csv"), format!("time,link,x,y,z,qx,qy,qz,qw\n{rows}")).unwrap();
    let words = "touches log.csv -o c.csv --readings readings.csv --pose twice.csv";
    refuses(folder, words, &["line 5", "one run of the clock"]);
}

/// Readings in mN or kPa mean what they mean in N, where a stiffness turns them into depths.
#[test]
fn the_unit_of_readings_fits_a_stiffness() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder);
    fs::write(folder.join("poses.csv"), "link,x,y,z,qx,qy,qz,qw\narm,0,0,0,0,0,0,1\n").unwrap();
    log_of(folder, "px,py,pz", |_, p| format!("{},{},{}", p.x, p.y, p.z));
    let text = fs::read_to_string(folder.join("readings.csv")).unwrap();
    let (names, rows) = text.split_once('\n').unwrap();
    let mut found = Vec::new();
    // A disc of 2 mm.
    let area = std::f64::consts::PI * 4e-6;
    for (unit, factor) in [("N", 1.0), ("mN", 1e3), ("kPa", 1e-3 / area), ("Ohm", 1.0)] {
        let scaled = |cell: (usize, &str)| match cell {
            (0, time) => time.to_owned(),
            (_, x) => (factor * x.parse::<f64>().unwrap()).to_string(),
        };
        let row = |row: &str| row.split(',').enumerate().map(scaled).collect::<Vec<_>>().join(",");
        let scaled = rows.lines().map(row).collect::<Vec<_>>().join("\n");
        let name = names.replace("[N]", &format!("[{unit}]"));
        fs::write(folder.join("scaled.csv"), format!("{name}\n{scaled}\n")).unwrap();
        let words = "touches log.csv -o c.csv --readings scaled.csv --pose poses.csv --skin sheet.glb --stiffness-kpa 20";
        if unit == "Ohm" {
            refuses(folder, words, &["Ohm", "force or pressure"]);
        } else {
            dermatome(folder, words).assert().success();
            found.push(table(&folder.join("c.csv")));
        }
    }
    for rows in &found[1..] {
        assert_eq!(rows.len(), found[0].len());
        for (row, first) in rows.iter().zip(&found[0]) {
            for axis in ["x", "y", "z"] {
                let [found, needed] = [row, first].map(|row| row[axis].parse::<f64>().unwrap());
                assert!((found - needed).abs() < 1e-6, "{axis}: {found} m, in N {needed} m");
            }
        }
    }
}

/// Links may share ids: readings without ids are those of all taxels in the order of the drawing, and the link of the log
/// says which of them count. A log without a link is refused, as is a drawing with other taxels.
#[test]
fn links_may_share_ids() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder);
    let sphere = |_: &BTreeMap<String, String>, p: DVec3| format!("{},{},{},0,0,0,0,0,0,1", p.x, p.y, p.z);
    log_of(folder, "px,py,pz,x,y,z,qx,qy,qz,qw", sphere);
    let of_one = "touches log.csv -o one.csv --readings readings.csv --skin sheet.glb";
    dermatome(folder, of_one).assert().success();

    // A hand of the same taxels, which come first and are not touched.
    let mut skin = Skin::from_mesh("palm", shapes::lattice(8, 8, 0.006));
    let (mut sheet, hand) = (skin.patches.iter().next().unwrap().clone(), LinkId::new(0));
    skin.links[hand].name = "hand".into();
    let arm = Link { name: "arm".into(), parent: None, pose: DAffine3::from_translation(DVec3::X) };
    (sheet.name, sheet.link) = ("sheet".into(), skin.links.push(arm));
    skin.patches.push(sheet);
    write_skin(&folder.join("two.glb"), &skin).unwrap();
    let text = fs::read_to_string(folder.join("readings.csv")).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let first = header.split(',').take_while(|name| ["time", "frame"].contains(name)).count();
    let mut wide =
        header.split(',').take(first).collect::<Vec<_>>().join(",") + &",.force[N]".repeat(128) + "\n";
    for row in rows.lines() {
        let cells: Vec<&str> = row.split(',').collect();
        let (times, values) = cells.split_at(first);
        writeln!(wide, "{}{},{}", times.join(","), ",0".repeat(64), values.join(",")).unwrap();
    }
    fs::write(folder.join("wide.csv"), wide).unwrap();
    let words = "touches log.csv -o two.csv --readings wide.csv --skin two.glb";
    dermatome(folder, words).assert().success();
    assert_eq!(fs::read(folder.join("one.csv")).unwrap(), fs::read(folder.join("two.csv")).unwrap());

    let log = fs::read_to_string(folder.join("log.csv")).unwrap().replace(",arm,", ",leg,");
    fs::write(folder.join("leg.csv"), log).unwrap();
    let words = "touches leg.csv -o no.csv --readings wide.csv --skin two.glb";
    refuses(folder, words, &["the link \"leg\"", "hand, arm"]);
    let log = fs::read_to_string(folder.join("log.csv")).unwrap().replace(",arm,", ",,");
    fs::write(folder.join("unnamed.csv"), log).unwrap();
    let words = "touches unnamed.csv -o no.csv --readings wide.csv --skin two.glb";
    refuses(folder, words, &["taxel 1 ", "\"palm\"", "\"sheet\"", "column `link`"]);
    let words = "touches log.csv -o no.csv --readings wide.csv --skin sheet.glb";
    refuses(folder, words, &["wide.csv", "128 columns", "64 taxels"]);
    refuses(folder, "touches log.csv -o no.csv --readings wide.csv", &["no ids", "--skin"]);
}

/// The trial of a cover, small: a sphere of 15 mm presses a curved skin at random places, readings are noisy, and only the
/// centre of the sphere is known. Asked is 1.42 mm; the fit of profiles reaches a tenth of it.
#[test]
fn presses_on_a_cover_place_its_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mesh = shapes::cap(200, 0.06, 0.6);
    write_skin(&folder.join("cover.glb"), &Skin::from_mesh("cover", mesh.clone())).unwrap();
    let words =
        "touch cover.glb -o readings.csv --truth truth.csv --presses 80 --rate-hz 20 --noise-kpa 2 --seed 4";
    dermatome(folder, words).assert().success();
    log_of(folder, "x,y,z,qx,qy,qz,qw,px,py,pz", |_, p| format!("0,0,0,0,0,0,1,{},{},{}", p.x, p.y, p.z));
    dermatome(folder, "touches log.csv -o contacts.csv --readings readings.csv").assert().success();
    dermatome(folder, "calibrate contacts.csv -o skin.csv").assert().success();
    let away = distances(folder, &mesh);
    let rms = (away.iter().map(|x| x * x).sum::<f64>() / away.len() as f64).sqrt();
    let farthest = away.iter().copied().fold(0.0, f64::max);
    println!("{} taxels, rms {:.3} mm, farthest {:.3} mm", away.len(), rms * 1e3, farthest * 1e3);
    assert!(away.len() > 60, "{} taxels with five touches", away.len());
    assert!(rms < 4e-4 && farthest < 2e-3, "{rms} m, {farthest} m");
}

/// Three touches a taxel with 1 mm of noise, the same in all frames of a touch: no taxel of a flat sheet is on the side of the sphere.
/// More than half of such logs had most of their taxels there.
#[test]
fn few_touches_tell_the_side_of_a_flat_sheet() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_skin(&folder.join("sheet.glb"), &Skin::from_mesh("sheet", shapes::lattice(8, 8, 0.006))).unwrap();
    for seed in 0..4 {
        let words =
            "touch sheet.glb -o readings.csv --truth truth.csv --presses 16 --rate-hz 20 --noise-kpa 1";
        dermatome(folder, &format!("{words} --seed {seed}")).assert().success();
        log_of(folder, "x,y,z,qx,qy,qz,qw,px,py,pz", |row, p| {
            // Of uniform numbers between -1.7 and 1.7 mm the standard deviation is 1 mm.
            let press: f64 = row["press"].parse().unwrap();
            let noise =
                |axis: f64| 1.7e-3 * (2.0 * (1e4 * (press + 37.0 * axis + 1.0).sin()).rem_euclid(1.0) - 1.0);
            format!("0,0,0,0,0,0,1,{},{},{}", p.x + noise(1.0), p.y + noise(2.0), p.z + noise(3.0))
        });
        dermatome(folder, "touches log.csv -o contacts.csv --readings readings.csv").assert().success();
        dermatome(folder, "calibrate contacts.csv -o skin.csv").assert().success();
        let found = read_truth(&folder.join("skin.csv")).unwrap();
        let heights = found.iter().map(|(_, pose)| pose.position.z.abs());
        let highest = heights.fold(0.0, f64::max);
        println!("seed {seed}: {} taxels, at most {:.1} mm off the sheet", found.len(), 1e3 * highest);
        assert!(found.len() > 50 && highest < 0.01, "seed {seed}: {highest} m");
    }
}

/// Joints carry the skin: a log in the world with their values is that of a skin at rest. Faulty taxels may be a table.
#[test]
fn joints_may_carry_the_skin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder);
    let still = "x,y,z,qx,qy,qz,qw,px,py,pz";
    log_of(folder, still, |_, p| format!("0,0,0,0,0,0,1,{},{},{}", p.x, p.y, p.z));
    let words = "--readings readings.csv --skin sheet.glb";
    dermatome(folder, &format!("touches log.csv -o still.csv {words}")).assert().success();
    // The slide moves by 10 mm in a second along x.
    log_of(folder, "px,py,pz", |row, p| {
        format!("{},{},{}", p.x + 0.01 * row["time"].parse::<f64>().unwrap(), p.y, p.z)
    });
    fs::write(
        folder.join("r.urdf"),
        "<robot name=\"r\"><link name=\"base\"/><link name=\"arm\"/><joint name=\"slide\" type=\"prismatic\">\
         <parent link=\"base\"/><child link=\"arm\"/><axis xyz=\"1 0 0\"/>\
         <limit lower=\"-9\" upper=\"9\" effort=\"1\" velocity=\"1\"/></joint></robot>",
    )
    .unwrap();
    fs::write(folder.join("joints.csv"), "time,slide\n0,0\n500,5\n").unwrap();
    let words = format!("{words} --pose r.urdf --joints joints.csv");
    dermatome(folder, &format!("touches log.csv -o moved.csv {words}")).assert().success();
    let [still, moved] = ["still.csv", "moved.csv"].map(|name| table(&folder.join(name)));
    assert_eq!(still.len(), moved.len());
    for (a, b) in still.iter().zip(&moved) {
        for name in ["i", "x", "y", "z"] {
            let [a, b] = [a, b].map(|row| row[name].parse::<f64>().unwrap());
            assert!((a - b).abs() < 1e-6, "{name}: {a}, {b}");
        }
    }
    fs::write(folder.join("faults.csv"), "taxel_id,state\n20,dead\n21,ok\n").unwrap();
    dermatome(folder, &format!("touches log.csv -o some.csv {words} --skip faults.csv")).assert().success();
    let ids: Vec<String> = table(&folder.join("some.csv")).into_iter().map(|row| row["i"].clone()).collect();
    assert!(!ids.contains(&"20".into()) && ids.contains(&"21".into()));
    fs::write(folder.join("short.csv"), "time,slide\n0,0\n1,0.01\n").unwrap();
    let words = words.replace("joints.csv", "short.csv");
    let said = ["line ", "the poses are from 0 to 1 s", "one clock"];
    refuses(folder, &format!("touches log.csv -o c.csv {words}"), &said);
}

/// A drawing of the skin of the simulated arm: its taxels where they are, on eight modules that are 0.7 mm and a degree off in
/// turn, and on a mount that is 10 mm off.
pub(crate) fn drawing_of_modules(folder: &Path) {
    let truth = read_truth(&folder.join("t.csv")).unwrap();
    let mut text = String::from("taxel_id,module,patch,x,y,z,nx,ny,nz\n");
    for (id, pose) in truth {
        let p = pose.position;
        let module = u8::from(p.x > 0.0) + 2 * u8::from(p.y > 0.0) + 4 * u8::from(p.x.hypot(p.y) > 0.02);
        let off = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y][usize::from(module % 4)] * 0.7e-3;
        let (p, n) = (p + off + DVec3::new(0.006, -0.008, 0.0), pose.rotation * DVec3::Z);
        writeln!(text, "{id},{module},skin,{},{},{},{},{},{}", p.x, p.y, p.z, n.x, n.y, n.z).unwrap();
    }
    fs::write(folder.join("drawing.csv"), text).unwrap();
}

/// Cuts the lines of a log into touches of six frames.
pub(crate) fn cut_touches(folder: &Path) {
    let text = fs::read_to_string(folder.join("log.csv")).unwrap();
    let (names, rows) = text.split_once('\n').unwrap();
    let mut cut = format!("{names}\n");
    let (mut line, mut touch, mut count) = (String::new(), 0, 0);
    for row in rows.lines() {
        let cells: Vec<&str> = row.splitn(3, ',').collect();
        if cells[1] != line || count == 6 {
            (line, touch, count) = (cells[1].into(), touch + 1, 0);
        }
        count += 1;
        writeln!(cut, "{},{touch},{}", cells[0], cells[2]).unwrap();
    }
    fs::write(folder.join("log.csv"), cut).unwrap();
}

/// Joints of the arm that are off by 0.4 degrees: with their offsets as unknowns the skin is as from exact joints.
#[test]
fn offsets_of_joints_are_unknowns_of_a_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let simulate = |fault: &str| {
        let words = "simulate --arm --taxels 120 --arm-noise-mm 0.5 --seed 2 -o log.csv --truth t.csv --joints j.csv --robot r.urdf";
        dermatome(folder, &format!("{words}{fault}")).assert().success();
        drawing_of_modules(folder);
        cut_touches(folder);
    };
    let words =
        "touches log.csv --skin drawing.csv --pose r.urdf --joints j.csv --fit-joints -o c.csv --json";
    let fit = |more: &str| {
        let words = format!("calibrate c.csv --cad drawing.csv -o s.csv --truth t.csv --json{more}");
        let run = dermatome(folder, &words).assert().success();
        let said = json(&run.get_output().stdout);
        println!("{more}: {} mm, joints {}", said["rmse_mm"], said["joints"]);
        (said["rmse_mm"].as_f64().unwrap(), said["joints"].clone())
    };
    simulate("");
    let found = dermatome(folder, words).assert().success();
    let names = json(&found.get_output().stdout)["joints"].clone();
    assert_eq!(names.as_array().unwrap().len(), 6, "{names}");
    let exact = fit("").0;
    simulate(" --fault joints-deg=0.4");
    dermatome(folder, words).assert().success();
    let (without, none) = fit("");
    assert!(none.as_array().unwrap().is_empty());
    let (with, joints) = fit(" --fit-joints");
    assert!(with < 0.8 * without, "{with} mm, without {without} mm, exact joints {exact} mm");
    assert_eq!(joints[2]["name"], "elbow");
    assert_eq!(joints[2]["unit"], "degrees");
    let text = fs::read_to_string(folder.join("c.csv")).unwrap();
    assert!(text.lines().next().unwrap().contains("dx:elbow,dy:elbow,dz:elbow"), "{text:.300}");
    let said = String::from_utf8(
        dermatome(folder, "calibrate c.csv --cad drawing.csv --fit-joints=0.5 -o s.csv")
            .assert()
            .success()
            .get_output()
            .stdout
            .clone(),
    )
    .unwrap();
    assert!(said.contains("offset of the joint wrist_bend: "), "{said}");
}

/// What joints need: a robot with the links of the log, values of each joint between them in rad and m, on the clock of the log.
#[test]
fn joints_that_cannot_be_fitted_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let words = "simulate --arm --taxels 30 -o log.csv --truth t.csv --joints j.csv --robot r.urdf";
    dermatome(folder, words).assert().success();
    let words = "touches log.csv -o c.csv --fit-joints";
    refuses(folder, words, &["--joints"]);
    let words = format!("{words} --pose r.urdf --joints");
    dermatome(folder, &format!("{words} j.csv")).assert().success();
    let text = fs::read_to_string(folder.join("j.csv")).unwrap();
    let change = |name: &str, header: [&str; 2], cells: &dyn Fn(&str) -> String| {
        let (names, rows) = text.split_once('\n').unwrap();
        let rows: Vec<String> = rows.lines().map(cells).collect();
        fs::write(
            folder.join(name),
            format!("{}\n{}\n", names.replace(header[0], header[1]), rows.join("\n")),
        )
        .unwrap();
    };
    change("typo.csv", ["elbow", "elbov"], &str::to_owned);
    refuses(
        folder,
        &format!("{words} typo.csv"),
        &["\"elbow\"", "\"end_effector\"", "no values", "--joints"],
    );
    change("degrees.csv", ["", ""], &|row| {
        let (time, values) = row.split_once(',').unwrap();
        let degrees = values.split(',').map(|q| q.parse::<f64>().unwrap().to_degrees().to_string());
        format!("{time},{}", degrees.collect::<Vec<_>>().join(","))
    });
    notes(folder, &format!("{words} degrees.csv"), &["beyond 360 degrees", "in rad and m"]);
    change("late.csv", ["", ""], &|row| format!("9{row}"));
    refuses(
        folder,
        &format!("{words} late.csv"),
        &["line 2", "values of the joints are from 9", "one clock"],
    );
    let log = fs::read_to_string(folder.join("log.csv")).unwrap();
    fs::write(folder.join("paw.csv"), log.replace("end_effector", "paw")).unwrap();
    let of_paw = words.replace("log.csv", "paw.csv");
    refuses(folder, &format!("{of_paw} j.csv"), &["line 2", "\"paw\"", "of the robot", "--fit-joints"]);
    fs::write(folder.join("base.csv"), log.replace("end_effector", "base")).unwrap();
    let of_base = words.replace("log.csv", "base.csv");
    refuses(folder, &format!("{of_base} j.csv"), &["no joint moves the link \"base\""]);
    drawing_of_modules(folder);
    dermatome(folder, "touches log.csv -o c.csv").assert().success();
    refuses(
        folder,
        "calibrate c.csv --cad drawing.csv --fit-joints -o s.csv",
        &["row 1 ", "touches --fit-joints"],
    );
}

/// A taxel without neighbours that a point touches, by an arm said to be exact: its information is finite, and `calibrate`
/// reads it.
#[test]
fn an_exact_arm_gives_finite_information() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "0,0,0,0,0,0,0,0,1,0,0,0.01,1:1\n1,1,0,0,0,0,0,0,1,0,0,0.01,1:1\n";
    let log = format!("time,touch,x,y,z,qx,qy,qz,qw,px,py,pz,taxels\n{rows}");
    fs::write(folder.path().join("l.csv"), log).unwrap();
    for (options, expected) in [("", 1e-3), (" --taxel-mm 1", 5e-4)] {
        dermatome(folder.path(), &format!("touches l.csv --arm-noise-mm 0{options} -o c.csv"))
            .assert()
            .success();
        dermatome(folder.path(), "calibrate c.csv -o k.csv").assert().success();
        let information: f64 = table(&folder.path().join("c.csv"))[0]["ixx"].parse().unwrap();
        assert!((information.powf(-0.5) / expected - 1.0).abs() < 1e-6, "{options}: {information}");
    }
}

/// Tables that are no log are refused with line and column.
#[test]
fn broken_logs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let header = "time,touch,link,x,y,z,qx,qy,qz,qw,px,py,pz,radius,taxels";
    for (rows, said) in [
        ("0,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:x", "column `taxels`"),
        ("0,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:-1", "column `taxels`"),
        ("0,0,a,0,0,0,0,0,0,1.2,0,0,0.1,0.01,3:1", "a unit quaternion"),
        ("0,0,a,0,0,0,0,0,0,1,0,0,0.1,-1,3:1", "column `radius`"),
        ("0,x,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:1", "column `touch`"),
        ("0,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:1;4", "taxel 4 has no reading"),
        ("1,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:1\n0,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:1", "in their order"),
        ("1,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:1\n2,1,b,0,0,0,0,0,0,1,0,0,0.1,0.01,3:1", "--link"),
        ("0,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,", "active taxel"),
    ] {
        fs::write(folder.join("log.csv"), format!("{header}\n{rows}\n")).unwrap();
        refuses(folder, "touches log.csv -o c.csv", &[said]);
        assert!(!folder.join("c.csv").exists(), "nothing is written");
    }
    fs::write(
        folder.join("log.csv"),
        format!(
            "{header}\n0,0,a,0,0,0,0,0,0,1,0,0,0.1,0.01,3:1;4:1\n1,0,a,0,0,0,0,0,0,1,0,0,0.101,0.01,3:1;4:1\n"
        ),
    )
    .unwrap();
    refuses(folder, "touches log.csv -o c.csv --skip 999", &["taxel 999"]);
    fs::write(folder.join("log.csv"), "time,taxels\n0,3\n").unwrap();
    refuses(folder, "touches log.csv -o c.csv", &["a column `px`"]);
    refuses(folder, "simulate --arm -o -", &["-o log.csv"]);
    refuses(folder, "simulate --arm --force-n 1e9 -o log.csv", &["0.9 of its radius"]);
}

/// Faults change the columns of which they speak, and name the touches; the same seed gives the same bytes.
#[test]
fn a_log_can_have_the_faults_of_real_ones() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let simulate = "simulate --arm --taxels 40 --seed 3";
    notes(folder, &format!("{simulate} -o clean.csv"), &["40 taxels"]);
    let clean = table(&folder.join("clean.csv"));
    for (fault, columns, said) in [
        ("ids-percent=10", &["taxels"][..], "wrong ids in the touches "),
        ("places-percent=10", &["x", "y", "z"], "wrong places in the touches "),
        ("radius-percent=5", &["radius"], "40 taxels"),
    ] {
        notes(folder, &format!("{simulate} --fault {fault} -o log.csv"), &[said]);
        let faulty = table(&folder.join("log.csv"));
        assert_eq!(clean.len(), faulty.len(), "{fault}");
        let mut changed: Vec<&str> = Vec::new();
        for (before, after) in clean.iter().zip(&faulty) {
            changed.extend(before.keys().filter(|name| before[*name] != after[*name]).map(String::as_str));
        }
        changed.sort_unstable();
        changed.dedup();
        assert_eq!(changed, columns, "{fault}");
        let bytes = fs::read(folder.join("log.csv")).unwrap();
        notes(folder, &format!("{simulate} --fault {fault} -o log.csv"), &[said]);
        assert_eq!(bytes, fs::read(folder.join("log.csv")).unwrap(), "{fault}");
    }
    // 40 ms of a line of some seconds: fewer rows, each with the readings of a clean one.
    notes(folder, &format!("{simulate} --fault late-ms=40 -o log.csv"), &["40 taxels"]);
    let late = table(&folder.join("log.csv"));
    assert!(late.len() < clean.len() && 2 * late.len() > clean.len(), "{} of {}", late.len(), clean.len());
    assert!(late.iter().all(|row| clean.iter().any(|other| other["taxels"] == row["taxels"])));
    for (fault, said) in [
        ("late-ms", "a name and a number"),
        ("late=4", "names are late-ms, ids-percent, places-percent, radius-percent"),
        ("late-ms=nan", "a name and a number"),
        ("late-ms=4,late-ms=5", "late-ms comes twice"),
        ("late-ms=2000", "the delay of the readings in s is 2"),
        ("ids-percent=101", "the share of touches with wrong ids is 1.01"),
        ("radius-percent=-100", "the error of the radius"),
    ] {
        refuses(folder, &format!("{simulate} --fault {fault} -o none.csv"), &[said]);
        assert!(!folder.join("none.csv").exists(), "{fault}");
    }
    refuses(folder, "simulate --fault late-ms=4 -o none.g2o", &["--arm"]);
}

/// A late clock is said, and taken off unless the delay is given.
#[test]
fn late_readings_are_said_and_taken_off() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let words =
        "simulate --arm --taxels 60 --arm-noise-mm 0.5 --seed 3 --fault late-ms=40 -o log.csv --truth t.csv";
    dermatome(folder, words).assert().success();
    let late = |options: &str, said: &[&str]| {
        let words = format!("touches log.csv -o c.csv{options}");
        notes(folder, &words, said);
        let run = dermatome(folder, &format!("{words} --json")).assert().success();
        let found = json(&run.get_output().stdout);
        let number = |key: &str| found[key].as_f64().unwrap();
        assert!((number("delay_ms") - 40.0).abs() < 10.0, "{options}: {found}");
        let run = dermatome(folder, "calibrate c.csv -o s.csv --truth t.csv --json").assert().success();
        (number("delay_removed_ms"), rmse(&run))
    };
    let said = "the readings are late by ";
    let (found, error) = late("", &[said, "which is taken off"]);
    let (given, same) = late(" --delay-ms 40", &[said, "which is taken off"]);
    let (none, worse) = late(" --delay-ms 0", &[said]);
    assert!(
        (found - 40.0).abs() < 10.0 && (given - 40.0).abs() < 1e-9 && none == 0.0,
        "{found} ms, {given} ms, {none} ms"
    );
    println!("{error} mm, {same} mm, {worse} mm");
    assert!(error < 0.5 * worse && same < 0.5 * worse, "{error} mm, {same} mm, {worse} mm");
    let run = dermatome(folder, "check log.csv --json").assert().success();
    let found = json(&run.get_output().stdout);
    let clock = found["findings"].as_array().unwrap().iter().find(|f| f["kind"] == "clock").unwrap();
    assert!(clock["message"].as_str().unwrap().contains(said), "{clock}");
    let text = fs::read_to_string(folder.join("log.csv")).unwrap();
    let untimed = text.replacen("time", "clock", 1);
    fs::write(folder.join("untimed.csv"), untimed).unwrap();
    refuses(folder, "touches untimed.csv -o c.csv --delay-ms 40", &["line 2", "a time in each row"]);
}

/// Real self-touches: active taxels without readings, a body of unknown size, contacts that are repeated, and its
/// orientation.
#[test]
fn self_touches_of_a_nao_go_through() {
    let Some(data) = common::data("nao") else { return };
    let folder = tempfile::tempdir().unwrap();
    let words =
        format!("touches {0}/torso_touches.csv -o contacts.csv --skin {0}/torso_skin.csv", data.display());
    notes(&folder, &words, &["753 touches of 153 taxels", "2174 contacts"]);
    let rows = table(&folder.path().join("contacts.csv"));
    for name in ["touch", "contact", "weight", "qx", "qw", "ixx", "izz"] {
        assert!(rows.iter().all(|row| !row[name].is_empty()), "{name}");
    }
    // A taxel is no better known than the distance of taxels: 6.45 mm over the square root of 12.
    let sigma = rows[0]["ixx"].parse::<f64>().unwrap().powf(-0.5);
    assert!((0.0015..0.002).contains(&sigma), "{sigma} m");
    dermatome(&folder, "calibrate contacts.csv -o skin.csv").assert().success();
}

/// A taxel of the drawing that is too far from others for a triangle is a taxel like the others.
#[test]
fn taxels_of_a_drawing_need_no_triangle() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let drawing = "taxel_id,x,y,z,nx,ny,nz\n0,0,0,0,0,0,1\n1,0.005,0,0,0,0,1\n2,0,0.005,0,0,0,1\n3,0.005,0.005,0,0,0,1\n4,0.05,0.05,0,0,0,1\n";
    fs::write(folder.join("drawing.csv"), drawing).unwrap();
    let log = "touch,x,y,z,qx,qy,qz,qw,px,py,pz,radius,taxels\n0,0,0,0,0,0,0,1,0.002,0.002,0.009,0.01,0;1;2;3\n1,0,0,0,0,0,0,1,0.05,0.05,0.009,0.01,4\n";
    fs::write(folder.join("log.csv"), log).unwrap();
    dermatome(folder, "touches log.csv --skin drawing.csv -o contacts.csv").assert().success();
    let rows = table(&folder.join("contacts.csv"));
    let far = rows.iter().find(|row| row["i"] == "4").unwrap();
    assert!(
        far["z"].parse::<f64>().unwrap().abs() < 2e-3,
        "the radius is taken off along its normal: {far:?}"
    );
    assert_eq!(rows.len(), 5);
}

/// A log is judged before any fit: what no skin follows from is an error, what it cannot tell a warning.
#[test]
fn check_says_what_is_wrong_with_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    dermatome(folder, "simulate --arm --taxels 40 --seed 3 -o log.csv").assert().success();
    let kinds = |name: &str, code: i32| -> Vec<String> {
        let run = dermatome(folder, &format!("check {name} --json")).assert().code(code);
        let found = json(&run.get_output().stdout);
        assert!(found["log"]["touches"].as_u64() > Some(0) || code == 1, "{found}");
        found["findings"].as_array().unwrap().iter().map(|f| f["kind"].as_str().unwrap().into()).collect()
    };
    let clean = kinds("log.csv", 0);
    assert!(clean.iter().all(|kind| ["coverage", "lone"].contains(&&**kind)), "{clean:?}");
    let text = fs::read_to_string(folder.join("log.csv")).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let changed = |name: &str, change: &dyn Fn(usize, &str, &str) -> String| {
        let row = |(k, line): (usize, &str)| {
            let cells = names.iter().zip(line.split(',')).map(|(name, cell)| change(k, name, cell));
            cells.collect::<Vec<String>>().join(",")
        };
        let rows: Vec<String> = text.lines().skip(1).enumerate().map(row).collect();
        fs::write(folder.join(name), format!("{}\n{}\n", names.join(","), rows.join("\n"))).unwrap();
    };
    let number = |cell: &str| cell.parse::<f64>().unwrap();
    let pose = ["x", "y", "z", "qx", "qy", "qz", "qw"];
    let first: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
    let of_first = |name: &str| first[names.iter().position(|n| *n == name).unwrap()].to_owned();
    changed("still.csv", &|_, name, cell| if pose.contains(&name) { of_first(name) } else { cell.into() });
    assert!(kinds("still.csv", 1).contains(&"still".into()));
    let lengths = ["x", "y", "z", "px", "py", "pz", "radius"];
    changed("mm.csv", &|_, name, cell| {
        if lengths.contains(&name) { (1e3 * number(cell)).to_string() } else { cell.into() }
    });
    assert!(kinds("mm.csv", 1).contains(&"unit".into()));
    changed("bare.csv", &|_, name, cell| match name {
        "radius" => "0".into(),
        "taxels" => cell.split(';').map(|felt| felt.split(':').next().unwrap()).collect::<Vec<_>>().join(";"),
        _ => cell.into(),
    });
    let bare = kinds("bare.csv", 0);
    assert!(["radius", "readings"].iter().all(|kind| bare.iter().any(|k| k == kind)), "{bare:?}");
    let printed = dermatome(folder, "check bare.csv").assert().success();
    assert!(
        String::from_utf8_lossy(&printed.get_output().stdout).contains("radius of the body is not known")
    );
}
