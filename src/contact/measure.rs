//! What the answers on each level of a map cost and how exact they are, measured on this machine: time, error bound
//! and true error against the exact answer.
//!
//! Contacts lie 0 to 3 mm off the skin, in no order, but for those of a path. A time is the mean over all
//! contacts, of the fastest of [`PASSES`] passes for every [`FEW`] of them; works that are compared take turns
//! after that many contacts, on different ones. Map positions of all levels count from an answer with its map
//! position of level 0.

use std::{array, fmt::Write, hint::black_box, time::Instant};

use glam::{DVec2, DVec3};
use serde::Serialize;

use crate::contact::{ContactError, ContactIndex, Hit, IndexOptions, MapIndex, Query, Reactive};
use crate::id::FaceId;
use crate::map::{PatchMap, SkinMap};
use crate::numeric::Random;
use crate::pyramid::LevelId;
use crate::skin::PatchId;

const CONTACTS: usize = 1 << 15;
const PASSES: usize = 13;
/// Contacts that are timed together.
const FEW: usize = 128;

/// Thresholds on the distance of a contact, in mm, that a level decides or not.
const THRESHOLDS_MM: [f64; 4] = [1.0, 2.0, 5.0, 10.0];

/// What answers on a map cost: times in ns a contact. See [`measure`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnswerCosts {
    /// Triangles of level 0, of all patches.
    pub faces: usize,
    /// Number of contacts.
    pub contacts: usize,
    /// Time to make the index, in s.
    pub index_seconds: f64,
    /// The same with trees of all levels.
    pub index_with_levels_seconds: f64,
    /// The nearest point of the skin, alone.
    pub single_ns: f64,
    /// The same with its cell of level 0.
    pub with_cell_ns: f64,
    /// What the cells of all levels add to the nearest point.
    pub all_cells_ns: f64,
    /// The nearest point near that of the contact before, on a path.
    pub path_ns: f64,
    /// The nearest point in a batch, on all threads.
    pub batch_ns: f64,
    /// From a place of the map to the skin.
    pub back_ns: f64,
    /// The same from pixel to pixel; `None` where none lies on the map.
    pub back_by_pixels_ns: Option<f64>,
    /// The levels above level 0, which answer alone.
    pub levels: Vec<LevelCosts>,
}

/// What answers of one level alone cost, and how exact they are.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LevelCosts {
    /// The level.
    pub level: usize,
    /// Its triangles, of all patches.
    pub faces: usize,
    /// Time of an answer, in ns.
    pub ns: f64,
    /// Time of the exact answer over it, measured in turn.
    pub times_faster: f64,
    /// The error bound that comes with an answer, in mm: median, 99th percentile and largest.
    pub bound_mm: [f64; 3],
    /// The true error of the distance, in the same way.
    pub error_mm: [f64; 3],
    /// Number of answers between whose `least` and `most` the exact distance does not lie: 0.
    pub violations: usize,
    /// Share of the contacts of which the answer tells for sure whether they are within 1, 2, 5 and
    /// 10 mm of the skin.
    pub decided: [f64; 4],
}

/// The contacts of a measurement, in world coordinates.
#[derive(Debug, Clone)]
pub struct SampleContacts {
    /// 0 to 3 mm off the skin, in no order.
    pub scattered: Vec<Query>,
    /// A walk over the skin in steps of half a millimetre, turning slowly and turning back at borders, 1 to
    /// 1.1 mm off.
    pub path: Vec<Query>,
}

