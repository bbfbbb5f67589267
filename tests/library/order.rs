//! Laws of the order of columns: touches put shuffled columns back on a skin; what touches leave open is refused.

use std::sync::Arc;

use dermatome::Error;
use dermatome::id::VertexId;
use dermatome::io::{Readings, ReadingsReader, read_order, write_order};
use dermatome::map::SkinMap;
use dermatome::plot::{PlotOptions, plot_signals};
use dermatome::recording::{Recording, RecordingOptions, find_order, map_signals};
use dermatome::run::Run;
use dermatome::signal::{
    ConditionOptions, LEAST_OBJECTIVE, Order, Quantity, ReadoutOptions, TouchOptions, TouchSimulation, Zero,
};
use dermatome::skin::{PatchId, Skin, TaxelId};

use crate::common;

const SPACING: f64 = 0.006;

/// A sheet with arms of unequal lengths and widths, which no turn or mirror image maps onto itself.
fn hand() -> Skin {
    common::cut_sheet(SPACING, |x, y| y < 3.5 || (x < 4.5 && y < 9.5))
}

fn presses(count: usize) -> TouchOptions {
    TouchOptions {
        radii: vec![0.015],
        presses: count,
        pause: 0.1,
        rate: 20.0,
        quantity: Quantity::Intensive,
        noise: 2000.0,
        seed: 4,
        readout: ReadoutOptions { gain_spread: 0.3, ..ReadoutOptions::default() },
        ..TouchOptions::default()
    }
}

/// A recording whose column `k` is of taxel `order[k]`.
fn record(skin: &Skin, options: &TouchOptions, order: &[usize]) -> Readings {
    let mut simulation = TouchSimulation::new(skin, options).unwrap();
    let channels = vec![simulation.channel().clone()];
    let mut readings = Readings { channels, width: order.len(), ..Readings::default() };
    while let Some((frame, _)) = simulation.next_frame() {
        readings.times.push(frame.time);
        let all: Vec<f64> = frame.values.iter().flat_map(|patch| patch[0].iter().copied()).collect();
        readings.values.extend(order.iter().map(|&k| all[k]));
    }
    readings
}

/// A permutation: multiples of a number that has no factor in common with the count.
fn shuffled(count: usize) -> Vec<usize> {
    let factor = [37, 41, 43].into_iter().find(|factor| !count.is_multiple_of(*factor)).unwrap();
    (0..count).map(|k| (k * factor + 5) % count).collect()
}

fn find(skin: &Skin, readings: &Readings, known: &[(usize, TaxelId)]) -> Result<Order, Error> {
    let condition = ConditionOptions { zero: Zero::At(0.0), ..ConditionOptions::default() };
    let options = RecordingOptions { condition, ..RecordingOptions::default() };
    let open = |_| Ok::<_, Error>(ReadingsReader::memory(readings.clone())?);
    find_order(&SkinMap::of_taxels(skin), known, None, &options, 1, open, Run::default())
}

/// The shares of all taxels whose column is at their place, and at most a spacing off.
fn right(skin: &Skin, order: &Order, truth: &[usize]) -> [f64; 2] {
    let positions = &skin.patches[PatchId::new(0)].mesh.positions;
    let count = |far: f64| {
        let all = order.columns.iter().zip(truth);
        let near = all.filter(|(column, at)| {
            column.taxel.is_some_and(|(_, vertex, _)| {
                positions[vertex].distance(positions[VertexId::new(**at)]) <= far * SPACING
            })
        });
        near.count() as f64 / positions.len() as f64
    };
    [count(0.1), count(1.3)]
}

fn count(skin: &Skin) -> usize {
    skin.patches[PatchId::new(0)].mesh.positions.len()
}

