//! A skin as two tables: `skin.csv` with a taxel a row, `skin.triangles.csv` with their triangles.

use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::id::{IdVec, VertexId};
use crate::io::error::Result;
use crate::io::file::OutPath;
use crate::io::file::{Source, finite};
use crate::io::mesh::parts::all_triangles;
use crate::io::table::calibration::{BY_ROW, Corners, Taxels};
use crate::io::table::regions::NAME_NEEDED;
use crate::io::table::writer::{TableWriter, write_table};
use crate::io::table::{Columns, Row, Table};
use crate::skin::{
    Covariance, Draft, Link, LinkId, Modalities, NAMES_OF_MODALITIES, Patch, Presence, RegionName, Remark,
    RemarkKind, Sheet, Skin, TaxelId, are_modalities, is_region_name,
};

/// Columns of the table of taxels.
const COLUMNS: &str = "id,x,y,z,nx,ny,nz,qx,qy,qz,qw,area,density,weight,present,patch,on_link,\
                       cxx,cxy,cxz,cyy,cyz,czz,region";

/// The column of what taxels sense, which only skins that know it have.
const MODALITY: &str = "modality";

/// The link that a taxel is on, where positions are in the world: in a table of contacts `link`
/// would mean that they are in the frame of that link.
const ON_LINK: &str = "on_link";

/// The same in tables from elsewhere.
const LINK: &str = "link";

/// A column that a table of calibrated taxels has besides, and those of an exported table.
const SIGMA: &str = "sigma";
const TANGENT: [&str; 3] = ["tx", "ty", "tz"];
const PRESENCE: &str = "presence";

/// The table of triangles that is read and written with the table of taxels `path`.
pub fn triangles_path(path: &Path) -> PathBuf {
    path.with_extension("triangles.csv")
}

struct ColumnIndices {
    position: [usize; 3],
    normal: Option<[usize; 3]>,
    id: Option<usize>,
    area: Option<usize>,
    density: Option<usize>,
    weight: Option<usize>,
    present: Option<usize>,
    patch: Option<usize>,
    link: Option<usize>,
    sigma: Option<usize>,
    covariance: Option<[usize; 6]>,
    rotation: Option<[usize; 4]>,
    tangent: Option<[usize; 3]>,
    region: Option<usize>,
    modality: Option<usize>,
}

/// Reads the two tables, or the taxels alone where there is no table of triangles.
///
/// Taxels: `x,y,z` and optionally `id`, `nx,ny,nz`, `area` (m^2), `density` (1/m^2), `weight`, `present` (0
/// absent, 1 present, 2 thermal pad, 3 another sensor, or `presence` in words), `tx,ty,tz` (tangent), `patch` and `on_link` or `link` (names; every patch becomes a
/// sheet), `region` (a name, or nothing),
/// `modality` (names joined by `+`, or nothing; stronger than `present` but for 0), `cxx,cxy,cxz,cyy,cyz,czz` (covariance, m^2; empty cells where it is not known), in any order; other columns are not
/// read. The id -1 is the placeholder [`u32::MAX`]. `qx,qy,qz,qw` is the frame of a taxel: its z axis is the normal where
/// there is no `nx,ny,nz`, its x axis the tangent. Tables of calibrated taxels are read, too: `sigma`
/// follows from the covariance, and frames that are all the identity stand for unknown ones, unless
/// all normals given are +z. Triangles: `row0,row1,row2`, the rows
/// of taxels in their table, counted from 0, or `id0,id1,id2`, their ids. The tables have no frames: links are at the origin.
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let (mut draft, homes) = read_taxels(source)?;
    let triangles = triangles_path(source.path());
    if source.is_file() && triangles.exists() {
        read_triangles(&Source::open(&triangles)?, &homes, &mut draft)?;
    }
    Ok(draft)
}

