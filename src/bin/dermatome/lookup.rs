//! `dermatome lookup MAP.glb CONTACTS.csv`: where contacts are on the map, on every level.

use std::{
    fs::File,
    io::{Read, Write, stdin, stdout},
    path::{Path, PathBuf},
    process::ExitCode,
};

use dermatome::{
    Error,
    contact::{ContactError, ContactIndex, Query},
    id::{IdVec, VertexId},
    io::{ContactRow, IoError, LookupRow, read_contacts, read_map, read_poses, replace_file, write_lookups},
    map::{MapLevel, PatchMap, SkinMap},
    pyramid::LevelId,
    skin::{Link, LinkId, PatchId, Presence},
};

use crate::{
    common::Common,
    errors::advise,
    notes::note,
    outputs::{self, is_stream},
    print::plain,
};

/// Contacts read, answered and written at a time: enough for every thread, and a few megabytes.
const CHUNK: usize = 1 << 16;

/// Arguments of `lookup`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: PathBuf,
    /// The contacts: a table with columns x,y,z in m, and link if they are in the frame of a link;
    /// `-`: standard input
    #[arg(value_name = "CONTACTS.csv")]
    contacts: PathBuf,
    /// File for the answers; `-`: standard output
    #[arg(short, long, default_value = "-", value_name = "OUT.csv")]
    output: PathBuf,
    /// Answer on this level only; may be given more than once [default: all levels]
    #[arg(long = "level", value_name = "K")]
    levels: Vec<usize>,
    /// Poses of links in the world: a table with columns link,x,y,z,qx,qy,qz,qw; other links keep
    /// their pose relative to their parent
    #[arg(long, value_name = "P.csv")]
    pose: Option<PathBuf>,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    check_output(args)?;
    let map = read_map(&args.map).map_err(Error::from)?;
    let mut index = ContactIndex::new(&map).map_err(Error::from)?;
    let SkinMap { links, patches } = map;
    let patches: IdVec<PatchId, PatchFacts> = patches.into_iter().map(PatchFacts::of).collect();
    if let Some(path) = &args.pose {
        let poses = read_poses(path, &|name| find_link(&links, name)).map_err(Error::from)?;
        index.move_links(&poses).map_err(Error::from)?;
    }
    let most = patches.iter().map(|patch| patch.levels).max().unwrap_or(0);
    if let Some(level) = args.levels.iter().find(|&&level| level >= most) {
        let what = format!("the map has no level {level}; its levels are 0 to {}", most.saturating_sub(1));
        return Err(advise(what, "leave out --level to get all of them"));
    }
    for patch in patches.iter().filter(|patch| args.levels.iter().any(|&level| level >= patch.levels)) {
        let what = format!("{} has {} levels", plain(&patch.name), patch.levels);
        note(common, format_args!("{what}; contacts on it get no row for levels above"));
    }
    let levels = (0..most).filter(|k| args.levels.is_empty() || args.levels.contains(k)).map(LevelId::new);

    let (path, input): (_, Box<dyn Read>) = if is_stream(&args.contacts) {
        (Path::new("standard input"), Box::new(stdin().lock()))
    } else {
        let fail = |source| Error::from(IoError::Read { path: args.contacts.clone(), source });
        (&args.contacts, Box::new(File::open(&args.contacts).map_err(fail)?))
    };
    let (unknown, contacts) = read_contacts(path, input).map_err(Error::from)?;
    for column in unknown {
        note(common, format_args!("{}: column `{column}` is not used", path.display()));
    }
    let levels: Vec<LevelId> = levels.collect();
    let silent = vec![0; levels.len()];
    let mut lookup = Lookup { index: &index, links, patches, path, levels, unused: [false; 4], silent };
    if is_stream(&args.output) {
        lookup.answer(contacts, Path::new("standard output"), stdout().lock()).map_err(Error::from)?;
    } else {
        replace_file(&args.output, |output| lookup.answer(contacts, &args.output, output))
            .map_err(Error::from)?;
    }
    for (column, _) in UNUSED.iter().zip(lookup.unused).filter(|(_, given)| *given) {
        note(common, format_args!("{}: column `{column}` is not used", path.display()));
    }
    if let Some(text) = lookup.silent_fields() {
        note(common, text);
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses an output that is not a table, or that is one of the inputs.
fn check_output(args: &Args) -> anyhow::Result<()> {
    if is_stream(&args.output) {
        return Ok(());
    }
    outputs::check_table(&args.output)?;
    outputs::check([args.output.as_path()])?;
    let inputs = [&args.map, &args.contacts].into_iter().chain(&args.pose);
    outputs::check_inputs(&args.output, inputs.map(PathBuf::as_path))
}

/// The first link of this name.
fn find_link(links: &IdVec<LinkId, Link>, name: &str) -> Option<LinkId> {
    links.enumerate().find(|(_, link)| link.name == name).map(|(id, _)| id)
}

/// Columns that are read and checked, but change nothing in the answer.
const UNUSED: [&str; 4] = ["nx,ny,nz", "force", "radius", "time"];

struct Lookup<'a> {
    index: &'a ContactIndex,
    links: IdVec<LinkId, Link>,
    patches: IdVec<PatchId, PatchFacts>,
    /// Name of the table of contacts in errors.
    path: &'a Path,
    levels: Vec<LevelId>,
    /// Which of [`UNUSED`] some contact has.
    unused: [bool; 4],
    /// On each of `levels`, how many contacts lie in a field whose centre reads no pressure.
    silent: Vec<u64>,
}

