//! Fuzzing in process: `fuzz MINUTES [SEED [DRIVER]]`, or `fuzz FILE...` to repeat kept cases.
//!
//! The stored cases come first: every input that once broke something. Then each driver makes inputs from
//! consecutive seeds, so that an input follows from its driver and its seed alone. An execution must not panic,
//! must return what the room promises, and must end within [`LONGEST`] and [`MEMORY`]. An input that breaks
//! this is kept in `target/fuzz`, made smaller, and the exit code is 1.
//!
//! `tools/mutate` damages files for the whole *command* (exit codes, messages, outputs, limits of the process);
//! this calls the *library* a hundred times as often, and checks what it returns.
#![warn(clippy::unwrap_used)]

mod geometry;
mod readers;
mod seeds;
mod signals;

use std::collections::BTreeMap;
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use std::{env, error::Error, fs, process, thread};

use mutate::{Random, smaller};

/// Processor time of an execution, and its time without any.
const LONGEST: Duration = Duration::from_secs(20);
const LONGEST_WAIT: Duration = Duration::from_secs(300);

/// Resident memory of the process, in KiB.
const MEMORY: u64 = 3 << 20;

/// Each driver runs this long before the next one does.
const TURN: Duration = Duration::from_secs(2);

/// Why an execution failed, or nothing.
pub(crate) type Outcome = Result<(), String>;

/// What executions reached, by name: a driver whose inputs are all refused tests nothing.
pub(crate) type Counts = BTreeMap<&'static str, u64>;

/// One kind of inputs: how they are made and what must hold for them.
struct Driver {
    name: &'static str,
    /// A name, whose extension says the kind, and content.
    generate: fn(&mut Random) -> (String, Vec<u8>),
    /// The random numbers choose options; they begin anew for each execution.
    check: fn(&str, &[u8], &mut Random, &mut Counts) -> Outcome,
}

const DRIVERS: [Driver; 4] = [
    Driver { name: "readers", generate: readers::generate, check: readers::check },
    Driver { name: "geometry", generate: geometry::generate, check: geometry::check },
    Driver { name: "signals", generate: signals::generate, check: signals::check_signals },
    Driver { name: "calibration", generate: signals::generate, check: signals::check_calibration },
];

/// The execution in progress, for the watchdog, and the text of the last panic.
static CURRENT: Mutex<Option<(Instant, Duration, Case)>> = Mutex::new(None);
static PANIC: Mutex<String> = Mutex::new(String::new());

#[derive(Clone)]
struct Case {
    driver: usize,
    seed: u64,
    name: String,
    bytes: Vec<u8>,
}

impl Case {
    /// A file as [`Case::keep`] names it, or any other file as an input of the readers.
    fn read(path: &Path) -> Result<Self, Box<dyn Error>> {
        let (bytes, file) =
            (fs::read(path)?, path.file_name().unwrap_or_default().to_string_lossy().into_owned());
        let mut words = file.splitn(3, '-');
        let driver = words.next().and_then(|word| DRIVERS.iter().position(|driver| driver.name == word));
        let seed = words.next().and_then(|word| word.parse().ok());
        Ok(match (driver, seed, words.next()) {
            (Some(driver), Some(seed), Some(name)) => Self { driver, seed, name: name.to_owned(), bytes },
            _ => Self { driver: 0, seed: 1, name: file, bytes },
        })
    }

    fn keep(&self) -> std::io::Result<PathBuf> {
        let folder = Path::new(&env::var_os("CARGO_TARGET_DIR").unwrap_or("target".into())).join("fuzz");
        fs::create_dir_all(&folder)?;
        let path = folder.join(format!("{}-{}-{}", DRIVERS[self.driver].name, self.seed, self.name));
        fs::write(&path, &self.bytes)?;
        Ok(path)
    }

    fn execute(&self, counts: &mut Counts) -> Outcome {
        *locked(&CURRENT) = Some((Instant::now(), processor_time(), self.clone()));
        let check = DRIVERS[self.driver].check;
        let run = || check(&self.name, &self.bytes, &mut Random::new(!self.seed), counts);
        let outcome = panic::catch_unwind(AssertUnwindSafe(run));
        *locked(&CURRENT) = None;
        outcome.unwrap_or_else(|_| Err(format!("panic: {}", locked(&PANIC))))
    }
}

