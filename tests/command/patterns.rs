//! Patterns at 1:1: SVG and DXF, read back by a strict XML parser and by group codes, say the same in mm.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::common::{cut_sheet, dermatome, listing, refuses};
use dermatome::io::write_skin;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::Skin;
use glam::{DVec2, DVec3};

/// An element on a layer: straight lines, a point or a text; in mm, y up.
#[derive(Debug, Clone, Default, PartialEq)]
struct Element {
    layer: String,
    kind: &'static str,
    points: Vec<DVec2>,
    is_closed: bool,
    text: String,
}

impl Element {
    fn length(&self) -> f64 {
        let closing = self.is_closed.then(|| self.points[0].distance(*self.points.last().unwrap()));
        self.points.windows(2).map(|p| p[0].distance(p[1])).sum::<f64>() + closing.unwrap_or(0.0)
    }
}

/// Group codes and values of a DXF.
fn groups(text: &str) -> Vec<(u16, &str)> {
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len() % 2, 0, "pairs");
    lines.chunks(2).map(|pair| (pair[0].trim().parse().unwrap(), pair[1])).collect()
}

fn read_dxf(path: &Path) -> Vec<Element> {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.is_ascii());
    let groups = groups(&text);
    assert_eq!(groups.last(), Some(&(0, "EOF")));
    let value = |name| groups[groups.iter().position(|g| *g == (9, name)).unwrap() + 1];
    assert_eq!((value("$ACADVER"), value("$INSUNITS")), ((1, "AC1009"), (70, "4")), "Release 12 in mm");
    let start = groups.iter().position(|g| *g == (2, "ENTITIES")).unwrap();
    let mut elements: Vec<Element> = Vec::new();
    let (mut is_vertex, mut at) = (false, DVec2::ZERO);
    for &(code, value) in &groups[start + 1..] {
        let last = elements.last_mut();
        match (code, value, last) {
            (0, "VERTEX", _) => is_vertex = true,
            (0, "SEQEND" | "ENDSEC" | "EOF", _) => is_vertex = false,
            (0, kind, _) => {
                let kind = ["POLYLINE", "POINT", "TEXT"].into_iter().find(|k| *k == kind).unwrap();
                elements.push(Element { kind, ..Element::default() });
                is_vertex = false;
            }
            (8, layer, Some(last)) if !is_vertex => last.layer = layer.to_owned(),
            (1, text, Some(last)) => last.text = text.to_owned(),
            (70, flags, Some(last)) if last.kind == "POLYLINE" => last.is_closed = flags == "1",
            (10, x, _) => at.x = x.parse().unwrap(),
            (20, y, Some(last)) => {
                at.y = y.parse().unwrap();
                if is_vertex || last.kind != "POLYLINE" {
                    last.points.push(at);
                }
            }
            _ => {}
        }
    }
    elements
}

/// The number in an attribute.
fn number(node: roxmltree::Node<'_, '_>, name: &str) -> f64 {
    node.attribute(name).unwrap().trim_end_matches("mm").parse().unwrap()
}

