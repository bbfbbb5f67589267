//! Valid files of every kind that is read: what the library writes, and short ones of the other kinds.

use std::io::{Cursor, Write};
use std::path::Path;
use std::{error::Error, fs};

use dermatome::calib::{Model, SimulateOptions, simulate};
use dermatome::mesh::shapes;
use dermatome::{BuildOptions, Skin, build, io};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// Files as they are. The beginning of a name says what reads it.
#[rustfmt::skip]
const TEXTS: [(&str, &str); 37] = [
    ("acuities.csv", "id,acuity\n1,2\n2,0.5\n"),
    ("boundary.csv", "id,x,y\n1,0,0\n2,1,0\n3,0,1\n"),
    ("contacts.csv", "x,y,z,nx,ny,nz,force,time\n0,0,0.01,0,0,1,2.5,0\n0.02,0,0,0,0,1,1,0.1\n"),
    ("contacts.link.csv", "link,x,y,z,radius\nbase,0,0,0.01,0.002\n,0.02,0,0,0\n"),
    ("gains.csv", "id,gain\n1,2.5\n2,0.5\n"),
    ("joints.csv", "time[ms],shoulder,elbow\n0,0.1,0.2\n10,0.2,-0.3\n"),
    ("motion.csv", "link,time,x,y,z,qx,qy,qz,qw\nbase,0,0,0,0,0,0,0,1\nbase,1,0.1,0,0,0,0,0.6,0.8\n"),
    ("places.csv", "patch,level,u,v\ncap,0,0.001,0.002\ncap,1,0,0\n"),
    ("seams.csv", "from,to\n7,8\n8,9\n"),
    ("triangles.csv", "row0,row1,row2\n0,1,6\n0,6,5\n1,2,7\n1,7,6\n"),
    ("truth.csv", "id,x,y,z\n0,0,0,0\n1,0.01,0,0\n"),
    ("readings.csv", "time,1.force[N],2.force[N],1.t[K],2.t[K]\n0,0.5,,1,2\n0.1,1,nan,3,4\n0.2,2,1e-3,-5,6\n"),
    ("readings.decimal.csv", "time[ms];1;2\n0;0,5;1\n10;1,5;2\n"),
    ("readings.long.csv", "time,taxel_id,value[Pa]\n0,1,0.5\n0,2,1.5\n0.1,1,0.7\n0.1,2,0.1\n"),
    ("readings.dates.csv", "time,1,2\n2024-01-02T03:04:05.5Z,1,2\n2024-01-02T03:04:06Z,3,4\n"),
    ("readings.txt", "1 2 3\n0 0.0 0.5 1 2\n1 0.1 0.6 1 2\n2 0.2 0.7 nan 2\n"),
    ("readings.log", "0 1700000000.5 1 2 3\n1 1700000000.6 1 2 4\n2 1700000000.7 0 2 5\n"),
    ("recording.asf", "DATA_TYPE MOVIE\nROWS 2\nCOLS 3\nROW_SPACING 5 mm\nCOL_SPACING 5 mm\nSECONDS_PER_FRAME 0.1\nSTART_FRAME 1\nEND_FRAME 2\n\
      UNITS raw\nASCII_DATA @@\n\nFrame 1,0,,,Raw Sum=,,15\nB,1,2\n3,4,5\n\nFrame 2,0.1,,,Raw Sum=,,5\nB,1,1\n1,1,1\n@@\n"),
    ("recording.lst", "\t\tPage 1\n\tSensor area: 1 cm2\tTime/picture:10.0 ms\n\tSensor size: 1.0x1.0 cm\n\tPict-No.: 1 x\n\t26\t27\tForce\n\
      30\t1\t2\t0.3\nForce\t0.1\t0.2\t0.3\n\u{c}\tPage 2\n\tPict-No.: 2\n\t26\t27\tForce\n30\t0\t1\t0.1\nForce\t0\t0.1\t0.1\n"),
    ("recording.asc", "file name: a\nmat type s\ntime per frame [secs]: 0.5 scanning rate [Hz]: 2\npressure values in kPa\ntime[secs] 4 9\n 5.0 1 2\n\
      \x20 5.5 0 1\n MPP 1 2\n time[secs] force[N] x y\n 5.0 0.5 0 0\n 5.5 0.2 0 0\nsensor 4 9\nx[c] 0 1\ny[c] 0 0\narea 1 2\n"),
    ("recording.pedar.asc", "file name:  a.sol\tdate/time 1\nsensor type:  y-1\ntotal time [secs]: 0.02\ttime per frame [secs]: 0.01\t\
      scanning rate [Hz]: 100\npressure values in kPa\nleft insole: 1,2,\nright insole: 1,2,\n\ntime[secs]\t1\t2\t1\t2\n\
      \x20 0.01\t1\t2\t3\t4\n  0.02\t0\t2\t5\t4\n"),
    ("recording.xsensor.csv", "File:,\"walk.XSN\",,\n,,,\nUnits:,kPa,,\n,,,\nThreshold:,1\nFRAME,5\n,,,\nDate, 2026 Jan 31\nTime, 23:59:59.1\n,,,\n\
      SENSOR,left\n,,,\nRows,2\nColumns,2\nSensel Width (cm),1\nSensel Height (cm),1\nEst. Load (N),1\n,,,\nSENSELS\n,,,\n1,2,,\n,,,\n3,4,,\n,,,\n\
      Name,Heel\nCells,2\nEst. Load (N),99\nFRAME,6\n,,,\nDate, 2026 Jan 31\nTime, 23:59:59.3\n,,,\nSENSOR,left\n,,,\nRows,2\nColumns,2\n\
      Sensel Width (cm),1\nSensel Height (cm),1\nEst. Load (N),0.9\n,,,\nSENSELS\n,,,\n1,2,,\n,,,\n3,3,,\n,,,\n"),
    ("recording.stappone.csv", "sole_id,timestamp,accel_x,pressure_01,pressure_02,corrupt\n1,1768494979568,0,350,474,0\n\
      1,1768494979584,0,351,474,1\n1,1768494979600,0,352,474,0\n"),
    ("recording.jsonl", "{\"message\": \"Welcome\"}\n{\"message\": 7, \"time\": 1.5, \"1\": {\"data\": \"8000,80FF,6000\", \"taxels\": 1, \"model\": \"XR\"}}\n\
      {\"message\": 8, \"time\": 1.6, \"1\": {\"data\": \"8000,80FF,6009\", \"taxels\": 1, \"model\": \"XR\"}}\n"),
    ("recording.log", "0 1700000000.5 240 240 240\n1 1700000000.6 240 230 240\n2 1700000000.7 0 2 5\n"),
    ("layout.grid.json", "{\"dermatome_layout\": 1, \"axes\": [\"frame\", \"row\", \"col\"], \"time\": {\"rate\": 10}, \"channels\": [{\"name\": \
      \"pressure\", \"unit\": \"count\"}], \"press\": \"raises\", \"zero\": 0, \"taxels\": {\"shape\": [2, 3], \"first_id\": 1, \"flip\": [\"row\"]}}"),
    ("layout.xela.json", "{\"dermatome_layout\": 1, \"axes\": [\"frame\", \"taxel\", \"component\"], \"time\": {\"unit\": \"s\"}, \"channels\": \
      [{\"name\": \"normal\", \"unit\": \"count\", \"component\": 2}], \"press\": \"raises\", \"zero\": {\"first\": 1}, \"taxels\": {\"shape\": [1], \"first_id\": 0}}"),
    ("layout.ids.json", "{\"dermatome_layout\": 1, \"axes\": [\"frame\", \"taxel\"], \"time\": {\"unit\": \"s\", \"between\": [0.01, 10]}, \"channels\": \
      [{\"name\": \"p\", \"unit\": \"kPa\", \"scale\": 0.5}], \"press\": \"lowers\", \"zero\": 240, \"missing\": [-1], \"taxels\": {\"ids\": [3, 4, 9]}}"),
    ("layout.file.json", "{\"dermatome_layout\": 1, \"axes\": [\"frame\", \"taxel\"], \"time\": {\"stream\": \"timestamps\", \"unit\": \"s\"}, \"channels\": \
      [{\"name\": \"p\", \"unit\": \"count\"}], \"press\": \"raises\", \"zero\": {\"first\": 2}, \"taxels\": {\"ids\": \"file\"}}"),
    ("regions.csv", "taxel_id,region\n1,thumb\n2,thumb\n9,palm\n"),
    ("regions.json", "[{\"patch\": \"skin\", \"region\": \"left\", \"uv\": [[0, 0], [0.01, 0], [0.01, 0.01], [0, 0.01]]}]"),
    ("skin.txt", "name left\nspatial_sampling taxel\ntaxel2Repr ( 0 1 2 3 -1 -2 3 3 3 3 3 3 )\n[calibration]\n0 0 0 0 0 1\n0.01 0 0 0 0 1\n\
      0 0.01 0 0 0 1\n0.01 0.01 0 0 0 1\n0 0 0 0 0 0\n0.02 0 0 0 0 1\n0 0.02 0 0 0 1\n0.02 0.02 0 0 0 1\n0.03 0 0 0 0 1\n0.03 0.01 0 0 0 1\n\
      0.03 0.02 0 0 0 1\n0.03 0.03 0 0 0 1\n"),
    ("polygons.obj", "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .2 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3//1 4 5\ng b\nf -5 -4 -3\n"),
    ("polygons.off", "OFF\n5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n.5 .2 0\n5 0 1 2 3 4\n3 0 1 2 255 0 0\n"),
    ("text.stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"),
    ("text.ply", "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\nproperty uchar red\n\
      element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1\n1 0 0 2\n1 1 0 3\n0 1 0 4\n4 0 1 2 3\n"),
    ("part.dae", "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\">\n\
      <asset><unit meter=\"0.01\"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id=\"g\"><mesh><source id=\"p\">\n\
      <float_array id=\"a\" count=\"12\">0 0 0 1 0 0 1 1 0.2 0 1 0</float_array><technique_common><accessor source=\"#a\" count=\"4\" stride=\"3\"/></technique_common></source>\n\
      <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices><polylist count=\"1\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><vcount>4</vcount><p>0 1 2 3</p></polylist>\n\
      <triangles count=\"2\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><p>0 1 2 0 2 3</p></triangles></mesh></geometry></library_geometries>\n\
      <library_visual_scenes><visual_scene id=\"s\"><node id=\"n\"><translate>1 0 0</translate><rotate>0 0 1 90</rotate><instance_geometry url=\"#g\"/></node>\n\
      <node><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><scale>2 2 2</scale><instance_node url=\"#n\"/></node></visual_scene></library_visual_scenes>\n\
      <scene><instance_visual_scene url=\"#s\"/></scene></COLLADA>\n"),
];

