//! The shape of the source, read from its text: which module may name which, which may use an
//! outside crate, that no files import each other in a circle, that only the command speaks of its
//! options, and that every file says what it is for.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The folders of the library, what computes and the rest, and that of the command.
const ROOTS: [&str; 3] = ["crates/core/src", "crates/files/src", "crates/command/src"];

/// The modules of the library; each may name only those before it.
#[rustfmt::skip]
const MODULES: &[&str] = &[
    "id", "parallel", "run", "numeric", "mesh", "bvh", "delaunay", "sparse", "nearest", "least_squares", "skin", "robot", "remesh", "design", "calib", "diff",
    "cut", "pyramid", "body", "flatten", "map", "registration", "atlas", "unfold", "contact", "signal", "response", "touches", "image", "io", "plot", "pattern",
    "report", "error", "recording", "page", "pipeline",
];

/// The outside crates, and the folders and files, by the beginning of their path in one of the [`ROOTS`], that may use them.
const DOORS: &[(&str, &[&str])] = &[
    ("glam rayon strum thiserror", &[""]),
    ("libm", &["calib", "numeric", "touches"]),
    ("rand_pcg", &["numeric"]),
    ("dermatome_bvh dermatome_delaunay dermatome_sparse", &["lib.rs"]),
    ("dermatome_core", &["lib.rs", "error.rs"]),
    ("dermatome", &["command"]),
    ("gltf", &["io/gltf"]),
    ("exr", &["io/image"]),
    ("base64", &["io/gltf", "page", "plot/picture/svg.rs"]),
    ("flate2", &["io/arrays", "io/image", "page"]),
    ("half", &["io/arrays"]),
    ("itoa", &["io/table"]),
    ("ply_rs_bw", &["io/mesh/ply.rs"]),
    ("roxmltree", &["io/file/xml.rs", "io/mesh/dae.rs", "io/mesh/threemf.rs", "io/robot"]),
    ("serde", &["flatten/distortion.rs", "map/on_atlas.rs", "io", "page", "report.rs", "command"]),
    ("serde_json", &["io", "page", "command"]),
    ("tempfile", &["io/file", "command"]),
    ("zip", &["io/arrays", "io/mesh/threemf.rs"]),
    ("zmij", &["io/table"]),
    ("epaint_default_fonts ttf_parser", &["plot/picture/font.rs"]),
    ("png tiny_skia", &["plot/picture"]),
    ("anyhow clap clap_complete clap_mangen glob indicatif signal_hook", &["command"]),
];

