//! Where the files of a robot description are: `package://NAME/PATH`, `file:///PATH` or a path.

use std::{
    env,
    path::{Component, Path, PathBuf},
};

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{invalid, percent_decoded};

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

    /// The file that `url` in `element` of the description `path` names.
    ///
    /// # Errors
    /// If it does not exist, is outside its package, or has a URL of another form.
    pub(super) fn find(&self, path: &Path, element: &str, url: &str) -> Result<PathBuf> {
        let file = match url.split_once("://") {
            // Without a folder it is a file beside the description.
            Some(("package", rest)) => match rest.trim_start_matches('/') {
                rest if rest.contains('/') => return self.in_package(path, element, url, rest),
                file => file,
            },
            Some(("file", file)) => {
                file.strip_prefix("localhost").filter(|file| file.starts_with('/')).unwrap_or(file)
            }
            None => url,
            Some(_) => {
                let needed = "package://NAME/PATH, file:///PATH, or a path";
                return Err(invalid(path, element, url, needed));
            }
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        let decoded = percent_decoded(file).and_then(|bytes| String::from_utf8(bytes).ok());
        let decoded = decoded.map(|name| folder.join(name));
        let file = folder.join(file);
        if let Some(decoded) = decoded.filter(|file| url.contains("://") && file.is_file()) {
            return Ok(decoded);
        }
        let missing = || IoError::MeshFile {
            path: path.into(),
            element: element.into(),
            url: url.into(),
            package: None,
            searched: vec![file.clone()],
            has_collision: false,
        };
        if file.is_file() {
            return Ok(file);
        }
        // Bullet takes names from the folder of its data, above that of the description.
        let is_from_above = !url.contains("://") && url.contains('/') && Path::new(url).is_relative();
        let from_above = is_from_above.then(|| self.in_package(path, element, url, url).ok()).flatten();
        from_above.ok_or_else(missing)
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
            if depth < 0 || [".", ".."].contains(&name) {
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
            has_collision: false,
        })
    }

    /// The folders that a package may be: of its name, above the description or in one of the paths.
    fn folders_of(&self, path: &Path, name: &str) -> Vec<PathBuf> {
        let path = path.canonicalize().unwrap_or_else(|_| path.into());
        let above = path.ancestors().skip(1).map(Path::to_path_buf);
        let mut folders: Vec<PathBuf> = Vec::new();
        for folder in above.chain(self.paths.iter().cloned()) {
            let is_own = folder.file_name().is_some_and(|own| own == name) || is_package(&folder, name);
            let own = is_own.then(|| folder.clone());
            for folder in own.into_iter().chain([folder.join(name)]).filter(|folder| folder.is_dir()) {
                if !folders.contains(&folder) {
                    folders.push(folder);
                }
            }
        }
        folders
    }
}

/// Whether the `package.xml` of a folder names this package.
fn is_package(folder: &Path, name: &str) -> bool {
    let text = std::fs::read_to_string(folder.join("package.xml")).unwrap_or_default();
    let own = text.split_once("<name>").and_then(|(_, rest)| rest.split_once("</name>"));
    own.is_some_and(|(own, _)| own.trim() == name)
}
