//! One channel of one chart: the values that were drawn last, and which vertices had one.

use crate::id::{IdVec, VertexId};
use crate::image::runs::{AT_ONCE, Plane, PlanesAtOnce};
use crate::image::surface::PixelSurface;
use crate::numeric::{narrow, storable};
use crate::signal::Quantity;

/// From larger values on, a pixel may be beyond 32-bit floats: it is then looked at, and NaN if it is.
const LARGE: f64 = 1e30;

/// The state of one channel of a chart.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    quantity: Quantity,
    /// The values that were drawn, and which of them are known.
    last: Vec<f64>,
    live: Vec<bool>,
    /// Factor of each value: 1, or for amounts the one with which pixels keep the total.
    scale: Vec<f64>,
    scaled: Vec<f64>,
    /// Values that no pixel shows, and the pixel that gets each.
    unseen: Vec<(u32, usize)>,
    planes: Vec<Plane>,
    /// Faces with one or two live corners: their pixels do not follow a plane.
    mixed: Vec<u32>,
}

impl Layer {
    /// A layer that shows nothing.
    pub(super) fn new(surface: &PixelSurface, quantity: Quantity) -> Self {
        let count = surface.vertices;
        Self {
            quantity,
            last: vec![f64::NAN; count],
            live: vec![false; count],
            scale: vec![1.0; count],
            scaled: vec![f64::NAN; count],
            unseen: Vec::new(),
            planes: vec![Plane::default(); surface.faces.len()],
            mixed: Vec::new(),
        }
    }

    /// A layer whose vertices have a value or not.
    pub(super) fn of_mask(surface: &PixelSurface, quantity: Quantity, live: Vec<bool>) -> Self {
        let mut layer = Self { live, ..Self::new(surface, quantity) };
        layer.remask(surface);
        layer
    }

    /// Calls `visit` with the vertices and weights of each pixel that shows a value, and again with each value that
    /// no pixel shows and its pixel.
    pub(super) fn each_row(&self, surface: &PixelSurface, mut visit: impl FnMut(u32, &[(u32, f64)])) {
        let mut scaled = Vec::new();
        surface.each_row(&self.live, |pixel, row| {
            scaled.clear();
            scaled.extend(row.iter().map(|&(v, w)| (v, w * self.scale[v as usize])));
            visit(pixel, &scaled);
        });
        for &(pixel, v) in &self.unseen {
            visit(pixel, &[(VertexId::new(v).raw(), 1.0 / surface.pixel_area)]);
        }
    }

    /// Draws values into the pixels of its channel; these must be as it drew them last.
    pub(super) fn draw(&mut self, surface: &PixelSurface, values: &IdVec<VertexId, f64>, pixels: &mut [f32]) {
        let (mut is_same, mut masks_changed) = (true, false);
        assert_eq!(values.len(), self.last.len(), "one value per vertex");
        for ((&value, last), live) in values.iter().zip(&mut self.last).zip(&mut self.live) {
            let value = storable(value);
            is_same &= value.to_bits() == last.to_bits();
            masks_changed |= value.is_nan() == *live;
            (*last, *live) = (value, !value.is_nan());
        }
        if is_same {
            return;
        }
        if masks_changed {
            // Pixels that are not drawn again are unknown.
            surface.runs.all.iter().for_each(|run| Plane::constant(f64::NAN).fill_alone(run, pixels));
            self.remask(surface);
        }
        let scaled = self.scaled.iter_mut().zip(self.last.iter().zip(&self.scale));
        scaled.for_each(|(scaled, (x, scale))| *scaled = x * scale);
        self.draw_all(surface, pixels);
    }

    /// Updates everything that depends on the mask alone.
    fn remask(&mut self, surface: &PixelSurface) {
        self.mixed.clear();
        let live = |v: VertexId| self.live[v.index()];
        let faces = surface.faces.iter().zip(0_u32..);
        self.mixed.extend(faces.filter(|(f, _)| matches!(f.live_corners(live), 1 | 2)).map(|(_, k)| k));
        if self.quantity == Quantity::Extensive {
            self.balance(surface);
        }
    }

