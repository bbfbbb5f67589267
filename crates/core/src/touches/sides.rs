//! Normals of taxels without a drawing, and on which side of them the sphere was.
//!
//! The centres of a sphere that touches lie on the skin raised by its radius, so that a normal is that of the quadric through all
//! of them near a taxel: one mean centre for each taxel is less exact by a contact. Signs follow from neighbour to neighbour
//! along the minimum spanning tree `(hoppe1992)`, nearly parallel normals first. The side of a connected piece is that to which readings
//! fall while the sphere moves, or where they do not tell that of the piece next to it, or that to which it bends, or else away from the origin of
//! the link.
//!
//! *Heuristic*: normals of one mean centre for each taxel, joined breadth first, put 4 taxels of one simulated log and 9 of another
//! on the far side of the sphere; these put none there. Of 45 logs of skins of modules (three touches a taxel, 1 mm of noise) two had a module of
//! three and four taxels there that one touch alone felt: its bend is noise, and it has the side of the next module now.

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::numeric::{DisjointSets, Relation, argsort, solve_system, symmetric_eigen};
use crate::touches::gather::Samples;
use crate::touches::surface::neighbours;

/// A touch counts at most this many standard deviations.
const MOST_SIGMAS: f64 = 6.0;

/// The side is that of the readings if the sum over the touches is beyond so many standard deviations.
const LEAST_SIGMAS: f64 = 4.0;

/// Touches tell the side only if the mean over them is beyond so many standard deviations: presses have 4.7, a sphere that rolls with a constant
/// force, which tells nothing, has 0.9, from the rim of the skin.
const LEAST_MEAN: f64 = 1.5;

/// What a spacing between two taxels costs in the spanning tree, next to one less the cosine of their normals.
const COST_OF_SPACING: f64 = 0.02;

/// Fewer touches that tell the side do not determine it: readings of one that moves along the skin change with the force, too.
const LEAST_TOLD: f64 = 3.0;

/// A touch that moves farther than so many radii of its body is judged in pieces, since its skin has several directions.
const PIECE: f64 = 2.0;

/// The size of a piece where the radius is not known, in m.
const PIECE_WITHOUT_RADIUS: f64 = 0.02;

/// A sum over touches in standard deviations; 0 if they do not tell the side.
pub(crate) fn side_told(sum: f64, count: f64) -> f64 {
    if count >= LEAST_TOLD && sum.abs() > LEAST_MEAN * count { sum / count.sqrt() } else { 0.0 }
}

/// What one touch, or a piece of a long one, says of the side.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Outward {
    /// The number of the touch.
    pub(super) touch: usize,
    /// The mean position of the body, in the frame of the link, in m.
    pub(super) centre: DVec3,
    /// The direction in which the readings fell, its length in standard deviations; zero where the touch does not tell.
    pub(super) direction: DVec3,
}

/// What each touch says of the side: a linear regression of the sums of the readings of its frames on the positions, and on the square
/// of the way along it. At the rim of a bent skin readings fall, and the body bends inwards: that square says so, not the height. A long
/// touch has several pieces.
pub(super) fn outwards(samples: &Samples, frames: usize) -> Vec<Outward> {
    let mut sums: Vec<Option<(usize, DVec3, f64)>> = vec![None; frames];
    let mut sizes = vec![PIECE_WITHOUT_RADIUS; samples.touches.len()];
    for sample in samples.of.iter().flatten() {
        sums[sample.frame].get_or_insert((sample.touch, sample.centre, 0.0)).2 += sample.reading;
        if sample.radius > 0.0 {
            sizes[sample.touch] = PIECE * sample.radius;
        }
    }
    let frames: Vec<(usize, DVec3, f64)> = sums.into_iter().flatten().collect();
    let mut all = Vec::new();
    for touch in frames.chunk_by(|a, b| a.0 == b.0) {
        let number = touch[0].0;
        let mut rest = touch;
        while let Some(first) = rest.first() {
            let is_far = |frame: &(usize, DVec3, f64)| frame.1.distance(first.1) > sizes[number];
            let (piece, others) = rest.split_at(rest.iter().position(is_far).unwrap_or(rest.len()));
            rest = others;
            let centre = piece.iter().map(|frame| frame.1).sum::<DVec3>() / piece.len() as f64;
            let direction = direction(piece, centre).unwrap_or(DVec3::ZERO);
            all.push(Outward { touch: number, centre, direction });
        }
    }
    all
}

