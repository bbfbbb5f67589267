//! Laws of the pictures: they say what was asked for, are sound XML, and stay small.

use std::{fs, path::Path};

use crate::maps::{self, flat_level, flat_patch, level_id, mapped_level, patch, skin, square_pyramid};
use assert_cmd::Command;
use dermatome::cut::PlaceId;
use dermatome::id::{IdVec, VertexId};
use dermatome::io::write_map;
use dermatome::map::{MapError, PatchMap, SkinMap};
use dermatome::mesh::shapes;
use dermatome::plot::{self, Paint, PlotError, PlotOptions, Viewpoint};
use dermatome::skin::Presence;
use glam::DVec2;
use predicates::str::contains;
use roxmltree::Document;
use ttf_parser::Face;

use crate::common;

/// All that need no calibration.
const PAINTS: [Paint; 3] = [Paint::Fields, Paint::Angle, Paint::Area];

/// The text of an SVG picture.
fn plot_map(map: &SkinMap, options: &PlotOptions) -> Result<String, PlotError> {
    Ok(plot::plot_map(map, options)?.to_svg())
}

/// Tags and texts, as a strict XML parser sees them.
fn elements(svg: &str) -> (Vec<String>, Vec<String>) {
    let document = Document::parse(svg).unwrap();
    let elements: Vec<_> = document.descendants().filter(|node| node.is_element()).collect();
    let texts = elements.iter().filter_map(|node| Some(node.text()?.to_owned()));
    (elements.iter().map(|node| node.tag_name().name().to_owned()).collect(), texts.collect())
}

fn count(tags: &[String], name: &str) -> usize {
    tags.iter().filter(|t| *t == name).count()
}

fn palm() -> PatchMap {
    square_pyramid("palm", &[13, 7, 4], 0.06, 0.001)
}

#[test]
fn every_panel_has_its_name_level_and_measures() {
    let svg = plot_map(&skin(vec![palm()]), &PlotOptions::default()).unwrap();
    let (tags, texts) = elements(&svg);
    for (level, line) in [(0, "169 taxels, 0 flips"), (1, "49 fields, 0 flips"), (2, "16 fields, 0 flips")] {
        assert!(texts.contains(&format!("palm, level {level}")), "{texts:?}");
        assert!(texts.iter().any(|t| t == line), "{line} in {texts:?}");
    }
    assert_eq!(count(&tags, "circle"), 169 + 49 + 16, "a dot for each taxel and each field");
    assert!(texts.iter().any(|t| t.ends_with(" mm")), "a scale bar");
}

/// Dots of taxels without a pressure reading are hollow, on every level, and a legend says so; only
/// where there are any.
#[test]
fn absent_taxels_are_hollow() {
    let mut palm = palm();
    let draw = |palm: &PatchMap, paint| {
        let options = PlotOptions { paint, space: Some(Viewpoint::Outside), ..PlotOptions::default() };
        let picture = plot::plot_map(&skin(vec![palm.clone()]), &options).unwrap();
        assert!(picture.to_png().unwrap().starts_with(b"\x89PNG"));
        picture.to_svg()
    };
    let hollow = |svg: &str| {
        let document = Document::parse(svg).unwrap();
        let groups = document.descendants().filter(|node| {
            node.attribute("fill") == Some("#ffffff")
                && node.attribute("stroke").is_some()
                && node.has_children()
        });
        groups.map(|group| group.children().filter(|node| node.is_element()).count()).collect::<Vec<_>>()
    };
    let legend = "absent taxel or thermal pad";
    let svg = draw(&palm, Paint::Fields);
    assert!(hollow(&svg).is_empty() && !svg.contains(legend));
    let corner = palm.levels[level_id(2)].level.origins[VertexId::new(0)];
    palm.taxels.presence[corner] = Presence::Absent;
    palm.taxels.presence[VertexId::new(20)] = Presence::ThermalPad;
    let svg = draw(&palm, Paint::Fields);
    let found = hollow(&svg);
    assert_eq!(found.last(), Some(&1), "a dot in the legend");
    assert!(svg.contains(legend));
    let on_level = |k| {
        let silent = palm.levels[level_id(k)].level.origins.iter();
        silent.filter(|&&taxel| palm.taxels.presence[taxel] != Presence::Present).count()
    };
    let wanted: usize = (0..3).map(on_level).sum();
    // The first panel shows the taxels in space.
    assert_eq!(found.iter().sum::<usize>(), on_level(0) + wanted + 1, "{found:?}");
    let angle = draw(&palm, Paint::Angle);
    assert!(hollow(&angle).is_empty() && !angle.contains(legend), "without dots no legend of them");
}

