//! Faces and normals: slivers, winding, placeholders.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, surface_normals};
use crate::skin::UnreliableNormals;
use crate::skin::assemble::zero_area::{has_no_area, slenderness};
use crate::skin::check::FindingKind;
use crate::skin::check::finding::{Report, Subject};
use crate::skin::normals::{NormalConsensus, NormalQuality};
use crate::skin::weld::welded_mesh::duplicate_faces;

/// A sliver is lower than this share of its longest side. Valid calibrated covers have faces down
/// to 0.04.
const SLIVER: f64 = 0.02;

/// Reports faces that repeat corners or other faces, and those that are too thin.
pub(super) fn check_faces(subject: &Subject<'_>, report: &mut Report<'_>) {
    let surface = &subject.surface;
    let mesh = &surface.mesh;
    report.add_faces(FindingKind::RepeatedCorner, surface.repeated.iter().copied());
    let in_file = |f: FaceId| surface.file_faces[f];
    report.add_faces(FindingKind::DuplicateFace, duplicate_faces(mesh).into_iter().map(in_file));
    let (mut flat, mut slivers, mut thinnest) = (Vec::new(), Vec::new(), f64::INFINITY);
    for face in mesh.triangles.ids() {
        let corners = mesh.corners(face);
        let slenderness = slenderness(corners);
        if has_no_area(corners) {
            flat.push(in_file(face));
        } else if slenderness < SLIVER {
            slivers.push(in_file(face));
            thinnest = thinnest.min(slenderness);
        }
    }
    report.add_faces(FindingKind::ZeroAreaFace, flat);
    report.add_faces(FindingKind::SliverFace { aspect: 1.0 / thinnest }, slivers);
}

pub(super) fn check_winding(subject: &Subject<'_>, report: &mut Report<'_>) {
    let winding = &subject.winding;
    let mesh = &subject.surface.mesh;
    let mut faces = vec![0_usize; winding.components.count];
    let mut against = vec![0_usize; winding.components.count];
    for (face, &piece) in winding.components.of.enumerate() {
        faces[piece] += 1;
        against[piece] += usize::from(winding.reversed[face]);
    }
    let fewer = mesh.triangles.ids().filter(|&f| {
        let piece = winding.components.of[f];
        let most_against = 2 * against[piece] > faces[piece];
        winding.reversed[f] != most_against
    });
    let kind = FindingKind::InconsistentWinding { of: mesh.triangles.len() };
    report.add_faces(kind, fewer.map(|f| subject.surface.file_faces[f]));
}

/// Reports faces wound against the normals, and normals that are zero, not finite, or disagree with the faces.
pub(super) fn check_normals(subject: &Subject<'_>, report: &mut Report<'_>) {
    let winding = &subject.winding;
    let mesh = &subject.surface.mesh;
    let Some(normals) = &subject.normals else { return };
    // The mesh with every piece wound like its first face, then outward.
    let mut wound = mesh.clone();
    let mut consensus = vec![NormalConsensus::default(); winding.components.count];
    for face in mesh.triangles.ids() {
        if winding.reversed[face] {
            wound.triangles[face].swap(1, 2);
        }
        let at_corners = wound.triangles[face].map(|v| normals[v]);
        consensus[winding.components.of[face]].add(wound.face_cross(face), at_corners);
    }
    let qualities: Vec<NormalQuality> = consensus.iter().map(NormalConsensus::quality).collect();
    let mut turned = Vec::new();
    for face in mesh.triangles.ids() {
        let of_piece = qualities[winding.components.of[face]];
        if of_piece == NormalQuality::Inward {
            wound.triangles[face].swap(1, 2);
        }
        let is_turned = winding.reversed[face] != (of_piece == NormalQuality::Inward);
        if is_turned && !matches!(of_piece, NormalQuality::Unreliable(_)) {
            turned.push(subject.surface.file_faces[face]);
        }
    }
    report.add_faces(FindingKind::WindingAgainstNormals { of: mesh.triangles.len() }, turned);
    check_directions(subject, normals, &wound, &qualities, report);
}

/// Reports normals that disagree with `wound`, the mesh wound outward.
fn check_directions(
    subject: &Subject<'_>,
    normals: &IdVec<VertexId, DVec3>,
    wound: &TriMesh,
    qualities: &[NormalQuality],
    report: &mut Report<'_>,
) {
    let in_file = |v| subject.surface.in_file(v);
    let outward = surface_normals(wound);
    let [mut constant, mut unrelated, mut inward] = [const { Vec::<VertexId>::new() }; 3];
    let mut seen = outward.map(|_| false);
    for (face, corners) in wound.triangles.enumerate() {
        for &v in corners {
            if std::mem::replace(&mut seen[v], true) {
                continue;
            }
            match qualities[subject.winding.components.of[face]] {
                NormalQuality::Unreliable(UnreliableNormals::Constant) => constant.push(in_file(v)),
                NormalQuality::Unreliable(UnreliableNormals::Unrelated) => unrelated.push(in_file(v)),
                NormalQuality::Outward | NormalQuality::Inward if normals[v].dot(outward[v]) < 0.0 => {
                    inward.push(in_file(v))
                }
                _ => {}
            }
        }
    }
    for list in [&mut constant, &mut unrelated, &mut inward] {
        list.sort_unstable();
    }
    report.add_vertices(FindingKind::ConstantNormals, constant);
    report.add_vertices(FindingKind::UnrelatedNormals, unrelated);
    report.add_vertices(FindingKind::InwardNormal, inward);
}
