//! Triangles of a primitive: lists, strips and fans.

use gltf::json::{
    accessor::ComponentType,
    mesh::{self, Primitive},
    validation::Checked,
};

use crate::io::{
    IoError,
    gltf::document::{Document, Role},
};

/// How a primitive joins its vertices, as far as skins are concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    /// Points or lines: nothing to touch.
    Thin,
    /// Three corners each.
    List,
    /// Each corner after the second makes a triangle with the two before it.
    Strip,
    /// Each corner after the second makes a triangle with the one before it and the first.
    Fan,
}

impl Mode {
    /// The mode of a primitive.
    pub(super) fn of(primitive: &Primitive) -> Self {
        match primitive.mode {
            Checked::Valid(mesh::Mode::Triangles) => Self::List,
            Checked::Valid(mesh::Mode::TriangleStrip) => Self::Strip,
            Checked::Valid(mesh::Mode::TriangleFan) => Self::Fan,
            _ => Self::Thin,
        }
    }
}

/// The triangles of a primitive of `vertices` vertices, counter-clockwise. Corners that do not fill
/// a triangle at the end are left out, as every viewer does; so are triangles of a strip or fan
/// that only turn a corner.
pub(super) fn triangles(
    document: &Document,
    element: &str,
    primitive: &Primitive,
    mode: Mode,
    vertices: usize,
) -> Result<Vec<[u32; 3]>, IoError> {
    let corners = match primitive.indices {
        Some(index) => {
            let accessor = document.accessor(index.value(), Role::Index, &format!("{element} indices"))?;
            let corners = document.gather_uint::<1>(&accessor)?;
            check_corners(document, &accessor.name(), accessor.component, &corners, vertices)?;
            corners
        }
        None => {
            document.reserve(element, vertices, 4)?;
            (0..u32::try_from(vertices).unwrap_or(u32::MAX)).map(|i| [i]).collect()
        }
    };
    let corners = corners.as_flattened();
    document.reserve(element, corners.len(), if mode == Mode::List { 4 } else { 12 })?;
    Ok(match mode {
        Mode::Thin => Vec::new(),
        Mode::List => corners.as_chunks::<3>().0.to_vec(),
        Mode::Strip => {
            let turned =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            corners.windows(3).enumerate().map(turned).filter(is_proper).collect()
        }
        Mode::Fan => {
            let hub = corners.first().copied().unwrap_or_default();
            corners.windows(2).skip(1).map(|w| [hub, w[0], w[1]]).filter(is_proper).collect()
        }
    })
}

fn is_proper(t: &[u32; 3]) -> bool {
    t[0] != t[1] && t[1] != t[2] && t[2] != t[0]
}

/// Corners are vertices that exist. The largest number of a type would restart a strip, which glTF
/// forbids.
fn check_corners(
    document: &Document,
    element: &str,
    component: ComponentType,
    corners: &[[u32; 1]],
    vertices: usize,
) -> Result<(), IoError> {
    let restart = match component.size() {
        1 => u32::from(u8::MAX),
        2 => u32::from(u16::MAX),
        _ => u32::MAX,
    };
    let largest = corners.as_flattened().iter().copied().max().unwrap_or_default();
    if largest != restart && (largest as usize) < vertices {
        return Ok(());
    }
    let wrong = |&[c]: &[u32; 1]| c == restart || c as usize >= vertices;
    let at = corners.iter().position(wrong).unwrap_or_default();
    let [found] = corners.get(at).copied().unwrap_or_default();
    if found as usize >= vertices {
        return Err(document.invalid(
            element,
            format!("index {found} at place {at}"),
            format!("less than {vertices}, the number of vertices"),
        ));
    }
    Err(document.invalid(
        element,
        format!("index {found} at place {at}"),
        "no primitive restart: a wider type of index",
    ))
}
