//! Sums of a trial as a table, and the loads of every frame.

use SummaryCell::{Count, Number, Text};

use crate::io::IoError;
use crate::io::file::OutPath;
use crate::io::file::outputs::Replacement;
use crate::io::table::writer::{TableWriter, write_table};
use crate::map::SkinMap;
use crate::signal::{Group, LoadingStep, Summary, Totals};

/// A cell of a summary.
#[derive(Debug, Clone, PartialEq)]
pub enum SummaryCell {
    /// A name; it may be empty.
    Text(String),
    /// A number, if it is known.
    Number(Option<f64>),
    /// A count or an id.
    Count(u64),
}

/// The cells of a row of a summary, each with the name of its column.
pub type SummaryRow = Vec<(&'static str, SummaryCell)>;

/// The rows of a summary, with the same columns: the whole skin, then links, patches, regions, fields of
/// the whole body if they are [followed](Summary::follow_fields), and contacts. docs/terms.md
/// defines them.
///
/// # Panics
/// If the summary is of another map.
pub fn summary_rows(map: &SkinMap, summary: &Summary) -> Vec<SummaryRow> {
    let row = |(group, totals): (Group, &Totals)| {
        let is_known = totals.taxels > 0;
        let mut row = names_of(map, summary, group);
        row.push(("taxels", Number(is_known.then_some(totals.taxels as f64))));
        row.push(("area", Number(is_known.then_some(totals.area))));
        row.push(("frames", Count(totals.frames as u64)));
        row.extend(peaks(map, totals));
        row.extend([
            ("contact_time", Number(totals.contact_time)),
            ("first_contact", Number(totals.first_contact)),
            ("last_contact", Number(totals.last_contact)),
        ]);
        row.extend(motion(totals));
        row
    };
    summary.totals().map(row).collect()
}

/// The rows of the steps of a summary, by their begin. `side` is `left` or `right` where the name of the region, the patch or
/// the link has that word, or the name that a file gives its `sensor`.
///
/// # Panics
/// If the summary is of another map.
pub fn summary_step_rows(map: &SkinMap, summary: &Summary, sensor: &str) -> Vec<SummaryRow> {
    let steps = summary.steps().map(|(steps, _)| steps).unwrap_or_default();
    steps.iter().map(|step| step_row(map, summary, sensor, step)).collect()
}

fn step_row(map: &SkinMap, summary: &Summary, sensor: &str, step: &LoadingStep) -> SummaryRow {
    let LoadingStep { group, number, totals } = step;
    let [patch, link, name] = summary.names(map, *group);
    let side = [&*name, &*patch, &*link, sensor].into_iter().find_map(side).unwrap_or_default();
    let mut row = vec![("step", Count(*number as u64)), ("side", Text(side.into()))];
    row.extend(names_of(map, summary, *group));
    row.push(("begin", Number(totals.first_contact)));
    row.push(("duration", Number(totals.contact_time)));
    row.push(("frames", Count(totals.loaded_frames as u64)));
    row.extend(peaks(map, totals));
    row.extend(motion(totals));
    row
}

/// `left` or `right`, if a name has one of these words.
fn side(name: &str) -> Option<&'static str> {
    let has =
        |side: &str| name.split(|c: char| !c.is_alphabetic()).any(|word| word.eq_ignore_ascii_case(side));
    match ["left", "right"].map(has) {
        [true, false] => Some("left"),
        [false, true] => Some("right"),
        _ => None,
    }
}

fn names_of(map: &SkinMap, summary: &Summary, group: Group) -> SummaryRow {
    let [patch, link, name] = summary.names(map, group).map(|name| Text(name.into_owned()));
    let channel = &summary.channel;
    vec![
        ("group", Text(<&str>::from(group).into())),
        ("name", name),
        ("patch", patch),
        ("link", link),
        ("channel", Text(channel.name.clone())),
        ("unit", Text(channel.unit.clone())),
    ]
}

