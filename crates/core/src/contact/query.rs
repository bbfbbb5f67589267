//! Queries of an index, and its answers: one, many in columns, as an interval, and fields.

use glam::DVec3;
use rayon::prelude::*;

use crate::id::{FaceId, VertexId};
use crate::mesh::SurfacePoint;
use crate::pyramid::LevelId;
use crate::skin::{LinkId, PatchId, TaxelId};

/// The queries that an index supports, besides the nearest point of the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IndexOptions {
    /// [Reactive](crate::contact::ContactIndex::reactive) answers: every link with skin has an octree of at
    /// most 50 bytes per triangle, or 512 KB if that is more.
    pub reactive: bool,
    /// Searches for taxels and receptive fields.
    pub fields: bool,
}

/// A point for which the nearest point of the skin is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    /// The point, in m, in the frame of `link`.
    pub point: DVec3,
    /// The link in whose frame `point` is given, with skin or without; `None`: the world.
    pub link: Option<LinkId>,
    /// The link whose patches alone are searched; `None`: all patches.
    pub only_link: Option<LinkId>,
}

impl Query {
    /// A point in the frame of a link, in m.
    pub const fn in_link(link: LinkId, point: DVec3) -> Self {
        Self { point, link: Some(link), only_link: None }
    }

    /// A point in the frame of a link, in m, for which the patches of that link alone are searched.
    pub const fn on_link(link: LinkId, point: DVec3) -> Self {
        Self { point, link: Some(link), only_link: Some(link) }
    }
}

impl From<DVec3> for Query {
    /// A point in world coordinates, in m.
    fn from(point: DVec3) -> Self {
        Self { point, link: None, only_link: None }
    }
}

/// The point of the skin nearest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The patch it lies on.
    pub patch: PatchId,
    /// The link of that patch.
    pub link: LinkId,
    /// The point of level 0 of that patch.
    pub point: SurfacePoint,
    /// Distance of the query from the skin, in m; negative inside.
    ///
    /// The side is that of the angle-weighted pseudo-normal `(baerentzen2005)`, which is
    /// right on edges and corners too. Beyond the boundary of an open patch it is the side of the
    /// skin's continuation.
    pub distance: f64,
    /// Position of the point, in m, in the frame of the query.
    pub position: DVec3,
    /// The outward unit normal of the skin there, in the same frame: that of the face, on edges and
    /// corners the angle-weighted pseudo-normal. Zero where all faces around are without area.
    pub normal: DVec3,
}

/// Fewest queries of a batch that one task answers: enough for them to profit from the cache.
pub(super) const RUN: usize = 256;

/// The hits of a batch in columns, one entry for each query in their order: see the fields of [`Hit`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Hits {
    /// The patch of each hit.
    pub patch: Vec<PatchId>,
    /// The link of that patch.
    pub link: Vec<LinkId>,
    /// The face on level 0 of that patch.
    pub face: Vec<FaceId>,
    /// The barycentric coordinates in that face.
    pub barycentric: Vec<[f64; 3]>,
    /// The signed distance from the skin, in m.
    pub distance: Vec<f64>,
    /// The nearest point, in m, in the frame of its query.
    pub position: Vec<DVec3>,
    /// The outward unit normal there, in the same frame.
    pub normal: Vec<DVec3>,
}

impl Hits {
    /// The hit of the query with this index.
    pub fn get(&self, number: usize) -> Option<Hit> {
        Some(Hit {
            patch: *self.patch.get(number)?,
            link: *self.link.get(number)?,
            point: SurfacePoint {
                face: *self.face.get(number)?,
                barycentric: *self.barycentric.get(number)?,
            },
            distance: *self.distance.get(number)?,
            position: *self.position.get(number)?,
            normal: *self.normal.get(number)?,
        })
    }

