//! What touches do, in words: `render --events`.

use std::sync::Arc;

use dermatome::Error;
use dermatome::io::read_body_words;
use dermatome::map::SkinMap;
use dermatome::recording::Step;
use dermatome::signal::{
    BodyWord, Event, EventContact, EventDetector, EventOptions, EventPlace, Phase, SignalError, Word,
};
use serde_json::{Map, Value, json};

use crate::console::errors::advise;
use crate::console::notes::note_columns;
use crate::console::print::{json_line, print};
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, InPath, OutFile};
use crate::readings::positive;

/// Which events are found.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Events")]
#[group(requires = "events")]
pub(super) struct EventsArgs {
    /// Also say in words what touches do (touch, tap, press, hold, stroke, rub, pat, grasp, hit), a line of JSON for each
    /// begin, change and end; `-`: on standard output, as they happen
    #[arg(long, value_name = "E.jsonl")]
    events: Option<OutFile>,
    /// Names of directions on links, for strokes: a table with columns link,x,y,z,word
    #[arg(long, value_name = "B.csv")]
    body_words: Option<InPath>,
    /// A contact whose force exceeds this at once is a hit; the readings must give forces [default: no hits]
    #[arg(long, value_name = "N", value_parser = positive)]
    hit_n: Option<f64>,
}

/// Finds and writes events.
pub(super) struct Events {
    map: Arc<SkinMap>,
    detector: EventDetector,
    /// The episode of the frames, if the recording has several.
    episode: Option<u64>,
    words: Vec<BodyWord>,
    path: OutFile,
    /// The lines, unless they are printed.
    lines: String,
    count: usize,
}

impl EventsArgs {
    pub(super) fn is_given(&self) -> bool {
        self.events.is_some()
    }

    /// Refuses, before any work, a file of another kind.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        match &self.events {
            Some(path) if !is_stream(path) && outputs::kind(path) != "jsonl" => Err(advise(
                format!("{} is no file of lines of JSON", path.display()),
                "name a file that ends in .jsonl, or - for standard output",
            )),
            _ => Ok(()),
        }
    }

    pub(super) fn open(&self, map: &Arc<SkinMap>, common: &Common) -> anyhow::Result<Option<Events>> {
        let Some(path) = &self.events else { return Ok(None) };
        let mut words = Vec::new();
        if let Some(path) = &self.body_words {
            let (read, unused) = read_body_words(path, map).map_err(Error::from)?;
            words = read;
            note_columns(path, &unused, common);
        }
        let options = EventOptions { hit_n: self.hit_n, words: words.clone(), ..EventOptions::default() };
        let detector = EventDetector::new(map, options).map_err(Error::from)?;
        let (map, path) = (Arc::clone(map), path.clone());
        Ok(Some(Events { map, detector, episode: None, words, path, lines: String::new(), count: 0 }))
    }
}

impl Events {
    /// The frames that follow are of this episode: what goes on ends with the one before.
    pub(super) fn begin_episode(&mut self, number: u64) -> anyhow::Result<()> {
        if self.episode.is_some_and(|before| before != number) {
            self.end()?;
            let options = self.detector.options().clone();
            self.detector = EventDetector::new(&self.map, options).map_err(Error::from)?;
        }
        self.episode = Some(number);
        Ok(())
    }

    /// Ends what goes on.
    fn end(&mut self) -> anyhow::Result<()> {
        let events = self.detector.finish().to_vec();
        self.put(&events)
    }

    /// Finds the events of a frame, and writes them.
    pub(super) fn write(&mut self, step: &Step<'_>) -> anyhow::Result<()> {
        let Some(tracker) = step.tracker else { return Ok(()) };
        let found = self.detector.see(step.frame.time, tracker);
        let events = found.map_err(|error| match error {
            SignalError::NoEventTime => advise(error.to_string(), "give --rate HZ"),
            other => Error::from(other).into(),
        })?;
        if events.is_empty() {
            return Ok(());
        }
        let events = events.to_vec();
        self.put(&events)
    }

