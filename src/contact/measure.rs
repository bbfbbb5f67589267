//! Measures the answers on each level of a map on this machine: time, interval and true error against the
//! exact answer.
//!
//! Contacts lie on both sides of the skin, in random order except on a path: 0 to 3 mm off it, or in a
//! [band](BandCosts). A time is the mean over all contacts, of the fastest of [`PASSES`] passes for every
//! [`FEW`] of them; compared tasks alternate after that many contacts, on different ones. The time of the
//! cells of all levels is that on top of an answer with its cell of level 0.

use std::{array, fmt::Write, hint::black_box, time::Instant};

use glam::{DVec2, DVec3};
use serde::Serialize;

use crate::bvh::Start;
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::contact::{
    Cell, ContactError, ContactIndex, Hit, IndexOptions, MapIndex, Query, Reactive, Refine,
};
use crate::id::IdVec;
use crate::map::{PatchMap, SkinMap};
use crate::mesh::triangle_cross;
use crate::numeric::Random;
use crate::pyramid::LevelId;
use crate::skin::PatchId;

const CONTACTS: usize = 1 << 15;
const BAND_CONTACTS: usize = 1 << 13;
const PASSES: usize = 13;
/// Contacts that are timed together.
const FEW: usize = 128;

/// Least and largest distance from the skin of the contacts of a band, in mm.
const BANDS_MM: [[f64; 2]; 4] = [[0.0, 3.0], [3.0, 10.0], [10.0, 20.0], [20.0, 50.0]];

/// Thresholds on the distance of a contact, in mm, which an answer may decide.
const THRESHOLDS_MM: [f64; 5] = [1.0, 2.0, 5.0, 10.0, 20.0];

/// Costs of answers on a map: times in ns per contact. See [`measure`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnswerCosts {
    /// Triangles of level 0, of all patches.
    pub faces: usize,
    /// Number of contacts of exact answers.
    pub contacts: usize,
    /// Time to make the index, in s.
    pub index_seconds: f64,
    /// Time to make the index with reactive answers, in s.
    pub index_with_reactive_seconds: f64,
    /// Memory of the octrees of reactive answers, in bytes.
    pub reactive_bytes: usize,
    /// The nearest point of the skin, alone.
    pub single_ns: f64,
    /// The nearest point with its cell of level 0.
    pub with_cell_ns: f64,
    /// Additional time of the cells of all levels.
    pub all_cells_ns: f64,
    /// The nearest point near that of the contact before, on a path.
    pub path_ns: f64,
    /// The nearest point in a batch, on all threads.
    pub batch_ns: f64,
    /// From a point of the map to the skin.
    pub back_ns: f64,
    /// From a pixel of the map to the skin, pixel by pixel; `None` if none lies on the map.
    pub back_by_pixels_ns: Option<f64>,
    /// Reactive answers, band by band; bands without a contact are left out.
    pub bands: Vec<BandCosts>,
}

/// Costs and errors of reactive answers to contacts in a band of distances off the skin, on both sides.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BandCosts {
    /// Least and largest distance of the contacts from the skin, in mm.
    pub off_mm: [f64; 2],
    /// Number of contacts.
    pub contacts: usize,
    /// Time of the exact answer, in ns.
    pub exact_ns: f64,
    /// Time of the interval, the side and the face.
    pub reactive_ns: f64,
    /// `exact_ns / reactive_ns`.
    pub times_faster: f64,
    /// Width of the interval, in mm: median, 99th percentile and largest.
    pub interval_mm: [f64; 3],
    /// The true error of its middle, in mm: median, 99th percentile and largest.
    pub error_mm: [f64; 3],
    /// Number of intervals that do not contain the exact distance: 0.
    pub violations: usize,
    /// Share of the contacts certainly off the skin whose side is not that of the exact answer.
    pub wrong_sides: f64,
    /// Share of the contacts for which the answer decides whether they are within 1, 2, 5, 10 and 20 mm of
    /// the skin.
    pub decided: [f64; 5],
    /// The levels, finest first.
    pub levels: Vec<LevelCosts>,
}

