//! Laws of pictures of skin in space.

use std::path::Path;

use crate::maps::{level_id, skin, square_pyramid};
use assert_cmd::Command;
use dermatome::id::IdVec;
use dermatome::io::{write_map, write_skin};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::plot::{self, Paint, PlotError, PlotOptions, Viewpoint};
use dermatome::skin::{Covariance, Link, LinkId, Patch, Skin};
use glam::{DAffine3, DQuat, DVec2, DVec3};
use predicates::{prelude::*, str::contains};

use crate::common;

fn from(azimuth: f64, elevation: f64) -> PlotOptions {
    let viewpoint = Viewpoint::From { azimuth: azimuth.to_radians(), elevation: elevation.to_radians() };
    PlotOptions { space: Some(viewpoint), ..PlotOptions::default() }
}

/// The text of an SVG picture.
fn plot_skin(skin: &Skin, options: &PlotOptions) -> Result<String, PlotError> {
    Ok(plot::plot_skin(skin, options)?.to_svg())
}

/// The text of an SVG picture.
fn plot_map(map: &SkinMap, options: &PlotOptions) -> Result<String, PlotError> {
    Ok(plot::plot_map(map, options)?.to_svg())
}

/// The pixels of a picture.
fn pixels(skin: &Skin, options: &PlotOptions) -> Vec<[u8; 3]> {
    let png = plot::plot_skin(skin, options).unwrap().to_png().unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes.as_chunks().0.to_vec()
}

/// The centres of the dots of a picture, up instead of down.
fn dots(svg: &str) -> Vec<DVec2> {
    let document = roxmltree::Document::parse(svg).unwrap();
    let circles = document.descendants().filter(|node| node.has_tag_name("circle"));
    let number = |node: roxmltree::Node<'_, '_>, name| node.attribute(name).unwrap().parse::<f64>().unwrap();
    circles.map(|node| DVec2::new(number(node, "cx"), -number(node, "cy"))).collect()
}

/// A sheet that faces the viewer shows its true shape, x to the right of what is up, from each
/// direction; from -y that is x and z, from above x and y.
#[test]
fn lengths_in_the_picture_plane_are_kept() {
    for (azimuth, elevation) in [(0.0, 0.0), (17.0, -63.0), (-143.0, 40.0), (57.0, 90.0), (229.0, -90.0)] {
        let [a, e] = [azimuth, elevation].map(f64::to_radians);
        let level = DVec3::new(a.cos(), a.sin(), 0.0);
        let (toward, up) = (e.cos() * level + e.sin() * DVec3::Z, e.cos() * DVec3::Z - e.sin() * level);
        let place = |i, j| f64::from(i) * up.cross(toward) + f64::from(j) * up + 7.0 * toward;
        let svg = plot_skin(&Skin::from_mesh("sheet", shapes::sheet(3, 4, place)), &from(azimuth, elevation));
        let dots = dots(&svg.unwrap());
        let scale = dots[1].x - dots[0].x;
        assert!(dots.len() == 12 && scale > 50.0, "from {azimuth}, {elevation}: {dots:?}");
        for (k, dot) in dots.iter().enumerate() {
            let expected = dots[0] + scale * DVec2::new((k % 3) as f64, (k / 3) as f64);
            assert!(dot.distance(expected) < 0.5, "from {azimuth}, {elevation}: {dots:?}");
        }
    }
    for (elevation, up) in [(0.0, DVec3::Z), (90.0, DVec3::Y)] {
        let place = |i, j| f64::from(i) * DVec3::X + f64::from(j) * up;
        let svg = plot_skin(&Skin::from_mesh("sheet", shapes::sheet(2, 2, place)), &from(-90.0, elevation));
        let dots = dots(&svg.unwrap());
        assert!(dots[1].x > dots[0].x + 50.0 && dots[2].y > dots[0].y + 50.0, "{dots:?}");
    }
}

/// The default direction sees all of a shallow cap, however its link is posed, and a posed skin
/// looks as its moved copy.
#[test]
fn the_default_sees_the_outside_of_a_posed_skin() {
    let cap = shapes::cap(200, 0.1, 0.6);
    for turn in [DQuat::IDENTITY, DQuat::from_rotation_x(1.5), DQuat::from_rotation_y(3.1)] {
        let pose = DAffine3::from_rotation_translation(turn, DVec3::new(0.1, 2.0, 3.0));
        let mut posed = Skin::from_mesh("cap", cap.clone());
        posed.links[LinkId::new(0)].pose = pose;
        let positions = cap.positions.map(|&p| pose.transform_point3(p));
        let moved = Skin::from_mesh("cap", TriMesh { positions, triangles: cap.triangles.clone() });
        let [here, there] =
            [posed, moved].map(|skin| dots(&plot_skin(&skin, &PlotOptions::default()).unwrap()));
        assert_eq!(here.len(), cap.positions.len(), "all taxels are seen");
        assert!(here.iter().zip(&there).all(|(a, b)| a.distance(*b) < 2.0), "{here:?}, {there:?}");
    }
}

