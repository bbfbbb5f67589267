//! The shape of the source, read from its text: which module may name which, which may use an
//! outside crate, that no files import each other in a circle, that only the command speaks of its
//! options, and that every file says what it is for.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

/// The modules of the library; each may name only those before it.
const MODULES: &[&str] = &[
    "id", "parallel", "numeric", "mesh", "bvh", "delaunay", "sparse", "skin", "calib", "cut", "pyramid",
    "flatten", "map", "atlas", "contact", "signal", "image", "io", "plot", "report", "error", "pipeline",
];

/// The folders and files, by the beginning of their path in `src`, that may use each outside crate.
const DOORS: &[(&str, &[&str])] = &[
    ("glam", &[""]),
    ("rayon", &[""]),
    ("thiserror", &[""]),
    ("libm", &["calib", "numeric"]),
    ("rand_pcg", &["numeric"]),
    ("dermatome_bvh", &["lib.rs"]),
    ("dermatome_delaunay", &["lib.rs"]),
    ("dermatome_sparse", &["lib.rs"]),
    ("gltf", &["io/gltf"]),
    ("exr", &["io/image"]),
    ("base64", &["io/gltf", "plot/picture/svg.rs"]),
    ("flate2", &["io/arrays", "io/image"]),
    ("ply_rs_bw", &["io/mesh/ply.rs"]),
    ("serde", &["flatten/distortion.rs", "io", "report.rs", "bin"]),
    ("serde_json", &["io", "bin"]),
    ("tempfile", &["io/file", "bin"]),
    ("zip", &["io/arrays"]),
    ("zmij", &["io/table"]),
    ("epaint_default_fonts", &["plot/picture/font.rs"]),
    ("png", &["plot/picture/png.rs"]),
    ("tiny_skia", &["plot/picture"]),
    ("ttf_parser", &["plot/picture/font.rs"]),
    ("anyhow", &["bin"]),
    ("clap", &["bin"]),
    ("clap_complete", &["bin"]),
    ("clap_mangen", &["bin"]),
    ("glob", &["bin"]),
    ("indicatif", &["bin"]),
    ("signal_hook", &["bin"]),
];

/// A source file.
struct Source {
    /// Its path in `src`, as `contact/map_index/plane_grid.rs`.
    path: String,
    /// Its module, as `["contact", "map_index", "plane_grid"]`; in the command all begin with `bin`.
    module: Vec<String>,
    text: String,
    /// The text without comments, strings and unit tests.
    code: String,
    strings: Vec<String>,
}

impl Source {
    /// The first part of its module.
    fn top(&self) -> &str {
        self.module.first().map_or("lib", String::as_str)
    }

    fn is_command(&self) -> bool {
        self.top() == "bin"
    }
}

fn sources() -> Vec<Source> {
    let mut paths = Vec::new();
    let mut folders = vec![PathBuf::from("src")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                paths.push(path);
            }
        }
    }
    paths.sort();
    paths.iter().map(|path| source(path)).collect()
}

fn source(file: &Path) -> Source {
    let path = file.strip_prefix("src").unwrap();
    let mut module: Vec<String> =
        path.with_extension("").iter().map(|part| part.to_str().unwrap().to_owned()).collect();
    if ["mod", "lib", "main"].contains(&module.last().unwrap().as_str()) {
        module.pop();
    }
    if module.first().is_some_and(|first| first == "bin") {
        // `src/bin/dermatome` is the root of the command.
        module.remove(1);
    }
    let text = fs::read_to_string(file).unwrap();
    let (code, strings) = without_comments_and_strings(before_unit_tests(&text));
    Source { path: path.to_str().unwrap().replace('\\', "/"), module, text, code, strings }
}

/// Unit tests end a file, and may use whatever they need.
fn before_unit_tests(text: &str) -> &str {
    text.find("\n#[cfg(test)]\nmod ").map_or(text, |at| &text[..at])
}

/// The text without comments and with empty strings, and the strings.
fn without_comments_and_strings(text: &str) -> (String, Vec<String>) {
    let (mut code, mut strings) = (String::new(), Vec::new());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if let Some((string, length)) = string(rest) {
            if !code.ends_with("doc = ") {
                strings.push(string.to_owned());
            }
            code.push_str("\"\"");
            length
        } else if let Some(length) = character(rest) {
            code.push_str("' '");
            length
        } else {
            code.push(c);
            c.len_utf8()
        };
        rest = &rest[length..];
    }
    (code, strings)
}

