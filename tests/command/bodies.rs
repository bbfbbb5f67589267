//! `calibrate --cad` and `calibrate --follow` as a user runs them.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::common::{data, dermatome, json, notes, refuses};
use serde_json::Value;

/// Four hexagons of seven taxels on two patches, as a table.
fn drawing() -> (String, Vec<(u32, [f64; 3])>) {
    let mut table = String::from("taxel_id,x,y,z,nx,ny,nz,module,patch\n");
    let mut taxels = Vec::new();
    for module in 0..4_u32 {
        let angle = 0.5 * f64::from(module);
        for slot in 0..7_u32 {
            let turn = f64::from(slot) * std::f64::consts::TAU / 6.0;
            let [u, v] = if slot == 6 { [0.0, 0.0] } else { [0.01 * turn.cos(), 0.01 * turn.sin()] };
            let (sin, cos) = angle.sin_cos();
            let at = [0.1 * cos - u * sin, 0.1 * sin + u * cos, v];
            let [x, y, z] = at;
            let id = 10 * module + slot;
            let patch = if module < 2 { "left" } else { "right" };
            writeln!(table, "{id},{x},{y},{z},{cos},{sin},0,m{module},{patch}").unwrap();
            taxels.push((id, at));
        }
    }
    (table, taxels)
}

const HEADER: &str = "i,x,y,z,touch,contact,weight,qx,qy,qz,qw,sigma\n";

/// Each taxel touched twice, on a skin that is mounted 4 mm too far along x, by a probe 5 mm off in its own y.
fn contacts(taxels: &[(u32, [f64; 3])]) -> String {
    let mut table = HEADER.to_owned();
    for (k, (id, [x, y, z])) in taxels.iter().enumerate() {
        for repeat in 0..2 {
            // The y of the probe is the y, the -x or the z of the link.
            let (q, at) = match k % 3 {
                0 => ("0,0,0,1", [x + 0.004, y - 0.005, *z]),
                1 => ("0,0,0.7071067811865476,0.7071067811865476", [x + 0.004 + 0.005, *y, *z]),
                _ => ("0.7071067811865476,0,0,0.7071067811865476", [x + 0.004, *y, z - 0.005]),
            };
            let [x, y, z] = at;
            writeln!(table, "{id},{x},{y},{z},{},{k},1,{q},0.0005", 2 * k + repeat).unwrap();
        }
    }
    table
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (table, taxels) = drawing();
    fs::write(folder.path().join("cad.csv"), table).unwrap();
    fs::write(folder.path().join("contacts.csv"), contacts(&taxels)).unwrap();
    folder
}

