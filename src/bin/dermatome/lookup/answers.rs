//! Contacts to rows: where each lies on every level.

use std::io::Write;
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use dermatome::contact::{Cell, ContactError, ContactIndex, Hit, Hits, ON_SKIN_SPACINGS, Query, Refine};
use dermatome::io::{IoError, LookupPlace, LookupRow, LookupWriter};
use dermatome::pyramid::LevelId;
use dermatome::skin::{LinkId, PatchId, Presence};
use glam::DVec3;

use crate::console::notes::{note, note_count};
use crate::lookup::contacts::{Batch, Contact, Contacts, WORLD};
use crate::lookup::player::Player;
use crate::lookup::readings::{Counts, Readings};
use crate::lookup::refusals::unanswered;
use crate::lookup::robot::Robot;
use crate::options::Common;

/// If most contacts are farther than this many spacings from the skin, they may be in another frame or
/// unit: a note asks.
const DOUBTFUL: f64 = 3.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Question {
    /// The nearest point of the skin, exactly.
    Nearest,
    /// How far the skin is, in constant time.
    Reactive,
    /// This many nearest fields of each level.
    Fields(usize),
    /// The fields of each level within this distance, in m.
    Within(f64),
    /// Where the ray along its normal meets the skin first.
    Ray,
}

/// Answers contacts, some at a time, so that memory does not grow with their number.
pub(super) struct Answers<'a> {
    robot: &'a Robot,
    index: ContactIndex,
    question: Question,
    /// Distance up to which a contact is on the skin, in m; `None`: [`ON_SKIN_SPACINGS`] of the patch.
    max_distance: Option<f64>,
    player: Player,
    readings: Option<Readings>,
    /// On each level, how many contacts lie in a field whose centre reads no pressure.
    silent: Vec<AtomicU64>,
    /// Contacts that are off the skin.
    far: AtomicU64,
    /// Contacts on the skin that are farther from it than [`DOUBTFUL`] spacings of the patch.
    doubtful: AtomicU64,
    /// Fields that are answers but belong to no face, and have no row.
    faceless: AtomicU64,
    /// What is not in the readings, if there are any.
    pressed: Option<Counts>,
}

impl<'a> Answers<'a> {
    pub(super) fn new(
        robot: &'a Robot,
        index: ContactIndex,
        question: Question,
        max_distance: Option<f64>,
        player: Player,
    ) -> Self {
        let silent = robot.levels.iter().map(|_| AtomicU64::new(0)).collect();
        let far = AtomicU64::new(0);
        Self {
            robot,
            index,
            question,
            max_distance,
            player,
            readings: None,
            silent,
            far,
            doubtful: AtomicU64::new(0),
            faceless: AtomicU64::new(0),
            pressed: None,
        }
    }

    /// Writes the forces of the contacts as readings too.
    pub(super) fn with_readings(self, readings: Option<Readings>) -> Self {
        Self { readings, ..self }
    }

    /// Whether a contact that is this far from a patch, in m, is off the skin.
    fn is_far(&self, patch: PatchId, away: f64) -> bool {
        away > self.max_distance.unwrap_or_else(|| ON_SKIN_SPACINGS * self.spacing(patch))
    }

    fn spacing(&self, patch: PatchId) -> f64 {
        self.index.spacing(patch).unwrap_or(0.0)
    }

    pub(super) fn answer(
        &mut self,
        contacts: &mut Contacts<'_>,
        path: &Path,
        output: impl Write + Send,
    ) -> Result<(), IoError> {
        let extra = (self.question == Question::Reactive).then_some("least,most");
        let mut table = LookupWriter::new(path, output, extra)?;
        self.player.start(&mut self.index)?;
        let robot = self.robot;
        let mut batch = contacts.batch(robot)?;
        while !batch.contacts.is_empty() {
            // The next rows are read while these are answered.
            let (next, written) = rayon::join(|| contacts.batch(robot), || self.write(&batch, &mut table));
            written?;
            batch = next?;
        }
        contacts.refusals.check_any()?;
        if let Some(readings) = self.readings.take() {
            self.pressed = Some(readings.finish(&contacts.refusals.path)?);
        }
        table.finish()
    }