#[test]
fn shuffled_columns_are_put_back() {
    let skin = hand();
    let truth = shuffled(count(&skin));
    let order = find(&skin, &record(&skin, &presses(120), &truth), &[]).unwrap();
    let [exact, near] = right(&skin, &order, &truth);
    assert!(exact > 0.8 && near > 0.97, "{exact}, {near}: objective {}", order.objective);
    assert!(order.objective >= LEAST_OBJECTIVE && order.runner_up.is_none_or(|next| next < order.objective));
    assert!(order.touches.abs_diff(120) < 12, "{} touches", order.touches);
    let supports = order.columns.iter().filter(|column| column.taxel.is_some()).map(|column| column.support);
    assert!(supports.clone().all(|support| (0.0..=1.0).contains(&support)));
    assert_eq!(order.placed() + order.without_column, truth.len());
}

/// The names of columns do not matter: another order of the same columns has the same taxels.
#[test]
fn relabelled_columns_have_the_same_taxels() {
    let skin = hand();
    let truth = shuffled(count(&skin));
    let plain: Vec<usize> = (0..truth.len()).collect();
    let [one, other] =
        [&plain, &truth].map(|order| find(&skin, &record(&skin, &presses(120), order), &[]).unwrap());
    for (k, &at) in truth.iter().enumerate() {
        assert_eq!(other.columns[k].taxel, one.columns[at].taxel, "column {k}");
    }
}

/// A rectangle looks alike from four sides; three known columns decide, those that the error names do.
#[test]
fn symmetric_skins_need_known_columns() {
    let skin = common::cut_sheet(SPACING, |x, y| x < 9.5 && y < 9.5);
    let truth = shuffled(count(&skin));
    let readings = record(&skin, &presses(150), &truth);
    let error = find(&skin, &readings, &[]).unwrap_err();
    assert_eq!(error.kind(), "symmetric", "{error}");
    let Error::Order(dermatome::signal::OrderError::Symmetric { taxels, .. }) = &error else { panic!() };
    let ids = &skin.patches[PatchId::new(0)].taxels.ids;
    let column = |id: TaxelId| truth.iter().position(|&at| ids[VertexId::new(at)] == id).unwrap();
    let known = taxels.map(|id| (column(id), id));
    let order = find(&skin, &readings, &known).unwrap();
    let [_, near] = right(&skin, &order, &truth);
    assert!(near > 0.97, "{near}");
    for (column, id) in known {
        assert_eq!(order.columns[column].taxel.map(|(.., id)| id), Some(id));
        assert!(order.columns[column].is_known);
    }
    let centre = [(truth.iter().position(|&at| at == 52).unwrap(), ids[VertexId::new(52)])];
    let kind = find(&skin, &readings, &centre).unwrap_err().kind();
    assert_eq!(kind, "symmetric", "the centre decides nothing");

    // Columns that are known wrongly, one of them beyond all symmetric orders.
    let [a, b, c] = known;
    let wrong = [(a.0, b.1), (b.0, c.1), (c.0, ids[VertexId::new(44)])];
    assert_eq!(find(&skin, &readings, &wrong).unwrap_err().kind(), "contradiction");
}

/// Columns that nothing touches, and taxels without a column, are counted, not guessed.
#[test]
fn silent_columns_have_no_taxel() {
    let skin = hand();
    let truth: Vec<usize> = shuffled(count(&skin)).into_iter().filter(|k| k % 9 != 4).collect();
    let mut readings = record(&skin, &presses(120), &truth);
    let width = truth.len();
    for frame in readings.values.chunks_mut(width) {
        frame[3] = 0.0;
        frame[7] = f64::NAN;
    }
    let order = find(&skin, &readings, &[]).unwrap();
    assert_eq!((order.columns[3].taxel, order.columns[7].taxel), (None, None));
    assert!(order.placed() <= width - 2 && order.placed() + order.without_column == count(&skin));
    let [_, near] = right(&skin, &order, &truth);
    assert!(near > 0.9 * (width - 2) as f64 / count(&skin) as f64, "{near} of all");
    // A known column has its taxel, though nothing touched it.
    let id = skin.patches[PatchId::new(0)].taxels.ids[VertexId::new(truth[3])];
    // The same if its signals are connected with no others.
    let mut alone = readings.clone();
    let untouched = |frame: &&mut [f64]| frame.iter().all(|x| x.is_nan() || *x < 8000.0);
    alone.values.chunks_mut(width).filter(untouched).take(8).for_each(|frame| frame[3] = 50_000.0);
    for readings in [readings, alone] {
        let order = find(&skin, &readings, &[(3, id)]).unwrap();
        assert_eq!(order.columns[3].taxel.map(|(.., id)| id), Some(id));
        assert!(order.columns[3].support.is_nan());
        let mut ids: Vec<TaxelId> = order.columns.iter().filter_map(|c| c.taxel).map(|(.., id)| id).collect();
        ids.sort_unstable();
        assert!(ids.is_sorted_by(|a, b| a < b), "each taxel once");
    }
}

