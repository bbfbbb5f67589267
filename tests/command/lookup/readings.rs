//! Readings of contacts: `lookup --readings`.

use super::*;

use crate::common;

/// A plane of 40 x 40 mm with a taxel every 5 mm.
fn plane() -> Fixture {
    Fixture::flat(shapes::lattice(9, 9, 0.005))
}

/// Time and sum of each frame of the readings of contacts, and what is said of them.
fn frames(fixture: &Fixture, contacts: &str, options: &str) -> (Vec<(f64, f64)>, String) {
    let said = fixture.answers(contacts, &format!("--readings touch.csv {options}")).said;
    let text = fs::read_to_string(fixture.path("touch.csv")).unwrap();
    let frame = |line: &str| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        (cells[0], cells[1..].iter().sum())
    };
    let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    (rows.map(frame).collect(), said)
}

/// The forces of contacts become a recording that `render` reads, and none of them is lost.
#[test]
fn forces_become_readings() {
    let fixture = Fixture::new();
    let contacts =
        "time,x,y,z,force,radius\n0,0,0,0.9,2,\n0.1,0,0,0.891,3,0.01\n0.1,0.02,0,0.9,1,\n0.2,0,0,5,9,\n";
    let (found, notes) = frames(&fixture, contacts, "");
    assert!(notes.contains("1 contact is off all taxels") && !notes.contains("is not used"), "{notes}");
    for ((time, sum), expected) in found.iter().zip([(0.0, 2.0), (0.1, 4.0), (0.2, 0.0)]) {
        assert!(*time == expected.0 && (sum - expected.1).abs() < 1e-12, "{found:?}");
    }
    common::notes(&fixture.folder, "render map.glb touch.csv -o touch.npz", &[]);
    // A force of the first frames is no zero.
    let text = fs::read_to_string(fixture.path("touch.csv")).unwrap();
    assert!(text.starts_with("# is_tared: 1\n# threshold: 0.000001\ntime,"), "{text}");
    common::dermatome(fixture.folder.as_ref(), "summary map.glb touch.csv -o sums.csv").assert().success();
    let sums = fs::read_to_string(fixture.path("sums.csv")).unwrap();
    let column = sums.lines().next().unwrap().split(',').position(|name| name == "force_peak").unwrap();
    let peak: f64 = sums.lines().nth(1).unwrap().split(',').nth(column).unwrap().parse().unwrap();
    assert!((peak - 4.0).abs() < 1e-9, "{sums}");
    fixture.refusal(contacts, "--readings touch.txt");
    fixture.refusal(contacts, "--readings in.csv");
}

/// A point farther from the skin than the largest distance touches no taxel, whatever is asked; a ball
/// presses where it touches the skin, wherever its centre is.
#[test]
fn points_off_the_skin_press_nothing() {
    let fixture = plane();
    let contacts = "x,y,z,force,radius\n0.02,0.02,0.004,1,\n0.02,0.02,0.004,2,0.01\n0.02,0.02,0.06,4,0.08\n";
    for (options, sum, untouched) in [
        ("", 7.0, 0),
        ("--max-distance 0.003", 6.0, 1),
        ("--max-distance inf", 7.0, 0),
        ("--reactive --max-distance 0.003", 6.0, 1),
        ("--nearest 1 --max-distance 0.003", 6.0, 1),
        ("--within 0.005", 7.0, 0),
    ] {
        let (found, notes) = frames(&fixture, contacts, options);
        assert!(found.len() == 1 && (found[0].1 - sum).abs() < 1e-12, "{options:?}: {found:?}");
        assert_eq!(notes.matches("off all taxels").count(), untouched, "{options:?}: {notes}");
        assert_eq!(notes.matches("1 contact is off all taxels").count(), untouched, "{options:?}: {notes}");
    }
}

/// What the answers say of fields has no part in it: a point on the skin presses though no taxel is within
/// the distance asked for, and one that is far presses if it may be.
#[test]
fn points_press_by_their_distance_from_the_skin() {
    let fixture = plane();
    for (contact, options) in [
        ("0.0225,0.0225,0", "--within 0.0005"),
        ("0.0225,0.0225,-3.7e-11", "--nearest 3 --max-distance 1e-9"),
        ("0.02,0.02,0.3", "--max-distance 1"),
        ("0.02,0.02,0.3", "--max-distance inf"),
    ] {
        let (found, notes) = frames(&fixture, &format!("x,y,z,force\n{contact},3\n"), options);
        assert!(found.len() == 1 && (found[0].1 - 3.0).abs() < 1e-12, "{options:?}: {found:?}");
        assert!(!notes.contains("off all taxels"), "{options:?}: {notes}");
    }
}

