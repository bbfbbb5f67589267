//! Laws of a body: what joins patches, and what does not.

use dermatome::body::{Body, BodyTaxel, Gap, gap_links};
use dermatome::id::VertexId;
use dermatome::io::{map_from_bytes, map_to_bytes};
use dermatome::map::{MapError, SkinMap};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::signal::{
    BodyFields, Channel, ContactRegion, ContactTracker, Event, EventDetector, EventOptions, Frame, Phase,
    Probe, Quantity, Restrictor, TrackerOptions, Word,
};
use dermatome::skin::{Link, LinkId, Patch, PatchId, Presence, Skin};
use glam::{DAffine3, DQuat, DVec3};

/// Distance of taxels, in m.
const SPACING: f64 = 0.005;

fn sheet(columns: u32, rows: u32, at: DVec3) -> TriMesh {
    let mut mesh = shapes::lattice(columns, rows, SPACING);
    mesh.positions.iter_mut().for_each(|x| *x += at);
    mesh
}

/// A skin of these sheets, each on the link of that number, which hangs from the one that is named.
fn skin(parents: &[Option<usize>], sheets: Vec<(usize, TriMesh)>) -> Skin {
    let mut skin = Skin::default();
    for (number, parent) in parents.iter().enumerate() {
        let link =
            Link { name: format!("l{number}"), parent: parent.map(LinkId::new), pose: DAffine3::IDENTITY };
        skin.links.push(link);
    }
    for (number, (link, mesh)) in sheets.into_iter().enumerate() {
        skin.patches.push(Patch::from_mesh(format!("p{number}"), LinkId::new(link), mesh));
    }
    skin
}

/// Two sheets of 6 x 5 and 6 x 5 taxels with this gap between them, on one link.
pub(crate) fn gapped(gap: f64) -> Skin {
    let right = sheet(6, 5, DVec3::X * (5.0 * SPACING + gap));
    skin(&[None], vec![(0, sheet(6, 5, DVec3::ZERO)), (0, right)])
}

fn gaps(skin: &Skin) -> Vec<Gap> {
    Body { links: gap_links(skin, None), ..Body::default() }.gaps(skin)
}

/// Links lead over the gap alone, from rim to rim, and are as long as it is wide.
#[test]
fn taxels_that_face_each_other_over_a_gap_are_linked() {
    let skin = gapped(0.012);
    let links = gap_links(&skin, None);
    assert!(links.len() > 2 && links.is_sorted() && links.iter().all(|[a, b]| a < b));
    for ends in &links {
        let x = ends.map(|end| skin.patches[end.patch].mesh.positions[end.taxel].x);
        assert!(x[1] > x[0] && x[1] - x[0] < 0.0175, "{x:?}");
    }
    let [gap] = gaps(&skin)[..] else { panic!("one gap") };
    assert_eq!((gap.patches, gap.links), ([0, 1].map(PatchId::new), links.len()));
}

#[test]
fn gaps_have_a_widest_that_is_given_or_a_few_spacings() {
    assert!(!gap_links(&gapped(0.016), None).is_empty());
    assert!(gap_links(&gapped(0.025), None).is_empty());
    assert!(!gap_links(&gapped(0.025), Some(0.03)).is_empty());
    assert!(gap_links(&gapped(0.012), Some(0.0104)).is_empty());
    assert!(gap_links(&gapped(0.012), Some(0.0)).is_empty());
    assert!(gap_links(&gapped(0.012), Some(f64::NAN)).is_empty());
}

/// Links are over joints, also over links without skin, but not from finger to finger; without a tree all are joined.
#[test]
fn links_lead_over_joints_and_not_between_fingers() {
    let next = |number: usize| sheet(6, 5, DVec3::X * number as f64 * (5.0 * SPACING + 0.01));
    let sheets = |links: [usize; 2]| links.into_iter().enumerate().map(|(k, link)| (link, next(k))).collect();
    let is_linked = |parents: &[Option<usize>], links: [usize; 2]| {
        !gap_links(&skin(parents, sheets(links)), None).is_empty()
    };
    assert!(is_linked(&[None, Some(0)], [0, 1]), "a joint");
    assert!(is_linked(&[None, Some(0), Some(1)], [0, 2]), "a link without skin");
    assert!(is_linked(&[None, None], [0, 1]), "no tree");
    let fingers = [(0, sheet(6, 5, DVec3::Y)), (1, next(0)), (2, next(1))];
    assert!(
        gap_links(&skin(&[None, Some(0), Some(0)], fingers.into()), None).is_empty(),
        "two fingers of a palm"
    );
    // A bare palm joins what it carries, whatever a link above it has.
    for forearm in [false, true] {
        let mut parts = vec![(2, next(0)), (3, next(1))];
        if forearm {
            parts.insert(0, (0, sheet(6, 5, DVec3::Y)));
        }
        let links = gap_links(&skin(&[None, Some(0), Some(1), Some(1)], parts), None);
        assert!(!links.is_empty(), "over a bare palm");
    }
}

