use std::collections::BTreeSet;

/// Fills of neighbouring fields: Paul Tol's "light" scheme, made for areas under black lines and letters and told
/// apart with every kind of colour vision, without its grey.
pub(crate) const FIELDS: [Colour; 8] = [
    Colour(0x77, 0xaa, 0xdd),
    Colour(0xee, 0x88, 0x66),
    Colour(0xee, 0xdd, 0x88),
    Colour(0x44, 0xbb, 0x99),
    Colour(0xff, 0xaa, 0xbb),
    Colour(0x99, 0xdd, 0xff),
    Colour(0xbb, 0xcc, 0x33),
    Colour(0xaa, 0xaa, 0x00),
];

/// The skin itself, whose taxels are no fields yet.
pub(crate) const SKIN: Colour = Colour(0xe3, 0xea, 0xf2);

/// An sRGB colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Colour(pub(crate) u8, pub(crate) u8, pub(crate) u8);

impl Colour {
    /// As SVG writes it.
    pub(crate) fn hex(self) -> String {
        format!("#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }

    /// So bright, 0 to 1.
    pub(crate) fn lit(self, brightness: f64) -> Self {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "below a byte; `as` saturates"
        )]
        let lit = |x: u8| (f64::from(x) * brightness).round() as u8;
        Self(lit(self.0), lit(self.1), lit(self.2))
    }

    /// Between three.
    pub(crate) fn mean([a, b, c]: [Self; 3]) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a mean of bytes is a byte")]
        let mean = |a: u8, b: u8, c: u8| ((u16::from(a) + u16::from(b) + u16::from(c)) / 3) as u8;
        Self(mean(a.0, b.0, c.0), mean(a.1, b.1, c.1), mean(a.2, b.2, c.2))
    }
}

/// A scale of colours between anchors at equal distances.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale(&'static [Colour]);

/// Light where a map is faithful, dark where it is not (ColorBrewer's YlOrBr).
pub(crate) const SEQUENTIAL: Scale = Scale(&[
    Colour(0xff, 0xff, 0xe5),
    Colour(0xfe, 0xe3, 0x91),
    Colour(0xfe, 0x99, 0x29),
    Colour(0xcc, 0x4c, 0x02),
    Colour(0x66, 0x25, 0x06),
]);

/// Blue below, light in the middle, red above (ColorBrewer's RdBu, reversed).
pub(crate) const DIVERGING: Scale = Scale(&[
    Colour(0x21, 0x66, 0xac),
    Colour(0x92, 0xc5, 0xde),
    Colour(0xf7, 0xf7, 0xf7),
    Colour(0xf4, 0xa5, 0x82),
    Colour(0xb2, 0x18, 0x2b),
]);

/// For an order without a middle (viridis).
pub(crate) const ORDER: Scale = Scale(&[
    Colour(0x44, 0x01, 0x54),
    Colour(0x3b, 0x52, 0x8b),
    Colour(0x21, 0x91, 0x8c),
    Colour(0x5e, 0xc9, 0x62),
    Colour(0xfd, 0xe7, 0x25),
]);

