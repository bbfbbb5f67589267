//! Drafts for tests: of shapes, of triangle soups, of real covers.

use std::collections::BTreeSet;

use dermatome::mesh::{Adjacency, TriMesh};
use dermatome::skin::{AssembleOptions, Assembled, Draft, Patch, Sheet, SkinError, TaxelId};
use glam::DVec3;

use crate::common::data;

/// Assembled with the default options.
pub(crate) fn assemble(draft: &Draft) -> Result<Assembled, SkinError> {
    dermatome::skin::assemble(draft, &AssembleOptions::default())
}

/// The patch of a skin that has one.
pub(crate) fn only(assembled: &Assembled) -> &Patch {
    assert_eq!(assembled.skin.patches.len(), 1, "one patch: {:?}", assembled.remarks);
    &assembled.skin.patches[0.into()]
}

/// Euler characteristic and number of boundary loops.
pub(crate) fn topology(mesh: &TriMesh) -> (i64, usize) {
    let adjacency = Adjacency::new(mesh).unwrap();
    (adjacency.euler_characteristic(), adjacency.boundary_loops().len())
}

/// The kinds of remarks, by the names of their variants.
pub(crate) fn kinds(assembled: &Assembled) -> BTreeSet<String> {
    let name = |kind: String| kind.split([' ', '{']).next().unwrap().to_owned();
    assembled.remarks.iter().map(|r| name(format!("{:?}", r.kind))).collect()
}

/// A draft of one sheet.
pub(crate) fn draft_of(sheet: Sheet) -> Draft {
    Draft { sheets: vec![sheet], ..Draft::default() }
}

/// A sheet of a mesh alone.
pub(crate) fn sheet_of(name: &str, mesh: &TriMesh) -> Sheet {
    Sheet {
        name: name.into(),
        positions: mesh.positions.as_slice().to_vec(),
        triangles: mesh.triangles.iter().map(|t| t.map(|v| v.raw())).collect(),
        ..Sheet::default()
    }
}

/// A sheet in which every face has vertices of its own, as in an STL file.
pub(crate) fn soup(name: &str, mesh: &TriMesh) -> Sheet {
    let positions = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v]);
    let faces = u32::try_from(mesh.triangles.len()).unwrap();
    Sheet {
        name: name.into(),
        positions: positions.collect(),
        triangles: (0..faces).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect(),
        ..Sheet::default()
    }
}

/// A real cover; `None` without the data from outside the repository.
pub(crate) fn cover(name: &str) -> Option<Draft> {
    let text = std::fs::read_to_string(data(&format!("cyskin/{name}"))?).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let number = |v: &serde_json::Value| v.as_u64().and_then(|n| u32::try_from(n).ok()).unwrap();
    let vector = |v: &serde_json::Value| DVec3::from_array([0, 1, 2].map(|k| v[k].as_f64().unwrap()));
    let taxels = json["skin"]["taxels"].as_array().unwrap();
    let faces = json["skin"]["faces"].as_array().unwrap();
    Some(draft_of(Sheet {
        name: "cover".into(),
        positions: taxels.iter().map(|t| vector(&t["x"])).collect(),
        triangles: faces.iter().map(|f| [0, 1, 2].map(|k| number(&f[k]))).collect(),
        ids: Some(taxels.iter().map(|t| TaxelId(number(&t["id"]))).collect()),
        normals: Some(taxels.iter().map(|t| vector(&t["n"])).collect()),
        ..Sheet::default()
    }))
}
