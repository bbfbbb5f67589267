//! Runs the command on damaged files of every kind that it reads:
//! `cargo run --release -p mutate -- target/release/dermatome [SECONDS [SEED]]`.
//!
//! The stored cases of `tools/mutate/cases` come first, then as many mutations of sound files as
//! the time allows. Every run must end by itself with an exit code from 0 to 2, without the text of
//! a panic, within [`LONGEST`] and within [`MEMORY_KIB`]. A file that breaks this is kept, made as
//! small as cutting it makes it, and the exit code is 1.
#![warn(clippy::unwrap_used)]

mod run;
mod seeds;

use std::{
    env,
    error::Error,
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
    time::{Duration, Instant},
};

use mutate::{Random, damage, smaller};

use crate::{
    run::{Run, commands_for},
    seeds::make_seeds,
};

/// A run that takes longer hangs.
pub(crate) const LONGEST: Duration = Duration::from_secs(20);

/// Address space of a run.
pub(crate) const MEMORY_KIB: u64 = 3 << 20;

/// Attempts to make a file that breaks something smaller.
const TRIES: usize = 300;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let mut arguments = env::args_os().skip(1);
    let command = arguments.next().ok_or("needed: the command, as target/release/dermatome")?;
    let command = fs::canonicalize(command)?;
    let mut number = || arguments.next().map(|text| text.to_string_lossy().parse::<u64>()).transpose();
    let (seconds, seed) = (number()?.unwrap_or(30), number()?.unwrap_or(1));

    let folder = env::temp_dir().join(format!("dermatome-mutate-{}", std::process::id()));
    fs::create_dir_all(&folder)?;
    let found = hunt(&command, &folder, Duration::from_secs(seconds), seed);
    fs::remove_dir_all(&folder)?;
    let broken = found?;
    for path in &broken {
        println!("kept {}", path.display());
    }
    Ok(if broken.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Runs the stored cases and then mutations; returns the files that break something.
fn hunt(command: &Path, folder: &Path, time: Duration, seed: u64) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let seeds = make_seeds(command, folder)?;
    let (mut broken, mut runs) = (Vec::new(), 0_usize);
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases");
    let mut stored: Vec<PathBuf> =
        fs::read_dir(&cases)?.map(|entry| Ok(entry?.path())).collect::<Result<_, std::io::Error>>()?;
    stored.sort();
    for case in stored {
        let name = case.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let bytes = fs::read(&case)?;
        for arguments in commands_for(&name) {
            runs += 1;
            if let Err(why) = (Run { command, folder, name: &name, arguments }).check(&bytes) {
                println!("{name}: {arguments}: {why}");
                broken.push(case.clone());
            }
        }
    }
    let (start, mut random) = (Instant::now(), Random::new(seed));
    while start.elapsed() < time {
        let (name, sound) = &seeds[random.below(seeds.len())];
        let bytes = damage(sound, &mut random);
        let all = commands_for(name);
        let arguments = all[random.below(all.len())];
        let run = Run { command, folder, name, arguments };
        runs += 1;
        if let Err(why) = run.check(&bytes) {
            println!("{name}: {arguments}: {why}");
            let smallest = smaller(bytes, &mut random, TRIES, |bytes| run.check(bytes).is_err());
            let path = env::current_dir()?.join(format!("mutated-{seed}-{runs}-{name}"));
            fs::write(&path, smallest)?;
            broken.push(path);
        }
    }
    println!("{runs} runs on damaged files, {} broke something", broken.len());
    Ok(broken)
}
