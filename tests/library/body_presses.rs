//! What links and levels of a body must reach, on a limb of two half shells, by presses and strokes at random.

use std::f64::consts::{PI, TAU};

use dermatome::body::{Body, FieldLevel};
use dermatome::id::{IdVec, VertexId};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::signal::{
    BodyFields, Channel, ContactTracker, EventDetector, EventOptions, Frame, Phase, Probe, Quantity,
    TrackerOptions, Word,
};
use dermatome::skin::{LinkId, Patch, PatchId, Skin};
use glam::DVec3;

/// Radius of the limb, distance of its taxels, and width of its two gaps, in m: those of a forearm of CySkin.
const RADIUS: f64 = 0.0716;
const SPACING: f64 = 0.0076;
const GAP: f64 = 0.018;

/// Two half shells of 27 x 19 taxels.
fn limb() -> SkinMap {
    let sheet = |first: f64| {
        let mut mesh = shapes::lattice(27, 19, SPACING);
        mesh.positions.iter_mut().for_each(|x| {
            let angle = first + x.x / (26.5 * SPACING) * (PI - GAP / RADIUS);
            *x = DVec3::new(RADIUS * angle.cos(), RADIUS * angle.sin(), x.y);
        });
        mesh.triangles.iter_mut().for_each(|t| {
            // Normals point away from the axis.
            let [a, b, c] = t.map(|v| mesh.positions[v]);
            if (b - a).cross(c - a).dot((a + b + c) * DVec3::new(1.0, 1.0, 0.0)) < 0.0 {
                t.swap(0, 1);
            }
        });
        mesh
    };
    let mut skin = Skin::from_mesh("front", sheet(0.0));
    let mut back = Patch::from_mesh("back", LinkId::new(0), sheet(PI));
    back.taxels.ids.iter_mut().for_each(|id| id.0 += 1000);
    skin.patches.push(back);
    build(&skin, &BuildOptions::default()).unwrap()
}

/// Numbers from 0 to 1, the same in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// The centre of a ball of this radius, pressed in by this depth where the limb has this angle and height.
fn ball(radius: f64, depth: f64, angle: f64, height: f64) -> DVec3 {
    let out = RADIUS + radius - depth;
    DVec3::new(out * angle.cos(), out * angle.sin(), height)
}

/// Pressures below balls of this radius, 20 kPa for each mm.
fn press(map: &SkinMap, radius: f64, balls: &[DVec3]) -> Frame {
    let mut frame = Frame::new(map, 1);
    for (id, patch) in map.patches.enumerate() {
        frame.values[id][0] = patch.levels[LevelId::default()]
            .level
            .mesh
            .positions
            .map(|x| 2e7 * balls.iter().map(|ball| radius - ball.distance(*x)).fold(0.0, f64::max));
    }
    frame
}

fn tracker(map: &SkinMap) -> ContactTracker {
    let options = TrackerOptions { threshold: Some(500.0), probe: Probe::Any, ..TrackerOptions::default() };
    ContactTracker::new(map, &Channel::new("pressure", "Pa").unwrap(), &options).unwrap()
}

/// The angle of the middle of the first or the second gap.
fn gap(number: usize) -> f64 {
    PI * (1 + number) as f64 - 0.5 * GAP / RADIUS
}

/// Of presses on a gap 97 % are one contact, of those that both sides feel 95 %; two balls 40 mm apart over a gap are never one.
#[test]
fn presses_on_a_gap_are_one_contact_and_two_balls_are_two() {
    let map = limb();
    let apart = SkinMap { body: Body::default(), ..map.clone() };
    let mut random = Random(7);
    let (mut one, mut on_both, mut as_one, mut pairs) = (0, 0, 0, 0);
    for k in 0..200 {
        let angle = gap(k % 2) + random.within(-0.3, 0.3) * GAP / RADIUS;
        let frame = press(&map, 0.04, &[ball(0.04, 0.004, angle, random.within(0.02, 0.1))]);
        let is_one = tracker(&map).track(&frame).len() == 1;
        one += usize::from(is_one);
        if tracker(&apart).track(&frame).len() > 1 {
            on_both += 1;
            as_one += usize::from(is_one);
        }
        let height = random.within(0.02, 0.1);
        let half = (0.02 / RADIUS).asin();
        let balls = [-half, half].map(|turn| ball(0.012, 0.003, gap(k % 2) + turn, height));
        let felt: std::collections::BTreeSet<PatchId> =
            tracker(&apart).track(&press(&map, 0.012, &balls)).iter().map(|region| region.patch).collect();
        if felt.len() == 2 {
            pairs += 1;
            assert!(tracker(&map).track(&press(&map, 0.012, &balls)).len() >= 2, "{balls:?}");
        }
    }
    assert!(on_both >= 25 && pairs >= 60, "{on_both} presses and {pairs} pairs are felt on both sides");
    assert!(one >= 194 && as_one * 100 >= on_both * 95, "{one} of 200, {as_one} of {on_both}");
}

