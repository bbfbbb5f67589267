//! The expected centre of a touch: by how much the mean of its taxels, weighted by their readings, differs from where the sphere
//! is, because taxels are few and modules end.
//!
//! At the end of a module all readings are on one side of the sphere, so their mean is off by up to half a contact.
//! The model of a press on an elastic foundation says by how much: the sphere, at a fit, presses the taxels around it, along the path of
//! the touch, and what their mean depths say of its position is compared with its position. Readings are used relative to
//! each other, so the stiffness need not be known.
//!
//! *Heuristic*: the depth is one of a list, the same for all touches, and the disc of a taxel has a radius of 2 mm. Of nine simulated skins (three
//! shapes of 240 taxels on modules, 240 presses with 1 mm of noise per axis) have an
//! RMSE of 1.21 mm with it and 1.57 mm without, 0.94 and 1.06 mm after rigid alignment; held-back touches are predicted within
//! 1.65 and 2.04 mm in the median.

use glam::DVec3;

use super::placement::{Hierarchy, PlacedTaxel, Placement};
use super::touches::{LIFT, Touch, Touches};
use crate::numeric::median;
use crate::parallel::par_map;

/// The radius of the disc on which a taxel feels, in m, and where on it the depth is sampled: in the middle, and at this share of
/// the radius, which six samples of three quarters of the weight make exact for quadrics.
const DISC: f64 = 2e-3;
const RING: f64 = 0.82;
const RING_WEIGHT: f64 = 0.75;
const RING_SAMPLES: u32 = 6;

/// Distance of the positions of the sphere along its path, in m: less than half the distance of taxels.
const STEP: f64 = 1.5e-3;

/// Most positions along a path: on a longer one the errors of its ends cancel those of its middle.
const MOST_STEPS: f64 = 32.0;

/// Taxels that say how high the surface is.
const NEAREST: usize = 4;

/// Depths of the presses that are tried, over the radius of the sphere; of deep presses the mean of the taxels is nearer to the sphere.
/// The simulated presses of 0.15 have errors of 0.88 mm rms with 0.15, 1.00 with 0.1 or 0.3, 1.29 with 0.05 and 1.72 without.
const DEPTHS: [f64; 5] = [0.05, 0.1, 0.15, 0.2, 0.3];

/// When depths are compared, an error counts at most as this many medians.
const MOST_MEDIANS: f64 = 3.0;

impl Touches {
    /// Finds the expected centre of each touch of a sphere whose path is known, at a placement: of the depths, or none, that
    /// with which the touches have the smallest errors.
    pub(super) fn expect(&mut self, of: &Hierarchy, at: &Placement) {
        let taxels: Vec<PlacedTaxel> = of.positions.ids().map(|v| at.taxel(of, v)).collect();
        let taxels: Vec<PlacedTaxel> =
            taxels.into_iter().filter(|taxel| taxel.normal != DVec3::ZERO).collect();
        let error = |touch: &Touch| at.error(of, touch).0 + touch.expected;
        let errors: Vec<DVec3> = self.all.iter().map(error).collect();
        let most = MOST_MEDIANS * median(errors.iter().map(|error| error.length())).unwrap_or(0.0);
        let cost = |expected: &[DVec3]| {
            let lengths = errors.iter().zip(expected).map(|(error, off)| error.distance(*off).min(most));
            let weighed = lengths.zip(&self.all).map(|(length, touch)| touch.weight * length * length);
            weighed.sum::<f64>()
        };
        let mut best = vec![DVec3::ZERO; errors.len()];
        let mut least = cost(&best);
        for depth in DEPTHS {
            let found = par_map(self.all.as_slice(), |touch| {
                Press::new(touch, at, depth).map_or(DVec3::ZERO, |press| press.expected(&taxels))
            });
            let cost = cost(&found);
            if cost < least {
                (best, least) = (found, cost);
            }
        }
        self.all.iter_mut().zip(best).for_each(|(touch, expected)| touch.expected = expected);
    }

    /// Whether a touch has an expected centre.
    pub(super) fn are_expected(&self) -> bool {
        self.all.iter().any(|touch| touch.lift > 0.0 && touch.path.is_some())
    }
}

/// A sphere that presses along a path.
struct Press {
    centre: DVec3,
    /// The standard deviation of the positions along the path, and its direction.
    path: DVec3,
    radius: f64,
    /// How high the centre is above the surface.
    height: f64,
}

