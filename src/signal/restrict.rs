//! Carries frames from the taxels to the receptive fields of every level.
//!
//! Intensive channels go as `P'(a m p) / P'(a m)`, extensive ones as `P'(m f)`, with `P` the
//! prolongations of the pyramid, `a` the areas of the taxels and `m` 1 where there is a reading, else
//! 0 (cannata, the virtual taxels of its equation 9, here with overlapping fields). The sums are
//! carried from level to level and divided on each, so that the total force of a level is that of
//! the taxels but for rounding.
//!
//! A field is always summed whole and in the same order. So a frame of which only the changed fields
//! are summed anew has the same bits as one that is computed from nothing, and errors do not pile up
//! in a long stream.

use crate::{
    id::{IdVec, VertexId},
    map::{PatchMap, SkinMap},
    pyramid::{LevelId, Prolongation},
    signal::{Channel, Frame, LevelFrame, Quantity, gather::Gather},
    skin::PatchId,
};

/// All fields of a level are summed if more than one in this many of its finer vertices changed.
/// *Heuristic*: with lists of the touched fields a frame takes 0.1 to 0.2 of the time of a whole one where
/// 1 % of the taxels changed together, 0.4 to 0.5 where 12 % did and 0.7 to 0.8 where 25 % did, for 642
/// taxels and for 4336 in 13 patches (`benches/signal.rs`): at about 40 % they pay no longer.
const FEW: usize = 2;

/// Carries frames to all levels.
///
/// It owns its buffers: after the first frame it allocates nothing. It computes only what changed
/// since the frame before.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     pipeline::{BuildOptions, build},
///     signal::{Channel, Frame, Restrictor},
///     skin::Skin,
/// };
///
/// let map = build(&Skin::from_mesh("palm", shapes::cap(400, 0.1, 0.5)), &BuildOptions::default())?;
/// let mut restrictor = Restrictor::new(&map, &[Channel::default()]);
/// let mut frame = Frame::new(&map, 1);
/// for value in frame.values.iter_mut().flatten().flat_map(|channel| channel.iter_mut()) {
///     *value = 2.5;
/// }
/// let levels = restrictor.restrict(&frame);
/// let (palm, pressure) = (map.patches.ids().next().unwrap(), 0);
/// for field in levels.values[palm][pressure].iter().flatten() {
///     assert!((field - 2.5).abs() < 1e-12, "a constant pressure is the same on every level");
/// }
/// # Ok::<(), dermatome::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Restrictor<'a> {
    map: &'a SkinMap,
    quantities: Vec<Quantity>,
    /// From each level to the next coarser one.
    steps: IdVec<PatchId, Vec<Gather>>,
    carried: IdVec<PatchId, Vec<Carried>>,
    levels: LevelFrame,
    touched: Touched,
}

/// What one channel of one patch carries from level to level.
#[derive(Debug, Clone)]
struct Carried {
    /// `a m p` or `m f` of the taxels, and what the fields collect of it.
    sums: IdVec<LevelId, IdVec<VertexId, f64>>,
    /// `a m` of the taxels, and what the fields collect of it; 0 where there is no reading.
    areas: IdVec<LevelId, IdVec<VertexId, f64>>,
}

/// The vertices of a level that changed.
#[derive(Debug, Clone, Default)]
struct Touched {
    /// Whether it is all of them; the lists are then not used.
    all: bool,
    /// The changed vertices of a level, and those of the next coarser one.
    fine: Vec<VertexId>,
    coarse: Vec<VertexId>,
    /// Which vertices are in `coarse`; all false between frames.
    marks: Vec<bool>,
}

impl<'a> Restrictor<'a> {
    /// A restrictor for frames of these channels.
    #[must_use]
    pub fn new(map: &'a SkinMap, channels: &[Channel]) -> Self {
        let steps = map.patches.map(|patch| {
            let prolongations = patch.levels.iter().filter_map(|l| l.level.from_coarser.as_ref());
            prolongations.map(Gather::new).collect()
        });
        let zeros = LevelFrame::new(map, 1).values.map(|patch| patch[0].map(|x| IdVec::filled(0.0, x.len())));
        let carried = zeros.map(|z| vec![Carried { sums: z.clone(), areas: z.clone() }; channels.len()]);
        let largest = zeros.iter().flatten().map(|values| values.len()).max().unwrap_or(0);
        let touched = Touched {
            all: false,
            fine: Vec::with_capacity(largest),
            coarse: Vec::with_capacity(largest),
            marks: vec![false; largest],
        };
        let quantities = channels.iter().map(|c| c.quantity).collect();
        Self { map, quantities, steps, carried, levels: LevelFrame::new(map, channels.len()), touched }
    }

