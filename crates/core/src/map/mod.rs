//! Somatosensory maps: every patch with every level, its map and how they are joined.
//!
//! A [`SkinMap`] is the content of `map.glb` and all that lookup and images need; it is made from a skin or
//! read from a file. Only [`SkinMap::validate`] decides what is a valid map.

mod carried_places;
mod error;
mod fields;
mod frame;
mod on_atlas;
mod regions;

use std::borrow::Cow;

use glam::{DAffine3, DVec2, DVec3};

use crate::body::{
    Body, BodyRows, BodyTaxel, Gap, Modality, body_levels, gap_links, is_valid, modalities, shrinks,
};
use crate::cut::{CutMesh, PlaceId, seam_length};
use crate::flatten::{Convergence, Distortion, distortion};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{FARTHEST, SurfacePoint, TriMesh, VertexCorners, signed_area};
use crate::parallel::par_each;
use crate::pyramid::{Level, LevelId, Prolongation, Pyramid, PyramidError, check_levels};
use crate::skin::{
    Link, LinkId, Motion, Patch, PatchId, Skin, SkinError, Taxels, check_patches, tangents_along,
};

pub use carried_places::carried_places;
pub(crate) use carried_places::{CarriedRow, carried_rows};
pub use error::MapError;
pub use frame::ImageFrame;
pub(crate) use frame::PixelGrid;
pub use on_atlas::{OnAtlas, OnPatch};
pub use regions::{FieldRegions, RegionId, Regions};

/// One level of a patch with its map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapLevel {
    /// The level: its mesh in the link's frame, and how it is joined to the others.
    pub level: Level,
    /// How the level is cut open on the map: a vertex of the seam has several places there. `None` where it
    /// is not cut; then its vertices are the places of the map.
    pub cut: Option<CutMesh>,
    /// Map positions of the places, in m.
    pub uv: IdVec<PlaceId, DVec2>,
    /// The rectangle its image shows.
    pub frame: ImageFrame,
    /// How faithful the map is; after a build measured in the 32-bit numbers of a map file.
    pub distortion: Distortion,
    /// How far its minimisation came, where known: files do not store it.
    pub convergence: Option<Convergence>,
}

impl MapLevel {
    /// A level with its map `uv` (m), which is not measured; images have `pixel` metres per pixel.
    pub(crate) fn new(level: Level, cut: Option<CutMesh>, uv: IdVec<PlaceId, DVec2>, pixel: f64) -> Self {
        let frame = ImageFrame::around(&uv, pixel);
        Self { level, cut, uv, frame, distortion: Distortion::default(), convergence: None }
    }

    /// Gives its image `pixel` metres per pixel.
    #[doc(hidden)]
    pub fn set_pixel(&mut self, pixel: f64) {
        self.frame = ImageFrame::around(&self.uv, pixel);
    }

    /// Whether all faces that have an area on the skin are mirrored on the map.
    fn is_mirrored(&self) -> bool {
        let mesh = &self.level.mesh;
        let faces = mesh.triangles.ids().filter(|&face| mesh.face_cross(face) != DVec3::ZERO);
        let mut areas = faces.map(|face| signed_area(self.uv_of(face))).peekable();
        areas.peek().is_some() && areas.all(|area| area < 0.0)
    }

    /// Measures the distortion anew.
    /// Panics if the map does not have one position per place, or a triangle names a vertex that does not exist.
    #[doc(hidden)]
    pub fn measure(&mut self) {
        self.distortion = distortion(&self.opened(), &self.opened_uv());
    }

    /// The corners of a face, as places of the map.
    ///
    /// # Panics
    /// If there is no such face.
    #[inline]
    pub fn places(&self, face: FaceId) -> [PlaceId; 3] {
        match &self.cut {
            Some(cut) => cut.triangles[face],
            None => self.level.mesh.triangles[face].map(PlaceId::first_of),
        }
    }

    /// The corners of every face, as places of the map.
    #[doc(hidden)]
    pub fn corners(&self) -> IdVec<FaceId, [PlaceId; 3]> {
        self.level.mesh.triangles.ids().map(|face| self.places(face)).collect()
    }

