//! Recordings that are written frame by frame, as [`ReadingsReader`] reads them.
//!
//! [`ReadingsReader`]: crate::io::ReadingsReader

use std::collections::HashSet;

use crate::id::VertexId;
use crate::io::IoError;
use crate::io::arrays::npy::{ElementType, Elements};
use crate::io::arrays::write::{ArrayId, ArrayWriter};
use crate::io::file::outputs::Replacement;
use crate::io::file::{OutPath, file_kind, unfit};
use crate::io::layout::KnownRest;
use crate::io::readings::arrays::REST;
use crate::io::table::writer::TableWriter;
use crate::signal::{Channel, Frame};
use crate::skin::{PatchId, Presence, Taxels};

/// Writes readings frame by frame: a table `.csv` or arrays `.npz`.
///
/// The table has the columns `time` in s, if frames have times, and `ID.CHANNEL` for each taxel that is present and each channel, as
/// `17.force`; a taxel without a reading has `NaN`. The arrays are `values` `(T, N)`, of several channels `(T, N, C)`,
/// `timestamps` `(T,)` if frames have times, `ids` `(N,)`, the texts `channels` and `units`, `kinds` where these do not tell the
/// [kind](Channel::kind) of each, and what is [known at rest](Self::state_rest). Where taxels share an id, all taxels
/// are written in their order, absent ones too, without ids: the columns of the table are `.force`.
/// No file appears before [`ReadingsWriter::finish`]; memory does not depend on
/// the number of frames.
pub struct ReadingsWriter {
    taxels: Vec<(PatchId, VertexId)>,
    channels: usize,
    is_of_touch: Vec<bool>,
    has_times: bool,
    output: Output,
    row: Vec<f64>,
}

/// The columns of readings that are written, besides those of taxels.
#[derive(Debug, Clone, Copy)]
pub struct ReadingsColumns<'a> {
    /// The channels.
    pub channels: &'a [Channel],
    /// Whether frames have times, which are written, too.
    pub has_times: bool,
}

enum Output {
    Table(TableWriter<Replacement>),
    Arrays { writer: ArrayWriter, times: Option<ArrayId>, values: ArrayId },
}

/// Whether a table of readings can name a channel so.
fn is_column_name(name: &str) -> bool {
    let is_bad = |c: char| c.is_control() || [',', ';', '"', '[', ']'].contains(&c);
    !name.contains(is_bad) && !name.starts_with(|c: char| c.is_ascii_digit()) && name.trim() == name
}