/// The direction in which sums of readings fall. `None` below six frames, or if they are at one place.
fn direction(frames: &[(usize, DVec3, f64)], mean: DVec3) -> Option<DVec3> {
    /// Frames without which five unknowns leave no residual.
    const LEAST_FRAMES: usize = 6;
    /// What is added to the normal equations, over one frame: directions in which the body did not move have no slope.
    const DAMPING: f64 = 1e-3;
    /// Least variance of the sums, over the largest one squared: the model is no better.
    const LEAST_VARIANCE: f64 = 1e-6;
    let count = frames.len() as f64;
    let largest = frames.iter().map(|frame| frame.2).fold(0.0, f64::max);
    let scale = (frames.iter().map(|frame| frame.1.distance_squared(mean)).sum::<f64>() / count).sqrt();
    if frames.len() < LEAST_FRAMES || !(scale > 0.0 && largest > 0.0) {
        return None;
    }
    let mut scatter = [[0.0; 3]; 3];
    for at in frames.iter().map(|frame| ((frame.1 - mean) / scale).to_array()) {
        for (line, a) in scatter.iter_mut().zip(at) {
            line.iter_mut().zip(at).for_each(|(cell, b)| *cell += a * b);
        }
    }
    let (values, vectors) = symmetric_eigen(&scatter);
    let most = (0..3).max_by(|&a, &b| values[a].total_cmp(&values[b]))?;
    let way = DVec3::from_array([0, 1, 2].map(|row| vectors[row][most]));
    let row = |frame: &(usize, DVec3, f64)| {
        let at = (frame.1 - mean) / scale;
        [1.0, at.x, at.y, at.z, at.dot(way).powi(2), frame.2 / largest]
    };
    let mut system = [[0.0; 6]; 5];
    for row in frames.iter().map(row) {
        for (line, a) in system.iter_mut().zip(row) {
            line.iter_mut().zip(row).for_each(|(cell, b)| *cell += a * b);
        }
    }
    system.iter_mut().enumerate().for_each(|(k, line)| line[k] += DAMPING);
    let solved = solve_system(system)?;
    let residual = |row: [f64; 6]| row[5] - (0..5).map(|k| solved[k] * row[k]).sum::<f64>();
    let squares = frames.iter().map(row).map(|row| residual(row).powi(2)).sum::<f64>();
    let variance = (squares / (count - 5.0)).max(LEAST_VARIANCE);
    let slope = DVec3::new(solved[1], solved[2], solved[3]);
    let along = slope.try_normalize()?;
    // The variance of the slope along its own direction: a column of the inverse of the normal equations.
    let mut inverse = system;
    inverse.iter_mut().zip([0.0, along.x, along.y, along.z, 0.0]).for_each(|(line, b)| line[5] = b);
    let column = solve_system(inverse)?;
    let spread = variance * along.dot(DVec3::new(column[1], column[2], column[3]));
    (spread > 0.0).then(|| -slope / spread.sqrt())
}

