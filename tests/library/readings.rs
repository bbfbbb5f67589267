//! Laws of readings on their way in: every format gives the numbers that were put in, what is broken
//! is refused by name, columns find their taxels, and filters lose nothing.

use std::collections::VecDeque;
use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use crate::common::{data, npy, npy_ordered};
use dermatome::id::VertexId;
use dermatome::io::{
    IoError, KnownRest, Layout, ReadOptions, Readings, ReadingsColumns, ReadingsLayout, ReadingsReader,
    ReadingsWriter, read_draft, read_gains,
};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::signal::{
    Channel, ChannelKind, ConditionOptions, Conditioner, Duplicates, Frame, Join, Quantity, SignalError,
    Stage, TouchOptions, TouchSimulation, Zero,
};
use dermatome::skin::{AssembleOptions, PatchId, Presence, Skin, TaxelId, assemble};
use proptest::prelude::*;
use tempfile::TempDir;

/// A recording as it was read: `frames[t][c * width + n]`, and the times.
struct Recorded {
    ids: Option<Vec<u32>>,
    channels: Vec<Channel>,
    width: usize,
    frames: Vec<Vec<f64>>,
    times: Vec<f64>,
}

fn drain(reader: ReadingsReader) -> Result<Recorded, IoError> {
    let (count, has_times) = (reader.frames, reader.has_times);
    let Readings { ids, channels, width, times, values, .. } = Readings::collect(reader, || ())?;
    assert!(count.is_none_or(|n| n == times.len() as u64), "as many frames as it said");
    assert!(times.iter().all(|t| t.is_finite() == has_times));
    let frames = values.chunks_exact(width * channels.len()).map(<[f64]>::to_vec).collect();
    let ids = ids.map(|ids| ids.into_iter().map(|id| id.0).collect());
    Ok(Recorded { ids, channels, width, frames, times })
}

fn read_as(name: &str, bytes: &[u8], layout: ReadingsLayout) -> Result<Recorded, IoError> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    drain(ReadingsReader::open(&path, layout)?)
}

fn read(name: &str, bytes: &[u8]) -> Result<Recorded, IoError> {
    read_as(name, bytes, ReadingsLayout::default())
}

fn message<T>(result: Result<T, IoError>) -> String {
    result.err().unwrap().to_string()
}

fn doubles(numbers: impl IntoIterator<Item = f64>) -> Vec<u8> {
    numbers.into_iter().flat_map(f64::to_le_bytes).collect()
}

fn unicode(texts: &[&str], characters: usize) -> Vec<u8> {
    let letters = texts.iter().flat_map(|t| t.chars().map(u32::from).chain([0; 20]).take(characters));
    letters.flat_map(u32::to_le_bytes).collect()
}

/// An archive as numpy's `savez` or `savez_compressed` writes it.
fn npz(arrays: &[(&str, Vec<u8>)], is_deflated: bool) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, array) in arrays {
        let mut crc = flate2::Crc::new();
        crc.update(array);
        let stored = if is_deflated {
            let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(array).unwrap();
            encoder.finish().unwrap()
        } else {
            array.clone()
        };
        let name = format!("{name}.npy");
        let short = |n: usize| u16::try_from(n).unwrap().to_le_bytes().to_vec();
        let long = |n: usize| u32::try_from(n).unwrap().to_le_bytes().to_vec();
        let start = long(bytes.len());
        let about = [
            vec![20, 0, 0, 0],
            short(if is_deflated { 8 } else { 0 }),
            vec![0, 0, 0x21, 0],
            crc.sum().to_le_bytes().to_vec(),
            long(stored.len()),
            long(array.len()),
            short(name.len()),
            vec![0, 0],
        ]
        .concat();
        bytes.extend([b"PK\x03\x04".to_vec(), about.clone(), name.clone().into_bytes(), stored].concat());
        directory
            .extend([b"PK\x01\x02\x14\x00".to_vec(), about, vec![0; 10], start, name.into_bytes()].concat());
    }
    let (start, length, count) = (bytes.len(), directory.len(), u16::try_from(arrays.len()).unwrap());
    let long = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    bytes.extend(directory);
    bytes.extend([&b"PK\x05\x06\0\0\0\0"[..], &count.to_le_bytes(), &count.to_le_bytes()].concat());
    bytes.extend([&long(length)[..], &long(start), &[0, 0]].concat());
    bytes
}

const TIMES: [f64; 3] = [0.0, 0.004, 0.1];

/// 3 frames of 2 channels of 4 taxels, all different.
fn value(frame: usize, channel: usize, taxel: usize) -> f64 {
    (frame * 100 + channel * 10 + taxel) as f64 - 7.5
}

fn numbers(is_taxels_first: bool) -> Vec<f64> {
    let mut numbers = Vec::new();
    for t in 0..3 {
        match is_taxels_first {
            true => (0..8).for_each(|k| numbers.push(value(t, k % 2, k / 2))),
            false => (0..8).for_each(|k| numbers.push(value(t, k / 4, k % 4))),
        }
    }
    numbers
}

fn check(found: &Recorded, what: &str) {
    assert_eq!((found.width, found.channels.len(), found.frames.len()), (4, 2, 3), "{what}");
    for (t, frame) in found.frames.iter().enumerate() {
        for (k, &x) in frame.iter().enumerate() {
            assert_eq!(x, value(t, k / 4, k % 4), "{what}: frame {t}, number {k}");
        }
    }
}

