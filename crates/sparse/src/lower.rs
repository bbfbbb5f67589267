//! The lower triangle of a matrix, as faer reads it, and the numbers that faer computes with.

use faer::sparse::SymbolicSparseColMatRef;
use glam::DVec2;

use crate::{Pattern, SparseError};

/// The lower triangle of a pattern, blocks expanded, column by column as faer reads it.
#[derive(Debug)]
pub(crate) struct Lower {
    pub(crate) rows: usize,
    pub(crate) starts: Vec<u32>,
    pub(crate) indices: Vec<u32>,
}

impl Lower {
    /// `None` if it has more than 2^32 entries.
    pub(crate) fn new(pattern: &Pattern, block: usize) -> Option<Self> {
        let (mut starts, mut indices) = (vec![0], Vec::new());
        for j in 0..pattern.rows() {
            for b in 0..block {
                let column = block * j + b;
                let below =
                    pattern.columns(j).iter().flat_map(|&i| (0..block).map(move |a| block * i as usize + a));
                for row in below.filter(|&row| row >= column) {
                    indices.push(u32::try_from(row).ok()?);
                }
                starts.push(u32::try_from(indices.len()).ok()?);
            }
        }
        Some(Self { rows: block * pattern.rows(), starts, indices })
    }

    pub(crate) fn symbolic(&self) -> SymbolicSparseColMatRef<'_, u32> {
        SymbolicSparseColMatRef::new_checked(self.rows, self.rows, &self.starts, None, &self.indices)
    }

    /// The entries of the lower triangle in this order.
    pub(crate) fn gather<T: Finite>(
        &self,
        pattern: &Pattern,
        block: usize,
        entry: impl Fn(usize, usize, usize) -> T,
    ) -> Result<Vec<T>, SparseError> {
        let mut values = Vec::with_capacity(self.indices.len());
        for j in 0..pattern.rows() {
            for b in 0..block {
                // Entry (i, j) below the diagonal: found from row i, so that only the lower
                // triangle is read.
                for &i in pattern.columns(j).iter().filter(|&&i| i as usize >= j) {
                    let slot = pattern.slot(i as usize, j).expect("patterns are symmetric");
                    for a in 0..block {
                        if block * i as usize + a >= block * j + b {
                            let value = entry(slot, a, b);
                            if !value.finite() {
                                return Err(SparseError::NotFinite { row: i as usize });
                            }
                            values.push(value);
                        }
                    }
                }
            }
        }
        Ok(values)
    }
}

pub(crate) type Complex = faer::c64;

/// The complex number with real part `z.x` and imaginary part `z.y`.
pub(crate) fn complex(z: DVec2) -> Complex {
    Complex::new(z.x, z.y)
}

/// Numbers that can be asked whether they are finite.
pub(crate) trait Finite {
    fn finite(&self) -> bool;
}

impl Finite for f64 {
    fn finite(&self) -> bool {
        self.is_finite()
    }
}

impl Finite for Complex {
    fn finite(&self) -> bool {
        self.re.is_finite() && self.im.is_finite()
    }
}
