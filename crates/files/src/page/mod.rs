//! `report.html`: a skin, its map and a recording as one file that a browser shows without a network.
//!
//! [`Page::new`] takes a map, [`Page::play`] a recording, and [`Page::to_html`] writes them into the page
//! that `tools/page` makes, which is stored compressed (`page.html.gz`). The page draws the skin in space
//! next to its map; its slider unfolds the one into the other ([`Unfolding`](crate::unfold::Unfolding)). Its data is packed (`pack`)
//! from the map (`skin`), the readings (`recording`) and what touches do (`events`). Without WebGL it shows the picture of
//! [`plot_map`](crate::plot::plot_map()) and the numbers of `report.json`.
//!
//! Names of files, patches and links are text, whatever they contain: in the table they are escaped, and the
//! rest of the page never treats them as markup. Its content policy allows its own script alone and no
//! connection.
//!
//! Positions are rounded to 65535ths of the patch's box, weights to 255ths, readings to 254ths.

mod events;
mod live;
mod pack;
mod recording;
mod skin;

pub use live::LiveServer;
pub use recording::{LiveFrames, LiveUpdate};

use std::io::Read;

use flate2::read::GzDecoder;
use serde::Serialize;

use crate::Error;
use crate::map::{PatchMap, SkinMap};
use crate::page::pack::Packer;
use crate::page::recording::{Recorder, RecordingHeader};
use crate::page::skin::{SkinHeader, pack_skin};
use crate::plot::{Paint, PlotOptions, plot_map};
use crate::pyramid::LevelId;
use crate::recording::Recording;
use crate::report::atlas_sentences;
use crate::signal::TrackerOptions;

/// The page without its data, made by `tools/page`.
const PAGE: &[u8] = include_bytes!("page.html.gz");

/// Width of the picture that is shown without WebGL, in pixels.
const PICTURE_PX: u32 = 900;

/// Most patches on that picture, and most vertices of the level that it shows: every page contains it.
const PICTURE_PATCHES: usize = 12;
const PICTURE_VERTICES: usize = 600;

/// Makes the page of a map.
///
/// ```
/// use dermatome::{map::SkinMap, mesh::shapes, page::Page};
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let html = Page::new(&map, "palm <1>")?.to_html()?;
/// assert!(html.contains("<title>palm &lt;1&gt;</title>"));
/// # Ok::<(), dermatome::Error>(())
/// ```
#[derive(Debug)]
pub struct Page<'m> {
    map: &'m SkinMap,
    title: String,
    atlas: Option<(&'m SkinMap, String)>,
    recorder: Option<Recorder<'m>>,
}

/// The header, which the page reads first.
#[derive(Debug, Serialize)]
struct PageHeader<'a> {
    version: &'static str,
    title: &'a str,
    #[serde(flatten)]
    skin: SkinHeader,
    /// The skin on whose map that of the other one will be drawn, and its name.
    atlas: Option<AtlasHeader<'a>>,
    recording: Option<RecordingHeader>,
}

#[derive(Debug, Serialize)]
struct AtlasHeader<'a> {
    name: &'a str,
    #[serde(flatten)]
    skin: SkinHeader,
}

impl<'m> Page<'m> {
    /// A page of a map, without readings.
    ///
    /// # Errors
    /// If the map breaks a rule of [`SkinMap::validate`], or has no patch.
    pub fn new(map: &'m SkinMap, title: impl Into<String>) -> Result<Self, Error> {
        map.validate().map_err(Error::from)?;
        Ok(Self { map, title: title.into(), atlas: None, recorder: None })
    }

    /// Adds the skin whose map will be the atlas of this one: the page shows both side by side, proposes landmarks, takes
    /// them by clicks and saves the table that [`read_landmarks`](crate::io::read_landmarks) reads.
    ///
    /// # Errors
    /// If its map breaks a rule of [`SkinMap::validate`].
    pub fn onto(&mut self, atlas: &'m SkinMap, name: impl Into<String>) -> Result<(), Error> {
        atlas.validate().map_err(Error::from)?;
        self.atlas = Some((atlas, name.into()));
        Ok(())
    }

    /// Adds a recording to the page, which shows the channel of these options, its contact regions and, if its frames
    /// have times, its events with the limits of [`EventOptions::default`](crate::signal::EventOptions); calls
    /// `progress` after each frame. After an error the page has the frames before it.
    ///
    /// # Errors
    /// As [`Recording::next_step`], and if the recording has more readings than a page can contain.
    pub fn play(
        &mut self,
        recording: &mut Recording,
        options: &TrackerOptions,
        mut progress: impl FnMut(),
    ) -> Result<(), Error> {
        recording.follow_contacts(options)?;
        let shown = options.channel;
        let mut recorder = Recorder::new(self.map, &recording.channels()[shown], shown)?;
        let ended = loop {
            match recording.next_step() {
                Ok(None) => break Ok(()),
                Ok(Some(step)) => {
                    if let Err(e) = recorder.record(&step) {
                        break Err(e.into());
                    }
                    progress();
                }
                Err(e) => break Err(e),
            }
        };
        recorder.threshold = recording.threshold();
        self.recorder = Some(recorder).filter(|recorder| recorder.frames() > 0);
        ended
    }

    /// Number of frames that the page plays.
    pub fn frames(&self) -> usize {
        self.recorder.as_ref().map_or(0, Recorder::frames)
    }

    /// The page.
    ///
    /// # Errors
    /// If the system of an unfolding does not fit into memory, or the map cannot be drawn.
    pub fn to_html(mut self) -> Result<String, Error> {
        let mut packer = Packer::default();
        let recording = self.recorder.take().map(|recorder| recorder.finish(&mut packer));
        self.html(recording, packer, &template())
    }

