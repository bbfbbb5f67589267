//! Options that are words, and the options of the command that several functions take.

use dermatome::{
    SkinMap,
    atlas::Pack,
    cut::Cut,
    flatten::{Boundary, Energy, FlattenOptions, Method, Overlap},
    mesh::FillHoles,
    pyramid::LevelId,
    signal::{Channel, Probe, Quantity},
    skin::{TaxelId, Weld},
};
use glam::DVec3;
use pyo3::prelude::*;

use crate::{
    arguments::found,
    arrays::{one_each, pairs},
    errors::bad,
};

/// What a word stands for.
pub(crate) fn word<T: Clone>(argument: &str, found: &str, known: &[(&str, T)]) -> PyResult<T> {
    let names = || known.iter().map(|(name, _)| format!("{name:?}")).collect::<Vec<_>>().join(", ");
    let value = known.iter().find(|(name, _)| *name == found).map(|(_, value)| value.clone());
    value.ok_or_else(|| bad(argument, format!("{found:?}"), names()))
}

/// How patches are packed, as a flag or a word.
#[derive(FromPyObject)]
pub(crate) enum PackArg {
    Flag(bool),
    Word(String),
}

impl PackArg {
    pub(crate) fn read(self) -> PyResult<Option<Pack>> {
        match self {
            Self::Flag(is_packed) => Ok(is_packed.then_some(Pack::Tight)),
            Self::Word(found) => {
                word("pack", &found, &[("tight", Pack::Tight), ("body", Pack::Body)]).map(Some)
            }
        }
    }
}

/// A number that counts something.
pub(crate) fn count(argument: &str, found: i64) -> PyResult<usize> {
    usize::try_from(found).map_err(|_| bad(argument, found, "a number from 0 on"))
}

/// A length or another number above 0.
pub(crate) fn positive(argument: &str, found: f64) -> PyResult<f64> {
    if found > 0.0 && found.is_finite() { Ok(found) } else { Err(bad(argument, found, "a number above 0")) }
}

/// One of the first levels.
pub(crate) fn level(argument: &str, found: i64, levels: usize) -> PyResult<LevelId> {
    let known = usize::try_from(found).ok().filter(|&k| k < levels);
    known
        .map(LevelId::new)
        .ok_or_else(|| bad(argument, found, format!("a level from 0 to {}", levels.saturating_sub(1))))
}

/// What touches the skin, by its word.
pub(crate) fn probe(found: &str) -> PyResult<Probe> {
    word("probe", found, &[("any", Probe::Any), ("finger", Probe::Finger), ("foot", Probe::Foot)])
}

