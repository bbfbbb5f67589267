//! `calibrate` with a drawing: touches move the bodies of a skin.

use std::{collections::HashMap, path::PathBuf, sync::Arc};

use dermatome::{
    Error, Skin,
    calib::{
        BodyCalibration, BodyFit, BodyLevel, BodyOptions, CadSkin, CalibratedTaxel, Folds, JointMotion,
        JointOffset, Misassembly, ModuleId, ModuleNames, NamedTaxel, Tolerance, fit_bodies_with,
    },
    id::{IdVec, VertexId},
    io::{modules_of_skin, read_draft, read_modules, write_bodies},
    skin::{AssembleOptions, Covariance, TaxelId, assemble},
};
use glam::DVec3;
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};

use crate::{
    arguments::{arg, object},
    arrays::{matrix, vector},
    errors::{bad, error},
    jobs::run,
    map::PyMap,
    observations::PyObservations,
    options::{count, word},
    skin::PySkin,
};

/// The modules of taxels, in a table or by their ids.
#[derive(FromPyObject)]
pub(crate) enum ModulesArg {
    Named(HashMap<u32, String>),
    Table(PathBuf),
}

/// A drawing as bodies, and as a skin, or why it is none.
#[derive(Debug, Clone)]
pub(crate) struct Drawing {
    pub(crate) cad: CadSkin,
    skin: Result<Arc<Skin>, String>,
    /// What is said of the modules that were given.
    remark: Option<String>,
}

impl Drawing {
    /// The drawing that `cad` is: a skin, a map or a file.
    pub(crate) fn read(
        py: Python<'_>,
        cad: &Bound<'_, PyAny>,
        modules: Option<ModulesArg>,
    ) -> PyResult<Self> {
        let names = move || match modules {
            None => Ok::<Option<ModuleNames>, Error>(None),
            Some(ModulesArg::Named(names)) => {
                Ok(Some(names.into_iter().map(|(id, name)| (TaxelId(id), name)).collect()))
            }
            Some(ModulesArg::Table(path)) => Ok(Some(read_modules(&path)?.rows.into_iter().collect())),
        };
        let skin = match (cad.cast::<PySkin>(), cad.cast::<PyMap>(), cad.extract::<PathBuf>()) {
            (Ok(skin), ..) => Arc::clone(&skin.get().skin),
            (_, Ok(map), _) => Arc::new(map.get().map.skin()),
            (.., Ok(path)) => {
                return run(py, 0, move |_| Self::of_file(&path, names()?))?.map_err(error);
            }
            _ => return Err(bad("cad", cad.get_type().name()?, "a Skin, a Map or a path")),
        };
        let made = run(py, 0, move |_| {
            let names = names()?;
            let cad = CadSkin::of_skin(&skin, names.as_ref())?;
            let remark = names.and_then(|names| cad.remark_of_modules(&names));
            Ok::<_, Error>(Self { cad, skin: Ok(skin), remark })
        });
        made?.map_err(error)
    }

    fn of_file(path: &std::path::Path, mut names: Option<ModuleNames>) -> Result<Self, Error> {
        let draft = read_draft(path)?;
        if names.is_none() {
            names = modules_of_skin(path)?.map(|rows| rows.into_iter().collect());
        }
        let cad = CadSkin::of_draft(&draft, names.as_ref())?;
        let assembled = assemble(&draft, &AssembleOptions::default());
        let skin = assembled.map(|made| Arc::new(made.skin)).map_err(|error| error.to_string());
        let remark = names.and_then(|names| cad.remark_of_modules(&names));
        Ok(Self { cad, skin, remark })
    }