#[test]
fn levels_and_patches_are_those_asked_for() {
    let map = skin(vec![palm(), flat_patch("tip", shapes::lattice(5, 4, 0.004), 0.001)]);
    let panels = |patches: &[&str], levels: &[usize]| {
        let options = PlotOptions {
            patches: patches.iter().map(|&p| p.to_owned()).collect(),
            levels: levels.iter().map(|&k| level_id(k)).collect(),
            ..PlotOptions::default()
        };
        let (_, texts) = elements(&plot_map(&map, &options).unwrap());
        texts.into_iter().filter(|t| t.contains(", level ")).collect::<Vec<_>>()
    };
    assert_eq!(panels(&["tip"], &[]), ["tip, level 0"]);
    assert_eq!(panels(&["palm"], &[2, 0]), ["palm, level 2", "palm, level 0"], "in the order asked for");
    assert_eq!(
        panels(&[], &[0, 1]),
        ["palm, level 0", "palm, level 1", "tip, level 0"],
        "a patch without a level leaves its place empty"
    );
}

#[test]
fn unknown_patches_levels_and_widths_are_refused() {
    let map = skin(vec![palm()]);
    let ask = |options: PlotOptions| plot_map(&map, &options).unwrap_err();
    let error = ask(PlotOptions { patches: vec!["thumb".into()], ..PlotOptions::default() });
    assert!(error.to_string().contains("thumb") && error.to_string().contains("palm"), "{error}");
    let error = ask(PlotOptions { levels: vec![level_id(3)], ..PlotOptions::default() });
    assert!(matches!(error, PlotError::UnknownLevel { last: 2, .. }), "{error}");
    for width_px in [0, 10, 1 << 20] {
        let error = ask(PlotOptions { width_px, ..PlotOptions::default() });
        assert!(matches!(error, PlotError::Width { panels: 3, least: 200, .. }), "{error}");
    }
    let levels = vec![level_id(0); 80];
    let error = ask(PlotOptions { levels, ..PlotOptions::default() });
    assert!(error.to_string().contains("80 panels side by side need at least 3765"), "{error}");
    assert_eq!(plot_map(&skin(Vec::new()), &PlotOptions::default()), Err(PlotError::Empty));
}

#[test]
fn broken_maps_are_refused() {
    let mut patch = palm();
    patch.levels[level_id(1)].uv[PlaceId::new(3)] = DVec2::NAN;
    for paint in PAINTS {
        let result = plot_map(&skin(vec![patch.clone()]), &PlotOptions { paint, ..PlotOptions::default() });
        assert!(matches!(result, Err(PlotError::Map(MapError::NotFinite { .. }))), "{result:?}");
    }
}

#[test]
fn names_are_escaped() {
    for name in ["a<b&\"c\"", "]]>", "\u{1}\0\u{ffff}", "手のひら", ""] {
        let svg =
            plot_map(&skin(vec![flat_patch(name, shapes::square(), 0.1)]), &PlotOptions::default()).unwrap();
        let (_, texts) = elements(&svg);
        let shown: String =
            name.chars().map(|c| if c < ' ' || c == '\u{ffff}' { '\u{fffd}' } else { c }).collect();
        assert!(texts.contains(&format!("{shown}, level 0")), "{name:?}: {texts:?}");
    }
}

