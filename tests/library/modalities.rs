//! Laws of modalities: which taxels sense what, and the fields over the sensors of each.

use std::path::Path;

use dermatome::body::{FieldLevel, Modality};
use dermatome::id::{IdVec, VertexId};
use dermatome::io::{RecordingLayout, RecordingWriter, map_from_bytes, map_to_bytes, read_draft, write_skin};
use dermatome::map::{MapError, SkinMap};
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::signal::{Channel, Duplicates, Frame, Join, Restrictor};
use dermatome::skin::{
    AssembleOptions, Link, LinkId, Modalities, Patch, PatchId, Presence, Skin, SkinError, TaxelError,
    assemble,
};
use glam::{DAffine3, DVec3};

/// Distance of taxels, in m.
const SPACING: f64 = 0.004;

/// A bent sheet of 21 x 11 taxels; every fifth of every fifth row is a thermal pad, and some taxels sense proximity as well.
pub(crate) fn mixed() -> Skin {
    let mut mesh = shapes::lattice(21, 11, SPACING);
    mesh.positions.iter_mut().for_each(|x| x.z = 3.0 * x.x * x.x);
    let mut skin = Skin::from_mesh("arm", mesh);
    let taxels = &mut skin.patches[PatchId::new(0)].taxels;
    let of = |k: usize| match (k % 21, k / 21) {
        (column, row) if column % 5 == 0 && row % 5 == 0 => Some(Modalities::from("thermal")),
        (column, row) if column % 3 == 1 && row % 3 == 1 => Some("touch+proximity".into()),
        _ => None,
    };
    let modalities: IdVec<VertexId, _> = (0..taxels.ids.len()).map(of).collect();
    for (presence, of) in taxels.presence.iter_mut().zip(&modalities) {
        if of.as_deref() == Some("thermal") {
            *presence = Presence::ThermalPad;
        }
    }
    taxels.modalities = Some(modalities);
    skin
}

fn mixed_map() -> SkinMap {
    build(&mixed(), &BuildOptions::default()).unwrap()
}

fn read(path: &Path) -> Result<Skin, dermatome::Error> {
    Ok(assemble(&read_draft(path)?, &AssembleOptions::default())?.skin)
}

fn finest(modality: &Modality) -> &dermatome::body::BodyLevel {
    &modality.levels[LevelId::default()]
}

#[test]
fn files_of_skins_keep_what_taxels_sense() {
    let (folder, skin) = (tempfile::tempdir().unwrap(), mixed());
    for name in ["skin.glb", "skin.gltf", "skin.csv"] {
        let path = folder.path().join(name);
        write_skin(&path, &skin).unwrap();
        let (read, old) = (read(&path).unwrap(), &skin.patches[PatchId::new(0)].taxels);
        let new = &read.patches[PatchId::new(0)].taxels;
        assert_eq!((&new.modalities, &new.presence), (&old.modalities, &old.presence), "{name}");
    }
    let table = "id,x,y,z,present,modality\n1,0,0,0,1,proximity\n2,0.01,0,0,0,touch\n3,0,0.01,0,2,touch+thermal\n\
                 4,0.01,0.01,0,2,\n";
    let path = folder.path().join("table.csv");
    std::fs::write(&path, table).unwrap();
    let taxels = &read(&path).unwrap().patches[PatchId::new(0)].taxels;
    let mut presence: Vec<_> = taxels.ids.iter().zip(&taxels.presence).map(|(id, p)| (id.0, *p)).collect();
    presence.sort_by_key(|(id, _)| *id);
    let found: Vec<Presence> = presence.into_iter().map(|(_, presence)| presence).collect();
    assert_eq!(found, [Presence::Other, Presence::Absent, Presence::Present, Presence::ThermalPad]);
    std::fs::write(&path, table.replace("proximity", "Proximity")).unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("Proximity") && error.contains("names of modalities"), "{error}");
}

