//! Contacts to rows: where each lies on every level.

use std::collections::HashSet;
use std::io::Write;
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use dermatome::contact::{Cell, ContactError, ContactIndex, Hit, Hits, ON_SKIN_SPACINGS, Query, Refine};
use dermatome::io::{IoError, LookupPlace, LookupRow, LookupWriter};
use dermatome::pyramid::LevelId;
use dermatome::run::Run;
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
    /// Whether answers keep the times of contacts.
    has_times: bool,
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
        let levels = robot.levels.last().map_or(0, |last| last.index() + 1);
        let silent = (0..levels).map(|_| AtomicU64::new(0)).collect();
        let far = AtomicU64::new(0);
        Self {
            robot,
            index,
            question,
            max_distance,
            player,
            readings: None,
            silent,
            has_times: false,
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
        let range = (self.question == Question::Reactive).then_some("least,most");
        let columns: Vec<&str> = range.into_iter().chain(contacts.has_times.then_some("time")).collect();
        let extra = columns.join(",");
        let mut table = LookupWriter::new(path, output, (!extra.is_empty()).then_some(&*extra))?;
        self.has_times = contacts.has_times;
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
            Question::Nearest => self.index.locate_all(queries, Run::default()).map_err(unanswered)?,
            _ => Hits::default(),
        };
        // Contacts are checked as they are read: an error is one about all of them.
        let failed = OnceLock::new();
        table.write(contacts.len(), |k, emit| {
            let mut rows = AnswerRows { answers: self, contact: &contacts[k], query: queries[k], emit };
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
        let counts = self.silent.iter().map(|n| n.load(Ordering::Relaxed)).enumerate();
        let counts = counts.filter(|(_, count)| *count > 0);
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

/// A level, and its name if it has no mesh.
type RowLevel<'a> = (LevelId, Option<&'a str>);

struct AnswerRows<'a, 'b> {
    answers: &'b Answers<'a>,
    contact: &'b Contact,
    query: Query,
    emit: &'b mut dyn FnMut(&LookupRow<'_>),
}

impl<'a> AnswerRows<'a, '_> {
    /// A row for each level of the nearest point.
    fn nearest(&mut self, hit: &Hit) {
        let answers = self.answers;
        let away = hit.distance.abs();
        if answers.is_far(hit.patch, away) {
            return self.off_skin(hit);
        }
        self.count_doubtful(hit.patch, away);
        self.on_levels(hit, |rows, level, place| {
            let silent = rows.answers.silent.get(level.0.index()).filter(|_| level.1.is_none());
            let is_silent = place.as_ref().is_some_and(|place| place.presence != Presence::Present);
            if let Some(silent) = silent.filter(|_| is_silent) {
                silent.fetch_add(1, Ordering::Relaxed);
            }
            rows.row(level, hit.distance, place, []);
        });
    }

    /// Calls `visit` with where a hit is on each level of its patch, and on those without a mesh: nowhere if its patch has no
    /// such fields.
    fn on_levels(
        &mut self,
        hit: &Hit,
        mut visit: impl FnMut(&mut Self, RowLevel<'a>, Option<LookupPlace<'a>>),
    ) {
        let answers = self.answers;
        for level in answers.robot.levels_of(hit.patch) {
            let Some(cell) = answers.index.cell(hit, level) else { continue };
            let place = self.place(hit.patch, hit.link, cell, hit.position, hit.normal);
            visit(self, (level, None), Some(place));
        }
        for fields in &answers.robot.fields {
            let Some(finest) = answers.index.cell(hit, LevelId::default()) else { continue };
            let place = fields.cell(hit.patch, &finest).map(|(cell, presence, region)| LookupPlace {
                cell,
                presence,
                region,
                ..self.place(hit.patch, hit.link, finest, hit.position, hit.normal)
            });
            visit(self, (fields.level, Some(&fields.name)), place);
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
        let robot = self.answers.robot;
        let (presence, live_taxel) = robot.live.nearest(patch, &cell);
        let region = robot.region(patch, &cell);
        let (patch, link) = (&robot.patches[patch], &robot.links[link]);
        LookupPlace { patch, link, region, cell, presence, live_taxel, position, normal }
    }

    fn row<const N: usize>(
        &mut self,
        (level, fields): RowLevel<'_>,
        distance: f64,
        place: Option<LookupPlace<'_>>,
        range: [f64; N],
    ) {
        let frame = self.query.link.map_or(WORLD, |link| &self.answers.robot.links[link]);
        let contact = self.contact.number;
        let mut extra = [f64::NAN; 3];
        extra[..N].copy_from_slice(&range);
        extra[N] = self.contact.time.unwrap_or(f64::NAN);
        let extra = &extra[..N + usize::from(self.answers.has_times)];
        (self.emit)(&LookupRow { contact, level, fields, distance, frame, place, extra });
    }

    /// How far the skin is, and a row for each level of a point near the nearest.
    fn reactive(&mut self) -> Result<(), ContactError> {
        let Answers { index, .. } = self.answers;
        let answer = index.reactive(self.query)?;
        let Some(hit) = index.hit_of(self.query, &answer, Refine::Walk) else { return Ok(()) };
        let answer = answer.narrowed(&hit);
        let is_far = self.answers.is_far(answer.patch, answer.least);
        if is_far {
            self.answers.far.fetch_add(1, Ordering::Relaxed);
        } else {
            self.count_doubtful(answer.patch, answer.least);
        }
        self.on_levels(&hit, |rows, level, place| {
            rows.row(level, answer.distance, place.filter(|_| !is_far), [answer.least, answer.most]);
        });
        Ok(())
    }

    /// The fields near the contact, or within the sphere of its radius.
    fn fields(&mut self) -> Result<(), ContactError> {
        let Answers { robot, index, question, max_distance, .. } = self.answers;
        let (mut is_far, mut seen) = (true, HashSet::new());
        let coarsest = robot.levels.last().copied().unwrap_or_default();
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
                // The coarsest level of a patch also answers for those that it does not reach up to.
                let is_shared = robot.map.patches[field.patch].nearest_level(coarsest) == field.level;
                let is_shared = is_shared && field.level < coarsest;
                if is_shared && !seen.insert((field.patch, field.level, field.field)) {
                    continue;
                }
                let Some(cell) = index.cell(&field, field.level) else {
                    self.answers.faceless.fetch_add(1, Ordering::Relaxed);
                    continue;
                };
                let place = self.place(field.patch, field.link, cell, field.position, field.normal);
                self.row((field.level, None), field.distance, Some(place), []);
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
        let Answers { index, max_distance, .. } = self.answers;
        let direction = self.contact.normal.unwrap_or_default();
        let longest = max_distance.unwrap_or(f64::INFINITY);
        let Some(hit) = index.first_hit(self.query, direction, longest)? else {
            self.off_skin(&index.locate(self.query)?);
            return Ok(());
        };
        self.on_levels(&hit, |rows, level, place| rows.row(level, hit.distance, place, []));
        Ok(())
    }

    /// The rows of a contact off the skin: its distance from there on each level.
    fn off_skin(&mut self, hit: &Hit) {
        self.answers.far.fetch_add(1, Ordering::Relaxed);
        let Robot { levels, fields, .. } = self.answers.robot;
        let named = fields.iter().map(|fields| (fields.level, Some(&*fields.name)));
        for level in levels.iter().map(|&level| (level, None)).chain(named) {
            self.row(level, hit.distance, None, []);
        }
    }
}
