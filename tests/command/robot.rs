//! Robot descriptions: what is read of them, and what is refused with the line where it stands.

use std::{fmt::Write, fs, path::Path};

use crate::common::{dermatome, json, notes, refuses};
use dermatome::{
    io::{Packages, RobotSurface, read_draft, read_robot, robot_draft, write_skin},
    mesh::shapes,
    skin::{AssembleOptions, Draft, LinkId, Skin, TaxelId, assemble, world_pose},
};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use tempfile::TempDir;

/// A folder with a robot of these elements.
fn robot(elements: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_robot(folder.path(), elements);
    folder
}

fn write_robot(folder: &Path, elements: &str) {
    fs::write(folder.join("r.urdf"), format!("<robot name='r'>\n{elements}\n</robot>\n")).unwrap();
}

/// A link that is seen as something.
fn link(name: &str, shape: &str) -> String {
    format!("<link name='{name}'><visual><geometry>{shape}</geometry></visual></link>\n")
}

/// A link with a shape that collides.
fn solid(name: &str, shape: &str) -> String {
    format!("<link name='{name}'><collision><geometry>{shape}</geometry></collision></link>\n")
}

/// A joint, with what else it has.
fn joint(parent: &str, child: &str, kind: &str, more: &str) -> String {
    format!(
        "<joint name='to_{child}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>{more}</joint>\n"
    )
}

const BALL: &str = "<sphere radius='0.1'/>";

fn draft_of(folder: &Path) -> Draft {
    read_draft(&folder.join("r.urdf")).unwrap()
}

/// The outside of the surfaces of a skin encloses this much, in m^3.
fn volume(skin: &Skin) -> f64 {
    let six = skin.patches.iter().flat_map(|patch| {
        patch.mesh.triangles.ids().map(|face| {
            let [a, b, c] = patch.mesh.corners(face);
            a.dot(b.cross(c))
        })
    });
    six.sum::<f64>() / 6.0
}

fn assembled(draft: &Draft) -> Skin {
    assemble(draft, &AssembleOptions { repair: true, ..AssembleOptions::default() }).unwrap().skin
}

/// Links come in the order of the tree, whatever the order of the file, with the poses of their joints:
/// turns around the fixed axes x, then y, then z.
#[test]
fn links_make_a_tree_of_poses() {
    let folder = robot(&format!(
        "{}{}{}{}{}",
        link("tip", BALL),
        joint("arm", "tip", "fixed", "<origin xyz='0 0 1' rpy='0.3 -0.2 0.1'/>"),
        link("arm", BALL),
        joint("base", "arm", "revolute", "<origin xyz='1 2 3'/><limit lower='-1' upper='2'/>"),
        "<link name='base'/>",
    ));
    let robot = read_robot(&folder.path().join("r.urdf")).unwrap();
    let names: Vec<&str> = robot.links.iter().map(|link| &*link.name).collect();
    assert_eq!(names, ["base", "arm", "tip"]);
    let joints: Vec<&str> = robot.joints.iter().map(|joint| &*joint.name).collect();
    assert_eq!(joints, ["to_arm", "to_tip"], "in the order of their links");
    assert_eq!(robot.joints[0].limits, Some([-1.0, 2.0]));
    let turn = DMat3::from_rotation_z(0.1) * DMat3::from_rotation_y(-0.2) * DMat3::from_rotation_x(0.3);
    let expected = DAffine3::from_mat3_translation(turn, DVec3::new(1.0, 2.0, 4.0));
    let found = world_pose(&robot.links, LinkId::new(2));
    assert!(found.abs_diff_eq(expected, 1e-15), "{found}");
    let draft = draft_of(folder.path());
    assert_eq!(draft.sheets.iter().map(|s| s.link.unwrap().index()).collect::<Vec<_>>(), [2, 1]);
}

/// Mirrored meshes keep their outside, scaled ones grow, and several shapes of a link have numbers.
#[test]
fn meshes_of_all_kinds_are_scaled_and_mirrored() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Skin::from_mesh("ball", shapes::ball(6, 0.1));
    for name in ["ball.stl", "ball.obj", "ball.ply", "ball.glb"] {
        write_skin(&folder.path().join(name), &ball).unwrap();
    }
    fs::write(folder.path().join("ball.dae"), dae(&ball, "")).unwrap();
    let one = volume(&ball);
    for kind in ["stl", "obj", "ply", "glb", "dae"] {
        for (scale, times) in [
            ("", 1.0),
            ("scale='2 2 2'", 8.0),
            ("scale='2'", 8.0),
            ("scale='1 -1 1'", 1.0),
            ("scale='-1 -1 -3'", 3.0),
        ] {
            write_robot(folder.path(), &link("a", &format!("<mesh filename='ball.{kind}' {scale}/>")));
            let draft = draft_of(folder.path());
            assert_eq!(draft.sheets[0].name, "a");
            let skin = assembled(&draft);
            assert_eq!(skin.patches.len(), 1);
            let found = volume(&skin);
            assert!((found / (times * one) - 1.0).abs() < 1e-6, "{kind} {scale}: {found}");
        }
    }
    let two = "<link name='a'><visual><geometry><box size='1 1 1'/></geometry></visual>\
               <visual><geometry><cylinder radius='1' length='2'/></geometry></visual><visual/></link>";
    write_robot(folder.path(), two);
    let names: Vec<String> = draft_of(folder.path()).sheets.into_iter().map(|sheet| sheet.name).collect();
    assert_eq!(names, ["a.1", "a.2"]);
}

/// A small file that uses one mesh many times, or has many shapes, is refused before they are made.
#[test]
fn triangles_of_all_uses_are_limited() {
    let mesh = "<visual><geometry><mesh filename='m.stl'/></geometry></visual>".repeat(400);
    let folder = robot(&format!("<link name='a'>{mesh}</link>"));
    let lattice = Skin::from_mesh("m", shapes::lattice(200, 200, 0.001));
    write_skin(&folder.path().join("m.stl"), &lattice).unwrap();
    let error = read_draft(&folder.path().join("r.urdf")).unwrap_err().to_string();
    assert!(error.contains("20000000 triangles") && error.contains("line 2"), "{error}");
    let shapes = format!("<visual><geometry>{BALL}</geometry></visual>").repeat(5001);
    write_robot(folder.path(), &format!("<link name='a'>{shapes}</link>"));
    let error = read_draft(&folder.path().join("r.urdf")).unwrap_err().to_string();
    assert!(error.contains("20000000 triangles") && error.contains("line 2"), "{error}");
}

