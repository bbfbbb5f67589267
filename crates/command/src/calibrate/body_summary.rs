//! What `calibrate --cad` prints.

use dermatome::calib::{
    BodyCalibration, BodyFit, BodyLevel, CadSkin, Comparison, HeldBack, JointMotion, JointOffset, ModuleId,
    Tolerance,
};
use serde::Serialize;

use crate::console::print::{plain, print, print_table};

/// What `--json` prints.
#[derive(Debug, Serialize)]
pub(super) struct BodySummary {
    touches: usize,
    contacts: usize,
    rejected: usize,
    chi2: f64,
    dof: f64,
    noise_mm: f64,
    noise_over_stated: f64,
    side: f64,
    tolerances: Vec<ToleranceRow>,
    faults: Vec<String>,
    doubts: Vec<String>,
    probe: Option<ProbeSummary>,
    standoff_mm: Option<f64>,
    standoff_sigma_mm: Option<f64>,
    joints: Vec<JointRow>,
    delay_ms: Option<f64>,
    delay_sigma_ms: Option<f64>,
    delay_removed_ms: f64,
    bodies: Vec<BodyRow>,
    exchanged: Vec<[String; 2]>,
    turned: Vec<TurnedRow>,
    untouched: Vec<String>,
    held_back: Option<HeldBackSummary>,
    steps: usize,
    converged: bool,
    seconds: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_aligned_mm: Option<f64>,
}

#[derive(Debug, Serialize)]
struct ProbeSummary {
    offset_mm: [f64; 3],
    sigma_mm: [f64; 3],
}

/// The offset of a joint from its values.
#[derive(Debug, Serialize)]
struct JointRow {
    name: String,
    unit: &'static str,
    offset: f64,
    sigma: f64,
}

impl JointRow {
    fn new(found: &JointOffset) -> Self {
        let (unit, scale) = match found.joint.motion {
            JointMotion::Turns => ("degrees", 1_f64.to_degrees()),
            JointMotion::Slides => ("mm", 1e3),
        };
        let (offset, sigma) = (scale * found.offset, scale * found.sigma);
        Self { name: found.joint.name.clone(), unit, offset, sigma }
    }
}

#[derive(Debug, Serialize)]
struct BodyRow {
    level: String,
    name: String,
    contacts: usize,
    moved_mm: f64,
    turned_deg: f64,
    translation_mm: [f64; 3],
    rotation_deg: [f64; 3],
    sigma_mm: Option<f64>,
    sigma_deg: Option<f64>,
    chi2: Option<f64>,
    dof: Option<usize>,
    p: Option<f64>,
    believable: Option<bool>,
}

/// The tolerance of a level, as given and as learned.
#[derive(Debug, Serialize)]
struct ToleranceRow {
    level: String,
    given_mm: f64,
    given_deg: f64,
    learned_mm: f64,
    learned_deg: f64,
}

impl ToleranceRow {
    fn new((level, given, learned): &(BodyLevel, Tolerance, Tolerance)) -> Self {
        Self {
            level: level.to_string(),
            given_mm: 1e3 * given.translation,
            given_deg: given.rotation.to_degrees(),
            learned_mm: 1e3 * learned.translation,
            learned_deg: learned.rotation.to_degrees(),
        }
    }
}

#[derive(Debug, Serialize)]
struct TurnedRow {
    module: String,
    degrees: f64,
}

#[derive(Debug, Serialize)]
struct HeldBackSummary {
    supported: String,
    explained: f64,
    gain: f64,
    drawing_median_mm: f64,
    drawing_p90_mm: f64,
    levels: Vec<LevelRow>,
}

#[derive(Debug, Serialize)]
struct LevelRow {
    level: String,
    median_mm: f64,
    p90_mm: f64,
    contact_median_mm: f64,
    contact_mean_mm: f64,
}

impl BodySummary {
    pub(super) fn new(
        found: &BodyCalibration,
        cad: &CadSkin,
        seconds: f64,
        truth: Option<Comparison>,
    ) -> Self {
        let name = |module: ModuleId| cad.modules[module].name.clone();
        let [touches, contacts] = found.counts;
        let probe = found.probe.map(|probe| ProbeSummary {
            offset_mm: (1e3 * probe.offset).to_array(),
            sigma_mm: (1e3 * probe.sigmas).to_array(),
        });
        let turned = found.misassembled.turned.iter();
        Self {
            touches,
            contacts,
            rejected: found.rejected.len(),
            chi2: found.chi2,
            dof: found.degrees_of_freedom,
            noise_mm: 1e3 * found.noise,
            noise_over_stated: found.noise_over_stated,
            side: found.side,
            tolerances: found.tolerances.iter().map(ToleranceRow::new).collect(),
            faults: found.faults(),
            doubts: found.doubts(),
            probe,
            standoff_mm: found.standoff.map(|[standoff, _]| 1e3 * standoff),
            standoff_sigma_mm: found.standoff.map(|[_, sigma]| 1e3 * sigma),
            joints: found.joints.iter().map(JointRow::new).collect(),
            delay_ms: found.delay.map(|delay| 1e3 * delay.seconds),
            delay_sigma_ms: found.delay.map(|delay| 1e3 * delay.sigma),
            delay_removed_ms: found.delay.map_or(0.0, |delay| 1e3 * delay.removed),
            bodies: found.bodies.iter().map(BodyRow::new).collect(),
            exchanged: found.misassembled.exchanged.iter().map(|pair| pair.map(name)).collect(),
            turned: turned.map(|t| TurnedRow { module: name(t.module), degrees: t.degrees }).collect(),
            untouched: found.untouched.iter().map(|&module| name(module)).collect(),
            held_back: found.held_back.as_ref().map(HeldBackSummary::new),
            steps: found.steps,
            converged: found.converged,
            seconds,
            rmse_mm: truth.map(|truth| 1e3 * truth.absolute),
            rmse_aligned_mm: truth.map(|truth| 1e3 * truth.rigid),
        }
    }
}

