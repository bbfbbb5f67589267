//! Images back to values: the least-squares values whose drawing comes nearest to the pixels.
//!
//! The normal equations of the renderer's own weights are solved by conjugate gradients,
//! preconditioned by their diagonal, from the weighted mean of each vertex's pixels. So an image
//! that the renderer drew gives back the values that it was drawn from. Taking the pixel at each
//! taxel, bilinearly between pixel centres, blurs instead: of some 280 taxels 6 mm apart at 1 mm a
//! pixel it returns a smooth press within 0.17 % of its peak and random values in -1..1 within 0.065
//! (RMS), least squares both within 1e-5 of their range (`tests/image.rs`).

use crate::{
    id::VertexId,
    image::{ImageError, Renderer, TactileImage, layer::Layer, tile::Tile},
    map::PatchMap,
    pyramid::LevelId,
    signal::{LevelFrame, Quantity},
    skin::Presence,
};

/// Values that images show.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    /// The values: NaN where no image, or no pixel with a value, shows a vertex, and where all
    /// taxels of a vertex are absent.
    pub values: LevelFrame,
    /// Of each channel the root mean square of what drawing the values misses the covered pixels
    /// by, in the unit of the pixels; NaN without any pixel.
    pub residuals: Vec<f64>,
}

/// The values that images show: the inverse of [`Renderer::render`].
///
/// Images are matched to those of the renderer by their names; levels without an image have no
/// values. Pixels that are not covered or not finite do not count.
///
/// # Errors
/// If an image is not one that the renderer draws, or has another size or other channels.
///
/// ```
/// use dermatome::{
///     atlas::{Atlas, AtlasOptions},
///     image::{RenderOptions, Renderer, sample},
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, LevelFrame},
/// };
///
/// let map = SkinMap::flat(shapes::lattice(10, 8, 0.004), 1e-3);
/// let atlas = Atlas::new(&map, &AtlasOptions::default())?;
/// let mut renderer = Renderer::new(&map, &atlas, &[Channel::default()], &RenderOptions::default())?;
/// let mut frame = LevelFrame::new(&map, 1);
/// for level in frame.values.iter_mut().flatten().flat_map(|channel| channel.iter_mut()) {
///     level.iter_mut().zip(0..).for_each(|(x, k)| *x = f64::from(k));
/// }
/// let images = renderer.render(&frame).to_vec();
/// let sampled = sample(&renderer, &images)?;
/// assert!(sampled.residuals[0] < 1e-4);
/// # Ok::<(), dermatome::Error>(())
/// ```
pub fn sample(renderer: &Renderer<'_>, images: &[TactileImage]) -> Result<Sampled, ImageError> {
    let channels = renderer.quantities.len();
    let mut values = LevelFrame::new(renderer.map, channels);
    let mut sums = vec![(0.0, 0_usize); channels];
    for image in images {
        let at = find(renderer, image)?;
        let count = image.coverage.len();
        for (patch, tile) in &renderer.canvases[at].tiles {
            for (channel, &quantity) in renderer.quantities.iter().enumerate() {
                let pixels = &image.values[channel * count..(channel + 1) * count];
                let live = present(&renderer.map.patches[*patch], image.level);
                let solve = |pixels: &[f32]| {
                    let system = System::new(tile, quantity, live.clone(), pixels);
                    (system.solve(), system.pixels.len())
                };
                let ((x, square), count) = match quantity {
                    Quantity::Intensive | Quantity::Extensive => solve(pixels),
                    Quantity::Direction => {
                        let parts =
                            [f32::cos, f32::sin].map(|part| pixels.iter().map(|&x| part(x)).collect());
                        let [((x, a), count), ((y, b), _)] = parts.map(|part: Vec<f32>| solve(&part));
                        ((x.iter().zip(y).map(|(x, y)| y.atan2(*x)).collect(), a + b), count)
                    }
                };
                values.values[*patch][channel][image.level] = x.into();
                sums[channel].0 += square;
                sums[channel].1 += count;
            }
        }
    }
    let residuals = sums.into_iter().map(|(square, count)| (square / count as f64).sqrt()).collect();
    Ok(Sampled { values, residuals })
}

/// The renderer's image of that name, if the sizes agree.
fn find(renderer: &Renderer<'_>, image: &TactileImage) -> Result<usize, ImageError> {
    let known = renderer.images();
    let Some(at) = known.iter().position(|other| other.name == image.name) else {
        let known = known.iter().take(10).map(|other| other.name.clone()).collect();
        return Err(ImageError::UnknownImage { name: image.name.clone(), known });
    };
    let needed = &known[at];
    let size = |image: &TactileImage| (image.size_px, image.channels, image.values.len());
    if size(image) == size(needed)
        && image.coverage.len() == needed.coverage.len()
        && image.level == needed.level
    {
        return Ok(at);
    }
    Err(ImageError::Size {
        name: image.name.clone(),
        found: image.size_px,
        channels: image.channels,
        values: image.values.len(),
        needed: needed.size_px,
        needed_channels: needed.channels,
    })
}

