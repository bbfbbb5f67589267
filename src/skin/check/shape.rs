//! Faces and normals: slivers, winding, placeholders.

use std::collections::HashMap;

use glam::DVec3;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
    skin::{
        UnreliableNormals,
        assemble::zero_area::{has_no_area, slenderness},
        check::{
            FindingKind,
            report::{Report, Subject, numbers},
        },
        normals::{NormalConsensus, NormalQuality, surface_normals},
    },
};

/// A sliver is lower than this share of its longest side. Sound calibrated covers have faces down
/// to 0.04.
const SLIVER: f64 = 0.02;

/// Notes faces that repeat corners or other faces, and those that are too thin.
pub(super) fn check_faces(subject: &Subject<'_>, report: &mut Report<'_>) {
    let surface = &subject.surface;
    let mesh = &surface.mesh;
    report.add(FindingKind::RepeatedCorner, numbers(surface.repeated.iter().map(|f| f.raw())), |n| {
        format!("{n} faces use one taxel twice")
    });
    let in_file = |f: FaceId| surface.file_faces[f].raw();
    let mut first: HashMap<[VertexId; 3], FaceId> = HashMap::with_capacity(mesh.triangles.len());
    let mut again = Vec::new();
    for (face, &corners) in mesh.triangles.enumerate() {
        let mut sorted = corners;
        sorted.sort_unstable();
        if *first.entry(sorted).or_insert(face) != face {
            again.push(in_file(face));
        }
    }
    report.add(FindingKind::DuplicateFace, numbers(again), |n| {
        format!("{n} faces have the same corners as an earlier face")
    });
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
    report.add(FindingKind::ZeroAreaFace, numbers(flat), |n| {
        format!("{n} faces have no area: their corners lie on a line")
    });
    report.add(FindingKind::SliverFace, numbers(slivers), |n| {
        format!(
            "{n} faces are more than {:.0} times longer than high, the thinnest {:.0} times",
            1.0 / SLIVER,
            1.0 / thinnest
        )
    });
}

pub(super) fn check_winding(subject: &Subject<'_>, report: &mut Report<'_>) {
    let winding = &subject.winding;
    let mesh = &subject.surface.mesh;
    let mut faces = vec![0_usize; winding.components];
    let mut against = vec![0_usize; winding.components];
    for (face, &piece) in winding.component.enumerate() {
        faces[piece] += 1;
        against[piece] += usize::from(winding.reversed[face]);
    }
    let in_file = |f: FaceId| subject.surface.file_faces[f].raw();
    let fewer = mesh.triangles.ids().filter(|&f| {
        let piece = winding.component[f];
        let most_against = 2 * against[piece] > faces[piece];
        winding.reversed[f] != most_against
    });
    report.add(FindingKind::InconsistentWinding, numbers(fewer.map(in_file)), |n| {
        format!("{n} of {} faces are wound against most faces of their piece", mesh.triangles.len())
    });
}

/// Notes faces wound against the normals, and normals that are not worth the name.
pub(super) fn check_normals(subject: &Subject<'_>, report: &mut Report<'_>) {
    let winding = &subject.winding;
    let mesh = &subject.surface.mesh;
    let Some(normals) = &subject.normals else { return };
    // The mesh with every piece wound like its first face, then outward.
    let mut wound = mesh.clone();
    let mut consensus = vec![NormalConsensus::default(); winding.components];
    for face in mesh.triangles.ids() {
        if winding.reversed[face] {
            wound.triangles[face].swap(1, 2);
        }
        let at_corners = wound.triangles[face].map(|v| normals[v]);
        consensus[winding.component[face]].add(wound.face_cross(face), at_corners);
    }
    let qualities: Vec<NormalQuality> = consensus.iter().map(NormalConsensus::quality).collect();
    let mut turned = Vec::new();
    for face in mesh.triangles.ids() {
        let of_piece = qualities[winding.component[face]];
        if of_piece == NormalQuality::Inward {
            wound.triangles[face].swap(1, 2);
        }
        let is_turned = winding.reversed[face] != (of_piece == NormalQuality::Inward);
        if is_turned && !matches!(of_piece, NormalQuality::Unreliable(_)) {
            turned.push(subject.surface.file_faces[face].raw());
        }
    }
    report.add(FindingKind::WindingAgainstNormals, numbers(turned), |n| {
        format!("{n} of {} faces are wound against the taxels' normals", mesh.triangles.len())
    });

    check_directions(subject, normals, &wound, &qualities, report);
}

/// Notes normals that do not tell the outside of `wound`, the mesh wound outward.
fn check_directions(
    subject: &Subject<'_>,
    normals: &IdVec<VertexId, DVec3>,
    wound: &TriMesh,
    qualities: &[NormalQuality],
    report: &mut Report<'_>,
) {
    let in_file = |v| subject.surface.in_file(v).raw();
    let outward = surface_normals(wound);
    let [mut constant, mut unrelated, mut inward] = [const { Vec::<u32>::new() }; 3];
    let mut seen = outward.map(|_| false);
    for (face, corners) in wound.triangles.enumerate() {
        for &v in corners {
            if std::mem::replace(&mut seen[v], true) {
                continue;
            }
            match qualities[subject.winding.component[face]] {
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
    report.add(FindingKind::ConstantNormals, numbers(constant), |n| {
        format!("the normals of {n} taxels are all the same although their piece is curved: placeholders")
    });
    report.add(FindingKind::UnrelatedNormals, numbers(unrelated), |n| {
        format!("the normals of {n} taxels do not fit the faces around them, inward or outward")
    });
    report.add(FindingKind::InwardNormal, numbers(inward), |n| {
        format!("the normals of {n} taxels point inwards, against most normals of their piece")
    });
}
