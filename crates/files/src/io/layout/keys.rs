//! The file of a layout: its keys, read and checked.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use crate::io::IoError;
use crate::io::file::{Source, excerpt, invalid};
use crate::io::layout::facts::{StatementSource, TimeUnit};
use crate::io::layout::rules::{ChannelRule, Press, TaxelRule, TimeRule, ZeroRule, typed};
use crate::signal::{Channel, ChannelKind};
use crate::skin::TaxelId;

/// The longest layout, in bytes.
const LONGEST_LAYOUT: usize = 1 << 22;

const REQUIRED: [&str; 6] = ["axes", "time", "channels", "press", "zero", "taxels"];
const OPTIONAL: [&str; 6] = ["dermatome_layout", "about", "note", "stream", "missing", "episode"];

/// What the numbers of a recording mean.
///
/// ```
/// use dermatome::io::{Decoder, Layout, StreamFacts, Times};
///
/// let text = r#"{"dermatome_layout": 1, "axes": ["frame", "row", "col"], "time": {"rate": 10},
///     "channels": [{"name": "pressure", "unit": "count"}], "press": "lowers", "zero": 100,
///     "taxels": {"shape": [1, 3], "first_id": 7, "flip": ["col"]}}"#;
/// let layout = Layout::parse("pad.json".as_ref(), text)?;
/// let facts = StreamFacts { cells: vec![1, 3], ..StreamFacts::default() };
/// let mut decoder = Decoder::new(&layout, "pad.npy".as_ref(), &facts)?;
/// let (mut values, mut seconds) = (Vec::new(), Vec::new());
/// decoder.decode(&[90.0, 100.0, 100.0, 99.0, 100.0, 40.0], Times::None, 0, &mut values, &mut seconds)?;
/// assert_eq!(decoder.ids()[0].0, 7);
/// assert_eq!((values, seconds), (vec![0.0, 0.0, 10.0, 60.0, 0.0, 1.0], vec![0.0, 0.1]));
/// # Ok::<(), dermatome::io::IoError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Its file, for messages, and for the folder of its tables.
    pub(super) name: PathBuf,
    text: String,
    stream: Option<String>,
    pub(super) axes: Vec<String>,
    pub(super) time: TimeRule,
    pub(super) rules: Vec<ChannelRule>,
    pub(super) channels: Vec<Channel>,
    pub(super) press: Press,
    pub(super) zero: ZeroRule,
    pub(super) missing: Vec<f64>,
    pub(super) taxels: TaxelRule,
    episode: Option<u64>,
    /// Who states what is in it.
    pub(super) origin: StatementSource,
}

