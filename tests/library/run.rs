//! A `Run` ends work early and tells how far it is; it changes no result.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use dermatome::Error;
use dermatome::calib::{CalibOptions, SimulateOptions, calibrate_with, simulate};
use dermatome::flatten::{FlattenOptions, flatten, flatten_pyramid};
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build, build_finest, build_with};
use dermatome::pyramid::{CoarsenOptions, coarsen};
use dermatome::registration::{Landmarks, Onto, register};
use dermatome::remesh::remesh_skin;
use dermatome::run::{Progress, Run, Stage};
use dermatome::skin::{Skin, Taxels};

/// A skin that is cut open, so that trial maps are made too.
fn tube() -> Skin {
    Skin::from_mesh("tube", shapes::tube(40, 24, 0.05, 0.2))
}

#[test]
fn every_job_that_is_cancelled_ends_with_that_error() {
    let (skin, cap, flag) = (tube(), shapes::cap(800, 0.1, 1.9), AtomicBool::new(true));
    let run = Run::default().cancelled_by(&flag);
    let (taxels, options) = (Taxels::from(&cap), FlattenOptions::default());
    let pyramid = coarsen(&cap, &taxels, &CoarsenOptions::default(), Run::default()).unwrap();
    let observed =
        simulate(&SimulateOptions { taxels: 20, ..SimulateOptions::default() }).unwrap().observations;
    let keep_going = BuildOptions { keep_going: true, ..BuildOptions::default() };
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let onto = Onto { atlas: &map, name: "", hash: 0, landmarks: &Landmarks::Regions, is_mirrored: false };
    let jobs: [(&str, Result<(), Error>); 8] = [
        ("register", register(&mut map.clone(), &onto, run).map(drop).map_err(Into::into)),
        ("flatten", flatten(&cap, None, &options, run).map(drop).map_err(Into::into)),
        ("pyramid", flatten_pyramid(&pyramid, None, &options, run).map(drop).map_err(Into::into)),
        ("coarsen", coarsen(&cap, &taxels, &CoarsenOptions::default(), run).map(drop).map_err(Into::into)),
        ("build", build_with(&skin, &keep_going, run).map(drop)),
        ("finest", build_finest(&skin, &keep_going, run).map(drop)),
        ("calibrate", calibrate_with(&observed, &CalibOptions::default(), run).map(drop).map_err(Into::into)),
        ("remesh", remesh_skin(&skin, &[0.01], run).map(drop).map_err(Into::into)),
    ];
    for (job, ended) in jobs {
        assert_eq!(ended.unwrap_err().kind(), "cancelled", "{job}");
    }
}

/// Also in the middle, from any thread, and although other patches could be kept.
#[test]
fn a_build_ends_where_it_is_cancelled() {
    for (stage, done) in [(Stage::Coarsen, 1), (Stage::Flatten, 0)] {
        let flag = AtomicBool::new(false);
        let told = |progress: Progress| {
            if (progress.stage, progress.done) == (stage, done) {
                flag.store(true, Ordering::Relaxed);
            }
        };
        let run = Run::default().cancelled_by(&flag).telling(&told);
        let options = BuildOptions { keep_going: true, ..BuildOptions::default() };
        let ended = build_with(&tube(), &options, run);
        assert_eq!(ended.unwrap_err().kind(), "cancelled", "{stage:?} {done}");
    }
}

#[test]
fn a_run_that_is_not_cancelled_changes_nothing_and_tells_every_step() {
    let (skin, flag, told) = (tube(), AtomicBool::new(false), Mutex::new(Vec::new()));
    let tell =
        |progress: Progress| told.lock().unwrap().push((progress.stage, progress.done, progress.total));
    let run = Run::default().cancelled_by(&flag).telling(&tell);
    let built = build_with(&skin, &BuildOptions::default(), run).unwrap();
    assert_eq!(*built.map, build(&skin, &BuildOptions::default()).unwrap());
    let steps =
        [(Stage::Coarsen, 0, 1), (Stage::Coarsen, 1, 1), (Stage::Flatten, 0, 1), (Stage::Flatten, 1, 1)];
    assert_eq!(*told.lock().unwrap(), steps);
}
