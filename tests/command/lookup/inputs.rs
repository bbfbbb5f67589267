//! Bad input: what is refused, what is answered all the same, and how it is named.

use super::*;

/// Two caps on an arm; the name of the second one has to be quoted.
fn two_caps() -> Fixture {
    Fixture::caps(&["cap", ASIDE])
}

const ASIDE: &str = "the \"other\", aside";

#[test]
fn a_quote_that_is_not_closed_costs_its_row_alone() {
    let rows = ["0,0,0.9,", "\"0,0,0.9,", "0,0,0.9,\"arm", "0,0,-0.1,\"arm\"", "", "  ", "0,\"0\",\"0.9\","];
    let table = format!("x,y,\"z\",link\r\n{}\r\n", rows.join("\r\n"));
    let run = two_caps().lookup(&table, "--level 0");
    assert_eq!((run.code, run.column("contact")), (2, vec!["0", "3", "4"]), "{}", run.said);
    for part in [r#"line 3, column `x`: found "\"0""#, r#"line 4, column `link`: found "\"arm""#] {
        assert!(run.said.contains(part), "{part} in {}", run.said);
    }
    assert!((0..3).all(|row| run.number(row, "distance").abs() < 1e-3), "{}", run.text);
}

#[test]
fn names_that_have_to_be_quoted_come_back() {
    let fixture = two_caps();
    let run = fixture.lookup("x,y,z\n1,0,0.9\n", "");
    assert!(run.column("patch").iter().all(|name| *name == ASIDE), "{}", run.text);
    let back = fixture.answers(&run.text, "--from-map");
    assert_eq!(back.rows.len(), run.rows.len());
    assert!((back.number(0, "x") - run.number(0, "x")).abs() < 1e-9);
}

#[test]
fn contacts_may_be_in_millimetres() {
    let fixture = two_caps();
    let metres = fixture.answers("x,y,z,radius\n0.01,0.02,0.9,0.005\n", "--level 0 --within 0.03");
    let other = fixture.answers("x,y,z,radius\n10,20,900,5\n", "--level 0 --within 0.03 --unit mm");
    assert!(metres.rows.len() > 3 && metres.rows.len() == other.rows.len(), "{}", other.said);
    for row in 0..metres.rows.len() {
        let [a, b] = [&metres, &other].map(|run| run.number(row, "distance"));
        assert!((a - b).abs() < 1e-12, "{a} and {b} m");
    }
    let [u, v] = metres.numbers(0, ["u", "v"]).map(|x| 100.0 * x);
    let back = fixture.answers(&format!("patch,u,v\ncap,{u},{v}\n"), "--from-map --unit cm");
    let [a, b] = [&metres, &back].map(|run| run.number(0, "u"));
    assert!((a - b).abs() < 1e-9, "{a} and {b} m");
}

#[test]
fn some_patches_of_a_map_answer() {
    let mut fixture = two_caps();
    let run = fixture.answers("x,y,z\n0,0,0.9\n1,0,0.9\n", "--level 0 --patch the* --max-distance inf");
    assert_eq!(run.column("patch"), [ASIDE; 2]);
    let table = "x,y,z,only_link\n0,0,0,arm\n0,0,0,base\n";
    let options = "--patch cap --level 0 --max-distance inf";
    let error = fixture.refusal(table, options);
    assert!(error.contains("\"base\", which carries no patch"), "{error}");
    fixture.map.patches[PatchId::new(1)].link = LinkId::new(0);
    fixture.write_map();
    let error = fixture.refusal(table, options);
    assert!(error.contains("\"base\", which carries none of the patches of --patch"), "{error}");
    let error = fixture.refusal(table, "--patch palm");
    assert!(error.contains("no patch of a name in --patch; it has cap"), "{error}");
}

