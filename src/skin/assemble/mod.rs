pub(super) mod zero_area;

use glam::{DAffine3, DVec3};

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Edges, MeshError, TriMesh},
    skin::{
        Draft, Link, LinkId, MeshOptions, Patch, Presence, Remark, RemarkKind, Sheet, Skin, SkinError,
        TaxelError, TaxelId, Taxels,
        assemble::zero_area::{Cleared, clear_zero_area},
        mesh_bare,
        names::{Names, sheet_name},
        normals::{Worth, enclosed_volume, poll, surface_normals, taxel_normals},
        remark::first_few,
        unit_check::doubtful_unit,
        welded::Surface,
        winding::Winding,
    },
};

/// A skin, and what had to be done to get it.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// The skin.
    pub skin: Skin,
    /// What was changed or left out, sheet by sheet.
    pub remarks: Vec<Remark>,
}

/// Welds, splits into patches and orients: whatever can be repaired without guessing is, and every change is told.
///
/// - **Welding**: vertices are one taxel if their positions are exactly equal and their ids are, or there are no ids;
///   with different ids they stay two taxels, unless one face has both. A weld that would only make sheets
///   touch in a point is undone.
/// - **Faces** that use a taxel twice are left out; faces without area are dropped at the boundary and flipped away
///   elsewhere, so that no slit opens. Taxels without a face are left out.
/// - **Patches** are the pieces that hang together across edges, in the order of their first faces: `name`, `name.1`, ...
/// - **Winding** is made consistent; the outside is where the taxels' normals point if these are believable (unit
///   vectors, not constant on a curved part, on the whole along the faces), else the outside of a closed surface, else
///   where most faces of the file have it.
/// - **Bare taxels**, a draft without any triangle, are meshed first, by [`mesh_bare`].
/// - **Normals** that are missing or not believable, and areas that are missing or not positive, come from the
///   triangles. Missing ids count from 1 through the skin. Sheets without a link hang on one at the origin.
///
/// # Errors
/// If links or arrays do not fit, a position is not finite, a corner or a density is out of range, more than two
/// faces meet at an edge, fans of faces touch in a point, a sheet has one side only, or there is no face at all.
pub fn assemble(draft: &Draft) -> Result<Assembled, SkinError> {
    let meshed = if draft.is_bare() { Some(mesh_bare(draft, &MeshOptions::default())?) } else { None };
    let draft = meshed.as_ref().unwrap_or(draft);
    let mut skin = Skin { links: draft.links.clone(), patches: IdVec::new() };
    check_links(&skin.links)?;
    let mut remarks = draft.remarks.clone();
    if let Some((sheet, message)) = doubtful_unit(&draft.sheets) {
        remarks.push(Remark { kind: RemarkKind::DoubtfulUnit, patch: sheet.to_owned(), message });
    }
    let mut names = Names::new(&draft.sheets);
    let mut next_id = 1;
    let mut origin = None;
    for sheet in &draft.sheets {
        check_sheet(sheet, &draft.links)?;
        let pieces = Pieces::new(sheet, &mut remarks)?;
        let first = skin.patches.len();
        for piece in pieces.split() {
            let link =
                sheet.link.unwrap_or_else(|| *origin.get_or_insert_with(|| origin_of(&mut skin.links)));
            let name = names.next(sheet_name(sheet));
            let patch = pieces.patch(piece, name, link, &mut next_id, &mut remarks)?;
            skin.patches.push(patch);
        }
        remark_names(sheet, &skin.patches.as_slice()[first..], &mut remarks);
    }
    if skin.patches.is_empty() {
        return Err(SkinError::NoTriangles);
    }
    skin.validate()?;
    Ok(Assembled { skin, remarks })
}

/// A link at the origin, for sheets that hang on none.
fn origin_of(links: &mut IdVec<LinkId, Link>) -> LinkId {
    links.push(Link { name: String::new(), parent: None, pose: DAffine3::IDENTITY })
}

fn check_links(links: &IdVec<LinkId, Link>) -> Result<(), SkinError> {
    match links.enumerate().find(|(link, l)| l.parent.is_some_and(|p| p >= *link)) {
        Some((link, _)) => Err(SkinError::LinkOrder { link }),
        None => Ok(()),
    }
}