/// The string that `text` begins with, and its length with its quotes.
fn string(text: &str) -> Option<(&str, usize)> {
    if let Some(rest) = text.strip_prefix('"') {
        let mut escaped = false;
        for (at, c) in rest.char_indices() {
            match c {
                '"' if !escaped => return Some((&rest[..at], at + 2)),
                '\\' => escaped = !escaped,
                _ => escaped = false,
            }
        }
        return None;
    }
    let hashes = text.strip_prefix('r')?.chars().take_while(|&c| c == '#').count();
    let rest = text[1 + hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    let at = rest.find(&end)?;
    Some((&rest[..at], 1 + hashes + 1 + at + end.len()))
}

/// The length of the character literal that `text` begins with; a lifetime has no
/// closing quote.
fn character(text: &str) -> Option<usize> {
    let rest = text.strip_prefix('\'')?;
    if let Some(escape) = rest.strip_prefix('\\') {
        return Some(3 + escape.char_indices().skip(1).find(|&(_, c)| c == '\'')?.0);
    }
    let c = rest.chars().next()?;
    rest[c.len_utf8()..].starts_with('\'').then(|| 2 + c.len_utf8())
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The identifier that `text` begins with.
fn identifier(text: &str) -> &str {
    text.split(|c| !is_word(c)).next().unwrap_or_default()
}

/// Where `word` stands alone in `code`: not as a part of a name, of a longer path or of `$crate`.
fn places<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    code.match_indices(word).map(|(at, _)| at).filter(|&at| {
        !code[..at].ends_with(|c| is_word(c) || c == ':' || c == '$')
            && !code[at + word.len()..].starts_with(is_word)
    })
}

/// All paths of a tree of imports or of one path: `a::{b, c::d}` gives `a b` and `a c d`.
fn paths(tree: &str) -> Vec<Vec<String>> {
    let tree = tree.trim_start();
    if let Some(group) = tree.strip_prefix('{') {
        return members(group).iter().flat_map(|member| paths(member)).collect();
    }
    let first = identifier(tree);
    let tail = tree[first.len()..].trim_start();
    if first.is_empty() {
        return vec![Vec::new()];
    }
    let rest = tail.strip_prefix("::").map_or_else(|| vec![Vec::new()], paths);
    rest.into_iter().map(|rest| [vec![first.to_owned()], rest].concat()).collect()
}

/// What stands between the commas of a group whose brace is open.
fn members(group: &str) -> Vec<&str> {
    let (mut depth, mut begin, mut found) = (0, 0, Vec::new());
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => {
                found.push(&group[begin..at]);
                break;
            }
            '}' => depth -= 1,
            ',' if depth == 0 => {
                found.push(&group[begin..at]);
                begin = at + 1;
            }
            _ => {}
        }
    }
    found.into_iter().filter(|member| !member.trim().is_empty()).collect()
}

/// The code without `pub use`, and the paths of those.
fn reexports(code: &str) -> (String, Vec<Vec<String>>) {
    let (mut rest, mut own, mut found) = (code, String::new(), Vec::new());
    while let Some(at) = rest.find("pub") {
        let visible = &rest[at + 3..];
        let scope = if visible.starts_with('(') { visible.find(')').map_or(0, |end| end + 1) } else { 0 };
        let tree = visible[scope..].strip_prefix(" use ");
        let end = tree.map_or(0, |tree| scope + 5 + tree.find(';').unwrap());
        found.extend(tree.into_iter().flat_map(paths));
        own.push_str(&rest[..at]);
        if tree.is_none() {
            own.push_str("pub");
        }
        rest = &visible[end..];
    }
    (own + rest, found)
}

/// Which file holds what a path names.
struct Files<'a> {
    by_module: BTreeMap<&'a [String], &'a Source>,
    reexports: BTreeMap<&'a [String], Vec<Vec<String>>>,
}

impl<'a> Files<'a> {
    fn new(sources: &'a [Source]) -> Self {
        let by_module = sources.iter().map(|s| (s.module.as_slice(), s)).collect();
        let reexports = sources.iter().map(|s| (s.module.as_slice(), reexports(&s.code).1)).collect();
        Self { by_module, reexports }
    }

