//! Files of a cap of 100 000 triangles in and out, and rows of contacts and lookups per second.
#![allow(clippy::cast_possible_truncation, reason = "numbers of rows are small")]

use std::{
    fmt::Write,
    hint::black_box,
    io,
    path::{Path, PathBuf},
};

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    contact::Cell,
    id::{FaceId, VertexId},
    io::{LookupPlace, LookupRow, LookupWriter, read_contacts, read_draft, write_flat, write_skin},
    mesh::{SurfacePoint, shapes},
    pyramid::LevelId,
    skin::{Presence, Skin, TaxelId},
};
use glam::{DVec2, DVec3};

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
            rows.map(|row| black_box(row.unwrap()).position.unwrap().x).sum::<f64>()
        });
    });
    group.bench_function("lookups_out", |b| {
        b.iter(|| {
            let mut table = LookupWriter::new(Path::new("-"), io::sink(), None).unwrap();
            table.write(ROWS as usize, |k, emit| emit(&row(k as u32))).unwrap();
            table.finish()
        });
    });
    group.finish();
}

/// Where contact `k` touches, more or less.
fn row(k: u32) -> LookupRow<'static> {
    let (x, level) = (f64::from(k).sin(), LevelId::new(0));
    let barycentric = [x, x / 3.0, 1.0 - x / 3.0 - x];
    let fields = (0..3_u32).map(|i| (VertexId::from(k / 2 + i), barycentric[i as usize]));
    let cell = Cell {
        level,
        point: SurfacePoint { face: FaceId::from(k), barycentric },
        uv: DVec2::new(x / 5.0, x / 7.0),
        pixel: [k % 512, k % 256],
        field: VertexId::from(k / 2),
        taxel: TaxelId(k),
        weights: fields.collect(),
    };
    let position = DVec3::splat(x / 9.0);
    let (presence, live_taxel) = (Presence::Present, Some(cell.taxel));
    let (patch, link, normal) = ("upper_arm/left", "upper_arm", position);
    let place = LookupPlace { patch, link, region: None, cell, presence, live_taxel, position, normal };
    let (contact, distance, place) = (k.into(), x * 1e-3, Some(place));
    LookupRow { contact, level, fields: None, distance, frame: "world", place, extra: &[] }
}

criterion_group!(benches, files, tables);
criterion_main!(benches);
