//! Runs the library outside of the interpreter: without its lock, on threads of the package's own, until Ctrl-C.

use std::{
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, channel},
    },
    time::Duration,
};

use dermatome::run::Run;
use pyo3::{exceptions::PyRuntimeError, prelude::*};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::bad;

/// How long Ctrl-C may wait.
const HEARD_AFTER: Duration = Duration::from_millis(50);

/// As the command has it.
const MOST_THREADS: usize = 512;

/// Threads that work for one job at a time, which can be given up.
struct Pool {
    count: usize,
    threads: ThreadPool,
    stop: Stop,
}

/// The pools without a job; those of another process have no threads here.
struct Idle {
    process: u32,
    pools: Vec<Pool>,
}

static IDLE: Mutex<Idle> = Mutex::new(Idle { process: 0, pools: Vec::new() });

fn idle() -> MutexGuard<'static, Idle> {
    let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if idle.process != process {
        // After a fork: to drop a pool wakes its threads, which only the parent has.
        std::mem::forget(std::mem::take(&mut idle.pools));
        idle.process = process;
    }
    idle
}

impl Pool {
    fn take(count: usize) -> PyResult<Self> {
        if count > MOST_THREADS {
            return Err(bad("threads", count, format!("0 (one per processor) to {MOST_THREADS}")));
        }
        let pools = &mut idle().pools;
        if let Some(k) = pools.iter().position(|pool| pool.count == count) {
            return Ok(pools.swap_remove(k));
        }
        let threads = ThreadPoolBuilder::new().num_threads(count).build();
        let threads = threads.map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
        Ok(Self { count, threads, stop: Stop::default() })
    }

    /// Makes the pool idle after its job. One whose job was given up ends with it instead, as do those beyond the few that
    /// calls from several threads of Python need.
    fn finish<T>(self, answer: Answer<T>) -> PyResult<T> {
        const MOST_IDLE: usize = 16;
        let stop = self.stop.clone();
        if !stop.is_given_up.load(Ordering::Relaxed) {
            let pools = &mut idle().pools;
            if pools.len() < MOST_IDLE {
                pools.push(self);
            }
        }
        stop.result(answer)
    }
}

/// Tells a job that it was given up.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop {
    is_given_up: Arc<AtomicBool>,
    /// What a function that the job called raised.
    raised: Arc<Mutex<Option<PyErr>>>,
}

impl Stop {
    /// How the library runs for the job.
    pub(crate) fn run(&self) -> Run<'_> {
        Run::default().cancelled_by(&self.is_given_up)
    }

    /// Ends the job at this place, by unwinding, if it was given up.
    pub(crate) fn check(&self) {
        if self.is_given_up.load(Ordering::Relaxed) {
            resume_unwind(Box::new("given up"));
        }
    }

    /// Ends the job; its caller raises the exception.
    pub(crate) fn raise(&self, exception: PyErr) {
        self.raised().get_or_insert(exception);
        self.is_given_up.store(true, Ordering::Relaxed);
    }

    fn raised(&self) -> MutexGuard<'_, Option<PyErr>> {
        self.raised.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The result of a job, or what was raised in it.
    fn result<T>(&self, answer: Answer<T>) -> PyResult<T> {
        match self.raised().take() {
            Some(exception) => Err(exception),
            None => answer.or_else(|panic| resume_unwind(panic)),
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
                .inspect_err(|_| stop.is_given_up.store(true, Ordering::Relaxed))?,
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
/// job that is given up goes on in the background until the library or the job itself checks whether it was.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    threads: usize,
    job: impl FnOnce(&Stop) -> T + Send + 'static,
) -> PyResult<T> {
    if is_in_job() {
        let stop = Stop::default();
        return stop.result(py.detach(|| catch_unwind(AssertUnwindSafe(|| job(&stop)))));
    }
    let (pool, (send, receive)) = (Pool::take(threads)?, channel());
    let stop = pool.stop.clone();
    pool.threads.spawn(move || {
        // Nobody waits for a job that was given up.
        let _ = send.send(catch_unwind(AssertUnwindSafe(|| job(&stop))));
    });
    let given_up = &pool.stop;
    let answer = py.detach(move || wait(&receive, given_up))?;
    pool.finish(answer)
}

/// Runs a job that borrows, as [`run`]: Ctrl-C is heard when the job checks whether it was given up.
pub(crate) fn run_here<T: Send>(
    py: Python<'_>,
    threads: usize,
    job: impl FnOnce(&Stop) -> T + Send,
) -> PyResult<T> {
    if is_in_job() {
        let stop = Stop::default();
        return stop.result(py.detach(|| catch_unwind(AssertUnwindSafe(|| job(&stop)))));
    }
    let pool = Pool::take(threads)?;
    let answer = py.detach(|| {
        let (send, receive) = channel();
        pool.threads.in_place_scope(|scope| {
            scope.spawn(|_| {
                let _ = send.send(catch_unwind(AssertUnwindSafe(|| job(&pool.stop))));
            });
            wait(&receive, &pool.stop)
        })
    })?;
    pool.finish(answer)
}
