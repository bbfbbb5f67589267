//! Files of observations: what is read, what comes back, what is refused and how it is named.

use std::{fs, path::PathBuf};

use dermatome::calib::{
    ContactMeasurement, ContactObservation, ContactObservationId, DisplacementId, DisplacementMeasurement,
    Information, JointMotion, Model, Pose, PoseMeasurement, SimulateOptions, TouchJoint, TouchRow,
    TouchingBody, calibrate, calibrated_skin, simulate,
};
use dermatome::id::VertexId;
use dermatome::io::{
    ObservationRemark, read_draft, read_observations, read_triangles, read_truth, write_calibration,
    write_observations, write_skin, write_triangles, write_truth,
};
use dermatome::skin::TaxelId;
use glam::{DQuat, DVec3};
use tempfile::TempDir;

fn file(name: &str, text: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    (folder, path)
}

fn refusal(name: &str, text: &str) -> String {
    let (_folder, path) = file(name, text);
    read_observations(&path, &[]).unwrap_err().to_string()
}

const UNIT: &str = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1";

#[test]
fn simulated_graphs_come_back_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.g2o");
    for model in [Model::Positions, Model::Poses] {
        let options = SimulateOptions { model, taxels: 30, anchors: 4, ..SimulateOptions::default() };
        let mut observations = simulate(&options).unwrap().observations;
        observations.taxels[VertexId::new(2)].fixed = true;
        if model == Model::Poses {
            let offset = Pose { position: DVec3::X, rotation: DQuat::from_xyzw(0.6, 0.0, 0.0, 0.8) };
            let information = Information::diagonal([1.0, 2.0, 3.0, 4.0, 5.0, 1e-300]);
            let seen = Box::new(PoseMeasurement { pose: Pose::default(), information });
            observations.contacts.push(ContactObservation {
                taxel: VertexId::new(3),
                measurement: ContactMeasurement::Pose { offset, seen },
            });
        }
        write_observations(&path, &observations).unwrap();
        let (back, remarks) = read_observations(&path, &[]).unwrap();
        assert!(remarks.is_empty(), "{remarks:?}");
        assert!(back == observations, "{model:?}");
    }
}

/// Touches come back with their contacts; a table has the same columns in every row.
#[test]
fn touches_of_contacts_go_into_a_table_and_come_back() {
    let text = "i,x,y,z,touch,contact,weight,qx,qy,qz,qw,px,py,pz,radius,pathx,pathy,pathz,\
                dx:Left Elbow,dy:Left Elbow,dz:Left Elbow,\"dx:a,b[m]\",\"dy:a,b[m]\",\"dz:a,b[m]\",sigma\n\
                5,0.1,0,0,3,9,1,0.6,0,0,0.8,1,2,3,0.01,0,0,0.003,0.1,0.2,0.3,0,1,0,0.5\n\
                7,0.2,0,0,3,9,0.25,0,0,0,1,1,2,3,0.01,0,0,0.003,0.1,0.2,0.3,0,1,0,0.5\n";
    let (folder, path) = file("a.csv", text);
    let (mut observations, remarks) = read_observations(&path, &[]).unwrap();
    assert!(remarks.is_empty(), "{remarks:?}");
    let probe = Some(DQuat::from_xyzw(0.6, 0.0, 0.0, 0.8));
    let body = Some(TouchingBody { centre: DVec3::new(1.0, 2.0, 3.0), radius: 0.01 });
    let way = Some(DVec3::new(0.0, 0.0, 0.003));
    let rows: Vec<TouchRow> = observations.touches.iter().cloned().collect();
    let by_joints = vec![DVec3::new(0.1, 0.2, 0.3), DVec3::Y];
    let (touch, contact) = (Some(3), Some(9));
    assert_eq!(
        rows[0],
        TouchRow {
            touch,
            contact,
            weight: 1.0,
            probe,
            body,
            outward: None,
            path: way,
            velocity: None,
            by_joints
        }
    );
    let joint = |name: &str, motion| TouchJoint { name: name.into(), motion };
    let joints = [joint("Left Elbow", JointMotion::Turns), joint("a,b", JointMotion::Slides)];
    assert_eq!(observations.joints, joints);
    assert_eq!((rows[1].weight, rows[1].probe), (0.25, Some(DQuat::IDENTITY)));
    let copy = folder.path().join("b.csv");
    write_observations(&copy, &observations).unwrap();
    assert!(read_observations(&copy, &[]).unwrap().0 == observations);
    // Touches are numbered in one table.
    let error = read_observations(&path, std::slice::from_ref(&copy)).unwrap_err().to_string();
    assert!(error.contains("all contacts in one table"), "{error}");
    observations.touches[ContactObservationId::new(1)].contact = None;
    let error = write_observations(&copy, &observations).unwrap_err().to_string();
    assert!(error.contains("the same columns in every row"), "{error}");
    let mut scaled = observations.clone();
    scaled.scale(1e-3);
    let row = scaled.touches.iter().next().unwrap();
    assert_eq!((row.path, row.body.unwrap().radius), (way.map(|way| 1e-3 * way), 1e-5));
    assert_eq!(row.by_joints, [1e-3 * DVec3::new(0.1, 0.2, 0.3), DVec3::Y], "a length by a length stays");
    observations.touches = observations.touches.iter().take(1).cloned().collect();
    assert_eq!(
        observations.validate().unwrap_err().to_string(),
        "there are 1 touches of 2 contacts; needed: one for each, or none"
    );
    assert!(refusal("a.csv", "i,x,y,z,qx,qy,qz\n1,0,0,0,0,0,0\n").contains("qw"));
    assert!(refusal("a.csv", "i,x,y,z,dx:a,dy:a\n1,0,0,0,0,0\n").contains("dz:a"));
}

