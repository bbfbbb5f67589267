//! Every reader, from damaged files of its kind; what could be read is used, written and read again.

use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::{env, fs, process};

use dermatome::contact::IndexOptions;
use dermatome::id::{IdVec, VertexId};
use dermatome::io::{self, Readings, ReadingsLayout, ReadingsReader};
use dermatome::map::SkinMap;
use dermatome::skin::{Link, TaxelId, Weld, check as check_draft};
use dermatome::{AssembleOptions, ContactIndex, Draft, LevelId, MapIndex, Skin, assemble, calibrate, remesh};
use glam::{DAffine3, DVec3};
use mutate::{Random, damage};
use serde_json::{Value, json};
use zip::ZipArchive;

use crate::{Counts, Outcome, seeds, text};

/// What replaces cells, lines and values of attributes.
#[rustfmt::skip]
const TEXTS: [&str; 36] = [
    "0", "-1", "7", "4294967296", "18446744073709551616", "-9223372036854775808", "1e308", "5e-324", "1e39", "1e-9",
    "nan", "inf", "", "-0", "1e400", "\"", "<", "&", "\0", "\u{1b}[31m", "\u{202e}", "\n", ",", ";", "../x", "true",
    "é", "time", "taxel_id", "#g", "#p", "revolute", "base", "VERTEX", "0 0 0", "1e308 0 0",
];

/// Patches with more triangles are not assembled: the input would be large, not hostile.
const MAX_TRIANGLES: usize = 5000;

/// Valid files of every kind, by name.
static SEEDS: LazyLock<Vec<(String, Vec<u8>)>> =
    LazyLock::new(|| seeds::make(&FOLDER).unwrap_or_else(|error| panic!("no seeds: {error}")));

/// Where files lie that are read by their path.
pub(crate) static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = env::temp_dir().join(format!("dermatome-fuzz-{}", process::id()));
    let _ = fs::create_dir_all(&folder);
    folder
});

pub(crate) fn generate(random: &mut Random) -> (String, Vec<u8>) {
    let (name, bytes) = random.pick(&SEEDS).clone();
    if random.chance(0.25) {
        return (name, damage(&bytes, random));
    }
    let damaged = match extension(&name) {
        "glb" => damage_glb(&bytes, random),
        "json" | "gltf" => damage_json(&bytes, random),
        "npy" => damage_npy(&bytes, random),
        "npz" => damage_npz(&bytes, random),
        "csv" | "obj" | "off" | "g2o" | "txt" | "log" | "asf" | "asc" | "lst" | "jsonl" => {
            damage_cells(&bytes, random)
        }
        "urdf" | "dae" | "xml" => damage_attribute(&bytes, random),
        _ => None,
    };
    let bytes = damaged.unwrap_or_else(|| damage(&bytes, random));
    (name, bytes)
}

fn extension(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or_default()
}

/// One to three values of a tree replaced, removed or repeated.
fn damage_json(bytes: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let mut tree: Value = serde_json::from_slice(bytes).ok()?;
    for _ in 0..=random.below(3) {
        damage_value(&mut tree, random, 0);
    }
    serde_json::to_vec(&tree).ok()
}

fn damage_value(value: &mut Value, random: &mut Random, depth: usize) {
    let ends = depth > 12 || random.chance(0.15);
    match value {
        Value::Array(values) if !values.is_empty() && !ends => {
            let at = random.below(values.len());
            match random.below(16) {
                0 => values.insert(at, values[at].clone()),
                1 => drop(values.remove(at)),
                _ => damage_value(&mut values[at], random, depth + 1),
            }
        }
        Value::Object(members) if !members.is_empty() && !ends => {
            let at = random.below(members.len());
            let key = members.keys().nth(at).cloned().unwrap_or_default();
            match members.get_mut(&key) {
                Some(value) if !random.chance(0.06) => damage_value(value, random, depth + 1),
                _ => drop(members.remove(&key)),
            }
        }
        _ => {
            let number = value.as_f64().unwrap_or(1.0);
            #[rustfmt::skip]
            let all = [
                json!(null), json!([]), json!({}), json!(""), json!(true), json!(-1), json!(4_294_967_296_u64),
                json!(random.below(20)), json!(number + 3.0 * random.signed()), json!(number + 1.0), json!(1e39), json!(1e308),
            ];
            *value = random.pick(&all).clone();
        }
    }
}

