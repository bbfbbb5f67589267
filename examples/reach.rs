//! A robot swings its arm past a ball: in every frame the links are posed, an interval of the distance is read
//! first, and only when the ball may touch the skin is searched exactly. What touches
//! becomes forces on taxels, and the touched cells light up on the map.
//!
//! ```sh
//! cargo run --release --example reach          # from the folder of the repository; writes reach.png
//! ```

use std::path::Path;

use dermatome::{
    contact::{ContactIndex, IndexOptions},
    io::read_draft,
    pipeline,
    plot::{PlotOptions, Viewpoint, plot_frame},
    pyramid::LevelId,
    signal::{Channel, Press, Restrictor, Spreader},
    skin::{AssembleOptions, LinkId, Motion, MotionFrame, PatchId, assemble},
};
use glam::{DAffine3, DQuat};

/// The ball, in m, and how stiff it is, in N/m.
const RADIUS: f64 = 0.02;
const STIFFNESS: f64 = 2000.0;
/// How deep it is pressed in at most, in m, and the length of the swing, in frames.
const DEPTH: f64 = 0.002;
const FRAMES: u32 = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let draft = read_draft(Path::new("meshes/robot.glb"))?;
    let skin = assemble(&draft, &AssembleOptions::default())?.skin;
    let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
    let mut index = ContactIndex::with_options(&map, &IndexOptions { reactive: true, fields: true })?;

    // The forearm turns about its elbow and passes its pose in the file after half a second.
    let forearm = map.links.enumerate().find(|(_, link)| link.name == "forearm");
    let (forearm, link) = forearm.ok_or("the robot has a forearm")?;
    let turned = |angle: f64| (0.5 + angle, link.pose * DAffine3::from_quat(DQuat::from_rotation_y(angle)));
    let mut motion = Motion::default();
    motion.set(forearm, MotionFrame::Parent, &[turned(-0.5), turned(0.0), turned(0.5)])?;

    // The ball is where the pad will be.
    let (pad, patch) = map.patches.enumerate().next_back().ok_or("the robot has patches")?;
    let ball = {
        let positions = &patch.levels[LevelId::new(0)].level.mesh.positions;
        let taxel = positions.ids().nth(positions.len() / 4).ok_or("the pad has taxels")?;
        index.set_motion(&motion, 0.5)?;
        let pose = index.poses()[forearm];
        pose.transform_point3(positions[taxel])
            + pose.transform_vector3(patch.taxels.normals[taxel]) * (RADIUS - DEPTH)
    };

    let spreader = Spreader { disc: 0.002, max_distance: None };
    let channels = [Channel::new("force", "N")?];
    let (mut asked, mut located, mut strongest) = (0, 0, (0.0, spreader.frame(&index, 0.0)));
    for k in 0..=FRAMES {
        let time = f64::from(k) / f64::from(FRAMES);
        index.set_motion(&motion, time)?;
        asked += 1;
        let first = index.reactive(ball)?;
        if first.is_within(RADIUS) == Some(false) {
            continue;
        }
        located += 1;
        let hit = index.locate(ball)?;
        let depth = RADIUS - hit.distance;
        if depth <= 0.0 {
            continue;
        }
        let press = Press { at: ball.into(), radius: RADIUS, force: STIFFNESS * depth };
        let mut frame = spreader.frame(&index, time);
        spreader.add(&index, &press, &mut frame)?;
        let cell = index.cell(&hit, LevelId::new(0)).ok_or("level 0 has a cell")?;
        if strongest.0 == 0.0 {
            let [least, most, fine] = [first.least, first.most, hit.distance].map(|x| 1e3 * x);
            println!(
                "first touch at {time:.3} s, of {} on {}",
                patch_name(&map, hit.patch),
                link_name(&map, hit.link)
            );
            println!("  the skin is {least:.2} to {most:.2} mm away");
            println!("  exactly {fine:.2} mm; taxel {} at {:.1} mm on the map", cell.taxel, 1e3 * cell.uv);
        }
        if press.force > strongest.0 {
            strongest = (press.force, frame);
        }
    }
    println!("{asked} frames, {located} refined; the strongest press is {:.2} N", strongest.0);

    let mut restrictor = Restrictor::new(&map, &channels);
    let frame = restrictor.restrict(&strongest.1);
    let levels = (0..map.patches[pad].levels.len()).map(LevelId::new).collect();
    let options = PlotOptions {
        patches: vec![patch.name.clone()],
        levels,
        space: Some(Viewpoint::Outside),
        width_px: 1000,
        ..PlotOptions::default()
    };
    std::fs::write("reach.png", plot_frame(&map, frame, &channels, 0, &options)?.to_png()?)?;
    println!("wrote reach.png: the touched taxels and fields of {}", patch.name);
    Ok(())
}

fn patch_name(map: &dermatome::map::SkinMap, patch: PatchId) -> &str {
    &map.patches[patch].name
}

fn link_name(map: &dermatome::map::SkinMap, link: LinkId) -> &str {
    &map.links[link].name
}
