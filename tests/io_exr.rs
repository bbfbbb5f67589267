//! Laws of the EXR files: what was written is read back bit by bit, and the bytes never change.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod maps;

use std::{collections::BTreeMap, fs, mem::discriminant, path::Path};

use dermatome::{
    atlas::{ImageRows, Samples, skin_images},
    io::{IoError, write_images},
    map::ImageFrame,
    mesh::shapes,
};
use exr::{
    meta::{
        MetaData,
        attribute::{AttributeValue, LineOrder, Text},
    },
    prelude::{Compression, FlatSamples, Image, ReadChannels, ReadLayers, Vec2, read},
};
use glam::DVec2;
use maps::{
    flat_patch,
    images::{Channel, WholeImage},
    skin, square_pyramid,
};

/// What the file holds: part by part the size and the channels.
fn read_back(path: &Path) -> Vec<(String, [usize; 2], BTreeMap<String, FlatSamples>)> {
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image: Image<_> = image.from_file(path).unwrap();
    let layer = |l: exr::prelude::Layer<exr::prelude::AnyChannels<FlatSamples>>| {
        let channels = l.channel_data.list.into_iter().map(|c| (c.name.to_string(), c.sample_data));
        (l.attributes.layer_name.unwrap().to_string(), [l.size.x(), l.size.y()], channels.collect())
    };
    image.layer_data.into_iter().map(layer).collect()
}

/// Floats as their bits: NaN is equal to itself, and -0 is not 0.
fn bits(samples: &Samples) -> Vec<u32> {
    match samples {
        Samples::F32(x) => x.iter().map(|x| x.to_bits()).collect(),
        Samples::U32(x) => x.clone(),
    }
}

/// A name as the file holds it: printable ASCII but `%` as it is, any other byte as `%` and two
/// digits.
fn part_name(name: &str) -> String {
    let is_plain = |b: u8| (b' '..=b'~').contains(&b) && b != b'%';
    name.bytes().map(|b| if is_plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}

fn assert_holds(path: &Path, images: &[WholeImage]) {
    let parts = read_back(path);
    assert_eq!(parts.len(), images.len(), "one part per image");
    for ((name, size, channels), image) in parts.iter().zip(images) {
        assert_eq!(*name, part_name(&image.name));
        assert_eq!(*size, image.frame.size_px.map(|n| n as usize), "size of {name}");
        assert_eq!(channels.len(), image.channels.len());
        for Channel { name: channel, samples } in &image.channels {
            let read = match &channels[channel] {
                FlatSamples::F32(x) => Samples::F32(x.clone()),
                FlatSamples::U32(x) => Samples::U32(x.clone()),
                FlatSamples::F16(_) => panic!("{channel} became half precision"),
            };
            assert_eq!(discriminant(&read), discriminant(samples), "kind of {channel}");
            assert_eq!(bits(&read), bits(samples), "{channel} of {name}");
        }
    }
}

fn frame(width: u32, height: u32) -> ImageFrame {
    ImageFrame {
        origin: DVec2::ZERO,
        size: DVec2::new(f64::from(width), f64::from(height)),
        size_px: [width, height],
    }
}

fn tiny(name: &str) -> WholeImage {
    let channels = vec![
        Channel { name: "taxel.id".into(), samples: Samples::U32(vec![u32::MAX - 1]) },
        Channel { name: "A".into(), samples: Samples::F32(vec![-0.0]) },
    ];
    WholeImage { name: name.into(), frame: frame(1, 1), channels }
}

#[test]
fn every_level_is_read_back_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    let map = skin(vec![
        square_pyramid("palm", &[17, 9, 5], 0.08, 0.001),
        flat_patch("cap", shapes::cap(700, 0.1, 1.0), 0.0009),
    ]);
    let images = skin_images(&map).unwrap();
    write_images(&path, &images).unwrap();
    let whole: Vec<_> = images.iter().map(WholeImage::of).collect();
    assert_eq!(
        whole.iter().map(|i| i.name.as_str()).collect::<Vec<_>>(),
        ["palm/L0", "palm/L1", "palm/L2", "cap/L0"]
    );
    assert_holds(&path, &whole);
    write_images(&folder.path().join("whole.exr"), &whole).unwrap();
    assert_eq!(
        fs::read(&path).unwrap(),
        fs::read(folder.path().join("whole.exr")).unwrap(),
        "images computed row by row and images in memory are written alike"
    );
}

