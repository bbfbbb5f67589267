//! One channel of one chart: what was drawn last, and what has to be drawn anew.

use crate::id::{IdVec, VertexId};
use crate::image::runs::{AT_ONCE, Plane, PlanesAtOnce};
use crate::image::surface::{Pattern, PixelSurface};
use crate::numeric::{Csr, narrow};
use crate::signal::Quantity;

/// The whole chart is drawn if more than one in this many of its sources (faces, vertices or
/// pixels) changed. *Heuristic*: a pixel of few changed faces costs more than one of many. At 2, a frame
/// in which a hundredth of the taxels of each of 13 patches changed takes 0.30 of the time of a whole one,
/// at 4/3 it takes 0.38; a single patch of 642 taxels takes 0.18 at both (`benches/image.rs`).
const FEW: usize = 2;

/// The state of one channel of a chart.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    quantity: Quantity,
    /// The values that are drawn, and which of them are there.
    last: Vec<f64>,
    live: Vec<bool>,
    /// What a value is multiplied by: 1, or for amounts what makes pixels keep the total.
    scale: Vec<f64>,
    scaled: Vec<f64>,
    /// Values that no pixel shows, and the pixel that gets each.
    unseen: Vec<(u32, usize)>,
    pattern: Pattern,
    /// Of a pattern of rows: those that each vertex takes part in.
    rows_of: Csr<u32>,
    planes: Vec<Plane>,
    /// Faces with one or two live corners: their pixels follow no plane.
    mixed: Vec<u32>,
    changed: Vec<u32>,
    /// The sources to be drawn, and which these are.
    sources: Vec<u32>,
    is_source: Vec<bool>,
}

impl Layer {
    /// A layer that shows nothing.
    pub(super) fn new(surface: &PixelSurface, quantity: Quantity) -> Self {
        let count = surface.vertices;
        let mut layer = Self {
            quantity,
            last: vec![f64::NAN; count],
            live: vec![false; count],
            scale: vec![1.0; count],
            scaled: vec![f64::NAN; count],
            unseen: Vec::new(),
            pattern: Pattern::default(),
            rows_of: Csr::default(),
            planes: Vec::new(),
            mixed: Vec::new(),
            changed: Vec::with_capacity(count),
            sources: Vec::new(),
            is_source: Vec::new(),
        };
        layer.count_sources(surface);
        layer
    }

    /// Draws values into the pixels of its channel, which hold what it drew last.
    pub(super) fn draw(&mut self, surface: &PixelSurface, values: &IdVec<VertexId, f64>, pixels: &mut [f32]) {
        let masks_changed = self.take(values);
        if self.changed.is_empty() {
            return;
        }
        if masks_changed {
            // What is not drawn again has nothing.
            surface.runs.all.iter().for_each(|run| Plane::constant(f64::NAN).fill_alone(run, pixels));
            self.remask(surface);
        }
        for &v in &self.changed {
            self.scaled[v as usize] = self.last[v as usize] * self.scale[v as usize];
        }
        let few = !masks_changed && self.unseen.is_empty() && self.changed.len() * FEW < self.last.len();
        if !(few && self.draw_changed(surface, pixels)) {
            self.draw_all(surface, pixels);
        }
    }

    /// Takes values in, lists those that changed, and says whether any came or went.
    fn take(&mut self, values: &[f64]) -> bool {
        const BLOCK: usize = 16;
        assert_eq!(values.len(), self.last.len(), "one value per vertex");
        self.changed.clear();
        let mut masks_changed = false;
        for begin in (0..values.len()).step_by(BLOCK) {
            let end = (begin + BLOCK).min(values.len());
            let pairs = values[begin..end].iter().zip(&self.last[begin..end]);
            if pairs.fold(0, |differ, (a, b)| differ | (a.to_bits() ^ b.to_bits())) == 0 {
                continue;
            }
            let kept = self.last[begin..end].iter_mut().zip(&mut self.live[begin..end]);
            for ((&value, (last, live)), at) in values[begin..end].iter().zip(kept).zip(begin..) {
                // What is not finite is not there.
                let value = if value.is_finite() { value } else { f64::NAN };
                if value.to_bits() == last.to_bits() {
                    continue;
                }
                masks_changed |= value.is_nan() == *live;
                (*last, *live) = (value, !value.is_nan());
                self.changed.push(u32::try_from(at).unwrap_or(u32::MAX));
            }
        }
        masks_changed
    }

    /// What follows from the mask alone.
    fn remask(&mut self, surface: &PixelSurface) {
        self.pattern = surface.pattern(&self.live);
        if let Pattern::Rows(rows) = &self.pattern {
            let entries = rows.entries.iter().zip(0_u32..);
            let entries = entries.flat_map(|(row, k)| row.iter().map(move |&(v, _)| (v as usize, k)));
            self.rows_of = Csr::from_pairs(self.live.len(), entries);
        }
        self.count_sources(surface);
        if matches!(self.pattern, Pattern::Faces) {
            self.mixed.clear();
            let live = |v: VertexId| self.live[v.index()];
            let faces = surface.faces.iter().zip(0_u32..);
            self.mixed.extend(faces.filter(|(f, _)| matches!(f.live_corners(live), 1 | 2)).map(|(_, k)| k));
        }
        if self.quantity == Quantity::Extensive {
            self.balance(surface);
        }
        // Scales may have changed everywhere.
        self.changed.clear();
        self.changed.extend((0_u32..).take(self.last.len()));
    }

