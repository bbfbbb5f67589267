//! Reading and writing skins as GLB, in memory-backed files where the system has them.

use std::{hint::black_box, path::Path};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    io::{read_draft, write_skin},
    mesh::shapes,
    skin::Skin,
};

/// Triangles of the caps.
const SIZES: [usize; 4] = [500, 10_000, 100_000, 1_000_000];

fn skins(c: &mut Criterion) {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.expect("a folder for the files");
    for faces in SIZES {
        let skin = Skin::from_mesh("cap", shapes::cap(faces, 0.1, 1.0));
        let path = folder.path().join(format!("cap_{faces}.glb"));
        write_skin(&path, &skin).expect("a file to read");
        let mut group = c.benchmark_group("skin_glb");
        group.throughput(Throughput::Elements(faces as u64));
        group.sample_size(if faces > 100_000 { 10 } else { 50 });
        group.bench_function(BenchmarkId::new("write", faces), |b| b.iter(|| write_skin(&path, &skin)));
        group.bench_function(BenchmarkId::new("read", faces), |b| b.iter(|| read_draft(black_box(&path))));
        group.finish();
    }
}

criterion_group!(benches, skins);
criterion_main!(benches);