/// Each outside crate with its doors.
fn doors() -> impl Iterator<Item = (&'static str, &'static [&'static str])> {
    DOORS.iter().flat_map(|(crates, doors)| crates.split(' ').map(move |name| (name, *doors)))
}

/// What a path names, part by part: `crate::mesh::TriMesh` as `["crate", "mesh", "TriMesh"]`.
type Named = Vec<String>;

/// A source file.
struct Source {
    /// Its path in `src`, as `contact/map_index/plane_grid.rs`; those of the command begin with `command`.
    path: String,
    /// Its module, as `["contact", "map_index", "plane_grid"]`; those of the command begin with `command`.
    module: Named,
    text: String,
    /// The text without comments, strings, unit tests, imports and re-exports.
    code: String,
    strings: Vec<String>,
    imports: Vec<Named>,
    reexports: Vec<Named>,
}

impl Source {
    fn read(root: &str, file: &Path) -> Self {
        let first = if root == ROOTS[2] { "command" } else { "" };
        let path = Path::new(first).join(file.strip_prefix(root).unwrap());
        let mut module: Named =
            path.with_extension("").iter().map(|part| part.to_str().unwrap().to_owned()).collect();
        if ["mod", "lib", "main"].contains(&module.last().unwrap().as_str()) {
            module.pop();
        }
        Self {
            path: path.to_str().unwrap().replace('\\', "/"),
            module,
            ..Self::of(fs::read_to_string(file).unwrap())
        }
    }

    fn of(text: String) -> Self {
        // Unit tests end a file, and may use whatever they need.
        let (all, strings) =
            without_comments_and_strings(text.split("\n#[cfg(test)]\nmod tests {").next().unwrap());
        let (mut code, mut imports, mut reexports) = (String::new(), Vec::new(), Vec::new());
        for statement in all.split_inclusive(';') {
            let visibility = |at: usize| statement[..at].rsplit('\n').next().unwrap().trim();
            let uses = statement.match_indices("use ").map(|(at, _)| at);
            let found = uses.filter(|&at| visibility(at).is_empty() || visibility(at).starts_with("pub"));
            let at = found.last();
            if let Some(at) = at {
                let list = if visibility(at).is_empty() { &mut imports } else { &mut reexports };
                paths(&statement[at + 4..], &[], list);
            }
            code.push_str(&statement[..at.unwrap_or(statement.len())]);
        }
        Self { path: String::new(), module: Vec::new(), text, code, strings, imports, reexports }
    }

    /// The first part of its module.
    fn top(&self) -> &str {
        self.module.first().map_or("lib", String::as_str)
    }

    fn is_command(&self) -> bool {
        self.top() == "command"
    }

    /// The paths in its code that begin with a word, and its imports.
    fn paths_from(&self, word: &str) -> Vec<Named> {
        let mut found: Vec<Named> = self.imports.iter().filter(|path| path[0] == word).cloned().collect();
        for (at, _) in self.code.match_indices(&format!("{word}::")) {
            // Not a part of a name, of a longer path or of `$crate`.
            if !self.code[..at].ends_with(|c| is_word(c) || c == ':' || c == '$') {
                paths(&self.code[at..], &[], &mut found);
            }
        }
        found
    }

    /// Whether it uses an outside crate, and not a module of ours with its name.
    fn uses(&self, outside: &str) -> bool {
        let ours = self.code.contains(&format!("mod {outside};"))
            || self.imports.iter().any(|path| path.len() > 1 && path.last().unwrap() == outside);
        !ours && !self.paths_from(outside).is_empty()
    }
}

/// The files below a folder.
fn read_sources(root: &str) -> Vec<Source> {
    let (mut files, mut folders) = (Vec::new(), vec![PathBuf::from(root)]);
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    files.iter().map(|path| Source::read(root, path)).collect()
}

/// The files of the library and the command. The root of the core, which only passes on its modules, is not among them.
fn sources_of_library() -> Vec<Source> {
    let [core, files, command] = ROOTS.map(read_sources);
    core.into_iter().filter(|source| source.path != "lib.rs").chain(files).chain(command).collect()
}

/// The text without comments and with empty strings, and the strings.
fn without_comments_and_strings(text: &str) -> (String, Vec<String>) {
    let (mut code, mut strings, mut rest) = (String::new(), Vec::new(), text);
    while let Some(c) = rest.chars().next() {
        let hashes = rest.chars().skip(1).take_while(|&c| c == '#').count();
        let is_raw = c == 'r' && !code.ends_with(is_word) && rest[1 + hashes..].starts_with('"');
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if c == '"' || is_raw {
            let open = if is_raw { hashes + 2 } else { 1 };
            let close = if is_raw { format!("\"{}", "#".repeat(hashes)) } else { "\"".to_owned() };
            let is_end = |at: usize| {
                let slashes = rest[..at].len() - rest[..at].trim_end_matches('\\').len();
                is_raw || slashes % 2 == 0
            };
            let ends = rest[open..].match_indices(&close).map(|(at, _)| open + at);
            let end = ends.into_iter().find(|&at| is_end(at)).unwrap();
            strings.push(rest[open..end].to_owned());
            code.push_str("\"\"");
            end + close.len()
        } else if rest.starts_with("'\"'") || rest.starts_with("'\\\"'") {
            rest[1..].find('\'').unwrap() + 2
        } else {
            code.push(c);
            c.len_utf8()
        };
        rest = &rest[length..];
    }
    (code, strings)
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Adds all paths of the tree of imports, or of the path, that `text` begins with: `a::{b, c::d}` gives
/// `a b` and `a c d`. Returns what comes after it.
fn paths<'a>(text: &'a str, prefix: &[String], found: &mut Vec<Named>) -> &'a str {
    let mut text = text.trim_start();
    if let Some(group) = text.strip_prefix('{') {
        text = group.trim_start();
        while !text.starts_with('}') {
            let rest = paths(text, prefix, found);
            text = rest[rest.find([',', '}']).unwrap()..].trim_start_matches(',').trim_start();
        }
        return &text[1..];
    }
    let first = text.split(|c| !is_word(c)).next().unwrap();
    let path = if first.is_empty() { prefix.to_vec() } else { [prefix, &[first.to_owned()]].concat() };
    let rest = &text[first.len()..];
    match rest.strip_prefix("::") {
        Some(below) if !first.is_empty() => return paths(below, &path, found),
        _ => found.push(path),
    }
    rest
}