/// A COLLADA file of one mesh, used by these nodes; without any, by none.
fn dae(skin: &Skin, nodes: &str) -> String {
    let mesh = &skin.patches.iter().next().unwrap().mesh;
    let numbers: Vec<String> =
        mesh.positions.iter().map(|p| format!("{:?} {:?} {:?}", p.x, p.y, p.z)).collect();
    // The second number of each corner is that of a normal.
    let corners: Vec<String> = mesh.triangles.iter().flatten().map(|v| format!("{} 0", v.raw())).collect();
    let scene = if nodes.is_empty() {
        String::new()
    } else {
        format!(
            "<library_visual_scenes><visual_scene id='s'>{nodes}</visual_scene></library_visual_scenes>\
             <scene><instance_visual_scene url='#s'/></scene>"
        )
    };
    format!(
        "<?xml version='1.0'?><COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>\
         <asset><unit meter='1'/><up_axis>Y_UP</up_axis></asset><library_geometries><geometry id='g'><mesh>\
         <source id='p'><float_array id='pa'>{}</float_array><technique_common><accessor source='#pa' stride='3'/>\
         </technique_common></source><vertices id='v'><input semantic='POSITION' source='#p'/></vertices>\
         <triangles><input semantic='VERTEX' source='#v' offset='0'/><input semantic='NORMAL' source='#n' offset='1'/>\
         <p>{}</p></triangles></mesh></geometry></library_geometries>{scene}</COLLADA>",
        numbers.join(" "),
        corners.join(" ")
    )
}

/// Every use of a mesh is a sheet, placed by the nodes above it and scaled by the unit of the file; which
/// way is up turns nothing.
#[test]
fn nodes_of_collada_place_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dae");
    let triangle = Skin::from_mesh("triangle", shapes::triangle());
    let read = |text: &str| {
        fs::write(&path, text).unwrap();
        read_draft(&path)
    };
    let nodes = "<node><translate>1 0 0</translate><node id='n'><rotate>0 0 1 90</rotate><scale>2 2 2</scale>\
                 <instance_geometry url='#g'/></node></node><node><matrix>1 0 0 5 0 1 0 6 0 0 -1 7 0 0 0 1</matrix>\
                 <instance_node url='#n'/></node>";
    let text = dae(&triangle, nodes).replace("meter='1'", "meter='0.5'");
    let draft = read(&text).unwrap();
    assert_eq!(draft.sheets.len(), 2);
    let close = |k: usize, expected: [DVec3; 3]| {
        let sheet = &draft.sheets[k];
        let found = sheet.triangles[0].map(|v| sheet.positions[v as usize]);
        let is_close = found.iter().zip(&expected).all(|(a, b)| a.abs_diff_eq(*b, 1e-12));
        assert!(is_close, "{found:?}, not {expected:?}");
    };
    close(0, [DVec3::X * 0.5, DVec3::new(0.5, 1.0, 0.0), DVec3::new(-0.5, 0.0, 0.0)]);
    let at = DVec3::new(2.5, 3.0, 3.5);
    close(1, [at, at - DVec3::X, at + DVec3::Y]);
    let strips = dae(&Skin::from_mesh("s", shapes::lattice(3, 2, 1.0)), "");
    let from = strips.find("<triangles>").unwrap();
    let to = strips.find("</triangles>").unwrap();
    for (element, count) in [
        ("<tristrips><input semantic='VERTEX' source='#v'/><p>0 3 1 4 2 5</p></tristrips>", 4),
        (
            "<polylist><input semantic='VERTEX' source='#v'/><vcount>4 3</vcount><p>0 1 4 3 1 2 4</p></polylist>",
            3,
        ),
        ("<polygons><input semantic='VERTEX' source='#v'/><p>0 1 4 3</p><p>1 2 4</p></polygons>", 3),
        (
            "<lines><input semantic='VERTEX' source='#v'/><p>0 1</p></lines><triangles><input semantic='VERTEX' source='#v'/><p>0 1 3</p></triangles>",
            1,
        ),
    ] {
        let text = [&strips[..from], element, &strips[to + "</triangles>".len()..]].concat();
        let sheet = read(&text).unwrap().sheets.remove(0);
        assert_eq!(sheet.triangles.len(), count, "{element}");
        let up = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| sheet.positions[v as usize]);
            (b - a).cross(c - a).z
        };
        let same = sheet.triangles.iter().all(|t| up(t) * up(&sheet.triangles[0]) >= 0.0);
        assert!(same, "all triangles of {element} face one way: {:?}", sheet.triangles);
    }
    for (from, to, said) in [
        ("<p>0 0 1 0", "<p>9 0 1 0", "vertices below 3"),
        ("#p'", "#w'", "the id of an element"),
        ("<p>0 0", "<p>x 0", "numbers of vertices"),
        ("stride='3'", "stride='2'", "three numbers"),
        ("meter='1'", "meter='-1'", "above 0"),
        ("COLLADA", "X3D", "COLLADA"),
        ("<mesh>", "<mesh", "line 1"),
    ] {
        let error = read(&dae(&triangle, "").replace(from, to)).unwrap_err().to_string();
        assert!(error.contains(said), "{from} -> {to}: {error}");
    }
    let commented = dae(&triangle, "").replace("<p>0 0 1 0", "<p>0 0<!-- a comment -->1 0");
    assert_eq!(read(&commented).unwrap().sheets[0].triangles, [[0, 1, 2]]);
    let many = format!("<node id='n'>{}</node>", "<instance_node url='#n'/>".repeat(3000));
    assert!(read(&dae(&triangle, &many)).unwrap_err().to_string().contains("use themselves"));
    let circle = "<node id='n'><instance_node url='#n'/></node>";
    assert!(read(&dae(&triangle, circle)).unwrap_err().to_string().contains("use themselves"));
    // Each node uses the next one twice: 2^30 uses of a mesh.
    let mut bomb = String::new();
    for k in 0..30 {
        let inner = format!("<instance_node url='#n{}'/>", k + 1);
        write!(bomb, "<node id='n{k}'>{inner}{inner}</node>").unwrap();
    }
    bomb.push_str("<node id='n30'/>");
    assert!(read(&dae(&triangle, &bomb)).unwrap_err().to_string().contains("more nodes"));
}

