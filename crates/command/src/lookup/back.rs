//! Places on maps to rows: the points of the skin that they show.

use std::{io::Write, path::Path};

use dermatome::{
    Error,
    contact::{ContactIndex, MapIndex, MapPlace},
    id::IdVec,
    io::{IoError, LookupPlace, LookupRow, LookupWriter, MapCoordinates, MapPlaceRow, read_map_places},
    pyramid::LevelId,
    skin::{LinkId, PatchId},
};
use glam::{DAffine3, DVec2};

use crate::console::notes::{note_columns, note_count};
use crate::files::input::open_input;
use crate::lookup::contacts::{FrameArg, LARGEST, WORLD};
use crate::lookup::player::Player;
use crate::lookup::refusals::{Refusals, unanswered};
use crate::lookup::robot::Robot;
use crate::options::{Common, Unit};

/// Places answered and written at a time.
const BATCH: usize = 1 << 14;

/// Answers places on maps, some at a time.
pub(super) struct Back<'a> {
    robot: &'a Robot,
    index: ContactIndex,
    maps: MapIndex,
    frame: FrameArg,
    unit: Unit,
    player: Player,
    rows: Box<dyn Iterator<Item = Result<MapPlaceRow, IoError>> + 'a>,
    pub(super) refusals: Refusals,
    has_times: bool,
    /// Places off every triangle of their map.
    off_chart: u64,
}

struct Place {
    number: u64,
    patch: PatchId,
    level: LevelId,
    uv: DVec2,
    time: Option<f64>,
}

impl<'a> Back<'a> {
    pub(super) fn open(
        path: &'a Path,
        unit: Unit,
        robot: &'a Robot,
        mut index: ContactIndex,
        (frame, player): (FrameArg, Player),
        common: &Common,
    ) -> anyhow::Result<Self> {
        player.start(&mut index).map_err(Error::from)?;
        let maps = MapIndex::new(&robot.map).map_err(Error::from)?;
        let (name, input) = open_input(path)?;
        let (unknown, rows) = read_map_places(name, input).map_err(Error::from)?;
        note_columns(name, &unknown, common);
        let refusals = Refusals::new(name.to_owned());
        let (has_times, rows) = (rows.has_times(), Box::new(rows));
        let off_chart = 0;
        Ok(Self { robot, index, maps, frame, unit, player, rows, refusals, has_times, off_chart })
    }

    pub(super) fn answer(&mut self, path: &Path, output: impl Write) -> Result<(), IoError> {
        let extra = if self.has_times { "off_chart,time" } else { "off_chart" };
        let mut table = LookupWriter::new(path, output, Some(extra))?;
        loop {
            let places = self.batch()?;
            if places.is_empty() {
                break;
            }
            let is_timed = self.player.is_timed();
            for part in places.chunk_by(|a, b| !is_timed || a.time == b.time) {
                self.player.pose(&mut self.index, part[0].time, part.len())?;
                self.write(part, &mut table)?;
            }
        }
        self.refusals.check_any()?;
        table.finish()
    }

    /// Writes the rows of places on the robot as it is posed.
    fn write(&mut self, places: &[Place], table: &mut LookupWriter<'_, impl Write>) -> Result<(), IoError> {
        let mut found = Vec::new();
        let mut from = vec![0];
        for place in places {
            let first = found.len();
            self.maps.places(place.patch, place.level, place.uv, &mut found).map_err(unanswered)?;
            self.off_chart += u64::from(found[first..].iter().any(|place| place.off_chart > 0.0));
            for place in &mut found[first..] {
                *place = self.maps.posed(&self.index, place).unwrap_or(*place);
            }
            from.push(found.len());
        }
        let (robot, poses, frame) = (self.robot, self.index.poses(), self.frame);
        let columns = 1 + usize::from(self.has_times);
        table.write(places.len(), |k, emit| {
            for place in &found[from[k]..from[k + 1]] {
                let extra = [place.off_chart, places[k].time.unwrap_or(f64::NAN)];
                let row = row(robot, &poses, frame, places[k].number, place);
                emit(&LookupRow { extra: &extra[..columns], ..row });
            }
        })
    }

