//! Laws of the arrays and frames that recordings are written to.

use std::{collections::BTreeMap, fs, io::Read, path::Path, sync::Arc};

use crate::maps::images::WholeImage;
use dermatome::atlas::{Atlas, AtlasOptions, Label};
use dermatome::image::{Renderer, TactileImage};
use dermatome::io::{
    FrameContent, IoError, ReadingsColumns, ReadingsWriter, RecordingLayout, RecordingWriter, write_frame,
    write_raw_frame, write_touches,
};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::plot::{ImageOptions, image_png};
use dermatome::signal::{Channel, LevelFrame, Restrictor, TouchOptions, TouchSimulation};
use dermatome::skin::{PatchId, Presence, Skin};
use glam::DVec2;
use npyz::NpyFile;

fn skin() -> Skin {
    Skin::from_mesh("palm", shapes::cap(800, 0.05, 1.0))
}

fn map() -> SkinMap {
    build(&skin(), &BuildOptions::default()).unwrap()
}

fn channels() -> Vec<Channel> {
    [("force.N", "N"), ("A", "m/s^2")].map(|(name, unit)| Channel::new(name, unit).unwrap()).to_vec()
}

/// The `.npy` files of an `.npz`.
fn arrays(path: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut archive = zip::ZipArchive::new(fs::File::open(path).unwrap()).unwrap();
    let mut arrays = BTreeMap::new();
    for at in 0..archive.len() {
        let mut file = archive.by_index(at).unwrap();
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        arrays.insert(file.name().strip_suffix(".npy").unwrap().to_owned(), bytes);
    }
    arrays
}

fn numbers(bytes: &[u8]) -> (Vec<u64>, Vec<f32>) {
    let file = NpyFile::new(bytes).unwrap();
    (file.shape().to_vec(), file.into_vec::<f32>().unwrap())
}

fn ids(bytes: &[u8]) -> (Vec<u64>, Vec<u32>) {
    let file = NpyFile::new(bytes).unwrap();
    (file.shape().to_vec(), file.into_vec::<u32>().unwrap())
}

/// Images whose pixels say where they are, with a hole.
fn images(map: &SkinMap, atlas: &Atlas, count: usize, frame: f32) -> Vec<TactileImage> {
    let channels = vec![Channel::default(); count];
    let mut images = Renderer::new(map, atlas, &channels, None).unwrap().images().to_vec();
    for image in &mut images {
        let pixels = image.coverage.len();
        for (at, value) in image.values.iter_mut().enumerate() {
            let (k, i) = (at / pixels, at % pixels);
            if image.coverage[i] == 1 && i % 7 != 3 {
                *value = k as f32 * 1e6 + i as f32 + frame;
            }
        }
    }
    assert!(!map.patches.is_empty());
    images
}