/// Taxels of sensors have their ids, and lie where the frames of sensor and taxel put them.
#[test]
fn sensors_give_taxels() {
    let sensors = "<sensor name='tip' update_rate='100'><parent link='a'/><origin xyz='0 0 1' rpy='0 0 1.5707963267948966'/>\
                   <tactile><taxel idx='7' xyz='1 0 0' rpy='0 0 0'/><taxel idx='9' xyz='0 1 0'/><taxel idx='3' xyz='0 0 0'/>\
                   </tactile></sensor><sensor name='camera'><parent link='a'/><camera/></sensor>\
                   <sensor name='pad'><parent link='a'/><tactile><array rows='2' cols='3' size='0.1 0.2' offset='1 1'/></tactile></sensor>";
    let folder = robot(&(link("a", BALL) + sensors));
    let draft = draft_of(folder.path());
    let [tip, pad] = &draft.sheets[..] else { panic!("{} sheets", draft.sheets.len()) };
    assert_eq!(tip.ids.as_deref(), Some(&[7, 9, 3].map(TaxelId)[..]));
    let expected = [DVec3::new(0.0, 1.0, 1.0), DVec3::new(-1.0, 0.0, 1.0), DVec3::Z];
    assert!(tip.positions.iter().zip(expected).all(|(p, q)| p.abs_diff_eq(q, 1e-12)), "{:?}", tip.positions);
    assert_eq!(pad.positions.len(), 6);
    assert!(
        pad.positions[1].abs_diff_eq(DVec3::new(-1.0, -0.8, 0.0), 1e-12),
        "columns along y: {}",
        pad.positions[1]
    );
    let path = folder.path().join("r.urdf");
    let seen = robot_draft(&path, &read_robot(&path).unwrap(), RobotSurface::Visual, &Packages::default());
    assert_eq!(seen.unwrap().sheets[0].name, "a");
    for (from, to, said) in [
        ("parent link='a'/><origin", "parent link='b'/><origin", "no <link>"),
        ("idx='7'", "idx='-7'", "a number from 0"),
        ("rows='2'", "rows='2000000000'", "a million taxels"),
        // With the two of the first sensor.
        ("rows='2' cols='3'", "rows='1000' cols='1000'", "a million taxels in the file"),
        ("size='0.1 0.2'", "", "size or spacing"),
        ("<array rows='2' cols='3' size='0.1 0.2' offset='1 1'/>", "", "no taxels"),
    ] {
        write_robot(folder.path(), &(link("a", BALL) + &sensors.replace(from, to)));
        refuses(folder.path(), "info r.urdf", &[said, "line"]);
    }
}

/// Links that hang by fixed joints can be taxels, those of others and of each other too: then on the link above.
#[test]
fn links_give_taxels() {
    let mut elements =
        link("a", BALL) + &link("b", BALL) + &joint("a", "b", "revolute", "<origin xyz='0 0 5'/>");
    let mut taxel = |parent: &str, name: &str, kind: &str, more: &str| {
        elements += &format!("<link name='{name}'/>{}", joint(parent, name, kind, more));
    };
    for (k, at) in ["0 0 0", "0.01 0 0", "0 0.01 0"].iter().enumerate() {
        taxel(
            "b",
            &format!("skin_{k}"),
            "fixed",
            &format!("<origin xyz='{at}' rpy='0 1.5707963267948966 0'/>"),
        );
    }
    taxel("skin_1", "skin_up", "fixed", "<origin xyz='0 0.02 0.03'/>");
    taxel("a", "skin_moved", "prismatic", "");
    let folder = robot(&elements);
    let path = folder.path().join("r.urdf");
    let mut robot = read_robot(&path).unwrap();
    assert_eq!(robot.add_taxels(|name| name.starts_with("skin_")), 4);
    let [sheet] = &robot.sensors[..] else { panic!("{} sheets", robot.sensors.len()) };
    assert_eq!((&*sheet.name, sheet.link), ("b", Some(LinkId::new(1))));
    assert_eq!(sheet.ids.as_deref(), Some(&[1, 2, 3, 4].map(TaxelId)[..]), "in the order of the links");
    let expected = [DVec3::ZERO, DVec3::X * 0.01, DVec3::new(0.04, 0.02, 0.0), DVec3::Y * 0.01];
    assert!(
        sheet.positions.iter().zip(expected).all(|(p, q)| p.abs_diff_eq(q, 1e-12)),
        "{:?}",
        sheet.positions
    );
    let (normals, tangents) = (sheet.normals.as_ref().unwrap(), sheet.tangents.as_ref().unwrap());
    assert!(normals.iter().all(|n| n.abs_diff_eq(DVec3::X, 1e-12)), "{normals:?}");
    assert!(tangents.iter().all(|t| t.abs_diff_eq(-DVec3::Z, 1e-12)), "{tangents:?}");
    let run = dermatome(folder.path(), "info r.urdf --taxels skin_? --json").assert().success();
    let info = json(&run.get_output().stdout);
    assert_eq!((&info["patches"][0]["name"], &info["patches"][0]["vertices"]), (&"b".into(), &3.into()));
    refuses(folder.path(), "info r.urdf --taxels skin_moved", &["skin_moved", "fixed joint"]);
    refuses(folder.path(), "info r.urdf --taxels skin_? --mesh visual", &["--mesh"]);
}

/// A robot without shapes lists its links, and has no skin.
#[test]
fn robots_without_shapes_are_listed() {
    let folder = robot(&format!("<link name='a'/><link name='b'/>{}", joint("a", "b", "floating", "")));
    let run = notes(folder.path(), "info r.urdf", &["nothing to make a skin of"]);
    assert!(String::from_utf8_lossy(&run.get_output().stdout).contains("floating"));
    let run = dermatome(folder.path(), "info r.urdf --json").assert().success();
    let info = json(&run.get_output().stdout);
    assert_eq!((info["links"].as_array().unwrap().len(), info["patches"].as_array().unwrap().len()), (2, 0));
    refuses(folder.path(), "build r.urdf -o out", &["<visual>, <collision> or <sensor>"]);
    refuses(folder.path(), "info r.urdf --joints to_b=1 --json", &["to_b", "floating"]);
    // Bullet's name of a ball joint.
    let folder = robot(&format!("<link name='a'/><link name='b'/>{}", joint("a", "b", "spherical", "")));
    let run = notes(folder.path(), "info r.urdf", &["nothing to make a skin of"]);
    assert!(String::from_utf8_lossy(&run.get_output().stdout).contains("ball"));
}