#[test]
fn a_png_has_the_size_of_its_picture() {
    for (width_px, paint) in [(200, Paint::Fields), (801, Paint::Angle), (400, Paint::Area)] {
        let options = PlotOptions { width_px, paint, ..PlotOptions::default() };
        let picture = plot::plot_map(&skin(vec![palm()]), &options).unwrap();
        let (svg, png) = (picture.to_svg(), picture.to_png().unwrap());
        assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
        let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
        assert_eq!(number(16), width_px, "width");
        let height = svg.split("height=\"").nth(1).unwrap().split('"').next().unwrap();
        assert_eq!(number(20).to_string(), height, "height");
    }
}

/// Left, right, top and bottom of the texts of a picture in the font that comes with the crate.
fn text_boxes(svg: &str) -> Vec<[f32; 4]> {
    let font = Face::parse(epaint_default_fonts::UBUNTU_LIGHT, 0).unwrap();
    let document = Document::parse(svg).unwrap();
    let number = |node: roxmltree::Node<'_, '_>, name| node.attribute(name).unwrap().parse::<f32>().unwrap();
    let em = number(document.root_element(), "font-size");
    let boxes = document.descendants().filter(|node| node.has_tag_name("text")).map(|node| {
        let letter_width = |c| {
            let glyph = font.glyph_index(c).unwrap_or_default();
            em * f32::from(font.glyph_hor_advance(glyph).unwrap()) / f32::from(font.units_per_em())
        };
        let width: f32 = node.text().unwrap_or_default().chars().map(letter_width).sum();
        let share = match node.attribute("text-anchor") {
            Some("middle") => 0.5,
            Some("end") => 1.0,
            _ => 0.0,
        };
        let (left, base) = (number(node, "x") - share * width, number(node, "y"));
        let [top, bottom] = [font.ascender(), font.descender()]
            .map(|y| base - em * f32::from(y) / f32::from(font.units_per_em()));
        [left, left + width, top, bottom]
    });
    boxes.collect()
}

/// The name is cut, and the measures break at commas, then between words.
#[test]
fn captions_of_narrow_panels_are_broken_and_not_lost() {
    let long = skin(vec![square_pyramid(&"n".repeat(50), &[13, 7, 4], 0.06, 0.001)]);
    for (width_px, is_broken) in [(1600, false), (300, true)] {
        let svg = plot_map(&long, &PlotOptions { width_px, ..PlotOptions::default() }).unwrap();
        let (_, texts) = elements(&svg);
        let names: Vec<_> = texts.iter().filter(|t| t.contains(", level ")).collect();
        assert!(names.iter().all(|t| t.starts_with("nnn") && t.contains("\u{2026}, level ")), "{names:?}");
        assert!(texts.iter().any(|t| t == "169 taxels, 0 flips"), "{texts:?}");
        let whole = texts.iter().filter(|t| t.starts_with("s1/s2 1.000 (max 1.00), area")).count();
        let parts = texts.iter().filter(|t| *t == "s1/s2 1.000 (max 1.00),").count();
        assert_eq!((whole, parts), if is_broken { (0, 3) } else { (3, 0) }, "{texts:?}");
    }
}

#[test]
fn no_text_leaves_the_picture_or_runs_into_another() {
    let long = "a_really_long_name_of_a_skin_as_exported_by_a_cad_program_revision_17_left_forearm_cover";
    for name in ["back", long, &"W".repeat(70)] {
        let mut patch = square_pyramid(name, &[13, 7, 4], 0.06, 0.001);
        let distortion = &mut patch.levels[level_id(1)].distortion;
        (distortion.qc_mean, distortion.qc_max) = (12_345.678, 98_765_432.1);
        let map = skin(vec![patch, PatchMap { name: "hand".into(), ..palm() }]);
        for (width_px, space) in
            [(200, None), (200, Some(Viewpoint::default())), (400, Some(Viewpoint::default())), (1600, None)]
        {
            let options = PlotOptions { width_px, space, paint: Paint::Area, ..PlotOptions::default() };
            let svg = plot_map(&map, &options).unwrap();
            assert!(svg.contains("1.2e4") && svg.contains("9.9e7"), "large numbers are short");
            let boxes = text_boxes(&svg);
            assert!(boxes.len() > 18, "{} texts", boxes.len());
            let width = width_px as f32;
            for (k, a) in boxes.iter().enumerate() {
                assert!(a[0] >= 0.0 && a[1] <= width, "{name:.9} at {width_px}: {a:?} leaves the picture");
                for b in &boxes[k + 1..] {
                    let apart = a[1] <= b[0] || b[1] <= a[0] || a[3] <= b[2] || b[3] <= a[2];
                    assert!(apart, "{name:.9} at {width_px}: {a:?} runs into {b:?}");
                }
            }
        }
    }
}