/// Which vertices of a level have a taxel that is present.
fn present(patch: &PatchMap, level: LevelId) -> Vec<bool> {
    let is_present = |taxel: VertexId| patch.taxels.presence[taxel] == Presence::Present;
    let at = &patch.levels[level].level;
    match &at.to_finest {
        None => at.origins.iter().map(|&v| is_present(v)).collect(),
        Some(rows) => {
            let mut live = vec![false; rows.coarse_len];
            for taxel in rows.indices.ids().filter(|&v| is_present(v)) {
                rows.row(taxel).for_each(|(field, _)| live[field.index()] = true);
            }
            live
        }
    }
}

/// `W x = b`: pixels in terms of the values behind them.
struct System {
    /// Of each row its entries' end, and its pixel.
    ends: Vec<usize>,
    pixels: Vec<f64>,
    entries: Vec<(usize, f64)>,
    /// Diagonal of `W' W`.
    diagonal: Vec<f64>,
    scale: Vec<f64>,
}

impl System {
    /// Vertices with less than this on the diagonal are not seen.
    const UNSEEN: f64 = 1e-6;

    fn new(tile: &Tile<'_>, quantity: Quantity, live: Vec<bool>, pixels: &[f32]) -> Self {
        let (pattern, live, scale) = Layer::new(tile, quantity).with_mask(tile, live);
        let vertices = tile.live_vertices(&live);
        let mut system = Self {
            ends: Vec::new(),
            pixels: Vec::new(),
            entries: Vec::new(),
            diagonal: vec![0.0; tile.values],
            scale,
        };
        let mut row_of = Vec::new();
        tile.surface.each_row(&pattern, &vertices, |pixel, row| {
            let pixel = pixels[pixel as usize];
            if !pixel.is_finite() {
                return;
            }
            row_of.clear();
            for &(v, w) in row {
                let v = v as usize;
                match &tile.lift {
                    None => add(&mut row_of, v, w),
                    Some(_) if w == 0.0 || !vertices[v] => {}
                    Some(lift) => {
                        lift.row(v, |c| live[c])
                            .into_iter()
                            .for_each(|(c, part)| add(&mut row_of, c, w * part));
                    }
                }
            }
            row_of.iter().for_each(|&(v, w)| system.diagonal[v] += w * w);
            system.entries.extend_from_slice(&row_of);
            system.ends.push(system.entries.len());
            system.pixels.push(pixel.into());
        });
        system
    }

    fn rows(&self) -> impl Iterator<Item = &[(usize, f64)]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.entries[start..end])
    }

    /// `W x`.
    fn draw(&self, x: &[f64]) -> Vec<f64> {
        self.rows().map(|row| row.iter().map(|&(v, w)| w * x[v]).sum()).collect()
    }

    /// `W' r`.
    fn collect(&self, r: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.diagonal.len()];
        for (row, r) in self.rows().zip(r) {
            row.iter().for_each(|&(v, w)| out[v] += w * r);
        }
        out
    }

    /// The least-squares values, and the sum of the squares of what is left.
    fn solve(&self) -> (Vec<f64>, f64) {
        /// Conjugate gradients stop when the residual has fallen by this factor, or after this many
        /// steps: the columns of weights are well apart, so about thirty do.
        const TOLERANCE: f64 = 1e-12;
        const STEPS: usize = 400;
        let is_seen: Vec<bool> = self.diagonal.iter().map(|&d| d > Self::UNSEEN).collect();
        let scaled = |r: &[f64]| -> Vec<f64> {
            (0..r.len()).map(|v| if is_seen[v] { r[v] / self.diagonal[v] } else { 0.0 }).collect()
        };
        let weight = self.collect(&vec![1.0; self.pixels.len()]);
        let mut x: Vec<f64> = self.collect(&self.pixels);
        for (v, x) in x.iter_mut().enumerate() {
            *x = if is_seen[v] { *x / weight[v] } else { 0.0 };
        }
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let mut left: Vec<f64> = self.pixels.iter().zip(self.draw(&x)).map(|(b, wx)| b - wx).collect();
        let mut z = scaled(&self.collect(&left));
        let mut direction = z.clone();
        let mut energy = dot(&self.collect(&left), &z);
        let start = energy;
        for _ in 0..STEPS {
            if energy.is_nan() || energy <= TOLERANCE * TOLERANCE * start {
                break;
            }
            let drawn = self.draw(&direction);
            let step = energy / dot(&drawn, &drawn);
            x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
            left.iter_mut().zip(&drawn).for_each(|(r, d)| *r -= step * d);
            let gradient = self.collect(&left);
            z = scaled(&gradient);
            let next = dot(&gradient, &z);
            let turn = next / energy;
            energy = next;
            direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + turn * *d);
        }
        let unscaled = (0..x.len()).map(|v| if is_seen[v] { x[v] / self.scale[v] } else { f64::NAN });
        (unscaled.map(|x| if x.is_finite() { x } else { f64::NAN }).collect(), dot(&left, &left))
    }
}

/// Adds to the entry of `v`.
fn add(row: &mut Vec<(usize, f64)>, v: usize, w: f64) {
    match row.iter_mut().find(|(other, _)| *other == v) {
        Some((_, weight)) => *weight += w,
        None => row.push((v, w)),
    }
}