#[test]
fn tables_give_the_numbers_that_were_put_in() {
    let header =
        "frame,5.force.N[N],7.force.N[N],time,5.heat,7.heat,9.heat,11.heat,9.force.N[N],11.force.N[N]";
    let order = [(0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (1, 3), (0, 2), (0, 3)];
    for (newline, separator, mark) in
        [("\n", ",", ""), ("\r\n", " , ", "\u{feff}"), ("\n\n# a\n", "\",\"", "")]
    {
        let mut text = format!("{mark}{header}{newline}");
        for (t, time) in TIMES.iter().enumerate() {
            let mut cells = vec![t.to_string()];
            for (k, &(channel, taxel)) in order.iter().enumerate() {
                if k == 2 {
                    cells.push(time.to_string());
                }
                cells.push(format!("{:e}", value(t, channel, taxel)));
            }
            let quote = if separator.contains('"') { "\"" } else { "" };
            text += &format!("{quote}{}{quote}{newline}", cells.join(separator));
        }
        for text in [text.as_str(), text.trim_end()] {
            let found = read("a.csv", text.as_bytes()).unwrap();
            check(&found, separator);
            assert_eq!(found.ids.unwrap(), [5, 7, 9, 11]);
            assert_eq!(found.times, TIMES);
            let force = Channel::new("force.N", "N").unwrap();
            assert_eq!(found.channels, [force, Channel::new("heat", "").unwrap()]);
        }
    }
}

#[test]
fn text_of_blanks_gives_the_numbers_that_were_put_in() {
    let text = "16 32  0\n0 0.000000 1 2 3 \n1 0.100 -4\t5.5 nan\n2 0.3 1e3 inf 0\n";
    let found = read("a.txt", text.as_bytes()).unwrap();
    assert_eq!((found.ids.unwrap(), found.times), (vec![16, 32, 0], vec![0.0, 0.1, 0.3]));
    assert_eq!(found.channels, [Channel::default()]);
    assert_eq!((&found.frames[0][..], &found.frames[1][..2]), (&[1.0, 2.0, 3.0][..], &[-4.0, 5.5][..]));
    assert!(found.frames[1][2].is_nan(), "missing");
    assert!(!found.frames[2][1].is_finite(), "missing, too");
    // A stream says itself which of the two it is.
    for text in ["16 32\n0 0.5 1 2\n", "time,16,32\n0.5,1,2\n"] {
        let found = drain(ReadingsReader::stream(Path::new("-"), text.as_bytes()).unwrap()).unwrap();
        assert_eq!(
            (found.ids.unwrap(), found.frames, found.times[0]),
            (vec![16, 32], vec![vec![1.0, 2.0]], 0.5)
        );
    }
}

#[test]
fn cells_without_a_number_are_missing_readings() {
    let found = read("a.csv", b"1,2.heat,1.heat\n,NaN,3\n4,,-inf\n").unwrap();
    assert_eq!((found.width, found.channels.len()), (2, 2));
    let missing: Vec<Vec<bool>> =
        found.frames.iter().map(|f| f.iter().map(|x| !x.is_finite()).collect()).collect();
    // Between tabs the first and the last reading may be missing, too.
    let tabs = read("a.csv", b"1.p\t2.p\t3.p\n\t5\t\n").unwrap();
    assert!(tabs.frames[0][0].is_nan() && tabs.frames[0][1] == 5.0 && tabs.frames[0][2].is_nan());
    assert_eq!(missing, [[true, true, false, true], [false, true, true, true]]);
    assert!(found.times.iter().all(|t| t.is_nan()), "without a time");
}

#[test]
fn arrays_of_both_layouts_give_the_numbers_that_were_put_in() {
    for (layout, shape) in
        [(ReadingsLayout::TaxelsFirst, [3, 4, 2]), (ReadingsLayout::ChannelsFirst, [3, 2, 4])]
    {
        let elements = doubles(numbers(layout == ReadingsLayout::TaxelsFirst));
        let alone = npy("<f8", &shape, &elements);
        let found = read_as("a.npy", &alone, layout).unwrap();
        check(&found, "npy");
        assert_eq!((found.ids, found.channels[1].name.as_str()), (None, "channel1"));
        for is_deflated in [false, true] {
            let ids: Vec<u8> = [5_i64, 7, 4_294_967_295, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
            let arrays = [
                ("ids", npy("<i8", &[4], &ids)),
                ("whatever", npy("|S3", &[1], b"abc")),
                ("timestamps", npy("<f8", &[3], &doubles(TIMES))),
                ("channels", npy("<U7", &[2], &unicode(&["force.N", "heat"], 7))),
                ("units", npy("|S2", &[2], b"mNK\0")),
                ("only", alone.clone()),
            ];
            let found = read_as("a.npz", &npz(&arrays, is_deflated), layout).unwrap();
            check(&found, "npz");
            assert_eq!(found.ids.unwrap(), [5, 7, u32::MAX, 0]);
            let named =
                [("ids", npy("<U3", &[4], &unicode(&["5", " 7", "12", "0"], 3))), ("only", alone.clone())];
            let named = read_as("a.npz", &npz(&named, is_deflated), layout).unwrap();
            assert_eq!(named.ids.unwrap(), [5, 7, 12, 0], "ids as texts");
            assert_eq!(found.times, TIMES);
            assert_eq!(
                found.channels,
                [Channel::new("force.N", "mN").unwrap(), Channel::new("heat", "K").unwrap()]
            );
        }
    }
}

/// An array called `units` that is no list of texts says nothing about the readings.
#[test]
fn units_that_are_no_list_are_passed_over() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.npz");
    let strange = [
        npy_ordered("<U3", &[0, 2], &[], "True"),
        npy_ordered("<U1", &[2, 2], &unicode(&["N", "N", "N", "N"], 1), "True"),
        npy("|O", &[1], &[0; 8]),
        npy("<U1", &[0], &[]),
    ];
    for units in strange {
        let arrays = [("values", npy("<f4", &[2, 3], &[0; 24])), ("units", units)];
        std::fs::write(&path, npz(&arrays, false)).unwrap();
        let draft = ReadingsReader::draft_layout(&path, None).unwrap();
        assert!(!draft.contains("\"N\""), "{draft}");
    }
}

/// The elements of a C array of this shape in Fortran order.
fn first_index_fastest(shape: &[usize], elements: &[f64]) -> Vec<f64> {
    let count: usize = shape.iter().product();
    let place = |k: usize| {
        let (mut left, mut at, mut stride) = (k, 0, count);
        for &side in shape {
            stride /= side;
            at += left % side * stride;
            left /= side;
        }
        at
    };
    (0..count).map(|k| elements[place(k)]).collect()
}

/// An array in Fortran order is the array that numpy shows, whatever its layout.
#[test]
fn arrays_in_fortran_order_are_read() {
    for (layout, shape) in
        [(ReadingsLayout::TaxelsFirst, [3, 4, 2]), (ReadingsLayout::ChannelsFirst, [3, 2, 4])]
    {
        let elements = first_index_fastest(&shape, &numbers(layout == ReadingsLayout::TaxelsFirst));
        let array = npy_ordered("<f8", &shape, &doubles(elements), "True");
        check(&read_as("a.npy", &array, layout).unwrap(), "npy");
        for is_deflated in [false, true] {
            let arrays =
                [("timestamps", npy_ordered("<f8", &[3], &doubles(TIMES), "True")), ("only", array.clone())];
            let found = read_as("a.npz", &npz(&arrays, is_deflated), layout).unwrap();
            check(&found, "npz");
            assert_eq!(found.times, TIMES);
        }
        let cut = npz(&[("only", array[..array.len() - 8].to_vec())], true);
        assert!(message(read_as("a.npz", &cut, layout)).contains("(3, "), "an array without its end");
    }
    let flat: Vec<f64> = (0..6).map(f64::from).collect();
    let array = npy_ordered("<f8", &[3, 2], &doubles(first_index_fastest(&[3, 2], &flat)), "True");
    assert_eq!(read("a.npy", &array).unwrap().frames, [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]);
}

/// numpy writes every entry in the long form, as if it were larger than 4 GiB.
#[test]
fn entries_in_the_long_form_are_read() {
    let mut archive = zip::ZipWriter::new(io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Stored)
        .large_file(true);
    archive.start_file("readings.npy", options).unwrap();
    archive.write_all(&npy("<f8", &[3, 4, 2], &doubles(numbers(true)))).unwrap();
    let bytes = archive.finish().unwrap().into_inner();
    check(&read("a.npz", &bytes).unwrap(), "long entries");
}

#[test]
fn elements_of_every_type_are_read() {
    let cases: [(&str, &[u8]); 14] = [
        ("|i1", &[1, 2]),
        ("|u1", &[1, 2]),
        ("|b1", &[1, 2]),
        ("<i2", &[1, 0, 2, 0]),
        (">i2", &[0, 1, 0, 2]),
        ("<u2", &[1, 0, 2, 0]),
        (">i4", &[0, 0, 0, 1, 0, 0, 0, 2]),
        ("<u4", &[1, 0, 0, 0, 2, 0, 0, 0]),
        ("<i8", &[1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0]),
        (">u8", &[0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2]),
        ("<f2", &[0x00, 0x3c, 0x00, 0x40]),
        ("<f4", &[0, 0, 0x80, 0x3f, 0, 0, 0, 0x40]),
        (">f4", &[0x3f, 0x80, 0, 0, 0x40, 0, 0, 0]),
        (">f8", &[0x3f, 0xf0, 0, 0, 0, 0, 0, 0, 0x40, 0, 0, 0, 0, 0, 0, 0]),
    ];
    for (descriptor, bytes) in cases {
        let found = read("a.npy", &npy(descriptor, &[1, 2], bytes)).unwrap();
        assert_eq!(found.frames, [[1.0, 2.0]], "{descriptor}");
    }
}

/// What the simulation of touch writes is read back, to the last bit.
#[test]
fn written_readings_are_read_back() {
    let skin = Skin::from_mesh("cap", shapes::cap(60, 0.05, 0.5));
    let mut simulation = TouchSimulation::new(&skin, &TouchOptions::default()).unwrap();
    let mut frames = Vec::new();
    while let (Some((frame, _)), true) = (simulation.next_frame(), frames.len() < 50) {
        frames.push(frame.clone());
    }
    let channel = Channel::new("force", "N").unwrap();
    let folder = TempDir::new().unwrap();
    for name in ["a.csv", "a.npz"] {
        let path = folder.path().join(name);
        let mut writer = ReadingsWriter::create(
            &path,
            skin.patches.iter().map(|p| &p.taxels),
            ReadingsColumns { channels: std::slice::from_ref(&channel), has_times: true },
        )
        .unwrap();
        frames.iter().for_each(|frame| writer.write(frame).unwrap());
        writer.finish().unwrap();
        let found = drain(ReadingsReader::open(&path, ReadingsLayout::default()).unwrap()).unwrap();
        assert_eq!(found.channels[0].quantity, Quantity::Extensive, "{name}");
        let ids: Vec<u32> = skin.patches[PatchId::new(0)].taxels.ids.iter().map(|id| id.0).collect();
        assert_eq!(found.ids.unwrap(), ids);
        assert_eq!(found.frames.len(), frames.len());
        for ((frame, &time), wrote) in found.frames.iter().zip(&found.times).zip(&frames) {
            assert_eq!(time, wrote.time);
            let wrote = wrote.values[PatchId::new(0)][0].iter();
            assert!(frame.iter().zip(wrote).all(|(a, b)| a == b || a.is_nan() && b.is_nan()), "{name}");
        }
    }
}

/// Frames without times are written without, and a table names no channel so that it could not be read.
#[test]
fn readings_without_times_are_read_back_without() {
    let skin = Skin::from_mesh("square", shapes::square());
    let map = SkinMap::flat(shapes::square(), 0.1);
    let folder = TempDir::new().unwrap();
    let write = |name: &str, channel: &str| {
        let path = folder.path().join(name);
        let channel = Channel { name: channel.into(), ..Channel::new("force", "N").unwrap() };
        let taxels = skin.patches.iter().map(|p| &p.taxels);
        let columns = ReadingsColumns { channels: std::slice::from_ref(&channel), has_times: false };
        let mut writer = ReadingsWriter::create(&path, taxels, columns)?;
        let mut frame = Frame::new(&map, 1);
        for k in [1.0, 2.0] {
            frame.time = f64::NAN;
            frame.values[PatchId::new(0)][0].iter_mut().for_each(|x| *x = k);
            writer.write(&frame)?;
        }
        writer.finish()?;
        let reader = ReadingsReader::open(&path, ReadingsLayout::default())?;
        assert!(!reader.has_times);
        let found = drain(reader).unwrap();
        assert_eq!((found.frames[1][0], &*found.channels[0].name), (2.0, &*channel.name), "{name}");
        Ok::<(), IoError>(())
    };
    for name in ["a.csv", "a.npz"] {
        write(name, "force").unwrap();
    }
    for bad in ["0", "a,b", "a;b", "a[b", " a"] {
        let error = write("b.csv", bad).unwrap_err().to_string();
        assert!(error.contains("channel") && !folder.path().join("b.csv").exists(), "{error}");
        write("b.npz", bad).unwrap();
    }
}

/// What is known where nothing touches is stated by an archive; arrays of these names that are no single number are about
/// something else.
#[test]
fn what_is_known_at_rest_is_read_back() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.npz");
    let skin = Skin::from_mesh("square", shapes::square());
    let mut frame = Frame::new(&SkinMap::flat(shapes::square(), 0.1), 1);
    frame.values[PatchId::new(0)][0] = vec![5.0; 4].into();
    for rest in [
        KnownRest::default(),
        KnownRest { is_zero: vec![true], threshold: None },
        KnownRest { is_zero: vec![true], threshold: Some(0.25) },
    ] {
        for path in [&path, &folder.path().join("a.csv")] {
            let taxels = skin.patches.iter().map(|p| &p.taxels);
            let channel = Channel::new("pressure", "Pa").unwrap();
            let columns = ReadingsColumns { channels: &[channel], has_times: true };
            let mut writer = ReadingsWriter::create(path.as_path(), taxels, columns).unwrap();
            writer.state_rest(&rest).unwrap();
            writer.write(&frame).unwrap();
            writer.finish().unwrap();
            let reader = ReadingsReader::open(path, ReadingsLayout::default()).unwrap();
            let stated = reader
                .statements()
                .iter()
                .map(|known| format!("{}: {}", known.what, known.value))
                .collect::<Vec<_>>();
            assert_eq!(
                stated.contains(&"zero: subtracted before".to_owned()),
                rest.is_zero_in(0),
                "{stated:?}"
            );
            assert_eq!(
                stated.contains(&"threshold: 0.25 Pa".to_owned()),
                rest.threshold.is_some(),
                "{stated:?}"
            );
            assert_eq!(reader.rest, rest);
            assert_eq!(Readings::collect(reader, || ()).unwrap().rest, rest);
        }
    }
    let with = |name: &'static str, shape: &[usize], number: f64| {
        let values = npy("<f8", &[2, 4], &doubles([1.0; 8]));
        let count = shape.iter().product();
        let other = npy("<f8", shape, &doubles(vec![number; count]));
        fs::write(&path, npz(&[("values", values), (name, other)], false)).unwrap();
        ReadingsReader::open(&path, ReadingsLayout::default()).map(|reader| reader.rest)
    };
    assert_eq!(with("threshold", &[1], 2.0).unwrap().threshold, Some(2.0));
    assert_eq!(with("threshold", &[4], -1.0).unwrap(), KnownRest::default());
    for (name, number) in
        [("threshold", 0.0), ("threshold", f64::NAN), ("is_tared", 2.0), ("is_tared", f64::NAN)]
    {
        assert!(message(with(name, &[], number)).contains(name), "{name} {number}");
    }
}