/// Which file holds what a path names.
struct Files<'a>(BTreeMap<&'a [String], &'a Source>);

impl<'a> Files<'a> {
    fn new(sources: &'a [Source]) -> Self {
        Self(sources.iter().map(|s| (s.module.as_slice(), s)).collect())
    }

    /// The file that defines what `path` names in `module`: modules are followed down, re-exports
    /// to their source.
    fn resolve(&self, module: &[String], path: &[String], depth: usize) -> Option<&'a Source> {
        assert!(depth < 20, "re-exports of {path:?} go round in a circle");
        let mut at = module.to_vec();
        for part in path {
            match part.as_str() {
                "crate" => at.truncate(usize::from(at.first().is_some_and(|first| first == "command"))),
                "dermatome" => at.clear(),
                "super" => drop(at.pop()),
                "self" => {}
                name => {
                    at.push(name.to_owned());
                    if self.0.contains_key(at.as_slice()) {
                        continue;
                    }
                    at.pop();
                    let mut passed_on = self.0.get(at.as_slice())?.reexports.iter();
                    let Some(source) = passed_on.find(|path| path.last().unwrap() == name) else { break };
                    return if source.len() == 1 { None } else { self.resolve(&at, source, depth + 1) };
                }
            }
        }
        self.0.get(at.as_slice()).copied()
    }

    /// The files that each file imports or names, but for those that it only passes on.
    fn graph(&self) -> BTreeMap<&'a str, BTreeSet<&'a str>> {
        let named = |source: &&'a Source| {
            let children = self.0.keys().filter_map(|module| module.strip_prefix(source.module.as_slice()));
            let children = children.filter(|below| below.len() == 1).map(|below| below[0].as_str());
            let library = source.is_command().then_some("dermatome");
            let starts = ["crate", "super", "self"].into_iter().chain(library).chain(children);
            let paths = starts.flat_map(|start| source.paths_from(start));
            let files = paths.filter_map(|path| self.resolve(&source.module, &path, 0));
            let others = files.map(|file| file.path.as_str()).filter(|path| *path != source.path);
            (source.path.as_str(), others.collect())
        };
        self.0.values().map(named).collect()
    }
}

/// The files that `starts` import, those that they import, and so on.
fn reached<'a>(
    starts: impl Iterator<Item = &'a str>,
    graph: &BTreeMap<&'a str, BTreeSet<&'a str>>,
) -> BTreeSet<&'a str> {
    let (mut seen, mut open) = (BTreeSet::new(), starts.collect::<Vec<_>>());
    while let Some(at) = open.pop() {
        open.extend(graph[at].iter().filter(|next| seen.insert(**next)));
    }
    seen
}

