//! Which face every pixel of a level's image shows: sizes are checked, positions snapped to exact
//! coordinates, faces rasterised once. Nothing is guaranteed of the map: where it overlaps itself
//! the smallest face wins, and how often that happened is counted.

use glam::DVec2;

use crate::{
    atlas::{
        AtlasError,
        rasterize::{PIXEL, Snapped, UNCOVERED, rasterize},
    },
    id::{FaceId, IdVec, VertexId},
    map::{ImageFrame, PatchMap},
    mesh::{SurfacePoint, TriMesh},
    pyramid::LevelId,
};

/// Largest width or height of an image, in pixels: what viewers and graphics cards take, and what
/// the exact arithmetic of the rasteriser allows.
const MAX_SIDE: u32 = 16_384;

/// Largest number of pixels: a chart of 1 GiB.
const MAX_PIXELS: u64 = 1 << 28;

/// Which face each pixel of a level's image shows, and where in it.
///
/// A pixel is covered if its centre lies in a face. Where the map overlaps itself the smallest face
/// id wins. Four bytes a pixel: barycentric coordinates are found from the face when they are asked
/// for.
#[derive(Debug, Clone)]
pub struct Chart<'a> {
    mesh: &'a TriMesh,
    uv: &'a IdVec<VertexId, DVec2>,
    frame: ImageFrame,
    faces: Vec<u32>,
    overlaps: usize,
}

impl<'a> Chart<'a> {
    /// Rasterises the map of one level. Work grows with the covered pixels and the triangles.
    ///
    /// # Errors
    /// If the patch breaks a rule of [`SkinMap::validate`](crate::map::SkinMap::validate) or has no
    /// such level, if the image would be larger than 16384 pixels a side or `2^28` in all, or if
    /// the map does not lie in its frame.
    pub fn new(patch: &'a PatchMap, level: LevelId) -> Result<Self, AtlasError> {
        patch.validate()?;
        Self::of_level(patch, level)
    }

    /// As [`Chart::new`], of a patch that is known to be valid.
    pub(super) fn of_level(patch: &'a PatchMap, level: LevelId) -> Result<Self, AtlasError> {
        let Some(at) = patch.levels.get(level) else {
            let last = patch.levels.len().saturating_sub(1);
            return Err(AtlasError::NoSuchLevel { patch: patch.name.clone(), level, last });
        };
        Self::of(&image_name(patch, level), &at.level.mesh, &at.uv, at.frame)
    }

    /// Rasterises a map `uv` (m) of `mesh` into `frame`, which are known to be valid; errors name
    /// it `image`.
    ///
    /// # Errors
    /// As [`Chart::new`].
    pub(crate) fn of(
        image: &str,
        mesh: &'a TriMesh,
        uv: &'a IdVec<VertexId, DVec2>,
        frame: ImageFrame,
    ) -> Result<Self, AtlasError> {
        check_size(&frame, image)?;
        let points = snap(uv, &frame, image)?;
        let (faces, overlaps) = rasterize(&points, &mesh.triangles, frame.size_px.map(|n| n as usize));
        Ok(Self { mesh, uv, frame, faces, overlaps })
    }

    /// The part of the map it shows.
    #[must_use]
    pub const fn frame(&self) -> &ImageFrame {
        &self.frame
    }

    /// How often a pixel centre lay in a further face: 0 for a map that does not overlap itself.
    #[must_use]
    pub const fn overlaps(&self) -> usize {
        self.overlaps
    }

    /// Number of pixels that show a face.
    #[must_use]
    pub fn covered(&self) -> usize {
        self.faces.iter().filter(|&&face| face != UNCOVERED).count()
    }

    /// The map position of a pixel's centre, in m; `row` counts from the top.
    #[must_use]
    pub fn centre(&self, column: u32, row: u32) -> DVec2 {
        let [width, height] = self.frame.size_px.map(f64::from);
        let unit = DVec2::new((f64::from(column) + 0.5) / width, (f64::from(row) + 0.5) / height);
        self.frame.map_position(unit)
    }

    /// The face that a pixel shows; `None` if it shows none or lies outside of the image.
    fn face(&self, column: u32, row: u32) -> Option<FaceId> {
        let [width, height] = self.frame.size_px;
        if column >= width || row >= height {
            return None;
        }
        let face = self.faces[row as usize * width as usize + column as usize];
        (face != UNCOVERED).then(|| FaceId::from(face))
    }

    /// The point of the mesh that a pixel shows; `None` if it shows none or lies outside of the
    /// image.
    #[must_use]
    pub fn point(&self, column: u32, row: u32) -> Option<SurfacePoint> {
        let face = self.face(column, row)?;
        let barycentric = Barycentric::new(self, face).at(self.centre(column, row));
        Some(SurfacePoint { face, barycentric })
    }

