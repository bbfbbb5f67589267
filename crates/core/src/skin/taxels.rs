//! The properties of the taxels of a patch: one array per property, one entry per vertex of its mesh.
//!
//! Every step that drops, reorders or moves taxels goes through [`Taxels::select`] and
//! [`Taxels::posed`], so that no property is lost.

use std::collections::HashSet;
use std::fmt;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, surface_normals};
use crate::numeric::Covariance;
use crate::skin::LinkId;
use crate::skin::columns::{Column, columns};
use crate::skin::modality::{
    Modalities, NAMES_OF_MODALITIES, Presence, THERMAL, TOUCH, are_modalities, presence_of,
};

/// The number a vendor gave to a taxel: any 32-bit integer, duplicates and placeholders included.
///
/// Never an index. `TaxelId(0)` is the placeholder of most vendors.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct TaxelId(pub u32);

impl TaxelId {
    /// Ids that vendors write where they have none.
    pub const PLACEHOLDERS: [Self; 2] = [Self(0), Self(u32::MAX)];
}

impl fmt::Debug for TaxelId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "taxel {}", self.0)
    }
}

impl fmt::Display for TaxelId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

columns! {
    /// The properties of the taxels of a patch.
    Taxels {
        /// Where each link that taxels follow takes the patch as it was bound to them, in the frame of the patch's
        /// link, if that is not where it lies; else empty. See [`Joints`].
        binds: Vec<(LinkId, DAffine3)>,
        /// Whether the ids only count the taxels, since their file has none. Coarser levels then depend on the places of
        /// the taxels, and not on their order.
        are_counted: bool,
    }
    /// Vendor ids; not unique.
    ids: IdVec<VertexId, TaxelId>,
    /// Unit normals in the link's frame, outward.
    normals: IdVec<VertexId, DVec3>,
    /// Unit tangents in the link's frame, perpendicular to the normals to within 1e-5; `None`:
    /// unknown. A taxel's frame is its tangent `t`, `n x t` and its normal `n`: right-handed.
    ///
    /// Calibrated poses and files give them; a map without them gets the direction in which its
    /// `u` grows most.
    tangents: Option<IdVec<VertexId, DVec3>>,
    /// Receptive areas in m^2, positive.
    areas: IdVec<VertexId, f64>,
    /// Taxels per m^2, positive; `None`: those of the spacing.
    densities: Option<IdVec<VertexId, f64>>,
    /// How much distortion of the map counts at each taxel, at least 0; only ratios matter. `None`:
    /// the same everywhere.
    weights: Option<IdVec<VertexId, f64>>,
    /// Factor by which fields are finer, and lengths on the map longer, at each taxel than elsewhere, from
    /// 0.001 to 1000; only ratios matter. `None`: the same everywhere.
    acuities: Option<IdVec<VertexId, f64>>,
    /// The content of each slot.
    presence: IdVec<VertexId, Presence>,
    /// Covariances of the positions, in the link's frame; `None`: unknown, of one taxel or of all. 0 is exact.
    covariances: Option<IdVec<VertexId, Option<Covariance>>>,
    /// The links that each taxel follows; `None`: all are fixed to the link of their patch.
    joints: Option<IdVec<VertexId, Joints>>,
    /// The named region that each taxel is in, if it is in one; `None`: none is.
    regions: Option<IdVec<VertexId, Option<RegionName>>>,
    /// What each taxel senses; `None`, of one taxel or of all: what its presence says.
    modalities: Option<IdVec<VertexId, Option<Modalities>>>,
}

/// The name of a region of the skin: 1 to 100 characters, none of them a control character.
pub type RegionName = Arc<str>;

/// Whether a text can be the name of a region.
#[doc(hidden)]
pub fn is_region_name(name: &str) -> bool {
    (1..=100).contains(&name.chars().count()) && !name.chars().any(char::is_control)
}

