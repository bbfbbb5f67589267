//! Drafts to skins, and what is wrong with them, for covers of many sizes.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    mesh::{TriMesh, shapes},
    skin::{AssembleOptions, Draft, Sheet, Taxels, assemble, check},
};

/// A healthy sheet with normals.
fn whole(mesh: &TriMesh) -> Draft {
    let sheet = Sheet {
        name: "cover".into(),
        positions: mesh.positions.as_slice().to_vec(),
        triangles: mesh.triangles.iter().map(|t| t.map(|v| v.raw())).collect(),
        normals: Some(Taxels::from(mesh).normals.into()),
        ..Sheet::default()
    };
    Draft { sheets: vec![sheet], ..Draft::default() }
}

/// The same with three vertices of its own for every face, as an STL file has them.
fn soup(mesh: &TriMesh) -> Draft {
    let positions = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v]).collect();
    let triangles = (0..).step_by(3).map(|v| [v, v + 1, v + 2]).take(mesh.triangles.len()).collect();
    let sheet = Sheet { name: "cover".into(), positions, triangles, ..Sheet::default() };
    Draft { sheets: vec![sheet], ..Draft::default() }
}

/// The taxels of a cap alone: about as many as asked for.
fn taxels(count: usize) -> Draft {
    let positions = shapes::cap(2 * count, 0.1, 1.9).positions.as_slice().to_vec();
    Draft { sheets: vec![Sheet { name: "cover".into(), positions, ..Sheet::default() }], ..Draft::default() }
}

fn bare(c: &mut Criterion) {
    let mut group = c.benchmark_group("bare");
    group.sample_size(10);
    for count in [500_usize, 10_000, 100_000, 1_000_000] {
        group.throughput(Throughput::Elements(count as u64));
        let draft = taxels(count);
        group.bench_with_input(BenchmarkId::new("assemble", count), &draft, |b, draft| {
            b.iter(|| assemble(draft, &AssembleOptions::default()));
        });
    }
}

fn skin(c: &mut Criterion) {
    let mut group = c.benchmark_group("skin");
    group.sample_size(10);
    for faces in [500_usize, 10_000, 100_000, 1_000_000] {
        group.throughput(Throughput::Elements(faces as u64));
        let mesh = shapes::cap(faces, 0.1, 1.9);
        let (whole, soup) = (whole(&mesh), soup(&mesh));
        group.bench_with_input(BenchmarkId::new("assemble", faces), &whole, |b, draft| {
            b.iter(|| assemble(draft, &AssembleOptions::default()));
        });
        group.bench_with_input(BenchmarkId::new("assemble_soup", faces), &soup, |b, draft| {
            b.iter(|| assemble(draft, &AssembleOptions::default()));
        });
        group.bench_with_input(BenchmarkId::new("check", faces), &whole, |b, draft| {
            b.iter(|| check(draft, &AssembleOptions::default()));
        });
    }
}

criterion_group!(benches, skin, bare);
criterion_main!(benches);
