//! Sound files of every kind that the command reads, made by the command itself.

use std::{error::Error, fmt::Write as _, fs, path::Path, process::Command};

/// How the files are made of `cap.obj`, in the folder.
const STEPS: &[&str] = &[
    "convert cap.obj skin.glb",
    "convert cap.obj skin.gltf",
    "convert cap.obj skin.json",
    "convert cap.obj skin.ply",
    "convert cap.obj skin.stl",
    "convert cap.obj skin.off",
    "convert cap.obj skin.csv",
    "flatten cap.obj -o flat.npz -o flat.obj",
    "build cap.obj -o map",
    "simulate -o graph.g2o --taxels 25 --anchors 5",
    "simulate -o poses.g2o --taxels 20 --model poses --anchors 5",
    "simulate -o observations.csv --taxels 25",
    "touch cap.obj -o readings.csv --presses 1 --rate-hz 5",
    "render map/map.glb readings.csv -o readings.npz --to 2",
];

/// What is mutated.
const SEEDS: &[&str] = &[
    "cap.obj",
    "skin.glb",
    "skin.gltf",
    "skin.json",
    "skin.ply",
    "skin.stl",
    "skin.off",
    "skin.csv",
    "arm.urdf",
    "part.dae",
    "flat.npz",
    "flat.obj",
    "map.glb",
    "graph.g2o",
    "poses.g2o",
    "observations.csv",
    "readings.csv",
    "readings.npz",
    "contacts.csv",
    "seams.csv",
    "readings.asf",
    "readings.lst",
    "readings.asc",
    "readings.jsonl",
];

/// Recordings of other programs.
const RECORDINGS: [(&str, &str); 5] = [
    (
        "readings.asf",
        "DATA_TYPE MOVIE\nROWS 2\nCOLS 3\nROW_SPACING 5 mm\nCOL_SPACING 5 mm\nSECONDS_PER_FRAME 0.1\nSTART_FRAME 1\nEND_FRAME \
         2\nUNITS raw\nASCII_DATA @@\n\nFrame 1,0,,,Raw Sum=,,15\nB,1,2\n3,4,5\n\nFrame 2,0.1,,,Raw Sum=,,5\nB,1,1\n1,1,1\n@@\n",
    ),
    (
        "readings.lst",
        "\t\tPage 1\n\tSensor area: 1 cm2\tTime/picture:10.0 ms\n\tSensor size: 1.0x1.0 cm\n\tPict-No.: 1 \
         x\n\t26\t27\tForce\n30\t1\t2\t0.3\nForce\t0.1\t0.2\t0.3\n\u{c}\tPage 2\n\tPict-No.: 2\n\t26\t27\tForce\n30\t0\t1\t0.1\n\
         Force\t0\t0.1\t0.1\n",
    ),
    (
        "readings.asc",
        "file name: a\nmat type s\ntime per frame [secs]: 0.5 scanning rate [Hz]: 2\npressure values in kPa\ntime[secs] 4 9\n 5.0 1 \
         2\n 5.5 0 1\n MPP 1 2\n time[secs] force[N] x y\n 5.0 0.5 0 0\n 5.5 0.2 0 0\nsensor 4 9\nx[c] 0 1\ny[c] 0 0\narea 1 2\n",
    ),
    (
        "readings.jsonl",
        "{\"message\": \"Welcome\"}\n{\"message\": 7, \"time\": 1.5, \"1\": {\"data\": \"8000,80FF,6000\", \"taxels\": 1, \"model\": \
         \"XR\"}}\n{\"message\": 8, \"time\": 1.6, \"1\": {\"data\": \"8000,80FF,6009\", \"taxels\": 1, \"model\": \"XR\"}}\n",
    ),
    (
        "xela.json",
        "{\"dermatome_layout\": 1, \"axes\": [\"frame\", \"taxel\", \"component\"], \"time\": {\"unit\": \"s\"}, \"channels\": \
         [{\"name\": \"normal\", \"unit\": \"count\", \"component\": 2}], \"press\": \"raises\", \"zero\": {\"first\": 1}, \
         \"taxels\": {\"shape\": [1], \"first_id\": 0}}",
    ),
];

/// A robot of the project.
const ARM: &str = include_str!("../../../meshes/arm.urdf");

/// A bent plate of two triangles, used twice.
const PART: &str = r##"<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="a" count="12">0 0 0 1 0 0 1 1 0.2 0 1 0</float_array>
      <technique_common><accessor source="#a" count="4" stride="3"/></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 2 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s">
    <node id="n"><translate>1 0 0</translate><rotate>0 0 1 90</rotate><instance_geometry url="#g"/></node>
    <node><scale>2 2 2</scale><instance_node url="#n"/></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"##;

/// The name of a file and its content.
pub(crate) type Seed = (String, Vec<u8>);

/// Makes the files.
pub(crate) fn make_seeds(command: &Path, folder: &Path) -> Result<Vec<Seed>, Box<dyn Error>> {
    fs::write(folder.join("cap.obj"), cap()?)?;
    fs::write(
        folder.join("contacts.csv"),
        "x,y,z,nx,ny,nz,force,time\n0,0,0.01,0,0,1,2.5,0\n0.02,0,0,0,0,1,1,0.1\n",
    )?;
    fs::write(folder.join("arm.urdf"), ARM)?;
    fs::write(folder.join("part.dae"), PART)?;
    fs::write(folder.join("seams.csv"), "from,to\n40,41\n41,42\n")?;
    for (name, text) in RECORDINGS {
        fs::write(folder.join(name), text)?;
    }
    for step in STEPS {
        let words: Vec<&str> = step.split(' ').collect();
        let run = Command::new(command).args(&words).current_dir(folder).output()?;
        if !run.status.success() {
            return Err(format!("{step}: {}", String::from_utf8_lossy(&run.stderr)).into());
        }
    }
    fs::copy(folder.join("map/map.glb"), folder.join("map.glb"))?;
    SEEDS.iter().map(|name| Ok(((*name).to_owned(), fs::read(folder.join(name))?))).collect()
}

/// A curved sheet of 9 x 9 vertices with texture coordinates.
fn cap() -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    let places = || (0..81_i32).map(|k| (k % 9, k / 9));
    for (i, j) in places() {
        let (x, y) = (0.005 * f64::from(i - 4), 0.005 * f64::from(j - 4));
        writeln!(text, "v {x} {y} {}", -10.0 * (x * x + y * y))?;
    }
    for (i, j) in places() {
        writeln!(text, "vt {} {}", f64::from(i) / 8.0, f64::from(j) / 8.0)?;
    }
    for (i, j) in places().filter(|&(i, j)| i < 8 && j < 8) {
        let a = 9 * j + i + 1;
        let [a, b, c, d] = [a, a + 1, a + 10, a + 9].map(|v| format!("{v}/{v}"));
        writeln!(text, "f {a} {b} {c} {d}")?;
    }
    Ok(text)
}
