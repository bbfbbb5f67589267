//! A recording as arrays: images and the values of every level, with all that numpy needs to read
//! them without the map.

use serde_json::{Map, Value, json};

use crate::atlas::{Atlas, AtlasPart};
use crate::body::FieldLevel;
use crate::id::IdVec;
use crate::image::TactileImage;
use crate::io::IoError;
use crate::io::arrays::npy::{ElementType, Elements};
use crate::io::arrays::write::{ArrayId, ArrayWriter};
use crate::io::file::{OutPath, file_kind, unfit, write_file};
use crate::map::{RegionId, Regions, SkinMap};
use crate::pyramid::LevelId;
use crate::signal::{Channel, LevelFrame, ModalityValues};
use crate::skin::PatchId;

/// The content of a recording.
#[derive(Debug, Clone, Copy)]
pub struct RecordingLayout<'a> {
    /// The channels of the frames.
    pub channels: &'a [Channel],
    /// The images, if there are any.
    pub atlas: Option<&'a Atlas>,
    /// Whether the values of the taxels and fields are kept too; a `.npy` has images alone.
    pub values: bool,
    /// The one level that is kept; `None`: all.
    pub level: Option<LevelId>,
    /// The level without a mesh whose values and images are kept, and no others; `None`: those of all, if no level is chosen.
    pub fields: Option<FieldLevel>,
}

/// Writes a recording frame by frame: `.npz` with arrays of everything, or `.npy` with one image.
///
/// Keys of the `.npz`, with `Lk` the level: `PATCH.Lk.image` `(T, C, H, W)` and `PATCH.Lk.values`
/// `(T, C, n)` as `f32`, NaN where nothing is known; `PATCH.Lk.mask` `(H, W)`, 1 where the image
/// shows the skin; `PATCH.Lk.taxel_id` `(H, W)`, above level 0 the index of the field, `0xFFFFFFFF`
/// where there is none; `PATCH.Lk.valid` `(T, n)`, 1 where every channel has a value that was measured, not [filled](crate::signal::Filler); `PATCH.ids`;
/// `PATCH.region` of each taxel and `PATCH.Lk.region` `(H, W)` of each pixel, 0 where there is none, else counted from 1
/// in `regions`, if the map has named regions; `timestamps` in s; `channels`, their `units` and those of their pixels, `image_units`: images show
/// an amount in N per area, in N/m^2; `metres_per_pixel`, one number, or
/// `PATCH.Lk.metres_per_pixel` where images differ. Packed
/// images are `Lk.image` and so on. `body.Lk.values` and `body.Lk.valid` are those of the [levels of the whole body](crate::body), which
/// have an image if one of them is chosen alone; a patch that is called `body` next to them has the keys `%62ody.Lk.values` and so on. `PATCH.MODALITY.Lk.values`, `body.MODALITY.Lk.values` and `.valid` are
/// those of a modality besides touch that a channel [is of](Channel::modality): NaN in the channels that are not, which `valid` leaves out. The `.npy` is `(T, H, W)`, or `(T, C, H, W)` with several
/// channels.
///
/// No file appears before [`RecordingWriter::finish`]; memory does not depend
/// on the number of frames.
///
/// ```
/// use dermatome::{
///     io::{RecordingLayout, RecordingWriter},
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, Frame, Restrictor},
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let channels = [Channel::default()];
/// let folder = std::env::temp_dir().join("dermatome-recording");
/// std::fs::create_dir_all(&folder)?;
/// let layout = RecordingLayout {
///     channels: &channels,
///     atlas: None,
///     values: true,
///     level: None,
///     fields: None,
/// };
/// let mut recording = RecordingWriter::create(&folder.join("touch.npz"), &map, &layout)?;
/// let mut restrictor = Restrictor::new(&map, &channels);
/// for _ in 0..10 {
///     recording.write(restrictor.restrict(&Frame::new(&map, 1)), &[])?;
/// }
/// recording.finish()?;
/// assert!(folder.join("touch.features.json").exists());
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct RecordingWriter {
    path: OutPath,
    writer: ArrayWriter,
    times: Option<ArrayId>,
    /// The array of episodes, and the current episode; `None` if the file has no episodes.
    episode: Option<(ArrayId, u32)>,
    images: Vec<ArrayId>,
    /// Name and number of values of each image.
    expected: Vec<(String, usize)>,
    values: Vec<LevelValues>,
    /// Values of each level without a mesh, and which are valid.
    fields: Vec<FieldValues>,
    features: Map<String, Value>,
}

