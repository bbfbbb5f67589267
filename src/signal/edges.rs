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
    signal::{Channel, LevelFrame, Quantity, contrast::live_areas},
};

/// The gradient of a frame on the map of every level, in two channels for each: its size in the
/// unit of the channel per m, for extensive channels per m^3, and its direction on the map in rad.
/// NaN where no face around a vertex has a value at all of its corners.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     pyramid::LevelId,
///     signal::{Channel, Frame, Restrictor, edges},
///     skin::PatchId,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let skin = PatchId::new(0);
/// let channels = [Channel::default()];
/// let mut frame = Frame::new(&map, 1);
/// frame.values[skin][0] = map.patches[skin].levels[LevelId::new(0)].uv.map(|at| 5.0 * at.x);
/// let steep = edges(&map, &channels, Restrictor::new(&map, &channels).restrict(&frame));
/// let [size, direction] = [0, 1].map(|k| &steep.values[skin][k][LevelId::new(0)]);
/// assert!(size.iter().all(|x| (x - 5.0).abs() < 1e-9), "it grows by 5 per metre");
/// assert!(direction.iter().all(|x| x.abs() < 1e-9), "along u");
/// ```
///
/// # Panics
/// If the frame has not the patches, channels and levels of `map` and `channels`.
#[must_use]
pub fn edges(map: &SkinMap, channels: &[Channel], frame: &LevelFrame) -> LevelFrame {
    let mut out = LevelFrame::new(map, 2 * channels.len());
    out.time = frame.time;
    assert_eq!(frame.values.len(), map.patches.len(), "one entry per patch");
    for (id, patch) in map.patches.enumerate() {
        assert_eq!(frame.values[id].len(), channels.len(), "one array per channel of {}", patch.name);
        let pairs = out.values[id].chunks_exact_mut(2);
        for ((channel, values), pair) in channels.iter().zip(&frame.values[id]).zip(pairs) {
            let areas = match channel.quantity {
                Quantity::Intensive => None,
                Quantity::Extensive => Some(live_areas(&patch.levels, &values[LevelId::new(0)])),
            };
            for (k, level) in patch.levels.enumerate() {
                let gradients = match &areas {
                    None => gradients(level, &values[k]),
                    Some(areas) => {
                        gradients(level, &values[k].iter().zip(&areas[k]).map(|(x, a)| x / a).collect())
                    }
                };
                for (v, g) in gradients.enumerate() {
                    (pair[0][k][v], pair[1][k][v]) = (g.length(), g.y.atan2(g.x));
                }
            }
        }
    }
    out
}

/// The gradient at each vertex on the map plane; NaN where there is none.
fn gradients(level: &MapLevel, values: &IdVec<VertexId, f64>) -> IdVec<VertexId, DVec2> {
    // Sums of area times gradient, and of areas, both doubled.
    let mut sums = IdVec::<VertexId, (DVec2, f64)>::filled((DVec2::ZERO, 0.0), values.len());
    for &corners in &level.level.mesh.triangles {
        let [f, g, h] = corners.map(|v| values[v]);
        if !(f.is_finite() && g.is_finite() && h.is_finite()) {
            continue;
        }
        let [a, b, c] = corners.map(|v| level.uv[v]);
        // `2 A grad` of a linear field: each rise times the normal of the edge across.
        let rise = (g - f) * (c - a).perp() - (h - f) * (b - a).perp();
        let area = 2.0 * signed_area([a, b, c]);
        for v in corners {
            sums[v].0 -= rise;
            sums[v].1 += area;
        }
    }
    sums.map(|&(rise, area)| if area > 0.0 { rise / area } else { DVec2::NAN })
}