/// A map of any size is as large on its picture, and the bar tells how long it is: 1, 2 or 5 times a
/// power of ten, and no zeros at the end.
#[test]
fn the_bar_of_a_map_of_any_size_has_a_round_length() {
    for (side, expected) in [(1e-20, "e-18 mm"), (0.06, "20 mm"), (0.1, "20 mm"), (3.0, "1000 mm")] {
        let svg =
            plot_map(&skin(vec![square_pyramid("dust", &[5], side, side / 10.0)]), &PlotOptions::default());
        let (_, texts) = elements(&svg.unwrap());
        let bar = texts.iter().find(|t| t.ends_with(" mm")).unwrap();
        assert!(bar.ends_with(expected) && bar.starts_with(['1', '2', '5']), "{bar} for {side} m");
    }
}

/// The scales are those of ColorBrewer.
#[test]
fn colour_scales_begin_and_end_as_published() {
    for (paint, first, last) in [(Paint::Angle, "#ffffe5", "#662506"), (Paint::Area, "#2166ac", "#b2182b")] {
        let svg = plot_map(&skin(vec![palm()]), &PlotOptions { paint, ..PlotOptions::default() }).unwrap();
        let document = Document::parse(&svg).unwrap();
        let stops: Vec<_> = document.descendants().filter_map(|node| node.attribute("stop-color")).collect();
        assert_eq!((stops[0], *stops.last().unwrap()), (first, last), "{paint:?}");
    }
}

/// A mark at the end of a scale says that there are values beyond it, and only then.
#[test]
fn a_scale_says_where_values_are_beyond_it() {
    let map = skin(vec![palm()]);
    let texts = |paint, range| {
        elements(&plot_map(&map, &PlotOptions { paint, range, ..PlotOptions::default() }).unwrap()).1
    };
    for paint in [Paint::Angle, Paint::Area] {
        let own = texts(paint, None);
        assert!(!own.iter().any(|t| t.contains(['≤', '≥'])), "a map without distortion: {own:?}");
    }
    let mesh = shapes::lattice(9, 8, 0.01);
    let uv = mesh.positions.map(|p| DVec2::new(p.x * (1.0 + 5.0 * p.x), p.y));
    let map = skin(vec![patch("palm", vec![mapped_level(mesh, uv, 0.001)])]);
    let texts = |range| {
        let options = PlotOptions { paint: Paint::Angle, range, ..PlotOptions::default() };
        elements(&plot_map(&map, &options).unwrap()).1
    };
    let narrow = texts(Some([1.1, 1.2]));
    assert!(narrow.contains(&"≤ 1.1".to_owned()) && narrow.contains(&"≥ 1.2".to_owned()), "{narrow:?}");
    let wide = texts(Some([1.0, 9.0]));
    assert!(wide.contains(&"1".to_owned()) && wide.contains(&"9".to_owned()), "{wide:?}");
    for (paint, range) in [(Paint::Angle, [2.0, 1.0]), (Paint::Area, [1.5, 2.0]), (Paint::Fields, [0.0, 1.0])]
    {
        let options = PlotOptions { paint, range: Some(range), ..PlotOptions::default() };
        assert!(matches!(plot_map(&map, &options), Err(PlotError::Range { .. })), "{paint:?}");
    }
}

