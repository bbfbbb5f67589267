//! What every input of `meshes/` promises.

use std::{path::Path, sync::LazyLock};

use dermatome::{
    id::VertexId,
    io::{ReadParts, draft_from_bytes, skin_to_bytes},
    mesh::{Adjacency, TriMesh},
    skin::{AssembleOptions, Draft, FindingKind, Sheet, Skin, Taxels, assemble, check, world_pose},
};
use glam::DVec3;

/// Every skin, made once for all tests.
static SKINS: LazyLock<Vec<(&str, Skin)>> =
    LazyLock::new(|| meshes::ALL.iter().map(|(name, generate)| (*name, generate())).collect());

fn mesh_of(skin: &Skin) -> &TriMesh {
    &skin.patches.iter().next().unwrap().mesh
}

#[test]
fn every_patch_is_a_sphere_with_holes_in_the_size_asked_for() {
    for (name, skin) in SKINS.iter() {
        skin.validate().unwrap();
        let taxels: usize = skin.patches.iter().map(|p| p.taxels.ids.len()).sum();
        assert!((300..=10_000).contains(&taxels), "{name} has {taxels} taxels");
        for patch in &skin.patches {
            let adjacency = Adjacency::new(&patch.mesh).unwrap();
            let loops = i64::try_from(adjacency.boundary_loops().len()).unwrap();
            assert_eq!(loops == 0, *name == "glove", "{name}: {} is open unless it is the glove", patch.name);
            assert_eq!(adjacency.euler_characteristic(), 2 - loops, "{name}: {} has no handles", patch.name);
        }
    }
}

/// In degrees.
fn smallest_angle(mesh: &TriMesh) -> f64 {
    let angles = mesh.triangles.ids().flat_map(|f| {
        let [a, b, c] = mesh.corners(f);
        [[a, b, c], [b, c, a], [c, a, b]].map(|[at, p, q]| (p - at).angle_between(q - at))
    });
    angles.fold(f64::INFINITY, f64::min).to_degrees()
}

#[test]
fn triangles_are_well_shaped() {
    for (name, skin) in SKINS.iter() {
        for patch in &skin.patches {
            let smallest = smallest_angle(&patch.mesh);
            assert!(smallest > 10.0, "{name}: {} has an angle of {smallest} degrees", patch.name);
        }
    }
}

#[test]
fn nothing_is_found_wrong() {
    for (name, skin) in SKINS.iter() {
        let sheet = |patch: &dermatome::skin::Patch| Sheet {
            name: patch.name.clone(),
            link: Some(patch.link),
            positions: patch.mesh.positions.as_slice().to_vec(),
            triangles: patch.mesh.triangles.iter().map(|t| t.map(VertexId::raw)).collect(),
            ids: Some(patch.taxels.ids.as_slice().to_vec()),
            normals: Some(patch.taxels.normals.as_slice().to_vec()),
            ..Sheet::default()
        };
        let draft = Draft {
            links: skin.links.clone(),
            sheets: skin.patches.iter().map(sheet).collect(),
            ..Draft::default()
        };
        let found: Vec<FindingKind> =
            check(&draft, &AssembleOptions::default()).into_iter().map(|finding| finding.kind).collect();
        let expected: &[FindingKind] = if *name == "glove" { &[FindingKind::ClosedPatch] } else { &[] };
        assert_eq!(found, expected, "{name}");
    }
}

#[test]
fn positions_survive_a_file_of_single_precision() {
    for (name, skin) in SKINS.iter() {
        for patch in &skin.patches {
            assert!(patch.mesh.positions.iter().all(|p| p.as_vec3().as_dvec3() == *p), "{name}");
        }
    }
}

#[test]
fn fingertips_are_ten_times_denser_than_the_palm() {
    let (_, skin) = SKINS.iter().find(|(name, _)| *name == "hand").unwrap();
    let mesh = mesh_of(skin);
    let density = |is_there: &dyn Fn(DVec3) -> bool| {
        let (mut count, mut area) = (0.0, 0.0);
        for (v, a) in Taxels::from(mesh).areas.enumerate() {
            if is_there(mesh.positions[v]) {
                count += 1.0;
                area += a;
            }
        }
        count / area
    };
    let palm = density(&|p| p.x.abs() < 0.025 && (0.015..0.06).contains(&p.y));
    let tip = density(&|p| p.x.abs() < 0.02 && (0.147..0.157).contains(&p.y));
    assert!((8.0..12.0).contains(&(tip / palm)), "fingertip over palm: {}", tip / palm);
}

#[test]
fn a_skin_is_the_same_every_time() {
    for ((name, skin), (_, generate)) in SKINS.iter().zip(meshes::ALL) {
        assert_eq!(*skin, generate(), "{name}");
    }
}

/// The bent sleeve is read where its joints take it, and follows them from there.
#[test]
fn the_bent_sleeve_keeps_its_joints() {
    let name = Path::new("sleeve.glb");
    let straight = meshes::sleeve::sleeve();
    let bytes = meshes::sleeve::bent(&skin_to_bytes(name, &straight).unwrap()).unwrap();
    let draft = draft_from_bytes(name, bytes, ReadParts::default()).unwrap();
    let bent = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let [bent, straight] = [&bent, &straight].map(|skin| {
        let patch = skin.patches.iter().next().unwrap();
        assert!(patch.taxels.joints.is_some());
        let pose = world_pose(&skin.links, patch.link);
        patch.mesh.positions.map(|&p| pose.transform_point3(p))
    });
    let moved: Vec<f64> = bent.iter().zip(&straight).map(|(a, b)| a.distance(*b)).collect();
    let (first, last) = (moved[0], moved[moved.len() - 1]);
    assert!(first < 1e-6 && last > 0.05, "the upper arm stays and the lower one turns: {first}, {last}");
}
