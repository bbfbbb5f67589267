//! Joints and weights: which links the vertices of a mesh follow (linear blend skinning).
//!
//! A skin of glTF lists its joints, which are nodes, and for each a matrix from the mesh as it was
//! bound to the frame of the joint. Where the nodes stand as they did then, all joints agree where the
//! mesh is, and it moves with its links from there. In a file that shows another pose, each vertex is
//! moved to where the file shows it, and where each link took the mesh as it was bound is kept
//! ([`Taxels::binds`](crate::skin::Taxels::binds)), so that it moves from there as the file says.
//!
//! Our own files name the link in whose frame the mesh is given; others put it on a link of its own.

use glam::{DAffine3, DMat3, DMat4, DVec4};
use gltf::json::extras::Extras;

use crate::io::error::Result;
use crate::io::gltf::SkinExtras;
use crate::io::gltf::document::Document;
use crate::io::gltf::nodes::{NodeTree, Placement};
use crate::io::gltf::primitive::Attributes;
use crate::mesh::rotation_defect;
use crate::skin::{Joints, LinkId, blended, scaled_joints, world_pose};

/// How far the places may be apart that two joints give the mesh, as rotations and in m: matrices of
/// files are `f32`.
const APART: f64 = 1e-4;

/// The same as a part of the distance of the joints from the origin, which `f32` rounds too.
const APART_FROM_AFAR: f64 = 1e-6;

/// How far the sum of a vertex's weights may be from 1 without a note: files hold them in 8 bits.
const SUM_TOLERANCE: f64 = 0.02;

/// A mesh that is bound to joints.
pub(super) struct Binding {
    joints: Vec<LinkId>,
    /// Where all joints see the frame of the mesh, in the world; `None` if the file says which link it is.
    pub(super) pose: Option<DAffine3>,
    /// Where each link takes the mesh as it was bound, in the frame of the mesh's link; empty if all
    /// leave it where it is.
    pub(super) binds: Vec<(LinkId, DAffine3)>,
    /// Whether the file has the mesh as it was bound: others than ours do.
    is_bound: bool,
}

impl Binding {
    /// The binding of a mesh with a skin; a note says if its joints stand elsewhere than when it was
    /// bound.
    pub(super) fn of(document: &Document, tree: &NodeTree, placement: &Placement) -> Result<Option<Self>> {
        let Some(number) = placement.skin else { return Ok(None) };
        let element = format!("skin {number}");
        let Some(skin) = document.root().skins.get(number) else {
            let needed = format!("one of the file's {}", document.root().skins.len());
            return document.notes.pass(document.invalid(element, "no such skin", needed)).map(|()| None);
        };
        let inverse: Vec<DMat4> = match skin.inverse_bind_matrices {
            None => vec![DMat4::IDENTITY; skin.joints.len()],
            Some(accessor) => {
                let accessor = document.accessor(accessor.value(), &element)?;
                accessor.reals(|m: [f64; 16]| DMat4::from_cols_array(&m))?
            }
        };
        if inverse.len() < skin.joints.len() {
            let found = format!("{} matrices for {} joints", inverse.len(), skin.joints.len());
            return Err(document.invalid(element, found, "one for each joint"));
        }
        let (mut joints, mut seen) = (Vec::new(), Vec::new());
        for (joint, inverse) in skin.joints.iter().zip(inverse) {
            let Some(link) = tree.nodes.get(joint.value()).copied().flatten() else {
                let fault = document.invalid(element, format!("joint {joint}"), "a node of the scene");
                return document.notes.pass(fault).map(|()| None);
            };
            if !inverse.row(3).abs_diff_eq(DVec4::W, APART) {
                let fault = document.invalid(element, format!("the matrix {inverse}"), "an affine matrix");
                return document.notes.pass(fault).map(|()| None);
            }
            let stretch = DAffine3::from_mat3(tree.stretches[joint.value()].unwrap_or(DMat3::IDENTITY));
            joints.push(link);
            seen.push(world_pose(&tree.links, link) * stretch * DAffine3::from_mat4(inverse));
        }
        let own = world_pose(&tree.links, placement.link);
        let known = (!placement.is_free).then_some(own);
        let far = joints.iter().map(|&link| world_pose(&tree.links, link).translation.abs().max_element());
        let apart = far.map(|far| far * APART_FROM_AFAR).fold(APART, f64::max);
        let is_rigid =
            |pose: &DAffine3| rotation_defect(&pose.matrix3) < APART && pose.matrix3.determinant() > 0.0;
        let mut all = seen.iter().chain(&known);
        let agreed = all.next().filter(|first| all.all(|other| other.abs_diff_eq(**first, apart)));
        if let Some(pose) = agreed.filter(|pose| is_rigid(pose)) {
            // Rounding in the file must not make a rotation of what is none.
            let is_origin = pose.abs_diff_eq(DAffine3::IDENTITY, APART);
            let (_, turn, place) = pose.to_scale_rotation_translation();
            let rigid = DAffine3::from_rotation_translation(turn.normalize(), place);
            let pose = if is_origin { DAffine3::IDENTITY } else { rigid };
            let binds = kept_binds(document, &element, &joints, &skin.extras)?;
            let pose = placement.is_free.then_some(pose);
            return Ok(Some(Self { joints, pose, binds, is_bound: false }));
        }
        let found = "joints that stand elsewhere than when the mesh was bound to them";
        let fault = document.invalid(element, found, "the pose of the inverse bind matrices");
        document.notes.settle(fault, "vertices were moved to where the file shows them")?;
        let binds = joints.iter().zip(seen).map(|(&link, seen)| (link, own.inverse() * seen)).collect();
        Ok(Some(Self { joints, pose: None, binds, is_bound: true }))
    }

