//! A robot of 47 patches with about 8000 taxels moves; in every frame its links are posed anew, and 64
//! contacts are placed on the maps of all levels. Prints how long a frame takes.
//!
//! ```sh
//! cargo run --release --example frames
//! ```

use std::{f64::consts::TAU, hint::black_box, time::Instant};

use dermatome::{
    contact::{ContactIndex, Hit, Query},
    mesh::shapes,
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    skin::{Link, LinkId, Motion, MotionFrame, Patch, Skin},
};
use glam::{DAffine3, DQuat, DVec3};

const PATCHES: usize = 47;
const CONTACTS: usize = 64;
const FRAMES: usize = 2000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut skin = Skin::default();
    for k in 0..PATCHES {
        let parent = k.checked_sub(1).map(LinkId::new);
        let pose = DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.2), DVec3::Z * 0.1);
        let link = skin.links.push(Link { name: format!("link {k}"), parent, pose });
        skin.patches.push(Patch::from_mesh(format!("patch {k}"), link, shapes::cap(310, 0.05, 0.9)));
    }
    let map = build(&skin, &BuildOptions::default())?;
    let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let mut motion = Motion::default();
    for (id, link) in map.links.enumerate() {
        let turned = link.pose * DAffine3::from_rotation_z(0.3);
        motion.set(id, MotionFrame::Parent, &[(0.0, link.pose), (1.0, turned)])?;
    }
    let mut index = ContactIndex::new(&map)?;
    index.set_motion(&motion, 0.5)?;
    // Contacts up to 5 mm from the skin in the middle of the motion, which passes them by.
    let near = |k: usize| {
        let link = LinkId::new(k * PATCHES / CONTACTS);
        let turn = DQuat::from_euler(glam::EulerRot::ZXY, TAU * k as f64 / 7.0, 0.1 * (k % 6) as f64, 0.0);
        let place = turn * DVec3::NEG_Z * (0.05 + 0.001 * (k % 5) as f64);
        Query::from(index.poses()[link].transform_point3(place))
    };
    let contacts: Vec<Query> = (0..CONTACTS).map(near).collect();
    let mut hits: Vec<Option<Hit>> = vec![None; CONTACTS];
    let mut nanoseconds = Vec::new();
    let (mut placed, mut posing) = (0, Vec::new());
    for frame in 0..FRAMES {
        let start = Instant::now();
        index.set_motion(&motion, frame as f64 / FRAMES as f64)?;
        posing.push(start.elapsed().as_nanos());
        for (contact, hit) in contacts.iter().zip(&mut hits) {
            let found = index.locate(*contact)?;
            let cells = (0..).map_while(|level| index.cell(&found, LevelId::new(level)));
            placed += cells.inspect(|cell| _ = black_box(cell)).count();
            *hit = Some(found);
        }
        nanoseconds.push(start.elapsed().as_nanos());
    }
    let microseconds = |times: &mut Vec<u128>, share: usize| {
        times.sort_unstable();
        times[times.len() * share / 100] as f64 / 1e3
    };
    println!("{taxels} taxels on {PATCHES} links, {CONTACTS} contacts, {} cells a frame", placed / FRAMES);
    println!("posing: median {:.1} us", microseconds(&mut posing, 50));
    let (median, slow) = (microseconds(&mut nanoseconds, 50), microseconds(&mut nanoseconds, 99));
    println!("frame: median {median:.1} us, 99 of 100 under {slow:.1} us");
    Ok(())
}
