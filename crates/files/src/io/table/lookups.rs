//! Tables of lookups, written some rows at a time: a million rows in about a second, into buffers that
//! every thread keeps.

use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use crate::contact::Cell;
use crate::io::IoError;
use crate::io::file::cannot_write;
use crate::io::table::writer::{end_row, push_cell, push_number, push_whole};
use crate::pyramid::LevelId;
use crate::skin::{Presence, TaxelId};

/// Columns of a table of lookups, but for those that a table adds.
const COLUMNS: &str = "contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance,link,\
                       x,y,z,nx,ny,nz,fields,presence,live_taxel_id,region,frame";

/// What stands in the column `patch` of a contact that touches none.
pub(super) const OFF_SKIN: &str = "off skin";

/// Bytes of rows that wait to be written: no thread begins another contact when there are as many.
const BYTES: usize = 1 << 23;

/// What a contact takes besides its rows.
const OF_CONTACT: usize = size_of::<(usize, Range<usize>)>() + size_of::<&[u8]>();

/// Threads that make rows, at most.
const THREADS: usize = 32;

/// Bytes that are given to the output together.
const WRITTEN: usize = 1 << 16;

/// Where one contact is on one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookupRow<'a> {
    /// Place of the contact in its table, counted from 0.
    pub contact: u64,
    /// The level.
    pub level: LevelId,
    /// Its name if it is a level without a mesh, as `body.L0` and `arm.thermal.L0`: `u,v,px,py` are empty.
    pub fields: Option<&'a str>,
    /// Signed distance from the skin, in m, positive outside.
    pub distance: f64,
    /// The frame that the contact was given in, `world` or the name of a link; its answer is in the
    /// same.
    pub frame: &'a str,
    /// Where it touches; `None`: it is off the skin.
    pub place: Option<LookupPlace<'a>>,
    /// The numbers in the columns that the table adds; NaN leaves a cell empty.
    pub extra: &'a [f64],
}

/// A place on the skin and on the map of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookupPlace<'a> {
    /// Name of the patch.
    pub patch: &'a str,
    /// Name of its link.
    pub link: &'a str,
    /// Name of the region of the field, if it is in one.
    pub region: Option<&'a str>,
    /// Where it is on the map of the level.
    pub cell: Cell,
    /// What the taxel of the cell is.
    pub presence: Presence,
    /// The nearest taxel that works, if one of the patch does.
    pub live_taxel: Option<TaxelId>,
    /// The point on the skin, in m, in the frame of the contact.
    pub position: DVec3,
    /// The unit normal of the skin there, in the same frame.
    pub normal: DVec3,
}

/// Writes a table of lookups with columns
/// `contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance,link,x,y,z,nx,ny,nz,fields`,
/// `presence`, `live_taxel_id`, `region` and `frame`, then those that a table adds.
///
/// `fields` has `vertex:weight` for each receptive field that the contact lies in, with `;` between
/// them. A contact off the skin has `off skin` as its patch, and otherwise only its distance. Decimals
/// are the shortest that read back as the same `f64`.
#[derive(Debug)]
pub struct LookupWriter<'a, W: Write> {
    path: &'a Path,
    output: BufWriter<W>,
    /// One for each thread that makes rows.
    texts: Vec<Text>,
}

impl<'a, W: Write> LookupWriter<'a, W> {
    /// Begins a table that adds columns, their names with commas between them; errors call it `path`.
    ///
    /// # Errors
    /// If `output` fails.
    pub fn new(path: &'a Path, mut output: W, extra: Option<&str>) -> Result<Self, IoError> {
        let columns: Vec<&str> = [COLUMNS].into_iter().chain(extra).collect();
        writeln!(output, "{}", columns.join(",")).map_err(cannot_write(path))?;
        let output = BufWriter::with_capacity(WRITTEN, output);
        Ok(Self { path, output, texts: Vec::new() })
    }

