//! `ContactTracker`: what touches the skin, frame by frame.

use std::sync::{Mutex, MutexGuard, PoisonError};

use dermatome::body::BodyTaxel;
use dermatome::{
    id::VertexId,
    signal::{
        Channel, ContactEvent, ContactRegion, ContactTracker, Duplicates, Frame, Join, Probe, Rest,
        TrackerOptions, TrackerState,
    },
};
use numpy::PyUntypedArrayMethods;
use pyo3::{
    exceptions::PyTypeError,
    prelude::*,
    types::{PyDict, PyList},
};

use crate::{
    arguments::{arg, object},
    arrays::{Reduced, bad_shape, floats, made_by, one_each, vector},
    errors::{bad, error},
    map::PyMap,
    options::{count, probe, word},
};

/// Finds what touches the skin in frames of readings, and follows it from frame to frame.
///
/// Parameters
/// ----------
/// map : Map
///     The map.
/// unit : str
///     Unit of the readings, as "Pa" or "N"; forces are known for units of pressure and force.
/// probe : str
///     What touches the skin: "any", "finger" for fingers side by side, or "foot" for one contact a foot. A tracker of fingers cannot be pickled.
/// threshold : float, optional
///     A contact has a taxel above this, in the unit of the readings; by default estimated from the first frames,
///     in which nothing should touch the skin.
/// tared : bool
///     Whether readings are about 0 where nothing touches the skin, as those with `Readings.is_tared`; by default the mean of
///     the frames from which the threshold is estimated is subtracted.
/// low : float, optional
///     Its other taxels are above this share of the threshold; by default 0.5, of fingers 0.625.
/// least : int
///     A contact has at least this many taxels.
/// prominence : float
///     A region with several peaks is split where a part rises above the saddle by this share of its height.
/// part : int
///     Such a part has at least this many taxels above the saddle.
/// noise_frames : int
///     From how many frames the threshold is estimated.
/// reach : float
///     How far a contact may move from a frame to the next, in m.
/// lasting : int
///     How many frames a contact lasts at least.
///
/// Two taxels next to the same taxel without a reading (NaN) count as neighbours, so that a dead taxel does not cut a
/// contact in two. A tracker that is pickled or copied goes on with what it has learned and follows.
///
/// Raises
/// ------
/// DataError
///     If a unit or word is unknown, or a number is out of its range.
#[pyclass(frozen, module = "dermatome", name = "ContactTracker")]
#[derive(Debug)]
pub(crate) struct PyContactTracker {
    tracker: Mutex<(ContactTracker, Frame)>,
    join: Join,
    taxels: usize,
    map: Py<PyMap>,
    unit: String,
    options: TrackerOptions,
}

