//! Landmarks that contradict the others: by the energy of the field that bends the map to all of them.
//!
//! The distance of a landmark from the fit of the others does not decide: right ones miss it by up to 20 standard deviations,
//! since skins differ. What decides is the energy that a landmark costs (leave-one-out), measured in the field on the
//! map, where two fingers are far from each other.

use glam::{DMat3, DVec2, DVec3};

use crate::calib::outer;
use crate::id::{IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::registration::RegistrationError;
use crate::registration::field::Bending;
use crate::registration::landmarks::Mark;
use crate::sparse::SparseError;

/// Two landmarks are exchanged where their exchange leaves less than this share of the energy. Of 720 pairs of hands with
/// 6 to 30 right landmarks the least share was 0.45; of as many with two exchanged, 19 in 20 had less than 0.4. (By the
/// thin-plate spline of the plane `(bookstein1989)`, which joins fingers over the gap between them, the least of right ones was as low, and fewer
/// were found.)
const EXCHANGED: f64 = 0.4;

/// With fewer landmarks another exchange may be as good by chance.
const FEWEST_TO_EXCHANGE: usize = 6;

/// A landmark is doubtful from so many times the median of the others on, and with so many landmarks. Of 480 pairs of hands
/// with 10 to 30 right landmarks, 3 had a doubtful one. Of one landmark that was 15, 30 and 60 mm off it was named in 2, 17
/// and 51 % of the pairs with 13 landmarks, in 31, 75 and 92 % with 20, in 50, 92 and 100 % with 30. By the spline of
/// the plane 0, 0 and 12 % were found with 13 landmarks, as was by the distance alone.
const DOUBTFUL: f64 = 5.0;
const FEWEST_TO_DOUBT: usize = 10;

/// More landmarks are not checked: the time grows with their number.
const MOST: usize = 400;

/// A landmark that lies where the others do not put it. It is used as the others are.
#[derive(Debug, Clone, PartialEq)]
pub struct Doubt {
    /// Its name.
    pub landmark: String,
    /// How far it is from there, in m.
    pub miss: f64,
    /// The miss in standard deviations of what the others leave open, over the median of the same of each other landmark.
    pub times: f64,
}

/// Checks the landmarks of a patch, whose map is `free`, and lies at `placed` before it is bent; the one that is doubtful.
///
/// # Errors
/// If two are exchanged, or the system does not fit into memory.
pub(super) fn contradictions(
    patch: &str,
    mesh: &TriMesh,
    [free, placed]: [&IdVec<VertexId, DVec2>; 2],
    marks: &[Mark],
) -> Result<Option<Doubt>, RegistrationError> {
    if !(FEWEST_TO_EXCHANGE..=MOST).contains(&marks.len()) {
        return Ok(None);
    }
    let held: Vec<VertexId> = marks.iter().map(|mark| mark.place.opened()).collect();
    let energy = match Bending::new(&mesh.triangles, placed, &held).and_then(|field| field.energy(placed)) {
        Ok(energy) => energy,
        // Needles: nothing can be said.
        Err(SparseError::NotPositiveDefinite { .. } | SparseError::NotFinite { .. }) => return Ok(None),
        Err(source) => return Err(RegistrationError::System { patch: patch.to_owned(), source }),
    };
    let pairs: Vec<[DVec2; 2]> = marks.iter().zip(&held).map(|(mark, &v)| [free[v], mark.to]).collect();
    let of = Contradiction::new(&pairs, energy);
    let name = |k: usize| marks[k].name.clone();
    if let Some(([a, b], share)) = of.best_exchange().filter(|(_, share)| *share < EXCHANGED) {
        let (first, second) = (name(a), name(b));
        return Err(RegistrationError::Exchanged { patch: patch.to_owned(), first, second, share });
    }
    let doubtful = of.farthest().filter(|of| marks.len() >= FEWEST_TO_DOUBT && of.times > DOUBTFUL);
    Ok(doubtful.map(|Farthest { landmark, miss, times }| Doubt { landmark: name(landmark), miss, times }))
}

/// The landmarks of a patch: each on the free map, and on the atlas.
struct Contradiction<'a> {
    pairs: &'a [[DVec2; 2]],
    /// The energy of what is left of the displacements after the affine map that leaves least, row by row.
    energy: Vec<f64>,
    /// Half of its derivative by the place of each landmark.
    pulls: Vec<DVec2>,
}

impl<'a> Contradiction<'a> {
    /// Of landmarks not on a line; `energy` is that of their displacements, a quadratic form row by row:
    /// [`Bending::energy`](super::field::Bending::energy).
    fn new(pairs: &'a [[DVec2; 2]], mut energy: Vec<f64>) -> Self {
        let count = pairs.len();
        let middle = pairs.iter().map(|pair| pair[0]).sum::<DVec2>() / count as f64;
        let size = pairs.iter().map(|pair| pair[0].distance(middle)).fold(0.0, f64::max);
        let linear: Vec<DVec3> = pairs.iter().map(|pair| ((pair[0] - middle) / size).extend(1.0)).collect();
        let row = |row: &[f64]| row.iter().zip(&linear).map(|(&x, &of)| x * of).sum();
        let pulls: Vec<DVec3> = energy.chunks_exact(count).map(row).collect();
        let form = pulls.iter().zip(&linear).fold(DMat3::ZERO, |sum, (pull, of)| sum + outer(*pull, *of));
        // A constant displacement costs nothing: the form is singular but for this.
        let trace: f64 = (0..count).map(|k| energy[k * count + k]).sum();
        let inverse = (form + DMat3::from_diagonal(DVec3::splat(1e-12 * trace))).inverse();
        for (i, pull) in pulls.iter().enumerate() {
            let pull = inverse * *pull;
            pulls.iter().enumerate().for_each(|(j, other)| energy[i * count + j] -= pull.dot(*other));
        }
        let row = |row: &[f64]| row.iter().zip(pairs).map(|(&x, pair)| x * pair[1]).sum();
        let pulls = energy.chunks_exact(count).map(row).collect();
        Self { pairs, energy, pulls }
    }

