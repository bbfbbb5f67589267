//! How near a moving arm comes to the skin of the other links, in every frame of a millisecond.
//!
//! ```sh
//! cargo run --release --example self_collision          # from the folder of the repository
//! ```

use std::{path::Path, time::Instant};

use dermatome::{
    contact::{ContactIndex, IndexOptions, Query},
    io::read_draft,
    pipeline::{BuildOptions, build},
    skin::{AssembleOptions, Motion, MotionFrame, assemble},
};
use glam::{DAffine3, DVec3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let skin = assemble(&read_draft(Path::new("meshes/robot.glb"))?, &AssembleOptions::default())?.skin;
    let map = build(&skin, &BuildOptions::default())?;
    let mut index = ContactIndex::with_options(&map, &IndexOptions { reactive: true, fields: false })?;
    let (arm, link) = map.links.enumerate().find(|(_, link)| link.name == "forearm").ok_or("no forearm")?;
    let turned = |time: f64| (time, link.pose * DAffine3::from_rotation_y(1.5 * time));
    let mut motion = Motion::default();
    motion.set(arm, MotionFrame::Parent, &[turned(0.0), turned(0.5), turned(1.0)])?;
    let on_arm = skin.patches.iter().filter(|patch| patch.link == arm);
    let taxels: Vec<DVec3> = on_arm.flat_map(|patch| patch.mesh.positions.as_slice().to_vec()).collect();
    let mut others: Vec<_> =
        skin.patches.iter().map(|patch| patch.link).filter(|other| *other != arm).collect();
    others.dedup();
    for frame in 0..=1000 {
        let start = Instant::now();
        index.set_motion(&motion, 0.001 * f64::from(frame))?;
        let mut margin = [f64::INFINITY; 2];
        for (&point, &other) in taxels.iter().flat_map(|taxel| others.iter().map(move |other| (taxel, other)))
        {
            let answer = index.reactive(Query { point, link: Some(arm), only_link: Some(other) })?;
            margin = [margin[0].min(answer.least), margin[1].min(answer.most)];
        }
        if frame % 100 == 0 {
            let ([least, most], us) = (margin.map(|x| 1e3 * x), start.elapsed().as_micros());
            println!("{frame:4} ms: {least:.1} to {most:.1} mm for {} taxels, in {us} us", taxels.len());
        }
    }
    Ok(())
}
