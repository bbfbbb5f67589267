//! Tables of designed skins: the drawing of a module, the poses of modules, and their wiring.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use glam::{DAffine3, DVec2};

use crate::design::{Module, PlacedModule, Plate};
use crate::id::IdVec;
use crate::io::IoError;
use crate::io::file::{OutPath, Source};
use crate::io::table::writer::write_table;
use crate::io::table::{Table, each_row_of};
use crate::skin::{Link, LinkId};

/// Columns of the table of modules.
const MODULES: &str =
    "module,chain,place,patch,on_link,x,y,z,qx,qy,qz,qw,curvature,direction,gap_mm,first_corner";

/// Columns of the table of wires.
const CHAINS: &str = "chain,place,module,from_module,from_port,to_port";

/// Reads the drawing of a module: columns `kind,x,y` in m, where a kind is `outline` (corners, counter-clockwise), `taxel`
/// (in the order of its ids) or `port` (the middle of an edge over which it may be wired; without one, all edges).
///
/// # Errors
/// If the file cannot be read, a column is missing or a kind is unknown. Whether it is a module,
/// [`Module::validate`] checks.
pub fn read_module(path: &Path) -> Result<Module, IoError> {
    let mut module = Module { outline: Vec::new(), taxels: Vec::new(), ports: Vec::new() };
    each_row_of(path, ["kind", "x", "y"], &mut |row, [kind, x, y]| {
        let points = match row.text(kind) {
            "outline" => &mut module.outline,
            "taxel" => &mut module.taxels,
            "port" => &mut module.ports,
            _ => return Err(row.invalid(kind, "outline, taxel or port")),
        };
        points.push(DVec2::from_array(row.numbers([x, y])?));
        Ok(())
    })?;
    Ok(module)
}

/// The modules of a table, and their links.
#[derive(Debug, Clone, Default)]
pub struct PlacedModules {
    /// The modules, in the order of the rows.
    pub modules: Vec<PlacedModule>,
    /// Their links, which are all at the origin: the table has names of links only.
    pub links: IdVec<LinkId, Link>,
    /// Columns that were not used.
    pub unused: Vec<String>,
}

/// Reads poses of modules, as CAD exports them: columns `module` (a number), `x,y,z` (m, in the world), `qx,qy,qz,qw`, and
/// optionally `curvature` (1/m) and `direction` (rad), `patch` and `on_link`. Ids of taxels must fit into
/// 32 bits with `block` ids a module.
///
/// # Errors
/// If the file cannot be read, a column is missing, a number comes twice or is too large, or a quaternion is not
/// of length 1.
pub fn read_placed_modules(path: &Path, block: u32) -> Result<PlacedModules, IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let known: Vec<&str> = MODULES.split(',').collect();
    let columns = &table.columns;
    let unused = columns.unknown(&known).map(|(_, name)| name.to_owned()).collect();
    let number = columns.need("module")?;
    let position = columns.need_vector(["x", "y", "z"])?;
    let rotation = columns.need_vector(["qx", "qy", "qz", "qw"])?;
    let bend = columns.find_vector(["curvature", "direction"])?;
    let [patch, on_link] = ["patch", "on_link"].map(|name| columns.find(name));
    let (mut placed, mut links) = (PlacedModules { unused, ..PlacedModules::default() }, BTreeMap::new());
    let mut seen = HashSet::new();
    let largest = u32::MAX / block - 1;
    table.each_row(&mut |row| {
        let module = row.text(number).parse().ok().filter(|module| *module <= largest);
        let module = module.ok_or_else(|| row.invalid(number, format!("a number from 0 to {largest}")))?;
        if !seen.insert(module) {
            return Err(row.invalid(number, "each module once"));
        }
        let frame = DAffine3::from_rotation_translation(row.rotation(rotation)?, row.vector(position)?);
        let [curvature, direction] = bend.map_or(Ok([0.0; 2]), |columns| row.numbers(columns))?;
        let name = |column: Option<usize>| column.map_or("", |column| row.text(column)).to_owned();
        let link = Some(name(on_link)).filter(|name| !name.is_empty());
        let link = link.map(|name| {
            let pose = DAffine3::IDENTITY;
            *links.entry(name.clone()).or_insert_with(|| placed.links.push(Link { name, parent: None, pose }))
        });
        let plate = Plate { frame, curvature, direction };
        placed.modules.push(PlacedModule { number: module, plate, patch: name(patch), link });
        Ok(())
    })?;
    if placed.modules.is_empty() {
        let (found, needed) = ("no row".into(), "one for each module".into());
        return Err(IoError::Invalid { path: path.to_owned(), element: "rows".into(), found, needed });
    }
    Ok(placed)
}

/// A row of the table of modules.
#[derive(Debug, Clone, PartialEq)]
pub struct ModuleRow {
    /// The module, in the world.
    pub placed: PlacedModule,
    /// The name of its link.
    pub link: String,
    /// Its chain, and its place in it, both counted from 1.
    pub chain: [u32; 2],
    /// Largest distance from the surface, in m.
    pub gap: f64,
    /// At which corner the first one of the drawing is, counted from 1 counter-clockwise from the edge to the module before.
    pub first_corner: u32,
    /// The module before it in the chain, and the edges of that and of this one, counted from 1; `None` of the first.
    pub before: Option<[u32; 3]>,
}

/// Writes the table of modules.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_placed_modules(path: impl Into<OutPath>, rows: &[ModuleRow]) -> Result<(), IoError> {
    write_table(&path.into(), MODULES, |table| {
        for row in rows {
            let Plate { frame, curvature, direction } = row.placed.plate;
            table.whole(row.placed.number);
            row.chain.into_iter().for_each(|number| table.whole(number));
            table.cell(&row.placed.patch);
            table.cell(&row.link);
            table.numbers(frame.translation.to_array());
            table.numbers(glam::DQuat::from_mat3(&frame.matrix3).to_array());
            table.numbers([curvature, direction, 1e3 * row.gap]);
            table.whole(row.first_corner);
            table.end_row()?;
        }
        Ok(())
    })
}

/// Writes the table of wires: a row for each module, in the order of its chain, with the module it is reached from.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_chains(path: impl Into<OutPath>, rows: &[ModuleRow]) -> Result<(), IoError> {
    write_table(&path.into(), CHAINS, |table| {
        for row in rows {
            row.chain.into_iter().for_each(|number| table.whole(number));
            table.whole(row.placed.number);
            match row.before {
                Some(before) => before.into_iter().for_each(|number| table.whole(number)),
                None => table.empty(3),
            }
            table.end_row()?;
        }
        Ok(())
    })
}
