//! Where the files of a robot description are: `package://NAME/PATH`, `file:///PATH` or a path.

use std::{
    env,
    path::{Component, Path, PathBuf},
};

use crate::io::{IoError, error::Result, file::invalid};

/// Where packages are looked for, besides the folders above the description.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Packages {
    /// The folders of some packages, by name; one that is named is looked for nowhere else.
    pub folders: Vec<(String, PathBuf)>,
    /// Folders in which packages lie, or that are packages.
    pub paths: Vec<PathBuf>,
}

impl Packages {
    /// Those of the environment: `ROS_PACKAGE_PATH`, and the folder `share` of each of `AMENT_PREFIX_PATH`.
    pub fn from_env() -> Self {
        let paths = |name| {
            env::var_os(name).map(|all| env::split_paths(&all).collect::<Vec<_>>()).unwrap_or_default()
        };
        let mut found = paths("ROS_PACKAGE_PATH");
        found.extend(paths("AMENT_PREFIX_PATH").into_iter().map(|prefix| prefix.join("share")));
        Self { folders: Vec::new(), paths: found }
    }

    /// The file that `url` names in the description `path`, where `element` says so.
    ///
    /// # Errors
    /// If it is not there, leaves its package, or is named in another way.
    pub(super) fn find(&self, path: &Path, element: &str, url: &str) -> Result<PathBuf> {
        let file = match url.split_once("://") {
            // Without a folder it is a file beside the description.
            Some(("package", rest)) => match rest.trim_start_matches('/') {
                rest if rest.contains('/') => return self.in_package(path, element, url, rest),
                file => file,
            },
            Some(("file", file)) => file,
            None => url,
            Some(_) => {
                let needed = "package://NAME/PATH, file:///PATH, or a path";
                return Err(invalid(path, element, url, needed));
            }
        };
        let file = path.parent().unwrap_or(Path::new("")).join(file);
        let missing = || IoError::MeshFile {
            path: path.into(),
            element: element.into(),
            url: url.into(),
            package: None,
            searched: vec![file.clone()],
        };
        if file.is_file() { Ok(file) } else { Err(missing()) }
    }

    fn in_package(&self, path: &Path, element: &str, url: &str, rest: &str) -> Result<PathBuf> {
        let (name, rest) = rest.split_once('/').unwrap_or((rest, ""));
        let mut depth = 0;
        for part in Path::new(rest).components() {
            depth += match part {
                Component::Normal(_) => 1,
                Component::CurDir => 0,
                _ => -1,
            };
            if depth < 0 {
                return Err(invalid(path, element, url, "a file of the package, not above it"));
            }
        }
        let given: Vec<PathBuf> = self
            .folders
            .iter()
            .filter(|(given, _)| given == name)
            .map(|(_, folder)| folder.clone())
            .collect();
        let folders = if given.is_empty() { self.folders_of(path, name) } else { given };
        let found = folders.iter().map(|folder| folder.join(rest)).find(|file| file.is_file());
        found.ok_or_else(|| IoError::MeshFile {
            path: path.into(),
            element: element.into(),
            url: url.into(),
            package: Some(name.into()),
            searched: folders,
        })
    }

    /// The folders that a package may be: of its name, above the description or in one of the paths.
    fn folders_of(&self, path: &Path, name: &str) -> Vec<PathBuf> {
        let path = path.canonicalize().unwrap_or_else(|_| path.into());
        let above = path.ancestors().skip(1).map(Path::to_path_buf);
        let mut folders: Vec<PathBuf> = Vec::new();
        for folder in above.chain(self.paths.iter().cloned()) {
            let own = folder.file_name().is_some_and(|own| own == name).then(|| folder.clone());
            for folder in own.into_iter().chain([folder.join(name)]).filter(|folder| folder.is_dir()) {
                if !folders.contains(&folder) {
                    folders.push(folder);
                }
            }
        }
        folders
    }
}