/// A cap whose taxels are known to a millimetre in its middle, and worse outwards.
fn calibrated_cap(faces: usize) -> Skin {
    let mut skin = Skin::from_mesh("cap", shapes::cap(faces, 0.1, 1.2));
    for patch in skin.patches.iter_mut() {
        let variance = |p: &DVec3| 1e-6 * (1.0 + 200.0 * p.truncate().length_squared());
        let covariance = |p: &DVec3| Some(Covariance::from([variance(p) / 3.0; 6]));
        patch.taxels.covariances = Some(patch.mesh.positions.map(covariance));
    }
    skin
}

/// A strip that comes back over itself, 10 mm higher. From above and from below the half in front
/// shows its inside.
fn folded_strip() -> TriMesh {
    shapes::sheet(21, 5, |i, j| {
        let t = f64::from(i) - 10.0;
        let height = if t < 0.0 { 0.0 } else { 0.01 };
        DVec3::new(0.1 - 0.01 * t.abs(), 0.01 * f64::from(j), height)
    })
}

/// The layer in front hides the other. It shows its inside, which is darker.
#[test]
fn the_nearer_layer_hides_the_farther_one() {
    let strip = Skin::from_mesh("strip", folded_strip());
    for elevation in [80.0, -80.0] {
        let pixels = pixels(&strip, &PlotOptions { paint: Paint::Fields, ..from(-90.0, elevation) });
        let count = |range: std::ops::Range<u8>| pixels.iter().filter(|p| range.contains(&p[0])).count();
        let (inside, outside) = (count(110..165), count(185..235));
        assert!(inside > 5 * outside, "from {elevation} degrees: {inside} pixels over {outside}");
    }
}

/// The patches of a robot stand where their links are, and hide each other.
#[test]
fn a_robot_is_one_picture() {
    let square = |name: &str| {
        Skin::from_mesh(name, shapes::sheet(5, 5, |i, j| DVec3::new(f64::from(i), f64::from(j), 0.0)))
    };
    let mut robot = square("front");
    let back = square("back");
    let pose = DAffine3::from_translation(DVec3::new(8.0, 0.0, 0.0));
    let tip = robot.links.push(Link { name: "tip".into(), parent: Some(LinkId::default()), pose });
    for patch in back.patches {
        robot.patches.push(Patch { link: tip, ..patch });
    }
    let svg = plot_skin(&robot, &from(-90.0, 90.0)).unwrap();
    assert!(svg.contains("2 patches, in space") && svg.contains("50 taxels"), "{svg}");
    let dots = dots(&svg);
    let step = dots[1].x - dots[0].x;
    assert!((dots[25].x - dots[0].x - 8.0 * step).abs() < 0.5, "{} and {}", dots[0], dots[25]);
    robot.links[tip].pose = DAffine3::from_translation(DVec3::new(0.0, 0.0, 1.0));
    let hidden = plot_skin(&robot, &from(-90.0, 90.0)).unwrap();
    let seen = hidden.matches("<circle").count();
    assert!(seen <= 25 + 16, "{seen}: the inner taxels of the lower square are hidden");
}

#[test]
fn hidden_taxels_have_no_dot() {
    let tube = Skin::from_mesh("tube", shapes::tube(24, 6, 0.03, 0.05));
    let taxels = tube.patches.iter().next().unwrap().taxels.ids.len();
    let svg = plot_skin(&tube, &from(0.0, 0.0)).unwrap();
    let dots = svg.matches("<circle").count();
    assert!((taxels / 3..=taxels / 2).contains(&dots), "{dots} of {taxels}: the half that faces the viewer");
}

/// A square of 100 mm has the same height from each azimuth, and from above its true size.
#[test]
fn the_scale_bar_holds_in_space() {
    let sheet = Skin::from_mesh("sheet", shapes::lattice(11, 11, 0.01));
    let bar = |svg: &str| svg.contains("mm</text>") || svg.contains(" mm\n</text>");
    let height = |elevation| {
        let svg = plot_skin(&sheet, &from(-90.0, elevation)).unwrap();
        assert!(bar(&svg), "a scale bar");
        svg.split("height=\"").nth(1).unwrap().split('"').next().unwrap().parse::<f64>().unwrap()
    };
    let ground = height(0.0);
    let (tilted, plan) = (height(30.0) - ground, height(90.0) - ground);
    assert!((tilted / plan - 0.5).abs() < 0.01, "sin 30: {tilted} of {plan} pixels");
}

