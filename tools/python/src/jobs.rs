//! Runs the library outside of the interpreter: without its lock, on threads of the package's own, until Ctrl-C.

use std::{
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{RecvTimeoutError, channel},
    },
    time::Duration,
};

use pyo3::{exceptions::PyRuntimeError, prelude::*};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::bad;

/// How long Ctrl-C may wait.
const HEARD_AFTER: Duration = Duration::from_millis(50);

/// As the command has it.
const MOST_THREADS: usize = 512;

/// The pools that were used, by their number of threads; those of another process have no threads here.
struct Pools {
    process: u32,
    pools: Vec<(usize, Arc<ThreadPool>)>,
}

static POOLS: Mutex<Pools> = Mutex::new(Pools { process: 0, pools: Vec::new() });

fn pool(threads: usize) -> PyResult<Arc<ThreadPool>> {
    if threads > MOST_THREADS {
        return Err(bad("threads", threads, format!("0 (one per processor) to {MOST_THREADS}")));
    }
    let mut known = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if known.process != process {
        // After a fork: to drop a pool wakes its threads, which only the parent has.
        std::mem::forget(std::mem::take(&mut known.pools));
        known.process = process;
    }
    if let Some((_, pool)) = known.pools.iter().find(|(count, _)| *count == threads) {
        return Ok(Arc::clone(pool));
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = Arc::new(pool.map_err(|e| PyRuntimeError::new_err(e.to_string()))?);
    known.pools.push((threads, Arc::clone(&pool)));
    Ok(pool)
}

/// Runs a job on `threads` threads, 0 for one per processor. Ctrl-C and other signals are heard while it runs; a
/// job that is given up goes on in the background until it ends.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    threads: usize,
    job: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let (send, mut receive) = channel();
    pool(threads)?.spawn(move || {
        // Nobody waits for a job that was given up.
        let _ = send.send(catch_unwind(AssertUnwindSafe(job)));
    });
    loop {
        let answer;
        (receive, answer) = py.detach(move || {
            let answer = receive.recv_timeout(HEARD_AFTER);
            (receive, answer)
        });
        match answer {
            Ok(Ok(answer)) => return Ok(answer),
            Ok(Err(panic)) => resume_unwind(panic),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => return Err(PyRuntimeError::new_err("the job was lost")),
        }
    }
}
