//! What file and layout state: the same, or one of the two alone.

use std::fmt::Display;
use std::path::Path;

use crate::io::IoError;
use crate::io::file::invalid;
use crate::io::layout::cells::MAX_CELLS;
use crate::io::layout::facts::{Statement, StatementSource, StreamFacts};
use crate::io::layout::keys::Layout;
use crate::io::layout::rules::{TaxelRule, TimeRule};
use crate::signal::unit_ratio;

/// A rate differs from another by more than this share of it, or it is the same.
const RATE_TOLERANCE: f64 = 1e-6;

impl Layout {
    /// Refuses a rate, or a name or unit of times, that is not that of the file.
    pub(super) fn check_time(&self, file: &Path, facts: &StreamFacts) -> Result<(), IoError> {
        let refuse = |element: &str, found: String, needed: &str| {
            Err(invalid(file, element, found, self.says(needed)))
        };
        match (&self.time, facts) {
            (TimeRule::Rate(rate), StreamFacts { rate_hz: Some(stated), .. })
                if (stated / rate - 1.0).abs() > RATE_TOLERANCE =>
            {
                refuse("rate", format!("{stated} frames a second"), &rate.to_string())
            }
            (TimeRule::Stream { unit, .. }, StreamFacts { time_unit: Some(stated), .. })
                if stated != unit =>
            {
                refuse("times", format!("times in {}", stated.name()), unit.name())
            }
            (TimeRule::Stream { stream: Some(name), .. }, StreamFacts { time_names, .. })
                if !time_names.is_empty() && !time_names.contains(name) =>
            {
                refuse("times", format!("times called {}", time_names.join(" or ")), name)
            }
            _ => Ok(()),
        }
    }

    /// The numbers in a frame of these axes; refuses frames of another shape or with other axes.
    pub(super) fn width_of(&self, axes: &[&str], file: &Path, facts: &StreamFacts) -> Result<usize, IoError> {
        let refuse =
            |element: &str, found: String, needed: String| Err(invalid(file, element, found, needed));
        let is_of_frame = |axis: &&str| !["frame", "episode"].contains(axis);
        let stated: Vec<&str> = facts.axes.iter().map(String::as_str).filter(is_of_frame).collect();
        if axes.len() != facts.cells.len() {
            let more = if axes.len() < facts.cells.len() && self.episode_axis().is_none() {
                "; an axis of trials is called \"episode\""
            } else {
                ""
            };
            let needed = self.says(format!("{} axes, frames and {axes:?}", self.axes.len())) + more;
            return refuse("axes", format!("frames of the shape {:?}", facts.cells), needed);
        }
        if !stated.is_empty() && stated != axes {
            return refuse("axes", format!("{stated:?}"), self.says(format_args!("{axes:?}")));
        }
        let width = facts.cells.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
        let Some(width) = width.filter(|width| (1..=MAX_CELLS).contains(width)) else {
            let needed = format!("1 to {MAX_CELLS} numbers in a frame");
            return refuse("axes", format!("frames of the shape {:?}", facts.cells), needed);
        };
        if facts.may_be_mirrored && !self.states_flips() {
            let found = "that rows or columns are mirrored, but not whether they are stored so".into();
            return refuse(
                "taxels",
                found,
                "`flip` in `taxels` of the layout: the axes to flip, or []".into(),
            );
        }
        Ok(width)
    }

    /// What is needed, and that the layout states it.
    pub(super) fn says(&self, what: impl Display) -> String {
        format!("{what}, as {} states", self.name.display())
    }

    /// What the layout states, or else the file; `taxels` are the cells that are taxels.
    pub(super) fn statements(&self, facts: &StreamFacts, taxels: String) -> Vec<Statement> {
        let origin = self.origin;
        let by_file = |is_stated: bool| if is_stated { StatementSource::File } else { origin };
        let time = match &self.time {
            TimeRule::Rate(rate) => (format!("{rate} frames a second"), by_file(facts.rate_hz.is_some())),
            TimeRule::Stream { stream, unit, .. } => {
                let name = stream.as_deref().unwrap_or("times");
                (format!("{name} in {}", unit.name()), by_file(facts.time_unit.is_some()))
            }
        };
        let mut all = vec![
            Statement::new("axes", self.axes.join(", "), origin),
            Statement::new("time", time.0, time.1),
            Statement::new(
                "press",
                format!("{} the number", self.press.name()),
                by_file(facts.has_pressures),
            ),
            Statement::new("zero", self.zero.describe(), origin),
            Statement::new("taxels", taxels, by_file(self.taxels == TaxelRule::File)),
        ];
        if !self.missing.is_empty() {
            all.push(Statement::new("missing", format!("{:?} stand for no reading", self.missing), origin));
        }
        all
    }

    /// What the numbers of a channel are multiplied by; refuses a unit that is not that of the file.
    pub(super) fn scale_of(
        &self,
        channel: usize,
        file: &Path,
        facts: &StreamFacts,
        statements: &mut Vec<Statement>,
    ) -> Result<f64, IoError> {
        let (rule, units) = (&self.rules[channel], &facts.units);
        let stated =
            if units.len() == 1 { units.first() } else { units.get(rule.component.unwrap_or(channel)) };
        let stated = stated.filter(|unit| !unit.is_empty());
        let source = match stated {
            Some(_) if facts.has_checked_units => StatementSource::Checked,
            Some(_) => StatementSource::File,
            None => self.origin,
        };
        let name = &rule.name;
        if let Some(stated) = stated {
            let ratio = unit_ratio(stated, &rule.unit);
            let fits = match (ratio, rule.scale) {
                (Some(ratio), scale) => (scale.unwrap_or(1.0) / ratio - 1.0).abs() < 1e-6,
                (None, scale) => scale.is_some(),
            };
            if !fits {
                let found = format!("the unit {stated} of {name}");
                let by = ratio.map_or(String::new(), |ratio| format!(", or `scale` {ratio} for it"));
                let needed = self.says(&rule.unit) + &by;
                return Err(invalid(file, "unit", found, needed));
            }
        }
        let of_channel = if self.rules.len() > 1 { format!(" of {name}") } else { String::new() };
        let unit = match (stated, rule.unit.as_str()) {
            (None, "") => "none in the file",
            (_, unit) => unit,
        };
        statements.push(Statement::new(format!("unit{of_channel}"), unit, source));
        if let Some(scale) = rule.scale {
            statements.push(Statement::new(format!("scale{of_channel}"), scale.to_string(), self.origin));
        }
        Ok(rule.scale.unwrap_or(1.0))
    }
}
