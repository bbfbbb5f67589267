//! Pictures of readings: one channel of one frame on every level, on the map and on the skin.
//!
//! Values are linear between the vertices of each level, as in tactile images; where values are unknown the
//! skin is hatched in greys, which no scale has.

use std::collections::BTreeSet;

use crate::body::FieldLevel;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::numeric::second_digit;
use crate::plot::colour::Scale;
use crate::plot::draw::Panel;
use crate::plot::layout::{Caption, lay_out, printable, signed, slots, ticks};
use crate::plot::patch_view::PatchView;
use crate::plot::picture::Picture;
use crate::plot::plot_map::{check_viewpoint, choose, choose_levels, title};
use crate::plot::{PlotError, PlotOptions};
use crate::pyramid::LevelId;
use crate::signal::{CarryDown, Channel, LevelFrame, Quantity};
use crate::skin::PatchId;

/// Draws the channel at `shown` of a frame with these channels: levels side by side, all at one scale and
/// in one scale of colours.
///
/// Extensive channels are drawn per area of skin, so that levels can be compared. A range on both
/// sides of zero has a diverging scale; any other has viridis. Dots are taxels or the fields'
/// centres, lines the level's triangles unless they are shorter than 12 pixels; a taxel without a
/// reading is hatched. With [`PlotOptions::space`] a patch has two rows:
/// the skin in space with the values of each level, and the maps.
///
/// # Errors
/// If there is no such patch, level or channel, the range does not rise, the frame is not one of
/// the map, the map is not valid, the viewpoint is not a direction, or the picture is narrower than
/// its panels need or larger than 16384 pixels a side.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     plot::{PlotOptions, plot_frame},
///     signal::{Channel, Frame, Restrictor},
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let channels = [Channel::new("pressure", "Pa")?];
/// let mut frame = Frame::new(&map, 1);
/// for reading in frame.values.iter_mut().flatten().flat_map(|channel| channel.iter_mut().skip(1)) {
///     *reading = 5e3;
/// }
/// let mut restrictor = Restrictor::new(&map, &channels);
/// let frame = restrictor.restrict(&frame);
/// let options = PlotOptions { range: Some([0.0, 20e3]), ..PlotOptions::default() };
/// let svg = plot_frame(&map, frame, &channels, 0, &options)?.to_svg();
/// assert!(svg.contains("pressure, kPa") && svg.contains("no reading"));
/// # Ok::<(), dermatome::Error>(())
/// ```
pub fn plot_frame(
    map: &SkinMap,
    frame: &LevelFrame,
    channels: &[Channel],
    shown: usize,
    options: &PlotOptions,
) -> Result<Picture, PlotError> {
    FramePlotter::new(map, channels, shown, options)?.draw(frame)
}

/// Draws many frames of one map as [`plot_frame`] does; everything that does not depend on the frame is
/// checked and prepared once.
pub struct FramePlotter<'a> {
    map: &'a SkinMap,
    channel: &'a Channel,
    shown: usize,
    options: &'a PlotOptions,
    patches: Vec<(PatchId, PatchView<'a>)>,
    levels: Vec<LevelId>,
    fields: Vec<Fields>,
}

/// A level without a mesh, and its name.
struct Fields {
    level: LevelId,
    name: String,
    down: CarryDown,
    /// The fields that each patch has taxels of.
    of_patches: IdVec<PatchId, BTreeSet<VertexId>>,
}

impl Fields {
    fn new(map: &SkinMap, at: FieldLevel) -> Result<Self, PlotError> {
        let Some((_, name)) = map.field_levels().find(|(known, _)| *known == at) else {
            return Err(PlotError::UnknownFieldLevel { level: at.level, count: map.field_levels().count() });
        };
        let down = CarryDown::new(map, at);
        let of_patches = map.patches.ids().map(|patch| down.fields_of(patch)).collect();
        Ok(Self { level: at.level, name, down, of_patches })
    }
}

