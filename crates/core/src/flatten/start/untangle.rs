//! Removes flipped faces by moving only the vertices around them (`(garanzha2021)`; *heuristic*: the sizes of
//! the regions).
//!
//! Success is not guaranteed, and a repaired map may wind twice about a vertex: the caller checks both, and
//! uses a convex start if that fails.

use std::collections::HashMap;

use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::{Element, ElementMesh, Uv};
use crate::flatten::energy::face_energy::DistortionEnergy;
use crate::flatten::energy::newton::{NewtonLimits, Solver};
use crate::flatten::energy::objective::Objective;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::signed_area;
use crate::sparse::SparseError;

/// Rings around flipped faces that may move, tried in turn: a larger region costs more but leaves more room.
const RINGS: [usize; 4] = [2, 4, 8, 16];

/// Regions up to this many movable vertices are repaired; larger ones are faster to flatten anew, unless the
/// boundary is prescribed.
const LARGEST_PART: usize = 20_000;

/// The regularisation starts at this multiple of the worst area and is halved from round to round.
const SOFTNESS: f64 = 1.0;

/// Halvings of the regularisation before a region is given up.
const MAX_HALVINGS: usize = 40;

/// Newton steps of a round; the energy changes in the next round anyway.
const ROUND: NewtonLimits = NewtonLimits { rest: 1e-3, steps: 4, gain: 0.0, most: f64::INFINITY };

/// Turns flipped faces back by moving only the vertices around them; returns whether none is left.
///
/// In each region the untangling energy is minimised while its `e` shrinks (`(escobar2003)`,
/// `(garanzha2021)`). There is no proof that this always succeeds.
pub(crate) fn untangle(domain: &FlattenDomain<'_>, uv: &mut Uv) -> Result<bool, SparseError> {
    let everything = if domain.prescribed.is_empty() { None } else { Some(domain.vertices()) };
    let largest = everything.unwrap_or(LARGEST_PART);
    for rings in RINGS.into_iter().chain(everything) {
        let flipped: Vec<bool> = domain.elements.flips(uv).collect();
        if !flipped.iter().any(|f| *f) {
            return Ok(true);
        }
        let movable = around(domain, &flipped, rings);
        for part in parts(domain, &movable) {
            if part.vertices.len() <= largest {
                repair(domain, &part, uv)?;
            }
        }
    }
    Ok(domain.elements.is_flip_free(uv))
}

/// The vertices within `rings` rings of a flipped face.
fn around(domain: &FlattenDomain<'_>, flipped: &[bool], rings: usize) -> IdVec<VertexId, bool> {
    let mut inside = IdVec::filled(false, domain.vertices());
    let mut front: Vec<VertexId> = Vec::new();
    let mut enter = |v: VertexId, front: &mut Vec<VertexId>| {
        if !std::mem::replace(&mut inside[v], true) {
            front.push(v);
        }
    };
    for (e, _) in domain.elements.faces.iter().zip(flipped).filter(|(_, f)| **f) {
        e.corners.into_iter().for_each(|v| enter(v, &mut front));
    }
    for _ in 0..rings {
        if front.is_empty() {
            break;
        }
        for v in std::mem::take(&mut front) {
            domain.disk.adjacency.ring(v).iter().for_each(|&w| enter(w, &mut front));
        }
    }
    for (is_movable, place) in inside.iter_mut().zip(&domain.prescribed) {
        *is_movable &= place.is_none();
    }
    inside
}

/// Connected movable vertices, and the faces around them.
#[derive(Debug, Default)]
struct LocalMesh {
    vertices: Vec<VertexId>,
    faces: Vec<FaceId>,
}

/// The connected regions of `movable` vertices, each in the order of a search from its smallest one.
fn parts(domain: &FlattenDomain<'_>, movable: &IdVec<VertexId, bool>) -> Vec<LocalMesh> {
    const NONE: usize = usize::MAX;
    let mut part_of = IdVec::<VertexId, usize>::filled(NONE, movable.len());
    let mut parts: Vec<LocalMesh> = Vec::new();
    for seed in movable.ids() {
        if !movable[seed] || part_of[seed] != NONE {
            continue;
        }
        part_of[seed] = parts.len();
        let mut vertices = vec![seed];
        let mut next = 0;
        while let Some(&v) = vertices.get(next) {
            next += 1;
            for &w in domain.disk.adjacency.ring(v) {
                if movable[w] && part_of[w] == NONE {
                    part_of[w] = parts.len();
                    vertices.push(w);
                }
            }
        }
        parts.push(LocalMesh { vertices, faces: Vec::new() });
    }
    // Movable corners of one face are neighbours, so they are all in one region.
    for (face, e) in domain.elements.faces.enumerate() {
        let part = e.corners.into_iter().map(|v| part_of[v]).find(|p| *p != NONE);
        if let Some(part) = part.and_then(|p| parts.get_mut(p)) {
            part.faces.push(face);
        }
    }
    parts
}