    /// Where the corners of a face lie on the map, in m.
    #[doc(hidden)]
    pub fn uv_of(&self, face: FaceId) -> [DVec2; 3] {
        self.places(face).map(|place| self.uv[place])
    }

    /// Where a point of the level lies on the map, in m.
    #[doc(hidden)]
    pub fn uv_at(&self, point: &SurfacePoint) -> DVec2 {
        self.uv_of(point.face).into_iter().zip(point.barycentric).map(|(uv, weight)| weight * uv).sum()
    }

    /// The vertex of the level for a place of the map.
    ///
    /// # Panics
    /// If there is no such place.
    #[inline]
    pub fn vertex_of(&self, place: PlaceId) -> VertexId {
        self.cut.as_ref().map_or(place.opened(), |cut| cut.unsplit[place])
    }

    /// The vertex of the level for each place of the map; `None` if the level is not cut: they are the same.
    #[doc(hidden)]
    pub fn unsplit(&self) -> Option<&IdVec<PlaceId, VertexId>> {
        self.cut.as_ref().map(|cut| &cut.unsplit)
    }

    /// Map positions of the vertices of [`Self::opened`], in m.
    pub fn opened_uv(&self) -> IdVec<VertexId, DVec2> {
        self.uv.clone().reindexed()
    }

    /// The mesh as it lies on the map: cut open.
    pub fn opened(&self) -> Cow<'_, TriMesh> {
        let mesh = &self.level.mesh;
        self.cut.as_ref().map_or(Cow::Borrowed(mesh), |cut| Cow::Owned(cut.mesh(&mesh.positions)))
    }

    /// The edges of its mesh along which the level is cut.
    #[doc(hidden)]
    pub fn seam(&self) -> Vec<[VertexId; 2]> {
        self.cut.as_ref().and_then(|cut| cut.seam(&self.level.mesh).ok()).unwrap_or_default()
    }

    /// Length of the seam along which the level is cut, in m; 0 without one.
    #[doc(hidden)]
    pub fn seam_length(&self) -> f64 {
        // The sum of no lengths is -0.
        seam_length(&self.level.mesh, &self.seam()) + 0.0
    }

    /// The face of the level that each row of its `to_finest` lies in: the one of smallest id with all
    /// vertices of positive weight.
    pub(crate) fn row_faces(&self, rows: &Prolongation) -> Result<IdVec<VertexId, FaceId>, PyramidError> {
        let mesh = &self.level.mesh;
        let around = VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len());
        let face_of = |(row, &weights): (VertexId, &[f64; 3])| {
            let corners = rows.indices[row];
            let is_corner = |t: &[VertexId; 3]| (0..3).all(|k| weights[k] == 0.0 || t.contains(&corners[k]));
            let mut faces =
                weights.iter().position(|w| *w != 0.0).into_iter().flat_map(|k| around.faces(corners[k]));
            let face = faces.find(|&f| is_corner(&mesh.triangles[f]));
            face.ok_or(PyramidError::NoFace { row, corners, weights })
        };
        Ok(rows.weights.enumerate().map(face_of).collect::<Result<Vec<_>, _>>()?.into())
    }
}

/// One patch with the maps of its levels.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchMap {
    /// Name of the patch.
    pub name: String,
    /// The link it is fixed to.
    pub link: LinkId,
    /// How many of the last triangles of level 0 fill holes: they are not skin.
    pub filled: usize,
    /// The properties of the taxels, the vertices of level 0.
    pub taxels: Taxels,
    /// The levels, finest first; at least one.
    pub levels: IdVec<LevelId, MapLevel>,
    /// Where it lies on the [atlas](SkinMap::atlas), if there is one.
    pub atlas: Option<OnPatch>,
}