impl ReadingsWriter {
    /// Starts a file of readings of the taxels that are present, given patch by patch.
    ///
    /// # Errors
    /// If the file is of another kind or cannot be created, no taxel is present, or a table cannot have a channel of that name.
    pub fn create<'a>(
        path: impl Into<OutPath>,
        patches: impl IntoIterator<Item = &'a Taxels>,
        columns: ReadingsColumns<'_>,
    ) -> Result<Self, IoError> {
        let ReadingsColumns { channels, has_times } = columns;
        let path = &path.into();
        let (mut all, mut present) = (Vec::new(), Vec::new());
        for (patch, of_patch) in patches.into_iter().enumerate() {
            for (taxel, presence) in of_patch.presence.enumerate() {
                all.push((PatchId::new(patch), taxel));
                if *presence == Presence::Present {
                    present.push(((PatchId::new(patch), taxel), of_patch.ids[taxel].0));
                }
            }
        }
        if present.is_empty() {
            return Err(unfit(path, "the skin", "no taxel that is present", "at least one"));
        }
        let (mut taxels, mut ids): (Vec<_>, Vec<_>) = present.into_iter().unzip();
        let mut seen = HashSet::new();
        let has_ids = ids.iter().all(|id| seen.insert(*id));
        if !has_ids {
            (taxels, ids) = (all, Vec::new());
        }
        let output = match file_kind(path).as_str() {
            "csv" => {
                if let Some(channel) = channels.iter().find(|channel| !is_column_name(&channel.name)) {
                    let needed =
                        "a name without a digit first and without separators, quotes and brackets, or a .npz";
                    return Err(unfit(path, "channel", format!("{:?}", channel.name), needed));
                }
                let mut names = HashSet::new();
                if let Some(channel) = channels.iter().find(|channel| !names.insert(&channel.name)) {
                    let needed = "a name of its own for each channel";
                    return Err(unfit(path, "channel", format!("{:?} twice", channel.name), needed));
                }
                if let Some(channel) = channels.iter().find(|channel| !channel.is_usual()) {
                    let found = format!("{:?}, of the kind {}", channel.name, channel.kind);
                    let needed = "a kind that name and unit tell, or a .npz";
                    return Err(unfit(path, "channel", found, needed));
                }
                let id = |column| ids.get(column).map_or(String::new(), u32::to_string);
                let name = |column, Channel { name, unit, .. }: &Channel| match unit.as_str() {
                    "" => format!("{}.{name}", id(column)),
                    unit => format!("{}.{name}[{unit}]", id(column)),
                };
                let names = (0..taxels.len())
                    .flat_map(|column| channels.iter().map(move |channel| name(column, channel)));
                let time = has_times.then(|| "time".to_owned());
                let header: Vec<String> = time.into_iter().chain(names).collect();
                Output::Table(TableWriter::create(path, &header.join(","))?)
            }
            "npz" => {
                let mut writer = ArrayWriter::create(path)?;
                let times =
                    has_times.then(|| writer.growing("timestamps", ElementType::F64, &[])).transpose()?;
                let shape = [taxels.len(), channels.len()];
                let shape = if channels.len() == 1 { &shape[..1] } else { &shape };
                let values = writer.growing("values", ElementType::F64, shape)?;
                if has_ids {
                    writer.constant("ids", &[ids.len()], Elements::U32(&ids))?;
                }
                let (names, units): (Vec<_>, Vec<_>) =
                    channels.iter().map(|channel| (channel.name.clone(), channel.unit.clone())).unzip();
                writer.constant("channels", &[names.len()], Elements::Text(&names))?;
                writer.constant("units", &[units.len()], Elements::Text(&units))?;
                if !channels.iter().all(Channel::is_usual) {
                    let kinds: Vec<String> =
                        channels.iter().map(|channel| channel.kind.to_string()).collect();
                    writer.constant("kinds", &[kinds.len()], Elements::Text(&kinds))?;
                }
                Output::Arrays { writer, times, values }
            }
            _ => return Err(IoError::UnknownKind { path: path.into(), known: ".csv, .npz" }),
        };
        let is_of_touch = channels.iter().map(|channel| channel.kind.is_of_touch()).collect();
        Ok(Self { taxels, channels: channels.len(), is_of_touch, has_times, output, row: Vec::new() })
    }

    /// States what is known of the readings where nothing touches, before the first frame: arrays of an `.npz`, lines with `#`
    /// above the names of a table, which states it of all channels of touch or of none.
    ///
    /// # Errors
    /// If it is known of some channels that measure touches and not of others, in a table; or the disk is full.
    pub fn state_rest(&mut self, rest: &KnownRest) -> Result<(), IoError> {
        let KnownRest { is_zero, threshold } = rest;
        let is_any = is_zero.contains(&true);
        let is_all = self.is_of_touch.iter().enumerate().all(|(k, of_touch)| !of_touch || rest.is_zero_in(k));
        match &mut self.output {
            Output::Arrays { writer, .. } => {
                if is_any && is_all {
                    writer.constant(REST[0], &[], Elements::U32(&[1]))?;
                } else if is_any {
                    let flags: Vec<u32> = (0..self.channels).map(|k| u32::from(rest.is_zero_in(k))).collect();
                    writer.constant(REST[0], &[flags.len()], Elements::U32(&flags))?;
                }
                if let Some(threshold) = threshold {
                    writer.constant(REST[1], &[], Elements::F64(&[*threshold]))?;
                }
            }
            Output::Table(table) => {
                if is_any && !is_all {
                    let needed = "all channels that measure touches about 0 at rest, or none; or a .npz";
                    return Err(unfit(table.path(), "channels", "some that are about 0 at rest", needed));
                }
                let tared = is_any.then(|| format!("# {}: 1\n", REST[0]));
                let threshold = threshold.map(|x| format!("# {}: {x}\n", REST[1]));
                table.put_first(&(tared.unwrap_or_default() + &threshold.unwrap_or_default()));
            }
        }
        Ok(())
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// If the disk is full.
    ///
    /// # Panics
    /// If the frame is not one of these taxels.
    pub fn write(&mut self, frame: &Frame) -> Result<(), IoError> {
        self.row.clear();
        for &(patch, taxel) in &self.taxels {
            self.row.extend((0..self.channels).map(|channel| frame.values[patch][channel][taxel]));
        }
        match &mut self.output {
            Output::Arrays { writer, times, values } => {
                if let Some(times) = times {
                    writer.push(*times, Elements::F64(&[frame.time]))?;
                }
                writer.push(*values, Elements::F64(&self.row))?;
                writer.end_frame()
            }
            Output::Table(table) => {
                let time = self.has_times.then_some(frame.time);
                table.numbers(time.into_iter().chain(self.row.iter().copied()));
                table.end_row()
            }
        }
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn finish(self) -> Result<(), IoError> {
        match self.output {
            Output::Arrays { writer, .. } => writer.finish(),
            Output::Table(table) => table.publish(),
        }
    }
}