/// Refuses what would make every further step guess.
pub(super) fn check_sheet(sheet: &Sheet, links: &IdVec<LinkId, Link>) -> Result<(), SkinError> {
    let patch = || sheet_name(sheet).to_owned();
    if let Some(link) = sheet.link.filter(|l| l.index() >= links.len()) {
        return Err(SkinError::UnknownLink { patch: patch(), link });
    }
    let needed = sheet.positions.len();
    if let Some((what, found)) = sheet.wrong_length() {
        let source = TaxelError::Length { what, found, needed };
        return Err(SkinError::Taxels { patch: patch(), source });
    }
    let refuse = |source| Err(SkinError::Mesh { patch: patch(), source });
    let faces = sheet.triangles.len();
    if needed >= u32::MAX as usize || faces >= (u32::MAX / 3) as usize {
        return refuse(MeshError::TooMany { vertices: needed, faces });
    }
    if let Some(v) = sheet.positions.iter().position(|p| !p.is_finite()) {
        let position = sheet.positions[v].to_array();
        return refuse(MeshError::NotFinite { vertex: VertexId::new(v), position });
    }
    for (face, t) in sheet.triangles.iter().enumerate() {
        if let Some(&v) = t.iter().find(|&&v| v as usize >= needed) {
            let (face, vertex) = (FaceId::new(face), VertexId::from(v));
            return refuse(MeshError::CornerOutOfRange { face, vertex, vertices: needed });
        }
    }
    Ok(())
}

/// Tells of a sheet that fell into several patches, or whose name was taken.
fn remark_names(sheet: &Sheet, patches: &[Patch], remarks: &mut Vec<Remark>) {
    let name = sheet_name(sheet).to_owned();
    let list = || first_few(patches.iter().map(|p| &p.name));
    if patches.len() > 1 {
        let message =
            format!("falls into {} pieces that share no edge; they are now {}", patches.len(), list());
        remarks.push(Remark { kind: RemarkKind::Components, patch: name, message });
    } else if patches.len() == 1 && patches[0].name != name {
        let message = format!("the name is taken; this patch is now {}", list());
        remarks.push(Remark { kind: RemarkKind::Renamed, patch: name, message });
    }
}

/// Tells which faces were left out or flipped.
fn remark_faces(
    repeated: &[FaceId],
    cleared: &Cleared,
    file_faces: &IdVec<FaceId, FaceId>,
    tell: &mut impl FnMut(RemarkKind, String),
) {
    if !repeated.is_empty() {
        let list = first_few(repeated.iter());
        tell(
            RemarkKind::RepeatedCorner,
            format!("{} faces use a taxel twice and were left out: {list}", repeated.len()),
        );
    }
    let in_file = |faces: &[FaceId]| first_few(faces.iter().map(|&f| file_faces[f]));
    for (faces, done) in [
        (&cleared.dropped, "at the boundary were dropped"),
        (&cleared.flipped, "had their longest side flipped"),
        (&cleared.kept, "were kept, since nothing could be done about them without a slit"),
    ] {
        if !faces.is_empty() {
            let message = format!("{} faces without area {done}: {}", faces.len(), in_file(faces));
            tell(RemarkKind::ZeroArea, message);
        }
    }
}

/// One sheet welded, wound consistently and free of faces without area, about to be split into patches.
struct Pieces<'a> {
    sheet: &'a Sheet,
    mesh: TriMesh,
    /// The piece of each face; `None` for a face that was dropped.
    piece: IdVec<FaceId, Option<usize>>,
    pieces: usize,
    /// Whether each face is wound against the file.
    turned: IdVec<FaceId, bool>,
    /// Believable parts of the taxels' normals; `None` without normals.
    normals: Option<IdVec<VertexId, DVec3>>,
}

/// One patch to be: its taxels and faces in the numbers of [`Pieces::mesh`].
#[derive(Debug, Clone, Default)]
struct Piece {
    vertices: Vec<VertexId>,
    mesh: TriMesh,
    /// How many of its faces are wound against the file.
    turned: usize,
}

