//! How each triangle turns from space to the map, along continuous branches.

use std::collections::VecDeque;

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec};
use crate::mesh::{FlatTriangle, VertexCorners, triangle_cross};

pub(super) struct Turns {
    pub(super) faces: IdVec<FaceId, FaceMap>,
    /// The pose of the map in space: the mean of all turns is zero, and the first corner of the first root
    /// keeps its position.
    pub(super) sheet: DAffine3,
    /// The face that each connected component starts from: in the middle of the map for the first.
    pub(super) roots: Vec<FaceId>,
}

/// The transition of one triangle from space to the map: it turns, and is stretched within its plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct FaceMap {
    /// Logarithm of the rotation to [`Turns::sheet`]: axis times angle.
    pub(super) turn: DVec3,
    /// Rotates the plane of its layout into space.
    pub(super) frame: DMat3,
    /// Its corners laid out in that plane, of the skin and of the map.
    ends: [[DVec2; 3]; 2],
}

impl FaceMap {
    /// The corners in their plane at a time from 0 to 1.
    pub(super) fn between(&self, time: f64) -> [DVec2; 3] {
        std::array::from_fn(|k| self.ends[0][k].lerp(self.ends[1][k], time))
    }

    /// The triangle with a turn; turn and layout together determine the map.
    fn new(turn: DVec3, stand: DQuat, space: [DVec3; 3], plane: [DVec2; 3]) -> Self {
        let normal = triangle_cross(space).try_normalize().unwrap_or(DVec3::Z);
        let along = (space[1] - space[0]).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
        let frame = DMat3::from_cols(along, normal.cross(along), normal);
        let into = |frame: DMat3, v: DVec3| (frame.transpose() * v).truncate();
        let back = DQuat::from_scaled_axis(-turn) * stand;
        let on_skin = space.map(|p| into(frame, p - space[0]));
        let on_map = plane.map(|p| into(frame, back * (p - plane[0]).extend(0.0)));
        Self { turn, frame, ends: [on_skin, on_map] }
    }
}

impl Turns {
    pub(super) fn new(
        corners: &IdVec<FaceId, [PlaceId; 3]>,
        space: &IdVec<PlaceId, DVec3>,
        plane: &IdVec<PlaceId, DVec2>,
    ) -> Self {
        let to_map: IdVec<FaceId, Option<DMat3>> =
            corners.iter().map(|c| rotation(c.map(|p| space[p]), c.map(|p| plane[p]))).collect();
        let (order, roots) = walk(corners, plane);
        let Some(&root) = roots.first() else {
            return Self { faces: IdVec::default(), sheet: DAffine3::IDENTITY, roots };
        };
        // First from the turn of the root, then from the mean of all turns.
        let mut stand = to_map[root].unwrap_or(DMat3::IDENTITY).transpose();
        let mut faces = branches(&order, &to_map, stand);
        let areas = corners.iter().map(|c| triangle_cross(c.map(|p| space[p])).length());
        let (sum, area) = faces
            .iter()
            .zip(areas)
            .fold((DVec3::ZERO, 0.0), |(sum, total), (turn, area)| (sum + area * *turn, total + area));
        if area > 0.0 {
            stand = DMat3::from_quat(DQuat::from_scaled_axis(-sum / area)) * stand;
            faces = branches(&order, &to_map, stand);
        }
        let pin = corners[root][0];
        let stands = DQuat::from_mat3(&stand);
        let faces = faces.enumerate().map(|(face, &turn)| {
            let c = corners[face];
            FaceMap::new(turn, stands, c.map(|p| space[p]), c.map(|p| plane[p]))
        });
        let faces = faces.collect();
        let sheet = DAffine3 { matrix3: stand, translation: space[pin] - stand * plane[pin].extend(0.0) };
        Self { faces, sheet, roots }
    }

    /// The mean turn of the faces around each place, by their areas.
    pub(super) fn at_places(
        &self,
        corners: &IdVec<FaceId, [PlaceId; 3]>,
        space: &IdVec<PlaceId, DVec3>,
    ) -> IdVec<PlaceId, DVec3> {
        let mut sums = IdVec::<PlaceId, (DVec3, f64)>::filled((DVec3::ZERO, 0.0), space.len());
        for (face, places) in corners.enumerate() {
            let area = triangle_cross(places.map(|p| space[p])).length();
            for &place in places {
                let (sum, total) = sums[place];
                sums[place] = (sum + area * self.faces[face].turn, total + area);
            }
        }
        sums.map(|&(sum, total)| if total > 0.0 { sum / total } else { DVec3::ZERO })
    }
}