impl Press {
    /// A press of a depth, over the radius; `None` if the touch is not of a sphere, or its path is not known.
    fn new(touch: &Touch, at: &Placement, depth: f64) -> Option<Self> {
        let path = touch.path.filter(|_| touch.lift > 0.0)?;
        let (centre, radius) = (at.body(touch), touch.lift / LIFT);
        Some(Self { centre, path, radius, height: (1.0 - depth) * radius })
    }

    /// The mean over the path, all of whose positions count alike.
    fn expected(&self, taxels: &[PlacedTaxel]) -> DVec3 {
        let half = 3_f64.sqrt() * self.path;
        let steps = (2.0 * half.length() / STEP).ceil().clamp(1.0, MOST_STEPS);
        let reach = half.length() + 2.0 * self.radius;
        let near = taxels.iter().filter(|taxel| taxel.position.distance(self.centre) < reach);
        let near: Vec<&PlacedTaxel> = near.collect();
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        let mut k = 0.5;
        while k < steps {
            if let Some(off) = self.off(self.centre + (2.0 * k / steps - 1.0) * half, &near) {
                sum += off;
                count += 1.0;
            }
            k += 1.0;
        }
        if count > 0.0 { sum / count } else { DVec3::ZERO }
    }

    /// How far a position is from what the readings say of it; `None` if no taxel feels the sphere.
    fn off(&self, centre: DVec3, taxels: &[&PlacedTaxel]) -> Option<DVec3> {
        let mut nearest: Vec<(f64, &PlacedTaxel)> =
            taxels.iter().map(|taxel| (taxel.position.distance_squared(centre), *taxel)).collect();
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut normal, mut above, mut weights) = (DVec3::ZERO, 0.0, 0.0);
        for (squared, taxel) in nearest.iter().take(NEAREST) {
            let weight = (squared + DISC * DISC).recip();
            normal += weight * taxel.normal;
            above += weight * taxel.normal.dot(centre - taxel.position);
            weights += weight;
        }
        let normal = normal.try_normalize()?;
        let centre = centre + (self.height - above / weights) * normal;
        let (mut seen, mut weights) = (DVec3::ZERO, 0.0);
        for taxel in taxels {
            let weight = self.depth(centre, taxel);
            seen += weight * (taxel.position + self.height * taxel.normal);
            weights += weight;
        }
        (weights > 0.0).then(|| centre - seen / weights)
    }

    /// The mean depth on the disc of a taxel, in m.
    fn depth(&self, centre: DVec3, taxel: &PlacedTaxel) -> f64 {
        let off = centre - taxel.position;
        let height = off.dot(taxel.normal);
        let across = (off - height * taxel.normal).length();
        if across > self.radius + DISC || height > self.radius {
            return 0.0;
        }
        let at = |squared: f64| ((self.radius * self.radius - squared).max(0.0).sqrt() - height).max(0.0);
        let ring = RING * DISC;
        let around = |k: u32| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(RING_SAMPLES);
            at(across * across + ring * ring - 2.0 * across * ring * libm::cos(angle))
        };
        let around = (0..RING_SAMPLES).map(around).sum::<f64>() / f64::from(RING_SAMPLES);
        (1.0 - RING_WEIGHT) * at(across * across) + RING_WEIGHT * around
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calib::{
        BodyLevel, BodyOptions, CadSkin, ContactMeasurement, ContactObservation, Information, NamedTaxel,
        Observations, TaxelVariable, TouchRow, TouchingBody, fit_bodies,
    };
    use crate::id::VertexId;
    use crate::numeric::Random;
    use crate::signal::Sphere;
    use crate::skin::TaxelId;

    const RADIUS: f64 = 0.01;
    const SPACING: f64 = 6e-3;

    /// Two by two modules of three by three taxels on a plane, 24 mm apart.
    fn drawing() -> (Vec<DVec3>, CadSkin) {
        let along = |k: u32| f64::from(k / 3) * 24e-3 + f64::from(k % 3) * SPACING;
        let positions: Vec<DVec3> = (0..36).map(|k| DVec3::new(along(k / 6), along(k % 6), 0.02)).collect();
        let names = ["0", "1", "2", "3"];
        let taxels = positions.iter().zip(0..).map(|(&position, id)| NamedTaxel {
            id: TaxelId(id),
            position,
            normal: Some(DVec3::Z),
            module: names[(id as usize / 18) * 2 + (id as usize % 6) / 3],
            patch: "skin",
        });
        let cad = CadSkin::new(taxels).unwrap();
        (positions, cad)
    }

    fn placed(cad: &CadSkin) -> Vec<PlacedTaxel> {
        let touches = Touches::new(&Observations::default(), cad, &BodyOptions::default()).unwrap();
        let hierarchy = Hierarchy::new(cad, &touches);
        hierarchy.positions.ids().map(|v| Placement::drawn(&hierarchy).taxel(&hierarchy, v)).collect()
    }

    /// The exact mean depths of a sphere.
    fn depths(centre: DVec3, taxels: &[DVec3]) -> Vec<f64> {
        let sphere = Sphere { centre, radius: RADIUS };
        taxels.iter().map(|&at| sphere.volume_under_disc(at, DVec3::Z, DISC)).collect()
    }

    fn press(centre: DVec3, path: DVec3) -> Press {
        Press { centre, path, radius: RADIUS, height: 0.85 * RADIUS }
    }

    /// The error of the mean of the taxels, by their exact depths, is what is expected of it, in the middle of a module, at
    /// its ends and beyond them.
    #[test]
    fn the_expected_centre_is_that_of_exact_depths() {
        let (positions, cad) = drawing();
        let taxels = placed(&cad);
        let mut worst = 0.0_f64;
        for x in [6.0, 4.5, 1.0, -1.5, -3.0] {
            let centre = DVec3::new(1e-3 * x, 7e-3, 0.02 + 0.85 * RADIUS);
            let weights = depths(centre, &positions);
            let total: f64 = weights.iter().sum();
            let mean = weights.iter().zip(&positions).map(|(w, &x)| *w * x).sum::<DVec3>() / total;
            let (seen, found) = (centre - mean, press(centre, DVec3::ZERO).expected(&taxels));
            worst = worst.max((seen - found).truncate().length());
        }
        assert!(worst < 1e-4, "{worst} m");
    }

    /// A path has the mean of its positions, and nothing is expected where no taxel is.
    #[test]
    fn a_path_has_the_mean_of_its_positions() {
        let (_, cad) = drawing();
        let taxels = placed(&cad);
        let centre = DVec3::new(1e-3, 6e-3, 0.029);
        let path = DVec3::X * 2e-3;
        let along = |k: f64| centre + (k / 50.0 - 1.0) * 3_f64.sqrt() * path;
        let all = (0..=100).map(|k| press(along(f64::from(k)), DVec3::ZERO).expected(&taxels));
        let mean = all.sum::<DVec3>() / 101.0;
        let found = press(centre, path).expected(&taxels);
        assert!(found.distance(mean) < 1e-4, "{found} for {mean} m");
        assert_eq!(press(DVec3::splat(5.0), path).expected(&taxels), DVec3::ZERO);
    }

    /// Exact touches with readings find the skin better where what is expected of their centres is taken off. Along the normal a
    /// plane says nothing: nine tenths of the radius are taken off.
    #[test]
    fn expected_centres_make_the_fit_better() {
        let (positions, cad) = drawing();
        let off = DVec3::new(4e-3, -3e-3, 2e-3);
        let rmse = |path: Option<DVec3>| {
            let mut random = Random::new(1, 0);
            let mut observations = Observations::default();
            let taxels: Vec<VertexId> = (0..36)
                .map(|id| {
                    observations.taxels.push(TaxelVariable { id: TaxelId(id), initial: None, fixed: false })
                })
                .collect();
            for touch in 0..60 {
                // On half of the touches beyond the ends of a module, as on a skin whose modules have gaps.
                let at = DVec3::new(random.uniform(), random.uniform(), 0.0) * 40e-3 - DVec3::splat(3e-3);
                let centre = DVec3::new(at.x, at.y, 0.02 + 0.85 * RADIUS);
                for (k, depth) in depths(centre, &positions).into_iter().enumerate().filter(|(_, d)| *d > 0.0)
                {
                    let information = Information::diagonal([2.5e5; 3]);
                    let measurement =
                        ContactMeasurement::Position { position: positions[k] + off, information };
                    observations.contacts.push(ContactObservation { taxel: taxels[k], measurement });
                    let body = Some(TouchingBody { centre: centre + off, radius: RADIUS });
                    let (touch, weight) = (Some(touch), 1e9 * depth);
                    observations.touches.push(TouchRow { touch, weight, body, path, ..TouchRow::default() });
                }
            }
            let options = BodyOptions { level: BodyLevel::Module, ..BodyOptions::default() };
            let found = fit_bodies(&observations, &cad, &options).unwrap();
            let squares = found
                .taxels
                .iter()
                .zip(&positions)
                .map(|(t, &x)| (t.position - x - off).truncate().length_squared());
            (squares.sum::<f64>() / 36.0).sqrt()
        };
        let (without, with) = (rmse(None), rmse(Some(DVec3::ZERO)));
        assert!(with < 0.4 * without, "{with} m, without {without} m");
    }
}