/// The numbers of a column.
fn column(folder: &Path, file: &str, name: &str) -> Vec<f64> {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    let mut lines = text.lines();
    let at = lines.next().unwrap().split(',').position(|title| title == name).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

#[test]
fn touches_move_a_drawn_skin() {
    let folder = folder();
    let at = folder.path();
    let words = "calibrate contacts.csv --cad cad.csv --fit-probe -o out.csv -o out.glb --folds 4 --json";
    let run = notes(at, words, &["wrote out.csv, out.glb"]);
    let found = json(&run.get_output().stdout);
    assert_eq!((&found["touches"], &found["contacts"]), (&56.into(), &28.into()));
    assert_eq!(
        (&found["schema"], &found["untouched"]),
        (&"dermatome.bodies/1".into(), &Value::Array(vec![]))
    );
    let number = |value: &Value| value.as_f64().unwrap();
    let offset = &found["probe"]["offset_mm"];
    assert!((number(&offset[1]) - 5.0).abs() < 0.3, "{offset} mm");
    let names: Vec<_> = found["bodies"].as_array().unwrap().iter().map(|body| &body["name"]).collect();
    assert_eq!(names, ["mount", "left", "right", "m0", "m1", "m2", "m3"]);
    assert_eq!(found["held_back"]["levels"].as_array().unwrap().len(), 3);
    let (before, after) = (column(at, "cad.csv", "x"), column(at, "out.csv", "x"));
    for (k, (before, after)) in before.iter().zip(&after).enumerate() {
        assert!((after - before - 0.004).abs() < 5e-4, "taxel {k} went from {before} to {after}");
    }
    assert!(column(at, "out.csv", "sigma").iter().all(|sigma| (1e-5..1e-2).contains(sigma)));
    // The result is a drawing, too, and the skin is one that other commands read.
    dermatome(at, "calibrate contacts.csv --cad out.csv --fit-probe -o again.csv").assert().success();
    let info = dermatome(at, "info out.glb --json").assert().success();
    assert_eq!(json(&info.get_output().stdout)["schema"], "dermatome.info/1");
}

/// The result is compared with the truth where that is known.
#[test]
fn a_fit_is_compared_with_the_truth() {
    let folder = folder();
    let at = folder.path();
    let rows: String =
        drawing().1.iter().map(|(id, [x, y, z])| format!("{id},{},{y},{z}\n", x + 0.004)).collect();
    fs::write(at.join("truth.csv"), format!("id,x,y,z\n{rows}")).unwrap();
    let words = "calibrate contacts.csv --cad cad.csv --fit-probe -o out.csv --truth truth.csv";
    let found = json(&dermatome(at, &format!("{words} --json")).assert().success().get_output().stdout);
    let error = found["rmse_mm"].as_f64().unwrap();
    assert!(error < 0.5 && found["rmse_aligned_mm"].as_f64().unwrap() <= error, "{error} mm");
    let printed = dermatome(at, words).assert().success();
    assert!(String::from_utf8_lossy(&printed.get_output().stdout).contains("RMSE "));
}

/// Without a column of uncertainty the noise is estimated, and an untouched module is named.
#[test]
fn what_is_assumed_is_printed() {
    let folder = folder();
    let at = folder.path();
    let (_, taxels) = drawing();
    let text = contacts(&taxels[..21]).replace(",sigma", "").replace(",0.0005", "");
    fs::write(at.join("some.csv"), text).unwrap();
    let said = ["gives no uncertainty; it is estimated", "a module keeps its drawn pose on its patch: `m3`"];
    let run = notes(at, "calibrate some.csv --cad cad.csv --fit-probe -o out.csv", &said);
    let printed = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    assert!(printed.contains("module m3") && printed.contains("offset of the probe"), "{printed}");
    notes(at, "calibrate contacts.csv -o out.csv", &["columns of touches count only with --cad"]);
    let rows: String = taxels.iter().map(|(id, _)| format!("{id},m{}\n", id / 10)).collect();
    fs::write(at.join("modules.csv"), format!("taxel_id,module\n{rows}900,b\n")).unwrap();
    notes(
        at,
        "calibrate contacts.csv --cad cad.csv --modules modules.csv -o out.csv",
        &["modules of taxels that are not in the drawing are passed over: 900"],
    );
}

#[test]
fn bad_tables_are_refused_with_their_rows() {
    let folder = folder();
    let at = folder.path();
    let refused = |row: &str, options: &str, said: &str| {
        fs::write(at.join("bad.csv"), format!("{HEADER}0,0.1,0,0,0,0,1,0,0,0,1,0.001\n{row}\n")).unwrap();
        refuses(at, &format!("calibrate bad.csv --cad cad.csv -o out.csv {options}"), &[said]);
        assert!(!at.join("out.csv").exists());
    };
    refused(
        "99,0,0,0,1,1,1,0,0,0,1,0.001",
        "",
        "row 2 of the contacts is of taxel 99, which the drawing does not have",
    );
    refused("1,0,0,0,1,1,1,0,0,0,2,0.001", "", "bad.csv: line 3");
    refused("1,0,0,0,1,1,1,0,0,0,2,0.001", "", "a unit quaternion");
    refused("1,0,0,0,1,1.5,1,0,0,0,1,0.001", "", "a whole number");
    refused("1,0,0,0,,1,1,0,0,0,1,0.001", "", "a whole number");
    refused("1,0,0,0,1,1,0,0,0,0,1,0.001", "", "a weight above 0");
    refused("1,0,0,0,0,1,1,0,0,0,1,0.001", "", "rows 1 and 2 of the contacts are of one touch");
    refused("1,0,0,0,1,1,1,0,0,0,1,0.001", "--folds 3", "the number of folds is 3");
    refused("1,0,0,0,1,1,1,0,0,0,1,0.001", "--module-mm 0", "a length above 0");
    fs::write(at.join("bare.csv"), "i,x,y,z\n0,0.1,0,0\n").unwrap();
    refuses(
        at,
        "calibrate bare.csv --cad cad.csv --fit-probe -o out.csv",
        &["row 1 of the contacts, of taxel 0, has no orientation of the probe (qx,qy,qz,qw)"],
    );
    fs::write(at.join("modules.csv"), "taxel_id,module\n0,a\n").unwrap();
    refuses(
        at,
        "calibrate contacts.csv --cad cad.csv --modules modules.csv -o out.csv",
        &["modules.csv has no module of taxel 1"],
    );
    refuses(at, "calibrate contacts.csv --cad cad.csv -o out.g2o", &["a graph has no place for bodies"]);
}

/// Observations one by one end at the result of all of them, and a wrong one is named at once.
#[test]
fn a_followed_stream_ends_at_the_batch_result() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    dermatome(at, "simulate -o obs.csv --taxels 40 --seed 4").assert().success();
    let mut text = fs::read_to_string(at.join("obs.csv")).unwrap();
    let header = text.lines().next().unwrap().to_owned();
    // The first displacement once more, 30 mm off.
    let first: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
    let dx: f64 = first[2].parse::<f64>().unwrap() + 0.03;
    let wrong = format!("{},{},{dx},{}\n", first[0], first[1], first[3..].join(","));
    text.push_str(&wrong);
    fs::write(at.join("obs.csv"), &text).unwrap();
    dermatome(at, "calibrate obs.csv -o batch.csv").assert().success();
    let run =
        dermatome(at, "calibrate - --follow -o followed.csv").write_stdin(text.clone()).assert().success();
    for name in ["x", "y", "z", "sigma"] {
        let (batch, followed) = (column(at, "batch.csv", name), column(at, "followed.csv", name));
        let far = batch.iter().zip(&followed).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(batch.len() == 40 && followed.len() == 40 && far < 1e-9, "{name} differs by {far} m");
    }
    let lines: Vec<Value> = String::from_utf8_lossy(&run.get_output().stdout)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines.len(), text.lines().count() - 1, "a line for each touch");
    assert!(lines.iter().zip(1..).all(|(line, number)| line["touch"] == number));
    assert_eq!(lines[0]["fits"], Value::Null, "nothing was known before the first");
    assert_eq!(lines.last().unwrap()["fits"], false, "{}", lines.last().unwrap());
    assert_eq!(lines.last().unwrap()["dof"], 3);
    let judged = lines.iter().filter(|line| line["fits"] != Value::Null).count();
    let unfit = lines.iter().filter(|line| line["fits"] == false).count();
    assert!(judged > 40 && unfit <= 2, "{unfit} of {judged} do not fit");

    // A stream that ends in a row: that row is not read.
    let half = format!("{header}\n{}", &wrong[..wrong.len() - 1]);
    let half =
        text.replacen(&format!("{header}\n"), "", 1).replace(&wrong, "") + half.split_once('\n').unwrap().1;
    let half = format!("{header}\n{half}");
    let run =
        dermatome(at, "calibrate - --follow -o half.csv --every 30").write_stdin(half).assert().success();
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(said.contains("has no end and was not read"), "{said}");
    fs::write(at.join("whole.csv"), text.replace(&wrong, "")).unwrap();
    dermatome(at, "calibrate whole.csv -o whole_out.csv").assert().success();
    let (whole, half) = (column(at, "whole_out.csv", "x"), column(at, "half.csv", "x"));
    assert!(whole.iter().zip(&half).all(|(a, b)| (a - b).abs() < 1e-9));
}