#[test]
fn what_touches_leave_open_is_refused() {
    let skin = hand();
    let plain: Vec<usize> = (0..count(&skin)).collect();
    let kind = |readings: &Readings, known: &[(usize, TaxelId)]| {
        let error = find(&skin, readings, known).unwrap_err();
        (error.kind(), error.to_string())
    };
    let silent = record(&skin, &TouchOptions { pause: 2.0, ..presses(0) }, &plain);
    assert_eq!(kind(&silent, &[]).0, "no_touch");
    let few = kind(&record(&skin, &presses(3), &plain), &[]);
    assert_eq!(few.0, "unconnected", "{}", few.1);
    // Touches that do not overlap enough.
    let small = TouchOptions { radii: vec![0.006], roll: 0.0, ..presses(60) };
    let (found, text) = kind(&record(&skin, &small, &plain), &[]);
    assert!(["unconnected", "poor"].contains(&found), "{found}: {text}");
    // All readings at one value, whether it is saturated or not.
    let mut held = silent.clone();
    held.values.fill(4095.0);
    assert_eq!(kind(&held, &[]).0, "no_touch");
    let empty = Readings { times: Vec::new(), values: Vec::new(), ..silent };
    assert_eq!(kind(&empty, &[]).0, "no_touch");

    let readings = record(&skin, &presses(3), &plain);
    let ids = &skin.patches[PatchId::new(0)].taxels.ids;
    let id = |k: usize| ids[VertexId::new(k)];
    for (known, needed) in [
        (vec![(plain.len(), id(0))], "known_column"),
        (vec![(0, TaxelId(99_999))], "known_taxel"),
        (vec![(0, id(0)), (1, id(0))], "known_twice"),
        (vec![(0, id(0)), (0, id(1))], "known_column_twice"),
    ] {
        assert_eq!(kind(&readings, &known).0, needed);
    }
}

