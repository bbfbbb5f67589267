//! Drafts: skins as written in files, before anything is repaired or refused.

use std::path::PathBuf;

use glam::{DAffine3, DVec2, DVec3};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{MeshError, is_within_reach, too_many};
use crate::skin::columns::columns;
use crate::skin::link::append_links;
use crate::skin::modality::presence_of;
use crate::skin::motion::moved_links;
use crate::skin::{
    Covariance, Joints, Link, LinkId, Modalities, Motion, Presence, RegionName, Remark, SkinError,
    TaxelError, TaxelId,
};

/// Bodies of robots are smaller, in m. One in millimetres is read as a thousand times larger, so its unit is
/// detected down to a fingertip of 5 mm.
const LARGEST_PART: f64 = 5.0;

/// Smallest size of a skin, in m: that of one taxel.
const SMALLEST_PART: f64 = 1e-3;

/// A skin as written in a file, before anything is repaired or refused.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Draft {
    /// The links; empty where the format has none.
    pub links: IdVec<LinkId, Link>,
    /// The sheets of taxels and triangles.
    pub sheets: Vec<Sheet>,
    /// Animations of the links.
    pub animations: Vec<Motion>,
    /// Remarks on changes and on data that the reader of the file ignored.
    pub remarks: Vec<Remark>,
    /// The names of the materials that [`Sheet::materials`] counts.
    pub materials: Vec<String>,
    /// Other files that were read for it, such as the meshes of a robot and the buffers of a glTF file.
    pub files: Vec<PathBuf>,
}

columns! {
    /// One sheet of triangles with their taxels, as written.
    ///
    /// The optional arrays should be as long as `positions`, those of the texture and the materials as
    /// `triangles`. Nothing is guaranteed before the draft is assembled: arrays may be shorter, corners
    /// out of range, positions not finite, vertices unused or duplicated, winding mixed.
    Sheet {
        /// Name of the patch.
        name: String,
        /// The link it is fixed to.
        link: Option<LinkId>,
        /// As [`Taxels::binds`](crate::skin::Taxels::binds).
        binds: Vec<(LinkId, DAffine3)>,
        /// Whether its taxels, which have no triangles, are a skin although other sheets have triangles.
        is_bare: bool,
        /// As [`Taxels::are_counted`](crate::skin::Taxels::are_counted); without ids they are.
        are_counted: bool,
        /// Corner indices into `positions`.
        triangles: Vec<[u32; 3]>,
        /// Texture coordinates of the corners of each triangle, if requested.
        texture: Option<Vec<[DVec2; 3]>>,
        /// The material of each triangle, if requested; [`u32::MAX`] where there is none.
        materials: Option<Vec<u32>>,
    }
    /// Positions in the link's frame, in m.
    positions: Vec<DVec3>,
    /// The numbers of the vertices in the file, where they are not their indices in `positions`.
    numbers: Option<Vec<u32>>,
    /// Vendor ids.
    ids: Option<Vec<TaxelId>>,
    /// Normals in the link's frame.
    normals: Option<Vec<DVec3>>,
    /// The x axes of the taxels' frames in the link's frame, which are projected to the tangent
    /// planes when the sheet is assembled; zero where there is none.
    tangents: Option<Vec<DVec3>>,
    /// Receptive areas, in m^2.
    areas: Option<Vec<f64>>,
    /// Taxels per m^2.
    densities: Option<Vec<f64>>,
    /// How much distortion of the map counts at each taxel, at least 0.
    weights: Option<Vec<f64>>,
    /// As [`Taxels::acuities`](crate::skin::Taxels::acuities).
    acuities: Option<Vec<f64>>,
    /// Whether each slot has a working taxel.
    presence: Option<Vec<Presence>>,
    /// Number of the rigid module each taxel sits on: taxels of one module lie in a plane.
    modules: Option<Vec<u32>>,
    /// Covariances of positions `xx xy xz yy yz zz` in the link's frame, in m^2; `None` where unknown.
    covariances: Option<Vec<Option<Covariance>>>,
    /// The links that each taxel follows; `None`: the sheet's.
    joints: Option<Vec<Joints>>,
    /// The named region that each taxel is in, if it is in one.
    regions: Option<Vec<Option<RegionName>>>,
    /// What each taxel senses; `None`: what its presence says, which else follows from this unless it is absent.
    modalities: Option<Vec<Option<Modalities>>>,
}

