//! Layouts: what the numbers of a recording mean, where its file does not state it.
//!
//! A [`Layout`] is a JSON file that names the axes, the time, the channels with unit and sign, whether pressing raises or
//! lowers the number, the zero, and which cell is which taxel. [`Layout::draft`] makes one of what a file states
//! ([`StreamFacts`]), with null where a value is unknown. A [`Decoder`] turns the numbers of one stream into readings. Every
//! [`Statement`] about them has a source; what a file and a layout state differently is refused, not converted.

mod cells;
mod checks;
mod agree;
mod clock;
pub(in crate::io) mod columns;
mod draft;
mod facts;
mod keys;
mod rules;

use std::path::{Path, PathBuf};

use self::cells::Member;
use self::checks::{CHECKED_FRAMES, Moves};
use self::clock::{Fault, FrameClock};
use self::rules::{Press, ZeroRule, ZeroWord};
use crate::io::IoError;
use crate::io::file::invalid;
use crate::numeric::Csr;
use crate::signal::{Channel, Quantity, main_channel};
use crate::skin::TaxelId;

pub use columns::NamedColumns;
pub use facts::{KnownRest, Statement, StatementSource, StreamFacts, TimeUnit, Times};
pub use keys::Layout;

/// Most numbers that are kept to learn from.
const MAX_LEARNED: usize = 1 << 22;

/// Turns the numbers of one stream into readings, some frames at a time.
///
/// The first frames that it gets are those from which it learns the zero, if the layout takes it from them, and by which
/// it checks sign, zero and axes: pass at least [`Self::frames_to_learn`] of them at once, or all that there are.
#[derive(Debug, Clone)]
pub struct Decoder {
    file: PathBuf,
    layout_name: PathBuf,
    origin: StatementSource,
    ids: Vec<TaxelId>,
    channels: Vec<Channel>,
    /// Numbers of a frame.
    width: usize,
    /// Of each channel: the numbers of each taxel.
    sources: Vec<Csr<Number>>,
    /// Numbers of a frame that are no taxels, if known.
    others: Vec<usize>,
    /// Of the first channel that presses raise: its number, its sign and scale.
    pressed: (usize, f64),
    press: Press,
    zero: ZeroRule,
    missing: Vec<f64>,
    /// These as floats of 16 bits have them, until they count.
    missing_halves: Vec<f64>,
    clock: FrameClock,
    /// Axes of cells: of several, two may be swapped.
    cell_axes: usize,
    /// Of each channel, whether the file states that its zero is subtracted.
    tared: Vec<bool>,
    /// The episode whose first frames the zero was taken from.
    zero_of: Option<u64>,
    has_learned: bool,
    statements: Vec<Statement>,
    /// Readings without a number, and the first frame that has one.
    lost: u64,
    first_lost: Option<u64>,
}

/// A number of a frame that is part of a reading: `(x - zero) * factor`, averaged or summed with `weight`.
#[derive(Debug, Clone, Copy, Default)]
struct Number {
    place: u32,
    weight: f64,
    factor: f64,
    zero: f64,
}