    /// What Python makes a `BodyCalibration` of.
    pub(crate) fn result<'py>(
        &self,
        py: Python<'py>,
        found: &BodyCalibration,
    ) -> PyResult<Bound<'py, PyDict>> {
        let name = |module: ModuleId| self.cad.modules[module].name.clone();
        let all = PyDict::new(py);
        let of_taxels = |of: &dyn Fn(ModuleId) -> String| -> Vec<String> {
            self.cad.taxels.iter().map(|taxel| of(taxel.module)).collect()
        };
        all.set_item("ids", vector(py, found.taxels.iter().map(|taxel| taxel.id.0)))?;
        all.set_item("positions", matrix(py, found.taxels.iter().map(|taxel| taxel.position.to_array()))?)?;
        let normal = |taxel: &CalibratedTaxel| taxel.normal.map_or([f64::NAN; 3], |n| n.to_array());
        all.set_item("normals", matrix(py, found.taxels.iter().map(normal))?)?;
        let covariance = |taxel: &CalibratedTaxel| <[f64; 6]>::from(taxel.covariance);
        all.set_item("covariances", matrix(py, found.taxels.iter().map(covariance))?)?;
        all.set_item("modules", of_taxels(&name))?;
        all.set_item(
            "patches",
            of_taxels(&|module| self.cad.patches[self.cad.modules[module].patch].clone()),
        )?;
        let [touches, contacts] = found.counts;
        all.set_item("touches", touches)?;
        all.set_item("contacts", contacts)?;
        all.set_item("rejected", vector(py, found.rejected.iter().map(|touch| touch.raw())))?;
        all.set_item("chi2", found.chi2)?;
        all.set_item("dof", found.degrees_of_freedom)?;
        all.set_item("noise", found.noise)?;
        all.set_item("noise_over_stated", found.noise_over_stated)?;
        all.set_item("side", found.side)?;
        all.set_item("faults", found.faults())?;
        let probe = found.probe.map(|probe| {
            let of = |v: DVec3| vector(py, v.to_array());
            (of(probe.offset), of(probe.sigmas))
        });
        all.set_item("probe", probe)?;
        all.set_item("standoff", found.standoff.map(|[standoff, _]| standoff))?;
        let joint = |found: &JointOffset| {
            let slides = found.joint.motion == JointMotion::Slides;
            (found.joint.name.clone(), slides, found.offset, found.sigma)
        };
        all.set_item("joints", found.joints.iter().map(joint).collect::<Vec<_>>())?;
        all.set_item("delay", found.delay.map(|delay| delay.seconds))?;
        all.set_item("delay_sigma", found.delay.map(|delay| delay.sigma))?;
        all.set_item("delay_removed", found.delay.map_or(0.0, |delay| delay.removed))?;
        all.set_item("standoff_sigma", found.standoff.map(|[_, sigma]| sigma))?;
        let bodies: Vec<_> = found.bodies.iter().map(|body| of_body(py, body)).collect::<PyResult<_>>()?;
        all.set_item("bodies", PyList::new(py, bodies)?)?;
        let exchanged = found.misassembled.exchanged.iter().map(|&[a, b]| (name(a), name(b)));
        all.set_item("exchanged", exchanged.collect::<Vec<_>>())?;
        let turned = found.misassembled.turned.iter().map(|t| (name(t.module), t.degrees.to_radians()));
        all.set_item("turned", turned.collect::<Vec<_>>())?;
        all.set_item("untouched", found.untouched.iter().map(|&module| name(module)).collect::<Vec<_>>())?;
        let held_back = found.held_back.as_ref().map(|held_back| {
            let levels: Vec<_> = held_back
                .scores
                .iter()
                .map(|s| (s.level.to_string(), s.median, s.most, s.contact_median, s.contact_mean))
                .collect();
            let drawn = (held_back.drawn_median, held_back.drawn_most);
            (held_back.supported.to_string(), levels, drawn, held_back.explained)
        });
        all.set_item("held_back", held_back)?;
        all.set_item("steps", found.steps)?;
        all.set_item("converged", found.converged)?;
        let remarks = self.remark.iter().cloned().chain(found.remarks(&self.cad));
        all.set_item("remarks", remarks.collect::<Vec<_>>())?;
        match &self.skin {
            Ok(skin) => {
                let mut skin = Skin::clone(skin);
                found.move_taxels(&mut skin);
                all.set_item("skin", PySkin::new(skin, &[]).into_pyobject(py)?)?;
            }
            Err(why) => all.set_item("skin", why)?,
        }
        Ok(all)
    }
}

/// What Python makes a `Body` of.
fn of_body<'py>(py: Python<'py>, body: &BodyFit) -> PyResult<Bound<'py, PyDict>> {
    let made = PyDict::new(py);
    made.set_item("level", body.level.to_string())?;
    made.set_item("name", &body.name)?;
    made.set_item("contacts", body.contacts)?;
    made.set_item("moved", body.translation.length())?;
    made.set_item("turned", body.rotation.length())?;
    made.set_item("translation", vector(py, body.translation.to_array()))?;
    made.set_item("rotation", vector(py, body.rotation.to_array()))?;
    made.set_item("sigma", body.sigmas.map(|[sigma, _]| sigma))?;
    made.set_item("sigma_turned", body.sigmas.map(|[_, sigma]| sigma))?;
    made.set_item("chi2", body.test.map(|test| test.chi2))?;
    made.set_item("dof", body.test.map(|test| test.degrees_of_freedom))?;
    made.set_item("p", body.test.map(|test| test.p))?;
    made.set_item("believable", body.test.map(|test| test.is_believable()))?;
    Ok(made)
}

