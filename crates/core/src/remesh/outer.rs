//! The outer faces of shells of CAD, without inner sides of walls, ribs and screws.

use std::collections::{BTreeMap, HashMap, HashSet};

use rayon::prelude::*;

use crate::numeric::bits;
use crate::remesh::seen::{Judged, judge};
use crate::remesh::sight::{Sight, corners};
use crate::skin::{Draft, LinkId, Remark, RemarkKind};

/// Links that a sentence names.
const MOST_NAMES: usize = 5;

/// What [`keep_outer`] left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeftOut {
    /// How many faces of the draft, as a whole.
    pub faces: usize,
    /// Of how many faces of the draft a part.
    pub parts: usize,
    /// By the name of the link, or of the first sheet where the file has none: the area that is seen from a tenth to a quarter of
    /// the directions, as the inside of a cup, in m^2.
    pub glimpsed: Vec<(String, f64)>,
}

impl LeftOut {
    /// Counts what is left out of a sheet of `count` faces; each flag is of a part of the face in `origins`.
    fn count(&mut self, is_kept: &[bool], origins: &[usize], count: usize) {
        let mut of_face = vec![[false; 2]; count];
        for (&kept, &face) in is_kept.iter().zip(origins) {
            of_face[face][usize::from(kept)] = true;
        }
        self.faces += of_face.iter().filter(|&&flags| flags == [true, false]).count();
        self.parts += of_face.iter().filter(|&&flags| flags == [true, true]).count();
    }

    /// What was left out, in sentences.
    pub fn notes(&self) -> Vec<String> {
        let faces = |count: usize| if count == 1 { "1 face".to_owned() } else { format!("{count} faces") };
        let are = if self.faces == 1 { "is" } else { "are" };
        let not_seen = match (self.faces, self.parts) {
            (0, 0) => return Vec::new(),
            (0, parts) => format!("of {} a part is not seen from outside, and left out", faces(parts)),
            (all, 0) => format!("{} {are} not seen from outside, and left out", faces(all)),
            (all, parts) => {
                let whole = faces(all);
                format!("{whole} {are} not seen from outside, and left out; of {parts} more a part")
            }
        };
        let mut glimpsed: Vec<&(String, f64)> = self.glimpsed.iter().collect();
        glimpsed.sort_by(|a, b| b.1.total_cmp(&a.1));
        let areas: Vec<String> = glimpsed
            .iter()
            .take(MOST_NAMES)
            .map(|(name, area)| format!("{name} {:.1} cm^2", 1e4 * area))
            .collect();
        let others = match glimpsed.len().saturating_sub(MOST_NAMES) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        let through = || {
            let areas = areas.join(", ");
            format!("of them, a tenth to a quarter of all directions see, as inside a cup: {areas}{others}")
        };
        [Some(not_seen), (!areas.is_empty()).then(through)].into_iter().flatten().collect()
    }
}

/// Keeps what can be seen from outside of each link, ignoring the other links: faces that are free in a quarter of the
/// directions on one of their sides. Faces that are partly seen are divided; parts of a smooth surface that are smaller than
/// 1/32 of the link across stay with what is around them. Of faces with the same corners in several sheets of a link the first
/// stays. Sheets of files without links belong to one link; a remark names each sheet that
/// is left out completely, and each link that cannot be searched, which is kept whole.
///
/// Faces with a corner out of range or not finite are kept; they are refused when the sheet is assembled. Where a sheet has ids or
/// other values of vertices than normals, its faces are kept or left out whole.
pub fn keep_outer(draft: &mut Draft) -> LeftOut {
    let mut links: BTreeMap<Option<LinkId>, Vec<usize>> = BTreeMap::new();
    for (k, sheet) in draft.sheets.iter().enumerate().filter(|(_, sheet)| !sheet.triangles.is_empty()) {
        links.entry(sheet.link).or_default().push(k);
    }
    let mut left_out = LeftOut::default();
    let mut kept: BTreeMap<usize, Vec<bool>> = BTreeMap::new();
    for (link, sheets) in links {
        let name = link
            .and_then(|link| draft.links.get(link))
            .map(|link| link.name.clone())
            .filter(|name| !name.is_empty())
            .unwrap_or_else(|| draft.sheets[sheets[0]].title().to_owned());
        let sight = match Sight::new(sheets.iter().map(|&k| &draft.sheets[k])) {
            Ok(sight) => sight,
            Err(error) => {
                let what = format!("what can be seen of it is not known, so it is kept whole: {error}");
                draft.remarks.push(Remark { patch: name, kind: RemarkKind::PassedOver { what } });
                continue;
            }
        };
        let judged: Vec<Judged> = sheets.par_iter().map(|&k| judge(&sight, &draft.sheets[k])).collect();
        let glimpsed: f64 = judged.iter().map(|judged| judged.glimpsed).sum();
        if glimpsed > 0.0 {
            left_out.glimpsed.push((name, glimpsed));
        }
        let second = second_faces(draft, &sheets);
        for ((k, judged), second) in sheets.into_iter().zip(judged).zip(second) {
            let Judged { sheet, mut is_kept, origins, .. } = judged;
            is_kept.iter_mut().zip(&origins).for_each(|(kept, face)| *kept = *kept && !second.contains(face));
            // A sheet of which all is seen keeps the faces of the file.
            if is_kept.contains(&false) {
                left_out.count(&is_kept, &origins, draft.sheets[k].triangles.len());
                draft.sheets[k] = sheet;
                kept.insert(k, is_kept);
            }
        }
    }
    for (&k, _) in kept.iter().filter(|(_, kept)| !kept.contains(&true)) {
        let kind = RemarkKind::PassedOver { what: "cannot be seen from outside, and left out".into() };
        draft.remarks.push(Remark { patch: draft.sheets[k].title().to_owned(), kind });
    }
    let all: Vec<usize> = draft.sheets.iter().map(|sheet| sheet.triangles.len()).collect();
    let mut flags = all.iter().enumerate().flat_map(|(k, &count)| {
        (0..count).map({
            let kept = kept.get(&k);
            move |face| kept.is_none_or(|kept| kept[face])
        })
    });
    // Sheets without triangles are kept.
    draft.retain(|sheet, _| sheet.triangles.is_empty() || flags.next().unwrap_or(true));
    left_out
}

/// The faces of each of these sheets that have the corners of a face of an earlier one: a robot may name one mesh twice.
fn second_faces(draft: &Draft, sheets: &[usize]) -> Vec<HashSet<usize>> {
    let mut first: HashMap<[[u64; 3]; 3], usize> = HashMap::new();
    let mut second = vec![HashSet::new(); sheets.len()];
    if sheets.len() < 2 {
        return second;
    }
    for (k, &sheet) in sheets.iter().enumerate() {
        let sheet = &draft.sheets[sheet];
        for (face, triangle) in sheet.triangles.iter().enumerate() {
            let Some(corners) = corners(sheet, triangle) else { continue };
            let mut key = corners.map(|p| bits(p.to_array()));
            key.sort_unstable();
            if *first.entry(key).or_insert(k) != k {
                second[k].insert(face);
            }
        }
    }
    second
}