    /// Calls `visit(column, face, barycentric)` for the covered pixels of a row, left to right.
    pub(super) fn each_in_row(&self, row: u32, mut visit: impl FnMut(usize, FaceId, [f64; 3])) {
        let width = self.frame.size_px[0] as usize;
        let start = row as usize * width;
        let mut current: Option<Barycentric> = None;
        for ((column, &face), x) in self.faces[start..start + width].iter().enumerate().zip(0_u32..) {
            if face == UNCOVERED {
                continue;
            }
            let face = FaceId::from(face);
            let inside = match current {
                Some(inside) if inside.face == face => inside,
                _ => Barycentric::new(self, face),
            };
            current = Some(inside);
            visit(column, face, inside.at(self.centre(x, row)));
        }
    }
}

/// From the plane to barycentric coordinates of one face.
#[derive(Clone, Copy)]
struct Barycentric {
    face: FaceId,
    corners: [DVec2; 3],
}

impl Barycentric {
    fn new(chart: &Chart<'_>, face: FaceId) -> Self {
        Self { face, corners: chart.mesh.triangles[face].map(|v| chart.uv[v]) }
    }

    /// Non-negative weights with sum 1. Snapping may have moved a centre out of its face by `2^-17`
    /// pixels: that is clamped away.
    fn at(&self, p: DVec2) -> [f64; 3] {
        let [a, b, c] = self.corners.map(|x| x - p);
        let cross = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
        let sign = (cross[0] + cross[1] + cross[2]).signum();
        let inside = cross.map(|x| (sign * x).max(0.0));
        let sum: f64 = inside.iter().sum();
        if sum > 0.0 && sum.is_finite() { inside.map(|x| x / sum) } else { [1.0, 0.0, 0.0] }
    }
}

/// Patch and level as files name them: `palm/L0`.
pub(super) fn image_name(patch: &PatchMap, level: LevelId) -> String {
    format!("{}/L{level}", patch.name)
}

fn check_size(frame: &ImageFrame, image: &str) -> Result<(), AtlasError> {
    let (size, size_px) = (frame.size, frame.size_px);
    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
    if size_px.iter().any(|&n| n > MAX_SIDE) || pixels > MAX_PIXELS {
        let by_side = size.max_element() / f64::from(MAX_SIDE - 2);
        let by_area = (size.x * size.y / MAX_PIXELS as f64).sqrt();
        // A tenth more for the margin.
        let fits_mm = two_digits_up(1.1e3 * by_side.max(by_area));
        return Err(AtlasError::TooLarge {
            image: image.into(),
            size,
            size_px,
            max_side: MAX_SIDE,
            max_pixels: MAX_PIXELS,
            fits_mm,
        });
    }
    Ok(())
}

/// Whether all images together keep to what one may have.
pub(super) fn check_total<'a>(frames: impl Iterator<Item = &'a ImageFrame>) -> Result<(), AtlasError> {
    let (mut images, mut pixels, mut area) = (0, 0_u64, 0.0);
    for frame in frames {
        let [width, height] = frame.size_px.map(u64::from);
        images += 1;
        pixels = pixels.saturating_add(width.saturating_mul(height));
        area += frame.size.x * frame.size.y;
    }
    if pixels > MAX_PIXELS {
        let fits_mm = two_digits_up(1.1e3 * (area / MAX_PIXELS as f64).sqrt());
        return Err(AtlasError::TooManyPixels { images, pixels, max_pixels: MAX_PIXELS, fits_mm });
    }
    Ok(())
}

/// The next number with two digits.
fn two_digits_up(x: f64) -> f64 {
    let exponent = x.log10().floor() - 1.0;
    let digits = (x / 10_f64.powf(exponent)).ceil();
    // Through text, which has no 4.800000000000001.
    format!("{digits}e{exponent}").parse().unwrap_or(x)
}

/// Map positions in the rasteriser's integers.
fn snap(
    uv: &IdVec<VertexId, DVec2>,
    frame: &ImageFrame,
    image: &str,
) -> Result<IdVec<VertexId, Snapped>, AtlasError> {
    let count = DVec2::new(f64::from(frame.size_px[0]), f64::from(frame.size_px[1]));
    let mut points = IdVec::new();
    for (vertex, &at) in uv.enumerate() {
        let px = (at - frame.origin) / frame.size * count;
        // Texture coordinates read from a file are rounded: a pixel beyond the border does no harm.
        let inside = px.cmpge(DVec2::NEG_ONE).all() && px.cmple(count + 1.0).all();
        if !inside {
            return Err(AtlasError::OutsideFrame { image: image.into(), vertex, at });
        }
        let snapped = (px * PIXEL as f64).round();
        #[expect(clippy::cast_possible_truncation, reason = "inside the image, so below 2^31")]
        let (x, y) = (snapped.x as i64, snapped.y as i64);
        points.push([x, i64::from(frame.size_px[1]) * PIXEL - y]);
    }
    Ok(points)
}
