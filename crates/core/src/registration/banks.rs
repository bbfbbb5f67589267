//! Where the banks of the seam of a closed skin lie on its atlas, whose seam has the same shape.
//!
//! The rim of such a map runs once around a tree: it visits each end of the seam once, and each branch as often as paths meet
//! there. Where both rims visit ends and branches in the same order, what lies between two visits is one path, and equal
//! shares of its length are one place. Without them, places beside the seam are only as near as the landmarks around put them,
//! and the rim of a finger may lie over the gap to the next one.

use glam::DVec2;

use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, mirrored};
use crate::mesh::{boundary_edges, boundary_loops};

/// The rim of the map of a closed surface that is cut along a tree.
struct Rim {
    places: Vec<PlaceId>,
    /// The numbers of those at which the seam ends or branches, and how many of its paths meet there.
    knots: Vec<(usize, usize)>,
}

impl Rim {
    /// `None` where the surface has a boundary or a handle, or no seam.
    fn of(level: &MapLevel) -> Option<Self> {
        let (cut, mesh) = (level.cut.as_ref()?, &level.level.mesh);
        let is_sphere = 2 * mesh.positions.len() == mesh.triangles.len() + 4;
        let loops = boundary_loops(&level.opened());
        let ([walk], true) = (loops.as_slice(), is_sphere && boundary_edges(mesh).is_empty()) else {
            return None;
        };
        let mut degrees = IdVec::<VertexId, usize>::filled(0, mesh.positions.len());
        cut.unsplit.iter().for_each(|&v| degrees[v] += 1);
        let places: Vec<PlaceId> = walk.iter().map(|&v| PlaceId::of_opened(v)).collect();
        let of_place = places.iter().map(|&place| degrees[cut.unsplit[place]]);
        let knots = of_place.enumerate().filter(|(_, degree)| *degree != 2).collect();
        Some(Self { places, knots })
    }

    /// The places from a knot to the next one, both included, each with its share of the length between.
    fn path(&self, level: &MapLevel, knot: usize) -> Vec<(PlaceId, f64)> {
        let [from, to] = [knot, knot + 1].map(|knot| self.knots[knot % self.knots.len()].0);
        let count = if to > from { to - from } else { to + self.places.len() - from };
        let at = |place: PlaceId| level.level.mesh.positions[level.vertex_of(place)];
        let (mut path, mut length) = (Vec::<(PlaceId, f64)>::new(), 0.0);
        for place in self.places.iter().cycle().skip(from).take(count + 1) {
            length += path.last().map_or(0.0, |&(before, _)| at(before).distance(at(*place)));
            path.push((*place, length));
        }
        path.iter_mut().for_each(|(_, share)| *share /= length);
        path
    }
}

/// The places of the rim of a closed skin, which lies at `placed`, in their order, and where they come to on its atlas; none
/// where the seams are of another shape or one of both surfaces has none.
pub(super) fn bank_marks(
    own: &MapLevel,
    placed: &IdVec<PlaceId, DVec2>,
    atlas: &MapLevel,
    is_mirrored: bool,
) -> Vec<(PlaceId, DVec2)> {
    let (Some(rim), Some(mut other)) = (Rim::of(own), Rim::of(atlas)) else { return Vec::new() };
    let on_atlas = |place: PlaceId| if is_mirrored { mirrored(atlas.uv[place]) } else { atlas.uv[place] };
    if is_mirrored {
        let last = other.places.len() - 1;
        other.places.reverse();
        other.knots.reverse();
        other.knots.iter_mut().for_each(|(number, _)| *number = last - *number);
    }
    let count = rim.knots.len();
    if other.knots.len() != count {
        return Vec::new();
    }
    // Of the turns with which ends come to ends and branches to branches, the one that moves them least.
    let moved = |turn: usize| {
        let pair = |knot: usize| (rim.knots[knot], other.knots[(knot + turn) % count]);
        let is_same = (0..count).map(pair).all(|((_, a), (_, b))| a == b);
        let far = |((a, _), (b, _)): ((usize, usize), (usize, usize))| {
            placed[rim.places[a]].distance_squared(on_atlas(other.places[b]))
        };
        is_same.then(|| (0..count).map(pair).map(far).sum::<f64>())
    };
    let turns = (0..count).filter_map(|turn| Some((turn, moved(turn)?)));
    let Some((turn, _)) = turns.min_by(|(_, a), (_, b)| a.total_cmp(b)) else { return Vec::new() };
    let mut marks = Vec::with_capacity(rim.places.len());
    for knot in 0..count {
        let (path, theirs) = (rim.path(own, knot), other.path(atlas, (knot + turn) % count));
        for &(place, share) in &path[..path.len() - 1] {
            let after = theirs.partition_point(|(_, other)| *other <= share).clamp(1, theirs.len() - 1);
            let [(from, low), (to, high)] = [theirs[after - 1], theirs[after]];
            let between = ((share - low) / (high - low)).clamp(0.0, 1.0);
            marks.push((place, on_atlas(from).lerp(on_atlas(to), between)));
        }
    }
    marks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::{Cut, decide};
    use crate::map::MapLevel;
    use crate::mesh::shapes;
    use crate::pyramid::Level;

    /// A ball cut along a tree, with its places somewhere on the plane.
    fn cut_ball(fine: u32) -> MapLevel {
        let mesh = shapes::ball(fine, 0.05);
        let cut = decide(&mesh, None, &Cut::Auto, &|_, _| None).unwrap().cut(&mesh, None).unwrap().unwrap();
        let place = |k: usize| DVec2::new(k as f64, (k * k % 97) as f64);
        let uv = (0..cut.unsplit.len()).map(place).collect();
        let areas = mesh.positions.map(|_| 1.0);
        MapLevel::new(Level::finest(mesh, areas), Some(cut), uv, 1.0)
    }

    /// The banks of a map come to themselves, and to the mirror image where that is asked for; with other triangles, the ends
    /// of a seam come to ends.
    #[test]
    fn banks_come_to_banks() {
        let level = cut_ball(6);
        for (is_mirrored, placed) in [(false, level.uv.clone()), (true, level.uv.clone())] {
            let marks = bank_marks(&level, &placed, &level, is_mirrored);
            assert_eq!(marks.len(), boundary_edges(&level.opened()).len());
            if !is_mirrored {
                assert!(marks.iter().all(|&(place, to)| to.distance(level.uv[place]) < 1e-9));
            }
        }
        let other = cut_ball(9);
        let marks = bank_marks(&level, &level.uv, &other, false);
        let ends = |level: &MapLevel| {
            let rim = Rim::of(level).unwrap();
            let knots = rim.knots.iter().filter(|(_, degree)| *degree == 1);
            knots.map(|(k, _)| rim.places[*k]).collect::<Vec<_>>()
        };
        for end in ends(&level) {
            let to = marks.iter().find(|(place, _)| *place == end).unwrap().1;
            assert!(ends(&other).iter().any(|&other_end| other.uv[other_end].distance(to) < 1e-9));
        }
    }

    /// A surface with a boundary has no banks.
    #[test]
    fn a_sheet_has_no_banks() {
        let mesh = shapes::lattice(5, 5, 0.01);
        let uv = mesh.positions.map(|p| p.truncate()).reindexed();
        let areas = mesh.positions.map(|_| 1.0);
        let level = MapLevel::new(Level::finest(mesh, areas), None, uv, 1.0);
        assert!(bank_marks(&level, &level.uv, &level, false).is_empty());
    }
}
