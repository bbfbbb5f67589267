//! The extension module of the Python package: it converts arrays, calls the library and converts back.
//!
//! In reading order: `errors`, `arrays`, `options`, `jobs` (what every function needs); `skin`, `build`, `map`, `level`,
//! `pool`, `matrix`, `index`, `hits`, `robot`, `bare_mesh`, `layout`, `recording_file`, `readings`, `renderer`, `tracker`, `response`,
//! `events`, `observations`, `calib`, `bodies`, `touches`, `follow`, `plot`. Doc comments of what Python sees are its
//! documentation, in the form that numpy uses.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

mod arrays;
mod bodies;
mod build;
mod calib;
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

use std::{ffi::OsString, process::ExitCode};

use pyo3::prelude::*;

/// Run the command.
///
/// Output goes to the standard streams of the process, and a signal that stops the run ends the process.
///
/// Parameters
/// ----------
/// args : sequence of str
///     The arguments, the first of which is the command's own name.
///
/// Returns
/// -------
/// int
///     The exit code.
#[pyfunction]
fn run_command(py: Python<'_>, args: Vec<OsString>) -> u8 {
    let code = py.detach(|| dermatome_command::run_with(args));
    (0..=u8::MAX).find(|&number| ExitCode::from(number) == code).unwrap_or(u8::MAX)
}

#[pymodule(gil_used = false)]
mod _dermatome {
    #[pymodule_export]
    use super::{
        bare_mesh::{PyFlattening, PyMeshLevel, coarsen, flatten},
        bodies::{fit_bodies, write_taxels_of_bodies},
        build::build,
        calib::{PyCalibration, calibrate_taxels, simulate},
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
            as_floats, as_numbers, condition_readings, is_extensive, join_readings, read_readings,
            simulate_touch, summarise_readings, touch_channel,
        },
        recording_file::PyRecordingFile,
        renderer::PyRenderer,
        response::{PyResponse, estimate_response, examine_taxels, order_columns},
        robot::PyRobot,
        run_command,
        skin::{PySkin, check},
        touches::contacts_of_log,
        tracker::PyContactTracker,
    };

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "its name in Python")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
