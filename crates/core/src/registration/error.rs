//! Why a map cannot be drawn on that of another skin.

/// Why a map cannot be drawn on that of another skin.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum RegistrationError {
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] crate::run::Cancelled),
    /// An id that does not name one taxel.
    #[error("{landmark}: {found} taxels of {whose} have the id {id}; one is needed")]
    NoTaxel { landmark: String, id: u32, found: usize, whose: String },
    /// A landmark on a seam has several places on the map.
    #[error(
        "{landmark}: taxel {taxel} of {whose} lies on the seam, where the map has two banks; name a taxel beside the seam"
    )]
    OnSeam { landmark: String, taxel: u32, whose: String },
    /// Two landmarks are one place.
    #[error("{first} and {second} are one place of {whose}; each landmark needs a place of its own")]
    OnePlace { first: String, second: String, whose: String },
    /// The landmarks of a patch do not span its map.
    #[error("the {count} landmarks of patch {patch:?} lie on a line; place one or two beside it")]
    OnALine { patch: String, count: usize },
    /// The landmarks fit the mirror image.
    #[error(
        "the landmarks of patch {patch:?} are those of the other hand: they miss the atlas by {straight_mm:.1} mm, and \
         {mirrored_mm:.1} mm as a mirror image"
    )]
    OtherHand { patch: String, straight_mm: f64, mirrored_mm: f64 },
    /// Two landmarks are exchanged.
    #[error(
        "{first} and {second}, in patch {patch:?}, seem to be exchanged: exchanged back, the map would bend with {:.2} of \
         the energy; correct them or leave them out",
        share
    )]
    Exchanged { patch: String, first: String, second: String, share: f64 },
    /// No patch has enough landmarks.
    #[error("no patch has four landmarks: {found}; needed: four or more in a patch, not on a line")]
    TooFew { found: String },
    /// The map would fold.
    #[error(
        "the map of patch {patch:?} folds with any four of its landmarks, first at {landmark}; are the landmarks in the \
         same order on both skins?"
    )]
    Folds { patch: String, landmark: String },
    /// The free map has flips, which nothing unfolds.
    #[error(
        "the map of patch {patch:?} has {flips} flipped faces, and cannot be bent; needed: the intrinsic method"
    )]
    Flipped { patch: String, flips: usize },
    /// A system that cannot be solved.
    #[error("the map of patch {patch:?} cannot be bent: {source}")]
    System { patch: String, source: crate::sparse::SparseError },
}
