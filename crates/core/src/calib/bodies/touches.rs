//! Touches: the rows of a table of contacts that observe one point, and which touches repeat a contact.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use glam::{DMat3, DVec3};

use super::cad::CadSkin;
use super::noise::Stated;
use super::options::BodyOptions;
use crate::calib::{
    CalibError, ContactMeasurement, ContactObservationId, Model, ObservationId, Observations, TouchJoint,
    TouchRow,
};
use crate::id::{IdVec, VertexId, define_id};
use crate::numeric::median;
use crate::skin::TaxelId;

define_id!(
    /// A touch: one or more taxels that feel the probe at once.
    pub TouchId, "t"
);

/// One touch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Touch {
    /// Its taxels in the drawing, and their weights, of sum 1.
    pub(super) taxels: Vec<(VertexId, f64)>,
    /// The centre of the body, or else the mean of the observed positions, in m.
    pub(super) position: DVec3,
    /// Orientation of the probe.
    pub(super) probe: DMat3,
    /// The stated noise: the mean of the information of its rows, which observe one point, so that it does not grow with
    /// their number; of a centre that of [`CENTRE_SIGMA`].
    pub(super) stated: Stated,
    /// How far the position is from the taxels along their normals, before the standoff is known, in m.
    pub(super) lift: f64,
    /// The direction in which its readings fell, its length in standard deviations; zero if it is not known.
    pub(super) outward: DVec3,
    /// The path of the body; `None` if it is not known.
    pub(super) path: Option<DVec3>,
    /// How it moves with each linear unknown ([`Touches::linear`]).
    pub(super) columns: Vec<DVec3>,
    /// The expected centre, at a fit: how far the body is from where its taxels place it, in m.
    pub(super) expected: DVec3,
    /// Number of its contact, dense.
    pub(super) contact: usize,
    /// Weight of the touch: one over the touches of its contact.
    pub(super) weight: f64,
}

/// All touches, in the order of their first rows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Touches {
    pub(super) all: IdVec<TouchId, Touch>,
    /// Number of contacts.
    pub(super) contacts: usize,
    /// The joints whose offsets are fitted.
    pub(super) joints: Vec<TouchJoint>,
    /// Whether the delay of the readings is fitted.
    pub(super) has_delay: bool,
    /// Touches whose radius is not known, and is taken from the others.
    pub(super) assumed_radii: usize,
}

/// Radii that differ by a larger share are those of several bodies.
const ONE_RADIUS: f64 = 0.01;

/// What is stated of the centre of a body next to the mean of the taxels that feel it, in m per axis: taxels are a few
/// millimetres apart, and the scale is estimated.
const CENTRE_SIGMA: f64 = 2e-3;

/// How late readings may be next to the poses, in s: the standard deviation of a prior.
const DELAY_SIGMA: f64 = 0.15;

/// The share of the radius of a sphere at which its centre is above the taxels; the rest is the depth of the press.
pub(super) const LIFT: f64 = 0.9;

/// A touch while its rows are read.
struct RowSum {
    first: ContactObservationId,
    contact: Option<u64>,
    taxels: Vec<(VertexId, f64)>,
    weight: f64,
    position: DVec3,
    probe: DMat3,
    information: DMat3,
    /// Sum of the normals of its taxels.
    normal: DVec3,
    /// The weighted sum of the centre, where all rows have it; those of the radii that are known, and of their weights.
    body: Option<DVec3>,
    radius: [f64; 2],
    outward: DVec3,
    path: Option<DVec3>,
    velocity: DVec3,
    by_joints: Vec<DVec3>,
}

impl Touches {
    /// The touches of observations, on a drawing.
    ///
    /// # Errors
    /// If the observations are not contacts of positions, a taxel is not in the drawing or twice in a touch, the rows of a touch are in
    /// different contacts, touches without a radius are among those of several radii, or an offset of the probe or of joints is fitted and the rows do not say how the touch moves with it.
    pub(super) fn new(
        observations: &Observations,
        cad: &CadSkin,
        options: &BodyOptions,
    ) -> Result<Self, CalibError> {
        Self::of_rows(observations, cad, options, 0)
    }