impl Draft {
    /// Multiplies all lengths by `metres`: those of a draft in another unit than m become m.
    pub fn scale(&mut self, metres: f64) {
        for link in self.links.iter_mut() {
            link.pose.translation *= metres;
        }
        self.animations.iter_mut().for_each(|motion| motion.scale(metres));
        for sheet in &mut self.sheets {
            let square = metres * metres;
            sheet.positions.iter_mut().for_each(|x| *x *= metres);
            sheet.binds.iter_mut().for_each(|(_, bind)| bind.translation *= metres);
            sheet.areas.iter_mut().flatten().for_each(|a| *a *= square);
            sheet.densities.iter_mut().flatten().for_each(|d| *d /= square);
            sheet
                .covariances
                .iter_mut()
                .flatten()
                .flatten()
                .for_each(|c| *c = <[f64; 6]>::from(*c).map(|x| x * square).into());
        }
    }

    /// Adds the links, sheets and animations of another file. A link of each with the same name, parent and pose are one
    /// link; without a name only if no animation moves them. Bare taxels of one file stay so beside triangles of another.
    ///
    /// # Panics
    /// If the parent of a link, or the link of a sheet or joint, is not an earlier link of `other`.
    pub fn append(&mut self, other: Self) {
        let links = append_links(
            &mut self.links,
            &other.links,
            [&self.animations, &other.animations].map(|all| moved_links(all)),
        );
        let [is_bare, is_bare_there] = [&*self, &other].map(Self::is_bare);
        self.sheets.iter_mut().for_each(|sheet| sheet.is_bare |= is_bare);
        let materials = u32::try_from(self.materials.len()).unwrap_or(u32::MAX);
        self.sheets.extend(other.sheets.into_iter().map(|mut sheet| {
            sheet.is_bare |= is_bare_there;
            sheet.link = sheet.link.map(|link| links[link]);
            let joints = sheet.joints.iter_mut().flatten().flatten();
            joints.for_each(|(link, _)| *link = links[*link]);
            sheet.binds.iter_mut().for_each(|(link, _)| *link = links[*link]);
            let of_faces = sheet.materials.iter_mut().flatten();
            of_faces.for_each(|material| *material = material.saturating_add(materials));
            sheet
        }));
        self.animations.extend(other.animations.into_iter().map(|motion| motion.of_links(&links)));
        self.remarks.extend(other.remarks);
        self.materials.extend(other.materials);
        self.files.extend(other.files);
    }

    /// Keeps the triangles for which `keep` is true, or the taxels of sheets without triangles; sheets of
    /// which nothing is left are dropped. `keep` takes the sheet and the index of the triangle, or of the
    /// taxel, in it; it is called for each of them in their order.
    pub fn retain(&mut self, mut keep: impl FnMut(&Sheet, usize) -> bool) {
        for sheet in &mut self.sheets {
            *sheet = sheet.retained(&mut keep);
        }
        self.sheets.retain(|sheet| !sheet.positions.is_empty());
    }

    /// Whether it has taxels, but no triangle.
    pub(super) fn is_bare(&self) -> bool {
        self.sheets.iter().all(|s| s.triangles.is_empty())
            && self.sheets.iter().any(|s| !s.positions.is_empty())
    }

    /// Whether taxels of it are to be joined.
    pub(super) fn has_bare(&self) -> bool {
        self.is_bare() || self.sheets.iter().any(Sheet::is_to_join)
    }

