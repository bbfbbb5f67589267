//! Entries of an inverse without the rest of it.

use faer::{
    Accum, Mat, MatMut, MatRef, Par,
    linalg::{matmul::matmul, triangular_inverse::invert_lower_triangular, triangular_solve},
    sparse::linalg::cholesky::supernodal::SupernodalLltRef,
};
use rayon::prelude::*;

/// Entries of the inverse of a factored matrix, on the pattern of its factor.
///
/// `(takahashi1973)`: from the last column to the first, every column of the inverse follows from
/// entries already known, since the rows of a column of `L` lie in columns that come later. Here in
/// supernodes: with `W = L_uj L_jj^-1`, `Z_uj = -Z_uu W` and `Z_jj = L_jj^-T L_jj^-1 - W' Z_uj`.
#[derive(Debug, Clone)]
pub struct SelectedInverse {
    /// Position of every row in the order of elimination.
    positions: Vec<u32>,
    /// Supernode of every position.
    supernodes: Vec<u32>,
    panels: Vec<Panel>,
    size: usize,
}

/// The columns of one supernode: its own rows, then those below.
#[derive(Debug, Clone, Default)]
struct Panel {
    start: usize,
    width: usize,
    below: Vec<u32>,
    /// Column by column, `width + below.len()` rows each.
    values: Vec<f64>,
}

impl Panel {
    fn height(&self) -> usize {
        self.width + self.below.len()
    }

    /// The row of the panel for `position`, if there is one.
    fn row(&self, position: usize) -> Option<usize> {
        if position < self.start + self.width {
            return position.checked_sub(self.start);
        }
        let position = u32::try_from(position).ok()?;
        self.below.binary_search(&position).ok().map(|k| self.width + k)
    }
}

impl SelectedInverse {
    /// Entry (`a`, `b`) of block (`row`, `column`) of the inverse; `None` outside the pattern of
    /// the factor.
    pub(crate) fn entry(&self, row: usize, column: usize, a: usize, b: usize) -> Option<f64> {
        let i = *self.positions.get(self.size * row + a)? as usize;
        let j = *self.positions.get(self.size * column + b)? as usize;
        let (later, earlier) = (i.max(j), i.min(j));
        let panel = &self.panels[self.supernodes[earlier] as usize];
        let k = panel.row(later)?;
        panel.values.get((earlier - panel.start) * panel.height() + k).copied()
    }

    /// The block of `row` on the diagonal of the inverse.
    ///
    /// # Panics
    /// If `N` is not the size of a block, or `row` does not exist.
    pub fn diagonal<const N: usize>(&self, row: usize) -> [[f64; N]; N] {
        assert_eq!(N, self.size, "rows of a block");
        std::array::from_fn(|a| {
            std::array::from_fn(|b| self.entry(row, row, a, b).expect("the factor holds its diagonal"))
        })
    }
}

/// Computes the inverse on the pattern of `factor`. Supernodes of equal depth in the elimination tree depend
/// only on their ancestors, so they are computed in parallel; the result does not depend on the number of
/// threads.
pub(super) fn invert(
    factor: SupernodalLltRef<'_, u32, f64>,
    positions: Vec<u32>,
    size: usize,
) -> SelectedInverse {
    let count = factor.symbolic().n_supernodes();
    let mut supernodes = vec![0_u32; positions.len()];
    for s in 0..count {
        let supernode = factor.supernode(s);
        let range = supernode.start()..supernode.start() + supernode.val().ncols();
        supernodes[range].fill(u32::try_from(s).expect("no more supernodes than rows"));
    }
    // Depth below the roots; parents have larger indices, so the last is first.
    let mut depths = vec![0_usize; count];
    for s in (0..count).rev() {
        if let Some(&first) = factor.supernode(s).pattern().first() {
            depths[s] = depths[supernodes[first as usize] as usize] + 1;
        }
    }
    let mut levels = vec![Vec::new(); depths.iter().max().map_or(0, |d| d + 1)];
    for (s, &depth) in depths.iter().enumerate() {
        levels[depth].push(s);
    }
    let mut panels = vec![Panel::default(); count];
    for level in levels {
        let done: Vec<Panel> =
            level.par_iter().map(|&s| invert_supernode(factor, s, &panels, &supernodes)).collect();
        for (s, panel) in level.into_iter().zip(done) {
            panels[s] = panel;
        }
    }
    SelectedInverse { positions, supernodes, panels, size }
}

fn invert_supernode(
    factor: SupernodalLltRef<'_, u32, f64>,
    s: usize,
    panels: &[Panel],
    supernodes: &[u32],
) -> Panel {
    let supernode = factor.supernode(s);
    let width = supernode.val().ncols();
    let below = supernode.pattern().to_vec();
    let (top, bottom) = supernode.val().split_at_row(width);
    let mut inverse = Mat::<f64>::zeros(width, width);
    invert_lower_triangular(inverse.as_mut(), top, Par::Seq);
    let mut panel = Panel { start: supernode.start(), width, below, values: Vec::new() };
    panel.values = vec![0.0; width * panel.height()];
    let height = panel.height();
    let z = MatMut::from_column_major_slice_mut(&mut panel.values, height, width);
    let (mut z_top, mut z_bottom) = z.split_at_row_mut(width);
    // L_jj^-T L_jj^-1.
    matmul(z_top.as_mut(), Accum::Replace, inverse.transpose(), inverse.as_ref(), 1.0, Par::Seq);
    if !panel.below.is_empty() {
        // W' = L_jj^-T L_uj'.
        let mut w = bottom.transpose().to_owned();
        triangular_solve::solve_upper_triangular_in_place(top.transpose(), w.as_mut(), Par::Seq);
        let known = gather(&panel.below, panels, supernodes);
        let n = panel.below.len();
        let known = MatRef::from_column_major_slice(&known, n, n);
        matmul(z_bottom.as_mut(), Accum::Replace, known, w.transpose(), -1.0, Par::Seq);
        matmul(z_top.as_mut(), Accum::Add, w.as_ref(), z_bottom.as_ref(), -1.0, Par::Seq);
    }
    panel
}

/// The submatrix of the inverse with these rows and columns: all of it lies in panels of ancestors.
fn gather(rows: &[u32], panels: &[Panel], supernodes: &[u32]) -> Vec<f64> {
    let n = rows.len();
    let mut square = vec![0.0; n * n];
    // Rows of the ancestor's panel, for the rows from the first of its columns on.
    let mut places = Vec::with_capacity(n);
    let mut first = 0;
    while first < n {
        let panel = &panels[supernodes[rows[first] as usize] as usize];
        let end = panel.start + panel.width;
        places.clear();
        let mut at = 0;
        for &row in &rows[first..] {
            let row = row as usize;
            if row < end {
                places.push(row - panel.start);
                continue;
            }
            while (panel.below[at] as usize) < row {
                at += 1;
            }
            places.push(panel.width + at);
        }
        let columns = rows[first..].iter().take_while(|&&r| (r as usize) < end).count();
        for k in 0..columns {
            let column = &panel.values[places[k] * panel.height()..][..panel.height()];
            for (offset, &place) in places.iter().enumerate().skip(k) {
                let (i, j) = (first + offset, first + k);
                square[j * n + i] = column[place];
                square[i * n + j] = column[place];
            }
        }
        first += columns;
    }
    square
}