/// The rotation nearest to the map of a triangle to the plane z = 0; `None` if it has no area.
pub(super) fn rotation(space: [DVec3; 3], plane: [DVec2; 3]) -> Option<DMat3> {
    let normal = triangle_cross(space).try_normalize()?;
    let along = (space[1] - space[0]).try_normalize()?;
    let flat = FlatTriangle::new(space);
    let j = flat.jacobian(plane);
    let DVec2 { x: cos, y: sin } =
        DVec2::new(j.x_axis.x + j.y_axis.y, j.x_axis.y - j.y_axis.x).normalize_or(DVec2::X);
    let turn = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
    let rotation = turn * DMat3::from_cols(along, normal.cross(along), normal).transpose();
    rotation.is_finite().then_some(rotation)
}

/// Every face with the one that it is reached from, breadth first from the face in the middle of the
/// map, and the first face of each component.
fn walk(
    corners: &IdVec<FaceId, [PlaceId; 3]>,
    plane: &IdVec<PlaceId, DVec2>,
) -> (Vec<(FaceId, Option<FaceId>)>, Vec<FaceId>) {
    let around = VertexCorners::new(corners.iter().copied(), plane.len());
    let middle_of = |face: FaceId| corners[face].iter().map(|&p| plane[p]).sum::<DVec2>() / 3.0;
    let middle = corners.ids().map(middle_of).sum::<DVec2>() / corners.len().max(1) as f64;
    let far = |face: &FaceId| middle_of(*face).distance_squared(middle);
    let first = corners.ids().min_by(|a, b| far(a).total_cmp(&far(b)));
    let mut is_reached = IdVec::<FaceId, bool>::filled(false, corners.len());
    let (mut order, mut roots) = (Vec::new(), Vec::new());
    for root in first.into_iter().chain(corners.ids()) {
        if is_reached[root] {
            continue;
        }
        is_reached[root] = true;
        roots.push(root);
        let mut queue = VecDeque::from([(root, None)]);
        while let Some((face, from)) = queue.pop_front() {
            order.push((face, from));
            for near in corners[face].into_iter().flat_map(|p| around.faces(p)) {
                if !is_reached[near] && shared(&corners[face], &corners[near]) == 2 {
                    is_reached[near] = true;
                    queue.push_back((near, Some(face)));
                }
            }
        }
    }
    (order, roots)
}

fn shared(a: &[PlaceId; 3], b: &[PlaceId; 3]) -> usize {
    a.iter().filter(|place| b.contains(place)).count()
}

/// Logarithms of `stand` after each rotation, each on the branch nearest to that of the face that it is
/// reached from; a face without area turns as that one.
fn branches(
    order: &[(FaceId, Option<FaceId>)],
    to_map: &IdVec<FaceId, Option<DMat3>>,
    stand: DMat3,
) -> IdVec<FaceId, DVec3> {
    let mut turns = IdVec::filled(DVec3::ZERO, to_map.len());
    for &(face, from) in order {
        let near = from.map_or(DVec3::ZERO, |from| turns[from]);
        turns[face] = to_map[face].map_or(near, |rotation| logarithm(stand * rotation, near));
    }
    turns
}

/// The logarithm of a rotation nearest to `near`: axis times angle, whole turns added.
fn logarithm(rotation: DMat3, near: DVec3) -> DVec3 {
    let turn = DQuat::from_mat3(&rotation).normalize().to_scaled_axis();
    let axis = turn.try_normalize().or(near.try_normalize()).unwrap_or(DVec3::X);
    let whole = ((near - turn).dot(axis) / std::f64::consts::TAU).round();
    turn + whole * std::f64::consts::TAU * axis
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_logarithm_follows_its_neighbour_beyond_half_a_turn() {
        let axis = DVec3::new(1.0, 2.0, -2.0) / 3.0;
        let mut near = DVec3::ZERO;
        for degrees in (0..=1000).step_by(25) {
            let angle = f64::from(degrees).to_radians();
            near = logarithm(DMat3::from_axis_angle(axis, angle), near);
            assert!(near.distance(angle * axis) < 1e-6, "{degrees} degrees: {near}");
        }
    }
}