/// Taxels that sense nothing but touch have no fields besides the levels, with or without a word on it.
#[test]
fn touch_alone_has_no_fields_of_its_own() {
    let mut skin = mixed();
    let taxels = &mut skin.patches[PatchId::new(0)].taxels;
    taxels.presence.iter_mut().for_each(|presence| *presence = Presence::Present);
    taxels.modalities = None;
    let plain = build(&skin, &BuildOptions::default()).unwrap();
    let count = plain.patches[PatchId::new(0)].taxels.ids.len();
    skin.patches[PatchId::new(0)].taxels.modalities =
        Some((0..count).map(|_| Some("touch".into())).collect());
    let said = build(&skin, &BuildOptions::default()).unwrap();
    assert_eq!((&plain.body, &plain.body), (&said.body, &dermatome::body::Body::default()));
    assert_eq!(plain.patches[PatchId::new(0)].levels, said.patches[PatchId::new(0)].levels);
    // A taxel that senses more keeps the levels of touch.
    skin.patches[PatchId::new(0)].taxels.modalities =
        Some((0..count).map(|_| Some("touch+proximity".into())).collect());
    let more = build(&skin, &BuildOptions::default()).unwrap();
    assert_eq!(plain.patches[PatchId::new(0)].levels, more.patches[PatchId::new(0)].levels);
    assert_eq!(finest(&more.body.modalities[0]).origins.len(), count);
}

/// Of each modality level 0 has a field a sensor, and the last level one; areas are shared out whole, and a number that
/// grows along the sheet is kept where sensors lie on all sides.
#[test]
fn fields_of_a_modality_are_over_its_own_sensors() {
    let map = mixed_map();
    let patch = &map.patches[PatchId::new(0)];
    let area: f64 = patch.taxels.areas.iter().sum();
    let names: Vec<_> = map.body.modalities.iter().map(|modality| &*modality.name).collect();
    assert_eq!(names, ["thermal", "proximity"]);
    for (number, modality) in map.body.modalities.iter().enumerate() {
        let sensors = patch.taxels.sensors(&modality.name);
        let at = |level| FieldLevel { modality: Some(number), level };
        let origins: Vec<_> = finest(modality).origins.iter().map(|at| at.taxel).collect();
        assert_eq!(origins, sensors);
        let sizes: Vec<_> = modality.levels.iter().map(|level| level.origins.len()).collect();
        assert!(sizes.is_sorted_by(|a, b| a > b) && sizes.last() == Some(&1), "{sizes:?}");
        for level in modality.levels.ids() {
            let (rows, areas) = (map.field_rows(at(level)), map.field_areas(at(level)));
            let Some(rows) = &rows[PatchId::new(0)] else { panic!("{level:?}") };
            assert!((areas.iter().sum::<f64>() / area - 1.0).abs() < 1e-12);
            assert!(areas.iter().all(|area| *area > 0.0));
            assert!(rows.weights.iter().all(|row| (row.iter().sum::<f64>() - 1.0).abs() < 1e-12));
        }
        let positions = &patch.levels[LevelId::default()].level.mesh.positions;
        let own = |field: VertexId| positions[finest(modality).origins[field].taxel];
        let low = sensors.iter().map(|v| positions[*v]).fold(DVec3::INFINITY, DVec3::min);
        let high = sensors.iter().map(|v| positions[*v]).fold(DVec3::NEG_INFINITY, DVec3::max);
        for (taxel, at) in positions.enumerate() {
            let found: DVec3 = finest(modality).rows.row(taxel).map(|(field, w)| w * own(field)).sum();
            let [low, inside, high] = [low + SPACING, *at, high - SPACING].map(DVec3::truncate);
            let is_inside = inside.cmpge(low).all() && inside.cmple(high).all();
            assert!(!is_inside || (found - *at).truncate().length() < 0.3 * SPACING, "{at} from {found}");
        }
        for (field, sensor) in sensors.iter().enumerate() {
            assert_eq!(finest(modality).rows.row(*sensor).next(), Some((VertexId::new(field), 1.0)));
        }
    }
}

/// An absent pad is no sensor; pads of a file that says nothing of modalities are sensors of heat.
#[test]
fn thermal_pads_need_no_word() {
    let mut skin = mixed();
    let taxels = &mut skin.patches[PatchId::new(0)].taxels;
    taxels.modalities = None;
    let pads = taxels.sensors("thermal");
    taxels.presence[pads[0]] = Presence::Absent;
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let [thermal] = &map.body.modalities[..] else { panic!("{:?}", map.body) };
    assert_eq!(finest(thermal).origins.len(), pads.len() - 1);
}