/// A level of the whole body, or of a modality.
struct FieldValues {
    at: FieldLevel,
    /// Which channels are of it.
    is_of_it: Vec<bool>,
    values: ArrayId,
    valid: ArrayId,
}

struct LevelValues {
    patch: PatchId,
    level: LevelId,
    values: ArrayId,
    valid: ArrayId,
}

impl RecordingWriter {
    /// Starts a recording.
    ///
    /// # Errors
    /// If the file is of another kind or cannot be created, or the layout has not one image for a
    /// `.npy`.
    pub fn create(
        path: impl Into<OutPath>,
        map: &SkinMap,
        layout: &RecordingLayout<'_>,
    ) -> Result<Self, IoError> {
        let path = &path.into();
        let mut this = Self {
            path: path.clone(),
            writer: ArrayWriter::create(path)?,
            times: None,
            episode: None,
            images: Vec::new(),
            expected: Vec::new(),
            values: Vec::new(),
            fields: Vec::new(),
            features: Map::new(),
        };
        let parts: Vec<_> = layout.atlas.iter().flat_map(|atlas| atlas.parts_of(layout.level)).collect();
        if file_kind(path) == "npy" {
            let [part] = &parts[..] else {
                let needed = "one image: one patch and one level";
                return Err(unfit(path, "the recording", format!("{} images", parts.len()), needed));
            };
            let [width, height] = part.frame.size_px.map(|n| n as usize);
            let shape = [layout.channels.len(), height, width];
            let shape = if layout.channels.len() == 1 { &shape[1..] } else { &shape };
            this.images.push(this.writer.growing(&part.name, ElementType::F32, shape)?);
            this.expected.push((part.name.clone(), layout.channels.len() * height * width));
            return Ok(this);
        }
        this.times = Some(this.writer.growing("timestamps", ElementType::F64, &[])?);
        let names: Vec<String> = layout.channels.iter().map(|c| c.name.clone()).collect();
        let units: Vec<String> = layout.channels.iter().map(|c| c.unit.clone()).collect();
        this.writer.constant("channels", &[names.len()], Elements::Text(&names))?;
        this.writer.constant("units", &[units.len()], Elements::Text(&units))?;
        let regions = map.regions();
        if !regions.names.is_empty() {
            let names: Vec<String> = regions.names.iter().map(ToString::to_string).collect();
            this.writer.constant("regions", &[names.len()], Elements::Text(&names))?;
            this.add_regions(map, &regions, &parts)?;
        }
        this.add_images(map, &parts, layout.channels)?;
        if layout.values {
            this.add_values(map, layout)?;
        }
        Ok(this)
    }

