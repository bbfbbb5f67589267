//! What joins the patches of a body: gap links and levels, for sizes that show how time grows.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    body::{body_levels, gap_links},
    id::IdVec,
    mesh::{TriMesh, shapes},
    pyramid::{CoarsenOptions, Level, coarsen},
    run::Run,
    skin::{LinkId, Patch, PatchId, Skin},
};
use glam::DVec3;

/// Meshes on one link.
fn body(meshes: impl IntoIterator<Item = TriMesh>) -> Skin {
    let patches = meshes.into_iter().map(|mesh| Patch::from_mesh("part", LinkId::default(), mesh));
    Skin { patches: patches.collect(), ..Skin::from_mesh("part", shapes::lattice(2, 2, 0.005)) }
}

/// Panels of 16 x 16 taxels in rows, with gaps.
fn panels(rows: u32) -> Skin {
    let panel = |k: u32| {
        let corner = DVec3::new(f64::from(k % rows) * 0.09, f64::from(k / rows) * 0.075, 0.0);
        let mut mesh = shapes::lattice(16, 16, 0.005);
        mesh.positions.iter_mut().for_each(|p| *p += corner);
        mesh
    };
    body((0..rows * rows).map(panel))
}

/// Four tubes side by side, with vertices on their rims alone, as CAD writes them.
fn tubes(count: u32) -> Skin {
    let tube = |k: u32| {
        let mut mesh = shapes::tube(count, 2, 0.01, 0.1);
        mesh.positions.iter_mut().for_each(|p| p.x += 0.022 * f64::from(k));
        mesh
    };
    body((0..4).map(tube))
}

fn links(c: &mut Criterion) {
    let mut group = c.benchmark_group("gap_links");
    group.sample_size(10);
    for (name, sizes, make) in
        [("panels", [2, 4, 8], panels as fn(u32) -> Skin), ("tubes", [32, 64, 128], tubes)]
    {
        for size in sizes {
            let skin = make(size);
            let taxels: usize = skin.patches.iter().map(|patch| patch.mesh.positions.len()).sum();
            group.throughput(Throughput::Elements(taxels as u64));
            group.bench_with_input(BenchmarkId::new(name, taxels), &skin, |b, skin| {
                b.iter(|| gap_links(skin, None));
            });
        }
    }
}

fn levels(c: &mut Criterion) {
    let mut group = c.benchmark_group("body_levels");
    group.sample_size(10);
    let options = CoarsenOptions { levels: Some(1), ..CoarsenOptions::default() };
    for rows in [2, 4, 8] {
        let skin = panels(rows);
        let links = gap_links(&skin, None);
        // All panels have the same levels.
        let Some(panel) = skin.patches.first() else { continue };
        let Ok(pyramid) = coarsen(&panel.mesh, &panel.taxels, &options, Run::default()) else { continue };
        let Some(level) = pyramid.levels.iter().last() else { continue };
        let coarsest: IdVec<PatchId, &Level> = skin.patches.map(|_| level);
        let fields = coarsest.iter().map(|level| level.mesh.positions.len()).sum::<usize>();
        group.throughput(Throughput::Elements(fields as u64));
        group.bench_with_input(BenchmarkId::new("panels", fields), &skin, |b, skin| {
            b.iter(|| body_levels(skin, &links, &coarsest));
        });
    }
}

criterion_group!(benches, links, levels);
criterion_main!(benches);