/// What a seed could not be made for.
type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// The content of a `.npy`, of numbers of 64 bits.
fn npy(shape: &str, kind: &str, numbers: impl Iterator<Item = [u8; 8]>) -> Vec<u8> {
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    header.extend(std::iter::repeat_n(' ', 117 - header.len()));
    [&b"\x93NUMPY\x01\x00\x76\x00"[..], header.as_bytes(), b"\n"]
        .concat()
        .into_iter()
        .chain(numbers.flatten())
        .collect()
}

/// An archive of these members, uncompressed.
pub(crate) fn npz(members: &[(String, Vec<u8>)]) -> Result<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in members {
        archive
            .start_file(name, SimpleFileOptions::default().compression_method(CompressionMethod::Stored))?;
        archive.write_all(bytes)?;
    }
    Ok(archive.finish()?.into_inner())
}

/// Names and contents; some files are written into the folder and read back.
pub(crate) fn make(folder: &Path) -> Result<Vec<(String, Vec<u8>)>> {
    let mut all: Vec<_> =
        TEXTS.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect();
    let meshes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../meshes");
    all.push(("arm.urdf".into(), fs::read(meshes.join("arm.urdf"))?));
    all.push(("robot.xml".into(), fs::read(meshes.join("../tools/checks/robot.xml"))?));
    let skin = Skin::from_mesh("cap", shapes::cap(24, 0.02, 1.0));
    for kind in ["glb", "gltf", "json", "obj", "off", "ply", "stl"] {
        let name = format!("skin.{kind}");
        all.push((name.clone(), io::skin_to_bytes(name.as_ref(), &skin)?));
    }
    all.push(("map.glb".into(), io::map_to_bytes(&build(&skin, &BuildOptions::default())?)?));
    let mut written = |name: &str, write: &dyn Fn(&Path) -> Result<()>| {
        let path = folder.join(name);
        write(&path)?;
        all.push((name.into(), fs::read(path)?));
        Result::Ok(())
    };
    written("skin.csv", &|path| Ok(io::write_skin(path, &skin)?))?;
    let patch = skin.patches.iter().next().ok_or("a skin without patches")?;
    let flat = patch.mesh.positions.map(|p| p.truncate());
    written("flat.npz", &|path| Ok(io::write_flat(path, &patch.mesh, &flat)?))?;
    for (name, model) in
        [("graph.g2o", Model::Positions), ("graph.poses.g2o", Model::Poses), ("graph.csv", Model::Positions)]
    {
        let anchors = if name.ends_with("g2o") { 4 } else { 0 };
        let options =
            SimulateOptions { model, taxels: 14, anchors, normal_noise: None, ..SimulateOptions::default() };
        written(name, &|path| Ok(io::write_observations(path, &simulate(&options)?.observations)?))?;
    }
    let numbers = |count: i64| (0..count).map(|k| (k as f64 / 8.0).to_le_bytes());
    let ids = npy("(4,)", "<i8", (1..5_i64).map(i64::to_le_bytes));
    let values = npy("(3, 4)", "<f8", numbers(12));
    let times = npy("(3,)", "<f8", numbers(3));
    let members = [("values.npy", values), ("ids.npy", ids), ("timestamps.npy", times)]
        .map(|(name, data)| (name.to_owned(), data));
    all.push(("readings.npz".into(), npz(&members)?));
    all.push(("readings.npy".into(), npy("(2, 4, 3)", "<f8", numbers(24))));
    Ok(all)
}