impl BodyRow {
    fn new(body: &BodyFit) -> Self {
        Self {
            level: body.level.to_string(),
            name: body.name.clone(),
            contacts: body.contacts,
            moved_mm: 1e3 * body.translation.length(),
            turned_deg: body.rotation.length().to_degrees(),
            translation_mm: (1e3 * body.translation).to_array(),
            rotation_deg: body.rotation.to_array().map(f64::to_degrees),
            sigma_mm: body.sigmas.map(|[mm, _]| 1e3 * mm),
            sigma_deg: body.sigmas.map(|[_, turn]| turn.to_degrees()),
            chi2: body.test.map(|test| test.chi2),
            dof: body.test.map(|test| test.degrees_of_freedom),
            p: body.test.map(|test| test.p),
            believable: body.test.map(|test| test.is_believable()),
        }
    }
}

impl HeldBackSummary {
    fn new(held_back: &HeldBack) -> Self {
        let levels = held_back.scores.iter().map(|score| LevelRow {
            level: score.level.to_string(),
            median_mm: 1e3 * score.median,
            p90_mm: 1e3 * score.most,
            contact_median_mm: 1e3 * score.contact_median,
            contact_mean_mm: 1e3 * score.contact_mean,
        });
        Self {
            supported: held_back.supported.to_string(),
            explained: held_back.explained,
            gain: held_back.gain,
            drawing_median_mm: 1e3 * held_back.drawn_median,
            drawing_p90_mm: 1e3 * held_back.drawn_most,
            levels: levels.collect(),
        }
    }
}

pub(super) fn print_bodies(found: &BodyCalibration) -> anyhow::Result<()> {
    let number = |x: Option<f64>| x.map_or("-".into(), |x| format!("{x:.2}"));
    let row = |body: &BodyFit| {
        [
            ("body", format!("{} {}", body.level, plain(&body.name))),
            ("contacts", body.contacts.to_string()),
            ("moved [mm]", format!("{:.2}", 1e3 * body.translation.length())),
            ("sigma", number(body.sigmas.map(|[mm, _]| 1e3 * mm))),
            ("turned [deg]", format!("{:.2}", body.rotation.length().to_degrees())),
            ("sigma", number(body.sigmas.map(|[_, turn]| turn.to_degrees()))),
            ("p", body.test.map_or("-".into(), |test| format!("{:.4}", test.p))),
            (
                "drawing",
                match body.test.map(|test| test.is_believable()) {
                    None => "-".into(),
                    Some(true) => "believable".into(),
                    Some(false) => "doubtful".into(),
                },
            ),
        ]
    };
    print_table(1, &found.bodies.iter().map(row).collect::<Vec<_>>())?;
    let [touches, contacts] = found.counts;
    print(&format!(
        "{touches} touches, {contacts} contacts; chi2 {:.1} of {:.0} degrees of freedom\n",
        found.chi2, found.degrees_of_freedom
    ))?;
    if let Some(probe) = found.probe {
        let [o, s] = [probe.offset, probe.sigmas].map(|v| (1e3 * v).to_array());
        let axes: Vec<String> = o.iter().zip(s).map(|(o, s)| format!("{o:.1} +- {s:.1}")).collect();
        print(&format!("offset of the probe: {} mm\n", axes.join(", ")))?;
    }
    if let Some([standoff, sigma]) = found.standoff {
        print(&format!("standoff: {:.1} +- {:.1} mm\n", 1e3 * standoff, 1e3 * sigma))?;
    }
    for JointRow { name, unit, offset, sigma } in found.joints.iter().map(JointRow::new) {
        print(&format!("offset of the joint {}: {offset:.2} +- {sigma:.2} {unit}\n", plain(&name)))?;
    }
    if let Some(delay) = found.delay.filter(|delay| delay.removed != 0.0) {
        let [ms, sigma] = [delay.seconds, delay.sigma].map(|seconds| 1e3 * seconds);
        print(&format!("the readings are {ms:.0} +- {sigma:.0} ms late, or joints have play: taken off\n"))?;
    }
    let (noise, times) = (1e3 * found.noise, found.noise_over_stated);
    print(&format!("noise: {noise:.2} mm per axis, {times:.2} times the stated one\n"))?;
    let Some(held_back) = &found.held_back else {
        return print("too few contacts to hold some back: the fit is not judged\n");
    };
    let number = |metres: f64| format!("{:.2}", 1e3 * metres);
    let row = |what: String, numbers: [f64; 2], of_contacts: Option<[f64; 2]>| {
        let [median, mean] = of_contacts.map_or(["-".into(), "-".into()], |both| both.map(number));
        [
            ("held-back contacts, predicted by", what),
            ("median [mm]", number(numbers[0])),
            ("90 %", number(numbers[1])),
            ("median of contacts", median),
            ("mean of contacts", mean),
        ]
    };
    let drawn = row("the drawing".into(), [held_back.drawn_median, held_back.drawn_most], None);
    let fitted = held_back.scores.iter().map(|score| {
        let of_contacts = [score.contact_median, score.contact_mean];
        row(score.level.to_string(), [score.median, score.most], Some(of_contacts))
    });
    print_table(1, &std::iter::once(drawn).chain(fitted).collect::<Vec<_>>())?;
    print(&format!(
        "the touches support the level {}, which explains {:.3} of where they are\n",
        held_back.supported, held_back.explained
    ))
}
