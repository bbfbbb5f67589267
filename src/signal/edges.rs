//! Edges: how steeply values change on the map of each level, and in which direction.
//!
//! The gradient at a vertex is the mean of the gradients of the faces around it all of whose corners
//! have a value, weighted by their areas on the map: exact for fields that are linear on the map,
//! whatever taxels are dead. An extensive channel is taken as an amount per area that has readings,
//! as in `contrast`.

use glam::DVec2;

use crate::{
    id::{IdVec, VertexId},
    map::{MapLevel, SkinMap},
    mesh::signed_area,
    pyramid::LevelId,
    signal::{Channel, LevelFrame, Quantity, contrast::LiveAreas},
};

/// The edges of frames: how steeply they change on the map of every level.
///
/// It owns its buffers and allocates nothing after it was made.
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
/// frame.values[skin][0] = map.patches[skin].levels[LevelId::new(0)].uv.map(|at| 5.0 * at.x);
/// let mut edges = Edges::new(&map, &channels);
/// let steep = edges.of(Restrictor::new(&map, &channels).restrict(&frame));
/// let [size, direction] = [0, 1].map(|k| &steep.values[skin][k][LevelId::new(0)]);
/// assert!(size.iter().all(|x| (x - 5.0).abs() < 1e-9), "it grows by 5 per metre");
/// assert!(direction.iter().all(|x| x.abs() < 1e-9), "along u");
/// ```
#[derive(Debug, Clone)]
pub struct Edges<'a> {
    map: &'a SkinMap,
    quantities: Vec<Quantity>,
    areas: LiveAreas,
    /// Of each vertex of a level: sums of area times gradient, and of areas, both doubled.
    sums: IdVec<VertexId, (DVec2, f64)>,
    out: LevelFrame,
}

impl<'a> Edges<'a> {
    /// Prepares for frames of these channels.
    #[must_use]
    pub fn new(map: &'a SkinMap, channels: &[Channel]) -> Self {
        let vertices =
            map.patches.iter().flat_map(|patch| &patch.levels).map(|level| level.level.mesh.positions.len());
        Self {
            map,
            quantities: channels.iter().map(|channel| channel.quantity).collect(),
            areas: LiveAreas::new(map),
            sums: IdVec::filled((DVec2::ZERO, 0.0), vertices.max().unwrap_or(0)),
            out: LevelFrame::new(map, 2 * channels.len()),
        }
    }

    /// The gradient of a frame on the map of every level, in two channels for each: its size in the
    /// unit of the channel per m, for extensive channels per m^3, and its direction on the map in rad,
    /// 0 where it has none; draw it as [`Quantity::Direction`]. NaN where no face around a vertex has a value at all of its corners.
    ///
    /// # Panics
    /// If the frame has not the patches, channels and levels that this was made for.
    pub fn of(&mut self, frame: &LevelFrame) -> &LevelFrame {
        frame.check(self.map, self.quantities.len());
        self.out.time = frame.time;
        for (id, patch) in self.map.patches.enumerate() {
            let channels = self.quantities.iter().zip(&frame.values[id]);
            for ((&quantity, values), pair) in channels.zip(self.out.values[id].chunks_exact_mut(2)) {
                let areas = self.areas.update(id, &patch.levels, quantity, &values[LevelId::new(0)]);
                for (k, level) in patch.levels.enumerate() {
                    match quantity {
                        Quantity::Intensive | Quantity::Direction => {
                            gradients(level, |v| values[k][v], &mut self.sums)
                        }
                        Quantity::Extensive => {
                            gradients(level, |v| values[k][v] / areas[k][v], &mut self.sums);
                        }
                    }
                    let [size, direction] = pair else { continue };
                    let out = size[k].iter_mut().zip(direction[k].iter_mut());
                    for ((size, direction), &(rise, area)) in out.zip(&self.sums) {
                        let gradient = if area > 0.0 { rise / area } else { DVec2::NAN };
                        (*size, *direction) = (gradient.length(), gradient.y.atan2(gradient.x));
                    }
                }
            }
        }
        &self.out
    }
}

/// Sums of area times gradient on the map plane, and of areas, at each vertex: of the faces all of
/// whose corners have a value.
fn gradients(level: &MapLevel, value: impl Fn(VertexId) -> f64, sums: &mut IdVec<VertexId, (DVec2, f64)>) {
    let mesh = &level.level.mesh;
    sums.iter_mut().take(mesh.positions.len()).for_each(|sum| *sum = (DVec2::ZERO, 0.0));
    for (face, &corners) in mesh.triangles.enumerate() {
        let [f, g, h] = corners.map(&value);
        if !(f.is_finite() && g.is_finite() && h.is_finite()) {
            continue;
        }
        let [a, b, c] = level.uv_of(face);
        // `2 A grad` of a linear field: each rise times the normal of the edge across.
        let rise = (g - f) * (c - a).perp() - (h - f) * (b - a).perp();
        let area = 2.0 * signed_area([a, b, c]);
        // Across a seam the map is turned: vertices there count the faces at their first place.
        for (v, _) in corners.into_iter().zip(level.corners()[face]).filter(|(v, place)| v == place) {
            sums[v].0 -= rise;
            sums[v].1 += area;
        }
    }
}
