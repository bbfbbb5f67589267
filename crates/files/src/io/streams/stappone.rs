//! Stappone `.csv`: a row for each frame of a sole, with times in ms, pressures in no stated unit, and a flag for rows that
//! are corrupt, which have no readings. A sensor is the taxel whose number is in the name of its column.

use std::collections::BTreeSet;
use std::path::Path;

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::layout::{Statement, StatementSource, StreamFacts, TimeUnit};
use crate::io::streams::frames::{FileTime, Frames, OpenStream, Wanted};
use crate::io::streams::lines::{TextLines, cells as split};
use crate::skin::TaxelId;

struct Stappone {
    lines: TextLines,
    columns: StappColumns,
    sole: String,
    corrupt: u64,
}

/// Where the columns are.
#[derive(Debug, Clone, Default)]
struct StappColumns {
    count: usize,
    /// In the order of the numbers in their names.
    pressures: Vec<usize>,
    numbers: Vec<u32>,
    corrupt: Option<usize>,
    /// Names that begin as those of pressures and have no number.
    unread: Vec<String>,
}

/// The most soles of a file.
const MOST_SOLES: usize = 100;

pub(super) fn open(path: &Path, wanted: Wanted<'_>) -> Result<OpenStream, IoError> {
    let mut lines = TextLines::open(path)?;
    let columns = read_columns(&mut lines)?;
    let (mut soles, mut rows): (BTreeSet<String>, Vec<String>) = (BTreeSet::new(), Vec::new());
    let mut frames = std::collections::BTreeMap::<String, u64>::new();
    while lines.advance_to_content()? {
        let sole =
            String::from_utf8_lossy(split(lines.bytes(), b',').next().unwrap_or_default()).into_owned();
        if sole == "sole_id" {
            let needed = "names in the first line alone: write a file for each recording";
            return Err(lines.at().invalid("the names of the columns again", needed));
        }
        *frames.entry(sole.clone()).or_default() += 1;
        if soles.insert(sole.clone()) {
            rows.push(sole);
        }
        if soles.len() > MOST_SOLES {
            return Err(lines
                .at()
                .invalid(format!("{} soles", soles.len()), format!("at most {MOST_SOLES}")));
        }
    }
    if rows.is_empty() {
        return Err(lines.ended("at least one row below the names"));
    }
    let shape = vec![columns.pressures.len()];
    let streams: Vec<_> = rows.iter().map(|sole| (format!("sole {sole}"), shape.clone())).collect();
    let place = wanted.choose(path, &streams)?;
    let sole = rows.swap_remove(place);
    let mut notes = vec![Statement::new("sole", &sole, StatementSource::File)];
    if !columns.unread.is_empty() {
        notes.push(Statement::new("columns not read", columns.unread.join(", "), StatementSource::File));
    }
    let is_whole = columns.numbers.iter().zip(1..).all(|(number, k)| *number == k);
    let ids = || columns.numbers.iter().map(|number| TaxelId(*number)).collect();
    let facts = StreamFacts {
        // Without a gap ids may begin anywhere, as those of a right sole.
        ids: (!is_whole).then(ids),
        stream: streams[place].0.clone(),
        cells: shape,
        usual_axes: vec!["taxel"],
        time_names: vec!["timestamp".into(), "time".into()],
        time_unit: Some(TimeUnit::Milliseconds),
        has_pressures: true,
        notes,
        ..StreamFacts::default()
    };
    let mut lines = TextLines::open(path)?;
    read_columns(&mut lines)?;
    let frames = frames.get(&sole).copied();
    let source = Stappone { lines, columns, sole, corrupt: 0 };
    Ok(OpenStream { facts, frames, sheet: None, source: Box::new(source) })
}

fn read_columns(lines: &mut TextLines) -> Result<StappColumns, IoError> {
    lines.advance_to_content()?;
    let text = lines.text();
    let names: Vec<&str> = text.split(',').map(str::trim).collect();
    let (mut numbered, mut unread) = (Vec::new(), Vec::new());
    for (k, name) in names.iter().enumerate() {
        let Some(number) = name.strip_prefix("pressure_") else { continue };
        match number.parse::<u32>() {
            Ok(number) if number > 0 => numbered.push((number, k)),
            _ => unread.push((*name).to_owned()),
        }
    }
    numbered.sort_unstable();
    if numbered.is_empty() {
        return Err(lines.at().invalid(excerpt(&text), "columns pressure_01, pressure_02, ..."));
    }
    if let Some(pair) = numbered.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let part = format!("column {}", pair[1].1 + 1);
        return Err(lines.at().invalid_part(part, format!("sensor {} again", pair[1].0), "each sensor once"));
    }
    Ok(StappColumns {
        count: names.len(),
        pressures: numbered.iter().map(|(_, k)| *k).collect(),
        numbers: numbered.iter().map(|(number, _)| *number).collect(),
        unread,
        corrupt: names.iter().position(|name| *name == "corrupt"),
    })
}

impl Frames for Stappone {
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        loop {
            if !self.lines.advance_to_content()? {
                return Ok(false);
            }
            let (lines, row) = (&self.lines, split(self.lines.bytes(), b',').collect::<Vec<_>>());
            if row.len() != self.columns.count {
                let needed = format!("{}, as the first line has", self.columns.count);
                return Err(lines.at().invalid(format!("{} cells", row.len()), needed));
            }
            if row[0] != self.sole.as_bytes() {
                continue;
            }
            let ms = std::str::from_utf8(row[1]).ok().and_then(|word| word.parse().ok());
            let ms = ms.ok_or_else(|| {
                lines.at().invalid_part(
                    "timestamp",
                    excerpt(&String::from_utf8_lossy(row[1])),
                    "a whole number of ms",
                )
            })?;
            *time = FileTime::Whole(ms);
            let is_corrupt = self.columns.corrupt.is_some_and(|column| row[column] != b"0");
            cells.clear();
            for &column in &self.columns.pressures {
                let value = match row[column] {
                    _ if is_corrupt => f64::NAN,
                    b"" => f64::NAN,
                    cell => lines.number(cell, || format!("column {}", column + 1))?,
                };
                cells.push(value);
            }
            self.corrupt += u64::from(is_corrupt);
            return Ok(true);
        }
    }

    fn statements(&self) -> Vec<Statement> {
        let value = format!("{} frames that the file calls corrupt; they have no readings", self.corrupt);
        let stated = (self.corrupt > 0).then(|| Statement::new("corrupt", value, StatementSource::File));
        stated.into_iter().collect()
    }
}
