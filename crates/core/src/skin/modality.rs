//! What a slot of the skin holds, and its modalities: what the sensors of a taxel measure. A taxel without a word on it senses touch, and a thermal pad heat.

use std::sync::Arc;

/// The content of a slot of the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, strum::IntoStaticStr, strum::EnumString)]
#[strum(serialize_all = "lowercase")]
pub enum Presence {
    /// A working taxel.
    #[default]
    Present,
    /// No taxel, or a dead one.
    Absent,
    /// A thermal pad: it has a position but no pressure reading.
    #[strum(serialize = "thermal")]
    ThermalPad,
    /// A sensor of other modalities: it has a position but no pressure reading.
    Other,
}

impl Presence {
    /// Whether it is a working taxel.
    #[doc(hidden)]
    pub fn reads_pressure(self) -> bool {
        self == Self::Present
    }

    /// Its number in files.
    #[doc(hidden)]
    pub const fn code(self) -> u8 {
        match self {
            Self::Absent => 0,
            Self::Present => 1,
            Self::ThermalPad => 2,
            Self::Other => 3,
        }
    }

    /// Its word in tables.
    #[doc(hidden)]
    pub fn word(self) -> &'static str {
        self.into()
    }

    const ALL: [Self; 4] = [Self::Absent, Self::Present, Self::ThermalPad, Self::Other];

    /// The presence with the number `code` in files.
    #[doc(hidden)]
    pub fn from_code(code: f64) -> Option<Self> {
        Self::ALL.into_iter().find(|p| f64::from(p.code()) == code)
    }
}

/// What a taxel senses: one to 16 names of modalities, joined by `+`, each once, such as `touch+thermal`.
///
/// A name has up to 32 small letters of ASCII, digits, `-` and `_`, the first a letter. `touch` is force and pressure.
pub type Modalities = Arc<str>;

/// The modality of taxels that touches press.
pub const TOUCH: &str = "touch";

/// The modality of thermal pads.
pub const THERMAL: &str = "thermal";

/// Whether a text can be what a taxel senses.
#[doc(hidden)]
pub fn are_modalities(text: &str) -> bool {
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

/// What the texts of modalities need.
#[doc(hidden)]
pub const NAMES_OF_MODALITIES: &str =
    "names of modalities joined by `+`, each once, of small letters, digits, - and _";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::id::VertexId;
    use crate::skin::{Sheet, Taxels};

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
