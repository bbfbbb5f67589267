//! The table of contacts, read some rows at a time.

use std::path::Path;

use clap::ValueEnum;
use dermatome::Error;
use dermatome::contact::Query;
use dermatome::io::{ContactRow, IoError, read_contacts};
use dermatome::skin::LinkId;
use glam::DVec3;

use crate::console::notes::{first_names, note, note_columns};
use crate::files::input::open_input;
use crate::lookup::refusals::Refusals;
use crate::lookup::robot::Robot;
use crate::options::{Common, Unit};

/// Contacts read, answered and written at a time: enough for every thread, and a few megabytes.
const BATCH: usize = 1 << 14;

/// Coordinates and radii of contacts are no larger, in m, nor are forces, in N.
pub(super) const LARGEST: f64 = 1e12;

/// Which frame contacts are in that name no link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum FrameArg {
    /// The world
    World,
    /// The frame of the link with skin, where the map has one alone
    Link,
}

/// A contact as read.
pub(super) struct Contact {
    /// Place in the table, from 0; refused rows count.
    pub(super) number: u64,
    pub(super) normal: Option<DVec3>,
    /// In N.
    pub(super) force: Option<f64>,
    /// In m.
    pub(super) radius: Option<f64>,
    /// In s.
    pub(super) time: Option<f64>,
}

#[derive(Default)]
pub(super) struct Batch {
    pub(super) contacts: Vec<Contact>,
    pub(super) queries: Vec<Query>,
}

/// Columns that are read and checked, but may change nothing in the answer.
const OPTIONAL: [&str; 3] = ["nx,ny,nz", "force", "radius"];

/// The place of `nx,ny,nz` among them.
const NORMAL: usize = 0;

/// Where a row names its link, for errors.
const LINK: &str = "column `link`";

/// Where a row names the only link that it can be on.
const ONLY_LINK: &str = "column `only_link`";

/// Where an answer names its frame.
const FRAME: &str = "column `frame`";

pub(super) const WORLD: &str = "world";

/// What the command line says of a table.
pub(super) struct Meaning {
    pub(super) unit: Unit,
    pub(super) frame: FrameArg,
}

pub(super) struct Contacts<'a> {
    rows: Box<dyn Iterator<Item = Result<ContactRow, IoError>> + Send + 'a>,
    meaning: Meaning,
    pub(super) has_times: bool,
    /// Which of [`OPTIONAL`] change the answer.
    used: [bool; OPTIONAL.len()],
    /// Which of [`OPTIONAL`] some contact has.
    given: [bool; OPTIONAL.len()],
    pub(super) refusals: Refusals,
}

