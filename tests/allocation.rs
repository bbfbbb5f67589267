//! The steady state allocates nothing: every step of a live stream, for frames that change as a whole,
//! in part or not at all.

use dermatome::atlas::{Atlas, AtlasOptions};
use dermatome::id::VertexId;
use dermatome::image::{Interpolation, RenderOptions, Renderer};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::signal::{
    Channel, ConditionOptions, Conditioner, ContactTracker, Contrast, Edges, Frame, Quantity, Restrictor,
    TouchOptions, TouchSimulation, TrackerOptions,
};
use dermatome::skin::{LinkId, Patch, PatchId, Skin};

fn skin() -> Skin {
    let mut skin = Skin::from_mesh("palm", shapes::cap(600, 0.05, 0.9));
    skin.patches.push(Patch::from_mesh("back", LinkId::new(0), shapes::cap(200, 0.03, 1.0)));
    skin
}

fn allocations(work: impl FnOnce()) -> u64 {
    allocation_counter::measure(work).count_total
}

/// What the counter says of nothing and of something, for the other tests to mean anything.
#[test]
fn allocations_are_counted() {
    assert_eq!(allocations(|| ()), 0);
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 1);
}

/// A recording of touches with noise, twice: what the first time has made room for is enough for the
/// second. Frames of noise change every taxel.
#[test]
fn whole_frames_allocate_nothing() {
    let skin = skin();
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let touches = TouchOptions {
        presses: 4,
        touches: 2,
        rate: 40.0,
        noise: 100.0,
        dead: 0.05,
        ..TouchOptions::default()
    };
    stream(&map, &skin, &touches);
}

/// Without noise only the touched taxels change, and in a pause none does.
#[test]
fn partial_changes_allocate_nothing() {
    let skin = skin();
    let map = build(&skin, &BuildOptions::default()).unwrap();
    for quantity in [Quantity::Intensive, Quantity::Extensive] {
        let touches = TouchOptions { presses: 4, rate: 40.0, quantity, ..TouchOptions::default() };
        stream(&map, &skin, &touches);
    }
}

/// Every step, on a recording that is played twice: counts in the second time.
fn stream(map: &SkinMap, skin: &Skin, touches: &TouchOptions) {
    let atlas = Atlas::new(map, &AtlasOptions::default()).unwrap();
    let simulation = TouchSimulation::new(skin, touches).unwrap();
    let options = ConditionOptions {
        baseline: 3,
        split_hz: Some(5.0),
        clip: Some([-1e9, 1e9]),
        ..ConditionOptions::default()
    };
    let mut conditioner =
        Conditioner::new(map, std::slice::from_ref(simulation.channel()), &options).unwrap();
    let channels: Vec<Channel> = conditioner.channels().to_vec();
    let mut restrictor = Restrictor::new(map, &channels);
    let (mut contrast, mut edges) = (Contrast::new(map, &channels), Edges::new(map, &channels));
    let all = [Interpolation::Linear, Interpolation::Nearest];
    let mut renderers = all.map(|interpolation| {
        let options = RenderOptions { interpolation, level: None };
        Renderer::new(map, &atlas, &channels, &options).unwrap()
    });
    let mut tracker =
        ContactTracker::new(map, &channels[0], &TrackerOptions { channel: 0, ..Default::default() }).unwrap();
    let mut regions = 0;
    for time in 0..2 {
        let mut simulation = TouchSimulation::new(skin, touches).unwrap();
        while let Some((frame, _)) = simulation.next_frame() {
            let count = |what: &str, work: &mut dyn FnMut()| {
                let found = allocations(work);
                assert!(time == 0 || found == 0, "{found} allocations of the {what} at {} s", frame.time);
            };
            let mut conditioned = None;
            count("conditioner", &mut || {
                let pushed: Result<(), std::convert::Infallible> = conditioner.push(frame, |frame| {
                    let levels = restrictor.restrict(frame);
                    renderers.iter_mut().for_each(|renderer| {
                        renderer.render(levels);
                    });
                    contrast.of(levels);
                    edges.of(levels);
                    conditioned = Some(frame.time);
                    Ok(())
                });
                pushed.unwrap();
            });
            count("tracker", &mut || regions += tracker.track(frame).len());
            assert_eq!(time == 1, time == 1 && conditioned == Some(frame.time));
        }
    }
    assert!(regions > 100, "{regions} regions are enough to see something");
}

/// One, some and many taxels that change, on a flat skin.
#[test]
fn any_share_of_changes_allocates_nothing() {
    let map = build(&skin(), &BuildOptions::default()).unwrap();
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    let channels = [Channel::default()];
    let mut restrictor = Restrictor::new(&map, &channels);
    let mut renderer = Renderer::new(&map, &atlas, &channels, &RenderOptions::default()).unwrap();
    let mut frame = Frame::new(&map, 1);
    frame.values.iter_mut().flatten().flat_map(|x| x.iter_mut()).for_each(|x| *x = 1.0);
    renderer.render(restrictor.restrict(&frame));
    for share in [1, 3, 10, 30, 100, 300] {
        let taxels = &mut frame.values[PatchId::new(0)][0];
        (0..share.min(taxels.len())).for_each(|k| taxels[VertexId::new(k)] += 0.5);
        let found = allocations(|| {
            renderer.render(restrictor.restrict(&frame));
        });
        assert_eq!(found, 0, "{share} taxels changed");
    }
}