#[test]
fn imports_paths_and_strings_are_told_apart() {
    let text = "pub(crate) use a::B;\nuse crate::{\n    id::{A as C, B},\n    Error,\n};\n\
                a('\"'); // \"b\"\nc::<'x>(\"d\\\"e\\\\\", r#\"f\"g\"#, crate::d::E::<f>())";
    let source = Source::of(text.to_owned());
    let joined = |paths: &[Named]| paths.iter().map(|path| path.join(" ")).collect::<Vec<_>>();
    assert_eq!(joined(&source.reexports), ["a B"]);
    assert_eq!(joined(&source.imports), ["crate id A", "crate id B", "crate Error"]);
    assert_eq!(joined(&source.paths_from("crate"))[3..], ["crate d E"]);
    assert!(source.code.ends_with("a(); \nc::<'x>(\"\", \"\", crate::d::E::<f>())"), "{}", source.code);
    assert_eq!(source.strings, ["d\\\"e\\\\", "f\"g"]);
}

#[test]
fn modules_name_only_those_before_them() {
    let rank = |module: &str| {
        MODULES.iter().position(|m| *m == module).unwrap_or_else(|| panic!("{module:?} is not in MODULES"))
    };
    let sources = sources_of_library();
    let graph = Files::new(&sources).graph();
    let top = |path: &str| sources.iter().find(|s| s.path == path).unwrap().top();
    for source in sources.iter().filter(|s| !s.is_command() && !s.module.is_empty()) {
        for other in graph[source.path.as_str()].iter().map(|path| top(path)).filter(|other| *other != "lib")
        {
            assert!(rank(other) <= rank(source.top()), "{} must not name {other}", source.path);
        }
    }
}