#[test]
fn unknown_lines_are_counted_and_named() {
    let text = format!(
        "# a comment\nVERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 2\n\
         EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {UNIT}\nVERTEX_CAM 3\nVERTEX_CAM 4\n"
    );
    let (_folder, path) = file("a.g2o", &text);
    let (_, remarks) = read_observations(&path, &[]).unwrap();
    assert_eq!(
        remarks,
        [
            ObservationRemark::UnknownTag { tag: "VERTEX_CAM".into(), lines: 2 },
            ObservationRemark::Normalised { quaternions: 1, worst: 2.0 },
        ]
    );
    assert_eq!(remarks[0].to_string(), "2 lines of the unknown kind VERTEX_CAM were left out");
}

#[test]
fn indefinite_information_is_counted_with_its_first_line() {
    let graph = "VERTEX_TRACKXYZ 0 0 0 0\nVERTEX_TRACKXYZ 1 0 0 0\nEDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0 1\n\
                 EDGE_POINTXYZ 0 1 1 0 0 1 0 0 -1 0 1\nEDGE_POINTXYZ_PRIOR 1 1 0 0 1 0 0 -1 0 1\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.g2o");
    fs::write(&path, graph).unwrap();
    let (mut observations, remarks) = read_observations(&path, &[]).unwrap();
    let said: Vec<String> = remarks.iter().map(ToString::to_string).collect();
    assert_eq!(said, ["line 4: the information of edge 0 to 1 is not positive semi-definite; 1 more is not"]);
    assert!(observations.validate().is_err());
    assert_eq!(observations.clip_information(), 2);
    observations.validate().unwrap();
}

#[test]
fn broken_graphs_are_refused_with_their_line() {
    let vertices = "VERTEX_TRACKXYZ 0 0 0 0\nVERTEX_TRACKXYZ 1 0 0 0\n";
    for (line, needed) in [
        ("EDGE_POINTXYZ 0 0 1 0 0 1 0 0 1 0 1", "itself"),
        ("EDGE_POINTXYZ 0 7 1 0 0 1 0 0 1 0 1", "taxel 7"),
        ("EDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0", "8 numbers"),
        ("EDGE_POINTXYZ 0", "ends too soon"),
        ("EDGE_POINTXYZ 0 1 NaN 0 0 1 0 0 1 0 1", "finite"),
        ("EDGE_POINTXYZ -1 1 0 0 0 1 0 0 1 0 1", "number of a taxel"),
        ("VERTEX_TRACKXYZ 1 0 0 0", "second time"),
        ("VERTEX_SE3:QUAT 2 0 0 0 0 0 0 1", "positions"),
        ("FIX 9", "taxel 9"),
        ("EDGE_POINTXYZ 0 1 1e160 0 0 1 0 0 1 0 1", "at most 1e12"),
        ("EDGE_POINTXYZ 0 1 1 0 0 1e300 0 0 1 0 1", "edge 0 to 1; needed: at most 1e18"),
    ] {
        let found = refusal("a.g2o", &format!("{vertices}{line}\n"));
        assert!(found.contains("line 3") && found.contains(needed), "{line}: {found}");
    }
    let found = refusal("a.g2o", vertices);
    assert!(found.contains("2 taxels and no observation"), "{found}");
    let poses = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n";
    for (line, needed) in [
        (format!("EDGE_SE3_PRIOR 0 5 0 0 0 0 0 0 1 {UNIT}"), "parameter 5"),
        ("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0".to_owned(), "length 0"),
        ("PARAMS_SE3OFFSET 0 0 0 0 0 0 0".to_owned(), "6 numbers"),
    ] {
        let found = refusal("a.g2o", &format!("{poses}{line}\n"));
        assert!(found.contains("line 2") && found.contains(needed), "{line}: {found}");
    }
}

