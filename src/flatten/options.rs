use crate::flatten::FlattenError;

/// How a map is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Minimise an [`Energy`] with projected Newton, from a spectral conformal start.
    #[default]
    Intrinsic,
    /// Spectral natural conformal map alone (Desbrun, Meyer and Alliez 2002; Mullen et al. 2008).
    Conformal,
    /// Linear mix of conformal and authalic rows with the natural conformal boundary
    /// (Desbrun, Meyer and Alliez 2002; eq. 7 and 8 of the source paper).
    ///
    /// It minimises nothing, and only its conformal rows reach the boundary, so nothing bounds the areas either. Measured on
    /// the skins of `meshes/`, angles **and** areas get worse as [`FlattenOptions::area`] grows, visibly from a hundredth of the
    /// angle's weight on, and from a tenth on maps flip or cross themselves. Without it this is a conformal map with two pins.
    Linear,
}

/// What the intrinsic method minimises; both are least at an isometry and infinite at a flip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Energy {
    /// Weighted sum of angle, area and perimeter terms, each 1 at isometry (eq. 4 of the source paper).
    #[default]
    Sum,
    /// `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`, 4 at isometry.
    SymmetricDirichlet,
}

/// Whether the boundary of the map may cross itself, so that two places of the skin share one of the map.
///
/// A skin that winds more than once around, like a spiral ramp, lies over itself on its map of least distortion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overlap {
    /// Whatever distorts least. Holes stay holes even so: a map with the rim of one over itself or inside out is computed
    /// again as if overlap were to be prevented.
    #[default]
    Allowed,
    /// A map that would cross itself is computed again with a boundary whose parts repel each other (after Smith and
    /// Schaefer 2015): one place of the skin for every place of the map, at more distortion. A map that does not cross
    /// itself stays as it is.
    ///
    /// That takes seconds at ten thousand vertices and minutes at a hundred thousand: Newton steps are many while parts of
    /// the boundary slide past each other.
    ///
    /// Only [`Method::Intrinsic`] can do that; the other methods fail where their map lies over itself.
    Prevented,
}

/// Options of flattening.
#[derive(Debug, Clone, PartialEq)]
pub struct FlattenOptions {
    /// How the map is computed.
    pub method: Method,
    /// What the intrinsic method minimises.
    pub energy: Energy,
    /// Weight of the angle term (`l1`), also of the conformal rows of [`Method::Linear`].
    pub angle: f64,
    /// Weight of the area term (`l2`), also of the authalic rows of [`Method::Linear`].
    pub area: f64,
    /// Weight of the perimeter term (`l3`).
    pub perimeter: f64,
    /// Exponent `gamma` of magnification: 0 isometric, 1 equal map area per taxel.
    pub magnify: f64,
    /// Whether the boundary of the map may cross itself.
    pub overlap: Overlap,
}

impl Default for FlattenOptions {
    fn default() -> Self {
        Self {
            method: Method::default(),
            energy: Energy::default(),
            angle: 1.0,
            area: 1.0,
            perimeter: 0.0,
            magnify: 0.0,
            overlap: Overlap::default(),
        }
    }
}

impl FlattenOptions {
    /// Checks that every number is in range and that something is left to minimise.
    ///
    /// # Errors
    /// [`FlattenError::Option`] with the field, the value found and what is needed.
    pub fn validate(&self) -> Result<(), FlattenError> {
        for (name, found) in [("angle", self.angle), ("area", self.area), ("perimeter", self.perimeter)] {
            if !(found.is_finite() && found >= 0.0) {
                return Err(FlattenError::Option {
                    name,
                    found,
                    needed: "a weight that is finite and not negative is needed",
                });
            }
        }
        if !self.magnify.is_finite() {
            let needed = "a finite exponent is needed";
            return Err(FlattenError::Option { name: "magnify", found: self.magnify, needed });
        }
        let weighted = match self.method {
            Method::Intrinsic => self.energy == Energy::Sum,
            Method::Conformal => false,
            Method::Linear => true,
        };
        if weighted && self.angle + self.area <= 0.0 {
            let needed =
                "it or the weight of the area must be positive: the perimeter alone leaves the inside free";
            return Err(FlattenError::Option { name: "angle", found: self.angle, needed });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(options: &FlattenOptions) -> Option<&'static str> {
        match options.validate() {
            Err(FlattenError::Option { name, .. }) => Some(name),
            _ => None,
        }
    }

    #[test]
    fn weights_that_mean_nothing_are_refused_by_name() {
        let sound = FlattenOptions::default();
        assert_eq!(refused(&sound), None);
        assert_eq!(refused(&FlattenOptions { area: -1.0, ..sound.clone() }), Some("area"));
        assert_eq!(refused(&FlattenOptions { perimeter: f64::NAN, ..sound.clone() }), Some("perimeter"));
        assert_eq!(refused(&FlattenOptions { magnify: f64::INFINITY, ..sound.clone() }), Some("magnify"));
        assert_eq!(
            refused(&FlattenOptions { angle: 0.0, area: 0.0, perimeter: 1.0, ..sound }),
            Some("angle")
        );
    }
}