/// The names in columns of patches, each once, in the order of their first taxels.
#[doc(hidden)]
pub fn names_of<'a>(
    columns: impl Iterator<Item = &'a Option<IdVec<VertexId, Option<Arc<str>>>>>,
) -> Vec<Arc<str>> {
    let mut seen = HashSet::new();
    let names = columns.flat_map(|column| column.iter().flatten().flatten());
    names.filter(|name| seen.insert(*name)).cloned().collect()
}

/// Up to four links that a point follows, with weights: it moves to the weighted mean of the positions to
/// which they move it (linear blend skinning). Weights are at least 0 with sum 1; a weight of 0 has no
/// effect.
///
/// With [`Taxels::binds`] `S`, the point that lies at `x` was bound at `b = (sum of w S)^-1 x`, and each link
/// carries `S b` instead of `x`.
pub type Joints = [(LinkId, f64); 4];

/// The [bind](Taxels::binds) of a link.
#[doc(hidden)]
pub fn bind_of(binds: &[(LinkId, DAffine3)], link: LinkId) -> DAffine3 {
    binds.iter().find(|(of, _)| *of == link).map_or(DAffine3::IDENTITY, |found| found.1)
}

/// Where the links that a point follows take it from where it was bound: the weighted sum of their binds.
#[doc(hidden)]
pub fn blended(joints: &Joints, binds: &[(LinkId, DAffine3)]) -> DAffine3 {
    let zero = DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO };
    joints.iter().filter(|joint| joint.1 > 0.0).fold(zero, |sum, &(link, weight)| {
        let bind = bind_of(binds, link);
        DAffine3 {
            matrix3: sum.matrix3 + bind.matrix3 * weight,
            translation: sum.translation + bind.translation * weight,
        }
    })
}

/// How far the sum of the weights of [`Joints`] may be from 1 before they are scaled to it: files store them
/// in 8 bits.
const JOINTS_TOLERANCE: f64 = 0.02;

/// Joints with weights of sum 1 and each link once; unused entries have weight 0. `None` if a weight is
/// negative or not a number, or the sum is not near 1.
#[doc(hidden)]
pub fn scaled_joints(joints: &Joints) -> Option<Joints> {
    let sum: f64 = joints.iter().map(|joint| joint.1).sum();
    // Also true for NaN.
    if !(joints.iter().all(|joint| joint.1 >= 0.0) && (sum - 1.0).abs() <= JOINTS_TOLERANCE) {
        return None;
    }
    let mut scaled: Joints = [(LinkId::default(), 0.0); 4];
    let mut count = 0;
    for &(link, weight) in joints.iter().filter(|joint| joint.1 > 0.0) {
        let known = scaled[..count].iter().position(|other| other.0 == link);
        let slot = known.unwrap_or(count);
        count = count.max(slot + 1);
        scaled[slot] = (link, scaled[slot].1 + weight / sum);
    }
    Some(scaled)
}

/// Tolerance of lengths, and of the cosine between normal and tangent: files store both as `f32`, with seven
/// digits.
const STORED_LENGTH_TOLERANCE: f64 = 1e-5;

/// Principal minors of a covariance may be this much below 0, in units of its trace: files store
/// `f32`.
const COVARIANCE_TOLERANCE: f64 = 1e-5;

/// The taxels of a bare mesh: ids count from 1, normals and areas come from the triangles.
impl From<&TriMesh> for Taxels {
    fn from(mesh: &TriMesh) -> Self {
        Self {
            ids: mesh.positions.ids().map(|v| TaxelId(v.raw() + 1)).collect(),
            normals: surface_normals(mesh),
            areas: mesh.vertex_areas(),
            presence: IdVec::filled(Presence::Present, mesh.positions.len()),
            are_counted: true,
            ..Self::default()
        }
    }
}

impl Taxels {
    /// The acuities; `None` where all are equal, since only ratios matter.
    #[doc(hidden)]
    pub fn relative_acuities(&self) -> Option<&IdVec<VertexId, f64>> {
        self.acuities.as_ref().filter(|all| all.iter().any(|x| Some(x) != all.first()))
    }

