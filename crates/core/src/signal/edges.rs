//! Edges: the gradient of values on the map of each level.
//!
//! The gradient at a vertex is the mean of the gradients of those faces around it whose corners all have a
//! value, weighted by their areas on the map. An extensive channel is used as an amount per area that has
//! readings, as in `contrast`.
//!
//! The value of a receptive field belongs to the mean position of its taxels with readings, which is not its
//! centre at the rim of a map or next to dead taxels; so faces are spanned between these positions. Then
//! gradients of linear functions are exact. A field that a seam cuts keeps its centre.

use glam::DVec2;

use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, SkinMap};
use crate::mesh::signed_area;
use crate::numeric::storable;
use crate::pyramid::{LevelId, Prolongation};
use crate::signal::{Channel, LevelFrame, Quantity};
use crate::skin::PatchId;

/// The edges of frames: the gradient of their values on the map of every level.
///
/// It owns its buffers; after construction it allocates nothing.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     pyramid::LevelId,
///     signal::{Channel, Edges, Frame, Restrictor},
///     skin::PatchId,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let skin = PatchId::new(0);
/// let channels = [Channel::default()];
/// let mut frame = Frame::new(&map, 1);
/// frame.values[skin][0] = map.patches[skin].levels[LevelId::new(0)].opened_uv().map(|at| 5.0 * at.x);
/// let mut edges = Edges::new(&map, &channels);
/// let steep = edges.of(Restrictor::new(&map, &channels).restrict(&frame));
/// let [u, v] = [0, 1].map(|k| &steep.values[skin][k][LevelId::new(0)]);
/// assert!(u.iter().all(|x| (x - 5.0).abs() < 1e-9), "it grows by 5 per metre along u");
/// assert!(v.iter().all(|x| x.abs() < 1e-9));
/// ```
#[derive(Debug, Clone)]
pub struct Edges {
    quantities: Vec<Quantity>,
    levels: IdVec<PatchId, IdVec<LevelId, FlatLevel>>,
    /// For each channel the positions of its fields, as offsets from their centres, and the areas of the
    /// taxels with readings for which they are valid.
    places: IdVec<PatchId, Vec<Places>>,
    /// For each vertex of a level: sums of area times gradient, and of areas, both doubled.
    sums: Vec<(DVec2, f64)>,
    out: LevelFrame,
}

#[derive(Debug, Clone)]
struct FlatLevel {
    faces: Vec<FlatFace>,
    to_finest: Option<Prolongation>,
    /// Positions of the vertices, and which of them are fields that no seam cuts.
    uv: Vec<DVec2>,
    is_whole: Vec<bool>,
}

#[derive(Debug, Clone)]
struct FlatFace {
    corners: [VertexId; 3],
    uv: [DVec2; 3],
    /// The map is turned across a seam: a vertex there uses only the faces at its first place.
    counts: [bool; 3],
}

#[derive(Debug, Clone)]
struct Places {
    served: IdVec<VertexId, f64>,
    offsets: IdVec<LevelId, Vec<DVec2>>,
}

impl Edges {
    /// Prepares for frames of these channels.
    pub fn new(map: &SkinMap, channels: &[Channel]) -> Self {
        let levels = map.patches.map(|patch| patch.levels.map(FlatLevel::new));
        let places = map.patches.map(|patch| {
            let offsets = patch.levels.map(|level| vec![DVec2::ZERO; level.level.mesh.positions.len()]);
            let served = IdVec::filled(f64::NAN, patch.taxels.ids.len());
            vec![Places { served, offsets }; channels.len()]
        });
        let vertices = levels.iter().flatten().map(|level| level.is_whole.len());
        Self {
            quantities: channels.iter().map(|channel| channel.quantity).collect(),
            sums: vec![(DVec2::ZERO, 0.0); vertices.max().unwrap_or(0)],
            levels,
            places,
            out: LevelFrame::new(map, 2 * channels.len()),
        }
    }