/// What is wrong is named with its line.
#[test]
fn bad_descriptions_are_refused_with_their_line() {
    let [a, b, c] = ["a", "b", "c"].map(|name| link(name, BALL));
    let mimic = |of: &str| format!("<mimic joint='to_{of}'/>");
    let cases: &[(String, &[&str])] = &[
        (format!("{a}{b}"), &["line 3", "hang by no joint", "\"a\", \"b\""]),
        (format!("{a}{a}"), &["line 3", "the name of line 2 again"]),
        (
            format!("{a}{b}{}{}", joint("a", "b", "fixed", ""), joint("a", "b", "fixed", "")),
            &["line 5", "the name of line 4"],
        ),
        (
            format!("{a}{b}{c}{}{}", joint("b", "c", "fixed", ""), joint("c", "b", "fixed", "")),
            &["a circle", "\"b\"", "\"c\""],
        ),
        (format!("{a}{}", joint("a", "a", "fixed", "")), &["a circle", "\"a\""]),
        (
            format!(
                "{a}{b}{c}{}{}",
                joint("a", "c", "fixed", ""),
                joint("b", "c", "fixed", "").replace("to_c", "other")
            ),
            &["line 6", "to_c"],
        ),
        (format!("{a}{}", joint("a", "x", "fixed", "")), &["line 3", "no <link> of that name"]),
        (format!("{a}{b}{}", joint("a", "b", "screw", "")), &["line 4", "type=\"screw\"", "prismatic"]),
        (format!("{a}{b}{}", joint("a", "b", "revolute", "<axis xyz='0 0 0'/>")), &["a direction"]),
        (format!("{a}{b}{}", joint("a", "b", "revolute", "<axis xyz='0 0'/>")), &["3 finite numbers"]),
        (format!("{a}{b}{}", joint("a", "b", "revolute", "<origin xyz='0 0 nan'/>")), &["3 finite numbers"]),
        (format!("{a}{b}{}", joint("a", "b", "revolute", &mimic("b"))), &["follows itself"]),
        (
            format!(
                "{a}{b}{c}{}{}",
                joint("a", "b", "revolute", &mimic("c")),
                joint("b", "c", "revolute", &mimic("b"))
            ),
            &["follows itself"],
        ),
        (link("a", "<mesh filename='x.stl'/>"), &["line 2", "x.stl", "--without"]),
        (
            link("a", "<mesh filename='x.stl'/>")
                + &solid("b", "<box size='1 1 1'/>")
                + &joint("a", "b", "fixed", ""),
            &["line 2", "x.stl", "--mesh collision"],
        ),
        (
            link("a", "<mesh filename='x.stl'/>")
                + &solid("b", "<mesh filename='y.stl'/>")
                + &joint("a", "b", "fixed", ""),
            &["line 2", "x.stl", "--without"],
        ),
        (
            link("a", "<mesh filename='package://hand/x.stl'/>"),
            &["line 2", "no folder of that name", "--package hand=DIR"],
        ),
        (link("a", "<mesh filename='package://hand/../../x.stl'/>"), &["line 2", "not above it"]),
        (link("a", "<mesh filename='package://../x.stl'/>"), &["line 2", "not above it"]),
        (link("a", "<mesh filename='http://a.b/x.stl'/>"), &["package://NAME/PATH"]),
        (link("a", "<mesh filename='r.mesh'/>"), &["OGRE", "stl, obj, dae, ply"]),
        (link("a", "<mesh filename='r.msh'/>"), &["MuJoCo", "Gmsh", "stl, obj, dae, ply"]),
        (link("a", "<cylinder radius='0.1' length='1e308'/>"), &["line 2", "a shape of finite size"]),
        (String::new(), &["no <link>"]),
        ("<link/>".into(), &["an attribute name"]),
        ("<link name='${side}_arm'/>".into(), &["a macro of xacro", "xacrodoc"]),
        ("<x:include xmlns:x='http://ros.org/wiki/xacro'/>".into(), &["a macro of xacro"]),
        ("<x:arm xmlns:x='http://ros.org/wiki/xacro'/>".into(), &["a macro of xacro"]),
        ("<link".into(), &["line"]),
    ];
    for (elements, said) in cases {
        let folder = robot(elements);
        fs::write(folder.path().join("r.mesh"), "x").unwrap();
        fs::write(folder.path().join("r.msh"), "x").unwrap();
        refuses(folder.path(), "build r.urdf -o out", said);
    }
    let folder = tempfile::tempdir().unwrap();
    let bomb = "<!DOCTYPE r [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;'>]><robot name='&b;'/>";
    for (text, said) in [(bomb, "DTD"), ("<sdf/>", "<robot>"), ("", "bytes"), ("\u{1}", "line 1")] {
        fs::write(folder.path().join("r.urdf"), text).unwrap();
        refuses(folder.path(), "build r.urdf -o out", &[said]);
    }
}

