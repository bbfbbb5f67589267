//! Triangles of a primitive: lists, strips and fans.

use gltf::json::{
    mesh::{Mode, Primitive},
    validation::Checked,
};

use crate::io::{
    IoError,
    gltf::{attributes::Attributes, document::Role},
};

/// What a primitive is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Points,
    Lines,
    Triangles,
}

impl Shape {
    pub(super) fn of(primitive: &Primitive) -> Self {
        use Mode::{Points, TriangleFan, TriangleStrip, Triangles};
        match primitive.mode {
            Checked::Valid(Points) => Self::Points,
            Checked::Valid(Triangles | TriangleStrip | TriangleFan) => Self::Triangles,
            _ => Self::Lines,
        }
    }
}

impl Attributes<'_> {
    /// The triangles of the primitive, counter-clockwise. Corners that do not fill a triangle at the
    /// end are left out, as every viewer does; so are triangles of a strip or fan that only turn a
    /// corner.
    pub(super) fn triangles(&self, primitive: &Primitive) -> Result<Vec<[u32; 3]>, IoError> {
        let corners = self.points(primitive)?;
        let is_list = primitive.mode == Checked::Valid(Mode::Triangles);
        self.document.reserve(&self.element, corners.len(), if is_list { 4 } else { 12 })?;
        let is_proper = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        Ok(match primitive.mode {
            _ if is_list => corners.as_chunks::<3>().0.to_vec(),
            Checked::Valid(Mode::TriangleStrip) => {
                let turned = |(i, w): (usize, &[u32])| {
                    if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] }
                };
                corners.windows(3).enumerate().map(turned).filter(is_proper).collect()
            }
            _ => {
                let hub = corners.first().copied().unwrap_or_default();
                corners.windows(2).skip(1).map(|w| [hub, w[0], w[1]]).filter(is_proper).collect()
            }
        })
    }

    /// The vertices that a primitive shows, which exist: those of its indices, else all. The largest
    /// number of a type would restart a strip, which glTF forbids.
    pub(super) fn points(&self, primitive: &Primitive) -> Result<Vec<u32>, IoError> {
        let Some(index) = primitive.indices else {
            self.document.reserve(&self.element, self.count, 4)?;
            return Ok((0..u32::try_from(self.count).unwrap_or(u32::MAX)).collect());
        };
        let asked_by = format!("{} indices", self.element);
        let accessor = self.document.accessor(index.value(), Role::Index, &asked_by)?;
        let corners = accessor.integers::<1>()?.into_flattened();
        let restart = u32::MAX >> (32 - 8 * accessor.gltf.size().min(4));
        let largest = corners.iter().copied().max().unwrap_or_default();
        if largest != restart && (largest as usize) < self.count {
            return Ok(corners);
        }
        let at = corners.iter().position(|&c| c == largest).unwrap_or_default();
        let needed = if largest as usize >= self.count {
            format!("less than {}, the number of vertices", self.count)
        } else {
            "no primitive restart: a wider type of index".into()
        };
        Err(accessor.invalid(format!("index {largest} at place {at}"), needed))
    }
}