    /// The file that defines what `path` names in `module`: modules are followed down, re-exports
    /// to their source.
    fn resolve(&self, module: &[String], path: &[String], depth: usize) -> Option<&'a Source> {
        assert!(depth < 20, "re-exports of {path:?} go round in a circle");
        let mut at = module.to_vec();
        let path = path.iter();
        for part in path {
            match part.as_str() {
                "crate" => at.truncate(usize::from(at.first().is_some_and(|first| first == "bin"))),
                "super" => drop(at.pop()),
                "self" => {}
                name => {
                    at.push(name.to_owned());
                    if self.by_module.contains_key(at.as_slice()) {
                        continue;
                    }
                    at.pop();
                    let passed_on = self.reexports.get(at.as_slice())?.iter();
                    let source = passed_on.clone().find(|passed| passed.last().is_some_and(|l| l == name));
                    let Some(source) = source else { break };
                    if source.len() == 1 {
                        return None;
                    }
                    return self.resolve(&at, source, depth + 1);
                }
            }
        }
        self.by_module.get(at.as_slice()).copied()
    }

    /// The files that a file imports or names, but for those that it only passes on.
    fn named_by(&self, source: &Source) -> BTreeSet<&'a str> {
        let (code, _) = reexports(&source.code);
        let children =
            self.by_module.keys().filter_map(|module| module.strip_prefix(source.module.as_slice()));
        let children = children.filter(|below| below.len() == 1).map(|below| below[0].as_str());
        let starts = ["crate", "super", "self"].into_iter().chain(children);
        let mut files = BTreeSet::new();
        for start in starts {
            for at in places(&code, start).filter(|&at| code[at + start.len()..].starts_with("::")) {
                for path in paths(&code[at..]) {
                    files.extend(self.resolve(&source.module, &path, 0).map(|file| file.path.as_str()));
                }
            }
        }
        files.remove(source.path.as_str());
        files
    }
}

#[test]
fn groups_and_single_paths_are_both_seen() {
    let text = "crate::{\n    id::{A, B},\n    mesh::TriMesh,\n    Error};\nlet x = 1";
    let found: Vec<String> = paths(text).iter().map(|path| path.join(" ")).collect();
    assert_eq!(found, ["crate id A", "crate id B", "crate mesh TriMesh", "crate Error"]);
}

#[test]
fn comments_strings_and_characters_are_not_code() {
    let text = "a('\"'); // \"b\"\nc::<'x>(\"d\\\"e\", r#\"f\"g\"#)";
    let (code, strings) = without_comments_and_strings(text);
    assert_eq!(code, "a(' '); \nc::<'x>(\"\", \"\")");
    assert_eq!(strings, ["d\\\"e", "f\"g"]);
}

#[test]
fn modules_name_only_those_before_them() {
    let rank = |module: &str| {
        MODULES.iter().position(|m| *m == module).unwrap_or_else(|| panic!("{module:?} is not in MODULES"))
    };
    let sources = sources();
    let files = Files::new(&sources);
    let of = |path: &str| sources.iter().find(|s| s.path == path).unwrap().top();
    for source in sources.iter().filter(|s| !s.is_command() && !s.module.is_empty()) {
        for other in files.named_by(source).into_iter().map(of).filter(|other| *other != "lib") {
            assert!(rank(other) <= rank(source.top()), "{} must not name {other}", source.path);
        }
    }
}

