use crate::{atlas::AtlasError, id::LevelId, map::MapError};

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A map without patches.
    #[error("the map has no patch: there is nothing to draw")]
    Empty,
    /// A patch that the map does not have.
    #[error("the map has no patch {patch:?}; it has {}", known.join(", "))]
    UnknownPatch {
        /// The patch asked for.
        patch: String,
        /// The patches there are.
        known: Vec<String>,
    },
    /// A level that none of the patches drawn has.
    #[error("there is no level {level}; the levels are 0 to {last}")]
    UnknownLevel {
        /// The level asked for.
        level: LevelId,
        /// The coarsest level there is.
        last: usize,
    },
    /// A picture that is too small or too large.
    #[error("a picture of {width} x {height} pixels cannot be drawn; {least} to {most} a side can")]
    Size {
        /// Its width, in pixels.
        width: u32,
        /// Its height, in pixels.
        height: u32,
        /// Least width.
        least: u32,
        /// Largest side.
        most: u32,
    },
    /// Data that is no map.
    #[error(transparent)]
    Map(#[from] MapError),
    /// A map that cannot be rasterised.
    #[error(transparent)]
    Atlas(#[from] AtlasError),
    /// A text that is no SVG picture.
    #[error("the picture cannot be rendered: {message}")]
    Render {
        /// What the renderer said.
        message: String,
    },
}

impl ReportError {
    /// What a user can do about it, as a sentence.
    #[must_use]
    pub fn help(&self) -> String {
        match self {
            Self::Empty | Self::Map(_) => "make the map again with `dermatome build`".into(),
            Self::UnknownPatch { .. } => "name one of them, or none to draw them all".into(),
            Self::UnknownLevel { .. } => "ask for one of them, or for none to draw the finest".into(),
            Self::Size { .. } => "ask for another width, or for fewer patches and levels".into(),
            Self::Atlas(e) => e.help(),
            Self::Render { .. } => "draw it as SVG and look at it in a browser".into(),
        }
    }
}
