//! Results as a person or a program reads them.

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Stdout, Write};

use dermatome::Error;
use dermatome::body::Gap;
use dermatome::io::{IoError, Outputs};
use dermatome::report::{LevelReport, PatchReport};
use serde::Serialize;

/// Longest note or line of an error.
const LONGEST_LINE: usize = 1000;

/// A line of a note or an error as a terminal may see it: it may quote names from a file.
pub(crate) fn line(text: &str) -> String {
    harmless(text, LONGEST_LINE)
}

/// Prints a text on standard output. A full output is an error; a closed one (`| head`) is not: its
/// reader has what it needs, and the run goes on to its own exit code.
pub(crate) fn print(text: &str) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => {
            Err(Error::from(IoError::Write { path: STANDARD_OUTPUT.into(), source }).into())
        }
        _ => Ok(()),
    }
}

/// Prints a line on standard error. One that cannot be written (a full disk, a closed pipe) stops
/// no run.
pub(crate) fn say(text: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// An object of JSON that says what it is: its keys mean the same as long as the number in `schema`
/// is the same, and further keys may join them. `docs/json.md` lists the keys of each.
#[derive(Serialize)]
struct Described<'a, T> {
    schema: &'a str,
    #[serde(flatten)]
    object: &'a T,
}

/// Pretty JSON of an object, with its schema, and a newline; characters that a terminal may obey are
/// escaped.
pub(crate) fn json(schema: &str, object: &impl Serialize) -> serde_json::Result<String> {
    Ok(escape(&serde_json::to_string_pretty(&Described { schema, object })?))
}

/// The same on one line.
pub(crate) fn json_line(schema: &str, object: &impl Serialize) -> serde_json::Result<String> {
    Ok(escape(&serde_json::to_string(&Described { schema, object })?))
}

fn escape(text: &str) -> String {
    let escaped = |c: char| match c {
        '\n' => c.to_string(),
        c if is_harmless(c) => c.to_string(),
        c => format!("\\u{:04x}", u32::from(c)),
    };
    text.chars().map(escaped).collect::<String>() + "\n"
}

pub(crate) fn print_json(schema: &str, object: &impl Serialize) -> anyhow::Result<()> {
    print(&json(schema, object)?)
}

/// Longest name a table shows; what follows is cut off.
const LONGEST_NAME: usize = 60;

pub(crate) fn plain(name: &str) -> String {
    harmless(name, LONGEST_NAME)
}

/// A sentence with names in it: each word as [`plain`], none cut off for the length of others.
pub(crate) fn plain_sentence(sentence: &str) -> String {
    sentence.split(' ').map(plain).collect::<Vec<_>>().join(" ")
}

/// Whether a terminal only shows a character: it is no control, begins no line and does not turn the
/// direction of writing.
pub(crate) fn is_harmless(c: char) -> bool {
    let turns = ['\u{200e}'..='\u{200f}', '\u{2028}'..='\u{202e}', '\u{2066}'..='\u{2069}'];
    !c.is_control() && !turns.iter().any(|range| range.contains(&c))
}

/// What errors call standard output.
pub(crate) const STANDARD_OUTPUT: &str = "standard output";

/// Standard output for a table or frames. A terminal does not obey what names of files may hold. A pipe that
/// its reader closed (`| head`) is an error only while the run writes no other file.
pub(crate) struct StandardOutput<'a> {
    out: Stdout,
    is_terminal: bool,
    others: &'a Outputs,
}

impl<'a> StandardOutput<'a> {
    pub(crate) fn new(others: &'a Outputs) -> Self {
        let out = io::stdout();
        Self { is_terminal: out.is_terminal(), out, others }
    }

    fn unless_closed(&self, result: io::Result<()>) -> io::Result<()> {
        result.or_else(|e| match e.kind() {
            ErrorKind::BrokenPipe if self.others.has_files() => Ok(()),
            _ => Err(e),
        })
    }
}

impl Write for StandardOutput<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = if self.is_terminal {
            let shown = |c: char| if c == '\n' || is_harmless(c) { c } else { '?' };
            let text: String = String::from_utf8_lossy(bytes).chars().map(shown).collect();
            self.out.write_all(text.as_bytes())
        } else {
            self.out.write_all(bytes)
        };
        self.unless_closed(written).map(|()| bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.out.flush();
        self.unless_closed(flushed)
    }
}

/// A text as a terminal may see it: control and direction characters escaped, all beyond `longest`
/// characters cut.
fn harmless(text: &str, longest: usize) -> String {
    let escaped: String = text
        .chars()
        .flat_map(|c| if is_harmless(c) { vec![c] } else { c.escape_default().collect() })
        .collect();
    if escaped.chars().count() <= longest {
        return escaped;
    }
    escaped.chars().take(longest - 3).chain("...".chars()).collect()
}

/// Prints rows of named cells under their names: the first `words` columns to the left, numbers to
/// the right.
pub(crate) fn print_table<const N: usize>(words: usize, rows: &[[(&str, String); N]]) -> anyhow::Result<()> {
    let titles = rows.iter().take(1).map(|row| row.each_ref().map(|(title, _)| *title));
    let cells = rows.iter().map(|row| row.each_ref().map(|(_, cell)| cell.as_str()));
    let lines: Vec<[&str; N]> = titles.chain(cells).collect();
    let widths: [usize; N] = std::array::from_fn(|column| {
        lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0)
    });
    let mut text = String::new();
    for line in lines {
        let cells = line.iter().zip(widths).enumerate().map(|(column, (cell, width))| {
            if column < words { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        text.push_str(cells.collect::<Vec<_>>().join("  ").trim_end());
        text.push('\n');
    }
    print(&text)
}

/// A line for each gap: between which patches, how many links, and how wide.
pub(crate) fn print_gaps(gaps: &[([String; 2], Gap)]) -> anyhow::Result<()> {
    let line = |([a, b], gap): &([String; 2], Gap)| {
        let [least, most] = gap.width.map(|width| 1e3 * width);
        let links = if gap.links == 1 { "link" } else { "links" };
        format!("gap {} - {}: {} {links}, {least:.1} to {most:.1} mm\n", plain(a), plain(b), gap.links)
    };
    print(&gaps.iter().map(line).collect::<String>())
}

pub(crate) fn print_levels(patches: &[PatchReport]) -> anyhow::Result<()> {
    let levels = patches.iter().flat_map(|patch| patch.levels.iter().map(move |level| (patch, level)));
    let row = |(patch, l): (&PatchReport, &LevelReport)| {
        [
            ("level", format!("{}/L{}", plain(&patch.name), l.level)),
            ("vertices", l.vertices.to_string()),
            ("faces", l.faces.to_string()),
            ("loops", l.boundary_loops.to_string()),
            ("flips", l.distortion.flips.to_string()),
            ("crossings", l.distortion.crossings.to_string()),
            ("s1/s2", format!("{:.4}", l.distortion.qc_mean)),
            ("max", format!("{:.3}", l.distortion.qc_max)),
            ("area", format!("{:.4}", l.distortion.area_mean)),
            ("max", format!("{:.3}", l.distortion.area_max)),
            ("symm. Dirichlet", format!("{:.5}", l.distortion.symmetric_dirichlet)),
        ]
    };
    print_table(1, &levels.map(row).collect::<Vec<_>>())
}
