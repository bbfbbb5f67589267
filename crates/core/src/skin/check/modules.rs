//! *Heuristic*: modules of one skin that are not congruent, as if a lattice had been stretched over a surface.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::id::VertexId;
use crate::numeric::median;
use crate::skin::check::FindingKind;
use crate::skin::check::finding::Report;
use crate::skin::{Presence, Sheet};

/// Modules differ if neighbouring taxels of one are farther apart than this share from those of the others: bent to a
/// radius of 20 mm, taxels 6.5 mm apart come only 0.5 % nearer.
const MAX_STRAIN: f64 = 0.1;

/// Distances up to this multiple of the least are those of neighbours: the next ones in a lattice are 1.7 times as long.
const NEIGHBOURS: f64 = 1.5;

/// Taxels of the triangles of iCub and CySkin, which are all congruent. Boards of palms and fingertips have others.
const TAXELS: usize = 10;

/// Ids of CySkin: 16 of a module; an eleventh taxel near a corner, which not all modules have, is not compared.
const BLOCK: u32 = 16;

/// Reports the taxels of modules that are not congruent with most of the others. They are compared by their distances in
/// ascending order, since the order of their ids depends on the wiring.
pub(super) fn check_congruent(sheet: &Sheet, report: &mut Report<'_>) {
    let at = |v: &VertexId| sheet.positions[v.index()];
    let distances = |module: &Vec<VertexId>| -> Vec<f64> {
        let pairs = (0..module.len()).flat_map(|k| (0..k).map(move |j| (j, k)));
        let mut all: Vec<f64> = pairs.map(|(j, k)| DVec3::distance(at(&module[j]), at(&module[k]))).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    // Modules that are not there have all taxels at one place.
    let modules = modules(sheet).into_iter().map(|module| (distances(&module), module));
    let modules: Vec<(Vec<f64>, Vec<VertexId>)> = modules.filter(|(all, _)| all[0] > 0.0).collect();
    // Of two, neither is like the others.
    if modules.len() < 3 {
        return;
    }
    let typical = |k: usize| median(modules.iter().map(|(all, _)| all[k])).unwrap_or_default();
    let least = typical(0);
    let typical: Vec<f64> =
        (0..modules[0].0.len()).map(typical).take_while(|d| *d <= NEIGHBOURS * least).collect();
    let strain = |all: &[f64]| {
        all.iter().zip(&typical).map(|(d, typical)| (d / typical - 1.0).abs()).fold(0.0, f64::max)
    };
    let strained: Vec<(f64, &Vec<VertexId>)> = modules
        .iter()
        .map(|(all, module)| (strain(all), module))
        .filter(|(strain, _)| *strain > MAX_STRAIN)
        .collect();
    let most = 100.0 * strained.iter().map(|(strain, _)| *strain).fold(0.0, f64::max);
    let kind = FindingKind::ModulesNotCongruent { modules: strained.len(), of: modules.len(), most };
    report.add_vertices(kind, strained.iter().flat_map(|(_, module)| module.iter().copied()));
}

/// The triangles among the modules of a sheet: those of the file, or where the ids are those of CySkin, by them.
fn modules(sheet: &Sheet) -> Vec<Vec<VertexId>> {
    let is_taxel = |v: usize| {
        sheet.positions[v].is_finite()
            && sheet.presence.as_ref().is_none_or(|presence| presence[v] == Presence::Present)
    };
    let numbers = match (&sheet.modules, &sheet.ids) {
        (Some(modules), _) => modules.iter().map(|module| (*module, 1)).collect(),
        (None, Some(ids)) => ids.iter().map(|id| (id.0 / BLOCK, id.0 % BLOCK)).collect(),
        (None, None) => Vec::new(),
    };
    let mut modules: BTreeMap<u32, Vec<VertexId>> = BTreeMap::new();
    let mut others = 0;
    for (v, &(module, place)) in numbers.iter().enumerate().filter(|(v, _)| is_taxel(*v)) {
        match place {
            1..=10 => modules.entry(module).or_default().push(VertexId::new(v)),
            11 => {}
            _ => others += 1,
        }
    }
    // Ids of other makers, and ids that count taxels, are in all places of a block.
    if 50 * others > numbers.len() {
        return Vec::new();
    }
    modules.into_values().filter(|module| module.len() == TAXELS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skin::TaxelId;

    /// Six modules of ten taxels in a row; those of one are drawn a fifth farther apart.
    fn row(stretched: Option<u32>) -> Sheet {
        let taxels = (0..6).flat_map(|m| (1..=10).map(move |k| (m, k)));
        let place = |(m, k): (u32, u32)| {
            let pitch = if Some(m) == stretched { 0.0078 } else { 0.0065 };
            DVec3::new(f64::from(k) * pitch, f64::from(m) * 0.03, 0.0)
        };
        Sheet {
            positions: taxels.clone().map(place).collect(),
            ids: Some(taxels.map(|(m, k)| TaxelId(16 * m + k)).collect()),
            ..Sheet::default()
        }
    }

    #[test]
    fn a_stretched_module_is_found_by_the_ids_of_its_maker() {
        let findings = |sheet: &Sheet| {
            let mut report = Report::new("arm");
            check_congruent(sheet, &mut report);
            report.findings
        };
        assert!(findings(&row(None)).is_empty());
        let found = findings(&row(Some(4)));
        assert_eq!(found.len(), 1);
        assert!(found[0].to_string().contains("1 of 6 modules"), "{}", found[0]);
        // Other ids say nothing about modules.
        let counted = Sheet { ids: Some((1..=60).map(TaxelId).collect()), ..row(Some(4)) };
        assert!(findings(&counted).is_empty());
        let listed = Sheet { modules: Some((0..60).map(|k| k / 10).collect()), ..counted };
        assert_eq!(findings(&listed).len(), 1);
    }
}