/// Costs of an answer with its cell on a level, and of a search of the mesh of the level.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LevelCosts {
    /// The level.
    pub level: usize,
    /// Its triangles, of all patches.
    pub faces: usize,
    /// Time of a reactive answer with its cell on the level, in ns: on its face, and after a walk from there.
    pub with_cell_ns: [f64; 2],
    /// Share of the answers whose strongest field is that of the exact answer: on its face, and after a walk.
    pub same_field: [f64; 2],
    /// Time of a search for the nearest point of the mesh of the level, in ns.
    pub search_ns: f64,
    /// Error of its distance, in mm: median, 99th percentile and largest.
    pub search_error_mm: [f64; 3],
}

/// The contacts of a measurement, in world coordinates.
#[derive(Debug, Clone)]
pub struct SampleContacts {
    /// 0 to 3 mm off the skin, on both sides, in random order.
    pub scattered: Vec<Query>,
    /// A path over the skin in steps of half a millimetre, 1 to 1.1 mm off; it turns slowly, and back at
    /// borders.
    pub path: Vec<Query>,
}

impl SampleContacts {
    /// Contacts on a map, the same in every run.
    ///
    /// # Errors
    /// As [`ContactIndex::locate`].
    pub fn new(map: &SkinMap, index: &ContactIndex) -> Result<Self, ContactError> {
        let mut random = Random::new(1, 0);
        let scattered: Vec<Query> =
            contacts_off(map, index, BANDS_MM[0], CONTACTS)?.into_iter().map(|(query, _)| query).collect();
        let first = scattered.first().ok_or(ContactError::NoSkin)?;
        let mut at = index.locate(*first)?.position;
        let mut heading = DVec3::new(0.3, 0.8, 0.5).normalize();
        let step = |_| {
            let hit = index.locate(Query::from(at + heading * 0.0005))?;
            let is_stopped = hit.position.distance(at) < 0.0002;
            at = hit.position;
            let turn = if is_stopped { 2.0 + random.uniform() } else { 0.2 * (random.uniform() - 0.5) };
            let normal = hit.normal.try_normalize().unwrap_or(DVec3::Z);
            let along = heading.reject_from(normal).normalize_or(normal.any_orthonormal_vector());
            heading = along * turn.cos() + normal.cross(along) * turn.sin();
            Ok(Query::from(at + normal * (0.001 + 0.0001 * random.uniform())))
        };
        let path = (0..CONTACTS).map(step).collect::<Result<_, ContactError>>()?;
        Ok(Self { scattered, path })
    }
}

/// Measures the answers on all levels of a map. Takes some seconds, a minute for a million triangles.
///
/// # Errors
/// As [`ContactIndex::new`].
pub fn measure(map: &SkinMap) -> Result<AnswerCosts, ContactError> {
    let (plain, index_seconds) = timed(|| ContactIndex::new(map))?;
    let reactive = IndexOptions { reactive: true, ..IndexOptions::default() };
    let (index, index_with_reactive_seconds) = timed(|| ContactIndex::with_options(map, &reactive))?;
    let SampleContacts { scattered, path } = SampleContacts::new(map, &plain)?;
    let exact: Vec<Hit> = plain.locate_all(&scattered)?.iter().collect();
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
    let [batch_ns] = time_in_turn(&[()], [&mut |()| _ = black_box(plain.locate_all(&scattered))]);
    let [back_ns, back_by_pixels_ns] = measure_back(map, &plain, &exact)?;
    let levels = LevelMeshes::new(map)?;
    let mut bands = Vec::new();
    for off_mm in BANDS_MM {
        bands.extend(measure_band(map, &index, &levels, off_mm)?);
    }
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
        bands,
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

/// Measures lookups from the map to the skin: from the cells of hits, and pixel by pixel.
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
    let pixels = map.patches.enumerate().flat_map(|(id, patch)| pixels(id, patch));
    let pixels: Vec<(PatchId, DVec2)> = pixels.filter(&mut answer).take(CONTACTS).collect();
    Ok([on_map, pixels].map(|places| {
        let [ns] = time_in_turn(&places, [&mut |place| _ = answer(place)]);
        (!places.is_empty()).then_some(ns)
    }))
}

