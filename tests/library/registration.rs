//! Maps of two skins on one plane: what must not matter, and what must be kept.

use std::sync::atomic::AtomicU64;
use std::sync::{Arc, LazyLock};

use dermatome::atlas::{Atlas, AtlasOptions, Pack};
use dermatome::cut::{Cut, PlaceId};
use dermatome::flatten::distortion;
use dermatome::id::VertexId;
use dermatome::io::{map_from_bytes, map_hash, map_to_bytes, share_plane};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, Built, build_with};
use dermatome::pyramid::LevelId;
use dermatome::registration::{
    Landmark, Landmarks, Onto, Registered, RegistrationError, carried_seams, register,
};
use dermatome::report::atlas_sentences;
use dermatome::run::Run;
use dermatome::signal::{Carry, Quantity};
use dermatome::skin::{LinkId, Patch, PatchId, Skin, TaxelId};
use glam::{DVec2, DVec3};

/// A domed sheet of uneven sides; `bent` moves its taxels in the plane before it is domed.
fn sheet(columns: u32, rows: u32, spacing: f64, bent: impl Fn(DVec2) -> DVec2) -> Skin {
    let mut mesh = shapes::lattice(columns, rows, spacing);
    for p in mesh.positions.iter_mut() {
        let at = bent(p.truncate());
        *p = at.extend(-2.0 * at.length_squared());
    }
    Skin::from_mesh("sheet", mesh)
}

/// The same places of two lattices of equal extent, at quarters of their sides.
fn landmarks(of_a: [usize; 2], of_b: [usize; 2], quarters: &[[usize; 2]]) -> Landmarks {
    let at = |[columns, rows]: [usize; 2], [x, y]: [usize; 2]| {
        (PatchId::new(0), VertexId::new((rows - 1) * y / 4 * columns + (columns - 1) * x / 4))
    };
    let landmark = |(number, &place): (usize, &[usize; 2])| Landmark {
        name: format!("line {}", number + 2),
        taxel: at(of_a, place),
        atlas: at(of_b, place),
    };
    Landmarks::Taxels(quarters.iter().enumerate().map(landmark).collect())
}

const PLACES: [[usize; 2]; 9] = [[0, 0], [2, 0], [4, 0], [0, 2], [2, 2], [4, 2], [0, 4], [2, 4], [4, 4]];

fn built(skin: &Skin) -> Built {
    build_with(skin, &BuildOptions::default(), Run::default()).unwrap()
}

/// A free map, drawn on an atlas.
fn onto(
    free: &SkinMap,
    atlas: &SkinMap,
    landmarks: &Landmarks,
    is_mirrored: bool,
) -> Result<(SkinMap, Registered), RegistrationError> {
    let mut map = free.clone();
    let hash = map_hash(atlas).unwrap();
    let registered =
        register(&mut map, &Onto { atlas, name: "other", hash, landmarks, is_mirrored }, Run::default())?;
    for level in &map.patches[PatchId::new(0)].levels {
        let measured = distortion(&level.opened(), &level.opened_uv());
        assert_eq!((measured.flips, measured.crossings), (0, 0));
    }
    Ok((map, registered))
}

fn wide(p: DVec2) -> DVec2 {
    DVec2::new(1.3 * p.x + 2.0 * p.x * p.y, 0.9 * p.y)
}

const A: [usize; 2] = [41, 21];
const B: [usize; 2] = [29, 15];

/// Two sheets, and the maps of both.
struct Pair {
    skin: Skin,
    free: Arc<SkinMap>,
    atlas: Arc<SkinMap>,
}

static PAIR: LazyLock<Pair> = LazyLock::new(|| {
    let (skin, other) = (sheet(41, 21, 0.0035, wide), sheet(29, 15, 0.005, |p| p));
    let (free, atlas) = (built(&skin).map, built(&other).map);
    Pair { skin, free, atlas }
});

fn marks_at(quarters: &[[usize; 2]]) -> Landmarks {
    landmarks(A, B, quarters)
}

