//! Files of a cap of 100 000 triangles in and out, and rows of contacts and lookups per second.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]
#![allow(clippy::unwrap_used, reason = "a bench may stop at the first surprise")]

use std::{
    fmt::Write,
    hint::black_box,
    io,
    path::{Path, PathBuf},
};

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    id::{FaceId, VertexId},
    io::{LookupRow, read_contacts, read_draft, write_flat, write_lookups, write_skin},
    mesh::shapes,
    pyramid::LevelId,
    skin::{Skin, TaxelId},
};
use glam::DVec2;

const FACES: usize = 100_000;
const ROWS: u32 = 100_000;

fn files(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let mesh = shapes::cap(FACES, 0.1, 1.9);
    let skin = Skin::from_mesh("cap", mesh.clone());
    let mut group = c.benchmark_group("100k_triangles");
    group.sample_size(10);
    for kind in ["json", "obj", "ply", "stl", "csv"] {
        let path = folder.path().join(format!("cap.{kind}"));
        group.bench_function(format!("write_{kind}"), |b| b.iter(|| write_skin(&path, &skin).unwrap()));
        group.bench_function(format!("read_{kind}"), |b| {
            b.iter_batched(|| (), |()| read_draft(&path).unwrap(), BatchSize::PerIteration);
        });
    }
    let uv = mesh.positions.map(|p| DVec2::new(p.x, p.y));
    for kind in ["npz", "obj"] {
        let path: PathBuf = folder.path().join(format!("flat.{kind}"));
        group.bench_function(format!("write_flat_{kind}"), |b| {
            b.iter(|| write_flat(&path, &mesh, &uv).unwrap())
        });
    }
    group.finish();
}

fn tables(c: &mut Criterion) {
    let mut group = c.benchmark_group("tables");
    group.throughput(Throughput::Elements(ROWS.into()));
    group.sample_size(20);
    let mut contacts = String::from("x,y,z,nx,ny,nz,force\n");
    for k in 0..ROWS {
        let x = f64::from(k).sin();
        writeln!(contacts, "{x:?},{:?},{:?},0,0,1,{:?}", x / 3.0, x / 7.0, x * x).unwrap();
    }
    group.bench_function("contacts_in", |b| {
        b.iter(|| {
            let (_, rows) = read_contacts(Path::new("-"), contacts.as_bytes()).unwrap();
            rows.map(|row| black_box(row.unwrap()).position.x).sum::<f64>()
        });
    });
    group.bench_function("lookups_out", |b| {
        b.iter(|| {
            write_lookups(Path::new("-"), io::sink(), |write| {
                (0..ROWS).try_for_each(|k| {
                    let x = f64::from(k).sin();
                    write(&LookupRow {
                        contact: k.into(),
                        level: LevelId::new(0),
                        patch: "upper_arm/left",
                        face: FaceId::from(k),
                        barycentric: [x, x / 3.0, 1.0 - x / 3.0 - x],
                        map: DVec2::new(x / 5.0, x / 7.0),
                        pixel: [k % 512, k % 256],
                        field: VertexId::from(k / 2),
                        taxel: TaxelId(k),
                        distance: x * 1e-3,
                    })
                })
            })
        });
    });
    group.finish();
}

criterion_group!(benches, files, tables);
criterion_main!(benches);
