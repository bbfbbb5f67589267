use std::collections::BTreeMap;

/// An sRGB colour.
type Rgb = [u8; 3];

/// Colours that one byte can number.
const MOST: usize = 256;

/// How much a channel of a colour may change, of 255, tried one after the other: what no eye sees beside an edge. At 12 the
/// steps of a colour scale begin to show.
const TOLERANCES: [u8; 6] = [0, 1, 2, 3, 4, 6];

/// At most 256 colours that stand for all of a picture.
///
/// A drawing has few colours but thousands of mixtures along its edges. The most frequent colours are taken first, each
/// unless one of those before is near enough, with the least tolerance that needs no more than 256. Shaded scales of colours
/// have no such palette.
pub(crate) struct Palette {
    /// The colours, the most frequent first.
    pub(crate) colours: Vec<Rgb>,
    numbers: BTreeMap<Rgb, u8>,
}

impl Palette {
    /// The palette of a picture's pixels, if it has one.
    pub(crate) fn new(pixels: impl Iterator<Item = Rgb>) -> Option<Self> {
        let mut counts = BTreeMap::<Rgb, u64>::new();
        let (mut current, mut run) = (None, 0);
        for pixel in pixels {
            if current != Some(pixel) {
                current.into_iter().for_each(|colour| *counts.entry(colour).or_default() += run);
                (current, run) = (Some(pixel), 0);
            }
            run += 1;
        }
        current.into_iter().for_each(|colour| *counts.entry(colour).or_default() += run);
        let mut frequent: Vec<(u64, Rgb)> = counts.iter().map(|(&colour, &count)| (count, colour)).collect();
        frequent.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        let colours = TOLERANCES.iter().find_map(|&tolerance| cover(&frequent, tolerance))?;
        let nearest = |colour: Rgb| {
            (0..=u8::MAX)
                .zip(&colours)
                .min_by_key(|(_, c)| (largest_change(**c, colour), distance(**c, colour)))
                .map_or(0, |(number, _)| number)
        };
        let numbers = counts.keys().map(|&colour| (colour, nearest(colour))).collect();
        Some(Self { colours, numbers })
    }

    /// The number of the colour that stands for a pixel.
    pub(crate) fn number(&self, pixel: Rgb) -> u8 {
        self.numbers.get(&pixel).copied().unwrap_or_default()
    }
}

/// Colours of which one is within `tolerance` of each, if 256 suffice.
fn cover(frequent: &[(u64, Rgb)], tolerance: u8) -> Option<Vec<Rgb>> {
    let mut chosen: Vec<Rgb> = Vec::new();
    for &(_, colour) in frequent {
        if !chosen.iter().any(|&c| largest_change(c, colour) <= tolerance) {
            if chosen.len() == MOST {
                return None;
            }
            chosen.push(colour);
        }
    }
    Some(chosen)
}

fn largest_change(a: Rgb, b: Rgb) -> u8 {
    (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap_or_default()
}

fn distance(a: Rgb, b: Rgb) -> u32 {
    (0..3).map(|k| u32::from(a[k].abs_diff(b[k])).pow(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colours_are_kept() {
        let pixels = (0..=255).map(|k| [k, 255 - k, 7]);
        let palette = Palette::new(pixels.clone()).unwrap();
        assert_eq!(palette.colours.len(), 256);
        for pixel in pixels {
            assert_eq!(palette.colours[usize::from(palette.number(pixel))], pixel);
        }
    }

    /// A few hundred mixtures along an edge between black and white, and the ground on both sides.
    #[test]
    fn many_colours_change_little() {
        let pixels = || (0..=255).flat_map(|k| [[k, k, k], [k, k, 255 - (255 - k) / 2], [255; 3]]);
        let palette = Palette::new(pixels()).unwrap();
        assert!(palette.colours.len() <= MOST);
        assert_eq!(palette.colours[0], [255; 3], "the ground stays what it is");
        let change = |p| largest_change(palette.colours[usize::from(palette.number(p))], p);
        assert!(pixels().map(change).max() <= Some(6));
    }

    #[test]
    fn a_cube_of_colours_has_no_palette() {
        let steps = || (0..=255).step_by(8);
        let pixels = steps().flat_map(|r| steps().flat_map(move |g| steps().map(move |b| [r, g, b])));
        assert!(Palette::new(pixels).is_none());
    }

    #[test]
    fn no_pixels_no_colours() {
        assert!(Palette::new(std::iter::empty()).unwrap().colours.is_empty());
    }
}
