//! Nanoseconds per query of one engine on one mesh, as one line of numbers: for comparisons in turn.
//!
//! `contact-peers contacts MESH.obj FOLDER` writes `scattered.f32` and `path.f32`: contacts 0 to 3 mm
//! off the skin, and a walk over it in steps of half a millimetre, 1 to 1.1 mm off.
//! `contact-peers ENGINE MESH.obj FOLDER` prints `single path batch build` (three times in
//! nanoseconds a contact, one in milliseconds) of `dermatome`, `obvhs` (ordered scalar traversal of its
//! binary tree) or `parry`; a dash where an engine has none. `dermatome` answers a batch of
//! a million contacts with all threads. `dermatome8` and `kiddo` print nanoseconds for the eight vertices
//! nearest to a contact and the sum of all their distances.

mod engines;
mod mesh;
#[path = "../../../benches/numbers/mod.rs"]
mod numbers;

use std::{hint::black_box, path::Path, time::Instant};

use mesh::Mesh;

/// Rounds over all contacts.
const ROUNDS: usize = 15;

/// Contacts that are timed together.
const FEW: usize = 256;

type Error = Box<dyn std::error::Error>;

/// Nanoseconds per contact of `answer`: the fastest round for each few contacts, so that other work on
/// the machine disturbs no more than some of them.
pub fn nanoseconds(contacts: &[[f32; 3]], mut answer: impl FnMut(&[[f32; 3]]) -> f64) -> f64 {
    let mut fastest = vec![f64::INFINITY; contacts.len().div_ceil(FEW)];
    for _ in 0..ROUNDS {
        for (fastest, few) in fastest.iter_mut().zip(contacts.chunks(FEW)) {
            let start = Instant::now();
            black_box(answer(black_box(few)));
            *fastest = fastest.min(start.elapsed().as_secs_f64());
        }
    }
    fastest.iter().sum::<f64>() * 1e9 / contacts.len() as f64
}

fn main() -> Result<(), Error> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [engine, file, folder] = args.as_slice() else {
        return Err("usage: contact-peers contacts|dermatome|obvhs|parry|dermatome8|kiddo MESH.obj FOLDER".into());
    };
    let (mesh, folder) = (Mesh::read(Path::new(file))?, Path::new(folder));
    if engine == "contacts" {
        mesh::write_contacts(&folder.join("scattered.f32"), &mesh.scattered(1 << 15))?;
        return mesh::write_contacts(&folder.join("path.f32"), &mesh.walk(1 << 15)?);
    }
    let scattered = mesh::read_contacts(&folder.join("scattered.f32"))?;
    let path = mesh::read_contacts(&folder.join("path.f32"))?;
    let pair = match engine.as_str() {
        "dermatome8" => Some(engines::dermatome_nearest(&mesh, &scattered)?),
        "kiddo" => Some(engines::kiddo(&mesh, &scattered)?),
        _ => None,
    };
    if let Some([first, second]) = pair {
        println!("{first:.1} {second:.6}");
        return Ok(());
    }
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
