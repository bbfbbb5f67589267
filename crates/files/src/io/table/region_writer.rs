//! Contacts of recordings: those found in them, written frame by frame, and those simulated.

use std::sync::Arc;

use crate::io::IoError;
use crate::io::file::OutPath;
use crate::io::file::file_kind;
use crate::io::file::outputs::Replacement;
use crate::io::table::writer::{TableWriter, write_table};
use crate::map::SkinMap;
use crate::signal::{ContactEvent, ContactRegion, Touch};
use crate::skin::Skin;

const COLUMNS: &str = "frame,time,track,event,patch,link,taxels,area,force,x,y,z,nx,ny,nz,u,v,\
                       major,minor,angle,peak_taxel_id,peak,region";

/// Writes the contacts of a recording frame by frame.
///
/// `frame,time,track,event,patch,link,taxels,area,force,x,y,z,nx,ny,nz,u,v,major,minor,angle,peak_taxel_id,peak,region`:
/// `event` is `onset`, `move` or `release`, `taxels` their number, `x` to `nz` the centre of pressure
/// and the normal there in the frame of the link, `u,v` the centre on the map; a row of a release
/// gives the state of the contact in the frame before. `region` is that of the taxel with the largest reading. Where contacts may go on over gaps, a
/// last column `patches` has the names of all patches, with `;` between them; `patch` is the one with most of the force. SI units; decimals are the shortest that read back
/// as the same `f64`. A force that does not follow from the unit of the channel, and a time that is not
/// known, are empty cells.
///
/// Nothing appears in the file's place before [`RegionWriter::finish`].
pub struct RegionWriter {
    map: Arc<SkinMap>,
    table: TableWriter<Replacement>,
    episode: Option<u64>,
}

impl RegionWriter {
    /// Starts a file of contacts on this map.
    ///
    /// # Errors
    /// If the file is no `.csv`, or cannot be created.
    pub fn create(path: impl Into<OutPath>, map: &Arc<SkinMap>) -> Result<Self, IoError> {
        let path = &path.into();
        if file_kind(path) != "csv" {
            return Err(IoError::UnknownKind { path: path.into(), known: ".csv" });
        }
        let columns = if has_gaps(map) { format!("{COLUMNS},patches") } else { COLUMNS.to_owned() };
        Ok(Self { map: Arc::clone(map), table: TableWriter::create(path, &columns)?, episode: None })
    }

    /// Begins an episode: the next frames have this number in the first column, `episode`. If a file has episodes, call it
    /// before the first frame.
    pub fn begin_episode(&mut self, number: u64) {
        if self.episode.replace(number).is_none() {
            self.table.add_first_column("episode");
        }
    }

    /// Writes the contacts of one frame.
    ///
    /// # Errors
    /// If the disk is full.
    ///
    /// # Panics
    /// If a contact is not one on this map.
    pub fn write(&mut self, frame: u64, time: f64, regions: &[ContactRegion]) -> Result<(), IoError> {
        let Self { map, table, episode } = self;
        for region in regions {
            let patch = &map.patches[region.patch];
            episode.iter().for_each(|&number| table.whole(number));
            table.whole(frame);
            table.number_if_any(Some(time).filter(|time| time.is_finite()));
            table.whole(region.track);
            table.cell(match region.event {
                ContactEvent::Onset => "onset",
                ContactEvent::Move => "move",
                ContactEvent::Release => "release",
            });
            table.cell(&patch.name);
            table.cell(&map.links[region.link].name);
            table.whole((region.taxels.len() + region.beyond.len()) as u64);
            table.numbers([region.area]);
            table.number_if_any(Some(region.force).filter(|force| force.is_finite()));
            table.numbers(region.centre.to_array().into_iter().chain(region.normal.to_array()));
            table.numbers([region.map.x, region.map.y, region.major, region.minor, region.angle]);
            table.whole(patch.taxels.ids[region.peak_taxel].0);
            table.numbers([region.peak]);
            let regions = patch.taxels.regions.as_ref();
            table.cell(regions.and_then(|all| all[region.peak_taxel].as_deref()).unwrap_or_default());
            if has_gaps(map) {
                let patches = region.patches();
                let names: Vec<&str> =
                    patches.iter().map(|&patch| map.patches[patch].name.as_str()).collect();
                table.cell(&names.join(";"));
            }
            table.end_row()?;
        }
        Ok(())
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn finish(self) -> Result<(), IoError> {
        self.table.publish()
    }
}

/// Whether contacts may go on over gaps.
fn has_gaps(map: &SkinMap) -> bool {
    !map.body.links.is_empty()
}

/// Writes what truly happens in a simulated recording: a row for each frame in which something is
/// touched.
///
/// `frame,time,press,patch,link,x,y,z,force,taxels,sphere_x,sphere_y,sphere_z`: `x,y,z` the centre
/// of pressure and `sphere_*` the centre of the sphere in the frame of the link, in m; `force` of
/// the whole contact, in N; `taxels` the number of working taxels that feel it.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
///
/// # Panics
/// If a touch names a patch that `skin` does not have.
pub fn write_touches(path: impl Into<OutPath>, skin: &Skin, touches: &[Touch]) -> Result<(), IoError> {
    const HEADER: &str = "frame,time,press,patch,link,x,y,z,force,taxels,sphere_x,sphere_y,sphere_z";
    write_table(&path.into(), HEADER, |table| {
        for touch in touches {
            let patch = &skin.patches[touch.patch];
            table.whole(touch.frame as u64);
            table.decimals([touch.time]);
            table.whole(touch.press as u64);
            table.cell(&patch.name);
            table.cell(&skin.links[patch.link].name);
            table.decimals(touch.centre.to_array().into_iter().chain([touch.force]));
            table.whole(touch.taxels as u64);
            table.decimals(touch.sphere.to_array());
            table.end_row()?;
        }
        Ok(())
    })
}

/// Writes the steps of a pressure that is the same everywhere as CSV, a row for each, with these columns:
///
/// | column | meaning |
/// |---|---|
/// | `time` | when the step begins, in s |
/// | `pressure` | its pressure, in Pa |
///
/// # Errors
/// If the file cannot be written.
pub fn write_steps(path: impl Into<OutPath>, steps: &[[f64; 2]]) -> Result<(), IoError> {
    write_table(&path.into(), "time,pressure", |table| {
        for &step in steps {
            table.decimals(step);
            table.end_row()?;
        }
        Ok(())
    })
}