    /// Writes the rows of a batch, those of equal times together.
    fn write(&mut self, batch: &Batch, table: &mut LookupWriter<'_, impl Write>) -> Result<(), IoError> {
        let is_timed = self.player.is_timed();
        let mut from = 0;
        for part in batch.contacts.chunk_by(|a, b| !is_timed || a.time == b.time) {
            let queries = &batch.queries[from..from + part.len()];
            from += part.len();
            self.player.pose(&mut self.index, part[0].time, part.len())?;
            self.write_part(part, queries, table)?;
            if let Some(readings) = &mut self.readings {
                readings.add(&self.index, part, queries)?;
            }
        }
        Ok(())
    }

    fn write_part(
        &self,
        contacts: &[Contact],
        queries: &[Query],
        table: &mut LookupWriter<'_, impl Write>,
    ) -> Result<(), IoError> {
        let hits = match self.question {
            Question::Nearest => self.index.locate_all(queries).map_err(unanswered)?,
            _ => Hits::default(),
        };
        // Contacts are checked as they are read: an error is one about all of them.
        let failed = OnceLock::new();
        table.write(contacts.len(), |k, emit| {
            let mut rows = Rows { answers: self, contact: &contacts[k], query: queries[k], emit };
            let answered = match self.question {
                Question::Nearest => {
                    if let Some(hit) = hits.get(k) {
                        rows.nearest(&hit);
                    }
                    Ok(())
                }
                Question::Reactive => rows.reactive(),
                Question::Fields(_) | Question::Within(_) => rows.fields(),
                Question::Ray => rows.ray(),
            };
            if let Err(error) = answered {
                _ = failed.set(error);
            }
        })?;
        failed.into_inner().map_or(Ok(()), |error| Err(unanswered(error)))
    }

    /// Notes on what was found; the one on contacts far from the skin ends with `ask`.
    pub(super) fn note(&self, contacts: &Contacts<'_>, ask: &str, common: &Common) {
        let counts = self.silent.iter().map(|n| n.load(Ordering::Relaxed));
        let counts = self.robot.levels.iter().zip(counts).filter(|(_, count)| *count > 0);
        let counts: Vec<_> = counts.map(|(level, count)| format!("{count} on level {level}")).collect();
        if !counts.is_empty() {
            let what = "contacts in a field whose centre is an absent taxel or a thermal pad";
            note!(common, "{what}: {}", counts.join(", "));
        }
        let answered = contacts.refusals.answered();
        let far = self.far.load(Ordering::Relaxed);
        let doubtful = self.doubtful.load(Ordering::Relaxed);
        if 2 * far > answered {
            let limit = match (self.question, self.max_distance) {
                (Question::Ray, _) => "their rays meet none".into(),
                (Question::Within(_), _) => "no centre of a field is near".into(),
                (_, Some(limit)) => format!("by more than {limit} m"),
                _ => format!("by more than {ON_SKIN_SPACINGS} spacings of its taxels"),
            };
            note!(common, "{far} of {answered} contacts are off the skin, {limit}{ask}");
        } else if 2 * (far + doubtful) > answered {
            let what = format_args!("contacts are more than {DOUBTFUL} spacings of taxels from the skin");
            note!(common, "{} of {answered} {what}{ask}", far + doubtful);
        }
        let how = "without a row: the field belongs to no face";
        note_count(common, self.faceless.load(Ordering::Relaxed), "answers", how);
        self.player.note("contacts", common);
        if let Some(pressed) = &self.pressed {
            pressed.note(common);
        }
    }
}

struct Rows<'a, 'b> {
    answers: &'b Answers<'a>,
    contact: &'b Contact,
    query: Query,
    emit: &'b mut dyn FnMut(&LookupRow<'_>),
}

