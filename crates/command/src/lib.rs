//! `dermatome`: the command. It parses, calls the library and prints.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

mod bench;
mod build;
mod calibrate;
mod carry;
mod check;
mod coarsen;
mod console;
mod convert;
mod design;
mod diff;
mod export;
mod files;
mod flatten;
mod help;
mod info;
mod layout;
mod lookup;
mod options;
mod plot;
mod readings;
mod render;
mod report;
mod response;
mod shell;
mod simulate;
mod summary;
mod touch;
mod touches;

use std::{ffi::OsString, process::ExitCode};

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::console::errors;
use crate::files::{outputs, paths, signals};
use crate::options::Common;

pub use crate::options::{Containers, DraftContainer, OpenContainer};

/// Somatosensory maps of robot skin.
///
/// The extension of a file determines its format. `-` is standard input for the observations of
/// `calibrate`, the contacts of `lookup` and the readings of `render` and `plot`, and standard output
/// for `lookup`, `plot`, `render` and `simulate`. Lengths may have a unit, as in 5mm, 2cm or 0.1m.
/// Exit codes: 0 success; 1 `build` would refuse what `check` read, `diff` found changes, or `build --keep-going` left out patches; 2 bad
/// usage or bad input, `calibrate` did not converge, or `lookup` refused rows; 128 plus the number of
/// the signal that stopped the run, 130 after ^C.
#[derive(Debug, Parser)]
#[command(name = "dermatome", version, max_term_width = 100)]
pub(crate) struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Measure lookups on a map: time, interval and true error, by distance and level.
    Bench(bench::Args),
    /// Build the maps of a skin: writes map.glb, map.exr and reports as JSON and HTML.
    Build(build::Args),
    /// Calibrate taxel poses from observations: writes a skin with covariances.
    Calibrate(calibrate::Args),
    /// Carry readings from one skin to another on the same atlas.
    Carry(carry::Args),
    /// List the problems of a skin: exit code 1 if `build` would refuse it.
    Check(check::Args),
    /// Build the pyramid of receptive fields, without maps.
    Coarsen(coarsen::Args),
    /// Convert a skin or mesh to another file format.
    Convert(convert::Args),
    /// Design a skin: modules on a surface, their wiring, and their pattern at 1:1.
    Design(design::Args),
    /// List what changed between two files of one skin: exit code 1 if anything did.
    Diff(diff::Args),
    /// Export a map to simulators, robots and tables.
    Export(export::Args),
    /// Map one mesh to the plane, at full precision.
    Flatten(flatten::Args),
    /// List the patches of a skin, their size and shape.
    Info(info::Args),
    /// Draft a layout, which states what the numbers of a recording mean.
    Layout(layout::Args),
    /// Find the map cells under contacts, on every level.
    Lookup(lookup::Args),
    /// Draw maps and their receptive fields.
    Plot(plot::Args),
    /// Draw readings as tactile images on every level.
    Render(render::Args),
    /// Write a page that shows the skin, its map and a recording in a browser.
    Report(report::Args),
    /// Estimate how readings become pressures, from touches or steps of pressure.
    Response(response::Args),
    /// Simulate observations of a skin with known taxel poses.
    Simulate(simulate::Args),
    /// Add up a recording by region, patch, link and contact.
    Summary(summary::Args),
    /// Simulate touches: a sphere that presses and rolls on a skin, as readings.
    Touch(touch::Args),
    /// Turn the log of a robot that touches its skin into contacts for `calibrate`.
    Touches(touches::Args),
    /// Print a completion script.
    Completions(shell::CompletionsArgs),
    /// Print the manual page, of the whole command or of a subcommand.
    Man(shell::ManArgs),
}

/// Runs the command with the arguments of this process.
pub fn main() -> ExitCode {
    run_with(std::env::args_os(), Containers::default())
}

