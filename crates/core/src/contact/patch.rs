//! [`IndexedPatch`]: the trees and the map of one patch. Its vertices may follow several links, by a linear
//! blend of their motions, to which the trees are fitted whenever links move ([`Blend`]).

use glam::{DAffine3, DVec3};

use crate::bvh::{Aabb, PointTree, Refitting};
use crate::contact::cell::PatchCells;
use crate::contact::patch_bvh::PatchBvh;
use crate::contact::posed_links::Links;
use crate::contact::{ContactError, IndexOptions};
use crate::id::{IdVec, VertexId};
use crate::map::PatchMap;
use crate::mesh::{TriMesh, is_within_reach};
use crate::pyramid::LevelId;
use crate::skin::{Joints, LinkId, PatchId, Presence, bind_of, blended, scaled_joints};

#[derive(Debug, Clone)]
pub(super) struct IndexedPatch {
    pub(super) name: String,
    pub(super) link: LinkId,
    pub(super) tree: PatchBvh,
    pub(super) cells: PatchCells,
    /// The centres of the fields of each level; none if the index has no fields.
    pub(super) fields: Vec<PointTree>,
    /// The box of its faces and fields, in m in the frame of the link.
    pub(super) bounds: Aabb,
    /// Mean length of the sides of its faces, in m.
    pub(super) spacing: f64,
    /// The vertex of level 0 at the centre of each field, on each level; none if the index has no fields.
    pub(super) origins: Vec<IdVec<VertexId, VertexId>>,
    /// Outward unit normals of the taxels in the current pose of the robot, in the frame of the link; none if
    /// the index has no fields.
    pub(super) normals: IdVec<VertexId, DVec3>,
    /// Which of its taxels work.
    pub(super) presence: IdVec<VertexId, Presence>,
    /// How its vertices follow several links; `None`: it is rigid.
    pub(super) blend: Option<Box<Blend>>,
}

impl IndexedPatch {
    /// A patch of a valid map; its links are those of the map, and its vertices follow none but its own.
    pub(super) fn new(patch: &PatchMap, options: &IndexOptions) -> Result<Self, ContactError> {
        let mesh = &patch.levels[LevelId::new(0)].level.mesh;
        if mesh.triangles.is_empty() {
            return Err(ContactError::NoFaces { patch: patch.name.clone() });
        }
        let tree = PatchBvh::new(&patch.name, mesh)?;
        let with_fields = || patch.levels.iter().filter(|_| options.fields);
        let mut indexed = Self {
            name: patch.name.clone(),
            link: patch.link,
            cells: PatchCells::new(patch)?,
            fields: with_fields().map(|map| vertex_tree(&map.level.mesh)).collect(),
            bounds: tree.bounds(),
            spacing: tree.spacing(),
            origins: with_fields().map(|map| map.level.origins.clone()).collect(),
            normals: if options.fields { patch.taxels.normals.clone() } else { IdVec::default() },
            presence: patch.taxels.presence.clone(),
            blend: None,
            tree,
        };
        indexed.fill_bounds();
        Ok(indexed)
    }

    /// Lets the vertices follow their [joints](crate::skin::Taxels::joints) from now on (linear blend
    /// skinning): a vertex moves to the weighted mean of the positions to which its links move it; weights
    /// are scaled to sum 1.
    ///
    /// # Errors
    /// If a link does not exist.
    pub(super) fn follow(
        &mut self,
        id: PatchId,
        (joints, binds): (&IdVec<VertexId, Joints>, &[(LinkId, DAffine3)]),
        links: &Links,
    ) -> Result<(), ContactError> {
        let mut scaled = joints.clone();
        for (vertex, row) in joints.enumerate() {
            let is_known = |row: &Joints| row.iter().all(|joint| joint.0.index() < links.len());
            scaled[vertex] = scaled_joints(row).filter(is_known).ok_or(ContactError::Joints {
                patch: id,
                vertex,
                joints: *row,
                links: links.len(),
            })?;
        }
        let (rest, poses) = (self.tree.mesh.positions.clone(), links.poses());
        let to_joint = poses.map(|pose| pose.inverse() * poses[self.link]);
        let blend =
            Blend::new(&rest, self.normals.clone(), (&scaled, binds), to_joint, self.tree.refitting());
        self.blend = Some(Box::new(blend));
        Ok(())
    }

    /// Fits the trees of a patch that follows several links to the positions of its vertices.
    pub(super) fn bend(&mut self) {
        let Some(blend) = &mut self.blend else { return };
        self.tree.refit(&mut blend.positions, &mut blend.refitting);
        std::mem::swap(&mut self.normals, &mut blend.normals);
        let (positions, normals) = (&self.tree.mesh.positions, &self.normals);
        for (fields, origins) in self.fields.iter_mut().zip(&self.origins) {
            let origin = |field: usize| origins[VertexId::new(field)];
            fields.refit(|field| positions[origin(field)], |field| normals[origin(field)]);
        }
        self.fill_bounds();
    }

    /// Fields may be outside of the faces of level 0: a taxel may belong to no face, and a coarse level has
    /// vertices of its own.
    fn fill_bounds(&mut self) {
        self.bounds = self.fields.iter().map(PointTree::bounds).fold(self.tree.bounds(), Aabb::union);
    }
}

