use glam::DVec3;

use crate::{
    id::IdVec,
    skin::{Link, LinkId, Presence, Remark, TaxelId},
};

/// A skin as a file tells it, before anything is repaired or refused.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Draft {
    /// The links; empty where the format knows none.
    pub links: IdVec<LinkId, Link>,
    /// The sheets of taxels and triangles.
    pub sheets: Vec<Sheet>,
    /// What the reader of the file changed or passed over.
    pub remarks: Vec<Remark>,
}

/// One sheet of triangles with their taxels, as written.
///
/// The optional arrays are either absent or as long as `positions`. Nothing else is promised: corners may be out
/// of range, positions not finite, vertices unused or duplicated, winding mixed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sheet {
    /// Name of the patch.
    pub name: String,
    /// The link it is fixed to.
    pub link: Option<LinkId>,
    /// Positions in the link's frame, in m.
    pub positions: Vec<DVec3>,
    /// Corner indices into `positions`.
    pub triangles: Vec<[u32; 3]>,
    /// Vendor ids.
    pub ids: Option<Vec<TaxelId>>,
    /// Normals in the link's frame.
    pub normals: Option<Vec<DVec3>>,
    /// Receptive areas, in m^2.
    pub areas: Option<Vec<f64>>,
    /// Taxels per m^2.
    pub densities: Option<Vec<f64>>,
    /// What each slot holds.
    pub presence: Option<Vec<Presence>>,
    /// Number of the rigid module each taxel sits on: taxels of one module lie in a plane.
    pub modules: Option<Vec<u32>>,
    /// Covariances of positions `xx xy xz yy yz zz` in the link's frame, in m^2.
    pub covariances: Option<Vec<[f64; 6]>>,
}

impl Sheet {
    /// The first optional array that has not one entry per vertex, and its length.
    pub(super) fn wrong_length(&self) -> Option<(&'static str, usize)> {
        let lengths = [
            ("ids", self.ids.as_ref().map(Vec::len)),
            ("normals", self.normals.as_ref().map(Vec::len)),
            ("areas", self.areas.as_ref().map(Vec::len)),
            ("densities", self.densities.as_ref().map(Vec::len)),
            ("presence", self.presence.as_ref().map(Vec::len)),
            ("covariances", self.covariances.as_ref().map(Vec::len)),
            ("modules", self.modules.as_ref().map(Vec::len)),
        ];
        let mut given = lengths.into_iter().filter_map(|(what, n)| Some((what, n?)));
        given.find(|&(_, n)| n != self.positions.len())
    }
}
