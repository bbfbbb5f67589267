//! The colours of triangles and taxels.

mod coloured_mesh;
mod field_colours;
mod scale_limits;

pub(crate) use coloured_mesh::{ColouredMesh, Fill, MeshOwner, mean_of_known};
pub(crate) use scale_limits::ScaleLimits;

/// Colour of texts, lines and dots.
pub(crate) const INK: Colour = Colour(0x22, 0x22, 0x22);

/// The skin itself, whose taxels are not coloured as fields.
pub(crate) const SKIN: Colour = Colour(0xe3, 0xea, 0xf2);

/// Frame around a faulty map.
pub(crate) const WARNING: Colour = Colour(0xd0, 0x10, 0x10);

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Colour(pub(crate) u8, pub(crate) u8, pub(crate) u8);

impl Colour {
    pub(crate) const WHITE: Self = Self(0xff, 0xff, 0xff);

    /// From `0xrrggbb`.
    pub(crate) const fn rgb(code: u32) -> Self {
        let [_, red, green, blue] = code.to_be_bytes();
        Self(red, green, blue)
    }

    pub(crate) fn hex(self) -> String {
        format!("#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }

    /// The colour at a brightness from 0 to 1.
    pub(crate) fn lit(self, brightness: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "below a byte; `as` saturates")]
        let lit = |x: u8| (f64::from(x) * brightness).round() as u8;
        Self(lit(self.0), lit(self.1), lit(self.2))
    }
}

/// Greys of the hatch: lighter than the dark end of every scale.
const HATCH: [Colour; 2] = [Colour(0xb8, 0xb8, 0xb8), Colour(0x8c, 0x8c, 0x8c)];

/// Width of a line of the hatch and its gap, in pixels.
const HATCH_PX: usize = 3;

/// The colour of unknown values, on this diagonal of the pixels: lines of two greys, which no scale has.
pub(crate) fn hatch(diagonal: usize) -> Colour {
    HATCH[diagonal / HATCH_PX % 2]
}

/// A scale of colours between anchors at equal distances, `0xrrggbb`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale([u32; 5]);

/// Light where a map is faithful, dark where it is not (ColorBrewer's YlOrBr).
pub(crate) const SEQUENTIAL: Scale = Scale([0xffffe5, 0xfee391, 0xfe9929, 0xcc4c02, 0x662506]);

/// Blue below, light in the middle, red above (ColorBrewer's RdBu, reversed).
pub(crate) const DIVERGING: Scale = Scale([0x2166ac, 0x92c5de, 0xf7f7f7, 0xf4a582, 0xb2182b]);

/// For an order without a middle (viridis).
pub(crate) const ORDER: Scale = Scale([0x440154, 0x3b528b, 0x21918c, 0x5ec962, 0xfde725]);

impl Scale {
    /// For values from `low` to `high`: diverging if these are on both sides of zero.
    pub(crate) fn of_range([low, high]: [f64; 2]) -> Self {
        if low < 0.0 && high > 0.0 { DIVERGING } else { ORDER }
    }

    /// The colour at `t`; below 0 the first, above 1 the last.
    pub(crate) fn at(self, t: f64) -> Colour {
        let last = self.0.len() - 1;
        let x = t.clamp(0.0, 1.0) * last as f64;
        let k = (0..last).rev().find(|&k| k as f64 <= x).unwrap_or(0);
        let (a, b, f) = (Colour::rgb(self.0[k]), Colour::rgb(self.0[k + 1]), x - k as f64);
        #[expect(clippy::cast_possible_truncation, reason = "between two bytes")]
        let mix = |a: u8, b: u8| (f64::from(a) + f * (f64::from(b) - f64::from(a))).round() as u8;
        Colour(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
    }
}