impl<'a> Pieces<'a> {
    fn new(sheet: &'a Sheet, remarks: &mut Vec<Remark>) -> Result<Self, SkinError> {
        let patch = || sheet_name(sheet).to_owned();
        let mut surface = Surface::new(sheet, |_| true);
        let edges = Edges::new(&surface.mesh.triangles, surface.mesh.positions.len());
        let crowded: Vec<[VertexId; 2]> = edges
            .iter()
            .filter(|uses| uses.len() > 2)
            .map(|uses| [uses[0].start(&surface.mesh), uses[0].end(&surface.mesh)])
            .collect();
        if !crowded.is_empty() {
            return Err(SkinError::NonManifoldEdges { patch: patch(), edges: crowded });
        }
        let vertices = surface.part_fans(sheet, &edges);
        if !vertices.is_empty() {
            return Err(SkinError::NonManifoldVertices { patch: patch(), vertices });
        }
        let winding = Winding::new(&surface.mesh, &edges);
        if let Some(&edge) = winding.contradictions.first() {
            return Err(SkinError::NotOrientable { patch: patch(), edge });
        }
        drop(edges);
        let Surface { mut mesh, taxel, file_faces, repeated } = surface;
        for (face, t) in mesh.triangles.iter_mut().enumerate() {
            if winding.against_first[FaceId::new(face)] {
                t.swap(1, 2);
            }
        }
        let cleared = clear_zero_area(&mut mesh);
        let mut piece: IdVec<FaceId, Option<usize>> = winding.component.map(|&c| Some(c));
        for &face in &cleared.dropped {
            piece[face] = None;
        }
        let normals = sheet.normals.as_deref().map(|n| taxel_normals(n, &taxel));
        let (turned, pieces) = (winding.against_first, winding.components);
        let this = Self { sheet, mesh, piece, pieces, turned, normals };
        let mut tell = |kind, message| remarks.push(Remark { kind, patch: patch(), message });
        remark_faces(&repeated, &cleared, &file_faces, &mut tell);
        this.remark_taxels(&taxel, &mut tell);
        Ok(this)
    }

    /// Tells which taxels have no face (any more), and how many vertices were welded.
    fn remark_taxels(&self, taxel: &IdVec<VertexId, VertexId>, tell: &mut impl FnMut(RemarkKind, String)) {
        let mut in_file = vec![false; taxel.len()];
        for &v in self.sheet.triangles.iter().flatten() {
            in_file[v as usize] = true;
        }
        let mut used = IdVec::<VertexId, bool>::filled(false, taxel.len());
        for (face, t) in self.mesh.triangles.enumerate() {
            if self.piece[face].is_some() {
                t.iter().for_each(|&v| used[v] = true);
            }
        }
        let mut merged = 0_usize;
        let mut left_out = Vec::new();
        for (v, &first) in taxel.enumerate() {
            if used[first] && in_file[v.index()] {
                merged += usize::from(first != v);
            } else if !used[first] {
                left_out.push(v);
            }
        }
        if merged > 0 {
            let taxels = used.iter().filter(|&&u| u).count();
            tell(
                RemarkKind::Welded,
                format!("{} vertices were welded into {taxels} taxels", taxels + merged),
            );
        }
        if !left_out.is_empty() {
            let list = first_few(left_out.iter());
            tell(
                RemarkKind::LeftOut,
                format!("{} taxels without a face were left out: vertices {list}", left_out.len()),
            );
        }
    }

    /// The taxels and faces of each piece that has any, in the order of the file.
    fn split(&self) -> Vec<Piece> {
        let mut pieces = vec![Piece::default(); self.pieces];
        let mut of_vertex = IdVec::<VertexId, Option<usize>>::filled(None, self.mesh.positions.len());
        for (face, t) in self.mesh.triangles.enumerate() {
            if let Some(piece) = self.piece[face] {
                t.iter().for_each(|&v| of_vertex[v] = Some(piece));
            }
        }
        let mut local = IdVec::<VertexId, VertexId>::filled(VertexId::default(), self.mesh.positions.len());
        for (v, &piece) in of_vertex.enumerate() {
            if let Some(piece) = piece {
                pieces[piece].vertices.push(v);
                local[v] = pieces[piece].mesh.positions.push(self.mesh.positions[v]);
            }
        }
        for (face, t) in self.mesh.triangles.enumerate() {
            if let Some(piece) = self.piece[face] {
                pieces[piece].mesh.triangles.push(t.map(|v| local[v]));
                pieces[piece].turned += usize::from(self.turned[face]);
            }
        }
        pieces.retain(|p| !p.vertices.is_empty());
        pieces
    }