fn peaks(map: &SkinMap, totals: &Totals) -> [(&'static str, SummaryCell); 12] {
    let peak_taxel = totals.peak_taxel.map(|(patch, taxel)| map.patches[patch].taxels.ids[taxel].0);
    [
        ("peak", Number(totals.peak)),
        ("peak_time", Number(totals.peak_time)),
        ("peak_taxel_id", peak_taxel.map_or(Number(None), |id| Count(id.into()))),
        ("mean", Number(totals.mean())),
        ("sum_peak", Number(totals.sum_peak)),
        ("force_peak", Number(totals.force_peak)),
        ("force_peak_time", Number(totals.force_peak_time)),
        ("force_mean", Number(totals.force_mean())),
        ("impulse", Number(totals.impulse)),
        ("pressure_time_integral", Number(totals.pressure_time_integral)),
        ("contact_area_peak", Number(Some(totals.contact_area_peak))),
        ("contact_area_mean", Number(totals.contact_area_mean())),
    ]
}

fn motion(totals: &Totals) -> [(&'static str, SummaryCell); 3] {
    [
        ("path", Number(totals.path)),
        ("speed_mean", Number(totals.speed_mean())),
        ("speed_peak", Number(totals.speed_peak)),
    ]
}

/// A summary, and the number of the episode that it is of where a recording has several.
pub type EpisodeSummary<'s> = (Option<u64>, &'s Summary);

/// Writes summaries as a table, a row for each group; what is not known is an empty cell. Those of episodes have a column
/// `episode` before the others.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
///
/// # Panics
/// If a summary is of another map.
pub fn write_summary(
    path: impl Into<OutPath>,
    map: &SkinMap,
    summaries: &[EpisodeSummary<'_>],
) -> Result<(), IoError> {
    let rows: Vec<SummaryRow> = summaries
        .iter()
        .flat_map(|&(episode, summary)| of_episode(episode, summary_rows(map, summary)))
        .collect();
    write_rows(&path.into(), &rows.first().cloned().unwrap_or_default(), rows)
}

/// Rows with the number of their episode, if they have one.
fn of_episode(episode: Option<u64>, mut rows: Vec<SummaryRow>) -> Vec<SummaryRow> {
    if let Some(number) = episode {
        rows.iter_mut().for_each(|row| row.insert(0, ("episode", Count(number))));
    }
    rows
}

/// Writes the [steps](summary_step_rows) of summaries as a table, a row for each.
///
/// # Errors
/// As [`write_summary`].
///
/// # Panics
/// As [`write_summary`].
pub fn write_summary_steps(
    path: impl Into<OutPath>,
    map: &SkinMap,
    summaries: &[EpisodeSummary<'_>],
    sensor: &str,
) -> Result<(), IoError> {
    let none = LoadingStep { group: Group::Whole, number: 0, totals: Totals::default() };
    let like = summaries
        .first()
        .map(|&(episode, summary)| of_episode(episode, vec![step_row(map, summary, sensor, &none)]).concat());
    let rows = summaries
        .iter()
        .flat_map(|&(episode, summary)| of_episode(episode, summary_step_rows(map, summary, sensor)));
    write_rows(&path.into(), &like.unwrap_or_default(), rows.collect())
}

/// `like` has the names of the columns.
fn write_rows(path: &OutPath, like: &SummaryRow, rows: Vec<SummaryRow>) -> Result<(), IoError> {
    let names: Vec<&str> = like.iter().map(|(name, _)| *name).collect();
    write_table(path, &names.join(","), |table| {
        for row in rows {
            for (_, cell) in row {
                match cell {
                    Text(text) => table.cell(&text),
                    Number(number) => table.number_if_any(number),
                    Count(count) => table.whole(count),
                }
            }
            table.end_row()?;
        }
        Ok(())
    })
}

/// Writes what presses on each group, but for contacts, frame by frame:
/// `frame,time,group,name,peak,mean,sum,force,contact_area,x,y,z`, the centre of pressure in m in the frame of its link.
///
/// Nothing appears in the file's place before [`LoadWriter::finish`].
pub struct LoadWriter {
    table: TableWriter<Replacement>,
    episode: Option<u64>,
}

impl LoadWriter {
    /// Starts a table.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: impl Into<OutPath>) -> Result<Self, IoError> {
        const COLUMNS: &str = "frame,time,group,name,peak,mean,sum,force,contact_area,x,y,z";
        Ok(Self { table: TableWriter::create(&path.into(), COLUMNS)?, episode: None })
    }

    /// The frames that follow are of this episode, as in [`RegionWriter::begin_episode`](crate::io::RegionWriter::begin_episode).
    pub fn begin_episode(&mut self, number: u64) {
        if self.episode.replace(number).is_none() {
            self.table.add_first_column("episode");
        }
    }

    /// Writes the frame that was added to a summary last.
    ///
    /// # Errors
    /// If the disk is full.
    ///
    /// # Panics
    /// If the summary is of another map.
    pub fn write(&mut self, frame: u64, time: f64, map: &SkinMap, summary: &Summary) -> Result<(), IoError> {
        let Self { table, episode } = self;
        for (group, load) in summary.loads() {
            let has_readings = load.readings > 0;
            episode.iter().for_each(|&number| table.whole(number));
            table.whole(frame);
            table.number_if_any(Some(time).filter(|time| time.is_finite()));
            table.cell(group.into());
            table.cell(&summary.names(map, *group)[2]);
            table.number_if_any(Some(load.peak).filter(|_| has_readings));
            table.number_if_any(load.mean());
            table.number_if_any(Some(load.sum).filter(|_| has_readings));
            table.number_if_any(Some(load.force).filter(|force| has_readings && !force.is_nan()));
            table.numbers([load.area]);
            match load.centre() {
                Some(centre) => table.numbers(centre.to_array()),
                None => table.empty(3),
            }
            table.end_row()?;
        }
        Ok(())
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn finish(self) -> Result<(), IoError> {
        self.table.publish()
    }
}