impl<'a> Rows<'a, '_> {
    /// A row for each level of the nearest point.
    fn nearest(&mut self, hit: &Hit) {
        let answers = self.answers;
        let away = hit.distance.abs();
        if answers.is_far(hit.patch, away) {
            return self.off_skin(hit);
        }
        self.count_doubtful(hit.patch, away);
        for (k, &level) in answers.robot.levels.iter().enumerate() {
            let Some(cell) = answers.index.cell(hit, level) else { continue };
            let place = self.place(hit.patch, hit.link, cell, hit.position, hit.normal);
            if place.presence != Presence::Present {
                answers.silent[k].fetch_add(1, Ordering::Relaxed);
            }
            self.row(level, hit.distance, Some(place), &[]);
        }
    }

    /// Counts a contact on the skin that is this far from a patch, in m, if that is far.
    fn count_doubtful(&self, patch: PatchId, away: f64) {
        let answers = self.answers;
        if answers.max_distance.is_none() && away > DOUBTFUL * answers.spacing(patch) {
            answers.doubtful.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn place(
        &self,
        patch: PatchId,
        link: LinkId,
        cell: Cell,
        position: DVec3,
        normal: DVec3,
    ) -> LookupPlace<'a> {
        let Robot { patches, links, live, .. } = self.answers.robot;
        let (presence, live_taxel) = live.nearest(patch, &cell);
        let (patch, link) = (&patches[patch], &links[link]);
        LookupPlace { patch, link, cell, presence, live_taxel, position, normal }
    }

    fn row(&mut self, level: LevelId, distance: f64, place: Option<LookupPlace<'_>>, extra: &[f64]) {
        let frame = self.query.link.map_or(WORLD, |link| &self.answers.robot.links[link]);
        let contact = self.contact.number;
        (self.emit)(&LookupRow { contact, level, distance, frame, place, extra });
    }

    /// How far the skin is, and a row for each level of a point near the nearest; the coarsest level of a patch answers once for
    /// those that it does not reach up to.
    fn reactive(&mut self) -> Result<(), ContactError> {
        let Answers { robot, index, .. } = self.answers;
        let answer = index.reactive(self.query)?;
        let Some(hit) = index.hit_of(self.query, &answer, Refine::Walk) else { return Ok(()) };
        let answer = answer.narrowed(&hit);
        let is_far = self.answers.is_far(answer.patch, answer.least);
        if is_far {
            self.answers.far.fetch_add(1, Ordering::Relaxed);
        } else {
            self.count_doubtful(answer.patch, answer.least);
        }
        let mut given = None;
        let patch = &robot.map.patches[answer.patch];
        for level in robot.levels.iter().map(|&level| patch.nearest_level(level)) {
            let Some(cell) = index.cell(&hit, level).filter(|_| given != Some(level)) else { continue };
            given = Some(level);
            let place = self.place(answer.patch, answer.link, cell, hit.position, hit.normal);
            self.row(level, answer.distance, (!is_far).then_some(place), &[answer.least, answer.most]);
        }
        Ok(())
    }

    /// The fields near the contact, or within the sphere of its radius.
    fn fields(&mut self) -> Result<(), ContactError> {
        let Answers { robot, index, question, max_distance, .. } = self.answers;
        let mut is_far = true;
        for &level in &robot.levels {
            let found = match question {
                Question::Within(distance) => {
                    let radius = distance + self.contact.radius.unwrap_or(0.0);
                    index.fields_within(self.query, radius, level)
                }
                Question::Fields(count) => index.nearest_fields(self.query, *count, level),
                _ => Ok(Vec::new()),
            };
            for field in found? {
                if max_distance.is_some_and(|most| field.distance > most) {
                    continue;
                }
                is_far = false;
                let Some(cell) = index.cell(&field, level) else {
                    self.answers.faceless.fetch_add(1, Ordering::Relaxed);
                    continue;
                };
                let place = self.place(field.patch, field.link, cell, field.position, field.normal);
                self.row(level, field.distance, Some(place), &[]);
            }
        }
        if !is_far && max_distance.is_some() {
            return Ok(());
        }
        let hit = index.locate(self.query)?;
        if is_far {
            self.off_skin(&hit);
        } else {
            self.count_doubtful(hit.patch, hit.distance.abs());
        }
        Ok(())
    }

    /// Where the ray along the contact's normal meets the skin.
    fn ray(&mut self) -> Result<(), ContactError> {
        let Answers { robot, index, max_distance, .. } = self.answers;
        let direction = self.contact.normal.unwrap_or_default();
        let longest = max_distance.unwrap_or(f64::INFINITY);
        let Some(hit) = index.first_hit(self.query, direction, longest)? else {
            self.off_skin(&index.locate(self.query)?);
            return Ok(());
        };
        for &level in &robot.levels {
            let Some(cell) = index.cell(&hit, level) else { continue };
            let place = self.place(hit.patch, hit.link, cell, hit.position, hit.normal);
            self.row(level, hit.distance, Some(place), &[]);
        }
        Ok(())
    }

    /// The rows of a contact off the skin: its distance from there on each level.
    fn off_skin(&mut self, hit: &Hit) {
        self.answers.far.fetch_add(1, Ordering::Relaxed);
        for &level in &self.answers.robot.levels {
            self.row(level, hit.distance, None, &[]);
        }
    }
}
