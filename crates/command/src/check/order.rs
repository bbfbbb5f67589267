//! `check --order`: which column of a recording is of which taxel.

use dermatome::Error;
use dermatome::io::{read_order, write_order};
use dermatome::map::SkinMap;
use dermatome::recording::find_order;
use dermatome::run::Run;
use dermatome::signal::{Order, Zero};
use dermatome::skin::Skin;
use serde_json::{Value, json};

use crate::check::recordings::RecordingArgs;
use crate::console::notes::{note, rows_of};
use crate::files::outputs;
use crate::options::{Common, InPath};
use crate::readings::remark_channel;

/// The order of columns.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Recordings")]
pub(super) struct OrderArgs {
    /// Find instead which column of the recordings is of which taxel, from separate touches that roll all over the skin;
    /// ids in the recordings are not used
    #[arg(long, requires = "readings", conflicts_with_all = ["modules", "gain", "response", "columns"])]
    pub(super) order: bool,
    /// Columns whose taxel is known, three if the skin is symmetric: a table with columns column,taxel_id; columns are
    /// counted from 0, without frames and times
    #[arg(long, value_name = "K.csv", requires = "order")]
    known: Option<InPath>,
}

impl OrderArgs {
    /// Finds the order of the columns of recordings, and writes it.
    pub(super) fn find(
        &self,
        recordings: &RecordingArgs,
        skin: &Skin,
        common: &Common,
    ) -> anyhow::Result<Order> {
        let known = self.known.as_ref().map(|path| rows_of(path, read_order(path), common)).transpose()?;
        let known = known.unwrap_or_default();
        let mut reading = recordings.read.clone();
        reading.zero = Some(reading.zero.unwrap_or(Zero::Follow));
        let options = reading.recording_options(common)?;
        let map = SkinMap::of_taxels(skin);
        let count = recordings.readings.len();
        let mut opened = 0;
        let open = |number: usize| {
            let path = &recordings.readings[number];
            let readings = reading.reader(path, common)?;
            if opened < count {
                remark_channel(&readings.channels, path, common);
            }
            opened += 1;
            Ok::<_, anyhow::Error>(readings)
        };
        let order = find_order(&map, &known, recordings.threshold, &options, count, open, Run::default())?;
        if let Some(path) = &recordings.output {
            let unnamed = write_order(common.outputs.file(path), &order).map_err(Error::from)?;
            if unnamed > 0 {
                note!(
                    common,
                    "{unnamed} columns are of taxels that share an id; they have none in {}",
                    path.display()
                );
            }
            outputs::publish(common)?;
        }
        if order.crowded > 0 {
            note!(common, "{} frames are left out, in which too many columns are touched", order.crowded);
        }
        Ok(order)
    }
}

/// How the order was found, in a line.
pub(super) fn sentence(order: &Order) -> String {
    let Order { columns, objective, runner_up, without_column, touches, frames, threshold, .. } = order;
    let placed = order.placed();
    let next = runner_up.map_or(String::new(), |next| format!(", {next:.3} of the next order that differs"));
    format!(
        "{placed} of {} columns have a taxel, {} were touched too seldom; {without_column} taxels have no column; objective \
         {objective:.3}{next}; {touches} touches in {frames} frames, touches are above {threshold:.4}\n",
        columns.len(),
        columns.len() - placed
    )
}

/// The order, for programs.
pub(super) fn as_json(order: &Order, skin: &Skin) -> Value {
    let column = |(number, column): (usize, &dermatome::signal::OrderedColumn)| {
        json!({
            "column": number, "taxel": column.taxel.map(|(.., id)| id.0),
            "patch": column.taxel.map(|(patch, ..)| &skin.patches[patch].name),
            "vertex": column.taxel.map(|(_, vertex, _)| vertex.raw()),
            "support": Some(column.support).filter(|x| x.is_finite()), "known": column.is_known,
        })
    };
    json!({
        "columns": order.columns.iter().enumerate().map(column).collect::<Vec<_>>(),
        "placed": order.placed(), "without_column": order.without_column, "objective": order.objective,
        "runner_up": order.runner_up, "touches": order.touches, "frames": order.frames, "crowded": order.crowded,
        "threshold": order.threshold,
    })
}