impl<'a> FramePlotter<'a> {
    /// A plotter of frames with these channels, which draws the one at `shown`.
    ///
    /// # Errors
    /// As [`plot_frame`], except those of frames and of the size of the picture.
    pub fn new(
        map: &'a SkinMap,
        channels: &'a [Channel],
        shown: usize,
        options: &'a PlotOptions,
    ) -> Result<Self, PlotError> {
        let [low, high] = options.range.unwrap_or([0.0, 1.0]);
        let rises = low.is_finite() && high.is_finite() && low < high;
        let Some(channel) = channels.get(shown).filter(|_| rises) else {
            return Err(PlotError::Channel { channel: shown, channels: channels.len(), range: [low, high] });
        };
        let chosen = choose(&map.patches, |patch| &patch.name, &options.patches)?;
        let levels = match &options.levels[..] {
            [] if !options.field_levels.is_empty() => Vec::new(),
            levels => choose_levels(&chosen, levels)?,
        };
        options.space.map_or(Ok(()), check_viewpoint)?;
        map.validate()?;
        let view = |patch: &'a PatchMap| {
            let id = map.patches.enumerate().find(|(_, p)| std::ptr::eq(*p, patch)).map(|(id, _)| id);
            Ok((id.ok_or(PlotError::Empty)?, PatchView::of_map(map, patch)?))
        };
        let patches = chosen.into_iter().map(view).collect::<Result<_, PlotError>>()?;
        // Their rows are read, so the map is valid.
        let fields = options.field_levels.iter().map(|&at| Fields::new(map, at)).collect::<Result<_, _>>()?;
        Ok(Self { map, channel, shown, options, patches, levels, fields })
    }

    /// Draws a frame.
    ///
    /// # Errors
    /// If the frame is not one of the map, or the picture is narrower than its panels need or larger than 16384 pixels
    /// a side.
    pub fn draw(&self, frame: &LevelFrame) -> Result<Picture, PlotError> {
        let Self { channel, options, .. } = *self;
        let about = about(channel);
        let mut rows = Vec::new();
        for (patch, view) in &self.patches {
            let of_level = |&level: &LevelId| self.densities(frame, *patch, level);
            let mut drawn: Vec<_> = self.levels.iter().map(of_level).collect::<Result<_, _>>()?;
            for fields in &self.fields {
                drawn.push(self.carried_down(frame, *patch, fields)?);
            }
            // Values of fields without a mesh are shown at the taxels.
            let levels = self.levels.iter().copied().chain(self.fields.iter().map(|_| LevelId::default()));
            if let Some(viewpoint) = options.space {
                let panel = |(level, drawn)| Some((Panel::in_space(view, level, viewpoint), drawn?));
                rows.push(levels.clone().zip(drawn.clone()).map(panel).collect::<Vec<_>>());
            }
            let panel = |(level, drawn)| Some((Panel::on_map(view, level)?, drawn?));
            rows.push(levels.zip(drawn).map(panel).collect());
        }
        let all = rows.iter().flatten().flatten().map(|(_, drawn)| drawn);
        let colours = Colours::new(options.range, &about, all);
        for (panel, drawn) in rows.iter_mut().flatten().flatten() {
            panel.slot.caption = caption(panel, drawn, channel, frame.time, &about);
        }
        let (rows, layout) = lay_out(rows, |(panel, _)| &panel.slot, options.width_px)?;
        let slots = slots(&rows, |(panel, _)| &panel.slot);
        let mut groups = Vec::new();
        let mut has_gaps = false;
        for ((panel, drawn), view) in rows.iter().flatten().flatten().zip(layout.views(&slots)) {
            let [low, high] = colours.range;
            let shares = drawn.densities.map(|x| (x - low) / (high - low));
            has_gaps |= shares.iter().any(|x| x.is_nan());
            groups.push(layout.caption(&panel.slot.caption, &view));
            groups.push(panel.draw_values(&view, &shares, colours.scale));
        }
        groups.push(layout.scale_bar());
        groups.push(layout.colour_bar(colours.scale, &about.label, &colours.labels(about.factor)));
        if has_gaps {
            groups.push(layout.hatch_key(&about.label));
        }
        let what = format!("{} on", printable(&channel.name));
        Ok(Picture {
            title: title(&what, self.patches.iter().map(|(_, view)| view.name)),
            size_px: [layout.width, layout.height],
            em: layout.em,
            groups,
        })
    }

    /// The drawn values of a level of a patch; `None` for a level that the patch does not have.
    fn densities(&self, frame: &LevelFrame, id: PatchId, level: LevelId) -> Result<Option<Drawn>, PlotError> {
        let patch = &self.map.patches[id];
        let Some(MapLevel { level: shape, .. }) = patch.levels.get(level) else { return Ok(None) };
        let other = || PlotError::FrameOfAnotherMap { patch: patch.name.clone(), level };
        let of_channel = frame.values.get(id).and_then(|channels| channels.get(self.shown));
        let values = of_channel.and_then(|levels| levels.get(level)).ok_or_else(other)?;
        if values.len() != shape.mesh.positions.len() {
            return Err(other());
        }
        let quantity = self.channel.quantity;
        let densities = values.iter().zip(&shape.areas).map(|(x, area)| x / quantity.extent(*area)).collect();
        let known = values.iter().filter(|x| !x.is_nan());
        let (masked, total) = (values.len() - known.clone().count(), known.sum());
        let name = format!("level {level}");
        Ok(Some(Drawn { name, count: values.len(), masked, total, densities }))
    }

    /// The values of a level without a mesh at the taxels of a patch, if it is of this patch; of an extensive channel those
    /// per area.
    fn carried_down(
        &self,
        frame: &LevelFrame,
        id: PatchId,
        Fields { level, name, down, of_patches }: &Fields,
    ) -> Result<Option<Drawn>, PlotError> {
        if !down.has_fields(id) {
            return Ok(None);
        }
        let patch = &self.map.patches[id];
        let other = || PlotError::FrameOfAnotherMap { patch: patch.name.clone(), level: *level };
        let values = down.fields(frame, self.shown).ok_or_else(other)?;
        let density = |taxel| down.density((id, taxel), values, self.channel.quantity);
        let densities: IdVec<VertexId, f64> = patch.taxels.ids.ids().map(density).collect();
        let of_patch = &of_patches[id];
        let masked = of_patch.iter().filter(|field| values[**field].is_nan()).count();
        // What of the fields is on this patch: they may go on on others.
        let amounts = densities.iter().zip(&patch.taxels.areas).map(|(x, area)| x * area);
        let total = amounts.filter(|x| !x.is_nan()).sum();
        Ok(Some(Drawn { name: name.clone(), count: of_patch.len(), masked, total, densities }))
    }
}

