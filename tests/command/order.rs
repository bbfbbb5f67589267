//! `check --order` and `--columns` as a user runs them.

use std::fs;
use std::path::Path;

use dermatome::io::{read_order, write_skin};

use crate::common;

/// A skin that no turn or mirror image maps onto itself, and a recording of touches whose columns are shuffled and named
/// by numbers from 1 on: column `k` is of the taxel `truth[k]`.
fn folder_with_a_shuffled_recording(is_symmetric: bool) -> (tempfile::TempDir, Vec<u32>) {
    let folder = tempfile::tempdir().unwrap();
    let skin = common::cut_sheet(0.006, |x, y| match is_symmetric {
        true => x < 7.5 && y < 7.5,
        false => y < 3.5 || (x < 4.5 && y < 8.5),
    });
    write_skin(&folder.path().join("sheet.glb"), &skin).unwrap();
    let words = "touch sheet.glb -o touched.csv --rate-hz 20 --reads pressure --noise-kpa 2 --seed 4 \
                 --gain-spread 0.3 --pause-s 0.1 --presses 120";
    common::dermatome(&folder, words).assert().success();
    let text = fs::read_to_string(folder.path().join("touched.csv")).unwrap();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let first = rows[0].iter().position(|name| name.parse::<f64>().is_ok() || name.contains('.')).unwrap();
    let count = rows[0].len() - first;
    let order: Vec<usize> = (0..count).map(|k| (k * 37 + 5) % count).collect();
    let id = |name: &str| name.split('.').next().unwrap().parse::<u32>().unwrap();
    let truth = order.iter().map(|&k| id(rows[0][first + k])).collect();
    let row = |(line, row): (usize, &Vec<&str>)| {
        let mut cells: Vec<String> = row[..first].iter().map(|&cell| cell.to_owned()).collect();
        let unit = rows[0][first].split_once('.').map_or("", |(_, rest)| rest);
        cells.extend(order.iter().enumerate().map(|(column, &k)| match line {
            0 => format!("{}.{unit}", column + 1).trim_end_matches('.').to_owned(),
            _ => row[first + k].to_owned(),
        }));
        cells.join(",") + "\n"
    };
    let shuffled: String = rows.iter().enumerate().map(row).collect();
    fs::write(folder.path().join("shuffled.csv"), shuffled).unwrap();
    (folder, truth)
}

fn order(folder: &Path) -> Vec<(usize, u32)> {
    let rows = read_order(&folder.join("order.csv")).unwrap().rows;
    rows.into_iter().map(|(column, id)| (column, id.0)).collect()
}

