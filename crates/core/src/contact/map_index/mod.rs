//! [`MapIndex`], the inverse lookup: from a point of the map of any level to the surface.
//!
//! Each level has a grid over its map, which finds the triangles at a point, and a tree over their boxes, for
//! the nearest triangle if there is none at the point and for crowded cells. Where a map overlaps itself a
//! point lies on several sheets, and each is an answer.

mod plane_grid;

use glam::{DVec2, DVec3};
use plane_grid::PlaneGrid;

use crate::bvh::{Aabb, BoxTree};
use crate::contact::cell::OwnFace;
use crate::contact::patch_bvh::{Best, check};
use crate::contact::{Cell, ContactError, ContactIndex};
use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, PixelGrid, SkinMap};
use crate::mesh::{
    Closest, Feature, SurfacePoint, TriMesh, VertexCorners, closest_point, is_within_reach, pseudo_normal,
    triangle_cross,
};
use crate::numeric::along_curve;
use crate::parallel::par_map;
use crate::pyramid::LevelId;
use crate::skin::{LinkId, PatchId, TaxelId};

/// A point this near to a triangle is on it, as a fraction of the size of the map: rounding.
const ON_CHART: f64 = 1e-12;

/// Points of the surface this near to each other are one where triangles of the map meet, as a fraction of
/// the size of the patch.
const SAME_POINT: f64 = 1e-9;

/// A point is clear of the sides of a triangle if its areas with them are more than this fraction of the
/// squares of its distances from the corners: far more than rounding, for slivers too.
const MIN_CLEARANCE: f64 = 1e-8;

/// The maps of all levels, prepared for lookups from the map to the surface.
#[derive(Debug, Clone)]
pub struct MapIndex {
    patches: IdVec<PatchId, IdVec<LevelId, LevelMap>>,
}

/// The map of a level.
#[derive(Debug, Clone)]
struct LevelMap {
    patch: PatchId,
    link: LinkId,
    level: LevelId,
    grid: PlaneGrid,
    /// The data of each place of the map that an answer reads.
    places: IdVec<VertexId, Place>,
    /// Its triangles, by their places.
    triangles: IdVec<FaceId, [VertexId; 3]>,
    /// The boxes of these triangles.
    tree: BoxTree,
    /// The mesh of the level, with the same faces, and its adjacency.
    mesh: TriMesh,
    corners: VertexCorners,
    /// The vertex of level 0 for each of its vertices, and the number of vertices of level 0.
    origins: IdVec<VertexId, VertexId>,
    vertices: usize,
    image: PixelGrid,
    /// Tolerances for being on the map, and for being the same point, in m.
    on_chart: f64,
    same_point: f64,
}

/// A vertex of a map.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    /// Position on the map, and in space, in m.
    uv: DVec2,
    position: DVec3,
    field: VertexId,
    taxel: TaxelId,
}

/// A point of the map of a level, and the point of the surface that it shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPlace {
    /// The patch.
    pub patch: PatchId,
    /// Its link.
    pub link: LinkId,
    /// Distance of the requested point from the map, in m; 0 on it.
    pub off_chart: f64,
    /// The face of the level, the map position, the fields and their weights.
    pub cell: Cell,
    /// The point of the level's mesh, on level 0 of the skin, in m in the frame of the link; in the
    /// pose of the map: [`MapIndex::posed`] moves it.
    pub position: DVec3,
    /// The outward unit normal there, in the same frame.
    pub normal: DVec3,
}

impl MapIndex {
    /// An index of the maps of all patches and levels.
    ///
    /// # Errors
    /// As [`ContactIndex::new`](crate::contact::ContactIndex::new).
    pub fn new(map: &SkinMap) -> Result<Self, ContactError> {
        map.validate()?;
        let of_patch = |patch: PatchId| {
            let levels = map.patches[patch].levels.ids();
            levels
                .map(|level| LevelMap::new(patch, &map.patches[patch], level))
                .collect::<Result<Vec<_>, _>>()
        };
        let patches =
            par_map(&map.patches.ids().collect::<Vec<_>>(), |&patch| of_patch(patch).map(IdVec::from));
        Ok(Self { patches: patches.into_iter().collect::<Result<Vec<_>, ContactError>>()?.into() })
    }

