//! Calibration of simulated skins and public pose graphs: start, solve and covariances of every
//! taxel.

use std::{hint::black_box, path::PathBuf};

use criterion::{Criterion, criterion_group, criterion_main};
use dermatome::{
    calib::{
        CalibOptions, Initialization, Loss, Model, Observations, ResidualConvention, SimulateOptions,
        calibrate, simulate,
    },
    io::read_observations,
};

fn solver(covariances: bool) -> CalibOptions {
    CalibOptions {
        residual: ResidualConvention::Log,
        robust: Some(Loss::Squared),
        initialization: Initialization::Chordal,
        covariances,
        ..CalibOptions::default()
    }
}

fn run(observations: &Observations, options: &CalibOptions) -> f64 {
    calibrate(black_box(observations), options).unwrap().cost
}

fn simulated(c: &mut Criterion) {
    let mut group = c.benchmark_group("simulated");
    for (model, taxels, spacing) in [
        (Model::Positions, 500, 5e-3),
        (Model::Poses, 500, 5e-3),
        (Model::Positions, 20_000, 1e-3),
        (Model::Positions, 200_000, 4e-4),
    ] {
        let options = SimulateOptions { model, taxels, spacing, ..SimulateOptions::default() };
        let observations = simulate(&options).unwrap().observations;
        group.sample_size(if taxels > 10_000 { 10 } else { 50 });
        for (name, options) in [("solve", solver(false)), ("with covariance", solver(true))] {
            group.bench_function(format!("{} {taxels} {name}", model), |b| {
                b.iter(|| run(&observations, &options));
            });
        }
    }
    group.finish();
}

fn public_graphs(c: &mut Criterion) {
    let Some(folder) = std::env::var_os("DERMATOME_DATA").map(PathBuf::from) else {
        println!("skipped: g2o of the data");
        return;
    };
    let mut group = c.benchmark_group("pose graph");
    group.sample_size(10);
    for name in ["sphere2500", "parking-garage", "smallGrid3D"] {
        let path = folder.join(format!("g2o/{name}.g2o"));
        let Ok((observations, _)) = read_observations(&path, &[]) else {
            println!("skipped: {name}");
            continue;
        };
        for (what, options) in [("solve", solver(false)), ("with covariance", solver(true))] {
            group.bench_function(format!("{name} {what}"), |b| b.iter(|| run(&observations, &options)));
        }
    }
    group.finish();
}

criterion_group!(benches, simulated, public_graphs);
criterion_main!(benches);