#[test]
fn one_bad_line_among_many_is_found() {
    let mut text = String::from("VERTEX_TRACKXYZ 0 0 0 0\nVERTEX_TRACKXYZ 1 0 0 0\n");
    let good = "EDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0 1\n";
    text.push_str(&good.repeat(20_000));
    text.push_str("EDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0 oops\n");
    text.push_str(&good.repeat(1000));
    assert!(refusal("a.g2o", &text).contains("line 20003"));
}

#[test]
fn bytes_that_are_no_text_and_endless_lines_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.g2o");
    fs::write(&path, b"VERTEX_TRACKXYZ 0 0 0 0\n\xff\xfe\n").unwrap();
    assert!(read_observations(&path, &[]).unwrap_err().to_string().contains("line 2"));
    fs::write(&path, vec![b'V'; 1 << 20]).unwrap();
    assert!(read_observations(&path, &[]).unwrap_err().to_string().contains("65536 bytes"));
    let other = folder.path().join("a.txt");
    fs::write(&other, "1 2 3").unwrap();
    assert!(read_observations(&other, &[]).unwrap_err().to_string().contains(".g2o"));
}

#[test]
fn tables_of_displacements_and_contacts_belong_together() {
    let (_folder, edges) = file("e.csv", "i,j,dx,dy,dz,sigma\n10,20,1,0,0,0.001\n20,30,0,1,0,0.002\n");
    let (read, _) = read_observations(&edges, &[]).unwrap();
    assert_eq!(read.taxels.iter().map(|t| t.id.0).collect::<Vec<_>>(), [10, 20, 30]);
    let DisplacementMeasurement::Offset { information, .. } = &read.edges[DisplacementId::new(1)].measurement
    else {
        panic!()
    };
    assert!((information.0[0][0] - 250_000.0).abs() < 1e-6);

    let (_folder, contacts) =
        file("c.csv", "i,x,y,z,nx,ny,nz,ixx,ixy,ixz,iyy,iyz,izz\n30,1,2,3,0,0,2,4,0,0,4,0,4\n");
    let (read, _) = read_observations(&edges, &[contacts]).unwrap();
    let contact = &read.contacts[ContactObservationId::new(0)];
    assert_eq!(contact.taxel, VertexId::new(2));
    assert!(
        matches!(contact.measurement, ContactMeasurement::PositionNormal { normal, .. } if normal == DVec3::Z)
    );
    let found = calibrate(&read, &Default::default()).unwrap();
    assert!(found.poses[VertexId::new(0)].position.distance(DVec3::new(0.0, 1.0, 3.0)) < 1e-9);

    let (_folder, stranger) = file("s.csv", "i,x,y,z\n77,0,0,0\n");
    let (_, remarks) = read_observations(&stranger, &[]).unwrap();
    assert_eq!(remarks.len(), 1, "an assumed sigma is remarked");
    let refused = read_observations(&edges, &[stranger]).unwrap_err().to_string();
    assert!(refused.contains("taxel 77"), "{refused}");
}

#[test]
fn broken_tables_are_refused_with_their_line() {
    for (text, needed) in [
        ("", "empty file"),
        ("i,j,dx,dy\n", "a column `dz`"),
        ("i;j;dx;dy;dz\n1;2;0,5;0;0\n", "column `dx`: found \"0,5\"; needed: a number with a decimal point"),
        ("i,j,dx,dy,dz,colour\n", "\"colour\""),
        ("i,i,x,y,z\n", "line 1, column 2: found \"i\" again"),
        ("i,j,dx,dy,dz\n1,2,3\n", "line 2: found 3 cells"),
        ("i,j,dx,dy,dz\n1,2,,0,0\n", "line 2, column `dx`: found \"\""),
        ("i,j,dx,dy,dz,sigma\n1,2,0,0,0,1e-200\n", "needed: a sigma of 1e-9 to 1e9"),
        ("i,x,y,z,sx,sy,sz\n1,0,0,0,1,-1,1\n", "column `sy`"),
        ("i,x,y,z,nx,ny,nz,sigma_n\n1,0,0,0,0,0,2,-0.03\n", "column `sigma_n`"),
        ("i,x,y,z,nx,ny,nz\n1,0,0,0,0,0,0\n", "direction"),
    ] {
        let found = refusal("a.csv", text);
        assert!(found.contains(needed), "{text:?}: {found}");
    }
}