impl Layout {
    /// Reads a layout.
    ///
    /// # Errors
    /// If the file cannot be read, is not JSON, or has keys that are unknown, missing, null or of another kind.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        let source = Source::open(path)?;
        if source.bytes().len() > LONGEST_LAYOUT {
            let found = format!("{} bytes", source.bytes().len());
            return Err(source.invalid("file", found, format!("a layout of at most {LONGEST_LAYOUT} bytes")));
        }
        Self::parse(path, source.text()?)
    }

    /// Reads a layout of a text, which errors call `name`; tables that it names are in the folder of `name`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(name: &Path, text: &str) -> Result<Self, IoError> {
        let json = serde_json::from_str(text);
        let json = json.map_err(|e| invalid(name, "file", e.to_string(), "a layout: JSON"))?;
        Self::from_json(name, text, &json, StatementSource::Layout)
    }

    pub(super) fn from_json(
        name: &Path,
        text: &str,
        json: &Value,
        origin: StatementSource,
    ) -> Result<Self, IoError> {
        let keys = checked_keys(name, json)?;
        let part = |key: &str| keys.get(key).unwrap_or(&Value::Null);
        let rules: Vec<ChannelRule> = typed(name, "channels", part("channels"), ChannelRule::KEYS)?;
        let mut channels = Vec::new();
        for (k, rule) in rules.iter().enumerate() {
            let wrong =
                |found: String, needed: String| invalid(name, format!("channels, {k}"), found, needed);
            let channel = Channel::new(&rule.name, &rule.unit);
            let channel = channel.map_err(|e| wrong(rule.unit.clone(), e.to_string()))?;
            let kind = match channel.kind {
                ChannelKind::Touch if rule.signed => ChannelKind::Tangential,
                kind => kind,
            };
            channels.push(Channel { kind: rule.kind.unwrap_or(kind), ..channel });
            if rules[..k].iter().any(|other| other.name == rule.name) {
                return Err(wrong(format!("the name {:?} again", rule.name), "a name of its own".into()));
            }
            if rule.scale.is_some_and(|scale| !scale.is_finite() || scale == 0.0) {
                return Err(wrong("scale 0".into(), "a number other than 0".into()));
            }
        }
        let layout = Self {
            name: name.into(),
            text: text.into(),
            stream: keys
                .get("stream")
                .map(|v| typed(name, "stream", v, "the name of a stream"))
                .transpose()?,
            axes: typed(name, "axes", part("axes"), "names, as [\"frame\", \"row\", \"col\"]")?,
            time: TimeRule::of(name, part("time"))?,
            rules,
            channels,
            press: typed(
                name,
                "press",
                part("press"),
                "\"raises\" or \"lowers\", what pressing does to the number",
            )?,
            zero: ZeroRule::of(name, part("zero"))?,
            missing: match keys.get("missing") {
                Some(missing) => {
                    typed(name, "missing", missing, "a list of numbers that stand for no reading")?
                }
                None => Vec::new(),
            },
            taxels: TaxelRule::of(name, part("taxels"))?,
            episode: keys
                .get("episode")
                .map(|v| typed(name, "episode", v, "the number of an episode, counted from 0"))
                .transpose()?,
            origin,
        };
        layout.check_axes()?;
        Ok(layout)
    }

    /// Refuses axes that do not fit each other or the channels.
    fn check_axes(&self) -> Result<(), IoError> {
        let wrong = |found: String, needed: &str| Err(invalid(&self.name, "axes", found, needed));
        let count = |name: &str| self.axes.iter().filter(|axis| *axis == name).count();
        if count("frame") != 1 {
            return wrong(format!("{:?}", self.axes), "\"frame\" once");
        }
        if let Some(axis) = self.axes.iter().find(|axis| axis.is_empty() || count(axis) > 1) {
            return wrong(format!("{axis:?} again, or empty"), "a name of its own for each axis");
        }
        let has_components = count("component") == 1;
        let element = |k: usize| format!("channels, {k}");
        for (k, rule) in self.rules.iter().enumerate() {
            if rule.component.is_some() != has_components {
                let needed = "`component` in each channel if \"component\" is one of the axes, else in none";
                return Err(invalid(&self.name, element(k), format!("{:?}", rule.component), needed));
            }
        }
        if self.rules.is_empty() || !has_components && self.rules.len() > 1 {
            let found = format!("{} channels", self.rules.len());
            return Err(invalid(&self.name, "channels", found, "one, or an axis \"component\" for several"));
        }
        Ok(())
    }

    /// The stream that it is of, if it names one.
    pub fn stream(&self) -> Option<&str> {
        self.stream.as_deref()
    }

    /// The file that it was read from: what errors call it.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Whether numbers in the first line of a text are ids: the layout says so, or they are those that it states itself.
    pub(in crate::io) fn calls_ids(&self, numbers: &[TaxelId]) -> Result<bool, IoError> {
        if self.taxels == TaxelRule::File {
            return Ok(true);
        }
        let mut line = numbers.to_vec();
        line.sort_unstable();
        let Some(own) = self.own_ids()?.filter(|_| line.windows(2).all(|pair| pair[0] != pair[1])) else {
            return Ok(false);
        };
        // A table may leave columns out.
        let has_all = !own.is_empty() && own.iter().all(|id| line.binary_search(id).is_ok());
        Ok(has_all && (own.len() == line.len() || matches!(self.taxels, TaxelRule::Table(_))))
    }

    /// The frames of a text: the shape of their cells where the layout has one for the `width` numbers of a line, and how
    /// many lines each of them has.
    pub(in crate::io) fn folded(&self, width: usize) -> Option<(Vec<usize>, usize)> {
        let TaxelRule::Grid(grid) = &self.taxels else { return None };
        let count = grid.shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
        let count = count.filter(|count| *count > 0 && grid.shape.len() < self.axes.len())?;
        let mut shape = grid.shape.clone();
        let cells = self.axes.iter().filter(|axis| *axis != "frame");
        if let Some(axis) = cells.clone().position(|axis| axis == "component") {
            (width.is_multiple_of(count) && axis <= shape.len())
                .then(|| shape.insert(axis, width / count))?;
            return Some((shape, 1));
        }
        let rests = (0..shape.len()).map(|k| shape[k..].iter().product::<usize>());
        let hit = rests.into_iter().position(|rest| rest == width)?;
        Some((shape.clone(), shape[..hit].iter().product()))
    }

    /// The names of the axes of the array, in its order.
    pub fn axes(&self) -> &[String] {
        &self.axes
    }

    /// Which axis is that of the frames.
    pub fn frame_axis(&self) -> usize {
        self.axes.iter().position(|axis| axis == "frame").unwrap_or(0)
    }

    /// Which axis is that of episodes, if the array has several.
    pub fn episode_axis(&self) -> Option<usize> {
        self.axes.iter().position(|axis| axis == "episode")
    }

    /// The episode that is read, if the layout chooses one.
    pub fn episode(&self) -> Option<u64> {
        self.episode
    }

    /// The channels of the readings.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// The numbers that stand for no reading, as they are and as floats of 32 bits have them.
    pub(in crate::io) fn missing_numbers(&self) -> Vec<f64> {
        #[expect(clippy::cast_possible_truncation, reason = "the nearest float of 32 bits is meant")]
        let singles = self.missing.iter().map(|&x| f64::from(x as f32));
        self.missing.iter().copied().chain(singles).collect()
    }

    /// These numbers as floats of 16 bits have them.
    pub(super) fn missing_halves(&self) -> Vec<f64> {
        self.missing.iter().map(|&x| half(x)).collect()
    }

    /// The stream from which the zero is taken, if it is.
    pub fn zero_stream(&self) -> Option<&str> {
        match &self.zero {
            ZeroRule::Stream { stream } => Some(stream),
            _ => None,
        }
    }

    /// The stream of the times, if it is named; and the frames per second, if they are stated.
    pub fn time(&self) -> (Option<&str>, Option<f64>) {
        match &self.time {
            TimeRule::Rate(rate) => (None, Some(*rate)),
            TimeRule::Stream { stream, .. } => (stream.as_deref(), None),
        }
    }

    /// The unit of the times, if frames are not taken at a stated rate.
    pub fn time_unit(&self) -> Option<TimeUnit> {
        match self.time {
            TimeRule::Rate(_) => None,
            TimeRule::Stream { unit, .. } => Some(unit),
        }
    }

    /// The text that it was read from.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// The keys of a layout, refused if one is unknown, missing or null.