impl Scale {
    /// The colour at `t`; below 0 the first, above 1 the last.
    pub(crate) fn at(self, t: f64) -> Colour {
        let last = self.0.len() - 1;
        let x = t.clamp(0.0, 1.0) * last as f64;
        let k = (0..last).rev().find(|&k| k as f64 <= x).unwrap_or(0);
        let (a, b, f) = (self.0[k], self.0[k + 1], x - k as f64);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
        let mix = |a: u8, b: u8| (f64::from(a) + f * (f64::from(b) - f64::from(a))).round() as u8;
        Colour(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
    }
}

/// One of [`FIELDS`] for each of `count` fields so that neighbours differ.
///
/// Fields are coloured in the reverse of the order in which the one with the fewest neighbours left is taken away
/// (Matula and Beck 1983): six colours then suffice for a planar map. Among the colours that no neighbour has, the
/// one is taken that is rarest two steps away, then rarest so far. Should every colour be taken, neighbours may agree.
pub(crate) fn colour_fields(count: usize, neighbours: &BTreeSet<(usize, usize)>) -> Vec<usize> {
    let mut ring = vec![Vec::new(); count];
    for &(a, b) in neighbours {
        ring[a].push(b);
        ring[b].push(a);
    }
    let mut colours: Vec<Option<usize>> = vec![None; count];
    let mut used = [0_usize; FIELDS.len()];
    for &field in smallest_last(&ring).iter().rev() {
        let mut near = [0_usize; FIELDS.len()];
        let mut beyond = [0_usize; FIELDS.len()];
        for &a in &ring[field] {
            colours[a].into_iter().for_each(|c| near[c] += 1);
            // A hub's thousands of neighbours would be walked once for each of them.
            ring[a].iter().take(64).filter_map(|&b| colours[b]).for_each(|c| beyond[c] += 1);
        }
        let best = (0..FIELDS.len()).min_by_key(|&c| (near[c], beyond[c], used[c], c)).unwrap_or(0);
        colours[field] = Some(best);
        used[best] += 1;
    }
    colours.into_iter().map(|c| c.unwrap_or(0)).collect()
}

/// Always the one with the fewest neighbours left, the first of several.
fn smallest_last(ring: &[Vec<usize>]) -> Vec<usize> {
    let mut left: Vec<usize> = ring.iter().map(Vec::len).collect();
    let mut queue: BTreeSet<(usize, usize)> = left.iter().copied().enumerate().map(|(i, n)| (n, i)).collect();
    let mut order = Vec::with_capacity(ring.len());
    while let Some((_, field)) = queue.pop_first() {
        order.push(field);
        for &other in &ring[field] {
            if queue.remove(&(left[other], other)) {
                left[other] -= 1;
                queue.insert((left[other], other));
            }
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(columns: usize, rows: usize) -> BTreeSet<(usize, usize)> {
        let at = |i: usize, j: usize| j * columns + i;
        let mut pairs = BTreeSet::new();
        for j in 0..rows {
            for i in 0..columns {
                if i + 1 < columns {
                    pairs.insert((at(i, j), at(i + 1, j)));
                }
                if j + 1 < rows {
                    pairs.insert((at(i, j), at(i, j + 1)));
                    if i + 1 < columns {
                        pairs.insert((at(i, j), at(i + 1, j + 1)));
                    }
                }
            }
        }
        pairs
    }

    #[test]
    fn neighbours_differ() {
        let pairs = grid(20, 15);
        let colours = colour_fields(300, &pairs);
        assert!(pairs.iter().all(|&(a, b)| colours[a] != colours[b]));
        let used: BTreeSet<_> = colours.iter().collect();
        assert!(used.len() > 4, "a varied picture: {used:?}");
    }

    /// A wheel with a thousand spokes: greedy colouring in the wrong order may run out of colours, this one not.
    #[test]
    fn a_hub_with_many_neighbours_differs_from_all() {
        let rim = 1000;
        let spokes = (1..=rim).map(|k| (0, k));
        let pairs: BTreeSet<_> =
            spokes.chain((1..=rim).map(|k| (k.min(k % rim + 1), k.max(k % rim + 1)))).collect();
        let colours = colour_fields(rim + 1, &pairs);
        assert!(pairs.iter().all(|&(a, b)| colours[a] != colours[b]));
    }

    #[test]
    fn scales_end_where_they_should() {
        assert_eq!(SEQUENTIAL.at(-1.0).hex(), "#ffffe5");
        assert_eq!(SEQUENTIAL.at(2.0).hex(), "#662506");
        assert_eq!(DIVERGING.at(0.5).hex(), "#f7f7f7");
        assert_eq!(ORDER.at(f64::NAN).hex().len(), 7, "no number is no panic");
    }
}