/// What answers need of a patch besides the index.
struct PatchFacts {
    name: String,
    /// How many levels it has.
    levels: usize,
    /// On each level, whether the centre of each field is an absent taxel or a thermal pad; empty if
    /// none is.
    silent: IdVec<LevelId, IdVec<VertexId, bool>>,
}

impl PatchFacts {
    fn of(patch: PatchMap) -> Self {
        let is_silent = |taxel: VertexId| patch.taxels.presence[taxel] != Presence::Present;
        let of_level = |map: &MapLevel| map.level.origins.map(|&taxel| is_silent(taxel));
        let has_silent = patch.taxels.presence.ids().any(is_silent);
        let silent = patch.levels.iter().filter(|_| has_silent).map(of_level).collect();
        Self { levels: patch.levels.len(), silent, name: patch.name }
    }
}

impl Lookup<'_> {
    /// A note about contacts in fields whose centre reads no pressure, if there are any.
    fn silent_fields(&self) -> Option<String> {
        let counts = self.levels.iter().zip(&self.silent).filter(|(_, count)| **count > 0);
        let counts: Vec<_> = counts.map(|(level, count)| format!("{count} on level {level}")).collect();
        let what = "contacts in a field whose centre is an absent taxel or a thermal pad";
        (!counts.is_empty()).then(|| format!("{what}: {}", counts.join(", ")))
    }

    /// Answers all contacts, some at a time, so that memory does not grow with their number.
    fn answer(
        &mut self,
        mut contacts: impl Iterator<Item = Result<ContactRow, IoError>>,
        path: &Path,
        output: impl Write,
    ) -> Result<(), IoError> {
        write_lookups(path, output, |write| {
            let (mut chunk, mut lines, mut first) = (Vec::new(), Vec::new(), 0);
            loop {
                chunk.clear();
                lines.clear();
                for row in contacts.by_ref().take(CHUNK) {
                    let row = row?;
                    lines.push(row.line);
                    chunk.push(self.contact(row)?);
                }
                if chunk.is_empty() {
                    return Ok(());
                }
                self.answer_chunk(first, &chunk, &lines, write)?;
                first += chunk.len() as u64;
            }
        })
    }

    fn contact(&mut self, row: ContactRow) -> Result<Query, IoError> {
        let given = [row.normal.is_some(), row.force.is_some(), row.radius.is_some(), row.time.is_some()];
        self.unused = std::array::from_fn(|k| self.unused[k] | given[k]);
        let link = row.link.map(|name| {
            find_link(&self.links, &name).ok_or_else(|| IoError::Invalid {
                path: self.path.into(),
                element: format!("line {}, column `link`", row.line),
                found: format!("{name:?}"),
                needed: "the name of a link of the map".into(),
            })
        });
        Ok(Query { point: row.position, link: link.transpose()? })
    }

    /// Writes the rows of some contacts, the first of which has number `first`.
    fn answer_chunk(
        &mut self,
        first: u64,
        chunk: &[Query],
        lines: &[u64],
        write: &mut dyn FnMut(&LookupRow<'_>) -> Result<(), IoError>,
    ) -> Result<(), IoError> {
        let hits = self.index.locate_all(chunk).map_err(|error| self.refused(&error, lines))?;
        for (contact, hit) in (first..).zip(&hits) {
            let patch = &self.patches[hit.patch];
            for (&level, silent) in self.levels.iter().zip(&mut self.silent) {
                let Some(cell) = self.index.cell(hit, level) else { continue };
                *silent += u64::from(patch.silent.get(level).is_some_and(|level| level[cell.field]));
                write(&LookupRow {
                    contact,
                    level: cell.level,
                    patch: &patch.name,
                    face: cell.point.face,
                    barycentric: cell.point.barycentric,
                    map: cell.uv,
                    pixel: cell.pixel,
                    field: cell.field,
                    taxel: cell.taxel,
                    distance: hit.distance,
                })?;
            }
        }
        Ok(())
    }

    /// A contact without an answer, as an error about its line.
    fn refused(&self, error: &ContactError, lines: &[u64]) -> IoError {
        let (contact, found, needed) = match error {
            ContactError::NotFinite { contact, point } => {
                (*contact, format!("{point:?}"), "finite coordinates within 1e12 m")
            }
            ContactError::BareLink { contact, name } => {
                (*contact, format!("link {name:?}, which carries no patch"), "a link with skin, or none")
            }
            other => (0, other.to_string(), "a contact that can be answered"),
        };
        let line = lines.get(contact).copied().unwrap_or(1);
        IoError::Invalid {
            path: self.path.into(),
            element: format!("line {line}"),
            found,
            needed: needed.into(),
        }
    }
}
