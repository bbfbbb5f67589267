//! What `calibrate` reads before the solve.

use std::{collections::HashMap, path::PathBuf};

use dermatome::{
    Error,
    calib::{Observations, Pose},
    id::VertexId,
    io::{IoError, read_observations, read_triangles, read_truth},
    skin::TaxelId,
};

use crate::{calibrate::args::Args, common::Common, notes::note};

/// What is read before the solve, so that no broken file wastes one.
pub(super) struct Inputs {
    pub(super) observations: Observations,
    pub(super) triangles: Option<Vec<[VertexId; 3]>>,
    pub(super) truth: Option<Truth>,
}

/// Where the taxels truly are, and the file that says so.
pub(super) struct Truth {
    pub(super) path: PathBuf,
    pub(super) poses: HashMap<TaxelId, Pose>,
}

impl Inputs {
    pub(super) fn read(args: &Args, common: &Common) -> anyhow::Result<Self> {
        let read = read_observations(&args.observations, &args.contacts);
        let (mut observations, remarks) = read.map_err(Error::from)?;
        remarks.iter().for_each(|remark| note(common, remark));
        if args.clip_information {
            let (clipped, edges) = (observations.clip_information(), observations.edges.len());
            let what = "information matrices were not positive semi-definite and were clipped";
            note(common, format_args!("{clipped} {what} ({edges} edges)"));
        }
        let ids = observations.taxels.map(|t| t.id);
        let triangles = args.triangles.as_ref().map(|path| read_triangles(path, &ids));
        let triangles = triangles.transpose().map_err(Error::from)?;
        if let Some((_, Some(remark))) = &triangles {
            note(common, remark);
        }
        let truth = args
            .truth
            .as_ref()
            .map(|path| Ok(Truth { path: path.clone(), poses: read_truth(path)?.into_iter().collect() }));
        Ok(Self {
            observations,
            triangles: triangles.map(|(triangles, _)| triangles),
            truth: truth.transpose().map_err(|e: IoError| Error::from(e))?,
        })
    }
}