/// The label of a channel on a picture.
struct About {
    /// Name and unit of the drawn values, as `pressure, kPa`.
    label: String,
    unit: String,
    /// Unit of the drawn values over that of the channel, per m^2 if it is extensive.
    factor: f64,
}

fn about(channel: &Channel) -> About {
    let name = printable(&channel.name);
    let (name, unit) = match (channel.quantity, channel.unit.as_str()) {
        (Quantity::Intensive, unit) => (name, printable(unit)),
        (Quantity::Extensive, "N") => (format!("{name} per area"), "Pa".to_owned()),
        (Quantity::Extensive, "") => (format!("{name} per area"), "1/m²".to_owned()),
        (Quantity::Extensive, unit) => (format!("{name} per area"), format!("{}/m²", printable(unit))),
    };
    let (unit, factor) = if unit == "Pa" { ("kPa".to_owned(), 1e3) } else { (unit, 1.0) };
    let label = if unit.is_empty() { name } else { format!("{name}, {unit}") };
    About { label, unit, factor }
}

/// The values of one level of a patch.
#[derive(Clone)]
struct Drawn {
    /// What it is called.
    name: String,
    /// Taxels or fields of this patch, those without a value, and the sum of the values on it; of a level without a mesh the
    /// part of its fields that is on this patch.
    count: usize,
    masked: usize,
    total: f64,
    /// The drawn values: those of the channel, or amounts per area of skin.
    densities: IdVec<VertexId, f64>,
}

