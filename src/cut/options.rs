//! What a user chooses about cutting.

use crate::skin::TaxelId;

/// How to cut patches before they are mapped.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Cut {
    /// Closed patches and handles are cut; patches with several loops where it makes their map much
    /// better; a plain disk never.
    #[default]
    Auto,
    /// As [`Cut::Auto`], and slits are added, into a plain disk too, until no face of the map is larger
    /// or smaller than on the skin by more than this ratio (see
    /// [`Distortion::area_max`](crate::flatten::Distortion)). Where slits do not suffice, those that
    /// lower the ratio most are added.
    AreaRatio(f64),
    /// Nothing is cut; closed patches and handles have no map then.
    None,
    /// Closed patches and handles are cut, and all loops are joined.
    All,
    /// Exactly these edges are cut, given by the ids of their taxels. Patches without any of them
    /// are cut as by [`Cut::Auto`].
    Along(Vec<[TaxelId; 2]>),
}
