//! `completions` and `man`: completion scripts and the manual page.

use std::process::ExitCode;

use clap::Command;

use crate::console::{errors::advise, print::print};

/// Arguments of `completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct CompletionsArgs {
    /// The shell that will run the script
    shell: clap_complete::Shell,
}

pub(crate) fn completions(args: &CompletionsArgs, command: &mut Command) -> anyhow::Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, command, "dermatome", &mut script);
    print(&String::from_utf8(script)?)?;
    Ok(ExitCode::SUCCESS)
}

/// Arguments of `man`.
#[derive(Debug, clap::Args)]
pub(crate) struct ManArgs {
    /// The subcommand, as build [default: the whole command]
    subcommand: Option<String>,
}

pub(crate) fn manual(args: &ManArgs, mut command: Command) -> anyhow::Result<ExitCode> {
    command.build();
    if let Some(name) = &args.subcommand {
        let Some(found) = command.find_subcommand(name) else {
            let names: Vec<_> = command.get_subcommands().map(Command::get_name).collect();
            return Err(advise(
                format!("there is no subcommand {name:?}"),
                format!("name one of {}", names.join(", ")),
            ));
        };
        command = found.clone();
    }
    let title = command.get_display_name().unwrap_or("dermatome").to_owned();
    let mut page = Vec::new();
    clap_mangen::Man::new(command).title(title).render(&mut page)?;
    print(&String::from_utf8(page)?)?;
    Ok(ExitCode::SUCCESS)
}
