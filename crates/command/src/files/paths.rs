//! The paths of an invocation, and what the shell completes.

use std::any::TypeId;
use std::path::{Path, PathBuf};

use clap::{Arg, ArgMatches, Command, ValueHint};

use crate::options::{
    BoundaryArg, CutArg, InPath, JointsArg, LandmarkSource, LayoutArg, MayRead, ModuleArg, ModulesArg,
    OutFile, OutFolder, RegionSource, SkipArg,
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
        READ.iter().for_each(|(_, all)| inputs.extend(all(given)));
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

fn all_read<T: MayRead>(given: &ArgMatches) -> Vec<PathBuf> {
    values::<T>(given).filter_map(MayRead::file).map(Path::to_owned).collect()
}

/// The type of an argument that may be the name of a file that is read, and these files.
type Readable = (fn() -> TypeId, fn(&ArgMatches) -> Vec<PathBuf>);

const READ: [Readable; 9] = [
    (TypeId::of::<BoundaryArg>, all_read::<BoundaryArg>),
    (TypeId::of::<CutArg>, all_read::<CutArg>),
    (TypeId::of::<JointsArg>, all_read::<JointsArg>),
    (TypeId::of::<LayoutArg>, all_read::<LayoutArg>),
    (TypeId::of::<ModuleArg>, all_read::<ModuleArg>),
    (TypeId::of::<ModulesArg>, all_read::<ModulesArg>),
    (TypeId::of::<LandmarkSource>, all_read::<LandmarkSource>),
    (TypeId::of::<RegionSource>, all_read::<RegionSource>),
    (TypeId::of::<SkipArg>, all_read::<SkipArg>),
];

/// Lets the shell complete the names of files and folders.
pub(crate) fn with_hints(command: Command) -> Command {
    let hinted = |arg: Arg| {
        let own = arg.get_value_parser().type_id();
        if own == TypeId::of::<InPath>() {
            arg.value_hint(ValueHint::AnyPath)
        } else if own == TypeId::of::<OutFile>() || READ.iter().any(|(of, _)| own == of()) {
            arg.value_hint(ValueHint::FilePath)
        } else if own == TypeId::of::<OutFolder>() {
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
