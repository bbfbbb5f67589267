//! The measurement of `dermatome bench`: costs of the answers on a map, and intervals against exact answers.
//! `benches/coarse_to_fine.rs` includes this file.
//!
//! Contacts lie on both sides of the skin, in random order except on a path: 0 to 3 mm off it, or in a band of
//! distances. A time is the mean over all contacts, of the fastest of [`PASSES`] passes for every [`FEW`] of
//! them. Compared tasks alternate after that many contacts, on different ones. The time of the cells of all
//! levels is that on top of an answer with its cell of level 0.

use std::{array, hint::black_box, time::Instant};

use dermatome::{
    contact::{ContactError, ContactIndex, Hit, IndexOptions, MapIndex, Query, Reactive, Refine},
    map::SkinMap,
    pyramid::LevelId,
    run::Run,
    skin::PatchId,
};
use glam::{DVec2, DVec3};
use serde::Serialize;

/// Contacts near the skin, contacts of a band, and passes over them, of which the fastest counts.
const CONTACTS: usize = 1 << 15;
const BAND_CONTACTS: usize = 1 << 13;
const PASSES: usize = 13;
/// Contacts that are timed together.
const FEW: usize = 128;

/// Least and largest distance from the skin of the contacts of a band, in mm.
const BANDS_MM: [[f64; 2]; 4] = [[0.0, 3.0], [3.0, 10.0], [10.0, 20.0], [20.0, 50.0]];

/// Thresholds on the distance of a contact, in mm, which an answer may decide.
const THRESHOLDS_MM: [f64; 5] = [1.0, 2.0, 5.0, 10.0, 20.0];

/// Costs of answers on a map: times in ns per contact. The keys of `dermatome.bench` in `docs/json.md`.
#[derive(Debug, Serialize)]
pub(crate) struct AnswerCosts {
    pub faces: usize,
    pub contacts: usize,
    pub index_seconds: f64,
    pub index_with_reactive_seconds: f64,
    pub reactive_bytes: usize,
    pub single_ns: f64,
    pub with_cell_ns: f64,
    pub all_cells_ns: f64,
    pub path_ns: f64,
    pub batch_ns: f64,
    pub back_ns: f64,
    pub back_by_pixels_ns: Option<f64>,
    pub bands: Vec<BandCosts>,
}

/// Costs and errors of reactive answers to contacts in a band of distances off the skin.
#[derive(Debug, Serialize)]
pub(crate) struct BandCosts {
    pub off_mm: [f64; 2],
    pub contacts: usize,
    pub exact_ns: f64,
    pub reactive_ns: f64,
    pub times_faster: f64,
    pub interval_mm: [f64; 3],
    pub error_mm: [f64; 3],
    pub violations: usize,
    pub wrong_sides: f64,
    pub decided: [f64; 5],
    pub levels: Vec<LevelCosts>,
}

/// Costs of a reactive answer with its cell on a level: on its face, and after a walk from there.
#[derive(Debug, Serialize)]
pub(crate) struct LevelCosts {
    pub level: usize,
    pub faces: usize,
    pub with_cell_ns: [f64; 2],
    pub same_field: [f64; 2],
}

/// Contacts on a map, in world coordinates, the same in every run.
pub(crate) struct SampleContacts {
    /// 0 to 3 mm off the skin, on both sides, in random order.
    pub scattered: Vec<Query>,
    /// A path over the skin in steps of half a millimetre, 1 to 1.1 mm off. It turns slowly, and back at borders.
    pub path: Vec<Query>,
}

impl SampleContacts {
    pub(crate) fn new(map: &SkinMap, index: &ContactIndex) -> Result<Self, ContactError> {
        let mut random = numbers();
        let scattered = contacts_off(map, index, BANDS_MM[0], CONTACTS)?;
        let scattered: Vec<Query> = scattered.into_iter().map(|(query, _)| query).collect();
        let first = scattered.first().ok_or(ContactError::NoSkin)?;
        let mut at = index.locate(*first)?.position;
        let mut heading = DVec3::new(0.3, 0.8, 0.5).normalize();
        let step = |_| {
            let hit = index.locate(Query::from(at + heading * 0.0005))?;
            let is_stopped = hit.position.distance(at) < 0.0002;
            at = hit.position;
            let turn = if is_stopped { 2.0 + random() } else { 0.2 * (random() - 0.5) };
            let normal = hit.normal.try_normalize().unwrap_or(DVec3::Z);
            let along = heading.reject_from(normal).normalize_or(normal.any_orthonormal_vector());
            heading = along * turn.cos() + normal.cross(along) * turn.sin();
            Ok(Query::from(at + normal * (0.001 + 0.0001 * random())))
        };
        let path = (0..CONTACTS).map(step).collect::<Result<_, ContactError>>()?;
        Ok(Self { scattered, path })
    }
}