    /// Makes room for the sources of the pattern.
    fn count_sources(&mut self, surface: &PixelSurface) {
        let (planes, sources) = match &self.pattern {
            Pattern::Faces => (surface.faces.len(), surface.faces.len()),
            Pattern::Cells(cells) => (cells.sources(), cells.sources()),
            Pattern::Rows(rows) => (0, rows.pixels.len()),
        };
        self.planes.resize(planes, Plane::default());
        self.is_source.resize(sources, false);
        self.sources.reserve(sources);
    }

    /// Scales amounts so that the pixels keep their total: each value by what its pixels add up to.
    fn balance(&mut self, surface: &PixelSurface) {
        /// A value whose weights add up to less, in pixels, is not seen.
        const UNSEEN: f64 = 1e-3;
        let mut seen = vec![0.0; self.live.len()];
        surface.each_row(&self.pattern, &self.live, |_, row| {
            row.iter().for_each(|&(v, w)| seen[v as usize] += w);
        });
        self.unseen.clear();
        for (v, &sum) in seen.iter().enumerate() {
            self.scale[v] = if sum > UNSEEN { 1.0 / (surface.pixel_area * sum) } else { 0.0 };
            if self.live[v] && sum <= UNSEEN {
                self.unseen.extend(surface.nearest_pixel(VertexId::new(v)).map(|pixel| (pixel, v)));
            }
        }
    }

    fn draw_all(&mut self, surface: &PixelSurface, pixels: &mut [f32]) {
        match &self.pattern {
            Pattern::Faces => {
                let planes = self.planes.iter_mut().zip(&surface.faces);
                planes.for_each(|(plane, face)| *plane = face.plane(&self.scaled));
                surface.runs.fill(&self.planes, pixels);
                let x = |v: VertexId| self.scaled[v.index()];
                self.mixed.iter().for_each(|&face| draw_mixed(surface, face, x, pixels));
            }
            Pattern::Cells(cells) => {
                let planes = self.planes.iter_mut().zip(&self.scaled);
                planes.for_each(|(plane, &x)| *plane = Plane::constant(x));
                cells.fill(&self.planes, pixels);
            }
            Pattern::Rows(rows) => {
                for (k, &pixel) in rows.pixels.iter().enumerate() {
                    pixels[pixel as usize] = narrow(rows.value(k, &self.scaled));
                }
            }
        }
        self.add_unseen(surface, |v| self.last[v], pixels);
    }

    fn add_unseen(&self, surface: &PixelSurface, value: impl Fn(usize) -> f64, pixels: &mut [f32]) {
        for &(pixel, v) in &self.unseen {
            let pixel = &mut pixels[pixel as usize];
            let amount = value(v) / surface.pixel_area;
            *pixel = narrow(if pixel.is_nan() { amount } else { f64::from(*pixel) + amount });
        }
    }

    /// Whether pixels follow planes of faces.
    pub(super) fn has_planes(&self) -> bool {
        matches!(self.pattern, Pattern::Faces)
    }

    /// Whether it can draw sixteen frames at once: those vertices have values that had some when it drew last.
    pub(super) fn fits(&self, values: &[[f64; AT_ONCE]]) -> bool {
        let fits = |(values, &live): (&[f64; AT_ONCE], &bool)| {
            values.iter().fold(true, |fits, value| fits & (value.is_finite() == live))
        };
        self.has_planes() && values.iter().zip(&self.live).all(fits)
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

    /// Draws what the changed values reach, unless that is much of the chart.
    fn draw_changed(&mut self, surface: &PixelSurface, pixels: &mut [f32]) -> bool {
        self.sources.clear();
        let (sources, is_source) = (&mut self.sources, &mut self.is_source);
        let mut reach = |source: u32| {
            if !std::mem::replace(&mut is_source[source as usize], true) {
                sources.push(source);
            }
        };
        for &v in &self.changed {
            match &self.pattern {
                Pattern::Faces => surface.around[v as usize].iter().for_each(|&face| reach(face)),
                Pattern::Cells(_) => reach(v),
                Pattern::Rows(_) => self.rows_of[v as usize].iter().for_each(|&row| reach(row)),
            }
        }
        self.sources.iter().for_each(|&source| self.is_source[source as usize] = false);
        if self.sources.len() * FEW >= self.is_source.len() {
            return false;
        }
        self.sources.iter().for_each(|&source| self.draw_source(surface, source, pixels));
        true
    }

    /// Draws one face, one vertex or one row.
    fn draw_source(&self, surface: &PixelSurface, source: u32, pixels: &mut [f32]) {
        let (k, x) = (source as usize, &self.scaled);
        match &self.pattern {
            Pattern::Faces => {
                let face = &surface.faces[k];
                if let 1 | 2 = face.live_corners(|v| !x[v.index()].is_nan()) {
                    return draw_mixed(surface, source, |v| x[v.index()], pixels);
                }
                let plane = face.plane(x);
                surface.runs.of_source(k).iter().for_each(|run| plane.fill_alone(run, pixels));
            }
            Pattern::Cells(cells) => {
                let plane = Plane::constant(x[k]);
                cells.of_source(k).iter().for_each(|run| plane.fill_alone(run, pixels));
            }
            Pattern::Rows(rows) => pixels[rows.pixels[k] as usize] = narrow(rows.value(k, x)),
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