    /// The frame on all levels. Readings that are not finite count as missing.
    ///
    /// # Panics
    /// If the frame has not the patches, channels and taxels that the restrictor was made for.
    pub fn restrict(&mut self, frame: &Frame) -> &LevelFrame {
        assert_eq!(frame.values.len(), self.map.patches.len(), "one entry per patch");
        self.levels.time = frame.time;
        for (id, patch) in self.map.patches.enumerate() {
            let (read, steps) = (&frame.values[id], &self.steps[id]);
            assert_eq!(read.len(), self.quantities.len(), "one array per channel of {}", patch.name);
            let carried = self.carried[id].iter_mut().zip(&mut self.levels.values[id]);
            for ((&quantity, read), (carried, out)) in self.quantities.iter().zip(read).zip(carried) {
                let masks_changed =
                    take(read, &patch.taxels.areas, quantity, carried, out, &mut self.touched.fine);
                self.touched.all = masks_changed;
                carry(patch, steps, quantity, carried, out, &mut self.touched);
            }
        }
        &self.levels
    }
}

/// Carries the sums of one channel of a patch from the taxels to all levels: only those that
/// `touched` says, or all, then the areas too.
fn carry(
    patch: &PatchMap,
    steps: &[Gather],
    quantity: Quantity,
    carried: &mut Carried,
    out: &mut IdVec<LevelId, IdVec<VertexId, f64>>,
    touched: &mut Touched,
) {
    let masks_changed = touched.all;
    for (k, step) in steps.iter().enumerate() {
        let coarser = LevelId::new(k + 1);
        if masks_changed {
            let (fine, coarse) = two_levels(&mut carried.areas, k);
            step.apply(fine, coarse);
        }
        let (fine, coarse) = two_levels(&mut carried.sums, k);
        let (areas, out) = (&carried.areas[coarser], &mut out[coarser]);
        touched.all |= touched.fine.len() > fine.len() / FEW;
        if touched.all {
            step.apply(fine, coarse);
            let fields = out.iter_mut().zip(&*coarse).zip(areas);
            fields.for_each(|((out, &sum), &area)| *out = value(sum, area, quantity));
        } else if let Some(prolongation) = &patch.levels[LevelId::new(k)].level.from_coarser {
            touched.coarsen(prolongation);
            for &field in &touched.fine {
                coarse[field] = step.sum(field.index(), fine);
                out[field] = value(coarse[field], areas[field], quantity);
            }
        }
    }
}

/// Takes the readings in, lists the taxels whose reading changed, and says whether any got or lost
/// one.
fn take(
    read: &[f64],
    areas: &IdVec<VertexId, f64>,
    quantity: Quantity,
    carried: &mut Carried,
    out: &mut IdVec<LevelId, IdVec<VertexId, f64>>,
    changed: &mut Vec<VertexId>,
) -> bool {
    /// Taxels compared at once.
    const BLOCK: usize = 16;
    let finest = LevelId::new(0);
    let last = &mut *out[finest];
    assert_eq!(read.len(), last.len(), "one reading per taxel");
    let (sums, served) = (&mut *carried.sums[finest], &mut *carried.areas[finest]);
    changed.clear();
    let mut masks_changed = false;
    for begin in (0..read.len()).step_by(BLOCK) {
        let end = (begin + BLOCK).min(read.len());
        let pairs = read[begin..end].iter().zip(&last[begin..end]);
        if pairs.fold(0, |differ, (a, b)| differ | (a.to_bits() ^ b.to_bits())) == 0 {
            continue;
        }
        for at in begin..end {
            if read[at].to_bits() == last[at].to_bits() {
                continue;
            }
            let vertex = VertexId::new(at);
            let area = areas[vertex];
            let is_live = read[at].is_finite();
            masks_changed |= is_live != (served[at] > 0.0);
            (last[at], served[at]) = if is_live { (read[at], area) } else { (f64::NAN, 0.0) };
            sums[at] = match quantity {
                _ if !is_live => 0.0,
                Quantity::Intensive | Quantity::Direction => area * read[at],
                Quantity::Extensive => read[at],
            };
            changed.push(vertex);
        }
    }
    masks_changed
}

/// The value of a field from what it collected; NaN where it has no area with readings.
fn value(sum: f64, area: f64, quantity: Quantity) -> f64 {
    match quantity {
        // 0 / 0 is NaN.
        Quantity::Intensive | Quantity::Direction => sum / area,
        Quantity::Extensive if area > 0.0 => sum,
        Quantity::Extensive => f64::NAN,
    }
}

/// Level `k`, and the next coarser one to write to.
fn two_levels<T>(levels: &mut IdVec<LevelId, T>, k: usize) -> (&T, &mut T) {
    let (finer, coarser) = levels.split_at_mut(k + 1);
    (&finer[k], &mut coarser[0])
}

impl Touched {
    /// From the changed vertices of a level to the fields of the next one that collect from them.
    fn coarsen(&mut self, prolongation: &Prolongation) {
        self.coarse.clear();
        for &vertex in &self.fine {
            for (field, _) in prolongation.row(vertex) {
                if !std::mem::replace(&mut self.marks[field.index()], true) {
                    self.coarse.push(field);
                }
            }
        }
        self.coarse.iter().for_each(|field| self.marks[field.index()] = false);
        std::mem::swap(&mut self.fine, &mut self.coarse);
    }
}
