//! Which column of a recording is of which taxel, if nobody knows: columns that are alike are neighbours on the skin.
//!
//! Two passes over recordings of separate touches ([`ColumnOrder`]), each a set of sums. The first one estimates noise and
//! threshold of each column; the second one how alike the signals of each two columns are (`likeness`). Then:
//!
//! 1. `surface`: the lengths of paths between taxels along the skin.
//! 2. `embed`: the map of the columns from their signals, and the same of the taxels, both in the plane.
//! 3. `align`: turns, mirror images and bends of the one onto the other; the best that differ go on.
//! 4. `matching`: of assignments near each of them, the one whose likeness fits the distances best: the largest
//!    objective, the cosine of the likeness and of `exp(-d^2 / 2 l^2)` over all pairs.
//!
//! `signal_map` is step 2 for taxels that are known: the map from signals, to compare with the true one.
//!
//! An order below [`LEAST_OBJECTIVE`] is refused. So is a skin that looks alike from two sides: two orders that differ
//! explain the signals alike, and only known columns decide. Columns that nothing touched have no taxel.
//!
//! *Heuristic*; measured on simulated touches of a cover of 642 taxels, `tests/library/order.rs` and
//! `docs/recordings.md`. What it does not guarantee: with few touches of small bodies the search may end at a poor order,
//! which its objective shows.

mod align;
mod embed;
mod error;
mod likeness;
mod matching;
mod signal_map;
mod surface;

use glam::DVec2;

use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::parallel::par_map;
use crate::run::Run;
use crate::signal::health::around::readings;
use crate::signal::health::survey::Survey;
use crate::signal::order::align::align;
use crate::signal::order::embed::{embed, scale};
use crate::signal::order::likeness::{Likeness, Sums};
use crate::signal::order::matching::{Answer, Matching};
use crate::signal::order::surface::{MOST_TAXELS, Surface};
use crate::signal::{Frame, SignalError};
use crate::skin::{PatchId, TaxelId};

pub use error::OrderError;
pub use signal_map::SignalMap;

/// An order is refused below this objective. Simulated touches: above 0.88 every one was right, below 0.85 none.
pub const LEAST_OBJECTIVE: f64 = 0.88;

/// Two orders whose objectives differ by less explain the signals alike: the search itself is off by up to 0.01, and orders
/// that are wrong were 0.05 lower. They differ if columns are this many spacings apart in
/// the mean.
const ALIKE: f64 = 0.02;
const DIFFERENT: f64 = 2.0;

/// How far known columns may be from their taxels before they are put there, in spacings.
const NEAR: f64 = 2.0;

/// Columns that have to be touched, and the share of the taxels whose columns have to be connected.
const LEAST_COLUMNS: usize = 12;
const LEAST_SHARE: f64 = 0.7;

/// Finds the order of columns by recordings, which are passed twice;
/// `recording::find_order` does that.
#[derive(Debug, Clone)]
pub struct ColumnOrder {
    channel: usize,
    threshold: Option<f64>,
    columns: usize,
    pass: usize,
    survey: Survey,
    sums: Sums,
}

/// The order of columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Each column of the recordings.
    pub columns: Vec<OrderedColumn>,
    /// How well distances on the skin explain the likeness of signals, from 0 to 1.
    pub objective: f64,
    /// The same of the best order that differs from it; known columns may exclude that one.
    pub runner_up: Option<f64>,
    /// Taxels that have no column.
    pub without_column: usize,
    /// Separate touches.
    pub touches: usize,
    /// Frames, also those that were left out.
    pub frames: usize,
    /// Frames that were left out since too many columns were touched.
    pub crowded: usize,
    /// A reading above it, less its zero, is a touch; in the unit of the readings.
    pub threshold: f64,
}

/// A column, and the taxel that it is of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrderedColumn {
    /// Its taxel: where it is, and its id; `None` if too few touches reached the column, or it is faulty.
    pub taxel: Option<(PatchId, VertexId, TaxelId)>,
    /// How well its signals fit those of its neighbourhood, from 0 to 1; NaN without signals.
    pub support: f64,
    /// Whether the taxel was known.
    pub is_known: bool,
}