/// Taxels that share a placeholder id are written in their order, absent ones too, without ids.
#[test]
fn readings_of_taxels_with_the_same_id_are_read_back_in_their_order() {
    let mut skin = Skin::from_mesh("square", shapes::square());
    let taxels = &mut skin.patches[PatchId::new(0)].taxels;
    taxels.ids = vec![TaxelId(0), TaxelId(0), TaxelId(7), TaxelId(8)].into();
    taxels.presence[3.into()] = Presence::Absent;
    let map = SkinMap::flat(shapes::square(), 0.1);
    let mut frame = Frame::new(&map, 1);
    frame.values[PatchId::new(0)][0] = vec![1.0, 2.0, 3.0, f64::NAN].into();
    let folder = TempDir::new().unwrap();
    for name in ["a.csv", "a.npz"] {
        let path = folder.path().join(name);
        let taxels = skin.patches.iter().map(|p| &p.taxels);
        let channels = &[Channel::new("force", "N").unwrap()];
        let columns = ReadingsColumns { channels, has_times: true };
        let mut writer = ReadingsWriter::create(&path, taxels, columns).unwrap();
        writer.write(&frame).unwrap();
        writer.finish().unwrap();
        let found = drain(ReadingsReader::open(&path, ReadingsLayout::default()).unwrap()).unwrap();
        assert_eq!((found.ids, found.channels[0].name.as_str()), (None, "force"), "{name}");
        assert_eq!(found.frames[0][..3], [1.0, 2.0, 3.0], "{name}");
        assert!(found.frames[0][3].is_nan(), "{name}: the absent taxel");
    }
}

