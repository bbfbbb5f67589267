use svg::{
    Document,
    node::element::{Rectangle, Title},
};

use crate::{
    id::IdVec,
    map::{MapError, PatchMap, SkinMap},
    mesh::MeshError,
    plot::{
        PlotError, Viewpoint,
        colour::scale_limits::Range,
        draw::panel::Panel,
        layout::grid::{Layout, Row, printable},
        patch_view::Subject,
        png::FONT_FAMILY,
    },
    pyramid::LevelId,
    skin::{Link, LinkId, PatchId, Skin, SkinError},
};

/// Levels drawn when none is asked for: as many as are legible side by side in a README.
const LEVELS_SIDE_BY_SIDE: usize = 3;

/// What the colours of a plot say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Paint {
    /// The receptive field that each taxel belongs to most; neighbouring fields differ.
    #[default]
    Fields,
    /// `s1/s2` of each triangle.
    Angle,
    /// `s1 s2` of each triangle.
    Area,
    /// Each taxel's id, from the lowest to the highest.
    Taxel,
    /// How uncertain each taxel's position is: the square root of the trace of its covariance.
    Sigma,
}

/// What to plot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotOptions {
    /// Names of the patches, one row each; none: all.
    pub patches: Vec<String>,
    /// The levels, side by side; none: the finest three. A patch that lacks a level leaves its place empty.
    pub levels: Vec<LevelId>,
    /// What the colours say.
    pub paint: Paint,
    /// From where the skin is drawn in space, beside its maps; `None`: the maps alone.
    pub space: Option<Viewpoint>,
    /// Width of the picture, in pixels.
    pub width_px: u32,
}

impl Default for PlotOptions {
    fn default() -> Self {
        Self { patches: Vec::new(), levels: Vec::new(), paint: Paint::default(), space: None, width_px: 1600 }
    }
}

/// Draws levels of patches side by side, all at one scale, as the text of an SVG picture.
///
/// Each panel shows the triangles and the boundary of one level on its own map. With [`Paint::Fields`] level 0 is
/// carried to each coarser level's map: the cell of each taxel has the colour of the field that it belongs to most, and
/// dots are the fields' centres; on level 0 itself dots are the taxels. With [`PlotOptions::space`] the first panel of a
/// row is the skin in space, as [`plot_skin`] draws it, with the colours of the first level drawn.
///
/// Triangles shorter than 6 pixels are left out, dots closer than 7; colours of triangles shorter than 3 pixels are drawn
/// pixel by pixel, so that the picture of a large mesh stays small.
///
/// # Errors
/// If there is no such patch or level, the data are no map or have no covariances to show, the viewpoint is none, or the
/// picture is narrower than its panels need or larger than 16384 pixels a side.
pub fn plot_map(map: &SkinMap, options: &PlotOptions) -> Result<String, PlotError> {
    let patches = choose(&map.patches, |patch| &patch.name, &options.patches)?;
    let levels = choose_levels(&patches, &options.levels)?;
    patches.iter().try_for_each(|patch| check(patch, &levels))?;
    options.space.map_or(Ok(()), check_viewpoint)?;
    check_links(map)?;
    let subjects: Option<Vec<_>> = patches.iter().map(|patch| Subject::of_map(map, patch)).collect();
    let subjects = subjects.ok_or(PlotError::Empty)?;
    let first = levels.first().copied().unwrap_or_default();
    let row = |subject| {
        let in_space = options.space.map(|viewpoint| Some(Panel::in_space(subject, first, viewpoint)));
        let maps = levels.iter().map(|&level| Panel::on_map(subject, level));
        in_space.into_iter().chain(maps).collect()
    };
    let rows: Vec<Row<'_>> = subjects.iter().map(row).collect();
    draw("Somatosensory maps of", &subjects, &rows, options)
}

/// Draws patches in space, one below the other at one scale, as the text of an SVG picture.
///
/// The projection is orthographic, so the scale bar holds for all lengths in the picture plane; z is up. Light falls from
/// the upper left; the inside of the skin is darker. Triangles and dots, which are the taxels, are left out where they
/// would be smaller than in [`plot_map`].
///
/// # Errors
/// If there is no such patch, the data are no skin, the colours need a map or covariances that are not there, the
/// viewpoint is none, or the picture is narrower than 200 or larger than 16384 pixels a side.
pub fn plot_skin(skin: &Skin, options: &PlotOptions) -> Result<String, PlotError> {
    let patches = choose(&skin.patches, |patch| &patch.name, &options.patches)?;
    skin.validate()?;
    let subjects: Vec<_> = patches.iter().map(|patch| Subject::of_skin(skin, patch)).collect();
    if let (Some(subject), false) = (subjects.first(), options.levels.is_empty()) {
        return Err(subject.no_map("levels"));
    }
    let viewpoint = options.space.unwrap_or_default();
    check_viewpoint(viewpoint)?;
    let row = |subject| vec![Some(Panel::in_space(subject, LevelId::default(), viewpoint))];
    let rows: Vec<Row<'_>> = subjects.iter().map(row).collect();
    draw("The skin of", &subjects, &rows, options)
}

