//! One channel of one chart: what was drawn last, and what has to be drawn anew.

use crate::{
    id::{IdVec, VertexId},
    image::{
        tile::Tile,
        weights::{
            runs::{Plane, narrow},
            surface::{Pattern, Surface},
        },
    },
    numeric::Csr,
    signal::Quantity,
};

/// The whole chart is drawn if more than one in this many of its sources (faces, vertices or
/// pixels) changed. *Heuristic*: a pixel of few changed faces costs more than one of many. At 2, a frame
/// in which a hundredth of the taxels of each of 13 patches changed takes 0.30 of the time of a whole one,
/// at 4/3 it takes 0.38; a single patch of 642 taxels takes 0.18 at both (`benches/image.rs`).
const FEW: usize = 2;

/// The state of one channel of a tile.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    quantity: Quantity,
    /// The values that are drawn, and which of them are there.
    last: Vec<f64>,
    live: Vec<bool>,
    /// What a value is multiplied by: 1, or for amounts what makes pixels keep the total.
    scale: Vec<f64>,
    /// Values that no pixel shows, and the pixel that gets each.
    unseen: Vec<(u32, usize)>,
    /// The scaled values, and those of the chart's vertices.
    scaled: Vec<f64>,
    x: Vec<f64>,
    pattern: Pattern,
    /// Of a pattern of rows: those that each vertex takes part in.
    rows_of: Csr<u32>,
    planes: Vec<Plane>,
    /// Large faces with one live corner, and those whose pixels follow no plane: all others with dead
    /// corners.
    single: Vec<u32>,
    mixed: Vec<u32>,
    changed: Vec<u32>,
    sources: Marked,
    vertices: Marked,
}

/// A set of small numbers.
#[derive(Debug, Clone, Default)]
struct Marked {
    is_in: Vec<bool>,
    all: Vec<u32>,
}

impl Marked {
    fn new(count: usize) -> Self {
        Self { is_in: vec![false; count], all: Vec::with_capacity(count) }
    }

    fn insert(&mut self, item: u32) {
        if !std::mem::replace(&mut self.is_in[item as usize], true) {
            self.all.push(item);
        }
    }

    fn clear(&mut self) {
        self.all.drain(..).for_each(|item| self.is_in[item as usize] = false);
    }
}

impl Layer {
    /// A layer that shows nothing.
    pub(super) fn new(tile: &Tile<'_>, quantity: Quantity) -> Self {
        let vertices = tile.surface.level.level.mesh.positions.len();
        let mut layer = Self {
            quantity,
            last: vec![f64::NAN; tile.values],
            live: vec![false; tile.values],
            scale: vec![1.0; tile.values],
            unseen: Vec::new(),
            scaled: vec![f64::NAN; tile.values],
            x: vec![f64::NAN; vertices],
            pattern: Pattern::default(),
            rows_of: Csr::default(),
            planes: Vec::new(),
            single: Vec::new(),
            mixed: Vec::new(),
            changed: Vec::with_capacity(tile.values),
            sources: Marked::default(),
            vertices: Marked::new(vertices),
        };
        layer.count_sources(tile);
        layer
    }

    /// Draws values into the pixels of its channel, which hold what it drew last. Says whether
    /// anything changed.
    pub(super) fn draw(
        &mut self,
        tile: &Tile<'_>,
        values: &IdVec<VertexId, f64>,
        pixels: &mut [f32],
    ) -> bool {
        let masks_changed = self.take(values);
        if self.changed.is_empty() {
            return false;
        }
        if masks_changed {
            // What is not drawn again has nothing.
            tile.surface.runs.all.iter().for_each(|run| Plane::constant(f64::NAN).fill_alone(run, pixels));
            self.remask(tile);
        }
        self.scale();
        let few = !masks_changed && self.unseen.is_empty() && self.changed.len() * FEW < self.last.len();
        if !(few && self.draw_changed(tile, pixels)) {
            self.draw_all(tile, pixels);
        }
        true
    }