    /// What a taxel senses, as [`Modalities`]; empty where nothing is known.
    ///
    /// # Panics
    /// If there is no such taxel.
    pub fn modalities_of(&self, taxel: VertexId) -> &str {
        let given = self.modalities.as_ref().and_then(|all| all[taxel].as_deref());
        given.unwrap_or(match self.presence[taxel] {
            Presence::Present => TOUCH,
            Presence::ThermalPad => THERMAL,
            Presence::Absent | Presence::Other => "",
        })
    }

    /// The sensors of a modality, ascending: taxels that sense it and are not absent.
    pub fn sensors(&self, modality: &str) -> Vec<VertexId> {
        let senses = |v: &VertexId| self.modalities_of(*v).split('+').any(|name| name == modality);
        let taxels = self.presence.enumerate().filter(|(_, presence)| **presence != Presence::Absent);
        taxels.map(|(v, _)| v).filter(senses).collect()
    }

    /// The modalities besides touch that have sensors, in the order of their first ones.
    pub fn other_modalities(&self) -> Vec<&str> {
        let mut names = Vec::new();
        for (v, _) in self.presence.enumerate().filter(|(_, presence)| **presence != Presence::Absent) {
            let others = self.modalities_of(v).split('+').filter(|name| !["", TOUCH].contains(name));
            others.for_each(|name| {
                if !names.contains(&name) {
                    names.push(name);
                }
            });
        }
        names
    }

    /// Checks the length of every array and its values: the one check of taxels that are assembled, built or
    /// read.
    #[doc(hidden)]
    pub fn validate(&self, vertices: usize) -> Result<(), TaxelError> {
        if let Some((what, found)) = self.wrong_column(vertices) {
            return Err(TaxelError::Length { what, found, needed: vertices });
        }
        self.check_demands(vertices)?;
        // A new column must be checked here, or listed as one with arbitrary values.
        let Self {
            normals,
            tangents,
            areas,
            covariances,
            joints,
            binds,
            regions,
            modalities,
            presence,
            ids: _,
            are_counted: _,
            densities: _,
            weights: _,
            acuities: _,
        } = self;
        if let Some((vertex, found)) = first(areas.enumerate(), |x| is_positive(*x)) {
            return Err(TaxelError::Area { vertex, found });
        }
        for (vertex, n) in normals.enumerate() {
            let found = n.length();
            if found.is_nan() || (found - 1.0).abs() > STORED_LENGTH_TOLERANCE {
                return Err(TaxelError::Normal { vertex, found });
            }
        }
        for (vertex, t) in tangents.iter().flat_map(IdVec::enumerate) {
            let (length, along) = (t.length(), t.dot(normals[vertex]));
            let is_tangent =
                (length - 1.0).abs() <= STORED_LENGTH_TOLERANCE && along.abs() <= STORED_LENGTH_TOLERANCE;
            if !is_tangent {
                return Err(TaxelError::Tangent { vertex, length, along });
            }
        }
        let joints = joints.iter().flat_map(IdVec::enumerate);
        if let Some((vertex, found)) = first(joints, |all| scaled_joints(all).is_some()) {
            return Err(TaxelError::Joints { vertex, found });
        }
        if let Some(&(link, _)) = binds.iter().find(|(_, bind)| !bind.is_finite()) {
            return Err(TaxelError::Bind { link });
        }
        let named =
            regions.iter().flat_map(IdVec::enumerate).filter_map(|(v, name)| Some((v, name.as_ref()?)));
        if let Some((vertex, found)) = named.into_iter().find(|(_, name)| !is_region_name(name)) {
            return Err(TaxelError::Region { vertex, found: found.to_string() });
        }
        let named =
            modalities.iter().flat_map(IdVec::enumerate).filter_map(|(v, of)| Some((v, of.as_deref()?)));
        for (vertex, of) in named {
            let found = presence[vertex];
            if !are_modalities(of) {
                return Err(TaxelError::Modalities { vertex, found: of.to_owned() });
            } else if ![Presence::Absent, presence_of(of)].contains(&found) {
                return Err(TaxelError::NotSensed { vertex, found, modalities: of.to_owned() });
            }
        }
        let known = covariances.iter().flat_map(IdVec::enumerate).filter_map(|(v, c)| Some((v, c.as_ref()?)));
        match first(known, is_covariance) {
            Some((vertex, found)) => Err(TaxelError::Covariance { vertex, found }),
            None => Ok(()),
        }
    }