#[test]
fn maps_keep_modalities_and_refuse_wrong_ones() {
    let map = mixed_map();
    let bytes = map_to_bytes(&map).unwrap();
    let read = map_from_bytes(bytes.clone()).unwrap();
    assert_eq!(
        read.patches[PatchId::new(0)].taxels.modalities,
        map.patches[PatchId::new(0)].taxels.modalities
    );
    for (new, old) in read.body.modalities.iter().zip(&map.body.modalities) {
        assert_eq!((new.patch, &new.name), (old.patch, &old.name));
        for (new, old) in new.levels.iter().zip(&old.levels) {
            assert_eq!((&new.origins, &new.rows.indices), (&old.origins, &old.rows.indices));
            let pairs = new.rows.weights.iter().flatten().zip(old.rows.weights.iter().flatten());
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
    assert_eq!(read.body.modalities.len(), 2);
    let altered = |change: fn(&mut Vec<Modality>)| {
        let mut map = map.clone();
        change(&mut map.body.modalities);
        map.validate()
    };
    let changes: [fn(&mut Vec<Modality>); 9] = [
        |all| all[0].patch = Some(PatchId::new(1)),
        |all| all[1].patch = None,
        |all| all[1] = all[0].clone(),
        |all| all[0].name = "touch".into(),
        |all| all[0].name = "proximity".into(),
        |all| all[0].levels = IdVec::default(),
        |all| all[0].levels[LevelId::new(1)].rows.coarse_len += 1,
        |all| all[0].levels[LevelId::new(1)].origins.iter_mut().for_each(|at| at.taxel = VertexId::new(231)),
        |all| {
            all[0].levels[LevelId::default()].rows.indices.push([VertexId::new(0); 3]);
            all[0].levels[LevelId::default()].rows.weights.push([1.0, 0.0, 0.0]);
        },
    ];
    for (k, change) in changes.into_iter().enumerate() {
        assert!(matches!(altered(change), Err(MapError::Modality { .. })), "change {k}");
    }
    let mut wrong = map.clone();
    wrong.patches[PatchId::new(0)].taxels.presence[VertexId::new(0)] = Presence::Present;
    let Err(MapError::Skin(SkinError::Taxels { source: TaxelError::NotSensed { vertex, .. }, .. })) =
        wrong.validate()
    else {
        panic!("a thermal pad that reads pressure");
    };
    assert_eq!(vertex, VertexId::new(0));
    // Maps of files without modalities are valid.
    let mut old = map.clone();
    old.body.modalities.clear();
    assert_eq!(old.validate(), Ok(()));
}

/// Numbers in a file that name no sensor or no text are refused, and no byte of its JSON makes a panic.
#[test]
fn damaged_files_are_refused() {
    let bytes = map_to_bytes(&mixed_map()).unwrap();
    let find = |text: &str| {
        let at = bytes.windows(text.len()).position(|part| part == text.as_bytes());
        at.unwrap_or_else(|| panic!("no {text}"))
    };
    for (from, to) in [
        ("\"name\":\"thermal\"", "\"name\":\"Thermal\""),
        ("\"patch\":0,", "\"patch\":7,"),
        ("[\"thermal\",", "[\"Thermal\","),
        ("[\"thermal\",\"touch+proximity\"]", "[\"thermal\"                  ]"),
    ] {
        let (mut damaged, at) = (bytes.clone(), find(from));
        damaged[at..at + to.len()].copy_from_slice(to.as_bytes());
        let error = map_from_bytes(damaged).unwrap_err().to_string();
        assert!(["modalit", "_MODALITY"].iter().any(|word| error.contains(word)), "{to}: {error}");
    }
    let (first, last) = (find("\"modalities\":[{"), find("\"scenes\""));
    let end = if last > first { last } else { first + 400 };
    for at in (first..end).step_by(11) {
        for byte in *b"0{]\"" {
            let mut damaged = bytes.clone();
            damaged[at] = byte;
            let _ = map_from_bytes(damaged);
        }
    }
}

/// A channel is of the modality of its name or its quantity, if the map has it.
#[test]
fn channels_are_of_the_modality_of_their_quantity() {
    let map = mixed_map();
    for (name, unit, expected) in [
        ("pressure", "kPa", None),
        ("", "degC", Some("thermal")),
        ("t", "mK", Some("thermal")),
        ("thermal", "count", Some("thermal")),
        ("temperature", "", Some("thermal")),
        ("proximity.left", "V", Some("proximity")),
        ("distance", "mm", Some("proximity")),
        ("acc.x", "m/s^2", None),
        ("light", "lx", None),
    ] {
        assert_eq!(Channel::new(name, unit).unwrap().modality(&map), expected, "{name} in {unit}");
    }
    let touch =
        build(&Skin::from_mesh("palm", shapes::cap(100, 0.1, 0.5)), &BuildOptions::default()).unwrap();
    assert_eq!(Channel::new("", "degC").unwrap().modality(&touch), None);
}

/// Sensors of a modality get the readings of its channels, other taxels none of them, and sums and constants are kept on
/// every level by the sensors that have a reading.
#[test]
fn readings_go_to_the_fields_of_their_modality() {
    let map = mixed_map();
    let id = PatchId::new(0);
    let channels = [("pressure", "kPa"), ("temperature", "degC"), ("proximity", "N")];
    let channels = channels.map(|(name, unit)| Channel::new(name, unit).unwrap());
    let (thermal, proximity) =
        (map.patches[id].taxels.sensors("thermal"), map.patches[id].taxels.sensors("proximity"));
    let mut join = Join::new(&map, None, 231, Duplicates::Refuse).unwrap();
    assert_eq!(join.report().matched, 231 - thermal.len());
    join.follow(&map, &channels);
    assert_eq!((join.report().matched, join.report().masked), (231, 0));
    let mut values: Vec<f64> = [5.0, 30.0, 2.0].into_iter().flat_map(|x| vec![x; 231]).collect();
    let (lost, dead) = (thermal[3], proximity[0]);
    values[231 + lost.index()] = f64::NAN;
    values[2 * 231 + dead.index()] = f64::NAN;
    let mut frame = Frame::new(&map, 3);
    assert_eq!(join.fill(&values, &mut frame), 2);
    let read = |channel: usize| frame.values[id][channel].iter().filter(|x| x.is_finite()).count();
    assert_eq!([0, 1, 2].map(read), [231 - thermal.len(), thermal.len() - 1, proximity.len() - 1]);

    let mut restrictor = Restrictor::new(&map, &channels);
    let levels = restrictor.restrict(&frame);
    let [of_thermal, of_proximity] = &levels.modalities[..] else { panic!("two modalities") };
    for (level, fields) in of_thermal.values[1].enumerate() {
        for (field, value) in fields.enumerate() {
            let is_lost = level.index() == 0 && thermal[field.index()] == lost;
            assert_eq!(value.is_nan(), is_lost);
            assert!(is_lost || (value - 30.0).abs() < 1e-12);
            assert_eq!(of_thermal.is_measured[1][level][field], !is_lost);
        }
    }
    for fields in &of_proximity.values[2] {
        let sum: f64 = fields.iter().filter(|x| x.is_finite()).sum();
        assert!((sum / (2.0 * (proximity.len() - 1) as f64) - 1.0).abs() < 1e-12);
    }
    // Channels of others have no values.
    let others =
        [&of_thermal.values[0], &of_thermal.values[2], &of_proximity.values[0], &of_proximity.values[1]];
    assert!(others.into_iter().flatten().flatten().all(|x| x.is_nan()));
    // Pressures are as of a map that knows nothing of modalities.
    let plain = SkinMap { body: dermatome::body::Body::default(), ..map.clone() };
    let mut of_touch = Restrictor::new(&plain, &channels[..1]);
    let mut alone = Frame::new(&plain, 1);
    Join::new(&plain, None, 231, Duplicates::Refuse).unwrap().fill(&values[..231], &mut alone);
    assert_eq!(
        format!("{:?}", of_touch.restrict(&alone).values[id][0]),
        format!("{:?}", levels.values[id][0])
    );
}

/// Arrays name the levels of a modality that a channel is of, and those alone; no patch has the same keys.
#[test]
fn arrays_name_levels_of_modalities() {
    let folder = tempfile::tempdir().unwrap();
    let mut map = mixed_map();
    let mut second = map.patches[PatchId::new(0)].clone();
    second.name = "arm.thermal".into();
    map.patches.push(second);
    assert_eq!(map.validate(), Ok(()));
    for (unit, is_thermal) in [("degC", true), ("kPa", false)] {
        let channels = [Channel::new("", unit).unwrap()];
        let layout =
            RecordingLayout { channels: &channels, atlas: None, values: true, level: None, fields: None };
        let path = folder.path().join(format!("{is_thermal}.npz"));
        let mut writer = RecordingWriter::create(&path, &map, &layout).unwrap();
        let mut restrictor = Restrictor::new(&map, &channels);
        writer.write(restrictor.restrict(&Frame::new(&map, 1)), &[]).unwrap();
        writer.finish().unwrap();
        let bytes = std::fs::read(path).unwrap();
        let has = |key: &str| bytes.windows(key.len()).any(|part| part == key.as_bytes());
        assert!(has("arm.L0.values.npy") && has("arm%2ethermal.L0.values.npy"));
        for key in ["arm.thermal.L0.values.npy", "arm.thermal.L1.valid.npy"] {
            assert_eq!(has(key), is_thermal, "{key}");
        }
        assert!(!has("arm.proximity.L0.values.npy"));
    }
}

/// Two bent sheets as that of [`mixed`] with a gap between them, a third one without sensors beside touch, and one with two
/// thermal pads far away on another link.
fn limbs() -> Skin {
    let mut skin = mixed();
    let first = skin.patches[PatchId::new(0)].clone();
    let mut first_id = 0;
    let mut add = |name: &str, at: DVec3, link: LinkId, change: &dyn Fn(&mut Patch)| {
        let mut patch = Patch { name: name.into(), link, ..first.clone() };
        patch.mesh.positions.iter_mut().for_each(|x| *x += at);
        first_id += 1000;
        patch.taxels.ids.iter_mut().for_each(|id| id.0 += first_id);
        change(&mut patch);
        skin.patches.push(patch);
    };
    let base = LinkId::new(0);
    add("hand", DVec3::Y * 0.048, base, &|_| ());
    add("back", DVec3::Y * 0.096, base, &|patch| {
        patch.taxels.modalities = None;
        patch.taxels.presence.iter_mut().for_each(|of| *of = Presence::Present);
    });
    add("tip", DVec3::Y * 0.5, LinkId::new(1), &|patch| {
        let names = patch.taxels.modalities.iter_mut().flatten().zip(&mut patch.taxels.presence).enumerate();
        for (_, (names, presence)) in names.filter(|(k, _)| ![0, 115].contains(k)) {
            (*names, *presence) = (None, Presence::Present);
        }
    });
    skin.links.push(Link { name: "far".into(), parent: Some(base), pose: DAffine3::IDENTITY });
    skin
}

/// Sensors of all patches have fields of the whole body above them, down to one, which share out areas and amounts whole and
/// keep a constant; patches without sensors have none, and dead sensors are left out.
#[test]
fn modalities_have_levels_of_the_whole_body() {
    let map = build(&limbs(), &BuildOptions::default()).unwrap();
    let names: Vec<String> = map.field_levels().map(|(_, name)| name).collect();
    for name in ["arm.thermal.L0", "body.L0", "body.thermal.L0", "body.proximity.L0", "tip.thermal.L0"] {
        assert!(names.iter().any(|known| known == name), "{name} of {names:?}");
    }
    assert!(names.iter().all(|name| !name.starts_with("back.")));
    let of_body: Vec<_> = map.body.modalities.iter().filter(|of| of.patch.is_none()).collect();
    assert_eq!(of_body.iter().map(|of| &*of.name).collect::<Vec<_>>(), ["thermal", "proximity"]);
    let channels = [Channel::new("thermal", "N").unwrap(), Channel::new("thermal.mean", "degC").unwrap()];
    let count: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let mut join = Join::new(&map, None, count, Duplicates::Refuse).unwrap();
    join.follow(&map, &channels);
    let mut frame = Frame::new(&map, 2);
    let amounts = (0..count).map(|k| if k % 9 == 4 { f64::NAN } else { (k * 37 % 101) as f64 });
    join.fill(&amounts.chain(vec![31.0; count]).collect::<Vec<f64>>(), &mut frame);
    let mut total = 0.0;
    for (id, patch) in map.patches.enumerate().filter(|(_, patch)| patch.name != "back") {
        let read = patch.taxels.sensors("thermal").into_iter().map(|v| frame.values[id][0][v]);
        total += read.filter(|x| x.is_finite()).sum::<f64>();
    }
    let mut restrictor = Restrictor::new(&map, &channels);
    let carried = restrictor.restrict(&frame);
    for (number, modality) in map.body.modalities.iter().enumerate().filter(|(_, of)| of.patch.is_none()) {
        let parts: Vec<_> = map.body.parts(modality).map(|(patch, _)| patch).collect();
        let sensors: Vec<usize> =
            parts.iter().map(|id| map.patches[*id].taxels.sensors(&modality.name).len()).collect();
        let area: f64 = parts.iter().flat_map(|id| map.patches[*id].taxels.areas.iter()).sum();
        let sizes: Vec<_> = modality.levels.iter().map(|level| level.origins.len()).collect();
        assert!(sizes[0] < sensors.iter().sum() && sizes.is_sorted_by(|a, b| a > b), "{sizes:?}");
        assert_eq!(sizes.last(), Some(&1));
        for level in modality.levels.ids() {
            let at = FieldLevel { modality: Some(number), level };
            assert!((map.field_areas(at).iter().sum::<f64>() / area - 1.0).abs() < 1e-12);
            for (id, rows) in map.field_rows(at).enumerate() {
                assert_eq!(rows.is_some(), parts.contains(&id));
                let weights = rows.iter().flat_map(|rows| &rows.weights);
                assert!(weights.into_iter().all(|row| (row.iter().sum::<f64>() - 1.0).abs() < 1e-12));
            }
            let [amounts, means] = [0, 1].map(|k| &carried.modalities[number].values[k][level]);
            if modality.name == "thermal" {
                let sum: f64 = amounts.iter().filter(|x| x.is_finite()).sum();
                assert!((sum / total - 1.0).abs() < 1e-12, "{sum} of {total}");
                assert!(means.iter().all(|x| (x - 31.0).abs() < 1e-12));
            } else {
                assert!(amounts.iter().chain(means).all(|x| x.is_nan()));
            }
        }
    }
    // A field over the gap between two patches has sensors of both.
    let first = FieldLevel { modality: Some(map.body.modalities.len() - 2), level: LevelId::default() };
    let rows = map.field_rows(first);
    let fields = |patch: usize| -> std::collections::BTreeSet<usize> {
        let rows = rows[PatchId::new(patch)].iter();
        rows.flat_map(|rows| rows.indices.iter().flatten()).map(|field| field.index()).collect()
    };
    assert!(fields(0).intersection(&fields(1)).next().is_some());

    let read = map_from_bytes(map_to_bytes(&map).unwrap()).unwrap();
    assert_eq!(read.field_levels().map(|(_, name)| name).collect::<Vec<_>>(), names);
    let altered = |change: fn(&mut Vec<Modality>)| {
        let mut map = map.clone();
        change(&mut map.body.modalities);
        map.validate()
    };
    let changes: [fn(&mut Vec<Modality>); 5] = [
        |all| all.rotate_right(1),
        |all| all.retain(|of| of.patch.is_none_or(|patch| patch == PatchId::new(0))),
        |all| all.last_mut().unwrap().levels = IdVec::default(),
        |all| {
            let origins = &mut all.last_mut().unwrap().levels[LevelId::default()].origins;
            origins.iter_mut().for_each(|at| at.patch = PatchId::new(4));
        },
        |all| {
            let rows = &mut all.last_mut().unwrap().levels[LevelId::default()].rows;
            rows.weights.iter_mut().for_each(|row| row[0] += 0.5);
        },
    ];
    for (k, change) in changes.into_iter().enumerate() {
        assert!(matches!(altered(change), Err(MapError::Modality { .. })), "change {k}");
    }
}
