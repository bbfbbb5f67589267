//! A recording of presses, frame by frame, with the truth of each.

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::Adjacency;
use crate::numeric::Random;
use crate::signal::touch::integral::contact;
use crate::signal::touch::path::Walker;
use crate::signal::touch::probe::{Probe, Sensor};
use crate::signal::touch::readout::{Readout, stream};
use crate::signal::touch::sphere::Sphere;
use crate::signal::touch::surface::{below, sagittas};
use crate::signal::touch::{TouchOptions, TouchShape};
use crate::signal::{Channel, Frame, Quantity, Response, SignalError};
use crate::skin::{Patch, PatchId, Skin, SkinError};

/// The truth of one press in a frame; in m, in the frame of the patch's link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Number of the frame, from 0 on.
    pub frame: usize,
    /// Its time, in s.
    pub time: f64,
    /// Number of the press, from 0 on; simultaneous presses have different numbers.
    pub press: usize,
    /// The patch on which it presses; it also touches the others of its link that it reaches.
    pub patch: PatchId,
    /// Centre of the sphere or ellipsoid.
    pub sphere: DVec3,
    /// Centre of pressure: the mean of the skin's points, weighted by their pressure.
    pub centre: DVec3,
    /// Force of the whole contact, also between taxels, in N: the pressure integrated over the skin.
    pub force: f64,
    /// Number of working taxels whose disc is touched.
    pub taxels: usize,
}

/// A recording of spheres that press and roll on a skin, frame by frame.
///
/// ```
/// use dermatome::{
///     mesh::shapes,
///     signal::{TouchOptions, TouchSimulation},
///     skin::Skin,
/// };
///
/// let skin = Skin::from_mesh("palm", shapes::lattice(30, 30, 0.004));
/// let mut recording = TouchSimulation::new(&skin, &TouchOptions::default())?;
/// let (mut frames, mut touched) = (0, 0);
/// while let Some((frame, touches)) = recording.next_frame() {
///     frames += 1;
///     touched += touches.len();
///     let forces = frame.values.iter().flatten().flatten();
///     assert_eq!(forces.sum::<f64>() > 0.0, touches.iter().any(|touch| touch.taxels > 0));
/// }
/// assert_eq!(frames, recording.frames());
/// assert!(touched > 400, "five presses of a second at 100 Hz");
/// # Ok::<(), dermatome::signal::SignalError>(())
/// ```
#[derive(Debug, Clone)]
pub struct TouchSimulation<'a> {
    channel: Channel,
    frames: usize,
    skin: &'a Skin,
    options: TouchOptions,
    places: Random,
    readout: Readout,
    /// The working taxels.
    live: IdVec<PatchId, Vec<VertexId>>,
    adjacency: IdVec<PatchId, Adjacency>,
    frame: Frame,
    next: usize,
    /// The current turn, and its presses.
    turn: Option<usize>,
    presses: Vec<Press>,
    /// The area of each patch, in m^2.
    areas: Vec<f64>,
    contacts: Vec<(Probe, Touch)>,
    touches: Vec<Touch>,
    sensor: Sensor,
    /// How far the skin is below the tangent plane of each taxel where this senses, in m.
    sagittas: IdVec<PatchId, IdVec<VertexId, f64>>,
    /// Sizes and directions of the spheres, and how unsteady their depths are.
    bodies: Random,
    bag: Bag,
}

/// The bag that presses on all taxels.
#[derive(Debug, Clone)]
struct Bag {
    /// Its pressure, in Pa.
    pressure: f64,
    placement: Option<usize>,
    /// The share of the pressure that each live taxel gets, patch after patch.
    shares: Vec<f64>,
    random: Random,
}

#[derive(Debug, Clone)]
struct Press {
    number: usize,
    patch: PatchId,
    walker: Walker,
    probe: Probe,
    /// Its depth where it is steady, in m, and the logarithm of the depth over it, in standard deviations.
    depth: f64,
    wobble: f64,
    /// How far the sphere has rolled, in m.
    rolled: f64,
}

/// How much of the unsteadiness of a depth stays after a hundredth of a press.
const STEADINESS: f64 = 0.974;

/// Share of a press in which the sphere goes down, and in which it goes up.
const RAMP: f64 = 0.2;

