//! What each taxel felt: the samples of a log, taxel by taxel, in the frame of the link.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::skin::TaxelId;
use crate::touches::log::{TouchBody, TouchLog};

/// One reading of a taxel, and where the body was.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// The frame of the log.
    pub(super) frame: usize,
    /// The touch, counted from 0 in the order of the log.
    pub(super) touch: usize,
    /// The point of the body that the log names, in the frame of the link, in m.
    pub(super) centre: DVec3,
    /// The radius of a sphere, in m; 0 for a point and a plane.
    pub(super) radius: f64,
    /// The normal of a plane to the side of the skin, in the frame of the link.
    pub(super) plane: Option<DVec3>,
    pub(super) reading: f64,
}

/// The samples of all taxels, which are in the order of their ids.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    pub(super) ids: IdVec<VertexId, TaxelId>,
    pub(super) of: IdVec<VertexId, Vec<Sample>>,
    /// The first frame of each touch.
    pub(super) touches: Vec<usize>,
}

impl Samples {
    /// Those of the taxels for which `is_used` holds.
    pub(super) fn new(log: &TouchLog, is_used: impl Fn(TaxelId) -> bool) -> Self {
        let mut by_id: BTreeMap<TaxelId, Vec<Sample>> = BTreeMap::new();
        let mut touches: Vec<usize> = Vec::new();
        for (k, frame) in log.frames.iter().enumerate() {
            if touches.last().is_none_or(|&first| log.frames[first].touch != frame.touch) {
                touches.push(k);
            }
            let into_link = frame.link.inverse();
            let plane = match frame.body {
                TouchBody::Plane { normal, .. } => Some(into_link.rotation * normal),
                TouchBody::Sphere { .. } => None,
            };
            for &(id, reading) in frame.felt.iter().filter(|(id, _)| is_used(*id)) {
                by_id.entry(id).or_default().push(Sample {
                    frame: k,
                    touch: touches.len() - 1,
                    centre: into_link.apply(frame.body.point()),
                    radius: frame.body.radius(),
                    plane,
                    reading,
                });
            }
        }
        let (ids, of): (Vec<_>, Vec<_>) = by_id.into_iter().unzip();
        Self { ids: ids.into(), of: of.into(), touches }
    }

    /// Leaves out the samples of taxels without an active neighbour in the same frame; returns how many.
    pub(super) fn drop_lone(&mut self, neighbours: &IdVec<VertexId, Vec<VertexId>>) -> usize {
        let frames: IdVec<VertexId, Vec<usize>> =
            self.of.map(|samples| samples.iter().map(|sample| sample.frame).collect());
        let mut dropped = 0;
        for (taxel, samples) in self.of.iter_mut().enumerate() {
            let around = &neighbours[VertexId::new(taxel)];
            let before = samples.len();
            samples.retain(|sample| around.iter().any(|&v| frames[v].binary_search(&sample.frame).is_ok()));
            dropped += before - samples.len();
        }
        dropped
    }
}