impl ColumnIndices {
    fn new(columns: &Columns) -> Result<Self> {
        let link = match (columns.find(ON_LINK), columns.find(LINK)) {
            (Some(_), Some(_)) => {
                let found = format!("columns `{ON_LINK}` and `{LINK}`");
                return Err(columns.at().invalid(found, "one of them"));
            }
            (on_link, link) => on_link.or(link),
        };
        let position = columns.need_vector(["x", "y", "z"])?;
        let normal = columns.find_vector(["nx", "ny", "nz"])?;
        let covariance = columns.find_vector(["cxx", "cxy", "cxz", "cyy", "cyz", "czz"])?;
        let rotation = columns.find_vector(["qx", "qy", "qz", "qw"])?;
        let tangent = columns.find_vector(TANGENT)?.filter(|_| rotation.is_none());
        let [id, area, density, weight, patch, sigma, region, modality] =
            ["id", "area", "density", "weight", "patch", SIGMA, "region", MODALITY]
                .map(|name| columns.find(name));
        let present = columns.find("present").or_else(|| columns.find(PRESENCE));
        Ok(Self {
            position,
            normal,
            id,
            area,
            density,
            weight,
            present,
            patch,
            link,
            sigma,
            covariance,
            rotation,
            tangent,
            region,
            modality,
        })
    }
}

/// The sheets that are being filled, and where each taxel went.
#[derive(Default)]
struct Sheets {
    draft: Draft,
    by_name: HashMap<String, usize>,
    links: HashMap<String, LinkId>,
    /// Sheet and index in it of every row.
    homes: Vec<(usize, u32)>,
}

/// Reads the taxels; with the sheet, and the index in it, of every row.
fn read_taxels(source: &Source) -> Result<(Draft, Vec<(usize, u32)>)> {
    let known: Vec<&str> =
        COLUMNS.split(',').chain([LINK, SIGMA, PRESENCE, MODALITY]).chain(TANGENT).collect();
    let table = Table::of(source)?;
    let unused: Vec<String> = table.columns.unknown(&known).map(|(_, name)| name.to_owned()).collect();
    let indices = ColumnIndices::new(&table.columns)?;
    let mut sheets = Sheets::default();
    table.each_row(&mut |row| sheets.add(row, &indices, source))?;
    for sheet in &mut sheets.draft.sheets {
        if indices.tangent.is_none() {
            drop_placeholders(sheet, indices.normal.is_some());
        }
        sheet.follow_modalities();
        sheet.covariances.take_if(|all| all.iter().all(Option::is_none));
    }
    remark_unused(&mut sheets.draft, source, unused);
    Ok((sheets.draft, sheets.homes))
}

/// Drops frames that are all the identity: those of a calibration of positions alone are not known,
/// unless normals of their own confirm them.
fn drop_placeholders(sheet: &mut Sheet, has_normals: bool) {
    let all = |axes: &Option<Vec<DVec3>>, axis| axes.as_ref().is_some_and(|a| a.iter().all(|x| *x == axis));
    let is_upright = all(&sheet.normals, DVec3::Z);
    if all(&sheet.tangents, DVec3::X) && is_upright != has_normals {
        sheet.tangents = None;
        sheet.normals = sheet.normals.take().filter(|_| has_normals);
    }
}