impl PatchMap {
    /// Joins a patch, its pyramid and the maps of its levels (m); images have `pixel` metres per
    /// pixel.
    ///
    /// Where there are fewer maps than levels, the coarsest levels are left out. Taxels without
    /// tangents get the direction in which `u` of level 0 grows most, in their
    /// tangent plane; where it has none there, the mean of their neighbours'.
    ///
    /// # Panics
    /// If a map does not have one position per vertex of its level, or a triangle names a vertex that does not exist.
    pub fn new(
        patch: &Patch,
        pyramid: Pyramid,
        maps: IdVec<LevelId, IdVec<VertexId, DVec2>>,
        pixel: f64,
    ) -> Self {
        let levels = pyramid.levels.into_iter().map(|level| (level, None)).collect();
        let mut map = Self::unmeasured(patch, levels, maps, pixel);
        map.levels.iter_mut().for_each(MapLevel::measure);
        map
    }

    /// Name of the patch on whose map it is drawn: of the [atlas](SkinMap::atlas), or its own.
    pub fn plane(&self) -> &str {
        self.atlas.as_ref().map_or(&self.name, |on| &on.patch)
    }

    /// That level, or the coarsest one of this patch if there is no such level.
    pub fn nearest_level(&self, level: LevelId) -> LevelId {
        level.min(LevelId::new(self.levels.len().saturating_sub(1)))
    }

    /// As [`Self::new`], without measuring the maps; levels may be cut open.
    #[doc(hidden)]
    pub fn unmeasured(
        patch: &Patch,
        levels: Vec<(Level, Option<CutMesh>)>,
        maps: IdVec<LevelId, IdVec<VertexId, DVec2>>,
        pixel: f64,
    ) -> Self {
        let levels = levels.into_iter().zip(maps);
        let levels = levels.map(|((level, cut), uv)| MapLevel::new(level, cut, uv.reindexed(), pixel));
        let levels: IdVec<LevelId, MapLevel> = levels.collect();
        let (name, taxels, count) = (patch.name.clone(), patch.taxels.clone(), levels.len());
        let mut map = Self { name, link: patch.link, filled: patch.filled, taxels, levels, atlas: None };
        if map.taxels.tangents.is_none() {
            map.set_tangents();
        }
        map.keep_finest(count);
        map
    }

    /// Gives the taxels the tangents of the map: see [`Self::new`].
    #[doc(hidden)]
    pub fn set_tangents(&mut self) {
        if let Some(finest) = self.levels.iter().next() {
            let directions = directions_of_u(finest);
            self.taxels.tangents =
                Some(tangents_along(&finest.level.mesh, &self.taxels.normals, &directions).0);
        }
    }

    /// Leaves out all but the finest levels.
    #[doc(hidden)]
    pub fn keep_finest(&mut self, count: usize) {
        self.levels = std::mem::take(&mut self.levels).into_iter().take(count).collect();
        if let Some(last) = self.levels.iter_mut().last() {
            last.level.from_coarser = None;
        }
    }

    /// The normals of a level of this patch: each vertex has that of its taxel.
    /// Panics if a vertex of the level is not a taxel of this patch.
    #[doc(hidden)]
    pub fn normals(&self, level: &Level) -> IdVec<VertexId, DVec3> {
        level.origins.map(|&taxel| self.taxels.normals[taxel])
    }

    /// Checks every rule that concerns this patch alone; see [`SkinMap::validate`].
    pub(crate) fn validate(&self) -> Result<(), MapError> {
        let levels: Vec<_> = self.levels.iter().map(|map| &map.level).collect();
        check_levels(&levels).map_err(|broken| {
            let (level, source) = match broken {
                PyramidError::AtLevel { level, source } => (level, *source),
                source => (LevelId::default(), source),
            };
            MapError::Level { patch: self.name.clone(), level, source }
        })?;
        let finest = levels[0];
        self.taxels
            .validate(finest.mesh.positions.len())
            .map_err(|source| SkinError::Taxels { patch: self.name.clone(), source })?;
        let mut areas = finest.areas.enumerate().zip(&self.taxels.areas);
        if let Some(((vertex, &found), &taxel)) = areas.find(|((_, a), b)| a != b) {
            return Err(MapError::Area { patch: self.name.clone(), vertex, found, taxel });
        }
        let faces = finest.mesh.triangles.len();
        if self.filled > faces {
            return Err(MapError::Filled { patch: self.name.clone(), found: self.filled, faces });
        }
        self.levels.enumerate().try_for_each(|(level, map)| self.check_map(level, map, finest))
    }