/// Moves the vertices of `part` until no face around them is flipped; if that fails, they keep their old
/// positions.
fn repair(domain: &FlattenDomain<'_>, part: &LocalMesh, uv: &mut Uv) -> Result<(), SparseError> {
    let (elements, ids) = elements_of(domain, part, uv);
    let mut local: Uv = ids.iter().map(|&v| uv[v]).collect();
    let worst = elements
        .faces
        .iter()
        .zip(elements.map_areas(&local))
        .map(|(e, area)| 2.0 * area * e.gradients[1].perp_dot(e.gradients[2]))
        .fold(0.0, f64::min);
    // Areas of exactly zero still need some softness to become positive.
    let mut softness = SOFTNESS * worst.abs().max(1e-2);
    for _ in 0..MAX_HALVINGS {
        let objective = Objective::of_faces(&elements, DistortionEnergy::Untangling { softness });
        objective.minimise(&mut local, Solver::Direct, ROUND, &mut |_| true)?;
        if elements.is_flip_free(&local) {
            for (&v, &p) in ids.iter().zip(&local) {
                uv[v] = p;
            }
            return Ok(());
        }
        softness *= 0.5;
    }
    Ok(())
}

/// The faces around the vertices of `part`, with new ids, movable vertices first, and the old id of each
/// vertex.
///
/// Faces are scaled so that their areas on the map are 1 on average: the region may be magnified or shrunk.
fn elements_of(domain: &FlattenDomain<'_>, part: &LocalMesh, uv: &Uv) -> (ElementMesh, Vec<VertexId>) {
    let mut ids = part.vertices.clone();
    let mut number: HashMap<VertexId, VertexId> =
        ids.iter().enumerate().map(|(k, &v)| (v, VertexId::new(k))).collect();
    let mut renumber = |v: VertexId| {
        *number.entry(v).or_insert_with(|| {
            ids.push(v);
            VertexId::new(ids.len() - 1)
        })
    };
    let mut faces: Vec<Element> = part
        .faces
        .iter()
        .map(|&f| {
            let e = domain.elements.faces[f];
            Element { corners: e.corners.map(&mut renumber), ..e }
        })
        .collect();
    let skin: f64 = faces.iter().map(|e| e.weight).sum();
    let map: f64 = faces.iter().map(|e| signed_area(e.corners.map(|v| uv[ids[v.index()]])).abs()).sum();
    let scale = if map > 0.0 { (skin / map).sqrt() } else { 1.0 };
    for e in &mut faces {
        e.gradients = e.gradients.map(|g| g * scale);
        e.weight /= skin;
    }
    let positions = part.vertices.iter().map(|&v| domain.mesh.positions[v]).collect();
    (ElementMesh::new(faces.into(), positions), ids)
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn displaced_vertices_return_into_their_stars() {
        let mesh = shapes::lattice(12, 10, 0.01);
        let domain = FlattenDomain::new(&mesh).unwrap();
        let mut uv: Uv = mesh.positions.ids().map(|v| domain.position(v).truncate()).collect();
        // Two vertices inside and one on the boundary, moved across their rings.
        for (v, by) in [(42, DVec2::new(0.3, 0.1)), (67, DVec2::new(-0.2, 0.25)), (5, DVec2::new(0.0, 0.4))] {
            uv[VertexId::new(v)] += by;
        }
        assert!(!domain.elements.is_flip_free(&uv));
        let before = uv.clone();
        assert_eq!(untangle(&domain, &mut uv), Ok(true));
        assert!(domain.elements.is_flip_free(&uv));
        let last = VertexId::new(119);
        assert_eq!(uv[last], before[last], "a vertex far from any flip does not move");
    }

    #[test]
    fn a_map_without_flips_stays_as_it_is() {
        let mesh = shapes::lattice(5, 4, 0.01);
        let domain = FlattenDomain::new(&mesh).unwrap();
        let mut uv = mesh.positions.map(|p| p.truncate() * 3.0);
        let before = uv.clone();
        assert_eq!(untangle(&domain, &mut uv), Ok(true));
        assert_eq!(uv, before);
    }
}