impl SampleContacts {
    /// Contacts on a map, the same in every run.
    ///
    /// # Errors
    /// As [`ContactIndex::locate`].
    pub fn new(map: &SkinMap, index: &ContactIndex) -> Result<Self, ContactError> {
        let mut random = Random::new(1, 0);
        let finest = |patch: PatchId| &map.patches[patch].levels[LevelId::new(0)].level.mesh;
        let faces: Vec<(PatchId, FaceId)> =
            map.patches.ids().flat_map(|id| finest(id).triangles.ids().map(move |face| (id, face))).collect();
        if faces.is_empty() {
            return Err(ContactError::NoSkin);
        }
        let scattered = (0..CONTACTS).map(|_| {
            let (patch, face) = faces[random.below(faces.len())];
            let [a, b, c] = finest(patch).corners(face);
            let (s, t) = (random.uniform().sqrt(), random.uniform());
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let at = a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t) + normal * (0.003 * random.uniform());
            Query::from(index.poses()[map.patches[patch].link].transform_point3(at))
        });
        let scattered: Vec<Query> = scattered.collect();
        let mut at = index.locate(scattered[0])?.position;
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

/// Measures the answers on all levels of a map, which takes some seconds, a minute at a million triangles.
///
/// # Errors
/// As [`ContactIndex::new`].
pub fn measure(map: &SkinMap) -> Result<AnswerCosts, ContactError> {
    let (plain, index_seconds) = timed(|| ContactIndex::new(map))?;
    let with_levels = IndexOptions { levels: true, ..IndexOptions::default() };
    let (index, index_with_levels_seconds) = timed(|| ContactIndex::with_options(map, &with_levels))?;
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
    let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(1);
    let of_level = |level| measure_level(map, &index, LevelId::new(level), &scattered, &exact);
    Ok(AnswerCosts {
        faces: faces_of(map, finest),
        contacts: scattered.len(),
        index_seconds,
        index_with_levels_seconds,
        single_ns,
        with_cell_ns,
        all_cells_ns: with_all_ns - single_ns,
        path_ns,
        batch_ns: batch_ns / scattered.len() as f64,
        back_ns: back_ns.unwrap_or_default(),
        back_by_pixels_ns,
        levels: (1..levels).map(of_level).collect::<Result<_, _>>()?,
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

/// Times of an item of several works in turn, in ns: their differences hold on a busy machine too. What one
/// has just loaded into the cache is of no use to the next, which works elsewhere.
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

/// The way back from the places of hits, and from pixel to pixel.
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

/// Answers of one level alone, compared with the exact ones.
fn measure_level(
    map: &SkinMap,
    index: &ContactIndex,
    level: LevelId,
    contacts: &[Query],
    exact: &[Hit],
) -> Result<LevelCosts, ContactError> {
    let answers = contacts.iter().map(|&q| index.reactive(q, level)).collect::<Result<Vec<_>, _>>()?;
    let [exact_ns, ns] = time_in_turn(
        contacts,
        [&mut |&q| _ = black_box(index.locate(q)), &mut |&q| _ = black_box(index.reactive(q, level))],
    );
    let errors = answers.iter().zip(exact).map(|(a, b)| (a.distance.abs() - b.distance.abs()).abs());
    let errors: Vec<f64> = errors.collect();
    let bounds: Vec<f64> = answers.iter().map(Reactive::error).collect();
    let is_wrong = |(answer, exact): (&Reactive, &Hit)| {
        let away = exact.distance.abs();
        away < answer.least - 1e-12 || away > answer.most + 1e-12
    };
    let share = |count: usize| count as f64 / contacts.len() as f64;
    let decides = |mm: f64| answers.iter().filter(|answer| answer.is_within(1e-3 * mm).is_some()).count();
    Ok(LevelCosts {
        level: level.index(),
        faces: faces_of(map, level),
        ns,
        times_faster: exact_ns / ns,
        violations: answers.iter().zip(exact).filter(|&pair| is_wrong(pair)).count(),
        bound_mm: spread(bounds),
        error_mm: spread(errors),
        decided: THRESHOLDS_MM.map(|mm| share(decides(mm))),
    })
}

/// Median, 99th percentile and largest, in mm.
fn spread(mut lengths: Vec<f64>) -> [f64; 3] {
    lengths.sort_by(f64::total_cmp);
    let last = lengths.len() - 1;
    [last / 2, last * 99 / 100, last].map(|k| 1e3 * lengths[k])
}

impl AnswerCosts {
    /// The measurement as a table in Markdown.
    pub fn to_markdown(&self) -> String {
        let mut text = format!(
            "{} triangles, {} contacts; index in {:.2} s, with levels in {:.2} s\n\n\
             | single ns | with cell | cells of all levels add | on a path | batch | way back | from pixel to pixel |\n\
             |---|---|---|---|---|---|---|\n\
             | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {} |\n\n\
             | level | triangles | ns | times faster | bound mm: median, 99 %, largest | error mm: median, 99 %, largest | \
             decides 1, 2, 5, 10 mm |\n\
             |---|---|---|---|---|---|---|\n",
            self.faces,
            self.contacts,
            self.index_seconds,
            self.index_with_levels_seconds,
            self.single_ns,
            self.with_cell_ns,
            self.all_cells_ns,
            self.path_ns,
            self.batch_ns,
            self.back_ns,
            self.back_by_pixels_ns.map_or("-".into(), |ns| format!("{ns:.0}")),
        );
        for level in &self.levels {
            let [bound, error] =
                [level.bound_mm, level.error_mm].map(|mm| mm.map(|x| format!("{x:.3}")).join(", "));
            let decided = level.decided.map(|share| format!("{:.0} %", 100.0 * share)).join(", ");
            let LevelCosts { level, faces, ns, times_faster, .. } = level;
            let _ = writeln!(
                text,
                "| {level} | {faces} | {ns:.0} | {times_faster:.1} | {bound} | {error} | {decided} |"
            );
        }
        text
    }
}
