//! Pictures of the map from signals alone, next to the true one: where both agree, neighbours on the skin feel alike.

use glam::DVec2;

use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::mesh::{TriMesh, rectangle_around};
use crate::plot::colour::Colour;
use crate::plot::draw::Panel;
use crate::plot::layout::{lay_out, short, slots};
use crate::plot::patch_view::PatchView;
use crate::plot::picture::Picture;
use crate::plot::plot_map::{choose, title};
use crate::plot::{PlotError, PlotOptions};
use crate::pyramid::{Level, LevelId};
use crate::signal::SignalMap;
use crate::skin::{Patch, PatchId};

/// Colours of the corners of a map. Taxels have the mixture of their place, in [`STEPS`] steps along each axis.
const CORNERS: [[Colour; 2]; 2] =
    [[Colour::rgb(0x2b_6cb0), Colour::rgb(0x2f_9e44)], [Colour::rgb(0x9c_36b5), Colour::rgb(0xff_d43b)]];
/// Colours of a map along each axis; with half as many its blocks are twice as wide.
const STEPS: u32 = 16;

/// Colours of taxels that have no map from signals.
const UNKNOWN: Colour = Colour::rgb(0xd9_d9d9);

/// Draws level 0 of each patch on its map and, next to it, where its signals put the taxels, with the triangles between
/// them. A taxel has the same colour in both, that of its place on the true map; those without signals are grey there.
///
/// Of `options` the patches and the width are used.
///
/// # Errors
/// If there is no such patch, the map is not valid, or the picture is narrower than its panels need or larger than 16384
/// pixels a side.
///
/// # Panics
/// If `signals` are not those of the patches of the map.
pub fn plot_signals(
    map: &SkinMap,
    signals: &IdVec<PatchId, Option<SignalMap>>,
    options: &PlotOptions,
) -> Result<Picture, PlotError> {
    let patches = choose(&map.patches, |patch| &patch.name, &options.patches)?;
    map.validate()?;
    let skin = map.skin();
    let chosen: Vec<(&PatchMap, PatchId)> = map
        .patches
        .enumerate()
        .filter(|(_, patch)| patches.iter().any(|chosen| std::ptr::eq(*chosen, *patch)))
        .map(|(id, patch)| (patch, id))
        .collect();
    let made: Vec<Option<(PatchMap, Vec<VertexId>)>> = chosen
        .iter()
        .map(|&(_, id)| signals[id].as_ref().map(|signals| by_signals(&skin.patches[id], signals)))
        .collect();
    let views: Vec<_> =
        chosen.iter().map(|(patch, _)| PatchView::of_map(map, patch)).collect::<Result<_, _>>()?;
    let made_views = made
        .iter()
        .map(|made| made.as_ref().map(|(patch, _)| PatchView::of_map(map, patch)).transpose())
        .collect::<Result<Vec<_>, _>>()?;
    let mut colours: Vec<Colour> = (0..STEPS * STEPS).map(|k| colour(k % STEPS, k / STEPS)).collect();
    colours.push(UNKNOWN);
    let mut rows = Vec::new();
    for (k, ((patch, id), view)) in chosen.iter().zip(&views).enumerate() {
        let cells = cells(patch);
        let kept = made[k].as_ref().map(|(_, kept)| kept);
        let known: IdVec<VertexId, u32> = cells
            .enumerate()
            .map(|(taxel, &cell)| match kept {
                Some(kept) if kept.binary_search(&taxel).is_ok() => cell,
                _ => STEPS * STEPS,
            })
            .collect();
        let mut truth = Panel::on_map(view, LevelId::default());
        if let Some(panel) = &mut truth {
            panel.slot.caption.about = [format!("{} taxels", patch.taxels.ids.len()), String::new()];
        }
        let mut found = made_views[k].as_ref().and_then(|view| Panel::on_map(view, LevelId::default()));
        if let (Some(panel), Some(kept), Some(signals)) = (&mut found, kept, &signals[*id]) {
            panel.slot.caption.which = ", from signals".to_owned();
            panel.slot.caption.about = [
                format!("{} taxels", kept.len()),
                format!("{} mm rms from the map", short(1e3 * signals.rms)),
            ];
        }
        let of_found = kept.into_iter().flatten().map(|&taxel| cells[taxel]).collect();
        rows.push(vec![truth.map(|panel| (panel, known)), found.map(|panel| (panel, of_found))]);
    }
    let (rows, layout) = lay_out(rows, |(panel, _)| &panel.slot, options.width_px)?;
    let slots = slots(&rows, |(panel, _)| &panel.slot);
    let mut groups = Vec::new();
    for ((panel, cells), view) in rows.iter().flatten().flatten().zip(layout.views(&slots)) {
        groups.push(layout.caption(&panel.slot.caption, &view));
        groups.push(panel.draw_cells(&view, cells.clone(), &colours));
    }
    groups.push(layout.scale_bar());
    Ok(Picture {
        title: title("The map from signals of", views.iter().map(|view| view.name)),
        size_px: [layout.width, layout.height],
        em: layout.em,
        groups,
    })
}

