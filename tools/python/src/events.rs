//! `EventDetector` and `diff`: what touches do in words, and what changed between two files of a skin.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use dermatome::diff::{Change, DiffOptions};
use dermatome::io::{modules_of_skin, read_draft};
use dermatome::signal::{
    BodyWord, Channel, ContactTracker, Duplicates, Event, EventContact, EventDetector, EventOptions,
    EventPlace, Frame, Join, Rest, TrackerOptions, Word,
};
use dermatome::skin::{TaxelId, link_named};
use glam::DVec3;
use numpy::PyUntypedArrayMethods;
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};

use crate::{
    arguments::{arg, object, part},
    arrays::{bad_shape, floats, vector},
    errors::{bad, error},
    jobs::run,
    map::PyMap,
    options::{count, probe},
};

/// Finds contacts in frames of readings and says in words what they do: `touch`, `tap`, `press`, `hold`, `stroke`, `rub`,
/// `pat`, `grasp`, `hit`, each true by definition.
///
/// Parameters
/// ----------
/// map : Map
///     The map.
/// unit : str
///     Unit of the readings, as "Pa" or "N"; forces are known for units of pressure and force.
/// probe : str
///     What touches the skin: "any", "finger" or "foot".
/// threshold : float, optional
///     A contact has a taxel above this; by default estimated from the first frames, in which nothing should touch the
///     skin.
/// tared : bool
///     Whether readings are about 0 where nothing touches the skin, as those with `Readings.is_tared`; by default the mean of
///     the frames from which the threshold is estimated is subtracted.
/// words : sequence of (str, (3,) array_like, str)
///     Names of directions for strokes: a link, a direction in its frame, and the word.
/// **limits
///     The limits of the words, in s, m, N and rad, as docs/behaviours.md lists them: `tap_s`, `hold_s`, `stroke_m`,
///     `stroke_spacings`, `rub_ratio`, `rub_turns`, `pat_taps`, `pat_s`, `pat_m`, `grasp_s`, `grasp_rad`, `hit_n`, `hit_s`,
///     `least_s`, `join_s`, `join_m`.
///
/// Raises
/// ------
/// DataError
///     If a unit or word is unknown, a number is out of its range, or a direction is none.
#[pyclass(frozen, module = "dermatome", name = "EventDetector")]
#[derive(Debug)]
pub(crate) struct PyEventDetector {
    state: Mutex<State>,
    join: Join,
    taxels: usize,
    map: Py<PyMap>,
    words: Vec<BodyWord>,
}

#[derive(Debug)]
struct State {
    tracker: ContactTracker,
    detector: EventDetector,
    frame: Frame,
}

#[pymethods]
impl PyEventDetector {
    #[new]
    #[pyo3(signature = (map, *, unit="Pa", probe="any", threshold=None, tared=false, words=None, **limits))]
    fn new(
        #[pyo3(from_py_with = object)] map: &Bound<'_, PyMap>,
        #[pyo3(from_py_with = arg)] unit: &str,
        #[pyo3(from_py_with = arg)] probe: &str,
        #[pyo3(from_py_with = arg)] threshold: Option<f64>,
        #[pyo3(from_py_with = arg)] tared: bool,
        #[pyo3(from_py_with = arg)] words: Option<Vec<(String, [f64; 3], String)>>,
        limits: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let (of, map) = (map, &map.get().map);
        let link = |name: &str| {
            link_named(&map.links, name).map_err(|links| match links {
                0 => bad("words", format!("{name:?}"), "the name of a link of the map"),
                _ => {
                    let found = format!("{name:?}, the name of {links} links");
                    bad("words", found, "the name of one link of the map alone")
                }
            })
        };
        let words: Vec<BodyWord> = words
            .unwrap_or_default()
            .into_iter()
            .map(|(of, direction, word)| {
                Ok(BodyWord { link: link(&of)?, direction: DVec3::from_array(direction), word })
            })
            .collect::<PyResult<_>>()?;
        let mut options = EventOptions { words: words.clone(), ..EventOptions::default() };
        for (name, value) in limits.iter().flat_map(|limits| limits.iter()) {
            set(&mut options, name.extract::<String>()?.as_str(), &value)?;
        }
        let probe = self::probe(probe)?;
        let channel = Channel::new("", unit).map_err(error)?;
        let rest = if tared { Rest::AtZero } else { Rest::Learned };
        let tracking =
            TrackerOptions { probe, low: probe.low(), threshold, rest, ..TrackerOptions::default() };
        let tracker = ContactTracker::new(map, &channel, &tracking).map_err(error)?;
        let detector = EventDetector::new(map, options).map_err(error)?;
        let taxels = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let join = Join::new(map, None, taxels, Duplicates::Refuse).map_err(error)?;
        let state = Mutex::new(State { tracker, detector, frame: Frame::new(map, 1) });
        Ok(Self { state, join, taxels, map: of.clone().unbind(), words })
    }