    /// Scales the changed values.
    fn scale(&mut self) {
        if self.changed.len() == self.last.len() {
            let pairs = self.last.iter().zip(&self.scale);
            self.scaled.iter_mut().zip(pairs).for_each(|(scaled, (x, scale))| *scaled = x * scale);
        } else {
            for &v in &self.changed {
                self.scaled[v as usize] = self.last[v as usize] * self.scale[v as usize];
            }
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

    /// Which pixels follow from which values, and what values are multiplied by, where only `live`
    /// ones are there.
    pub(super) fn with_mask(mut self, tile: &Tile<'_>, live: Vec<bool>) -> (Pattern, Vec<bool>, Vec<f64>) {
        self.live = live;
        self.remask(tile);
        (self.pattern, self.live, self.scale)
    }

    /// What follows from the mask alone.
    fn remask(&mut self, tile: &Tile<'_>) {
        let live = tile.live_vertices(&self.live);
        self.pattern = tile.surface.pattern(tile.interpolation, &live);
        if let Pattern::Rows(rows) = &self.pattern {
            let entries = (0..rows.pixels.len()).zip(0_u32..);
            let entries =
                entries.flat_map(|(k, row)| rows.row(k).iter().map(move |&(v, _)| (v as usize, row)));
            self.rows_of = Csr::from_pairs(live.len(), entries);
        }
        self.count_sources(tile);
        if matches!(self.pattern, Pattern::Faces) {
            self.single.clear();
            self.mixed.clear();
            for (face, k) in tile.surface.faces.iter().zip(0..) {
                match face.live_corners(|v| live[v.index()]) {
                    1 if tile.surface.is_large(k as usize) => self.single.push(k),
                    1 | 2 => self.mixed.push(k),
                    _ => {}
                }
            }
        }
        if self.quantity == Quantity::Extensive {
            self.balance(tile, &live);
        }
        // Scales may have changed everywhere.
        self.changed.clear();
        self.changed.extend((0_u32..).take(self.last.len()));
    }

    /// Makes room for the sources of the pattern.
    fn count_sources(&mut self, tile: &Tile<'_>) {
        let (planes, sources) = match &self.pattern {
            Pattern::Faces => (tile.surface.faces.len(), tile.surface.faces.len()),
            Pattern::Cells(cells) => (cells.sources(), cells.sources()),
            Pattern::Rows(rows) => (0, rows.pixels.len()),
        };
        if self.planes.len() != planes {
            self.planes = vec![Plane::default(); planes];
        }
        if self.sources.is_in.len() != sources {
            self.sources = Marked::new(sources);
        }
    }

    /// Scales amounts so that the pixels keep their total: each value by what its pixels add up to.
    fn balance(&mut self, tile: &Tile<'_>, live: &[bool]) {
        /// A value whose weights add up to less, in pixels, is not seen.
        const UNSEEN: f64 = 1e-3;
        let mut seen = vec![0.0; live.len()];
        tile.surface.each_row(&self.pattern, live, |_, row| {
            row.iter().for_each(|&(v, w)| seen[v as usize] += w);
        });
        if let Some(lift) = &tile.lift {
            let mut lifted = vec![0.0; self.last.len()];
            for (v, sum) in seen.iter().enumerate().filter(|(v, _)| live[*v]) {
                lift.row(v, |c| self.live[c]).into_iter().for_each(|(c, w)| lifted[c] += w * sum);
            }
            seen = lifted;
        }
        self.unseen.clear();
        for (v, &sum) in seen.iter().enumerate() {
            self.scale[v] = if sum > UNSEEN { 1.0 / (tile.pixel_area * sum) } else { 0.0 };
            if self.live[v] && sum <= UNSEEN {
                let value = VertexId::new(v);
                let vertex = tile.lift.as_ref().map_or(value, |lift| lift.origins[value]);
                if let Some(pixel) = tile.surface.nearest_pixel(vertex) {
                    self.unseen.push((pixel, v));
                }
            }
        }
    }

    /// Draws the whole chart.
    fn draw_all(&mut self, tile: &Tile<'_>, pixels: &mut [f32]) {
        match &tile.lift {
            None => self.x.copy_from_slice(&self.scaled),
            Some(lift) => {
                self.x.iter_mut().enumerate().for_each(|(v, x)| *x = lift.value(v, &self.scaled));
            }
        }
        let surface = &tile.surface;
        match &self.pattern {
            Pattern::Faces => {
                for &face in &surface.large {
                    self.planes[face as usize] = surface.faces[face as usize].plane(&self.x);
                }
                for &face in &self.single {
                    self.planes[face as usize] = surface.faces[face as usize].plane_of_one(&self.x);
                }
                surface.runs.fill(&self.planes, pixels);
                surface.points.fill(&self.x, pixels);
                self.mixed.iter().for_each(|&face| draw_mixed(surface, face, &self.x, pixels));
            }
            Pattern::Cells(cells) => {
                self.planes.iter_mut().zip(&self.x).for_each(|(plane, &x)| *plane = Plane::constant(x));
                cells.fill(&self.planes, pixels);
            }
            Pattern::Rows(rows) => {
                for (k, &pixel) in rows.pixels.iter().enumerate() {
                    pixels[pixel as usize] = narrow(rows.value(k, &self.x));
                }
            }
        }
        for &(pixel, value) in &self.unseen {
            let pixel = &mut pixels[pixel as usize];
            let amount = self.last[value] / tile.pixel_area;
            *pixel = narrow(if pixel.is_nan() { amount } else { f64::from(*pixel) + amount });
        }
        tile.gutter.fill(pixels);
    }

    /// Draws what the changed values reach, unless that is much of the chart.
    fn draw_changed(&mut self, tile: &Tile<'_>, pixels: &mut [f32]) -> bool {
        self.vertices.clear();
        for &value in &self.changed {
            match &tile.lift {
                None => self.vertices.insert(value),
                Some(lift) => {
                    lift.reached[value as usize].iter().for_each(|&v| self.vertices.insert(v));
                }
            }
        }
        self.sources.clear();
        for &v in &self.vertices.all {
            match &self.pattern {
                Pattern::Faces => {
                    tile.around[v as usize].iter().for_each(|&face| self.sources.insert(face));
                }
                Pattern::Cells(_) => self.sources.insert(v),
                Pattern::Rows(_) => {
                    self.rows_of[v as usize].iter().for_each(|&row| self.sources.insert(row));
                }
            }
        }
        if self.sources.all.len() * FEW >= self.sources.is_in.len() {
            return false;
        }
        for &v in &self.vertices.all {
            let v = v as usize;
            self.x[v] = match &tile.lift {
                None => self.scaled[v],
                Some(lift) => lift.value(v, &self.scaled),
            };
        }
        for &source in &self.sources.all {
            self.draw_source(&tile.surface, source, pixels);
        }
        match self.pattern {
            Pattern::Faces => self.sources.all.iter().for_each(|&face| tile.gutter.fill_face(face, pixels)),
            Pattern::Cells(_) | Pattern::Rows(_) => tile.gutter.fill(pixels),
        }
        true
    }

    /// Draws one face, one vertex or one row.
    fn draw_source(&self, surface: &Surface<'_>, source: u32, pixels: &mut [f32]) {
        let k = source as usize;
        match &self.pattern {
            Pattern::Faces => {
                let face = &surface.faces[k];
                let is_large = surface.is_large(k);
                let plane = match face.live_corners(|v| !self.x[v.index()].is_nan()) {
                    1 if is_large => face.plane_of_one(&self.x),
                    1 | 2 => return draw_mixed(surface, source, &self.x, pixels),
                    _ if is_large => face.plane(&self.x),
                    _ => return surface.points.fill_face(k, &self.x, pixels),
                };
                surface.runs.of_source(k).iter().for_each(|run| plane.fill_alone(run, pixels));
            }
            Pattern::Cells(cells) => {
                let plane = Plane::constant(self.x[k]);
                cells.of_source(k).iter().for_each(|run| plane.fill_alone(run, pixels));
            }
            Pattern::Rows(rows) => pixels[rows.pixels[k] as usize] = narrow(rows.value(k, &self.x)),
        }
    }
}

/// Draws a face with dead corners pixel by pixel.
fn draw_mixed(surface: &Surface<'_>, face: u32, x: &[f64], pixels: &mut [f32]) {
    let weights = &surface.faces[face as usize];
    let values = weights.corners.map(|v| x[v.index()]);
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