fn uv(map: &SkinMap) -> &dermatome::map::MapLevel {
    &map.patches[PatchId::new(0)].levels[LevelId::new(0)]
}

/// Landmarks lie at their places, other taxels near them, no level folds, and a file says all of it.
#[test]
fn a_sheet_lies_on_the_map_of_another() {
    let Pair { skin, atlas, .. } = &*PAIR;
    let marks = marks_at(&PLACES);
    let (hash, mut built) = (map_hash(atlas).unwrap(), built(skin));
    let other = Onto { atlas, name: "other", hash, landmarks: &marks, is_mirrored: false };
    let registered = built.register(skin, &BuildOptions::default(), &other, Run::default()).unwrap();
    let map = built.map;
    assert_eq!((registered.patches[0].landmarks, registered.patches[0].folding.len()), (9, 0));
    let Landmarks::Taxels(rows) = &marks else { unreachable!() };
    let place = |map: &SkinMap, v: VertexId| uv(map).opened_uv()[v];
    for row in rows {
        assert!(place(&map, row.taxel.1).distance(place(atlas, row.atlas.1)) < 1e-6, "{}", row.name);
    }
    for level in &map.patches[PatchId::new(0)].levels {
        assert_eq!((level.distortion.flips, level.distortion.crossings), (0, 0));
    }
    // The same shares of both lattices are one place.
    let mut worst = 0.0_f64;
    let sevenths = |k: usize| (7 * k / 10, (7 * k % 10) as f64 / 10.0);
    for (i, j) in (4..34).step_by(2).flat_map(|i| (1..16).step_by(2).map(move |j| (i, j))) {
        let ((column, along), (row, up)) = (sevenths(i), sevenths(j));
        let corner = |dx: usize, dy: usize| {
            place(atlas, VertexId::new((row + dy).min(14) * 29 + (column + dx).min(28)))
        };
        let below = corner(0, 0).lerp(corner(1, 0), along);
        let above = corner(0, 1).lerp(corner(1, 1), along);
        worst = worst.max(place(&map, VertexId::new(j * 41 + i)).distance(below.lerp(above, up)));
    }
    assert!(worst < 0.005, "{worst} m");
    let read = map_from_bytes(map_to_bytes(&map).unwrap()).unwrap();
    assert_eq!(read.atlas, map.atlas);
    assert_eq!(read.patches[PatchId::new(0)].plane(), "sheet");
    assert!(share_plane(&read, atlas).unwrap() && share_plane(atlas, &map).unwrap());
    let of_file = map_from_bytes(map_to_bytes(atlas).unwrap()).unwrap();
    assert_eq!(map_hash(&of_file).unwrap(), map_hash(atlas).unwrap(), "in memory and in a file");
    assert!(!share_plane(&read, &PAIR.free).unwrap(), "its free map is another plane");
}

/// The order of landmarks, the place of the skin and its unit do not matter.
#[test]
fn order_and_frame_of_the_skin_do_not_matter() {
    let Pair { skin, free, atlas, .. } = &*PAIR;
    let marks = marks_at(&PLACES);
    let (map, _) = onto(free, atlas, &marks, false).unwrap();
    let Landmarks::Taxels(mut rows) = marks else { unreachable!() };
    rows.reverse();
    let reversed = Landmarks::Taxels(rows);
    let mut turned = skin.clone();
    let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 1.0);
    let mesh = TriMesh {
        positions: skin.patches[PatchId::new(0)].mesh.positions.map(|&p| 3.0 * (turn * p) + DVec3::ONE),
        triangles: skin.patches[PatchId::new(0)].mesh.triangles.clone(),
    };
    turned.patches[PatchId::new(0)] = Patch::from_mesh("sheet", skin.patches[PatchId::new(0)].link, mesh);
    for free in [free, &built(&turned).map] {
        let (again, _) = onto(free, atlas, &reversed, false).unwrap();
        let far = uv(&map).uv.iter().zip(&uv(&again).uv).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(far < 2e-4, "{far} m");
    }
}