/// Width and height in mm, and the elements on layers.
fn read_svg(path: &Path) -> (DVec2, Vec<Element>) {
    let text = fs::read_to_string(path).unwrap();
    let document = roxmltree::Document::parse(&text).unwrap();
    let root = document.root_element();
    let size = DVec2::new(number(root, "width"), number(root, "height"));
    assert_eq!(root.attribute("viewBox").unwrap(), format!("0 0 {} {}", size.x, size.y), "a unit is one mm");
    assert!(root.attribute("width").unwrap().ends_with("mm"));
    let point = |text: &str| {
        let (x, y) = text.split_once(' ').unwrap();
        DVec2::new(x.parse().unwrap(), size.y - y.parse::<f64>().unwrap())
    };
    let mut elements = Vec::new();
    for node in root.descendants().filter(|node| node.is_element()) {
        let layer = node.parent().and_then(|g| g.attribute("id")).unwrap_or_default().to_owned();
        let element = |kind, points, text: &str| Element {
            layer: layer.clone(),
            kind,
            points,
            is_closed: false,
            text: text.to_owned(),
        };
        match node.tag_name().name() {
            "path" => {
                let d = node.attribute("d").unwrap();
                for piece in d.split('M').skip(1) {
                    let points = piece.trim_end_matches('Z').split('L').map(point).collect();
                    elements
                        .push(Element { is_closed: piece.ends_with('Z'), ..element("POLYLINE", points, "") });
                }
            }
            "circle" => {
                let at = DVec2::new(number(node, "cx"), size.y - number(node, "cy"));
                elements.push(element("POINT", vec![at], ""));
            }
            "text" => {
                let place = node.attribute("transform").unwrap().strip_prefix("translate(").unwrap();
                let at = point(place.split(')').next().unwrap());
                elements.push(element("TEXT", vec![at], node.text().unwrap()));
            }
            _ => {}
        }
    }
    (size, elements)
}

fn on<'a>(elements: &'a [Element], layer: &str, kind: &str) -> Vec<&'a Element> {
    elements.iter().filter(|e| e.layer == layer && e.kind == kind).collect()
}

fn write(folder: &Path, name: &str, mesh: TriMesh) {
    let (patch, _) = name.split_once('.').unwrap();
    write_skin(&folder.join(name), &Skin::from_mesh(patch, mesh)).unwrap();
}

/// Total length of the edges of one face, in mm.
fn rims(mesh: &TriMesh) -> f64 {
    let mut counts = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        for [p, q] in [[a, b], [b, c], [c, a]] {
            *counts.entry([p.min(q), p.max(q)]).or_insert(0) += 1;
        }
    }
    let length = |[a, b]: [_; 2]| 1e3 * mesh.positions[a].distance(mesh.positions[b]);
    counts.into_iter().filter(|(_, count)| *count == 1).map(|(edge, _)| length(edge)).sum()
}