/// Layers, sheets back to back and steps are no gaps.
#[test]
fn layers_and_edges_are_no_gaps() {
    let flipped = |mut mesh: TriMesh| {
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        mesh
    };
    for height in [1e-4, 0.001] {
        let up = DVec3::Z * height;
        for shift in [DVec3::ZERO, DVec3::new(0.3, 0.2, 0.0) * SPACING] {
            let layers = skin(&[None], vec![(0, sheet(8, 8, DVec3::ZERO)), (0, sheet(8, 8, up + shift))]);
            let inner = |end: &BodyTaxel| {
                let at = layers.patches[end.patch].mesh.positions[end.taxel];
                (at.truncate() - glam::DVec2::splat(3.5 * SPACING)).abs().max_element() < 2.6 * SPACING
            };
            let links = gap_links(&layers, None);
            assert!(
                !links.iter().any(|ends| ends.iter().all(inner)),
                "{} links at {up} {shift}",
                links.len()
            );
        }
    }
    let back = flipped(sheet(6, 5, DVec3::X * (5.0 * SPACING + 0.01)));
    assert!(gap_links(&skin(&[None], vec![(0, sheet(6, 5, DVec3::ZERO)), (0, back)]), None).is_empty());
    let step = sheet(6, 5, DVec3::new(5.0 * SPACING + 0.005, 0.0, 0.01));
    assert!(gap_links(&skin(&[None], vec![(0, sheet(6, 5, DVec3::ZERO)), (0, step)]), None).is_empty());
}

/// The links do not depend on where the skin is, nor on the frames of its links.
#[test]
fn links_are_those_of_any_frame() {
    let still = gapped(0.012);
    let mut moved = still.clone();
    let pose = DAffine3::from_rotation_translation(DQuat::from_rotation_y(1.0), DVec3::new(1.0, -2.0, 0.5));
    moved.links.iter_mut().for_each(|link| link.pose = pose);
    assert_eq!(gap_links(&moved, None), gap_links(&still, None));
}

/// A sheet of 30 x 21 taxels without those for which `is_out`.
fn cut_out(is_out: impl Fn(u32, u32) -> bool) -> Skin {
    let whole = shapes::lattice(30, 21, SPACING);
    let is_in = |v: &VertexId| !is_out(v.raw() % 30, v.raw() / 30);
    let mut mesh = TriMesh::default();
    let numbers: Vec<VertexId> = whole
        .positions
        .enumerate()
        .map(|(v, &at)| if is_in(&v) { mesh.positions.push(at) } else { VertexId::default() })
        .collect();
    let kept = whole.triangles.iter().filter(|corners| corners.iter().all(is_in));
    mesh.triangles = kept.map(|corners| corners.map(|v| numbers[v.index()])).collect();
    Skin::from_mesh("sheet", mesh)
}

