//! Assembling: a draft becomes a skin, and every repair is reported.
//!
//! [`assemble`] takes these steps for every sheet: `components` and `zero_area` split it into components,
//! `patch` makes a patch of each.

mod components;
mod orient;
mod patch;
pub(in crate::skin) mod zero_area;

use glam::{DAffine3, DVec3};

pub use orient::{Oriented, orient};

use crate::mesh::FillHoles;
use crate::skin::assemble::components::Components;
use crate::skin::assemble::patch::patch_of;
use crate::skin::triangulate::triangulate_taxels;
use crate::skin::weld::{Weld, WeldOptions};
use crate::skin::{
    Draft, Link, LinkId, Names, Patch, Remark, RemarkKind, Sheet, Skin, SkinError, TaxelId, check_links,
};

/// How a draft is assembled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AssembleOptions {
    /// Longest edge between bare taxels over the spacing of the taxels at its ends, from 1 to 20. Longer
    /// distances are gaps, with a boundary on each side.
    pub gap: f64,
    /// Which holes are filled; the longest loop of a patch is its outer boundary and is not filled, except a
    /// pin-hole of a closed body.
    pub fill_holes: FillHoles,
    /// Which coincident vertices are one taxel.
    pub weld: Weld,
    /// Drop faces with the corners of an earlier one, split edges with more than two faces into solids that
    /// touch there or sheets that continue each other, and cut one-sided surfaces open.
    pub repair: bool,
    /// The direction of the outside of bare taxels, in the world with the links at rest, for components whose outside
    /// the file does not determine.
    pub outside: Option<DVec3>,
    /// Leave out the sheets that cannot be repaired, instead of refusing the draft.
    pub keep_going: bool,
}

impl AssembleOptions {
    pub(in crate::skin) const fn welding(&self) -> WeldOptions {
        WeldOptions { weld: self.weld, repair: self.repair }
    }
}

impl Default for AssembleOptions {
    fn default() -> Self {
        Self {
            gap: 2.5,
            fill_holes: FillHoles::None,
            weld: Weld::Auto,
            repair: false,
            outside: None,
            keep_going: false,
        }
    }
}

/// A skin, and the remarks on how it was assembled.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// The skin.
    pub skin: Skin,
    /// What was changed or left out, sheet by sheet.
    pub remarks: Vec<Remark>,
}

/// Welds, splits into patches and orients. Everything that can be repaired without guessing is repaired, and
/// every change is reported.
///
/// - **Bare taxels**, a file without any triangle, are joined first: by the triangles of the Delaunay
///   triangulations in their tangent planes whose edges are no longer than the gap
///   ([`AssembleOptions::gap`]). Taxels closer than a fiftieth of the spacing become one. The result does not
///   depend on the order of the taxels, except for the diagonals of squares.
/// - **Welding**: vertices are one taxel if their positions are exactly equal and their ids are, or
///   there are no ids; with different ids they stay two taxels, unless one face has both. A weld
///   that would make sheets touch is undone, and a surface that the file cuts open into a disk stays
///   cut ([`Weld`](crate::skin::Weld)).
/// - **Fans** of faces that touch in a vertex get a copy of it each. On request, faces with the
///   corners of an earlier one are dropped and edges with more than two faces split into sheets.
/// - **Faces** that use a taxel twice are left out; faces without area are dropped at the boundary
///   and flipped away elsewhere, so that no slit opens. Taxels without a face are left out.
/// - **Patches** are the components joined across edges, in the order of their first faces: `name`,
///   `name.1`, ...
/// - **Winding** is made consistent; the outside is where the taxels' normals point if these are reliable
///   (unit vectors, not constant on a curved surface, mostly along the normals of the faces), else the
///   outside of a closed surface, else that of most faces of the file.
/// - **Holes** are filled, on request.
/// - **Tangents** are projected to the tangent planes of the normals; an unusable one is replaced by the mean
///   of its neighbours', and if most are unusable the patch has none.
/// - **Normals** that are missing or not reliable, and areas that are missing or not positive, come
///   from the faces. Missing ids count through the skin, from 1 or after the largest of the file. Sheets without a link get one at
///   the origin.
///
/// ```
/// use dermatome::skin::{AssembleOptions, Draft, RemarkKind, Sheet, assemble};
/// use glam::DVec3;
///
/// // Two triangles with six vertices, as an STL file has them: two are welded.
/// let [a, b, c, d] = [DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::Y];
/// let positions = vec![a, b, c, a, c, d];
/// let sheet = Sheet { positions, triangles: vec![[0, 1, 2], [3, 4, 5]], ..Sheet::default() };
/// let draft = Draft { sheets: vec![sheet], ..Draft::default() };
/// let assembled = assemble(&draft, &AssembleOptions::default())?;
/// assert_eq!(assembled.remarks[0].kind, RemarkKind::Welded { vertices: 6, taxels: 4 });
/// assert_eq!(assembled.remarks[0].to_string(), "patch: 6 vertices were welded into 4 taxels");
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Errors
/// If links or arrays do not fit, a position is not finite, a corner, a density or the gap is out of range,
/// bare taxels cannot be joined, more than two faces meet at an edge, a sheet has only one side, or there is
/// no face.
pub fn assemble(draft: &Draft, options: &AssembleOptions) -> Result<Assembled, SkinError> {
    check_links(&draft.links)?;
    let triangulated =
        if draft.has_bare() { Some(triangulate_taxels(draft, options.gap, options.outside)?) } else { None };
    let draft = triangulated.as_ref().unwrap_or(draft);
    let mut assembly = Assembly::new(draft);
    for sheet in &draft.sheets {
        assembly.add(sheet, draft.links.len(), options);
    }
    let Assembly { skin, mut remarks, mut errors, .. } = assembly;
    if options.keep_going && !skin.patches.is_empty() {
        let left_out = |(patch, reason)| Remark { patch, kind: RemarkKind::PatchLeftOut { reason } };
        remarks.extend(errors.drain(..).map(left_out));
    }
    let mut errors: Vec<SkinError> = errors.into_iter().map(|(_, reason)| reason).collect();
    if errors.len() > 1 {
        return Err(SkinError::Several { errors, valid: skin.patches.len() });
    }
    if let Some(error) = errors.pop() {
        return Err(error);
    }
    if skin.patches.is_empty() {
        let faces = draft.sheets.iter().map(|sheet| sheet.triangles.len()).sum();
        return Err(if faces > 0 { SkinError::NoArea { faces } } else { SkinError::NoTriangles });
    }
    // Links are checked above, and each patch when it is made.
    Ok(Assembled { skin, remarks })
}

