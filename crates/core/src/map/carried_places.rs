//! Where the taxels lie on the map of a coarser level that is cut open.
//!
//! A row of a level's `to_finest` names vertices of the uncut level, and a vertex of the seam has several
//! places on the map. The face of the row determines which of them belong to a taxel. A taxel of the seam
//! lies in faces on both sides; each of its places belongs to the side of its neighbours.

use glam::DVec2;

use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::MapLevel;
use crate::mesh::VertexCorners;
use crate::pyramid::Prolongation;

/// Smaller weights are rounding errors: a taxel of the seam lies on an edge.
const ROUNDED: f64 = 1e-6;

/// A place of level 0 in terms of the places of a coarser level, and their weights.
pub(crate) type CarriedRow = ([PlaceId; 3], [f64; 3]);

/// The position of each place of level 0 on the map of a level, in m: the weighted mean of the fields of its
/// taxel.
#[doc(hidden)]
pub fn carried_places(finest: &MapLevel, level: &MapLevel) -> IdVec<PlaceId, DVec2> {
    let Some(rows) = carried_rows(finest, level) else { return level.uv.clone() };
    rows.map(|row| mean_place(level, row))
}

/// Each place of level 0 in terms of the places of a level, by the weights of its taxel; `None` where
/// the level is level 0.
pub(crate) fn carried_rows(finest: &MapLevel, level: &MapLevel) -> Option<IdVec<PlaceId, CarriedRow>> {
    let rows = level.level.to_finest.as_ref()?;
    let mut carried = IdVec::<PlaceId, Option<CarriedRow>>::filled(None, finest.uv.len());
    let mut open: Vec<(PlaceId, Vec<CarriedRow>)> = Vec::new();
    let candidates = Candidates::new(finest, level, rows);
    for place in finest.uv.ids() {
        let taxel = finest.vertex_of(place);
        match candidates.of(taxel).as_slice() {
            &[only] => carried[place] = Some((only, rows.weights[taxel])),
            several => {
                open.push((place, several.iter().map(|&named| (named, rows.weights[taxel])).collect()));
            }
        }
    }
    // Propagates from neighbour to neighbour along the seam.
    let sides =
        VertexCorners::new(finest.level.mesh.triangles.ids().map(|f| finest.places(f)), finest.uv.len());
    while !open.is_empty() {
        let mut decided = Vec::new();
        open.retain(|(place, several)| {
            let around = sides.faces(*place).flat_map(|face| finest.places(face));
            let known: Vec<DVec2> =
                around.filter_map(|near| carried[near].as_ref().map(|row| mean_place(level, row))).collect();
            let middle = known.iter().sum::<DVec2>() / known.len() as f64;
            let far = |row: &CarriedRow| mean_place(level, row).distance_squared(middle);
            let nearest = several.iter().copied().min_by(|a, b| far(a).total_cmp(&far(b)));
            decided.extend(nearest.filter(|_| !known.is_empty()).map(|nearest| (*place, nearest)));
            known.is_empty() || nearest.is_none()
        });
        if decided.is_empty() {
            break;
        }
        decided.into_iter().for_each(|(place, nearest)| carried[place] = Some(nearest));
    }
    let usual = |place| {
        let taxel = finest.vertex_of(place);
        (rows.indices[taxel].map(PlaceId::first_of), rows.weights[taxel])
    };
    Some(carried.enumerate().map(|(place, found)| found.unwrap_or_else(|| usual(place))).collect())
}

fn mean_place(level: &MapLevel, &(places, weights): &CarriedRow) -> DVec2 {
    places.into_iter().zip(weights).map(|(place, w)| w * level.uv[place]).sum()
}

/// The places that rows may name.
struct Candidates<'m> {
    level: &'m MapLevel,
    rows: &'m Prolongation,
    around: VertexCorners,
    /// Whether each taxel lies on the seam of level 0.
    is_on_seam: IdVec<VertexId, bool>,
}

impl<'m> Candidates<'m> {
    fn new(finest: &MapLevel, level: &'m MapLevel, rows: &'m Prolongation) -> Self {
        let taxels = finest.level.mesh.positions.len();
        let mut is_on_seam = IdVec::filled(false, taxels);
        if let Some(unsplit) = finest.unsplit() {
            unsplit.iter().skip(taxels).for_each(|&taxel| is_on_seam[taxel] = true);
        }
        let mesh = &level.level.mesh;
        let around = VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len());
        Self { level, rows, around, is_on_seam }
    }

    /// The places of the row of a taxel in each of its faces, if they differ; a taxel off the seam lies in
    /// the face of all three vertices, if there is one.
    fn of(&self, taxel: VertexId) -> Vec<[PlaceId; 3]> {
        let (corners, weights) = (self.rows.indices[taxel], self.rows.weights[taxel]);
        let is_on_seam = self.is_on_seam[taxel];
        let counts = |k: usize| weights[k] > if is_on_seam { ROUNDED } else { 0.0 };
        let strongest = (1..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
        let mut found: Vec<[PlaceId; 3]> = Vec::new();
        for face in self.around.faces(corners[strongest]) {
            let whole = self.level.level.mesh.triangles[face];
            let side = corners.map(|v| whole.iter().position(|&w| w == v));
            if (0..3).any(|k| counts(k) && side[k].is_none()) {
                continue;
            }
            let places = self.level.places(face);
            let named = [0, 1, 2].map(|k| side[k].map_or(PlaceId::first_of(corners[k]), |at| places[at]));
            if !is_on_seam && side.iter().all(Option::is_some) {
                return vec![named];
            }
            if !found.iter().any(|other| (0..3).all(|k| !counts(k) || other[k] == named[k])) {
                found.push(named);
            }
        }
        found
    }
}
