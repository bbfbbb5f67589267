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
const TEXTS: [(&str, &str); 24] = [
    ("acuities.csv", "id,acuity\n1,2\n2,0.5\n"),
    ("boundary.csv", "id,x,y\n1,0,0\n2,1,0\n3,0,1\n"),
    ("contacts.csv", "x,y,z,nx,ny,nz,force,time\n0,0,0.01,0,0,1,2.5,0\n0.02,0,0,0,0,1,1,0.1\n"),
    ("contacts.link.csv", "link,x,y,z,radius\nbase,0,0,0.01,0.002\n,0.02,0,0,0\n"),
    ("faces.txt", "0\n3\n7-9\n"),
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