/// Measures the answers on all levels of a map. Takes some seconds, a minute for a million triangles.
pub(crate) fn measure(map: &SkinMap) -> Result<AnswerCosts, ContactError> {
    let (plain, index_seconds) = timed(|| ContactIndex::new(map))?;
    let reactive = IndexOptions { reactive: true, ..IndexOptions::default() };
    let (index, index_with_reactive_seconds) = timed(|| ContactIndex::with_options(map, &reactive))?;
    let SampleContacts { scattered, path } = SampleContacts::new(map, &plain)?;
    let exact: Vec<Hit> = plain.locate_all(&scattered, Run::default())?.iter().collect();
    let finest = LevelId::new(0);
    let [single_ns, with_cell_ns, with_all_ns] = time_in_turn(
        &scattered,
        [
            &mut |&q| _ = black_box(plain.locate(q)),
            &mut |&q| _ = black_box(plain.locate(q).map(|hit| plain.cell(&hit, finest))),
            &mut |&q| {
                let Ok(hit) = plain.locate(q) else { return };
                (0..).map_while(|k| plain.cell(&hit, LevelId::new(k))).for_each(|cell| _ = black_box(&cell));
            },
        ],
    );
    let [path_ns] = time_in_turn(&path, [&mut |&q| _ = black_box(plain.locate(q))]);
    let [batch_ns] =
        time_in_turn(&[()], [&mut |()| _ = black_box(plain.locate_all(&scattered, Run::default()))]);
    let [back_ns, back_by_pixels_ns] = measure_back(map, &plain, &exact)?;
    let bands = BANDS_MM.map(|off_mm| measure_band(map, &index, off_mm)).into_iter();
    Ok(AnswerCosts {
        faces: faces_of(map, finest),
        contacts: scattered.len(),
        index_seconds,
        index_with_reactive_seconds,
        reactive_bytes: index.reactive_bytes(),
        single_ns,
        with_cell_ns,
        all_cells_ns: with_all_ns - single_ns,
        path_ns,
        batch_ns: batch_ns / scattered.len() as f64,
        back_ns: back_ns.unwrap_or_default(),
        back_by_pixels_ns,
        bands: bands.filter_map(Result::transpose).collect::<Result<_, _>>()?,
    })
}

fn faces_of(map: &SkinMap, level: LevelId) -> usize {
    map.patches.iter().filter_map(|p| p.levels.get(level)).map(|l| l.level.mesh.triangles.len()).sum()
}

fn timed<T>(work: impl FnOnce() -> Result<T, ContactError>) -> Result<(T, f64), ContactError> {
    let start = Instant::now();
    let made = work()?;
    Ok((made, start.elapsed().as_secs_f64()))
}

/// Times per item of several tasks that alternate, in ns, so that their differences are valid on a busy
/// machine too. Each task works on other items than the one before, so it does not profit from the cache of
/// that one.
fn time_in_turn<T, const N: usize>(items: &[T], mut works: [&mut dyn FnMut(&T); N]) -> [f64; N] {
    let parts: Vec<&[T]> = items.chunks(FEW).collect();
    let mut fastest = vec![[f64::INFINITY; N]; parts.len()];
    for turn in 0..PASSES * parts.len() {
        for (k, work) in works.iter_mut().enumerate() {
            let part = (turn + k * parts.len() / N) % parts.len();
            let start = Instant::now();
            parts[part].iter().for_each(&mut *work);
            fastest[part][k] = fastest[part][k].min(start.elapsed().as_secs_f64());
        }
    }
    array::from_fn(|k| fastest.iter().map(|few| few[k]).sum::<f64>() * 1e9 / items.len() as f64)
}

