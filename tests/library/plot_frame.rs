//! Laws of pictures of readings: values are read off one scale, and what is not known is not zero.

use crate::maps::{level_id, skin, square_pyramid};
use dermatome::body::FieldLevel;
use dermatome::id::VertexId;
use dermatome::map::SkinMap;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::plot::{Picture, PlotError, PlotOptions, Viewpoint, plot_frame};
use dermatome::signal::{CarryDown, Channel, Frame, LevelFrame, Restrictor};
use dermatome::skin::PatchId;

fn palm() -> SkinMap {
    skin(vec![square_pyramid("palm", &[13, 7, 4], 0.06, 0.001)])
}

/// A frame of one channel on all levels, from the number of each taxel.
fn on_levels(map: &SkinMap, channel: &Channel, value: impl Fn(usize) -> f64) -> LevelFrame {
    let mut frame = Frame::new(map, 1);
    for (k, x) in frame.values[PatchId::new(0)][0].iter_mut().enumerate() {
        *x = value(k);
    }
    Restrictor::new(map, std::slice::from_ref(channel)).restrict(&frame).clone()
}

/// The first channel of a frame, drawn.
fn draw(
    map: &SkinMap,
    frame: &LevelFrame,
    channel: &Channel,
    options: &PlotOptions,
) -> Result<Picture, PlotError> {
    plot_frame(map, frame, std::slice::from_ref(channel), 0, options)
}

/// The colours of a picture.
fn colours(png: &[u8]) -> Vec<[u8; 3]> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes.as_chunks().0.to_vec()
}

#[test]
fn unknown_values_are_hatched_and_zero_is_not() {
    let (map, channel) = (palm(), Channel::new("pressure", "Pa").unwrap());
    let options = PlotOptions { levels: vec![level_id(0)], ..PlotOptions::default() };
    let share = |value: f64, is_grey: fn(&[u8; 3]) -> bool| {
        let frame = on_levels(&map, &channel, |k| if k == 0 { 5e3 } else { value });
        let png = draw(&map, &frame, &channel, &options).unwrap().to_png().unwrap();
        let pixels = colours(&png);
        pixels.iter().filter(|pixel| is_grey(pixel)).count() as f64 / pixels.len() as f64
    };
    let hatch = |c: &[u8; 3]| (0x8c..=0xb8).contains(&c[0]) && c[0] == c[1] && c[1] == c[2];
    let dark_end = |c: &[u8; 3]| c[2] > c[1] && c[0].abs_diff(0x44) < 8 && c[1] < 8;
    assert!(share(f64::NAN, hatch) > 0.3 && share(f64::NAN, dark_end) < 0.02);
    assert!(share(0.0, hatch) < 0.03 && share(0.0, dark_end) > 0.3);
}

#[test]
fn every_level_says_its_largest_value_and_the_same_total() {
    let map = palm();
    let force = Channel::new("force", "N").unwrap();
    let frame = on_levels(&map, &force, |k| if k == 3 { f64::NAN } else { 0.01 * k as f64 });
    let total: f64 = (0..169).filter(|&k| k != 3).map(|k| 0.01 * f64::from(k)).sum();
    let options = PlotOptions { space: Some(Viewpoint::Outside), ..PlotOptions::default() };
    let svg = draw(&map, &frame, &force, &options).unwrap().to_svg();
    assert_eq!(svg.matches(&format!("total {total:.0} N")).count(), 6, "{svg}");
    assert!(svg.contains("force per area, kPa") && svg.contains("169 taxels, 1 masked"));
    assert_eq!(svg.matches(" in space<").count(), 3);

    let pressure = Channel::new("pressure", "Pa").unwrap();
    let frame = on_levels(&map, &pressure, |_| 2500.0);
    let svg = draw(&map, &frame, &pressure, &PlotOptions::default()).unwrap().to_svg();
    assert_eq!(svg.matches("max 2.5 kPa").count(), 3);
    assert!(!svg.contains("no reading") && !svg.contains("masked"));
}

#[test]
fn a_scale_on_both_sides_of_zero_has_its_middle_there() {
    let (map, channel) = (palm(), Channel::new("shear", "Pa").unwrap());
    let frame = on_levels(&map, &channel, |k| if k % 2 == 0 { 900.0 } else { -950.0 });
    let svg = draw(&map, &frame, &channel, &PlotOptions::default()).unwrap().to_svg();
    for label in [">\u{2212}0.95<", ">0<", ">0.95<"] {
        assert!(svg.contains(label), "{label}");
    }
}

