//! Laws of the page: the same map gives the same bytes, and names stay text. What a reader sees is tested
//! in a browser, by `tools/page`.

use std::sync::Arc;

use crate::common::npy;
use crate::maps::{skin, square_pyramid};
use assert_cmd::Command;
use dermatome::Error;
use dermatome::io::{Readings, ReadingsLayout, ReadingsReader, write_map};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::page::Page;
use dermatome::recording::{Recording, RecordingOptions};
use dermatome::signal::{Channel, SignalError};
use predicates::str::contains;

fn palm(name: &str) -> SkinMap {
    skin(vec![square_pyramid(name, &[13, 7, 4], 0.06, 0.001)])
}

#[test]
fn the_same_map_gives_the_same_page() {
    let map = palm("palm");
    let [a, b] = [(); 2].map(|()| Page::new(&map, "palm").unwrap().to_html().unwrap());
    assert!(a == b, "two pages of one map differ");
}

#[test]
fn the_picture_shows_a_level_of_its_own_patches() {
    let mut patches: Vec<_> =
        (0..12).map(|k| square_pyramid(&format!("plate {k}"), &[30], 0.06, 0.001)).collect();
    patches.push(square_pyramid("palm", &[13, 7, 4], 0.06, 0.001));
    Page::new(&skin(patches), "plates").unwrap().to_html().unwrap();
}

#[test]
fn names_stay_text_and_fill_no_place_of_the_page() {
    let hostile = "%%DATA%%</script><script>alert(1)</script><!--";
    let map = palm(hostile);
    let html = Page::new(&map, hostile).unwrap().to_html().unwrap();
    assert!(!html.contains("alert(1)</script>"));
    assert!(html.contains("<h1>%%DATA%%&lt;/script&gt;"), "the title is shown as it is");
    assert_eq!(html.matches("<script").count(), 2, "the data and the script");
}

/// A page that plays a recording.
fn play(map: &Arc<SkinMap>, reader: ReadingsReader) -> (Page<'_>, Result<(), Error>) {
    let mut recording = Recording::open(map, reader, &RecordingOptions::default()).unwrap();
    let mut page = Page::new(map, "palm").unwrap();
    let options = recording.tracker_options(0);
    let played = page.play(&mut recording, &options, || ());
    (page, played)
}

#[test]
fn a_recording_that_does_not_fit_is_refused() {
    let map = Arc::new(SkinMap::flat(shapes::lattice(600, 600, 0.004), 1e-3));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    std::fs::write(&path, npy("|u1", &[200, 360_000], &vec![0; 72_000_000])).unwrap();
    let (page, refused) = play(&map, ReadingsReader::open(&path, ReadingsLayout::default()).unwrap());
    assert!(matches!(refused, Err(Error::Signal(SignalError::TooLong { .. }))), "{refused:?}");
    assert_eq!(page.frames(), (1 << 26) / 360_000, "those before it are there");
}

#[test]
fn readings_make_a_page_larger_but_keep_it_small() {
    let map = Arc::new(palm("palm"));
    let readings = Readings {
        channels: vec![Channel::new("force", "N").unwrap()],
        width: 169,
        times: (0..200).map(|k| 0.1 * f64::from(k)).collect(),
        values: (0..200 * 169).map(|k| if k % 169 == k / 169 % 169 { 1.0 } else { 0.0 }).collect(),
        ..Readings::default()
    };
    let (page, played) = play(&map, ReadingsReader::memory(readings).unwrap());
    played.unwrap();
    let still = Page::new(&map, "palm").unwrap().to_html().unwrap();
    let moving = page.to_html().unwrap();
    assert!(moving.len() > still.len() && moving.len() < still.len() + 30_000, "{} bytes", moving.len());
}

#[test]
fn the_command_writes_a_page_next_to_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.glb");
    write_map(&path, &palm("palm")).unwrap();
    let report = |args: &[&str]| {
        let mut command = Command::cargo_bin("dermatome").unwrap();
        command.current_dir(folder.path()).arg("report").arg("map.glb").args(args).assert()
    };
    report(&[]).success().stderr(contains("wrote report.html"));
    let written = std::fs::read(folder.path().join("report.html")).unwrap();
    report(&["-o", "-"]).success().stdout(written);
    report(&["-o", "page.pdf"]).failure().stderr(contains(".html"));
    report(&["-o", "map.glb"]).failure();
    report(&["--channel", "force"]).failure();
}

/// A first step that is a gap is a cut, as the events of the page say too: the recording is read ahead.
#[test]
fn a_gap_after_the_first_frame_is_a_cut() {
    let map = Arc::new(palm("palm"));
    let times: Vec<f64> = [0.0].into_iter().chain((0..50).map(|k| 30.0 + 0.1 * f64::from(k))).collect();
    let readings = Readings {
        channels: vec![Channel::new("force", "N").unwrap()],
        width: 169,
        values: (0..times.len() * 169).map(|k| ((k * 7919) % 101) as f64).collect(),
        times,
        ..Readings::default()
    };
    let (page, played) = play(&map, ReadingsReader::memory(readings).unwrap());
    played.unwrap();
    let recording = &header(&page.to_html().unwrap())["recording"];
    let words: Vec<&str> =
        recording["events"].as_array().unwrap().iter().filter_map(|event| event["word"].as_str()).collect();
    assert_eq!(recording["cuts"], serde_json::json!([1]));
    assert!(words.contains(&"gap"), "{words:?}");
}

/// What the data of a page begin with.
fn header(html: &str) -> serde_json::Value {
    use base64::{Engine as _, engine::general_purpose::STANDARD};
    use std::io::Read;
    let data = html.split(['<', '>']).max_by_key(|text| {
        let is_packed = text.bytes().all(|b| b.is_ascii_alphanumeric() || b"+/=".contains(&b));
        if is_packed { text.len() } else { 0 }
    });
    let packed = STANDARD.decode(data.unwrap()).unwrap();
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut bytes).unwrap();
    let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[4..4 + length]).unwrap()
}
