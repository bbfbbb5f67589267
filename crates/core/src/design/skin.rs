//! The taxels of modules, as a skin that can be assembled.

use std::collections::BTreeMap;

use crate::design::{Module, Plate};
use crate::id::IdVec;
use crate::skin::{Draft, Link, LinkId, Sheet, TaxelId};

/// A module of a skin, and what it is called there.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedModule {
    /// Its number: ids of its taxels are `number * block + 1` and so on, as [`Module::block`] says.
    pub number: u32,
    /// Where it is, in the frame of its link.
    pub plate: Plate,
    /// The name of the patch it belongs to.
    pub patch: String,
    /// The number of its link in the links of the skin.
    pub link: Option<LinkId>,
}

/// The taxels of modules without triangles, a sheet for each patch and link, in the order of their first modules.
pub fn skin_draft(module: &Module, placed: &[PlacedModule], links: IdVec<LinkId, Link>) -> Draft {
    let mut sheets: Vec<Sheet> = Vec::new();
    let mut by_name: BTreeMap<(&str, Option<LinkId>), usize> = BTreeMap::new();
    let block = module.block();
    for PlacedModule { number, plate, patch, link } in placed {
        let sheet = *by_name.entry((patch, *link)).or_insert_with(|| {
            sheets.push(Sheet {
                name: patch.clone(),
                link: *link,
                is_bare: true,
                ids: Some(Vec::new()),
                normals: Some(Vec::new()),
                ..Sheet::default()
            });
            sheets.len() - 1
        });
        let sheet = &mut sheets[sheet];
        sheet.positions.extend(module.taxels.iter().map(|&at| plate.point(at)));
        let ids = (0..)
            .zip(&module.taxels)
            .map(|(k, _): (u32, _)| TaxelId(number.wrapping_mul(block).wrapping_add(k + 1)));
        sheet.ids.iter_mut().for_each(|all| all.extend(ids.clone()));
        let normals = module.taxels.iter().map(|&at| plate.normal(at));
        sheet.normals.iter_mut().for_each(|all| all.extend(normals.clone()));
    }
    Draft { links, sheets, ..Draft::default() }
}
