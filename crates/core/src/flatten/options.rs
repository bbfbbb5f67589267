//! Options: how a map is computed, what it minimises, and whether it may overlap itself.

use glam::DVec2;

use crate::flatten::FlattenError;
use crate::id::{IdVec, VertexId};

/// How a map is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// Minimise an [`Energy`] with projected Newton, from a spectral conformal start.
    Intrinsic {
        /// The energy that is minimised.
        energy: Energy,
        /// Exponent `gamma` of magnification: 0 isometric, 1 equal map area per taxel.
        magnify: f64,
    },
    /// Spectral natural conformal map alone (`(desbrun2002)`, `(mullen2008)`).
    Conformal,
    /// Linear mix of conformal and authalic rows with the natural conformal boundary (`(desbrun2002)`; eq. 7
    /// and 8 of `(cannata)`).
    ///
    /// It minimises nothing, and only its conformal rows reach the boundary, so nothing bounds the areas
    /// either. On the skins of `meshes/`, angles **and** areas get worse as `area` grows, visibly from a
    /// hundredth of `angle` on; from a tenth on maps flip or cross themselves. With `area: 0.0` this is a
    /// conformal map with two pins.
    Linear {
        /// Weight of the conformal rows.
        angle: f64,
        /// Weight of the authalic rows.
        area: f64,
    },
}

impl Default for Method {
    fn default() -> Self {
        Self::Intrinsic { energy: Energy::default(), magnify: 0.0 }
    }
}

/// The energy that the intrinsic method minimises; both kinds are least at an isometry and infinite at a flip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Energy {
    /// Weighted sum of three terms, each 1 at an isometry (eq. 4 of `(cannata)`).
    Sum {
        /// Weight `l1` of the angle term.
        angle: f64,
        /// Weight `l2` of the area term.
        area: f64,
        /// Weight `l3` of the perimeter term.
        perimeter: f64,
    },
    /// `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`, 4 at an isometry.
    SymmetricDirichlet,
}

impl Default for Energy {
    /// Angle and area alike, no perimeter term.
    fn default() -> Self {
        Self::Sum { angle: 1.0, area: 1.0, perimeter: 0.0 }
    }
}

/// What to do if the map of least distortion overlaps itself: a skin that winds more than once
/// around, like a spiral ramp, or a junction of tubes. Holes stay holes either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overlap {
    /// The intrinsic method continues from the last map that did not, with a scaffold of triangles around it
    /// (after `(jiang2017)`), at more distortion. The other methods have only one map, which may overlap
    /// itself.
    #[default]
    Prevent,
    /// It may overlap itself: least distortion.
    Allow,
}

/// The outer boundary of an intrinsic or a linear map. A conformal map has its own.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Boundary {
    /// Where the energy is least.
    #[default]
    Free,
    /// On a circle as large as the skin, by length.
    Circle,
    /// At these positions (m), counter-clockwise: one for each vertex of the outer loop, `None` for all other
    /// vertices.
    Places(IdVec<VertexId, Option<DVec2>>),
}

/// Options of flattening.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FlattenOptions {
    /// How the map is computed.
    pub method: Method,
    /// Whether it may overlap itself. A map that does not is the same with both.
    pub overlap: Overlap,
    /// Its outer boundary.
    pub boundary: Boundary,
}

impl From<Method> for FlattenOptions {
    fn from(method: Method) -> Self {
        Self { method, ..Self::default() }
    }
}

impl From<Energy> for FlattenOptions {
    /// The map of least `energy`.
    fn from(energy: Energy) -> Self {
        Method::Intrinsic { energy, magnify: 0.0 }.into()
    }
}

impl FlattenOptions {
    /// Whether the map of a level of a pyramid starts from that of the next coarser one.
    #[doc(hidden)]
    pub fn starts_coarse(&self) -> bool {
        self.boundary == Boundary::Free && matches!(self.method, Method::Intrinsic { .. })
    }

    /// Checks that every number is in range and that there is something to minimise.
    pub(crate) fn validate(&self) -> Result<(), FlattenError> {
        match self.method {
            Method::Intrinsic { energy, magnify } => {
                if let Energy::Sum { angle, area, perimeter } = energy {
                    check_weights(angle, area, perimeter)?;
                }
                if !magnify.is_finite() {
                    let needed = "a finite exponent is needed";
                    return Err(FlattenError::Option { name: "magnify", found: magnify, needed });
                }
                Ok(())
            }
            Method::Conformal => Ok(()),
            Method::Linear { angle, area } => check_weights(angle, area, 0.0),
        }
    }
}

fn check_weights(angle: f64, area: f64, perimeter: f64) -> Result<(), FlattenError> {
    for (name, found) in [("angle", angle), ("area", area), ("perimeter", perimeter)] {
        if !(found.is_finite() && found >= 0.0) {
            let needed = "a weight that is finite and not negative is needed";
            return Err(FlattenError::Option { name, found, needed });
        }
    }
    if angle + area <= 0.0 {
        let needed =
            "it or the weight of the area must be positive: the perimeter alone leaves the inside free";
        return Err(FlattenError::Option { name: "angle", found: angle, needed });
    }
    Ok(())
}
