//! What is fixed of one chart in an image: how values reach its pixels.

use crate::{
    id::{IdVec, VertexId},
    image::{Interpolation, weights::surface::Surface},
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
    pub(super) around: Lists,
    pub(super) gutter: Gutter,
    /// Area of a pixel, in m^2.
    pub(super) pixel_area: f64,
}

/// Pixels around the chart that repeat those of its faces.
#[derive(Debug, Clone, Default)]
pub(super) struct Gutter {
    /// Each pixel and the one it repeats, face by face.
    pairs: Vec<[u32; 2]>,
    /// Where those of each face begin; one more entry than faces.
    starts: Vec<u32>,
}

/// From the values of a level to the vertices of level 0.
#[derive(Debug, Clone)]
pub(super) struct Lift<'a> {
    pub(super) prolongation: &'a Prolongation,
    /// The vertex that each value belongs to.
    pub(super) origins: &'a IdVec<VertexId, VertexId>,
    /// The vertices that each value reaches.
    pub(super) reached: Lists,
}

/// One list of numbers for each of some things.
#[derive(Debug, Clone, Default)]
pub(super) struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// From pairs of thing and item.
    pub(super) fn new(count: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut starts = vec![0_u32; count + 1];
        pairs.clone().for_each(|(of, _)| starts[of as usize + 1] += 1);
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        let (mut next, mut items) = (starts.clone(), vec![0; starts.last().map_or(0, |&n| n as usize)]);
        for (of, item) in pairs {
            let slot = &mut next[of as usize];
            items[*slot as usize] = item;
            *slot += 1;
        }
        Self { starts, items }
    }

    #[inline]
    pub(super) fn of(&self, thing: usize) -> &[u32] {
        &self.items[self.starts[thing] as usize..self.starts[thing + 1] as usize]
    }
}

impl Gutter {
    /// From face, pixel and repeated pixel of each.
    pub(super) fn new(faces: usize, mut all: Vec<(u32, [u32; 2])>) -> Self {
        all.sort_unstable();
        let before = |face: usize| all.partition_point(|(of, _)| (*of as usize) < face);
        let starts = (0..=faces).map(|face| u32::try_from(before(face)).unwrap_or(u32::MAX)).collect();
        Self { pairs: all.into_iter().map(|(_, pair)| pair).collect(), starts }
    }

    /// Repeats all pixels.
    pub(super) fn fill(&self, pixels: &mut [f32]) {
        self.pairs.iter().for_each(|&[to, from]| pixels[to as usize] = pixels[from as usize]);
    }

    /// Repeats those of one face.
    #[inline]
    pub(super) fn fill_face(&self, face: u32, pixels: &mut [f32]) {
        let range = self.starts[face as usize] as usize..self.starts[face as usize + 1] as usize;
        self.pairs[range].iter().for_each(|&[to, from]| pixels[to as usize] = pixels[from as usize]);
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
        let corners = corners.flat_map(|(face, k)| face.corners.map(move |v| (v.raw(), k)));
        let around = Lists::new(vertices, corners);
        let values = lift.map_or(vertices, |(_, p)| p.coarse_len);
        let lift = lift.map(|(level, prolongation)| {
            let rows = prolongation.indices.ids();
            let rows: Vec<_> =
                rows.flat_map(|v| prolongation.row(v).map(move |(c, _)| (c.raw(), v.raw()))).collect();
            Lift { origins: &level.origins, prolongation, reached: Lists::new(values, rows.iter().copied()) }
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