    /// Take the next frame.
    ///
    /// Parameters
    /// ----------
    /// time : float
    ///     Its time, in s.
    /// values : (N,) array_like
    ///     Readings in the order of the map; NaN where there is none.
    ///
    /// Returns
    /// -------
    /// list of dict
    ///     The events that are known with this frame, with the keys of `dermatome.event/1` in docs/json.md but for
    ///     `schema`; taxels are their ids.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the time is no number or the frame has another number of readings.
    fn see<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] time: f64,
        values: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyList>> {
        let values = floats("values", values)?;
        if values.shape() != [self.taxels] {
            return Err(bad_shape("values", values.shape(), format!("shape ({},)", self.taxels)));
        }
        let values = values.as_slice()?.to_vec();
        let events = py.detach(|| {
            let State { tracker, detector, frame } = &mut *self.lock();
            self.join.fill(&values, frame);
            frame.time = time;
            tracker.track(frame);
            detector.see(time, tracker).map(<[Event]>::to_vec)
        });
        self.list(py, &events.map_err(error)?)
    }

    /// End what goes on, after the last frame.
    ///
    /// Returns
    /// -------
    /// list of dict
    ///     The last events.
    fn finish<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let events = self.lock().detector.finish().to_vec();
        self.list(py, &events)
    }

    /// int: How many contacts the strongest touch so far had at once, voted over its frames.
    #[getter]
    fn at_once(&self) -> usize {
        self.lock().tracker.at_once()
    }

    /// float or None: The threshold of contacts, given or estimated, in the unit of the readings; None while it is not known.
    #[getter]
    fn threshold(&self) -> Option<f64> {
        self.lock().tracker.threshold()
    }
}

impl PyEventDetector {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn list<'py>(&self, py: Python<'py>, events: &[Event]) -> PyResult<Bound<'py, PyList>> {
        let all = PyList::empty(py);
        for event in events {
            let found = PyDict::new(py);
            found.set_item("event", <&str>::from(event.word))?;
            found.set_item("phase", <&str>::from(event.phase))?;
            if let [contact] = event.contacts[..] {
                found.set_item("contact", contact)?;
            } else if !event.contacts.is_empty() {
                found.set_item("contacts", &event.contacts)?;
            }
            for (name, value) in [("time", event.time), ("begin", event.begin), ("duration", event.duration)]
            {
                found.set_item(name, value)?;
            }
            if let Some(contact) = &event.contact {
                self.describe(py, contact, event, &found)?;
            }
            all.append(found)?;
        }
        Ok(all)
    }

    fn describe(
        &self,
        py: Python<'_>,
        contact: &EventContact,
        event: &Event,
        found: &Bound<'_, PyDict>,
    ) -> PyResult<()> {
        let map = &self.map.get().map;
        let patch = &map.patches[contact.patch];
        found.set_item("patch", &patch.name)?;
        found.set_item("link", &map.links[contact.link].name)?;
        let regions = patch.taxels.regions.as_ref();
        if let Some(region) = regions.and_then(|all| all[contact.peak_taxel].as_deref()) {
            found.set_item("region", region)?;
        }
        if contact.force_peak.is_finite() {
            found.set_item("force_peak", contact.force_peak)?;
            found.set_item("force_mean", contact.force_mean)?;
            found.set_item("impulse", contact.impulse)?;
        }
        found.set_item("area", contact.area)?;
        for (name, EventPlace { point, patch, map: at }) in [("from", contact.from), ("to", contact.to)] {
            let place = PyDict::new(py);
            for (axis, x) in [("x", point.x), ("y", point.y), ("z", point.z), ("u", at.x), ("v", at.y)] {
                place.set_item(axis, x)?;
            }
            if patch != contact.patch {
                place.set_item("patch", &map.patches[patch].name)?;
            }
            found.set_item(name, place)?;
        }
        found.set_item("length", contact.length)?;
        if let Some(direction) = contact.direction {
            found.set_item("direction", direction)?;
        }
        if matches!(event.word, Word::Stroke | Word::Rub) && event.duration > 0.0 {
            found.set_item("speed", contact.length / event.duration)?;
        }
        if let Some(word) = contact.body_word {
            found.set_item("words", vec![&self.words[word].word])?;
        }
        let ids = contact.taxels.iter().map(|&taxel| patch.taxels.ids[taxel].0);
        found.set_item("taxels", vector(py, ids))?;
        if contact.patches.len() > 1 {
            let names: Vec<_> = contact.patches.iter().map(|&patch| &map.patches[patch].name).collect();
            found.set_item("patches", names)?;
        }
        if !contact.beyond.is_empty() {
            let beyond = PyDict::new(py);
            for part in contact.beyond.chunk_by(|a, b| a.patch == b.patch) {
                let patch = &map.patches[part[0].patch];
                let ids = part.iter().map(|at| patch.taxels.ids[at.taxel].0);
                beyond.set_item(&patch.name, vector(py, ids))?;
            }
            found.set_item("beyond", beyond)?;
        }
        Ok(())
    }
}