/// Touches of several rows are judged together, and what came before a bad row is kept.
#[test]
fn a_followed_stream_keeps_what_came_before_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let good = "i,x,y,z,touch,sigma\n0,0,0,0,5,0.001\n1,0.01,0,0,5,0.001\n0,0.001,0,0,6,0.001\n1,0.01,0.001,0,6,0.001\n";
    let text = format!("{good}0,0,0,zero,7,0.001\n");
    let run = dermatome(at, "calibrate - --follow -o out.csv").write_stdin(text).assert().code(2);
    let printed = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    let lines: Vec<Value> = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 2, "{printed}");
    assert_eq!((&lines[1]["taxels"], &lines[1]["dof"]), (&serde_json::json!([0, 1]), &6.into()));
    // Two positions of sigma 1 mm differ by 1 mm each: sqrt(2 * 1 / 2).
    assert!((lines[1]["sigmas"].as_f64().unwrap() - 1.0).abs() < 1e-6, "{}", lines[1]);
    assert!((lines[1]["moved_mm"].as_f64().unwrap() - 0.5).abs() < 1e-6, "{}", lines[1]);
    assert!(lines.iter().all(|line| line["time"].is_null()), "{printed}");
    let x = column(at, "out.csv", "x");
    assert!((x[0] - 0.0005).abs() < 1e-12 && (x[1] - 0.01).abs() < 1e-12, "{x:?}");
    refuses(at, "calibrate nothing.csv --follow -o out.csv", &["nothing.csv"]);
}

