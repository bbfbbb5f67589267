//! Joins the regions of one foot, or another body that is loaded as a whole.

use crate::id::VertexId;
use crate::signal::contacts::ContactRegion;
use crate::signal::contacts::find::Finder;
use crate::signal::contacts::joined::Joined;

/// Regions this far apart are one, in m: the arch of a large foot leaves 9 cm between heel and ball without load. Feet that
/// stand closer than this on one mat are one, too.
const APART: f64 = 0.1;

/// Joins the regions of each patch where a chain of them has no wider gap; taxels of a region ascend.
pub(super) fn join_near(joined: &Joined, found: &mut Vec<ContactRegion>, finder: &mut Finder) {
    let positions = &joined.mesh.positions;
    let is_near = |a: &ContactRegion, b: &ContactRegion| {
        let near = |&v: &VertexId| {
            b.taxels.iter().any(|&w| {
                joined.patch_of(v) == joined.patch_of(w)
                    && positions[v].distance_squared(positions[w]) <= APART * APART
            })
        };
        a.taxels.iter().any(near)
    };
    let mut at = 0;
    while at < found.len() {
        match (at + 1..found.len()).find(|&other| is_near(&found[at], &found[other])) {
            Some(other) => {
                let part = found.swap_remove(other);
                found[at].taxels.extend_from_slice(&part.taxels);
                finder.recycle(part);
            }
            None => {
                found[at].taxels.sort_unstable();
                at += 1;
            }
        }
    }
}