/// Sets a limit by its name.
fn set(options: &mut EventOptions, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    let limit = match name {
        "least_s" => &mut options.least_s,
        "join_s" => &mut options.join_s,
        "join_m" => &mut options.join_m,
        "tap_s" => &mut options.tap_s,
        "hold_s" => &mut options.hold_s,
        "stroke_m" => &mut options.stroke_m,
        "stroke_spacings" => &mut options.stroke_spacings,
        "rub_ratio" => &mut options.rub_ratio,
        "pat_s" => &mut options.pat_s,
        "pat_m" => &mut options.pat_m,
        "grasp_s" => &mut options.grasp_s,
        "grasp_rad" => &mut options.grasp_rad,
        "hit_s" => &mut options.hit_s,
        "hit_n" => options.hit_n.insert(0.0),
        "rub_turns" => {
            options.rub_turns = count(name, part(name, value)?)?;
            return Ok(());
        }
        "pat_taps" => {
            options.pat_taps = count(name, part(name, value)?)?;
            return Ok(());
        }
        _ => return Err(bad("limits", format!("{name:?}"), "a limit of a word, as tap_s")),
    };
    *limit = part(name, value)?;
    Ok(())
}

/// List what changed between two files of one skin.
///
/// Parameters
/// ----------
/// before, after : str or os.PathLike
///     The files: any that `Skin.read` reads.
/// modules : dict of int to str, optional
///     The module of each taxel by its id, where the files do not have it in a column `module`.
/// sigma : float, optional
///     Standard deviation of the difference of one taxel along each axis, in m; by default estimated from the files.
///
/// Returns
/// -------
/// list of dict
///     For each change its `kind` ("frame", "relinked", "mirrored", "moved", "turned", "swapped", "renumbered", "missing", "new",
///     "tilted", "resized", "regrouped", "modality" or "region"),
///     `subject`, `name`, `other`, `link`, `patch`, `taxels` and `others` (ids), `distance` (m), `angle` (rad), `sigmas` and
///     `p`, NaN where nothing was measured.
///
/// Raises
/// ------
/// DataError
///     If the files share no taxel, or an argument is out of range.
#[pyfunction]
#[pyo3(signature = (before, after, *, modules=None, sigma=None))]
pub(crate) fn diff<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = arg)] before: PathBuf,
    #[pyo3(from_py_with = arg)] after: PathBuf,
    #[pyo3(from_py_with = arg)] modules: Option<BTreeMap<u32, String>>,
    #[pyo3(from_py_with = arg)] sigma: Option<f64>,
) -> PyResult<Bound<'py, PyList>> {
    let given: Option<Vec<_>> =
        modules.map(|modules| modules.into_iter().map(|(id, name)| (TaxelId(id), name)).collect());
    let found = run(py, 0, move |_| {
        let modules = |path| match &given {
            Some(modules) => Ok(modules.clone()),
            None => modules_of_skin(path).map(Option::unwrap_or_default),
        };
        let modules = [modules(&before)?, modules(&after)?];
        let options = DiffOptions { modules, sigma, ..DiffOptions::default() };
        let [before, after] = [&before, &after].map(|path| read_draft(path));
        dermatome::diff::diff(&before?, &after?, &options).map_err(dermatome::Error::from)
    })?;
    let all = PyList::empty(py);
    for Change {
        kind, subject, name, other, link, patch, taxels, others, distance, angle, sigmas, p, ..
    } in found.map_err(error)?.changes
    {
        let change = PyDict::new(py);
        change.set_item("kind", kind.to_string())?;
        change.set_item("subject", subject.to_string())?;
        change.set_item("name", name)?;
        change.set_item("other", other)?;
        change.set_item("link", link)?;
        change.set_item("patch", patch)?;
        change.set_item("taxels", vector(py, taxels.into_iter().map(|id| id.0)))?;
        change.set_item("others", vector(py, others.into_iter().map(|id| id.0)))?;
        for (key, value) in [("distance", distance), ("angle", angle), ("sigmas", sigmas), ("p", p)] {
            change.set_item(key, value)?;
        }
        all.append(change)?;
    }
    Ok(all)
}