impl Sheets {
    fn add(&mut self, row: Row<'_>, indices: &ColumnIndices, source: &Source) -> Result<()> {
        let link = self.link(indices.link.map_or("", |c| row.text(c)));
        let name = indices.patch.map_or("", |c| row.text(c));
        let sheets = &mut self.draft.sheets;
        let at = match self.by_name.get(name) {
            Some(&at) => at,
            None => {
                self.by_name.insert(name.to_owned(), sheets.len());
                let name = if name.is_empty() { source.stem() } else { name.to_owned() };
                sheets.push(Sheet { name, link, ..Sheet::default() });
                sheets.len() - 1
            }
        };
        let sheet = &mut sheets[at];
        if let (true, Some(column)) = (sheet.link != link, indices.link) {
            return Err(row.invalid(column, "the link of the other taxels of its patch"));
        }
        let place = sheet.positions.len();
        sheet.positions.push(row.vector(indices.position)?);
        if let Some(column) = indices.id {
            sheet.ids.get_or_insert_default().push(taxel_id(row, column)?);
        }
        if let Some(columns) = indices.normal {
            let normal = row.numbers_if_any(columns)?.map(DVec3::from_array);
            push((row, columns[0], place), &mut sheet.normals, normal)?;
        }
        if let Some(columns) = indices.rotation {
            let rotation = row.rotation_if_any(columns)?;
            let axis = |axis| rotation.map(|rotation| rotation * axis);
            push((row, columns[0], place), &mut sheet.tangents, axis(DVec3::X))?;
            if indices.normal.is_none() {
                push((row, columns[0], place), &mut sheet.normals, axis(DVec3::Z))?;
            }
        }
        if let Some(columns) = indices.tangent {
            let tangent = row.numbers_if_any(columns)?.map(DVec3::from_array);
            push((row, columns[0], place), &mut sheet.tangents, tangent)?;
        }
        if let Some(columns) = indices.covariance {
            let covariance = row.numbers_if_any(columns)?.map(Covariance::from);
            sheet.covariances.get_or_insert_default().push(covariance);
        }
        if let Some(column) = indices.sigma {
            row.number_if_any(column)?;
        }
        for (column, numbers) in [
            (indices.area, &mut sheet.areas),
            (indices.density, &mut sheet.densities),
            (indices.weight, &mut sheet.weights),
        ] {
            let Some(column) = column else { continue };
            push((row, column, place), numbers, row.number_if_any(column)?)?;
        }
        if let Some(column) = indices.region {
            let region = Some(row.text(column)).filter(|name| !name.is_empty());
            if region.is_some_and(|name| !is_region_name(name)) {
                return Err(row.invalid(column, NAME_NEEDED));
            }
            sheet.regions.get_or_insert_default().push(region.map(RegionName::from));
        }
        if let Some(column) = indices.modality {
            let modalities = Some(row.text(column)).filter(|names| !names.is_empty());
            if modalities.is_some_and(|names| !are_modalities(names)) {
                return Err(row.invalid(column, NAMES_OF_MODALITIES));
            }
            sheet.modalities.get_or_insert_default().push(modalities.map(Modalities::from));
        }
        if let Some(column) = indices.present {
            let word = row.text(column);
            let presence = finite(word).map_or_else(|| word.parse().ok(), Presence::from_code);
            let needed = "0 (`absent`), 1 (`present`), 2 (`thermal`, a thermal pad) or 3 (`other`)";
            let presence = presence.ok_or_else(|| row.invalid(column, needed))?;
            sheet.presence.get_or_insert_default().push(presence);
        }
        self.homes.push((at, VertexId::new(place).raw()));
        Ok(())
    }

    fn link(&mut self, name: &str) -> Option<LinkId> {
        if name.is_empty() {
            return None;
        }
        if let Some(&link) = self.links.get(name) {
            return Some(link);
        }
        let link = Link { name: name.to_owned(), parent: None, pose: DAffine3::IDENTITY };
        let link = self.draft.links.push(link);
        self.links.insert(name.to_owned(), link);
        Some(link)
    }
}

