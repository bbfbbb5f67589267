//! Chains unrolled in the plane: modules edge to edge, at 1:1, as they lie on the table.

use glam::{DAffine2, DVec2};

use crate::design::grow::{GAP, outline_separation};
use crate::design::{Design, Module};

/// Modules of one chain in the plane, none over another; a chain that would lie over itself has several.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    /// The chain.
    pub chain: usize,
    /// The modules, and the motion that places the drawing of each in the plane, in m.
    pub modules: Vec<(usize, DAffine2)>,
}

/// Unrolls the chains of a design, each along its steps.
pub fn strips(design: &Design, module: &Module) -> Vec<Strip> {
    let mut strips = Vec::new();
    let mut places = vec![DAffine2::IDENTITY; design.modules.len()];
    for (chain, members) in design.chains.iter().enumerate() {
        let mut strip = Strip { chain, modules: Vec::new() };
        for (k, &own) in members.modules.iter().enumerate() {
            places[own] = DAffine2::IDENTITY;
            let step = k.checked_sub(1).map(|k| members.steps[k]);
            let from = step.and_then(|step| strip.modules.iter().position(|(m, _)| *m == step.modules[0]));
            if let (Some(step), Some(_)) = (step, from) {
                places[own] = beside(module, places[step.modules[0]], step.edges);
            }
            let is_free = |other: &(usize, DAffine2)| {
                let outline = |place: DAffine2| -> Vec<DVec2> {
                    module.outline.iter().map(|p| place.transform_point2(*p)).collect()
                };
                outline_separation(&outline(other.1), &outline(places[own])) > -0.1 * GAP
            };
            // A step from a module of an earlier strip begins a new one, too.
            if (step.is_some() && from.is_none()) || !strip.modules.iter().all(is_free) {
                places[own] = DAffine2::IDENTITY;
                strips.push(std::mem::replace(&mut strip, Strip { chain, modules: Vec::new() }));
            }
            strip.modules.push((own, places[own]));
        }
        strips.push(strip);
    }
    strips.iter_mut().for_each(|strip| turn(strip, module));
    strips
}

/// Turns a strip so that it runs along x from its first module to its last.
fn turn(strip: &mut Strip, module: &Module) {
    let centre = |(_, place): &(usize, DAffine2)| place.transform_point2(module.centre());
    let ends = strip.modules.first().zip(strip.modules.last());
    let along = ends.map_or(DVec2::ZERO, |(first, last)| centre(last) - centre(first));
    let back = DAffine2::from_angle(-along.to_angle());
    strip.modules.iter_mut().for_each(|(_, place)| *place = back * *place);
}

/// The place of a module whose edge `edges[1]` lies along edge `edges[0]` of another, with a gap between.
fn beside(module: &Module, other: DAffine2, edges: [usize; 2]) -> DAffine2 {
    let [a, b] = module.edge(edges[0]).map(|p| other.transform_point2(p));
    let [c, d] = module.edge(edges[1]);
    // The edges run in opposite directions.
    let turn = (a - b).to_angle() - (d - c).to_angle();
    let place = DAffine2::from_angle(turn);
    let middle = a.midpoint(b) - (b - a).normalize().perp() * GAP;
    DAffine2 { translation: middle - place.transform_vector2(c.midpoint(d)), ..place }
}