#[test]
fn pictures_are_the_same_every_time() {
    for (faces, paint) in [(400, Paint::Sigma), (60_000, Paint::Fields)] {
        let skin = calibrated_cap(faces);
        let draw = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = PlotOptions { paint, ..PlotOptions::default() };
            pool.install(|| plot_skin(&skin, &options).unwrap())
        };
        let svg = draw(1);
        assert!(svg == draw(1) && svg == draw(3), "{paint:?}");
        if faces == 400 {
            let options = PlotOptions { paint, ..PlotOptions::default() };
            assert!(pixels(&skin, &options) == pixels(&skin, &options));
        }
    }
}

#[test]
fn the_picture_of_a_large_skin_stays_small() {
    let skin = calibrated_cap(200_000);
    for paint in [Paint::Fields, Paint::Sigma] {
        let svg = plot_skin(&skin, &PlotOptions { paint, ..PlotOptions::default() }).unwrap();
        assert!(svg.len() < 8 << 20, "{paint:?}: {} bytes", svg.len());
    }
}

#[test]
fn the_printed_direction_gives_the_same_picture() {
    let skin = calibrated_cap(300);
    let svg = plot_skin(&skin, &PlotOptions::default()).unwrap();
    let angle = |name: &str| {
        let rest = svg.split(name).nth(1).unwrap();
        rest.split('°').next().unwrap().trim().replace('\u{2212}', "-").parse::<f64>().unwrap()
    };
    assert_eq!(plot_skin(&skin, &from(angle("azimuth "), angle("elevation "))).unwrap(), svg);
}

#[test]
fn the_skin_stands_beside_its_maps() {
    let map = skin(vec![square_pyramid("palm", &[13, 7, 4], 0.06, 0.001)]);
    for (levels, paint) in
        [(vec![], Paint::Fields), (vec![level_id(1)], Paint::Fields), (vec![level_id(1)], Paint::Area)]
    {
        let options = PlotOptions { levels: levels.clone(), paint, ..from(20.0, 50.0) };
        let svg = plot_map(&map, &options).unwrap();
        assert_eq!(svg.matches("palm, in space").count(), 1);
        assert_eq!(svg.matches("palm, level").count(), if levels.is_empty() { 3 } else { 1 });
        plot::plot_map(&map, &options).unwrap().to_png().unwrap();
    }
    // A closed surface is cut: each level has a seam of its own.
    let ball = build(&Skin::from_mesh("ball", shapes::ball(10, 0.05)), &BuildOptions::default()).unwrap();
    for paint in [Paint::Area, Paint::Angle, Paint::Fields] {
        plot_map(&ball, &PlotOptions { levels: vec![level_id(1)], paint, ..from(20.0, 50.0) }).unwrap();
    }
}

/// A patch with fewer levels than another is drawn in space all the same, with its coarsest.
#[test]
fn a_patch_without_the_level_has_the_colours_of_its_coarsest() {
    let patches =
        vec![square_pyramid("palm", &[9, 5], 0.06, 0.001), square_pyramid("tip", &[5], 0.02, 0.001)];
    let mut map = skin(patches);
    let options = PlotOptions { levels: vec![level_id(1)], paint: Paint::Angle, ..from(20.0, 50.0) };
    let svg = plot_map(&map, &options).unwrap();
    assert!(svg.contains("tip, in space") && !svg.contains("tip, level"));
    map.links = IdVec::default();
    assert!(matches!(plot_map(&map, &options), Err(PlotError::Map(_))), "no link, no place in space");
}

#[test]
fn shapes_without_extent_or_of_any_size_are_drawn() {
    let scaled = |factor: f64| {
        let mesh = shapes::cap(60, 1.0, 1.0);
        TriMesh { positions: mesh.positions.map(|p| factor * *p), triangles: mesh.triangles.clone() }
    };
    let meshes = [shapes::triangle(), shapes::square(), shapes::fan(500), scaled(1e-9), scaled(1e9)];
    for mesh in meshes {
        let skin = Skin::from_mesh("shape", mesh);
        for options in [PlotOptions::default(), from(0.0, 0.0), from(17.0, -90.0), from(1e6, 90.0)] {
            let small = PlotOptions { width_px: 300, ..options };
            plot::plot_skin(&skin, &small).unwrap().to_png().unwrap();
        }
    }
}