/// Most positions that are tried for each of several simultaneous presses.
const MOST_TRIES: usize = 200;

/// How far the distance in space between bodies may differ from that along the skin, relative.
const MOST_OFF: f64 = 0.1;

/// Steps of a rolling sphere at which its distance from the others is checked.
const CHECKED_STEPS: u32 = 16;

impl<'a> TouchSimulation<'a> {
    /// Prepares a recording on the taxels of a skin that are present.
    ///
    /// # Errors
    /// If an option is out of range, or the skin is not valid or has no working taxel.
    pub fn new(skin: &'a Skin, options: &TouchOptions) -> Result<Self, SignalError> {
        options.validate()?;
        skin.validate()?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated: 0 to 1e7")]
        let frames = (options.seconds() * options.rate + 1e-9).floor() as usize;
        let adjacency = |patch: &Patch| {
            Adjacency::new(&patch.mesh)
                .map_err(|source| SkinError::Mesh { patch: patch.name.clone(), source })
        };
        let adjacency = skin.patches.iter().map(adjacency).collect::<Result<_, _>>()?;
        let readout = Readout::new(skin, &adjacency, options, frames)?;
        let mut live: IdVec<PatchId, Vec<_>> = skin.patches.map(|_| Vec::new());
        readout.live().for_each(|(patch, taxel)| live[patch].push(taxel));
        let values = skin.patches.map(|patch| vec![IdVec::filled(f64::NAN, patch.mesh.positions.len())]);
        let unit = if options.quantity == Quantity::Extensive { "N" } else { "Pa" };
        let sensor = Sensor::new(options);
        Ok(Self {
            channel: Channel::new("", unit)?,
            frames,
            skin,
            sagittas: skin.patches.map(|patch| sagittas(patch, sensor.variance())),
            sensor,
            bodies: Random::new(options.seed, stream::BODIES),
            bag: Bag {
                pressure: 0.0,
                placement: None,
                shares: vec![1.0; live.iter().map(Vec::len).sum()],
                random: Random::new(options.seed, stream::BAG),
            },
            options: options.clone(),
            places: Random::new(options.seed, stream::PLACES),
            readout,
            live,
            adjacency,
            frame: Frame { time: 0.0, values, ..Frame::default() },
            next: 0,
            turn: None,
            presses: Vec::new(),
            areas: skin.patches.iter().map(|patch| patch.mesh.area()).collect(),
            contacts: Vec::new(),
            touches: Vec::new(),
        })
    }

    /// The channel of the readings: `force` in N, or `pressure` in Pa.
    pub fn channel(&self) -> &Channel {
        &self.channel
    }

    /// Number of frames of the whole recording.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// How each taxel that is present is read, with its faults. Numbers of a taxel that is dead and reads NaN are not
    /// known.
    pub fn response(&self) -> &Response {
        self.readout.truth()
    }

    /// The next frame, NaN for taxels that are absent or dead, and its truth, press by press; `None` after
    /// the last.
    pub fn next_frame(&mut self) -> Option<(&Frame, &[Touch])> {
        if self.next >= self.frames {
            return None;
        }
        let (frame, time) = (self.next, self.next as f64 / self.options.rate);
        self.next += 1;
        self.frame.time = time;
        if self.options.steps.is_empty() {
            self.touch(frame, time);
        } else {
            self.fill_bag(time);
        }
        let reading = self.options.quantity.extent(self.options.taxel_area());
        let mut shares = self.bag.shares.iter();
        for (id, live) in self.live.enumerate() {
            let patch = &self.skin.patches[id];
            for (&taxel, share) in live.iter().zip(&mut shares) {
                let mut felt = self.bag.pressure * share;
                let is_here = |touch: &Touch| self.skin.patches[touch.patch].link == patch.link;
                for (probe, touch) in self.contacts.iter_mut().filter(|(_, touch)| is_here(touch)) {
                    let normal = patch.taxels.normals[taxel];
                    let at = patch.mesh.positions[taxel] - self.sagittas[id][taxel] * normal;
                    let pressure = self.options.stiffness * self.sensor.depth(probe, at, normal);
                    touch.taxels += usize::from(pressure > 0.0);
                    felt += pressure;
                }
                self.frame.values[id][0][taxel] = reading * felt;
            }
        }
        self.readout.read(frame, &mut self.frame);
        self.touches.clear();
        self.touches.extend(self.contacts.iter().map(|(_, touch)| *touch));
        Some((&self.frame, &self.touches))
    }