    /// Checks densities, weights and acuities, which control fields and maps.
    pub(crate) fn check_demands(&self, vertices: usize) -> Result<(), TaxelError> {
        let Self { densities, weights, acuities, .. } = self;
        for (what, values) in [("densities", densities), ("weights", weights), ("acuities", acuities)] {
            if let Some(found) = values.entries().filter(|found| *found != vertices) {
                return Err(TaxelError::Length { what, found, needed: vertices });
            }
        }
        let wrong = |values: &Option<IdVec<VertexId, f64>>, is_right: fn(f64) -> bool| {
            first(values.iter().flat_map(IdVec::enumerate), |x| is_right(*x))
        };
        if let Some((vertex, found)) = wrong(densities, is_positive) {
            return Err(TaxelError::Density { vertex, found });
        }
        if let Some((vertex, found)) = wrong(acuities, |x| (1e-3..=1e3).contains(&x)) {
            return Err(TaxelError::Acuity { vertex, found });
        }
        if let Some((vertex, found)) = wrong(weights, is_weight) {
            return Err(TaxelError::Weight { vertex, found });
        }
        match weights {
            Some(weights) if vertices > 0 && weights.iter().all(|w| *w == 0.0) => {
                Err(TaxelError::NoWeight { found: vertices })
            }
            _ => Ok(()),
        }
    }

    /// Densities (1/m^2) that follow from the acuities, for code that depends on densities alone.
    pub(crate) fn wanted_densities(&self) -> Option<IdVec<VertexId, f64>> {
        match (&self.densities, &self.acuities) {
            (densities, None) => densities.clone(),
            (None, Some(a)) => Some(a.iter().zip(&self.areas).map(|(a, area)| a * a / area).collect()),
            (Some(rho), Some(a)) => Some(a.iter().zip(rho).map(|(a, rho)| a * a * rho).collect()),
        }
    }

    /// The taxels `origins`, in that order.
    /// Panics if one of them does not exist.
    #[must_use]
    #[doc(hidden)]
    pub fn select<I>(&self, origins: &IdVec<I, VertexId>) -> Self {
        let Self { are_counted, .. } = *self;
        Self { binds: self.binds.clone(), are_counted, ..self.selected(origins.iter().map(|v| v.index())) }
    }

    /// The taxels in another frame, transformed by a rigid pose.
    ///
    /// Poses of links never mirror. A mirror would map `n x t` to the opposite of its image, so frames would
    /// not stay right-handed.
    pub(super) fn posed(&self, pose: &DAffine3) -> Self {
        let turn = pose.matrix3;
        Self {
            normals: self.normals.map(|&n| turn * n),
            tangents: self.tangents.as_ref().map(|all| all.map(|&t| turn * t)),
            covariances: self.covariances.as_ref().map(|all| all.map(|c| c.map(|c| c.conjugate(&turn)))),
            binds: self.binds.iter().map(|&(link, bind)| (link, *pose * bind * pose.inverse())).collect(),
            ..self.clone()
        }
    }
}