/// Measures lookups from the map to the skin: from the cells of hits, and pixel by pixel, row by row from a
/// quarter of the height of each image on.
fn measure_back(
    map: &SkinMap,
    index: &ContactIndex,
    exact: &[Hit],
) -> Result<[Option<f64>; 2], ContactError> {
    let finest = LevelId::new(0);
    let back = MapIndex::new(map)?;
    let mut places = Vec::new();
    let mut answer = |&(patch, uv): &(PatchId, DVec2)| {
        places.clear();
        let answered = back.places(patch, finest, uv, &mut places);
        answered.is_ok() && black_box(&places).first().is_some_and(|place| place.off_chart == 0.0)
    };
    let on_map = exact.iter().filter_map(|hit| Some((hit.patch, index.cell(hit, finest)?.uv)));
    let on_map: Vec<(PatchId, DVec2)> = on_map.collect();
    let pixels = map.patches.enumerate().flat_map(|(id, patch)| {
        let frame = patch.levels[finest].frame;
        let [columns, rows] = frame.size_px;
        (rows / 4..rows)
            .flat_map(move |row| (0..columns).map(move |column| (id, frame.centre([column, row]))))
    });
    let pixels: Vec<(PatchId, DVec2)> = pixels.filter(&mut answer).take(CONTACTS).collect();
    Ok([on_map, pixels].map(|places| {
        let [ns] = time_in_turn(&places, [&mut |place| _ = answer(place)]);
        (!places.is_empty()).then_some(ns)
    }))
}

/// Contacts in a band of distances off the skin, on both sides, in random order, with their exact answers.
/// Fewer than `count` if few points are that far off.
fn contacts_off(
    map: &SkinMap,
    index: &ContactIndex,
    off_mm: [f64; 2],
    count: usize,
) -> Result<Vec<(Query, Hit)>, ContactError> {
    let (mut random, [least, most]) = (numbers(), off_mm.map(|mm| 1e-3 * mm));
    let finest = |patch: PatchId| &map.patches[patch].levels[LevelId::new(0)].level.mesh;
    let (mut faces, mut area) = (Vec::new(), 0.0);
    for patch in map.patches.ids() {
        for face in finest(patch).triangles.ids() {
            area += finest(patch).face_cross(face).length() / 2.0;
            faces.push((area, patch, face));
        }
    }
    let (poses, mut contacts) = (index.poses(), Vec::new());
    for _ in 0..16 * count {
        let at = area * random();
        let (_, patch, face) = faces[faces.partition_point(|(sum, ..)| *sum < at).min(faces.len() - 1)];
        let [a, b, c] = finest(patch).corners(face);
        let (s, t) = (random().sqrt(), random());
        let normal = finest(patch).face_cross(face).normalize_or_zero() * (random() - 0.5).signum();
        // Tilted, so that contacts also lie beyond rims.
        let tilt = DVec3::from_array(array::from_fn(|_| random() - 0.5));
        let up = (normal + 0.5 * tilt).normalize_or_zero();
        let height = least + (most - least) * random();
        let at = a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t) + up * height;
        let query = Query::from(poses[map.patches[patch].link].transform_point3(at));
        let hit = index.locate(query)?;
        if (least..=most).contains(&hit.distance.abs()) {
            contacts.push((query, hit));
        }
        if contacts.len() == count {
            break;
        }
    }
    Ok(contacts)
}

/// Measures reactive answers in a band against the exact ones. `None` if no contact is that far off.
fn measure_band(
    map: &SkinMap,
    index: &ContactIndex,
    off_mm: [f64; 2],
) -> Result<Option<BandCosts>, ContactError> {
    let contacts = contacts_off(map, index, off_mm, BAND_CONTACTS)?;
    if contacts.is_empty() {
        return Ok(None);
    }
    let answers = contacts.iter().map(|(q, _)| index.reactive(*q)).collect::<Result<Vec<Reactive>, _>>()?;
    let [exact_ns, reactive_ns] = time_in_turn(
        &contacts,
        [&mut |(q, _)| _ = black_box(index.locate(*q)), &mut |(q, _)| _ = black_box(index.reactive(*q))],
    );
    let pairs = || answers.iter().zip(contacts.iter().map(|(_, hit)| hit));
    let is_wrong = |(answer, exact): &(&Reactive, &Hit)| {
        let away = exact.distance.abs();
        away < answer.least - 1e-12 || away > answer.most + 1e-12
    };
    let is_other_side =
        |(answer, exact): &(&Reactive, &Hit)| answer.least > 0.0 && answer.distance * exact.distance < 0.0;
    let share = |count: usize| count as f64 / contacts.len() as f64;
    let decides = |mm: f64| answers.iter().filter(|answer| answer.is_within(1e-3 * mm).is_some()).count();
    let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0);
    Ok(Some(BandCosts {
        off_mm,
        contacts: contacts.len(),
        exact_ns,
        reactive_ns,
        times_faster: exact_ns / reactive_ns,
        interval_mm: spread_mm(answers.iter().map(|answer| answer.most - answer.least).collect()),
        error_mm: spread_mm(pairs().map(|(a, b)| (a.distance.abs() - b.distance.abs()).abs()).collect()),
        violations: pairs().filter(is_wrong).count(),
        wrong_sides: share(pairs().filter(is_other_side).count()),
        decided: THRESHOLDS_MM.map(|mm| share(decides(mm))),
        levels: (0..levels).map(|level| measure_level(map, index, level, &contacts)).collect(),
    }))
}

