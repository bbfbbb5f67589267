//! The surfaces between a patch in space and its map: the skin unfolds.
//!
//! [`Unfolding::new`] computes them from level 0 of a patch, for pictures and animations. A straight line
//! from each taxel in space to its place on the map would collapse a sleeve halfway. Triangles turn
//! instead (`(alexa2000)`, with the logarithms of `(sumner2005)`):
//!
//! 1. Each triangle `f` has a rotation `R_f` from the skin to the map, the polar factor of its
//!    Jacobian (`turns`). Its logarithm `w_f` has many branches; a walk over neighbouring triangles takes
//!    the one nearest to that of the neighbour, so that a sleeve turns through -180 to 180 degrees and does
//!    not tear. The pose of the map makes the mean of `w_f` zero.
//! 2. At time `t` the edge `e` of `f` is wanted as `exp(t w_f) ((1 - t) x_e + t R_f' u_e)`: at 0 that of the
//!    skin, at 1 that of the map. The triangles do not fit together then; a least-squares solution with
//!    cotangent weights joins them (`join_triangles`). Then each triangle is rotated to fit its joined edges
//!    best, and all are joined again, a few times `(sorkine2007)`. One factor serves all times.
//! 3. This is solved at three times between 0 and 1 on the finest level of at most 2000 vertices, at whose
//!    vertices the map is that of level 0. [`Unfolding::at`] interpolates between key frames by the
//!    polynomial through all five, and carries them to level 0: a place keeps its difference from the mean of
//!    its fields, which turns with them.
//!
//! A patch that is cut opens at its seam: places are moved, not taxels.
//!
//! Not guaranteed: that the surfaces at times between 0 and 1 do not cross themselves.

mod join_triangles;
mod turns;

use glam::{DAffine3, DQuat, DVec2, DVec3};

use crate::cut::PlaceId;
use crate::id::IdVec;
use crate::map::{CarriedRow, MapLevel, PatchMap, carried_places, carried_rows};
use crate::pyramid::LevelId;
use crate::sparse::SparseError;
use crate::unfold::join_triangles::Joiner;
use crate::unfold::turns::Turns;

/// Times of the solved surfaces between skin (0) and map (1).
const KEY_TIMES: [f64; 3] = [0.25, 0.5, 0.75];

/// Most vertices of the level that is solved, if there is such a level: 1000 take about 20 ms. Halfway, the
/// mean error of lengths on the glove of `meshes/`, which has 7614 taxels, is 0.9 %; solved on all taxels it
/// is 0.7 %.
const MOST_VERTICES: usize = 2000;

/// How one patch unfolds from its shape in space to its map.
///
/// All positions are in the frame of the patch's link, in m.
///
/// ```
/// use dermatome::{map::SkinMap, mesh::shapes, skin::PatchId, unfold::Unfolding};
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let patch = &map.patches[PatchId::new(0)];
/// let half = Unfolding::new(patch)?.at(0.5);
/// assert_eq!(half.len(), 600);
/// # Ok::<(), dermatome::SparseError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Unfolding {
    /// The level whose places have key frames.
    pub level: LevelId,
    /// The pose of the unfolded map in the frame of the link: of the point `(u, v, 0)`.
    pub sheet: DAffine3,
    /// The places of that level at `KEY_TIMES`.
    pub keys: [IdVec<PlaceId, DVec3>; 3],
    /// How far the skin turns at each of those places from space to map: axis times angle, in rad.
    pub turns: IdVec<PlaceId, DVec3>,
    /// Where the places of level 0 are in space and on the map.
    ends: [IdVec<PlaceId, DVec3>; 2],
    /// Places of level 0 by those of the level; `None` where it is level 0.
    #[doc(hidden)]
    pub rows: Option<IdVec<PlaceId, CarriedRow>>,
    /// The place of level 0 that each place of the level is.
    #[doc(hidden)]
    pub origins: IdVec<PlaceId, PlaceId>,
}