    /// Checks the map of one level, whose mesh is known to be valid.
    fn check_map(&self, level: LevelId, map: &MapLevel, finest: &Level) -> Result<(), MapError> {
        let MapLevel { level: Level { mesh, .. }, cut, uv, frame, distortion, .. } = map;
        let patch = || self.name.clone();
        if let Some(place) = cut.as_ref().and_then(|cut| cut.wrong_place(mesh)) {
            return Err(MapError::Cut { patch: patch(), level, place });
        }
        let (found, needed) = (uv.len(), cut.as_ref().map_or(mesh.positions.len(), |cut| cut.unsplit.len()));
        if found != needed {
            let source = PyramidError::Length { what: "uv", found, needed };
            return Err(MapError::Level { patch: patch(), level, source });
        }
        if let Some((place, &at)) = uv.enumerate().find(|(_, at)| !at.is_finite()) {
            return Err(MapError::NotFinite { patch: patch(), level, vertex: map.vertex_of(place), at });
        }
        if let Some((place, &at)) = uv.enumerate().find(|(_, at)| at.abs().max_element() > FARTHEST) {
            return Err(MapError::TooFar { patch: patch(), level, vertex: map.vertex_of(place), at });
        }
        if !frame.is_valid() {
            return Err(MapError::Frame { patch: patch(), level, frame: *frame });
        }
        let has_area = mesh.triangles.ids().any(|face| mesh.face_cross(face) != DVec3::ZERO);
        let at = uv.iter().next().copied().unwrap_or_default();
        if has_area && uv.iter().all(|other| *other == at) {
            return Err(MapError::OnePoint { patch: patch(), level, at });
        }
        if map.is_mirrored() {
            return Err(MapError::Mirrored { patch: patch(), level });
        }
        let coarser = self.levels.get(LevelId::new(level.index() + 1));
        if let Some(vertex) = coarser.and_then(|coarser| map.level.contradiction(&coarser.level, finest)) {
            return Err(MapError::Contradiction { patch: patch(), level, vertex });
        }
        if !is_possible(distortion, mesh.triangles.len()) {
            return Err(MapError::Distortion { patch: patch(), level, distortion: *distortion });
        }
        Ok(())
    }
}

/// The mirror image of a place of a map: where it is for a skin of the other hand.
pub(crate) fn mirrored(at: DVec2) -> DVec2 {
    DVec2::new(-at.x, at.y)
}

/// At each vertex the sum over its faces of area times gradient of `u`, twice, in m^2: zero where
/// the gradients cancel or the faces have no area.
fn directions_of_u(finest: &MapLevel) -> IdVec<VertexId, DVec3> {
    let mesh = &finest.level.mesh;
    let mut sums = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, mesh.positions.len());
    let gradient = |face| {
        let [x, y, z] = mesh.corners(face);
        let normal = mesh.face_cross(face).normalize_or_zero();
        // The gradient of a hat function is the opposite side, turned by a right angle inwards.
        let [a, b, c] = finest.uv_of(face);
        let side = (b.x - a.x) * (x - z) + (c.x - a.x) * (y - x);
        normal.cross(side)
    };
    par_each(mesh.triangles.len(), gradient, |face, gradient| {
        mesh.triangles[face].iter().for_each(|&v| sums[v] += gradient);
    });
    sums
}

/// Whether a map of `faces` faces can have these measures. Measuring again takes longer than all other
/// checks, so they are not compared with the map. Measures are not numbers where no face has an area, which
/// lookups accept.
fn is_possible(distortion: &Distortion, faces: usize) -> bool {
    let &Distortion { flips, qc_mean, qc_max, area_mean, area_max, .. } = distortion;
    let exceeds = |mean: f64, most: f64| mean > most * (1.0 + 1e-9);
    flips <= faces && !exceeds(qc_mean, qc_max) && !exceeds(area_mean, area_max)
}