fn kind(result: Result<(SkinMap, Registered), RegistrationError>) -> &'static str {
    result.map(|_| ()).unwrap_err().kind()
}

/// Each landmark that cannot be right is refused by name.
#[test]
fn wrong_landmarks_are_refused() {
    let Pair { free, atlas, .. } = &*PAIR;
    let refused = |marks: &Landmarks| onto(free, atlas, marks, false).map(|_| ()).unwrap_err();
    assert_eq!(refused(&marks_at(&PLACES[..3])).kind(), "too_few");
    assert_eq!(refused(&marks_at(&[[0, 2], [1, 2], [2, 2], [4, 2]])).kind(), "on_a_line");
    let Landmarks::Taxels(rows) = marks_at(&PLACES) else { unreachable!() };
    for of_atlas in [false, true] {
        let mut twice = rows.clone();
        if of_atlas {
            twice[7].atlas = twice[3].atlas;
        } else {
            twice[7].taxel = twice[3].taxel;
        }
        let error = refused(&Landmarks::Taxels(twice));
        let whose = if of_atlas { "the atlas" } else { "the skin" };
        assert!(error.kind() == "one_place" && error.to_string().contains("line 5 and line 9"), "{error}");
        assert!(error.to_string().contains(whose), "{error}");
    }
    let mut exchanged = rows.clone();
    let (a, b) = (exchanged[1].atlas, exchanged[5].atlas);
    (exchanged[1].atlas, exchanged[5].atlas) = (b, a);
    let error = refused(&Landmarks::Taxels(exchanged));
    assert!(error.kind() == "exchanged" && error.to_string().contains("line 3 and line 7"), "{error}");
    // The skin of the other hand: left and right are exchanged.
    let mirrored: Vec<Landmark> = rows
        .iter()
        .enumerate()
        .map(|(k, row)| Landmark { atlas: rows[k / 3 * 3 + 2 - k % 3].atlas, ..row.clone() })
        .collect();
    let error = refused(&Landmarks::Taxels(mirrored.clone()));
    assert!(error.kind() == "other_hand" && error.to_string().contains("as a mirror image"), "{error}");
    let (map, _) = onto(free, atlas, &Landmarks::Taxels(mirrored), true).unwrap();
    assert!(map.is_mirrored());
    assert_eq!(kind(onto(free, atlas, &Landmarks::Taxels(rows), true)), "other_hand");
}

/// Of 25 landmarks the one that is a fifth of the sheet off is named with its distance; right ones are not doubted, and the
/// landmark is used all the same.
#[test]
fn a_landmark_that_is_off_is_named() {
    let Pair { free, atlas, .. } = &*PAIR;
    let quarters: Vec<[usize; 2]> = (0..25).map(|k| [k % 5, k / 5]).collect();
    let (_, right) = onto(free, atlas, &marks_at(&quarters), false).unwrap();
    assert_eq!(right.patches[0].doubtful, None);
    let Landmarks::Taxels(mut rows) = marks_at(&quarters) else { unreachable!() };
    let [columns, _] = B;
    rows[12].atlas.1 = VertexId::new(rows[12].atlas.1.index() + 4 + 2 * columns);
    let (map, wrong) = onto(free, atlas, &Landmarks::Taxels(rows), false).unwrap();
    let doubt = wrong.patches[0].doubtful.clone().unwrap();
    assert_eq!(doubt.landmark, "line 14");
    assert!((doubt.miss - 0.022).abs() < 0.008, "{} m for 22 mm", doubt.miss);
    assert!(wrong.remarks()[0].contains("line 14 may be wrong"), "{:?}", wrong.remarks());
    let on = map.patches[PatchId::new(0)].atlas.clone().unwrap();
    assert_eq!((on.patch.as_str(), on.landmarks + on.left_out), ("sheet", 25));
}

