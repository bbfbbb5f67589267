//! The rooms of the crate, from the ground up, and the doors to other crates.
//! A room may name only rooms listed before it; an outside crate has one door.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::{fs, path::Path};

const ROOMS: &[&str] = &[
    "id", "numeric", "mesh", "delaunay", "sparse", "skin", "calib", "pyramid", "flatten", "map", "atlas",
    "contact", "io", "plot", "report", "error", "pipeline",
];

const DOORS: &[(&str, &str)] =
    &[("spade", "delaunay"), ("faer", "sparse"), ("obvhs", "contact"), ("gltf", "io"), ("exr", "io")];

/// Calls `visit(room, text)` for every source file of the library.
fn each_file(dir: &Path, room: Option<&str>, visit: &mut dyn FnMut(&str, &str)) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() && stem != "bin" {
            each_file(&path, room.or(Some(&stem)), visit);
        } else if path.extension().is_some_and(|e| e == "rs") && (room.is_some() || stem != "lib") {
            visit(room.unwrap_or(&stem), &fs::read_to_string(&path).unwrap());
        }
    }
}

/// The text without comments.
fn code(text: &str) -> String {
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

/// The identifier that `text` begins with.
fn identifier(text: &str) -> &str {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default()
}

/// Rooms named after `crate::`, one by one or in a group `crate::{a::.., b::{..}}`.
fn rooms_named(text: &str) -> Vec<String> {
    let code = code(text);
    let mut rooms = Vec::new();
    for (at, prefix) in code.match_indices("crate::") {
        // `$crate::` of a macro and `some_crate::` are other things.
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '$') {
            continue;
        }
        let rest = &code[at + prefix.len()..];
        let Some(group) = rest.strip_prefix('{') else {
            rooms.push(identifier(rest).to_owned());
            continue;
        };
        let mut depth = 1;
        let mut begins = true;
        for (k, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => begins = true,
                c if begins && !c.is_whitespace() => {
                    rooms.push(identifier(&group[k..]).to_owned());
                    begins = false;
                }
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
    }
    // `crate::Error` and `crate::Result` are the room `error`.
    rooms.iter_mut().filter(|r| *r == "Error").for_each(|r| "error".clone_into(r));
    rooms
}

#[test]
fn groups_and_single_paths_are_both_seen() {
    let text =
        "use crate::{\n    id::{A, B},\n    mesh::TriMesh, // crate::io\n};\nlet x = crate::skin::y();";
    assert_eq!(rooms_named(text), ["id", "numeric", "mesh", "skin"]);
}

#[test]
fn arrows_point_down() {
    let rank = |room: &str| {
        ROOMS.iter().position(|r| *r == room).unwrap_or_else(|| panic!("room {room:?} is not in ROOMS"))
    };
    each_file(Path::new("src"), None, &mut |room, text| {
        for other in rooms_named(text) {
            assert!(rank(&other) <= rank(room), "{room} must not name {other}");
        }
    });
}

#[test]
fn each_outside_crate_has_one_door() {
    each_file(Path::new("src"), None, &mut |room, text| {
        for (outside, door) in DOORS {
            let named = text.lines().any(|l| {
                let l = l.trim_start();
                !l.starts_with("//")
                    && (l.starts_with(&format!("use {outside}")) || l.contains(&format!("{outside}::")))
            });
            assert!(!named || room == *door, "{outside} is reached through {door}, not {room}");
        }
    });
}