/// The maps of a whole skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SkinMap {
    /// The links; a parent comes before its children.
    pub links: IdVec<LinkId, Link>,
    /// The patches.
    pub patches: IdVec<PatchId, PatchMap>,
    /// How the links may move.
    pub animations: Vec<Motion>,
    /// What joins the patches and the banks of slits, with the links at rest, and the levels above them; modalities of each patch.
    pub body: Body,
    /// The map of another skin that this one is drawn on, if there is one.
    pub atlas: Option<OnAtlas>,
}

impl SkinMap {
    /// The map of a mesh seen along z, from above, or from below where all of it faces down: one
    /// patch of one level, on one link at the origin. Images have `pixel` metres per pixel.
    ///
    /// A vertex whose triangles have no area gets the normal z and an area of 1 square micrometre.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist.
    ///
    /// ```
    /// use dermatome::{map::SkinMap, mesh::shapes};
    ///
    /// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
    /// map.validate()?;
    /// # Ok::<(), dermatome::map::MapError>(())
    /// ```
    pub fn flat(mesh: TriMesh, pixel: f64) -> Self {
        let mut taxels = Taxels::from(&mesh);
        taxels.normals.iter_mut().filter(|n| **n == DVec3::ZERO).for_each(|n| *n = DVec3::Z);
        taxels.areas.iter_mut().filter(|a| **a == 0.0).for_each(|a| *a = 1e-12);
        let uv = mesh.positions.map(|p| p.truncate());
        let level = Level::finest(mesh.clone(), taxels.areas.clone());
        let pyramid = Pyramid { levels: vec![level].into(), removals: IdVec::default() };
        let link = Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY };
        let patch = Patch { name: "skin".into(), link: LinkId::new(0), mesh, filled: 0, taxels };
        let mut patch = PatchMap::new(&patch, pyramid, vec![uv.clone()].into(), pixel);
        if patch.levels.iter().any(MapLevel::is_mirrored) {
            for level in patch.levels.iter_mut() {
                level.uv = level.uv.map(|at| DVec2::new(-at.x, at.y));
                level.set_pixel(pixel);
                level.measure();
            }
        }
        Self { links: vec![link].into(), patches: vec![patch].into(), ..Self::default() }
    }

    /// A skin as a map of level 0 alone, seen along z, for what needs its taxels and neighbours only, such as
    /// recordings (`recording::Recording`). It may overlap itself, and is not [valid](Self::validate) where it
    /// has no area.
    pub fn of_taxels(skin: &Skin) -> Self {
        /// A map has images; nobody draws those of this one, so that any pixel serves.
        const PIXEL: f64 = 1e-3;
        let patch = |patch: &Patch| {
            let level = Level::finest(patch.mesh.clone(), patch.taxels.areas.clone());
            let uv = patch.mesh.positions.map(|p| p.truncate());
            PatchMap::unmeasured(patch, vec![(level, None)], vec![uv].into(), PIXEL)
        };
        Self {
            links: skin.links.clone(),
            patches: skin.patches.map(patch),
            animations: skin.animations.clone(),
            body: Body::default(),
            atlas: None,
        }
    }

    /// Whether it is drawn on the mirror image of its [atlas](Self::atlas).
    pub fn is_mirrored(&self) -> bool {
        self.atlas.as_ref().is_some_and(|on| on.is_mirrored)
    }

    /// Checks every rule of a map, in time linear in its size.
    ///
    /// Links come after their parents and have rigid poses, patches have names of their own and
    /// links and joints that exist. Of each patch, the taxels keep the rules of [`Taxels`], the levels
    /// those of a pyramid except manifoldness and nesting (lookups accept any triangles), map
    /// positions are finite and within 1e12 m, one per vertex, or per place of a vertex on a map that
    /// is cut, not all the same nor all mirrored, `from_coarser` and the `to_finest` of the next level
    /// agree, and image frames have a size.
    ///
    /// # Errors
    /// The first broken rule, with patch, level and element.
    pub fn validate(&self) -> Result<(), MapError> {
        check_patches(&self.links, self.patches.iter().map(|p| (p.name.as_str(), p.link, &p.taxels)))?;
        self.patches.iter().try_for_each(PatchMap::validate)?;
        self.check_body()
    }

    /// Checks that the links of the body are ascending pairs of taxels.
    fn check_body(&self) -> Result<(), MapError> {
        let exists = |end: &BodyTaxel| {
            self.patches.get(end.patch).is_some_and(|patch| end.taxel.index() < patch.taxels.ids.len())
        };
        let links = &self.body.links;
        let is_wrong = |(k, ends): &(usize, &[BodyTaxel; 2])| {
            let is_ascending = ends[0] < ends[1] && links.get(k + 1).is_none_or(|next| *ends < next);
            !(is_ascending && ends.iter().all(exists))
        };
        if let Some((link, ends)) = links.iter().enumerate().find(is_wrong) {
            return Err(MapError::GapLink { link, ends: *ends });
        }
        let mut before = self.coarsest().iter().map(|level| level.origins.len()).sum();
        for (number, level) in self.body.levels.enumerate() {
            if !(is_valid(level, before, exists) && shrinks(&level.origins, before)) {
                return Err(MapError::BodyLevel { level: number, before });
            }
            before = level.origins.len();
        }
        self.check_modalities(exists)
    }

    /// Checks the modalities: those of patches in their order, then those of the body, each once.
    fn check_modalities(&self, exists: impl Fn(&BodyTaxel) -> bool) -> Result<(), MapError> {
        let order = |modality: &Modality| (modality.patch.is_none(), modality.patch);
        for (k, modality) in self.body.modalities.iter().enumerate() {
            let earlier = &self.body.modalities[..k];
            let key = |modality: &Modality| (modality.patch, modality.name.clone());
            let is_once = earlier.iter().all(|other| key(other) != key(modality))
                && earlier.last().is_none_or(|last| order(last) <= order(modality));
            let before = match modality.patch {
                Some(patch) => self.patches.get(patch).map(|patch| patch.taxels.ids.len()),
                None => {
                    let parts = || self.body.parts(modality);
                    (parts().count() > 1).then(|| parts().flat_map(|(_, part)| part.sensors()).count())
                }
            };
            let wrong = before.filter(|_| is_once).map(|before| modality.wrong_level(before, &exists));
            if let Some(level) = wrong.unwrap_or(Some(LevelId::default())) {
                let (patch, name) = (modality.patch, modality.name.clone());
                return Err(MapError::Modality { patch, name, level });
            }
        }
        Ok(())
    }

    /// The coarsest level of each patch.
    fn coarsest(&self) -> IdVec<PatchId, &Level> {
        self.patches.iter().filter_map(|patch| patch.levels.iter().last()).map(|map| &map.level).collect()
    }

    /// Finds what joins the patches, over gaps of at most `across` (m).
    #[doc(hidden)]
    pub fn find_body(&mut self, across: Option<f64>) {
        let skin = self.skin();
        let links = gap_links(&skin, across);
        let levels = body_levels(&skin, &links, &self.coarsest());
        let finest = self.patches.iter().filter_map(|patch| patch.levels.iter().next());
        let modalities = modalities(&skin, &links, &finest.map(|map| &map.level).collect());
        self.body = Body { links, levels, modalities };
    }

    /// The taxels in terms of the fields of the body levels.
    pub fn body_rows(&self) -> BodyRows {
        BodyRows::new(&self.body, &self.coarsest())
    }

    /// The gaps between patches, and how wide they are.
    pub fn gaps(&self) -> Vec<Gap> {
        if self.body.links.is_empty() { Vec::new() } else { self.body.gaps(&self.skin()) }
    }

    /// The skin that was mapped: level 0 of every patch.
    pub fn skin(&self) -> Skin {
        let patches = self.patches.iter().filter_map(|patch| {
            let mesh = patch.levels.get(LevelId::new(0))?.level.mesh.clone();
            let (name, taxels) = (patch.name.clone(), patch.taxels.clone());
            Some(Patch { name, link: patch.link, mesh, filled: patch.filled, taxels })
        });
        Skin { links: self.links.clone(), patches: patches.collect(), animations: self.animations.clone() }
    }
}