/// Pairs of taxels that feel a frame together, or whose centres are within two spacings.
pub(super) fn joined(
    samples: &Samples,
    centres: &IdVec<VertexId, DVec3>,
    spacing: f64,
) -> Vec<[VertexId; 2]> {
    let mut pairs: Vec<[VertexId; 2]> = neighbours(centres, 2.0 * spacing)
        .enumerate()
        .flat_map(|(v, near)| near.iter().filter(move |u| v < **u).map(move |&u| [v, u]).collect::<Vec<_>>())
        .collect();
    let frames = samples.of.iter().flatten().map(|sample| sample.frame + 1).max().unwrap_or(0);
    let mut felt: Vec<Vec<VertexId>> = vec![Vec::new(); frames];
    for (v, of) in samples.of.enumerate() {
        of.iter().for_each(|sample| felt[sample.frame].push(v));
    }
    for felt in &felt {
        // A frame of n taxels has n^2 / 2 pairs; those of each with the next ones in the order of ids connect it as well.
        pairs.extend(felt.windows(2).map(|pair| [pair[0], pair[1]]));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Turns normals to the outside. Returns `false` if nothing determines it for a piece.
pub(super) fn orient(
    points: &IdVec<VertexId, DVec3>,
    normals: &mut IdVec<VertexId, Option<DVec3>>,
    pairs: &[[VertexId; 2]],
    touches: &[Outward],
    spacing: f64,
) -> bool {
    let mut sets = DisjointSets::<VertexId, Relation>::new(points.len());
    let edge = |&[a, b]: &[VertexId; 2]| {
        let cosine = normals[a]?.dot(normals[b]?);
        let cost = 1.0 - cosine.abs() + COST_OF_SPACING * points[a].distance(points[b]) / spacing;
        Some((cost, [a, b], Relation::reversed_if(cosine < 0.0)))
    };
    let edges: Vec<_> = pairs.iter().filter_map(edge).collect();
    for k in argsort(&edges.iter().map(|edge| edge.0).collect::<Vec<_>>()) {
        let (_, [a, b], relation) = edges[k];
        if sets.root(a).0 != sets.root(b).0 {
            let _ = sets.join(a, b, relation);
        }
    }
    for v in points.ids() {
        if sets.root(v).1.is_reversed() {
            normals[v] = normals[v].map(|n| -n);
        }
    }
    let pieces = sets.labels();
    let mut told = vec![(0.0, 0.0_f64); pieces.count];
    for touch in touches.iter().filter(|touch| touch.direction != DVec3::ZERO) {
        let distance = |v: &VertexId| points[*v].distance_squared(touch.centre);
        let known = points.ids().filter(|v| normals[*v].is_some());
        let nearest = known.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let Some((v, normal)) = nearest.and_then(|v| Some((v, normals[v]?))) else { continue };
        let (sum, count) = &mut told[pieces.of[v]];
        *sum += normal.dot(touch.direction).clamp(-MOST_SIGMAS, MOST_SIGMAS);
        *count += 1.0;
    }
    let mut members: Vec<Vec<VertexId>> = vec![Vec::new(); pieces.count];
    for v in points.ids().filter(|v| normals[*v].is_some()) {
        members[pieces.of[v]].push(v);
    }
    let by_readings: Vec<Option<bool>> = told
        .into_iter()
        .map(|(sum, count)| side_told(sum, count))
        .map(|sigmas| (sigmas.abs() > LEAST_SIGMAS).then_some(sigmas > 0.0))
        .collect();
    let turn = |normals: &mut IdVec<VertexId, Option<DVec3>>, piece: &[VertexId]| {
        piece.iter().for_each(|&v| normals[v] = normals[v].map(|n| -n));
    };
    let is_told = |k: &usize| by_readings[*k].is_some();
    for k in (0..pieces.count).filter(is_told) {
        if by_readings[k] == Some(false) {
            turn(normals, &members[k]);
        }
    }
    let told: Vec<VertexId> = (0..pieces.count).filter(is_told).flat_map(|k| members[k].clone()).collect();
    let mut all_told = true;
    for piece in (0..pieces.count).filter(|k| !is_told(k)).map(|k| &members[k]).filter(|of| !of.is_empty()) {
        let centre = piece.iter().map(|&v| points[v]).sum::<DVec3>() / piece.len() as f64;
        let bend = || away_from(points, normals, piece, centre);
        let away = || away_from(points, normals, piece, DVec3::ZERO);
        match as_beside(points, normals, piece, &told, spacing).or_else(bend).or_else(away) {
            Some(true) => {}
            Some(false) => turn(normals, piece),
            None => all_told = false,
        }
    }
    all_told
}

/// Whether the normals of a piece are to the same side as those of the nearest of some taxels whose side is known; `None` if it is far
/// away, or across.
fn as_beside(
    points: &IdVec<VertexId, DVec3>,
    normals: &IdVec<VertexId, Option<DVec3>>,
    piece: &[VertexId],
    told: &[VertexId],
    spacing: f64,
) -> Option<bool> {
    /// In spacings: a module next to another one that no touch felt with it.
    const FARTHEST: f64 = 6.0;
    /// Cosines of normals below this tell nothing.
    const LEAST_COSINE: f64 = 0.5;
    let pairs = piece.iter().flat_map(|&v| told.iter().map(move |&u| (v, u)));
    let distance = |(v, u): &(VertexId, VertexId)| points[*v].distance_squared(points[*u]);
    let (v, u) = pairs.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    let cosine = normals[v]?.dot(normals[u]?);
    let is_beside = distance(&(v, u)).sqrt() < FARTHEST * spacing && cosine.abs() > LEAST_COSINE;
    is_beside.then_some(cosine > 0.0)
}

/// Whether the normals of a piece point away from a place, which is its middle for its bend; `None` if most are across.
fn away_from(
    points: &IdVec<VertexId, DVec3>,
    normals: &IdVec<VertexId, Option<DVec3>>,
    piece: &[VertexId],
    from: DVec3,
) -> Option<bool> {
    /// Sines below this, as the mean of those between normals and the directions from there, are noise.
    const LEAST_SINE: f64 = 0.05;
    let sines = piece.iter().filter_map(|&v| Some(normals[v]?.dot((points[v] - from).normalize_or_zero())));
    let mean = sines.sum::<f64>() / piece.len() as f64;
    (mean.abs() > LEAST_SINE).then_some(mean > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A module that no touch joins to the sheet next to it, whose bend is noise, has the side of the sheet, which readings tell; far
    /// away it has the side to which it bends.
    #[test]
    fn a_module_has_the_side_of_the_sheet_next_to_it() {
        const SPACING: f64 = 6e-3;
        for (gap, expected) in [(4.0, 1.0), (9.0, -1.0)] {
            let along = |k: u32| SPACING * f64::from(k);
            let sheet = (0..36).map(|k| DVec3::new(along(k / 6), along(k % 6), 0.1));
            let end = along(5) + gap * SPACING;
            let module = (0..3).map(|k| DVec3::new(end, along(k), if k == 1 { 0.099 } else { 0.1 }));
            let points: IdVec<VertexId, DVec3> = sheet.chain(module).collect();
            let sheet = 36;
            let mut normals: IdVec<VertexId, Option<DVec3>> = points
                .enumerate()
                .map(|(v, _)| Some(if v.index().is_multiple_of(3) { DVec3::Z } else { -DVec3::Z }))
                .collect();
            // The module bends to the far side: a normal of it that is turned says so.
            normals[VertexId::new(sheet)] = Some(DVec3::new(0.0, -0.4, 1.0).normalize());
            normals[VertexId::new(sheet + 2)] = Some(DVec3::new(0.0, -0.4, -1.0).normalize());
            let pairs: Vec<[VertexId; 2]> = neighbours(&points, 2.0 * SPACING)
                .enumerate()
                .flat_map(|(v, near)| near.iter().map(|&u| [v, u]).collect::<Vec<_>>())
                .collect();
            let touch = |k: u32| Outward {
                touch: k as usize,
                centre: DVec3::new(along(k), along(2), 0.11),
                direction: DVec3::new(0.0, 0.0, 5.0),
            };
            let touches: Vec<Outward> = (0..5).map(touch).collect();
            assert!(orient(&points, &mut normals, &pairs, &touches, SPACING));
            for (v, normal) in normals.enumerate() {
                let side = if v.index() < sheet { 1.0 } else { expected };
                assert!(normal.unwrap().z * side > 0.0, "gap {gap}: taxel {v:?} has {normal:?}");
            }
        }
    }

    /// One touch, or two, however certain, do not tell the side; three do.
    #[test]
    fn one_touch_does_not_tell_the_side() {
        assert_eq!([side_told(6.0, 1.0), side_told(-12.0, 2.0)], [0.0, 0.0]);
        assert!(side_told(-18.0, 3.0) < -LEAST_SIGMAS);
    }
}