fn draw(
    title: &str,
    subjects: &[Subject<'_>],
    rows: &[Row<'_>],
    options: &PlotOptions,
) -> Result<String, PlotError> {
    let layout = Layout::new(rows, options.width_px)?;
    let panels = layout.views(rows);
    let levels: Vec<_> = panels.iter().filter_map(|(panel, _)| panel.level()).collect();
    let mut range = Range::new(&levels);
    if options.paint == Paint::Sigma {
        range = range.with_sigmas(subjects)?;
    }
    let names: Vec<_> = subjects.iter().map(|subject| printable(subject.name)).collect();
    let (width, height) = (f64::from(layout.width), f64::from(layout.height));
    let mut picture = Document::new()
        .set("width", width)
        .set("height", height)
        .set("viewBox", format!("0 0 {width} {height}"))
        .set("font-family", format!("{FONT_FAMILY}, 'DejaVu Sans', Arial, sans-serif"))
        .set("font-size", layout.em)
        .add(Title::new(format!("{title} {}", names.join(", "))))
        .add(Rectangle::new().set("width", width).set("height", height).set("fill", "#fff"));
    for (panel, view) in &panels {
        picture = picture.add(layout.caption(panel, view)).add(panel.draw(view, options.paint, &range)?);
    }
    picture = picture.add(layout.scale_bar());
    if let Some((definition, legend)) = layout.legend(options.paint, &range) {
        picture = picture.add(definition).add(legend);
    }
    Ok(picture.to_string())
}

/// The patches of these names, in this order; without names all.
fn choose<'a, P>(
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

/// Whether every patch has a place in the world.
fn check_links(map: &SkinMap) -> Result<(), SkinError> {
    let is_before_its_parent = |(id, link): &(LinkId, &Link)| link.parent.is_some_and(|parent| parent >= *id);
    if let Some((link, _)) = map.links.enumerate().find(is_before_its_parent) {
        return Err(SkinError::LinkOrder { link });
    }
    match map.patches.iter().find(|patch| patch.link.index() >= map.links.len()) {
        None => Ok(()),
        Some(patch) => Err(SkinError::UnknownLink { patch: patch.name.clone(), link: patch.link }),
    }
}

fn check_viewpoint(viewpoint: Viewpoint) -> Result<(), PlotError> {
    let Viewpoint::From { azimuth, elevation } = viewpoint else { return Ok(()) };
    let [azimuth, elevation] = [azimuth, elevation].map(f64::to_degrees);
    // A right angle in radians is no decimal.
    let is_direction = azimuth.is_finite() && elevation.abs() <= 90.0 + 1e-9;
    if is_direction { Ok(()) } else { Err(PlotError::Direction { azimuth, elevation }) }
}

fn choose_levels(patches: &[&PatchMap], levels: &[LevelId]) -> Result<Vec<LevelId>, PlotError> {
    let count = patches.iter().map(|p| p.levels.len()).max().unwrap_or(0);
    if let Some(&level) = levels.iter().find(|l| l.index() >= count) {
        return Err(PlotError::UnknownLevel { level, last: count.saturating_sub(1) });
    }
    if levels.is_empty() {
        return Ok((0..count.min(LEVELS_SIDE_BY_SIDE)).map(LevelId::new).collect());
    }
    Ok(levels.to_vec())
}

/// Whether a patch keeps the promises that drawing relies on.
fn check(patch: &PatchMap, levels: &[LevelId]) -> Result<(), PlotError> {
    let taxels = patch.levels.iter().next().map_or(0, |l| l.mesh.positions.len());
    let finest = LevelId::default();
    for &id in std::iter::once(&finest).chain(levels) {
        let Some(level) = patch.levels.get(id) else { continue };
        let (name, label) = (|| patch.name.clone(), || format!("L{id}"));
        let count = level.mesh.positions.len();
        let mut lengths = vec![("map positions", level.uv.len(), count)];
        level.mesh.validate().map_err(|source| MapError::Mesh { patch: name(), level: label(), source })?;
        if let Some(v) = level.origins.iter().find(|v| v.index() >= taxels) {
            let (what, found, count) = ("origins", v.index(), taxels);
            return Err(MapError::OutOfRange { patch: name(), level: label(), what, found, count }.into());
        }
        if let Some((vertex, at)) = level.uv.enumerate().find(|(_, at)| !at.is_finite()) {
            let source = MeshError::NotFinite { vertex, position: [at.x, at.y, 0.0] };
            return Err(MapError::Mesh { patch: name(), level: label(), source }.into());
        }
        if let Some(direct) = &level.direct {
            lengths.push(("direct indices", direct.indices.len(), taxels));
            lengths.push(("direct weights", direct.weights.len(), taxels));
            if let Some(v) = direct.indices.iter().flatten().find(|v| v.index() >= count) {
                let (what, found) = ("direct", v.index());
                return Err(MapError::OutOfRange { patch: name(), level: label(), what, found, count }.into());
            }
        }
        if id == finest {
            lengths.push(("taxel ids", patch.ids.len(), count));
            lengths.push(("covariances", patch.covariances.as_ref().map_or(count, IdVec::len), count));
        }
        if let Some(&(what, found, needed)) = lengths.iter().find(|(_, found, needed)| found != needed) {
            return Err(MapError::Length { patch: name(), level: label(), what, found, needed }.into());
        }
    }
    Ok(())
}
