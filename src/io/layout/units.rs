//! The unit of a channel, as file and layout state it.

use std::path::Path;

use crate::io::IoError;
use crate::io::file::invalid;
use crate::io::layout::facts::{Statement, StatementSource, StreamFacts};
use crate::io::layout::keys::Layout;
use crate::signal::unit_ratio;

impl Layout {
    /// What the numbers of a channel are multiplied by; refuses a unit that is not that of the file.
    pub(super) fn scale_of(
        &self,
        channel: usize,
        file: &Path,
        facts: &StreamFacts,
        statements: &mut Vec<Statement>,
    ) -> Result<f64, IoError> {
        let (rule, units) = (&self.rules[channel], &facts.units);
        let stated = if units.len() == 1 { units.first() } else { units.get(channel) };
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
                let needed = format!("{}, as {} states{by}", rule.unit, self.name.display());
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
