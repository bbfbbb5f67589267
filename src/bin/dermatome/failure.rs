//! Errors as a user reads them, in three lines: what, why, what to do.

use std::{
    fmt,
    io::{ErrorKind, IsTerminal},
    process::ExitCode,
};

use crate::{ColorChoice, tables::line};

/// Exit code of bad usage and bad input.
const BAD_INPUT: u8 = 2;

/// What a user can do, where the library's own advice does not know the command's options.
#[derive(Debug)]
pub(crate) struct Advice(pub String);

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Advice {}

/// An error with advice of the command's own.
pub(crate) fn advise(what: impl fmt::Display, help: impl Into<String>) -> anyhow::Error {
    anyhow::Error::new(Advice(help.into())).context(what.to_string())
}

/// Prints what clap has to say: help on standard output, errors on standard error.
pub(crate) fn usage(error: &clap::Error) -> ExitCode {
    let failed_to_print = error.print().is_err();
    if error.use_stderr() || failed_to_print { ExitCode::from(BAD_INPUT) } else { ExitCode::SUCCESS }
}

/// Prints an error; a reader that went away (`| head`) is none.
pub(crate) fn report(error: &anyhow::Error, color: ColorChoice) -> ExitCode {
    if error.chain().any(is_broken_pipe) {
        return ExitCode::SUCCESS;
    }
    let paint = match color {
        ColorChoice::Always => true,
        ColorChoice::Never => false,
        ColorChoice::Auto => std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none(),
    };
    let label = |text: &str, code: &str| {
        if paint { format!("\u{1b}[1;{code}m{text}\u{1b}[0m") } else { text.to_owned() }
    };
    let mut reasons: Vec<String> = Vec::new();
    for cause in error.chain().filter(|cause| !cause.is::<Advice>()).map(ToString::to_string) {
        // Most errors tell their source in their own sentence.
        if !reasons.last().is_some_and(|told| told.contains(&cause)) {
            reasons.push(cause);
        }
    }
    let what = reasons.first().cloned().unwrap_or_default();
    eprintln!("{} {}", label("error:", "31"), line(&what));
    if reasons.len() > 1 {
        eprintln!("{} {}", label("  why:", "33"), line(&reasons[1..].join(": ")));
    }
    if let Some(help) = help(error) {
        eprintln!("{} {}", label(" help:", "32"), line(&help));
    }
    ExitCode::from(BAD_INPUT)
}

fn is_broken_pipe(cause: &(dyn std::error::Error + 'static)) -> bool {
    cause.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == ErrorKind::BrokenPipe)
}

fn help(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(|cause| {
        if let Some(advice) = cause.downcast_ref::<Advice>() {
            return Some(advice.0.clone());
        }
        if let Some(e) = cause.downcast_ref::<dermatome::io::IoError>() {
            return Some(e.help());
        }
        cause.downcast_ref::<dermatome::Error>().map(dermatome::Error::help)
    })
}