impl Decoder {
    /// Puts a layout on a stream of `file`.
    ///
    /// # Errors
    /// If the file states something else than the layout: its axes, the shape of a frame, a unit, a rate.
    pub fn new(layout: &Layout, file: &Path, facts: &StreamFacts) -> Result<Self, IoError> {
        let axes: Vec<&str> = layout.frame_axes().collect();
        let width = layout.width_of(&axes, file, facts)?;
        let component = axes.iter().position(|axis| *axis == "component");
        let shape = facts.cells.iter().enumerate().filter(|(k, _)| Some(*k) != component);
        let shape: Vec<usize> = shape.map(|(_, size)| *size).collect();
        let (members, no_taxels) = layout.members(file, facts, &shape)?;
        let mut ids: Vec<TaxelId> = members.iter().map(|member| member.id).collect();
        ids.dedup();
        // Where the first component of a cell is among the numbers of a frame, and how far apart components are.
        let inner: usize = component.map_or(1, |axis| facts.cells[axis + 1..].iter().product());
        let components = component.map_or(1, |axis| facts.cells[axis]);
        let place = |cell: usize| cell / inner * inner * components + cell % inner;
        let place = |cell: usize| if component.is_some() { place(cell) } else { cell };
        let mut statements = facts.notes.clone();
        let mut sources = Vec::new();
        let is_taken = matches!(layout.zero, ZeroRule::Word(ZeroWord::Taken) | ZeroRule::Number(0.0));
        let mut tared = Vec::new();
        for (k, rule) in layout.rules.iter().enumerate() {
            let at = rule.component.unwrap_or(0);
            if let Some(other) = facts.names.iter().position(|name| *name == rule.name)
                && facts.names.get(at) != Some(&rule.name)
            {
                let found = format!("{} as component {other}", rule.name);
                return Err(invalid(file, "channels", found, layout.says(format!("component {at}"))));
            }
            if at >= components {
                let needed = layout.says(format!("component {at} of channel {}", rule.name));
                return Err(invalid(file, "axes", format!("{components} components"), needed));
            }
            let scale = layout.scale_of(k, file, facts, &mut statements)?;
            let is_of_touch = layout.channels[k].kind.is_of_touch();
            // One number is of all components.
            let is_tared =
                is_of_touch && facts.tared.get(if facts.tared.len() == 1 { 0 } else { at }) == Some(&true);
            if is_tared && !is_taken {
                let of = if facts.tared.len() == 1 { String::new() } else { format!(" of component {at}") };
                let found = format!("`is_tared` 1{of}: zero is subtracted already");
                return Err(invalid(file, "zero", found, layout.says(layout.zero.describe())));
            }
            tared.push(is_tared);
            let sign = if layout.press == Press::Lowers && !rule.signed && is_of_touch { -1.0 } else { 1.0 };
            let is_amount = layout.channels[k].quantity == Quantity::Extensive;
            sources.push(numbers(&members, &ids, is_amount, |member| Number {
                place: u32::try_from(place(member.cell) + at * inner).unwrap_or(u32::MAX),
                weight: member.weight,
                factor: sign * scale * member.gain,
                zero: 0.0,
            }));
        }
        let others = match component {
            Some(_) => Vec::new(),
            None => {
                let mut is_taxel = vec![false; width];
                members.iter().for_each(|member| is_taxel[member.cell] = true);
                // The table says of these that they are none.
                no_taxels.iter().for_each(|&cell| is_taxel[cell] = true);
                (0..width).filter(|&cell| !is_taxel[cell]).collect()
            }
        };
        let pressed = main_channel(layout.channels.iter().map(|channel| channel.kind));
        let scale = layout.rules[pressed].scale.unwrap_or(1.0);
        let mut decoder = Self {
            file: file.into(),
            layout_name: layout.name.clone(),
            origin: layout.origin,
            channels: layout.channels.clone(),
            width,
            sources,
            others,
            pressed: (pressed, scale),
            tared,
            press: layout.press,
            zero: layout.zero.clone(),
            missing: layout.missing_numbers(),
            missing_halves: layout.missing_halves(),
            clock: FrameClock::new(layout.time.clone(), facts),
            cell_axes: shape.len(),
            zero_of: None,
            has_learned: false,
            statements,
            lost: 0,
            first_lost: None,
            ids,
        };
        if facts.has_halves {
            decoder.take_halves();
        }
        decoder.set_zero(facts)?;
        layout.check_time(file, facts)?;
        let taxels = format!("{} of {} cells", decoder.ids.len(), shape.iter().product::<usize>());
        decoder.statements.extend(layout.statements(facts, taxels));
        Ok(decoder)
    }

    /// The taxels, in ascending order of their ids.
    pub fn ids(&self) -> &[TaxelId] {
        &self.ids
    }

    /// The channels.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// What is known of readings where nothing touches: pressures and forces are about 0 there, since their zero is stated,
    /// and the threshold is that of the file. Nothing is known of counts, whose zero differs from taxel to taxel, unless the
    /// file states that it is subtracted.
    pub fn rest(&self, facts: &StreamFacts) -> KnownRest {
        let (channel, scale) = self.pressed;
        let is_zero = |c: &Channel| c.kind.is_of_touch() && c.newtons().is_some();
        let is_zero: Vec<bool> =
            self.channels.iter().zip(&self.tared).map(|(c, is_tared)| *is_tared || is_zero(c)).collect();
        let zero = if let ZeroRule::Number(zero) = self.zero { zero } else { 0.0 };
        let threshold = facts.threshold.map(|x| (x - zero) * scale.abs());
        let threshold = threshold.filter(|x| *x > 0.0 && is_zero[channel]);
        KnownRest { is_zero, threshold }
    }

