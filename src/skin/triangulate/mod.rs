//! Bare taxels to a mesh.

mod repair;
mod growing_mesh;
mod kd_tree;
mod coincident;
mod neighbours;
mod normals;
mod orient_normals;
mod orient_outward;
mod unique_points;
mod tangent_star;
mod point_cloud;
mod candidates;

use std::collections::BTreeSet;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::smallest_first,
    skin::{
        Draft, Remark, RemarkKind, Sheet, SkinError,
        assemble::check_sheet,
        names::sheet_name,
        remark::first_few,
        triangulate::{
            candidates::weave,
            neighbours::Neighbours,
            normals::Normals,
            orient_normals::orient,
            orient_outward::{Outside, turn_outward},
            point_cloud::Surroundings,
        },
    },
};

pub(super) use unique_points::Places;

/// How bare taxels are meshed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshOptions {
    /// Longest edge over the spacing of the taxels at its ends, from 1 to 20: what is longer spans a real gap, and a boundary
    /// stays there.
    pub gap: f64,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self { gap: 2.5 }
    }
}

/// Gaps that make sense: below 1 nothing is joined, and work grows with the square.
const GAPS: std::ops::RangeInclusive<f64> = 1.0..=20.0;

/// Neighbourhoods that are this thick, half of them or more, are those of a cloud: a noise of a third of the spacing
/// reaches 0.1, random points in a ball 0.5.
const THICKEST: f64 = 0.25;

/// That less than one in so many normals of the file looks to the wrong side is not worth a word.
const FEW: usize = 20;

/// A sheet without triangles, and where its taxels lie.
#[derive(Debug)]
struct Bare<'a> {
    sheet: &'a Sheet,
    places: Places,
}

impl Draft {
    /// Whether it holds taxels, but no triangle.
    #[must_use]
    pub fn is_bare(&self) -> bool {
        self.sheets.iter().all(|s| s.triangles.is_empty())
            && self.sheets.iter().any(|s| !s.positions.is_empty())
    }
}

/// Joins the taxels of every sheet of a draft without triangles, and adds to its remarks what was done;
/// [`crate::skin::assemble`] calls it with the default options.
///
/// - **Taxels** at one place become one (the first that reads pressure), and so do taxels closer than a fiftieth of the spacing:
///   the same place, rounded otherwise. Slots that hold nothing are left out. Thermal pads and dead taxels have a place, and
///   stay. Taxels keep the order of the file; arrays move with them.
/// - The **spacing** is the distance to the third nearest taxel, smoothed.
/// - **Normals** are those of rigid modules ([`Sheet::modules`]), else planes of least squares, turned to one side along a
///   spanning tree (Hoppe et al. 1992, judged as by König and Gumhold 2009). Those of the file, where these are believable (unit
///   vectors along the planes of the neighbourhoods, not all the same on a curved part), keep the sides of a thin part apart, lead
///   the tree, stand in where a sharp edge or a strip has no plane, and tell the outside.
/// - **Triangles** are those of the Delaunay triangulations in the tangent planes on which at least two corners agree, then
///   those of one corner that fit between them; a square is cut along one diagonal by the place of its corners. Edges are no longer
///   than [`MeshOptions::gap`] times the spacing at their ends. The mesh is an oriented manifold: a face that would give an edge a
///   third face, or overlap in the tangent plane of a corner, is not taken.
/// - The **outside** of pieces whose normals do not tell it, two thirds of them, is away from the middle of the sheet.
///
/// The result does not depend on the order of the taxels, up to the order of their names, nor on frame and unit, except for which
/// diagonal a square gets. Time and memory are near-linear.
///
/// # Errors
/// If an option is out of range, or the taxels of every sheet have fewer than three places, lie in a cloud rather than on a
/// surface, or have no triangle within the gap. Such a sheet among others is left out, with a remark.
pub fn mesh_bare(draft: &Draft, options: &MeshOptions) -> Result<Draft, SkinError> {
    let mut meshed = draft.clone();
    for sheet in &meshed.sheets {
        check_sheet(sheet, &draft.links)?;
    }
    let gap = options.gap;
    if !GAPS.contains(&gap) {
        return Err(SkinError::Gap { found: gap });
    }
    let sheets = std::mem::take(&mut meshed.sheets);
    let mut refused = None;
    for sheet in sheets {
        if sheet.positions.is_empty() {
            meshed.sheets.push(sheet);
            continue;
        }
        match mesh_sheet(&sheet, gap, &mut meshed.remarks) {
            Ok(sheet) => meshed.sheets.push(sheet),
            Err(why) => {
                let message = format!("{} taxels were left out: {why}", sheet.positions.len());
                let patch = sheet_name(&sheet).to_owned();
                meshed.remarks.push(Remark { kind: RemarkKind::LeftOut, patch, message });
                refused.get_or_insert(why);
            }
        }
    }
    match refused {
        Some(why) if meshed.sheets.iter().all(|s| s.triangles.is_empty()) => Err(why),
        _ => Ok(meshed),
    }
}

