//! Colours, and scales of colours for values.

/// Colour of texts, lines and dots.
pub(crate) const INK: Colour = Colour(0x22, 0x22, 0x22);

/// The skin itself, whose taxels are not fields yet.
pub(crate) const SKIN: Colour = Colour(0xe3, 0xea, 0xf2);

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Colour(pub(crate) u8, pub(crate) u8, pub(crate) u8);

impl Colour {
    pub(crate) const WHITE: Self = Self(0xff, 0xff, 0xff);

    pub(crate) fn hex(self) -> String {
        format!("#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }

    /// The colour at a brightness from 0 to 1.
    pub(crate) fn lit(self, brightness: f64) -> Self {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "below a byte; `as` saturates"
        )]
        let lit = |x: u8| (f64::from(x) * brightness).round() as u8;
        Self(lit(self.0), lit(self.1), lit(self.2))
    }
}

/// Greys of the hatch: lighter than the dark end of a scale, without its colour.
const HATCH: [Colour; 2] = [Colour(0xb8, 0xb8, 0xb8), Colour(0x8c, 0x8c, 0x8c)];

/// Width of a line of the hatch and its gap, in pixels.
const HATCH_PX: usize = 3;

/// The colour where nothing is known, on this diagonal of the pixels: lines of two greys, which no
/// scale has.
pub(crate) fn hatch(diagonal: usize) -> Colour {
    HATCH[diagonal / HATCH_PX % 2]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_end_where_they_should() {
        assert_eq!(SEQUENTIAL.at(-1.0).hex(), "#ffffe5");
        assert_eq!(SEQUENTIAL.at(2.0).hex(), "#662506");
        assert_eq!(DIVERGING.at(0.5).hex(), "#f7f7f7");
        assert_eq!(ORDER.at(f64::NAN).hex().len(), 7, "NaN does not panic");
    }
}