#[test]
fn readings_without_a_force_are_noted() {
    for (contacts, is_noted) in [("x,y,z\n0.02,0.02,0\n", true), ("x,y,z,force\n0.02,0.02,0,0\n", false)] {
        let (_, notes) = frames(&plane(), contacts, "");
        assert_eq!(notes.contains("no contact has a force"), is_noted, "{notes}");
    }
}

#[test]
fn readings_of_rays_are_refused() {
    let fixture = plane();
    let contacts = "x,y,z,nx,ny,nz,force\n0.02,0.02,0.01,0,0,-1,1\n";
    let notes = fixture.refusal(contacts, "--ray --readings touch.csv");
    assert!(notes.contains("cannot be used with") && !fixture.path("touch.csv").exists(), "{notes}");
}

/// Contacts of one time in a row are a frame; others of that time are another one, which a note counts.
#[test]
fn times_that_go_back_are_noted() {
    for (times, expected, backwards) in [
        (&["0", "0", "1", "1"][..], &[0.0, 1.0][..], None),
        (&["0", "1", "0", "", "1", "0.5"], &[0.0, 1.0, 0.0, 1.0, 0.5], Some("note: 2 frame")),
    ] {
        let rows: String = times.iter().map(|time| format!("0.02,0.02,0,1,{time}\n")).collect();
        let (found, notes) = frames(&plane(), &format!("x,y,z,force,time\n{rows}"), "");
        assert_eq!(found.into_iter().map(|(time, _)| time).collect::<Vec<_>>(), expected, "{notes}");
        let count = notes.matches("earlier in the readings").count();
        assert_eq!(count, usize::from(backwards.is_some()), "{notes}");
        assert!(backwards.is_none_or(|note| notes.contains(note)), "{notes}");
    }
}

/// Forces of contacts are 0 where nothing touches, and an archive says so: a contact of the first frame is none of the zero that
/// `summary` subtracts. What `carry` makes of them says it, too.
#[test]
fn forces_of_contacts_have_a_known_zero() {
    let fixture = plane();
    let rows: String = (0..12)
        .map(|k| format!("0.02,0.02,0,{},{}\n", 2.0 + 0.01 * f64::from(k % 2), 0.1 * f64::from(k)))
        .collect();
    fixture.answers(&format!("x,y,z,force,time\n{rows}"), "--readings touch.npz");
    common::dermatome(&fixture.folder, "carry map.glb touch.npz --to map.glb -o carried.npz")
        .assert()
        .success();
    common::dermatome(&fixture.folder, "render map.glb touch.npz -o drawn.npz").assert().success();
    for name in ["touch.npz", "carried.npz"] {
        let said = common::dermatome(&fixture.folder, &format!("summary map.glb {name} -o sums.csv --json"))
            .assert()
            .success();
        let said = common::json(&said.get_output().stdout);
        let peak = said["groups"][0]["force_peak"].as_f64().unwrap();
        assert!((peak - 2.01).abs() < 1e-9, "{name}: {peak}");
    }
}

/// A recording has a frame; a table of answers may be empty.
#[test]
fn a_table_without_contacts_makes_no_recording() {
    let fixture = plane();
    for name in ["touch.csv", "touch.npz"] {
        let notes = fixture.refusal("x,y,z,force\n", &format!("--readings {name} -o out.csv"));
        assert!(notes.contains("in.csv: the table: found no contact"), "{notes}");
        assert!(["out.csv", name].iter().all(|name| !fixture.path(name).exists()));
    }
    assert!(fixture.answers("x,y,z,force\n", "").text.starts_with("contact,level"));
}

#[test]
fn the_radius_of_taxels_needs_readings() {
    let fixture = plane();
    let notes = fixture.refusal("x,y,z\n0.02,0.02,0\n", "--taxel-radius-mm 3");
    assert!(notes.contains("--readings"), "{notes}");
    fixture.answers("x,y,z\n0.02,0.02,0\n", "");
}
