//! Names of directions on links.

use std::path::Path;

use crate::io::IoError;
use crate::io::file::invalid;
use crate::io::table::each_row_of;
use crate::io::table::regions::NAME_NEEDED;
use crate::map::SkinMap;
use crate::signal::BodyWord;
use crate::skin::{is_region_name, link_named};

/// Reads names of directions on the links of a map: a table with columns `link,x,y,z,word`, with directions of any length
/// in the frame of the link. Returns also the names of columns that are not used.
///
/// # Errors
/// If the file cannot be read, lacks a column or has no row, or a link is not one of the map, a direction has no length, or
/// a word is none.
pub fn read_body_words(path: &Path, map: &SkinMap) -> Result<(Vec<BodyWord>, Vec<String>), IoError> {
    let mut words = Vec::new();
    let unused = each_row_of(path, ["link", "x", "y", "z", "word"], &mut |row, [link, x, y, z, word]| {
        let name = row.text(link);
        let of = link_named(&map.links, name).map_err(|links| match links {
            0 => row.invalid(link, "the name of a link of the map"),
            _ => row.invalid(link, format!("a name of one link: {links} links of the map have it")),
        })?;
        let direction = row.vector([x, y, z])?;
        if direction.try_normalize().is_none() {
            return Err(row.invalid(x, "a direction other than 0,0,0"));
        }
        let text = row.text(word);
        if !is_region_name(text) {
            return Err(row.invalid(word, NAME_NEEDED));
        }
        words.push(BodyWord { link: of, direction, word: text.to_owned() });
        Ok(())
    })?;
    match words.is_empty() {
        true => Err(invalid(path, "table", "no row", "a row for each direction")),
        false => Ok((words, unused)),
    }
}