#[test]
fn the_bytes_do_not_depend_on_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let map = skin(vec![
        square_pyramid("palm", &[17, 9], 0.3, 0.001),
        square_pyramid("tip", &[9, 5], 0.01, 0.0002),
    ]);
    let write = |threads: usize, run: usize| {
        let path = folder.path().join(format!("{threads}-{run}.exr"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write_images(&path, &skin_images(&map).unwrap()).unwrap());
        fs::read(path).unwrap()
    };
    let one = write(1, 0);
    for (threads, run) in [(1, 1), (2, 0), (7, 0), (7, 1)] {
        assert!(write(threads, run) == one, "{threads} threads, run {run}");
    }
}

#[test]
fn headers_say_what_every_reader_needs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    let map =
        skin(vec![square_pyramid("palm", &[17, 9], 0.08, 0.001), square_pyramid("tip", &[5], 0.01, 0.0002)]);
    let images = skin_images(&map).unwrap();
    write_images(&path, &images).unwrap();
    let meta = MetaData::read_from_file(&path, true).unwrap();
    let largest =
        images.iter().fold([0, 0], |[w, h], i| [w.max(i.frame().size_px[0]), h.max(i.frame().size_px[1])]);
    for (header, image) in meta.headers.iter().zip(&images) {
        assert_eq!(header.compression, Compression::ZIP16);
        assert_eq!(header.line_order, LineOrder::Increasing);
        assert_eq!(header.own_attributes.layer_position, Vec2(0, 0), "the data window starts at the origin");
        let display = header.shared_attributes.display_window;
        assert_eq!(
            display.size,
            Vec2(largest[0] as usize, largest[1] as usize),
            "one display window for all"
        );
        let names: Vec<_> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
        assert!(names.is_sorted() && names.len() == 14, "{names:?}");
        assert_eq!(header.own_attributes.other.len() + header.shared_attributes.other.len(), 1);
        let AttributeValue::Text(note) = &header.own_attributes.other[&Text::new_or_panic("dermatome")]
        else {
            panic!("the attribute is a text")
        };
        // As text: the numbers are exact, but not every JSON reader is.
        let [x, y, w, h] = [image.frame().origin.to_array(), image.frame().size.to_array()].concat()[..]
        else {
            panic!()
        };
        let map = format!(r#""map":{{"origin":[{x:?},{y:?}],"size":[{w:?},{h:?}]}}"#);
        assert!(note.to_string().contains(&map), "{note} holds {map}");
        let note: serde_json::Value = serde_json::from_slice(note.as_slice()).unwrap();
        assert_eq!(note["name"], image.name());
        assert!(note["version"].is_string());
    }
}

#[test]
fn the_smallest_image_and_the_strangest_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    let long = "long ".repeat(100);
    let images = ["", "a/b/L0", "Händfläche ☞/L0", "100%/L0", "tab\tnul\0/L0", long.as_str()].map(tiny);
    write_images(&path, &images).unwrap();
    assert_holds(&path, &images);
    write_images(&path, &images[2..3]).unwrap();
    assert_holds(&path, &images[2..3]);
    assert_eq!(read_back(&path)[0].0, "H%C3%A4ndfl%C3%A4che %E2%98%9E/L0");
}

#[test]
fn what_cannot_be_written_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    let old = tiny("old");
    write_images(&path, std::slice::from_ref(&old)).unwrap();
    let empty = WholeImage { frame: frame(0, 3), ..tiny("empty") };
    let hollow = WholeImage { channels: Vec::new(), ..tiny("hollow") };
    let torn = WholeImage { frame: frame(7, 50), ..tiny("torn") };
    for images in [vec![], vec![empty], vec![hollow], vec![torn], vec![tiny("twice"), tiny("twice")]] {
        let result = write_images(&path, &images);
        assert!(matches!(result, Err(IoError::Unfit { .. })), "{images:?}: {result:?}");
        assert_holds(&path, std::slice::from_ref(&old));
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays behind");
    assert!(write_images(&folder.path().join("none/map.exr"), &[old]).is_err());
}

#[test]
fn an_image_of_one_face_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    let map = flat_patch("one", shapes::triangle(), 1.0);
    let image = maps::image(&map, 0);
    write_images(&path, std::slice::from_ref(&image)).unwrap();
    assert_holds(&path, &[image]);
}