/// A slit that ends at both sides has links from rim to rim and is a gap of the patch with itself; a press on it is one contact. Slits
/// that are open at an end, as those between fingers, and round holes have none.
#[test]
fn slits_of_one_patch_are_linked_and_fingers_are_not() {
    let slit = cut_out(|x, y| y == 10 && (8..22).contains(&x));
    let links = gap_links(&slit, None);
    let mesh = &slit.patches[PatchId::new(0)].mesh;
    assert!(links.len() >= 14, "{} links", links.len());
    for ends in &links {
        let y = ends.map(|end| mesh.positions[end.taxel].y);
        assert!((y[0] - y[1]).abs() > 1.5 * SPACING, "{y:?}");
    }
    assert!(gap_links(&slit, Some(0.0)).is_empty() && gap_links(&slit, Some(0.006)).is_empty());
    let [gap] = gaps(&slit)[..] else { panic!("one gap") };
    assert_eq!((gap.patches, gap.links), ([PatchId::new(0); 2], links.len()));
    for (name, other) in [
        ("open at an end", cut_out(|x, y| y == 10 && x >= 8)),
        ("fingers", cut_out(|x, y| y % 4 == 3 && x >= 8)),
        ("a round hole", cut_out(|x, y| (12..17).contains(&x) && (8..13).contains(&y))),
    ] {
        assert!(gaps(&other).is_empty(), "{name}: {:?}", gaps(&other));
    }
    let map = build(&slit, &BuildOptions::default()).unwrap();
    assert_eq!(map.body.links, links);
    assert_eq!(map_from_bytes(map_to_bytes(&map).unwrap()).unwrap().body, map.body);
    let rim = mesh.positions[links[links.len() / 2][0].taxel];
    let ball = DVec3::new(rim.x, 0.5 * (rim.y + mesh.positions[links[links.len() / 2][1].taxel].y), 0.0);
    let apart = SkinMap { body: Body::default(), ..map.clone() };
    let count = |map: &SkinMap| tracker(map, Probe::Any).track(&pressed(map, &[ball], 0.014)).len();
    assert_eq!([count(&map), count(&apart)], [1, 2]);
}

/// Rims of one sheet that face each other, as those of a sleeve that is open along a line or of fingers, have no links.
#[test]
fn one_patch_has_no_links() {
    let radius = (39.0 * SPACING + 0.01) / std::f64::consts::TAU;
    let mut sleeve = shapes::lattice(40, 9, SPACING);
    sleeve.positions.iter_mut().for_each(|x| {
        let angle = x.x / radius;
        *x = DVec3::new(radius * angle.sin(), x.y, -radius * angle.cos());
    });
    for mesh in [sleeve, shapes::lattice(12, 12, SPACING), shapes::frame(2, 4, SPACING)] {
        assert!(gaps(&Skin::from_mesh("whole", mesh)).is_empty());
    }
}

/// Files keep links; a map of one patch has none of it, and one without links is valid.
#[test]
fn files_keep_links_and_refuse_wrong_ones() {
    let map = build(&gapped(0.012), &BuildOptions::default()).unwrap();
    assert!(!map.body.links.is_empty());
    let bytes = map_to_bytes(&map).unwrap();
    assert_eq!(map_from_bytes(bytes).unwrap().body.links, map.body.links);
    let old = SkinMap { body: Body::default(), ..map.clone() };
    let old = map_from_bytes(map_to_bytes(&old).unwrap()).unwrap();
    assert!(old.gaps().is_empty());
    let none = build(&gapped(0.012), &BuildOptions { across: Some(0.0), ..BuildOptions::default() }).unwrap();
    assert!(none.body.links.is_empty());
    let one = build(&Skin::from_mesh("one", shapes::cap(300, 0.1, 0.6)), &BuildOptions::default()).unwrap();
    assert_eq!(one.body, Body::default());
    let [first, ..] = map.body.links[..] else { unreachable!() };
    for links in [
        vec![[first[1], first[0]]],
        vec![first, first],
        vec![[first[0], BodyTaxel { patch: PatchId::new(2), ..first[1] }]],
    ] {
        let body = Body { links, ..Body::default() };
        let wrong = SkinMap { body, ..map.clone() };
        assert!(matches!(wrong.validate(), Err(MapError::GapLink { .. })));
    }
}

/// Pressures of balls of this radius pressed in by a fifth of it, 20 kPa a mm, at these places of the world.
fn pressed(map: &SkinMap, balls: &[DVec3], radius: f64) -> Frame {
    let (mut frame, skin) = (Frame::new(map, 1), map.skin());
    for (id, patch) in skin.patches.enumerate() {
        let pose = dermatome::skin::world_pose(&skin.links, patch.link);
        frame.values[id][0] = patch.mesh.positions.map(|&x| {
            let x = pose.transform_point3(x);
            let depth = |at: &DVec3| radius - x.distance(*at + DVec3::Z * 0.8 * radius);
            2e7 * balls.iter().map(depth).fold(0.0, f64::max)
        });
    }
    frame
}

fn tracker(map: &SkinMap, probe: Probe) -> ContactTracker {
    let options =
        TrackerOptions { threshold: Some(500.0), probe, low: probe.low(), ..TrackerOptions::default() };
    ContactTracker::new(map, &Channel::new("pressure", "Pa").unwrap(), &options).unwrap()
}