/// With a drawing all touches so far are fitted after every few, the table is written each time, and the last is the batch
/// result. A stream that stops keeps what it wrote.
#[test]
fn a_drawn_skin_follows_touches() {
    let folder = folder();
    let at = folder.path();
    let text = fs::read_to_string(at.join("contacts.csv")).unwrap();
    let mut timed = String::new();
    for (k, line) in text.lines().enumerate() {
        let time = if k == 0 { "time".to_owned() } else { format!("{}", 0.5 * k as f64) };
        writeln!(timed, "{line},{time}").unwrap();
    }
    let words = "--cad cad.csv --fit-probe";
    dermatome(at, &format!("calibrate contacts.csv {words} -o batch.csv")).assert().success();
    let follow = format!("calibrate - --follow {words} --every 10 -o followed.csv");
    let run = dermatome(at, &follow).write_stdin(timed.clone()).assert().success();
    for name in ["x", "y", "z", "sigma"] {
        let (batch, followed) = (column(at, "batch.csv", name), column(at, "followed.csv", name));
        assert!(batch.iter().zip(&followed).all(|(a, b)| (a - b).abs() < 1e-9), "{name}");
    }
    let printed = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    let lines: Vec<Value> = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 56);
    for (line, number) in lines.iter().zip(1..) {
        assert_eq!(line["time"], 0.5 * f64::from(number));
        assert_eq!(line["moved_mm"].is_null(), number % 10 != 0, "{line}");
        assert_eq!(line["worst"].is_null(), number % 10 != 0, "{line}");
    }
    assert!(lines[9]["moved_mm"].as_f64().unwrap() > lines[49]["moved_mm"].as_f64().unwrap());

    // The touch after the twentieth is of a taxel that the drawing does not have.
    let first: String = text.lines().take(21).map(|line| format!("{line}\n")).collect();
    fs::write(at.join("first.csv"), &first).unwrap();
    dermatome(at, &format!("calibrate first.csv {words} -o first_out.csv")).assert().success();
    let unknown = "99,0,0,0,900,900,1,0,0,0,1,0.0005\n99,0,0,0,901,901,1,0,0,0,1,0.0005\n";
    let stopped =
        dermatome(at, &format!("{follow} -o followed.glb")).write_stdin(first + unknown).assert().code(2);
    let said = String::from_utf8_lossy(&stopped.get_output().stderr).into_owned();
    assert!(said.contains("row 21 of the contacts is of taxel 99"), "{said}");
    let printed = String::from_utf8_lossy(&stopped.get_output().stdout).into_owned();
    assert_eq!(printed.lines().count(), 20, "it ends at the first unknown taxel: {printed}");
    assert_eq!(column(at, "first_out.csv", "x"), column(at, "followed.csv", "x"));
    assert!(at.join("followed.glb").exists(), "what came before the error is written");

    // Without a column of uncertainty the noise is estimated, as in the batch.
    let (_, taxels) = drawing();
    let bare = contacts(&taxels).replace(",sigma", "").replace(",0.0005", "");
    fs::write(at.join("bare.csv"), &bare).unwrap();
    dermatome(at, &format!("calibrate bare.csv {words} -o bare_out.csv")).assert().success();
    let run = dermatome(at, &follow).write_stdin(bare).assert().success();
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert_eq!(said.matches("gives no uncertainty; it is estimated").count(), 1, "{said}");
    assert_eq!(column(at, "bare_out.csv", "sigma"), column(at, "followed.csv", "sigma"));
}

