//! Why data is not a map.

use glam::DVec2;

use crate::body::BodyTaxel;
use crate::cut::PlaceId;
use crate::flatten::Distortion;
use crate::id::VertexId;
use crate::map::ImageFrame;
use crate::pyramid::{LevelId, PyramidError};
use crate::skin::{PatchId, SkinError};

/// Why data is not a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum MapError {
    #[error(transparent)]
    Skin(#[from] SkinError),
    /// A level that breaks a rule, or is missing.
    #[error("{patch}/{level:?}: {source}")]
    Level { patch: String, level: LevelId, source: PyramidError },
    #[error("{patch}/L0: vertex {vertex} has an area of {found} m^2, but its taxel one of {taxel} m^2")]
    Area { patch: String, vertex: VertexId, found: f64, taxel: f64 },
    #[error("{patch}: its count of faces that fill holes is {found}, but level 0 has {faces} faces")]
    Filled { patch: String, found: usize, faces: usize },
    #[error(
        "{patch}/{level:?}: place {place} of the cut map is not the vertex of the level that its faces name; vertices \
         are their own first places, and the faces of both are the same"
    )]
    Cut { patch: String, level: LevelId, place: PlaceId },
    #[error("{patch}/{level:?}: vertex {vertex} lies at {at} m on the map, which is not finite")]
    NotFinite { patch: String, level: LevelId, vertex: VertexId, at: DVec2 },
    #[error(
        "{patch}/{level:?}: vertex {vertex} lies at {at} m on the map; coordinates within 1e12 m are needed"
    )]
    TooFar { patch: String, level: LevelId, vertex: VertexId, at: DVec2 },
    #[error("{patch}/{level:?}: all vertices lie at one point of the map, {at} m; they must differ")]
    OnePoint { patch: String, level: LevelId, at: DVec2 },
    #[error(
        "{patch}/{level:?}: the map is mirrored: all its triangles run clockwise, but from outside of the skin they run \
         counter-clockwise"
    )]
    Mirrored { patch: String, level: LevelId },
    #[error(
        "{patch}/{level:?}: vertex {vertex} has other weights in `up` (`from_coarser`) than the row of its taxel in \
         `direct` (`to_finest`) of the next coarser level; both give its position there"
    )]
    Contradiction { patch: String, level: LevelId, vertex: VertexId },
    #[error(
        "{patch}/{level:?}: the image frame is {} m at {} in {:?} pixels; it must be finite, with a positive size",
        frame.size, frame.origin, frame.size_px
    )]
    Frame { patch: String, level: LevelId, frame: ImageFrame },
    #[error(
        "{patch}/{level:?}: the distortion is {distortion:?}; means must be at most maxima, and flips at most the \
         number of faces"
    )]
    Distortion { patch: String, level: LevelId, distortion: Distortion },
    #[error("a region is called {found:?}; a name of 1 to 100 printable characters is needed")]
    RegionName { found: String },
    #[error("region {region:?}: the name of {links} links with taxels; the name of one link alone is needed")]
    SharedLink { region: String, links: usize },
    #[error("region {region:?}: no taxel is in it")]
    NoTaxelInRegion { region: String },
    #[error(
        "region {region:?}: the map has no patch {patch:?}; it has {}",
        known.iter().take(10).cloned().collect::<Vec<_>>().join(", ")
    )]
    NoPatchOfRegion { region: String, patch: String, known: Vec<String> },
    #[error("region {region:?}: a polygon of {found} corners; 3 to {most} are needed")]
    Corners { region: String, found: usize, most: usize },
    #[error(
        "region {region:?}: corner {corner} lies at {at} m, off the map of {patch}, which reaches from {low} to {high}; \
         a polygon may reach beyond it by a tenth of its side"
    )]
    OutsideMap { region: String, patch: String, corner: usize, at: DVec2, low: DVec2, high: DVec2 },
    #[error("region {region:?}: sides {first} and {second} of the polygon cross each other; none may")]
    Crosses { region: String, first: usize, second: usize },
    #[error(
        "gap link {link} joins vertex {} of patch {} and vertex {} of patch {}, counted from 0; links join two taxels \
         of the map, each pair once, in ascending order",
        ends[0].taxel.raw(), ends[0].patch.raw(), ends[1].taxel.raw(), ends[1].patch.raw()
    )]
    GapLink { link: usize, ends: [BodyTaxel; 2] },
    #[error(
        "body level {level:?}: it must have fewer fields than the {before} of the level before, a row of weights that sum \
         to 1 for each of those, and taxels of the map as centres"
    )]
    BodyLevel { level: LevelId, before: usize },
    #[error(
        "level {level} of the modality {name:?} of {}, counted from 0: patches ascend and have each modality but touch \
         once, and after them the body those of several patches; level 0 of a patch has its sensors, ascending, and a row for \
         each of its taxels, others have fewer fields than the level before, of the body than all sensors, taxels as centres, \
         and a row for each field of the level before; weights of a row sum to 1",
        patch.map_or("the body".into(), |patch| format!("patch {}", patch.raw()))
    )]
    Modality { patch: Option<PatchId>, name: String, level: LevelId },
    /// A level whose map loses a triangle when it is rounded to the `f32` of a file.
    #[error("a map file cannot represent it: found {found}; needed: {needed}")]
    Rounded { found: String, needed: String },
}