/// Packages are found above the file, in the paths of the environment, and where the option says.
#[test]
fn packages_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let ball = Skin::from_mesh("ball", shapes::ball(4, 0.1));
    for place in ["hand/meshes", "hand/urdf", "other/share/arm", "elsewhere"] {
        fs::create_dir_all(here.join(place)).unwrap();
    }
    write_skin(&here.join("hand/meshes/m.stl"), &ball).unwrap();
    write_skin(&here.join("other/share/arm/m.stl"), &ball).unwrap();
    write_robot(&here.join("hand/urdf"), &link("a", "<mesh filename='package://hand/meshes/m.stl'/>"));
    dermatome(here, "info hand/urdf/r.urdf").assert().success();
    dermatome(here.join("hand/urdf"), "info r.urdf").assert().success();
    write_robot(here, &link("a", "<mesh filename='package://arm/m.stl'/>"));
    refuses(here, "build r.urdf -o out", &["--package arm=DIR"]);
    dermatome(here, "info r.urdf --package arm=other/share/arm").assert().success();
    dermatome(here, "info r.urdf").env("ROS_PACKAGE_PATH", here.join("other/share")).assert().success();
    dermatome(here, "info r.urdf").env("AMENT_PREFIX_PATH", here.join("other")).assert().success();
    refuses(here, "build r.urdf -o out --package arm=elsewhere", &["looked for in: elsewhere"]);
    refuses(here, "info r.urdf --package arm", &["NAME=DIR"]);
    refuses(here, "info r.urdf --package arm=nowhere", &["is no folder"]);
    fs::copy(here.join("hand/meshes/m.stl"), here.join("m.stl")).unwrap();
    write_robot(here, &link("a", "<mesh filename='package://m.stl'/>"));
    dermatome(here, "info r.urdf").assert().success();
    let file = here.join("hand/meshes/m.stl");
    write_robot(here, &link("a", &format!("<mesh filename='file://{}'/>", file.display())));
    dermatome(here, "info r.urdf").assert().success();
    write_robot(&here.join("hand/urdf"), &link("a", "<mesh filename='hand/meshes/m.stl'/>"));
    dermatome(here, "info hand/urdf/r.urdf").assert().success();
    refuses(here, "info hand/meshes/m.stl --links a", &["a .urdf"]);
}

/// The arm of `meshes/` builds, one patch for each shape of the links that are chosen, and lists its links.
#[test]
fn a_robot_builds_and_lists_its_links() {
    let folder = tempfile::tempdir().unwrap();
    let arm = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/arm.urdf");
    fs::copy(arm, folder.path().join("arm.urdf")).unwrap();
    let run = dermatome(folder.path(), "info arm.urdf --json").assert().success();
    let info = json(&run.get_output().stdout);
    assert_eq!(info["links"].as_array().unwrap().len(), 7);
    assert_eq!(info["joints"][4]["mimic"]["joint"], "grip");
    assert_eq!(info["patches"].as_array().unwrap().len(), 8);
    dermatome(folder.path(), "build arm.urdf -o out --links f* --links thumb").assert().success();
    let map = dermatome::read_map(&folder.path().join("out/map.glb")).unwrap();
    let names: Vec<&str> = map.patches.iter().map(|patch| &*patch.name).collect();
    assert_eq!(names, ["forearm", "finger.1", "finger.2", "thumb.1", "thumb.2"]);
    assert_eq!(map.links.len(), 7, "links without skin are kept");
    dermatome(folder.path(), "info arm.urdf --mesh collision --links base").assert().success();
    refuses(folder.path(), "info arm.urdf --links wrist", &["wrist", "dermatome info"]);
    refuses(folder.path(), "info arm.urdf --mesh sensors", &["<sensor> with <tactile>"]);
    write_robot(folder.path(), &link("a", "<box size='200 100 100'/>"));
    notes(folder.path(), "info r.urdf", &["in millimetres?", "scale=\"0.001 0.001 0.001\""]);
    let lost = format!(
        "{}{}{}",
        link("a", BALL),
        link("b", BALL),
        joint("a", "b", "revolute", "<mimic joint='x'/>")
    );
    write_robot(folder.path(), &lost);
    notes(folder.path(), "info r.urdf", &["to_b: it follows a joint \"x\" that is not there"]);
}

/// A chain and a star of 100,000 links are read one link at a time.
#[test]
fn huge_robots_are_read() {
    for is_chain in [false, true] {
        let mut text = link("l0", BALL);
        for k in 1..100_000 {
            let parent = format!("l{}", if is_chain { k - 1 } else { 0 });
            write!(text, "<link name='l{k}'/>").unwrap();
            text += &joint(&parent, &format!("l{k}"), "revolute", "");
        }
        let folder = robot(&text);
        assert_eq!(read_robot(&folder.path().join("r.urdf")).unwrap().links.len(), 100_000);
        assert_eq!(draft_of(folder.path()).sheets.len(), 1);
    }
}

/// The arm of `meshes/` in a folder, with the map of the skin of some links.
fn arm(links: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let arm = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/arm.urdf");
    fs::copy(arm, folder.path().join("arm.urdf")).unwrap();
    dermatome(folder.path(), &format!("build arm.urdf -o out --links {links}")).assert().success();
    folder
}

/// Joints turn and slide along their axes in the frame of their links; followers follow, whatever is given.
#[test]
fn joint_values_pose_the_links() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/arm.urdf");
    let robot = read_robot(&path).unwrap();
    let place = |name: &str| robot.joints.iter().position(|joint| joint.name == name).unwrap();
    let given = [("shoulder", 0.5), ("elbow", 1.0), ("wrist", -2.0), ("grip", 0.02), ("grip_thumb", 9.0)];
    let values = robot.joint_values(&given.map(|(name, value)| (place(name), value)));
    assert_eq!(values[place("grip_thumb")], -0.02);
    let turn = |about: DVec3, angle: f64| DAffine3::from_quat(DQuat::from_axis_angle(about, angle));
    let up = |z: f64| DAffine3::from_translation(DVec3::Z * z);
    let hand = up(0.06)
        * turn(DVec3::Y, 0.5)
        * up(0.26)
        * turn(DVec3::Y, 1.0)
        * up(0.21)
        * turn(DVec3::Z, 0.3 - 2.0);
    let finger = hand * DAffine3::from_translation(DVec3::new(0.03, 0.0, 0.06));
    let thumb = hand * DAffine3::from_translation(DVec3::new(-0.03, 0.0, 0.06));
    let poses = robot.poses(&values);
    for (name, expected) in [("hand", hand), ("finger", finger), ("thumb", thumb), ("tool", hand * up(0.1))] {
        let (_, pose) = robot.links.iter().zip(&poses).find(|(link, _)| link.name == name).unwrap();
        assert!(pose.abs_diff_eq(expected, 1e-14), "{name}: {pose}, not {expected}");
    }
    let beyond: Vec<&str> = robot.beyond_limits(&values).map(|(joint, _)| &*joint.name).collect();
    assert!(beyond.is_empty(), "{beyond:?}");
    let values = robot.joint_values(&[(place("elbow"), -1.0), (place("wrist"), 100.0)]);
    let beyond: Vec<&str> = robot.beyond_limits(&values).map(|(joint, _)| &*joint.name).collect();
    assert_eq!(beyond, ["elbow"], "the wrist has no limits");
}