/// Runs the command with arguments, the first of which is its own name; signals that stop it end the process. `containers`
/// reads the recordings that the library does not.
pub fn run_with(args: impl IntoIterator<Item = OsString>, containers: Containers) -> ExitCode {
    let command = help::with_short_help(help::with_ends(with_negative_numbers(Cli::command())));
    let command = paths::with_hints(command);
    let parsed = command.clone().try_get_matches_from(args);
    let parsed = parsed.and_then(|given| Ok((Cli::from_arg_matches(&given)?, given)));
    let (mut cli, given) = match parsed {
        Ok(parsed) => parsed,
        Err(e) => return errors::usage(&e),
    };
    cli.common.containers = containers;
    let color = cli.common.color;
    if let Some((_, given)) = given.subcommand()
        && let Err(e) = outputs::check_command_line(given, &cli.common.outputs)
    {
        return errors::report(&e, color);
    }
    let ran = run(&cli);
    let is_complete = !cli.common.outputs.has_files();
    cli.common.outputs.discard(|| ());
    match ran {
        Ok(code) => code,
        // The reader of the only output has what it needs (`| head`).
        Err(e) if is_complete && errors::is_closed_pipe(&e) => ExitCode::SUCCESS,
        Err(e) => signals::stopped().map_or_else(|| errors::report(&e, color), ExitCode::from),
    }
}

/// Takes `-1` as the value of an option and never as an option, so that the option's own error says
/// what is needed.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command
        .mut_args(|arg| {
            let takes_value = arg.get_action().takes_values();
            arg.allow_negative_numbers(takes_value)
        })
        .mut_subcommands(with_negative_numbers)
}

fn run(cli: &Cli) -> anyhow::Result<ExitCode> {
    let common = &cli.common;
    let threads = common.workers().map_err(|why| errors::advise(why, "correct it, or give --threads"))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| {
        errors::advise(
            format!("cannot start the threads: {e}"),
            "give fewer --threads, or allow more memory and processes (ulimit -v, -u)",
        )
    })?;
    signals::catch_signals(&common.outputs);
    // On a thread of the pool: from outside, every parallel loop waits until the pool wakes up.
    pool.install(|| run_command(cli))
}

fn run_command(cli: &Cli) -> anyhow::Result<ExitCode> {
    let common = &cli.common;
    match &cli.command {
        Command::Bench(args) => bench::run(args),
        Command::Build(args) => build::run(args, common),
        Command::Calibrate(args) => calibrate::run(args, common),
        Command::Carry(args) => carry::run(args, common),
        Command::Check(args) => check::run(args, common),
        Command::Coarsen(args) => coarsen::run(args, common),
        Command::Convert(args) => convert::run(args, common),
        Command::Design(args) => design::run(args, common),
        Command::Diff(args) => diff::run(args, common),
        Command::Export(args) => export::run(args, common),
        Command::Flatten(args) => flatten::run(args, common),
        Command::Info(args) => info::run(args, common),
        Command::Layout(args) => layout::run(args, common),
        Command::Lookup(args) => lookup::run(args, common),
        Command::Plot(args) => plot::run(args, common),
        Command::Render(args) => render::run(args, common),
        Command::Report(args) => report::run(args, common),
        Command::Response(args) => response::run(args, common),
        Command::Simulate(args) => simulate::run(args, common),
        Command::Summary(args) => summary::run(args, common),
        Command::Touch(args) => touch::run(args, common),
        Command::Touches(args) => touches::run(args, common),
        Command::Completions(args) => shell::completions(args, &mut paths::with_hints(Cli::command())),
        Command::Man(args) => shell::manual(args, help::with_ends(Cli::command())),
    }
}

#[cfg(test)]
mod tests {
    use std::any::TypeId;
    use std::collections::BTreeSet;

    use clap::error::ErrorKind;
    use glob::Pattern;

    use super::*;
    use crate::options::{CutArg, InPath, JointsArg, ModulesArg, OutFile, OutFolder};

    // clap checks this too, but not in a release.
    #[test]
    fn no_subcommand_has_two_options_of_one_name() {
        let mut command = Cli::command();
        command.build();
        for subcommand in command.get_subcommands() {
            let mut names = BTreeSet::new();
            for argument in subcommand.get_arguments() {
                let long = argument.get_long_and_visible_aliases().unwrap_or_default();
                let short = argument.get_short_and_visible_aliases().unwrap_or_default();
                for name in long.into_iter().map(str::to_owned).chain(short.into_iter().map(String::from)) {
                    assert!(names.insert(name.clone()), "{} has two options {name:?}", subcommand.get_name());
                }
            }
        }
    }