    /// Where a vertex goes that follows its links to where the file shows it; `None` if all are there.
    pub(super) fn moved(&self, joints: &Joints) -> Option<DAffine3> {
        self.is_bound.then(|| blended(joints, &self.binds))
    }

    /// The links that each vertex of a primitive follows.
    pub(super) fn joints(&self, attributes: &Attributes<'_>) -> Result<Option<Vec<Joints>>> {
        let document = attributes.document;
        let (Some(joints), Some(weights)) = (attributes.get("JOINTS_0"), attributes.get("WEIGHTS_0")) else {
            return Ok(None);
        };
        if weights.is_blank() {
            return Ok(None);
        }
        if attributes.get("JOINTS_1").is_some() {
            let fault = document.invalid(&attributes.element, "JOINTS_1", "at most four joints a vertex");
            document.notes.settle(fault, "those of JOINTS_0 alone are followed")?;
        }
        let (numbers, shares) = (joints.integers::<4>()?, weights.reals(|row: [f64; 4]| row)?);
        let mut rows = Vec::with_capacity(numbers.len());
        for (vertex, (numbers, mut shares)) in numbers.into_iter().zip(shares).enumerate() {
            let sum: f64 = shares.iter().sum();
            if sum > 0.0 && (sum - 1.0).abs() > SUM_TOLERANCE {
                let fault = weights.invalid("weights whose sum is not 1", "the sum 1");
                document.notes.settle(fault, "they were scaled to it")?;
                shares = shares.map(|share| share / sum);
            }
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

/// The binds that our own files keep with the joints of a skin.
fn kept_binds(
    document: &Document,
    element: &str,
    joints: &[LinkId],
    extras: &Extras,
) -> Result<Vec<(LinkId, DAffine3)>> {
    let Some(SkinExtras { binds }) = SkinExtras::of(extras) else { return Ok(Vec::new()) };
    let is_affine = |m: &DMat4| m.is_finite() && m.row(3) == DVec4::W;
    let binds: Vec<DMat4> = binds.iter().map(DMat4::from_cols_array).filter(is_affine).collect();
    if binds.len() != joints.len() {
        let found = format!("{} affine matrices in extras.dermatome.binds", binds.len());
        return Err(document.invalid(element, found, format!("{}, one for each joint", joints.len())));
    }
    Ok(joints.iter().copied().zip(binds.into_iter().map(DAffine3::from_mat4)).collect())
}
