//! Laws of the page: the same map gives the same bytes, and names stay text. What a reader sees is tested
//! in a browser, by `tools/page`.

mod common;
mod maps;

use assert_cmd::Command;
use dermatome::id::VertexId;
use dermatome::io::write_map;
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::page::Page;
use dermatome::signal::{Channel, Frame, SignalError};
use dermatome::skin::PatchId;
use maps::{skin, square_pyramid};
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

#[test]
fn a_recording_that_does_not_fit_is_refused() {
    let map = SkinMap::flat(shapes::lattice(600, 600, 0.004), 1e-3);
    let mut page = Page::new(&map, "large").unwrap();
    let frame = Frame::new(&map, 1);
    let refused = (0..1000).find_map(|_| page.record(&frame, &[Channel::default()], 0).err());
    assert!(
        matches!(refused, Some(dermatome::Error::Signal(SignalError::TooLong { .. }))),
        "{refused:?} after 1000 frames of 360000 taxels"
    );
}

#[test]
fn readings_make_a_page_larger_but_keep_it_small() {
    let map = palm("palm");
    let mut page = Page::new(&map, "palm").unwrap();
    for k in 0..200 {
        let mut frame = Frame::new(&map, 1);
        let values = &mut frame.values[PatchId::new(0)][0];
        values.iter_mut().for_each(|x| *x = 0.0);
        values[VertexId::new(k % 169)] = 1.0;
        frame.time = 0.1 * k as f64;
        page.record(&frame, &[Channel::new("force", "N").unwrap()], 0).unwrap();
    }
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
