//! Captions of panels, broken into lines that fit.
//!
//! Widths of letters are estimates: an SVG is drawn with the fonts of its viewer.

/// The text above a panel: its name, then its measures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Caption {
    /// Name of the patch, which may be as long as a file allows.
    pub(crate) name: String,
    /// Which of the patch's panels; it follows the name and is never cut.
    pub(crate) which: String,
    pub(crate) about: [String; 2],
}

impl Caption {
    /// Its lines, each at most `room` times as wide as the letters are high.
    ///
    /// The name is cut; the measures break at commas and, if that is not enough, between words.
    pub(crate) fn lines(&self, room: f64) -> Vec<String> {
        let name = shorten(&self.name, room - width(&self.which)) + &self.which;
        let about = self.about.iter().flat_map(|text| break_lines(text, room));
        std::iter::once(shorten(&name, room)).chain(about).collect()
    }
}

/// The last letter of a text that was cut.
const CUT: char = '\u{2026}';

fn break_lines(text: &str, room: f64) -> Vec<String> {
    if width(text) <= room {
        return vec![text.to_owned()];
    }
    let mut lines = Vec::new();
    for clause in text.split_inclusive(", ") {
        let mut line = String::new();
        for word in clause.split_whitespace() {
            let longer = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
            if width(&longer) <= room || line.is_empty() {
                line = longer;
            } else {
                lines.push(std::mem::replace(&mut line, word.to_owned()));
            }
        }
        lines.push(line);
    }
    lines.iter().map(|line| shorten(line, room)).collect()
}

/// As many letters of a text as fit.
fn shorten(text: &str, room: f64) -> String {
    if width(text) <= room {
        return text.to_owned();
    }
    let mut used = letter_width(CUT);
    let fitting = text.chars().take_while(|&c| {
        used += letter_width(c);
        used <= room
    });
    fitting.chain([CUT]).collect()
}

/// Width of a text over the height of its letters.
pub(super) fn width(text: &str) -> f64 {
    text.chars().map(letter_width).sum()
}

/// Width of a letter over the height of its text, or slightly more: the larger of Ubuntu Light,
/// which PNGs are drawn with, and `DejaVu` Sans, which a browser uses if it has no Ubuntu. Letters
/// of other scripts are as wide as high.
fn letter_width(c: char) -> f64 {
    match c {
        ' ' | '.' | ',' | ':' | ';' | '\'' | 'i' | 'j' | 'l' | 'I' => 0.32,
        'f' | 'r' | 't' | '(' | ')' | '[' | ']' | '/' | '\\' | '|' | '-' | '!' => 0.41,
        'm' | 'w' | 'M' | 'W' | '@' | '%' => 1.0,
        'A'..='Z' | '+' | '=' | '<' | '>' | '~' | '#' | '&' => 0.84,
        ' '..='~' => 0.64,
        _ => 1.0,
    }
}