    /// Appends the points of the surface at a point (m) of the map of a level: one for each sheet there, the
    /// first face first; off the map the nearest one.
    ///
    /// # Errors
    /// If the point is not finite or farther than 1e12 m, or there is no such patch or level.
    pub fn places(
        &self,
        patch: PatchId,
        level: LevelId,
        uv: DVec2,
        found: &mut Vec<MapPlace>,
    ) -> Result<(), ContactError> {
        let known = self.patches.get(patch).and_then(|levels| levels.get(level));
        let map = known.ok_or(ContactError::NoMap { patch, level })?;
        let point = uv.extend(0.0);
        if !is_within_reach(point) {
            return Err(ContactError::NotOnPlane { uv: uv.to_array() });
        }
        let first = found.len();
        let is_listed = map.grid.each_at(uv, |face, corners| {
            if let Some(closest) = map.at(uv, corners) {
                found.push(map.place(face, corners, closest, 0.0));
            }
        });
        if !is_listed {
            map.tree.each_near(point, map.on_chart, |face| {
                let face = FaceId::new(face);
                let closest = map.closest(uv, map.triangles[face]);
                if closest.squared <= map.on_chart * map.on_chart {
                    found.push(map.place(face, map.triangles[face], closest, 0.0));
                }
                map.on_chart
            });
        }
        match found.len() - first {
            0 => {
                let mut best = None;
                map.tree.each_near(point, f64::INFINITY, |face| {
                    let face = FaceId::new(face);
                    Best::offer(&mut best, patch, face, map.closest(uv, map.triangles[face]));
                    Best::squared(best.as_ref()).sqrt()
                });
                found.extend(best.map(|Best { face, closest, .. }| {
                    map.place(face, map.triangles[face], closest, closest.squared.sqrt())
                }));
            }
            1 => (),
            _ => map.keep_sheets(found, first),
        }
        Ok(())
    }

    /// The answer in the current pose of `index`, an index of the same map: on a patch that follows several
    /// links the point and its normal move in the frame of the patch's link. `None` if the answer is not one
    /// of that map.
    pub fn posed(&self, index: &ContactIndex, place: &MapPlace) -> Option<MapPlace> {
        let patch = index.patches.get(place.patch)?;
        let map = self.patches.get(place.patch)?.get(place.cell.level)?;
        let SurfacePoint { face, barycentric } = place.cell.point;
        let fields = map.mesh.triangles.get(face)?;
        let vertices = &patch.tree.mesh.positions;
        if map.vertices != vertices.len() {
            return None;
        }
        if patch.blend.is_none() {
            return Some(*place);
        }
        let at = |field: VertexId| vertices[map.origins[field]];
        let position = fields.iter().zip(barycentric).map(|(&field, weight)| at(field) * weight).sum();
        let normal = map.normal(at, face, Feature::at(barycentric)).normalize_or_zero();
        Some(MapPlace { position, normal, ..*place })
    }
}