    /// The gradient of a frame on the map of every level, in two channels for each, along u and along
    /// v: in the unit of the channel per m, for extensive channels per m^3. NaN where no face around a
    /// vertex has a value at all of its corners.
    ///
    /// # Panics
    /// If the frame does not have the patches, channels and levels that this was made for.
    pub fn of(&mut self, frame: &LevelFrame) -> &LevelFrame {
        frame.check(self.levels.len(), self.quantities.len());
        self.out.time = frame.time;
        for (out, read) in self.out.unmeasured.iter_mut().zip(&frame.unmeasured) {
            for (out, read) in out.chunks_exact_mut(2).zip(read).filter(|(out, read)| out[0] != **read) {
                out.fill(read.clone());
            }
        }
        for (id, levels) in self.levels.enumerate() {
            for (channel, &quantity) in self.quantities.iter().enumerate() {
                let (values, areas) = (&frame.values[id][channel], &frame.areas[id][channel]);
                let places = &mut self.places[id][channel];
                places.update(levels, areas);
                let [u, v] = &mut self.out.values[id][2 * channel..][..2] else { continue };
                for (k, level) in levels.enumerate() {
                    let offsets = &places.offsets[k];
                    let density = |v| values[k][v] / quantity.extent(areas[k][v]);
                    level.gradients(density, offsets, &mut self.sums);
                    for ((u, v), &(rise, area)) in u[k].iter_mut().zip(v[k].iter_mut()).zip(&self.sums) {
                        [*u, *v] =
                            (if area > 0.0 { rise / area } else { DVec2::NAN }).to_array().map(storable);
                    }
                }
            }
        }
        &self.out
    }
}

impl FlatLevel {
    fn new(level: &MapLevel) -> Self {
        let mesh = &level.level.mesh;
        let faces = mesh.triangles.enumerate().map(|(face, &corners)| {
            let places = level.places(face);
            let counts = [0, 1, 2].map(|k| places[k] == PlaceId::first_of(corners[k]));
            FlatFace { corners, uv: level.uv_of(face), counts }
        });
        let vertices = mesh.positions.len();
        let to_finest = level.level.to_finest.clone();
        // Fields that have a taxel in a face at the seam.
        let mut is_on_seam = IdVec::<VertexId, bool>::filled(false, vertices);
        let places = level.unsplit().into_iter().flat_map(|unsplit| unsplit.enumerate());
        places.filter(|(place, v)| *place != PlaceId::first_of(**v)).for_each(|(_, &v)| is_on_seam[v] = true);
        let mut is_whole = vec![true; vertices];
        for row in to_finest.iter().flat_map(|rows| &rows.indices) {
            if row.iter().any(|&v| is_on_seam[v]) {
                row.iter().for_each(|v| is_whole[v.index()] = false);
            }
        }
        Self {
            faces: faces.collect(),
            to_finest,
            uv: level.uv.iter().take(vertices).copied().collect(),
            is_whole,
        }
    }

    /// Sums of area times gradient on the map plane, and of areas, at each vertex: of the faces whose corners
    /// all have a value.
    fn gradients(&self, value: impl Fn(VertexId) -> f64, offsets: &[DVec2], sums: &mut [(DVec2, f64)]) {
        sums[..self.is_whole.len()].fill((DVec2::ZERO, 0.0));
        for FlatFace { corners, uv, counts } in &self.faces {
            let [f, g, h] = corners.map(&value);
            if !(f.is_finite() && g.is_finite() && h.is_finite()) {
                continue;
            }
            let [a, b, c] = [0, 1, 2].map(|k| uv[k] + offsets[corners[k].index()]);
            let area = 2.0 * signed_area([a, b, c]);
            if area <= 0.0 {
                continue;
            }
            // `2 A grad` of a linear field: each rise times the normal of the edge across.
            let rise = (g - f) * (c - a).perp() - (h - f) * (b - a).perp();
            for (v, _) in corners.iter().zip(counts).filter(|(_, counts)| **counts) {
                sums[v.index()].0 -= rise;
                sums[v.index()].1 += area;
            }
        }
    }
}

impl Places {
    /// Computes the positions of fields whose taxels have these areas with readings; does nothing if the
    /// areas are unchanged.
    fn update(&mut self, levels: &IdVec<LevelId, FlatLevel>, areas: &IdVec<LevelId, IdVec<VertexId, f64>>) {
        let served = &areas[LevelId::new(0)];
        if self.served == *served {
            return;
        }
        self.served.as_mut_slice().copy_from_slice(served.as_slice());
        for ((k, level), offsets) in levels.enumerate().zip(self.offsets.iter_mut()) {
            let Some(rows) = &level.to_finest else { continue };
            offsets.fill(DVec2::ZERO);
            for (taxel, &area) in served.enumerate().filter(|(_, area)| **area > 0.0) {
                let place: DVec2 = rows.row(taxel).map(|(v, w)| w * level.uv[v.index()]).sum();
                for (v, w) in rows.row(taxel) {
                    offsets[v.index()] += w * area * (place - level.uv[v.index()]);
                }
            }
            let fields = offsets.iter_mut().zip(&areas[k]).zip(&level.is_whole);
            for ((offset, &area), &is_whole) in fields {
                *offset = if is_whole && area > 0.0 { *offset / area } else { DVec2::ZERO };
            }
        }
    }
}