/// Appends a cell of a column that is filled for all taxels of a sheet, `before` so far, or for none.
fn push<T>(
    (row, column, before): (Row<'_>, usize, usize),
    values: &mut Option<Vec<T>>,
    value: Option<T>,
) -> Result<()> {
    match value {
        Some(value) if values.is_some() || before == 0 => values.get_or_insert_default().push(value),
        None if values.is_none() => {}
        _ => return Err(row.invalid(column, "a value for every taxel of a patch, or for none")),
    }
    Ok(())
}

fn taxel_id(row: Row<'_>, column: usize) -> Result<TaxelId> {
    if row.text(column) == "-1" {
        return Ok(TaxelId(u32::MAX));
    }
    row.taxel(column)
}

/// Notes columns that are not read.
fn remark_unused(draft: &mut Draft, source: &Source, columns: Vec<String>) {
    if !columns.is_empty() {
        let kind = RemarkKind::ColumnsNotRead { columns };
        draft.remarks.push(Remark { patch: source.stem(), kind });
    }
}

fn read_triangles(source: &Source, homes: &[(usize, u32)], draft: &mut Draft) -> Result<()> {
    let table = Table::of(source)?;
    let corners = Corners::new(&table.columns)?;
    let unused = table.columns.unknown(&corners.names).map(|(_, name)| name.to_owned()).collect();
    remark_unused(draft, source, unused);
    let sheets = &draft.sheets;
    let id = |&(sheet, place): &(usize, u32)| sheets[sheet].ids.as_ref().map(|ids| ids[place as usize]);
    let taxels = Taxels::new(homes.len(), homes.iter().filter_map(id));
    table.each_row(&mut |row| {
        let homes = corners.rows_of(row, &taxels)?.map(|row| homes[row]);
        let [(sheet, _), ..] = homes;
        if let Some(other) = homes.iter().position(|home| home.0 != sheet) {
            let needed = "a taxel of the same patch as the other corners";
            return Err(row.invalid(corners.columns[other], needed));
        }
        draft.sheets[sheet].triangles.push(homes.map(|home| home.1));
        Ok(())
    })?;
    Ok(())
}

/// Writes the two tables, positions in the world. Of the links only their names are kept.
pub(crate) fn write(path: &OutPath, skin: &Skin) -> Result<()> {
    path.together(|path| {
        let has_modalities = skin.patches.iter().any(|patch| patch.taxels.modalities.is_some());
        let columns = if has_modalities { format!("{COLUMNS},{MODALITY}") } else { COLUMNS.to_owned() };
        write_table(path, &columns, |taxels| {
            for patch in &skin.patches {
                let link = &skin.links[patch.link].name;
                write_taxels(taxels, &skin.in_world(patch), link, has_modalities)?;
            }
            Ok(())
        })?;
        write_table(&path.beside(triangles_path(path)), &BY_ROW.join(","), |triangles| {
            for corners in all_triangles(skin) {
                corners.into_iter().for_each(|row| triangles.whole(row as u64));
                triangles.end_row()?;
            }
            Ok(())
        })
    })
}

fn write_taxels<W: Write>(
    table: &mut TableWriter<W>,
    patch: &Patch,
    link: &str,
    has_modalities: bool,
) -> Result<()> {
    let taxels = &patch.taxels;
    for (v, x) in patch.mesh.positions.enumerate() {
        let n = taxels.normals[v];
        table.whole(taxels.ids[v].0);
        table.numbers(x.to_array().into_iter().chain(n.to_array()));
        match &taxels.tangents {
            Some(tangents) => table.numbers(rotation(tangents[v], n).to_array()),
            None => table.empty(4),
        }
        table.numbers([taxels.areas[v]]);
        for column in [&taxels.densities, &taxels.weights] {
            table.number_if_any(column.as_ref().map(|column| column[v]));
        }
        table.whole(taxels.presence[v].code());
        table.cell(&patch.name);
        table.cell(link);
        match taxels.covariances.as_ref().and_then(|covariances| covariances[v]) {
            Some(c) => table.numbers(<[f64; 6]>::from(c)),
            None => table.empty(6),
        }
        let name = |column: &Option<IdVec<VertexId, Option<RegionName>>>| {
            column.as_ref().and_then(|all| all[v].clone())
        };
        table.cell(name(&taxels.regions).as_deref().unwrap_or_default());
        if has_modalities {
            table.cell(name(&taxels.modalities).as_deref().unwrap_or_default());
        }
        table.end_row()?;
    }
    Ok(())
}

/// The rotation whose x and z axes are a tangent and a normal.
fn rotation(tangent: DVec3, normal: DVec3) -> DQuat {
    let (x, z) = (tangent.normalize(), normal.normalize());
    DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z)).normalize()
}
