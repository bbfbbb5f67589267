//! Files of pictures: their kinds, and how they are written.

use std::path::Path;

use dermatome::Error;
use dermatome::io::IoError;
use dermatome::plot::Picture;

use crate::files::outputs::{self, is_stream, write_bytes};
use crate::options::Common;

#[derive(Clone, Copy)]
pub(crate) enum PictureKind {
    Svg,
    Png,
}

/// The extension determines the format; standard output is SVG.
pub(crate) fn picture_kind(path: &Path) -> Result<PictureKind, Error> {
    if is_stream(path) {
        return Ok(PictureKind::Svg);
    }
    match outputs::kind(path).as_str() {
        "svg" => Ok(PictureKind::Svg),
        "png" => Ok(PictureKind::Png),
        _ => Err(IoError::UnknownKind { path: path.to_owned(), known: ".svg, .png" }.into()),
    }
}

/// Writes a picture to a file that is no stream; it appears with the other outputs.
pub(crate) fn write_picture(path: &Path, picture: &Picture, common: &Common) -> Result<(), Error> {
    let bytes = match picture_kind(path)? {
        PictureKind::Svg => picture.to_svg().into_bytes(),
        PictureKind::Png => picture.to_png()?,
    };
    Ok(write_bytes(&common.outputs.file(path), &bytes)?)
}