    /// Scales amounts so that the pixels keep their total: divides each value by the sum of its weights.
    fn balance(&mut self, surface: &PixelSurface) {
        /// A value whose weights have a smaller sum, in pixels, counts as unseen.
        const MIN_SEEN: f64 = 1e-3;
        let mut seen = vec![0.0; self.live.len()];
        surface.each_row(&self.live, |_, row| {
            row.iter().for_each(|&(v, w)| seen[v as usize] += w);
        });
        self.unseen.clear();
        for (v, &sum) in seen.iter().enumerate() {
            self.scale[v] = if sum > MIN_SEEN { 1.0 / (surface.pixel_area * sum) } else { 0.0 };
            if self.live[v] && sum <= MIN_SEEN {
                self.unseen.extend(surface.nearest_pixel(VertexId::new(v)).map(|pixel| (pixel, v)));
            }
        }
    }

    fn draw_all(&mut self, surface: &PixelSurface, pixels: &mut [f32]) {
        let planes = self.planes.iter_mut().zip(&surface.faces);
        planes.for_each(|(plane, face)| *plane = face.plane(&self.scaled));
        surface.runs.fill(&self.planes, pixels);
        let x = |v: VertexId| self.scaled[v.index()];
        self.mixed.iter().for_each(|&face| draw_mixed(surface, face, x, pixels));
        if self.scaled.iter().any(|x| x.abs() > LARGE) {
            for run in &surface.runs.all {
                let drawn = &mut pixels[run.at as usize..][..usize::from(run.length)];
                drawn.iter_mut().filter(|x| x.is_infinite()).for_each(|x| *x = f32::NAN);
            }
        }
        self.add_unseen(surface, |v| self.last[v], pixels);
    }

    fn add_unseen(&self, surface: &PixelSurface, value: impl Fn(usize) -> f64, pixels: &mut [f32]) {
        for &(pixel, v) in &self.unseen {
            let pixel = &mut pixels[pixel as usize];
            let amount = value(v) / surface.pixel_area;
            *pixel = narrow(storable(if pixel.is_nan() { amount } else { f64::from(*pixel) + amount }));
        }
    }

    /// Whether it can draw sixteen frames at once: those vertices have values that had some when it drew last, none of them
    /// [large](LARGE).
    pub(super) fn fits(&self, values: &[[f64; AT_ONCE]]) -> bool {
        let fits = |(values, (&live, &scale)): (&[f64; AT_ONCE], (&bool, &f64))| {
            let fits = |value: &f64| (value.is_finite() == live) & (((value * scale).abs() <= LARGE) | !live);
            values.iter().fold(true, |all, value| all & fits(value))
        };
        values.iter().zip(self.live.iter().zip(&self.scale)).all(fits)
    }

    /// Draws values of sixteen frames that [fit](Self::fits), into images that begin `stride` numbers apart.
    pub(super) fn draw_at_once(
        &self,
        surface: &PixelSurface,
        values: &[[f64; AT_ONCE]],
        planes: &mut Vec<PlanesAtOnce>,
        images: &mut [f32],
        stride: usize,
    ) {
        planes.resize(surface.faces.len(), [[0.0; AT_ONCE]; 3]);
        for (face, planes) in surface.faces.iter().zip(&mut *planes) {
            face.planes_at_once(values, &self.scale, planes);
        }
        surface.runs.fill_at_once(planes, images, stride);
        for (k, image) in images.chunks_mut(stride).enumerate() {
            let x = |v: VertexId| values[v.index()][k] * self.scale[v.index()];
            self.mixed.iter().for_each(|&face| draw_mixed(surface, face, x, image));
            self.add_unseen(surface, |v| values[v][k], image);
        }
    }
}

/// Draws a face with dead corners pixel by pixel.
fn draw_mixed(surface: &PixelSurface, face: u32, x: impl Fn(VertexId) -> f64, pixels: &mut [f32]) {
    let weights = &surface.faces[face as usize];
    let values = weights.corners.map(x);
    let live = values.map(|x| !x.is_nan());
    for run in surface.runs.of_source(face as usize) {
        for k in 0..run.length {
            let row = weights.live_at(run.column + k, run.row, live);
            let value =
                row.map_or(f64::NAN, |row| (0..3).filter(|&k| live[k]).map(|k| row[k] * values[k]).sum());
            pixels[run.at as usize + usize::from(k)] = narrow(value);
        }
    }
}
