//! The fields of a level of a whole map, and readings carried to them and to regions.

use std::slice;

use dermatome::{
    SkinMap,
    body::{Body, FieldLevel},
    contact::FieldCells,
    id::VertexId,
    map::{PatchMap, RegionId},
    pyramid::LevelId,
    recording::{Batch, Carried},
    signal::{BodyFields, Channel, Duplicates, Frame, GroupPool, Join, Quantity, SignalError},
    skin::PatchId,
};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::{
    arrays::{bad_shape, floats, vector, zeros},
    errors::{bad, error},
    jobs::run_here,
    matrix::{PyMatrix, Rows},
    options::level,
};

/// Patch, level and index of each field.
pub(crate) type FieldArrays<'py> =
    (Bound<'py, PyArray1<i32>>, Bound<'py, PyArray1<i32>>, Bound<'py, PyArray1<i64>>);

/// The number of vertices of a level of a patch, or of its coarsest.
fn size_of(patch: &PatchMap, level: LevelId) -> usize {
    patch.levels[patch.nearest_level(level)].level.mesh.positions.len()
}

/// Where the vertices of each patch begin among those of a level of the whole map, and the end of the last.
pub(crate) fn starts(map: &SkinMap, level: LevelId) -> Vec<usize> {
    let mut starts = vec![0];
    let mut end = 0;
    for patch in &map.patches {
        end += size_of(patch, level);
        starts.push(end);
    }
    starts
}

/// The fields of a level of the whole map: the patch, the level and the vertex of each.
pub(crate) fn fields_of<'py>(py: Python<'py>, map: &SkinMap, level: LevelId) -> FieldArrays<'py> {
    let of_patch = |(id, patch): (PatchId, &PatchMap)| {
        let on = patch.nearest_level(level).raw();
        (0..size_of(patch, level)).map(move |index| (id.raw(), on, index))
    };
    let all: Vec<(u32, u32, usize)> = map.patches.enumerate().flat_map(of_patch).collect();
    (
        vector(py, all.iter().map(|field| field.0 as i32)),
        vector(py, all.iter().map(|field| field.1 as i32)),
        vector(py, all.iter().map(|field| field.2 as i64)),
    )
}

/// How the taxels of the whole map, or of one patch, depend on the fields of a level.
pub(crate) fn pooling_of(py: Python<'_>, map: &SkinMap, level: LevelId, only: Option<PatchId>) -> PyMatrix {
    let (mut rows, mut first) = (Rows::new(), 0);
    for (_, patch) in map.patches.enumerate().filter(|(id, _)| only.is_none_or(|only| only == *id)) {
        let direct = &patch.levels[patch.nearest_level(level)].level.to_finest;
        for taxel in patch.taxels.ids.ids() {
            match direct {
                Some(direct) => rows.push(direct.row(taxel).map(|(field, w)| (first + field.index(), w))),
                None => rows.push([(first + taxel.index(), 1.0)]),
            }
        }
        first += size_of(patch, level);
    }
    rows.into_matrix(py, first)
}

/// Readings of the taxels of a map, and the shape of an array with `count` numbers for each of their frames.
fn frames_of<'py>(
    map: &SkinMap,
    values: &Bound<'py, PyAny>,
    count: usize,
) -> PyResult<(PyReadonlyArrayDyn<'py, f64>, Vec<usize>)> {
    let values = floats("values", values)?;
    let needed: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let Some((_, frames)) = values.shape().split_last().filter(|(last, _)| **last == needed) else {
        return Err(bad_shape("values", values.shape(), format!("shape (..., {needed})")));
    };
    let shape = frames.iter().copied().chain([count]).collect();
    Ok((values, shape))
}