/// Bit by bit, since NaN is not equal to itself.
fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn a_recording_holds_every_array_that_was_promised() {
    let (folder, map, channels) = (tempfile::tempdir().unwrap(), map(), channels());
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    let path = folder.path().join("touch.npz");
    let layout =
        RecordingLayout { channels: &channels, atlas: Some(&atlas), values: true, level: None, fields: None };
    let mut recording = RecordingWriter::create(&path, &map, &layout).unwrap();
    let mut frame = LevelFrame::new(&map, 2);
    let palm = PatchId::new(0);
    for t in 0..3_u8 {
        frame.time = f64::from(t) * 0.01;
        for (c, channel) in frame.values[palm].iter_mut().enumerate() {
            for level in channel.iter_mut() {
                level
                    .iter_mut()
                    .zip(0..)
                    .for_each(|(x, i)| *x = f64::from(i) + f64::from(t) + 0.5 * c as f64);
                level[1.into()] = f64::NAN;
            }
        }
        recording.write(&frame, &images(&map, &atlas, 2, f32::from(t))).unwrap();
    }
    assert!(!path.exists(), "nothing is in its place before the end");
    recording.finish().unwrap();

    let arrays = arrays(&path);
    let levels = map.patches[palm].levels.len();
    let mut expected: Vec<String> =
        ["timestamps", "channels", "units", "image_units", "metres_per_pixel", "palm.ids"]
            .map(String::from)
            .into();
    for level in 0..levels {
        expected.extend(
            ["image", "mask", "taxel_id", "values", "valid"].map(|key| format!("palm.L{level}.{key}")),
        );
    }
    expected.sort();
    assert_eq!(arrays.keys().cloned().collect::<Vec<_>>(), expected);
    let shown = WholeImage::of(&atlas.images(&Arc::new(map.clone()), None));
    for (level, part) in map.patches[palm].levels.ids().zip(&atlas.parts) {
        let [width, height] = part.frame.size_px.map(u64::from);
        let n = map.patches[palm].levels[level].level.mesh.positions.len();
        let (shape, values) = numbers(&arrays[&format!("palm.L{level}.image")]);
        assert_eq!(shape, [3, 2, height, width]);
        let drawn: Vec<f32> = (0..3_u8)
            .flat_map(|t| images(&map, &atlas, 2, f32::from(t)).remove(level.index()).values)
            .collect();
        assert_eq!(bits(&values), bits(&drawn));
        let (shape, values) = numbers(&arrays[&format!("palm.L{level}.values")]);
        assert_eq!(shape, [3, 2, n as u64]);
        assert_eq!(values[3 * n], f32::from(1_u8) + 0.5, "frame 1, channel 1, field 0");
        assert!(values[n + 1].is_nan(), "what is not known is NaN");
        let (shape, taxels) = ids(&arrays[&format!("palm.L{level}.taxel_id")]);
        assert_eq!((shape, taxels), (vec![height, width], shown[level.index()].ids("taxel.id").to_vec()));
        let valid = NpyFile::new(&arrays[&format!("palm.L{level}.valid")][..]).unwrap();
        assert_eq!(valid.shape(), [3, n as u64]);
        assert_eq!(valid.into_vec::<u8>().unwrap()[..3], [1, 0, 1]);
        let mask = NpyFile::new(&arrays[&format!("palm.L{level}.mask")][..]).unwrap();
        assert_eq!(mask.into_vec::<u8>().unwrap(), images(&map, &atlas, 1, 0.0)[level.index()].coverage);
    }
    let features: serde_json::Value =
        serde_json::from_slice(&fs::read(path.with_extension("features.json")).unwrap()).unwrap();
    assert_eq!(features.as_object().unwrap().len(), map.patches[palm].levels.len(), "one for each level");
    let fields = map.patches[palm].levels[1.into()].level.mesh.positions.len();
    let feature = &features["observation.tactile.palm.L1"];
    assert_eq!(feature["dtype"], "float32");
    assert_eq!(feature["shape"], serde_json::json!([2 * fields]));
    assert_eq!(feature["info"]["array"], "palm.L1.values");
    assert_eq!(feature["info"]["valid"], "palm.L1.valid");
}

#[test]
fn a_npy_holds_one_image_and_no_more() {
    let (folder, map) = (tempfile::tempdir().unwrap(), map());
    let (path, channel) = (folder.path().join("touch.npy"), Channel::default());
    let channels = std::slice::from_ref(&channel);
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    let all = RecordingLayout { channels, atlas: Some(&atlas), values: true, level: None, fields: None };
    let refused = RecordingWriter::create(&path, &map, &all).err().unwrap();
    assert!(matches!(refused, IoError::Unfit { .. }), "{refused}");
    let layout = RecordingLayout { level: Some(1.into()), ..all };
    let mut recording = RecordingWriter::create(&path, &map, &layout).unwrap();
    let frame = LevelFrame::new(&map, 1);
    for t in 0..5_u8 {
        let image = images(&map, &atlas, 1, f32::from(t)).swap_remove(1);
        recording.write(&frame, &[image]).unwrap();
    }
    let wrong = images(&map, &atlas, 1, 0.0);
    assert!(recording.write(&frame, &wrong[..1]).is_err(), "an image of another level");
    recording.finish().unwrap();
    let (shape, values) = numbers(&fs::read(&path).unwrap());
    let [width, height] = atlas.parts[1].frame.size_px.map(u64::from);
    assert_eq!(shape, [5, height, width]);
    let count = values.len() / 5;
    assert_eq!(bits(&values[2 * count..3 * count]), bits(&images(&map, &atlas, 1, 2.0)[1].values));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no features, no temporary file");
}