/// 400 landmarks that are exchanged with their neighbours fold nearly all: the map is bent some 40 times, not 400.
#[test]
fn hundreds_of_landmarks_that_fold_cost_few_bends() {
    let Pair { free, atlas, .. } = &*PAIR;
    let [columns, rows] = B;
    let at = |k: usize, columns: usize| (PatchId::new(0), VertexId::new(k % 29 + k / 29 * columns));
    let marks: Vec<Landmark> = (0..columns * rows / 4 * 4)
        .map(|k| Landmark { name: format!("line {k}"), taxel: at(k, A[0]), atlas: at(k ^ 3, columns) })
        .collect();
    let (steps, marks) = (AtomicU64::new(0), Landmarks::Taxels(marks));
    let onto = Onto { atlas, name: "other", hash: 0, landmarks: &marks, is_mirrored: false };
    let made = register(&mut SkinMap::clone(free), &onto, Run::default().counting(&steps));
    let steps = steps.into_inner();
    assert!((8..60).contains(&steps), "{steps} bends");
    match made {
        Ok(made) => assert!(made.patches[0].folding.len() > 100, "{made:?}"),
        Err(error) => assert_eq!(error.kind(), "folds"),
    }
}

/// A map says by how many landmarks it lies on the atlas, and its energy before.
#[test]
fn a_map_says_what_it_cost_to_draw_it_on_an_atlas() {
    let Pair { free, atlas, .. } = &*PAIR;
    let (map, _) = onto(free, atlas, &marks_at(&PLACES), false).unwrap();
    let read = map_from_bytes(map_to_bytes(&map).unwrap()).unwrap();
    let on = read.patches[PatchId::new(0)].atlas.clone().unwrap();
    assert_eq!((on.landmarks, on.left_out), (9, 0));
    assert_eq!(on.free_dirichlet, Some(uv(free).distortion.symmetric_dirichlet));
    let said = atlas_sentences(&read);
    assert_eq!(said.len(), 2);
    assert!(said[1].contains("on its patch sheet by 9 landmarks; symmetric Dirichlet energy"), "{}", said[1]);
    assert!(atlas_sentences(free).is_empty());
}

/// An id must be that of one taxel of all patches.
#[test]
fn ids_of_several_taxels_are_no_landmarks() {
    let Pair { skin, atlas, .. } = &*PAIR;
    let taxels = &skin.patches[PatchId::new(0)].taxels;
    let pairs: Vec<[TaxelId; 2]> = (0..4).map(|k| [taxels.ids[VertexId::new(7 * k)], TaxelId(1)]).collect();
    assert!(Landmarks::of_ids([taxels], atlas, &pairs).is_ok());
    let error = Landmarks::of_ids([taxels, taxels], atlas, &pairs).unwrap_err();
    assert!(matches!(error, RegistrationError::NoTaxel { found: 2, .. }), "{error}");
}

/// A landmark on the seam of a closed skin has two places.
#[test]
fn a_landmark_on_a_seam_is_refused() {
    let skin = Skin::from_mesh("ball", shapes::ball(12, 0.05));
    let map = built(&skin).map;
    let level = uv(&map);
    let on_seam = level.cut.as_ref().unwrap().unsplit.iter().next_back().copied().unwrap();
    let at = (PatchId::new(0), on_seam);
    let free = |v: &VertexId| {
        !level
            .cut
            .as_ref()
            .unwrap()
            .unsplit
            .iter()
            .skip(map.patches[PatchId::new(0)].taxels.ids.len())
            .any(|w| w == v)
    };
    let beside = (PatchId::new(0), (0..).map(VertexId::new).find(|v| free(v)).unwrap());
    let row = |v: usize| Landmark {
        name: format!("line {v}"),
        taxel: (PatchId::new(0), VertexId::new(v)),
        atlas: (PatchId::new(0), VertexId::new(v)),
    };
    for (taxel, atlas, whose) in [(at, beside, "the skin"), (beside, at, "the atlas")] {
        let mut rows: Vec<Landmark> = [5, 60, 100, 140].map(row).to_vec();
        rows.push(Landmark { name: "line 9".into(), taxel, atlas });
        let error = onto(&map, &map, &Landmarks::Taxels(rows), false).map(|_| ()).unwrap_err();
        assert!(error.kind() == "on_seam" && error.to_string().starts_with("line 9"), "{error}");
        assert!(error.to_string().contains(whose), "{error}");
    }
}