    /// All hits in their order.
    pub fn iter(&self) -> impl Iterator<Item = Hit> + '_ {
        (0..self.patch.len()).map_while(|number| self.get(number))
    }

    pub(super) fn with_capacity(count: usize) -> Self {
        Self {
            patch: Vec::with_capacity(count),
            link: Vec::with_capacity(count),
            face: Vec::with_capacity(count),
            barycentric: Vec::with_capacity(count),
            distance: Vec::with_capacity(count),
            position: Vec::with_capacity(count),
            normal: Vec::with_capacity(count),
        }
    }

    /// Appends the hits of `sorted`, the one at `places[k]` with index `k`.
    pub(super) fn extend(&mut self, sorted: &[Option<Hit>], places: &[usize]) {
        fn column<T: Send + Default>(
            out: &mut Vec<T>,
            sorted: &[Option<Hit>],
            places: &[usize],
            of: impl Fn(&Hit) -> T + Sync,
        ) {
            let hits = places.par_iter().with_min_len(RUN).map(|&place| sorted[place].as_ref());
            out.par_extend(hits.map(|hit| hit.map(&of).unwrap_or_default()));
        }
        column(&mut self.patch, sorted, places, |hit| hit.patch);
        column(&mut self.link, sorted, places, |hit| hit.link);
        column(&mut self.face, sorted, places, |hit| hit.point.face);
        column(&mut self.barycentric, sorted, places, |hit| hit.point.barycentric);
        column(&mut self.distance, sorted, places, |hit| hit.distance);
        column(&mut self.position, sorted, places, |hit| hit.position);
        column(&mut self.normal, sorted, places, |hit| hit.normal);
    }
}

/// The distance of the skin from a contact, as an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reactive {
    /// The patch of the face.
    pub patch: PatchId,
    /// The link of that patch.
    pub link: LinkId,
    /// A face on level 0 of that patch, the nearest one or one near it: see
    /// [`hit_of`](crate::contact::ContactIndex::hit_of).
    pub face: FaceId,
    /// The middle between `least` and `most`, in m; negative inside. The side is that of the
    /// face, or of the ball of the cell that is nearer; it is not certain, and sometimes wrong within 2 mm of two sheets.
    pub distance: f64,
    /// Lower bound of the distance of the contact from the skin, without a sign, in m.
    pub least: f64,
    /// Upper bound of the distance of the contact from the skin, without a sign, in m.
    pub most: f64,
}

impl Reactive {
    /// Upper bound of the error of `distance`, without sign, in m.
    #[must_use]
    pub fn error(&self) -> f64 {
        let away = self.distance.abs();
        (away - self.least).max(self.most - away).max(0.0)
    }

    /// The answer narrowed by a point of the skin, which bounds the distance from above, and with the side there: see
    /// [`hit_of`](crate::contact::ContactIndex::hit_of).
    #[must_use]
    pub fn narrowed(&self, hit: &Hit) -> Self {
        let most = self.most.min(hit.distance.abs()).max(self.least);
        Self { distance: self.least.midpoint(most).copysign(hit.distance), most, ..*self }
    }

    /// Whether the skin is at most a distance (m) from the contact: `None` if the interval does not decide.
    #[must_use]
    pub fn is_within(&self, distance: f64) -> Option<bool> {
        if self.most <= distance { Some(true) } else { (self.least > distance).then_some(false) }
    }
}

/// Which point of the skin represents a [reactive answer](crate::contact::ContactIndex::reactive).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Refine {
    /// The nearest point of its face: the cheapest.
    #[default]
    Face,
    /// The nearest point of the faces that a walk over neighbours reaches, each nearer than the one before:
    /// usually the nearest point of the skin.
    Walk,
}

/// A receptive field near a contact; on level 0 a taxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldHit {
    /// Its patch.
    pub patch: PatchId,
    /// The link of that patch.
    pub link: LinkId,
    /// Its level.
    pub level: LevelId,
    /// The field: a vertex of that level.
    pub field: VertexId,
    /// Vendor id of the taxel at its centre.
    pub taxel: TaxelId,
    /// Distance of its centre from the point, in m.
    pub distance: f64,
    /// Its centre, in m, in the frame of the query.
    pub position: DVec3,
    /// The outward unit normal of the taxel at its centre, in the same frame. On a patch that follows several
    /// links it is rotated like the vertices are moved: by the weighted mean of the rotations.
    pub normal: DVec3,
}

/// A result that has a cell on the map: see [`ContactIndex::cell`](super::ContactIndex::cell).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Found<'a> {
    /// A point of level 0.
    Hit(&'a Hit),
    /// The centre of a field.
    Field(&'a FieldHit),
}

impl<'a> From<&'a Hit> for Found<'a> {
    fn from(hit: &'a Hit) -> Self {
        Self::Hit(hit)
    }
}

impl<'a> From<&'a FieldHit> for Found<'a> {
    fn from(field: &'a FieldHit) -> Self {
        Self::Field(field)
    }
}