    fn entry(&self, i: usize, j: usize) -> f64 {
        self.energy[i * self.pairs.len() + j]
    }

    /// The two landmarks whose places on the atlas, exchanged, leave least of the energy, and the share that is left;
    /// `None` where there is no energy.
    fn best_exchange(&self) -> Option<([usize; 2], f64)> {
        let Self { pairs, pulls, .. } = self;
        let whole: f64 = pulls.iter().zip(*pairs).map(|(pull, pair)| pull.dot(pair[1])).sum();
        let mut best = None;
        for j in 0..pairs.len() {
            for i in 0..j {
                let by = pairs[j][1] - pairs[i][1];
                let change = 2.0 * by.dot(pulls[i] - pulls[j])
                    + by.length_squared() * (self.entry(i, i) + self.entry(j, j) - 2.0 * self.entry(i, j));
                let share = (whole + change) / whole;
                if best.is_none_or(|(_, least)| share < least) {
                    best = Some(([i, j], share));
                }
            }
        }
        best.filter(|(_, share)| share.is_finite())
    }

    /// The landmark that costs most energy, and how it differs from the others.
    fn farthest(&self) -> Option<Farthest> {
        let scores: Vec<f64> =
            self.pulls.iter().enumerate().map(|(k, pull)| pull.length() / self.entry(k, k).sqrt()).collect();
        let landmark = (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b]))?;
        let mut others: Vec<f64> =
            scores.iter().enumerate().filter(|(k, _)| *k != landmark).map(|(_, score)| *score).collect();
        others.sort_by(f64::total_cmp);
        let times = scores[landmark] / others.get(others.len() / 2)?;
        let miss = self.pulls[landmark].length() / self.entry(landmark, landmark);
        times.is_finite().then_some(Farthest { landmark, miss, times })
    }
}

/// A landmark that is far from where the others put it.
struct Farthest {
    landmark: usize,
    /// How far, in m.
    miss: f64,
    /// Its miss in standard deviations of what the others leave open, over the median of the same of the others.
    times: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Landmarks of a lattice that is stretched and bent smoothly, every third vertex both ways.
    fn with<T>(change: impl Fn(&mut [[DVec2; 2]]), of: impl Fn(&Contradiction<'_>) -> T) -> T {
        let mesh = shapes::lattice(13, 13, 0.01);
        let uv: IdVec<VertexId, DVec2> = mesh.positions.map(|p| p.truncate());
        let held: Vec<VertexId> = (0..25).map(|k| VertexId::new(13 * 3 * (k / 5) + 3 * (k % 5))).collect();
        let bent = |p: DVec2| DVec2::new(p.x * 1.2 + p.y * p.y, p.y * 0.9 - 0.5 * p.x * p.y);
        let mut pairs: Vec<[DVec2; 2]> = held.iter().map(|&v| [uv[v], bent(uv[v])]).collect();
        change(&mut pairs);
        let energy = Bending::new(&mesh.triangles, &uv, &held).unwrap().energy(&uv).unwrap();
        of(&Contradiction::new(&pairs, energy))
    }

    #[test]
    fn two_exchanged_points_are_found() {
        let (_, share) = with(|_| (), |of| of.best_exchange()).unwrap();
        assert!(share > 1.0, "right pairs: {share}");
        let exchange = |pairs: &mut [[DVec2; 2]]| (pairs[6][1], pairs[18][1]) = (pairs[18][1], pairs[6][1]);
        let (found, share) = with(exchange, |of| of.best_exchange()).unwrap();
        assert_eq!(found, [6, 18]);
        assert!(share < 0.2, "{share}");
    }

    #[test]
    fn one_point_that_is_off_is_found_with_its_distance() {
        let right = with(|_| (), |of| of.farthest()).unwrap();
        assert!(right.times < 4.0, "right pairs: {}", right.times);
        let off = |pairs: &mut [[DVec2; 2]]| pairs[12][1] += DVec2::new(0.02, 0.0);
        let Farthest { landmark, miss, times } = with(off, |of| of.farthest()).unwrap();
        assert!(landmark == 12 && (miss - 0.02).abs() < 0.006 && times > 5.0, "{landmark} {miss} {times}");
    }

    /// An affine map costs nothing.
    #[test]
    fn affine_maps_cost_nothing() {
        let affine = |pairs: &mut [[DVec2; 2]]| {
            pairs.iter_mut().for_each(|[p, q]| *q = DVec2::new(p.x + 0.4 * p.y + 3.0, 0.7 * p.y));
        };
        let most = |of: &Contradiction<'_>| of.pulls.iter().map(|pull| pull.length()).fold(0.0, f64::max);
        let (least, bent) = (with(affine, most), with(|_| (), most));
        assert!(least < 1e-6 * bent, "{least} {bent}");
    }
}