#[test]
fn broken_texts_are_refused_with_their_line() {
    for (name, text, place) in [
        ("a.csv", "", "an empty file"),
        ("a.csv", "5,6\n", "line 1"),
        ("a.csv", "time,frame\n0,0\n", "no taxel id"),
        ("a.csv", "taxel_5;taxel_6\n1,5;2,5\n", "time,taxel_id,value"),
        ("a.csv", "frame,5,6\n0,1,2\n1\n", "line 3: found 1 cells"),
        ("a.csv", "frame,5,6\n0,1,x\n", "line 2, column 3"),
        ("a.csv", "time,6\nNaN,1\n", "line 2, column 1"),
        ("a.csv", "time,6\n1.7e12,1\n", "time[ms]"),
        ("a.csv", "time,6,time\n0,1,0\n", "line 1, column 3"),
        ("a.csv", "5.force[N],6.force[mN]\n1,2\n", "line 1, column 2"),
        ("a.txt", "5 6\n0 0.0 1 2 3\n", "line 2: found 5 cells"),
        ("a.csv", "time,taxel_id,value\n", "no row of readings"),
        ("a.csv", "time,taxel_id,value\n0,1,2\n0,1,2\n", "taxel 1 again"),
        ("a.csv", "time,taxel_id,value\n0,1\n", "line 2: found 2 cells"),
    ] {
        let found = message(read(name, text.as_bytes()));
        assert!(found.contains(place) && found.contains(name), "{text:?}: {found}");
    }
    assert!(message(read("a.csv", b"5,\xff\n1,2\n")).contains("UTF-8"));
    assert!(matches!(read("a.exr", b"5"), Err(IoError::UnknownKind { .. })));
    let absent = ReadingsReader::open(Path::new("no such folder/a.csv"), ReadingsLayout::default());
    assert!(matches!(absent, Err(IoError::Read { .. })));
}

/// A long table has a row for each reading; a frame has the readings of one time. Dates count from 1970.
#[test]
fn long_tables_give_frames() {
    let text = "taxel_id,value[kPa],time\n7,1,0.5\n9,2,0.5\n9,3,0.75\n7,,1\n8,4,1\n";
    for text in [text.to_owned(), text.replace(',', ";")] {
        let found = read("a.csv", text.as_bytes()).unwrap();
        assert_eq!((found.ids.unwrap(), found.times), (vec![7, 9, 8], vec![0.5, 0.75, 1.0]));
        assert_eq!(found.channels[0].unit, "kPa");
        let missing = |frame: &Vec<f64>| frame.iter().map(|x| if x.is_nan() { -1.0 } else { *x }).collect();
        let frames: Vec<Vec<f64>> = found.frames.iter().map(missing).collect();
        assert_eq!(frames, [[1.0, 2.0, -1.0], [-1.0, 3.0, -1.0], [-1.0, -1.0, 4.0]]);
    }
    let words = message(read("a.csv", b"time;5\n0,0;1,5\n").map(|_| ()));
    assert!(
        words.contains("line 2, column 1: found \"0,0\"; needed: a number with a decimal point"),
        "{words}"
    );
    let log = read("data.log", b"7 0.5 1 2 3\n8 0.75 4 5 6\n").unwrap();
    assert_eq!((log.ids, log.width, log.times), (None, 3, vec![0.5, 0.75]), "a log of YARP names no taxels");
    assert_eq!(log.frames, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert!(message(read("data.log", b"5 6\n").map(|_| ())).contains("yarpdatadumper"));
    let dated = read("a.csv", b"time,5\n1970-01-01T00:01:00Z,1\n1970-01-01 00:01:00.5,2\n").unwrap();
    assert_eq!(dated.times, [60.0, 60.5]);
    let by_taxel = read("a.csv", b"time,taxel_id,value\n0,1,5\n0.1,1,6\n0,2,7\n0.1,2,8\n");
    assert!(
        message(by_taxel.map(|_| ()))
            .contains("line 4: found the time 0 s after 0.1 s; needed: rows sorted by time")
    );
    let tabs = ReadingsReader::stream(Path::new("-"), &b"time\t5\t6\n0\t\t2\n"[..]).unwrap();
    assert!(drain(tabs).unwrap().frames[0][0].is_nan(), "an empty cell between tabs of a stream");
    let stream = ReadingsReader::stream(Path::new("-"), text.as_bytes());
    assert!(message(stream).contains("in a file"), "its taxels are not known at its beginning");
}

#[test]
fn after_a_broken_row_the_next_one_is_read() {
    let text = &b"5.p,6.p\n1\n3,4\n"[..];
    let mut reader = ReadingsReader::stream(Path::new("-"), text).unwrap();
    let (mut values, mut time) = (Vec::new(), 0.0);
    assert!(reader.read(&mut values, &mut time).is_err());
    assert!(reader.read(&mut values, &mut time).unwrap());
    assert_eq!(values, [3.0, 4.0]);
    assert!(!reader.read(&mut values, &mut time).unwrap());
}

/// A line without end is given up instead of filling the memory.
#[test]
fn an_endless_line_is_refused() {
    let endless = io::Cursor::new("5.p,6.p\n").chain(io::repeat(b'1'));
    let mut reader = ReadingsReader::stream(Path::new("-"), endless).unwrap();
    let found = message(reader.read(&mut Vec::new(), &mut 0.0));
    assert!(found.contains("line 2: found more than 16777216 bytes"), "{found}");
    assert!(message(ReadingsReader::stream(Path::new("-"), io::repeat(b'1'))).contains("line 1"));
}

/// As many channels as ids ask for a frame of their product.
#[test]
fn a_header_cannot_ask_for_more_memory_than_a_frame_may_have() {
    let header: Vec<String> = (0..5000).map(|k| format!("{k}.channel{k}")).collect();
    let found = message(read("a.csv", (header.join(",") + "\n").as_bytes()));
    assert!(found.contains("5000 taxels and 5000 channels"), "{found}");
}

#[test]
fn arrays_of_wrong_sizes_are_refused() {
    let elements = doubles([1.0; 6]);
    let huge = usize::MAX / 16;
    for (bytes, place) in [
        (npy("<f8", &[4, 2], &elements), "the shape (4, 2) f8 in"),
        (npy("<f8", &[2, 2], &elements), "the shape (2, 2) f8 in"),
        (npy("<f8", &[huge, huge], &elements), "fewer than 2^64 bytes"),
        (npy("<f8", &[0, 1 << 60], b""), "at least one frame"),
        (npy("<f8", &[1, 1, 1, 6], &elements), "(1, 1, 1, 6) f8"),
        (npy("|S8", &[3, 2], &elements), "numbers of the shape (T, N)"),
        (npy("|O", &[3, 2], &elements), "(3, 2) objects"),
        (npy("<f8", &[3, 2], &elements)[..40].to_vec(), "an end within its header"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec(), "a header of 4294967295 bytes"),
        (b"not an array at all".to_vec(), "version 1, 2 or 3"),
    ] {
        let found = message(read("a.npy", &bytes));
        assert!(found.contains(place), "{place:?} is named in {found:?}");
    }
}

#[test]
fn archives_whose_arrays_do_not_fit_are_refused() {
    let values = || ("values", npy("<f8", &[3, 4], &doubles([1.0; 12])));
    let other = |name| (name, npy("<f8", &[3, 4], &doubles([1.0; 12])));
    let named = |name, descriptor, count: usize, bytes: &[u8]| (name, npy(descriptor, &[count], bytes));
    for (arrays, place) in [
        (vec![values(), named("ids", "<f8", 3, &doubles([1.0; 3]))], "one for each taxel"),
        (vec![values(), named("ids", "<f8", 4, &doubles([1.0, -2.0, 2.0, 3.0]))], "element 1: found -2"),
        (vec![values(), named("timestamps", "<f8", 2, &doubles([0.0; 2]))], "one for each frame"),
        (vec![values(), named("timestamps", "<f8", 3, &doubles([0.0, f64::NAN, 1.0]))], "row 1: found NaN"),
        (vec![values(), named("timestamps", "<f8", 3, &doubles([1.7e12; 3]))], "row 0: found 1700000000000"),
        (vec![values(), named("units", "<f8", 1, &doubles([1.0]))], "needed: strings"),
        (vec![other("a"), other("b")], "a (3, 4) f8, b (3, 4) f8"),
        (vec![values(), values()], "2 entries, of which 1 have other names"),
        (vec![values(), other("readings")], "array `readings`: found array `values` too"),
        (
            vec![
                values(),
                named("ids", "<f8", 4, &doubles([1.0; 4])),
                named("taxel_ids", "<f8", 4, &doubles([1.0; 4])),
            ],
            "found array `ids` too",
        ),
        (vec![], "arrays: found none"),
    ] {
        let found = message(read("a.npz", &npz(&arrays, false)));
        assert!(found.contains(place), "{place:?} is named in {found:?}");
    }
    // The ids say that the layout is the other one.
    let arrays = [
        ("values", npy("<f8", &[3, 2, 4], &doubles(numbers(false)))),
        ("ids", npy("<f8", &[4], &doubles([1.0, 2.0, 3.0, 4.0]))),
    ];
    let found = message(read("a.npz", &npz(&arrays, false)));
    assert!(found.contains("(3, 2, 4)") && found.contains("the other order"), "{found}");
    assert!(read_as("a.npz", &npz(&arrays, false), ReadingsLayout::ChannelsFirst).is_ok());
}

/// A byte of an element in an archive is noticed by its checksum, and a cut by the end of the file.
#[test]
fn a_damaged_archive_is_refused() {
    let mut bytes = npz(&[("values", npy("<f8", &[3, 8], &doubles(numbers(false))))], false);
    assert!(read("a.npz", &bytes[..bytes.len() / 2]).is_err());
    let late = message(read("a.npz", &[&bytes[..], &[0; 100_000]].concat()));
    assert!(late.contains("end"), "the end of an archive is looked for at the end of the file: {late}");
    let at = bytes.windows(8).position(|w| w == value(1, 0, 0).to_le_bytes()).unwrap();
    bytes[at] ^= 1;
    let found = message(read("a.npz", &bytes));
    assert!(found.contains("checksum"), "{found}");
}

#[test]
fn gains_are_read() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("gains.csv");
    let read = |text: &str| {
        fs::write(&path, text).unwrap();
        read_gains(&path)
    };
    for (text, unused) in
        [("gain, id\n0.5,7\n-2,9\n", &[][..]), ("taxel_id,note,Gain\n7,,0.5\n9,x,-2\n", &["note"])]
    {
        let table = read(text).unwrap();
        assert_eq!(table.rows, [(TaxelId(7), 0.5), (TaxelId(9), -2.0)]);
        assert_eq!(table.unused, unused);
    }
    for (text, place) in [
        ("id\n7\n", "a column `gain`"),
        ("id,gain\n7,1\n7,2\n", "line 3, column `id`"),
        ("id,gain\n7,inf\n", "line 2, column `gain`"),
        ("id,gain\n-7,1\n", "line 2, column `id`"),
    ] {
        let found = message(read(text));
        assert!(found.contains(place), "{place:?} is named in {found:?}");
    }
}

