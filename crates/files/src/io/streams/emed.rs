//! novel emed `.lst`: pages between form feeds, each with a picture whose rows and columns are numbered and cropped to what is
//! loaded. The unit is not in the file: kPa follows from the force that each page states.

use std::collections::BTreeSet;
use std::path::Path;

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::layout::{Statement, StatementSource, StreamFacts, TimeUnit};
use crate::io::streams::frames::{FileTime, Frames, OpenStream, Sheet, Wanted};
use crate::io::streams::lines::{TextLines, number, words};
use crate::io::streams::numbers::{is_interval, is_sum};

/// A force may differ from the sum of cells by this share of it, and by this many N.
const FORCE_TOLERANCE: [f64; 2] = [5e-4, 0.02];

/// What stands between pages.
const FORM_FEED: u8 = 0x0c;

/// The most rows and columns of a platform.
const MOST_SIDES: u32 = 1 << 12;

/// What all pages state.
#[derive(Debug, Clone, Copy, Default)]
struct EmedAbout {
    /// Height and width of a sensor, in m.
    pitch: Option<[f64; 2]>,
    /// Time of a picture, in s.
    step: Option<f64>,
}

struct Emed {
    lines: TextLines,
    about: EmedAbout,
    /// The numbers of the rows and columns that any page has.
    sides: [Vec<u32>; 2],
    pitch: [f64; 2],
    step: f64,
    picture: Option<u64>,
    /// The picture whose page begins next.
    next: Option<u64>,
    forces: u64,
    frames: u64,
}

/// A page: cells with their row and column, and the force.
#[derive(Debug, Default)]
struct Page {
    picture: u64,
    cells: Vec<(u32, u32, f64)>,
    force: Option<f64>,
}

pub(super) fn open(path: &Path, wanted: Wanted<'_>) -> Result<OpenStream, IoError> {
    let mut lines = TextLines::open(path)?;
    let (mut about, mut next) = (EmedAbout::default(), None);
    let mut sides = [BTreeSet::new(), BTreeSet::new()];
    let mut pictures = BTreeSet::new();
    while let Some(page) = next_page(&mut lines, &mut about, &mut next)? {
        pictures.insert(page.picture);
        for (row, col, _) in page.cells {
            sides[0].insert(row);
            sides[1].insert(col);
        }
    }
    let wrong = |found: &str, needed: &str| Err(lines.at().invalid(found, needed));
    let (Some(pitch), Some(step)) = (about.pitch, about.step) else {
        return wrong(
            "no size of a sensor or no time of a picture",
            "`Sensor size: 0.500x0.500 cm` and `Time/picture:10.0 ms`",
        );
    };
    let sides = sides.map(|side| side.into_iter().collect::<Vec<u32>>());
    let shape = [sides[0].len(), sides[1].len()];
    if shape.contains(&0) {
        return wrong("no picture", "at least one page with `Pict-No.:` and rows of numbers");
    }
    wanted.choose(path, &[(String::new(), shape.to_vec())])?;
    let range = |side: &[u32]| format!("{} to {}", side[0], side[side.len() - 1]);
    let of_file = |what: &str, value: String| Statement::new(what, value, StatementSource::File);
    let facts = StreamFacts {
        cells: shape.to_vec(),
        usual_axes: vec!["row", "col"],
        units: vec!["kPa".into()],
        has_checked_units: true,
        rate_hz: Some(1.0 / step),
        time_names: vec!["frames".into(), "time".into()],
        time_unit: Some(TimeUnit::Seconds),
        has_pressures: true,
        notes: vec![
            Sheet::pitch_note(pitch),
            of_file("rows", range(&sides[0])),
            of_file("columns", range(&sides[1])),
        ],
        ..StreamFacts::default()
    };
    let lines = TextLines::open(path)?;
    let source = Emed { lines, about, sides, pitch, step, picture: None, next: None, forces: 0, frames: 0 };
    Ok(OpenStream {
        facts,
        frames: Some(pictures.len() as u64),
        sheet: Some(Sheet::grid(shape, pitch, &[])),
        source: Box::new(source),
    })
}

/// The text after a word of a line, up to a tab.
fn after<'t>(text: &'t str, word: &str) -> Option<&'t str> {
    Some(text.split_once(word)?.1.split('\t').next().unwrap_or_default().trim())
}

