use glam::DVec2;

/// A point is on a circle if it is this close to it, over the square of its distance: the corners of a square are on one circle in
/// any frame.
const ON_CIRCLE: f64 = 1e-7;

/// The triangles of a Delaunay triangulation around one of its points, found without the rest of it.
///
/// They join the neighbours whose Voronoi cells border on that of the point. Its cell is cut out of a square by the bisectors with
/// the other points, the nearest first, until the next is too far away to cut. Of four or more points on a common circle each sees
/// all triangles that it can have with them in order around it, so that the corners of a square see both of its diagonals:
/// which one is drawn is left to the caller. Keeps its memory from point to point.
#[derive(Debug, Clone, Default)]
pub struct Star {
    cell: Vec<Corner>,
    cut: Vec<Corner>,
}

/// A corner of the cell, and which point's bisector the side after it is on.
#[derive(Debug, Clone, Copy)]
struct Corner {
    at: DVec2,
    side: Option<usize>,
}

impl Star {
    /// The triangles around the origin, as pairs of places in `points`, counter-clockwise.
    ///
    /// The points must come nearest first; triangles whose circles have a radius above `reach` are not among them.
    pub fn around(
        &mut self,
        points: impl IntoIterator<Item = DVec2>,
        reach: f64,
    ) -> impl Iterator<Item = [usize; 2]> {
        self.cell.clear();
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            self.cell.push(Corner { at: reach * DVec2::new(x, y), side: None });
        }
        for (k, point) in points.into_iter().enumerate() {
            let farthest = self.cell.iter().fold(0.0, |far: f64, c| far.max(c.at.length()));
            if point.length() > 2.0 * farthest {
                break;
            }
            self.cut_off(point, k);
        }
        let before = self.cell.iter().cycle().skip(self.cell.len() - 1);
        self.cell.iter().zip(before).filter_map(move |(corner, before)| {
            let sides = [before.side?, corner.side?];
            (sides[0] != sides[1] && corner.at.length() <= reach).then_some(sides)
        })
    }

    /// Cuts off the part of the cell that is nearer to `point` than to the origin.
    fn cut_off(&mut self, point: DVec2, k: usize) {
        let size = point.length_squared();
        let beyond = |c: &Corner| c.at.dot(point) - 0.5 * size;
        let is_cut = |c: &Corner| beyond(c) > -ON_CIRCLE * size;
        if !self.cell.iter().any(is_cut) || self.cell.iter().all(is_cut) {
            return;
        }
        self.cut.clear();
        let next = self.cell.iter().cycle().skip(1);
        for (&a, &b) in self.cell.iter().zip(next) {
            let crossing = || {
                let (s, t) = (beyond(&a), beyond(&b));
                a.at.lerp(b.at, (s / (s - t)).clamp(0.0, 1.0))
            };
            match (is_cut(&a), is_cut(&b)) {
                (false, false) => self.cut.push(a),
                (false, true) => self.cut.extend([a, Corner { at: crossing(), side: Some(k) }]),
                (true, false) => self.cut.push(Corner { at: crossing(), side: a.side }),
                (true, true) => {}
            }
        }
        std::mem::swap(&mut self.cell, &mut self.cut);
    }
}
