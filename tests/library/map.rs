//! Laws of maps: every field of a map is judged, in one place, by name.

use crate::maps::{level_id, skin, square_pyramid};
use dermatome::cut::PlaceId;
use dermatome::id::{FaceId, IdVec, VertexId};
use dermatome::map::{MapLevel, PatchMap, SkinMap};
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::Level;
use dermatome::skin::{Covariance, LinkId, PatchId, Skin};
use glam::{DAffine3, DVec2, DVec3};

/// Two patches of two levels on two links.
fn map() -> SkinMap {
    let mut map = skin(vec![
        square_pyramid("palm", &[9, 5], 0.08, 0.001),
        square_pyramid("back", &[5, 3], 0.08, 0.001),
    ]);
    let mut hand = map.links[LinkId::new(0)].clone();
    hand.parent = Some(LinkId::new(0));
    map.patches[PatchId::new(1)].link = map.links.push(hand);
    let palm = patch(&mut map);
    palm.taxels.densities = Some(palm.taxels.areas.map(|a| 1.0 / a));
    palm.taxels.covariances =
        Some(palm.taxels.areas.map(|_| Some(Covariance::from([1e-6, 0.0, 0.0, 1e-6, 0.0, 0.0]))));
    map
}

fn patch(map: &mut SkinMap) -> &mut PatchMap {
    &mut map.patches[PatchId::new(0)]
}

fn mapped(map: &mut SkinMap, k: usize) -> &mut MapLevel {
    &mut patch(map).levels[level_id(k)]
}

fn level(map: &mut SkinMap, k: usize) -> &mut Level {
    &mut mapped(map, k).level
}

fn v(k: usize) -> VertexId {
    VertexId::new(k)
}

#[test]
fn maps_of_named_shapes_are_valid() {
    assert_eq!(map().validate(), Ok(()));
    assert_eq!(SkinMap::default().validate(), Ok(()), "no patches, no rules");
    for mesh in [shapes::square(), shapes::cap(300, 0.1, 1.9), shapes::saddle(9)] {
        assert_eq!(SkinMap::flat(mesh, 0.001).validate(), Ok(()));
    }
}

/// A flat map is the sheet itself, so `u` grows along x. A map of any skin gives every taxel a
/// tangent that follows `u`, and keeps those that the taxels have.
#[test]
fn maps_give_tangents_along_u() {
    let flat = SkinMap::flat(shapes::saddle(9), 0.001);
    for (v, t) in flat.patches[PatchId::new(0)].taxels.tangents.as_ref().unwrap().enumerate() {
        let normal = flat.patches[PatchId::new(0)].taxels.normals[v];
        let along_x = (DVec3::X - DVec3::X.dot(normal) * normal).normalize();
        assert!(t.dot(normal).abs() < 1e-12 && t.dot(along_x) > 0.98, "{t} of {v}, not {along_x}");
    }
    let skin = Skin::from_mesh("cap", shapes::cap(600, 0.1, 1.2));
    let built = build(&skin, &BuildOptions::default()).unwrap();
    assert_eq!(built.validate(), Ok(()));
    let patch = &built.patches[PatchId::new(0)];
    let tangents = patch.taxels.tangents.as_ref().unwrap();
    let finest = &patch.levels[level_id(0)];
    for corners in &finest.level.mesh.triangles {
        for [a, b] in [[0, 1], [1, 2], [2, 0]].map(|side| side.map(|k| corners[k])) {
            let step = finest.level.mesh.positions[b] - finest.level.mesh.positions[a];
            let [from, to] = [a, b].map(PlaceId::of_opened);
            let on_map = finest.uv[to] - finest.uv[from];
            let along = step.dot(tangents[a]) / step.length();
            let across = step.dot(patch.taxels.normals[a].cross(tangents[a])) / step.length();
            let expected = on_map.normalize();
            assert!((along - expected.x).abs() < 0.25, "{along} along u, {} on the map", expected.x);
            assert!((across - expected.y).abs() < 0.25, "{across} along v, {} on the map", expected.y);
        }
    }
    let mut calibrated = skin;
    let taxels = &mut calibrated.patches[PatchId::new(0)].taxels;
    taxels.tangents = Some(taxels.normals.map(|n| n.any_orthonormal_vector()));
    let kept = build(&calibrated, &BuildOptions::default()).unwrap();
    let given = &calibrated.patches[PatchId::new(0)].taxels;
    assert_eq!(&kept.patches[PatchId::new(0)].taxels, given);
}