/// The next page with a picture; `next` is the number of a picture that a line has begun. Pages without a number are
/// summaries.
fn next_page(
    lines: &mut TextLines,
    about: &mut EmedAbout,
    next: &mut Option<u64>,
) -> Result<Option<Page>, IoError> {
    let mut page = next.take().map(|picture| Page { picture, ..Page::default() });
    let mut columns: Vec<u32> = Vec::new();
    let (mut has_forces, mut has_ended) = (false, false);
    while lines.advance()? {
        if lines.bytes().contains(&FORM_FEED) {
            has_ended = page.is_some();
        }
        if lines.bytes().trim_ascii().is_empty() {
            continue;
        }
        let text = lines.text();
        let wrong = |needed: &str| lines.at().invalid(excerpt(&text), needed);
        if let Some(size) = after(&text, "Sensor size:") {
            let sides = size.trim_end_matches("cm").split_once('x');
            let sides = sides.and_then(|(w, h)| Some([number(h.as_bytes())?, number(w.as_bytes())?]));
            let sides = sides.filter(|sides| sides.iter().all(|side| *side > 0.0));
            about.pitch = Some(
                sides.ok_or_else(|| wrong("the size of a sensor as 0.500x0.500 cm"))?.map(|cm| 1e-2 * cm),
            );
        }
        if let Some(step) = after(&text, "Time/picture:") {
            let ms = number(step.trim_end_matches("ms").as_bytes()).map(|ms| ms / 1e3);
            let step = ms.filter(|step| is_interval(*step));
            about.step = Some(step.ok_or_else(|| wrong("the time of a picture as 10.0 ms"))?);
        }
        if let Some(picture) = after(&text, "Pict-No.:") {
            let picture = picture.split_whitespace().next().and_then(|word| word.parse().ok());
            let picture = picture.ok_or_else(|| wrong("the number of a picture"))?;
            match &mut page {
                // A picture that is too wide for a page goes on on the next one.
                Some(page) if page.picture == picture => (columns, has_ended) = (Vec::new(), false),
                Some(_) => {
                    *next = Some(picture);
                    return Ok(page);
                }
                None => page = Some(Page { picture, ..Page::default() }),
            }
            continue;
        }
        let Some(page) = page.as_mut().filter(|_| !has_ended) else { continue };
        let mut all = words(lines.bytes());
        let Some(first) = all.next() else { continue };
        if first == b"Force" {
            page.force = all.last().and_then(number).or(page.force);
            continue;
        }
        if columns.is_empty() {
            let names: Vec<&[u8]> = words(lines.bytes()).collect();
            has_forces = names.last().is_some_and(|name| *name == b"Force");
            let names = &names[..names.len() - usize::from(has_forces)];
            let parsed: Option<Vec<u32>> = names.iter().map(|name| side(name)).collect();
            // Other lines of the head are texts.
            columns = parsed.unwrap_or_default();
            continue;
        }
        let Some(row) = side(first) else { continue };
        let mut count = 0;
        for (k, word) in all.enumerate() {
            let value = lines.number(word, || format!("row {row}, column {}", k + 1))?;
            if let Some(&column) = columns.get(k) {
                page.cells.push((row, column, value));
            }
            count = k + 1;
        }
        let needed = columns.len() + usize::from(has_forces);
        if count != needed {
            return Err(lines.at().invalid(
                format!("{count} numbers in row {row}"),
                format!("{needed}, as the line of columns has"),
            ));
        }
    }
    Ok(page)
}

/// The number of a row or a column.
fn side(word: &[u8]) -> Option<u32> {
    std::str::from_utf8(word).ok()?.parse().ok().filter(|side| *side <= MOST_SIDES)
}

impl Frames for Emed {
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        let Some(page) = next_page(&mut self.lines, &mut self.about, &mut self.next)? else {
            return Ok(false);
        };
        let part = format!("picture {}", page.picture);
        let wrong = |found: String, needed: String| Err(self.lines.at().invalid_part(&part, found, needed));
        if let Some(last) = self.picture.filter(|last| last.checked_add(1) != Some(page.picture)) {
            return wrong(
                format!("picture {} after {last}", page.picture),
                "the picture that follows".into(),
            );
        }
        let [rows, cols] = &self.sides;
        cells.clear();
        cells.resize(rows.len() * cols.len(), f64::NAN);
        let mut sum = 0.0;
        for (row, col, value) in page.cells {
            let (Ok(r), Ok(c)) = (rows.binary_search(&row), cols.binary_search(&col)) else {
                return wrong(
                    format!("row {row}, column {col}"),
                    "a file that does not change while it is read".into(),
                );
            };
            let cell = &mut cells[r * cols.len() + c];
            if !cell.is_nan() {
                return wrong(format!("row {row}, column {col} again"), "each cell once".into());
            }
            (*cell, sum) = (value, sum + value);
        }
        let newtons = 1e3 * sum * self.pitch[0] * self.pitch[1];
        let Some(stated) = page.force else {
            return wrong("no force".into(), "its line Force, which proves that pressures are in kPa".into());
        };
        if !is_sum(newtons, stated, FORCE_TOLERANCE[1], FORCE_TOLERANCE[0]) {
            return wrong(
                format!("cells that are {newtons:.2} N in kPa"),
                format!("{stated} N, the Force of the page"),
            );
        }
        // Pages are cropped to what is loaded: the force proves that the other cells are not.
        cells.iter_mut().filter(|x| x.is_nan()).for_each(|x| *x = 0.0);
        (self.picture, self.forces) = (Some(page.picture), self.forces + 1);
        *time = FileTime::Real(self.frames as f64 * self.step);
        self.frames += 1;
        Ok(true)
    }

    fn statements(&self) -> Vec<Statement> {
        let value = format!("the Force of {} pictures is that of their cells in kPa", self.forces);
        vec![Statement::new("forces", value, StatementSource::Checked)]
    }
}
