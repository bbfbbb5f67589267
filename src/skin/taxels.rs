//! The number of a taxel.

use std::fmt;

/// The number a vendor gave to a taxel: any 32-bit integer, duplicates and placeholders included.
///
/// Never an index. `TaxelId(0)` is the placeholder of most vendors.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct TaxelId(pub u32);

impl fmt::Debug for TaxelId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "taxel {}", self.0)
    }
}

impl fmt::Display for TaxelId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