/// Carries readings of the taxels of a map to groups of them.
pub(crate) fn pool_groups<'py>(
    py: Python<'py>,
    map: &SkinMap,
    values: &Bound<'py, PyAny>,
    groups: &GroupPool,
    quantity: Quantity,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let (values, shape) = frames_of(map, values, groups.count())?;
    let taxels = values.shape().last().copied().unwrap_or(0);
    let (pooled, values) = (zeros(py, &shape)?, values.as_slice()?);
    let mut writer = pooled.readwrite();
    let frames = writer.as_slice_mut()?.chunks_mut(groups.count().max(1)).zip(values.chunks(taxels.max(1)));
    run_here(py, 1, |stop| {
        for (out, values) in frames {
            stop.check();
            let sums = groups.pool(values, quantity);
            out.iter_mut().zip(sums).for_each(|(out, value)| *out = narrow(value));
        }
    })?;
    Ok(pooled)
}

/// The level of the whole body of this name.
fn body_level(map: &SkinMap, name: &str) -> PyResult<LevelId> {
    let count = map.body.levels.len();
    Body::number_of(name).filter(|level| level.index() < count).ok_or_else(|| {
        let needed = match count {
            0 => "a number: a map of one patch, or an older one, has no levels of the whole body".to_owned(),
            count => format!("a number, or \"body.L0\" to \"body.L{}\"", count - 1),
        };
        bad("level", format!("{name:?}"), needed)
    })
}

/// The level of this name without a mesh, of the whole body or of a modality.
pub(crate) fn field_level(map: &SkinMap, name: &str) -> PyResult<FieldLevel> {
    let mut known: Vec<(FieldLevel, String)> = map.field_levels().collect();
    if let Some(found) = known.iter().find(|(_, known)| known == name) {
        return Ok(found.0);
    }
    if !known.iter().any(|(at, _)| at.modality.is_some()) {
        return body_level(map, name).map(|level| FieldLevel { modality: None, level });
    }
    known.truncate(10);
    let names: Vec<String> = known.iter().map(|(_, name)| format!("{name:?}")).collect();
    Err(bad(
        "level",
        format!("{name:?}"),
        format!("a number, or one of Map.field_levels: {}", names.join(", ")),
    ))
}

/// A level of a map: of patches, or one without a mesh.
#[derive(Debug, Clone, Copy)]
pub(crate) enum MapLevel {
    Patches(LevelId),
    Fields(FieldLevel),
}

/// A level by its number or its name.
#[derive(Debug, FromPyObject)]
pub(crate) enum LevelArg {
    Number(i64),
    Name(String),
}

impl LevelArg {
    /// The finest level of the patches.
    pub(crate) const FINEST: Self = Self::Number(0);

    /// The level of a map.
    pub(crate) fn of(&self, map: &SkinMap) -> PyResult<MapLevel> {
        let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0);
        match self {
            Self::Number(number) => level("level", *number, levels).map(MapLevel::Patches),
            Self::Name(name) => field_level(map, name).map(MapLevel::Fields),
        }
    }
}

/// A level without a mesh, ready for contacts.
#[derive(Debug)]
pub(crate) struct NamedLevel {
    pub(crate) cells: FieldCells,
    /// The number of the region of each field, -1 for none.
    pub(crate) regions: Vec<i32>,
}

impl NamedLevel {
    pub(crate) fn new(map: &SkinMap, at: FieldLevel) -> Self {
        let regions = map.regions().of_fields(&map.field_rows(at));
        let number = |region: &Option<_>| region.map_or(-1, |region: RegionId| region.raw() as i32);
        let regions = regions.iter().map(number).collect();
        Self { cells: FieldCells::new(map, at, map.patches.ids()), regions }
    }
}

