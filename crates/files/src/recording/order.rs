//! Which column of recordings is of which taxel: recordings, passed as often as [`ColumnOrder`] needs them.

use std::sync::Arc;

use crate::Error;
use crate::id::{IdVec, VertexId};
use crate::io::ReadingsReader;
use crate::map::SkinMap;
use crate::mesh::TriMesh;
use crate::recording::{Recording, RecordingOptions, same_unit};
use crate::run::Run;
use crate::signal::{ColumnOrder, ConditionOptions, Order, OrderError, SignalError, SignalMap, Zero};
use crate::skin::{PatchId, Skin, TaxelId};

/// Finds the order of the columns of recordings of separate touches on a skin; ids of columns are not used.
///
/// `open` opens a recording, by its number; each of the `recordings` is opened [`ColumnOrder::PASSES`] times, so that
/// memory does not depend on their length. The [channel](Recording::channel) without a name counts. `known` columns, counted from
/// 0, with the ids of their taxels, decide where the skin is symmetric. `options` say how readings are made comparable;
/// [`Zero::Taken`] is right only for readings less their zeros.
///
/// # Errors
/// Those of `open` and of reading; [`OrderError`] if the recordings do not determine the order.
pub fn find_order<E: From<Error>>(
    map: &SkinMap,
    known: &[(usize, TaxelId)],
    threshold: Option<f64>,
    options: &RecordingOptions,
    recordings: usize,
    mut open: impl FnMut(usize) -> Result<ReadingsReader, E>,
    run: Run<'_>,
) -> Result<Order, E> {
    let fail = |error: OrderError| E::from(Error::from(error));
    let mut found: Option<(ColumnOrder, Arc<SkinMap>, usize)> = None;
    let mut unit = None;
    for pass in 0..ColumnOrder::PASSES {
        for number in 0..recordings {
            let mut reader = open(number)?;
            // Of the columns, before they are told from a frame by the taxels that stand for them.
            reader.settle_first_line(map.patches.iter().flat_map(|patch| patch.taxels.ids.iter().copied()));
            reader.ids = None;
            let (order, columns, first) = match &mut found {
                Some(found) => found,
                None => {
                    let order = ColumnOrder::new(reader.width, threshold).map_err(fail)?;
                    found.insert((order, Arc::new(columns(reader.width)), reader.width))
                }
            };
            if reader.width != *first {
                let (found, first) = (reader.width, *first);
                return Err(fail(OrderError::Columns { number: number + 1, found, first }));
            }
            let zero = if pass == 0 { Zero::AS_READ } else { options.condition.zero };
            let condition = ConditionOptions { zero, ..options.condition.clone() };
            let options = RecordingOptions { condition, ..options.clone() };
            let recording = Recording::open(columns, reader, &options).map_err(Error::from);
            recording
                .and_then(|recording| see(order, recording, (&mut unit, number)))
                .map_err(|e| e.in_recording(number, recordings))?;
        }
        found.iter_mut().for_each(|(order, ..)| order.end_pass());
    }
    let (order, ..) = found.ok_or_else(|| Error::from(SignalError::NoFrames))?;
    order.solve(map, known, run).map_err(fail)
}

/// Where the signals of recordings put the taxels of each patch of a map: the nearer, the more alike they are.
///
/// `open` opens a recording, by its number, with a zero; each of the `recordings` is opened [`ColumnOrder::PASSES`]
/// times. The [channel](Recording::channel) without a name counts. Touches follow `zero`.
///
/// # Errors
/// Those of `open` and of reading; [`OrderError`] if nothing is touched, or the map has too many taxels.
pub fn map_signals<E: From<Error>>(
    map: &SkinMap,
    zero: Zero,
    recordings: usize,
    mut open: impl FnMut(usize, Zero) -> Result<Recording, E>,
) -> Result<IdVec<PatchId, Option<SignalMap>>, E> {
    let fail = |error: OrderError| E::from(Error::from(error));
    let taxels = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let mut order = ColumnOrder::new(taxels, None).map_err(fail)?;
    let mut unit = None;
    for pass in 0..ColumnOrder::PASSES {
        for number in 0..recordings {
            let recording = open(number, if pass == 0 { Zero::AS_READ } else { zero })?;
            see(&mut order, recording, (&mut unit, number))
                .map_err(|e| e.in_recording(number, recordings))?;
        }
        order.end_pass();
    }
    order.signal_maps(map).map_err(fail)
}

/// Sees all frames of a recording.
fn see(
    order: &mut ColumnOrder,
    mut recording: Recording,
    (unit, number): (&mut Option<String>, usize),
) -> Result<(), Error> {
    let channel = recording.touch_channel()?;
    same_unit(unit, number, &recording.channels()[channel])?;
    order.begin_recording(channel);
    recording.each_frame(|frame| match frame {
        Some(frame) => order.see(frame),
        None => {
            order.end_recording();
            order.begin_recording(channel);
        }
    })?;
    order.end_recording();
    Ok(())
}

/// A map whose taxels are the columns, none a neighbour of another.
fn columns(count: usize) -> SkinMap {
    let positions: IdVec<VertexId, _> = IdVec::filled(glam::DVec3::ZERO, count);
    let mesh = TriMesh { positions, ..TriMesh::default() };
    SkinMap::of_taxels(&Skin::from_mesh("columns", mesh))
}
