//! Values of options: words to choose from, numbers within a range, and lengths with a unit.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use dermatome::body::{Body, FieldLevel};
use dermatome::map::SkinMap;
use dermatome::pyramid::LevelId;
use dermatome::signal::Probe;
use glam::DVec3;

use crate::console::errors::advise;
use crate::console::notes::first_names;
use crate::console::print::plain;

/// A number within a range that `wanted` describes.
pub(crate) fn number(text: &str, wanted: &str, ok: impl Fn(f64) -> bool) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && ok(x) => Ok(x),
        _ => Err(format!("needed: {wanted}")),
    }
}

/// A whole number of at least 1, which `wanted` describes.
pub(crate) fn whole(text: &str, wanted: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or_else(|| format!("needed: {wanted}"))
}

/// A length in m: `5mm`, `2cm`, `1in`, `0.1m`; a bare number is in m.
pub(crate) fn length(text: &str) -> Result<f64, String> {
    length_in(text, 1.0).ok_or_else(|| "needed: a length, as in 0.1, 0.1m or 100mm".into())
}

/// A length in m; a number without a unit is in mm.
pub(crate) fn length_mm(text: &str) -> Result<f64, String> {
    length_in(text, 1e-3).ok_or_else(|| "needed: a length, as in 5, 5mm or 0.005m".into())
}

/// A length in m above 0; a bare number is in mm.
pub(crate) fn side_mm(text: &str) -> Result<f64, String> {
    length_mm(text)
        .ok()
        .filter(|x| *x > 0.0 && x.is_finite())
        .ok_or_else(|| "needed: a length above 0, as in 5, 5mm or 0.005m".into())
}

/// A length in m, 0 or above; a bare number is in m.
pub(crate) fn length_or_0(text: &str) -> Result<f64, String> {
    length(text)
        .ok()
        .filter(|x| *x >= 0.0 && x.is_finite())
        .ok_or_else(|| "needed: a length, as in 0.02, 20mm or 0 for none".into())
}

fn length_in(text: &str, bare: f64) -> Option<f64> {
    let units = [("mm", 1e-3), ("cm", 1e-2), ("dm", 0.1), ("in", 0.0254), ("m", 1.0)];
    let known = units.iter().find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)));
    let (number, unit) = known.unwrap_or((text, bare));
    number.trim_end().parse::<f64>().ok().filter(|x| !x.is_nan()).map(|x| unit * x)
}

/// A value of an option: its word, its value in the library, and its help.
pub(crate) type Choice<T> = (&'static str, T, &'static str);

/// A parser of the words of some choices.
pub(crate) fn one_of<T: Clone + Send + Sync + 'static>(
    choices: &'static [Choice<T>],
) -> impl TypedValueParser<Value = T> {
    let words = choices.iter().map(|(word, _, help)| PossibleValue::new(*word).help(*help));
    PossibleValuesParser::new(words).map(|word| {
        let chosen = choices.iter().find(|(other, ..)| *other == word);
        chosen.map(|(_, value, _)| value.clone()).expect("clap takes no other words")
    })
}

/// The word that chooses a value; empty if none does.
pub(crate) fn word_of<T: PartialEq>(choices: &[Choice<T>], value: &T) -> &'static str {
    choices.iter().find(|(_, other, _)| other == value).map_or("", |(word, ..)| word)
}

/// What touches the skin.
pub(crate) const PROBES: [Choice<Probe>; 3] = [
    ("any", Probe::Any, "Anything: contacts are apart where a peak rises above the saddle to the next"),
    (
        "finger",
        Probe::Finger,
        "Fingers: zero and noise are followed, readings smoothed, and ridges as wide as fingers counted; a palm is one",
    ),
    (
        "foot",
        Probe::Foot,
        "A foot, a seat, a lying body: what is at most 10 cm apart on a patch is one contact",
    ),
];

/// A level without a mesh, and its name.
pub(crate) type NamedLevel = (FieldLevel, String);

/// A level of the patches, or the name of one without a mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum LevelArg {
    Patches(LevelId),
    Fields(String),
}