/// A map with a fault is not to be taken for a good one.
#[test]
fn a_map_with_flips_or_crossings_is_framed_in_red() {
    let red = "#d01010";
    let plot = |edit: &dyn Fn(&mut IdVec<VertexId, DVec2>)| {
        let mesh = shapes::lattice(6, 5, 0.01);
        let mut uv = mesh.positions.map(|p| p.truncate());
        edit(&mut uv);
        let map = skin(vec![patch("palm", vec![mapped_level(mesh, uv, 0.001)])]);
        plot_map(&map, &PlotOptions::default()).unwrap()
    };
    let good = plot(&|_| ());
    assert!(!good.contains(red) && good.contains("palm, level 0<"));
    let flipped = plot(&|uv| uv.iter_mut().for_each(|p| p.x = (p.x - 0.012).abs()));
    assert!(flipped.contains(red) && flipped.contains("level 0: flipped triangles"), "{flipped}");
    let thin = plot(&|uv| uv.iter_mut().for_each(|p| p.x *= 1e-3));
    assert!(thin.contains(red) && thin.contains("level 0: far from isometric"));
    let poor = plot(&|uv| uv.iter_mut().for_each(|p| p.x *= 0.2));
    assert!(poor.contains(red) && poor.contains("level 0: poor"));
}

/// Level 0 of a mesh too fine for lines and dots is no blank shape: squares of the map are seen.
#[test]
fn a_fine_mesh_has_a_checker() {
    let colours = |columns| {
        let map = SkinMap::flat(shapes::lattice(columns, columns, 0.004), 1e-3);
        let png = plot::plot_map(&map, &PlotOptions::default()).unwrap().to_png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        let pixels = bytes.as_chunks::<3>().0;
        [[0xe3, 0xea, 0xf2], [0xc3, 0xcf, 0xdf]].map(|colour| pixels.iter().filter(|p| **p == colour).count())
    };
    let [skin, shade] = colours(100);
    assert!(skin > 1000 && shade > 1000 && skin < 2 * shade && shade < 2 * skin, "{skin}, {shade}");
    assert_eq!(colours(10)[1], 0, "a coarse mesh has lines and dots");
}

/// Patches of a large robot stand side by side, so that the picture is seen at a glance.
#[test]
fn many_patches_are_drawn_on_two_screens() {
    let patches = |count: usize| {
        let patch = |k| square_pyramid(&format!("patch{k}"), &[7, 4], 0.06, 0.001);
        skin((0..count).map(patch).collect())
    };
    for count in [1, 2, 5, 13, 30] {
        let svg = plot_map(&patches(count), &PlotOptions::default()).unwrap();
        let document = Document::parse(&svg).unwrap();
        let side = |name| document.root_element().attribute(name).unwrap().parse::<f64>().unwrap();
        assert!(side("height") <= 1.125 * side("width"), "{count}: {} high", side("height"));
        for k in 0..count {
            assert_eq!(svg.matches(&format!("patch{k}, level 1<")).count(), 1, "patch{k} of {count}");
        }
    }
}

/// On a fine mesh dots would hide the colours.
#[test]
fn fine_meshes_have_no_dots() {
    let dots = |columns| {
        let map = skin(vec![flat_patch("fine", shapes::lattice(columns, 70, 0.001), 0.001)]);
        let options = PlotOptions { width_px: 4000, ..PlotOptions::default() };
        plot_map(&map, &options).unwrap().matches("<circle").count()
    };
    assert_eq!((dots(80), dots(70)), (0, 4900));
}

/// Letters come with the crate: a PNG shows them whichever fonts the machine has.
#[test]
fn letters_are_drawn_without_fonts_of_the_machine() {
    let picture = |name: &str| {
        let map = skin(vec![flat_patch(name, shapes::square(), 0.1)]);
        plot::plot_map(&map, &PlotOptions::default()).unwrap().to_png().unwrap()
    };
    for (a, b) in [("s1", "s2"), ("≥", "≤"), ("é", "e"), ("Σ", "Ж")] {
        assert_ne!(picture(a), picture(b), "{a} and {b}");
    }
}