/// The table of the order makes a shuffled recording that of the skin.
#[test]
fn a_shuffled_recording_is_read_by_its_order() {
    let (folder, truth) = folder_with_a_shuffled_recording(false);
    let words = "check sheet.glb --order --recording shuffled.csv -o order.csv --json";
    let run = common::dermatome(&folder, words).assert().success();
    let json = common::json(&run.get_output().stdout);
    let found = order(folder.path());
    assert_eq!(json["order"]["placed"], found.len());
    assert!(json["order"]["objective"].as_f64().unwrap() > 0.88);
    let right = found.iter().filter(|(column, id)| truth[*column] == *id).count();
    assert!(right as f64 > 0.8 * truth.len() as f64, "{right} of {}", truth.len());
    for (column, id) in &found {
        assert_eq!(json["order"]["columns"][column]["taxel"], *id);
    }

    // A first line of bare numbers has the ids of the columns, which the order does not follow: they are what is looked for.
    let text = fs::read_to_string(folder.path().join("shuffled.csv")).unwrap();
    let ids: Vec<String> = truth.iter().map(u32::to_string).collect();
    let values = text.lines().skip(1).map(|line| line.split_once(',').unwrap().1.to_owned());
    let bare: Vec<String> = std::iter::once(ids.join(",")).chain(values).collect();
    fs::write(folder.path().join("bare.csv"), bare.join("\n") + "\n").unwrap();
    let words = "check sheet.glb --order --recording bare.csv --rate 20 -o order.csv";
    common::dermatome(&folder, words).assert().success();
    let found = order(folder.path());
    let right = found.iter().filter(|(column, id)| truth[*column] == *id).count();
    assert!(right as f64 > 0.8 * truth.len() as f64, "{right} of {} by a bare first line", truth.len());

    // With the true order, the shuffled recording is that of the touches.
    let rows: String = truth.iter().enumerate().map(|(column, id)| format!("{column},{id}\n")).collect();
    fs::write(folder.path().join("truth.csv"), format!("column,taxel_id\n{rows}")).unwrap();
    for words in ["touched.csv -o a.npz", "shuffled.csv --columns truth.csv -o b.npz"] {
        let words = format!("render sheet/map.glb {words} --values-only");
        common::dermatome(&folder, "build sheet.glb -o sheet --quiet").assert().success();
        common::dermatome(&folder, &words).assert().success();
    }
    let [a, b] = ["a.npz", "b.npz"].map(|name| fs::read(folder.path().join(name)).unwrap());
    assert!(a == b, "the same values");

    let words = "plot sheet/map.glb --recording shuffled.csv --columns truth.csv --signals -o signals.svg";
    common::dermatome(&folder, words).assert().success();
    let picture = fs::read_to_string(folder.path().join("signals.svg")).unwrap();
    assert!(picture.contains("from signals"), "{picture}");
    common::refuses(&folder, "plot sheet/map.glb --recording - --signals -o s.svg", &["read twice"]);
    common::refuses(&folder, "plot sheet/map.glb --signals -o s.svg", &["--readings"]);
    common::refuses(&folder, "plot sheet.glb --recording touched.csv --signals -o s.svg", &["map"]);

    for (table, said) in [
        ("column,taxel_id\n999,1\n", "as the readings have"),
        ("column,taxel_id\n0,1\n0,2\n", "each column once"),
        ("column,taxel_id\n0,1\n1,1\n", "each taxel once"),
        ("column,taxel_id\n-1,1\n", "counted from 0"),
        ("column,taxel_id\n0,\n", "no column with a taxel"),
        ("column,module\n0,1\n", "taxel_id"),
    ] {
        fs::write(folder.path().join("bad.csv"), table).unwrap();
        common::refuses(&folder, "render sheet/map.glb shuffled.csv --columns bad.csv -o c.npz", &[said]);
    }
}

/// What touches leave open is refused, and nothing is written; three known columns decide on a symmetric skin.
#[test]
fn symmetric_skins_ask_for_known_columns() {
    let (folder, truth) = folder_with_a_shuffled_recording(true);
    let words = "check sheet.glb --order --recording shuffled.csv -o order.csv";
    let refused = common::refuses(&folder, words, &["symmetric", "three taxels", "--known"]);
    assert!(!folder.path().join("order.csv").exists());
    let text = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    let after = text.split("best ").nth(1).unwrap();
    let ids = after.split(|c: char| !c.is_ascii_digit()).filter_map(|id| id.parse::<u32>().ok());
    let column = |id: u32| truth.iter().position(|known| *known == id).unwrap();
    let rows: String = ids.take(3).map(|id| format!("{},{id}\n", column(id))).collect();
    fs::write(folder.path().join("known.csv"), format!("column,taxel_id\n{rows}")).unwrap();
    let run = common::dermatome(&folder, &format!("{words} --known known.csv")).assert().success();
    let text = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    assert!(text.contains("68 of 68 columns have a taxel"), "{text}");
    let right = order(folder.path()).iter().filter(|(column, id)| truth[*column] == *id).count();
    assert!(right > 60, "{right} of 68");

    fs::write(folder.path().join("known.csv"), "column,taxel_id\n68,1\n").unwrap();
    for (words, said) in [
        ("--order --recording shuffled.csv --known known.csv", "counted from 0"),
        ("--order", "--recording"),
        ("--known known.csv --recording shuffled.csv", "--order"),
        ("--order --recording -", "read twice"),
        ("--order --recording shuffled.csv --columns known.csv", "--columns"),
        ("--order --recording shuffled.csv --modules known.csv", "--modules"),
        ("--order --recording shuffled.csv --threshold 1e12", "columns are touched"),
    ] {
        common::refuses(&folder, &format!("check sheet.glb {words}"), &[said]);
    }
}