/// What was written to a pipe; reading more than that is an error instead of waiting.
#[derive(Clone, Default)]
struct Pipe(Arc<Mutex<VecDeque<u8>>>);

impl Pipe {
    fn write(&self, text: &str) {
        self.0.lock().unwrap().extend(text.bytes());
    }
}

impl Read for Pipe {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut bytes = self.0.lock().unwrap();
        if bytes.is_empty() {
            return Err(io::Error::other("read before it was written"));
        }
        bytes.read(buffer)
    }
}

#[test]
fn a_stream_is_read_row_by_row() {
    for (header, row) in [("time,5,6\n", "0.5,1,2\n"), ("5 6\n", "0 0.5 1 2\r\n")] {
        let pipe = Pipe::default();
        pipe.write(header);
        let mut reader = ReadingsReader::stream(Path::new("-"), pipe.clone()).unwrap();
        let (mut values, mut time) = (Vec::new(), 0.0);
        for _ in 0..3 {
            pipe.write(row);
            assert!(reader.read(&mut values, &mut time).unwrap());
            assert_eq!((values.as_slice(), time), (&[1.0, 2.0][..], 0.5));
        }
    }
}

/// Two patches of 9 and 4 taxels, with an absent one, a thermal pad, and an id in both.
fn two_patches() -> SkinMap {
    let mut map = SkinMap::flat(shapes::lattice(3, 3, 0.004), 1e-3);
    let mut other = SkinMap::flat(shapes::lattice(2, 2, 0.004), 1e-3).patches.into_iter().next().unwrap();
    other.name = "other".into();
    for (v, id) in [(0, 100), (1, 101), (2, 102), (3, 4)] {
        other.taxels.ids[VertexId::new(v)] = TaxelId(id);
    }
    other.taxels.presence[VertexId::new(0)] = Presence::ThermalPad;
    map.patches[PatchId::new(0)].taxels.presence[VertexId::new(8)] = Presence::Absent;
    map.patches.push(other);
    map
}

fn ids(ids: &[u32]) -> Vec<TaxelId> {
    ids.iter().copied().map(TaxelId).collect()
}

fn taxels(frame: &Frame, channel: usize) -> Vec<f64> {
    frame.values.iter().flat_map(|patch| patch[channel].iter().copied()).collect()
}

#[test]
fn columns_find_their_taxels() {
    let map = two_patches();
    // Taxels 1 to 9 (9 is absent), then 100 (a pad), 101, 102 and 4 again.
    let columns = ids(&[101, 77, 4, 9, 100, 1, 78]);
    let join = Join::new(&map, Some(&columns), 7, Duplicates::Refuse).unwrap();
    let report = &join.report();
    assert_eq!((report.matched, report.masked, report.unknown), (4, 9, 2));
    assert_eq!((report.first_unknown.as_slice(), report.shared), (&ids(&[77, 78])[..], 1));
    let mut frame = Frame::new(&map, 2);
    let values: Vec<f64> = (0..14).map(f64::from).collect();
    assert_eq!(join.fill(&values, &mut frame), 0);
    for (channel, add) in [(0, 0.0), (1, 7.0)] {
        let found = taxels(&frame, channel);
        let known: Vec<(usize, f64)> =
            found.iter().enumerate().filter(|(_, x)| !x.is_nan()).map(|(k, &x)| (k, x - add)).collect();
        assert_eq!(known, [(0, 5.0), (3, 2.0), (10, 0.0), (12, 2.0)]);
    }
    // Missing readings are masked and counted: that of taxel 4 twice.
    let mut values = values;
    (values[2], values[7], values[1]) = (f64::INFINITY, f64::NAN, f64::NAN);
    assert_eq!(join.fill(&values, &mut frame), 3);
    assert!(taxels(&frame, 0)[3].is_nan() && taxels(&frame, 1)[10].is_nan());
}

#[test]
fn without_ids_columns_are_the_taxels_in_order() {
    let map = two_patches();
    let join = Join::new(&map, None, 13, Duplicates::Refuse).unwrap();
    assert_eq!((join.report().matched, join.report().masked), (11, 2));
    let mut frame = Frame::new(&map, 1);
    assert_eq!(join.fill(&(0..13).map(f64::from).collect::<Vec<_>>(), &mut frame), 0);
    for (k, x) in taxels(&frame, 0).into_iter().enumerate() {
        assert_eq!(x.is_nan(), [8, 9].contains(&k), "absent taxels and pads are masked");
        assert!(x.is_nan() || x == k as f64);
    }
    let error = Join::new(&map, None, 12, Duplicates::Refuse).unwrap_err();
    assert_eq!(error, SignalError::Width { found: 12, needed: 13 });
    assert!(error.to_string().contains("an array `ids` with the taxel id of each of the 12 columns"));
}

#[test]
fn columns_with_the_same_id_are_refused_or_the_first_is_taken() {
    let map = two_patches();
    let columns = ids(&[3, 5, 3, 77, 3]);
    let refused = Join::new(&map, Some(&columns), 5, Duplicates::Refuse).unwrap_err();
    assert_eq!(refused, SignalError::DuplicateId { taxel: TaxelId(3), columns: [0, 2] });
    let mut frame = Frame::new(&map, 1);
    let join = Join::new(&map, Some(&columns), 5, Duplicates::First).unwrap();
    assert_eq!((join.report().duplicates, join.report().unknown), (2, 1));
    join.fill(&[1.0, 9.0, 5.0, 0.0, 9.0], &mut frame);
    assert_eq!(taxels(&frame, 0)[2], 1.0);
    let ids_lack = Join::new(&map, Some(&columns), 6, Duplicates::First).unwrap_err();
    assert_eq!(ids_lack, SignalError::IdCount { ids: 5, width: 6 });
    let empty = Join::new(&map, Some(&[]), 0, Duplicates::Refuse).unwrap_err();
    assert_eq!(empty, SignalError::Width { found: 0, needed: 13 });
    let foreign = Join::new(&map, Some(&ids(&[500, 501])), 2, Duplicates::Refuse).unwrap_err();
    assert!(foreign.to_string().contains("the first is 500, that of the map 1"), "{foreign}");
}