    /// The pressure of the bag in the latest frame, in Pa; 0 without a bag.
    pub fn bag_pressure(&self) -> f64 {
        self.bag.pressure
    }

    /// The number of the turn at this time, and the share of it that has passed; `None` in a pause.
    fn turn_at(&self, time: f64) -> Option<(usize, f64)> {
        let TouchOptions { duration, pause, presses, .. } = self.options;
        let turn = (time - pause) / (duration + pause);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated: 0 to 1e7")]
        let number = (turn + 1e-9).floor().max(0.0) as usize;
        let share = (time - pause - number as f64 * (duration + pause)) / duration;
        (number < presses && (0.0..=1.0).contains(&share)).then_some((number, share))
    }

    /// The pressure of the bag at this time: up its steps and down again.
    fn fill_bag(&mut self, time: f64) {
        self.bag.pressure = 0.0;
        let Some((number, share)) = self.turn_at(time) else { return };
        let steps = &self.options.steps;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the share is 0 to 1")]
        let step = (share * 2.0 * steps.len() as f64) as usize;
        let step = step.min(2 * steps.len() - 1);
        self.bag.pressure = steps[step.min(2 * steps.len() - 1 - step)];
        while self.bag.placement.is_none_or(|last| last < number) {
            self.bag.placement = Some(self.bag.placement.map_or(0, |last| last + 1));
            let Bag { shares, random, .. } = &mut self.bag;
            shares
                .iter_mut()
                .for_each(|share| *share = (1.0 + self.options.uneven * random.normal()).max(0.0));
        }
    }

    /// Finds the contacts of the spheres at this time; does not count their taxels yet.
    fn touch(&mut self, frame: usize, time: f64) {
        let TouchOptions { duration, roll, wobble, rate, .. } = self.options;
        self.contacts.clear();
        let Some((number, share)) = self.turn_at(time) else { return };
        while self.turn.is_none_or(|turn| turn < number) {
            let turn = self.turn.map_or(0, |turn| turn + 1);
            self.turn = Some(turn);
            self.begin(turn);
        }
        // Speed is zero at both ends of the descent.
        let way = (share.min(1.0 - share) / RAMP).clamp(0.0, 1.0);
        let way = way * way * (3.0 - 2.0 * way);
        let rolled = roll * ((share - RAMP) / (1.0 - 2.0 * RAMP)).clamp(0.0, 1.0);
        for press in &mut self.presses {
            let (patch, adjacency) = (&self.skin.patches[press.patch], &self.adjacency[press.patch]);
            press.walker.advance(&patch.mesh, adjacency, rolled - press.rolled);
            press.rolled = rolled;
            let mut depth = press.depth * way;
            if wobble > 0.0 {
                let kept = STEADINESS.powf(100.0 / (rate * duration));
                press.wobble = kept * press.wobble + (1.0 - kept * kept).sqrt() * self.bodies.normal();
                // Never as deep as its radius.
                depth *= (wobble * press.wobble - 0.5 * wobble * wobble).exp();
                depth = depth.min(0.99 * press.probe.sphere.radius);
            }
            let radius = press.probe.sphere.radius;
            let Some((foot, normal)) = below(&press.walker, patch) else { continue };
            press.probe.sphere.centre = foot + (radius - depth) * normal;
            (press.probe.foot, press.probe.pressed) = (foot, depth);
            // Rolling does not turn the body about the normal.
            let axis = press.probe.axis.reject_from_normalized(normal).try_normalize();
            press.probe.axis = match press.probe.shape {
                TouchShape::Palm => normal,
                _ => axis.unwrap_or_else(|| normal.any_orthonormal_vector()),
            };
            let of_link = self.skin.patches.iter().filter(|other| other.link == patch.link);
            if let Some((force, centre)) = contact(&press.probe, press.depth, of_link, &self.options) {
                let (number, patch) = (press.number, press.patch);
                let sphere = press.probe.sphere.centre;
                let touch = Touch { frame, time, press: number, patch, sphere, centre, force, taxels: 0 };
                self.contacts.push((press.probe, touch));
            }
        }
    }