impl LevelMap {
    /// Prepares a level of a patch of a valid map.
    fn new(id: PatchId, patch: &PatchMap, level: LevelId) -> Result<Self, ContactError> {
        let map = &patch.levels[level];
        let mesh = map.level.mesh.clone();
        if mesh.triangles.is_empty() {
            return Err(ContactError::NoFaces { patch: patch.name.clone() });
        }
        let plane = plane(map);
        check(&patch.name, &plane.positions)?;
        let boxes: Vec<Aabb> = plane.triangles.ids().map(|face| Aabb::around(plane.corners(face))).collect();
        let on_chart = ON_CHART * size(&plane);
        let mut places = IdVec::filled(Place::default(), plane.positions.len());
        for (of_face, fields) in plane.triangles.iter().zip(&mesh.triangles) {
            for (&place, &field) in of_face.iter().zip(fields) {
                let taxel = patch.taxels.ids[map.level.origins[field]];
                let (uv, position) = (plane.positions[place].truncate(), mesh.positions[field]);
                places[place] = Place { uv, position, field, taxel };
            }
        }
        Ok(Self {
            patch: id,
            link: patch.link,
            level,
            grid: PlaneGrid::new(&plane, on_chart),
            places,
            triangles: plane.triangles,
            tree: BoxTree::new(&boxes).expect("the map is finite"),
            corners: VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len()),
            origins: map.level.origins.clone(),
            vertices: patch.taxels.ids.len(),
            image: PixelGrid::new(map.frame),
            on_chart,
            same_point: SAME_POINT * size(&mesh),
            mesh,
        })
    }

    #[inline(always)]
    fn places_of(&self, corners: [VertexId; 3]) -> [&Place; 3] {
        corners.map(|place| &self.places[place])
    }

    /// The point of a triangle at a point of the map, if the triangle contains it.
    #[inline(always)]
    fn at(&self, uv: DVec2, ids: [VertexId; 3]) -> Option<Closest> {
        let corners = self.places_of(ids).map(|corner| corner.uv);
        match Planar::of(uv, corners, self.on_chart) {
            Planar::Beyond => None,
            Planar::Inside(barycentric) => {
                Some(Closest { squared: 0.0, barycentric, feature: Feature::Inside, is_flat: false })
            }
            Planar::Near => {
                Some(self.closest(uv, ids)).filter(|closest| closest.squared <= self.on_chart * self.on_chart)
            }
        }
    }

    /// The point of a triangle nearest to a point of the map.
    #[inline]
    fn closest(&self, uv: DVec2, ids: [VertexId; 3]) -> Closest {
        let corners = self.places_of(ids).map(|corner| corner.uv.extend(0.0));
        closest_point(uv.extend(0.0), corners, ids)
    }

    #[inline(always)]
    fn place(
        &self,
        face: FaceId,
        corners: [VertexId; 3],
        Closest { barycentric, feature, .. }: Closest,
        off_chart: f64,
    ) -> MapPlace {
        let point = SurfacePoint { face, barycentric };
        let corners = self.places_of(corners);
        let own = OwnFace {
            fields: corners.map(|corner| corner.field),
            taxels: corners.map(|corner| corner.taxel),
            uv: corners.map(|corner| corner.uv),
        };
        let [a, b, c] = corners.map(|corner| corner.position);
        let normal = match feature {
            Feature::Inside => triangle_cross([a, b, c]),
            _ => self.normal(|field| self.mesh.positions[field], face, feature),
        };
        let position = a * barycentric[0] + b * barycentric[1] + c * barycentric[2];
        let (cell, normal) = (own.cell(self.level, point, &self.image), normal.normalize_or_zero());
        MapPlace { patch: self.patch, link: self.link, off_chart, cell, position, normal }
    }

    /// Keeps one of the answers from `first` on for each sheet: where faces meet, the first one.
    #[inline(never)]
    fn keep_sheets(&self, found: &mut Vec<MapPlace>, first: usize) {
        found[first..].sort_unstable_by_key(|place| place.cell.point.face);
        let mut kept = first;
        for k in first..found.len() {
            let is_new = |other: &MapPlace| other.position.distance(found[k].position) > self.same_point;
            if found[first..kept].iter().all(is_new) {
                found.swap(kept, k);
                kept += 1;
            }
        }
        found.truncate(kept);
    }

    /// A vector on the outer side at a feature of a face; `at` gives the vertices of the level.
    fn normal(&self, at: impl Fn(VertexId) -> DVec3 + Copy, face: FaceId, feature: Feature) -> DVec3 {
        pseudo_normal(&self.corners, &self.mesh.triangles, at, face, feature)
    }
}

/// The triangles of a map at height 0, its places numbered along a curve, so that neighbours on the map are
/// near in memory.
fn plane(map: &MapLevel) -> TriMesh {
    let order = along_curve(map.uv.map(|uv| uv.extend(0.0)).as_slice());
    let mut ranks = IdVec::<PlaceId, VertexId>::filled(VertexId::new(0), order.len());
    for (rank, &place) in order.iter().enumerate() {
        ranks[PlaceId::new(place)] = VertexId::new(rank);
    }
    let positions = order.iter().map(|&place| map.uv[PlaceId::new(place)].extend(0.0)).collect();
    TriMesh { positions, triangles: map.corners().map(|corners| corners.map(|place| ranks[place])) }
}

/// The relation of a point to a triangle in the same plane.
enum Planar {
    /// Inside and clear of its sides, with its barycentric coordinates.
    Inside([f64; 3]),
    /// Farther than the margin beyond a side.
    Beyond,
    /// Undecided, because of rounding and the margin.
    Near,
}

impl Planar {
    /// The rounding error must be less than `margin` (m).
    #[inline(always)]
    fn of(at: DVec2, corners: [DVec2; 3], margin: f64) -> Self {
        let [a, b, c] = corners.map(|corner| corner - at);
        // Twice the areas opposite to each corner, signed.
        let areas = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
        let area = areas[0] + areas[1] + areas[2];
        let away = a.length_squared() + b.length_squared() + c.length_squared();
        // At least twice the margin times the longest side, whose square is at most twice `away`.
        let clear = (2.0 * MIN_CLEARANCE * away + margin * margin / MIN_CLEARANCE) * area.abs();
        let signed = areas.map(|opposite| opposite * area);
        if (signed[0] > clear) & (signed[1] > clear) & (signed[2] > clear) {
            Self::Inside(areas.map(|opposite| opposite / area))
        } else if (signed[0] < -clear) | (signed[1] < -clear) | (signed[2] < -clear) {
            Self::Beyond
        } else {
            Self::Near
        }
    }
}

fn size(mesh: &TriMesh) -> f64 {
    mesh.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max)
}
