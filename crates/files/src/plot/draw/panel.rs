//! A panel: one picture of one patch, with its caption.

use std::collections::BTreeMap;

use glam::{DQuat, DVec2};

use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap};
use crate::mesh::{TriMesh, rectangle_around};
use crate::plot::colour::{
    Colour, ColouredMesh, Fill, MeshOwner, Scale, ScaleLimits, WARNING, mean_of_known,
};
use crate::plot::draw::camera::Camera;
use crate::plot::draw::drawn_mesh::FINE;
use crate::plot::draw::map_view::{draw_map, on_places};
use crate::plot::draw::view_3d::draw_in_space;
use crate::plot::layout::{Caption, Slot, View, minus, number, printable};
use crate::plot::patch_view::PatchView;
use crate::plot::picture::{Anchor, Path, Shape, Stroke};
use crate::plot::{Paint, PlotError, PlotOptions, Viewpoint};
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::{RegionName, Taxels};
use crate::unfold::Unfolding;

pub(crate) struct Panel<'a> {
    patch: &'a PatchView<'a>,
    look: Look<'a>,
    pub(crate) slot: Slot,
}

enum Look<'a> {
    OnMap(&'a MapLevel),
    /// The skin itself, coloured by a level if it has a map.
    InSpace(Camera, Option<&'a MapLevel>),
    Between(Camera, Box<Between<'a>>),
}

/// A skin during its unfolding from space to its map.
struct Between<'a> {
    /// The places of level 0.
    mesh: TriMesh,
    taxels: Taxels,
    finest: &'a MapLevel,
    /// The level whose colours are shown.
    level: &'a MapLevel,
}

impl<'a> Panel<'a> {
    pub(crate) fn on_map(patch: &'a PatchView<'a>, number: LevelId) -> Option<Self> {
        let level = patch.level(number)?;
        let slot = Slot {
            bounds: rectangle_around(level.uv.iter().copied()),
            caption: caption_of_map(patch.name, number, level),
        };
        Some(Self { patch, look: Look::OnMap(level), slot })
    }

    /// The skin in space, with the colours of a level, or of the coarsest if the patch has fewer.
    pub(crate) fn in_space(patch: &'a PatchView<'a>, number: LevelId, viewpoint: Viewpoint) -> Self {
        let camera = Camera::new(viewpoint, patch.mesh, patch.pose, &patch.seam());
        let slot = Slot {
            bounds: rectangle_around(patch.mesh.positions.iter().map(|&p| camera.project(p))),
            caption: caption_in_space(patch, &camera),
        };
        Self { patch, look: Look::InSpace(camera, patch.level_at_most(number)), slot }
    }

    /// The skin at a time of its unfolding, with the colours of a level; `None` without a map.
    pub(crate) fn unfolding(
        patch: &'a PatchView<'a>,
        map: &PatchMap,
        unfolding: &Unfolding,
        time: f64,
        level: LevelId,
        viewpoint: Viewpoint,
    ) -> Option<Self> {
        let finest = patch.level(LevelId::default())?;
        let camera = Camera::new(viewpoint, patch.mesh, patch.pose, &patch.seam());
        // The turn to the viewer is slow at both ends.
        let ease = time * time * (3.0 - 2.0 * time);
        let facing = DQuat::from_mat3(&(camera.picture_plane() * unfolding.sheet.matrix3.transpose()));
        let turn = DQuat::IDENTITY.slerp(facing, ease);
        let positions = unfolding.at(time).map(|&p| turn * p).reindexed();
        let mesh = TriMesh { positions, triangles: finest.opened().triangles.clone() };
        let slot = Slot {
            bounds: rectangle_around(mesh.positions.iter().map(|&p| camera.project(p))),
            caption: caption_of_unfolding(patch, time),
        };
        let vertices = finest.uv.ids().map(|place| finest.vertex_of(place));
        let taxels = map.taxels.select(&IdVec::<PlaceId, _>::from_iter(vertices));
        let between = Between { mesh, taxels, finest, level: patch.level_at_most(level)? };
        Some(Self { patch, look: Look::Between(camera, Box::new(between)), slot })
    }

    pub(crate) fn level(&self) -> Option<&'a MapLevel> {
        match self.look {
            Look::OnMap(level) => Some(level),
            Look::InSpace(_, level) => level,
            Look::Between(_, ref between) => Some(between.level),
        }
    }

    pub(crate) fn is_in_space(&self) -> bool {
        matches!(self.look, Look::InSpace(..))
    }

    pub(crate) fn draw(
        &self,
        view: &View,
        options: &PlotOptions,
        limits: &ScaleLimits,
    ) -> Result<Vec<Shape>, PlotError> {
        let mut coloured = ColouredMesh::new(self.patch, self.level(), options.paint, limits)?;
        Ok(match &self.look {
            Look::OnMap(level) => {
                coloured.has_dots &= level.uv.len() <= FINE;
                let mut shapes = draw_map(self.patch, level, &coloured, view);
                shapes.extend(fault(level).map(|_| warning(view)));
                if options.paint == Paint::Regions {
                    shapes.extend(self.region_labels(level, view));
                }
                shapes
            }
            Look::InSpace(camera, level) => {
                let dots = match options.paint {
                    Paint::Fields => self.centres(*level),
                    _ if coloured.has_dots => self.centres(None),
                    _ => Vec::new(),
                };
                let dots = if dots.len() <= FINE { &dots[..] } else { &[] };
                let seam = match level.filter(|_| coloured.owner == MeshOwner::Level) {
                    Some(level) => level.seam(),
                    None => self.patch.seam(),
                };
                draw_in_space(self.patch, &coloured, camera, view, seam, dots)
            }
            Look::Between(camera, between) => {
                let Between { mesh, taxels, finest, level } = &**between;
                let patch = PatchView::of_taxels(self.patch.name, mesh, self.patch.pose, taxels);
                coloured.fill = on_places(&coloured.fill, finest.unsplit()).into_owned();
                coloured.mesh = mesh;
                let is_shown = options.paint.has_dots() && finest.uv.len() <= FINE;
                let is_centre = |place: &PlaceId| {
                    options.paint != Paint::Fields
                        || level.level.origins.as_slice().contains(&finest.vertex_of(*place))
                };
                let dots = mesh.positions.ids().zip(finest.uv.ids());
                let dots = dots.filter(|(_, place)| is_shown && is_centre(place));
                let dots: Vec<VertexId> = dots.map(|(v, _)| v).collect();
                draw_in_space(&patch, &coloured, camera, view, Vec::new(), &dots)
            }
        })
    }

    /// The name of each region on a map, at the place nearest to the mean of its places.
    fn region_labels(&self, level: &MapLevel, view: &View) -> Vec<Shape> {
        let mut places = BTreeMap::<&RegionName, Vec<DVec2>>::new();
        for (place, &at) in level.uv.enumerate() {
            if let Some(region) = self.patch.region(level.level.origins[level.vertex_of(place)]) {
                places.entry(region).or_default().push(at);
            }
        }
        let label = |(name, places): (&RegionName, Vec<DVec2>)| {
            let mean = places.iter().sum::<DVec2>() / places.len() as f64;
            let order = |a: &&DVec2, b: &&DVec2| a.distance(mean).total_cmp(&b.distance(mean));
            let at = view.to_pixels(*places.iter().min_by(order)?);
            Some(Shape::text(printable(name), at, Anchor::Middle))
        };
        places.into_iter().filter_map(label).collect()
    }

    /// The taxels that are the centres of a level's fields; all of them without fields.
    fn centres(&self, level: Option<&MapLevel>) -> Vec<VertexId> {
        match level.filter(|level| level.level.to_finest.is_some()) {
            Some(level) => level.level.origins.iter().copied().collect(),
            None => self.patch.mesh.positions.ids().collect(),
        }
    }

    /// The panel of level 0 with a colour for each taxel, by its number in a list.
    pub(crate) fn draw_cells(
        &self,
        view: &View,
        groups: IdVec<VertexId, u32>,
        colours: &[Colour],
    ) -> Vec<Shape> {
        let Look::OnMap(level) = &self.look else { return Vec::new() };
        let has_dots = groups.len() <= FINE;
        let fill = Fill::Cells { groups, colours: colours.to_vec() };
        let mesh = &level.level.mesh;
        let coloured = ColouredMesh { mesh, owner: MeshOwner::Level, fill, is_scale: true, has_dots };
        draw_map(self.patch, level, &coloured, view)
    }

    /// The panel in the colours of values of the level's vertices, from 0 to 1, with dots at the vertices.
    pub(crate) fn draw_values(&self, view: &View, values: &IdVec<VertexId, f64>, scale: Scale) -> Vec<Shape> {
        let has_dots = values.len() <= FINE;
        let coloured = |mesh, owner, values, has_lines| {
            let fill = Fill::Values { values, scale, has_lines };
            ColouredMesh { mesh, owner, fill, is_scale: true, has_dots }
        };
        match &self.look {
            Look::OnMap(level) => {
                let coloured = coloured(&level.level.mesh, MeshOwner::Level, values.clone(), true);
                let mut shapes = draw_map(self.patch, level, &coloured, view);
                shapes.extend(fault(level).map(|_| warning(view)));
                shapes
            }
            Look::InSpace(camera, level) => {
                let prolongation = level.and_then(|level| level.level.to_finest.as_ref());
                let on_taxels = prolongation.map_or_else(|| values.clone(), |p| carry_known(p, values));
                let coloured =
                    coloured(self.patch.mesh, MeshOwner::Taxels, on_taxels, prolongation.is_none());
                let dots = if has_dots { self.centres(*level) } else { Vec::new() };
                draw_in_space(self.patch, &coloured, camera, view, self.patch.seam(), &dots)
            }
            Look::Between(..) => Vec::new(),
        }
    }
}