    /// How many frames it has to see at first.
    pub fn frames_to_learn(&self) -> usize {
        let checked = CHECKED_FRAMES.min(MAX_LEARNED / self.width).max(1);
        match self.zero {
            ZeroRule::First { first } => checked.max(first),
            _ => checked,
        }
    }

    /// What is known about the readings; frames add to it.
    pub fn statements(&self) -> Vec<Statement> {
        let mut all = self.statements.clone();
        if let Some(frame) = self.first_lost {
            let value = format!("{} readings, the first in frame {frame}; they stay missing", self.lost);
            all.push(Statement::new("missing", value, StatementSource::Checked));
        }
        all.extend(self.clock.statements());
        all
    }

    /// Takes numbers that stand for no reading as floats of 16 bits have them.
    pub fn take_halves(&mut self) {
        self.missing.append(&mut self.missing_halves);
    }

    /// As [`Self::decode_beside`], without zeros beside the frames.
    ///
    /// # Errors
    /// As [`Self::decode_beside`].
    pub fn decode<T: Copy + Into<f64> + FromF64>(
        &mut self,
        raw: &[T],
        times: Times<'_>,
        episode: u64,
        values: &mut Vec<T>,
        seconds: &mut Vec<f64>,
    ) -> Result<(), IoError> {
        self.decode_beside(raw, &[], times, episode, values, seconds)
    }

    /// Appends the readings and the seconds of some frames: channel `c` of taxel `n` of a frame is `[c * taxels + n]`.
    /// All frames are of one episode; a later call may be of a later one, whose times may begin again, and whose first frames
    /// are its zero where the layout says so. `zeros` are the numbers at rest, where the layout takes them from a stream: of one
    /// frame for all of these, or of each frame its own; none: those of [`StreamFacts::zero`].
    ///
    /// # Errors
    /// If there are too few numbers, zeros or times, times do not ascend or have another unit, or the first frames contradict
    /// the layout.
    pub fn decode_beside<T: Copy + Into<f64> + FromF64>(
        &mut self,
        raw: &[T],
        zeros: &[f64],
        times: Times<'_>,
        episode: u64,
        values: &mut Vec<T>,
        seconds: &mut Vec<f64>,
    ) -> Result<(), IoError> {
        if !raw.len().is_multiple_of(self.width) {
            let found = format!("{} numbers", raw.len());
            return Err(self.invalid("frames", found, format!("{} for each frame", self.width)));
        }
        let frames = raw.len() / self.width;
        if !zeros.is_empty() && zeros.len() != self.width && zeros.len() != raw.len() {
            let found = format!("{} numbers in the stream of the zero", zeros.len());
            let needed =
                format!("{}, one for each of a frame, or as many for each of {frames} frames", self.width);
            return Err(self.invalid("zero", found, needed));
        }
        let before = self.clock.frames();
        let fault = |[element, found, needed]: Fault| invalid(&self.file, element, found, needed);
        self.clock.seconds(times, frames, episode, seconds).map_err(fault)?;
        if frames == 0 {
            return Ok(());
        }
        let start = values.len();
        if self.zero_of.replace(episode) != Some(episode) {
            self.learn_zero(raw)?;
        }
        values.reserve(frames * self.sources.len() * self.ids.len());
        // A row of zeros for each frame; of one row all frames take it.
        let rows = zeros.len() / self.width;
        for (k, frame) in raw.chunks_exact(self.width).enumerate() {
            let zeros = (rows > 0).then(|| &zeros[k.min(rows - 1) * self.width..][..self.width]);
            let lost = self.decode_frame(frame, zeros, values);
            if lost > 0 {
                self.lost += lost as u64;
                self.first_lost.get_or_insert(before + k as u64);
            }
        }
        if !std::mem::replace(&mut self.has_learned, true) {
            self.check(raw, &values[start..])?;
        }
        Ok(())
    }

