//! A robot of 47 patches with about 8000 taxels, posed anew in every frame: contacts are answered on
//! all levels without an allocation.

use dermatome::contact::{ContactIndex, Query};
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::skin::{LinkId, Motion, MotionFrame, Skin};
use glam::{DAffine3, DQuat, DVec3};

use super::{REACTIVE, skin_of};

const PATCHES: usize = 47;

fn robot() -> Skin {
    let pose = DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.2), DVec3::Z * 0.1);
    let mut skin = skin_of((0..PATCHES).map(|_| (shapes::cap(310, 0.05, 0.9), pose)));
    for k in 1..PATCHES {
        skin.links[LinkId::new(k)].parent = Some(LinkId::new(k - 1));
    }
    skin
}

#[test]
fn frames_of_contacts_allocate_nothing() {
    let map = build(&robot(), &BuildOptions::default()).unwrap();
    let taxels: usize = map.patches.iter().map(|p| p.taxels.ids.len()).sum();
    assert!((7000..9000).contains(&taxels), "{taxels} taxels");
    let mut index = ContactIndex::with_options(&map, &REACTIVE).unwrap();
    let mut motion = Motion::default();
    for (id, link) in map.links.enumerate() {
        let turned = link.pose * DAffine3::from_rotation_z(0.3);
        motion.set(id, MotionFrame::Parent, &[(0.0, link.pose), (1.0, turned)]).unwrap();
    }
    let (mut sum, mut cells) = (0.0, 0);
    let mut frame = |time: f64| {
        index.set_motion(&motion, time).unwrap();
        for k in 0..64 {
            let at = DVec3::new((0.7 * k as f64).sin(), (1.1 * k as f64).cos(), 0.05 * k as f64) * 0.3;
            let hit = index.locate(Query::from(at)).unwrap();
            cells += (0..).map_while(|k| index.cell(&hit, LevelId::new(k))).count();
            sum += hit.distance + index.reactive(at).unwrap().distance;
        }
    };
    frame(0.0);
    let allocations = allocation_counter::measure(|| (1..20).for_each(|k| frame(f64::from(k) / 20.0)));
    assert_eq!(allocations.count_total, 0, "in 19 frames of 64 contacts");
    assert!(cells > 64 * 20 && sum.is_finite());
}

/// A clone that moves shares the trees: it allocates less than the positions of its vertices take.
#[test]
fn clones_share_their_trees() {
    let map = build(&robot(), &BuildOptions::default()).unwrap();
    let taxels: u64 = map.patches.iter().map(|p| p.taxels.ids.len() as u64).sum();
    let index = ContactIndex::with_options(&map, &REACTIVE).unwrap();
    let cloned = allocation_counter::measure(|| {
        let mut moved = index.clone();
        moved.set_motion(&Motion::default(), 0.0).unwrap();
    });
    assert!(cloned.bytes_total < taxels * 24, "{} bytes for {taxels} taxels", cloned.bytes_total);
}
