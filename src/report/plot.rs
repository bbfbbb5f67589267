use svg::{
    Document,
    node::element::{Rectangle, Title},
};

use crate::{
    atlas::face_stretch,
    id::LevelId,
    map::{MapError, PatchMap, SkinMap},
    mesh::MeshError,
    report::{
        ReportError,
        layout::{Layout, printable, round_up},
        panel::{Panel, Range},
        png::FONT_FAMILY,
    },
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
}

/// What to plot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlotOptions {
    /// Names of the patches, one row each; none: all.
    pub patches: Vec<String>,
    /// The levels, side by side; none: the finest three. A patch that lacks a level leaves its place empty.
    pub levels: Vec<LevelId>,
    /// What the colours say.
    pub paint: Paint,
    /// Width of the picture, in pixels.
    pub width_px: u32,
}

impl Default for PlotOptions {
    fn default() -> Self {
        Self { patches: Vec::new(), levels: Vec::new(), paint: Paint::default(), width_px: 1600 }
    }
}

/// Draws levels of patches side by side, all at one scale, as the text of an SVG picture.
///
/// Each panel shows the triangles and the boundary of one level on its own map. With [`Paint::Fields`] level 0 is
/// carried to each coarser level's map: the cell of each taxel has the colour of the field that it belongs to most, and
/// dots are the fields' centres; on level 0 itself dots are the taxels. Triangles shorter than 6 pixels are left out, dots closer than 7; colours of triangles shorter
/// than 3 pixels are drawn pixel by pixel, so that the picture of a large mesh stays small.
///
/// # Errors
/// If there is no such patch or level, the data are no map, or the picture is larger than 16384 pixels a side.
pub fn plot_map(map: &SkinMap, options: &PlotOptions) -> Result<String, ReportError> {
    let patches = choose_patches(map, &options.patches)?;
    let levels = choose_levels(&patches, &options.levels)?;
    patches.iter().try_for_each(|patch| check(patch, &levels))?;
    let layout = Layout::new(&patches, &levels, options.width_px)?;
    let panels = layout.panels(&patches, &levels);
    let range = range_of(&panels);

    let (width, height) = (f64::from(layout.width), f64::from(layout.height));
    let mut picture = Document::new()
        .set("width", width)
        .set("height", height)
        .set("viewBox", format!("0 0 {width} {height}"))
        .set("font-family", format!("{FONT_FAMILY}, 'DejaVu Sans', Arial, sans-serif"))
        .set("font-size", layout.em)
        .add(Title::new(picture_title(&patches)))
        .add(Rectangle::new().set("width", width).set("height", height).set("fill", "#fff"));
    for panel in &panels {
        picture = picture.add(layout.caption(panel)).add(panel.draw(options.paint, &range)?);
    }
    picture = picture.add(layout.scale_bar());
    if let Some((definition, legend)) = layout.legend(options.paint, &range) {
        picture = picture.add(definition).add(legend);
    }
    Ok(picture.to_string())
}

fn picture_title(patches: &[&PatchMap]) -> String {
    let names: Vec<_> = patches.iter().map(|p| printable(&p.name)).collect();
    format!("Somatosensory maps of {}", names.join(", "))
}

fn choose_patches<'a>(map: &'a SkinMap, names: &[String]) -> Result<Vec<&'a PatchMap>, ReportError> {
    if map.patches.is_empty() {
        return Err(ReportError::Empty);
    }
    if names.is_empty() {
        return Ok(map.patches.iter().collect());
    }
    let find = |name: &String| {
        map.patches.iter().find(|p| p.name == *name).ok_or_else(|| ReportError::UnknownPatch {
            patch: name.clone(),
            known: map.patches.iter().map(|p| p.name.clone()).collect(),
        })
    };
    names.iter().map(find).collect()
}

fn choose_levels(patches: &[&PatchMap], levels: &[LevelId]) -> Result<Vec<LevelId>, ReportError> {
    let count = patches.iter().map(|p| p.levels.len()).max().unwrap_or(0);
    if let Some(&level) = levels.iter().find(|l| l.index() >= count) {
        return Err(ReportError::UnknownLevel { level, last: count.saturating_sub(1) });
    }
    if levels.is_empty() {
        return Ok((0..count.min(LEVELS_SIDE_BY_SIDE)).map(LevelId::new).collect());
    }
    Ok(levels.to_vec())
}

/// Whether a patch keeps the promises that drawing relies on.
fn check(patch: &PatchMap, levels: &[LevelId]) -> Result<(), ReportError> {
    let taxels = patch.levels.iter().next().map_or(0, |l| l.mesh.positions.len());
    let finest = LevelId::default();
    for &id in std::iter::once(&finest).chain(levels) {
        let Some(level) = patch.levels.get(id) else { continue };
        let (name, label) = (|| patch.name.clone(), || format!("L{id}"));
        let count = level.mesh.positions.len();
        let mut lengths = vec![("map positions", level.uv.len(), count)];
        level.mesh.validate().map_err(|source| MapError::Mesh { patch: name(), level: label(), source })?;
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
        }
        if let Some(&(what, found, needed)) = lengths.iter().find(|(_, found, needed)| found != needed) {
            return Err(MapError::Length { patch: name(), level: label(), what, found, needed }.into());
        }
    }
    Ok(())
}

/// Ends of the scales: what all but a hundredth of the triangles stay below, rounded.
fn range_of(panels: &[Panel<'_>]) -> Range {
    let stretches =
        || panels.iter().flat_map(|p| p.level.mesh.triangles.ids().map(|f| face_stretch(p.level, f)));
    let most = |values: Vec<f64>| {
        let mut values: Vec<f64> = values.into_iter().filter(|x| x.is_finite()).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() * 99 / 100).map_or(0.0, |x| *x)
    };
    let angle = most(stretches().map(|s| s.angle.abs() - 1.0).collect());
    let area = most(stretches().map(|s| s.area.abs().ln().abs()).collect());
    Range {
        angle: 1.0 + round_up(angle.clamp(0.02, 100.0)),
        area: 1.0 + round_up(area.clamp(0.02, 5.0).exp_m1()),
    }
}