/// Forces keep their sum, pressures their values, and a skin on its own map carries nothing away.
#[test]
fn forces_keep_their_sum_and_pressures_their_value() {
    let Pair { free, atlas, .. } = &*PAIR;
    let marks = marks_at(&PLACES);
    let (map, _) = onto(free, atlas, &marks, false).unwrap();
    let pressure = |p: DVec2| 1.0 + (40.0 * p.x).sin() * (60.0 * p.y).cos();
    for (from, to) in [(&map, &**atlas), (&**atlas, &map)] {
        let carry = Carry::new(from, to).unwrap();
        let values: Vec<f64> = uv(from).opened_uv().iter().map(|&p| pressure(p)).collect();
        let carried = carry.carry(&values, Quantity::Intensive);
        let at = uv(to).opened_uv();
        let errors: Vec<f64> = carried
            .iter()
            .zip(&at)
            .filter(|(value, _)| value.is_finite())
            .map(|(value, &p)| (value - pressure(p)).powi(2))
            .collect();
        let rms = (errors.iter().sum::<f64>() / errors.len() as f64).sqrt();
        assert!(rms < 0.05 && carry.unreached() * 20 < carried.len(), "{rms}, {}", carry.unreached());
        let ones = carry.carry(&vec![2.5; values.len()], Quantity::Intensive);
        assert!(ones.iter().filter(|x| x.is_finite()).all(|x| (x - 2.5).abs() < 1e-12));
        // Of what lies on the other skin nothing is lost.
        let mut forces = values.clone();
        for &(_, taxel) in carry.outside() {
            forces[taxel.index()] = 0.0;
        }
        let sum = |values: &[f64]| values.iter().filter(|x| x.is_finite()).sum::<f64>();
        let all = carry.carry(&forces, Quantity::Extensive);
        assert!((sum(&all) / sum(&forces) - 1.0).abs() < 1e-12);
    }
}

/// A map is drawn on the canvas of another: its size, its pixels, and amounts kept.
#[test]
fn a_map_is_drawn_on_the_canvas_of_its_atlas() {
    let Pair { free, atlas, .. } = &*PAIR;
    let marks = marks_at(&PLACES);
    let (map, _) = onto(free, atlas, &marks, false).unwrap();
    let options = AtlasOptions::default();
    let (own, drawn) = (Atlas::new(atlas, &options).unwrap(), Atlas::onto(&map, atlas, &options).unwrap());
    for (own, drawn) in own.parts.iter().zip(&drawn.parts) {
        assert_eq!((&own.name, own.frame), (&drawn.name, drawn.frame));
        assert!((drawn.fill() / own.fill() - 1.0).abs() < 0.15, "{} and {}", drawn.fill(), own.fill());
    }
    let chart = &drawn.parts[0].charts[0];
    let [width, height] = drawn.parts[0].frame.size_px;
    let (middle, finest) = ([width / 2, height / 2], uv(&map));
    let point = chart.point(&map, middle[0], middle[1]).unwrap();
    let at: DVec2 = finest
        .places(point.face)
        .map(|place| finest.uv[place])
        .into_iter()
        .zip(point.barycentric)
        .map(|(p, w)| w * p)
        .sum();
    assert!(at.distance(own.parts[0].charts[0].centre(middle[0], middle[1])) < 1e-6);
    // The skin of the other hand comes to the mirrored pixel.
    let Landmarks::Taxels(rows) = &marks else { unreachable!() };
    let mirrored =
        (0..9).map(|k: usize| Landmark { atlas: rows[k / 3 * 3 + 2 - k % 3].atlas, ..rows[k].clone() });
    let (map, _) = onto(free, atlas, &Landmarks::Taxels(mirrored.collect()), true).unwrap();
    let drawn = Atlas::onto(&map, atlas, &options).unwrap();
    let chart = &drawn.parts[0].charts[0];
    let [column, row] = [width / 3, height / 2];
    let (finest, point) = (uv(&map), chart.point(&map, column, row).unwrap());
    let at: DVec2 = finest
        .places(point.face)
        .map(|place| finest.uv[place])
        .into_iter()
        .zip(point.barycentric)
        .map(|(p, w)| w * p)
        .sum();
    let shown = own.parts[0].charts[0].centre(column, row);
    assert!(DVec2::new(-at.x, at.y).distance(shown) < 1e-6, "{at} is the mirror image of {shown}");
    assert!(Atlas::onto(&SkinMap::flat(shapes::lattice(3, 3, 0.01), 1e-3), atlas, &options).is_err());
}