    /// *Heuristic*: the largest sheet and its size (m), if that is implausible in metres.
    pub(super) fn doubtful_unit(&self) -> Option<(&Sheet, f64)> {
        let extents = self.sheets.iter().map(|sheet| (sheet, sheet.extent()));
        let largest = extents.max_by(|a, b| a.1.total_cmp(&b.1));
        let is_odd = |extent: f64| extent > LARGEST_PART || (extent > 0.0 && extent < SMALLEST_PART);
        largest.filter(|&(_, extent)| is_odd(extent) && extent.is_finite())
    }
}

impl Sheet {
    /// The name to show: that of the file, or `patch` if it has none.
    pub fn title(&self) -> &str {
        if self.name.is_empty() { "patch" } else { &self.name }
    }

    /// Whether its taxels are to be joined, whatever other sheets are.
    pub(super) fn is_to_join(&self) -> bool {
        self.is_bare && self.triangles.is_empty() && !self.positions.is_empty()
    }

    /// Refuses links, lengths, positions and corners out of range.
    pub(crate) fn validate(&self, links: usize) -> Result<(), SkinError> {
        let patch = || self.title().to_owned();
        if let Some(link) = self.link.filter(|l| l.index() >= links) {
            return Err(SkinError::UnknownLink { patch: patch(), link });
        }
        let needed = self.positions.len();
        if let Some((what, found)) = self.wrong_length() {
            let source = TaxelError::Length { what, found, needed };
            return Err(SkinError::Taxels { patch: patch(), source });
        }
        let refuse = |source| Err(SkinError::Mesh { patch: patch(), source });
        if let Some(error) = too_many(needed, self.triangles.len()) {
            return refuse(error);
        }
        if let Some(v) = self.positions.iter().position(|p| !is_within_reach(*p)) {
            let position = self.positions[v].to_array();
            return refuse(MeshError::NotFinite { vertex: VertexId::new(v), position });
        }
        for (face, t) in self.triangles.iter().enumerate() {
            if let Some(&v) = t.iter().find(|&&v| v as usize >= needed) {
                let (face, vertex) = (FaceId::new(face), VertexId::from(v));
                return refuse(MeshError::CornerOutOfRange { face, vertex, vertices: needed });
            }
        }
        Ok(())
    }

    /// Longest side, in m, of the box without the outermost hundredth of the vertices on each side:
    /// sentinel coordinates such as -999 do not change it.
    fn extent(&self) -> f64 {
        let count = self.positions.len();
        let out = count.div_ceil(100).min(count.saturating_sub(1) / 2);
        let side = |axis: usize| {
            let mut along: Vec<f64> = self.positions.iter().map(|p| p[axis]).collect();
            let mut nth = |k: usize| *along.select_nth_unstable_by(k, f64::total_cmp).1;
            nth(count - 1 - out) - nth(out)
        };
        if count == 0 { 0.0 } else { (0..3).map(side).fold(0.0, f64::max) }
    }

    /// The taxels `kept`, in that order, without triangles.
    #[doc(hidden)]
    pub fn select(&self, kept: &[usize]) -> Self {
        let (name, binds) = (self.name.clone(), self.binds.clone());
        let Self { link, is_bare, are_counted, .. } = *self;
        Self { name, link, is_bare, are_counted, binds, ..self.selected(kept.iter().copied()) }
    }

    /// Gives taxels that are not absent the presence that their modalities name: readers of files call it.
    #[doc(hidden)]
    pub fn follow_modalities(&mut self) {
        let Some(modalities) = &self.modalities else { return };
        let all = self.presence.get_or_insert_with(|| vec![Presence::Present; modalities.len()]);
        for (presence, of) in all.iter_mut().zip(modalities) {
            if let Some(of) = of.as_deref().filter(|_| *presence != Presence::Absent) {
                *presence = presence_of(of);
            }
        }
    }

