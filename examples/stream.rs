//! A skin that feels at 250 Hz: every frame of a stream becomes tactile images of all levels and
//! tracked contacts, and the time from the reading to the result is measured.
//!
//! ```sh
//! cargo run --release --example stream
//! ```

use std::{
    thread::sleep,
    time::{Duration, Instant},
};

use dermatome::{
    atlas::{Atlas, AtlasOptions},
    image::Renderer,
    mesh::shapes,
    pipeline,
    signal::{ContactTracker, Restrictor, TouchOptions, TouchSimulation, TrackerOptions},
    skin::Skin,
};

/// Frames per second of the stream.
const RATE: f64 = 250.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A cover of about 640 taxels, 6.5 mm apart, and a sphere that presses it five times.
    let skin = Skin::from_mesh("cover", shapes::cap(1200, 0.15, 0.6));
    let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
    let touches = TouchOptions { rate: RATE, noise: 50.0, ..TouchOptions::default() };
    let mut stream = TouchSimulation::new(&skin, &touches)?;

    // Everything that a frame needs is made once; from then on nothing is allocated.
    let channels = [stream.channel().clone()];
    let atlas = Atlas::new(&map, &AtlasOptions::default())?;
    let mut restrictor = Restrictor::new(&map, &channels);
    let mut renderer = Renderer::new(&map, &atlas, &channels, None)?;
    let mut tracker = ContactTracker::new(&map, &channels[0], &TrackerOptions::default())?;

    let start = Instant::now();
    let mut latencies = Vec::new();
    let mut pixels = 0;
    let mut regions = 0;
    while let Some((frame, _)) = stream.next_frame() {
        let due = Duration::from_secs_f64(frame.time);
        sleep(due.saturating_sub(start.elapsed()));
        let read = Instant::now();
        let images = renderer.render(restrictor.restrict(frame));
        let contacts = tracker.track(frame);
        latencies.push(read.elapsed());
        pixels = images.iter().map(|image| image.coverage.len()).sum();
        regions += contacts.len();
    }
    latencies.sort_unstable();
    println!(
        "{} frames of {} taxels, {} images of {pixels} pixels in all, {regions} contact regions",
        latencies.len(),
        skin.patches.iter().map(|patch| patch.taxels.ids.len()).sum::<usize>(),
        atlas.parts.len(),
    );
    for percent in [50, 90, 99, 100] {
        let at = (latencies.len() - 1) * percent / 100;
        println!("latency, {percent:3} %: {:6.1} microseconds", latencies[at].as_secs_f64() * 1e6);
    }
    Ok(())
}