/// The pixels of the image of level 0, row by row, from a quarter of its height on.
fn pixels(id: PatchId, patch: &PatchMap) -> impl Iterator<Item = (PatchId, DVec2)> {
    let frame = patch.levels[LevelId::new(0)].frame;
    let [columns, rows] = frame.size_px;
    (rows / 4..rows).flat_map(move |row| (0..columns).map(move |column| (id, frame.centre([column, row]))))
}

/// The mesh of each level, prepared for searches.
struct LevelMeshes(Vec<IdVec<PatchId, Option<PatchBvh>>>);

impl LevelMeshes {
    fn new(map: &SkinMap) -> Result<Self, ContactError> {
        let count = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0);
        let of = |level: usize| {
            let tree = |patch: &PatchMap| {
                let map = patch.levels.get(LevelId::new(level));
                map.map(|map| PatchBvh::new(&patch.name, &map.level.mesh)).transpose()
            };
            map.patches.iter().map(tree).collect::<Result<IdVec<_, _>, ContactError>>()
        };
        (0..count).map(of).collect::<Result<_, _>>().map(Self)
    }

    /// The distance of a query from the mesh of a level, in m.
    fn search(&self, index: &ContactIndex, level: usize, query: &Query) -> f64 {
        let mut best = None;
        index.each_patch(query, f64::INFINITY, |id, q| {
            if let Some(tree) = &self.0[level][id] {
                tree.nearest(id, q, Start::Root, &mut best);
            }
            Best::squared(best.as_ref()).sqrt()
        });
        Best::squared(best.as_ref()).sqrt()
    }
}