/// The options of a fit, as a dict has them; tolerances in m and rad.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct BodyArgs {
    level: String,
    mount: Option<f64>,
    mount_angle: Option<f64>,
    patch: Option<f64>,
    patch_angle: Option<f64>,
    module: Option<f64>,
    module_angle: Option<f64>,
    fit_probe: Option<f64>,
    fit_standoff: Option<f64>,
    fit_joints: Option<f64>,
    as_drawn: bool,
    folds: i64,
    seed: u64,
}

impl BodyArgs {
    pub(crate) fn options(&self) -> PyResult<BodyOptions> {
        let known = BodyOptions::default();
        let tolerance = |known: Tolerance, translation: Option<f64>, rotation: Option<f64>| Tolerance {
            translation: translation.unwrap_or(known.translation),
            rotation: rotation.unwrap_or(known.rotation),
        };
        let levels = BodyLevel::ALL.map(|level| (level.to_string(), level));
        let levels = levels.each_ref().map(|(name, level)| (name.as_str(), *level));
        let folds = Folds { count: count("folds", self.folds)?, seed: self.seed };
        Ok(BodyOptions {
            mount: tolerance(known.mount, self.mount, self.mount_angle),
            patch: tolerance(known.patch, self.patch, self.patch_angle),
            module: tolerance(known.module, self.module, self.module_angle),
            level: word("level", &self.level, &levels)?,
            probe: self.fit_probe,
            standoff: self.fit_standoff,
            joints: self
                .fit_joints
                .map(|turn| Tolerance { translation: 1e-3 * turn.to_degrees(), rotation: turn }),
            misassembly: if self.as_drawn { Misassembly::Reported } else { Misassembly::Corrected },
            folds: Some(folds),
        })
    }
}

/// Fit the bodies of a drawing.
#[pyfunction]
pub(crate) fn fit_bodies<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = object)] observations: &Bound<'py, PyObservations>,
    cad: &Bound<'py, PyAny>,
    modules: Option<ModulesArg>,
    options: BodyArgs,
    #[pyo3(from_py_with = arg)] threads: i64,
) -> PyResult<Bound<'py, PyDict>> {
    let observations = observations.get();
    let options = options.options()?;
    let drawing = Drawing::read(py, cad, modules)?;
    let (of, bodies) = (Arc::clone(&observations.observations), drawing.cad.clone());
    let fit = move |stop: &crate::jobs::Stop| fit_bodies_with(&of, &bodies, &options, stop.run());
    let found = run(py, count("threads", threads)?, fit)?.map_err(error)?;
    let made = drawing.result(py, &found)?;
    let said: Vec<String> =
        made.get_item("remarks")?.map(|said| said.extract()).transpose()?.unwrap_or_default();
    made.set_item("remarks", [observations.remarks_of_bodies(), said].concat())?;
    Ok(made)
}

/// A calibrated taxel: its id, position, normal, NaN where it has none, covariance, module and patch.
type TaxelRow = (u32, [f64; 3], [f64; 3], [f64; 6], String, String);

/// Write the table of taxels that `calibrate --cad -o` writes.
#[pyfunction]
pub(crate) fn write_taxels_of_bodies(
    py: Python<'_>,
    #[pyo3(from_py_with = arg)] path: PathBuf,
    rows: Vec<TaxelRow>,
) -> PyResult<()> {
    let taxel = |(id, position, normal, covariance, ..): &TaxelRow| CalibratedTaxel {
        id: TaxelId(*id),
        position: DVec3::from_array(*position),
        normal: Some(DVec3::from_array(*normal)).filter(|normal| normal.is_finite()),
        covariance: Covariance::from(*covariance),
    };
    let taxels: IdVec<VertexId, CalibratedTaxel> = rows.iter().map(taxel).collect();
    let named = taxels.iter().zip(&rows).map(|(taxel, (.., module, patch))| NamedTaxel {
        id: taxel.id,
        position: taxel.position,
        normal: taxel.normal,
        module,
        patch,
    });
    let cad = CadSkin::new(named).map_err(|e| error(Error::from(e)))?;
    run(py, 0, move |_| write_bodies(&path, &cad, &taxels))?.map_err(error)
}
