//! Sums of a trial as a table, and the loads of every frame.

use crate::io::IoError;
use crate::io::file::OutPath;
use crate::io::file::outputs::Replacement;
use crate::io::table::writer::{TableWriter, write_table};
use crate::map::SkinMap;
use crate::signal::{Group, Summary, Totals};

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

/// The word of a kind of group.
fn word(group: Group) -> &'static str {
    match group {
        Group::Whole => "whole",
        Group::Link(_) => "link",
        Group::Patch(_) => "patch",
        Group::Region(_) => "region",
        Group::Contact(_) => "contact",
    }
}

/// The rows of a summary, each with the names of its columns, which are the same in all: the whole skin, then links,
/// patches, regions and contacts. docs/terms.md defines them.
///
/// # Panics
/// If the summary is of another map.
pub fn summary_rows(map: &SkinMap, summary: &Summary) -> Vec<Vec<(&'static str, SummaryCell)>> {
    use SummaryCell::{Count, Number, Text};
    let row = |(group, totals): (Group, &Totals)| {
        let [patch, link, name] = summary.names(map, group).map(|name| Text(name.into_owned()));
        let peak_taxel = totals.peak_taxel.map(|(patch, taxel)| map.patches[patch].taxels.ids[taxel].0);
        let is_known = totals.taxels > 0;
        vec![
            ("group", Text(word(group).into())),
            ("name", name),
            ("patch", patch),
            ("link", link),
            ("channel", Text(summary.channel.name.clone())),
            ("unit", Text(summary.channel.unit.clone())),
            ("taxels", Number(is_known.then_some(totals.taxels as f64))),
            ("area", Number(is_known.then_some(totals.area))),
            ("frames", Count(totals.frames as u64)),
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
            ("contact_time", Number(totals.contact_time)),
            ("first_contact", Number(totals.first_contact)),
            ("last_contact", Number(totals.last_contact)),
            ("path", Number(totals.path)),
            ("speed_mean", Number(totals.speed_mean())),
            ("speed_peak", Number(totals.speed_peak)),
        ]
    };
    summary.totals().map(row).collect()
}

/// Writes a summary as a table, a row for each group; what is not known is an empty cell.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
///
/// # Panics
/// If the summary is of another map.
pub fn write_summary(path: impl Into<OutPath>, map: &SkinMap, summary: &Summary) -> Result<(), IoError> {
    let rows = summary_rows(map, summary);
    let names: Vec<&str> = rows.iter().take(1).flatten().map(|(name, _)| *name).collect();
    write_table(&path.into(), &names.join(","), |table| {
        for row in rows {
            for (_, cell) in row {
                match cell {
                    SummaryCell::Text(text) => table.cell(&text),
                    SummaryCell::Number(number) => table.number_if_any(number),
                    SummaryCell::Count(count) => table.whole(count),
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
pub struct LoadWriter(TableWriter<Replacement>);

impl LoadWriter {
    /// Starts a table.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: impl Into<OutPath>) -> Result<Self, IoError> {
        const COLUMNS: &str = "frame,time,group,name,peak,mean,sum,force,contact_area,x,y,z";
        Ok(Self(TableWriter::create(&path.into(), COLUMNS)?))
    }

    /// Writes the frame that was added to a summary last.
    ///
    /// # Errors
    /// If the disk is full.
    ///
    /// # Panics
    /// If the summary is of another map.
    pub fn write(&mut self, frame: u64, time: f64, map: &SkinMap, summary: &Summary) -> Result<(), IoError> {
        let table = &mut self.0;
        for (group, load) in summary.loads() {
            let has_readings = load.readings > 0;
            table.whole(frame);
            table.number_if_any(Some(time).filter(|time| time.is_finite()));
            table.cell(word(*group));
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
        self.0.publish()
    }
}