    /// Writes the rows of `contacts` contacts in their order; `rows` passes the rows of the contact
    /// with a number below that to its second argument. It is called in parallel, once for each contact.
    /// Memory does not grow with the number of contacts: it is that of some megabytes and of one contact's
    /// rows for each thread.
    ///
    /// # Errors
    /// If `output` fails.
    pub fn write(
        &mut self,
        contacts: usize,
        rows: impl Fn(usize, &mut dyn FnMut(&LookupRow<'_>)) + Sync,
    ) -> Result<(), IoError> {
        let threads = rayon::current_num_threads().min(THREADS);
        self.texts.resize_with(threads, Text::default);
        let next = AtomicUsize::new(0);
        let mut first = 0;
        while first < contacts {
            let bytes = AtomicUsize::new(0);
            self.texts.par_iter_mut().for_each(|text| {
                text.clear(BYTES / threads);
                while bytes.load(Ordering::Relaxed) < BYTES {
                    let contact = next.fetch_add(1, Ordering::Relaxed);
                    if contact >= contacts {
                        break;
                    }
                    let from = text.rows.len();
                    rows(contact, &mut |row| text.push(row));
                    text.contacts.push((contact, from..text.rows.len()));
                    bytes.fetch_add(text.rows.len() - from + OF_CONTACT, Ordering::Relaxed);
                }
            });
            // Threads take the contacts one by one: those taken so far are without a gap.
            let mut made = vec![&[][..]; self.texts.iter().map(|text| text.contacts.len()).sum()];
            self.texts.iter().flat_map(Text::made).for_each(|(contact, rows)| made[contact - first] = rows);
            first += made.len();
            for rows in made {
                self.output.write_all(rows).map_err(cannot_write(self.path))?;
            }
        }
        Ok(())
    }

    /// Ends the table.
    ///
    /// # Errors
    /// If `output` fails.
    pub fn finish(mut self) -> Result<(), IoError> {
        self.output.flush().map_err(cannot_write(self.path))
    }
}

#[derive(Debug, Default)]
struct Text {
    rows: Vec<u8>,
    /// Whose rows they are, and where they stand.
    contacts: Vec<(usize, Range<usize>)>,
    /// The columns `x` to `nz` of the last place, which are the same on every level, and the bits of
    /// their numbers.
    skin: Vec<u8>,
    skin_of: Option<[u64; 6]>,
}

impl Text {
    /// Gives back memory but for some bytes.
    fn clear(&mut self, kept: usize) {
        self.contacts.clear();
        self.rows.clear();
        self.rows.shrink_to(kept);
    }

    /// The contacts, and the rows of each.
    fn made(&self) -> impl Iterator<Item = (usize, &[u8])> {
        self.contacts.iter().map(|(contact, range)| (*contact, &self.rows[range.clone()]))
    }

    fn push(&mut self, row: &LookupRow<'_>) {
        let rows = &mut self.rows;
        push_whole(rows, row.contact);
        match row.fields {
            Some(name) => push_cell(rows, name),
            None => push_whole(rows, row.level.raw().into()),
        }
        match &row.place {
            Some(place) => self.push_place(row, place),
            None => {
                push_cell(rows, OFF_SKIN);
                rows.extend([b','; 10]);
                push_distance(rows, row.distance);
                rows.extend([b','; 11]);
            }
        }
        let rows = &mut self.rows;
        push_cell(rows, row.frame);
        for &x in row.extra {
            if x.is_nan() { rows.push(b',') } else { push_number(rows, x) }
        }
        end_row(rows);
    }

    fn push_place(&mut self, row: &LookupRow<'_>, place: &LookupPlace<'_>) {
        let LookupPlace { patch, link, cell, position, normal, .. } = place;
        let rows = &mut self.rows;
        push_cell(rows, patch);
        push_whole(rows, cell.point.face.raw().into());
        cell.point.barycentric.into_iter().for_each(|x| push_number(rows, x));
        if row.fields.is_some() {
            rows.extend([b','; 4]);
        } else {
            cell.uv.to_array().into_iter().for_each(|x| push_number(rows, x));
            cell.pixel.into_iter().for_each(|x| push_whole(rows, x.into()));
        }
        push_whole(rows, cell.field.raw().into());
        push_whole(rows, cell.taxel.0.into());
        push_distance(rows, row.distance);
        push_cell(rows, link);
        let ([x, y, z], [nx, ny, nz]) = (position.to_array(), normal.to_array());
        let numbers = [x, y, z, nx, ny, nz];
        let shown = Some(numbers.map(f64::to_bits));
        if self.skin_of != shown {
            self.skin_of = shown;
            self.skin.clear();
            numbers.into_iter().for_each(|x| push_number(&mut self.skin, x));
        }
        rows.extend_from_slice(&self.skin);
        for (k, (field, weight)) in cell.weights.iter().enumerate() {
            rows.extend((k > 0).then_some(b';'));
            push_whole(rows, field.raw().into());
            rows.pop();
            rows.push(b':');
            push_number(rows, weight);
            rows.pop();
        }
        rows.push(b',');
        push_cell(rows, place.presence.word());
        match place.live_taxel {
            Some(taxel) => push_whole(rows, taxel.0.into()),
            None => rows.push(b','),
        }
        push_cell(rows, place.region.unwrap_or_default());
    }
}

/// Appends a distance. Adding 0 makes -0 the same.
#[inline]
fn push_distance(text: &mut Vec<u8>, distance: f64) {
    push_number(text, distance + 0.0);
}