#[test]
fn the_picture_of_a_large_mesh_stays_small() {
    let map = skin(vec![flat_patch("cap", shapes::cap(100_000, 0.1, 1.2), 0.001)]);
    for paint in PAINTS {
        let svg = plot_map(&map, &PlotOptions { paint, ..PlotOptions::default() }).unwrap();
        assert!(svg.len() < 4 << 20, "{paint:?}: {} bytes", svg.len());
        let (tags, _) = elements(&svg);
        assert!(tags.len() < 200, "{paint:?}: {} elements", tags.len());
    }
}

#[test]
fn a_picture_is_the_same_every_time() {
    let map = skin(vec![palm()]);
    for paint in PAINTS {
        let draw = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| plot_map(&map, &PlotOptions { paint, ..PlotOptions::default() }).unwrap())
        };
        assert_eq!(draw(1), draw(3), "{paint:?}");
    }
}

/// All vertices on a line: no triangle has an area.
#[test]
fn a_map_without_area_is_drawn() {
    let mut point = flat_level(shapes::triangle(), 0.1);
    point.uv = vec![DVec2::ONE, 2.0 * DVec2::ONE, DVec2::ONE].into();
    for paint in PAINTS {
        let map = skin(vec![maps::patch("point", vec![point.clone()])]);
        plot::plot_map(&map, &PlotOptions { paint, ..PlotOptions::default() }).unwrap().to_png().unwrap();
    }
}

fn plot(map: &Path) -> Command {
    let mut command = common::command();
    command.arg("plot").arg(map);
    command
}

#[test]
fn the_command_writes_the_kinds_that_its_outputs_name() {
    let folder = tempfile::tempdir().unwrap();
    let [map, svg, png] = ["map.glb", "p.svg", "p.PNG"].map(|name| folder.path().join(name));
    write_map(&map, &skin(vec![palm()])).unwrap();
    plot(&map)
        .arg("-o")
        .arg(&svg)
        .arg("-o")
        .arg(&png)
        .args(["--show", "area", "--level", "1"])
        .assert()
        .success();
    let (_, texts) = elements(&fs::read_to_string(svg).unwrap());
    assert!(
        texts.iter().any(|t| t == "palm, level 1") && texts.iter().any(|t| t == "area on map / on skin"),
        "{texts:?}"
    );
    assert!(fs::read(png).unwrap().starts_with(b"\x89PNG"));
    plot(&map).args(["-o", "-"]).assert().success().stdout(contains("palm, level 2"));
}

#[test]
fn the_command_refuses_unknown_levels_patches_and_kinds() {
    let folder = tempfile::tempdir().unwrap();
    let [map, svg, jpg] = ["map.glb", "p.svg", "p.jpg"].map(|name| folder.path().join(name));
    write_map(&map, &skin(vec![palm()])).unwrap();
    plot(&map).arg("-o").arg(&svg).args(["--level", "7"]).assert().code(2).stderr(contains("no level 7"));
    plot(&map).arg("-o").arg(&svg).args(["--patch", "toe"]).assert().code(2).stderr(contains("it has palm"));
    plot(&map).arg("-o").arg(&svg).arg("-o").arg(&jpg).assert().code(2).stderr(contains(".svg, .png"));
    plot(&svg).arg("-o").arg(&svg).assert().code(2);
    assert!(!svg.exists() && !jpg.exists(), "nothing is written before everything is known to be right");
}

/// The strip begins with the skin in space, ends with the map, and has a panel for each time.
#[test]
fn the_unfolding_is_a_strip_of_panels() {
    let options = PlotOptions { unfold: vec![0.0, 0.5, 1.0], ..PlotOptions::default() };
    for paint in PAINTS {
        let svg = plot_map(&skin(vec![palm()]), &PlotOptions { paint, ..options.clone() }).unwrap();
        let (_, texts) = elements(&svg);
        for which in ["palm, in space", "palm, 50 % unfolded", "palm, its map"] {
            assert!(texts.iter().any(|text| text == which), "{which} in {texts:?}");
        }
    }
    let beyond = PlotOptions { unfold: vec![1.5], ..PlotOptions::default() };
    assert!(matches!(plot_map(&skin(vec![palm()]), &beyond), Err(PlotError::Time { .. })));
}