/// The middle of the gap of [`gapped`].
fn middle(gap: f64) -> DVec3 {
    DVec3::new(5.0 * SPACING + 0.5 * gap, 2.0 * SPACING, 0.0)
}

/// A press over a gap is one contact on two patches, with the force and the area of both; two balls are two.
#[test]
fn a_press_over_a_gap_is_one_contact() {
    let skin = gapped(0.01);
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let apart = SkinMap { body: Body::default(), ..map.clone() };
    for shift in [-0.004, 0.0, 0.003] {
        let frame = pressed(&map, &[middle(0.01) + DVec3::X * shift], 0.02);
        let found = tracker(&map, Probe::Any).track(&frame).to_vec();
        let [one] = &found[..] else { panic!("{found:?}") };
        let two = tracker(&apart, Probe::Any).track(&frame).to_vec();
        assert_eq!((two.len(), one.patches().len()), (2, 2));
        let sum = |of: fn(&ContactRegion) -> f64| two.iter().map(of).sum::<f64>();
        assert!((one.force / sum(|r| r.force) - 1.0).abs() < 1e-12);
        assert!((one.area / sum(|r| r.area) - 1.0).abs() < 1e-12);
        let main = two.iter().max_by(|a, b| a.force.total_cmp(&b.force)).unwrap();
        if shift != 0.0 {
            assert_eq!((one.patch, &one.taxels, one.peak_taxel), (main.patch, &main.taxels, main.peak_taxel));
        }
        let taxels = |r: &ContactRegion| r.all_taxels().collect::<std::collections::BTreeSet<_>>();
        assert_eq!(taxels(one), two.iter().flat_map(taxels).collect());
    }
    let balls = [-1.0, 1.0].map(|side| middle(0.01) + DVec3::X * side * 0.02);
    assert_eq!(tracker(&map, Probe::Any).track(&pressed(&map, &balls, 0.01)).len(), 2, "40 mm apart");
    let fingers = [-1.0, 1.0].map(|side| middle(0.01) + DVec3::X * side * 0.0125);
    for (count, balls) in [(1, &[middle(0.01)][..]), (2, &fingers[..])] {
        let mut tracker = tracker(&map, Probe::Finger);
        let mut frame = pressed(&map, balls, 0.014);
        for k in 0..20 {
            frame.time = 0.05 * f64::from(k);
            tracker.track(&frame);
        }
        assert_eq!(tracker.contacts().len(), count, "fingers");
    }
}

/// A dead taxel at the rim does not divide a contact over the gap.
#[test]
fn dead_taxels_at_a_gap_join_as_anywhere() {
    let map = build(&gapped(0.01), &BuildOptions::default()).unwrap();
    let mut frame = pressed(&map, &[middle(0.01)], 0.02);
    for ends in &map.body.links {
        frame.values[ends[0].patch][0][ends[0].taxel] = f64::NAN;
    }
    let found = tracker(&map, Probe::Any).track(&frame).to_vec();
    assert_eq!(found.len(), 1, "{found:?}");
}

/// The event that ends, of a ball that is moved along x at 0.1 m/s, from 30 mm before the middle to 30 mm behind it.
fn stroke(map: &SkinMap, at: DVec3) -> Vec<Event> {
    let (mut tracker, mut detector) =
        (tracker(map, Probe::Any), EventDetector::new(map, EventOptions::default()).unwrap());
    let mut events = Vec::new();
    for k in 0..80 {
        let x = -0.03 + 0.001 * f64::from(k - 10);
        let balls = [at + DVec3::X * x];
        let mut frame = pressed(map, &balls[..usize::from((10..70).contains(&k))], 0.02);
        frame.time = 0.01 * f64::from(k);
        tracker.track(&frame);
        events.extend(detector.see(frame.time, &tracker).unwrap().iter().cloned());
    }
    events.extend(detector.finish().iter().cloned());
    events.retain(|event| event.phase == Phase::End);
    events
}