/// A misspelt column is not silently ignored.
#[test]
fn columns_without_meaning_are_refused() {
    for (header, column) in [
        ("i,j,dx,dy,dz,nx,ny,nz", "nx"),
        ("i,j,dx,dy,dz,sigma,ixx,ixy,ixz,iyy,iyz,izz", "ixx"),
        ("i,j,dx,dy,dz,sigma_n", "sigma_n"),
    ] {
        let found = refusal("a.csv", &format!("{header}\n"));
        let needed = format!("line 1: found a column \"{column}\", which is redundant");
        assert!(found.contains(&needed), "{header}: {found}");
    }
}

#[test]
fn sigma_may_differ_by_axis_in_every_table() {
    let expected = Information::diagonal([1e6, 250_000.0, 1e4]);
    let near = |information: &Information<3>| {
        information
            .0
            .iter()
            .flatten()
            .zip(expected.0.iter().flatten())
            .all(|(a, b)| (a - b).abs() <= 1e-12 * b)
    };
    let (_folder, path) = file("e.csv", "i,j,dx,dy,dz,sx,sy,sz\n1,2,0,0,0,0.001,0.002,0.01\n");
    let edges = read_observations(&path, &[]).unwrap().0.edges;
    assert!(
        matches!(&edges[DisplacementId::new(0)].measurement, DisplacementMeasurement::Offset { information, .. } if near(information))
    );
    let (_folder, path) = file("c.csv", "i,sz,sy,sx,x,y,z\n1,0.01,0.002,0.001,0,0,0\n");
    let contacts = read_observations(&path, &[]).unwrap().0.contacts;
    assert!(
        matches!(&contacts[ContactObservationId::new(0)].measurement, ContactMeasurement::Position { information, .. } if near(information))
    );
}

/// What editors and spreadsheets do to a file leaves it the same file.
#[test]
fn headers_may_have_marks_comments_and_capitals() {
    let read = |text: &str| {
        let (_folder, path) = file("a.csv", text);
        read_observations(&path, &[]).unwrap()
    };
    let plain = read("i,j,dx,dy,dz\n1,2,0.005,0,0\n");
    for text in [
        "\u{feff}i,j,dx,dy,dz\n1,2,0.005,0,0\n",
        "\u{feff}# a comment\n\n# another\ni,j,dx,dy,dz\n# a third\n1,2,0.005,0,0\n",
        "I , J , DX , DY , DZ\r\n 1 , 2 , 5e-3 , 0 , 0 \r\n",
        "\"i\",\"j\",\"dx\",\"dy\",\"dz\"\n\"1\",2,0.005,0,0",
    ] {
        assert_eq!(read(text), plain, "{text:?}");
    }
    let graph = "VERTEX_TRACKXYZ 0 0 0 0\nVERTEX_TRACKXYZ 1 0 0 0\nEDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0 1\n";
    let (_folder, path) = file("a.g2o", &format!("\u{feff}{graph}"));
    let (read, remarks) = read_observations(&path, &[]).unwrap();
    assert_eq!((remarks.len(), read.taxels.len()), (0, 2));
}

#[test]
fn errors_count_lines_of_unknown_tags() {
    let flat = refusal("a.g2o", &"VERTEX_SE2 0 0 0 0\n".repeat(12));
    let told = "0 taxels and no observation; 12 lines of unknown tags: VERTEX_SE2 (12)";
    assert!(flat.contains(told), "{flat}");
    let mixed = "VERTEX_TRACKXYZ 0 0 0 0\nVERTEX_XYZ 1 0 0 0\nEDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0 1\n";
    let dangling = refusal("a.g2o", mixed);
    assert!(dangling.contains("taxel 1; 1 line of unknown tags: VERTEX_XYZ (1)"), "{dangling}");
    let many = refusal("a.g2o", &format!("A\nB\nC\nD\n{}\n", "E".repeat(5000)));
    assert!(many.contains("5 lines of unknown tags: (other) (1), A (1), B (1) and 2 more"), "{many}");
}