/// A stroke over a gap is one event in 24 of 24, whatever its direction.
#[test]
fn strokes_over_a_gap_are_one_event() {
    let map = limb();
    let mut random = Random(11);
    for k in 0..24 {
        let (slope, height) = (random.within(-0.7, 0.7), random.within(0.045, 0.075));
        let side = if k % 3 == 0 { -1.0 } else { 1.0 };
        let (mut tracker, mut detector) =
            (tracker(&map), EventDetector::new(&map, EventOptions::default()).unwrap());
        let mut ended = Vec::new();
        for step in 0..70 {
            let way = 0.002 * (f64::from(step) - 35.0);
            let along =
                ball(0.02, 0.003, gap(k % 2) + side * way / RADIUS, height + slope * way.clamp(-0.04, 0.04));
            let is_on = (15..56).contains(&step);
            let mut frame = press(&map, 0.02, &[along][..usize::from(is_on)]);
            frame.time = 0.02 * f64::from(step);
            tracker.track(&frame);
            ended.extend(detector.see(frame.time, &tracker).unwrap().iter().cloned());
        }
        ended.extend(detector.finish().iter().cloned());
        ended.retain(|event| event.phase == Phase::End);
        let words: Vec<Word> = ended.iter().map(|event| event.word).collect();
        assert_eq!(words, [Word::Stroke], "stroke {k} with slope {slope}");
        assert_eq!(ended[0].contact.as_ref().unwrap().patches.len(), 2, "stroke {k}");
    }
}

/// Weights `x` with the least squares of `rows x - y`, and a little of their own.
fn fit(rows: &[Vec<f64>], y: &[f64]) -> Vec<f64> {
    let count = rows[0].len();
    let mut system = vec![vec![0.0; count + 1]; count];
    for (row, y) in rows.iter().zip(y) {
        for i in 0..count {
            (0..count).for_each(|j| system[i][j] += row[i] * row[j]);
            system[i][count] += row[i] * y;
        }
    }
    (0..count).for_each(|i| system[i][i] += 1e-9);
    for i in 0..count {
        let pivot = system[i].clone();
        for (j, row) in system.iter_mut().enumerate().filter(|(j, _)| *j != i) {
            let factor = row[i] / pivot[i];
            assert!(factor.is_finite(), "row {j}");
            row.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
        }
    }
    (0..count).map(|i| system[i][count] / system[i][i]).collect()
}

/// Median error of the place of presses, of a linear fit of features of others.
fn error_of_fit(features: &[Vec<f64>], places: &[DVec3]) -> f64 {
    let learned = features.len() * 2 / 3;
    let weights = [0, 1, 2].map(|axis| {
        let y: Vec<f64> = places[..learned].iter().map(|at| at[axis]).collect();
        fit(&features[..learned], &y)
    });
    let place = |features: &Vec<f64>| {
        let of = |axis: usize| weights[axis].iter().zip(features).map(|(w, x)| w * x).sum();
        DVec3::new(of(0), of(1), of(2))
    };
    let mut errors: Vec<f64> =
        features[learned..].iter().zip(&places[learned..]).map(|(of, at)| place(of).distance(*at)).collect();
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

/// Fields of the body keep more of where a press is than as many parts of the body: the error of a linear fit is at most 0.65
/// of theirs, on every level of six fields or more.
#[test]
fn fields_of_the_body_say_where_presses_are() {
    let map = limb();
    let mut random = Random(3);
    let mut presses = Vec::new();
    while presses.len() < 450 {
        let (angle, height) = (random.within(0.0, TAU), random.within(0.01, 0.11));
        let mut frame = press(&map, 0.015, &[ball(0.015, 0.004, angle, height)]);
        let total: f64 = frame.values.iter().flat_map(|values| values[0].iter()).sum();
        if total > 0.0 {
            frame.values.iter_mut().for_each(|values| values[0].iter_mut().for_each(|x| *x /= total));
            presses.push((frame, ball(0.0, 0.0, angle, height)));
        }
    }
    let places: Vec<DVec3> = presses.iter().map(|(_, at)| *at).collect();
    let at = |patch: PatchId, taxel: VertexId| {
        map.patches[patch].levels[LevelId::default()].level.mesh.positions[taxel]
    };
    let mut is_any = false;
    for (level, fields) in map.body.levels.enumerate().filter(|(_, fields)| fields.origins.len() >= 6) {
        is_any = true;
        let mut carry = BodyFields::new(&map);
        let mut features = Vec::new();
        for (frame, _) in &presses {
            carry.take(frame, 0, Quantity::Extensive);
            let value = |field| carry.value(level, field, Quantity::Extensive);
            features.push(fields.origins.ids().map(value).collect::<Vec<f64>>());
        }
        let centres: Vec<DVec3> =
            fields.origins.iter().map(|origin| at(origin.patch, origin.taxel)).collect();
        let nearest: IdVec<PatchId, Vec<usize>> = map.patches.map(|patch| {
            let mesh = &patch.levels[LevelId::default()].level.mesh;
            let part = |x: &DVec3| {
                let away = |k: &usize| centres[*k].distance(*x);
                (0..centres.len()).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap()
            };
            mesh.positions.iter().map(part).collect()
        });
        let parts = presses.iter().map(|(frame, _)| {
            let mut sums = vec![0.0; centres.len()];
            for (patch, parts) in nearest.enumerate() {
                parts.iter().zip(&frame.values[patch][0]).for_each(|(part, x)| sums[*part] += x);
            }
            sums
        });
        let (own, other) =
            (error_of_fit(&features, &places), error_of_fit(&parts.collect::<Vec<_>>(), &places));
        assert!(own <= 0.65 * other, "{} fields: {own} m, {other} m of a partition", centres.len());
        // The areas of its fields are those of the skin.
        let areas: f64 = map.field_areas(FieldLevel { modality: None, level }).iter().sum();
        let skin: f64 = map.patches.iter().flat_map(|patch| patch.taxels.areas.iter()).sum();
        assert!((areas / skin - 1.0).abs() < 1e-12, "{areas} of {skin}");
    }
    assert!(is_any, "a level of six fields");
}