/// A skin that is assembled sheet by sheet.
struct Assembly {
    skin: Skin,
    remarks: Vec<Remark>,
    /// Why some sheets, by their names, are not a valid skin.
    errors: Vec<(String, SkinError)>,
    names: Names,
    /// The id of the next taxel that has none.
    next_id: u32,
    /// The link of sheets that have none.
    origin: Option<LinkId>,
}

impl Assembly {
    fn new(draft: &Draft) -> Self {
        let mut remarks = draft.remarks.clone();
        remarks.extend(draft.doubtful_unit().map(|(sheet, extent)| Remark {
            patch: sheet.title().to_owned(),
            kind: RemarkKind::DoubtfulUnit { extent },
        }));
        let ids = draft.sheets.iter().filter_map(|sheet| sheet.ids.as_ref()).flatten();
        let largest = ids.filter(|id| !TaxelId::PLACEHOLDERS.contains(id)).max();
        Self {
            skin: Skin {
                links: draft.links.clone(),
                animations: draft.animations.clone(),
                ..Skin::default()
            },
            remarks,
            errors: Vec::new(),
            names: Names::new(draft.sheets.iter().map(Sheet::title)),
            next_id: largest.map_or(1, |id| id.0 + 1),
            origin: None,
        }
    }

    /// Adds the patches of a sheet of a draft with this many links, its remarks and its error.
    fn add(&mut self, sheet: &Sheet, links: usize, options: &AssembleOptions) {
        let mut kinds = Vec::new();
        let valid = sheet.validate(links);
        let components = match valid.and_then(|()| Components::new(sheet, options.welding(), &mut kinds)) {
            Ok(components) => components,
            Err(reason) => return self.errors.push((sheet.title().to_owned(), reason)),
        };
        self.remark(sheet.title(), kinds.drain(..));
        let first = self.skin.patches.len();
        for component in components.split() {
            let mut next_id = self.next_id;
            match patch_of(&components, component, links, options.fill_holes, &mut next_id, &mut kinds) {
                Ok(patch) => {
                    self.next_id = next_id;
                    let link = sheet.link.unwrap_or_else(|| self.origin());
                    let name = self.names.next(sheet.title());
                    self.remark(&name, kinds.drain(..));
                    self.skin.patches.push(Patch { name, link, ..patch });
                }
                Err(reason) => {
                    kinds.clear();
                    self.errors.push((sheet.title().to_owned(), reason));
                }
            }
        }
        let renamed = renamed(sheet, &self.skin.patches.as_slice()[first..]);
        self.remark(sheet.title(), renamed);
    }

    fn remark(&mut self, patch: &str, kinds: impl IntoIterator<Item = RemarkKind>) {
        self.remarks.extend(kinds.into_iter().map(|kind| Remark { patch: patch.to_owned(), kind }));
    }

    fn origin(&mut self) -> LinkId {
        let link = || Link { name: String::new(), parent: None, pose: DAffine3::IDENTITY };
        *self.origin.get_or_insert_with(|| self.skin.links.push(link()))
    }
}

/// The remark that a sheet became several patches, or that its name was taken.
fn renamed(sheet: &Sheet, patches: &[Patch]) -> Option<RemarkKind> {
    match patches {
        [patch] if patch.name == sheet.title() => None,
        [patch] => Some(RemarkKind::Renamed { name: patch.name.clone() }),
        [] => None,
        _ => Some(RemarkKind::Components { patches: patches.iter().map(|p| p.name.clone()).collect() }),
    }
}