fn measure_level(map: &SkinMap, index: &ContactIndex, level: usize, contacts: &[(Query, Hit)]) -> LevelCosts {
    let id = LevelId::new(level);
    let cell = |query: &Query, refine: Refine| {
        let answer = index.reactive(*query).ok()?;
        index.cell(&index.hit_of(*query, &answer, refine)?, id)
    };
    let with_cell_ns = time_in_turn(
        contacts,
        [&mut |(q, _)| _ = black_box(cell(q, Refine::Face)), &mut |(q, _)| {
            _ = black_box(cell(q, Refine::Walk))
        }],
    );
    let same = |refine: Refine| {
        let is_same = |(q, hit): &&(Query, Hit)| {
            cell(q, refine).map(|cell| cell.field) == index.cell(hit, id).map(|cell| cell.field)
        };
        contacts.iter().filter(is_same).count() as f64 / contacts.len() as f64
    };
    let same_field = [Refine::Face, Refine::Walk].map(same);
    LevelCosts { level, faces: faces_of(map, id), with_cell_ns, same_field }
}

/// Median, 99th percentile and largest, in mm.
fn spread_mm(mut lengths: Vec<f64>) -> [f64; 3] {
    lengths.sort_by(f64::total_cmp);
    let last = lengths.len() - 1;
    [last / 2, last * 99 / 100, last].map(|k| 1e3 * lengths[k])
}

/// Numbers in [0, 1), the same in every run.
fn numbers() -> impl FnMut() -> f64 {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

impl AnswerCosts {
    /// The measurement as tables in Markdown.
    pub(crate) fn to_markdown(&self) -> String {
        let percents = |shares: &[f64]| {
            shares.iter().map(|share| format!("{:.0}", 100.0 * share)).collect::<Vec<_>>().join(", ")
        };
        let lengths = |mm: &[f64]| mm.iter().map(|x| format!("{x:.3}")).collect::<Vec<_>>().join(", ");
        let mut text = format!(
            "{} triangles; index in {:.3} s, with reactive answers in {:.3} s and {:.0} KB more\n\n\
             {} contacts 0 to 3 mm off the skin:\n\n\
             | single ns | with cell | cells of all levels add | on a path | batch | map to skin | from pixel to pixel |\n\
             |---|---|---|---|---|---|---|\n\
             | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {} |\n\n\
             Contacts on both sides of the skin, some mm off it:\n\n\
             | mm off | exact ns | reactive ns | times faster | interval mm: median, 99 %, largest | error mm: median, 99 %, largest | \
             decides 1, 2, 5, 10, 20 mm |\n\
             |---|---|---|---|---|---|---|\n",
            self.faces,
            self.index_seconds,
            self.index_with_reactive_seconds,
            self.reactive_bytes as f64 / 1024.0,
            self.contacts,
            self.single_ns,
            self.with_cell_ns,
            self.all_cells_ns,
            self.path_ns,
            self.batch_ns,
            self.back_ns,
            self.back_by_pixels_ns.map_or("-".into(), |ns| format!("{ns:.0}")),
        );
        for band in &self.bands {
            text += &format!(
                "| {} to {} | {:.0} | {:.0} | {:.1} | {} | {} | {} % |\n",
                band.off_mm[0],
                band.off_mm[1],
                band.exact_ns,
                band.reactive_ns,
                band.times_faster,
                lengths(&band.interval_mm),
                lengths(&band.error_mm),
                percents(&band.decided)
            );
        }
        text += "\nReactive answers with their cell on a level:\n\n\
                 | mm off | level | triangles | ns: on the face, after a walk | field as exact |\n|---|---|---|---|---|\n";
        for band in &self.bands {
            let [from, to] = band.off_mm;
            for LevelCosts { level, faces, with_cell_ns: [face, walk], same_field } in &band.levels {
                let same = percents(same_field);
                text +=
                    &format!("| {from} to {to} | {level} | {faces} | {face:.0}, {walk:.0} | {same} % |\n");
            }
        }
        text
    }
}