/// A contact at a place of a link that moved is found there, and frames of links without skin are frames too.
#[test]
fn contacts_are_found_on_a_robot_that_moves() {
    let folder = arm("forearm --links hand");
    let run =
        dermatome(folder.path(), "info arm.urdf --joints shoulder=0.5,elbow=1 --json").assert().success();
    let info = json(&run.get_output().stdout);
    let forearm = info["links"].as_array().unwrap().iter().find(|link| link["name"] == "forearm").unwrap();
    let numbers =
        |key: &str| forearm[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>();
    let pose = DAffine3::from_rotation_translation(
        DQuat::from_slice(&numbers("rotation")),
        DVec3::from_slice(&numbers("position")),
    );
    let p = pose.transform_point3(DVec3::new(0.0, 0.03, 0.1));
    fs::write(folder.path().join("world.csv"), format!("x,y,z,time\n{},{},{},3\n", p.x, p.y, p.z)).unwrap();
    fs::write(folder.path().join("tool.csv"), "x,y,z,link\n0,0,-0.04,tool\n").unwrap();
    fs::write(folder.path().join("q.csv"), "time,elbow,shoulder,battery\n2,0,0,1\n4,2,1,1\n").unwrap();
    let nearest = |words: &str| {
        let run = dermatome(folder.path(), words).assert().success();
        let text = String::from_utf8(run.get_output().stdout.clone()).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let names = lines.next().unwrap();
        let row = lines.next().unwrap();
        let of = |name: &str| row[names.iter().position(|n| n == name).unwrap()].clone();
        (of("patch"), of("distance").parse::<f64>().unwrap())
    };
    for words in ["--joints shoulder=0.5,elbow=1", "--joints q.csv"] {
        let (patch, distance) =
            nearest(&format!("lookup out/map.glb world.csv -o - --pose arm.urdf {words}"));
        assert!(patch == "forearm" && distance.abs() < 1e-4, "{words}: {patch} at {distance} m");
    }
    for words in ["", "--pose arm.urdf --joints elbow=2,wrist=1"] {
        let (patch, distance) = nearest(&format!("lookup out/map.glb tool.csv -o - {words}"));
        assert!(patch == "hand" && distance.abs() < 1e-6, "{words}: {patch} at {distance} m");
    }
    let lookup = "lookup out/map.glb world.csv -o -";
    notes(folder.path(), &format!("{lookup} --pose arm.urdf --joints q.csv"), &["`battery` is not used"]);
    notes(
        folder.path(),
        &format!("{lookup} --pose arm.urdf --joints elbow=9"),
        &["beyond the limits", "`elbow`"],
    );
    refuses(folder.path(), &format!("{lookup} --pose arm.urdf --joints knee=1"), &["knee", "dermatome info"]);
    refuses(folder.path(), &format!("{lookup} --pose arm.urdf --joints grip_thumb=1"), &["grip_thumb"]);
    refuses(folder.path(), &format!("{lookup} --pose arm.urdf --joints elbow=x"), &["NAME=VALUE"]);
    refuses(folder.path(), &format!("{lookup} --joints elbow=1"), &["--pose"]);
    for (table, said) in [
        ("a,b\n1,2\n", "as shoulder"),
        ("elbow\n1\n2\n", "a column `time`"),
        ("elbow\n", "no row"),
        ("elbow\nnan\n", "finite"),
    ] {
        fs::write(folder.path().join("bad.csv"), table).unwrap();
        refuses(folder.path(), &format!("{lookup} --pose arm.urdf --joints bad.csv"), &[said]);
    }
}

/// What lies within a link is left out, and the rest meshed anew.
#[test]
fn the_outside_is_meshed_anew() {
    let folder = robot(
        "<link name='a'><visual><geometry><cylinder radius='0.1' length='0.3'/></geometry></visual>\
         <visual><geometry><sphere radius='0.05'/></geometry></visual>\
         <visual><origin xyz='0 0 0.5'/><geometry><sphere radius='0.001'/></geometry></visual></link>",
    );
    let words = "info r.urdf --outer --spacing 1cm --json";
    let run = notes(folder.path(), words, &["not seen from outside, and left out", "`a.3`", "10 mm apart"]);
    let info = json(&run.get_output().stdout);
    let patches = info["patches"].as_array().unwrap();
    assert_eq!(patches.len(), 1, "{patches:?}");
    let spacing = patches[0]["spacing_mm"].as_f64().unwrap();
    assert!((spacing / 10.0 - 1.0).abs() < 0.03, "{spacing} mm");
    let two = link("a", BALL) + &link("hand", BALL) + &joint("a", "hand", "fixed", "");
    write_robot(folder.path(), &two);
    for words in ["h*=5mm,2cm", "2cm,hand=5mm", "hand=5mm,*a*=2cm"] {
        let words = format!("info r.urdf --spacing {words} --json");
        let run = notes(folder.path(), &words, &["5 to 20 mm apart"]);
        let patches = json(&run.get_output().stdout)["patches"].clone();
        let spacing = |k: usize| patches[k]["spacing_mm"].as_f64().unwrap();
        assert!((spacing(0) / 20.0 - 1.0).abs() < 0.1 && (spacing(1) / 5.0 - 1.0).abs() < 0.03, "{patches}");
    }
    refuses(folder.path(), "info r.urdf --spacing hand=5mm", &["the link a", "for all others"]);
    refuses(folder.path(), "info r.urdf --spacing foot=5mm,1cm", &["foot", "dermatome info"]);
    refuses(folder.path(), "info r.urdf --spacing 5mm,1cm", &["one length without a name"]);
    refuses(folder.path(), "info r.urdf --spacing hand=,1cm", &["above 0"]);
    refuses(folder.path(), "info r.urdf --spacing 10m", &["smaller --spacing"]);
    refuses(folder.path(), "info r.urdf --spacing 1e-9", &["change --spacing"]);
    refuses(folder.path(), "info r.urdf --spacing 0", &["above 0"]);
}

/// Small pieces of a link are left out with one note, and those of other files are not.
#[test]
fn crumbs_of_links_are_left_out() {
    let ball = |x: f64, radius: f64| {
        format!("<visual><origin xyz='{x} 0 0'/><geometry><sphere radius='{radius}'/></geometry></visual>")
    };
    let collision = "<collision><geometry><sphere radius='0.1'/></geometry></collision>";
    let shapes = [(0.0, 0.1), (0.5, 0.001), (0.7, 0.02)].map(|(x, radius)| ball(x, radius)).concat();
    let folder = robot(&format!("<link name='a'>{shapes}{collision}</link>"));
    for (words, names, note) in [
        (
            "",
            &["a.1", "a.3"][..],
            "left out, 1 of 3: `a.2`; --least-area 0 keeps them; --mesh collision has 1 shape",
        ),
        ("--least-area 0", &["a.1", "a.2", "a.3"], ""),
        ("--least-area 10%", &["a.1"], "left out, 2 of 3: `a.2`, `a.3`;"),
        ("--spacing 3cm", &["a.1"], "left out, 2 of 3: `a.2`, `a.3`;"),
        ("--mesh collision", &["a"], ""),
    ] {
        let run = notes(folder.path(), &format!("info r.urdf --json {words}"), &[note]);
        let patches = json(&run.get_output().stdout)["patches"].clone();
        let found: Vec<&str> =
            patches.as_array().unwrap().iter().map(|p| p["name"].as_str().unwrap()).collect();
        assert_eq!(found, names, "{words}");
    }
    notes(folder.path(), "build r.urdf -o o --patch a.2", &["a.2"]);
    for words in ["--least-area 2", "--least-area -1%", "--least-area x"] {
        refuses(folder.path(), &format!("info r.urdf {words}"), &["a share from 0 to 1"]);
    }
    // Pieces of other CAD are left out where that is asked for: of two squares and a small one.
    let square = |x: f64, side: f64, first: u32| {
        let corners = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)];
        let corners: String = corners.iter().map(|(u, v)| format!("v {} {v} 0\n", x + u)).collect();
        format!("{corners}f {first} {} {} {}\n", first + 1, first + 2, first + 3)
    };
    let squares = square(0.0, 0.1, 1) + &square(0.2, 0.05, 5) + &square(0.3, 0.009, 9);
    fs::write(folder.path().join("t.obj"), squares).unwrap();
    for (words, pieces, note) in [
        ("", 3, ""),
        ("--least-area 1%", 2, "small pieces are left out, 1 of 3"),
        ("--least-area 50%", 1, "2 of 3"),
    ] {
        let run = notes(folder.path(), &format!("info t.obj --json {words}"), &[note]);
        assert_eq!(json(&run.get_output().stdout)["patches"].as_array().unwrap().len(), pieces, "{words}");
    }
}