    /// Chooses the patches and positions of the presses of a turn.
    fn begin(&mut self, turn: usize) {
        // Where a first body has no neighbour at the given distance, another place is chosen for all.
        for _ in 0..if self.options.apart.is_some() { MOST_TRIES } else { 1 } {
            self.presses.clear();
            for k in 0..self.options.touches {
                for _ in 0..if self.options.apart.is_some() { 1 } else { MOST_TRIES } {
                    let number = turn * self.options.touches + k;
                    let Some(press) = self.choose(number) else { break };
                    let press = match self.options.apart {
                        Some(apart) => self.beside_the_last(press, apart),
                        None => Some(press).filter(|press| self.has_room(press)),
                    };
                    if let Some(press) = press {
                        self.presses.push(press);
                        break;
                    }
                }
            }
            if self.presses.len() == self.options.touches {
                break;
            }
        }
    }

    fn choose(&mut self, number: usize) -> Option<Press> {
        let mut left = self.places.uniform() * self.areas.iter().sum::<f64>();
        let patch = self.areas.iter().position(|area| {
            left -= area;
            left < 0.0
        });
        let patch = PatchId::new(patch.unwrap_or(self.areas.len() - 1));
        let walker = Walker::random(&self.skin.patches[patch].mesh, &mut self.places)?;
        let TouchOptions { radii, depths: [shallow, deep], aspect, shape, length, .. } = &self.options;
        let random = &mut self.bodies;
        let sphere = Sphere { centre: DVec3::ZERO, radius: radii[random.below(radii.len())] };
        let depth = shallow + (deep - shallow) * random.uniform();
        let probe = Probe {
            sphere,
            shape: *shape,
            extent: 0.5 * length,
            foot: DVec3::ZERO,
            pressed: depth,
            axis: random.direction(),
            aspect: 1.0 + (aspect - 1.0) * random.uniform(),
        };
        Some(Press { number, patch, walker, probe, depth, wobble: random.normal(), rolled: 0.0 })
    }

    /// A press at this distance along the skin from the last of its turn, if it has one. `None` if that is at another
    /// distance in space, since a boundary or a curve is between.
    fn beside_the_last(&self, press: Press, apart: f64) -> Option<Press> {
        let Some(last) = self.presses.last() else { return Some(press) };
        let (patch, adjacency) = (&self.skin.patches[last.patch], &self.adjacency[last.patch]);
        let mut walker = last.walker;
        walker.advance(&patch.mesh, adjacency, apart);
        let distance = walker.point.distance(last.walker.point);
        let is_there = (distance - apart).abs() <= MOST_OFF * apart;
        is_there.then_some(Press { patch: last.patch, walker, ..press })
    }

    /// Whether a press keeps its distance from the others of its turn while they roll.
    fn has_room(&self, press: &Press) -> bool {
        let roll = self.options.roll;
        // Half the distance that two bodies need.
        let reach = |press: &Press| press.probe.reach();
        let link = |press: &Press| self.skin.patches[press.patch].link;
        let mut presses: Vec<Press> =
            self.presses.iter().filter(|other| link(other) == link(press)).cloned().collect();
        presses.insert(0, press.clone());
        (0..=CHECKED_STEPS).all(|step| {
            let places = presses.iter_mut().map(|press| {
                let patch = &self.skin.patches[press.patch];
                if step > 0 {
                    let adjacency = &self.adjacency[press.patch];
                    press.walker.advance(&patch.mesh, adjacency, roll / f64::from(CHECKED_STEPS));
                }
                // Neither the spheres nor the points under them may come closer.
                let walked = press.walker.point;
                let (foot, normal) = below(&press.walker, patch).unwrap_or((walked, DVec3::ZERO));
                (reach(press), [foot, foot + press.probe.sphere.radius * normal])
            });
            let places: Vec<_> = places.collect();
            let (own, here) = places[0];
            let is_apart = |(other, there): &(f64, [DVec3; 2])| {
                there.iter().zip(here).all(|(&a, b)| a.distance(b) >= own + other)
            };
            places[1..].iter().all(is_apart)
        })
    }
}
