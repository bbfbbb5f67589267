//! What `calibrate` reads before the solve.

use std::collections::HashMap;
use std::io::{BufReader, stdin};
use std::path::{Path, PathBuf};

use dermatome::Error;
use dermatome::calib::{Comparison, Observations, Pose, compare};
use dermatome::id::{IdVec, VertexId};
use dermatome::io::{
    ObservationRemark, observations_from_stream, read_observations, read_triangles, read_truth,
};
use dermatome::skin::TaxelId;

use crate::calibrate::args::Args;
use crate::console::errors::advise;
use crate::console::notes::note;
use crate::files::outputs::is_stream;
use crate::options::{Common, Unit};

/// Reads observations of a file, or of standard input, and further contacts.
pub(super) fn read_seen(
    path: &Path,
    contacts: &[PathBuf],
) -> Result<(Observations, Vec<ObservationRemark>), Error> {
    let read = if is_stream(path) {
        observations_from_stream(BufReader::new(stdin()), "standard input".as_ref(), contacts)
    } else {
        read_observations(path, contacts)
    };
    Ok(read?)
}

/// Whether the table gives no uncertainty, so that one was assumed.
pub(super) fn is_assumed(remark: &ObservationRemark) -> bool {
    matches!(remark, ObservationRemark::AssumedSigma { .. })
}

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
        let contacts: Vec<PathBuf> = args.contacts.iter().map(PathBuf::from).collect();
        let (mut observations, remarks) = read_seen(&args.observations, &contacts)?;
        remarks.iter().for_each(|remark| note!(common, "{remark}"));
        if !observations.touches.is_empty() {
            note!(common, "columns of touches count only with --cad: every row is an observation of its own");
        }
        // What is assumed is a length in metres, which must not become one in the unit of the file.
        if args.unit != Unit::M && remarks.iter().any(is_assumed) {
            let what = "a table gives no uncertainty, and none is assumed with --unit";
            return Err(advise(what, "add a column sigma, in the unit of the file"));
        }
        let metres = args.unit.metres();
        observations.scale(metres);
        if args.clip_information {
            let (clipped, edges) = (observations.clip_information(), observations.edges.len());
            let what = "information matrices were not positive semi-definite and were clipped";
            note!(common, "{clipped} {what} ({edges} edges)");
        }
        let ids = observations.taxels.map(|t| t.id);
        let triangles = args.triangles.as_ref().map(|path| read_triangles(path, &ids));
        let triangles = triangles.transpose().map_err(Error::from)?;
        Ok(Self { observations, triangles, truth: Truth::read(args)? })
    }
}

impl Truth {
    /// That of the arguments.
    pub(super) fn read(args: &Args) -> anyhow::Result<Option<Self>> {
        let Some(path) = &args.truth else { return Ok(None) };
        let mut poses: HashMap<_, Pose> = read_truth(path).map_err(Error::from)?.into_iter().collect();
        poses.values_mut().for_each(|pose| pose.position *= args.unit.metres());
        Ok(Some(Self { path: path.into(), poses }))
    }

    /// Compares the taxels that it knows.
    pub(super) fn compare(&self, found: &[(TaxelId, Pose)], common: &Common) -> anyhow::Result<Comparison> {
        let (mut here, mut there) = (IdVec::<VertexId, Pose>::default(), IdVec::default());
        for (id, pose) in found {
            if let Some(known) = self.poses.get(id) {
                here.push(*pose);
                there.push(*known);
            }
        }
        let (path, known, all) = (self.path.display(), here.len(), found.len());
        if known == 0 {
            return Err(advise(
                format!("{path} has none of the {all} taxels"),
                "give the table that `simulate --truth` wrote with these observations: its ids are those of the taxels",
            ));
        }
        if known < all && !common.quiet {
            note!(common, "{path} has {known} of the {all} taxels; the others are not compared");
        }
        Ok(compare(&here, &there).map_err(Error::from)?)
    }
}