impl Contacts<'_> {
    /// Opens a table of which the columns `used` change the answer besides `x,y,z`, `link` and `only_link`.
    pub(super) fn open(
        path: &Path,
        meaning: Meaning,
        used: &[&str],
        common: &Common,
    ) -> anyhow::Result<Self> {
        let (name, input) = open_input(path)?;
        let (unknown, rows) = read_contacts(name, input).map_err(Error::from)?;
        note_columns(name, &unknown, common);
        Ok(Self {
            has_times: rows.has_times(),
            rows: Box::new(rows),
            meaning,
            used: OPTIONAL.map(|column| used.contains(&column)),
            given: [false; OPTIONAL.len()],
            refusals: Refusals::new(name.to_owned()),
        })
    }

    /// The next rows that can be answered; none: the table has ended.
    pub(super) fn batch(&mut self, robot: &Robot) -> Result<Batch, IoError> {
        let mut batch = Batch::default();
        while batch.contacts.len() < BATCH {
            let Some(row) = self.rows.next() else { break };
            let metres = self.meaning.unit.metres();
            let row = row.and_then(|mut row| {
                row.radius = row.radius.map(|radius| radius * metres);
                let query = row.position.map(|at| self.query(robot, &row, at * metres));
                Ok(query.transpose()?.map(|query| (query, row)))
            });
            let Some((number, row)) = self.refusals.sort(row)? else { continue };
            let Some((query, ContactRow { normal, force, radius, time, .. })) = row else {
                self.refusals.off_skin += 1;
                continue;
            };
            batch.contacts.push(Contact { number, normal, force, radius, time });
            batch.queries.push(query);
        }
        Ok(batch)
    }

    fn query(&mut self, robot: &Robot, row: &ContactRow, point: DVec3) -> Result<Query, IoError> {
        let given = [row.normal.is_some(), row.force.is_some(), row.radius.is_some()];
        self.given = std::array::from_fn(|k| self.given[k] | given[k]);
        let link = self.link(robot, row)?;
        if point.abs().max_element() > LARGEST {
            let found = format!("{:?}", point.to_array());
            return Err(self.refusals.invalid(row.line, "columns x,y,z", found, "coordinates within 1e12 m"));
        }
        for (column, value) in [("radius", row.radius), ("force", row.force)] {
            if let Some(value) = value.filter(|x| x.abs() > LARGEST) {
                let (part, needed) = (format!("column `{column}`"), "a number within 1e12");
                return Err(self.refusals.invalid(row.line, &part, value.to_string(), needed));
            }
        }
        if self.used[NORMAL] && row.normal.is_none_or(|n| n == DVec3::ZERO) {
            let found = "no direction".into();
            return Err(self.refusals.invalid(
                row.line,
                "columns nx,ny,nz",
                found,
                "the direction of the ray",
            ));
        }
        let only_link = self.only_link(robot, row)?;
        Ok(Query { point, link, only_link })
    }

    /// The link in whose frame a contact is; `None`: in the world.
    fn link(&mut self, robot: &Robot, row: &ContactRow) -> Result<Option<LinkId>, IoError> {
        let (name, column, needed) = match &row.frame {
            Some(frame) if frame == WORLD => return self.world(robot, row.line),
            Some(frame) => (Some(frame), FRAME, "`world`, or the name of a link"),
            None => (row.link.as_ref(), LINK, "the name of a link, or nothing"),
        };
        match (name, self.meaning.frame) {
            (Some(name), _) => self.link_named(robot, name, (row.line, column, needed)).map(Some),
            (None, FrameArg::World) => Ok(None),
            (None, FrameArg::Link) => {
                let needed = "a link, since several carry skin";
                let refused = || self.refusals.invalid(row.line, LINK, "nothing".into(), needed);
                robot.only_link().ok_or_else(refused).map(Some)
            }
        }
    }

    /// The link whose skin alone a contact can be on; `None`: that of all links.
    fn only_link(&mut self, robot: &Robot, row: &ContactRow) -> Result<Option<LinkId>, IoError> {
        let Some(name) = &row.only_link else { return Ok(None) };
        let needed = "the name of a link with skin, or nothing";
        let link = self.link_named(robot, name, (row.line, ONLY_LINK, needed))?;
        if !robot.carries[link] {
            let chosen = if robot.has_skin[link] { "none of the patches of --patch" } else { "no patch" };
            let found = format!("{:?}, which carries {chosen}", robot.links[link]);
            return Err(self.refusals.invalid(row.line, ONLY_LINK, found, needed));
        }
        Ok(Some(link))
    }

    /// The frame of the world, if no other frame has its name.
    fn world(&self, robot: &Robot, line: u64) -> Result<Option<LinkId>, IoError> {
        if robot.links.enumerate().any(|(id, name)| name == WORLD && robot.is_apart(id)) {
            let found = "`world`, also the name of a link".into();
            return Err(self.refusals.invalid(line, FRAME, found, "a map whose links have other names"));
        }
        Ok(None)
    }

    fn link_named(
        &mut self,
        robot: &Robot,
        name: &str,
        (line, column, needed): (u64, &str, &str),
    ) -> Result<LinkId, IoError> {
        let mut links = robot.links.enumerate().filter(|(_, other)| *other == name).map(|(id, _)| id);
        let (found, needed) = match (links.next(), links.count()) {
            (Some(link), 0) => return Ok(link),
            (Some(_), others) => {
                let found = format!("{name:?}, the name of {} links", 1 + others);
                (found, "the name of one link of the map alone")
            }
            (None, _) => {
                let is_patch = robot.patches.iter().any(|patch| patch == name);
                let kind = if is_patch { ", the name of a patch" } else { "" };
                let known: Vec<String> = robot.links.iter().cloned().collect();
                let needed = &format!("{needed}: {}", first_names(&known));
                return Err(self.refusals.invalid(line, column, format!("{name:?}{kind}"), needed));
            }
        };
        Err(self.refusals.invalid(line, column, found, needed))
    }

    /// Says which columns and rows changed nothing.
    pub(super) fn note_unused(&self, common: &Common) {
        self.refusals.note_off_skin(common);
        for ((column, given), used) in OPTIONAL.iter().zip(self.given).zip(self.used) {
            if given && !used {
                let path = self.refusals.path.display();
                note!(common, "{path}: column `{column}` is not used");
            }
        }
    }
}