    /// Whether a number of the file stands for no reading: infinite ones are missing, too.
    fn is_missing(&self, x: f64) -> bool {
        !x.is_finite() || self.missing.contains(&x)
    }

    /// Appends the readings of a frame, and returns how many are missing.
    fn decode_frame<T: Copy + Into<f64> + FromF64>(
        &self,
        frame: &[T],
        zeros: Option<&[f64]>,
        values: &mut Vec<T>,
    ) -> usize {
        let mut lost = 0;
        for (numbers, channel) in self.sources.iter().zip(&self.channels) {
            let zeros = zeros.filter(|_| channel.kind.is_of_touch());
            let read = |number: &Number| {
                let place = number.place as usize;
                let x: f64 = frame[place].into();
                let zero = match zeros {
                    Some(zeros) if self.is_missing(zeros[place]) => f64::NAN,
                    Some(zeros) => zeros[place],
                    None => number.zero,
                };
                // No zero has a sign: 0.0 is added.
                if self.is_missing(x) { f64::NAN } else { (x - zero) * number.factor + 0.0 }
            };
            let is_amount = channel.quantity == Quantity::Extensive;
            values.extend(numbers.iter().map(|numbers| {
                let x = match numbers {
                    [one] if !is_amount => read(one),
                    several => {
                        let known = several.iter().map(|n| (read(n), n.weight)).filter(|(x, _)| !x.is_nan());
                        let [sum, weight] =
                            known.fold([0.0, 0.0], |[sum, all], (x, w)| [sum + w * x, all + w]);
                        // 0 / 0 is NaN.
                        if is_amount && weight > 0.0 { sum } else { sum / weight }
                    }
                };
                lost += usize::from(x.is_nan());
                T::from_f64(x)
            }));
        }
        lost
    }

    /// Takes the zero that the layout or another stream gives.
    fn set_zero(&mut self, facts: &StreamFacts) -> Result<(), IoError> {
        match (&self.zero, &facts.zero) {
            (ZeroRule::Stream { stream }, None) => {
                let (found, needed) = (format!("no stream {stream}"), "the stream of the zero");
                Err(self.invalid("zero", found, needed.into()))
            }
            (ZeroRule::Stream { .. }, Some(zeros)) if zeros.len() != self.width => {
                let found = format!("{} numbers in the stream of the zero", zeros.len());
                Err(self.invalid("zero", found, format!("{}, one for each of a frame", self.width)))
            }
            (ZeroRule::Stream { .. }, Some(zeros)) => {
                let zeros: Vec<f64> =
                    zeros.iter().map(|&zero| if self.is_missing(zero) { f64::NAN } else { zero }).collect();
                self.each_number(|number| number.zero = zeros[number.place as usize]);
                Ok(())
            }
            (ZeroRule::Number(zero), _) => {
                let zero = *zero;
                self.each_number(|number| number.zero = zero);
                Ok(())
            }
            (ZeroRule::First { first }, _) if first.saturating_mul(self.width) > 4 * MAX_LEARNED => {
                let needed = format!("at most {} frames", 4 * MAX_LEARNED / self.width);
                Err(self.invalid("zero", format!("first {first}"), needed))
            }
            _ => Ok(()),
        }
    }

    /// The numbers of the channels that have a zero: those of touch.
    fn each_number(&mut self, mut change: impl FnMut(&mut Number)) {
        let of_touch =
            self.sources.iter_mut().zip(&self.channels).filter(|(_, channel)| channel.kind.is_of_touch());
        of_touch.for_each(|(numbers, _)| numbers.items_mut().iter_mut().for_each(&mut change));
    }

    /// Takes the mean of the first frames for the zero, if the layout does.
    fn learn_zero<T: Copy + Into<f64>>(&mut self, raw: &[T]) -> Result<(), IoError> {
        let ZeroRule::First { first } = self.zero else { return Ok(()) };
        let width = self.width;
        if raw.len() / width < first {
            let found = format!("{} frames", raw.len() / width);
            return Err(self.invalid("zero", found, format!("the first {first}, as the layout states")));
        }
        let missing = self.missing.clone();
        let mut without = 0;
        self.each_number(|number| {
            let numbers =
                raw.chunks_exact(width).take(first).map(|frame| frame[number.place as usize].into());
            let known = numbers.filter(|x: &f64| x.is_finite() && !missing.contains(x));
            let [sum, count] = known.fold([0.0, 0.0], |[sum, count], x| [sum + x, count + 1.0]);
            number.zero = sum / count;
            without += usize::from(count == 0.0);
        });
        if without > 0 {
            let value = format!(
                "{without} cells without a number in the first {first} frames: they have no zero, and their readings stay missing"
            );
            self.statements.push(Statement::new("zero", value, StatementSource::Checked));
        }
        Ok(())
    }

