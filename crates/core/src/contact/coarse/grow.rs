//! Growing an [`Octree`]: from large to small cells, the widest intervals divided first, up to the memory limit.
//!
//! The constants below gave the narrowest intervals on two skins, and were checked on five others.

use glam::DVec3;

use crate::bvh::{Start, meet};
use crate::contact::coarse::open_sides::{Hull, OpenSides};
use crate::contact::coarse::{LEAF, Leaf, Octree, Record, wide};
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::id::FaceId;
use crate::mesh::SurfacePoint;
use crate::parallel::par_collect;
use crate::skin::PatchId;

/// Memory of an octree: `BYTES_PER_FACE` for each triangle, but at least `LEAST_BYTES`.
const BYTES_PER_FACE: usize = 50;
const LEAST_BYTES: usize = 512 << 10;

/// The grid extends this far beyond the skin, in m.
const REACH: f64 = 0.05;

/// Cells of the top grid are this wide, in m, or wider by a power of two if there would be more than [`MOST_TOP_CELLS`].
const TOP_CELL: f64 = 0.032;
const MOST_TOP_CELLS: f64 = 4096.0;

/// No cell is narrower than half of this, in m.
const FINEST_CELL: f64 = 0.002;

/// An interval is narrow enough at this width (m) plus this fraction of the distance.
const NARROW: f64 = 0.2e-3;
const NARROW_RATIO: f64 = 0.03;

/// The width of a cell is evaluated at its centre and at points this fraction of the way to its corners.
const WIDTH_POINTS: f64 = 0.6;

/// Spacing of the faces from which contacts choose: this many edges, and this fraction of their distance.
const FIELD_EDGES: f64 = 1.5;
const FIELD_RATIO: f64 = 0.25;

/// The centre of a ball is at most this many half cells, and this far (m), beyond a contact.
const MOST_BEYOND: f64 = 24.0;
const LARGEST_BALL: f64 = 1.0;

/// Attempts at a ball.
const ATTEMPTS: usize = 3;

/// A ball that meets the skin elsewhere is replaced by one of this fraction of the radius that would touch
/// there, which keeps its centre off the medial axis, where searches are slow.
const SHRINK: f64 = 0.6;

/// A gap between two balls in which crossings are counted is at most this long, in m.
const LONGEST_GAP: f64 = 2e-3;

/// A crossing with a smaller barycentric coordinate is uncertain.
const MIN_SURE: f64 = 1e-6;

/// A point with a smaller barycentric coordinate may be nearest to a side; balls then touch the face this
/// fraction of the way to its centroid.
const MIN_INNER: f64 = 0.01;
const TO_CENTROID: f64 = 0.15;

/// Most steps of a walk to the nearest face.
const MOST_STEPS: usize = 24;

#[derive(Debug, Clone, Copy)]
struct Ball {
    centre: DVec3,
    radius: f64,
}

/// The wanted position of a ball.
struct Aim {
    /// The point of the skin that it touches, and the unit vector from there to its centre.
    touch: DVec3,
    up: DVec3,
    /// Height of the centre of the cell over that point along `up`.
    lift: f64,
    /// Half the side of the cell.
    half: f64,
}

/// The point of the skin nearest to another.
#[derive(Clone, Copy)]
struct Near {
    face: FaceId,
    distance: f64,
    point: DVec3,
    barycentric: [f64; 3],
}

/// A cell, with the data from which its children start.
#[derive(Clone, Copy)]
struct Cell {
    node: usize,
    centre: DVec3,
    half: f64,
    start: Start,
    /// How far the centres of balls may be beyond contacts, on either side, in m: as found in the cell above.
    beyond: [f64; 2],
    /// The leaf of the cell above, whose record this one shares.
    shared: Option<Leaf>,
}

/// A finished cell, before its record has an index.
struct Made {
    cell: Cell,
    record: Option<Record>,
    /// The face and its flags; the record if it is shared.
    leaf: Leaf,
    /// Width of the interval over the width that is narrow enough.
    width: f64,
    distance: f64,
}

struct Grower<'a> {
    skin: &'a PatchBvh,
    open: OpenSides,
    /// The origin of records.
    centre: DVec3,
    /// By how much radii are reduced for the rounding of `f64`, and the resolution of `f32`, in m.
    rounding: f64,
    resolution: f64,
}

