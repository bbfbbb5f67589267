//! Rows of weights, as numbers of two accessors.

use crate::id::VertexId;
use crate::io::error::Result;
use crate::io::gltf::RowsExtras;
use crate::io::gltf::document::Document;
use crate::io::gltf::writer::SceneWriter;
use crate::numeric::narrow;
use crate::pyramid::Prolongation;

pub(super) fn add_rows(writer: &mut SceneWriter<'_>, rows: &Prolongation) -> RowsExtras {
    let indices = writer.array(None, rows.indices.iter().map(|row| row.map(VertexId::raw)));
    let weights = writer.array(None, rows.weights.iter().map(|row| row.map(narrow)));
    RowsExtras { indices: indices.value(), weights: weights.value() }
}

pub(super) fn read_rows(
    document: &Document,
    name: &str,
    given: RowsExtras,
    coarse_len: usize,
) -> Result<Prolongation> {
    let accessor = |number: usize| document.accessor(number, name);
    let indices = accessor(given.indices)?.integers::<3>()?;
    let weights = accessor(given.weights)?.reals(|row: [f64; 3]| row)?;
    let mut rows = Prolongation {
        indices: indices.into_iter().map(|row| row.map(VertexId::from)).collect(),
        weights: weights.into(),
        coarse_len,
    };
    rows.rescale();
    Ok(rows)
}