#[test]
fn outside_crates_are_used_behind_their_doors() {
    let manifests =
        ROOTS.map(|root| fs::read_to_string(Path::new(root).with_file_name("Cargo.toml")).unwrap());
    let sections = manifests.iter().flat_map(|manifest| manifest.split("\n["));
    let sections =
        sections.filter(|section| section.contains("dependencies]\n") && !section.starts_with("dev-"));
    for line in sections.flat_map(|section| section.lines().skip(1)) {
        let name = line.split('=').next().unwrap_or_default().trim().replace('-', "_");
        let listed = name.is_empty() || name.starts_with('#') || doors().any(|(c, _)| c == name);
        assert!(listed, "{name} is not in DOORS");
    }
    let mut broken = Vec::new();
    for source in sources_of_library() {
        for (outside, doors) in doors() {
            if !doors.iter().any(|door| source.path.starts_with(door)) && source.uses(outside) {
                broken.push(format!("{outside} is used behind {doors:?} alone, not in {}", source.path));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
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

/// Every crate that the project is built on is used where users pass: `build`, `lookup` and `render` reach
/// a file that does.
#[test]
fn foundations_are_reached_by_build_lookup_or_render() {
    let sources = sources_of_library();
    let is_start = |s: &&Source| {
        s.is_command() && s.module.get(1).is_some_and(|m| ["build", "lookup", "render"].contains(&m.as_str()))
    };
    let starts = sources.iter().filter(is_start).map(|s| s.path.as_str());
    let reached = reached(starts, &Files::new(&sources).graph());
    let is_reached = |is_used: &dyn Fn(&Source) -> bool| {
        sources.iter().any(|s| reached.contains(s.path.as_str()) && is_used(s))
    };
    for (outside, door) in FOUNDATIONS {
        let folder = format!("crates/{}", door.unwrap_or("files"));
        let is_used = match door {
            None => is_reached(&|s| s.uses(outside)),
            Some(member) => {
                let names = |path: &Named| path.len() > 1 && path[1] == *member;
                is_reached(&|s| s.paths_from("crate").iter().any(names))
                    && read_sources(&format!("{folder}/src")).iter().any(|s| s.uses(outside))
            }
        };
        assert!(is_used, "{outside} is not used by what `build`, `lookup` and `render` reach");
        let manifest = fs::read_to_string(format!("{folder}/Cargo.toml")).unwrap();
        let dependencies =
            manifest.split("\n[").find(|section| section.starts_with("dependencies]")).unwrap();
        assert!(dependencies.contains(&format!("\n{outside}")), "{outside} is not used by {folder}");
    }
}

#[test]
fn files_do_not_import_each_other_in_a_circle() {
    let sources = sources_of_library();
    let graph = Files::new(&sources).graph();
    let is_in_circle = |path: &&&str| reached([**path].into_iter(), &graph).contains(**path);
    let found: BTreeMap<_, _> = graph.keys().filter(is_in_circle).map(|path| (path, &graph[path])).collect();
    assert!(found.is_empty(), "files import each other in a circle: {found:#?}");
}

#[test]
fn only_the_command_names_its_options() {
    let sources = sources_of_library();
    let commands = sources.iter().filter(|s| s.is_command() && s.module.len() == 2).map(|s| &s.module[1]);
    let names: Vec<String> = commands.flat_map(|c| [format!("dermatome {c}"), format!("`{c}`")]).collect();
    let is_option = |text: &str| {
        let mut options = text.split("--").skip(1);
        options.any(|rest| rest.starts_with(|c: char| c.is_ascii_lowercase()))
    };
    let mut said = Vec::new();
    for source in sources.iter().filter(|s| !s.is_command()) {
        let is_named = |text: &String| is_option(text) || names.iter().any(|name| text.contains(name));
        said.extend(
            source.strings.iter().find(|s| is_named(s)).map(|text| format!("{}: {text:?}", source.path)),
        );
    }
    assert!(said.is_empty(), "only the command names its options:\n{}", said.join("\n"));
}

#[test]
fn every_file_says_what_it_is_for() {
    let sources = sources_of_library();
    let silent = sources.iter().filter(|s| !s.text.starts_with("//!"));
    let silent: Vec<&str> = silent.map(|s| s.path.as_str()).collect();
    assert!(silent.is_empty(), "these files do not open with `//!`: {silent:?}");
}

/// Keys in comments that look like `(desbrun2002)`, or `(cannata, ...` for the source paper.
fn keys_cited(text: &str) -> BTreeSet<String> {
    let is_key = |word: &&str| {
        let name = word.trim_end_matches(|c: char| c.is_ascii_lowercase());
        let letters = name.trim_end_matches(|c: char| c.is_ascii_digit());
        let is_dated = name.len() == letters.len() + 4 && letters.len() > 1;
        *word == "cannata" || (is_dated && letters.chars().all(|c| c.is_ascii_lowercase()))
    };
    let comments = text.lines().filter_map(|line| line.trim_start().strip_prefix("//"));
    let bracketed = comments.flat_map(|line| line.split('(').skip(1));
    let words = bracketed.flat_map(|rest| rest.split(')').next().unwrap().split([',', ';', ' ']));
    words.filter(is_key).map(str::to_owned).collect()
}

/// Every work that the code cites by its key is in REFERENCES.md, and every work there is cited.
#[test]
fn references_are_those_that_the_code_cites() {
    let references = fs::read_to_string("REFERENCES.md").unwrap();
    let entries = references.lines().filter_map(|line| line.strip_prefix("- **"));
    let listed: BTreeSet<String> =
        entries.filter_map(|line| line.split("**").next()).map(str::to_owned).collect();
    let roots = ["crates/bvh/src", "crates/delaunay/src", "crates/sparse/src"];
    let cited: BTreeSet<String> = ROOTS
        .into_iter()
        .chain(roots)
        .flat_map(read_sources)
        .flat_map(|source| keys_cited(&source.text))
        .collect();
    assert!(cited.len() > 20, "{cited:?}");
    assert_eq!(listed, cited, "left: in REFERENCES.md, right: in the code");
}