/// Contacts in a band of distances off the skin, on both sides, in random order, with their exact answers;
/// fewer than `count` if few points are that far off.
fn contacts_off(
    map: &SkinMap,
    index: &ContactIndex,
    off_mm: [f64; 2],
    count: usize,
) -> Result<Vec<(Query, Hit)>, ContactError> {
    let (mut random, [least, most]) = (Random::new(2, 0), off_mm.map(|mm| 1e-3 * mm));
    let finest = |patch: PatchId| &map.patches[patch].levels[LevelId::new(0)].level.mesh;
    let (mut faces, mut area) = (Vec::new(), 0.0);
    for patch in map.patches.ids() {
        for face in finest(patch).triangles.ids() {
            area += finest(patch).face_area(face);
            faces.push((area, patch, face));
        }
    }
    let mut contacts = Vec::new();
    for _ in 0..16 * count {
        let at = area * random.uniform();
        let (_, patch, face) = faces[faces.partition_point(|(sum, ..)| *sum < at).min(faces.len() - 1)];
        let [a, b, c] = finest(patch).corners(face);
        let (s, t) = (random.uniform().sqrt(), random.uniform());
        let normal =
            triangle_cross([a, b, c]).normalize_or_zero() * if random.below(2) == 0 { 1.0 } else { -1.0 };
        // Tilted, so that contacts also lie beyond rims.
        let up = (normal + 0.3 * random.direction()).normalize_or_zero();
        let height = least + (most - least) * random.uniform();
        let at = a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t) + up * height;
        let query = Query::from(index.links.pose(map.patches[patch].link).transform_point3(at));
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

/// Measures reactive answers in a band against the exact ones; `None` if no contact is that far off.
fn measure_band(
    map: &SkinMap,
    index: &ContactIndex,
    levels: &LevelMeshes,
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
    Ok(Some(BandCosts {
        off_mm,
        contacts: contacts.len(),
        exact_ns,
        reactive_ns,
        times_faster: exact_ns / reactive_ns,
        interval_mm: spread(answers.iter().map(|answer| answer.most - answer.least).collect()),
        error_mm: spread(pairs().map(|(a, b)| (a.distance.abs() - b.distance.abs()).abs()).collect()),
        violations: pairs().filter(is_wrong).count(),
        wrong_sides: share(pairs().filter(is_other_side).count()),
        decided: THRESHOLDS_MM.map(|mm| share(decides(mm))),
        levels: (0..levels.0.len())
            .map(|level| measure_level(map, index, levels, level, &contacts))
            .collect(),
    }))
}

fn measure_level(
    map: &SkinMap,
    index: &ContactIndex,
    levels: &LevelMeshes,
    level: usize,
    contacts: &[(Query, Hit)],
) -> LevelCosts {
    let id = LevelId::new(level);
    let cell = |query: &Query, refine: Refine| -> Option<Cell> {
        let answer = index.reactive(*query).ok()?;
        index.cell(&index.hit_of(*query, &answer, refine)?, id)
    };
    let [on_face, walked, search_ns] = time_in_turn(
        contacts,
        [
            &mut |(q, _)| _ = black_box(cell(q, Refine::Face)),
            &mut |(q, _)| _ = black_box(cell(q, Refine::Walk)),
            &mut |(q, _)| _ = black_box(levels.search(index, level, q)),
        ],
    );
    let field = |cell: Option<Cell>| cell.map(|cell| cell.field);
    let same = |refine: Refine| {
        let is_same = |(q, hit): &&(Query, Hit)| field(cell(q, refine)) == field(index.cell(hit, id));
        contacts.iter().filter(is_same).count() as f64 / contacts.len() as f64
    };
    let error = |(q, hit): &(Query, Hit)| (levels.search(index, level, q) - hit.distance.abs()).abs();
    LevelCosts {
        level,
        faces: faces_of(map, id),
        with_cell_ns: [on_face, walked],
        same_field: [Refine::Face, Refine::Walk].map(same),
        search_ns,
        search_error_mm: spread(contacts.iter().map(error).collect()),
    }
}

/// Median, 99th percentile and largest, in mm.
fn spread(mut lengths: Vec<f64>) -> [f64; 3] {
    lengths.sort_by(f64::total_cmp);
    let last = lengths.len() - 1;
    [last / 2, last * 99 / 100, last].map(|k| 1e3 * lengths[k])
}

impl AnswerCosts {
    /// The measurement as tables in Markdown.
    pub fn to_markdown(&self) -> String {
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
        let percent = |share: &f64| format!("{:.0}", 100.0 * share);
        let decided = |band: &BandCosts| {
            format!("{} %", band.decided.iter().map(percent).collect::<Vec<_>>().join(", "))
        };
        let lengths = |mm: &[f64]| mm.iter().map(|x| format!("{x:.3}")).collect::<Vec<_>>().join(", ");
        for band in &self.bands {
            let BandCosts {
                off_mm: [from, to],
                exact_ns,
                reactive_ns,
                times_faster,
                interval_mm,
                error_mm,
                ..
            } = band;
            let _ = writeln!(
                text,
                "| {from} to {to} | {exact_ns:.0} | {reactive_ns:.0} | {times_faster:.1} | {} | {} | {} |",
                lengths(interval_mm),
                lengths(error_mm),
                decided(band)
            );
        }
        text += "\nReactive answers with their cell on a level, and a search of the mesh of that level:\n\n\
                 | mm off | level | triangles | with cell ns: on the face, after a walk | field as exact | interval mm: median, 99 % | \
                 decides 1, 2, 5, 10, 20 mm | search ns | its error mm: median, 99 % |\n\
                 |---|---|---|---|---|---|---|---|---|\n";
        for band in &self.bands {
            for LevelCosts { level, faces, with_cell_ns, same_field, search_ns, search_error_mm } in
                &band.levels
            {
                let ([from, to], [face, walk]) = (band.off_mm, with_cell_ns);
                let _ = writeln!(
                    text,
                    "| {from} to {to} | {level} | {faces} | {face:.0}, {walk:.0} | {} % | {} | {} | {search_ns:.0} | {} |",
                    same_field.iter().map(percent).collect::<Vec<_>>().join(", "),
                    lengths(&band.interval_mm[..2]),
                    decided(band),
                    lengths(&search_error_mm[..2]),
                );
            }
        }
        text
    }
}