#[test]
fn outside_crates_are_used_behind_their_doors() {
    let manifest = fs::read_to_string("Cargo.toml").unwrap();
    let mut section = "";
    for line in manifest.lines() {
        if line.starts_with('[') {
            section = line;
        } else if section.ends_with("dependencies]") && !section.contains("dev-") {
            let name = line.split('=').next().unwrap_or_default().trim().replace('-', "_");
            let listed = name.is_empty() || name.starts_with('#') || DOORS.iter().any(|(c, _)| *c == name);
            assert!(listed, "{name} is not in DOORS");
        }
    }
    let mut broken = Vec::new();
    for source in sources() {
        for (outside, doors) in DOORS.iter().filter(|(_, doors)| !doors.contains(&"")) {
            let inside = doors.iter().any(|door| source.path.starts_with(door));
            if !inside && uses_crate(&source.code, outside) {
                broken.push(format!("{outside} is used behind {doors:?} alone, not in {}", source.path));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

/// Whether code uses an outside crate, and not a module of ours with its name.
fn uses_crate(code: &str, name: &str) -> bool {
    let (rest, imports) = imports(code);
    let named = |path: &Vec<String>| path.first().is_some_and(|first| first == name);
    let ours = places(&rest, "mod").any(|at| rest[at + 3..].starts_with(&format!(" {name};")))
        || imports.iter().any(|path| path.len() > 1 && path.last().is_some_and(|last| last == name));
    let inline = || places(&rest, name).any(|at| rest[at + name.len()..].starts_with("::"));
    !ours && (imports.iter().any(named) || inline())
}

/// The code without imports, and the paths of those.
fn imports(code: &str) -> (String, Vec<Vec<String>>) {
    let (mut rest, mut own, mut found) = (code, String::new(), Vec::new());
    while let Some(at) = places(rest, "use").find(|&at| rest[at..].starts_with("use ")) {
        let end = at + rest[at..].find(';').unwrap();
        found.extend(paths(&rest[at + 4..end]));
        own.push_str(&rest[..at]);
        rest = &rest[end..];
    }
    (own + rest, found)
}

/// The crates that the project is built on, and the crate of ours that is the door of some.
const FOUNDATIONS: &[(&str, Option<&str>)] = &[
    ("spade", Some("delaunay")),
    ("obvhs", Some("bvh")),
    ("glam", None),
    ("gltf", None),
    ("exr", None),
    ("faer", Some("sparse")),
    ("rayon", None),
];

/// Whether a manifest lists a crate for more than tests.
fn depends_on(manifest: &str, name: &str) -> bool {
    let manifest = fs::read_to_string(manifest).unwrap();
    let sections = manifest.split("\n[").filter(|section| section.starts_with("dependencies]"));
    sections.flat_map(str::lines).any(|line| line.split('=').next().is_some_and(|key| key.trim() == name))
}

/// Whether code uses a crate of ours, which the library names as a module.
fn uses_member(code: &str, member: &str) -> bool {
    let named = |path: &Vec<String>| path.len() > 1 && path[0] == "crate" && path[1] == member;
    imports(code).1.iter().any(named) || code.contains(&format!("crate::{member}::"))
}

/// Every crate that the project is built on is used where users pass: `build`, `lookup` and `render` reach
/// a file that does.
#[test]
fn foundations_are_reached_by_build_lookup_or_render() {
    let sources = sources();
    let files = Files::new(&sources);
    let is_start = |s: &&Source| {
        s.is_command()
            && s.module.get(1).is_some_and(|name| ["build", "lookup", "render"].contains(&name.as_str()))
    };
    let mut open: Vec<&Source> = sources.iter().filter(is_start).collect();
    let mut reached: BTreeMap<&str, &Source> = BTreeMap::new();
    while let Some(source) = open.pop() {
        if reached.insert(&source.path, source).is_some() {
            continue;
        }
        let named = files.named_by(source);
        open.extend(sources.iter().filter(|other| named.contains(other.path.as_str())));
        for at in places(&source.code, "dermatome").filter(|_| source.is_command()) {
            let library = paths(&source.code[at..]).into_iter().filter(|path| path.len() > 1);
            open.extend(library.filter_map(|path| files.resolve(&[], &path[1..], 0)));
        }
    }
    for (outside, door) in FOUNDATIONS {
        let (is_used, manifest) = match door {
            None => (reached.values().any(|s| uses_crate(&s.code, outside)), "Cargo.toml".to_owned()),
            Some(member) => {
                let folder = fs::read_dir(format!("crates/{member}/src")).unwrap();
                let mut texts = folder.map(|file| fs::read_to_string(file.unwrap().path()).unwrap());
                let opens = |text: String| {
                    uses_crate(&without_comments_and_strings(before_unit_tests(&text)).0, outside)
                };
                let is_reached = reached.values().any(|s| uses_member(&s.code, member));
                (is_reached && texts.any(opens), format!("crates/{member}/Cargo.toml"))
            }
        };
        assert!(is_used, "{outside} is not used by what `build`, `lookup` and `render` reach");
        assert!(depends_on(&manifest, outside), "{outside} is not in {manifest}");
    }
    assert!(
        uses_member("use crate::{bvh::BoxTree, id::Id};", "bvh") && !uses_member("use crate::id::Id;", "bvh")
    );
}

/// The files that `start` imports, those that they import, and so on.
fn reached_from<'a>(start: &'a str, graph: &BTreeMap<&'a str, BTreeSet<&'a str>>) -> BTreeSet<&'a str> {
    let (mut seen, mut open) = (BTreeSet::new(), vec![start]);
    while let Some(at) = open.pop() {
        open.extend(graph[at].iter().filter(|next| seen.insert(**next)));
    }
    seen
}

/// The circles of files, each sorted.
fn circles(graph: &BTreeMap<&str, BTreeSet<&str>>) -> BTreeSet<Vec<String>> {
    let reached: BTreeMap<&str, BTreeSet<&str>> =
        graph.keys().map(|file| (*file, reached_from(file, graph))).collect();
    let circle = |file: &&str| -> Vec<String> {
        let back = reached[*file].iter().filter(|other| reached[**other].contains(*file));
        back.map(|other| (*other).to_owned()).collect()
    };
    graph.keys().map(circle).filter(|circle| !circle.is_empty()).collect()
}

#[test]
fn files_do_not_import_each_other_in_a_circle() {
    let sources = sources();
    let files = Files::new(&sources);
    let graph = sources.iter().map(|s| (s.path.as_str(), files.named_by(s))).collect();
    let found: Vec<String> = circles(&graph).iter().map(|circle| edges(circle, &graph)).collect();
    assert!(found.is_empty(), "files import each other in a circle:\n{}", found.join("\n"));
}

/// A circle as its imports, one a line.
fn edges(circle: &[String], graph: &BTreeMap<&str, BTreeSet<&str>>) -> String {
    let inside = |file: &str| circle.iter().any(|other| other == file);
    let lines = circle.iter().map(|file| {
        let named: Vec<&str> = graph[file.as_str()].iter().copied().filter(|other| inside(other)).collect();
        format!("  {file} -> {}", named.join(", "))
    });
    lines.collect::<Vec<_>>().join("\n") + "\n"
}

#[test]
fn only_the_command_names_its_options() {
    let sources = sources();
    let commands: Vec<&str> = sources
        .iter()
        .filter(|s| s.is_command() && s.module.len() == 2)
        .map(|s| s.module[1].as_str())
        .collect();
    let is_option = |text: &str| {
        text.match_indices("--").any(|(at, dashes)| {
            let rest = &text[at + dashes.len()..];
            !text[..at].ends_with('-') && rest.starts_with(|c: char| c.is_ascii_lowercase())
        })
    };
    let is_command = |text: &str| {
        text.match_indices("dermatome ").any(|(at, name)| {
            let next = identifier(&text[at + name.len()..]);
            next == "help" || commands.contains(&next)
        })
    };
    let mut said = Vec::new();
    for source in sources.iter().filter(|s| !s.is_command()) {
        let named = source.strings.iter().find(|text| is_option(text) || is_command(text));
        if let Some(text) = named {
            said.push(format!("{}: {text:?}", source.path));
        }
    }
    assert!(said.is_empty(), "only the command names its options:\n{}", said.join("\n"));
}

#[test]
fn every_file_says_what_it_is_for() {
    let sources = sources();
    let silent = sources.iter().filter(|s| !s.text.starts_with("//!"));
    let silent: Vec<&str> = silent.map(|s| s.path.as_str()).collect();
    assert!(silent.is_empty(), "these files do not open with `//!`: {silent:?}");
}

/// Keys that look like `(desbrun2002)`, or `(cannata, ...` for the source paper, in comments.
fn keys_cited(text: &str) -> BTreeSet<String> {
    let comments = text.lines().filter_map(|line| line.trim_start().strip_prefix("//"));
    let is_key = |word: &str| {
        let name = word.trim_end_matches(|c: char| c.is_ascii_lowercase());
        let letters = name.trim_end_matches(|c: char| c.is_ascii_digit());
        word == "cannata"
            || (name.len() == letters.len() + 4
                && letters.len() > 1
                && letters.chars().all(|c| c.is_ascii_lowercase()))
    };
    comments
        .flat_map(|line| line.split('(').skip(1))
        .flat_map(|rest| rest.split(')').next().unwrap_or_default().split([',', ';', ' ']))
        .filter(|word| is_key(word))
        .map(str::to_owned)
        .collect()
}

/// Every work that the code cites by its key is in REFERENCES.md, and every work there is cited.
#[test]
fn references_are_those_that_the_code_cites() {
    let references = fs::read_to_string("REFERENCES.md").unwrap();
    let listed: BTreeSet<String> = references
        .lines()
        .filter_map(|line| line.strip_prefix("- **"))
        .filter_map(|line| line.split("**").next())
        .map(str::to_owned)
        .collect();
    let mut cited: BTreeSet<String> = sources().iter().flat_map(|source| keys_cited(&source.text)).collect();
    for folder in ["crates/bvh/src", "crates/delaunay/src", "crates/sparse/src"] {
        for entry in fs::read_dir(folder).unwrap() {
            cited.extend(keys_cited(&fs::read_to_string(entry.unwrap().path()).unwrap()));
        }
    }
    assert!(cited.len() > 20, "{cited:?}");
    assert_eq!(listed, cited, "left: in REFERENCES.md, right: in the code");
}
