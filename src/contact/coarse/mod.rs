//! A coarse level with its own tree, and how far each of its faces and the skin are apart; `distance`
//! measures how far a triangle is from a mesh.

mod distance;

use distance::{DEEPEST, ROUND_UP, Target};
use glam::DVec3;

use crate::contact::ContactError;
use crate::contact::patch_bvh::PatchBvh;
use crate::id::{FaceId, IdVec};
use crate::map::PatchMap;
use crate::mesh::TriMesh;
use crate::parallel::par_collect;

/// Part of the mean edge of the finer level below which a deviation does not matter.
const TOLERANCE: f64 = 0.01;

/// Contacts nearer than this part of a level's mean edge know which faces the skin near them may
/// belong to; farther ones are bounded by the largest deviation of the level.
const NEAR: f64 = 0.5;

/// A level of a patch that is searched alone.
#[derive(Debug, Clone)]
pub(in crate::contact) struct CoarseLevel {
    pub(in crate::contact) tree: PatchBvh,
    deviations: IdVec<FaceId, Deviation>,
    /// Largest `skin` of all faces, in m.
    pub(in crate::contact) most: f64,
    /// Up to which distance `around` holds, in m.
    pub(in crate::contact) near: f64,
}

/// How far a face and the skin are apart, in m. The parts of the skin that the faces of a level
/// stand for cover the skin.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::contact) struct Deviation {
    /// Largest distance from the face of the part of the skin that it stands for, in m.
    pub(in crate::contact) skin: f64,
    /// Largest distance of the face from the skin, in m; at least `skin`.
    pub(in crate::contact) face: f64,
    /// The largest `skin` of all faces whose skin may be nearest to a contact within `near` of this
    /// face.
    pub(in crate::contact) around: f64,
}

impl CoarseLevel {
    pub(in crate::contact) fn deviation(&self, face: FaceId) -> Deviation {
        self.deviations[face]
    }

    /// A level above a finer one, which is `None` above level 0, whose tree is `finest`.
    fn new(
        patch: &str,
        mesh: &TriMesh,
        finest: &PatchBvh,
        finer: Option<&Self>,
    ) -> Result<Self, ContactError> {
        let tree = PatchBvh::new(patch, mesh)?;
        let below = finer.map_or(finest, |level| &level.tree);
        let (edge, finer_edge) = (mean_side(mesh), mean_side(&below.mesh));
        let size = mesh.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let (tolerance, rounding) = (TOLERANCE * finer_edge, ROUND_UP * size);
        let skin_of = |f: FaceId| finer.map_or(0.0, |level| level.deviations[f].skin);
        let face_of = |f: FaceId| finer.map_or(0.0, |level| level.deviations[f].face);

        let target = Target { tree: &tree, more: &|_| 0.0, tolerance };
        // Which face a part of a finer face belongs to, and how far from it the skin there is.
        let parts = par_collect(below.mesh.triangles.len(), |range, parts: &mut Vec<(FaceId, f64)>| {
            for child in range.map(FaceId::new) {
                let first = parts.len();
                let part = target.part(below.mesh.corners(child));
                target.measure(&part, DEEPEST, &mut |face, bound, is_last| {
                    let bound = bound + skin_of(child) + rounding;
                    let known = parts[first..].iter_mut().find(|(f, _)| *f == face);
                    if known.as_ref().is_some_and(|(_, old)| bound <= *old) {
                        return true;
                    }
                    if is_last {
                        match known {
                            Some((_, old)) => *old = bound,
                            None => parts.push((face, bound)),
                        }
                    }
                    false
                });
            }
        });
        let mut deviations = IdVec::<FaceId, Deviation>::filled(Deviation::default(), mesh.triangles.len());
        for (face, bound) in parts {
            deviations[face].skin = deviations[face].skin.max(bound);
        }
        let target = Target { tree: below, more: &face_of, tolerance };
        let cuts = DEEPEST + 2 * halvings(edge / finer_edge);
        let faces = par_collect(mesh.triangles.len(), |range, faces: &mut Vec<f64>| {
            faces.extend(range.map(FaceId::new).map(|face| {
                // Answers are as inexact as `skin` anyway.
                let mut most = deviations[face].skin;
                let part = target.part(mesh.corners(face));
                target.measure(&part, cuts, &mut |_, bound, is_last| {
                    let is_known = bound + rounding <= most;
                    if is_last {
                        most = most.max(bound + rounding);
                    }
                    is_known
                });
                most
            }));
        });
        for (deviation, face) in deviations.iter_mut().zip(faces) {
            deviation.face = face;
        }
        let most = deviations.iter().map(|d| d.skin).fold(0.0, f64::max);
        let mut level = Self { tree, deviations, most, near: NEAR * edge };
        level.fill_around();
        Ok(level)
    }

    /// Finds `around` of every face. The skin nearest to a contact at most `near` from a face is at
    /// most `near + face` from it, and belongs to a face at most `most` farther from there: no
    /// farther than `2 near + face + most` from the first.
    fn fill_around(&mut self) {
        let mesh = &self.tree.mesh;
        let around = par_collect(mesh.triangles.len(), |range, around: &mut Vec<f64>| {
            around.extend(range.map(FaceId::new).map(|face| {
                let reach = 2.0 * self.near + self.deviations[face].face + self.most;
                let corners = mesh.corners(face);
                let centre = corners.into_iter().sum::<DVec3>() / 3.0;
                let radius = corners.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
                let mut most = self.deviations[face].skin;
                self.tree.each_around(centre, (radius + reach) * (1.0 + 1e-9), |other| {
                    most = most.max(self.deviations[other].skin);
                });
                most
            }));
        });
        for (deviation, around) in self.deviations.iter_mut().zip(around) {
            deviation.around = around;
        }
    }
}

/// How often a length must be halved to be at most 1.
fn halvings(ratio: f64) -> u32 {
    (0..16).find(|&n| ratio <= f64::from(1 << n)).unwrap_or(16)
}

/// The levels of a patch above level 0, finest first.
pub(in crate::contact) fn coarse_levels(
    patch: &PatchMap,
    finest: &PatchBvh,
) -> Result<Vec<CoarseLevel>, ContactError> {
    let mut levels: Vec<CoarseLevel> = Vec::new();
    for map in patch.levels.iter().skip(1) {
        levels.push(CoarseLevel::new(&patch.name, &map.level.mesh, finest, levels.last())?);
    }
    Ok(levels)
}

/// Mean length of the sides of all faces, in m.
pub(in crate::contact) fn mean_side(mesh: &TriMesh) -> f64 {
    let around = |f: FaceId| {
        let [a, b, c] = mesh.corners(f);
        a.distance(b) + b.distance(c) + c.distance(a)
    };
    mesh.triangles.ids().map(around).sum::<f64>() / (3 * mesh.triangles.len()) as f64
}
