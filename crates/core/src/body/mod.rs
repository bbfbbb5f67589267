//! One body: what joins the patches of a skin, and the banks of its slits.
//!
//! A limb is covered by several panels with gaps of millimetres. [`gap_links`] finds the pairs of taxels that face each
//! other over a gap, so that a contact or a stroke goes on over it. Links are those of the pose at rest. Nothing is
//! triangulated: a gap has no area, and no map.
//!
//! *Heuristic* (`links`): two taxels of different patches, on one link or over a joint, are a gap link if they are at most
//! 3.5 spacings apart, their normals are within 90 degrees, the segment between them is within 45 degrees of both
//! surfaces, and no third taxel with a like normal lies in the ball over the segment (Gabriel's rule, `(gabriel1969)`).
//! Of 1000 simulated presses of a ball of 40 mm on the gaps of a forearm of two half shells 694 were one contact without
//! links, 990 with them. At 2.5 spacings gaps of 16.5 mm between taxels 7 mm apart have no links; at 5 spacings nothing
//! changes. A rule by rims finds few links of links of CAD, whose surfaces are closed.
//! Rims of one patch that face each other have links over a slit that ends at both sides: both taxels are on the rim of one
//! hole, which is any loop of the boundary of a piece but for the longest, and the way on the sheet from one to the other is
//! over four times as long as the link. Slits that are open at an end have no links: width, normals and the way on the sheet do
//! not tell them from two fingers of a hand of one sheet. Links by the rules above, on sheets of taxels 5 mm apart with some
//! left out:
//!
//! | shape | on any rims | on the rim of one hole |
//! |---|---|---|
//! | sheet, tubes, frame; forearm, robot, glove, sleeve, saddle, cap of `meshes/` | 0 | 0 |
//! | hole of 5 x 5 taxels; of 1 x 5 | 0 | 0 |
//! | slit of 1 x 14 taxels; of 2 x 14 | 25; 13 | 25; 13 |
//! | slit of 1 x 22 taxels, open at an end | 58 | 0 |
//! | comb with fingers of 3 taxels; of 5 | 165; 110 | 0 |
//! | `hand.glb`, `robot_hand.glb`: fingers | 37, 7 | 0 |
//!
//! Above the coarsest fields of the patches lies a pyramid of fields of the whole body ([`body_levels`]), to one field:
//! body level 0 is the finest. These levels have fields, but neither a mesh nor a map. *Centres* are chosen as those of
//! patches, a maximal independent set with conflicts within 1.35 spacings, but by the distance along the body (`graph`):
//! along edges of the coarsest levels, gap links, and where a patch has none one link to the nearest patch, which joins no
//! contacts. *Rows* give each field of the level before up to three of the five nearest centres, with weights that sum
//! to one and keep its place as well as they can (`levels`). Those of taxels are products of rows, of which the three
//! largest are kept (`rows`). Forces and areas are collected by them as on the levels of patches, so sums are kept.
//!
//! The sensors of a [`Modality`] besides touch have fields of their own, on the patch and the map that are there. Level 0 has
//! one for each sensor, whose rows give every taxel of the patch its nearest sensors along the edges of its mesh, with
//! weights as above; coarser levels follow from the same rules, with distances along the mesh, to one field. Where several
//! patches have sensors of one modality, those of the whole body lie above all of them, with distances along the body.
//!
//! *Heuristic*: of 500 presses of a ball of 15 mm, a linear fit of the fields of four robots errs by 0.2 to 0.65 of what
//! it does for a partition with as many centres, from six fields on. Fields that follow distance alone are worse. With few fields a row
//! may reach over a joint.

mod gaps;
mod graph;
mod levels;
mod links;
mod modality;
mod rest;
mod rows;

use crate::id::{IdVec, VertexId};
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::PatchId;

pub use gaps::Gap;
pub use levels::{body_levels, modalities};
pub use links::gap_links;
pub use modality::{FieldLevel, Modality};
pub use rows::BodyRows;
pub use rows::field_areas;
pub(crate) use rows::{is_valid, shrinks};

/// A taxel of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct BodyTaxel {
    /// Its patch.
    pub patch: PatchId,
    /// Its vertex of level 0.
    pub taxel: VertexId,
}

/// What joins the patches of a skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Body {
    /// Gap links: pairs of taxels that face each other over a gap, ascending, the first before the second.
    pub links: Vec<[BodyTaxel; 2]>,
    /// The levels of the whole body, finest first; none of one patch.
    pub levels: IdVec<LevelId, BodyLevel>,
    /// The fields of modalities besides touch, patch after patch.
    pub modalities: Vec<Modality>,
}

impl Body {
    /// The number of a level of the whole body that is called `body.L0`, `body.L1` and so on, whether there is one or not.
    pub fn number_of(name: &str) -> Option<LevelId> {
        let digits =
            name.strip_prefix("body.L").filter(|digits| digits.bytes().all(|c| c.is_ascii_digit()))?;
        digits.parse::<u32>().ok().map(LevelId::from)
    }
}

/// A level of the whole body, or of a modality: fields without mesh and map.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyLevel {
    /// The taxel at the centre of each field.
    pub origins: IdVec<VertexId, BodyTaxel>,
    /// The fields of the body level before in terms of these; of body level 0 those of the coarsest levels of all patches,
    /// patch after patch; of level 0 of a modality the taxels of its patch.
    pub rows: Prolongation,
}