#[test]
fn taxels_of_further_files_are_merged() {
    let (_folder, edges) = file("e.csv", "i,j,dx,dy,dz\n1,2,1,0,0\n2,3,0,1,0\n");
    let graph = |lines: &str| file("c.g2o", &format!("{lines}\nEDGE_POINTXYZ_PRIOR 2 1 0 0 1 0 0 1 0 1\n"));
    let first = "VERTEX_TRACKXYZ 1 7 0 0\nVERTEX_TRACKXYZ 2 8 0 0\nFIX 1";
    let (_folder, other) = graph(first);
    let (both, _) = read_observations(&edges, std::slice::from_ref(&other)).unwrap();
    let taxel = |k: usize| both.taxels[VertexId::new(k)];
    let at = |x: f64| Some(Pose { position: DVec3::X * x, ..Pose::default() });
    assert_eq!((taxel(0).fixed, taxel(0).initial), (true, at(7.0)));
    assert_eq!((taxel(1).fixed, taxel(1).initial), (false, at(8.0)));
    assert_eq!(taxel(2).initial, None);

    for (lines, needed) in [
        ("VERTEX_TRACKXYZ 1 9 0 0\nVERTEX_TRACKXYZ 2 8 0 0\nFIX 1", "taxel 1: found another fixed position"),
        ("VERTEX_TRACKXYZ 2 8 0 0\nVERTEX_TRACKXYZ 4 0 0 0\nFIX 4", "taxel 4"),
        ("VERTEX_SE3:QUAT 2 0 0 0 0 0 0 1", "poses model; needed: positions"),
    ] {
        let (_folder, path) = graph(lines);
        let found = read_observations(&edges, &[other.clone(), path]).unwrap_err().to_string();
        assert!(found.contains(needed), "{lines:?}: {found}");
    }
}

#[test]
fn displacements_go_into_a_table_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.csv");
    let options = SimulateOptions { taxels: 30, ..SimulateOptions::default() };
    let observations = simulate(&options).unwrap().observations;
    write_observations(&path, &observations).unwrap();
    let (back, remarks) = read_observations(&path, &[]).unwrap();
    assert!(remarks.is_empty() && back.edges == observations.edges);
    for (options, told) in [
        (SimulateOptions { anchors: 3, ..options }, "a contact among displacements"),
        (SimulateOptions { model: Model::Poses, ..options }, "a rotation"),
    ] {
        let refused = write_observations(&path, &simulate(&options).unwrap().observations).unwrap_err();
        assert!(refused.to_string().contains(told), "{refused}");
    }
    let refused = write_observations(&folder.path().join("e.txt"), &observations).unwrap_err();
    assert!(refused.to_string().contains(".g2o, .csv"), "{refused}");
}

#[test]
fn a_truth_with_a_taxel_twice_is_refused() {
    let (_folder, path) = file("t.csv", "id,x,y,z\n1,0,0,0\n1,5,0,0\n");
    let refused = read_truth(&path).unwrap_err().to_string();
    assert!(refused.contains("line 3, column `id`"), "{refused}");
}

#[test]
fn contacts_with_normals_have_a_table_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let options = SimulateOptions {
        model: Model::Poses,
        taxels: 30,
        anchors: 5,
        normal_noise: Some(0.03),
        ..SimulateOptions::default()
    };
    let mut observations = simulate(&options).unwrap().observations;
    for refusal in ["a normal", "no initial pose"] {
        let refused = write_observations(&folder.path().join("a.g2o"), &observations).unwrap_err();
        assert!(refused.to_string().contains(refusal), "{refused}");
        observations.taxels.iter_mut().for_each(|taxel| taxel.initial = None);
    }
    let path = folder.path().join("c.csv");
    observations.edges = Default::default();
    write_observations(&path, &observations).unwrap();
    let back = read_observations(&path, &[]).unwrap().0;
    assert_eq!(back.contacts.len(), 5);
    for (a, b) in observations.contacts.iter().zip(&back.contacts) {
        let (
            ContactMeasurement::PositionNormal {
                position: p,
                information: i,
                normal: n,
                normal_information: k,
            },
            ContactMeasurement::PositionNormal {
                position: q,
                information: j,
                normal: m,
                normal_information: l,
            },
        ) = (&a.measurement, &b.measurement)
        else {
            panic!("contacts with normals");
        };
        assert!(p == q && n.distance(*m) < 1e-15);
        assert!(i == j, "{i:?} comes back as {j:?}");
        assert!((k / l - 1.0).abs() < 1e-14, "{k} comes back as {l}");
    }
}

