//! On what a map is drawn: the map of another skin, patch by patch.

use serde::{Deserialize, Serialize};

/// On which map of another skin a map is drawn: its positions are those of the other one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OnAtlas {
    /// Name of the other map, for people.
    pub name: String,
    /// Hash (`io::map_hash`) of the other map; 16 hexadecimal digits in files.
    #[serde(with = "hexadecimal")]
    pub hash: u64,
    /// Whether it lies on the mirror image of the other map, `u` for `-u`: the skin is that of the other hand.
    #[serde(rename = "mirrored")]
    pub is_mirrored: bool,
}

/// On which patch of an atlas a patch lies, and by what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OnPatch {
    /// Name of the patch of the atlas.
    pub patch: String,
    /// Number of landmarks that lie at their places.
    pub landmarks: usize,
    /// Number of landmarks that were left out.
    pub left_out: usize,
    /// Symmetric Dirichlet energy of its free map, where known; that on the atlas is in the [distortion](super::MapLevel::distortion)
    /// of level 0.
    pub free_dirichlet: Option<f64>,
}

mod hexadecimal {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(super) fn serialize<S: Serializer>(hash: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("{hash:016x}"))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        let digits = String::deserialize(deserializer)?;
        let hash = u64::from_str_radix(&digits, 16).ok().filter(|_| digits.len() == 16);
        hash.ok_or_else(|| D::Error::custom(format_args!("hash {digits:?}")))
    }
}
