//! Prints the table of what each stage contributes, for the documentation of this module.
#![allow(clippy::print_stdout, reason = "it prints a table")]

use super::{Solution, automatic, robust_fit};
use crate::calib::{
    CalibError, CalibOptions, DisplacementMeasurement, Loss, LossFunctions, Poses, Problem, SimulateOptions,
    Solver, compare, simulate, solve::initial::initial_poses,
};
use crate::run::Run;

type Stage = fn(&mut Solver<'_>, Poses, &LossFunctions) -> Result<Solution, CalibError>;

const STAGES: [(&str, Stage); 4] = [
    ("least squares", |solver, start, _| Solution::least_squares(solver, start)),
    ("graduated non-convexity", |solver, start, losses| Solution::graduated(solver, start, losses, None)),
    ("+ length prior", robust_fit),
    ("automatic, with noise scale", |solver, start, _| automatic(solver, start)),
];

fn rmse_mm(stage: Stage, outliers: f64, stated: f64, seed: u64) -> f64 {
    let simulation = simulate(&SimulateOptions { outliers, seed, ..SimulateOptions::default() }).unwrap();
    let mut observations = simulation.observations;
    for edge in observations.edges.iter_mut() {
        if let DisplacementMeasurement::Offset { information, .. } = &mut edge.measurement {
            information.0.iter_mut().flatten().for_each(|x| *x *= stated.powi(-2));
        }
    }
    let options = CalibOptions::default();
    let problem = Problem::new(&observations, options.residual).unwrap();
    let start = initial_poses(&observations, options.initialization).unwrap();
    let mut solver =
        Solver { problem: &problem, options: &options, run: Run::default(), iterations: Vec::new() };
    let losses = LossFunctions::new(&problem.dimensions, Loss::Truncated);
    let found = stage(&mut solver, start, &losses).unwrap();
    compare(&found.iterate.poses, &simulation.truth).unwrap().rigid * 1e3
}

#[test]
#[ignore = "prints the ablation table; takes some ten seconds"]
fn table() {
    println!("                                 noise stated right        noise understated twice");
    println!("wrong edges                    0 %    5 %   20 %   40 %     0 %    5 %   20 %   40 %");
    for (name, stage) in STAGES {
        print!("{name:28}");
        for stated in [1.0, 0.5] {
            for outliers in [0.0, 0.05, 0.2, 0.4] {
                let mean = (0..20).map(|seed| rmse_mm(stage, outliers, stated, seed)).sum::<f64>() / 20.0;
                print!(" {mean:6.3}");
            }
            print!("  ");
        }
        println!();
    }
}
