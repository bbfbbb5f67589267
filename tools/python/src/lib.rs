//! The extension module of the Python package: it converts arrays, calls the library and converts back.
//!
//! In reading order: `errors`, `arguments`, `arrays`, `options`, `jobs` (what every function needs); `skin`, `build`, `map`, `level`,
//! `pool`, `matrix`, `index`, `hits`, `robot`, `bare_mesh`, `layout`, `recording_file`, `containers`, `readings`, `renderer`, `tracker`, `response`,
//! `events`, `observations`, `calib`, `bodies`, `touches`, `follow`, `plot`. Doc comments of what Python sees are its
//! documentation, in the form that numpy uses.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

mod arguments;
mod arrays;
mod bodies;
mod build;
mod calib;
mod containers;
mod errors;
mod events;
mod follow;
mod hits;
mod index;
mod jobs;
mod layout;
mod level;
mod map;
mod matrix;
mod observations;
mod bare_mesh;
mod options;
mod plot;
mod pool;
mod readings;
mod recording_file;
mod renderer;
mod response;
mod robot;
mod skin;
mod touches;
mod tracker;

use pyo3::prelude::*;

#[pymodule(gil_used = false)]
mod _dermatome {
    #[pymodule_export]
    use super::{
        bare_mesh::{PyFlattening, PyMeshLevel, coarsen, flatten},
        bodies::{fit_bodies, write_taxels_of_bodies},
        build::build,
        calib::{PyCalibration, calibrate_taxels, simulate},
        containers::run_command,
        events::{PyEventDetector, diff},
        follow::{PyTouchFollower, PyTouchLines},
        hits::{PyFields, PyHits},
        index::PyIndex,
        layout::{PyDecoder, PyLayout},
        level::{PyLevel, PyPatch},
        map::PyMap,
        matrix::PyMatrix,
        observations::PyObservations,
        plot::{PyPicture, colours},
        readings::{
            as_floats, as_numbers, condition_readings, is_extensive, is_of_touch, is_same_unit,
            join_readings, main_channel, read_readings, simulate_touch, summarise_readings,
        },
        recording_file::PyRecordingFile,
        renderer::PyRenderer,
        response::{PyResponse, estimate_response, examine_taxels, order_columns},
        robot::PyRobot,
        skin::{PySkin, check},
        touches::contacts_of_log,
        tracker::PyContactTracker,
    };

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "its name in Python")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
