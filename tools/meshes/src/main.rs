//! Writes the inputs of `meshes/`: `cargo run --release -p meshes -- meshes`.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

use dermatome::io::{skin_to_bytes, write_skin};
use meshes::hand;
use meshes::sleeve::{bent, sleeve};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("meshes"), PathBuf::from);
    for (name, generate) in meshes::ALL {
        write_skin(&folder.join(name).with_extension("glb"), &generate())?;
    }
    let rows = hand::landmarks().into_iter().map(|[own, other]| format!("{},{}\n", own.0, other.0));
    let table = "taxel_id,atlas_taxel_id\n".to_owned() + &rows.collect::<String>();
    fs::write(folder.join("hands.csv"), table)?;
    let name = Path::new("sleeve.glb");
    let bent = bent(&skin_to_bytes(name, &sleeve())?).ok_or("a GLB file is needed")?;
    fs::write(folder.join(name), bent)?;
    Ok(())
}
