//! Recordings read frame by frame, on their way to a map: 642 taxels, in every format.

use std::{fs, hint::black_box, path::Path};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    io::{ReadingsColumns, ReadingsLayout, ReadingsReader, ReadingsWriter},
    map::SkinMap,
    mesh::shapes,
    signal::{Channel, ConditionOptions, Conditioner, Duplicates, Frame, Join, Stage},
    skin::Skin,
};

/// Readings of `frames` frames that differ.
fn write(path: &Path, skin: &Skin, frames: u32) {
    let mut frame = Frame::new(&SkinMap::flat(shapes::lattice(107, 6, 0.005), 1e-3), 1);
    let mut writer = ReadingsWriter::create(
        path,
        skin.patches.iter().map(|p| &p.taxels),
        ReadingsColumns { channels: &[Channel::new("force", "N").unwrap()], has_times: true },
    )
    .expect("a file");
    for t in 0..frames {
        frame.time = f64::from(t) * 0.004;
        for (k, x) in (0..).zip(frame.values.iter_mut().flatten().flat_map(|taxels| taxels.iter_mut())) {
            *x = f64::from((t * 7919 + k * 104_729) % 65_536) / 1024.0;
        }
        writer.write(&frame).expect("room for the file");
    }
    writer.finish().expect("room for the file");
}

/// CySkin's text, with whole numbers.
fn cyskin(frames: u32) -> String {
    let words = |of: &dyn Fn(u32) -> u32| (0..642).map(|k| of(k).to_string()).collect::<Vec<_>>().join(" ");
    let row =
        |t: u32| format!("{t} {:.6} {}\n", f64::from(t) * 0.1, words(&|k| (t * 7919 + k * 104_729) % 1024));
    words(&|k| k + 1) + "\n" + &(0..frames).map(row).collect::<String>()
}

fn read(path: &Path) -> f64 {
    let mut reader = ReadingsReader::open(path, ReadingsLayout::default()).expect("sound readings");
    let (mut values, mut time, mut sum) = (Vec::new(), 0.0, 0.0);
    while reader.read(&mut values, &mut time).expect("sound readings") {
        sum += values[0];
    }
    sum
}

fn readings(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder for the files");
    let skin = Skin::from_mesh("cover", shapes::lattice(107, 6, 0.005));
    let mut group = c.benchmark_group("read_642_taxels");
    group.sample_size(10);
    for frames in [100, 1000] {
        group.throughput(Throughput::Elements(u64::from(frames)));
        for name in ["a.csv", "a.txt", "a.npz"] {
            let path = folder.path().join(name);
            match name {
                "a.txt" => fs::write(&path, cyskin(frames)).expect("room for the file"),
                _ => write(&path, &skin, frames),
            }
            group.bench_function(BenchmarkId::new(name, frames), |b| b.iter(|| read(black_box(&path))));
        }
    }
    group.finish();
}

fn frames(c: &mut Criterion) {
    let map = SkinMap::flat(shapes::lattice(107, 6, 0.005), 1e-3);
    let ids: Vec<_> = map.patches.iter().flat_map(|patch| patch.taxels.ids.iter().rev().copied()).collect();
    let join = Join::new(&map, Some(&ids), ids.len(), Duplicates::Refuse).expect("the ids of the map");
    let values: Vec<f64> = (0..642).map(f64::from).collect();
    let mut frame = Frame::new(&map, 1);
    c.bench_function("join_642_taxels", |b| b.iter(|| join.fill(black_box(&values), &mut frame)));
    let options = ConditionOptions { split_hz: Some(5.0), clip: Some([0.0, 600.0]), ..Default::default() };
    let mut conditioner = Conditioner::new(&map, &[Channel::default()], &options).expect("usable options");
    c.bench_function("split_642_taxels", |b| {
        b.iter(|| {
            frame.time += 0.004;
            black_box(conditioner.apply(&frame));
        });
    });
}

criterion_group!(benches, readings, frames);
criterion_main!(benches);
