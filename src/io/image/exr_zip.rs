use std::io::{self, Write};

use flate2::{Compression, write::ZlibEncoder};

/// Effort of the deflate. The samples are mostly noise in their low bytes: level 1 already finds what there is to find.
const EFFORT: Compression = Compression::new(1);

/// The ZIP compression of OpenEXR for one block of little-endian samples: even bytes before odd ones, so that exponents
/// stand beside exponents, then differences of neighbouring bytes, then zlib. A block that does not shrink stays as it
/// is, as the format wants it.
///
/// Written here because the exr crate's own deflate takes three times as long, and most of the time of an image.
///
/// # Errors
/// Whatever the encoder says; writing to memory it says nothing.
pub(super) fn compress(block: Vec<u8>) -> io::Result<Vec<u8>> {
    let mut bytes: Vec<u8> =
        block.iter().step_by(2).chain(block.iter().skip(1).step_by(2)).copied().collect();
    let mut previous = 128_u8;
    for byte in &mut bytes {
        let this = *byte;
        // The first byte stays, the others become differences around 128.
        *byte = this.wrapping_sub(previous).wrapping_add(128);
        previous = this;
    }
    let mut encoder = ZlibEncoder::new(Vec::with_capacity(block.len() / 2), EFFORT);
    encoder.write_all(&bytes)?;
    let packed = encoder.finish()?;
    Ok(if packed.len() < block.len() { packed } else { block })
}