/// A tube becomes a panel: its rims are as long as on the tube, both banks of its seam are equally long, and each
/// tick is as far along its bank as its namesake. SVG and DXF show the same.
#[test]
fn a_tube_is_a_panel_with_two_matching_banks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let tube = shapes::tube(64, 20, 0.03, 0.1);
    write(path, "tube.obj", tube.clone());
    dermatome(path, "flatten tube.obj --cut all -o p.svg -o p.dxf").assert().success();
    let (dxf, (_, svg)) = (read_dxf(&path.join("p.dxf")), read_svg(&path.join("p.svg")));
    for (a, layer) in [("POLYLINE", "CUT"), ("POLYLINE", "SEAM"), ("POINT", "TAXEL"), ("TEXT", "TEXT")] {
        let [a, b] = [&dxf, &svg].map(|elements| on(elements, layer, a));
        assert_eq!(a.len(), b.len(), "{layer}");
        for (a, b) in a.iter().zip(&b) {
            assert_eq!((&a.text, a.is_closed, a.points.len()), (&b.text, b.is_closed, b.points.len()));
            let far = a.points.iter().zip(&b.points).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
            assert!(far < 3e-4, "{layer}: {far} mm apart");
        }
    }
    let cut: f64 = on(&dxf, "CUT", "POLYLINE").iter().map(|e| e.length()).sum();
    assert!((cut - rims(&tube)).abs() < 0.5, "rims of {cut} mm, on the tube {}", rims(&tube));
    let banks = on(&dxf, "SEAM", "POLYLINE");
    assert_eq!(banks.len(), 2);
    let [left, right] = [0, 1].map(|k| banks[k].length());
    assert!((left - right).abs() < 0.05 && left > 99.5, "{left} and {right} mm");
    assert!(!banks[0].is_closed, "between two rims");
    // Rims and banks are closed outlines: each end of one is that of another.
    let mut ends = BTreeMap::new();
    for piece in dxf.iter().filter(|e| e.layer == "CUT" || e.layer == "SEAM") {
        for p in [piece.points[0], *piece.points.last().unwrap()] {
            *ends.entry(format!("{p}")).or_insert(0) += 1;
        }
    }
    assert!(ends.values().all(|count| *count == 2), "{ends:?}");

    let along = |bank: &Element, at: DVec2| {
        let mut walked = 0.0;
        for edge in bank.points.windows(2) {
            let (step, out) = (edge[1] - edge[0], at - edge[0]);
            let part = out.dot(step) / step.length_squared();
            if (-1e-3..=1.001).contains(&part) && (out - part * step).length() < 1e-3 {
                // The skin is to the left of the bank, where the tick points.
                return Some((walked + part * step.length(), step));
            }
            walked += step.length();
        }
        None
    };
    let marks: Vec<&Element> = dxf.iter().filter(|e| e.layer == "TEXT").collect();
    let mut ticks: BTreeMap<&str, Vec<(usize, f64)>> = BTreeMap::new();
    for pair in marks.windows(2) {
        if let [tick, label] = pair
            && label.text.starts_with('A')
        {
            let (bank, (at, step)) =
                (0..2).find_map(|k| Some((k, along(banks[k], tick.points[0])?))).expect("on a bank");
            assert!(step.perp_dot(tick.points[1] - tick.points[0]) > 0.0, "ticks point into the sheet");
            ticks.entry(&label.text).or_default().push((bank, at));
        }
    }
    assert!(ticks.len() >= 9, "{ticks:?}");
    for (name, places) in &mut ticks {
        places.sort_by_key(|place| place.0);
        let [(0, a), (1, b)] = places[..] else { panic!("{name} once on each bank: {places:?}") };
        assert!((a + b - left).abs() < 0.05, "{name}: {a} and {b} of {left} mm");
    }

    let texts: Vec<&str> = marks.iter().map(|e| &*e.text).collect();
    assert!(texts.iter().any(|t| t.starts_with("1 %: 0.0 %")), "nearly developable: {texts:?}");
    assert!(texts.contains(&"50 mm"));
    let bars = marks.iter().filter(|e| e.points.len() == 2 && (e.length() - 50.0).abs() < 1e-9).count();
    assert_eq!(bars, 1, "the bar");
    let ids: BTreeSet<&str> = on(&dxf, "TAXEL", "TEXT").iter().map(|e| &*e.text).collect();
    assert_eq!(ids.len(), tube.positions.len(), "each taxel has its id");
    assert_eq!(on(&svg, "STRAIN", "POLYLINE").len(), tube.triangles.len() + 21, "each face and the scale");
    assert!(dxf.iter().all(|e| e.layer != "STRAIN"));
}

/// A flat panel with a hole is its own pattern, to a hundredth of a millimetre.
#[test]
fn a_flat_panel_with_a_hole_is_its_own_pattern() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let is_kept = |x: f64, y: f64| DVec2::new(x - 5.0, y - 4.3).length() > 2.1;
    let skin = cut_sheet(0.008, is_kept);
    let mesh = skin.patches.iter().next().unwrap().mesh.clone();
    write_skin(&path.join("panel.obj"), &skin).unwrap();
    dermatome(path, "flatten panel.obj -o p.svg -o p.dxf").assert().success();
    for elements in [read_dxf(&path.join("p.dxf")), read_svg(&path.join("p.svg")).1] {
        let cut = on(&elements, "CUT", "POLYLINE");
        assert_eq!(cut.len(), 2, "the rim and the hole");
        assert!(cut.iter().all(|e| e.is_closed));
        let length: f64 = cut.iter().map(|e| e.length()).sum();
        assert!((length - rims(&mesh)).abs() < 0.01, "{length} mm, not {}", rims(&mesh));
        assert!(on(&elements, "SEAM", "POLYLINE").is_empty());
        let taxels = on(&elements, "TAXEL", "POINT");
        assert_eq!(taxels.len(), mesh.positions.len());
        let distance = |a: usize, b: usize| taxels[a].points[0].distance(taxels[b].points[0]);
        let on_skin = |a: usize, b: usize| {
            let positions: Vec<DVec3> = mesh.positions.iter().copied().collect();
            1e3 * positions[a].distance(positions[b])
        };
        let last = taxels.len() - 1;
        for (a, b) in [(0, last), (3, 40), (10, last - 10)] {
            assert!((distance(a, b) - on_skin(a, b)).abs() < 0.01, "taxels {a} and {b}");
        }
    }
}