/// A map on its own canvas has the pixels that it has without one, packed or not; and one on a map that lies on a third
/// lies on the plane of the third.
#[test]
fn a_map_is_its_own_canvas() {
    let mut skin = PAIR.skin.clone();
    let link = skin.patches[PatchId::new(0)].link;
    let mut pad = Patch::from_mesh("pad", link, shapes::lattice(9, 24, 0.004));
    pad.mesh.positions.iter_mut().for_each(|p| p.x += 1.0);
    skin.patches.push(pad);
    let map = built(&skin).map;
    for pack in [None, Some(Pack::Tight), Some(Pack::Body)] {
        let options = AtlasOptions { pack, ..AtlasOptions::default() };
        assert_eq!(
            Atlas::onto(&map, &map, &options).unwrap(),
            Atlas::new(&map, &options).unwrap(),
            "{pack:?}"
        );
    }
    let Pair { free, atlas, .. } = &*PAIR;
    let (first, _) = onto(free, atlas, &marks_at(&PLACES), false).unwrap();
    let (second, _) = onto(atlas, &first, &landmarks(B, A, &PLACES), false).unwrap();
    assert_eq!((&second.atlas, second.patches[PatchId::new(0)].plane()), (&first.atlas, "sheet"));
    assert!(share_plane(&second, atlas).unwrap());
    let far = uv(&second).uv.iter().zip(&uv(atlas).uv).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(far < 0.005, "there and back: {far} m");
}