/// A unit of length, in m: a word or a number.
pub(crate) fn unit(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    match value.extract::<f64>() {
        Ok(metres) => positive("unit", metres),
        Err(_) => {
            let needed = "a word as \"mm\", or the length of the unit in m";
            let name: String = value.extract().map_err(|_| bad("unit", found(value), needed))?;
            word("unit", &name, &[("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("dm", 0.1), ("in", 0.0254)])
        }
    }
}

/// A unit vector.
pub(crate) fn direction(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<DVec3> {
    let given = DVec3::from_slice(&one_each(argument, value, 3)?).try_normalize();
    given.ok_or_else(|| bad(argument, "no direction", "three numbers, not all 0"))
}

pub(crate) fn weld(found: &str) -> PyResult<Weld> {
    let known = [("auto", Weld::Auto), ("all", Weld::All), ("none", Weld::None), ("texture", Weld::Texture)];
    word("weld", found, &known)
}

/// Filling a hole costs the cube of its number of edges.
const LARGEST_HOLE: i64 = 200;

pub(crate) fn fill_holes(found: Option<i64>) -> PyResult<FillHoles> {
    match found {
        None => Ok(FillHoles::PinHoles),
        Some(edges @ 0..=LARGEST_HOLE) => Ok(FillHoles::UpTo(count("fill_holes", edges)?)),
        Some(found) => Err(bad("fill_holes", found, format!("a number of edges from 0 to {LARGEST_HOLE}"))),
    }
}

/// An amount, or an average.
pub(crate) fn quantity(extensive: bool) -> Quantity {
    if extensive { Quantity::Extensive } else { Quantity::Intensive }
}

/// What the readings of a channel are: an amount or an average, and of which modality besides touch.
pub(crate) fn channel(map: &SkinMap, extensive: bool, modality: Option<&str>) -> PyResult<Channel> {
    let all = || map.body.modalities.iter().map(|modality| &*modality.name);
    if let Some(name) = modality.filter(|name| all().all(|known| known != *name)) {
        let mut known: Vec<String> = all().map(|known| format!("{known:?}")).collect();
        known.dedup();
        let needed = match &known[..] {
            [] => "None: the map has no sensors but those of touch".to_owned(),
            known => format!("None for touch, or one of the map: {}", known.join(", ")),
        };
        return Err(bad("modality", format!("{name:?}"), needed));
    }
    let name = modality.unwrap_or_default().to_owned();
    Ok(Channel { name, quantity: quantity(extensive), ..Channel::default() })
}

/// What holds for all channels, or one for each.
#[derive(Debug, Clone)]
pub(crate) enum PerChannel<T> {
    All(T),
    Each(Vec<T>),
}

impl<T: Clone + Default + for<'py> FromPyObjectOwned<'py>> PerChannel<T> {
    pub(crate) fn read(argument: &str, value: Option<&Bound<'_, PyAny>>, needed: &str) -> PyResult<Self> {
        let Some(value) = value else { return Ok(Self::All(T::default())) };
        if let Ok(all) = value.extract() {
            return Ok(Self::All(all));
        }
        let each = value.extract().map(Self::Each);
        each.map_err(|_: PyErr| bad(argument, found(value), format!("{needed}, or one for each channel")))
    }

    /// For how many channels there is one each.
    pub(crate) fn count(&self) -> Option<usize> {
        match self {
            Self::All(_) => None,
            Self::Each(each) => Some(each.len()),
        }
    }

    /// One for each of some channels.
    pub(crate) fn of_channels(&self, argument: &str, channels: usize) -> PyResult<Vec<T>> {
        match self {
            Self::All(one) => Ok(vec![one.clone(); channels]),
            Self::Each(each) if each.len() != channels => {
                Err(bad(argument, each.len(), format!("one, or {channels}: one for each channel")))
            }
            Self::Each(each) => Ok(each.clone()),
        }
    }
}

/// How many times finer the skin is at each of some taxels.
pub(crate) fn acuities(value: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<f64>> {
    let found = one_each("acuity", value, count)?;
    match found.iter().position(|x| !(0.01..=100.0).contains(x)) {
        Some(k) => Err(bad(&format!("acuity[{k}]"), found[k], "a number from 0.01 to 100")),
        None => Ok(found),
    }
}

/// Where to cut: a word, or pairs of the ids of taxels that an edge joins.
pub(crate) fn cut(value: Option<&Bound<'_, PyAny>>, max_area_ratio: Option<f64>) -> PyResult<Cut> {
    let cut = match value.map(|value| (value, value.extract::<String>())) {
        None => Cut::Auto,
        Some((_, Ok(found))) => {
            word("cut", &found, &[("auto", Cut::Auto), ("none", Cut::None), ("all", Cut::All)])?
        }
        Some((value, Err(_))) => {
            Cut::Along(pairs("cut", value)?.into_iter().map(|pair| pair.map(TaxelId)).collect())
        }
    };
    match (cut, max_area_ratio) {
        (cut, None) => Ok(cut),
        (Cut::Auto, Some(ratio)) if ratio > 1.0 => Ok(Cut::AreaRatio(ratio)),
        (Cut::Auto, Some(ratio)) => Err(bad("max_area_ratio", ratio, "a number above 1")),
        _ => Err(bad("max_area_ratio", "another cut than \"auto\"", "one of the two")),
    }
}

/// How to flatten, as the command's options of the same names say it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlattenArgs<'a> {
    pub(crate) method: &'a str,
    pub(crate) energy: &'a str,
    pub(crate) angle: f64,
    pub(crate) area: f64,
    pub(crate) perimeter: f64,
    pub(crate) magnify: f64,
    pub(crate) overlap: &'a str,
    pub(crate) boundary: &'a str,
}

impl FlattenArgs<'_> {
    pub(crate) fn options(&self) -> PyResult<FlattenOptions> {
        let Self { angle, area, perimeter, magnify, .. } = *self;
        let sum = Energy::Sum { angle, area, perimeter };
        let energy = word(
            "energy",
            self.energy,
            &[("sum", sum), ("symmetric-dirichlet", Energy::SymmetricDirichlet)],
        )?;
        let known = [
            ("intrinsic", Method::Intrinsic { energy, magnify }),
            ("conformal", Method::Conformal),
            ("linear", Method::Linear { angle, area }),
        ];
        let method = word("method", self.method, &known)?;
        let overlap =
            word("overlap", self.overlap, &[("prevent", Overlap::Prevent), ("allow", Overlap::Allow)])?;
        let boundary =
            word("boundary", self.boundary, &[("free", Boundary::Free), ("circle", Boundary::Circle)])?;
        Ok(FlattenOptions { method, overlap, boundary })
    }
}
