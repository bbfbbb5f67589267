//! Paths of the command line. The type of an argument says whether its file is read or written, so that no input can be
//! replaced.

use std::ffi::OsString;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use dermatome::Error;
use dermatome::design::Module;
use dermatome::io::{ReadingsLayout, file_kind, read_module};

use crate::options::values::side_mm;
use crate::options::{BoundaryArg, CutArg, JointsArg, RegionSource};

macro_rules! paths {
    ($($(#[$doc:meta])* $name:ident),*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq)]
        pub(crate) struct $name(PathBuf);

        impl From<OsString> for $name {
            fn from(text: OsString) -> Self {
                Self(text.into())
            }
        }

        impl Deref for $name {
            type Target = Path;

            fn deref(&self) -> &Path {
                &self.0
            }
        }

        impl From<&$name> for PathBuf {
            fn from(path: &$name) -> Self {
                path.0.clone()
            }
        }

        impl AsRef<Path> for $name {
            fn as_ref(&self) -> &Path {
                &self.0
            }
        }
    )*};
}

paths!(
    /// A file or folder that is read.
    InPath,
    /// A file that is written, in a folder that exists.
    OutFile,
    /// A folder that is written, or a file where its name says so; what may be there is known to the subcommand.
    OutFolder
);

/// An argument that is a word or the name of a file that is read.
pub(crate) trait MayRead: Clone + Send + Sync + 'static {
    fn file(&self) -> Option<&Path>;
}

macro_rules! may_read {
    ($($name:ident :: $variant:ident),*) => {$(
        impl MayRead for $name {
            fn file(&self) -> Option<&Path> {
                if let Self::$variant(path) = self { Some(path) } else { None }
            }
        }
    )*};
}

may_read!(
    BoundaryArg::Table,
    CutArg::Table,
    JointsArg::File,
    LandmarkSource::File,
    LayoutArg::File,
    ModulesArg::Table,
    RegionSource::File,
    SkipArg::File
);

/// A layout of readings, or the order of the axes of an array of three.
#[derive(Debug, Clone)]
pub(crate) enum LayoutArg {
    Axes(ReadingsLayout),
    File(PathBuf),
}

/// A parser of [`LayoutArg`].
pub(crate) fn layout_arg(text: &str) -> Result<LayoutArg, String> {
    match text {
        "tnc" => Ok(LayoutArg::Axes(ReadingsLayout::TaxelsFirst)),
        "tcn" => Ok(LayoutArg::Axes(ReadingsLayout::ChannelsFirst)),
        file if file_kind(Path::new(file)) == "json" => Ok(LayoutArg::File(file.into())),
        _ => Err("needed: a file that ends in .json, tnc or tcn".into()),
    }
}

/// Taxels that are left out.
#[derive(Debug, Clone)]
pub(crate) enum SkipArg {
    Ids(Vec<u32>),
    /// A table of their states.
    File(PathBuf),
}

/// A parser of [`SkipArg`].
pub(crate) fn skip_arg(text: &str) -> Result<SkipArg, String> {
    let ids: Result<Vec<u32>, _> = text.split(',').map(|id| id.trim().parse()).collect();
    match ids {
        Ok(ids) => Ok(SkipArg::Ids(ids)),
        Err(_) if file_kind(Path::new(text)) == "csv" => Ok(SkipArg::File(text.into())),
        Err(_) => {
            Err("needed: ids of taxels as in 3,17, or a .csv that `check --recording -o` writes".into())
        }
    }
}

/// Which taxels are one module: those whose ids give the same number divided by the size of a module, or as a table says.
#[derive(Debug, Clone)]
pub(crate) enum ModulesArg {
    Of(u32),
    Table(PathBuf),
}

/// Where landmarks come from.
#[derive(Debug, Clone)]
pub(crate) enum LandmarkSource {
    Regions,
    File(PathBuf),
}

/// A parser of [`LandmarkSource`].
pub(crate) fn landmark_source(text: &str) -> Result<LandmarkSource, String> {
    match text {
        "regions" => Ok(LandmarkSource::Regions),
        file if &*file_kind(Path::new(file)) == "csv" => Ok(LandmarkSource::File(file.into())),
        _ => Err("needed: regions, or a file that ends in .csv".into()),
    }
}

/// A module to design with: one with a name and a size, or a drawing.
#[derive(Debug, Clone)]
pub(crate) enum ModuleArg {
    Known(Module),
    File(PathBuf),
}

/// A parser of [`ModuleArg`].
pub(crate) fn module_arg(text: &str) -> Result<ModuleArg, String> {
    let sides = |sides: &str| sides.split(':').map(|side| side_mm(side).ok()).collect::<Option<Vec<_>>>();
    let known = text.split_once(':').and_then(|(kind, rest)| match (kind, &sides(rest)?[..]) {
        ("triangle", &[side]) => Some(Module::triangle(side)),
        ("hexagon", &[side]) => Some(Module::hexagon(side)),
        ("rectangle", &[width, height]) => Some(Module::rectangle(width, height)),
        _ => None,
    });
    match known {
        Some(module) => Ok(ModuleArg::Known(module)),
        None if file_kind(Path::new(text)) == "csv" => Ok(ModuleArg::File(text.into())),
        None => {
            Err("needed: triangle:L, hexagon:L or rectangle:W:H with lengths as in 32mm, or a .csv".into())
        }
    }
}

impl ModuleArg {
    /// The module.
    ///
    /// # Errors
    /// If its file cannot be read, or has no module.
    pub(crate) fn read(&self) -> anyhow::Result<Module> {
        let module = match self {
            Self::Known(module) => module.clone(),
            Self::File(path) => read_module(path).map_err(Error::from)?,
        };
        module.validate().map_err(Error::from)?;
        Ok(module)
    }
}

impl MayRead for ModuleArg {
    fn file(&self) -> Option<&Path> {
        if let Self::File(path) = self { Some(path) } else { None }
    }
}

/// A parser of [`ModulesArg`].
pub(crate) fn modules_arg(text: &str) -> Result<ModulesArg, String> {
    match text.strip_prefix("ids/").unwrap_or(text).parse() {
        Ok(0) => Err("needed: a number of taxels from 1 on, or a table".into()),
        Ok(size) => Ok(ModulesArg::Of(size)),
        Err(_) => Ok(ModulesArg::Table(text.into())),
    }
}
