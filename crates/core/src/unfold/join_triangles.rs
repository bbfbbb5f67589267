//! The surface whose triangles are nearest to the wanted ones, each rotated to fit best.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec};
use crate::mesh::cotangent;
use crate::sparse::{Cholesky, Factor, Matrix, Pattern, SparseError};
use crate::unfold::turns::{Turns, rotation};

/// Cotangents are clamped: a sliver would outweigh its ring, and an obtuse angle would count negative.
const COTANGENTS: [f64; 2] = [0.05, 19.1];

/// Number of further rotations and solutions after the first one. Halfway, the mean error of lengths on the
/// glove of `meshes/` falls from 3.9 % to 0.9 %, that on the forearm from 0.46 % to 0.13 %; 32 more rounds
/// take four times as long and leave 0.6 % and 0.09 %.
const ROTATION_ROUNDS: usize = 8;

pub(super) struct Joiner<'a> {
    corners: &'a IdVec<FaceId, [PlaceId; 3]>,
    space: &'a IdVec<PlaceId, DVec3>,
    flat: &'a IdVec<PlaceId, DVec3>,
    turns: &'a Turns,
    /// Cotangent weight of the edge opposite to each corner.
    weights: IdVec<FaceId, [f64; 3]>,
    /// One place of each component, whose position is given at every time.
    pins: Vec<PlaceId>,
}

impl<'a> Joiner<'a> {
    /// `flat` has the places of the map, in the pose of the map.
    pub(super) fn new(
        corners: &'a IdVec<FaceId, [PlaceId; 3]>,
        space: &'a IdVec<PlaceId, DVec3>,
        flat: &'a IdVec<PlaceId, DVec3>,
        turns: &'a Turns,
    ) -> Self {
        let weights = corners.map(|c| {
            let [x, y, z] = c.map(|p| space[p]);
            [cotangent(x, y, z), cotangent(y, z, x), cotangent(z, x, y)]
                .map(|cot| if cot.is_nan() { COTANGENTS[0] } else { cot.clamp(COTANGENTS[0], COTANGENTS[1]) })
        });
        let mut has_face = IdVec::<PlaceId, bool>::filled(false, space.len());
        corners.iter().flatten().for_each(|&place| has_face[place] = true);
        let alone = space.ids().filter(|&place| !has_face[place]);
        let pins = turns.roots.iter().map(|&root| corners[root][0]).chain(alone).collect();
        Self { corners, space, flat, turns, weights, pins }
    }

    /// The surfaces at these times.
    pub(super) fn solve<const N: usize>(
        &self,
        times: [f64; N],
    ) -> Result<[IdVec<PlaceId, DVec3>; N], SparseError> {
        let rows = self.space.len();
        let pattern = Pattern::new(rows, self.edges().map(|e| (e.from.index(), e.to.index())));
        let mut matrix = Matrix::zero(&pattern);
        for SharedEdge { from, to, weight, .. } in self.edges() {
            let (i, j) = (from.index(), to.index());
            *matrix.at(i, i) += weight;
            *matrix.at(j, j) += weight;
            *matrix.at(i, j) -= weight;
            *matrix.at(j, i) -= weight;
        }
        self.pins.iter().for_each(|pin| *matrix.at(pin.index(), pin.index()) += 1.0);
        let cholesky = Cholesky::new(&pattern, self.space.as_slice())?;
        let factor = cholesky.factor(&matrix)?;
        let mut solved = [(); N].map(|()| IdVec::default());
        for (surface, time) in solved.iter_mut().zip(times) {
            *surface = self.surface(time, &factor)?;
        }
        Ok(solved)
    }

    fn surface(&self, time: f64, factor: &Factor<'_, f64>) -> Result<IdVec<PlaceId, DVec3>, SparseError> {
        let wanted = self.turns.faces.map(|face| face.between(time));
        let mut ways: IdVec<FaceId, DMat3> = self
            .turns
            .faces
            .map(|face| DMat3::from_quat(DQuat::from_scaled_axis(time * face.turn)) * face.frame);
        let mut surface = self.join(time, &wanted, &ways, factor)?;
        for _ in 0..ROTATION_ROUNDS {
            for ((way, corners), wanted) in ways.iter_mut().zip(self.corners).zip(&wanted) {
                if let Some(back) = rotation(corners.map(|p| surface[p]), *wanted) {
                    *way = back.transpose();
                }
            }
            surface = self.join(time, &wanted, &ways, factor)?;
        }
        Ok(surface)
    }

    /// The surface whose edges are nearest to those of flat triangles, each with its own rotation.
    fn join(
        &self,
        time: f64,
        wanted: &IdVec<FaceId, [DVec2; 3]>,
        ways: &IdVec<FaceId, DMat3>,
        factor: &Factor<'_, f64>,
    ) -> Result<IdVec<PlaceId, DVec3>, SparseError> {
        let mut sums = IdVec::filled(DVec3::ZERO, self.space.len());
        for SharedEdge { face, sides: [a, b], from, to, weight } in self.edges() {
            let edge = weight * (ways[face] * (wanted[face][b] - wanted[face][a]).extend(0.0));
            sums[to] += edge;
            sums[from] -= edge;
        }
        self.pins.iter().for_each(|&pin| sums[pin] += self.space[pin].lerp(self.flat[pin], time));
        for axis in 0..3 {
            let mut x: Vec<f64> = sums.iter().map(|p| p[axis]).collect();
            factor.solve(&mut x)?;
            sums.iter_mut().zip(x).for_each(|(p, x)| p[axis] = x);
        }
        Ok(sums)
    }

    fn edges(&self) -> impl Iterator<Item = SharedEdge> {
        self.corners.enumerate().flat_map(|(face, c)| {
            let weights = self.weights[face];
            [0, 1, 2].map(|k| {
                let sides = [(k + 1) % 3, (k + 2) % 3];
                SharedEdge { face, sides, from: c[sides[0]], to: c[sides[1]], weight: weights[k] }
            })
        })
    }
}

struct SharedEdge {
    face: FaceId,
    /// Its ends among the corners of the face.
    sides: [usize; 2],
    from: PlaceId,
    to: PlaceId,
    weight: f64,
}
