//! `response` as a user runs it: simulated recordings in, a table out, and readings that become pressures by it.

use std::fs;
use std::path::Path;

use dermatome::io::{read_response, write_skin};
use dermatome::mesh::shapes;
use dermatome::signal::{Response, Scale, TaxelState};
use dermatome::skin::Skin;

use crate::common::{dermatome, refuses};

fn folder_with_a_patch() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_skin(&folder.path().join("skin.glb"), &Skin::from_mesh("patch", shapes::lattice(10, 8, 0.007)))
        .unwrap();
    folder
}

fn read(folder: &Path, name: &str) -> Response {
    read_response(&folder.join(name)).unwrap().0
}

/// The rms difference of the logarithms of gains, relative to their mean or not.
fn difference(found: &Response, truth: &Response, is_relative: bool) -> f64 {
    let pairs = found.taxels.iter().filter_map(|taxel| {
        let other = truth.taxels.iter().find(|other| other.taxel == taxel.taxel)?;
        Some((taxel.gain?.ln() - other.gain?.ln(), 1.0))
    });
    let pairs: Vec<(f64, f64)> = pairs.collect();
    assert!(pairs.len() > 60, "{} gains", pairs.len());
    let count = pairs.len() as f64;
    let mean = if is_relative { pairs.iter().map(|(x, _)| x).sum::<f64>() / count } else { 0.0 };
    (pairs.iter().map(|(x, _)| (x - mean).powi(2)).sum::<f64>() / count).sqrt()
}

const TOUCHES: &str = "touch skin.glb --reads pressure --sphere-mm 8,15 --depth-mm 1,3 --blur-mm 1.5 --aspect 2 --rate-hz 20 \
                       --press-s 1.25 --noise-kpa 1 --gain-spread 0.3 --dead 0.03";

/// From touches to relative gains, to pascals by known forces, to pressures of a recording.
#[test]
fn touches_give_gains_and_forces_their_scale() {
    let folder = folder_with_a_patch();
    let folder = folder.path();
    let run = |words: &str| dermatome(folder, words).assert().success();
    run(&format!("{TOUCHES} -o touches.csv --presses 80 --true-response true.csv --truth force.csv"));
    run("response skin.glb touches.csv -o relative.csv");
    let (relative, truth) = (read(folder, "relative.csv"), read(folder, "true.csv"));
    assert_eq!((relative.scale, relative.unit.as_str()), (Some(Scale::Relative), "Pa"));
    let error = difference(&relative, &truth, true);
    assert!(error < 0.12, "{error}");
    let of = |state| relative.taxels.iter().filter(|taxel| taxel.state == state).count();
    assert!(of(TaxelState::Ok) > 60 && of(TaxelState::Ok) + of(TaxelState::Untested) == 80);
    assert!(relative.taxels.iter().all(|taxel| taxel.gain.is_some() == (taxel.state == TaxelState::Ok)));
    run("response skin.glb touches.csv --force force.csv --response relative.csv -o scaled.csv");
    let scaled = read(folder, "scaled.csv");
    assert_eq!(scaled.scale, Some(Scale::Pascals));
    let error = difference(&scaled, &truth, false);
    assert!(error < 0.2, "{error}");
    run("build skin.glb -o map");
    let said = run("render map/map.glb touches.csv --response scaled.csv --zero stored -o out.npz --json")
        .get_output()
        .clone();
    let said = String::from_utf8(said.stdout).unwrap();
    assert!(said.contains("\"Pa\""), "{said}");
    refuses(folder, "render map/map.glb touches.csv --zero stored -o out.npz", &["--response"]);
    let other = "taxel_id,gain\n900,2\n";
    fs::write(folder.join("other.csv"), other).unwrap();
    refuses(folder, "render map/map.glb touches.csv --response other.csv -o out.npz", &["900", "same skin"]);
}

/// From steps of pressure to gains in Pa and exponents.
#[test]
fn steps_of_pressure_give_pascals() {
    let folder = folder_with_a_patch();
    let folder = folder.path();
    let run = |words: &str| dermatome(folder, words).assert().success();
    run(
        "touch skin.glb -o bag.csv --reads pressure --bag-kpa 5,20,60 --presses 3 --press-s 6 --pause-s 2 --rate-hz 10 \
         --uneven 0.02 --gain-spread 0.3 --exponent 0.8 --noise-kpa 0.1 --true-response true.csv --truth steps.csv",
    );
    run("response skin.glb bag.csv --pressure steps.csv -o response.csv");
    let (found, truth) = (read(folder, "response.csv"), read(folder, "true.csv"));
    assert_eq!(found.scale, Some(Scale::Pascals));
    for taxel in &found.taxels {
        let other = truth.taxels.iter().find(|other| other.taxel == taxel.taxel).unwrap();
        let pressure =
            |of: &dermatome::signal::TaxelResponse| of.gain.unwrap() * 2e4_f64.powf(of.exponent.unwrap());
        let ratio = pressure(taxel) / pressure(other);
        assert!((ratio - 1.0).abs() < 0.12, "{ratio}: {taxel:?}, {other:?}");
    }
    fs::write(folder.join("kpa.csv"), "time,pressure\n2,5\n4,20\n").unwrap();
    refuses(folder, "response skin.glb bag.csv --pressure kpa.csv -o no.csv", &["5 Pa", "unit"]);
}