    /// Ends what goes on, completes the file, and counts the events that have ended.
    pub(super) fn finish(mut self, common: &Common) -> anyhow::Result<usize> {
        self.end()?;
        if !is_stream(&self.path) {
            outputs::write_bytes(&common.outputs.file(&self.path), self.lines.as_bytes())
                .map_err(Error::from)?;
        }
        Ok(self.count)
    }

    fn put(&mut self, events: &[Event]) -> anyhow::Result<()> {
        let line = |event: &Event| line(event, self.episode, &self.map, &self.words);
        let lines: String = events.iter().map(line).collect::<Result<_, _>>()?;
        self.count += events.iter().filter(|event| event.phase == Phase::End).count();
        if is_stream(&self.path) && !lines.is_empty() {
            return print(&lines);
        }
        self.lines.push_str(&lines);
        Ok(())
    }
}

/// A line of JSON: `dermatome.event/1` of docs/json.md.
fn line(
    event: &Event,
    episode: Option<u64>,
    map: &SkinMap,
    words: &[BodyWord],
) -> serde_json::Result<String> {
    let mut object = Map::new();
    let mut put = |key: &str, value: Value| object.insert(key.to_owned(), value);
    if let Some(number) = episode {
        put("episode", json!(number));
    }
    put("event", json!(<&str>::from(event.word)));
    put("phase", json!(<&str>::from(event.phase)));
    if let [contact] = event.contacts[..] {
        put("contact", json!(contact));
    } else if !event.contacts.is_empty() {
        put("contacts", json!(event.contacts));
    }
    for (key, value) in [("time", event.time), ("begin", event.begin), ("duration", event.duration)] {
        put(key, json!(value));
    }
    if let Some(contact) = &event.contact {
        describe(contact, event, map, words, &mut object);
    }
    json_line("dermatome.event/1", &object)
}

fn describe(
    contact: &EventContact,
    event: &Event,
    map: &SkinMap,
    words: &[BodyWord],
    object: &mut Map<String, Value>,
) {
    let mut put = |key: &str, value: Value| object.insert(key.to_owned(), value);
    let patch = &map.patches[contact.patch];
    put("patch", json!(patch.name));
    put("link", json!(map.links[contact.link].name));
    if contact.patches.len() > 1 {
        put("patches", contact.patches.iter().map(|&patch| json!(map.patches[patch].name)).collect());
    }
    let region = patch.taxels.regions.as_ref().and_then(|all| all[contact.peak_taxel].as_deref());
    if let Some(region) = region {
        put("region", json!(region));
    }
    // Without a unit of force or pressure there is no force.
    if contact.force_peak.is_finite() {
        put("force_peak", json!(contact.force_peak));
        put("force_mean", json!(contact.force_mean));
        put("impulse", json!(contact.impulse));
    }
    put("area", json!(contact.area));
    let place = |place: EventPlace| {
        let EventPlace { point, patch, map: at } = place;
        let mut object = json!({ "x": point.x, "y": point.y, "z": point.z, "u": at.x, "v": at.y });
        if patch != contact.patch {
            object["patch"] = json!(map.patches[patch].name);
        }
        object
    };
    put("from", place(contact.from));
    put("to", place(contact.to));
    put("length", json!(contact.length));
    if let Some(direction) = contact.direction {
        put("direction", json!(direction));
    }
    if matches!(event.word, Word::Stroke | Word::Rub) && event.duration > 0.0 {
        put("speed", json!(contact.length / event.duration));
    }
    if let Some(word) = contact.body_word {
        put("words", json!([words[word].word]));
    }
    put("taxels", contact.taxels.iter().map(|&taxel| json!(patch.taxels.ids[taxel].0)).collect());
    if !contact.beyond.is_empty() {
        let mut beyond = Map::new();
        for part in contact.beyond.chunk_by(|a, b| a.patch == b.patch) {
            let patch = &map.patches[part[0].patch];
            let ids = part.iter().map(|at| json!(patch.taxels.ids[at.taxel].0)).collect();
            beyond.insert(patch.name.clone(), ids);
        }
        put("beyond", beyond.into());
    }
}