/// A closed skin is cut along the seam of its atlas, so that places near it have the same neighbours on both maps.
#[test]
fn a_closed_skin_is_cut_along_the_seam_of_its_atlas() {
    let stretched = |p: DVec3| DVec3::new(1.3 * p.x + 0.2 * p.y, 0.9 * p.y, 1.1 * p.z);
    let other = Skin::from_mesh("ball", shapes::ball(9, 0.05));
    let mut mesh = shapes::ball(11, 0.05);
    mesh.positions.iter_mut().for_each(|p| *p = stretched(*p));
    let skin = Skin::from_mesh("ball", mesh);
    let atlas = built(&other).map;
    let (own, theirs) = (&skin.patches[PatchId::new(0)].mesh, &other.patches[PatchId::new(0)].mesh);
    let on_seam: Vec<VertexId> = {
        let level = uv(&atlas);
        let unsplit = &level.cut.as_ref().unwrap().unsplit;
        unsplit.iter().skip(theirs.positions.len()).copied().collect()
    };
    let nearest = |at: DVec3| {
        let far = |v: &VertexId| own.positions[*v].distance_squared(at);
        own.positions.ids().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap()
    };
    let rows = (0..theirs.positions.len()).step_by(23).map(VertexId::new).filter(|v| !on_seam.contains(v));
    let landmark = |v: VertexId| Landmark {
        name: format!("taxel {v}"),
        taxel: (PatchId::new(0), nearest(stretched(theirs.positions[v]))),
        atlas: (PatchId::new(0), v),
    };
    let marks = Landmarks::Taxels(rows.map(landmark).collect());
    let carried = |skin: &Skin, atlas: &SkinMap, landmarks: &Landmarks| {
        let onto = Onto { atlas, name: "other", hash: 0, landmarks, is_mirrored: false };
        carried_seams(skin, &onto).unwrap()
    };
    let seams = carried(&skin, &atlas, &marks);
    assert!(seams[PatchId::new(0)].len() > 5, "{seams:?}");
    // A further patch whose taxels have the same ids changes nothing.
    let mut pair = skin.clone();
    pair.patches.push(Patch::from_mesh("sheet", LinkId::default(), shapes::cap(60, 0.05, 0.5)));
    let of_pair = carried(&pair, &atlas, &marks);
    assert_eq!(of_pair.as_slice(), [seams[PatchId::new(0)].clone(), Vec::new()]);
    let of_pair = BuildOptions { cut: Cut::Edges(of_pair), ..BuildOptions::default() };
    assert!(build_with(&pair, &of_pair, Run::default()).is_ok());
    let spacing = 0.012;
    for &v in seams[PatchId::new(0)].iter().flatten() {
        let far = |w: &VertexId| stretched(theirs.positions[*w]).distance(own.positions[v]);
        let least = on_seam.iter().map(far).fold(f64::INFINITY, f64::min);
        assert!(least < 2.0 * spacing, "{v}: {least} m from the seam");
    }
    let options = BuildOptions { cut: Cut::Edges(seams), ..BuildOptions::default() };
    let cut = build_with(&skin, &options, Run::default()).unwrap();
    assert!(uv(&cut.map).cut.is_some());
    // Its triangles are others than those of the atlas, and taxels come to where they are on it.
    let seam: Vec<VertexId> =
        uv(&cut.map).cut.as_ref().unwrap().unsplit.iter().skip(own.positions.len()).copied().collect();
    let Landmarks::Taxels(rows) = marks else { unreachable!() };
    let beside = rows.into_iter().filter(|row| !seam.contains(&row.taxel.1)).collect();
    let (map, _) = onto(&cut.map, &atlas, &Landmarks::Taxels(beside), false).unwrap();
    let mut errors: Vec<f64> = Vec::new();
    for (v, &at) in theirs.positions.enumerate().filter(|(v, _)| !on_seam.contains(v)) {
        let same = nearest(stretched(at));
        let is_near = stretched(at).distance(own.positions[same]) < 0.2 * spacing;
        if is_near && !seam.contains(&same) {
            errors.push(uv(&map).uv[PlaceId::first_of(same)].distance(uv(&atlas).uv[PlaceId::first_of(v)]));
        }
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 8 && errors[errors.len() / 2] < 0.5 * spacing, "{errors:?}");
    // A skin with a boundary keeps its own cut.
    assert!(carried(&PAIR.skin, &PAIR.atlas, &marks_at(&PLACES)).iter().all(Vec::is_empty));
}

/// A closed hand: a ball of `fine` with five prongs, turned by `turn` before they grow, so that its triangles are others;
/// also where the vertices are on the ball.
fn star(fine: u32, turn: f64) -> (TriMesh, Vec<DVec3>) {
    let mut mesh = shapes::ball(fine, 1.0);
    let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, turn);
    let on_ball: Vec<DVec3> = mesh.positions.iter().map(|&p| turn * p).collect();
    for (at, p) in mesh.positions.iter_mut().zip(&on_ball) {
        let prong = |k: u32| {
            let tip = DVec2::from_angle(0.9 * f64::from(k) + 0.2 * f64::from(k % 2)).extend(0.1);
            1.4 * (-(p.angle_between(tip) / 0.3).powi(2)).exp()
        };
        *at = 0.03 * (1.0 + (0..5).map(prong).sum::<f64>()) * *p * DVec3::new(1.0, 1.0, 0.6);
    }
    (mesh, on_ball)
}