impl Unfolding {
    /// Solves for the key frames of a patch of a valid map.
    ///
    /// # Errors
    /// If the system does not fit into memory.
    ///
    /// # Panics
    /// If the patch has no level.
    pub fn new(patch: &PatchMap) -> Result<Self, SparseError> {
        let finest = &patch.levels[LevelId::default()];
        let coarsest = LevelId::new(patch.levels.len() - 1);
        let is_small = |(_, map): &(LevelId, &MapLevel)| map.level.mesh.positions.len() <= MOST_VERTICES;
        let level = patch.levels.enumerate().find(is_small).map_or(coarsest, |(id, _)| id);
        let solved = &patch.levels[level];
        let origins = origins(finest, solved);
        let skin = finest.uv.ids().map(|at| finest.level.mesh.positions[finest.vertex_of(at)]);
        let skin: IdVec<PlaceId, DVec3> = skin.collect();
        let corners = solved.corners();
        let space = origins.map(|&at| skin[at]);
        let plane = origins.map(|&at| finest.uv[at]);
        let turns = Turns::new(&corners, &space, &plane);
        let sheet = turns.sheet;
        let flat = finest.uv.map(|&at| sheet.transform_point3(at.extend(0.0)));
        let on_sheet = origins.map(|&at| flat[at]);
        let joiner = Joiner::new(&corners, &space, &on_sheet, &turns);
        Ok(Self {
            level,
            sheet,
            keys: joiner.solve(KEY_TIMES)?,
            turns: turns.at_places(&corners, &space),
            rows: carried_rows(finest, solved),
            ends: [skin, flat],
            origins,
        })
    }

    /// The places of level 0 at a time from 0, the skin, to 1, the map at [`Self::sheet`].
    pub fn at(&self, time: f64) -> IdVec<PlaceId, DVec3> {
        let shares = shares(time);
        let [skin, flat] = &self.ends;
        let of_level = self.origins.enumerate().map(|(place, &at)| {
            let [a, b, c] = [0, 1, 2].map(|k| self.keys[k][place]);
            [skin[at], a, b, c, flat[at]].iter().zip(shares).map(|(p, share)| share * *p).sum()
        });
        let of_level: IdVec<PlaceId, DVec3> = of_level.collect();
        let Some(rows) = &self.rows else { return of_level };
        let carry = |(place, &(named, weights)): (PlaceId, &CarriedRow)| {
            let mean = |of: &dyn Fn(PlaceId) -> DVec3| -> DVec3 {
                named.into_iter().zip(weights).map(|(p, w)| w * of(p)).sum()
            };
            let off = |end: &IdVec<PlaceId, DVec3>| end[place] - mean(&|p| end[self.origins[p]]);
            let turn = mean(&|p| self.turns[p]);
            let back = DQuat::from_scaled_axis(-turn);
            let off = (1.0 - time) * off(skin) + time * (back * off(flat));
            mean(&|p| of_level[p]) + DQuat::from_scaled_axis(time * turn) * off
        };
        rows.enumerate().map(carry).collect()
    }
}

/// The place of level 0 for each place of a level: of the places of its taxel the one at its position on the
/// map of the level.
#[doc(hidden)]
pub fn origins(finest: &MapLevel, level: &MapLevel) -> IdVec<PlaceId, PlaceId> {
    if level.level.to_finest.is_none() {
        return level.uv.ids().collect();
    }
    let carried = carried_places(finest, level);
    let mut places_of = IdVec::filled(Vec::new(), finest.level.mesh.positions.len());
    finest.uv.ids().for_each(|place| places_of[finest.vertex_of(place)].push(place));
    let origin = |(place, uv): (PlaceId, &DVec2)| {
        let taxel = level.level.origins[level.vertex_of(place)];
        let far = |at: &PlaceId| carried[*at].distance_squared(*uv);
        let nearest = places_of[taxel].iter().copied().min_by(|a, b| far(a).total_cmp(&far(b)));
        nearest.unwrap_or(PlaceId::first_of(taxel))
    };
    level.uv.enumerate().map(origin).collect()
}

/// The weights of the skin, the three key frames and the map at a time: those of the polynomial of degree 4
/// through all five.
fn shares(time: f64) -> [f64; 5] {
    let times = [0.0, KEY_TIMES[0], KEY_TIMES[1], KEY_TIMES[2], 1.0];
    std::array::from_fn(|k| {
        let others = (0..5).filter(|&j| j != k);
        others.map(|j| (time - times[j]) / (times[k] - times[j])).product()
    })
}