/// Values of a level on the taxels: the mean of the known values of their fields.
fn carry_known(prolongation: &Prolongation, values: &IdVec<VertexId, f64>) -> IdVec<VertexId, f64> {
    let mean = |taxel| mean_of_known(prolongation.row(taxel).map(|(field, w)| (values[field], w)));
    prolongation.indices.ids().map(mean).collect()
}

/// The fault of a map, in a word or two.
fn fault(level: &MapLevel) -> Option<&'static str> {
    let d = &level.distortion;
    if d.flips > 0 {
        Some("flipped triangles")
    } else if d.crossings > 0 {
        Some("overlaps itself")
    } else if d.is_far_from_isometric() {
        Some("far from isometric")
    } else {
        // A map whose faces have no area is not poor.
        (d.is_poor() && !d.symmetric_dirichlet.is_nan()).then_some("poor")
    }
}

/// A frame around a map that has a fault.
fn warning(view: &View) -> Shape {
    let path = Path::rectangle(view.corner, view.size);
    let stroke = Stroke { colour: WARNING, width: 3.0, opacity: 1.0 };
    Shape::Path { path, fill: None, stroke: Some(stroke) }
}

fn caption_of_map(name: &str, id: LevelId, level: &MapLevel) -> Caption {
    let (d, count) = (&level.distortion, level.level.mesh.positions.len());
    let kind = if id == LevelId::default() { "taxels" } else { "fields" };
    let stretch = format!("s1/s2 {} (max {})", number(d.qc_mean, 3), number(d.qc_max, 2));
    let area = format!("area ratio {} (max {})", number(d.area_mean, 3), number(d.area_max, 2));
    Caption {
        name: printable(name),
        which: format!(", level {id}{}", fault(level).map_or_else(String::new, |word| format!(": {word}"))),
        about: [format!("{count} {kind}, {} flips", d.flips), format!("{stretch}, {area}")],
    }
}

fn caption_of_unfolding(patch: &PatchView<'_>, time: f64) -> Caption {
    let which = if time == 0.0 {
        ", in space".into()
    } else if time == 1.0 {
        ", its map".into()
    } else {
        format!(", {} % unfolded", number(100.0 * time, 0))
    };
    let taxels = patch.mesh.positions.len();
    Caption { name: printable(patch.name), which, about: [format!("{taxels} taxels"), String::new()] }
}

fn caption_in_space(patch: &PatchView<'_>, camera: &Camera) -> Caption {
    let [azimuth, elevation] = camera.degrees.map(degrees);
    let [taxels, triangles] = [patch.mesh.positions.len(), patch.mesh.triangles.len()];
    Caption {
        name: printable(patch.name),
        which: ", in space".into(),
        about: [
            format!("{taxels} taxels, {triangles} triangles"),
            format!("seen from azimuth {azimuth}, elevation {elevation}{}", camera.stands_on()),
        ],
    }
}

/// An angle in degrees with at most a tenth, and a minus as wide as a figure.
fn degrees(x: f64) -> String {
    let tenths = (10.0 * x).round() / 10.0;
    format!("{}{}°", minus(tenths), tenths.abs())
}