fn checked_keys<'v>(name: &Path, json: &'v Value) -> Result<&'v Map<String, Value>, IoError> {
    let version = json.get("dermatome_layout");
    let Some(keys) = json.as_object().filter(|_| version == Some(&1.into())) else {
        let found = version.map_or("none".to_owned(), |v| excerpt(&v.to_string()));
        return Err(invalid(name, "dermatome_layout", found, "1: a layout as docs/files.md describes it"));
    };
    let is_known = |key: &str| REQUIRED.iter().chain(&OPTIONAL).any(|known| *known == key);
    if let Some(key) = keys.keys().find(|key| !is_known(key)) {
        let needed = format!("one of {}, {}", REQUIRED.join(", "), OPTIONAL.join(", "));
        return Err(invalid(name, "keys", excerpt(key), needed));
    }
    if let Some(key) = REQUIRED.iter().find(|key| !keys.contains_key(**key)) {
        let needed = format!("the key {key:?}, so that nothing is guessed");
        return Err(invalid(name, *key, "none", needed));
    }
    if let Some(path) = first_null(json) {
        let needed = "a value: a draft has null where the file does not state it; replace it";
        return Err(invalid(name, path, "null", needed));
    }
    Ok(keys)
}

/// The path of the first null.
pub(super) fn first_null(json: &Value) -> Option<String> {
    let under = |name: String, value: &Value| {
        let path = first_null(value)?;
        Some(if path.is_empty() { name } else { format!("{name}, {path}") })
    };
    match json {
        Value::Null => Some(String::new()),
        Value::Array(items) => items.iter().enumerate().find_map(|(k, item)| under(k.to_string(), item)),
        Value::Object(keys) => keys.iter().find_map(|(key, value)| under(key.clone(), value)),
        _ => None,
    }
}

/// The nearest float of 16 bits, which has 11 digits in base 2; those below 2^-14 have the step of the next.
fn half(x: f64) -> f64 {
    const LEAST: i32 = -14;
    if x == 0.0 || !x.is_finite() {
        return x;
    }
    let step = x.abs().log2().floor().max(f64::from(LEAST)) - 10.0;
    let step = step.exp2();
    (x / step).round_ties_even() * step
}