/// Frames as the conditioner passes them on.
fn apply(conditioner: &mut Conditioner, frames: &[Frame]) -> Vec<Frame> {
    let first = conditioner.frames_to_learn().min(frames.len());
    frames[..first].iter().for_each(|frame| conditioner.learn(frame));
    conditioner.settle();
    frames.iter().map(|frame| conditioner.apply(frame).clone()).collect()
}

/// Frames of one channel with these times, in which the number of a taxel in its patch is added to a number.
fn condition(map: &SkinMap, options: &ConditionOptions, frames: &[(f64, f64)]) -> (Vec<Frame>, Conditioner) {
    let mut conditioner = Conditioner::new(map, &[Channel::default()], options).unwrap();
    let frame = |&(time, x): &(f64, f64)| {
        let mut frame = Frame { time, ..Frame::new(map, 1) };
        for taxel in frame.values.iter_mut().flatten() {
            taxel.iter_mut().zip(0_u8..).for_each(|(y, k)| *y = x + f64::from(k));
        }
        frame
    };
    let frames: Vec<Frame> = frames.iter().map(frame).collect();
    (apply(&mut conditioner, &frames), conditioner)
}

#[test]
fn the_baseline_is_the_mean_of_the_first_frames() {
    let map = two_patches();
    let frames: Vec<(f64, f64)> = (0..6).map(|t| (f64::from(t), f64::from(t) * 2.0)).collect();
    for (baseline, mean) in [(0, None), (1, Some(0.0)), (4, Some(3.0)), (50, Some(5.0))] {
        let options = ConditionOptions { zero: Zero::First(baseline), ..ConditionOptions::default() };
        let (out, _) = condition(&map, &options, &frames);
        assert_eq!(out.len(), 6);
        for (frame, &(time, x)) in out.iter().zip(&frames) {
            assert_eq!(frame.time, time);
            for patch in &frame.values {
                for (k, &y) in patch[0].iter().enumerate() {
                    let expected = mean.map_or(x + k as f64, |mean| x - mean);
                    assert!((y - expected).abs() < 1e-12, "{baseline}: {y} is not {expected}");
                }
            }
        }
    }
    let too_many = ConditionOptions { zero: Zero::First(usize::MAX), ..ConditionOptions::default() };
    let error = Conditioner::new(&map, &[Channel::default()], &too_many).unwrap_err();
    assert!(matches!(error, SignalError::Option { .. }), "{error}");
}

#[test]
fn a_taxel_without_a_baseline_is_masked() {
    let map = two_patches();
    let options = ConditionOptions { zero: Zero::First(2), ..ConditionOptions::default() };
    let mut conditioner = Conditioner::new(&map, &[Channel::default()], &options).unwrap();
    let (first, taxels) = (PatchId::new(0), [0, 1].map(VertexId::new));
    let frames = [[f64::NAN, f64::NAN], [1.0, f64::NAN], [4.0, 4.0]].map(|values| {
        let mut frame = Frame::new(&map, 1);
        taxels.iter().zip(values).for_each(|(&taxel, x)| frame.values[first][0][taxel] = x);
        frame
    });
    let seen: Vec<(f64, f64)> = apply(&mut conditioner, &frames)
        .iter()
        .map(|frame| (frame.values[first][0][taxels[0]], frame.values[first][0][taxels[1]]))
        .collect();
    assert!(seen[0].0.is_nan(), "a reading that is missing stays so");
    assert_eq!((seen[1].0, seen[2].0), (0.0, 3.0), "the mean of those that are there");
    assert!(seen[2].1.is_nan());
    assert_eq!(conditioner.report().without_baseline, 12);
}

#[test]
fn gains_and_bounds_follow_the_baseline() {
    let map = two_patches();
    let options = ConditionOptions {
        zero: Zero::First(1),
        gains: vec![(TaxelId(2), 10.0), (TaxelId(101), -1.0), (TaxelId(999), 3.0)],
        clip: Some([-1.5, 15.0]),
        ..ConditionOptions::default()
    };
    let (out, conditioner) = condition(&map, &options, &[(0.0, 5.0), (1.0, 6.0), (2.0, 7.0)]);
    let found: Vec<Vec<f64>> = out.iter().map(|f| taxels(f, 0)).collect();
    assert_eq!((found[1][0], found[1][1], found[1][10]), (1.0, 10.0, -1.0));
    assert_eq!((found[2][0], found[2][1], found[2][10]), (2.0, 15.0, -1.5), "20 and -2 are clipped");
    assert_eq!((conditioner.report().clipped, conditioner.report().unknown_gains), (2, 1));
    let options = ConditionOptions { gains: vec![(TaxelId(2), 10.0)], ..ConditionOptions::default() };
    // The fast part of a jump from one end of the range to the other is twice as large.
    let split = ConditionOptions { split_hz: Some(1e-9), ..ConditionOptions::default() };
    let (out, conditioner) = condition(&map, &split, &[(0.0, -3.3e38), (1.0, 3.3e38)]);
    assert!(taxels(&out[1], 1).iter().all(|x| x.is_nan()) && taxels(&out[1], 0).iter().all(|x| *x < 0.0));
    assert_eq!(conditioner.report().too_large, taxels(&out[1], 1).len() as u64);
    let (out, conditioner) = condition(&map, &options, &[(0.0, 1e38), (1.0, 3.5e38)]);
    let found: Vec<Vec<f64>> = out.iter().map(|f| taxels(f, 0)).collect();
    assert_eq!(
        conditioner.report().too_large,
        u64::try_from(1 + found[1].len()).unwrap(),
        "beyond the range of 32-bit floats"
    );
    assert_eq!(found[0].iter().filter(|x| x.is_nan()).count(), 1);
    assert!(found[1].iter().all(|x| x.is_nan()), "masked");
    let refused = |options| Conditioner::new(&map, &[Channel::default()], &options).unwrap_err();
    for clip in [[1.0, 1.0], [f64::NAN, 1.0], [2.0, 1.0]] {
        let error = refused(ConditionOptions { clip: Some(clip), ..ConditionOptions::default() });
        assert!(matches!(error, SignalError::Option { .. }), "{error}");
    }
    for hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = refused(ConditionOptions { split_hz: Some(hz), ..ConditionOptions::default() });
        assert!(matches!(error, SignalError::Option { .. }), "{error}");
    }
    let gains = vec![(TaxelId(2), f64::NAN)];
    let error = refused(ConditionOptions { gains, ..ConditionOptions::default() });
    assert!(matches!(error, SignalError::Option { .. }), "{error}");
}

#[test]
fn times_that_go_backwards_are_counted_and_move_filters_by_the_usual_step() {
    let map = two_patches();
    let options = ConditionOptions { split_hz: Some(1.0), ..ConditionOptions::default() };
    let frames = [(0.0, 0.0), (0.1, 0.0), (0.05, 8.0), (f64::NAN, 8.0), (0.05, 8.0), (0.25, 8.0)];
    let (out, conditioner) = condition(&map, &options, &frames);
    assert_eq!(conditioner.report().backwards, 2);
    let slow: Vec<f64> = out.iter().map(|f| taxels(f, 0)[0]).collect();
    for (slow, passed) in slow.into_iter().zip([0.0, 0.0, 0.1, 0.2, 0.2, 0.4]) {
        let expected = 8.0 * (1.0 - (-std::f64::consts::TAU * passed).exp());
        assert!((slow - expected).abs() < 1e-12, "{slow} is not {expected}");
    }
}

