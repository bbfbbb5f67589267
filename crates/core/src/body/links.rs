//! Gap links: pairs of taxels that face each other over a gap between patches.

use std::cell::RefCell;

use glam::DVec3;

use crate::body::BodyTaxel;
use crate::body::rest::{Rest, are_joined};
use crate::bvh::{Aabb, BoxTree, PointTree};
use crate::id::VertexId;
use crate::mesh::VertexCorners;
use crate::parallel::par_collect;
use crate::skin::Skin;

/// Widest gap, in mean spacings of the two taxels.
const WIDEST: f64 = 3.5;

/// Largest sine of the angle between a link and the surfaces at its ends: 45 degrees.
const STEEPEST: f64 = 0.7;

/// Two sheets closer than this share of the spacing are layers at one place.
const LAYERS: f64 = 0.5;

/// The gap links of a skin at rest, ascending. Gaps are at most `across` wide, in m, by default 3.5 spacings; with 0
/// there are none.
///
/// ```
/// use dermatome::{body::gap_links, mesh::shapes, skin::{Patch, Skin}};
///
/// // Two sheets with a gap of 10 mm between them.
/// let mut skin = Skin::from_mesh("left", shapes::lattice(5, 5, 0.005));
/// let mut right = shapes::lattice(5, 5, 0.005);
/// right.positions.iter_mut().for_each(|x| x.x += 0.03);
/// let link = skin.links.ids().next().unwrap();
/// skin.patches.push(Patch::from_mesh("right", link, right));
/// assert!(gap_links(&skin, None).len() >= 5);
/// assert!(gap_links(&skin, Some(0.008)).is_empty());
/// ```
pub fn gap_links(skin: &Skin, across: Option<f64>) -> Vec<[BodyTaxel; 2]> {
    if skin.patches.len() < 2 || across.is_some_and(|most| most.is_nan() || most <= 0.0) {
        return Vec::new();
    }
    let rest = Rest::new(skin);
    let widest = |a: usize, b: usize| across.unwrap_or(0.5 * WIDEST * (rest.spacing[a] + rest.spacing[b]));
    let links = between_patches(skin, &rest, across, &widest);
    let mut links: Vec<[BodyTaxel; 2]> = links.into_iter().map(|ends| ends.map(|k| rest.taxels[k])).collect();
    links.sort_unstable();
    links
}

/// Links of taxels of different patches, by number, the first before the second.
fn between_patches(
    skin: &Skin,
    rest: &Rest,
    across: Option<f64>,
    widest: &(impl Fn(usize, usize) -> f64 + Sync),
) -> Vec<[usize; 2]> {
    let tree = PointTree::new(&rest.positions, |k| rest.normals[k]);
    let boxes: Vec<Aabb> = rest.positions.iter().map(|&x| Aabb::around([x])).collect();
    // Positions of a skin are finite.
    let Ok(boxes) = BoxTree::new(&boxes) else { return Vec::new() };
    let are_joined = are_joined(skin);
    let around: Vec<VertexCorners> = skin
        .patches
        .iter()
        .map(|patch| VertexCorners::new(patch.mesh.triangles.iter().copied(), patch.mesh.positions.len()))
        .collect();
    // Whether a taxel lies on the sheet of another, on the faces around it or those around its neighbours.
    let is_on_sheet = |a: usize, b: usize| {
        let BodyTaxel { patch, taxel } = rest.taxels[a];
        let start = rest.start(patch);
        let next = rest.neighbours[a].iter().map(|&k| VertexId::new(k as usize - start));
        let mut faces = next.chain([taxel]).flat_map(|v| around[patch.index()].faces(v));
        let triangles = &skin.patches[patch].mesh.triangles;
        let corner = |v: VertexId| rest.positions[start + v.index()];
        faces.any(|face| is_on(rest.positions[b], triangles[face].map(corner), LAYERS * rest.spacing[a]))
    };
    par_collect(rest.taxels.len(), |range, out| {
        let hiding = RefCell::new(Hiding::default());
        for a in range {
            let (patch, at) = (rest.taxels[a].patch, rest.positions[a]);
            let radius = across.unwrap_or(WIDEST * rest.spacing[a]);
            hiding.replace_with(|hiding| std::mem::take(hiding).around(at));
            boxes.each_kept(
                at,
                radius,
                |b| hiding.borrow().hides(b),
                |b| {
                    hiding.borrow_mut().add(rest, a, b);
                    // Each pair once, from the taxel with the larger spacing, whose ball has the other.
                    let order = rest.spacing[b].total_cmp(&rest.spacing[a]).then(a.cmp(&b));
                    let (other, along) = (rest.taxels[b].patch, rest.positions[b] - at);
                    if other == patch
                        || order.is_gt()
                        || along.length() > radius.min(widest(a, b))
                        || !are_joined(patch, other)
                    {
                        return;
                    }
                    let along = along.normalize_or_zero();
                    let is_flat = |k: usize| along.dot(rest.normals[k]).abs() < STEEPEST;
                    let is_like = rest.normals[a].dot(rest.normals[b]) > 0.0;
                    // Two layers at one place have no gap.
                    if is_like
                        && is_flat(a)
                        && is_flat(b)
                        && rest.is_alone([a, b], &tree)
                        && !(is_on_sheet(a, b) && is_on_sheet(b, a))
                    {
                        out.push([a.min(b), a.max(b)]);
                    }
                },
            );
        }
    })
}