/// How the taxels of the whole map, or of one patch, depend on the fields of a level of the whole body.
pub(crate) fn pooling_of_fields(
    py: Python<'_>,
    map: &SkinMap,
    at: FieldLevel,
    only: Option<PatchId>,
) -> PyResult<PyMatrix> {
    if at.modality.is_some() {
        return Err(bad(
            "level",
            "a level of a modality",
            "a number, or a level of the whole body, as \"body.L0\"",
        ));
    }
    let (of_patches, mut rows) = (map.field_rows(at), Rows::new());
    let count = map.fields_of(at).map_or(0, |fields| fields.origins.len());
    for (_, of_patch) in of_patches.enumerate().filter(|(id, _)| only.is_none_or(|only| only == *id)) {
        for taxel in of_patch.iter().flat_map(|of_patch| of_patch.indices.ids().map(move |v| (of_patch, v))) {
            rows.push(taxel.0.row(taxel.1).map(|(field, weight)| (field.index(), weight)));
        }
    }
    Ok(rows.into_matrix(py, count))
}

/// Frames that one thread takes at least: it copies the weights of all levels for them, which are as many numbers as a few frames.
const LEAST_FRAMES: usize = 64;

/// Carries readings of the taxels of a map to the fields of a level of the whole body or of a modality, whose sensors they are
/// of then.
pub(crate) fn pool_fields<'py>(
    py: Python<'py>,
    map: &SkinMap,
    values: &Bound<'py, PyAny>,
    FieldLevel { modality, level }: FieldLevel,
    channel: &Channel,
    threads: usize,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let modality = modality.and_then(|number| map.body.modalities.get(number));
    let fields = match modality {
        Some(modality) => BodyFields::of_modality(map, modality),
        None => BodyFields::new(map),
    };
    let count = fields.sizes()[level];
    let (values, shape) = frames_of(map, values, count)?;
    let taxels = values.shape().last().copied().unwrap_or(0);
    let (pooled, values) = (zeros(py, &shape)?, values.as_slice()?);
    let quantity = channel.quantity;
    let mut join = Join::new(map, None, taxels, Duplicates::Refuse).map_err(error)?;
    let of_level = modality.map(|modality| Channel::new(&modality.name, "")).transpose().map_err(error)?;
    join.follow(map, &[of_level.unwrap_or_else(|| channel.clone())]);
    let mut writer = pooled.readwrite();
    let frames = writer.as_slice_mut()?.par_chunks_mut(count.max(1)).zip(values.par_chunks(taxels.max(1)));
    run_here(py, threads, |stop| {
        frames.with_min_len(LEAST_FRAMES).for_each_init(
            || (fields.clone(), Frame::new(map, 1)),
            |(fields, frame), (out, values)| {
                stop.check();
                join.fill(values, frame);
                fields.take(frame, 0, quantity);
                for (field, out) in out.iter_mut().enumerate() {
                    *out = narrow(fields.value(level, VertexId::new(field), quantity));
                }
            },
        );
    })?;
    Ok(pooled)
}

/// How frames are carried to the fields of a level.
pub(crate) struct Pooling<'a> {
    pub(crate) map: &'a SkinMap,
    pub(crate) level: LevelId,
    pub(crate) channel: Channel,
    pub(crate) contrast: bool,
}

impl Pooling<'_> {
    /// Carries readings of the taxels to the fields; with 0 threads one per processor.
    pub(crate) fn pool<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let fields = starts(self.map, self.level).last().copied().unwrap_or(0);
        let (values, shape) = frames_of(self.map, values, fields)?;
        let (pooled, values) = (zeros(py, &shape)?, values.as_slice()?);
        let mut writer = pooled.readwrite();
        let out = writer.as_slice_mut()?;
        let Self { map, level, ref channel, contrast } = *self;
        let carried = if contrast { Carried::Contrast } else { Carried::Values };
        let only = (!contrast).then_some(level);
        run_here(py, threads, |stop| -> Result<(), SignalError> {
            let batch = Batch::new(map, slice::from_ref(channel), carried, only)?;
            batch.pool(map, level, values, out, || stop.check());
            Ok(())
        })?
        .map_err(error)?;
        Ok(pooled)
    }
}

/// A number of a result, in 32 bits.
#[expect(clippy::cast_possible_truncation, reason = "readings are given in fewer digits")]
fn narrow(value: f64) -> f32 {
    value as f32
}
