use std::fmt;

/// What kind of change a [`Remark`] tells of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum RemarkKind {
    /// Vertices that were split in the file are one taxel.
    Welded,
    /// Taxels without a face were left out.
    LeftOut,
    /// Faces that use a taxel twice were left out.
    RepeatedCorner,
    /// Faces without area were dropped or flipped away.
    ZeroArea,
    /// Faces were turned over.
    Turned,
    /// A sheet fell into several patches.
    Components,
    /// Normals were replaced by those of the triangles.
    Normals,
    /// Areas were replaced by those of the triangles.
    Areas,
    /// Bare taxels were joined by triangles.
    Meshed,
    /// Several taxels at one place became one.
    Merged,
    /// Nothing told the outside of bare taxels, and it was assumed.
    Outside,
    /// Something in a file was passed over.
    PassedOver,
    /// A patch was given another name.
    Renamed,
    /// Nothing was changed, but the size makes it doubtful that the file is in metres.
    DoubtfulUnit,
}

/// One change that [`crate::skin::assemble`] made; `Display` tells it in a sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// What kind of change.
    pub kind: RemarkKind,
    /// Name of the patch or sheet.
    pub patch: String,
    /// The sentence.
    pub message: String,
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.patch, self.message)
    }
}

/// `1, 5, 9 and 4 more`: the first few of a list, for a sentence.
pub(super) fn first_few<T: fmt::Display>(items: impl ExactSizeIterator<Item = T>) -> String {
    /// Enough to find the place in the file; a terminal line holds no more.
    const SHOWN: usize = 8;
    let count = items.len();
    let shown: Vec<String> = items.take(SHOWN).map(|item| item.to_string()).collect();
    let rest = count - shown.len();
    if rest == 0 { shown.join(", ") } else { format!("{} and {rest} more", shown.join(", ")) }
}