    /// Compares the first frames with what is stated.
    fn check<T: Copy + Into<f64>>(&mut self, raw: &[T], values: &[T]) -> Result<(), IoError> {
        let (channel, scale) = self.pressed;
        let (taxels, channels) = (self.ids.len(), self.sources.len());
        let frames = (raw.len() / self.width).min(CHECKED_FRAMES.min(MAX_LEARNED / self.width).max(1));
        let series = |numbers: &[T], width: usize, place: usize| -> Vec<f64> {
            let frames = numbers.chunks_exact(width).take(frames);
            frames.map(|frame| frame[place].into()).filter(|x: &f64| x.is_finite()).collect()
        };
        let taxel = |n| series(values, taxels * channels, channel * taxels + n);
        let zero = if let ZeroRule::Number(zero) = self.zero { zero } else { 0.0 };
        let moves = Moves::of(&(0..taxels).map(taxel).collect::<Vec<_>>(), zero * scale);
        if let Some(found) = moves.against_zero().filter(|_| zero != 0.0) {
            let needed = format!("another `press` or `zero` in {}", self.layout_name.display());
            return Err(self.invalid("zero", format!("{found}, with the zero {zero}"), needed));
        }
        let others: Vec<_> = self.others.iter().map(|&place| series(raw, self.width, place)).collect();
        let moving = moves.moving(&others, scale);
        let name = self.layout_name.display();
        if Moves::is_enough(moving) && self.cell_axes > 1 {
            let found = format!("{moving} cells that move and are no taxels in {name}");
            let needed = "the axes in the order in which the file has them, or a row without `taxel_id` in the table for \
                          each cell that moves and is no taxel";
            return Err(self.invalid("axes", found, needed.into()));
        }
        if Moves::is_enough(moving) {
            let value = format!("{moving} cells that move are none in {name}, and are not read");
            self.statements.push(Statement::new("taxels", value, StatementSource::Checked));
        }
        let press = self.press.name();
        let remark = moves.sign_remark(press).filter(|_| self.origin == StatementSource::Layout);
        self.statements.extend(remark.map(|text| Statement::new("press", text, StatementSource::Checked)));
        Ok(())
    }

    fn invalid(&self, element: &str, found: String, needed: String) -> IoError {
        invalid(&self.file, element, found, needed)
    }
}

/// The numbers of each taxel: those of an amount are shared by the taxels of a cell.
fn numbers(
    members: &[Member],
    ids: &[TaxelId],
    is_amount: bool,
    number: impl Fn(&Member) -> Number,
) -> Csr<Number> {
    let mut weights = std::collections::HashMap::new();
    if is_amount {
        members.iter().for_each(|member| *weights.entry(member.cell).or_insert(0.0) += member.weight);
    }
    let mut taxel = 0;
    let pairs = members.iter().map(|member| {
        let mut number = number(member);
        if let Some(all) = weights.get(&member.cell) {
            number.weight /= all;
        }
        (member.id, number)
    });
    let pairs: Vec<(usize, Number)> = pairs
        .map(|(id, number)| {
            while ids[taxel] != id {
                taxel += 1;
            }
            (taxel, number)
        })
        .collect();
    Csr::from_pairs(ids.len(), pairs.iter().copied())
}

/// A number that a reading is narrowed to.
pub trait FromF64 {
    /// The nearest number.
    fn from_f64(x: f64) -> Self;
}

impl FromF64 for f64 {
    fn from_f64(x: f64) -> Self {
        x
    }
}

impl FromF64 for f32 {
    #[expect(clippy::cast_possible_truncation, reason = "readings of 32 bits stay readings of 32 bits")]
    fn from_f64(x: f64) -> Self {
        x as Self
    }
}