    /// The page for a [`LiveServer`], and the converter of the frames of a recording for it: the channel
    /// of these options, the contact regions and the events that end.
    ///
    /// # Errors
    /// As [`Self::to_html`], and if there is no such channel.
    pub fn to_live_html(
        self,
        recording: &mut Recording,
        options: &TrackerOptions,
    ) -> Result<(String, LiveFrames), Error> {
        recording.follow_contacts(options)?;
        let shown = options.channel;
        let (frames, header) = LiveFrames::new(self.map, &recording.channels()[shown], shown)?;
        // The page may fetch frames from its own server.
        let template =
            template().replacen("default-src 'none';", "default-src 'none'; connect-src 'self';", 1);
        Ok((self.html(Some(header), Packer::default(), &template)?, frames))
    }

    fn html(
        &self,
        recording: Option<RecordingHeader>,
        mut packer: Packer,
        template: &str,
    ) -> Result<String, Error> {
        let (map, title) = (self.map, &*self.title);
        let skin = pack_skin(&mut packer, map)?;
        let atlas = self
            .atlas
            .as_ref()
            .map(|(atlas, name)| Ok::<_, Error>(AtlasHeader { name, skin: pack_skin(&mut packer, atlas)? }));
        let version = env!("CARGO_PKG_VERSION");
        let header = PageHeader { version, title, skin, atlas: atlas.transpose()?, recording };
        let data = packer.finish(&header);
        let shown: Vec<&PatchMap> = map.patches.iter().take(PICTURE_PATCHES).collect();
        let options = PlotOptions {
            patches: shown.iter().map(|patch| patch.name.clone()).collect(),
            levels: vec![picture_level(&shown)],
            paint: Paint::Angle,
            width_px: PICTURE_PX,
            ..PlotOptions::default()
        };
        let picture = plot_map(map, &options)?.to_svg();
        let fill =
            [("TITLE", escape(title)), ("PICTURE", picture), ("NUMBERS", numbers(map)), ("DATA", data)];
        Ok(filled(template, &fill))
    }
}

/// The finest level that is small enough for the picture, else the coarsest.
fn picture_level(patches: &[&PatchMap]) -> LevelId {
    let deepest = patches.iter().map(|patch| patch.levels.len()).max().unwrap_or_default();
    let count = |level: &LevelId| -> usize {
        patches.iter().filter_map(|patch| patch.levels.get(*level)).map(|map| map.uv.len()).sum()
    };
    let small = (0..deepest).map(LevelId::new).find(|level| count(level) <= PICTURE_VERTICES);
    small.unwrap_or(LevelId::new(deepest.saturating_sub(1)))
}

fn template() -> String {
    let mut text = String::new();
    let read = GzDecoder::new(PAGE).read_to_string(&mut text);
    read.expect("the asset is what a test unpacks");
    text
}

/// The page with its markers `%%NAME%%` replaced; the replacements are not searched again.
fn filled(template: &str, fill: &[(&str, String)]) -> String {
    let mut page =
        String::with_capacity(template.len() + fill.iter().map(|(_, text)| text.len()).sum::<usize>());
    let mut rest = template;
    while let Some(at) = rest.find("%%") {
        page.push_str(&rest[..at]);
        rest = &rest[at + 2..];
        let name = rest.split_once("%%").map(|(name, _)| name);
        match name.and_then(|name| fill.iter().find(|(known, _)| *known == name)) {
            Some((name, text)) => {
                page.push_str(text);
                rest = &rest[name.len() + 2..];
            }
            None => page.push_str("%%"),
        }
    }
    page.push_str(rest);
    page
}

/// The measures of `report.json` as a table.
fn numbers(map: &SkinMap) -> String {
    const NAMES: &str =
        "patch|level|taxels or fields|triangles|flips|crossings|s1/s2 mean|max|area ratio mean|max";
    let names = NAMES.replace('|', "</th><th>");
    let mut table = format!("<table><thead><tr><th>{names}</th></tr></thead><tbody>");
    for patch in &map.patches {
        for (id, level) in patch.levels.enumerate() {
            let (mesh, d) = (&level.level.mesh, &level.distortion);
            let counts = [id.index(), mesh.positions.len(), mesh.triangles.len(), d.flips, d.crossings];
            let cells = [
                escape(&patch.name),
                counts.map(|count| count.to_string()).join("</td><td>"),
                format!("{:.4}</td><td>{:.3}", d.qc_mean, d.qc_max),
                format!("{:.4}</td><td>{:.3}", d.area_mean, d.area_max),
            ];
            table.extend(["<tr><td>", &cells.join("</td><td>"), "</td></tr>"]);
        }
    }
    table.push_str("</tbody></table>");
    let sentences = atlas_sentences(map);
    table.extend(sentences.iter().map(|sentence| format!("<p>{}</p>", escape(sentence))));
    table
}

fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            c if c.is_control() && c != '\n' && c != '\t' => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_all_markers_and_names_its_licence() {
        let page = template();
        for name in ["TITLE", "PICTURE", "NUMBERS", "DATA"] {
            assert!(page.contains(&format!("%%{name}%%")), "{name}");
        }
        assert!(page.contains("three.js") && page.contains("Permission is hereby granted"));
        assert!(page.contains("default-src 'none'; script-src 'sha256-"));
    }

    #[test]
    fn replacements_in_the_page_are_not_replaced_again() {
        let fill = [("A", "%%B%%".to_owned()), ("B", "<b>".to_owned())];
        assert_eq!(filled("x%%A%%y%%B%% 100%% %%C%%", &fill), "x%%B%%y<b> 100%% %%C%%");
    }
}
