//! Gap links: pairs of taxels that face each other over a gap between patches, or over a slit of one.

use std::cell::RefCell;
use std::ops::ControlFlow;

use glam::DVec3;

use crate::body::BodyTaxel;
use crate::body::graph::Graph;
use crate::body::rest::{Rest, are_joined};
use crate::bvh::{Aabb, BoxTree, PointTree};
use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, VertexCorners, boundary_loops};
use crate::numeric::{DisjointSets, each_by_distance};
use crate::parallel::par_collect;
use crate::skin::{PatchId, Skin};

/// Widest gap, in mean spacings of the two taxels.
const WIDEST: f64 = 3.5;

/// Largest sine of the angle between a link and the surfaces at its ends: 45 degrees.
const STEEPEST: f64 = 0.7;

/// The way on the sheet around a slit, at least, in its width.
const AROUND: f64 = 4.0;

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
    if across.is_some_and(|most| most.is_nan() || most <= 0.0) {
        return Vec::new();
    }
    let slits = skin.patches.map(|patch| slits(&patch.mesh));
    if skin.patches.len() < 2 && slits.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let rest = Rest::new(skin);
    let widest = |a: usize, b: usize| across.unwrap_or(0.5 * WIDEST * (rest.spacing[a] + rest.spacing[b]));
    let mut links =
        if skin.patches.len() < 2 { Vec::new() } else { between_patches(skin, &rest, across, &widest) };
    links.extend(over_slits(skin, &rest, &slits, &widest));
    let mut links: Vec<[BodyTaxel; 2]> = links.into_iter().map(|ends| ends.map(|k| rest.taxels[k])).collect();
    links.sort_unstable();
    links
}

/// The holes of a patch: the loops of the boundary of each piece but for the longest.
fn slits(mesh: &TriMesh) -> Vec<Vec<VertexId>> {
    let loops = boundary_loops(mesh);
    if loops.len() < 2 {
        return Vec::new();
    }
    let mut sets = DisjointSets::<VertexId>::new(mesh.positions.len());
    for &[a, b, c] in &mesh.triangles {
        sets.join(a, b);
        sets.join(b, c);
    }
    let place = |v: &VertexId| mesh.positions[*v];
    let length = |of: &[VertexId]| -> f64 {
        let next = of.iter().cycle().skip(1);
        of.iter().zip(next).map(|(a, b)| place(a).distance(place(b))).sum()
    };
    let lengths: Vec<(VertexId, f64)> = loops
        .iter()
        .map(|of| (of.first().map_or_else(VertexId::default, |&v| sets.root(v)), length(of)))
        .collect();
    // Of equally long ones the first is the outer rim.
    let is_hole = |k: usize| {
        let (piece, own) = lengths[k];
        let is_longer = |(other, (of, length)): (usize, &(VertexId, f64))| {
            *of == piece && (*length > own || (*length == own && other < k))
        };
        lengths.iter().enumerate().any(is_longer)
    };
    loops.into_iter().enumerate().filter(|(k, _)| is_hole(*k)).map(|(_, of)| of).collect()
}

/// Links of taxels on the rim of one hole, by number, the first before the second.
fn over_slits(
    skin: &Skin,
    rest: &Rest,
    slits: &IdVec<PatchId, Vec<Vec<VertexId>>>,
    widest: &impl Fn(usize, usize) -> f64,
) -> Vec<[usize; 2]> {
    if slits.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let all = PointTree::new(&rest.positions, |k| rest.normals[k]);
    let mut links = Vec::new();
    for (patch, holes) in slits.enumerate().filter(|(_, holes)| !holes.is_empty()) {
        let (start, graph) = (rest.start(patch), Graph::of_patch(patch, &skin.patches[patch].mesh));
        let (mut distances, mut reached) = (vec![f64::INFINITY; graph.origins.len()], Vec::new());
        for hole in holes {
            let rim: Vec<usize> = hole.iter().map(|v| start + v.index()).collect();
            let places: Vec<DVec3> = rim.iter().map(|&a| rest.positions[a]).collect();
            let tree = PointTree::new(&places, |k| rest.normals[rim[k]]);
            let radius = rim.iter().map(|&a| widest(a, a)).fold(0.0, f64::max);
            for &a in &rim {
                let at = rest.positions[a];
                // It never breaks.
                let _ = tree.each_within(at, radius, |k: u32, width| {
                    let b = rim[k as usize];
                    let is_link = a < b
                        && width > 0.0
                        && width <= widest(a, b)
                        && rest.face(a, b, (rest.positions[b] - at) / width)
                        && rest.is_alone([a, b], &all);
                    if is_link {
                        let mut is_around = true;
                        each_by_distance(&graph.ways, a - start, &mut distances, &mut reached, |v, way| {
                            let is_near = way <= AROUND * width;
                            is_around &= !(is_near && start + v as usize == b);
                            is_around && is_near
                        });
                        if is_around {
                            links.push([a, b]);
                        }
                    }
                    ControlFlow::Continue(())
                });
            }
        }
    }
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
                    // Two layers at one place have no gap.
                    if rest.face(a, b, along.normalize_or_zero())
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

impl Rest {
    /// Whether two taxels have normals within 90 degrees, and the way from one to the other is within 45 degrees of both
    /// surfaces.
    fn face(&self, a: usize, b: usize, along: DVec3) -> bool {
        let is_flat = |k: usize| along.dot(self.normals[k]).abs() < STEEPEST;
        self.normals[a].dot(self.normals[b]) > 0.0 && is_flat(a) && is_flat(b)
    }
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