/// Taxels near one that hide those behind them: they lie in the ball over the segment to these, so that there is no link.
/// Without them a search has all taxels of a surface whose vertices lie on its rims.
#[derive(Default)]
struct Hiding {
    from: DVec3,
    /// The ways to them, and their squared lengths.
    by: Vec<(DVec3, f64)>,
}

impl Hiding {
    /// Those of another taxel, none yet.
    fn around(mut self, from: DVec3) -> Self {
        self.by.clear();
        Self { from, ..self }
    }

    /// Adds a taxel `b` near `a`, if its normal is near enough to that of `a`: within 45 degrees it is like the sum of it and
    /// any normal within 90 degrees of it.
    fn add(&mut self, rest: &Rest, a: usize, b: usize) {
        /// Those that are found first hide most.
        const MOST: usize = 12;
        const LEAST_COSINE: f64 = 0.75;
        let way = rest.positions[b] - self.from;
        if self.by.len() < MOST && way != DVec3::ZERO && rest.normals[a].dot(rest.normals[b]) > LEAST_COSINE {
            self.by.push((way, way.length_squared()));
        }
    }

    /// Whether all points of a box are hidden by one of them. A taxel at `w` lies in the ball over `v` if `w (v - w) >= 0`,
    /// and within the part of it that [`Rest::is_alone`] counts if that is at least a share of `v^2`.
    fn hides(&self, b: &Aabb) -> bool {
        /// A little more than `(1 - 0.999^2) / 4`.
        const SHARE: f64 = 6e-4;
        let (lo, hi) = (b.lo - self.from, b.hi - self.from);
        let farthest = lo.abs().max(hi.abs()).length_squared();
        let is_behind = |&(way, squared): &(DVec3, f64)| {
            let least = (way * lo).min(way * hi).element_sum();
            least - squared >= SHARE * farthest
        };
        self.by.iter().any(is_behind)
    }
}

/// Whether a point lies over a triangle or below it, its foot in the triangle, and at most this far (m) from it.
fn is_on(point: DVec3, [a, b, c]: [DVec3; 3], most: f64) -> bool {
    let normal = (b - a).cross(c - a);
    let side = |from: DVec3, to: DVec3| normal.dot((to - from).cross(point - from));
    let is_near = normal.dot(point - a).abs() <= most * normal.length();
    normal != DVec3::ZERO && is_near && side(a, b) >= 0.0 && side(b, c) >= 0.0 && side(c, a) >= 0.0
}
