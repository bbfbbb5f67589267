//! Drafts of skins from files of all kinds.

use std::path::Path;

#[cfg(feature = "robots")]
use crate::io::file::file_kind;
use crate::io::file::{Source, exists};
use crate::io::mesh::{MeshReader, reader_of};
#[cfg(feature = "robots")]
use crate::io::robot::{Packages, RobotSurface, draft_of, robot_of};
use crate::io::streams::{Wanted, is_vendor, read_sheet};
use crate::io::{IoError, ReadParts};
use crate::skin::Draft;

/// Reads a skin or a mesh as it was written, by the extension of its file:
///
/// | extension | what | keeps |
/// |---|---|---|
/// | `glb`, `gltf` | glTF 2.0: every mesh of the default scene is a sheet | all, as 32 bits |
/// | `json` | robotskinlib, version 2 | ids, normals, link frame |
/// | `obj` | Wavefront OBJ: every `o` or `g` is a sheet | normals |
/// | `npz` | arrays of numpy, `V`, `F`, `N` and `ids`: one sheet | ids, normals |
/// | `off` | OFF of Geomview, as text: one sheet | normals |
/// | `ply` | PLY, text or binary | ids, normals, areas, densities, presence |
/// | `stl` | STL, text or binary: every solid is a sheet | positions of 32 bits |
/// | `dae` | COLLADA: every use of a mesh in the scene is a sheet | positions |
/// | `3mf` | 3MF: every object that its build uses is a sheet | positions |
/// | `urdf` | a robot: every shape of a link, or its tactile sensors ([`read_robot`](crate::io::read_robot)) | links, ids of taxels |
/// | `xml`, `mjcf` | the same of `MuJoCo`, whose root is `<mujoco>`; or a URDF | links |
/// | `csv` | taxels, and if there triangles (`skin.triangles.csv`) | all but the frames of links |
/// | `txt` | positions of iCub taxels, without triangles | ids, normals, presence, modules |
/// | `asf`, `lst`, `asc`, `csv` | recordings of Tekscan, novel and XSENSOR: their sensors as a flat sheet, without triangles | ids, areas |
///
/// `ply`, `dae`, `3mf` and `urdf` need the feature `robots`. Every number of the draft is finite and every corner exists; nothing else has been judged.
///
/// ```
/// use dermatome::io::read_draft;
///
/// let path = std::env::temp_dir().join("dermatome-read-draft.obj");
/// std::fs::write(&path, "o palm\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
/// let draft = read_draft(&path)?;
/// assert_eq!(draft.sheets[0].name, "palm");
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the file cannot be read, is longer than 4 GiB or of an unknown kind, or breaks a rule of its
/// format.
pub fn read_draft(path: &Path) -> Result<Draft, IoError> {
    read_draft_with(path, ReadParts::default())
}

/// The same as [`read_draft`], with more parts of the file.
///
/// # Errors
/// As [`read_draft`], or if texture coordinates are not finite numbers.
pub fn read_draft_with(path: &Path, parts: ReadParts) -> Result<Draft, IoError> {
    if is_vendor(path) {
        return Ok(read_sheet(path, Wanted::default())?.into_draft());
    }
    exists(path)?;
    // A file of an unknown kind is not opened.
    let read = kind_of(path)?;
    read(Source::open(path)?, parts)
}

/// Reads the sensors of one stream of a recording that states where they are, as [`read_draft`] reads those of the only
/// one.
///
/// # Errors
/// As [`read_draft`], or if the file has no such stream.
pub fn read_draft_of_stream(path: &Path, stream: &str) -> Result<Draft, IoError> {
    Ok(read_sheet(path, Wanted { stream: Some(stream), ..Wanted::default() })?.into_draft())
}

/// Reads a skin from the content of a file, whose kind follows from the extension of `name`; it may
/// name no other files.
///
/// # Errors
/// As [`read_draft`].
pub fn draft_from_bytes(name: &Path, bytes: Vec<u8>, parts: ReadParts) -> Result<Draft, IoError> {
    kind_of(name)?(Source::from_bytes(name, bytes)?, parts)
}

/// Whether a file is a robot description, by its extension.
#[cfg(feature = "robots")]
pub fn is_robot(path: &Path) -> bool {
    matches!(file_kind(path).as_str(), "urdf" | "xml" | "mjcf")
}

fn kind_of(path: &Path) -> Result<MeshReader, IoError> {
    #[cfg(feature = "robots")]
    if is_robot(path) {
        return Ok(|source, _| {
            let robot = robot_of(&source)?;
            let packages = source.is_file().then(Packages::from_env);
            draft_of(source.path(), &robot, RobotSurface::Auto, packages.as_ref())
        });
    }
    reader_of(path)
}