/// Numbers that are none, too large, or of the wrong sign: each is named by line and column.
#[test]
fn wrong_numbers_are_named() {
    let fixture = two_caps();
    for (columns, cells, options, expected) in [
        ("x,y,z", "NaN,0,0", "", "column `x`: found \"NaN\""),
        ("x,y,z", "0,,0", "", "column `y`: found \"\""),
        ("x,y,z", "0,0", "", "found 2 cells"),
        ("x,y,z", "0,0,1e13", "", "coordinates within 1e12 m"),
        ("x,y,z,radius", "0,0,0,-1", "", "column `radius`: found \"-1\""),
        ("x,y,z,force", "0,0,0,1e300", "", "column `force`"),
        ("x,y,z,nx,ny,nz", "0,0,0,0,0,0", "--ray", "columns nx,ny,nz: found no direction"),
        ("u,v,patch", "1e300,0,cap", "--from-map", "columns u,v"),
        ("u,v", "0,0", "--from-map", "column `patch`"),
        ("px,py,patch", "0,4294967295,cap", "--from-map", "columns px,py"),
        ("px,py,patch", "0,4294967296,cap", "--from-map", "a whole number, 0 to 4294967295"),
        ("u,v,patch,level", "0,0,cap,9", "--from-map", "column `level`"),
    ] {
        let run = fixture.lookup(&format!("{columns}\n{cells}\n"), options);
        let named = run.said.contains("in.csv: line 2") && run.said.contains(expected);
        assert!(run.code == 2 && named && run.rows.is_empty(), "{cells}: {}", run.said);
    }
    for (columns, expected) in [
        ("x,y", "line 1: found columns \"x,y\"; needed: a column `z`"),
        ("x,y,z,x", "column 4: found \"x\" again"),
        ("1,-2.5,3e0", "line 1: found the numbers \"1,-2.5,3e0\"; the header is missing"),
    ] {
        let error = fixture.refusal(&format!("{columns}\n0,0,0\n"), "");
        assert!(error.contains(expected), "{columns}: {error}");
    }
    let commas = fixture.lookup("x,y,z,time[ms]\n0,0,0.5,1500\n", "");
    for separator in [";", "\t"] {
        let other = fixture.lookup(&"x,y,z,time[ms]\n0,0,0.5,1500\n".replace(',', separator), "");
        assert_eq!((other.code, other.rows), (0, commas.rows.clone()), "{}", other.said);
    }
}

#[test]
fn options_that_answer_nothing_are_refused() {
    let fixture = two_caps();
    for options in [
        "--nearest 0",
        "--nearest -1",
        "--within inf",
        "--within nan",
        "--taxel-radius-mm inf",
        "--max-distance nan",
        "--level 99",
        "--pose absent.csv",
        "--animation wave",
    ] {
        let run = fixture.lookup("x,y,z\n0,0,0.9\n", options);
        assert!(run.code == 2 && run.rows.is_empty(), "{options:?}: {}", run.said);
    }
}

/// Very far contacts are answered, with any question.
#[test]
fn contacts_far_away_are_answered() {
    let fixture = two_caps();
    let table = "x,y,z,nx,ny,nz\n1e9,0,0,-1e300,0,1e291\n-1e12,1e12,1e12,1e-310,0,0\n0,0,0,0,0,1e-320\n";
    for options in ["--max-distance inf", "--reactive", "--nearest 2", "--within 1"] {
        let run = fixture.answers(table, options);
        let far: Vec<usize> = (0..run.rows.len()).filter(|&row| run.cell(row, "contact") == "0").collect();
        let is_right = |&row: &usize| (run.number(row, "distance").abs() - 1e9).abs() < 2.0;
        assert!(!far.is_empty() && far.iter().all(is_right), "{options:?}: {}", run.text);
        assert_eq!(run.column("contact").last(), Some(&"2"));
    }
    let run = fixture.answers(table, "--ray --level 0");
    assert_eq!(run.cell(2, "patch"), "cap");
    assert!((run.number(2, "distance") - 0.9).abs() < 1e-3, "the length of the direction does not count");
}

/// An empty column is as none; the frame of the one link with skin takes the names of others too.
#[test]
fn contacts_without_a_link_are_in_the_world() {
    let fixture = two_caps();
    let run = fixture.answers("x,y,z,link,radius,force\n0,0,0.89,,,\n", "--level 0");
    assert!(!run.said.contains("note"), "{}", run.said);
    assert_eq!(["frame", "link"].map(|name| run.cell(0, name)), ["world", "arm"]);
    let run = fixture.answers("x,y,z,link\n0,0,-0.11,\n", "--level 0 --frame link");
    assert!((run.number(0, "distance") - 0.01).abs() < 1e-3, "{}", run.text);
    let table = "x,y,z,link\n0,0,0,leg\n0,0,0,\"l,eg\"\n0,0,0.9,\n0,0,0,leg\n";
    let run = fixture.lookup(table, "--level 0");
    assert_eq!((run.code, run.column("contact")), (2, vec!["2"]));
}

