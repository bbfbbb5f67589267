//! All taxels of a skin in the world, as the links are at rest.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

use glam::DVec3;

use crate::body::BodyTaxel;
use crate::bvh::PointTree;
use crate::mesh::neighbours;
use crate::numeric::Csr;
use crate::skin::{LinkId, PatchId, Skin, world_pose};

/// The taxels, numbered patch after patch.
pub(super) struct Rest {
    starts: Vec<usize>,
    pub(super) taxels: Vec<BodyTaxel>,
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Vec<DVec3>,
    /// The taxels next to each one.
    pub(super) neighbours: Csr<u32>,
    /// Mean length of the edges of each taxel, in m; of one without edges that over all.
    pub(super) spacing: Vec<f64>,
}

impl Rest {
    pub(super) fn new(skin: &Skin) -> Self {
        let (mut starts, mut taxels) = (Vec::new(), Vec::new());
        let (mut positions, mut normals) = (Vec::new(), Vec::new());
        for (id, patch) in skin.patches.enumerate() {
            let pose = world_pose(&skin.links, patch.link);
            starts.push(taxels.len());
            taxels.extend(patch.mesh.positions.ids().map(|taxel| BodyTaxel { patch: id, taxel }));
            positions.extend(patch.mesh.positions.iter().map(|&x| pose.transform_point3(x)));
            normals.extend(patch.taxels.normals.iter().map(|&n| pose.transform_vector3(n)));
        }
        let neighbours = neighbours(skin.patches.iter().map(|patch| &patch.mesh));
        let length = |a: usize, &b: &u32| positions[a].distance(positions[b as usize]);
        let all: f64 =
            neighbours.iter().enumerate().flat_map(|(a, near)| near.iter().map(move |b| length(a, b))).sum();
        let mean = all / neighbours.items().len().max(1) as f64;
        let of_taxel = |(a, near): (usize, &[u32])| match near.len() {
            0 => mean,
            count => near.iter().map(|b| length(a, b)).sum::<f64>() / count as f64,
        };
        let spacing = neighbours.iter().enumerate().map(of_taxel).collect();
        Self { starts, taxels, positions, normals, neighbours, spacing }
    }

    pub(super) fn number(&self, at: BodyTaxel) -> usize {
        self.starts[at.patch.index()] + at.taxel.index()
    }

    /// The number of the first taxel of a patch.
    pub(super) fn start(&self, patch: PatchId) -> usize {
        self.starts[patch.index()]
    }

    /// Whether no taxel but these two, with a normal like theirs, lies in the ball over the segment between them; `tree`
    /// has all taxels.
    pub(super) fn is_alone(&self, [a, b]: [usize; 2], tree: &PointTree) -> bool {
        /// Of the radius: those on the ball do not count, as in a lattice.
        const INSIDE: f64 = 0.999;
        let middle = 0.5 * (self.positions[a] + self.positions[b]);
        let radius = INSIDE * 0.5 * self.positions[a].distance(self.positions[b]);
        let normal = self.normals[a] + self.normals[b];
        let is_between = |k: u32| {
            let k = k as usize;
            k != a
                && k != b
                && self.positions[k].distance(middle) <= radius
                && self.normals[k].dot(normal) > 0.0
        };
        // Mostly it is a neighbour of one of them.
        let mut next = self.neighbours[a].iter().chain(&self.neighbours[b]);
        let until_between =
            |k, _| if is_between(k) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        !next.any(|&k| is_between(k)) && tree.each_within(middle, radius, until_between).is_continue()
    }
}

/// Which patches may be joined: those of one link, and of links that a joint joins, or a chain of links without skin, also over
/// the world. What a link further up carries does not matter.
pub(super) fn are_joined(skin: &Skin) -> impl Fn(PatchId, PatchId) -> bool + Sync + use<> {
    let with_skin: BTreeSet<LinkId> = skin.patches.iter().map(|patch| patch.link).collect();
    // The links above one: bare ones, `None` for the world, and the one with skin that ends them.
    let above = |link: LinkId| {
        let (mut bare, mut at) = (Vec::new(), skin.links[link].parent);
        while let Some(parent) = at.filter(|at| !with_skin.contains(at)) {
            bare.push(Some(parent));
            at = skin.links[parent].parent;
        }
        if at.is_none() {
            bare.push(None);
        }
        (bare, at)
    };
    let above: BTreeMap<LinkId, _> = with_skin.iter().map(|&link| (link, above(link))).collect();
    let links: Vec<LinkId> = skin.patches.iter().map(|patch| patch.link).collect();
    move |a, b| {
        let [a, b] = [a, b].map(|patch| links[patch.index()]);
        let [(bare_a, end_a), (bare_b, end_b)] = [&above[&a], &above[&b]];
        a == b || *end_a == Some(b) || *end_b == Some(a) || bare_a.iter().any(|at| bare_b.contains(at))
    }
}