    /// Begins an episode: the next frames have this number in the array `episode` `(T,)` of a `.npz`. If a recording has
    /// episodes, call it before the first frame.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn begin_episode(&mut self, number: u64) -> Result<(), IoError> {
        if self.times.is_none() {
            return Ok(());
        }
        let array = match self.episode {
            Some((array, _)) => array,
            None => self.writer.growing("episode", ElementType::U32, &[])?,
        };
        self.episode = Some((array, u32::try_from(number).unwrap_or(u32::MAX)));
        Ok(())
    }

    /// The region of each taxel, and of each pixel.
    fn add_regions(&mut self, map: &SkinMap, regions: &Regions, parts: &[&AtlasPart]) -> Result<(), IoError> {
        let number = |region: Option<RegionId>| region.map_or(0, |region| region.raw() + 1);
        for (id, patch) in map.patches.enumerate() {
            let of: Vec<u32> = regions.of_taxels[id].iter().map(|region| number(*region)).collect();
            self.writer.constant(
                &format!("{}.region", map.name_in_levels(&patch.name)),
                &[of.len()],
                Elements::U32(&of),
            )?;
        }
        for part in parts {
            let of_level = map.patches.enumerate();
            let of_level: IdVec<PatchId, _> = of_level
                .map(|(id, patch)| regions.of_level(id, patch, patch.nearest_level(part.level)))
                .collect();
            let shown = part.vertices(map).into_iter();
            let of: Vec<u32> = shown.map(|at| number(at.and_then(|(patch, v)| of_level[patch][v]))).collect();
            let [width, height] = part.frame.size_px.map(|n| n as usize);
            let name = format!("{}.region", key(map, &part.name));
            self.writer.constant(&name, &[height, width], Elements::U32(&of))?;
        }
        Ok(())
    }

    fn add_images(
        &mut self,
        map: &SkinMap,
        parts: &[&AtlasPart],
        channels: &[Channel],
    ) -> Result<(), IoError> {
        if !parts.is_empty() {
            let units: Vec<String> = channels.iter().map(Channel::pixel_unit).collect();
            self.writer.constant("image_units", &[units.len()], Elements::Text(&units))?;
        }
        /// Sizes that differ by rounding only are the same.
        const SIZE_ROUNDING: f64 = 1e-12;
        let first = parts.first().map(|part| pixel_size(part));
        let is_first = |size: f64| first.is_some_and(|first| (size - first).abs() <= SIZE_ROUNDING * first);
        let is_common = parts.iter().all(|part| is_first(pixel_size(part)));
        if let Some(size) = first.filter(|_| is_common) {
            self.writer.constant("metres_per_pixel", &[], Elements::F64(&[size]))?;
        }
        for part in parts {
            let key = key(map, &part.name);
            let [width, height] = part.frame.size_px.map(|n| n as usize);
            let shape = [channels.len(), height, width];
            self.images.push(self.writer.growing(&format!("{key}.image"), ElementType::F32, &shape)?);
            self.expected.push((part.name.clone(), shape.iter().product()));
            self.writer.constant(&format!("{key}.mask"), &shape[1..], Elements::U8(&part.coverage()))?;
            let ids = part.taxel_ids(map);
            self.writer.constant(&format!("{key}.taxel_id"), &shape[1..], Elements::U32(&ids))?;
            if !is_common {
                let name = format!("{key}.metres_per_pixel");
                self.writer.constant(&name, &[], Elements::F64(&[pixel_size(part)]))?;
            }
        }
        Ok(())
    }

    fn add_values(&mut self, map: &SkinMap, layout: &RecordingLayout<'_>) -> Result<(), IoError> {
        for (id, patch) in map.patches.enumerate() {
            let ids: Vec<u32> = patch.taxels.ids.iter().map(|id| id.0).collect();
            self.writer.constant(
                &format!("{}.ids", map.name_in_levels(&patch.name)),
                &[ids.len()],
                Elements::U32(&ids),
            )?;
            for (level, fields) in patch.levels.enumerate() {
                if layout.fields.is_some() || layout.level.is_some_and(|wanted| wanted != level) {
                    continue;
                }
                let key = format!("{}.L{level}", map.name_in_levels(&patch.name));
                let shape = [layout.channels.len(), fields.level.mesh.positions.len()];
                let values = self.writer.growing(&format!("{key}.values"), ElementType::F32, &shape)?;
                let valid = self.writer.growing(&format!("{key}.valid"), ElementType::U8, &shape[1..])?;
                self.values.push(LevelValues { patch: id, level, values, valid });
                self.add_feature(&key, shape.iter().product(), layout.channels);
            }
        }
        let is_kept = |at: FieldLevel| layout.fields.map_or(layout.level.is_none(), |only| only == at);
        for (at, key) in map.field_levels().filter(|(at, _)| is_kept(*at)) {
            let channels = layout.channels.iter();
            let is_of_it: Vec<bool> = channels.map(|channel| channel.has_fields(map, at)).collect();
            let Some(fields) = map.fields_of(at).filter(|_| is_of_it.contains(&true)) else { continue };
            let shape = [layout.channels.len(), fields.origins.len()];
            let values = self.writer.growing(&format!("{key}.values"), ElementType::F32, &shape)?;
            let valid = self.writer.growing(&format!("{key}.valid"), ElementType::U8, &shape[1..])?;
            self.fields.push(FieldValues { at, is_of_it, values, valid });
            self.add_feature(&key, shape.iter().product(), layout.channels);
        }
        Ok(())
    }

    /// The values of a level as one vector, channel by channel: statistics of images would be of rows of pixels.
    fn add_feature(&mut self, key: &str, length: usize, channels: &[Channel]) {
        let feature = json!({
            "dtype": "float32",
            "shape": [length],
            "names": null,
            "info": {
                "array": format!("{key}.values"),
                "valid": format!("{key}.valid"),
                "missing": 0,
                "channels": channels.iter().map(|c| &c.name).collect::<Vec<_>>(),
                "units": channels.iter().map(|c| &c.unit).collect::<Vec<_>>(),
            },
        });
        // LeRobot allows no slash; patches that differ in it alone are numbered.
        let name = format!("observation.tactile.{}", key.replace('/', "_"));
        let others = (2..).map(|number: usize| format!("{name}_{number}"));
        let free = std::iter::once(name.clone()).chain(others).find(|name| !self.features.contains_key(name));
        self.features.insert(free.unwrap_or(name), feature);
    }

    /// Writes a frame and its images, in the order of the atlas; those of other levels than the
    /// kept one are left out by the caller.
    ///
    /// # Errors
    /// If the images are not those of the layout, or the disk is full.
    ///
    /// # Panics
    /// If the frame is not one of the map.
    pub fn write(&mut self, frame: &LevelFrame, images: &[TactileImage]) -> Result<(), IoError> {
        let fits = |((name, length), image): (&(String, usize), &TactileImage)| {
            *name == image.name && *length == image.values.len()
        };
        if images.len() != self.expected.len() || !self.expected.iter().zip(images).all(fits) {
            let found: Vec<_> = images.iter().map(|image| (&image.name, image.values.len())).collect();
            let (found, needed) = (format!("images and values {found:?}"), format!("{:?}", self.expected));
            return Err(unfit(&self.path, "a frame", found, needed));
        }
        for (&array, image) in self.images.iter().zip(images) {
            self.writer.push(array, Elements::F32(&image.values))?;
        }
        if let Some(times) = self.times {
            self.writer.push(times, Elements::F64(&[frame.time]))?;
        }
        if let Some((array, number)) = self.episode {
            self.writer.push(array, Elements::U32(&[number]))?;
        }
        let mut all_valid = Vec::new();
        for LevelValues { patch, level, values, valid } in &self.values {
            all_valid.clear();
            for (channel, unmeasured) in frame.values[*patch].iter().zip(&frame.unmeasured[*patch]) {
                let of_level = &channel[*level];
                self.writer.push(*values, Elements::F64(of_level.as_slice()))?;
                all_valid.resize(of_level.len(), 1);
                all_valid.iter_mut().zip(of_level).for_each(|(valid, x)| *valid &= u8::from(!x.is_nan()));
                unmeasured[*level].iter().for_each(|vertex| all_valid[vertex.index()] = 0);
            }
            self.writer.push(*valid, Elements::U8(&all_valid))?;
        }
        for FieldValues { at: FieldLevel { modality, level }, is_of_it, values: array, valid: valid_array } in
            &self.fields
        {
            let (of_channels, are_measured) = match modality {
                None => (&frame.body, &frame.is_body_measured),
                Some(number) => {
                    let ModalityValues { values, is_measured } = &frame.modalities[*number];
                    (values, is_measured)
                }
            };
            all_valid.clear();
            for ((values, is_measured), is_of_it) in of_channels.iter().zip(are_measured).zip(is_of_it) {
                self.writer.push(*array, Elements::F64(values[*level].as_slice()))?;
                all_valid.resize(values[*level].len(), 1);
                if !is_of_it {
                    continue;
                }
                let known = values[*level].iter().zip(&is_measured[*level]);
                let known = known.map(|(x, is_measured)| !x.is_nan() && *is_measured);
                all_valid.iter_mut().zip(known).for_each(|(valid, known)| *valid &= u8::from(known));
            }
            self.writer.push(*valid_array, Elements::U8(&all_valid))?;
        }
        self.writer.end_frame()
    }

    /// Gives the file its name, and writes next to an `.npz`, as `touch.npz`, its features, `touch.features.json`: the
    /// values of each level as a vector, as datasets of `LeRobot` describe features. Such vectors are finite: a
    /// value that is not known is 0 there, and the array `info.valid` marks those that are known.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn finish(self) -> Result<(), IoError> {
        let (writer, features) = (self.writer, self.features);
        if file_kind(&self.path) == "npy" {
            return writer.finish();
        }
        self.path.together(|path| {
            writer.finish_at(path)?;
            write_file(&path.beside(path.with_extension("features.json")), |file| {
                Ok(serde_json::to_writer_pretty(file, &features)?)
            })
        })
    }
}

/// Side of a pixel, in m.
fn pixel_size(part: &AtlasPart) -> f64 {
    part.frame.size.x / f64::from(part.frame.size_px[0])
}

/// The name of an image as a part of a key: `palm/L0` becomes `palm.L0`.
fn key(map: &SkinMap, image: &str) -> String {
    let of_patch = |(patch, level)| format!("{}.{level}", map.name_in_levels(patch));
    image.rsplit_once('/').map_or_else(|| image.to_owned(), of_patch)
}
