//! `info`: the patches of a skin, their size and shape.

use std::{path::PathBuf, process::ExitCode};

use dermatome::{
    Error,
    mesh::{Adjacency, mean_edge_length},
    skin::{Patch, Presence, Skin},
};
use serde_json::{Value, json};

use crate::{
    common::Common,
    input::read_skin,
    options::BareArgs,
    print::{plain, print_json, print_table},
};

/// Arguments of `info`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Skin or mesh: .glb, .gltf, .json, .obj, .ply, .stl, .csv or .txt
    file: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    bare: BareArgs,
}

/// Columns of the table, one row per patch.
const COLUMNS: [&str; 12] = [
    "name",
    "link",
    "vertices",
    "faces",
    "boundary_loops",
    "euler",
    "area_m2",
    "spacing_mm",
    "present",
    "absent",
    "thermal",
    "density_per_m2",
];

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let skin = read_skin(&args.file, &args.bare.options(), common)?;
    let rows: Vec<[Value; 12]> =
        skin.patches.iter().map(|patch| row(&skin, patch)).collect::<Result<_, Error>>()?;
    if args.json {
        let patches: Vec<Value> =
            rows.into_iter().map(|row| COLUMNS.map(String::from).into_iter().zip(row).collect()).collect();
        print_json(&json!({ "patches": patches }))?;
    } else {
        let rows: Vec<_> = rows.iter().map(|row| row.each_ref().map(cell)).collect();
        print_table(COLUMNS, 2, &rows)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn row(skin: &Skin, patch: &Patch) -> Result<[Value; 12], Error> {
    let adjacency = Adjacency::new(&patch.mesh)?;
    let count = |what| patch.taxels.presence.iter().filter(|p| **p == what).count();
    let range = |[low, high]: [f64; 2], &x: &f64| [low.min(x), high.max(x)];
    let densities = patch.taxels.densities.as_ref();
    let densities = densities.map(|all| all.iter().fold([f64::INFINITY, f64::NEG_INFINITY], range));
    Ok([
        json!(patch.name),
        json!(skin.links[patch.link].name),
        json!(patch.mesh.positions.len()),
        json!(patch.mesh.triangles.len()),
        json!(adjacency.boundary_loops().len()),
        json!(adjacency.euler_characteristic()),
        json!(patch.mesh.area()),
        json!(1e3 * mean_edge_length(&patch.mesh, &adjacency)),
        json!(count(Presence::Present)),
        json!(count(Presence::Absent)),
        json!(count(Presence::ThermalPad)),
        json!(densities),
    ])
}

/// A value as text: words bare, measures with four decimals, ranges from lowest to highest.
fn cell(value: &Value) -> String {
    match value {
        Value::String(text) => plain(text),
        Value::Null => "-".into(),
        Value::Array(range) => range.iter().map(cell).collect::<Vec<_>>().join(".."),
        Value::Number(n) if n.is_f64() => format!("{:.4}", n.as_f64().unwrap_or(f64::NAN)),
        other => other.to_string(),
    }
}