/// Breaks each field once; what is found says where.
#[test]
fn every_broken_field_is_refused_by_name() {
    let refused = |words: &[&str], spoil: &dyn Fn(&mut SkinMap)| {
        let mut broken = map();
        spoil(&mut broken);
        let error = broken.validate().unwrap_err().to_string();
        for word in words {
            assert!(error.contains(word), "{word:?} is missing in {error}");
        }
    };
    // Links and patches.
    refused(&["link 1", "after its parent"], &|m| m.links[LinkId::new(1)].parent = Some(LinkId::new(1)));
    let far = [DVec3::NAN, DVec3::X * 1e300].map(DAffine3::from_translation);
    for pose in far.into_iter().chain([DAffine3::from_scale(DVec3::splat(1.001))]) {
        refused(&["link 0", "rigid"], &|m| m.links[LinkId::new(0)].pose = pose);
    }
    refused(&["\"palm\"", "link 5"], &|m| patch(m).link = LinkId::new(5));
    refused(&["two patches", "\"back\""], &|m| patch(m).name = "back".into());
    refused(&["palm", "without levels"], &|m| patch(m).levels = IdVec::default());
    refused(&["palm", "fill holes", "1000"], &|m| patch(m).filled = 1000);
    // Taxels.
    refused(&["\"palm\"", "ids", "80"], &|m| {
        patch(m).taxels.ids = patch(m).taxels.ids.iter().skip(1).copied().collect()
    });
    refused(&["\"palm\"", "normals"], &|m| patch(m).taxels.normals = IdVec::default());
    refused(&["\"palm\"", "tangents"], &|m| patch(m).taxels.tangents = Some(IdVec::default()));
    for wrong in [DVec3::Z, 0.5 * DVec3::X, DVec3::NAN, DVec3::ZERO] {
        refused(&["\"palm\"", "tangent of vertex 7"], &|m| {
            patch(m).taxels.tangents.as_mut().unwrap()[v(7)] = wrong;
        });
    }
    refused(&["\"palm\"", "presence"], &|m| patch(m).taxels.presence = IdVec::default());
    refused(&["\"palm\"", "areas"], &|m| patch(m).taxels.areas = IdVec::default());
    refused(&["\"palm\"", "densities"], &|m| patch(m).taxels.densities = Some(IdVec::default()));
    refused(&["\"palm\"", "covariances"], &|m| patch(m).taxels.covariances = Some(IdVec::default()));
    refused(&["\"palm\"", "normal of vertex 3"], &|m| patch(m).taxels.normals[v(3)] = DVec3::splat(1.0));
    refused(&["\"palm\"", "vertex 4", "-1 m^2"], &|m| patch(m).taxels.areas[v(4)] = -1.0);
    refused(&["palm/L0", "vertex 4", "its taxel"], &|m| patch(m).taxels.areas[v(4)] *= 2.0);
    refused(&["\"palm\"", "vertex 5", "density"], &|m| {
        patch(m).taxels.densities.as_mut().unwrap()[v(5)] = 0.0
    });
    for wrong in [[f64::NAN; 6], [-1e-6, 0.0, 0.0, 0.0, 0.0, 0.0], [1e-6, 2e-6, 0.0, 1e-6, 0.0, 0.0]] {
        refused(&["\"palm\"", "vertex 6", "covariance"], &|m| {
            patch(m).taxels.covariances.as_mut().unwrap()[v(6)] = Some(Covariance::from(wrong));
        });
    }
    // Levels.
    refused(&["palm/L1", "vertex 99"], &|m| level(m, 1).mesh.triangles[FaceId::new(0)][0] = v(99));
    refused(&["palm/L0", "finite coordinates"], &|m| level(m, 0).mesh.positions[v(0)] = DVec3::NAN);
    refused(&["palm/L1", "origins"], &|m| level(m, 1).origins = IdVec::default());
    refused(&["palm/L1", "vertex 2", "vertex 99 of level 0"], &|m| level(m, 1).origins[v(2)] = v(99));
    refused(&["palm/L0", "vertex 2", "vertex 1 of level 0"], &|m| level(m, 0).origins[v(2)] = v(1));
    refused(&["palm/L1", "areas"], &|m| level(m, 1).areas = IdVec::default());
    refused(&["palm/L1", "vertex 2", "area"], &|m| level(m, 1).areas[v(2)] = f64::NAN);
    refused(&["palm/L0", "from_coarser"], &|m| level(m, 0).from_coarser = None);
    refused(&["palm/L1", "from_coarser"], &|m| level(m, 1).from_coarser = level(m, 0).from_coarser.clone());
    refused(&["palm/L1", "to_finest"], &|m| level(m, 1).to_finest = None);
    refused(&["palm/L0", "to_finest"], &|m| level(m, 0).to_finest = level(m, 1).to_finest.clone());
    let rows = |m: &mut SkinMap, spoil: &dyn Fn(&mut dermatome::pyramid::Prolongation)| {
        spoil(level(m, 1).to_finest.as_mut().unwrap());
    };
    refused(&["palm/L1", "to_finest", "7 coarse"], &|m| rows(m, &|p| p.coarse_len = 7));
    refused(&["palm/L1", "to_finest", "row 5", "vertex 40"], &|m| rows(m, &|p| p.indices[v(5)][1] = v(40)));
    refused(&["palm/L1", "to_finest", "row 5", "sum 1"], &|m| rows(m, &|p| p.weights[v(5)] = [0.5; 3]));
    refused(&["palm/L1", "to_finest", "weights has 0"], &|m| rows(m, &|p| p.weights = IdVec::default()));
    // Maps.
    refused(&["palm/L1", "uv has 0"], &|m| mapped(m, 1).uv = IdVec::default());
    refused(&["palm/L1", "vertex 3", "finite"], &|m| mapped(m, 1).uv[PlaceId::new(3)] = DVec2::NAN);
    refused(&["palm/L1", "1e12 m"], &|m| mapped(m, 1).uv.iter_mut().for_each(|at| *at *= 1e300));
    refused(&["palm/L1", "one point"], &|m| mapped(m, 1).uv.iter_mut().for_each(|at| *at = DVec2::ONE));
    refused(&["palm/L1", "mirrored"], &|m| mapped(m, 1).uv.iter_mut().for_each(|at| at.x = -at.x));
    refused(&["palm/L0", "vertex 7", "`up`", "`direct`"], &|m| {
        let up = level(m, 0).from_coarser.as_mut().unwrap();
        up.indices[v(7)] = up.indices[v(80)];
        up.weights[v(7)] = up.weights[v(80)];
    });
    for size in [DVec2::ZERO, DVec2::NAN, DVec2::NEG_ONE] {
        refused(&["palm/L1", "frame"], &|m| mapped(m, 1).frame.size = size);
    }
    refused(&["palm/L1", "frame"], &|m| mapped(m, 1).frame.origin.x = f64::INFINITY);
    refused(&["palm/L1", "frame"], &|m| mapped(m, 1).frame.size_px = [0, 4]);
    refused(&["palm/L1", "distortion"], &|m| mapped(m, 1).distortion.flips = 1000);
    refused(&["palm/L1", "distortion"], &|m| mapped(m, 1).distortion.qc_mean = 1e9);
    refused(&["palm/L1", "distortion"], &|m| mapped(m, 1).distortion.area_max = 0.5);
}