#[test]
fn unknown_channels_ranges_and_other_maps_are_refused() {
    let (map, channel) = (palm(), Channel::default());
    let frame = on_levels(&map, &channel, |_| f64::NAN);
    let options = PlotOptions::default();
    assert!(
        draw(&map, &frame, &channel, &options).unwrap().to_svg().contains("no reading"),
        "nothing at all"
    );
    for (shown, range) in [(1, None), (0, Some([1.0, 1.0])), (0, Some([f64::NAN, 1.0]))] {
        let options = PlotOptions { range, ..PlotOptions::default() };
        let result = plot_frame(&map, &frame, std::slice::from_ref(&channel), shown, &options);
        assert!(matches!(result, Err(PlotError::Channel { channels: 1, .. })));
    }
    let empty = LevelFrame::default();
    assert!(matches!(draw(&map, &empty, &channel, &options), Err(PlotError::FrameOfAnotherMap { .. })));
    let mut short = frame.clone();
    let level = &mut short.values[PatchId::new(0)][0][level_id(1)];
    *level = level.iter().skip(1).copied().collect::<Vec<_>>().into();
    assert!(level.get(VertexId::new(0)).is_some());
    assert!(matches!(draw(&map, &short, &channel, &options), Err(PlotError::FrameOfAnotherMap { .. })));
}

/// Without a range given, its ends have two digits and hold the values: from zero if that is near,
/// symmetric if values of both signs matter; a constant has a scale, too.
#[test]
fn ranges_are_round_and_hold_the_values() {
    let (map, channel) = (palm(), Channel::new("strain", "").unwrap());
    let options = PlotOptions { levels: vec![level_id(0)], ..PlotOptions::default() };
    for (values, ends) in [
        ([0.0, 37_210.0], ["0", "38000"]),
        ([-40.0, 37_210.0], ["≤ 0", "38000"]),
        ([-30_000.0, 37_210.0], ["−38000", "38000"]),
        ([-37_210.0, 100.0], ["−38000", "≥ 0"]),
        ([50_100.0, 50_900.0], ["50000", "51000"]),
        ([-51.0, -50.5], ["−51", "−50"]),
        ([0.0, 0.0], ["0", "1"]),
        ([f64::NAN, f64::NAN], ["0", "1"]),
    ] {
        let frame = on_levels(&map, &channel, |k| values[k % 2]);
        let svg = draw(&map, &frame, &channel, &options).unwrap().to_svg();
        for end in ends {
            assert!(svg.contains(&format!(">{end}</text>")), "{end} for {values:?}");
        }
    }
    for x in [1.0, -1.0, 0.37, -1e-300, 3e38, 12.0] {
        let frame = on_levels(&map, &channel, |_| x);
        let svg = draw(&map, &frame, &channel, &options).unwrap().to_svg();
        assert!(!svg.contains("no reading"), "{x} is on the scale");
    }
}

/// Each panel of a level of the whole body says what is on its patch: fields that have taxels of it, and the sum on these.
#[test]
fn levels_of_the_whole_body_say_what_is_on_each_patch() {
    let skin = crate::body::gapped(0.012);
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let force = Channel::new("force", "N").unwrap();
    let mut frame = Frame::new(&map, 1);
    for (values, x) in frame.values.iter_mut().zip([0.25, 2.0]) {
        values[0].iter_mut().for_each(|value| *value = x);
    }
    let at = FieldLevel { modality: None, level: level_id(0) };
    let mut restrictor = Restrictor::new(&map, std::slice::from_ref(&force));
    let frame = restrictor.restrict(&frame).clone();
    let down = CarryDown::new(&map, at);
    let fields = [0, 1].map(|patch| down.fields_of(PatchId::new(patch)).len());
    let options = PlotOptions { field_levels: vec![at], ..PlotOptions::default() };
    let svg = draw(&map, &frame, &force, &options).unwrap().to_svg();
    let totals: Vec<f64> =
        svg.split("total ").skip(1).map(|text| text.split(' ').next().unwrap().parse().unwrap()).collect();
    assert_eq!(totals.len(), 2, "{svg}");
    assert!((totals.iter().sum::<f64>() - 67.5).abs() < 0.5, "{totals:?}");
    assert!(totals[0] < 0.5 * totals[1], "{totals:?}");
    for count in fields {
        assert!(svg.contains(&format!("{count} fields")), "{fields:?}");
    }
}