/// Patches of a map lie apart, each with its name; `--patch` draws one. The number of threads changes nothing.
#[test]
fn patches_of_a_map_lie_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "cap.obj", shapes::cap(300, 0.05, 0.9));
    write(path, "torus.obj", shapes::torus(24, 12, 0.05, 0.02));
    dermatome(path, "build cap.obj torus.obj -o out").assert().success();
    dermatome(path, "plot out/map.glb --pattern -o p.svg -o p.dxf --threads 1").assert().success();
    dermatome(path, "plot out/map.glb --pattern -o q.svg -o q.dxf --threads 2").assert().success();
    for kind in ["svg", "dxf"] {
        let [p, q] = ["p", "q"].map(|name| fs::read_to_string(path.join(format!("{name}.{kind}"))).unwrap());
        assert_eq!(p.replace("<title>p</title>", "<title>q</title>"), q, "{kind}");
    }
    let (size, elements) = read_svg(&path.join("p.svg"));
    let outline = elements.iter().filter(|e| e.layer == "CUT" || e.layer == "SEAM");
    let boxes: Vec<[DVec2; 2]> = outline
        .map(|e| {
            let fold = |f: fn(DVec2, DVec2) -> DVec2| e.points.iter().copied().reduce(f).unwrap();
            [fold(DVec2::min), fold(DVec2::max)]
        })
        .collect();
    assert!(boxes.iter().all(|[low, high]| low.min_element() >= 0.0 && high.cmple(size).all()));
    let [a, b] = boxes[..] else { panic!("a rim and a seam: {boxes:?}") };
    assert!(a[1].cmplt(b[0]).any() || b[1].cmplt(a[0]).any(), "{a:?} and {b:?}");
    let labels: Vec<&str> = on(&elements, "TEXT", "TEXT").iter().map(|e| &*e.text).collect();
    for name in ["cap", "torus"] {
        assert!(labels.iter().any(|text| text.contains(name)), "{name} in {labels:?}");
    }
    // A torus has curves of its seam that meet: each tick is there twice.
    let mut ticks = BTreeMap::new();
    let is_tick =
        |t: &&&str| t.as_bytes()[0].is_ascii_uppercase() && t.as_bytes()[1..].iter().all(u8::is_ascii_digit);
    labels.iter().filter(is_tick).for_each(|t| *ticks.entry(t).or_insert(0) += 1);
    assert!(ticks.len() > 10 && ticks.values().all(|count| *count == 2), "{ticks:?}");

    dermatome(path, "plot out/map.glb --pattern --patch cap* -o cap.dxf").assert().success();
    let cap = read_dxf(&path.join("cap.dxf"));
    assert_eq!(on(&cap, "CUT", "POLYLINE").len(), 1);
    let printed = dermatome(path, "plot out/map.glb --pattern -o -").assert().success();
    assert!(printed.get_output().stdout.starts_with(b"<svg"));
}