/// A box and a direction choose faces, in the world or in the frame of a link.
#[test]
fn faces_are_chosen_in_the_frame_of_a_link() {
    let turned = "<origin xyz='1 0 0' rpy='0 1.5707963267948966 0'/>";
    let folder = robot(&(link("a", BALL) + &link("b", BALL) + &joint("a", "b", "fixed", turned)));
    let faces = |words: &str| {
        dermatome(folder.path(), &format!("convert r.urdf o.off {words}")).assert().success();
        read_draft(&folder.path().join("o.off")).unwrap().sheets.remove(0)
    };
    let all = faces("").triangles.len();
    for (words, same) in [
        ("--facing x,40", "--facing b:z,40deg"),
        ("--facing 1,0,0", "--facing b:0,0,1,60"),
        ("--box 1,-1,-1,2,1,1", "--box b:-1,-1,0,1,1,1"),
    ] {
        let found = faces(words);
        assert_eq!(found, faces(same), "{words}");
        assert!(!found.triangles.is_empty() && 3 * found.triangles.len() < all, "{words}");
    }
}

/// What the skin does not need stops nothing: it is left out with a note.
#[test]
fn what_the_skin_does_not_need_stops_nothing() {
    let two = |shape: &str, more: &str| {
        format!("{}{}{}", link("a", BALL), link("b", shape), joint("a", "b", "revolute", more))
    };
    for (elements, note) in [
        (two("<mesh filename='none.stl'/>", ""), "none.stl"),
        (two("<mesh filename='none.mesh'/>", ""), "none.mesh"),
        (two("<ellipsoid size='1 1 1'/>", ""), "capsule or sphere"),
        (two("<box size='0 1 1'/>", ""), "three lengths"),
        (two(BALL, "<limit lower='1' upper='-1'/>"), "lower limits below"),
        (two("<capsule radius='0.1' length='0.2'/>", "<mimic joint='x'/>"), "not there"),
    ] {
        let folder = robot(&elements);
        notes(folder.path(), "info r.urdf", &[note]);
    }
    let folder = robot(&two("<mesh filename='none.stl'/>", ""));
    notes(folder.path(), "info r.urdf --without b --quiet", &[]);
    refuses(folder.path(), "build r.urdf -o o --without a", &["none.stl", "--without"]);
    notes(folder.path(), "info r.urdf --without a", &["no skin is read", "none.stl"]);
    refuses(folder.path(), "info r.urdf --without c", &["c in --without"]);
    let late = format!("<!-- made by -->\n<?xml version='1.0'?><robot name='r'>{}</robot>", link("a", BALL));
    fs::write(folder.path().join("late.urdf"), late.replace("by", "b\u{e9}")).unwrap();
    read_robot(&folder.path().join("late.urdf")).unwrap();
    fs::write(folder.path().join("late.urdf"), [late.as_bytes(), b"<!-- \xff -->"].concat()).unwrap();
    read_robot(&folder.path().join("late.urdf")).unwrap();
    fs::write(folder.path().join("late.urdf"), [late.as_bytes(), b"\r\n\0"].concat()).unwrap();
    read_robot(&folder.path().join("late.urdf")).unwrap();
}

