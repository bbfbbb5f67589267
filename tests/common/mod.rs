//! What both test programs share: the command, data from outside the repository, and small readers
//! and writers of its files.
#![allow(dead_code, reason = "each test program uses a part of it")]

use assert_cmd::assert::Assert;
use dermatome::id::VertexId;
use dermatome::io::Readings;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::signal::Channel;
use dermatome::skin::{Skin, TaxelId};
use std::path::{Path, PathBuf};
use std::{env, fs};

/// The command without arguments.
pub(crate) fn command() -> assert_cmd::Command {
    assert_cmd::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"))
}

/// The command in a folder, with words that a user would type.
pub(crate) fn dermatome(folder: impl AsRef<Path>, words: &str) -> assert_cmd::Command {
    let mut command = command();
    command.current_dir(folder).args(words.split_whitespace());
    command
}

/// The command in a folder, which refuses with exit code 2 and says all of this.
pub(crate) fn refuses(folder: impl AsRef<Path>, words: &str, said: &[&str]) -> Assert {
    says(dermatome(folder, words).assert().code(2), words, said)
}

/// The command in a folder, which succeeds and says all of this on standard error.
pub(crate) fn notes(folder: impl AsRef<Path>, words: &str, said: &[&str]) -> Assert {
    says(dermatome(folder, words).assert().success(), words, said)
}
fn says(run: Assert, words: &str, said: &[&str]) -> Assert {
    let found = String::from_utf8_lossy(&run.get_output().stderr);
    for part in said {
        assert!(found.contains(part), "{words}: {part:?} is missing in {found}");
    }
    run
}

/// What a command printed as JSON.
pub(crate) fn json(output: &[u8]) -> serde_json::Value {
    serde_json::from_slice(output).unwrap()
}

/// A file or folder of the data outside the repository, which lies where the environment variable
/// `DERMATOME_DATA` says. Without it the caller passes, and the output says what was skipped.
pub(crate) fn data(name: &str) -> Option<PathBuf> {
    let path = env::var_os("DERMATOME_DATA").map(|root| Path::new(&root).join(name));
    let path = path.filter(|path| path.exists());
    if path.is_none() {
        println!("skipped: {name} of the data");
    }
    path
}

/// Names in a folder, hidden ones included, in order.
pub(crate) fn listing(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A numpy array in C order: its type as numpy writes it (`<f4`), shape and elements.
pub(crate) fn npy(descriptor: &str, shape: &[usize], elements: &[u8]) -> Vec<u8> {
    npy_ordered(descriptor, shape, elements, "False")
}

/// A numpy array in Fortran order if `is_fortran` is Python's `True`.
pub(crate) fn npy_ordered(descriptor: &str, shape: &[usize], elements: &[u8], is_fortran: &str) -> Vec<u8> {
    let shape: String = shape.iter().map(|n| format!("{n},")).collect();
    let text = format!("{{'descr': '{descriptor}', 'fortran_order': {is_fortran}, 'shape': ({shape}), }}\n");
    let length = u16::try_from(text.len()).unwrap();
    [b"\x93NUMPY\x01\x00", &length.to_le_bytes()[..], text.as_bytes(), elements].concat()
}

/// The recordings of an archive and their names: `ids`, and arrays of frames, each with one of its times.
pub(crate) fn fingers(path: &Path) -> Vec<(String, Readings)> {
    let mut archive = zip::ZipArchive::new(fs::File::open(path).unwrap()).unwrap();
    let numbers = |archive: &mut zip::ZipArchive<fs::File>, name: &str| -> (Vec<u64>, Vec<f64>) {
        let entry = archive.by_name(&format!("{name}.npy")).unwrap();
        let array = npyz::NpyFile::new(entry).unwrap();
        let shape = array.shape().to_vec();
        let kind = array.dtype().descr();
        let values = match kind.trim_matches('\'') {
            "<i4" => array.into_vec::<i32>().unwrap().into_iter().map(f64::from).collect(),
            "<i8" => array.into_vec::<i64>().unwrap().into_iter().map(|x| x as f64).collect(),
            _ => array.into_vec::<f64>().unwrap(),
        };
        (shape, values)
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ids of the cover are small")]
    let ids = numbers(&mut archive, "ids").1.into_iter().map(|id| TaxelId(id as u32)).collect::<Vec<_>>();
    let mut names: Vec<String> =
        archive.file_names().filter_map(|name| Some(name.strip_suffix(".npy")?.to_owned())).collect();
    names.retain(|name| name != "ids" && !name.ends_with("_t"));
    names.sort();
    let mut of_name = |name: &String| Readings {
        ids: Some(ids.clone()),
        channels: vec![Channel::new("pressure", "count").unwrap()],
        width: ids.len(),
        times: numbers(&mut archive, &format!("{name}_t")).1,
        values: numbers(&mut archive, name).1,
        ..Readings::default()
    };
    names.iter().map(|name| (name.clone(), of_name(name))).collect()
}

/// A lattice of 11 x 11 taxels without those that a rule leaves out, whose arguments are in spacings.
pub(crate) fn cut_sheet(spacing: f64, is_kept: impl Fn(f64, f64) -> bool) -> Skin {
    let lattice = shapes::lattice(11, 11, spacing);
    let kept = lattice.positions.enumerate().filter(|(_, p)| is_kept(p.x / spacing, p.y / spacing));
    let kept: Vec<VertexId> = kept.map(|(v, _)| v).collect();
    let number = |v: VertexId| kept.iter().position(|k| *k == v).and_then(|k| u32::try_from(k).ok());
    let triangles = lattice.triangles.iter().filter_map(|t| {
        let corners = t.map(number);
        Some([corners[0]?, corners[1]?, corners[2]?])
    });
    let positions = kept.iter().map(|&v| lattice.positions[v]).collect();
    let mesh = TriMesh::from_arrays(positions, &triangles.collect::<Vec<_>>());
    Skin::from_mesh("sheet", mesh)
}
