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

    /// Takes out the samples of taxels without an active neighbour in the same frame.
    pub(super) fn take_lone(
        &mut self,
        neighbours: &IdVec<VertexId, Vec<VertexId>>,
    ) -> IdVec<VertexId, Vec<Sample>> {
        let frames: IdVec<VertexId, Vec<usize>> =
            self.of.map(|samples| samples.iter().map(|sample| sample.frame).collect());
        let is_joined = |v: VertexId, sample: &Sample| {
            neighbours[v].iter().any(|&u| frames[u].binary_search(&sample.frame).is_ok())
        };
        let mut lone = self.of.map(|_| Vec::new());
        for v in lone.ids() {
            let (joined, alone) = self.of[v].iter().partition(|sample: &&Sample| is_joined(v, sample));
            (self.of[v], lone[v]) = (joined, alone);
        }
        lone
    }

    /// Leaves out the samples that are farther than `reach` (m) from the centre of their taxel, and takes those of `more` that are
    /// not; returns how many of `more` are left.
    pub(super) fn keep_near(
        &mut self,
        more: &IdVec<VertexId, Vec<Sample>>,
        centres: &IdVec<VertexId, DVec3>,
        reach: f64,
    ) -> usize {
        let mut left = 0;
        for (v, more) in more.enumerate() {
            let is_near = |sample: &Sample| sample.centre.distance(centres[v]) <= reach;
            let of = &mut self.of[v];
            of.extend(more);
            of.retain(is_near);
            of.sort_by_key(|sample| sample.frame);
            left += more.iter().filter(|sample| !is_near(sample)).count();
        }
        left
    }
}