/// The first value that is not valid, and its vertex.
fn first<'a, T: Copy + 'a>(
    mut values: impl Iterator<Item = (VertexId, &'a T)>,
    is_right: impl Fn(&T) -> bool,
) -> Option<(VertexId, T)> {
    values.find(|(_, x)| !is_right(x)).map(|(vertex, &found)| (vertex, found))
}

/// Whether a number can be an area or a density.
pub(super) fn is_positive(x: f64) -> bool {
    x.is_finite() && x > 0.0
}

pub(super) fn is_weight(x: f64) -> bool {
    x.is_finite() && x >= 0.0
}

/// Whether all principal minors are non-negative up to rounding: then no direction has a negative variance.
fn is_covariance(&Covariance { xx, xy, xz, yy, yz, zz }: &Covariance) -> bool {
    let trace = xx + yy + zz;
    let [a, b, c] = [xx * yy - xy * xy, xx * zz - xz * xz, yy * zz - yz * yz];
    let determinant = xx * c - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    let minors = [(xx, 1), (yy, 1), (zz, 1), (a, 2), (b, 2), (c, 2), (determinant, 3)];
    trace.is_finite()
        && minors.iter().all(|&(minor, degree)| minor >= -COVARIANCE_TOLERANCE * trace.powi(degree))
}

/// Why arrays are not the taxels of a patch.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum TaxelError {
    #[error("{what}: an array of {found} entries; {needed} are needed, one per vertex")]
    Length { what: &'static str, found: usize, needed: usize },
    #[error("vertex {vertex} has an area of {found} m^2; a positive number is needed")]
    Area { vertex: VertexId, found: f64 },
    #[error("the normal of vertex {vertex} has length {found}; 1 is needed")]
    Normal {
        vertex: VertexId,
        /// Length of the normal found; zero where the faces have no direction.
        found: f64,
    },
    #[error(
        "the tangent of vertex {vertex} has length {length} and the component {along} along the normal; \
         1 and 0 are needed"
    )]
    Tangent { vertex: VertexId, length: f64, along: f64 },
    #[error("vertex {vertex} has a density of {found} taxels per m^2; a positive number is needed")]
    Density { vertex: VertexId, found: f64 },
    #[error("vertex {vertex} has a weight of {found}; a number of at least 0 is needed")]
    Weight { vertex: VertexId, found: f64 },
    #[error("all {found} weights are 0; at least one above 0 is needed")]
    NoWeight { found: usize },
    #[error("vertex {vertex} has an acuity of {found}; a number from 0.001 to 1000 is needed")]
    Acuity { vertex: VertexId, found: f64 },
    #[error("vertex {vertex} follows {found:?}; weights of at least 0 with sum 1 are needed")]
    Joints { vertex: VertexId, found: Joints },
    #[error("vertex {vertex} is in the region {found:?}; a name of 1 to 100 printable characters is needed")]
    Region { vertex: VertexId, found: String },
    #[error("vertex {vertex} senses {found:?}; {NAMES_OF_MODALITIES} are needed")]
    Modalities { vertex: VertexId, found: String },
    #[error(
        "vertex {vertex} is {} and senses {modalities}; {} or absent is needed", found.word(), presence_of(modalities).word()
    )]
    NotSensed { vertex: VertexId, found: Presence, modalities: String },
    #[error("vertex {vertex} follows link {link}, but there are {links} links")]
    UnknownJoint { vertex: VertexId, link: LinkId, links: usize },
    #[error("the bind of link {link} is not finite; a finite affine map is needed")]
    Bind { link: LinkId },
    #[error(
        "vertex {vertex} has the covariance {:?} m^2 (xx xy xz yy yz zz); it must be finite and positive \
         semidefinite",
        <[f64; 6]>::from(*found)
    )]
    Covariance { vertex: VertexId, found: Covariance },
}

impl TaxelError {
    /// The error with another number for its vertex.
    pub(super) fn renumbered(mut self, number: impl Fn(VertexId) -> VertexId) -> Self {
        match &mut self {
            Self::Area { vertex, .. }
            | Self::Normal { vertex, .. }
            | Self::Tangent { vertex, .. }
            | Self::Density { vertex, .. }
            | Self::Weight { vertex, .. }
            | Self::Acuity { vertex, .. }
            | Self::Joints { vertex, .. }
            | Self::UnknownJoint { vertex, .. }
            | Self::Region { vertex, .. }
            | Self::Modalities { vertex, .. }
            | Self::NotSensed { vertex, .. }
            | Self::Covariance { vertex, .. } => *vertex = number(*vertex),
            Self::Length { .. } | Self::NoWeight { .. } | Self::Bind { .. } => {}
        }
        self
    }
}
