//! Laws of unfolding: it begins with the skin, ends with the map, and keeps lengths on the way.

use std::path::Path;

use dermatome::cut::PlaceId;
use dermatome::id::{FaceId, IdVec};
use dermatome::io::read_draft;
use dermatome::map::{MapLevel, PatchMap, SkinMap};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::skin::{AssembleOptions, Skin, assemble};
use dermatome::unfold::Unfolding;
use glam::DVec3;

fn map_of(mesh: TriMesh) -> SkinMap {
    build(&Skin::from_mesh("skin", mesh), &BuildOptions::default()).unwrap()
}

fn map_of_file(name: &str) -> SkinMap {
    let draft = read_draft(&Path::new("meshes").join(name)).unwrap();
    let skin = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    build(&skin, &BuildOptions::default()).unwrap()
}

fn finest(patch: &PatchMap) -> &MapLevel {
    &patch.levels[LevelId::new(0)]
}

/// Lengths of the sides of all triangles.
fn lengths(map: &MapLevel, at: &IdVec<PlaceId, DVec3>) -> Vec<f64> {
    let faces = 0..map.level.mesh.triangles.len();
    let of_face = |face| {
        let [a, b, c] = map.places(FaceId::new(face)).map(|place| at[place]);
        [a.distance(b), b.distance(c), c.distance(a)]
    };
    faces.flat_map(of_face).collect()
}

/// Ratios, or their inverses, of lengths halfway to the mean of those at both ends: the mean, and what half a
/// hundredth of them exceed.
fn errors_at_half(patch: &PatchMap) -> [f64; 2] {
    let unfolding = Unfolding::new(patch).unwrap();
    let [skin, half, flat] = [0.0, 0.5, 1.0].map(|time| lengths(finest(patch), &unfolding.at(time)));
    let course = skin.iter().zip(&flat).map(|(a, b)| 0.5 * (a + b));
    let mut ratios: Vec<f64> = half.iter().zip(course).map(|(l, m)| (l / m).max(m / l)).collect();
    ratios.sort_unstable_by(f64::total_cmp);
    [ratios.iter().sum::<f64>() / ratios.len() as f64, ratios[ratios.len() - 1 - ratios.len() / 200]]
}

#[test]
fn unfolding_begins_with_the_skin_and_ends_with_the_map() {
    for map in [map_of(shapes::cap(900, 0.1, 1.2)), map_of(shapes::tube(60, 40, 0.05, 0.2))] {
        let patch = map.patches.iter().next().unwrap();
        let unfolding = Unfolding::new(patch).unwrap();
        let map = finest(patch);
        for (place, at) in unfolding.at(0.0).enumerate() {
            let skin = map.level.mesh.positions[map.vertex_of(place)];
            assert!(at.distance(skin) < 1e-12, "place {place} begins at {at}, not {skin}");
        }
        for (place, at) in unfolding.at(1.0).enumerate() {
            let flat = unfolding.sheet.transform_point3(map.uv[place].extend(0.0));
            assert!(at.distance(flat) < 1e-12, "place {place} ends at {at}, not {flat}");
        }
    }
}

/// The level with key frames is coarser than the skin here, and cut: its places must go with the right
/// side of the seam.
#[test]
fn a_cut_tube_unrolls_isometrically_at_every_time() {
    let map = map_of(shapes::tube(120, 60, 0.05, 0.25));
    let patch = map.patches.iter().next().unwrap();
    assert!(finest(patch).cut.is_some() && finest(patch).uv.len() > 2000);
    let unfolding = Unfolding::new(patch).unwrap();
    assert!(unfolding.level > LevelId::new(0));
    let skin = lengths(finest(patch), &unfolding.at(0.0));
    for time in [0.25, 0.5, 0.75] {
        for (length, skin) in lengths(finest(patch), &unfolding.at(time)).iter().zip(&skin) {
            assert!((length / skin - 1.0).abs() < 0.03, "at {time}: {length} m, {skin} m on the skin");
        }
    }
}

/// On the glove one side in two hundred, across the folds between its fingers, is off by more than a tenth.
#[test]
fn lengths_halfway_are_means_of_both_ends() {
    for (name, most) in [
        ("sleeve.glb", [1.01, 1.1]),
        ("forearm.glb", [1.01, 1.1]),
        ("hand.glb", [1.01, 1.1]),
        ("glove.glb", [1.011, 1.15]),
        ("robot.glb", [1.011, 1.1]),
    ] {
        for patch in &map_of_file(name).patches {
            let [mean, large] = errors_at_half(patch);
            assert!(mean < most[0] && large < most[1], "{name}, {}: {mean} and {large}", patch.name);
        }
    }
}

#[test]
fn the_same_patch_unfolds_to_the_same_bits() {
    let map = map_of(shapes::ball(12, 0.1));
    let patch = map.patches.iter().next().unwrap();
    let [a, b] = [(); 2].map(|()| Unfolding::new(patch).unwrap().at(0.5));
    assert_eq!(a.as_slice(), b.as_slice());
}
