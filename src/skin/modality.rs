//! Modalities: what the sensors of a taxel measure. A taxel without a word on it senses touch, and a thermal pad heat.

use std::sync::Arc;

use crate::id::VertexId;
use crate::skin::{Presence, Sheet, Taxels};

/// What a taxel senses: one to 16 names of modalities, joined by `+`, each once, such as `touch+thermal`.
///
/// A name has up to 32 small letters of ASCII, digits, `-` and `_`, the first a letter. `touch` is force and pressure.
pub type Modalities = Arc<str>;

/// The modality of taxels that touches press.
pub const TOUCH: &str = "touch";

/// The modality of thermal pads.
pub const THERMAL: &str = "thermal";

/// Whether a text can be what a taxel senses.
pub(crate) fn are_modalities(text: &str) -> bool {
    let names: Vec<&str> = text.split('+').collect();
    let is_name = |name: &&str| {
        (1..=32).contains(&name.len())
            && name.starts_with(|c: char| c.is_ascii_lowercase())
            && name.bytes().all(|c| matches!(c, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_'))
    };
    let is_once = |k: usize| !names[..k].contains(&names[k]);
    names.len() <= 16 && names.iter().all(is_name) && (0..names.len()).all(is_once)
}

/// The presence of a taxel that is not absent and senses these.
pub(crate) fn presence_of(modalities: &str) -> Presence {
    match modalities {
        THERMAL => Presence::ThermalPad,
        names if names.split('+').any(|name| name == TOUCH) => Presence::Present,
        _ => Presence::Other,
    }
}

impl Taxels {
    /// What a taxel senses, as [`Modalities`]; empty where nothing is known.
    ///
    /// # Panics
    /// If there is no such taxel.
    pub fn modalities_of(&self, taxel: VertexId) -> &str {
        let given = self.modalities.as_ref().and_then(|all| all[taxel].as_deref());
        given.unwrap_or(match self.presence[taxel] {
            Presence::Present => TOUCH,
            Presence::ThermalPad => THERMAL,
            Presence::Absent | Presence::Other => "",
        })
    }

    /// The sensors of a modality, ascending: taxels that sense it and are not absent.
    pub fn sensors(&self, modality: &str) -> Vec<VertexId> {
        let senses = |v: &VertexId| self.modalities_of(*v).split('+').any(|name| name == modality);
        let taxels = self.presence.enumerate().filter(|(_, presence)| **presence != Presence::Absent);
        taxels.map(|(v, _)| v).filter(senses).collect()
    }

    /// The modalities besides touch that have sensors, in the order of their first ones.
    pub fn other_modalities(&self) -> Vec<&str> {
        let mut names = Vec::new();
        for (v, _) in self.presence.enumerate().filter(|(_, presence)| **presence != Presence::Absent) {
            let others = self.modalities_of(v).split('+').filter(|name| !["", TOUCH].contains(name));
            others.for_each(|name| {
                if !names.contains(&name) {
                    names.push(name);
                }
            });
        }
        names
    }
}

impl Sheet {
    /// Gives taxels that are not absent the presence that their modalities name: readers of files call it.
    pub(crate) fn follow_modalities(&mut self) {
        let Some(modalities) = &self.modalities else { return };
        let all = self.presence.get_or_insert_with(|| vec![Presence::Present; modalities.len()]);
        for (presence, of) in all.iter_mut().zip(modalities) {
            if let Some(of) = of.as_deref().filter(|_| *presence != Presence::Absent) {
                *presence = presence_of(of);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_names_joined_by_plus_each_once() {
        for good in ["touch", "thermal", "touch+thermal", "a1-b_c"] {
            assert!(are_modalities(good), "{good}");
        }
        for bad in
            ["", "+", "touch+", "touch+touch", "Touch", "1a", "a b", "a.b", "a/b", "\u{e9}", &"a".repeat(33)]
        {
            assert!(!are_modalities(bad), "{bad}");
        }
    }

    #[test]
    fn what_a_taxel_senses_decides_its_presence_but_not_whether_it_is_there() {
        let names = ["touch+thermal", "thermal", "proximity", "thermal"];
        let mut sheet = Sheet {
            presence: Some(vec![
                Presence::ThermalPad,
                Presence::Present,
                Presence::Present,
                Presence::Absent,
            ]),
            modalities: Some(names.into_iter().map(|name| Some(Modalities::from(name))).collect()),
            ..Sheet::default()
        };
        sheet.follow_modalities();
        let presence = [Presence::Present, Presence::ThermalPad, Presence::Other, Presence::Absent];
        assert_eq!(sheet.presence.as_deref(), Some(&presence[..]));
        let taxels = Taxels {
            presence: presence.into_iter().collect(),
            modalities: sheet.modalities.map(Into::into),
            ..Taxels::default()
        };
        assert_eq!(taxels.other_modalities(), [THERMAL, "proximity"]);
        assert_eq!(taxels.sensors(THERMAL), [0, 1].map(VertexId::new));
        assert_eq!(taxels.sensors(TOUCH), [VertexId::new(0)]);
    }
}