/// Commas may end numbers, as in the descriptions that Bullet comes with.
#[test]
fn commas_after_numbers_separate_them() {
    let placed = |at: &str| {
        let box_at = link("b", "<box size='1, 1, 1'/>");
        robot(&format!(
            "{}{box_at}{}",
            link("a", BALL),
            joint("a", "b", "fixed", &format!("<origin xyz='{at}'/>"))
        ))
    };
    let [plain, commas] = ["0.07 0 -0.69", "0.07, 0,  -0.69"].map(placed);
    assert_eq!(draft_of(plain.path()).links, draft_of(commas.path()).links);
    for wrong in ["0,07 0 -0.69", "0.07,0,-0.69", ", 0 1 2"] {
        refuses(placed(wrong).path(), "info r.urdf", &["3 finite numbers", wrong]);
    }
}

/// A joint that follows another with an offset rests there in the skin, too.
#[test]
fn joints_that_follow_rest_at_their_offset() {
    let folder = robot(&format!(
        "{}{}{}{}{}",
        link("a", BALL),
        link("b", BALL),
        link("c", BALL),
        joint("a", "b", "continuous", "<axis xyz='0 0 1'/>"),
        joint("b", "c", "continuous", "<axis xyz='0 0 1'/><mimic joint='to_b' offset='0.2'/>"),
    ));
    let pose = world_pose(&draft_of(folder.path()).links, LinkId::new(2));
    assert!(pose.abs_diff_eq(DAffine3::from_rotation_z(0.2), 1e-15), "{pose}");
}

/// Bodies, classes, included files, frames and geoms of `MuJoCo`.
#[test]
fn models_of_mujoco_are_robots() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.xml");
    let model = "<mujoco model='m'><compiler autolimits='false'/><default><default class='x'>\
        <joint type='slide' axis='0 1 0' ref='0.5'/><geom type='box' size='1 2 3' contype='0' conaffinity='0'/>\
        </default></default><worldbody><geom type='plane' size='1 1 1'/><include file='b.xml'/></worldbody></mujoco>";
    let body = "<mujocoinclude><body name='b' childclass='x' pos='1 0 0'><joint name='s'/>\
        <joint name='h' class='main' pos='0 0 1' axis='1 0 0' range='-90 90' limited='true'/>\
        <frame pos='0 0 2'><geom/><geom class='main' group='3' size='0.5'/></frame>\
        <geom class='main' type='capsule' fromto='0 0 0 0 0 4' size='0.5'/></body></mujocoinclude>";
    fs::write(&path, model).unwrap();
    fs::write(folder.path().join("b.xml"), body).unwrap();
    let robot = read_robot(&path).unwrap();
    let names: Vec<&str> = robot.links.iter().map(|link| &*link.name).collect();
    assert_eq!(names, ["world", "b/s", "b"]);
    assert_eq!(robot.joints[1].limits, Some([-1.0, 1.0].map(|x| x * std::f64::consts::FRAC_PI_2)));
    let pose = robot.poses(&[0.75, std::f64::consts::FRAC_PI_2])[LinkId::new(2)];
    assert!(
        pose.transform_point3(DVec3::Z).abs_diff_eq(DVec3::new(1.0, 0.25, 1.0), 1e-12),
        "the anchor stays"
    );
    assert!(pose.transform_vector3(DVec3::Y).abs_diff_eq(DVec3::Z, 1e-12));
    let of = |surface| robot_draft(&path, &robot, surface, &Packages::default()).unwrap().sheets.len();
    assert_eq!((of(RobotSurface::Visual), of(RobotSurface::Collision)), (1, 2), "the box alone is only seen");
    for (elements, found) in [
        ("<worldbody><replicate count='2'/></worldbody>", "makes bodies"),
        ("<compiler coordinate='global'/><worldbody/>", "global"),
        ("<worldbody><include file='r.xml'/><include file='r.xml'/></worldbody>", "again"),
        ("<worldbody><body><geom type='mesh' mesh='m'/></body></worldbody>", "no <mesh>"),
        ("<worldbody/>", "no <body>"),
    ] {
        fs::write(&path, format!("<mujoco>{elements}</mujoco>")).unwrap();
        let error = read_robot(&path).unwrap_err().to_string();
        assert!(error.contains(found), "{error}");
    }
}

/// Definitions of xacro that nothing uses are passed over with one note.
#[test]
fn definitions_that_nothing_uses_are_not_read() {
    let definitions = "<x:property xmlns:x='http://ros.org/wiki/xacro' name='width' value='.2'/>\
                       <x:macro xmlns:x='http://ros.org/wiki/xacro' name='m' params='p'><link name='${p}'/></x:macro>";
    let folder = robot(&(definitions.to_owned() + &link("a", BALL)));
    notes(folder.path(), "info r.urdf", &["2 definitions of xacro are not used"]);
}

/// A joint of a model follows another one as its equality says, from the pose of the file; what is not linear is noted.
#[test]
fn coupled_joints_of_mujoco_follow() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hand.xml");
    let body = |name: &str, joint: &str| {
        format!("<body name='{name}'><joint name='{joint}' ref='{}'/><geom size='1'/></body>", 30)
    };
    let bodies: String =
        [("a", "lead"), ("b", "half"), ("c", "square"), ("d", "off")].map(|(b, j)| body(b, j)).concat();
    let equalities = "<joint joint1='half' joint2='lead' polycoef='0.1 0.5 0 0 0'/>\
                      <joint joint1='square' joint2='lead' polycoef='0 0 1 0 0'/>\
                      <joint joint1='off' joint2='lead' active='false'/><joint joint1='lead' joint2='half'/>";
    let text = format!("<mujoco><worldbody>{bodies}</worldbody><equality>{equalities}</equality></mujoco>");
    fs::write(&path, &text).unwrap();
    let robot = read_robot(&path).unwrap();
    let values = robot.joint_values(&[(0, 1.0)]);
    let rest = 30.0_f64.to_radians();
    assert!((values[1] - (rest + 0.1 + 0.5 * (1.0 - rest))).abs() < 1e-12, "{values:?}");
    assert_eq!(values[2..], [0.0, 0.0]);
    let said: Vec<String> = robot.remarks.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].contains("square is not followed: it is not linear"), "{said:?}");
    assert!(said[1].contains("lead is not followed: it would follow itself"), "{said:?}");
    fs::write(&path, text.replace("joint2='half'", "joint2='none'")).unwrap();
    assert!(read_robot(&path).unwrap_err().to_string().contains("joint2 of no joint"));
}
