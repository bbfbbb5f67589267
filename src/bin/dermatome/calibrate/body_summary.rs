//! What `calibrate --cad` prints.

use dermatome::calib::{BodyCalibration, BodyFit, CadSkin, HeldBack, ModuleId};
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
    /// Along the normal and in the tangent plane, of touches of one, two, three and more taxels.
    noise_mm: Option<Vec<[f64; 2]>>,
    probe: Option<ProbeSummary>,
    standoff_mm: Option<f64>,
    standoff_sigma_mm: Option<f64>,
    bodies: Vec<BodyRow>,
    exchanged: Vec<[String; 2]>,
    turned: Vec<TurnedRow>,
    untouched: Vec<String>,
    held_back: Option<HeldBackSummary>,
    steps: usize,
    converged: bool,
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct ProbeSummary {
    offset_mm: [f64; 3],
    sigma_mm: [f64; 3],
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

#[derive(Debug, Serialize)]
struct TurnedRow {
    module: String,
    degrees: f64,
}

#[derive(Debug, Serialize)]
struct HeldBackSummary {
    supported: String,
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
    pub(super) fn new(found: &BodyCalibration, cad: &CadSkin, seconds: f64) -> Self {
        let name = |module: ModuleId| cad.modules[module].name.clone();
        let [touches, contacts] = found.counts;
        let noise = found.noise.map(|classes| classes.map(|pair| pair.map(|sigma| 1e3 * sigma)).to_vec());
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
            noise_mm: noise,
            probe,
            standoff_mm: found.standoff.map(|[standoff, _]| 1e3 * standoff),
            standoff_sigma_mm: found.standoff.map(|[_, sigma]| 1e3 * sigma),
            bodies: found.bodies.iter().map(BodyRow::new).collect(),
            exchanged: found.misassembled.exchanged.iter().map(|pair| pair.map(name)).collect(),
            turned: turned.map(|t| TurnedRow { module: name(t.module), degrees: t.degrees }).collect(),
            untouched: found.untouched.iter().map(|&module| name(module)).collect(),
            held_back: found.held_back.as_ref().map(HeldBackSummary::new),
            steps: found.steps,
            converged: found.converged,
            seconds,
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
        Self { supported: held_back.supported.to_string(), levels: levels.collect() }
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
    let Some(held_back) = &found.held_back else { return Ok(()) };
    let rows = held_back.scores.iter().map(|score| {
        [
            ("held-back contacts, fitted down to", score.level.to_string()),
            ("median [mm]", format!("{:.2}", 1e3 * score.median)),
            ("90 %", format!("{:.2}", 1e3 * score.most)),
            ("median of contacts", format!("{:.2}", 1e3 * score.contact_median)),
            ("mean of contacts", format!("{:.2}", 1e3 * score.contact_mean)),
        ]
    });
    print_table(1, &rows.collect::<Vec<_>>())?;
    print(&format!("the touches support the level {}\n", held_back.supported))
}
