//! `info`: the patches of a skin, their size and shape; of a robot also its links and joints.

use std::process::ExitCode;

use dermatome::Error;
use dermatome::body::{FieldLevel, Modality};
use dermatome::io::IoError;
use dermatome::map::{RegionId, SkinMap};
use dermatome::mesh::{Adjacency, mean_edge_length};
use dermatome::pyramid::LevelId;
use dermatome::report::atlas_sentences;
use dermatome::robot::{Joint, Robot, Role};
use dermatome::skin::{Link, LinkId, Motion, Patch, PatchId, Presence, Skin, link_names};
use glam::{DAffine3, DQuat};
use serde_json::{Value, json};

use crate::console::errors;
use crate::console::notes::note;
use crate::console::print::{plain, plain_sentence, print, print_gaps, print_json, print_table};
use crate::files::input::{gaps_as_json, gaps_of, read_map_if_any, read_skin};
use crate::options::{Common, InPath, JointsArg, PatchArgs, ReadArgs, RobotArgs, joints};

/// Arguments of `info`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Skin or mesh: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt
    file: InPath,
    /// Values of the joints of a robot, in rad and m [default: 0], for the poses of its links in --json:
    /// NAME=VALUE,..., or a table of one row with a column for each joint
    #[arg(long, value_name = "FILE|NAME=VALUE", value_parser = joints, requires = "json")]
    joints: Option<JointsArg>,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let robot = RobotArgs::describes(&args.file).then(|| args.read.robot.read(&args.file)).transpose()?;
    if let Some(robot) = robot.as_ref().filter(|_| !args.json) {
        // Before its meshes are read, which may not be there.
        print_table(
            4,
            &robot.links.enumerate().map(|(id, link)| link_row(robot, id, link)).collect::<Vec<_>>(),
        )?;
    }
    let is_bare = robot.as_ref().is_some_and(|robot| robot.shapes.is_empty() && robot.sensors.is_empty());
    let skin = if is_bare {
        note!(common, "no shapes and no tactile sensors on these links: nothing to make a skin of");
        Skin::default()
    } else {
        let options = args.read.options(&[&args.file]);
        match read_skin(&args.file, &args.read, &PatchArgs::default(), &options, common) {
            Err(error) if robot.is_some() && is_absent(&error) => {
                let help = errors::help(&error).map(|help| format!("; {help}")).unwrap_or_default();
                note!(common, "no skin is read: {error}{help}");
                Skin::default()
            }
            skin => skin?,
        }
    };
    let map = read_map_if_any(&args.file)?;
    let of_map = map.as_ref().map(SkinMap::skin);
    let gaps = gaps_of(map.as_ref(), of_map.as_ref().unwrap_or(&skin), args.read.unit);
    let links = link_names(&skin.links);
    let row = |patch: &Patch| row(&links[patch.link], patch);
    let rows = skin.patches.iter().map(row).collect::<Result<Vec<_>, Error>>()?;
    if args.json {
        let object = |row: PatchRow| row.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let animations: Vec<_> = skin.animations.iter().map(animation).collect();
        let patches: Vec<Value> = rows.into_iter().map(object).collect();
        let mut all = json!({ "patches": patches, "animations": animations });
        if !gaps.is_empty() {
            all["gaps"] = gaps_as_json(&gaps);
        }
        if let Some(map) = map.as_ref().filter(|map| map.atlas.is_some()) {
            all["atlas"] = json!(map.atlas);
            let patches = all["patches"].as_array_mut().into_iter().flatten();
            for (row, patch) in patches.zip(&map.patches) {
                row["atlas"] = json!(patch.atlas);
                row["atlas"]["symmetric_dirichlet"] =
                    json!(patch.levels[LevelId::new(0)].distortion.symmetric_dirichlet);
            }
        }
        if let Some(map) = map.as_ref().filter(|map| !map.body.levels.is_empty()) {
            let object = |(level, regions)| json!({ "level": level, "fields": Vec::len(&regions), "regions": regions });
            all["body_levels"] = body_levels(map).into_iter().map(object).collect();
        }
        let modalities = modalities(map.as_ref(), &skin);
        if !modalities.is_empty() {
            let object = |of: ModalityRow| json!({ "patch": of.patch, "name": of.name, "sensors": of.sensors, "fields": of.fields, "levels": of.levels });
            all["modalities"] = modalities.into_iter().map(object).collect();
        }
        if let Some(robot) = &robot {
            let values = args.joints.as_ref().map(|joints| joints.one_pose(robot, common)).transpose()?;
            let poses = robot.poses(&values.unwrap_or_else(|| robot.joint_values(&[])));
            all["links"] =
                robot.links.enumerate().map(|(id, link)| link_json(robot, id, link, &poses[id])).collect();
            all["joints"] = robot.joints.iter().map(|joint| joint_json(robot, joint)).collect();
        }
        print_json("dermatome.info/1", &all)?;
    } else {
        if robot.is_some() && !is_bare {
            print("\n")?;
        }
        let rows: Vec<_> = rows.iter().map(|row| row.each_ref().map(|(name, x)| (*name, cell(x)))).collect();
        print_table(2, &rows)?;
        print_gaps(&gaps)?;
        let sentences = map.iter().flat_map(atlas_sentences);
        sentences.into_iter().try_for_each(|sentence| print(&format!("{}\n", plain_sentence(&sentence))))?;
        map.iter().try_for_each(print_body_levels)?;
        for ModalityRow { patch, name, sensors, fields, levels } in modalities(map.as_ref(), &skin) {
            // As levels are called, without their numbers.
            let called = levels.first().and_then(|level| level.rsplit_once('.')).map(|(of, _)| of.to_owned());
            let own = || format!("{}.{name}", patch.as_deref().unwrap_or("body"));
            let called = plain(&called.unwrap_or_else(own));
            let counts: Vec<String> = fields.iter().map(ToString::to_string).collect();
            let counts =
                if fields.is_empty() { String::new() } else { format!(", fields {}", counts.join(", ")) };
            print(&format!("{called}: sensors {sensors}{counts}\n"))?;
        }
        for (name, [from, to]) in skin.animations.iter().filter_map(times) {
            print(&format!("animation {}: {from} to {to} s\n", plain(name)))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The names of the levels of the whole body, and the region of each field.
fn body_levels(map: &SkinMap) -> Vec<(String, Vec<Option<String>>)> {
    let regions = map.regions();
    let name = |region: &Option<RegionId>| region.map(|region| regions.names[region].to_string());
    let of_level = |(at, level): (FieldLevel, String)| {
        (level, regions.of_fields(&map.field_rows(at)).iter().map(name).collect())
    };
    map.field_levels().filter(|(at, _)| at.modality.is_none()).map(of_level).collect()
}

/// A line for each level of the whole body: the number of fields, and their regions if few have one.
fn print_body_levels(map: &SkinMap) -> anyhow::Result<()> {
    /// Names that fit into a line.
    const MOST: usize = 12;
    for (level, regions) in body_levels(map) {
        let fields = if regions.len() == 1 { "field" } else { "fields" };
        let names: Vec<String> =
            regions.iter().map(|name| name.as_deref().map_or_else(|| "-".into(), plain)).collect();
        let are_named = regions.len() <= MOST && regions.iter().any(Option::is_some);
        let names = if are_named { format!(": {}", names.join(", ")) } else { String::new() };
        print(&format!("{level}: {} {fields}{names}\n", regions.len()))?;
    }
    Ok(())
}

/// A modality besides touch of a patch, or of the whole body, which has no patch.
struct ModalityRow {
    patch: Option<String>,
    name: String,
    sensors: usize,
    /// Of a map, how many fields each level has.
    fields: Vec<usize>,
    /// Of a map, the names of the levels.
    levels: Vec<String>,
}

/// The modalities of each patch, and of a map those of the whole body.
fn modalities(map: Option<&SkinMap>, skin: &Skin) -> Vec<ModalityRow> {
    let all = || map.iter().flat_map(|map| map.body.modalities.iter().enumerate());
    let sizes = |of: &Modality| of.levels.iter().map(|level| level.origins.len()).collect();
    let names = |number: usize| -> Vec<String> {
        let levels = map.into_iter().flat_map(SkinMap::field_levels);
        levels.filter(|(at, _)| at.modality == Some(number)).map(|(_, name)| name).collect()
    };
    let of_patch = |(id, patch): (PatchId, &Patch)| {
        let row = |name: &str| {
            let found = all().find(|(_, modality)| modality.patch == Some(id) && modality.name == name);
            ModalityRow {
                patch: Some(patch.name.clone()),
                name: name.to_owned(),
                sensors: patch.taxels.sensors(name).len(),
                fields: found.map_or_else(Vec::new, |(_, of)| sizes(of)),
                levels: found.map_or_else(Vec::new, |(number, _)| names(number)),
            }
        };
        patch.taxels.other_modalities().into_iter().map(row).collect::<Vec<_>>()
    };
    let of_body = |(number, of): (usize, &Modality)| ModalityRow {
        patch: None,
        name: of.name.clone(),
        sensors: skin.patches.iter().map(|patch| patch.taxels.sensors(&of.name).len()).sum(),
        fields: sizes(of),
        levels: names(number),
    };
    let whole = all().filter(|(_, modality)| modality.patch.is_none()).map(of_body);
    skin.patches.enumerate().flat_map(of_patch).chain(whole).collect()
}

/// Whether the mesh files of a robot are absent.
fn is_absent(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref::<Error>(), Some(Error::Io(IoError::MeshFile { .. })))
}

/// The name of an animation, and its first and last time.
fn times(animation: &Motion) -> Option<(&str, [f64; 2])> {
    Some((&animation.name, animation.times()?))
}

fn animation(animation: &Motion) -> Value {
    json!({ "name": animation.name, "seconds": animation.times() })
}

/// How many shapes to see, shapes to collide with and taxels a link of a robot has.
fn counts(robot: &Robot, id: LinkId) -> [usize; 3] {
    let shapes = |role| robot.shapes.iter().filter(|shape| shape.link == id && shape.role == role).count();
    let sensors = robot.sensors.iter().filter(|sheet| sheet.link == Some(id));
    [shapes(Role::Visual), shapes(Role::Collision), sensors.map(|sheet| sheet.positions.len()).sum()]
}

fn link_row(robot: &Robot, id: LinkId, link: &Link) -> [(&'static str, String); 8] {
    let [visual, collision, taxels] = counts(robot, id).map(|count| count.to_string());
    // Every link but the first hangs by a joint, in the same order.
    let joint = id.index().checked_sub(1).map(|k| &robot.joints[k]);
    let or_none = |text: Option<String>| text.unwrap_or_else(|| "-".into());
    let range = |joint: &Joint| Some(joint.limits?.map(|x| format!("{x:.4}")).join(".."));
    [
        ("link", plain(&link.name)),
        ("parent", or_none(link.parent.map(|parent| plain(&robot.links[parent].name)))),
        ("joint", or_none(joint.map(|joint| plain(&joint.name)))),
        ("moves", or_none(joint.map(|joint| joint.kind.name().into()))),
        ("range", or_none(joint.and_then(range))),
        ("visual", visual),
        ("collision", collision),
        ("taxels", taxels),
    ]
}

fn link_json(robot: &Robot, id: LinkId, link: &Link, pose: &DAffine3) -> Value {
    let [visual, collision, taxels] = counts(robot, id);
    let parent = link.parent.map(|parent| &robot.links[parent].name);
    json!({
        "name": link.name, "parent": parent, "visual": visual, "collision": collision, "taxels": taxels,
        "position": pose.translation.to_array(), "rotation": DQuat::from_mat3(&pose.matrix3).to_array(),
    })
}

fn joint_json(robot: &Robot, joint: &Joint) -> Value {
    let mimic = joint.mimic.as_ref().map(|mimic| {
        let leader = &robot.joints[mimic.joint].name;
        json!({ "joint": leader, "multiplier": mimic.multiplier, "offset": mimic.offset })
    });
    json!({
        "name": joint.name, "type": joint.kind.name(), "link": robot.links[joint.link].name,
        "axis": joint.axis.to_array(), "anchor": joint.anchor.to_array(), "limits": joint.limits, "mimic": mimic,
    })
}

type PatchRow = [(&'static str, Value); 12];

fn row(link: &str, patch: &Patch) -> Result<PatchRow, Error> {
    let adjacency = Adjacency::new(&patch.mesh)?;
    let count = |what| patch.taxels.presence.iter().filter(|p| **p == what).count();
    let range = |[low, high]: [f64; 2], &x: &f64| [low.min(x), high.max(x)];
    let densities = patch.taxels.densities.as_ref();
    let densities = densities.map(|all| all.iter().fold([f64::INFINITY, f64::NEG_INFINITY], range));
    Ok([
        ("name", json!(patch.name)),
        ("link", json!(link)),
        ("vertices", json!(patch.mesh.positions.len())),
        ("faces", json!(patch.mesh.triangles.len())),
        ("boundary_loops", json!(adjacency.boundary_loops().len())),
        ("euler", json!(adjacency.euler_characteristic())),
        ("area_m2", json!(patch.mesh.area())),
        ("spacing_mm", json!(1e3 * mean_edge_length(&patch.mesh, &adjacency))),
        ("present", json!(count(Presence::Present))),
        ("absent", json!(count(Presence::Absent))),
        ("thermal", json!(count(Presence::ThermalPad))),
        ("density_per_m2", json!(densities)),
    ])
}

/// Larger measures are printed with an exponent.
const HUGE: f64 = 1e9;

/// A value as text: words bare, measures with four decimals, ranges from lowest to highest.
fn cell(value: &Value) -> String {
    match value {
        Value::String(text) => plain(text),
        Value::Null => "-".into(),
        Value::Array(range) => range.iter().map(cell).collect::<Vec<_>>().join(".."),
        Value::Number(n) if n.is_f64() => match n.as_f64().unwrap_or(f64::NAN) {
            huge if huge.abs() >= HUGE => format!("{huge:.4e}"),
            x => format!("{x:.4}"),
        },
        other => other.to_string(),
    }
}