    /// As [`Touches::new`], of observations that come after `before` rows, which errors count.
    pub(super) fn of_rows(
        observations: &Observations,
        cad: &CadSkin,
        options: &BodyOptions,
        before: usize,
    ) -> Result<Self, CalibError> {
        if let Some((edge, found)) = observations.edges.enumerate().next() {
            let id = observations.taxels[found.from].id;
            let (observation, needed) = (ObservationId::Edge(edge), "contacts alone next to a drawing");
            return Err(CalibError::WrongModel { observation, id, model: Model::Positions, needed });
        }
        let vertices: HashMap<TaxelId, VertexId> = cad.taxels.enumerate().map(|(v, t)| (t.id, v)).collect();
        let (mut sums, mut numbers) = (IdVec::<TouchId, RowSum>::default(), HashMap::new());
        for (place, observed) in observations.contacts.enumerate() {
            let (row, id) = (observations.touch_of(place), observations.taxels[observed.taxel].id);
            let contact = ContactObservationId::new(before + place.index());
            let vertex = *vertices.get(&id).ok_or(CalibError::NotInCad { contact, id })?;
            if options.probe.is_some() && row.probe.is_none() {
                return Err(CalibError::NoProbeOrientation { contact, id });
            }
            if options.joints.is_some() && row.by_joints.is_empty() {
                return Err(CalibError::NoJointColumns { contact, id });
            }
            let touch = match row.touch.map(|number| numbers.entry(number)) {
                Some(Entry::Occupied(known)) => *known.get(),
                Some(Entry::Vacant(place)) => *place.insert(sums.push(RowSum::new(contact, &row))),
                None => sums.push(RowSum::new(contact, &row)),
            };
            let sum = &mut sums[touch];
            if sum.contact != row.contact {
                return Err(CalibError::TouchInTwoContacts { contact, first: sum.first });
            }
            let (position, information) = match &observed.measurement {
                ContactMeasurement::Position { position, information }
                | ContactMeasurement::PositionNormal { position, information, .. } => {
                    (*position, information)
                }
                ContactMeasurement::Pose { .. } => {
                    let (observation, needed) =
                        (ObservationId::Contact(contact), "positions next to a drawing");
                    return Err(CalibError::WrongModel { observation, id, model: Model::Positions, needed });
                }
            };
            for (sum, column) in sum.by_joints.iter_mut().zip(&row.by_joints) {
                *sum += row.weight * *column;
            }
            sum.velocity += row.weight * row.velocity.unwrap_or(DVec3::ZERO);
            sum.outward += row.weight * row.outward.unwrap_or(DVec3::ZERO);
            sum.normal += cad.taxels[vertex].normal.unwrap_or(DVec3::ZERO);
            sum.body = sum.body.zip(row.body).map(|(centre, body)| centre + row.weight * body.centre);
            if let Some(radius) = row.body.map(|body| body.radius).filter(|radius| *radius > 0.0) {
                sum.radius = [sum.radius[0] + row.weight * radius, sum.radius[1] + row.weight];
            }
            if sum.taxels.iter().any(|(other, _)| *other == vertex) {
                return Err(CalibError::TaxelTwiceInTouch { contact, id, first: sum.first });
            }
            sum.taxels.push((vertex, row.weight));
            sum.weight += row.weight;
            sum.position += row.weight * position;
            sum.probe += row.weight * DMat3::from_quat(row.probe.unwrap_or_default());
            sum.information += row.weight * information.matrix();
        }
        let mut touches = Self::of_sums(sums)?;
        touches.has_delay =
            observations.touches.iter().any(|row| row.velocity.is_some_and(|v| v != DVec3::ZERO));
        if options.joints.is_some() {
            touches.joints.clone_from(&observations.joints);
        } else {
            // The last column is the velocity.
            touches.all.iter_mut().for_each(|touch| drop(touch.columns.drain(..touch.columns.len() - 1)));
        }
        Ok(touches)
    }

    /// The radius of touches that have a centre and no radius: that of the others, if all agree; 0 if none has one.
    fn common_radius(sums: &IdVec<TouchId, RowSum>) -> Result<f64, CalibError> {
        let with_centre = || sums.iter().filter(|sum| sum.body.is_some());
        let Some(unknown) = with_centre().find(|sum| sum.radius[1] == 0.0) else { return Ok(0.0) };
        let known =
            || with_centre().filter(|sum| sum.radius[1] > 0.0).map(|sum| sum.radius[0] / sum.radius[1]);
        let Some(usual) = median(known()) else { return Ok(0.0) };
        if known().any(|radius| (radius / usual - 1.0).abs() > ONE_RADIUS) {
            let count = with_centre().filter(|sum| sum.radius[1] == 0.0).count();
            return Err(CalibError::NoRadius { contact: unknown.first, count });
        }
        Ok(usual)
    }