impl Order {
    /// Columns that have a taxel.
    pub fn placed(&self) -> usize {
        self.columns.iter().filter(|column| column.taxel.is_some()).count()
    }

    /// The id of the taxel of each column; a placeholder, which no taxel has, where it has none.
    pub fn ids(&self) -> Vec<TaxelId> {
        let id = |column: &OrderedColumn| column.taxel.map_or(TaxelId::PLACEHOLDERS[1], |(.., id)| id);
        self.columns.iter().map(id).collect()
    }
}

impl ColumnOrder {
    /// How often the recordings are passed.
    pub const PASSES: usize = 2;

    /// Finds the order of this many columns. A reading above the threshold, less its zero, is a touch; `None`: four
    /// times the noise.
    ///
    /// # Errors
    /// [`OrderError::TooLarge`], and [`SignalError::Option`] if the threshold is not positive.
    pub fn new(columns: usize, threshold: Option<f64>) -> Result<Self, OrderError> {
        if let Some(threshold) = threshold.filter(|x| !(x.is_finite() && *x > 0.0)) {
            return Err(
                SignalError::option("the threshold of touches", threshold, "a positive number").into()
            );
        }
        if columns > MOST_TAXELS {
            return Err(OrderError::TooLarge { what: "columns", found: columns, most: MOST_TAXELS });
        }
        let (survey, sums) = (Survey::new(columns), Sums::new(columns));
        Ok(Self { channel: 0, threshold, columns, pass: 0, survey, sums })
    }

    /// Begins a recording of which one channel counts.
    pub fn begin_recording(&mut self, channel: usize) {
        self.channel = channel;
    }

    /// Sees the next frame of a recording: in the first pass as it was read, then less its zeros.
    ///
    /// # Panics
    /// If it does not have one value for each column, or not the channel.
    pub fn see(&mut self, frame: &Frame) {
        let x = readings(frame, self.channel);
        match self.pass {
            0 => self.survey.see(x),
            _ => self.sums.see(x, &self.survey),
        }
    }

    /// Ends a recording.
    pub fn end_recording(&mut self) {
        match self.pass {
            0 => self.survey.end_recording(),
            _ => self.sums.end_recording(),
        }
    }

    /// Ends a pass: the next recording is the first one again.
    pub fn end_pass(&mut self) {
        if self.pass == 0 {
            self.survey.settle(&vec![true; self.columns], self.threshold);
        }
        self.pass += 1;
    }