/// What tells nothing is an error, and leaves no file.
#[test]
fn recordings_that_tell_nothing_are_refused() {
    let folder = folder_with_a_patch();
    let folder = folder.path();
    dermatome(folder, "touch skin.glb -o none.csv --presses 0 --pause-s 20 --rate-hz 10 --noise-kpa 1")
        .assert()
        .success();
    refuses(folder, "response skin.glb none.csv -o no.csv", &["0 touches", "20 presses"]);
    refuses(folder, "response skin.glb none.csv -o no.csv --response x.csv", &["--force"]);
    fs::write(folder.join("foreign.csv"), "time,900,901\n0,1,2\n0.1,1,3\n").unwrap();
    let foreign = ["foreign.csv: none of the 2 taxel ids", "the map of the skin"];
    refuses(folder, "response skin.glb foreign.csv -o no.csv", &foreign);
    refuses(folder, "response skin.glb none.csv foreign.csv -o no.csv", &foreign);
    fs::write(folder.join("counts.csv"), "time,1.pressure[count]\n0,1\n0.1,2\n").unwrap();
    let mixed = "response skin.glb none.csv counts.csv -o no.csv";
    refuses(folder, mixed, &["recording 2", "\"count\"", "\"N\"", "one sensor"]);
    fs::write(folder.join("steps.csv"), "time,pressure\n0,20000\n").unwrap();
    let twice = "response skin.glb none.csv none.csv --pressure steps.csv -o no.csv";
    refuses(folder, twice, &["one recording", "2 are given"]);
    fs::write(folder.join("one.csv"), "taxel_id,gain\n1,2\n").unwrap();
    fs::write(folder.join("force.csv"), "time,force\n0,1\n20,1\n").unwrap();
    refuses(
        folder,
        "response skin.glb none.csv -o no.csv --response one.csv --force force.csv",
        &["no relative gains"],
    );
    assert!(!folder.join("no.csv").exists());
}

/// A recording of which half the columns are of another skin is one of half the taxels: the others have no gain, and the
/// command says so. Of a table of gains of which half is of another skin the other half counts.
#[test]
fn half_a_recording_of_another_skin_gives_half_the_gains() {
    let folder = folder_with_a_patch();
    let folder = folder.path();
    let run = |words: &str| dermatome(folder, words).assert().success();
    run(
        "touch skin.glb -o bag.csv --reads pressure --bag-kpa 5,20,60 --presses 1 --press-s 6 --pause-s 2 --rate-hz 10 \
         --truth steps.csv",
    );
    let bag = fs::read_to_string(folder.join("bag.csv")).unwrap();
    let (header, rows) = bag.split_once('\n').unwrap();
    let renamed: Vec<String> = header
        .split(',')
        .map(|column| {
            let (id, rest) = column.split_once('.').unwrap_or((column, ""));
            match id.parse::<u32>() {
                Ok(id) if id > 40 => format!("{}.{rest}", id + 900),
                _ => column.to_owned(),
            }
        })
        .collect();
    fs::write(folder.join("mixed.csv"), format!("{}\n{rows}", renamed.join(","))).unwrap();
    let said =
        run("response skin.glb mixed.csv --pressure steps.csv -o mixed_gains.csv").get_output().clone();
    let said = String::from_utf8(said.stderr).unwrap();
    for words in ["40 columns are of no taxel of the map: 941", "40 have none", "40 untested"] {
        assert!(said.contains(words), "{said}");
    }
    for taxel in read(folder, "mixed_gains.csv").taxels {
        let state = if taxel.taxel.0 > 40 { TaxelState::Untested } else { TaxelState::Ok };
        assert_eq!((taxel.state, taxel.gain.is_some()), (state, state == TaxelState::Ok), "{taxel:?}");
    }
    let said = dermatome(folder, "check skin.glb --recording mixed.csv").assert().get_output().clone();
    let said = String::from_utf8([said.stdout, said.stderr].concat()).unwrap();
    assert!(said.contains("40 columns are of no taxel of the map"), "{said}");
    fs::write(folder.join("half.csv"), "# scale: relative\ntaxel_id,gain\n1,2\n900,2\n").unwrap();
    fs::write(folder.join("force.csv"), "time,force\n0,1\n20,1\n").unwrap();
    refuses(
        folder,
        "response skin.glb bag.csv -o no.csv --force force.csv --response half.csv",
        &["79 taxels are without a gain", "0 touches of known force", "correct --force"],
    );
    assert!(!folder.join("no.csv").exists());
}