/// A stroke over a gap, and over a joint between links with other frames, is one event with a path along the body.
#[test]
fn strokes_go_on_over_gaps() {
    let gap = 0.012;
    let mut skin = gapped(gap);
    let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_z(2.0), DVec3::new(0.3, 0.1, -0.2));
    let hand = Link { name: "hand".into(), parent: Some(LinkId::new(0)), pose: turned };
    let flat = build(&skin, &BuildOptions::default()).unwrap();
    let link = skin.links.push(hand);
    let right = PatchId::new(1);
    let mesh = TriMesh {
        positions: skin.patches[right].mesh.positions.map(|&x| turned.inverse().transform_point3(x)),
        ..skin.patches[right].mesh.clone()
    };
    skin.patches[right] = Patch::from_mesh("p1", link, mesh);
    let jointed = build(&skin, &BuildOptions::default()).unwrap();
    for map in [flat, jointed] {
        let events = stroke(&map, middle(gap));
        let [event] = &events[..] else { panic!("{events:?}") };
        assert_eq!(event.word, Word::Stroke);
        let contact = event.contact.as_ref().unwrap();
        assert_eq!(contact.patches, [0, 1].map(PatchId::new));
        assert_eq!((contact.from.patch, contact.to.patch), (PatchId::new(0), right));
        assert!(contact.direction.is_none());
        assert!((contact.length - 0.05).abs() < 0.012, "{} m", contact.length);
        let end = contact.to.point;
        let pose = dermatome::skin::world_pose(&map.links, map.patches[right].link);
        let end = pose.transform_point3(end);
        assert!((end.x - middle(gap).x - 0.025).abs() < 0.006 && (end.y - 0.01).abs() < 1e-3, "{end}");
    }
}

/// A body of a large sheet and four smaller ones, on three links; the last two are far from the others.
fn patchwork() -> Skin {
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    skin(
        &[None, Some(0), Some(1)],
        vec![
            (0, sheet(24, 20, at(0.0, 0.0))),
            (0, sheet(12, 10, at(0.127, 0.0))),
            (1, sheet(10, 16, at(0.127, 0.06))),
            (2, sheet(9, 9, at(0.5, 0.0))),
            (2, sheet(5, 24, at(0.6, 0.3))),
        ],
    )
}

/// Forces and areas are kept on every level down to one field, also with dead taxels, and an even pressure is even.
#[test]
fn body_levels_keep_sums_down_to_one_field() {
    let map = build(&patchwork(), &BuildOptions::default()).unwrap();
    let levels = &map.body.levels;
    let sizes: Vec<usize> = levels.iter().map(|level| level.origins.len()).collect();
    assert!(sizes.len() > 1 && sizes.is_sorted_by(|a, b| a > b) && *sizes.last().unwrap() == 1, "{sizes:?}");
    let rows = map.body_rows();
    for of_patches in &rows.0 {
        for row in of_patches.iter().flat_map(|rows| &rows.weights) {
            assert!(
                (row.iter().sum::<f64>() - 1.0).abs() < 1e-14 && row.iter().all(|w| *w >= 0.0),
                "{row:?}"
            );
        }
    }
    let mut frame = Frame::new(&map, 1);
    let mut number = 0_u32;
    for values in frame.values.iter_mut() {
        for x in values[0].iter_mut() {
            number += 1;
            *x = if number % 7 == 3 { f64::NAN } else { f64::from(number * 37 % 101) };
        }
    }
    let mut fields = BodyFields::new(&map);
    let total: f64 = frame.values.iter().flat_map(|values| values[0].iter()).filter(|x| !x.is_nan()).sum();
    fields.take(&frame, 0, Quantity::Extensive);
    for (level, count) in fields.sizes().enumerate() {
        let sum: f64 = (0..*count)
            .map(|k| fields.value(level, VertexId::new(k), Quantity::Extensive))
            .filter(|x| !x.is_nan())
            .sum();
        assert!((sum / total - 1.0).abs() < 1e-12, "{level:?}: {sum} of {total}");
    }
    frame
        .values
        .iter_mut()
        .for_each(|values| values[0].iter_mut().filter(|x| !x.is_nan()).for_each(|x| *x = 2.5));
    let mut restrictor = Restrictor::new(&map, &[Channel::default()]);
    let carried = restrictor.restrict(&frame);
    assert!(carried.body[0].iter().flat_map(|level| level.iter()).all(|x| (x - 2.5).abs() < 1e-12));
    frame.values.iter_mut().for_each(|values| values[0].iter_mut().for_each(|x| *x = f64::NAN));
    assert!(restrictor.restrict(&frame).body[0].iter().flat_map(|level| level.iter()).all(|x| x.is_nan()));
}