    /// The order of the columns on the taxels of a map; some columns may be known.
    ///
    /// # Errors
    /// [`OrderError`]: too few touches, a skin that is symmetric to signals, or known columns that do not fit.
    pub fn solve(
        &self,
        map: &SkinMap,
        known: &[(usize, TaxelId)],
        run: Run<'_>,
    ) -> Result<Order, OrderError> {
        let all = Surface::new(map)?;
        let known = self.known(known, &all)?;
        let touched = self.touched()?;
        let embedding = embed(&touched);
        let likeness = touched.select(&embedding.members);
        let number = |column: usize| likeness.columns.binary_search(&column).ok();
        // The taxels of known columns that are not connected are taken.
        let taken: Vec<usize> =
            known.iter().filter(|(column, _)| number(*column).is_none()).map(|(_, taxel)| *taxel).collect();
        let surface = all.without(&taken);
        if touched.len() > all.len() || likeness.len() > surface.len() {
            let (found, taxels) = (touched.len().max(likeness.len() + taken.len()), all.len());
            return Err(OrderError::MoreColumns { found, taxels });
        }
        let found = embedding.members.len();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count")]
        let needed = ((LEAST_SHARE * all.len() as f64).ceil() as usize).max(LEAST_COLUMNS);
        if found < needed {
            let (columns, taxels, touches) = (self.columns, all.len(), self.sums.touches);
            return Err(OrderError::Unconnected { found, columns, taxels, touches, needed });
        }
        let target = |taxel: usize| surface.ids.iter().position(|id| *id == all.ids[taxel]);
        let pinned: Vec<(usize, usize)> =
            known.iter().filter_map(|&(column, taxel)| Some((number(column)?, target(taxel)?))).collect();
        let targets = scale(&surface.distances, surface.len());
        let starts = align(&centred(embedding.points), &centred(targets.clone()), &pinned, run)?;
        let centred_targets = centred(targets);
        let first = starts.first().map_or(&[][..], |start| &start.taxels);
        let matching = Matching::new(&likeness, &surface, &centred_targets, first);
        let answers = par_map(&starts, |start| matching.solve(start, run));
        let answers = answers.into_iter().collect::<Result<Vec<_>, _>>()?;
        let (mut best, runner_up) = self.choose(answers, &pinned, &likeness, &surface)?;
        put_known(&mut best.taxels, &pinned);
        best.objective = matching.objective(&best.taxels);
        if best.objective < LEAST_OBJECTIVE {
            let (objective, needed, touches) = (best.objective, LEAST_OBJECTIVE, self.sums.touches);
            return Err(OrderError::Poor { objective, needed, touches });
        }
        let mut columns =
            vec![OrderedColumn { taxel: None, support: f64::NAN, is_known: false }; self.columns];
        let place =
            |surface: &Surface, k: usize| Some((surface.taxels[k].0, surface.taxels[k].1, surface.ids[k]));
        let supports = matching.supports(&best.taxels);
        for ((&column, &taxel), support) in likeness.columns.iter().zip(&best.taxels).zip(supports) {
            (columns[column].taxel, columns[column].support) = (place(&surface, taxel), support);
        }
        for &(column, taxel) in &known {
            (columns[column].taxel, columns[column].is_known) = (place(&all, taxel), true);
        }
        let placed = columns.iter().filter(|column| column.taxel.is_some()).count();
        Ok(Order {
            columns,
            objective: best.objective,
            runner_up,
            without_column: all.len() - placed,
            touches: self.sums.touches,
            frames: self.sums.frames,
            crowded: self.sums.crowded,
            threshold: self.survey.threshold,
        })
    }

    /// Where signals put the taxels of each patch, if the columns are the taxels of a map, patch after patch; `None` of a
    /// patch of which fewer than four are touched.
    ///
    /// # Errors
    /// [`OrderError::NoTouch`].
    ///
    /// # Panics
    /// If the map has another number of taxels.
    pub fn signal_maps(&self, map: &SkinMap) -> Result<IdVec<PatchId, Option<SignalMap>>, OrderError> {
        assert_eq!(map.patches.iter().map(|patch| patch.taxels.ids.len()).sum::<usize>(), self.columns);
        Ok(signal_map::signal_maps(map, &self.touched()?))
    }

    /// The likeness of the columns that are touched, if they are some.
    fn touched(&self) -> Result<Likeness, OrderError> {
        let likeness = self.sums.likeness();
        if likeness.len() >= LEAST_COLUMNS {
            return Ok(likeness);
        }
        Err(OrderError::NoTouch {
            found: likeness.len(),
            columns: self.columns,
            frames: self.sums.frames,
            crowded: self.sums.crowded,
            needed: LEAST_COLUMNS,
            threshold: self.survey.threshold,
        })
    }

    /// Known columns with the numbers of their taxels, each once.
    fn known(
        &self,
        known: &[(usize, TaxelId)],
        surface: &Surface,
    ) -> Result<Vec<(usize, usize)>, OrderError> {
        let mut all: Vec<(usize, usize)> = Vec::with_capacity(known.len());
        for &(column, taxel) in known {
            if column >= self.columns {
                return Err(OrderError::KnownColumn { column, columns: self.columns });
            }
            let number =
                surface.taxel(taxel).map_err(|count| OrderError::KnownTaxel { column, taxel, count })?;
            if let Some(&(_, first)) = all.iter().find(|(other, _)| *other == column) {
                let first = surface.ids[first];
                return Err(OrderError::KnownColumnTwice { column, first, second: taxel });
            }
            if let Some(&(other, _)) = all.iter().find(|(_, other)| *other == number) {
                return Err(OrderError::KnownTwice { column, other, taxel });
            }
            all.push((column, number));
        }
        Ok(all)
    }