/// A tree over the vertices of a mesh, along its normals.
fn vertex_tree(mesh: &TriMesh) -> PointTree {
    let mut normals = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, mesh.positions.len());
    for (face, corners) in mesh.triangles.enumerate() {
        corners.iter().for_each(|&v| normals[v] += mesh.face_cross(face));
    }
    PointTree::new(mesh.positions.as_slice(), |v| normals[VertexId::new(v)])
}

/// How the vertices of a patch follow links.
#[derive(Debug, Clone)]
pub(super) struct Blend {
    /// The links that each vertex follows, their weights, none of them 0, and the points that they carry, in m in
    /// the frame of the patch's link; one vertex after the other: fewer bytes to read than [`Joints`].
    joints: Vec<(LinkId, f64, DVec3)>,
    /// Number of links that each vertex follows.
    counts: Vec<u8>,
    /// From the frame of the patch's link to that of each link, in the pose of the map.
    to_joint: IdVec<LinkId, DAffine3>,
    /// The motion of each link since the pose of the map, in the frame of the patch's link.
    carried: IdVec<LinkId, DAffine3>,
    /// The moved vertices, in the same frame, until the tree is fitted to them.
    positions: IdVec<VertexId, DVec3>,
    /// The normals of the taxels in the pose of the map, in the same frame; none if the index has no fields.
    rest_normals: IdVec<VertexId, DVec3>,
    /// The normals as rotated by the links.
    normals: IdVec<VertexId, DVec3>,
    refitting: Refitting,
}

impl Blend {
    /// A blend of vertices at `rest` and of normals, if there are any, by joints whose weights have the sum 1.
    #[expect(clippy::cast_possible_truncation, reason = "at most four")]
    fn new(
        rest: &IdVec<VertexId, DVec3>,
        rest_normals: IdVec<VertexId, DVec3>,
        (joints, binds): (&IdVec<VertexId, Joints>, &[(LinkId, DAffine3)]),
        to_joint: IdVec<LinkId, DAffine3>,
        refitting: Refitting,
    ) -> Self {
        let count = |row: &Joints| row.iter().filter(|joint| joint.1 > 0.0).count() as u8;
        Self {
            counts: joints.iter().map(count).collect(),
            joints: joints.iter().zip(rest).flat_map(|(row, &rest)| carried(row, binds, rest)).collect(),
            carried: to_joint.map(|_| DAffine3::IDENTITY),
            positions: rest.clone(),
            normals: rest_normals.clone(),
            rest_normals,
            to_joint,
            refitting,
        }
    }

    /// Moves the vertices with the next poses of the links in the world; `own` is the link of the patch.
    ///
    /// # Errors
    /// The first vertex that is too far away.
    pub(super) fn follow(
        &mut self,
        own: LinkId,
        next: impl Fn(LinkId) -> DAffine3,
    ) -> Result<(), (VertexId, DVec3)> {
        let from_world = next(own).inverse();
        for (link, to_joint) in self.to_joint.enumerate() {
            // Rounding must not move vertices that follow the patch's own link.
            self.carried[link] =
                if link == own { DAffine3::IDENTITY } else { from_world * next(link) * *to_joint };
        }
        let Self { joints, counts, carried, .. } = self;
        let rows = counts.iter().scan(joints.as_slice(), |left, &count| {
            let (row, others) = left.split_at(usize::from(count));
            *left = others;
            Some(row)
        });
        for ((vertex, position), row) in self.positions.iter_mut().enumerate().zip(rows.clone()) {
            let part = |&(joint, weight, rest): &(LinkId, f64, DVec3)| {
                weight * carried[joint].transform_point3(rest)
            };
            *position = row.iter().map(part).sum();
            if !is_within_reach(*position) {
                return Err((VertexId::new(vertex), *position));
            }
        }
        for ((normal, rest), row) in self.normals.iter_mut().zip(&self.rest_normals).zip(rows) {
            let part =
                |&(joint, weight, _): &(LinkId, f64, DVec3)| weight * carried[joint].transform_vector3(*rest);
            *normal = row.iter().map(part).sum::<DVec3>().normalize_or(*rest);
        }
        Ok(())
    }
}

/// The links that a vertex at `rest` follows, their weights, and the points that they carry; see [`Joints`].
fn carried(
    row: &Joints,
    binds: &[(LinkId, DAffine3)],
    rest: DVec3,
) -> impl Iterator<Item = (LinkId, f64, DVec3)> {
    // Of one link it is the vertex itself, and a blend that is singular does not say where it was bound.
    let is_one = row.iter().filter(|joint| joint.1 > 0.0).count() == 1;
    let from_rest = blended(row, binds).inverse();
    let bound =
        (!binds.is_empty() && !is_one && from_rest.is_finite()).then(|| from_rest.transform_point3(rest));
    row.iter().filter(|joint| joint.1 > 0.0).map(move |&(link, weight)| {
        let point = bound.map_or(rest, |bound| bind_of(binds, link).transform_point3(bound));
        (link, weight, point)
    })
}