#[test]
fn a_split_has_two_channels_for_each() {
    let map = two_patches();
    let channels = [Channel::new("force.N", "N").unwrap(), Channel::new("heat", "K").unwrap()];
    let options = ConditionOptions { split_hz: Some(1.0), ..ConditionOptions::default() };
    let mut conditioner = Conditioner::new(&map, &channels, &options).unwrap();
    let names: Vec<&str> = conditioner.channels().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["force.N.slow", "force.N.fast", "heat.slow", "heat.fast"]);
    assert_eq!(conditioner.channels()[1].quantity, Quantity::Extensive);
    let mut frame = Frame::new(&map, 2);
    frame.values[PatchId::new(1)][1][VertexId::new(2)] = 3.0;
    let out = conditioner.apply(&frame);
    let found: Vec<f64> = (0..4).map(|c| out.values[PatchId::new(1)][c][VertexId::new(2)]).collect();
    assert!(found[0].is_nan() && found[1].is_nan());
    assert_eq!(found[2..], [3.0, 0.0], "the first reading is slow");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A taxel has the reading of the column with its id, whatever their order, and nothing else.
    #[test]
    fn a_taxel_has_the_reading_of_its_id(columns in proptest::collection::hash_set(0_u32..120, 1..60)) {
        let map = two_patches();
        let columns: Vec<TaxelId> = columns.into_iter().map(TaxelId).collect();
        match Join::new(&map, Some(&columns), columns.len(), Duplicates::Refuse) {
            Err(SignalError::NoneMatched { .. }) => {
                for patch in &map.patches {
                    prop_assert!(patch.taxels.ids.iter().all(|id| !columns.contains(id)));
                }
            }
            join => {
                let join = join.unwrap();
                let values: Vec<f64> = columns.iter().map(|id| f64::from(id.0) + 0.5).collect();
                let mut frame = Frame::new(&map, 1);
                prop_assert_eq!(join.fill(&values, &mut frame), 0);
                let (mut matched, mut total) = (0, 0);
                for (id, patch) in map.patches.enumerate() {
                    for (v, taxel) in patch.taxels.ids.enumerate() {
                        total += 1;
                        let x = frame.values[id][0][v];
                        let is_live = patch.taxels.presence[v] == Presence::Present && columns.contains(taxel);
                        matched += usize::from(is_live);
                        prop_assert_eq!(x.is_nan(), !is_live);
                        prop_assert!(!is_live || x == f64::from(taxel.0) + 0.5);
                    }
                }
                prop_assert_eq!((join.report().matched, join.report().masked), (matched, total - matched));
            }
        }
    }

    /// Slow and fast parts add up to the reading but for one rounding of the larger one.
    #[test]
    fn slow_and_fast_parts_add_up(
        steps in proptest::collection::vec((0.0_f64..0.2, -1e3_f64..1e3), 1..40),
        hz in 0.1_f64..100.0,
    ) {
        let map = two_patches();
        let mut time = 0.0;
        let frames: Vec<(f64, f64)> = steps.iter().map(|&(dt, x)| { time += dt; (time, x) }).collect();
        let options = ConditionOptions { split_hz: Some(hz), ..ConditionOptions::default() };
        let (out, _) = condition(&map, &options, &frames);
        for (frame, &(_, x)) in out.iter().zip(&frames) {
            let (slow, fast) = (taxels(frame, 0)[0], taxels(frame, 1)[0]);
            let tolerance = f64::EPSILON * slow.abs().max(x.abs());
            prop_assert!((slow + fast - x).abs() <= tolerance, "{slow} + {fast} is not {x}");
        }
    }

    /// The filter's answer to a step does not depend on when frames are taken.
    #[test]
    fn the_filter_follows_real_time(steps in proptest::collection::vec(1e-3_f64..0.1, 1..40), hz in 0.1_f64..20.0) {
        let map = two_patches();
        let mut time = 0.0;
        let mut frames = vec![(0.0, 0.0)];
        frames.extend(steps.iter().map(|dt| { time += dt; (time, 1.0) }));
        let options = ConditionOptions { split_hz: Some(hz), ..ConditionOptions::default() };
        let (out, _) = condition(&map, &options, &frames);
        for (frame, &(time, _)) in out.iter().zip(&frames) {
            let expected = 1.0 - (-std::f64::consts::TAU * hz * time).exp();
            prop_assert!((taxels(frame, 0)[0] - expected).abs() < 1e-12);
        }
    }
}

/// The laboratory's own recordings and the cover that they were made with, if they are here.
#[test]
fn real_recordings_are_read_and_joined() {
    let Some(folder) = data("cyskin") else { return };
    let draft = read_draft(&folder.join("curved_gesture_patch_isomap.json")).unwrap();
    let skin = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let mut recordings: Vec<PathBuf> =
        fs::read_dir(folder.join("recordings")).unwrap().map(|e| e.unwrap().path()).collect();
    recordings.sort();
    assert_eq!(recordings.len(), 6);
    for path in recordings {
        let reader = ReadingsReader::open(&path, ReadingsLayout::default()).unwrap();
        let join = Join::new(&map, reader.ids.as_deref(), reader.width, Duplicates::Refuse).unwrap();
        assert_eq!((join.report().matched, join.report().masked), (634, 8), "{}", path.display());
        let found = drain(reader).unwrap();
        assert_eq!((found.width, found.frames.len()), (716, 30));
        assert!(found.times.windows(2).all(|t| t[0] < t[1]));
        let mut frame = Frame::new(&map, 1);
        assert!(found.frames.iter().all(|values| join.fill(values, &mut frame) == 0));
    }
}

/// Reads arrays by a layout of cells of this shape.
fn laid(arrays: &[(&str, Vec<u8>)], axes: &[&str], changes: serde_json::Value) -> Result<Recorded, IoError> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.npz");
    fs::write(&path, npz(arrays, false)).unwrap();
    let mut json = serde_json::json!({"dermatome_layout": 1, "axes": axes, "time": {"rate": 10}, "stream": "data",
        "channels": [{"name": "pressure", "unit": "kPa"}], "press": "raises", "zero": {"stream": "rest"},
        "taxels": {"shape": [2]}, "missing": [-1]});
    for (key, value) in changes.as_object().unwrap() {
        json[key] = value.clone();
    }
    let layout = Layout::parse(Path::new("l.json"), &json.to_string())?;
    drain(ReadingsReader::open(&path, ReadOptions { layout: Some(layout), ..ReadOptions::default() })?)
}

