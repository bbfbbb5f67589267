//! The blocks of a Hessian to which each face contributes.

use std::ops::Range;

use glam::DVec2;
use rayon::prelude::*;

use crate::flatten::energy::elements::{Element, ElementMesh};
use crate::flatten::energy::face_energy::LocalModel;
use crate::id::{FaceId, IdVec, VertexId};
use crate::sparse::{Block, Matrix};

/// Rows that one task sums. A face between two groups of rows is computed for both: one face in fourteen
/// along a space-filling curve.
const ROWS: usize = 2048;

/// Slot of an entry whose row another task sums, or whose row or column is fixed or held and so has no
/// unknown.
const NONE: u32 = u32::MAX;

/// A face, and the slots of its blocks among the entries of a task.
struct FaceSlots {
    face: FaceId,
    /// For the row of each corner: the slots of the corner itself, of the next and of the previous one.
    slots: [[u32; 3]; 3],
}

impl FaceSlots {
    /// The slots of a face in the task of these rows.
    fn new(net: &ElementMesh, rows: &Range<usize>, face: FaceId) -> Self {
        let corners = net.faces[face].corners.map(VertexId::index);
        let first = net.pattern().slots(rows.start).start;
        let slot = |row, column| {
            let slot = net.pattern().slot(row, column).filter(|_| !net.is_held(column));
            slot.and_then(|slot| u32::try_from(slot - first).ok()).unwrap_or(NONE)
        };
        let slots = [0, 1, 2].map(|k| {
            let row = corners[k];
            let around = [row, corners[(k + 1) % 3], corners[(k + 2) % 3]];
            let is_summed = rows.contains(&row) && !net.is_held(row);
            if is_summed { around.map(|column| slot(row, column)) } else { [NONE; 3] }
        });
        Self { face, slots }
    }
}

/// The faces around the rows of each task, so that tasks run in parallel and each sums in a fixed order.
pub(crate) struct Assembly(Vec<Vec<FaceSlots>>);

impl Assembly {
    pub(crate) fn new(net: &ElementMesh) -> Self {
        let free = net.free();
        let mut faces = vec![Vec::new(); free.div_ceil(ROWS)];
        for (face, e) in net.faces.enumerate() {
            let [a, b, c] = e.corners.map(|v| v.index() / ROWS);
            for part in [Some(a), Some(b).filter(|b| *b != a), Some(c).filter(|c| *c != a && *c != b)] {
                if let Some(faces) = part.and_then(|part| faces.get_mut(part)) {
                    faces.push(face);
                }
            }
        }
        let of_part = |(part, faces): (usize, Vec<FaceId>)| {
            let rows = part * ROWS..((part + 1) * ROWS).min(free);
            faces.into_iter().map(|face| FaceSlots::new(net, &rows, face)).collect()
        };
        Self(faces.into_par_iter().enumerate().map(of_part).collect())
    }

    /// Sums the Hessians of the models of all faces, and returns minus the sum of their gradients.
    pub(crate) fn sum<B: Block>(
        &self,
        faces: &IdVec<FaceId, Element>,
        model: impl Fn(&Element) -> LocalModel + Sync,
        hessian: &mut Matrix<'_, B>,
    ) -> Vec<DVec2> {
        let mut downhill = vec![DVec2::ZERO; hessian.pattern().rows()];
        let sums = hessian.parts_mut(ROWS).into_par_iter().zip(downhill.par_chunks_mut(ROWS));
        self.0.par_iter().zip(sums).enumerate().for_each(|(part, (of_part, (blocks, downhill)))| {
            blocks.fill(B::ZERO);
            for &FaceSlots { face, slots } in of_part {
                let e = &faces[face];
                let m = model(e);
                for (k, slots) in slots.into_iter().enumerate().filter(|(_, slots)| slots[0] != NONE) {
                    downhill[e.corners[k].index() - part * ROWS] -= m.gradient[k];
                    let of_corner =
                        [m.diagonal[k], m.off_diagonal[k], m.off_diagonal[(k + 2) % 3].transpose()];
                    for (slot, block) in slots.into_iter().zip(of_corner).filter(|(slot, _)| *slot != NONE) {
                        blocks[slot as usize] += B::of(block);
                    }
                }
            }
        });
        downhill
    }
}
