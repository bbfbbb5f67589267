//! What is fixed of one chart in an image: how values reach its pixels.

use crate::{
    id::{IdVec, VertexId},
    image::{Interpolation, weights::surface::Surface},
    numeric::Csr,
    pyramid::{Level, Prolongation},
};

/// One chart in an image, and the patch whose values it shows.
#[derive(Debug, Clone)]
pub(super) struct Tile<'a> {
    pub(super) interpolation: Interpolation,
    pub(super) surface: Surface<'a>,
    /// Number of values; from them to the vertices of the chart, where these are not the same.
    pub(super) values: usize,
    pub(super) lift: Option<Lift<'a>>,
    /// The faces around each vertex of the chart that cover pixels.
    pub(super) around: Csr<u32>,
    pub(super) gutter: Gutter,
    /// Area of a pixel, in m^2.
    pub(super) pixel_area: f64,
}

/// Pixels around the chart that repeat those of its faces.
#[derive(Debug, Clone, Default)]
pub(super) struct Gutter {
    /// Each pixel and the one it repeats, face by face.
    pairs: Csr<[u32; 2]>,
}

/// From the values of a level to the vertices of level 0.
#[derive(Debug, Clone)]
pub(super) struct Lift<'a> {
    pub(super) prolongation: &'a Prolongation,
    /// The vertex that each value belongs to.
    pub(super) origins: &'a IdVec<VertexId, VertexId>,
    /// The vertices that each value reaches.
    pub(super) reached: Csr<u32>,
}

impl Gutter {
    /// From face, pixel and repeated pixel of each.
    pub(super) fn new(faces: usize, mut all: Vec<(usize, [u32; 2])>) -> Self {
        all.sort_unstable();
        Self { pairs: Csr::from_pairs(faces, all.into_iter()) }
    }

    /// Repeats all pixels.
    pub(super) fn fill(&self, pixels: &mut [f32]) {
        self.pairs.items().iter().for_each(|&[to, from]| pixels[to as usize] = pixels[from as usize]);
    }

    /// Repeats those of one face.
    #[inline]
    pub(super) fn fill_face(&self, face: u32, pixels: &mut [f32]) {
        self.pairs[face as usize].iter().for_each(|&[to, from]| pixels[to as usize] = pixels[from as usize]);
    }
}

impl<'a> Tile<'a> {
    pub(super) fn new(
        surface: Surface<'a>,
        interpolation: Interpolation,
        lift: Option<(&'a Level, &'a Prolongation)>,
        pixel_area: f64,
    ) -> Self {
        let vertices = surface.level.level.mesh.positions.len();
        let corners = surface.faces.iter().zip(0_u32..);
        let corners = corners.filter(|(_, k)| !surface.runs.of_source(*k as usize).is_empty());
        let corners = corners.flat_map(|(face, k)| face.corners.map(move |v| (v.index(), k)));
        let around = Csr::from_pairs(vertices, corners);
        let values = lift.map_or(vertices, |(_, p)| p.coarse_len);
        let lift = lift.map(|(level, prolongation)| {
            let rows = prolongation.indices.ids();
            let rows: Vec<_> =
                rows.flat_map(|v| prolongation.row(v).map(move |(c, _)| (c.index(), v.raw()))).collect();
            Lift {
                origins: &level.origins,
                prolongation,
                reached: Csr::from_pairs(values, rows.iter().copied()),
            }
        });
        Self { interpolation, surface, values, lift, around, gutter: Gutter::default(), pixel_area }
    }

    /// Which vertices of the chart have a value.
    pub(super) fn live_vertices(&self, live: &[bool]) -> Vec<bool> {
        match &self.lift {
            None => live.to_vec(),
            Some(lift) => {
                let rows = lift.prolongation.indices.ids();
                rows.map(|v| lift.prolongation.row(v).any(|(c, _)| live[c.index()])).collect()
            }
        }
    }
}

impl Lift<'_> {
    /// The weights of the live values at a vertex of level 0, with sum 1 if there is one.
    pub(super) fn row(&self, vertex: usize, is_live: impl Fn(usize) -> bool) -> [(usize, f64); 3] {
        let v = VertexId::new(vertex);
        let (indices, weights) = (self.prolongation.indices[v], self.prolongation.weights[v]);
        let live = [0, 1, 2].map(|k| if is_live(indices[k].index()) { weights[k] } else { 0.0 });
        let sum = live[0] + live[1] + live[2];
        [0, 1, 2].map(|k| (indices[k].index(), live[k] / sum))
    }

    /// The value at a vertex of level 0; NaN without a live one.
    #[inline]
    pub(super) fn value(&self, vertex: usize, values: &[f64]) -> f64 {
        let row = self.row(vertex, |c| !values[c].is_nan());
        row.into_iter().map(|(c, w)| if w == 0.0 { 0.0 } else { w * values[c] }).sum()
    }
}