fn mesh_sheet(sheet: &Sheet, gap: f64, remarks: &mut Vec<Remark>) -> Result<Sheet, SkinError> {
    let patch = || sheet_name(sheet).to_owned();
    let bare = Bare { sheet, places: Places::new(sheet) };
    let positions = &bare.places.positions;
    let places = positions.len();
    if places < 3 {
        return Err(SkinError::TooFewPlaces { patch: patch(), found: places });
    }
    let mut neighbours = Neighbours::new(positions, gap);
    let mut normals = Normals::new(&bare, &mut neighbours);
    if normals.thickness > THICKEST && !normals.has_file() {
        return Err(SkinError::NoSurface { patch: patch(), thickness: normals.thickness });
    }
    orient(&mut normals, positions, &neighbours);
    normals.replace_bad_planes(&neighbours);
    let mut triangles =
        weave(&Surroundings { positions, normals: &normals.normal, neighbours: &neighbours, gap });
    if triangles.is_empty() {
        return Err(SkinError::NoFace { patch: patch(), places });
    }
    let outside = turn_outward(&mut triangles, positions, &normals.file);
    let mut tell = |kind, message| remarks.push(Remark { kind, patch: patch(), message });
    let reach = length(gap * bare.places.unit * median(&neighbours.spacing));
    let faces = triangles.len();
    let joined = triangles.iter().flatten().collect::<BTreeSet<_>>().len();
    let message = format!(
        "{joined} bare taxels were joined by {faces} triangles; longer edges than {gap} times the spacing, here {reach}, \
         are gaps"
    );
    tell(RemarkKind::Meshed, message);
    bare.remark(&normals, outside, &mut tell);
    Ok(bare.sheet_of(&triangles, &normals, &mut tell))
}

/// A length in m, told in mm where that is readable.
fn length(metres: f64) -> String {
    if (1e-6..1e3).contains(&metres) { format!("{:.3} mm", 1e3 * metres) } else { format!("{metres:.3e} m") }
}

fn median(spacing: &IdVec<VertexId, f64>) -> f64 {
    let mut spacing = spacing.as_slice().to_vec();
    let middle = spacing.len() / 2;
    *spacing.select_nth_unstable_by(middle, f64::total_cmp).1
}

impl Bare<'_> {
    /// Tells what was assumed about the taxels.
    fn remark(&self, normals: &Normals, outside: Outside, tell: &mut impl FnMut(RemarkKind, String)) {
        let Places { merged, absent, .. } = &self.places;
        if *absent > 0 {
            tell(RemarkKind::PassedOver, format!("{absent} empty slots were left out"));
        }
        if !merged.is_empty() {
            let list = first_few(merged.iter());
            let message = format!("{} and were merged with it: {list}", self.places.told_merged());
            tell(RemarkKind::Merged, message);
        }
        if let Some(why) = normals.refused {
            tell(RemarkKind::Normals, format!("{why}; those of the faces replace them"));
        }
        let Outside { centre, undecided, opposed, normals } = outside;
        if opposed > normals / FEW {
            let message = format!(
                "{opposed} of {normals} normals oppose those of their neighbours; the planes of the neighbourhoods were used, and \
                 of a piece the side that two thirds of its normals tell"
            );
            tell(RemarkKind::Normals, message);
        }
        if centre > 0 {
            let message = format!(
                "no normals tell the outside; it was assumed away from the middle of the part for {centre} pieces"
            );
            tell(RemarkKind::Outside, message);
        }
        if undecided > 0 {
            let message = format!(
                "no normals tell the outside, and {undecided} pieces bulge neither way; of their two sides the one \
                 towards +x, +y or +z was assumed, whichever they face most"
            );
            tell(RemarkKind::Outside, message);
        }
    }

    /// The taxels that have a face, in the order of the file, and their faces.
    fn sheet_of(
        &self,
        triangles: &IdVec<FaceId, [VertexId; 3]>,
        normals: &Normals,
        tell: &mut impl FnMut(RemarkKind, String),
    ) -> Sheet {
        let sheet = self.sheet;
        let places = &self.places;
        let mut used = vec![false; sheet.positions.len()];
        for &v in triangles.iter().flatten() {
            used[places.taxel[v]] = true;
        }
        let mut left_out: Vec<usize> = places.taxel.iter().copied().filter(|&k| !used[k]).collect();
        left_out.sort_unstable();
        if !left_out.is_empty() {
            let list = first_few(left_out.iter());
            let message =
                format!("{} taxels found no place in a triangle and were left out: {list}", left_out.len());
            tell(RemarkKind::LeftOut, message);
        }
        let kept: Vec<usize> = (0..used.len()).filter(|&k| used[k]).collect();
        let mut number = vec![0_u32; used.len()];
        (0..).zip(&kept).for_each(|(new, &k)| number[k] = new);
        let mut faces: Vec<[u32; 3]> =
            triangles.iter().map(|t| smallest_first(t.map(|v| number[places.taxel[v]]))).collect();
        faces.sort_unstable();
        Sheet {
            name: sheet.name.clone(),
            link: sheet.link,
            positions: pick(&sheet.positions, &kept),
            triangles: faces,
            ids: sheet.ids.as_ref().map(|x| pick(x, &kept)),
            normals: sheet.normals.as_ref().filter(|_| normals.refused.is_none()).map(|x| pick(x, &kept)),
            areas: sheet.areas.as_ref().map(|x| pick(x, &kept)),
            densities: sheet.densities.as_ref().map(|x| pick(x, &kept)),
            presence: sheet.presence.as_ref().map(|x| pick(x, &kept)),
            covariances: sheet.covariances.as_ref().map(|x| pick(x, &kept)),
            modules: sheet.modules.as_ref().map(|x| pick(x, &kept)),
        }
    }
}

fn pick<T: Copy>(values: &[T], kept: &[usize]) -> Vec<T> {
    kept.iter().map(|&k| values[k]).collect()
}
