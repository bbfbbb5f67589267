//! What every part of the check works on: one sheet, and the findings about it.

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    skin::{
        Sheet,
        check::finding::{Finding, FindingKind},
        weld::{welded_mesh::WeldedMesh, winding::Winding},
    },
};

/// One sheet with everything that the parts of the check need to know about it.
pub(super) struct Subject<'a> {
    pub sheet: &'a Sheet,
    pub surface: WeldedMesh,
    pub winding: Winding,
    /// Unit normals of the taxels, zero where there is none; `None` without normals.
    pub normals: Option<IdVec<VertexId, DVec3>>,
}

/// The findings of one sheet, at most one of each kind.
pub(super) struct Report<'a> {
    pub patch: &'a str,
    pub findings: Vec<Finding>,
}

impl Report<'_> {
    /// Adds a finding, unless it has no elements; `message` takes their number.
    pub(super) fn add(
        &mut self,
        kind: FindingKind,
        elements: Vec<u64>,
        message: impl FnOnce(usize) -> String,
    ) {
        let per_item = if kind.elements() == "edges" { 2 } else { 1 };
        if !elements.is_empty() {
            let count = elements.len() / per_item;
            let message = if count == 1 { of_one(&message(1)) } else { message(count) };
            self.findings.push(Finding { kind, patch: self.patch.to_owned(), elements, message });
        }
    }

    pub(super) fn add_whole(&mut self, kind: FindingKind, message: String) {
        self.findings.push(Finding::of_sheet(kind, self.patch, message));
    }
}

/// A sentence that begins with the number 1: its first noun and verb in the singular.
fn of_one(message: &str) -> String {
    const NOUNS: [[&str; 2]; 9] = [
        ["faces ", "face "],
        ["edges ", "edge "],
        ["vertices ", "vertex "],
        ["taxels ", "taxel "],
        ["pieces ", "piece "],
        ["normals ", "normal "],
        ["tangents ", "tangent "],
        ["areas ", "area "],
        ["densities ", "density "],
    ];
    const VERBS: [[&str; 2]; 6] = [
        [" are ", " is "],
        [" have ", " has "],
        [" use ", " uses "],
        [" lie ", " lies "],
        [" belong ", " belongs "],
        [" name ", " names "],
    ];
    let Some(rest) = message.strip_prefix("1 ") else { return message.to_owned() };
    let noun = NOUNS.iter().find(|[several, _]| rest.starts_with(several));
    let rest = noun.map_or_else(|| rest.to_owned(), |[several, one]| rest.replacen(several, one, 1));
    let verb = VERBS.iter().filter_map(|verb| Some((rest.find(verb[0])?, verb))).min();
    let rest = verb.map_or_else(|| rest.clone(), |(_, [several, one])| rest.replacen(several, one, 1));
    format!("1 {rest}")
}

/// Elements as a finding lists them.
pub(super) fn numbers<T: Copy + Into<u64>>(elements: impl IntoIterator<Item = T>) -> Vec<u64> {
    elements.into_iter().map(Into::into).collect()
}

#[cfg(test)]
mod tests {
    use super::of_one;

    #[test]
    fn one_thing_is_spoken_of_in_the_singular() {
        for (several, one) in [
            ("1 faces use one taxel twice", "1 face uses one taxel twice"),
            ("1 of 3 faces are wound against most", "1 of 3 faces is wound against most"),
            ("1 pieces have no boundary: they are cut", "1 piece has no boundary: they are cut"),
            ("12 holes", "12 holes"),
        ] {
            assert_eq!(of_one(several), one);
        }
    }
}
