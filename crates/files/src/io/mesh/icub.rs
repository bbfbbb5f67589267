//! Taxel positions of the iCub, as its `skinManager` keeps them: `positions/*.txt`.

use std::collections::BTreeSet;

use glam::DVec3;

use crate::io::error::Result;
use crate::io::file::{LineLocation, Source, excerpt, finite};
use crate::skin::{Draft, Presence, Remark, RemarkKind, Sheet, TaxelId};

/// Slots of one module: a triangle of ten taxels and two thermal pads, a palm board, a fingertip.
const SLOTS_PER_MODULE: u32 = 12;

/// The entry in `taxel2Repr` of a slot without a pressure reading.
const ABSENT: i64 = -1;
const THERMAL_PAD: i64 = -2;

const SECTION: &str = "[calibration]";

/// Reads one part of the skin as one sheet without triangles.
///
/// Before the line `[calibration]` stand `name`, `spatial_sampling` and `taxel2Repr ( ... )`, one
/// number a slot: which slot reads for it, -1 for an absent one, -2 for a thermal pad. After it
/// each slot has a row `x y z nx ny nz`, in m in the frame of the link; twelve rows are one module.
/// Ids are the numbers of the slots, from 0. A row of zeros is an absent slot, whatever
/// `taxel2Repr` defines; a slot with a position but without a reading is a thermal pad. Normals are taken
/// as they are, placeholders too.
///
/// A header line may stand there once. That rows end within a module, or `taxel2Repr` names slots
/// beyond them, is remarked.
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let last = LineLocation { path: source.path(), line: source.text()?.lines().count() };
    let mut lines = source.lines()?.map(|(at, line)| (at, line.trim())).filter(|(_, line)| !line.is_empty());
    let header = IcubHeader::read(&mut lines, last)?;
    let mut sheet = Sheet { name: header.name.unwrap_or_else(|| source.stem()), ..Sheet::default() };
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    for (at, line) in lines {
        let [x, y, z, nx, ny, nz] = row(at, line)?;
        positions.push(DVec3::new(x, y, z));
        normals.push(DVec3::new(nx, ny, nz));
    }
    if positions.is_empty() {
        return Err(last.invalid("the end", format!("rows after {SECTION}")));
    }
    let presence = |(k, (p, n)): (usize, (&DVec3, &DVec3))| match header.representatives.get(k) {
        _ if *p == DVec3::ZERO && *n == DVec3::ZERO => Presence::Absent,
        Some(&(ABSENT | THERMAL_PAD)) => Presence::ThermalPad,
        _ => Presence::Present,
    };
    sheet.presence = Some(positions.iter().zip(&normals).enumerate().map(presence).collect());
    sheet.ids = Some((0..).take(positions.len()).map(TaxelId).collect());
    sheet.modules = Some((0..).take(positions.len()).map(|slot: u32| slot / SLOTS_PER_MODULE).collect());
    (sheet.positions, sheet.normals) = (positions, Some(normals));
    let odd = odd_counts(sheet.positions.len(), &header.representatives);
    let remark = |what| Remark { patch: sheet.name.clone(), kind: RemarkKind::PassedOver { what } };
    let remarks = header.remarks.into_iter().chain(odd).map(remark).collect();
    Ok(Draft { sheets: vec![sheet], remarks, ..Draft::default() })
}

/// What is odd about the number of rows, and of entries of `taxel2Repr`.
fn odd_counts(rows: usize, representatives: &[i64]) -> impl Iterator<Item = String> {
    let over = rows % SLOTS_PER_MODULE as usize;
    let of_modules = format!("a whole number of modules of {SLOTS_PER_MODULE}: the last one has {over}");
    let cut_module =
        (over != 0).then(|| format!("{rows} rows are not {of_modules}, as if the file were cut"));
    let is_beyond = |&&n: &&i64| usize::try_from(n).is_ok_and(|n| n >= rows);
    let beyond = representatives.iter().take(rows).filter(is_beyond).count();
    let slots = format!("slots beyond the {rows} rows, as if the file were cut; they are taxels");
    let cut_rows = (beyond > 0).then(|| format!("{beyond} entries of taxel2Repr name {slots}"));
    let declared = representatives.len();
    let meaning = if declared > rows {
        "the last ones were passed over"
    } else {
        "slots without an entry are taxels unless their rows are zero"
    };
    let other_length =
        (declared != rows).then(|| format!("taxel2Repr has {declared} entries for {rows} rows; {meaning}"));
    [cut_module, cut_rows, other_length].into_iter().flatten()
}

#[derive(Debug, Default)]
struct IcubHeader {
    name: Option<String>,
    representatives: Vec<i64>,
    remarks: Vec<String>,
}

impl IcubHeader {
    fn read<'a>(
        lines: &mut dyn Iterator<Item = (LineLocation<'a>, &'a str)>,
        last: LineLocation<'_>,
    ) -> Result<Self> {
        const KNOWN: &str = "positions of iCub taxels: lines `name`, `spatial_sampling` and `taxel2Repr`, then `[calibration]`";
        const KEYS: [&str; 3] = ["name", "spatial_sampling", "taxel2Repr"];
        let mut header = Self::default();
        let mut seen = BTreeSet::new();
        for (at, line) in lines {
            let (key, value) = line.split_once(|c: char| c.is_whitespace() || c == '(').unwrap_or((line, ""));
            if KEYS.contains(&key) && !seen.insert(key) {
                return Err(at.invalid(format!("{key} again"), "each header line once"));
            }
            match key {
                SECTION => return Ok(header),
                "name" => header.name = Some(value.trim().to_owned()).filter(|name| !name.is_empty()),
                "spatial_sampling" if value.trim() == "taxel" => {}
                "spatial_sampling" => {
                    let message = format!("spatial_sampling {} is not looked at", excerpt(value.trim()));
                    header.remarks.push(message);
                }
                "taxel2Repr" => header.representatives = representatives(at, line)?,
                _ => return Err(at.invalid(excerpt(line), KNOWN)),
            }
        }
        Err(last.invalid("the end", KNOWN))
    }
}

fn representatives(at: LineLocation<'_>, line: &str) -> Result<Vec<i64>> {
    let list = line.split_once('(').and_then(|(_, rest)| rest.trim().strip_suffix(')'));
    let list = list.ok_or_else(|| at.invalid(excerpt(line), "taxel2Repr ( one number a slot )"))?;
    let parse = |(k, word): (usize, &str)| {
        word.parse::<i64>().ok().filter(|&n| n >= THERMAL_PAD).ok_or_else(|| {
            let part = format!("entry {} of taxel2Repr", k + 1);
            at.invalid_part(part, excerpt(word), "the number of a slot, -1 or -2")
        })
    };
    list.split_whitespace().enumerate().map(parse).collect()
}

fn row(at: LineLocation<'_>, line: &str) -> Result<[f64; 6]> {
    const NEEDED: &str = "x y z nx ny nz, six finite numbers";
    let number = |word: &str| finite(word).ok_or_else(|| at.invalid(excerpt(word), NEEDED));
    let numbers: Vec<f64> = line.split_whitespace().map(number).collect::<Result<_, _>>()?;
    numbers.try_into().map_err(|_| at.invalid(excerpt(line), NEEDED))
}