impl Octree {
    /// The octree of a skin in the frame of its link.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded by MOST_TOP_CELLS")]
    pub(in crate::contact) fn new(skin: &PatchBvh) -> Self {
        let bounds = skin.bounds();
        let (centre, extent) = (bounds.lo.midpoint(bounds.hi), bounds.hi - bounds.lo + 2.0 * REACH);
        let (mut top, mut depth) = (TOP_CELL, (TOP_CELL / FINEST_CELL).log2() as u32 + 1);
        while (extent / top).ceil().element_product() > MOST_TOP_CELLS {
            (top, depth) = (2.0 * top, (depth + 1).min(Self::MOST_DEPTH));
        }
        let count = (extent / top).ceil();
        let size = 0.5 * top * count.max_element();
        let far = centre.abs().max_element();
        let grower = Grower {
            skin,
            open: OpenSides::new(&skin.mesh),
            centre,
            rounding: 1e-8 * size + 1e-14 * far,
            resolution: 3e-7 * size,
        };
        let mut octree = Self {
            bounds,
            centre,
            lo: -0.5 * top * count,
            dims: count.to_array().map(|x| x as u32),
            per_metre: top.recip(),
            nodes: vec![0; count.element_product() as usize],
            leaves: Vec::new(),
            records: Vec::new(),
            slack: 2.4e-7 * size + 1e-14 * far,
        };
        octree.grow(&grower, top, depth);
        octree.nodes.shrink_to_fit();
        octree.leaves.shrink_to_fit();
        octree.records.shrink_to_fit();
        octree
    }

    /// Its memory.
    pub(in crate::contact) fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.leaves) + size_of_val(&*self.records)
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "the memory of an octree is bounded: see `BYTES_PER_FACE`"
    )]
    fn grow(&mut self, grower: &Grower<'_>, top: f64, depth: u32) {
        const LEAF_BYTES: usize = size_of::<Leaf>();
        const DIVISION_BYTES: usize = 8 * (LEAF_BYTES + size_of::<u32>()) - LEAF_BYTES;
        const RECORD_BYTES: usize = size_of::<Record>();
        let most_bytes = (BYTES_PER_FACE * grower.skin.mesh.triangles.len()).max(LEAST_BYTES);
        let field = FIELD_EDGES * grower.skin.spacing();
        let [nx, ny, _] = self.dims.map(|n| n as usize);
        let cell = |node: usize| {
            let at = [node % nx, node / nx % ny, node / nx / ny].map(|k| (k as f64 + 0.5) * top);
            let centre = self.centre + self.lo + DVec3::from_array(at);
            Cell {
                node,
                centre,
                half: 0.5 * top,
                start: Start::Root,
                beyond: [f64::INFINITY; 2],
                shared: None,
            }
        };
        let mut cells: Vec<Cell> = (0..self.nodes.len()).map(cell).collect();
        for level in 0..=depth {
            let is_last = level == depth;
            let mut made = par_collect(cells.len(), |range, out| {
                out.extend(cells[range].iter().map(|cell| grower.make(*cell, is_last)));
            });
            let room = |made: &Made| LEAF_BYTES + made.record.map_or(0, |_| RECORD_BYTES);
            let needed = self.bytes() + made.iter().map(room).sum::<usize>();
            let mut room = most_bytes.saturating_sub(needed);
            made.sort_by(|a, b| b.width.total_cmp(&a.width).then(a.distance.total_cmp(&b.distance)));
            cells.clear();
            for Made { cell, record, mut leaf, width, distance } in made {
                let parts = DIVISION_BYTES + 7 * RECORD_BYTES;
                let is_wide = width > 1.0 && !is_last && room >= parts;
                let is_coarse = 2.0 * cell.half > field + FIELD_RATIO * distance && distance < REACH;
                let is_shared = !is_wide && is_coarse && !is_last && room >= DIVISION_BYTES;
                if let Some(record) = record.filter(|_| !is_wide) {
                    leaf.record = self.records.len() as u32;
                    self.records.push(record);
                }
                if !is_wide && !is_shared {
                    self.nodes[cell.node] = LEAF | self.leaves.len() as u32;
                    self.leaves.push(leaf);
                    continue;
                }
                room -= if is_wide { parts } else { DIVISION_BYTES };
                let first = self.nodes.len();
                self.nodes[cell.node] = first as u32;
                self.nodes.resize(first + 8, 0);
                let (half, shared) = (0.5 * cell.half, (!is_wide).then_some(leaf));
                let corners = corners(cell.centre, half).into_iter().enumerate();
                cells.extend(corners.map(|(k, centre)| Cell {
                    node: first + k,
                    centre,
                    half,
                    shared,
                    ..cell
                }));
            }
        }
    }
}

/// The corners of a cube, x first.
fn corners(centre: DVec3, half: f64) -> [DVec3; 8] {
    std::array::from_fn(|k| {
        let side = |bit: usize| if k >> bit & 1 == 0 { -half } else { half };
        centre + DVec3::new(side(0), side(1), side(2))
    })
}

