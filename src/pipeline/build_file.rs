//! From the file of a skin to the files of its maps.

use std::{fs, path::Path};

use crate::{
    Error,
    atlas::skin_images,
    io::{IoError, StagedFiles, read_draft, write_images, write_map},
    pipeline::{BuildOptions, Built, build_with_progress},
    skin::{AssembleOptions, assemble},
};

/// Reads a skin, builds its maps and writes them to a folder, which is made if it does not exist:
/// `map.glb`, every level with its map, and `map.exr`, the images of what each pixel shows. Both appear
/// together, or neither. Returns the map.
///
/// The skin is assembled with the default options, and what that changed is not returned: who needs either calls
/// [`read_draft`], [`assemble()`] and [`build`](crate::pipeline::build).
///
/// ```
/// use dermatome::{BuildOptions, build_file, read_map};
///
/// # let folder = tempfile::tempdir()?;
/// # let out = folder.path();
/// let built = build_file("meshes/sphere_cap.glb".as_ref(), out, &BuildOptions::default())?;
/// assert_eq!(read_map(&out.join("map.glb"))?.patches.len(), built.map.patches.len());
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A file that cannot be read or written, a skin that is not sound, and those of [`build`](crate::pipeline::build).
pub fn build_file(skin: &Path, folder: &Path, options: &BuildOptions) -> Result<Built, Error> {
    let draft = read_draft(skin)?;
    let assemble_options = AssembleOptions { keep_going: options.keep_going, ..AssembleOptions::default() };
    let skin = assemble(&draft, &assemble_options)?.skin;
    fs::create_dir_all(folder).map_err(|source| IoError::Write { path: folder.into(), source })?;
    let built = build_with_progress(&skin, options, &|_| ())?;
    let images = skin_images(&built.map)?;
    let mut files = StagedFiles::default();
    files.stage(|| write_map(&folder.join("map.glb"), &built.map))?;
    files.stage(|| write_images(&folder.join("map.exr"), &images))?;
    files.publish()?;
    Ok(built)
}