    /// Turns `piece` outward and gives its taxels what the file says about them.
    fn patch(
        &self,
        mut piece: Piece,
        name: String,
        link: LinkId,
        next_id: &mut u32,
        remarks: &mut Vec<Remark>,
    ) -> Result<Patch, SkinError> {
        let mut tell = |kind, message| remarks.push(Remark { kind, patch: name.clone(), message });
        let given = self
            .normals
            .as_ref()
            .map(|normals| piece.vertices.iter().map(|&v| normals[v]).collect::<IdVec<VertexId, DVec3>>());
        let worth = given.as_ref().map(|given| poll(&piece.mesh, given).worth());
        turn_outward(&mut piece, worth, &mut tell);
        let Piece { vertices, mesh, .. } = piece;
        let normals = choose_normals(&mesh, given, worth, &mut tell);
        let ids = match &self.sheet.ids {
            Some(ids) => vertices.iter().map(|v| ids[v.index()]).collect(),
            None => vertices.iter().map(|_| count_on(next_id)).collect(),
        };
        let areas = self.areas(&vertices, &mesh, &mut tell);
        let presence = vertices
            .iter()
            .map(|v| self.sheet.presence.as_ref().map_or(Presence::Present, |p| p[v.index()]))
            .collect();
        let densities =
            self.sheet.densities.as_ref().map(|d| vertices.iter().map(|v| d[v.index()]).collect());
        if let Some((&vertex, &found)) = vertices
            .iter()
            .zip(densities.iter().flat_map(IdVec::<VertexId, f64>::iter))
            .find(|(_, d)| !(d.is_finite() && **d > 0.0))
        {
            return Err(SkinError::Taxels { patch: name, source: TaxelError::Density { vertex, found } });
        }
        let covariances =
            self.sheet.covariances.as_ref().map(|c| vertices.iter().map(|v| c[v.index()]).collect());
        let taxels = Taxels { ids, normals, areas, densities, presence, covariances };
        Ok(Patch { name, link, mesh, taxels })
    }

    /// The areas of the file where they are positive, else those of the triangles.
    fn areas(
        &self,
        vertices: &[VertexId],
        mesh: &TriMesh,
        tell: &mut impl FnMut(RemarkKind, String),
    ) -> IdVec<VertexId, f64> {
        let mut areas = mesh.vertex_areas();
        let Some(given) = &self.sheet.areas else { return areas };
        let mut replaced = Vec::new();
        for (area, &v) in areas.iter_mut().zip(vertices) {
            let found = given[v.index()];
            if found.is_finite() && found > 0.0 {
                *area = found;
            } else {
                replaced.push(v);
            }
        }
        if !replaced.is_empty() {
            let message = format!(
                "{} areas were not positive and were measured instead: vertices {}",
                replaced.len(),
                first_few(replaced.iter())
            );
            tell(RemarkKind::Areas, message);
        }
        areas
    }
}

/// The next id for a taxel that has none; starts again after the last 32-bit number.
fn count_on(next_id: &mut u32) -> TaxelId {
    let id = TaxelId(*next_id);
    *next_id = next_id.wrapping_add(1);
    id
}

/// Turns all faces over if the inside is out, and tells how many faces then differ from the file.
fn turn_outward(piece: &mut Piece, worth: Option<Worth>, tell: &mut impl FnMut(RemarkKind, String)) {
    let faces = piece.mesh.triangles.len();
    let (inside_out, reason) = match worth {
        Some(Worth::Outward) => (false, "the taxels' normals"),
        Some(Worth::Inward) => (true, "the taxels' normals"),
        _ => match enclosed_volume(&piece.mesh) {
            Some(volume) => (volume < 0.0, "the closed surface"),
            None => (2 * piece.turned > faces, "most of its faces"),
        },
    };
    if inside_out {
        piece.mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        piece.turned = faces - piece.turned;
    }
    if piece.turned == faces {
        tell(
            RemarkKind::Turned,
            format!("all {faces} faces were wound against {reason} and were turned over"),
        );
    } else if piece.turned > 0 {
        let turned = piece.turned;
        let message = format!(
            "the winding was not consistent: {turned} of {faces} faces were turned over; the outside follows {reason}"
        );
        tell(RemarkKind::Turned, message);
    }
}

/// The given normals where they are believable, else those of the faces.
fn choose_normals(
    mesh: &TriMesh,
    given: Option<IdVec<VertexId, DVec3>>,
    worth: Option<Worth>,
    tell: &mut impl FnMut(RemarkKind, String),
) -> IdVec<VertexId, DVec3> {
    let mut normals = surface_normals(mesh);
    let (Some(given), Some(worth)) = (given, worth) else { return normals };
    let why = match worth {
        Worth::Outward | Worth::Inward => {
            let mut replaced = 0_usize;
            for (normal, &n) in normals.iter_mut().zip(&given) {
                if n.dot(*normal) > 0.0 {
                    *normal = n;
                } else {
                    replaced += 1;
                }
            }
            if replaced > 0 {
                let message = format!(
                    "{replaced} normals are no unit vectors or point inwards; those of the faces replace them"
                );
                tell(RemarkKind::Normals, message);
            }
            return normals;
        }
        Worth::NotUnit => "most normals are no unit vectors",
        Worth::Constant => "the normals are all the same although the patch is curved",
        Worth::Unrelated => "the normals do not fit the faces",
    };
    tell(RemarkKind::Normals, format!("{why}; those of the faces replace them"));
    normals
}