/// A closed hand with other triangles, other proportions and a bend lies on the map of another one, also of the other side:
/// its seam has the same ends and branches, its rim lies on that of the atlas, and nearly all of its taxels lie at their
/// places in space.
#[test]
fn a_closed_hand_lies_on_one_with_other_triangles() {
    let (theirs, on_ball) = star(14, 0.0);
    let atlas = built(&Skin::from_mesh("hand", theirs.clone())).map;
    let finest = uv(&atlas);
    let cut = finest.cut.as_ref().unwrap();
    let of_degree = |map: &SkinMap, degree: usize| {
        let level = uv(map);
        let mut degrees = vec![0; level.level.mesh.positions.len()];
        level.seam().iter().flatten().for_each(|v| degrees[v.index()] += 1);
        degrees.into_iter().filter(|found| *found == degree).count()
    };
    let on_seam: Vec<VertexId> = cut.unsplit.iter().skip(theirs.positions.len()).copied().collect();
    for is_mirrored in [false, true] {
        let (mut own, mut places) = star(12, 0.7);
        for p in own.positions.iter_mut() {
            *p = DVec3::new(1.15 * p.x + 0.1 * p.y, 0.9 * p.y, p.z - 4.0 * p.x * p.x);
        }
        if is_mirrored {
            own.positions.iter_mut().for_each(|p| p.y = -p.y);
            own.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        }
        let skin = Skin::from_mesh("hand", own);
        let nearest = |of: &[DVec3], at: DVec3| {
            let far = |v: &usize| of[*v].distance_squared(at);
            VertexId::new((0..of.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap())
        };
        // The vertices of the atlas that have one of the skin near them on the ball, away from the seam.
        let is_beside =
            |v: VertexId| on_seam.iter().any(|w| on_ball[v.index()].distance(on_ball[w.index()]) < 0.2);
        let pairs = theirs.positions.ids().map(|v| (v, nearest(&places, on_ball[v.index()])));
        let pairs: Vec<(VertexId, VertexId)> = pairs
            .filter(|&(v, w)| !is_beside(v) && places[w.index()].distance(on_ball[v.index()]) < 0.04)
            .collect();
        assert!(pairs.len() > 40, "{}", pairs.len());
        let row = |&(v, w): &(VertexId, VertexId)| Landmark {
            name: format!("taxel {w}"),
            taxel: (PatchId::new(0), w),
            atlas: (PatchId::new(0), v),
        };
        let marks = Landmarks::Taxels(pairs.iter().step_by(pairs.len() / 20).map(row).collect());
        let other = Onto { atlas: &atlas, name: "other", hash: 0, landmarks: &marks, is_mirrored };
        let seams = carried_seams(&skin, &other).unwrap();
        let options = BuildOptions { cut: Cut::Edges(seams), ..BuildOptions::default() };
        let free = build_with(&skin, &options, Run::default()).unwrap().map;
        for degree in [1, 3, 4, 5] {
            let [found, needed] = [&free, &atlas].map(|map| of_degree(map, degree));
            assert_eq!(found, needed, "vertices where {degree} edges of the seam meet");
        }
        let (map, registered) = onto(&free, &atlas, &marks, is_mirrored).unwrap();
        assert!(registered.patches[0].folding.is_empty(), "{:?}", registered.patches[0].folding);
        let mut far = Vec::new();
        let turn = |at: DVec2| if is_mirrored { DVec2::new(-at.x, at.y) } else { at };
        let level = uv(&map);
        places = level.unsplit().unwrap().iter().map(|v| places[v.index()]).collect();
        for (place, &at) in level.uv.enumerate() {
            let far_from = |other: &PlaceId| finest.uv[*other].distance_squared(turn(at));
            let near = finest.uv.ids().min_by(|a, b| far_from(a).total_cmp(&far_from(b))).unwrap();
            far.push(places[place.index()].distance(on_ball[finest.vertex_of(near).index()]));
        }
        far.sort_by(f64::total_cmp);
        let [median, most] = [far[far.len() / 2], far[far.len() * 99 / 100]];
        assert!(median < 0.1 && most < 0.35, "{median} and {most} of the radius of the ball");
    }
}
