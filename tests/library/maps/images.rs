//! Images as the exr crate reads them back from a file.

use std::{collections::BTreeMap, path::Path};

use dermatome::{atlas::LevelImage, io::write_images};
use exr::prelude::{AnyChannels, FlatSamples, Image, Layer, ReadChannels, ReadLayers, read};

/// One image of a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WholeImage {
    pub(crate) name: String,
    pub(crate) size_px: [u32; 2],
    pub(crate) channels: BTreeMap<String, FlatSamples>,
}

impl WholeImage {
    /// All images of a file.
    pub(crate) fn read(path: &Path) -> Vec<Self> {
        let image =
            read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
        let image: Image<_> = image.from_file(path).unwrap();
        let whole = |layer: Layer<AnyChannels<FlatSamples>>| Self {
            name: layer.attributes.layer_name.unwrap().to_string(),
            size_px: [layer.size.x(), layer.size.y()].map(|n| u32::try_from(n).unwrap()),
            channels: layer
                .channel_data
                .list
                .into_iter()
                .map(|c| (c.name.to_string(), c.sample_data))
                .collect(),
        };
        image.layer_data.into_iter().map(whole).collect()
    }

    /// What is written of images.
    pub(crate) fn of(images: &[LevelImage]) -> Vec<Self> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.exr");
        write_images(&path, images).unwrap();
        Self::read(&path)
    }

    pub(crate) fn floats(&self, name: &str) -> &[f32] {
        match self.channels.get(name) {
            Some(FlatSamples::F32(x)) => x,
            other => panic!("channel {name}: {other:?}"),
        }
    }

    pub(crate) fn ids(&self, name: &str) -> &[u32] {
        match self.channels.get(name) {
            Some(FlatSamples::U32(x)) => x,
            other => panic!("channel {name}: {other:?}"),
        }
    }
}