    fn batch(&mut self) -> Result<Vec<Place>, IoError> {
        let mut places = Vec::new();
        while places.len() < BATCH {
            let Some(row) = self.rows.next() else { break };
            let row = row.and_then(|row| row.position.map(|at| self.place(&row, at)).transpose());
            let Some((number, place)) = self.refusals.sort(row)? else { continue };
            let Some(place) = place else {
                self.refusals.off_skin += 1;
                continue;
            };
            places.push(Place { number, ..place });
        }
        Ok(places)
    }

    fn place(&self, row: &MapPlaceRow, position: MapCoordinates) -> Result<Place, IoError> {
        let patches = &self.robot.map.patches;
        let named = patches.enumerate().find(|(_, patch)| patch.name == row.patch).map(|(id, _)| id);
        let only = (row.patch.is_empty() && patches.len() == 1).then_some(PatchId::new(0));
        let patch = named.or(only).ok_or_else(|| {
            let (found, needed) = (
                format!("{:?}", row.patch),
                "the name of a patch of the map, one of --patch if that is given",
            );
            self.refusals.invalid(row.line, "column `patch`", found, needed)
        })?;
        let levels = patches[patch].levels.len();
        if row.level >= levels {
            let needed = format!("a level of {:?}, 0 to {}", patches[patch].name, levels - 1);
            let found = row.level.to_string();
            return Err(self.refusals.invalid(row.line, "column `level`", found, &needed));
        }
        let level = LevelId::new(row.level);
        let position = match position {
            MapCoordinates::Metres(uv) => MapCoordinates::Metres(uv * self.unit.metres()),
            pixel => pixel,
        };
        let uv = match position {
            MapCoordinates::Metres(uv) if uv.abs().max_element() > LARGEST => {
                let (found, needed) = (format!("{:?}", uv.to_array()), "coordinates within 1e12 m");
                return Err(self.refusals.invalid(row.line, "columns u,v", found, needed));
            }
            MapCoordinates::Metres(uv) => uv,
            MapCoordinates::Pixel(pixel) => {
                let frame = patches[patch].levels[level].frame;
                let [width, height] = frame.size_px;
                if pixel[0] >= width || pixel[1] >= height {
                    let needed = format!("a pixel of the image of {width} x {height}");
                    let found = format!("{pixel:?}");
                    return Err(self.refusals.invalid(row.line, "columns px,py", found, &needed));
                }
                frame.centre(pixel)
            }
        };
        Ok(Place { number: 0, patch, level, uv, time: row.time })
    }

    pub(super) fn note(&self, common: &Common) {
        self.refusals.note_off_skin(common);
        let how = "off the map: the nearest place on it is answered (column `off_chart`)";
        note_count(common, self.off_chart, "places", how);
        self.player.note("places", common);
    }
}

fn row<'a>(
    robot: &'a Robot,
    poses: &IdVec<LinkId, DAffine3>,
    frame: FrameArg,
    contact: u64,
    place: &'a MapPlace,
) -> LookupRow<'a> {
    let link = &robot.links[place.link];
    let ((position, normal), frame) = match frame {
        FrameArg::World => {
            let pose = poses[place.link];
            ((pose.transform_point3(place.position), pose.transform_vector3(place.normal)), WORLD)
        }
        FrameArg::Link => ((place.position, place.normal), link.as_str()),
    };
    let cell = place.cell;
    let (presence, live_taxel) = robot.live.nearest(place.patch, &cell);
    let (patch, region) = (&robot.patches[place.patch], robot.region(place.patch, &cell));
    let place = LookupPlace { patch, link, region, cell, presence, live_taxel, position, normal };
    LookupRow {
        contact,
        level: cell.level,
        fields: None,
        distance: 0.0,
        frame,
        place: Some(place),
        extra: &[],
    }
}
