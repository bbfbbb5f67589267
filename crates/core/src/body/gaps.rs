//! The gaps between patches, and how wide they are.

use crate::body::Body;
use crate::body::rest::Rest;
use crate::skin::{PatchId, Skin};

/// A gap between two patches, or slits of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// The patches, the first before the second; a patch twice where its slits have links.
    pub patches: [PatchId; 2],
    /// Number of its links.
    pub links: usize,
    /// Length of the shortest and of the longest link, in m: how wide it is between taxels.
    pub width: [f64; 2],
}

impl Body {
    /// The gaps, by their patches, and how wide they are on a skin at rest.
    ///
    /// # Panics
    /// If a link names a taxel that the skin does not have.
    pub fn gaps(&self, skin: &Skin) -> Vec<Gap> {
        let rest = Rest::new(skin);
        let mut gaps: Vec<Gap> = Vec::new();
        let mut links: Vec<_> = self.links.iter().map(|ends| (ends.map(|end| end.patch), ends)).collect();
        links.sort_by_key(|(patches, _)| *patches);
        for (patches, ends) in links {
            let [a, b] = ends.map(|end| rest.positions[rest.number(end)]);
            let length = a.distance(b);
            match gaps.last_mut().filter(|gap| gap.patches == patches) {
                Some(gap) => {
                    gap.links += 1;
                    gap.width = [gap.width[0].min(length), gap.width[1].max(length)];
                }
                None => gaps.push(Gap { patches, links: 1, width: [length; 2] }),
            }
        }
        gaps
    }
}
