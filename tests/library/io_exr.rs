//! Laws of the EXR files: what every reader needs is there, and the bytes never change. What pixels hold
//! is tested in `atlas.rs` and `io_arrays.rs`, read back from such files.

use std::{fs, sync::Arc};

use crate::maps::{flat_patch, images::WholeImage, level_id, skin, square_pyramid};
use dermatome::atlas::skin_images;
use dermatome::io::{IoError, write_images};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, LineOrder, Text};
use exr::prelude::{Compression, Vec2};

fn map() -> Arc<SkinMap> {
    Arc::new(skin(vec![
        square_pyramid("palm", &[17, 9, 5], 0.3, 0.001),
        square_pyramid("tip", &[5], 0.01, 0.0002),
    ]))
}

#[test]
fn the_bytes_do_not_depend_on_the_threads() {
    let (folder, map) = (tempfile::tempdir().unwrap(), map());
    let write = |threads: usize, run: usize| {
        let path = folder.path().join(format!("{threads}-{run}.exr"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write_images(&path, &skin_images(&map).unwrap()).unwrap());
        fs::read(path).unwrap()
    };
    let one = write(1, 0);
    for (threads, run) in [(1, 1), (2, 0), (7, 0)] {
        assert!(write(threads, run) == one, "{threads} threads, run {run}");
    }
}

#[test]
fn headers_say_what_every_reader_needs() {
    let (folder, map) = (tempfile::tempdir().unwrap(), map());
    let path = folder.path().join("map.exr");
    write_images(&path, &skin_images(&map).unwrap()).unwrap();
    let meta = MetaData::read_from_file(&path, true).unwrap();
    let levels = map.patches.iter().flat_map(|patch| patch.levels.enumerate().map(move |l| (patch, l)));
    let sizes = levels.clone().map(|(_, (_, level))| level.frame.size_px.map(|n| n as usize));
    let largest = sizes.fold([0, 0], |[w, h], [x, y]| [w.max(x), h.max(y)]);
    assert_eq!(meta.headers.len(), 4);
    for (header, (patch, (k, level))) in meta.headers.iter().zip(levels) {
        assert_eq!(header.compression, Compression::ZIP16);
        assert_eq!(header.line_order, LineOrder::Increasing);
        assert_eq!(header.own_attributes.layer_position, Vec2(0, 0), "the data window starts at the origin");
        let display = header.shared_attributes.display_window.size;
        assert_eq!(display, Vec2(largest[0], largest[1]), "one display window for all");
        let names: Vec<_> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
        assert!(names.is_sorted() && names.len() == 14, "{names:?}");
        assert_eq!(header.own_attributes.other.len() + header.shared_attributes.other.len(), 1);
        let AttributeValue::Text(note) = &header.own_attributes.other[&Text::new_or_panic("dermatome")]
        else {
            panic!("the attribute is a text")
        };
        // As text: the numbers are exact, but not every JSON reader is.
        let [x, y, w, h] = [level.frame.origin.to_array(), level.frame.size.to_array()].concat()[..] else {
            panic!()
        };
        let rectangle = format!(r#""map":{{"origin":[{x:?},{y:?}],"size":[{w:?},{h:?}]}}"#);
        assert!(note.to_string().contains(&rectangle), "{note} holds {rectangle}");
        let note: serde_json::Value = serde_json::from_slice(note.as_slice()).unwrap();
        assert_eq!(note["name"], format!("{}/L{k}", patch.name));
        assert!(note["version"].is_string());
    }
}

/// Printable ASCII but `%` as it is, any other byte as `%` and two digits.
#[test]
fn one_pixel_and_names_of_any_bytes_are_written() {
    let long = "long ".repeat(100);
    for (name, written) in [
        ("a/b", "a/b/L0"),
        ("Händfläche ☞", "H%C3%A4ndfl%C3%A4che %E2%98%9E/L0"),
        ("100%", "100%25/L0"),
        ("tab\tend", "tab%09end/L0"),
        (&long, &format!("{long}/L0")),
    ] {
        let mut patch = flat_patch(name, shapes::triangle(), 1.0);
        patch.levels[level_id(0)].frame.size_px = [1, 1];
        let images = WholeImage::of(&skin_images(&Arc::new(skin(vec![patch]))).unwrap());
        assert_eq!((images[0].name.as_str(), images[0].size_px), (written, [1, 1]));
    }
}

#[test]
fn a_failed_write_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    fs::write(&path, "old").unwrap();
    let images = skin_images(&map()).unwrap();
    let twice = [images[0].clone(), images[0].clone()];
    for images in [&[], &twice[..]] {
        let result = write_images(&path, images);
        assert!(matches!(result, Err(IoError::Unfit { .. })), "{result:?}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays behind");
    assert!(write_images(&folder.path().join("none/map.exr"), &images).is_err());
}
