//! Gains from touches, for covers of several sizes: from frames in memory to gains.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use dermatome::{
    mesh::shapes,
    response::GainEstimator,
    run::Run,
    signal::{Frame, Quantity, TouchOptions, TouchSimulation},
    skin::Skin,
};

fn gains(c: &mut Criterion) {
    let mut group = c.benchmark_group("response/gains");
    group.sample_size(10);
    for (columns, presses) in [(10, 80), (25, 400)] {
        let skin = Skin::from_mesh("cover", shapes::lattice(columns, columns, 0.007));
        let options = TouchOptions {
            radii: vec![0.008, 0.015, 0.04],
            depths: [0.001, 0.004],
            presses,
            rate: 20.0,
            quantity: Quantity::Intensive,
            noise: 2000.0,
            ..TouchOptions::default()
        };
        let mut simulation = TouchSimulation::new(&skin, &options).unwrap();
        let mut frames: Vec<Frame> = Vec::new();
        while let Some((frame, _)) = simulation.next_frame() {
            frames.push(frame.clone());
        }
        let name = format!("{} taxels, {presses} presses", columns * columns);
        group.bench_function(BenchmarkId::from_parameter(name), |b| {
            b.iter(|| {
                let mut estimator = GainEstimator::new(&skin).unwrap();
                frames.iter().for_each(|frame| estimator.see(frame));
                estimator.solve(Run::default()).unwrap()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, gains);
criterion_main!(benches);