    /// Values of options that have no list of words and no default, by the name of their value.
    const SOUND: [(&str, &str); 44] = [
        ("A4|A3|W,H", "A3"),
        ("AZIMUTH,ELEVATION", "-65,-45"),
        ("auto|MS", "40"),
        ("D", "5"),
        ("DEG", "10"),
        ("DIR", "0,1,0"),
        ("F", "0.5"),
        ("GAMMA", "1"),
        ("H", "64"),
        ("HZ", "10"),
        ("ID,...|F.csv", "3,17"),
        ("K", "2"),
        ("KIND=N", "dead=3"),
        ("K|NAME.LK", "body.L1"),
        ("KPA", "5"),
        ("KPA,...", "5,20"),
        ("L.json|tnc|tcn", "tcn"),
        ("L.csv|regions", "regions"),
        ("LENGTH|0", "20mm"),
        ("LENGTH|NAME=LENGTH,...", "hand=2mm,5mm"),
        ("LOW,HIGH", "0,1"),
        ("MB", "50"),
        ("MM", "5"),
        ("MM,...", "5,10"),
        ("MM[,MM]", "5,8"),
        ("MODULE", "triangle:32mm"),
        ("N", "3"),
        ("NAME=DIR", "a=."),
        ("NAME=VALUE,...", "late-ms=40"),
        ("PERCENT", "5"),
        ("PX", "600"),
        ("R", "3"),
        ("R.csv|P.json|link", "link"),
        ("S", "1"),
        ("SHAPE|FILE.csv", "circle"),
        ("SHARE", "5%"),
        ("T,T,...", "0,1"),
        ("UNIT", "mm"),
        ("W", "1"),
        ("X", "2"),
        ("[LINK:]DIR[,DEG]", "0,1,0,20"),
        ("[LINK:]X,Y,Z,X,Y,Z", "0,0,0,1,1,1"),
        ("follow|stored|first=N|NUMBER", "first=3"),
        ("uv", "uv"),
    ];

    /// Every value of every option is read to its end. Names are free, and so are files: one that does not exist is
    /// refused when it is read.
    #[test]
    fn what_follows_a_sound_value_is_refused() {
        let free = [
            TypeId::of::<String>(),
            TypeId::of::<Pattern>(),
            TypeId::of::<InPath>(),
            TypeId::of::<OutFile>(),
            TypeId::of::<OutFolder>(),
            TypeId::of::<CutArg>(),
            TypeId::of::<JointsArg>(),
            TypeId::of::<ModulesArg>(),
        ];
        let mut root = with_negative_numbers(Cli::command());
        root.build();
        let mut tried = 0;
        for command in root.get_subcommands() {
            for argument in command.get_arguments().filter(|argument| argument.get_action().takes_values()) {
                if free.iter().any(|known| argument.get_value_parser().type_id() == *known) {
                    continue;
                }
                let name = argument.get_value_names().map_or("", |names| names[0].as_str());
                let words = argument.get_possible_values();
                let word = words.first().map(|word| word.get_name().to_owned());
                let given =
                    argument.get_default_values().first().map(|word| word.to_string_lossy().into_owned());
                let listed =
                    SOUND.iter().find(|(other, _)| *other == name).map(|(_, value)| (*value).to_owned());
                let sound = word.or(given).or(listed);
                let sound =
                    sound.unwrap_or_else(|| panic!("{} {argument}: give a value", command.get_name()));
                let count = argument.get_num_args().map_or(1, |range| range.min_values().max(1));
                let is_refused = |value: &str| {
                    let mut line = vec!["dermatome".to_owned(), command.get_name().to_owned()];
                    if let Some(long) = argument.get_long().filter(|_| argument.is_require_equals_set()) {
                        line.push(format!("--{long}={value}"));
                    } else {
                        line.extend(argument.get_long().map(|long| format!("--{long}")));
                        line.extend(std::iter::repeat_n(sound.clone(), count - 1));
                        line.push(value.to_owned());
                    }
                    let error = root.clone().try_get_matches_from(line).err().map(|error| error.kind());
                    matches!(error, Some(ErrorKind::InvalidValue | ErrorKind::ValueValidation))
                };
                assert!(!is_refused(&sound), "{} {argument} {sound}", command.get_name());
                for rubbish in ["x", ",x", " x"].map(|rubbish| format!("{sound}{rubbish}")) {
                    assert!(is_refused(&rubbish), "{} {argument} {rubbish:?} is taken", command.get_name());
                }
                tried += 1;
            }
        }
        assert!(tried > 200, "{tried} options");
    }
}