/// The tree of a binary glTF damaged, or numbers of its buffer.
fn damage_glb(bytes: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let length = u32::from_le_bytes(bytes.get(12..16)?.try_into().ok()?) as usize;
    let (mut tree, mut buffer) = (bytes.get(20..20 + length)?.to_vec(), bytes.get(20 + length..)?.to_vec());
    if random.chance(0.6) {
        tree = damage_json(&tree, random)?;
        tree.resize(tree.len().next_multiple_of(4), b' ');
    } else if buffer.len() > 16 {
        for _ in 0..=random.below(8) {
            let at = 8 + 4 * random.below(buffer.len() / 4 - 2);
            let words = [
                f32::NAN.to_bits(),
                f32::INFINITY.to_bits(),
                1e30_f32.to_bits(),
                1e-30_f32.to_bits(),
                0,
                u32::MAX,
                7,
            ];
            buffer[at..at + 4].copy_from_slice(&random.pick(&words).to_le_bytes());
        }
    }
    let total = u32::try_from(20 + tree.len() + buffer.len()).ok()?;
    let length = u32::try_from(tree.len()).ok()?;
    Some([&bytes[..8], &total.to_le_bytes(), &length.to_le_bytes(), &bytes[16..20], &tree, &buffer].concat())
}

/// The header of an array damaged, or its numbers.
fn damage_npy(bytes: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    const TYPES: [&str; 11] =
        ["<f8", "<f4", "<f2", "<i8", "|u1", "<U3", ">f8", "|O", "|b1", "<c8", "<M8[ns]"];
    let length = usize::from(u16::from_le_bytes(bytes.get(8..10)?.try_into().ok()?));
    let (header, data) = bytes.get(10..)?.split_at_checked(length)?;
    let (mut header, mut data) = (header.to_vec(), data.to_vec());
    if random.chance(0.5) {
        let text = String::from_utf8_lossy(&header);
        let from = random.pick(&["<f8", "<f4", "<i8", "<u4", "False"]);
        header = if random.chance(0.5) {
            text.replace(from, random.pick::<&str>(&TYPES)).into()
        } else {
            damage(&header, random)
        };
    } else if data.len() >= 8 {
        let at = 8 * random.below(data.len() / 8);
        let value = *random.pick(&[0.0, 1.0, 1e30, f64::INFINITY, f64::NAN, 3.5e38, -1e308, 5e-324]);
        data[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
    let length = u16::try_from(header.len()).ok()?;
    Some([&bytes[..8], &length.to_le_bytes(), &header, &data].concat())
}

/// A member of an archive damaged, removed or renamed.
fn damage_npz(bytes: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    const NAMES: [&str; 5] = ["values.npy", "ids.npy", "timestamps.npy", "V.npy", "x"];
    let mut archive = ZipArchive::new(Cursor::new(bytes)).ok()?;
    let (mut made, chosen) = (Vec::new(), random.below(archive.len().max(1)));
    for at in 0..archive.len() {
        let mut member = archive.by_index(at).ok()?;
        let (mut name, mut data) = (member.name().to_owned(), Vec::new());
        member.read_to_end(&mut data).ok()?;
        match random.below(12) {
            _ if at != chosen => {}
            0 => continue,
            1 => name = (*random.pick(&NAMES)).to_owned(),
            _ => data = damage_npy(&data, random)?,
        }
        made.push((name, data));
    }
    seeds::npz(&made).ok()
}

/// Cells of a table, or words of lines, replaced, removed, repeated or exchanged.
fn damage_cells(bytes: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let text = String::from_utf8_lossy(bytes);
    let separator = if text.lines().next()?.contains(',') { "," } else { " " };
    let mut lines: Vec<Vec<&str>> = text.split('\n').map(|line| line.split(separator).collect()).collect();
    for _ in 0..=random.below(4) {
        let row = if random.chance(0.75) { random.below(lines.len()) } else { 0 };
        let row = &mut lines[row];
        if row.is_empty() {
            continue;
        }
        let (at, other) = (random.below(row.len()), random.below(row.len()));
        match random.below(10) {
            0 => drop(row.remove(at)),
            1 => row.insert(at, row[other]),
            2 => row.swap(at, other),
            _ => row[at] = random.pick::<&str>(&TEXTS),
        }
    }
    Some(lines.iter().map(|row| row.join(separator)).collect::<Vec<_>>().join("\n").into_bytes())
}

/// The value of an attribute replaced, or a piece between two elements removed or repeated.
fn damage_attribute(bytes: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let text = String::from_utf8_lossy(bytes);
    let mut pieces: Vec<&str> = text.split_inclusive(if random.chance(0.6) { '"' } else { '>' }).collect();
    let at = random.below(pieces.len());
    let kept;
    match (pieces[at].ends_with('"') && at % 2 == 1, random.below(2)) {
        (true, _) => {
            kept = format!("{}\"", random.pick(&TEXTS));
            pieces[at] = &kept;
        }
        (false, 0) => drop(pieces.remove(at)),
        (false, _) => pieces.insert(random.below(pieces.len()), pieces[at]),
    }
    Some(pieces.concat().into_bytes())
}

/// What is read follows from the beginning of the name, or from the extension.
pub(crate) fn check(name: &str, bytes: &[u8], random: &mut Random, counts: &mut Counts) -> Outcome {
    let kind = name.split('.').next().unwrap_or_default();
    if kind == "map" {
        return check_map(bytes, random, counts);
    }
    let (path, file) = (Path::new(name), FOLDER.join(name));
    let is_from_path =
        !matches!(kind, "contacts" | "places" | "skin" | "polygons" | "text" | "part" | "flat");
    if is_from_path {
        fs::write(&file, bytes).map_err(text)?;
    }
    let file = file.as_path();
    let is_read = match kind {
        "readings" => {
            let layout = *random.pick(&[ReadingsLayout::TaxelsFirst, ReadingsLayout::ChannelsFirst]);
            let reader = if random.chance(0.3) && matches!(extension(name), "csv" | "txt") {
                ReadingsReader::stream(path, Cursor::new(bytes.to_vec()))
            } else {
                ReadingsReader::open(file, layout)
            };
            match reader.and_then(|reader| Readings::collect(reader, || {})) {
                Ok(readings) => {
                    let numbers = readings.times.len() * readings.width * readings.channels.len();
                    if numbers != readings.values.len()
                        || readings.times.iter().any(|time| time.is_infinite())
                    {
                        return Err("readings of another size, or an infinite time".into());
                    }
                    true
                }
                Err(_) => false,
            }
        }
        // A recording of another program, alone or by one of the layouts.
        "recording" => check_recording(file, random)?,
        // A damaged layout, with one of the recordings.
        "layout" => match io::Layout::read(file) {
            Ok(layout) => {
                let recordings = SEEDS.iter().filter(|(name, _)| is_recording(name)).collect::<Vec<_>>();
                let (name, bytes) = random.pick(&recordings);
                let other = FOLDER.join(format!("of-layout-{name}"));
                fs::write(&other, bytes).map_err(text)?;
                read_recording(&other, Some(layout))?
            }
            Err(_) => false,
        },
        "regions" => {
            let mut map = SkinMap::flat(dermatome::mesh::shapes::lattice(5, 5, 0.01), 1e-3);
            let found = io::read_regions(file, &mut map);
            map.validate().map_err(text)?;
            found.is_ok()
        }
        "contacts" => {
            io::read_contacts(path, bytes).is_ok_and(|(_, rows)| rows.take(100).any(|row| row.is_ok()))
        }
        "places" => {
            io::read_map_places(path, bytes).is_ok_and(|(_, rows)| rows.take(100).any(|row| row.is_ok()))
        }
        "gains" => io::read_gains(file).is_ok(),
        "boundary" => io::read_boundary(file).is_ok(),
        "seams" => io::read_seams(file).is_ok(),
        "truth" => io::read_truth(file).is_ok(),
        "motion" => {
            let link = Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY };
            let links = IdVec::from(vec![link]);
            io::read_motion(file, None, &links).is_ok()
        }
        "joints" => SEEDS.iter().find(|(name, _)| name == "arm.urdf").is_some_and(|(name, arm)| {
            let robot = FOLDER.join(format!("of-joints-{name}"));
            let robot = fs::write(&robot, arm).ok().and_then(|()| io::read_robot(&robot).ok());
            robot.is_some_and(|robot| io::read_joint_values(file, &robot).is_ok())
        }),
        "graph" => match io::read_observations(file, &[]) {
            Ok((observations, _)) if observations.taxels.len() < 60 => {
                let options = dermatome::calib::CalibOptions {
                    limits: dermatome::least_squares::Options { max_iterations: 3, ..Default::default() },
                    ..Default::default()
                };
                let found = calibrate(&observations, &options);
                if found.as_ref().is_ok_and(|found| found.poses.iter().any(|pose| !pose.position.is_finite()))
                {
                    return Err("a calibrated position is not finite".into());
                }
                found.is_ok()
            }
            _ => false,
        },
        "acuities" => {
            let mut skin = Skin::from_mesh("a", dermatome::mesh::shapes::lattice(5, 5, 0.01));
            let found = io::read_acuities(file, &mut skin);
            skin.validate().map_err(text)?;
            found.is_ok()
        }
        "triangles" => {
            let ids: IdVec<VertexId, TaxelId> = (0..25).map(TaxelId).collect();
            io::read_triangles(file, &ids).is_ok()
        }
        "arm" | "robot" => {
            if let Ok(robot) = io::read_robot(file)
                && robot.poses(&robot.joint_values(&[])).iter().any(|pose| !pose.is_finite())
            {
                return Err("the pose of a link is not finite".into());
            }
            return check_skin(name, bytes, random, counts);
        }
        _ => return check_skin(name, bytes, random, counts),
    };
    *counts.entry("read").or_default() += u64::from(is_read);
    Ok(())
}

fn is_recording(name: &str) -> bool {
    name.starts_with("recording.") || ["readings.npz", "readings.npy", "readings.csv"].contains(&name)
}

/// Reads a damaged recording by itself or by a layout, drafts a layout of it, and reads where its sensors are.
fn check_recording(file: &Path, random: &mut Random) -> Result<bool, String> {
    if let Ok(draft) = io::ReadingsReader::draft_layout(file, None) {
        serde_json::from_str::<Value>(&draft).map_err(|error| format!("a draft is no JSON: {error}"))?;
    }
    if let Ok(draft) = io::read_draft(file) {
        check_finite(&draft)?;
    }
    if random.chance(0.5) {
        return read_recording(file, None);
    }
    let layouts = SEEDS.iter().filter(|(name, _)| name.starts_with("layout.")).collect::<Vec<_>>();
    let (name, layout) = random.pick(&layouts);
    let layout = io::Layout::parse(Path::new(name), &String::from_utf8_lossy(layout)).map_err(text)?;
    read_recording(file, Some(layout))
}

/// Reads a recording; what is read has a value for each taxel and finite times that are known or NaN.
fn read_recording(file: &Path, layout: Option<io::Layout>) -> Result<bool, String> {
    let options = io::ReadOptions { layout, ..io::ReadOptions::default() };
    let Ok(mut reader) = ReadingsReader::open(file, options) else { return Ok(false) };
    let (mut values, mut time) = (Vec::new(), 0.0);
    for _ in 0..1000 {
        match reader.read(&mut values, &mut time) {
            Ok(true) if values.len() != reader.width * reader.channels.len() => {
                return Err("a frame of another size".into());
            }
            Ok(true) if time.is_infinite() => return Err("an infinite time".into()),
            Ok(true) => {}
            Ok(false) => break,
            Err(_) => return Ok(false),
        }
    }
    std::hint::black_box(reader.statements());
    Ok(true)
}

fn check_finite(draft: &Draft) -> Outcome {
    for sheet in &draft.sheets {
        let count = sheet.positions.len();
        let is_finite = |columns: &Option<Vec<f64>>| columns.iter().flatten().all(|x| x.is_finite());
        let is_valid = sheet.positions.iter().chain(sheet.normals.iter().flatten()).all(|p| p.is_finite())
            && sheet.triangles.iter().flatten().all(|&corner| (corner as usize) < count)
            && is_finite(&sheet.areas)
            && is_finite(&sheet.densities);
        if !is_valid {
            return Err("a draft with numbers that are not finite or corners that do not exist".into());
        }
    }
    let is_finite = draft.links.iter().all(|link| link.pose.is_finite());
    if is_finite { Ok(()) } else { Err("a draft with a pose that is not finite".into()) }
}

fn check_skin(name: &str, bytes: &[u8], random: &mut Random, counts: &mut Counts) -> Outcome {
    let parts = io::ReadParts { texture: random.chance(0.5), materials: random.chance(0.5) };
    let Ok(mut draft) = io::draft_from_bytes(Path::new(name), bytes.to_vec(), parts) else { return Ok(()) };
    check_finite(&draft)?;
    if draft.sheets.iter().map(|sheet| sheet.triangles.len()).sum::<usize>() > MAX_TRIANGLES {
        return Ok(());
    }
    if random.chance(0.15) {
        remesh::keep_outer(&mut draft);
        check_finite(&draft)?;
    }
    let options = AssembleOptions {
        repair: random.chance(0.6),
        keep_going: random.chance(0.6),
        weld: *random.pick(&[Weld::Auto, Weld::All, Weld::None, Weld::Texture]),
        ..AssembleOptions::default()
    };
    check_draft(&draft, &options).iter().for_each(|finding| drop(finding.message()));
    let Ok(assembled) = assemble(&draft, &options) else { return Ok(()) };
    *counts.entry("assembled").or_default() += 1;
    let skin = &assembled.skin;
    skin.validate().map_err(|error| format!("an assembled skin is not valid: {error}"))?;
    let kind = random.pick(&["glb", "gltf", "json", "obj", "off", "ply", "stl"]);
    let written = PathBuf::from(format!("x.{kind}"));
    if let Ok(bytes) = io::skin_to_bytes(&written, skin) {
        let again = io::draft_from_bytes(&written, bytes, io::ReadParts::default())
            .map_err(|error| format!("a written {kind} cannot be read: {error}"))?;
        let faces: usize = skin.patches.iter().map(|patch| patch.mesh.triangles.len()).sum();
        if faces != again.sheets.iter().map(|sheet| sheet.triangles.len()).sum::<usize>() {
            return Err(format!("a written {kind} has other faces"));
        }
    }
    Ok(())
}

/// A map that can be read is valid, can be written and read again as it was, and answers.
fn check_map(bytes: &[u8], random: &mut Random, counts: &mut Counts) -> Outcome {
    let Ok(map) = io::map_from_bytes(bytes.to_vec()) else { return Ok(()) };
    *counts.entry("maps read").or_default() += 1;
    map.validate().map_err(|error| format!("a map that was read is not valid: {error}"))?;
    let written =
        io::map_to_bytes(&map).map_err(|error| format!("a map that was read cannot be written: {error}"))?;
    io::map_from_bytes(written).map_err(|error| format!("a written map cannot be read: {error}"))?;
    let options = IndexOptions { reactive: random.chance(0.5), fields: random.chance(0.5) };
    if let Ok(index) = ContactIndex::with_options(&map, &options) {
        for scale in [0.02, 0.2, 1e3] {
            let point = DVec3::new(random.signed(), random.signed(), random.signed()) * scale;
            let hit = index.locate(point).map_err(|error| error.to_string())?;
            if !(hit.distance.is_finite() && hit.position.is_finite() && hit.normal.is_finite()) {
                return Err(format!("a hit that is not finite: {hit:?}"));
            }
            for level in 0..3 {
                if index.cell(&hit, LevelId::new(level)).is_some_and(|cell| !cell.uv.is_finite()) {
                    return Err("a cell that is not finite".into());
                }
            }
            let _ = index.reactive(point);
            let _ = index.nearest_fields(point, 3, LevelId::new(1));
            let _ = index.first_hit(point, -point, f64::INFINITY);
        }
    }
    if let Ok(index) = MapIndex::new(&map) {
        let mut found = Vec::new();
        for (patch, of_patch) in map.patches.enumerate() {
            let centre = of_patch.levels[LevelId::new(0)].frame.centre([0, 0]);
            let _ = index.places(patch, LevelId::new(0), centre, &mut found);
        }
    }
    Ok(())
}
