//! Runs the library outside of the interpreter: without its lock, on threads of the package's own, until Ctrl-C.

use std::{
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, channel},
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

/// Tells a job that it was given up.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Ends the job at this place, by unwinding, if it was given up.
    pub(crate) fn check(&self) {
        if self.0.load(Ordering::Relaxed) {
            resume_unwind(Box::new("given up"));
        }
    }
}

type Answer<T> = std::thread::Result<T>;

/// The answer of a job, or what a handler of signals raised meanwhile; then the job is to stop.
fn wait<T>(receive: &Receiver<Answer<T>>, stop: &Stop) -> PyResult<Answer<T>> {
    loop {
        match receive.recv_timeout(HEARD_AFTER) {
            Ok(answer) => return Ok(answer),
            Err(RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())
                .inspect_err(|_| stop.0.store(true, Ordering::Relaxed))?,
            Err(RecvTimeoutError::Disconnected) => return Err(PyRuntimeError::new_err("the job was lost")),
        }
    }
}

/// Whether this thread is one of a pool, as where `progress` calls the package again: to wait for others would be to
/// wait for itself.
fn is_in_job() -> bool {
    rayon::current_thread_index().is_some()
}

/// Runs a job on `threads` threads, 0 for one per processor. Ctrl-C and other signals are heard while it runs; a
/// job that is given up goes on in the background until it checks whether it was, or ends.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    threads: usize,
    job: impl FnOnce(&Stop) -> T + Send + 'static,
) -> PyResult<T> {
    let (pool, stop, (send, receive)) = (pool(threads)?, Stop::default(), channel());
    if is_in_job() {
        return Ok(py.detach(|| job(&stop)));
    }
    let given = stop.clone();
    pool.spawn(move || {
        // Nobody waits for a job that was given up.
        let _ = send.send(catch_unwind(AssertUnwindSafe(|| job(&given))));
    });
    let answer = py.detach(move || wait(&receive, &stop))?;
    answer.or_else(|panic| resume_unwind(panic))
}

/// Runs a job that borrows, as [`run`]: Ctrl-C is heard when the job checks whether it was given up.
pub(crate) fn run_here<T: Send>(
    py: Python<'_>,
    threads: usize,
    job: impl FnOnce(&Stop) -> T + Send,
) -> PyResult<T> {
    let (pool, stop) = (pool(threads)?, Stop::default());
    if is_in_job() {
        return Ok(py.detach(|| job(&stop)));
    }
    let answer = py.detach(|| {
        let (send, receive) = channel();
        pool.in_place_scope(|scope| {
            scope.spawn(|_| {
                let _ = send.send(catch_unwind(AssertUnwindSafe(|| job(&stop))));
            });
            wait(&receive, &stop)
        })
    })?;
    answer.or_else(|panic| resume_unwind(panic))
}