    fn of_sums(sums: IdVec<TouchId, RowSum>) -> Result<Self, CalibError> {
        let common = Self::common_radius(&sums)?;
        let mut assumed_radii = 0;
        let (mut numbers, mut counts) = (HashMap::<u64, usize>::new(), Vec::<usize>::new());
        let mut all: IdVec<TouchId, Touch> = IdVec::default();
        for sum in sums {
            let new = counts.len();
            let contact = sum.contact.map_or(new, |number| *numbers.entry(number).or_insert(new));
            if contact == new {
                counts.push(0);
            }
            counts[contact] += 1;
            let share = sum.weight.recip();
            // Without a normal nothing says where the taxels are from the centre, but the positions of the rows do.
            let [radii, of] = sum.radius;
            let radius = if of > 0.0 { radii / of } else { common };
            assumed_radii += usize::from(sum.body.is_some() && of == 0.0 && common > 0.0);
            let body = sum.body.filter(|_| radius == 0.0 || sum.normal != DVec3::ZERO);
            let (position, stated, lift) = match body {
                Some(centre) => (share * centre, Stated::isotropic(CENTRE_SIGMA), LIFT * radius),
                None => (share * sum.position, Stated::of_information(&(sum.information * share)), 0.0),
            };
            all.push(Touch {
                taxels: sum.taxels.into_iter().map(|(v, w)| (v, w * share)).collect(),
                position,
                probe: sum.probe * share,
                stated,
                lift,
                outward: share * sum.outward,
                path: sum.path,
                columns: sum
                    .by_joints
                    .into_iter()
                    .map(|column| share * column)
                    .chain([-share * sum.velocity])
                    .collect(),
                expected: DVec3::ZERO,
                contact,
                weight: 1.0,
            });
        }
        all.iter_mut().for_each(|touch: &mut Touch| touch.weight = (counts[touch.contact] as f64).recip());
        Ok(Self { all, contacts: counts.len(), joints: Vec::new(), has_delay: false, assumed_radii })
    }

    /// The standard deviation of the standoff where touches are centres of spheres: a tenth of their radius, at least 1 mm.
    pub(super) fn standoff(&self) -> Option<f64> {
        let lifts = self.all.iter().map(|touch| touch.lift).filter(|lift| *lift > 0.0);
        median(lifts).map(|lift| (0.1 * lift / LIFT).max(1e-3))
    }

    /// The standard deviations of the unknowns on which the errors of touches depend linearly: offsets of joints, in rad or m, and the delay of the readings, in s.
    pub(super) fn linear(&self, options: &BodyOptions) -> Vec<f64> {
        let of_joint = |joint: &TouchJoint| options.joints.map(|tolerance| tolerance.of_joint(joint.motion));
        let delay = self.has_delay.then_some(DELAY_SIGMA);
        self.joints.iter().filter_map(of_joint).chain(delay).collect()
    }

    /// Those for which `takes` is true of the contact.
    pub(super) fn of_contacts(&self, takes: impl Fn(usize) -> bool) -> Self {
        let taken = self.all.iter().filter(|touch| takes(touch.contact)).cloned();
        Self { all: taken.collect(), joints: self.joints.clone(), ..*self }
    }
}

impl RowSum {
    fn new(first: ContactObservationId, row: &TouchRow) -> Self {
        Self {
            first,
            contact: row.contact,
            taxels: Vec::new(),
            weight: 0.0,
            position: DVec3::ZERO,
            probe: DMat3::ZERO,
            information: DMat3::ZERO,
            normal: DVec3::ZERO,
            body: Some(DVec3::ZERO),
            radius: [0.0; 2],
            outward: DVec3::ZERO,
            path: row.path,
            velocity: DVec3::ZERO,
            by_joints: vec![DVec3::ZERO; row.by_joints.len()],
        }
    }
}
