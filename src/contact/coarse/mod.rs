//! A coarse level with its own tree, and how far each of its faces and the skin are apart; `distance`
//! measures how far a triangle is from a mesh, `columns` how far the skin is from contacts over a part of a face.

mod columns;
mod distance;

use columns::{Columns, Skin};
use distance::Part;
use glam::DVec3;

use crate::contact::ContactError;
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::id::{FaceId, IdVec};
use crate::map::PatchMap;
use crate::mesh::{Feature, TriMesh};
use crate::parallel::{par_collect, par_ids};

/// How often a finer face is cut to measure how far it is from a level.
const CUTS: u32 = 4;

/// Bounds are enlarged by this part of the coordinates they follow from: some hundred roundings.
const ROUND_UP: f64 = 1e-13;

/// Contacts up to this distance from a level, in its mean edges, know how far the skin near them is.
const CLOSE_EDGES: f64 = 2.0;

/// A level of a patch that is searched alone.
#[derive(Debug, Clone)]
pub(in crate::contact) struct CoarseLevel {
    pub(in crate::contact) tree: PatchBvh,
    columns: IdVec<FaceId, Columns>,
    /// The skin is nowhere farther from the level, in m.
    pub(in crate::contact) most: f64,
}

impl CoarseLevel {
    /// The least and the largest distance from the skin of a point (m, in the frame of the tree) whose nearest
    /// face of the level is `best`.
    pub(in crate::contact) fn range(&self, q: DVec3, best: &Best) -> [f64; 2] {
        let Best { face, closest, .. } = *best;
        let (corners, weights) = (self.tree.mesh.corners(face), closest.barycentric);
        let (away, normal) = (closest.squared.sqrt(), self.tree.mesh.face_cross(face));
        let height = away.copysign((q - corners[0]).dot(normal));
        let beside = if closest.feature == Feature::Inside {
            0.0
        } else {
            let nearest: DVec3 = corners.iter().zip(weights).map(|(p, weight)| *p * weight).sum();
            q.distance(nearest + normal.normalize_or_zero() * height)
        };
        let [least, most] = self.columns[face].range(weights, height, beside);
        [least.max(away - self.most).max(0.0), most]
    }

    /// A level above a finer one, which is `None` above level 0.
    fn new(patch: &str, mesh: &TriMesh, skin: &Skin<'_>, finer: Option<&Self>) -> Result<Self, ContactError> {
        let tree = PatchBvh::new(patch, mesh)?;
        let (below, edge) = (finer.map_or(skin.tree, |level| &level.tree), mean_side(mesh));
        let size = mesh.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let rounding = ROUND_UP * size;
        let apart = par_collect(below.mesh.triangles.len(), |range, most: &mut Vec<f64>| {
            most.push(rounding);
            for child in range.map(FaceId::new) {
                Part::new(below.mesh.corners(child)).raise(&tree, CUTS, &mut most[0]);
            }
        });
        let most = finer.map_or(0.0, |level| level.most) + apart.into_iter().fold(0.0, f64::max) + rounding;
        let columns =
            par_ids(mesh.triangles.len(), |id| skin.columns(mesh.corners(id), CLOSE_EDGES * edge, rounding));
        Ok(Self { tree, columns, most })
    }
}

/// The levels of a patch above level 0, finest first.
pub(in crate::contact) fn coarse_levels(
    patch: &PatchMap,
    finest: &PatchBvh,
) -> Result<Vec<CoarseLevel>, ContactError> {
    let mut levels: Vec<CoarseLevel> = Vec::new();
    let skin = Skin::new(finest);
    for map in patch.levels.iter().skip(1) {
        levels.push(CoarseLevel::new(&patch.name, &map.level.mesh, &skin, levels.last())?);
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