/// The taxels of a patch that have signals, where these put them, and which of the patch they are.
fn by_signals(patch: &Patch, signals: &SignalMap) -> (PatchMap, Vec<VertexId>) {
    /// The map is drawn as triangles: its pixels are not used.
    const PIXEL: f64 = 1e-3;
    let kept: Vec<VertexId> =
        signals.points.enumerate().filter(|(_, point)| point.is_some()).map(|(taxel, _)| taxel).collect();
    let number = |taxel: VertexId| kept.binary_search(&taxel).ok().map(VertexId::new);
    let triangles = patch.mesh.triangles.iter().filter_map(|corners| {
        let [a, b, c] = corners.map(number);
        Some([a?, b?, c?])
    });
    let positions = kept.iter().map(|&taxel| patch.mesh.positions[taxel]).collect();
    let mesh = TriMesh { positions, triangles: triangles.collect() };
    let taxels = patch.taxels.select(&IdVec::<VertexId, _>::from(kept.clone()));
    let uv: IdVec<VertexId, DVec2> = signals.points.iter().copied().flatten().collect();
    let level = Level::finest(mesh.clone(), taxels.areas.clone());
    let patch = Patch { mesh, taxels, filled: 0, ..patch.clone() };
    (PatchMap::unmeasured(&patch, vec![(level, None)], vec![uv].into(), PIXEL), kept)
}

/// The number of the colour of each taxel, by its place on its map; of those on a seam the last one.
fn cells(patch: &PatchMap) -> IdVec<VertexId, u32> {
    let mut cells = patch.taxels.ids.map(|_| STEPS * STEPS);
    let Some(level) = patch.levels.get(LevelId::default()) else { return cells };
    let (low, high) = rectangle_around(level.uv.iter().copied());
    let size = (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    for (place, &uv) in level.uv.enumerate() {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to the steps")]
        let step = ((uv - low) / size * f64::from(STEPS)).to_array().map(|x| (x as u32).min(STEPS - 1));
        cells[level.vertex_of(place)] = step[0] + STEPS * step[1];
    }
    cells
}

/// The mixture of the corners.
fn colour(x: u32, y: u32) -> Colour {
    let [x, y] = [x, y].map(|k| f64::from(k) / f64::from(STEPS - 1));
    let mix = |part: fn(Colour) -> u8| {
        let row = |row: [Colour; 2]| (1.0 - x) * f64::from(part(row[0])) + x * f64::from(part(row[1]));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
        let mixed = ((1.0 - y) * row(CORNERS[0]) + y * row(CORNERS[1])).round() as u8;
        mixed
    };
    Colour(mix(|c| c.0), mix(|c| c.1), mix(|c| c.2))
}