#[test]
fn invalid_poses_are_refused() {
    let fixture = two_caps();
    let header = "time,link,x,y,z,qx,qy,qz,qw";
    let rigid = "found a pose of link \"arm\" that is not rigid";
    for (columns, poses, expected) in [
        ("", "0,arm,0,0,0,0,0,0,2\n", "a unit quaternion"),
        ("", "0,arm,0,0,1e13,0,0,0,1\n", &format!("p.csv: the poses at 0 s: {rigid}")),
        ("", "0,arm,0,0,1,0,0,0,1\n9,arm,0,0,1e13,0,0,0,1\n", "p.csv: the poses at 9 s: found a pose"),
        ("", "0,leg,0,0,0,0,0,0,1\n", "column `link`"),
        ("", "0,arm,0,0,0,0,0,0,1\n-0,arm,0,0,0,0,0,0,1\n", "line 3, column `link`"),
        (",scale", "0,arm,0,0,1,0,0,0,1,2\n", "column `scale`"),
        (",sz", "0,arm,0,0,1,0,0,0,1,2\n", "column `sz`"),
        ("", "", "p.csv: the table: found no row"),
    ] {
        fixture.file("p.csv", &format!("{header}{columns}\n{poses}"));
        let error = fixture.refusal("x,y,z,time\n0,0,0.9,0\n0,0,0.9,99\n", "--pose p.csv -o out.csv");
        assert!(error.contains(expected) && !fixture.path("out.csv").exists(), "{poses}: {error}");
    }
    // One pose for all times.
    fixture.file("p.csv", &format!("{header}\n5,arm,0,0,2,0,0,0,1\n"));
    let run = fixture.answers("x,y,z,time\n0,0,0.89,7\n", "--pose p.csv --level 0");
    assert!((run.number(0, "distance") - 1.01).abs() < 1e-3, "{}", run.text);
}

#[test]
fn what_of_a_table_of_poses_is_not_used_is_named() {
    let fixture = two_caps();
    for (columns, cells, expected) in [
        ("", "", None),
        (",scale", ",1", None),
        (",comment", ",2", Some("note: p.csv: column `comment` is not used\n")),
        (",speed,Timer", ",2,3", Some("note: p.csv: columns `speed`, `Timer` are not used\n")),
    ] {
        fixture.file("p.csv", &format!("link,x,y,z,qx,qy,qz,qw{columns}\narm,0,0,1,0,0,0,1{cells}\n"));
        let said = fixture.answers("x,y,z\n0,0,0.9\n", "--pose p.csv").said;
        let is_noted = expected.map_or(!said.contains("not used"), |note| said.contains(note));
        assert!(is_noted, "{columns}: {said}");
    }
}

/// Tables as spreadsheets and loggers write them: a byte order mark, lines that end in two characters, times
/// in no order.
#[test]
fn tables_with_a_mark_and_times_in_no_order_are_read() {
    let fixture = two_caps();
    let poses = "\u{feff}link,time,x,y,z,qx,qy,qz,qw\r\narm,2,0,0,3,0,0,0,1\r\narm,0,0,0,1,0,0,0,1\r\n";
    fixture.file("p.csv", poses);
    let table = "\u{feff}x,y,z,time\r\n0,0,2.89,2\r\n0,0,0.89,0\r\n0,0,1.89,1\r\n";
    let run = fixture.answers(table, "--pose p.csv --level 0");
    assert_eq!(run.column("contact"), ["0", "1", "2"]);
    assert!((0..3).all(|row| (run.number(row, "distance") - 0.01).abs() < 1e-3), "{}", run.text);
}

/// A skin of one triangle, and one 1000 km from the origin of its link.
#[test]
fn the_smallest_and_the_farthest_skins_are_answered() {
    for (mesh, away, at) in [
        (shapes::triangle(), DVec3::ZERO, DVec3::new(0.2, 0.2, 0.01)),
        (shapes::lattice(8, 8, 0.5), DVec3::splat(1e6), DVec3::new(1.1, 1.2, 0.01)),
    ] {
        let mesh = TriMesh { positions: mesh.positions.map(|p| *p + away), ..mesh };
        let run = Fixture::of(Skin::from_mesh("far", mesh)).answers(&table([away + at]), "--level 0");
        assert_eq!(run.column("patch"), ["far"]);
        assert!((run.number(0, "distance").abs() - 0.01).abs() < 1e-8, "{}", run.text);
        assert_eq!(run.number(0, "nz").abs(), 1.0, "{}", run.text);
    }
}