/// Each point of the pattern is on the sheet of its row and column, at its place between the margins.
#[test]
fn sheets_join_to_the_pattern() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "tube.obj", shapes::tube(32, 10, 0.03, 0.1));
    dermatome(path, "flatten tube.obj --cut all -o p.svg").assert().success();
    dermatome(path, "flatten tube.obj --cut all -o s.svg -o s.obj --sheet 120,150").assert().success();
    let (size, whole) = read_svg(&path.join("p.svg"));
    let (columns, rows) = ((size.x / 100.0).ceil(), (size.y / 130.0).ceil());
    let count = listing(path).iter().filter(|name| name.starts_with("s-")).count();
    assert_eq!(count as f64, columns * rows, "{size}");
    assert!(!path.join("s.svg").exists() && path.join("s.obj").exists());
    let sheets: Vec<_> = (1..=count).map(|k| read_svg(&path.join(format!("s-{k}.svg")))).collect();
    for (k, (paper, elements)) in sheets.iter().enumerate() {
        assert_eq!(*paper, DVec2::new(120.0, 150.0));
        let marks = on(elements, "SHEET", "POLYLINE");
        assert_eq!(marks.iter().filter(|e| (e.length() - 8.0).abs() < 1e-9).count(), 8, "four crosses");
        assert!(marks.iter().any(|e| (e.length() - 50.0).abs() < 1e-9), "a bar");
        let label = format!("s: sheet {} of {count}", k + 1);
        assert!(on(elements, "SHEET", "TEXT").iter().any(|e| e.text.starts_with(&label)));
    }
    for taxel in on(&whole, "TAXEL", "POINT") {
        let at = DVec2::new(taxel.points[0].x, size.y - taxel.points[0].y);
        let cell = (at / DVec2::new(100.0, 130.0)).floor();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few sheets")]
        let (_, elements) = &sheets[(cell.y * columns + cell.x) as usize];
        let there = at - cell * DVec2::new(100.0, 130.0) + 10.0;
        let there = DVec2::new(there.x, 150.0 - there.y);
        let near = |e: &&Element| e.points[0].distance(there) < 3e-4;
        assert!(on(elements, "TAXEL", "POINT").iter().any(near), "{at} at {there}");
    }
    // A4 lies on its side where fewer are needed then: 220 mm of pattern fit 277 mm.
    dermatome(path, "flatten tube.obj --cut all -o a.svg --sheet A4").assert().success();
    let papers: Vec<_> = listing(path).into_iter().filter(|name| name.starts_with("a-")).collect();
    assert_eq!(papers, ["a-1.svg"]);
    let [width, height] = read_svg(&path.join("a-1.svg")).0.to_array();
    assert_eq!(width + height, 507.0);
}

#[test]
fn patterns_that_cannot_be_written_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "small.obj", shapes::lattice(5, 5, 0.01));
    write(path, "large.obj", shapes::lattice(11, 11, 0.5));
    write(path, "p-1.obj", shapes::lattice(5, 5, 0.01));
    let cases: [(&str, &[&str]); 9] = [
        ("flatten small.obj -o p.png", &["p.png", "obj, npz, svg, dxf"]),
        ("flatten small.obj -o p.svg --sheet 20,20", &["20 x 20 mm", "100 to 100000 mm", "--sheet A4"]),
        ("flatten small.obj -o p.svg --sheet A5", &["A4, A3, or width and height in mm"]),
        ("flatten small.obj -o p.obj --sheet A4", &["--sheet changes nothing"]),
        ("flatten large.obj -o p.svg --sheet A4", &["sheets; at most 200", "--unit"]),
        ("flatten large.obj -o p.svg --sheet nan,200", &["A4, A3"]),
        ("plot small.obj --pattern -o p.svg", &["small.obj"]),
        ("plot small.obj --pattern -o p.png", &[".svg, .dxf"]),
        ("plot small.obj --sheet A4 -o p.svg", &["--pattern"]),
    ];
    for (words, said) in cases {
        refuses(path, words, said);
    }
    refuses(path, "plot small.obj --pattern --level 1 -o p.svg", &["cannot be used with"]);
    assert_eq!(listing(path), ["large.obj", "p-1.obj", "small.obj"], "nothing is written");
}