#[pymethods]
impl PyContactTracker {
    #[new]
    #[pyo3(signature = (map, *, unit="Pa", probe="any", threshold=None, tared=false, low=None, least=2, prominence=0.4,
        part=4, noise_frames=5, reach=0.01, lasting=1))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        #[pyo3(from_py_with = object)] map: &Bound<'_, PyMap>,
        #[pyo3(from_py_with = arg)] unit: &str,
        #[pyo3(from_py_with = arg)] probe: &str,
        #[pyo3(from_py_with = arg)] threshold: Option<f64>,
        #[pyo3(from_py_with = arg)] tared: bool,
        #[pyo3(from_py_with = arg)] low: Option<f64>,
        #[pyo3(from_py_with = arg)] least: i64,
        #[pyo3(from_py_with = arg)] prominence: f64,
        #[pyo3(from_py_with = arg)] part: i64,
        #[pyo3(from_py_with = arg)] noise_frames: i64,
        #[pyo3(from_py_with = arg)] reach: f64,
        #[pyo3(from_py_with = arg)] lasting: i64,
    ) -> PyResult<Self> {
        let (of, map) = (map, &map.get().map);
        let probe = self::probe(probe)?;
        let options = TrackerOptions {
            probe,
            channel: 0,
            threshold,
            low: low.unwrap_or(probe.low()),
            least: count("least", least)?,
            prominence,
            part: count("part", part)?,
            noise_frames: count("noise_frames", noise_frames)?,
            reach,
            lasting: count("lasting", lasting)?,
            rest: if tared { Rest::AtZero } else { Rest::Learned },
        };
        let channel = Channel::new("", unit).map_err(error)?;
        let tracker = ContactTracker::new(map, &channel, &options).map_err(error)?;
        let taxels = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let join = Join::new(map, None, taxels, Duplicates::Refuse).map_err(error)?;
        let tracker = Mutex::new((tracker, Frame::new(map, 1)));
        Ok(Self { tracker, join, taxels, map: of.clone().unbind(), unit: unit.to_owned(), options })
    }

    /// Find the contacts of the next frame.
    ///
    /// Parameters
    /// ----------
    /// values : (N,) array_like
    ///     Readings in the order of the map; NaN or infinite where there is none.
    /// time : float, optional
    ///     Time of the frame, in s; where it is before the last one, or long after it, all contacts end; without times frames count as 0.1 s apart, for `probe="finger"` and `at_once`.
    ///
    /// Returns
    /// -------
    /// list of dict
    ///     For each contact its `track`, `event` ("onset", "move" or "release"), `age`, `patch`, `link`, `taxels` (on that patch), `patches`, `beyond` (the taxels on other patches),
    ///     `area` (m^2), `force` (N), `centre` and `normal` (m, frame of the link), `uv` (m on the map), `major`,
    ///     `minor` (m), `angle` (rad), `peak_taxel` and `peak`.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the shape is another.
    #[pyo3(signature = (values, time=None))]
    fn track<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = arg)] time: Option<f64>,
    ) -> PyResult<Bound<'py, PyList>> {
        let values = floats("values", values)?;
        if values.shape() != [self.taxels] {
            return Err(bad_shape("values", values.shape(), format!("shape ({},)", self.taxels)));
        }
        let values = values.as_slice()?.to_vec();
        let regions = py.detach(|| {
            let (tracker, frame) = &mut *self.lock();
            self.join.fill(&values, frame);
            frame.time = time.unwrap_or(f64::NAN);
            tracker.track(frame).to_vec()
        });
        let contacts = PyList::empty(py);
        for region in &regions {
            contacts.append(self.contact(py, region)?)?;
        }
        Ok(contacts)
    }

    /// float or None: The threshold, given or estimated, in the unit of the readings; None while it is not known.
    #[getter]
    fn threshold(&self) -> Option<f64> {
        self.lock().0.threshold()
    }

    /// int: How many contacts the strongest touch so far had at once, voted over its frames.
    #[getter]
    fn at_once(&self) -> usize {
        self.lock().0.at_once()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        if self.options.probe == Probe::Finger {
            return Err(PyTypeError::new_err("cannot pickle a ContactTracker of fingers: it follows zeros"));
        }
        let TrackerState { threshold, learned, rest, contacts, next, memory } = self.lock().0.state();
        let state = PyDict::new(py);
        state.set_item("threshold", threshold)?;
        state.set_item("learned", vector(py, learned))?;
        state.set_item("rest", vector(py, rest))?;
        let contacts =
            contacts.iter().map(|region| self.contact(py, region)).collect::<PyResult<Vec<_>>>()?;
        state.set_item("contacts", contacts)?;
        state.set_item("next", next)?;
        state.set_item("memory", vector(py, memory))?;
        let TrackerOptions {
            probe,
            channel: _,
            threshold,
            low,
            least,
            prominence,
            part,
            rest,
            noise_frames,
            reach,
            lasting,
        } = self.options;
        let options = PyDict::new(py);
        options.set_item("unit", &self.unit)?;
        options.set_item("probe", if probe == Probe::Foot { "foot" } else { "any" })?;
        options.set_item("threshold", threshold)?;
        options.set_item("tared", rest == Rest::AtZero)?;
        options.set_item("low", low)?;
        options.set_item("least", least)?;
        options.set_item("prominence", prominence)?;
        options.set_item("part", part)?;
        options.set_item("noise_frames", noise_frames)?;
        options.set_item("reach", reach)?;
        options.set_item("lasting", lasting)?;
        made_by(py, "tracker", (self.map.clone_ref(py), options, state))
    }

    fn _resume(&self, state: &Bound<'_, PyDict>) -> PyResult<()> {
        fn item<'py, T: FromPyObjectOwned<'py>>(of: &Bound<'py, PyDict>, name: &str) -> PyResult<T> {
            let found = of
                .get_item(name)?
                .ok_or_else(|| bad("state", format!("no {name:?}"), "that of a tracker"))?;
            found.extract().map_err(Into::into)
        }
        let numbers = |of: &Bound<'_, PyDict>, name| -> PyResult<Vec<f64>> {
            let array: Bound<'_, PyAny> = item(of, name)?;
            one_each(name, &array, array.len()?)
        };
        let vertices = |of: &Bound<'_, PyDict>| -> PyResult<Vec<VertexId>> {
            Ok(item::<Vec<u32>>(of, "taxels")?.into_iter().map(VertexId::from).collect())
        };
        let map = self.map.get();
        let region = |contact: &Bound<'_, PyDict>| -> PyResult<ContactRegion> {
            let patch = map.patch_named(&item::<String>(contact, "patch")?)?;
            let mut beyond = Vec::new();
            for (name, taxels) in &item::<Bound<'_, PyDict>>(contact, "beyond")? {
                let patch = map.patch_named(&name.extract::<String>()?)?;
                let taxels = taxels.extract::<Vec<u32>>()?.into_iter().map(VertexId::from);
                beyond.extend(taxels.map(|taxel| BodyTaxel { patch, taxel }));
            }
            let event: String = item(contact, "event")?;
            Ok(ContactRegion {
                track: item(contact, "track")?,
                event: word(
                    "event",
                    &event,
                    &[("onset", ContactEvent::Onset), ("move", ContactEvent::Move)],
                )?,
                age: item(contact, "age")?,
                patch,
                link: map.map.patches[patch].link,
                taxels: vertices(contact)?,
                beyond,
                area: item(contact, "area")?,
                force: item(contact, "force")?,
                centre: item::<[f64; 3]>(contact, "centre")?.into(),
                normal: item::<[f64; 3]>(contact, "normal")?.into(),
                map: item::<[f64; 2]>(contact, "uv")?.into(),
                major: item(contact, "major")?,
                minor: item(contact, "minor")?,
                angle: item(contact, "angle")?,
                peak_taxel: VertexId::from(item::<u32>(contact, "peak_taxel")?),
                peak: item(contact, "peak")?,
            })
        };
        let contacts: Vec<Bound<'_, PyDict>> = item(state, "contacts")?;
        let state = TrackerState {
            threshold: item(state, "threshold")?,
            learned: numbers(state, "learned")?,
            rest: numbers(state, "rest")?,
            contacts: contacts.iter().map(region).collect::<PyResult<_>>()?,
            next: item(state, "next")?,
            memory: numbers(state, "memory")?,
        };
        self.lock().0.resume(state).map_err(error)
    }

    fn __repr__(&self) -> String {
        let (tracker, _) = &*self.lock();
        let threshold =
            tracker.threshold().map_or("not known yet".to_owned(), |x| format!("{x} {}", self.unit));
        format!("<dermatome.ContactTracker: {} contacts, threshold {threshold}>", tracker.contacts().len())
    }
}