/// Each archive of a folder keeps its own features.
#[test]
fn two_archives_in_one_folder_keep_their_features() {
    let (folder, map, channels) = (tempfile::tempdir().unwrap(), map(), channels());
    for (name, level) in [("a.npz", 0), ("b.npz", 1)] {
        let layout = RecordingLayout {
            channels: &channels,
            atlas: None,
            values: true,
            level: Some(level.into()),
            fields: None,
        };
        let mut recording = RecordingWriter::create(&folder.path().join(name), &map, &layout).unwrap();
        recording.write(&LevelFrame::new(&map, 2), &[]).unwrap();
        recording.finish().unwrap();
    }
    for (name, level) in [("a", 0), ("b", 1)] {
        let text = fs::read(folder.path().join(format!("{name}.features.json"))).unwrap();
        let features: BTreeMap<String, serde_json::Value> = serde_json::from_slice(&text).unwrap();
        let names: Vec<_> = features.into_keys().collect();
        assert_eq!(names, [format!("observation.tactile.palm.L{level}")]);
    }
}

#[test]
fn a_frame_is_read_back_from_openexr() {
    let (folder, map, channels) = (tempfile::tempdir().unwrap(), map(), channels());
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    for image in images(&map, &atlas, 2, 0.25) {
        let path = folder.path().join(format!("L{}.exr", image.level));
        let content = FrameContent { channels: &channels, time: 1.5, shown: None };
        write_frame(&path, &image, &content).unwrap();
        let found = WholeImage::read(&path).swap_remove(0);
        assert_eq!((&found.name, found.size_px), (&image.name, image.frame.size_px));
        assert_eq!(found.channels.keys().collect::<Vec<_>>(), ["A", "Y", "force.N", "signal.A"]);
        let channel = |name: &str| bits(found.floats(name));
        let count = image.coverage.len();
        assert_eq!(channel("Y"), bits(&image.values[..count]));
        assert_eq!(channel("force.N"), channel("Y"));
        assert_eq!(channel("signal.A"), bits(&image.values[count..]));
        for (i, &alpha) in found.floats("A").iter().enumerate() {
            assert_eq!(alpha == 1.0, image.coverage[i] == 1 && !image.values[i].is_nan(), "pixel {i}");
        }
        let few = FrameContent { channels: &channels[..1], ..content };
        assert!(write_frame(&path, &image, &few).is_err(), "one channel too few");
    }
}

#[test]
fn raw_frames_are_the_values_in_order() {
    let map = map();
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    let images = images(&map, &atlas, 2, 0.5);
    let mut pipe = Vec::new();
    write_raw_frame(&mut pipe, &images).unwrap();
    let expected: Vec<u8> = images.iter().flat_map(|i| &i.values).flat_map(|x| x.to_le_bytes()).collect();
    assert!(pipe == expected);
}

/// Unknown pixels are grey, pixels off the skin transparent, ends of the range the ends of the
/// scale.
#[test]
fn a_picture_shows_what_is_not_known_as_no_value() {
    let map = SkinMap::flat(shapes::lattice(12, 12, 0.004), 1e-3);
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    let mut image = images(&map, &atlas, 1, 0.0).remove(0);
    image.values.iter_mut().filter(|x| !x.is_nan()).for_each(|x| *x = 0.0);
    let plain = ImageOptions::default();
    for options in [plain.clone(), ImageOptions { magnification: 5, ..plain.clone() }] {
        let height = options.magnification * image.frame.size_px[1];
        let png = image_png(&image, 0, &options).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.color_type, info.height), (png::ColorType::Rgba, height));
        let zoom = options.magnification as usize;
        for (i, (&value, &covered)) in image.values.iter().zip(&image.coverage).enumerate() {
            let [column, row] = [i % image.frame.size_px[0] as usize, i / image.frame.size_px[0] as usize];
            let pixel = &bytes[4 * (row * zoom * info.width as usize + column * zoom)..][..4];
            match (covered, value.is_nan()) {
                (0, _) => assert_eq!(pixel[3], 0, "off the skin"),
                (_, true) => assert!(pixel[0] == pixel[1] && pixel[1] == pixel[2] && pixel[3] == 255, "grey"),
                (_, false) => assert_eq!(pixel, [0x44, 0x01, 0x54, 255], "the dark end"),
            }
        }
        assert_eq!(png, image_png(&image, 0, &options).unwrap(), "the same bytes");
    }
    // A name is written around its place alone; one that would cover it is left out.
    let label = |text: &str, x| Label { text: text.into(), at: DVec2::new(x, 10.0) };
    let with =
        |labels| image_png(&image, 0, &ImageOptions { magnification: 4, labels, ..plain.clone() }).unwrap();
    let named = with(vec![label("palm", 20.0)]);
    assert_ne!(named, with(vec![]));
    assert_eq!(named, with(vec![label("palm", 20.0), label("thumb", 21.0)]));
    assert!(image_png(&image, 1, &plain).is_err());
    assert!(image_png(&image, 0, &ImageOptions { range: [1.0, 1.0], ..plain.clone() }).is_err());
    assert!(image_png(&image, 0, &ImageOptions { magnification: u32::MAX, ..plain }).is_err());
}

