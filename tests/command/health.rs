//! `check --recording` as a user runs it.

use std::fs;
use std::path::Path;

use dermatome::io::{read_response, write_skin};
use dermatome::mesh::shapes;
use dermatome::signal::TaxelState;
use dermatome::skin::Skin;

use crate::common;

fn folder_with_a_recording(faults: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("sheet", shapes::lattice(8, 8, 0.006));
    write_skin(&folder.path().join("sheet.glb"), &skin).unwrap();
    let words = "touch sheet.glb -o touched.csv --true-response truth.csv --rate-hz 25 \
                 --reads pressure --noise-kpa 2 --seed 2";
    common::dermatome(&folder, &format!("{words} {faults}")).assert().success();
    folder
}

fn states(folder: &Path, name: &str, state: TaxelState) -> Vec<u32> {
    let taxels = read_response(&folder.join(name)).unwrap().0.taxels;
    taxels.iter().filter(|known| known.state == state).map(|known| known.taxel.0).collect()
}

/// Faults are findings in the schema of `check`, exit code 1, and states in the table of responses.
#[test]
fn faulty_taxels_are_listed_with_their_evidence() {
    let folder = folder_with_a_recording("--presses 40 --pause-s 0 --faults dead=2,noisy=1");
    let words = "check sheet.glb --recording touched.csv -o states.csv --json";
    let run = common::dermatome(&folder, words).assert().code(1);
    let json = common::json(&run.get_output().stdout);
    assert_eq!(json["schema"], "dermatome.check/1");
    let findings = json["findings"].as_array().unwrap();
    for (kind, state) in [("dead", TaxelState::Dead), ("noisy", TaxelState::Noisy)] {
        let own = findings.iter().filter(|finding| finding["kind"] == kind);
        let ids: Vec<u32> =
            own.map(|finding| u32::try_from(finding["taxels"][0].as_u64().unwrap()).unwrap()).collect();
        assert_eq!(ids, states(folder.path(), "truth.csv", state), "{findings:?}");
        assert_eq!(ids, states(folder.path(), "states.csv", state));
    }
    let noisy = findings.iter().find(|finding| finding["kind"] == "noisy").unwrap();
    assert!(noisy["evidence"]["times_median"].as_f64().unwrap() > 3.0 && noisy["severity"] == "error");
    assert_eq!((&json["health"]["frames"], &json["health"]["recordings"]), (&1000.into(), &1.into()));
    let plain =
        common::dermatome(&folder, "check sheet.glb --recording touched.csv touched.csv").assert().code(1);
    let text = String::from_utf8_lossy(&plain.get_output().stdout).into_owned();
    assert!(text.contains("is dead") && text.contains("2000 frames of 2 recordings"), "{text}");
}

/// Without a touch taxels are untested, which is no fault and is said; what cannot be read three times or is of another
/// skin is refused.
#[test]
fn untested_taxels_are_counted_and_foreign_recordings_refused() {
    let folder = folder_with_a_recording("--presses 0 --pause-s 4 --faults dead=0");
    let run = common::dermatome(&folder, "check sheet.glb --recording touched.csv").assert().success();
    let text = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    assert!(text.contains("0 taxels tested, 64 untested"), "{text}");
    fs::write(folder.path().join("other.csv"), "time,900,901\n0,1,2\n0.1,1,3\n").unwrap();
    let row = |of: &dyn Fn(u32) -> String| (1..=64).map(of).collect::<Vec<_>>().join(",");
    let (names, values) = (row(&|id| format!("{id}.temperature[K]")), row(&|id| id.to_string()));
    fs::write(folder.path().join("warm.csv"), format!("time,{names}\n0,{values}\n0.1,{values}\n")).unwrap();
    fs::write(folder.path().join("modules.csv"), "taxel_id,module\n900,a\n").unwrap();
    for (words, said) in [
        ("--recording other.csv", "other.csv: none of the 2 taxel ids"),
        ("--recording touched.csv other.csv", "other.csv: none of the 2 taxel ids"),
        ("--recording touched.csv warm.csv", "recording 2: no channel of the readings"),
        ("--recording touched.csv warm.csv --order", "recording 2: no channel of the readings"),
        ("--recording -", "read three times"),
        ("--recording touched.csv --modules modules.csv", "a taxel of the skin"),
        ("--recording touched.csv -o states.json", ".csv"),
        ("--recording touched.csv --threshold 0", "a positive number"),
        ("-o states.csv", "--recording"),
    ] {
        common::refuses(&folder, &format!("check sheet.glb {words}"), &[said]);
    }
}