#[test]
fn calibrated_taxels_go_into_tables_and_skins() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let simulation = simulate(&SimulateOptions::default()).unwrap();
    let found = calibrate(&simulation.observations, &Default::default()).unwrap();
    write_calibration(&at("c.csv"), &found).unwrap();
    let text = fs::read_to_string(at("c.csv")).unwrap();
    assert!(text.starts_with("id,x,y,z,qx,qy,qz,qw,sigma,cxx,cxy,cxz,cyy,cyz,czz\n"), "{text:.80}");
    assert_eq!(text.lines().count(), 501);

    let triangles = &simulation.mesh.triangles;
    write_triangles(&at("t.csv"), &found.ids, triangles.as_slice()).unwrap();
    assert_eq!(read_triangles(&at("t.csv"), &found.ids).unwrap(), triangles.as_slice().to_vec());
    write_truth(&at("truth.csv"), &found.ids, &simulation.truth).unwrap();
    let truth = read_truth(&at("truth.csv")).unwrap();
    assert_eq!(truth[499].0, TaxelId(499));
    assert_eq!(truth[499].1.position, simulation.truth[VertexId::new(499)].position);

    let given = calibrated_skin(&found, &simulation.observations, Some(triangles.as_slice())).unwrap();
    let meshed = calibrated_skin(&found, &simulation.observations, None).unwrap();
    for made in [&given, &meshed] {
        assert!(made.left_out.is_empty());
        let patch = made.skin.patches.iter().next().unwrap();
        assert_eq!((patch.mesh.positions.len(), patch.mesh.triangles.len()), (500, 920));
        let outward =
            patch.taxels.normals.enumerate().filter(|(v, n)| n.dot(patch.mesh.positions[*v]) > 0.0).count();
        assert_eq!(outward, 500, "seen from outside");
    }
    write_skin(&at("s.glb"), &meshed.skin).unwrap();
    let sheet = read_draft(&at("s.glb")).unwrap().sheets.remove(0);
    let covariances = sheet.covariances.unwrap();
    let expected = found.marginals.unwrap().positions[VertexId::new(7)];
    let covariance = covariances[7].unwrap();
    assert!((covariance.xx / expected.xx - 1.0).abs() < 1e-6, "{covariance:?} is not {expected:?}");
}

/// A wrong header is the error, whether rows follow or not; a part of a quaternion is no rotation.
#[test]
fn headers_of_truth_and_triangles_are_checked() {
    let ids = [TaxelId(1), TaxelId(2), TaxelId(3)].into_iter().collect();
    for (text, said) in [
        ("foo\n", "a column `id`"),
        ("id,x,y,z,qx,qy,qz\n1,0,0,0,0,0,1\n", "a column `qw`"),
        ("id,x,y,z,qx,qy,qz,qw\n1,0,0,0,0,0,1,1\n", "a unit quaternion"),
    ] {
        let (_folder, path) = file("t.csv", text);
        let refused = read_truth(&path).unwrap_err().to_string();
        assert!(refused.contains(said), "{text:?}: {refused}");
    }
    let (_folder, path) = file("t.csv", "foo\n");
    let refused = read_triangles(&path, &ids).unwrap_err().to_string();
    assert!(refused.contains("columns id0,id1,id2 (ids of taxels) or row0,row1,row2"), "{refused}");
    // The names of the columns say what the numbers are.
    for text in ["id2,id1,id0\n3,2,1\n", "row0,row1,row2\n0,1,2\n"] {
        let (_folder, path) = file("t.csv", text);
        assert_eq!(read_triangles(&path, &ids).unwrap(), [[0, 1, 2].map(VertexId::new)], "{text:?}");
    }
}

#[test]
fn a_chain_of_taxels_makes_no_skin() {
    let (_folder, path) = file("e.csv", "i,j,dx,dy,dz\n1,2,1,0,0\n2,3,1,0,0\n");
    let observations = read_observations(&path, &[]).unwrap().0;
    let found = calibrate(&observations, &Default::default()).unwrap();
    let refused = calibrated_skin(&found, &observations, None).unwrap_err().to_string();
    assert!(refused.contains("no three taxels"), "{refused}");
}