impl PyContactTracker {
    fn lock(&self) -> MutexGuard<'_, (ContactTracker, Frame)> {
        self.tracker.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn contact<'py>(&self, py: Python<'py>, region: &ContactRegion) -> PyResult<Bound<'py, PyDict>> {
        let contact = PyDict::new(py);
        let event = match region.event {
            ContactEvent::Onset => "onset",
            ContactEvent::Move => "move",
            ContactEvent::Release => "release",
        };
        contact.set_item("track", region.track)?;
        contact.set_item("event", event)?;
        contact.set_item("age", region.age)?;
        let map = &self.map.get().map;
        contact.set_item("patch", &map.patches[region.patch].name)?;
        contact.set_item("link", &map.links[region.link].name)?;
        contact.set_item("taxels", vector(py, region.taxels.iter().map(|taxel| taxel.raw())))?;
        let names = region.patches().into_iter().map(|patch| map.patches[patch].name.clone());
        contact.set_item("patches", names.collect::<Vec<_>>())?;
        let beyond = PyDict::new(py);
        for part in region.beyond.chunk_by(|a, b| a.patch == b.patch) {
            let taxels = vector(py, part.iter().map(|at| at.taxel.raw()));
            beyond.set_item(&map.patches[part[0].patch].name, taxels)?;
        }
        contact.set_item("beyond", beyond)?;
        contact.set_item("area", region.area)?;
        contact.set_item("force", region.force)?;
        contact.set_item("centre", vector(py, region.centre.to_array()))?;
        contact.set_item("normal", vector(py, region.normal.to_array()))?;
        contact.set_item("uv", vector(py, region.map.to_array()))?;
        contact.set_item("major", region.major)?;
        contact.set_item("minor", region.minor)?;
        contact.set_item("angle", region.angle)?;
        contact.set_item("peak_taxel", region.peak_taxel.raw())?;
        contact.set_item("peak", region.peak)?;
        Ok(contact)
    }
}