#[test]
fn skins_without_maps_covariances_or_patches_are_refused() {
    let bare = Skin::from_mesh("bare", shapes::square());
    let ask = |options: PlotOptions| plot_skin(&bare, &options).unwrap_err();
    let paint = |paint| PlotOptions { paint, ..PlotOptions::default() };
    assert!(matches!(ask(paint(Paint::Angle)), PlotError::NoMap { .. }));
    assert!(matches!(ask(paint(Paint::Area)), PlotError::NoMap { .. }));
    assert!(matches!(ask(paint(Paint::Sigma)), PlotError::NoCovariances { .. }));
    let levels = PlotOptions { levels: vec![level_id(0)], ..PlotOptions::default() };
    assert!(matches!(ask(levels), PlotError::NoMap { .. }));
    for options in [from(0.0, 91.0), from(f64::NAN, 0.0), from(0.0, f64::INFINITY)] {
        assert!(matches!(ask(options), PlotError::Direction { .. }));
    }
    assert_eq!(plot_skin(&Skin::default(), &PlotOptions::default()), Err(PlotError::Empty));
    let mut broken = calibrated_cap(100);
    broken.patches.iter_mut().for_each(|p| p.taxels.covariances = Some(IdVec::default()));
    assert!(matches!(plot_skin(&broken, &paint(Paint::Sigma)), Err(PlotError::Skin(_))));
}

#[test]
fn uncertainty_has_a_scale_in_millimetres() {
    let svg = plot_skin(&calibrated_cap(800), &PlotOptions { paint: Paint::Sigma, ..PlotOptions::default() })
        .unwrap();
    for word in ["sigma, mm", ">1<", ">1.7<"] {
        assert!(svg.contains(word), "{word}");
    }
    assert!(!svg.contains(['≤', '≥']), "nothing is clipped");
}

fn plot(file: &Path) -> Command {
    let mut command = common::command();
    command.arg("plot").arg(file);
    command
}

#[test]
fn the_command_draws_skins_and_maps_alike() {
    let folder = tempfile::tempdir().unwrap();
    let [cap, map, svg] = ["cap.glb", "map.glb", "p.svg"].map(|name| folder.path().join(name));
    write_skin(&cap, &calibrated_cap(300)).unwrap();
    write_map(&map, &skin(vec![square_pyramid("palm", &[9, 5], 0.06, 0.001)])).unwrap();
    let both = || contains("in space").and(contains("palm, level 0"));
    plot(&cap).args(["-o", "-", "--show", "sigma"]).assert().success().stdout(contains("cap, in space"));
    plot(&map).args(["-o", "-"]).assert().success().stdout(contains("in space").not());
    plot(&map).args(["-o", "-", "--space"]).assert().success().stdout(both());
    let seen = both().and(contains("azimuth \u{2212}65°, elevation \u{2212}45.5°"));
    plot(&map).args(["-o", "-", "--view", "-65,-45.5"]).assert().success().stdout(seen);

    let refused = [
        (&cap, ["--show", "angle"], "dermatome build"),
        (&cap, ["--level", "0"], "has no map"),
        (&map, ["--show", "sigma"], "no covariances"),
        (&map, ["--view", "10"], "two angles"),
        (&map, ["--view", "0,100"], "-90 to 90"),
        (&map, ["--view", "inf,0"], "two angles"),
    ];
    for (file, options, said) in refused {
        plot(file)
            .arg("-o")
            .arg(&svg)
            .args(options)
            .assert()
            .code(2)
            .stderr(contains(said).and(contains("help")));
    }
    assert!(!svg.exists(), "nothing is written");
}

/// A body that is tallest along y, as in files with y up, stands in the picture.
#[test]
fn a_body_that_stands_along_y_stands_in_the_picture() {
    let tube = shapes::tube(12, 20, 0.02, 0.2);
    let lying = tube.positions.map(|p| DVec3::new(p.x, p.z, -p.y));
    let [along_z, along_y] = [tube.positions, lying].map(|positions| {
        let skin = Skin::from_mesh("tube", TriMesh { positions, triangles: tube.triangles.clone() });
        plot_skin(&skin, &PlotOptions::default()).unwrap()
    });
    let height = |svg: &str| {
        let (low, high) = dots(svg).iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.y), h.max(p.y)));
        high - low
    };
    assert!(along_y.contains(", y up") && !along_z.contains("y up"));
    assert!((height(&along_y) / height(&along_z) - 1.0).abs() < 0.02, "the same picture");
}

/// Where taxels lie closer than elsewhere their dots do not cover the mesh.
#[test]
fn dots_do_not_cover_each_other() {
    let svg = plot_skin(&Skin::from_mesh("fan", shapes::fan(500)), &from(0.0, 90.0)).unwrap();
    let dots = dots(&svg);
    assert!(dots.len() > 50, "{}", dots.len());
    for (k, a) in dots.iter().enumerate() {
        assert!(dots[..k].iter().all(|b| a.distance(*b) > 7.5), "{a}");
    }
}