fn main() -> Result<ExitCode, Box<dyn Error>> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    panic::set_hook(Box::new(|info| *locked(&PANIC) = info.to_string().replace('\n', " ")));
    thread::spawn(watch);
    let arguments: Vec<String> = env::args().skip(1).collect();
    let minutes = arguments.first().ok_or("needed: minutes, or kept cases")?;
    let Ok(minutes) = minutes.parse::<f64>() else {
        let cases =
            arguments.iter().map(|path| Case::read(Path::new(path))).collect::<Result<Vec<_>, _>>()?;
        return Ok(report(cases.iter().filter_map(|case| found(case, &mut Counts::new())).collect()));
    };
    let seed: u64 = arguments.get(1).map_or(Ok(1), |text| text.parse())?;
    let only = arguments.get(2);
    let mut findings = BTreeMap::new();
    let (mut counts, mut executions) = (Counts::new(), [0_u64; DRIVERS.len()]);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    for folder in [folder.join("cases"), folder.join("../mutate/cases")] {
        let mut paths = fs::read_dir(folder)?
            .map(|entry| Ok(entry?.path()))
            .collect::<Result<Vec<_>, std::io::Error>>()?;
        paths.sort();
        for path in paths {
            let case = Case::read(&path)?;
            executions[case.driver] += 1;
            findings.extend(found(&case, &mut counts));
        }
    }
    let start = Instant::now();
    let chosen = |driver: &Driver| only.is_none_or(|name| name == driver.name);
    while start.elapsed().as_secs_f64() < 60.0 * minutes {
        for (driver, kind) in DRIVERS.iter().enumerate().filter(|(_, driver)| chosen(driver)) {
            let turn = Instant::now();
            while turn.elapsed() < TURN {
                let seed = (seed << 40) + executions[driver];
                executions[driver] += 1;
                let (name, bytes) = (kind.generate)(&mut Random::new(seed));
                let case = Case { driver, seed, name, bytes };
                if let Err(why) = case.execute(&mut counts) {
                    // One of a kind is enough.
                    let kind = kind_of(&why);
                    if !findings.contains_key(&kind) {
                        findings.extend(found(&case.smaller(&kind), &mut counts).or(Some((kind, why))));
                    }
                }
            }
        }
    }
    for (driver, executions) in DRIVERS.iter().zip(executions) {
        println!("{}: {executions} executions", driver.name);
    }
    println!("{counts:?}, {} findings", findings.len());
    Ok(report(findings))
}

impl Case {
    /// A smaller case that fails in the same way: lines are cut first, then bytes of files.
    fn smaller(&self, kind: &str) -> Self {
        let with = |bytes: &[u8]| Self { bytes: bytes.to_vec(), ..self.clone() };
        let breaks =
            |bytes: &[u8]| with(bytes).execute(&mut Counts::new()).is_err_and(|why| kind_of(&why) == kind);
        let start = Instant::now();
        let mut lines: Vec<&[u8]> = self.bytes.split_inclusive(|&byte| byte == b'\n').collect();
        let mut at = lines.len();
        while at > 0 && start.elapsed() < Duration::from_secs(20) {
            at -= 1;
            let line = lines.remove(at);
            if !breaks(&lines.concat()) {
                lines.insert(at, line);
            }
        }
        let bytes = lines.concat();
        // Generated inputs are numbers of a driver or lines that it understands.
        if self.driver == 0 { with(&smaller(bytes, &mut Random::new(1), 200, breaks)) } else { with(&bytes) }
    }
}

/// Executes a case; what failed, by kind, after keeping it.
fn found(case: &Case, counts: &mut Counts) -> Option<(String, String)> {
    let why = case.execute(counts).err()?;
    let kept = case.keep().map_or_else(|error| error.to_string(), |path| path.display().to_string());
    println!("{kept} ({} bytes): {why}", case.bytes.len());
    Some((kind_of(&why), why))
}

fn report(findings: BTreeMap<String, String>) -> ExitCode {
    if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// What failed without the numbers in it, but with the line of a panic.
fn kind_of(why: &str) -> String {
    match why.strip_prefix("panic: ") {
        Some(panic) => panic.split_whitespace().filter(|word| word.contains(".rs:")).collect(),
        None => why.chars().filter(|c| c.is_alphabetic() && *c != 'e' || *c == ' ').take(60).collect(),
    }
}

/// Ends the process where an execution takes too long or too much memory, and keeps its input.
fn watch() {
    loop {
        thread::sleep(Duration::from_millis(50));
        let current = locked(&CURRENT).clone();
        let Some((start, before, case)) = current else { continue };
        let is_long = processor_time().saturating_sub(before) > LONGEST || start.elapsed() > LONGEST_WAIT;
        let why = if is_long { "does not end" } else { "takes too much memory" };
        if is_long || status("VmRSS:") > MEMORY {
            println!("{:?} ({} bytes): {why}", case.keep(), case.bytes.len());
            process::exit(1);
        }
    }
}

/// Processor time of the process so far; 0 where the system does not tell.
fn processor_time() -> Duration {
    let text = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let ticks = text.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
    Duration::from_millis(10 * ticks.filter_map(|word| word.parse::<u64>().ok()).sum::<u64>())
}

/// A number of `/proc/self/status`, in KiB; 0 where the system does not tell.
fn status(name: &str) -> u64 {
    let text = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// The words of an error.
pub(crate) fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// What a function returns in a pool of two threads: outside there is one.
pub(crate) fn in_two_threads<T: Send>(what: impl FnOnce() -> T + Send) -> Result<T, String> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(2).build().map_err(text)?.install(what))
}

fn locked<T>(of: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}