    /// The best answer that agrees with the known columns, and the objective of the best one that differs from it.
    fn choose(
        &self,
        mut answers: Vec<Answer>,
        known: &[(usize, usize)],
        likeness: &Likeness,
        surface: &Surface,
    ) -> Result<(Answer, Option<f64>), OrderError> {
        answers.sort_by(|a, b| b.objective.total_cmp(&a.objective));
        let touches = self.sums.touches;
        let poor = |objective: f64| OrderError::Poor { objective, needed: LEAST_OBJECTIVE, touches };
        // How far the worst known column is from its taxel, in spacings.
        let worst = |answer: &Answer| {
            let far = |&(column, taxel): &(usize, usize)| {
                (surface.distance(answer.taxels[column], taxel) / surface.spacing, column, taxel)
            };
            known.iter().map(far).max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let agrees = |answer: &Answer| worst(answer).is_none_or(|(far, ..)| far <= NEAR);
        let Some(highest) = answers.first() else { return Err(poor(0.0)) };
        if highest.objective < LEAST_OBJECTIVE {
            return Err(poor(highest.objective));
        }
        let is_good = |answer: &&Answer| answer.objective >= LEAST_OBJECTIVE;
        let Some(best) = answers.iter().filter(is_good).find(|answer| agrees(answer)) else {
            let nearest = answers.iter().filter(is_good).filter_map(|answer| Some((worst(answer)?, answer)));
            let nearest = nearest.min_by(|a, b| a.0.0.total_cmp(&b.0.0));
            return Err(nearest.map_or(poor(0.0), |((spacings, column, taxel), answer)| {
                let (known, found) = (surface.ids[taxel], surface.ids[answer.taxels[column]]);
                OrderError::Contradiction { column: likeness.columns[column], known, found, spacings }
            }));
        };
        let apart = |other: &Answer| {
            let far = best.taxels.iter().zip(&other.taxels).map(|(&a, &b)| surface.distance(a, b));
            far.sum::<f64>() / (surface.spacing * best.taxels.len() as f64)
        };
        let others: Vec<&Answer> = answers.iter().filter(|other| apart(other) > DIFFERENT).collect();
        let twin = others.iter().find(|other| agrees(other) && best.objective - other.objective < ALIKE);
        if let Some(twin) = twin {
            let objectives = [best.objective, twin.objective];
            return Err(OrderError::Symmetric { objectives, taxels: distinguishing(best, twin, surface) });
        }
        let runner_up = others.first().map(|other| other.objective);
        Ok((best.clone(), runner_up))
    }
}

/// Three taxels far apart whose columns differ between two answers.
fn distinguishing(best: &Answer, twin: &Answer, surface: &Surface) -> [TaxelId; 3] {
    let moved: Vec<f64> =
        best.taxels.iter().zip(&twin.taxels).map(|(&a, &b)| surface.distance(a, b)).collect();
    let mut chosen: Vec<usize> = Vec::new();
    for _ in 0..3 {
        let worth = |k: usize| {
            let away = chosen.iter().map(|&other| surface.distance(best.taxels[k], best.taxels[other]));
            away.fold(moved[k], f64::min)
        };
        // A taxel that shares its id cannot be named.
        let named = (0..moved.len()).filter(|&k| surface.taxel(surface.ids[best.taxels[k]]).is_ok());
        chosen.extend(named.max_by(|&a, &b| worth(a).total_cmp(&worth(b))));
    }
    std::array::from_fn(|k| {
        chosen.get(k).map_or(TaxelId::default(), |&column| surface.ids[best.taxels[column]])
    })
}

/// Puts known columns on their taxels; columns that are there take their places.
fn put_known(taxels: &mut [usize], known: &[(usize, usize)]) {
    for &(column, taxel) in known {
        let before = std::mem::replace(&mut taxels[column], taxel);
        let other = (0..taxels.len()).find(|&k| k != column && taxels[k] == taxel);
        if let Some(other) = other {
            taxels[other] = before;
        }
    }
}

/// Points with the mean 0.
fn centred(mut points: Vec<DVec2>) -> Vec<DVec2> {
    let mean = points.iter().sum::<DVec2>() / points.len().max(1) as f64;
    points.iter_mut().for_each(|x| *x -= mean);
    points
}