/// The table and the arrays of a simulated recording hold the same readings, and no absent taxel.
#[test]
fn readings_are_written_as_a_table_and_as_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let mut skin = skin();
    skin.patches[PatchId::new(0)].taxels.presence[4.into()] = Presence::Absent;
    let options = TouchOptions { presses: 2, rate: 20.0, dead: 0.1, ..TouchOptions::default() };
    let [table, archive] = ["r.csv", "r.npz"].map(|name| folder.path().join(name));
    let mut touches = Vec::new();
    for path in [&table, &archive] {
        touches.clear();
        let mut simulation = TouchSimulation::new(&skin, &options).unwrap();
        let mut writer = ReadingsWriter::create(
            path,
            skin.patches.iter().map(|p| &p.taxels),
            ReadingsColumns { channels: std::slice::from_ref(simulation.channel()), has_times: true },
        )
        .unwrap();
        while let Some((frame, now)) = simulation.next_frame() {
            writer.write(frame).unwrap();
            touches.extend_from_slice(now);
        }
        assert!(!path.exists());
        writer.finish().unwrap();
    }
    let text = fs::read_to_string(&table).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!(header[..3], ["time", "1.force[N]", "2.force[N]"]);
    assert!(!header.contains(&"5.force[N]"), "taxel 5 is absent");
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    let arrays = arrays(&archive);
    let values = NpyFile::new(&arrays["values"][..]).unwrap();
    assert_eq!(values.shape(), [rows.len() as u64, header.len() as u64 - 1]);
    let values: Vec<f64> = values.into_vec().unwrap();
    let times: Vec<f64> = NpyFile::new(&arrays["timestamps"][..]).unwrap().into_vec().unwrap();
    for ((row, values), time) in rows.iter().zip(values.chunks(header.len() - 1)).zip(times) {
        assert_eq!(row[0], time);
        assert!(
            row[1..]
                .iter()
                .zip(values)
                .all(|(a, b)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()))
        );
    }
    let truth = folder.path().join("truth.csv");
    write_touches(&truth, &skin, &touches).unwrap();
    let text = fs::read_to_string(&truth).unwrap();
    assert!(text.starts_with("frame,time,press,patch,link,x,y,z,force,taxels,sphere_x,sphere_y,sphere_z\n"));
    assert_eq!(text.lines().count(), 1 + touches.len());
}

/// A restricted frame is written as it is.
#[test]
fn the_same_recording_gives_the_same_bytes() {
    let (folder, map) = (tempfile::tempdir().unwrap(), map());
    let skin = skin();
    let mut files = Vec::new();
    for name in ["a.npz", "b.npz"] {
        let path = folder.path().join(name);
        let mut simulation =
            TouchSimulation::new(&skin, &TouchOptions { presses: 1, ..TouchOptions::default() }).unwrap();
        let channels = [simulation.channel().clone()];
        let layout =
            RecordingLayout { channels: &channels, atlas: None, values: true, level: None, fields: None };
        let mut recording = RecordingWriter::create(&path, &map, &layout).unwrap();
        let mut restrictor = Restrictor::new(&map, &channels);
        while let Some((frame, _)) = simulation.next_frame() {
            recording.write(restrictor.restrict(frame), &[]).unwrap();
        }
        recording.finish().unwrap();
        files.push(fs::read(&path).unwrap());
    }
    assert!(files[0] == files[1]);
}