    /// The first optional array without one entry per vertex, and its length.
    pub(super) fn wrong_length(&self) -> Option<(&'static str, usize)> {
        let of_faces = [
            ("texture", self.texture.as_ref().map(Vec::len)),
            ("materials", self.materials.as_ref().map(Vec::len)),
        ];
        let mut given = of_faces.into_iter().filter_map(|(what, n)| Some((what, n?)));
        if let Some(wrong) = given.find(|&(_, n)| n != self.triangles.len()) {
            return Some(wrong);
        }
        self.wrong_column(self.positions.len())
    }

    /// The sheet with the elements that [`Draft::retain`] keeps. Vertices that no triangle used are kept; a
    /// sheet with an array of another length, which is refused later, is kept whole.
    fn retained(&self, mut keep: impl FnMut(&Self, usize) -> bool) -> Self {
        if self.wrong_length().is_some() {
            // Called nevertheless, so that `keep` can count elements through all sheets.
            let count = if self.triangles.is_empty() { self.positions.len() } else { self.triangles.len() };
            for k in 0..count {
                keep(self, k);
            }
            return self.clone();
        }
        if self.triangles.is_empty() {
            let kept: Vec<usize> = (0..self.positions.len()).filter(|&v| keep(self, v)).collect();
            return self.select(&kept);
        }
        let faces: Vec<usize> = (0..self.triangles.len()).filter(|&f| keep(self, f)).collect();
        if faces.is_empty() {
            return Self::default();
        }
        let mut is_kept = vec![true; self.positions.len()];
        let mut mark = |t: &[u32; 3], value| {
            t.iter().for_each(|&v| {
                if let Some(kept) = is_kept.get_mut(v as usize) {
                    *kept = value;
                }
            });
        };
        self.triangles.iter().for_each(|t| mark(t, false));
        faces.iter().for_each(|&f| mark(&self.triangles[f], true));
        let kept: Vec<usize> = (0..self.positions.len()).filter(|&v| is_kept[v]).collect();
        // Corners out of range are kept, and are refused later.
        let mut places = vec![u32::MAX; self.positions.len()];
        for (place, &v) in (0..).zip(&kept) {
            places[v] = place;
        }
        let moved = |v: u32| places.get(v as usize).copied().unwrap_or(u32::MAX);
        let mut part = self.select(&kept);
        part.numbers =
            Some(kept.iter().map(|&v| self.numbers.as_ref().map_or(number(v), |all| all[v])).collect());
        part.triangles = faces.iter().map(|&f| self.triangles[f].map(moved)).collect();
        part.texture = self.texture.as_ref().map(|all| faces.iter().map(|&f| all[f]).collect());
        part.materials = self.materials.as_ref().map(|all| faces.iter().map(|&f| all[f]).collect());
        part
    }
}

/// The number of a vertex; drafts with more vertices than 32 bits count are refused.
fn number(v: usize) -> u32 {
    u32::try_from(v).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;

    /// A link of both files becomes one; others keep their parents and sheets.
    #[test]
    fn files_share_the_links_of_one_name_and_pose() {
        let link = |name: &str, parent: Option<u32>| Link {
            name: name.into(),
            parent: parent.map(LinkId::from),
            pose: DAffine3::IDENTITY,
        };
        let on = |link: u32| Sheet { link: Some(link.into()), ..Sheet::default() };
        let draft = |names: [&str; 2]| Draft {
            links: vec![link(names[0], None), link(names[1], Some(0))].into(),
            sheets: vec![on(1)],
            ..Draft::default()
        };
        let mut both = draft(["base", "left"]);
        both.append(draft(["base", "right"]));
        let names: Vec<_> = both.links.iter().map(|link| &*link.name).collect();
        assert_eq!(names, ["base", "left", "right"]);
        assert_eq!(both.links[LinkId::new(2)].parent, Some(LinkId::new(0)));
        assert_eq!(
            both.sheets.iter().map(|sheet| sheet.link).collect::<Vec<_>>(),
            [1, 2].map(|k| Some(k.into()))
        );
    }
}