/// A patch whose taxels are all dead takes no part: fields that have others are those of these, its own have no value, and a
/// press on the other side of its gap is one contact.
#[test]
fn dead_patches_have_no_value() {
    let mut skin = gapped(0.01);
    skin.patches[PatchId::new(1)].taxels.presence.iter_mut().for_each(|of| *of = Presence::Absent);
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let mut frame = Frame::new(&map, 1);
    frame.values[PatchId::new(0)][0].iter_mut().for_each(|x| *x = 3.0);
    let mut restrictor = Restrictor::new(&map, &[Channel::default()]);
    let body = &restrictor.restrict(&frame).body[0];
    assert!(body.iter().flatten().all(|x| x.is_nan() || (x - 3.0).abs() < 1e-12));
    assert!(body.iter().last().unwrap().iter().all(|x| (x - 3.0).abs() < 1e-12), "the one field of all");
    let mut frame = pressed(&map, &[middle(0.01)], 0.02);
    frame.values[PatchId::new(1)][0].iter_mut().for_each(|x| *x = f64::NAN);
    assert_eq!(tracker(&map, Probe::Any).track(&frame).len(), 1);
}

/// Rows keep the places of fields well inside of the body: a place is interpolated better than by its nearest centre.
#[test]
fn body_rows_keep_places() {
    let map = build(&patchwork(), &BuildOptions::default()).unwrap();
    let rows = map.body_rows();
    let level = LevelId::new(0);
    let at = |end: BodyTaxel| map.patches[end.patch].levels[LevelId::new(0)].level.mesh.positions[end.taxel];
    let origins = &map.body.levels[level].origins;
    let (mut by_rows, mut by_nearest) = (0.0, 0.0);
    for (patch, rows) in rows.0[level].enumerate() {
        for taxel in rows.indices.ids() {
            let own = at(BodyTaxel { patch, taxel });
            let place: DVec3 = rows.row(taxel).map(|(field, w)| w * at(origins[field])).sum();
            let nearest = origins.iter().map(|&o| at(o).distance(own)).fold(f64::INFINITY, f64::min);
            (by_rows, by_nearest) = (by_rows + place.distance(own), by_nearest + nearest);
        }
    }
    assert!(by_rows < 0.6 * by_nearest, "{by_rows} {by_nearest}");
}

/// Thousands of patches of few taxels, patches at one place, and a patch called `body`.
#[test]
fn body_levels_of_odd_skins_end_in_one_field() {
    let many =
        (0..1200).map(|k| (0, sheet(2, 2, DVec3::new(f64::from(k % 40), f64::from(k / 40), 0.0) * 0.012)));
    let same = (0..3).map(|_| (0, sheet(6, 6, DVec3::ZERO)));
    for sheets in [many.collect::<Vec<_>>(), same.collect()] {
        let map = SkinMap::of_taxels(&skin(&[None], sheets));
        let coarsest = map.patches.iter().map(|patch| &patch.levels[LevelId::new(0)].level).collect();
        let skin = map.skin();
        let levels = dermatome::body::body_levels(&skin, &gap_links(&skin, None), &coarsest);
        assert_eq!(levels.iter().last().unwrap().origins.len(), 1);
    }
    let mut named = gapped(0.01);
    named.patches[PatchId::new(0)].name = "body".into();
    let map = build(&named, &BuildOptions::default()).unwrap();
    assert_eq!(map_from_bytes(map_to_bytes(&map).unwrap()).unwrap().body.levels.len(), map.body.levels.len());
}

/// Files keep body levels and refuse those that do not fit; levels have the same centres and rows up to `f32`.
#[test]
fn files_keep_body_levels() {
    let map = build(&patchwork(), &BuildOptions::default()).unwrap();
    let read = map_from_bytes(map_to_bytes(&map).unwrap()).unwrap();
    for (a, b) in map.body.levels.iter().zip(&read.body.levels) {
        assert_eq!((&a.origins, &a.rows.indices), (&b.origins, &b.rows.indices));
        let near = |(a, b): (&[f64; 3], &[f64; 3])| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-7);
        assert!(a.rows.weights.iter().zip(&b.rows.weights).all(near));
    }
    let mut wrong = map.clone();
    let first = wrong.body.levels.iter_mut().next().unwrap();
    first.rows.weights.as_mut_slice()[0] = [2.0, 0.0, 0.0];
    assert!(matches!(wrong.validate(), Err(MapError::BodyLevel { .. })));
    let mut wrong = map.clone();
    wrong.body.levels = wrong.body.levels.iter().skip(1).cloned().collect();
    assert!(matches!(wrong.validate(), Err(MapError::BodyLevel { .. })));
}
