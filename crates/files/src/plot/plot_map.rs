//! Pictures of maps and of skins: lays out and draws the requested panels.

use crate::id::IdVec;
use crate::map::{PatchMap, SkinMap};
use crate::plot::colour::ScaleLimits;
use crate::plot::draw::Panel;
use crate::plot::layout::{lay_out, printable, slots};
use crate::plot::patch_view::{PatchView, Robot};
use crate::plot::picture::{Picture, Shape};
use crate::plot::{Paint, PlotError, PlotOptions, Viewpoint};
use crate::pyramid::LevelId;
use crate::skin::{PatchId, Skin};
use crate::unfold::Unfolding;

/// The panels of a patch; a level that it lacks leaves its slot empty.
type PanelRow<'a> = Vec<Option<Panel<'a>>>;

/// Number of levels drawn by default: as many as are legible side by side in a README.
const LEVELS_SIDE_BY_SIDE: usize = 3;

/// The level whose fields colour the unfolding skin: few enough fields to be followed by eye.
const UNFOLDED_LEVEL: u32 = 2;

/// Draws levels of patches side by side, all at one scale.
///
/// Each panel shows the triangles and the boundary of one level on its own map. With
/// [`crate::plot::Paint::Fields`] level 0 is drawn on each coarser level's map: the cell of each taxel has
/// the colour of the field to which it belongs most, and dots are the fields' centres; on level 0 itself dots
/// are the taxels. Dots of absent taxels and thermal pads are hollow. With [`PlotOptions::space`] the first
/// panel of a row is the skin in space, as [`plot_skin`] draws it, with the colours of the first level drawn.
///
/// With [`PlotOptions::unfold`] the skin is drawn as it unfolds: it turns towards the viewer while it becomes
/// flat, so that the last panel is its map.
///
/// Triangles shorter than 6 pixels are left out, dots closer than 7; colours of triangles shorter
/// than 3 pixels are drawn pixel by pixel, so that the picture of a large mesh stays small.
///
/// # Errors
/// If there is no such patch or level, the data are not a valid map or lack the covariances to
/// show, the viewpoint is not a direction, or the picture is narrower than its panels need or
/// larger than 16384 pixels a side.
pub fn plot_map(map: &SkinMap, options: &PlotOptions) -> Result<Picture, PlotError> {
    let patches = choose(&map.patches, |patch| &patch.name, &options.patches)?;
    let levels = choose_levels(&patches, &options.levels)?;
    options.space.map_or(Ok(()), check_viewpoint)?;
    map.validate()?;
    let views: Vec<_> =
        patches.iter().map(|patch| PatchView::of_map(map, patch)).collect::<Result<_, _>>()?;
    let first = levels.first().copied().unwrap_or_default();
    if !options.unfold.is_empty() {
        let rows = patches.iter().zip(&views).map(|(patch, view)| unfolding_row(patch, view, options));
        let rows = rows.collect::<Result<_, _>>()?;
        return draw(
            title("How the skin unfolds:", views.iter().map(|view| view.name)),
            &views,
            rows,
            options,
        );
    }
    let row = |view| {
        let in_space = options.space.map(|viewpoint| Some(Panel::in_space(view, first, viewpoint)));
        let maps = levels.iter().map(|&level| Panel::on_map(view, level));
        in_space.into_iter().chain(maps).collect()
    };
    let rows: Vec<PanelRow<'_>> = views.iter().map(row).collect();
    draw(title("Somatosensory maps of", views.iter().map(|view| view.name)), &views, rows, options)
}

/// A patch at each time of its unfolding.
///
/// The colours are those of the first requested level, or of the coarsest up to level [`UNFOLDED_LEVEL`];
/// stretches are those of level 0, whose triangles are drawn.
fn unfolding_row<'a>(
    patch: &PatchMap,
    view: &'a PatchView<'a>,
    options: &PlotOptions,
) -> Result<PanelRow<'a>, PlotError> {
    if let Some(&time) = options.unfold.iter().find(|time| !(0.0..=1.0).contains(*time)) {
        return Err(PlotError::Time { time });
    }
    let unfolding =
        Unfolding::new(patch).map_err(|source| PlotError::Unfold { patch: patch.name.clone(), source })?;
    let level = match options.paint {
        Paint::Angle | Paint::Area => LevelId::default(),
        _ => options.levels.first().copied().unwrap_or(UNFOLDED_LEVEL.into()),
    };
    let viewpoint = options.space.unwrap_or_default();
    let panel = |&time: &f64| Panel::unfolding(view, patch, &unfolding, time, level, viewpoint);
    Ok(options.unfold.iter().map(panel).collect())
}