struct Colours {
    range: [f64; 2],
    /// Smallest and largest value drawn.
    extremes: [f64; 2],
    scale: Scale,
}

impl Colours {
    fn new<'a>(range: Option<[f64; 2]>, about: &About, drawn: impl Iterator<Item = &'a Drawn>) -> Self {
        let known = drawn.flat_map(|drawn| &drawn.densities).copied().filter(|x| x.is_finite());
        let grow = |[low, high]: [f64; 2], x: f64| [low.min(x), high.max(x)];
        let extremes = known.fold([f64::INFINITY, f64::NEG_INFINITY], grow);
        let range = range.unwrap_or_else(|| colour_range(extremes, about.factor));
        Self { range, extremes, scale: Scale::of_range(range) }
    }

    /// The values at both ends and in the middle, with a sign at an end beyond which there are values.
    fn labels(&self, factor: f64) -> [String; 3] {
        let [low, middle, high] = ticks(self.range, factor);
        let below = if self.extremes[0] < self.range[0] { "≤ " } else { "" };
        let above = if self.extremes[1] > self.range[1] { "≥ " } else { "" };
        [format!("{below}{low}"), middle, format!("{above}{high}")]
    }
}

/// Values of the other sign below this share of the largest value do not get half of a scale.
const SLIGHTLY_NEGATIVE: f64 = 0.2;

/// The scale starts at zero if the smallest value is below this share of the largest.
const NEARLY_ZERO: f64 = 0.5;

/// The colour scale of values from the least to the largest of `extremes`: its ends have two digits; it is from zero if that
/// is near, symmetric if values of both signs matter. Without a value other than 0 it ends at `least`.
pub fn colour_range([low, high]: [f64; 2], least: f64) -> [f64; 2] {
    let largest = low.abs().max(high.abs());
    if low > high || largest == 0.0 {
        return [0.0, least];
    }
    let digit = second_digit(largest);
    let up = |x: f64| (x / digit).ceil() * digit;
    let down = |x: f64| (x / digit).floor() * digit;
    if low < 0.0 && high > 0.0 && (-low).min(high) > SLIGHTLY_NEGATIVE * largest {
        [-up(largest), up(largest)]
    } else if high <= 0.0 || -low > high {
        let to = if high < NEARLY_ZERO * low { up(high) } else { 0.0 };
        [down(low).min(to - digit), to]
    } else {
        let from = if low > NEARLY_ZERO * high { down(low) } else { 0.0 };
        [from, up(high).max(from + digit)]
    }
}

/// The caption of a panel: level, time, number of masked values, and the largest value.
fn caption(panel: &Panel<'_>, drawn: &Drawn, channel: &Channel, time: f64, about: &About) -> Caption {
    let Drawn { name, count, masked, total, densities } = drawn;
    let time = if time.is_nan() { String::new() } else { format!(", {time:.3} s") };
    let kind = if name == "level 0" { "taxels" } else { "fields" };
    let masked = if *masked > 0 { format!(", {masked} masked") } else { String::new() };
    let largest = densities.iter().copied().filter(|x| !x.is_nan()).reduce(f64::max);
    let mut measures = match largest {
        Some(x) => format!("max {} {}", signed(x / about.factor), about.unit).trim_end().to_owned(),
        None => "no reading".to_owned(),
    };
    let Channel { unit, quantity, .. } = channel;
    if *quantity == Quantity::Extensive {
        measures += &format!(", total {} {}", signed(*total), printable(unit));
    }
    Caption {
        name: panel.slot.caption.name.clone(),
        which: format!(", {name}{}", if panel.is_in_space() { " in space" } else { "" }),
        about: [format!("{count} {kind}{masked}{time}"), measures.trim_end().to_owned()],
    }
}