/// Places off every chart are answered with the nearest one, and say how far off they are.
#[test]
fn places_off_the_map_say_so() {
    let run = two_caps().answers("u,v,patch\n1e9,0,cap\n0,0,cap\n0,-1e12,cap\n", "--from-map");
    assert_eq!(run.column("contact"), ["0", "1", "2"]);
    assert!((run.number(0, "off_chart") - 1e9).abs() < 1.0 && run.number(1, "off_chart") == 0.0);
    assert!(run.said.contains("2 places are off the map"), "{}", run.said);
}

#[test]
fn a_file_without_a_map_is_refused() {
    let fixture = two_caps();
    for bad in [r#"{"asset":{"version":"2.0"}}"#, "x,y,z\n0,0,0.9\n"] {
        fixture.file("map.glb", bad);
        let error = fixture.refusal("x,y,z\n0,0,0.9\n", "");
        assert!(error.contains("map.glb"), "{bad}: {error}");
    }
}

/// Tens of thousands of triangles at one place: the first is the answer, there and back, in no time.
#[test]
fn triangles_at_one_place_are_answered() {
    const STACKED: u32 = 70_000;
    let corners: Vec<DVec3> = shapes::triangle().positions.iter().copied().collect();
    let stacked = (0..STACKED).flat_map(|_| corners.iter().map(|p| *p * 0.1)).collect();
    let triangles: Vec<_> = (0..STACKED).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let fixture = Fixture::flat(TriMesh::from_arrays(stacked, &triangles));
    let contacts = "x,y,z\n0.02,0.02,0.001\n-1,0.3,0.2\n1e9,0,0\n";
    let run = fixture.answers(contacts, "--level 0 --max-distance inf");
    assert_eq!(run.column("face"), ["0"; 3]);
    assert!((run.number(2, "distance").abs() / 1e9 - 1.0).abs() < 1e-6);
    let back = fixture.answers("level,u,v\n0,0.02,0.02\n0,-0.5,0.02\n", "--from-map");
    assert_eq!(back.rows.len(), 2);
    assert!((back.number(0, "x") - 0.02).abs() < 1e-9 && back.number(0, "off_chart") == 0.0);
    assert!((back.number(1, "off_chart") - 0.5).abs() < 1e-9);
}

#[test]
fn a_table_without_contacts_has_no_answers() {
    assert_eq!(two_caps().answers("x,y,z\n", "").rows.len(), 0);
}

/// A row that is too long is refused by its line, like any other.
#[test]
fn a_row_that_is_too_long_costs_no_other_row() {
    let fixture = two_caps();
    for (long, said) in [
        ("1".repeat(3 << 20), "found more than 1048576 bytes"),
        (format!("\"{}", ",".repeat(400_000)), "found 400001 cells"),
    ] {
        let table = format!("x,y,z\n0,0,0.9\n{long}\n0,0,0.9\n{long}\r\n\n0,0,0.9\n");
        let run = fixture.lookup(&table, "--level 0");
        assert_eq!((run.code, run.column("contact")), (2, vec!["0", "2", "4"]), "{}", run.said);
        for part in ["2 of 5 rows".to_owned(), format!("line 3: {said}"), format!("line 5: {said}")] {
            assert!(run.said.contains(&part), "{part} in {}", run.said);
        }
    }
    let error = fixture.refusal(&format!("{}\n0,0,0.9\n", "x".repeat(2 << 20)), "");
    assert!(error.contains("line 1: found more than"), "{error}");
}

/// A name of two links says neither.
#[test]
fn a_name_of_two_links_is_refused() {
    let mut fixture = two_caps();
    fixture.map.links.iter_mut().for_each(|link| link.name = "arm".into());
    fixture.write_map();
    let run = fixture.lookup("x,y,z,link\n0,0,-0.11,arm\n0,0,0.89,\n", "--level 0");
    assert_eq!((run.code, run.column("contact")), (2, vec!["1"]), "{}", run.said);
    assert!(run.said.contains("line 2, column `link`: found \"arm\", the name of 2 links"), "{}", run.said);
}

/// However many links are unknown and columns are not used, the first few are named and all are counted.
#[test]
fn unknown_columns_are_counted() {
    let fixture = two_caps();
    for (count, note) in [
        (1, "column `c0` is not used"),
        (3, "columns `c0`, `c1`, `c2` are not used"),
        (9, "columns `c0`, `c1`, `c2`, `c3`, `c4` and 4 more are not used"),
    ] {
        let names: String = (0..count).map(|k| format!(",c{k}")).collect();
        let table = format!("x,y,z{names}\n0,0,0.9{}\n", ",1".repeat(count));
        assert_eq!(fixture.answers(&table, "").said, format!("note: in.csv: {note}\n"));
    }
}
