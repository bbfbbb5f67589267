//! The paths of an invocation, and what the shell completes.

use std::any::TypeId;
use std::path::{Path, PathBuf};

use clap::{Arg, ArgMatches, Command, ValueHint};

use crate::options::{
    BoundaryArg, CutArg, InPath, JointsArg, LayoutArg, MayRead, ModuleArg, ModulesArg, OutFile, OutFolder,
    RegionSource, SkipArg,
};

/// The paths of an invocation.
pub(crate) struct GivenPaths {
    pub(crate) inputs: Vec<PathBuf>,
    pub(crate) files: Vec<PathBuf>,
    pub(crate) folders: Vec<PathBuf>,
}

impl GivenPaths {
    pub(crate) fn of(given: &ArgMatches) -> Self {
        let mut inputs = all::<InPath>(given);
        inputs.extend(all_read::<CutArg>(given));
        inputs.extend(all_read::<BoundaryArg>(given));
        inputs.extend(all_read::<JointsArg>(given));
        inputs.extend(all_read::<LayoutArg>(given));
        inputs.extend(all_read::<RegionSource>(given));
        inputs.extend(all_read::<ModuleArg>(given));
        inputs.extend(all_read::<ModulesArg>(given));
        inputs.extend(all_read::<SkipArg>(given));
        Self { inputs, files: all::<OutFile>(given), folders: all::<OutFolder>(given) }
    }
}

/// The values of all arguments of a type.
fn values<T: Clone + Send + Sync + 'static>(given: &ArgMatches) -> impl Iterator<Item = &T> {
    given.ids().filter_map(|id| given.try_get_many::<T>(id.as_str()).ok().flatten()).flatten()
}

fn all<T: AsRef<Path> + Clone + Send + Sync + 'static>(given: &ArgMatches) -> Vec<PathBuf> {
    values::<T>(given).map(|path| path.as_ref().to_owned()).collect()
}

fn all_read<T: MayRead>(given: &ArgMatches) -> impl Iterator<Item = PathBuf> {
    values::<T>(given).filter_map(MayRead::file).map(Path::to_owned)
}

/// Lets the shell complete the names of files and folders.
pub(crate) fn with_hints(command: Command) -> Command {
    let has_type = |arg: &Arg, types: &[TypeId]| types.iter().any(|t| arg.get_value_parser().type_id() == *t);
    let hinted = |arg: Arg| {
        let files = [
            TypeId::of::<OutFile>(),
            TypeId::of::<CutArg>(),
            TypeId::of::<BoundaryArg>(),
            TypeId::of::<LayoutArg>(),
            TypeId::of::<RegionSource>(),
            TypeId::of::<ModuleArg>(),
            TypeId::of::<ModulesArg>(),
            TypeId::of::<SkipArg>(),
        ];
        if has_type(&arg, &[TypeId::of::<InPath>()]) {
            arg.value_hint(ValueHint::AnyPath)
        } else if has_type(&arg, &files) || has_type(&arg, &[TypeId::of::<JointsArg>()]) {
            arg.value_hint(ValueHint::FilePath)
        } else if has_type(&arg, &[TypeId::of::<OutFolder>()]) {
            arg.value_hint(ValueHint::DirPath)
        } else {
            arg
        }
    };
    command.mut_args(hinted).mut_subcommands(with_hints)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::Cli;

    /// A bare path would be neither known as an input nor checked as an output.
    #[test]
    fn every_path_says_whether_it_is_read_or_written() {
        for command in Cli::command().get_subcommands() {
            for arg in command.get_arguments() {
                let parser = arg.get_value_parser().type_id();
                assert!(parser != TypeId::of::<PathBuf>(), "{} {}", command.get_name(), arg.get_id());
            }
        }
    }
}
