//! Nanoseconds per query of one engine on one mesh, as one line of numbers: for comparisons in turn.
//!
//! `contact-peers contacts MESH.obj FOLDER` writes `scattered.f32` and `path.f32`: contacts 0 to 3 mm
//! off the skin, and a walk over it in steps of half a millimetre, 1 to 1.1 mm off.
//! `contact-peers ENGINE MESH.obj FOLDER` prints `single path batch build bytes-per-triangle` of
//! `dermatome`, `obvhs` (ordered scalar traversal of its binary tree) or `parry`; a dash where an engine
//! has none. `dermatome` answers the path with the last hit at hand, and the batch with all threads.

mod engines;
mod mesh;

use std::{hint::black_box, path::Path, time::Instant};

use mesh::Mesh;

/// Rounds over all contacts, of which the median counts.
const ROUNDS: usize = 9;

type Error = Box<dyn std::error::Error>;

/// Median nanoseconds per contact of `answer`.
pub fn nanoseconds(contacts: &[[f32; 3]], mut answer: impl FnMut(&[[f32; 3]]) -> f64) -> f64 {
    let mut rounds: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            black_box(answer(black_box(contacts)));
            start.elapsed().as_secs_f64() * 1e9 / contacts.len() as f64
        })
        .collect();
    rounds.sort_by(f64::total_cmp);
    rounds[ROUNDS / 2]
}

fn main() -> Result<(), Error> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [engine, file, folder] = args.as_slice() else {
        return Err("usage: contact-peers contacts|dermatome|obvhs|parry MESH.obj FOLDER".into());
    };
    let (mesh, folder) = (Mesh::read(Path::new(file))?, Path::new(folder));
    if engine == "contacts" {
        mesh::write_contacts(&folder.join("scattered.f32"), &mesh.scattered(1 << 15))?;
        return mesh::write_contacts(&folder.join("path.f32"), &mesh.walk(1 << 15)?);
    }
    let scattered = mesh::read_contacts(&folder.join("scattered.f32"))?;
    let path = mesh::read_contacts(&folder.join("path.f32"))?;
    let times = match engine.as_str() {
        "dermatome" => engines::dermatome(&mesh, &scattered, &path)?,
        "obvhs" => engines::obvhs(&mesh, &scattered, &path),
        "parry" => engines::parry(&mesh, &scattered, &path)?,
        other => return Err(format!("no engine {other:?}").into()),
    };
    let column = |ns: Option<f64>| ns.map_or("-".to_owned(), |ns| format!("{ns:.1}"));
    println!("{}", times.map(column).join(" "));
    Ok(())
}
