//! Joints and weights: which links the vertices of a mesh follow (linear blend skinning).
//!
//! A skin of glTF lists its joints, which are nodes, and for each a matrix from the mesh as it was
//! bound to the frame of the joint. Where the nodes stand as they did then, all joints agree where the
//! mesh is, and it moves with its links from there; files that show another pose are read without
//! joints, with a note.
//!
//! Our own files name the link in whose frame the mesh is given; others put it on a link of its own.

use glam::{DAffine3, DMat4, DVec4};
use serde::Deserialize;

use crate::{
    io::{
        error::Result,
        gltf::{
            document::{Document, Role},
            nodes::{Placement, Tree},
            primitive::Attributes,
        },
    },
    mesh::rotation_defect,
    skin::{Joints, LinkId, scaled_joints, world_pose},
};

/// How far the places may be apart that two joints give the mesh, as rotations and in m: matrices of
/// files are `f32`.
const APART: f64 = 1e-4;

/// The same as a part of the distance of the joints from the origin, which `f32` rounds too.
const APART_FROM_AFAR: f64 = 1e-6;

/// What is read of a skin.
#[derive(Deserialize)]
struct SkinJson {
    joints: Vec<usize>,
    #[serde(rename = "inverseBindMatrices")]
    inverse: Option<usize>,
}

/// A mesh that is bound to joints.
pub(super) struct Binding {
    joints: Vec<LinkId>,
    /// Where all joints see the frame of the mesh, in the world; `None` if the file says which link it is.
    pub(super) pose: Option<DAffine3>,
}

impl Binding {
    /// The binding of a mesh with a skin, if its joints agree where it is; a note says if they do not.
    pub(super) fn of(document: &Document, tree: &Tree, placement: &Placement) -> Result<Option<Self>> {
        let Some(number) = placement.skin else { return Ok(None) };
        let element = format!("skin {number}");
        let json = document.skins.get(number).cloned().unwrap_or_default();
        let skin = match SkinJson::deserialize(json) {
            Ok(skin) => skin,
            Err(fault) => {
                let fault = document.invalid(element, fault.to_string(), "joints: a list of nodes");
                return document.notes.pass(fault).map(|()| None);
            }
        };
        let mut joints = Vec::new();
        for &node in &skin.joints {
            let Some(link) = tree.nodes.get(node).copied().flatten() else {
                let fault = document.invalid(element, format!("joint {node}"), "a node of the scene");
                return document.notes.pass(fault).map(|()| None);
            };
            joints.push(link);
        }
        let inverse: Vec<DMat4> = match skin.inverse {
            None => vec![DMat4::IDENTITY; joints.len()],
            Some(accessor) => {
                let accessor = document.accessor(accessor, Role::Plain, &element)?;
                accessor.reals(|m: [f64; 16]| DMat4::from_cols_array(&m))?
            }
        };
        if inverse.len() < joints.len() {
            let found = format!("{} matrices for {} joints", inverse.len(), joints.len());
            return Err(document.invalid(element, found, "one for each joint"));
        }
        let seen = joints.iter().zip(&inverse).map(|(&link, inverse)| {
            let is_affine = inverse.row(3).abs_diff_eq(DVec4::W, APART);
            is_affine.then(|| world_pose(&tree.links, link) * DAffine3::from_mat4(*inverse))
        });
        let mut seen = seen.collect::<Option<Vec<_>>>().unwrap_or_default();
        if !placement.is_free && !seen.is_empty() {
            seen.push(world_pose(&tree.links, placement.link));
        }
        let far = joints.iter().map(|&link| world_pose(&tree.links, link).translation.abs().max_element());
        let apart = far.map(|far| far * APART_FROM_AFAR).fold(APART, f64::max);
        let is_rigid =
            |pose: &DAffine3| rotation_defect(&pose.matrix3) < APART && pose.matrix3.determinant() > 0.0;
        let agreed = seen.first().filter(|first| seen.iter().all(|other| other.abs_diff_eq(**first, apart)));
        let Some(pose) = agreed.filter(|pose| is_rigid(pose)) else {
            let found = "joints that stand elsewhere than when the mesh was bound to them, or are scaled";
            let needed = "the nodes in the pose of the inverse bind matrices; joints are not read";
            return document.notes.pass(document.invalid(element, found, needed)).map(|()| None);
        };
        // Rounding in the file must not make a rotation of what is none.
        let is_origin = pose.abs_diff_eq(DAffine3::IDENTITY, APART);
        let (_, turn, place) = pose.to_scale_rotation_translation();
        let rigid = DAffine3::from_rotation_translation(turn.normalize(), place);
        let pose = if is_origin { DAffine3::IDENTITY } else { rigid };
        Ok(Some(Self { joints, pose: placement.is_free.then_some(pose) }))
    }

    /// The links that each vertex of a primitive follows.
    pub(super) fn joints(&self, attributes: &Attributes<'_>) -> Result<Option<Vec<Joints>>> {
        if attributes.get("JOINTS_1").is_some() {
            let fault =
                attributes.document.unsupported(&attributes.element, "more than four joints a vertex");
            return attributes.document.notes.pass(fault).map(|()| None);
        }
        let (Some(joints), Some(weights)) = (attributes.get("JOINTS_0"), attributes.get("WEIGHTS_0")) else {
            return Ok(None);
        };
        if weights.is_blank() {
            return Ok(None);
        }
        let (numbers, shares) = (joints.integers::<4>()?, weights.reals(|row: [f64; 4]| row)?);
        let mut rows = Vec::with_capacity(numbers.len());
        for (vertex, (numbers, shares)) in numbers.into_iter().zip(shares).enumerate() {
            let mut row = [(LinkId::default(), 0.0); 4];
            for ((slot, number), share) in row.iter_mut().zip(numbers).zip(shares) {
                // What has no weight may be any number.
                let link = self.joints.get(number as usize).copied();
                let link = if share == 0.0 { Some(LinkId::default()) } else { link };
                let unknown = || {
                    let needed = format!("less than {}, the joints of the skin", self.joints.len());
                    joints.invalid(format!("joint {number} of vertex {vertex}"), needed)
                };
                *slot = (link.ok_or_else(unknown)?, share);
            }
            rows.push(scaled_joints(&row).ok_or_else(|| {
                let found = format!("the weights {shares:?} of vertex {vertex}");
                weights.invalid(found, "weights of at least 0 with sum 1")
            })?);
        }
        Ok(Some(rows))
    }
}