/// Taxels that share an id are placed, but a table cannot name them.
#[test]
fn shared_ids_are_not_written() {
    let mut skin = hand();
    let truth = shuffled(count(&skin));
    let ids = &mut skin.patches[PatchId::new(0)].taxels.ids;
    [10, 30].into_iter().for_each(|k| ids[VertexId::new(k)] = TaxelId(0));
    let order = find(&skin, &record(&skin, &presses(120), &truth), &[]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("order.csv");
    assert_eq!(write_order(&path, &order).unwrap(), 2);
    let rows = read_order(&path).unwrap().rows;
    assert_eq!(rows.len(), order.placed() - 2);
    assert!(rows.iter().all(|&(column, id)| order.columns[column].taxel.is_some_and(|(.., own)| own == id)));
}

/// The map from signals is the true one, up to turns, mirror images and scale; taxels without signals have no place on it.
#[test]
fn signals_draw_the_map() {
    let skin = hand();
    let plain: Vec<usize> = (0..count(&skin)).collect();
    let mut readings = record(&skin, &presses(120), &plain);
    readings.values.chunks_mut(plain.len()).for_each(|frame| frame[20] = f64::NAN);
    let map = Arc::new(SkinMap::of_taxels(&skin));
    let open = |map: &Arc<SkinMap>, readings: &Readings, zero| {
        let condition = ConditionOptions { zero, ..ConditionOptions::default() };
        let options = RecordingOptions { condition, ..RecordingOptions::default() };
        Ok::<_, Error>(Recording::open(map, ReadingsReader::memory(readings.clone())?, &options)?)
    };
    let signals = map_signals(&map, Zero::At(0.0), 1, |_, zero| open(&map, &readings, zero)).unwrap();
    let found = signals[PatchId::new(0)].as_ref().unwrap();
    assert!(found.rms < 1.5 * SPACING, "{} m", found.rms);
    assert_eq!(found.points[VertexId::new(20)], None);
    // Neighbours are nearer to each other than to most others.
    let (a, b, far) = (VertexId::new(0), VertexId::new(1), VertexId::new(plain.len() - 1));
    let [a, b, far] = [a, b, far].map(|taxel| found.points[taxel].unwrap());
    assert!(a.distance(b) < 0.3 * a.distance(far));
    let picture = plot_signals(&map, &signals, &PlotOptions::default()).unwrap().to_svg();
    assert!(picture.contains("sheet, from signals") && picture.contains("mm rms"));

    // A second patch that nothing touches has no map from signals, and an empty place in the picture.
    let mut both = hand();
    both.append(&common::cut_sheet(SPACING, |x, y| x < 2.5 && y < 2.5));
    let mut wider = Readings { width: readings.width + 8, values: Vec::new(), ..readings.clone() };
    for frame in readings.values.chunks(readings.width) {
        wider.values.extend_from_slice(frame);
        wider.values.extend([0.0; 8]);
    }
    let map = Arc::new(SkinMap::of_taxels(&both));
    assert_eq!(map.patches[PatchId::new(1)].taxels.ids.len(), 8);
    let two = map_signals(&map, Zero::At(0.0), 1, |_, zero| open(&map, &wider, zero)).unwrap();
    assert_eq!((&two[PatchId::new(0)], &two[PatchId::new(1)]), (&signals[PatchId::new(0)], &None));
    plot_signals(&map, &two, &PlotOptions::default()).unwrap();

    let map = Arc::new(SkinMap::of_taxels(&skin));
    let silent = record(&skin, &TouchOptions { pause: 2.0, ..presses(0) }, &plain);
    let error = map_signals(&map, Zero::At(0.0), 1, |_, zero| open(&map, &silent, zero)).unwrap_err();
    assert_eq!(error.kind(), "no_touch");
}

/// Per cent of all taxels whose column is within a spacing of them, and objectives: the numbers of `docs/recordings.md`.
/// `cargo test --release --test library order:: -- --ignored table --nocapture`.
#[test]
#[ignore = "a measurement of minutes"]
fn table() {
    let Some(path) = common::data("cyskin/curved_gesture_patch_isomap.json") else { return };
    let draft = dermatome::io::read_draft(&path).unwrap();
    let skin = dermatome::skin::assemble(&draft, &dermatome::skin::AssembleOptions::default()).unwrap().skin;
    let truth = shuffled(count(&skin));
    let ids = &skin.patches[PatchId::new(0)].taxels.ids;
    // Three taxels far from each other whose ids are their own.
    let known = [0, 200, 640].map(|at| {
        let is_own = |id: TaxelId| ids.iter().filter(|other| **other == id).count() == 1;
        let at =
            (0..ids.len()).map(|k| (at + k) % ids.len()).find(|&k| is_own(ids[VertexId::new(k)])).unwrap();
        (truth.iter().position(|&k| k == at).unwrap(), ids[VertexId::new(at)])
    });
    for (radius, presses_of_it, least) in
        [(0.04, 200, 0.85), (0.04, 400, 0.98), (0.015, 400, 0.0), (0.015, 800, 0.9)]
    {
        for seed in 1..4 {
            let options = TouchOptions {
                radii: vec![radius],
                rate: 25.0,
                wobble: 0.05,
                seed,
                ..presses(presses_of_it)
            };
            match find(&skin, &record(&skin, &options, &truth), &known) {
                Ok(order) => {
                    let [exact, near] = right(&skin, &order, &truth).map(|share| 100.0 * share);
                    println!(
                        "{radius} m, {presses_of_it} touches, seed {seed}: {exact:.1} %, {near:.1} %, {:.3}",
                        order.objective
                    );
                    assert!(near >= 100.0 * least);
                }
                Err(error) => {
                    println!("{radius} m, {presses_of_it} touches, seed {seed}: {error}");
                    assert!(least == 0.0);
                }
            }
        }
    }
}
