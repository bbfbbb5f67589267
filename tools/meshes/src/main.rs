//! Writes the inputs of `meshes/`: `cargo run --release -p meshes -- meshes`.

use std::{error::Error, path::PathBuf};

use dermatome::io::write_skin;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("meshes"), PathBuf::from);
    for (name, generate) in meshes::ALL {
        write_skin(&folder.join(name).with_extension("glb"), &generate())?;
    }
    Ok(())
}
