//! Turns the faces of a draft outward before some of them are chosen: a part of a surface does not show where the outside
//! of the whole is.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use rayon::prelude::*;

use crate::id::FaceId;
use crate::skin::assemble::components::Components;
use crate::skin::assemble::patch::{given_normals, turn_outward};
use crate::skin::normals::NormalQuality;
use crate::skin::weld::WeldOptions;
use crate::skin::{AssembleOptions, Draft, LinkId, Remark, RemarkKind, Sheet};

/// Winds the faces of each sheet as [`assemble`](crate::skin::assemble()) would wind the whole sheet, and drops normals that
/// it would not use, so that faces can be left out before the draft is assembled and the rest keeps its outside.
/// Returns what was turned over.
///
/// Edges with more than two faces are split as with [`AssembleOptions::repair`]. A sheet that cannot be repaired stays as
/// it is: the part of it that is kept may be valid. Bare taxels are not changed.
///
/// ```
/// use dermatome::{mesh::shapes, skin::{AssembleOptions, Draft, Sheet, orient}};
///
/// let ball = shapes::ball(2, 0.1);
/// let triangles = ball.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| v.raw())).collect();
/// let sheet = Sheet { positions: ball.positions.into_iter().collect(), triangles, ..Sheet::default() };
/// let mut draft = Draft { sheets: vec![sheet], ..Draft::default() };
/// let oriented = orient(&mut draft, &AssembleOptions::default());
/// assert!(oriented.remarks(&draft)[0].to_string().contains("were wound against the closed surface"));
/// let outward: Vec<_> = ball.triangles.iter().map(|t| t.map(|v| v.raw())).collect();
/// assert_eq!(draft.sheets[0].triangles, outward);
/// ```
pub fn orient(draft: &mut Draft, options: &AssembleOptions) -> Oriented {
    let (links, weld) = (draft.links.len(), options.weld);
    let orient = |sheet: &mut Sheet| orient_sheet(sheet, links, WeldOptions { weld, repair: true });
    let sheets: Vec<Option<OrientedSheet>> = draft.sheets.par_iter_mut().map(orient).collect();
    Oriented { sheets: sheets.into_iter().flatten().collect() }
}

/// What [`orient`] changed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Oriented {
    sheets: Vec<OrientedSheet>,
}

/// What was changed in a sheet.
#[derive(Debug, Clone, PartialEq)]
struct OrientedSheet {
    title: String,
    link: Option<LinkId>,
    /// Each change, and the component that it is of.
    changes: Vec<(usize, RemarkKind)>,
    /// The component at the position of each vertex.
    at: HashMap<[u64; 3], usize>,
}

impl Oriented {
    /// Remarks on the components of which a draft still has faces, by their corners; on all of a sheet if it has faces with
    /// other corners alone, as where a box cuts a part out of one face.
    pub fn remarks(&self, draft: &Draft) -> Vec<Remark> {
        let of_sheet = |of: &OrientedSheet| {
            let sheets = draft.sheets.iter();
            let sheets = sheets.filter(|sheet| sheet.title() == of.title && sheet.link == of.link);
            let faces = sheets.flat_map(|sheet| sheet.triangles.iter().map(move |t| (sheet, t)));
            let corners = |(sheet, t): (&Sheet, &[u32; 3])| {
                t.map(|v| of.at.get(&place(*sheet.positions.get(v as usize)?)).copied())
            };
            let corners: HashSet<Option<usize>> = faces.flat_map(corners).collect();
            let is_cut = corners.len() == 1 && corners.contains(&None);
            let is_left = |component: usize| is_cut || corners.contains(&Some(component));
            let changes = of.changes.iter().filter(|(component, _)| is_left(*component));
            let remark =
                |(_, kind): &(usize, RemarkKind)| Remark { patch: of.title.clone(), kind: kind.clone() };
            changes.map(remark).collect::<Vec<_>>()
        };
        self.sheets.iter().flat_map(of_sheet).collect()
    }
}

/// The bits of a position; adding zero makes -0 and 0 equal.
fn place(p: DVec3) -> [u64; 3] {
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// `None` where nothing needs to be changed.
fn orient_sheet(sheet: &mut Sheet, links: usize, welding: WeldOptions) -> Option<OrientedSheet> {
    if sheet.triangles.is_empty() || sheet.validate(links).is_err() {
        return None;
    }
    let components = Components::new(sheet, welding, &mut Vec::new()).ok()?;
    let mut changes = Vec::new();
    let mut is_inside_out = vec![false; components.count];
    let mut is_unusable = vec![false; components.count];
    for mut component in components.split() {
        let quality = given_normals(&components, &component).map(|(_, quality)| quality);
        is_unusable[component.number] = matches!(quality, Some(NormalQuality::Unreliable(_)));
        let mut remarks = Vec::new();
        if let Some(NormalQuality::Unreliable(reason)) = quality {
            remarks.push(RemarkKind::NormalsIgnored { reason });
        }
        is_inside_out[component.number] = turn_outward(&mut component, quality, &mut remarks);
        changes.extend(remarks.into_iter().map(|kind| (component.number, kind)));
    }
    // Where no component changes, faces with the corners of an earlier one may.
    if changes.is_empty() && components.duplicates.is_empty() {
        return None;
    }
    let mut at = HashMap::new();
    let mut is_turned = vec![false; sheet.triangles.len()];
    let mut unusable = Vec::new();
    for (face, of) in components.component.enumerate() {
        let Some(of) = *of else { continue };
        let in_file = components.file_faces[face].index();
        for v in sheet.triangles[in_file] {
            at.insert(place(sheet.positions[v as usize]), of);
        }
        is_turned[in_file] = components.turned[face] != is_inside_out[of];
        if is_unusable[of] {
            unusable.push(in_file);
        }
    }
    turn_duplicates(&components, &mut is_turned);
    for (face, _) in is_turned.iter().enumerate().filter(|(_, turned)| **turned) {
        sheet.triangles[face].swap(1, 2);
        if let Some(texture) = &mut sheet.texture {
            texture[face].swap(1, 2);
        }
    }
    if let Some(normals) = &mut sheet.normals {
        for v in unusable.into_iter().flat_map(|face| sheet.triangles[face]) {
            normals[v as usize] = DVec3::ZERO;
        }
        if normals.iter().all(|n| *n == DVec3::ZERO) {
            sheet.normals = None;
        }
    }
    Some(OrientedSheet { title: sheet.title().to_owned(), link: sheet.link, changes, at })
}

/// Faces with the corners of an earlier one become wound as that is.
fn turn_duplicates(components: &Components<'_>, is_turned: &mut [bool]) {
    if components.duplicates.is_empty() {
        return;
    }
    let triangles = &components.sheet.triangles;
    let corners = |face: usize| triangles[face].map(|v| components.place[v.into()]);
    let key = |face: usize| {
        let mut corners = corners(face);
        corners.sort_unstable();
        corners
    };
    // Of three different numbers in a ring two ascend, or one.
    let is_ascending = |face: usize| {
        let [a, b, c] = corners(face);
        [a < b, b < c, c < a].into_iter().filter(|ascends| *ascends).count() == 2
    };
    let kept: HashMap<_, usize> =
        components.file_faces.iter().map(|face: &FaceId| (key(face.index()), face.index())).collect();
    for face in components.duplicates.iter().map(|face| face.index()) {
        if let Some(&first) = kept.get(&key(face)) {
            is_turned[face] = is_turned[first] != (is_ascending(face) != is_ascending(first));
        }
    }
}
