//! Pixels of small faces, each written from the values of the three corners of its face.
//!
//! A plane and a run cost as much as several pixels, so faces of a few pixels are drawn pixel by pixel,
//! as rows of a sparse matrix with three entries each. Faces without pixels cost nothing.

use crate::image::weights::{
    face_weights::FaceWeights,
    runs::{Runs, narrow},
};

/// One pixel of a small face.
#[derive(Debug, Clone, Copy)]
struct Point {
    /// Its index in the image.
    at: u32,
    /// The corners of the face.
    corners: [u32; 3],
    /// Weights of the second and the third corner.
    weights: [f64; 2],
}

/// The pixels of small faces, face by face.
#[derive(Debug, Clone, Default)]
pub(in crate::image) struct Points {
    all: Vec<Point>,
    /// Where the pixels of each face begin; one more entry than faces.
    starts: Vec<u32>,
}

impl Points {
    /// The pixels of the faces that `is_small` says.
    pub(in crate::image) fn new(
        faces: &[FaceWeights],
        runs: &Runs,
        is_small: impl Fn(usize) -> bool,
    ) -> Self {
        let (mut all, mut starts) = (Vec::new(), vec![0]);
        for (k, face) in faces.iter().enumerate() {
            let corners = face.corners.map(|v| v.raw());
            for run in runs.of_source(k).iter().filter(|_| is_small(k)) {
                for (at, column) in (run.at..).zip(run.column..run.column + run.length) {
                    let [_, second, third] = face.at(column, run.row);
                    all.push(Point { at, corners, weights: [second, third] });
                }
            }
            starts.push(u32::try_from(all.len()).unwrap_or(u32::MAX));
        }
        all.shrink_to_fit();
        Self { all, starts }
    }

    /// Whether it draws the pixels of a face.
    pub(in crate::image) fn has(&self, face: usize) -> bool {
        self.starts[face] < self.starts[face + 1]
    }

    /// Draws all pixels.
    pub(in crate::image) fn fill(&self, x: &[f64], pixels: &mut [f32]) {
        self.all.iter().for_each(|point| point.draw(x, pixels));
    }

    /// Draws the pixels of one face.
    pub(in crate::image) fn fill_face(&self, face: usize, x: &[f64], pixels: &mut [f32]) {
        let range = self.starts[face] as usize..self.starts[face + 1] as usize;
        self.all[range].iter().for_each(|point| point.draw(x, pixels));
    }
}

impl Point {
    /// Draws the pixel; NaN where a corner has no value.
    #[inline]
    fn draw(&self, x: &[f64], pixels: &mut [f32]) {
        let [a, b, c] = self.corners.map(|v| x[v as usize]);
        let [second, third] = self.weights;
        pixels[self.at as usize] = narrow(a + ((b - a) * second + (c - a) * third));
    }
}