/// Draws a skin in space, with all patches at the poses of their links.
///
/// The projection is orthographic, so the scale bar is valid for all lengths in the picture plane; z
/// is up. Light falls from the upper left; the inside of the skin is darker. Triangles and dots,
/// which are the taxels, are left out where they would be smaller than in [`plot_map`].
///
/// # Errors
/// If there is no such patch, the data are not a valid skin, the colours need a map or covariances
/// that are missing, the viewpoint is not a direction, or the picture is narrower than 200 or
/// larger than 16384 pixels a side.
pub fn plot_skin(skin: &Skin, options: &PlotOptions) -> Result<Picture, PlotError> {
    let patches = choose(&skin.patches, |patch| &patch.name, &options.patches)?;
    skin.validate()?;
    let views: Vec<_> = patches.iter().map(|patch| PatchView::of_skin(skin, patch)).collect();
    if let (Some(view), false) = (views.first(), options.levels.is_empty()) {
        return Err(view.no_map("levels"));
    }
    let viewpoint = options.space.unwrap_or_default();
    check_viewpoint(viewpoint)?;
    let names = views.iter().map(|view| view.name);
    let title = title("The skin of", names);
    let robot;
    let views = match &views[..] {
        [_] => views,
        several => {
            robot = Robot::new(several);
            vec![robot.view()]
        }
    };
    let row = |view| vec![Some(Panel::in_space(view, LevelId::default(), viewpoint))];
    let rows: Vec<PanelRow<'_>> = views.iter().map(row).collect();
    draw(title, &views, rows, options)
}

/// The title: what a picture shows, and of which patches.
pub(super) fn title<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> String {
    format!("{what} {}", names.map(printable).collect::<Vec<_>>().join(", "))
}

fn draw(
    title: String,
    patches: &[PatchView<'_>],
    rows: Vec<PanelRow<'_>>,
    options: &PlotOptions,
) -> Result<Picture, PlotError> {
    let (rows, layout) = lay_out(rows, |panel| &panel.slot, options.width_px)?;
    let slots = slots(&rows, |panel| &panel.slot);
    let panels: Vec<_> = rows.iter().flatten().flatten().collect();
    let levels: Vec<_> = panels.iter().filter_map(|panel| panel.level()).collect();
    let limits = ScaleLimits::new(&levels, patches, options.paint, options.range)?;
    let mut groups = Vec::new();
    for (panel, view) in panels.into_iter().zip(layout.views(&slots)) {
        groups.push(layout.caption(&panel.slot.caption, &view));
        groups.push(panel.draw(&view, options, &limits)?);
    }
    let has_hollow = groups.iter().flatten().any(|s| matches!(s, Shape::Dots { has_rim: true, .. }));
    groups.push(layout.scale_bar());
    groups.push(layout.legend(options.paint, &limits));
    if has_hollow {
        groups.push(layout.legend_of_hollow_dots(options.paint));
    }
    Ok(Picture { title, size_px: [layout.width, layout.height], em: layout.em, groups })
}

/// The patches of these names, in this order; without names all.
pub(super) fn choose<'a, P>(
    patches: &'a IdVec<PatchId, P>,
    name: impl Fn(&P) -> &String,
    names: &[String],
) -> Result<Vec<&'a P>, PlotError> {
    if patches.is_empty() {
        return Err(PlotError::Empty);
    }
    if names.is_empty() {
        return Ok(patches.iter().collect());
    }
    let find = |wanted: &String| {
        patches.iter().find(|p| name(p) == wanted).ok_or_else(|| PlotError::UnknownPatch {
            patch: wanted.clone(),
            known: patches.iter().map(|p| name(p).clone()).collect(),
        })
    };
    names.iter().map(find).collect()
}

pub(super) fn check_viewpoint(viewpoint: Viewpoint) -> Result<(), PlotError> {
    let Viewpoint::From { azimuth, elevation } = viewpoint else { return Ok(()) };
    let [azimuth, elevation] = [azimuth, elevation].map(f64::to_degrees);
    // A right angle in radians is not exactly representable.
    let is_direction = azimuth.is_finite() && elevation.abs() <= 90.0 + 1e-9;
    if is_direction { Ok(()) } else { Err(PlotError::Direction { azimuth, elevation }) }
}

pub(super) fn choose_levels(patches: &[&PatchMap], levels: &[LevelId]) -> Result<Vec<LevelId>, PlotError> {
    let count = patches.iter().map(|p| p.levels.len()).max().unwrap_or(0);
    if let Some(&level) = levels.iter().find(|l| l.index() >= count) {
        return Err(PlotError::UnknownLevel { level, last: count.saturating_sub(1) });
    }
    if levels.is_empty() {
        return Ok((0..count.min(LEVELS_SIDE_BY_SIDE)).map(LevelId::new).collect());
    }
    Ok(levels.to_vec())
}