/// A followed skin that is refused at the end does not stay from a fit to fewer touches: what was there before comes back.
#[test]
fn a_refused_skin_does_not_stay_on_the_disk() {
    let folder = folder();
    let at = folder.path();
    let (_, mut taxels) = drawing();
    let ids: Vec<u32> = taxels.iter().map(|(id, _)| *id).collect();
    taxels.iter_mut().enumerate().for_each(|(k, taxel)| taxel.0 = ids[(k * 11 + 5) % ids.len()]);
    let shuffled = contacts(&taxels);
    fs::write(at.join("shuffled.csv"), &shuffled).unwrap();
    refuses(at, "calibrate shuffled.csv --cad cad.csv -o out.csv", &["nothing was written"]);
    let follow = "calibrate - --follow --cad cad.csv --every 10 -o out.csv";
    for before in [None, Some("the skin of yesterday\n")] {
        before.iter().for_each(|text| fs::write(at.join("out.csv"), text).unwrap());
        let run = dermatome(at, follow).write_stdin(shuffled.clone()).assert().code(2);
        let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
        assert!(said.contains("earlier tables are taken back"), "{said}");
        assert_eq!(fs::read_to_string(at.join("out.csv")).ok().as_deref(), before);
    }
    dermatome(at, &format!("{follow} --keep")).write_stdin(shuffled).assert().code(2);
    assert_eq!(column(at, "out.csv", "x").len(), 28);
}

/// Tables that `touches` writes of logs where some rows have a contact or an orientation are read: empty cells are none. A log behind
/// another one, whose touches count from 0 again, is refused.
#[test]
fn empty_cells_of_touches_are_none() {
    let folder = folder();
    let at = folder.path();
    let (_, taxels) = drawing();
    let text = contacts(&taxels);
    let some = |(k, line): (usize, &str)| {
        let mut cells: Vec<&str> = line.split(',').collect();
        if k > 20 {
            // The contact and the orientation of the probe.
            [5, 7, 8, 9, 10].into_iter().for_each(|column| cells[column] = "");
        }
        cells.join(",") + "\n"
    };
    fs::write(at.join("some.csv"), text.lines().enumerate().map(some).collect::<String>()).unwrap();
    dermatome(at, "calibrate some.csv --cad cad.csv -o out.csv").assert().success();
    refuses(at, "calibrate some.csv --cad cad.csv --fit-probe -o out.csv", &["row 21", "no orientation"]);
    let again: String = text.lines().chain(text.lines().skip(1)).map(|line| format!("{line}\n")).collect();
    fs::write(at.join("again.csv"), again).unwrap();
    refuses(
        at,
        "calibrate again.csv --cad cad.csv -o out.csv",
        &["rows 1 and following", "row 57 has its taxel 0"],
    );
}

/// Real touches of a Nao's torso by its own finger: contacts that were held back are predicted, and the offset of the
/// finger is found. Bounds: 3.5 mm in the median and 6.6 mm for 90 %, and no worse than the mount alone.
#[test]
fn touches_of_a_real_robot_are_predicted() {
    let Some(nao) = data("nao") else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let text = fs::read_to_string(nao.join("torso_touches.csv")).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut table = String::from("i,x,y,z,touch,contact,qx,qy,qz,qw\n");
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |name: &str| cells[names.iter().position(|n| *n == name).unwrap()];
        let rest = ["px", "py", "pz", "touch", "contact", "pqx", "pqy", "pqz", "pqw"].map(cell).join(",");
        cell("taxels").split(';').for_each(|id| writeln!(table, "{id},{rest}").unwrap());
    }
    fs::write(at.join("touches.csv"), table).unwrap();
    fs::copy(nao.join("torso_skin.csv"), at.join("cad.csv")).unwrap();
    let words = "calibrate touches.csv --cad cad.csv --fit-probe --folds 5 --seed 10 -o out.csv --json";
    let found = json(&dermatome(at, words).assert().success().get_output().stdout);
    let level = |k: usize, key: &str| found["held_back"]["levels"][k][key].as_f64().unwrap();
    let [mount, modules] = [0, 2].map(|k| [level(k, "median_mm"), level(k, "p90_mm")]);
    assert!(modules[0] < 3.5 && modules[1] < 6.6, "{modules:?} mm");
    assert!(modules[0] > 2.2, "{} mm: contacts are in both groups", modules[0]);
    assert!(
        modules.iter().zip(mount).all(|(modules, mount)| *modules < mount + 0.1),
        "{modules:?}, {mount:?}"
    );
    for (axis, known) in [-0.1, -8.0, 14.2].into_iter().enumerate() {
        let offset = found["probe"]["offset_mm"][axis].as_f64().unwrap();
        assert!((offset - known).abs() < 3.0, "axis {axis}: {offset} mm");
    }
    assert_eq!((&found["exchanged"], &found["turned"]), (&serde_json::json!([]), &serde_json::json!([])));
}