impl Grower<'_> {
    fn make(&self, mut cell: Cell, is_last: bool) -> Made {
        if let Some(above) = cell.shared {
            let best = self.skin.walk(cell.centre, FaceId::from(above.face()), MOST_STEPS);
            let (distance, flags) = (best.closest.squared.sqrt(), above.face ^ above.face());
            let leaf = Leaf { face: best.face.raw() | flags, ..above };
            return Made { cell, record: None, leaf, width: 0.0, distance };
        }
        let near = self.nearest(&mut cell);
        let (record, face) = self.record(&mut cell, &near);
        let is_judged = !is_last && near.distance < REACH.max(2.0 * cell.half);
        let width = if is_judged { self.width(&cell, &record, face) } else { 0.0 };
        Made { cell, record: Some(record), leaf: Leaf { record: 0, face }, width, distance: near.distance }
    }

    fn near(&self, best: &Best) -> Near {
        let (face, barycentric) = (best.face, best.closest.barycentric);
        let point = self.skin.mesh.point(&SurfacePoint { face, barycentric });
        Near { face, distance: best.closest.squared.sqrt(), point, barycentric }
    }

    fn nearest(&self, cell: &mut Cell) -> Near {
        let mut best = None;
        if let Some(packet) = self.skin.nearest(PatchId::new(0), cell.centre, cell.start, &mut best) {
            cell.start = Start::Packet(packet);
        }
        self.near(&best.expect("a skin has a face"))
    }

    /// The skin nearest to `q` if it is nearer than `distance`.
    fn nearer(&self, q: DVec3, distance: f64) -> Option<Near> {
        let mut best = Some(Best::bound(distance));
        self.skin.nearest(PatchId::new(0), q, Start::Root, &mut best);
        best.filter(|best| !best.is_bound()).map(|best| self.near(&best))
    }

    fn rounded(&self, p: DVec3) -> DVec3 {
        self.centre + (p - self.centre).as_vec3().as_dvec3()
    }

    fn relative(&self, p: DVec3) -> [f32; 3] {
        (p - self.centre).as_vec3().to_array()
    }

    /// An empty ball that nearly touches the skin at a point: of the tried centres the one whose bound is
    /// loosened least half a cell away from the contact. `beyond` is how far the centre may be beyond
    /// contacts, and is set to how far it is.
    fn ball(&self, aim: &Aim, spare: Ball, beyond: &mut f64) -> Ball {
        let &Aim { touch, up, lift, half } = aim;
        let (over, under) = (lift.max(0.0), (-lift).max(0.0));
        let loss = |beyond: f64| half * half / (2.0 * beyond);
        let mut radius = (MOST_BEYOND * half).min(*beyond) + under;
        let (mut best, mut least, mut got) = (spare, half, 0.5 * radius);
        for _ in 0..ATTEMPTS {
            let centre = self.rounded(touch + up * (over + radius - under).min(LARGEST_BALL));
            let reach = centre.distance(touch);
            let wanted = reach - 0.25 * loss(radius) - self.resolution;
            let Some(near) = self.nearer(centre, wanted) else {
                if 1.25 * loss(radius) < least {
                    (best, got) = (Ball { centre, radius: wanted.max(0.0) }, radius);
                }
                break;
            };
            let gap = (reach - near.distance).max(0.0);
            if gap + loss(radius) < least {
                least = gap + loss(radius);
                (best, got) = (Ball { centre, radius: near.distance }, radius);
            }
            let other = near.point - touch;
            let along = up.dot(other);
            if along <= self.rounding {
                break;
            }
            let next = SHRINK * (other.length_squared() / (2.0 * along) - over) + under;
            if next > 0.0 && loss(next) <= 0.9 * least {
                radius = next.min(0.7 * radius);
            } else if gap < 2.0 * loss(radius) {
                break;
            } else {
                radius *= 0.4;
            }
            if radius <= under {
                break;
            }
        }
        *beyond = (got - under).max(half);
        best
    }

    /// The record of a cell, and its face with flags.
    fn record(&self, cell: &mut Cell, near: &Near) -> (Record, u32) {
        let Cell { centre, half, mut beyond, .. } = *cell;
        let cross = self.skin.mesh.face_cross(near.face);
        let normal = cross.normalize_or_zero();
        let c = self.rounded(centre);
        let own = Ball { centre: c, radius: (near.distance - c.distance(centre)).max(0.0) };
        let is_inner = near.barycentric.iter().all(|&x| x > MIN_INNER);
        let [a, b, e] = self.skin.mesh.corners(near.face);
        let touch = if is_inner { near.point } else { near.point.lerp((a + b + e) / 3.0, TO_CENTROID) };
        let is_outside = (centre - touch).dot(normal) >= 0.0;
        let flags = near.face.raw() | if is_outside { Leaf::OUTSIDE } else { 0 };
        let of = |balls: [Ball; 2]| Record {
            balls: balls.map(|ball| (self.relative(ball.centre), self.radius(ball))),
            touch: self.relative(near.point),
        };
        if normal == DVec3::ZERO {
            return (of([own, own]), flags);
        }
        let up = if is_outside { normal } else { -normal };
        let away =
            Aim { touch: near.point, up: (centre - near.point) / near.distance, lift: near.distance, half };
        let over = Aim { touch, up, lift: centre.distance(touch), half };
        let under = Aim { touch, up: -up, lift: -centre.distance(touch), half };
        let corners = corners(centre, half);
        let is_crossing = near.distance < half * 3_f64.sqrt() * 1.0001;
        let is_lonely =
            !is_crossing && !self.open.are_off(&Hull::new(touch, touch - up * (0.5 * half), &corners));
        let [front, back] = &mut beyond;
        if is_lonely {
            // Here no ball behind the skin bounds the distance from above.
            let ball = self.ball(&away, own, front);
            cell.beyond = beyond;
            return (of([ball, ball]), flags);
        }
        let behind = self.ball(&under, Ball { centre: touch, radius: 0.0 }, back);
        let has = |ball: Ball| corners.iter().all(|q| q.distance(ball.centre) < ball.radius - self.rounding);
        // The ball of the record in front, and one whose line to the ball behind crosses the skin if that bounds from above.
        let (first, mut witness) = if is_crossing {
            let ball = self.ball(&over, own, front);
            (ball, Some(ball))
        } else {
            let ball = self.ball(&away, own, front);
            if is_inner {
                (ball, Some(Ball { centre, radius: near.distance }))
            } else if has(ball) && self.is_crossed(ball, behind) {
                (ball, Some(ball))
            } else {
                let ball = self.ball(&over, own, front);
                (ball, has(ball).then_some(ball))
            }
        };
        cell.beyond = beyond;
        witness = witness.filter(|&ball| {
            self.is_crossed(ball, behind)
                && self.open.are_off(&Hull::new(ball.centre, behind.centre, &corners))
        });
        (of([first, behind]), flags | witness.map_or(0, |_| Leaf::CERTIFIED))
    }

    /// The radius of a ball for a record: rounded down.
    #[expect(clippy::cast_possible_truncation, reason = "rounded down")]
    fn radius(&self, ball: Ball) -> f32 {
        let known = self.centre + wide(self.relative(ball.centre));
        ((ball.radius - known.distance(ball.centre) - self.rounding) as f32).next_down()
    }

    /// Whether the line between the centres of two empty balls certainly crosses the skin an odd number of times.
    fn is_crossed(&self, a: Ball, b: Ball) -> bool {
        let length = a.centre.distance(b.centre);
        let gap = (length - a.radius - b.radius).max(0.0);
        if gap > LONGEST_GAP || length <= self.rounding {
            return false;
        }
        let along = (b.centre - a.centre) / length;
        let (mut crossings, mut is_sure) = (0, true);
        self.skin.each_around(a.centre + along * (a.radius + 0.5 * gap), 0.5 * gap + self.rounding, |face| {
            if let Some(met) = meet(a.centre, along, self.skin.mesh.corners(face)) {
                crossings += usize::from(met.along >= 0.0 && met.along <= length);
                is_sure &= met.barycentric.iter().all(|&x| x > MIN_SURE);
            }
        });
        is_sure && crossings % 2 == 1
    }

    /// Width of the interval in a cell over the width that is narrow enough.
    fn width(&self, cell: &Cell, record: &Record, face: u32) -> f64 {
        let leaf = Leaf { record: 0, face };
        let points = corners(cell.centre, WIDTH_POINTS * cell.half).into_iter().chain([cell.centre]);
        let widths = points.map(|q| {
            let local = q - self.centre;
            let excess = record.excess(local);
            let least = Record::least(excess);
            let most = if face & Leaf::CERTIFIED != 0 {
                record.most(local, excess)
            } else {
                self.skin.walk(q, FaceId::from(leaf.face()), MOST_STEPS).closest.squared.sqrt()
            };
            (most - least) / (NARROW + NARROW_RATIO * least)
        });
        widths.fold(0.0, f64::max)
    }
}