impl LevelArg {
    /// Those of the patches, and those without a mesh with their names, which the map must have.
    pub(crate) fn sort(
        levels: &[Self],
        map: Option<&SkinMap>,
    ) -> anyhow::Result<(Vec<LevelId>, Vec<NamedLevel>)> {
        let (mut patches, mut fields) = (Vec::new(), Vec::new());
        for level in levels {
            match level {
                Self::Patches(level) => patches.push(*level),
                Self::Fields(name) => fields.push(field_level(name, map)?),
            }
        }
        Ok((patches, fields))
    }
}

/// The level without a mesh that a name is of; refuses one that a map does not have.
pub(crate) fn field_level(name: &str, map: Option<&SkinMap>) -> anyhow::Result<NamedLevel> {
    if let Some(level) = Body::number_of(name) {
        check_body_level(level, map)?;
        return Ok((FieldLevel { modality: None, level }, format!("body.L{level}")));
    }
    let known: Vec<_> = map.into_iter().flat_map(SkinMap::field_levels).collect();
    if let Some(found) = known.iter().find(|(_, known)| known == name) {
        return Ok(found.clone());
    }
    let of_modalities = known.into_iter().filter(|(at, _)| at.modality.is_some());
    let names: Vec<String> = of_modalities.map(|(_, name)| name).collect();
    let advice = match &names[..] {
        [] => "it has no modalities besides touch: a skin says what its taxels sense".to_owned(),
        names => format!("levels of its modalities are {}", first_names(names)),
    };
    Err(advise(format!("the map has no level {}", plain(name)), advice))
}

/// Refuses a level of the whole body that a map does not have.
fn check_body_level(level: LevelId, map: Option<&SkinMap>) -> anyhow::Result<()> {
    match map.map_or(0, |map| map.body.levels.len()) {
        count if level.index() < count => Ok(()),
        0 => Err(advise(
            format!(
                "there is no level body.L{level}: levels of the whole body are those of a map of several patches"
            ),
            "maps of several patches that `dermatome build` wrote before have none; build them again",
        )),
        count => Err(advise(
            format!("the map has no level body.L{level}"),
            format!("its levels of the whole body are body.L0 to body.L{}", count - 1),
        )),
    }
}

/// A level: a number, or the name of one without a mesh.
pub(crate) fn level(text: &str) -> Result<LevelArg, String> {
    let number = || text.parse::<u32>().ok().map(LevelId::from).map(LevelArg::Patches);
    let is_number = |digits: &str| !digits.is_empty() && digits.bytes().all(|c| c.is_ascii_digit());
    let is_name = text.rsplit_once(".L").is_some_and(|(of, digits)| !of.is_empty() && is_number(digits));
    let named = is_name.then(|| LevelArg::Fields(text.to_owned()));
    named.or_else(number).ok_or_else(|| {
        "needed: the number of a level, body.L0, body.L1, ... of the whole body, or as arm.thermal.L0 of a modality"
            .into()
    })
}

/// The whole text as `N` finite numbers with commas between them.
pub(crate) fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let finite = |word: &str| word.trim().parse().ok().filter(|x: &f64| x.is_finite());
    text.split(',').map(finite).collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// A direction: an axis, or three numbers.
pub(crate) fn direction(text: &str) -> Result<DVec3, String> {
    let axis = match text.trim_start_matches('+') {
        "x" => Some(DVec3::X),
        "-x" => Some(DVec3::NEG_X),
        "y" => Some(DVec3::Y),
        "-y" => Some(DVec3::NEG_Y),
        "z" => Some(DVec3::Z),
        "-z" => Some(DVec3::NEG_Z),
        _ => None,
    };
    let direction = axis.or_else(|| numbers(text).map(DVec3::from_array)).and_then(DVec3::try_normalize);
    direction.ok_or_else(|| "needed: x, -x, y, -y, z, -z, or three numbers X,Y,Z".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        assert_eq!(
            ["0.1", "0.1m", "5mm", "2 cm", "inf"].map(length),
            [0.1, 0.1, 5e-3, 0.02, f64::INFINITY].map(Ok)
        );
        assert_eq!(["5", "5mm", "0.5m", "-1"].map(length_mm), [5e-3, 5e-3, 0.5, -1e-3].map(Ok));
        assert!(["", "m", "5 km", "NaN"].map(length).iter().all(Result::is_err));
        assert!(["0", "-1mm", "inf"].map(side_mm).iter().all(Result::is_err));
    }
}