/// Zeros of a stream are one for all frames, one beside each frame, one of each episode, or the mean of other rows; numbers that
/// stand for none are no zero.
#[test]
fn zeros_of_a_stream_are_those_of_frames_and_episodes() {
    let f8 = |shape: &[usize], numbers: &[f64]| npy("<f8", shape, &doubles(numbers.iter().copied()));
    let frames = f8(&[3, 2], &[11.0, 21.0, 12.0, 22.0, 13.0, 23.0]);
    let read = |rest: Vec<u8>| {
        let found =
            laid(&[("data", frames.clone()), ("rest", rest)], &["frame", "taxel"], serde_json::json!({}));
        found.unwrap().frames.concat()
    };
    let all = [1.0, 1.0, 2.0, 2.0, 3.0, 3.0];
    assert_eq!(read(f8(&[2], &[10.0, 20.0])), all);
    assert_eq!(read(f8(&[1, 2], &[10.0, 20.0])), all);
    let rows = [9.0, 20.0, -1.0, 20.0, 11.0, f64::NAN, 10.0, 20.0];
    assert_eq!(read(f8(&[4, 2], &rows)), all, "the mean of what is known");
    assert_eq!(read(f8(&[3, 2], &[10.0, 20.0, 11.0, 20.0, 12.0, 20.0])), [1.0, 1.0, 1.0, 2.0, 1.0, 3.0]);
    for rest in
        [f8(&[2], &[10.0, -1.0]), f8(&[4, 2], &[10.0, -1.0].repeat(4)), f8(&[3, 2], &[10.0, -1.0].repeat(3))]
    {
        let found = read(rest);
        assert!(found.iter().enumerate().all(|(k, x)| x.is_nan() == (k % 2 == 1)), "{found:?}");
    }
    // Two episodes of three frames, the second 30 higher.
    let data = [11.0, 21.0, 12.0, 22.0, 13.0, 23.0, 41.0, 51.0, 42.0, 52.0, 43.0, 53.0];
    let mut beside = [10.0, 20.0].repeat(3);
    beside.extend([40.0, 50.0].repeat(3));
    for (axes, shape, data) in [
        (["episode", "frame", "taxel"], [2, 3, 2], data.to_vec()),
        // Episodes last: number (frame, taxel, episode).
        (["frame", "taxel", "episode"], [3, 2, 2], {
            let at = |e: usize, f: usize, c: usize| data[6 * e + 2 * f + c];
            (0..12).map(|k| at(k % 2, k / 4, k / 2 % 2)).collect()
        }),
    ] {
        let zeros: Vec<(Vec<usize>, Vec<f64>)> = match axes[0] {
            "episode" => vec![(vec![2, 2], vec![10.0, 20.0, 40.0, 50.0]), (vec![2, 3, 2], beside.clone())],
            _ => vec![(vec![2, 2], vec![10.0, 40.0, 20.0, 50.0])],
        };
        for (of_zeros, zeros) in zeros {
            for episode in [None, Some(1)] {
                let mut changes = serde_json::json!({});
                episode.into_iter().for_each(|k: u64| changes["episode"] = k.into());
                let arrays = [("data", f8(&shape, &data)), ("rest", f8(&of_zeros, &zeros))];
                let found = laid(&arrays, &axes, changes).unwrap().frames.concat();
                let expected = if episode.is_none() { all.repeat(2) } else { all.to_vec() };
                assert_eq!(found, expected, "{axes:?} {of_zeros:?} {episode:?}");
            }
        }
    }
    let error = message(laid(
        &[("data", frames.clone()), ("rest", f8(&[3], &[1.0; 3]))],
        &["frame", "taxel"],
        serde_json::json!({}),
    ));
    assert!(error.contains("or rows of them"), "{error}");
}

/// What an archive states of its readings is compared with a layout, and its threshold is taken; axes that it has not are refused.
#[test]
fn archives_are_compared_with_a_layout() {
    let f8 = |shape: &[usize], numbers: &[f64]| npy("<f8", shape, &doubles(numbers.iter().copied()));
    let axes = ["frame", "taxel", "component"];
    let data = || ("data", f8(&[2, 2, 2], &[1.0; 8]));
    let channels =
        serde_json::json!({"zero": 0, "channels": [{"name": "pressure", "unit": "Pa", "component": 0}]});
    let names = npy("<U8", &[2], &unicode(&["temp", "pressure"], 8));
    let error = message(laid(&[data(), ("channels", names)], &axes, channels.clone()));
    assert!(error.contains("pressure as component 1"), "{error}");
    let tared = || ("is_tared", npy("|u1", &[], &[1]));
    let mut other = channels.clone();
    other["zero"] = 5.into();
    assert!(message(laid(&[data(), tared()], &axes, other)).contains("`is_tared` 1"));
    // One number for each component, of which the layout has the first or the second.
    for (component, fits) in [(0, true), (1, false)] {
        let each = ("is_tared", npy("|u1", &[2], &[0, 1]));
        let mut other = channels.clone();
        other["zero"] = 5.into();
        other["channels"][0]["component"] = component.into();
        let said =
            laid(&[data(), each], &axes, other).err().map_or_else(String::new, |error| error.to_string());
        assert_eq!(said.contains("`is_tared` 1 of component 1"), !fits, "{said}");
    }
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.npz");
    fs::write(&path, npz(&[data(), tared(), ("threshold", f8(&[], &[0.5]))], false)).unwrap();
    let json = serde_json::json!({"dermatome_layout": 1, "axes": axes, "time": {"rate": 10}, "stream": "data", "press": "raises",
        "zero": "taken", "taxels": {"shape": [2]}, "channels": channels["channels"].clone()});
    let layout = Some(Layout::parse(Path::new("l.json"), &json.to_string()).unwrap());
    let reader = ReadingsReader::open(&path, ReadOptions { layout, ..ReadOptions::default() }).unwrap();
    assert_eq!(reader.rest, KnownRest { is_zero: vec![true], threshold: Some(0.5) });
    // Fewer axes than the layout, or none.
    for shape in [&[3, 36][..], &[36], &[]] {
        let numbers = vec![1.0; shape.iter().product()];
        let found = laid(
            &[("data", f8(shape, &numbers))],
            &["pad", "row", "col", "frame"],
            serde_json::json!({"zero": 0}),
        );
        assert!(message(found).contains("axes: found"), "{shape:?}");
    }
    let path = folder.path().join("one.npy");
    fs::write(&path, f8(&[], &[3.0])).unwrap();
    let error = ReadingsReader::draft_layout(&path, None).unwrap_err().to_string();
    assert!(error.contains("axes: found 0 axes"), "{error}");
}

/// Dates state their unit, whatever the array is called; and kinds that names and units do not tell are read back.
#[test]
fn dates_and_kinds_are_those_that_are_stated() {
    let values = || ("values", npy("<f8", &[2, 1], &doubles([1.0, 2.0])));
    let dates = npy("<M8[ms]", &[2], &[5_000_i64, 5_500].map(i64::to_le_bytes).concat());
    for name in ["timestamps", "time", "time[ms]"] {
        let found = read("a.npz", &npz(&[values(), (name, dates.clone())], false)).unwrap();
        assert_eq!(found.times, [5.0, 5.5], "{name}");
    }
    let folder = TempDir::new().unwrap();
    let skin = Skin::from_mesh("square", shapes::square());
    let channel = |name: &str, kind| Channel { kind, ..Channel::new(name, "count").unwrap() };
    let channels = [channel("a", ChannelKind::Other), channel("p", ChannelKind::Touch)];
    let frame = Frame::new(&SkinMap::flat(shapes::square(), 0.1), 2);
    let create = |name: &str, channels: &[Channel]| {
        ReadingsWriter::create(
            folder.path().join(name).as_path(),
            skin.patches.iter().map(|p| &p.taxels),
            ReadingsColumns { channels, has_times: true },
        )
    };
    let mut writer = create("a.npz", &channels).unwrap();
    writer.state_rest(&KnownRest { is_zero: vec![false, true], threshold: None }).unwrap();
    writer.write(&frame).unwrap();
    writer.finish().unwrap();
    let reader = ReadingsReader::open(&folder.path().join("a.npz"), ReadingsLayout::default()).unwrap();
    assert_eq!((&reader.channels[..], &reader.rest.is_zero[..]), (&channels[..], &[false, true][..]));
    // A table states names alone.
    let refused = |channels: &[Channel]| create("a.csv", channels).err().unwrap().to_string();
    assert!(refused(&channels).contains("of the kind other"));
    assert!(
        refused(&[channel("p", ChannelKind::Touch), channel("p", ChannelKind::Touch)])
            .contains("\"p\" twice")
    );
    let two = [channel("a", ChannelKind::Touch), channel("p", ChannelKind::Touch)];
    let mixed =
        create("a.csv", &two).unwrap().state_rest(&KnownRest { is_zero: vec![false, true], threshold: None });
    assert!(mixed.unwrap_err().to_string().contains("all channels that measure touches"));
    let mut writer = create("b.npz", &two).unwrap();
    writer.state_rest(&KnownRest { is_zero: vec![false, true], threshold: None }).unwrap();
    writer.write(&frame).unwrap();
    writer.finish().unwrap();
    let reader = ReadingsReader::open(&folder.path().join("b.npz"), ReadingsLayout::default()).unwrap();
    assert_eq!(reader.rest.is_zero, [false, true]);
}
