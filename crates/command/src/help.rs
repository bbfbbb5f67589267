//! The help of each subcommand: `--help` has what most runs choose, `dermatome help NAME` all of it. What stands at its end: the words of tables and notes, of which `docs/terms.md` has
//! all, and commands that run in a checkout.

use clap::{Arg, ArgAction, Command};

/// Adds the end of its help to each subcommand.
pub(crate) fn with_ends(mut command: Command) -> Command {
    for (name, words, examples) in ENDS {
        command = command.mut_subcommand(name, |subcommand| {
            let examples = format!("Examples:\n  {}", examples.join("\n  "));
            let gap = if words.is_empty() { "" } else { "\n\n" };
            subcommand.after_long_help(format!("{words}{gap}{examples}")).after_help(examples)
        });
    }
    command
}

/// Makes `--help` of each subcommand the short one: two screens of what most runs choose.
pub(crate) fn with_short_help(command: Command) -> Command {
    command.mut_subcommands(|subcommand| {
        let all = format!("Print this; `dermatome help {}` has all options", subcommand.get_name());
        let help = Arg::new("help").short('h').long("help").action(ArgAction::HelpShort).help(all);
        subcommand.disable_help_flag(true).arg(help)
    })
}

/// The words and the examples of each subcommand.
const ENDS: [(&str, &str, &[&str]); 24] = [
    (
        "bench",
        OF_COSTS,
        &["dermatome build meshes/forearm.glb -o forearm", "dermatome bench forearm/map.glb"],
    ),
    (
        "build",
        OF_MAPS,
        &[
            "dermatome build meshes/forearm.glb",
            "dermatome build meshes/robot.glb -o robot --patch 'fore*' --pixel-mm 0.5",
            "dermatome build meshes/arm.urdf -o arm --links '*arm' --outer --spacing 8mm",
        ],
    ),
    (
        "calibrate",
        "",
        &[
            "dermatome simulate -o seen.g2o --truth truth.csv --triangles triangles.csv",
            "dermatome calibrate seen.g2o -o skin.glb --triangles triangles.csv --truth truth.csv",
        ],
    ),
    (
        "carry",
        "",
        &[
            "dermatome build meshes/hand.glb -o hand",
            "dermatome build meshes/robot_hand.glb -o robot --atlas hand/map.glb --landmarks meshes/hands.csv",
            "dermatome touch meshes/robot_hand.glb -o touch.csv --presses 1 --rate-hz 20",
            "dermatome carry robot/map.glb touch.csv --to hand/map.glb -o carried.csv",
        ],
    ),
    ("check", "", &["dermatome check meshes/robot.glb"]),
    ("coarsen", OF_LEVELS, &["dermatome coarsen meshes/forearm.glb -o levels.glb"]),
    ("completions", "", &["dermatome completions bash"]),
    ("convert", "", &["dermatome convert meshes/forearm.glb forearm.csv"]),
    (
        "design",
        "",
        &["dermatome design meshes/arm.urdf -o d --links forearm --module triangle:32mm --bend-radius 20mm"],
    ),
    (
        "diff",
        "",
        &[
            "dermatome convert meshes/forearm.glb before.csv",
            "dermatome diff before.csv meshes/forearm.glb -o changes.csv",
        ],
    ),
    (
        "export",
        OF_LEVELS,
        &[
            "dermatome build meshes/arm.urdf -o arm --links '*arm' --outer --spacing 8mm",
            "dermatome export arm/map.glb -o arm/skin.xml --level 1 --patch forearm",
            "dermatome export arm/map.glb -o arm/skin.csv",
            "dermatome export arm/map.glb -o arm/arm_with_skin.urdf --robot meshes/arm.urdf",
        ],
    ),
    (
        "flatten",
        OF_MAPS,
        &[
            "dermatome flatten meshes/saddle.glb -o saddle.obj -o saddle.npz",
            "dermatome flatten meshes/forearm.glb -o pattern.dxf -o pattern.svg --sheet A4",
        ],
    ),
    ("info", OF_PATCHES, &["dermatome info meshes/robot.glb", "dermatome info meshes/arm.urdf"]),
    (
        "layout",
        "",
        &[
            "dermatome touch meshes/forearm.glb -o touch.npz --presses 1 --rate-hz 20",
            "dermatome layout touch.npz --stream values -o layout.json",
        ],
    ),
    (
        "lookup",
        OF_ANSWERS,
        &[
            "dermatome build meshes/forearm.glb -o forearm",
            "dermatome convert meshes/forearm.glb contacts.csv",
            "dermatome lookup forearm/map.glb contacts.csv --max-distance 5mm -o answers.csv",
            "dermatome build meshes/arm.urdf -o arm",
            "dermatome lookup arm/map.glb contacts.csv --pose meshes/arm.urdf --joints elbow=1 -o moved.csv",
        ],
    ),
    ("man", "", &["dermatome man build"]),
    (
        "plot",
        OF_MAPS,
        &[
            "dermatome build meshes/forearm.glb -o forearm",
            "dermatome plot forearm/map.glb --space -o forearm.svg",
        ],
    ),
    (
        "render",
        OF_LEVELS,
        &[
            "dermatome build meshes/forearm.glb -o forearm",
            "dermatome touch forearm/map.glb -o touch.csv --presses 1 --rate-hz 20",
            "dermatome render forearm/map.glb touch.csv -o touch.npz --contacts regions.csv",
            "dermatome render forearm/map.glb touch.csv -o touch.npz --values-only --events words.jsonl",
        ],
    ),
    (
        "report",
        OF_MAPS,
        &[
            "dermatome touch meshes/forearm.glb -o touch.csv --presses 1 --rate-hz 20",
            "dermatome build meshes/forearm.glb -o forearm",
            "dermatome report forearm/map.glb touch.csv -o touch.html",
            "dermatome build meshes/robot.glb -o robot",
            "dermatome report robot/map.glb --atlas forearm/map.glb -o landmarks.html",
        ],
    ),
    (
        "response",
        "",
        &[
            "dermatome touch meshes/sphere_cap.glb -o touches.csv --presses 60 --sphere-mm 15 --rate-hz 20",
            "dermatome response meshes/sphere_cap.glb touches.csv -o response.csv",
        ],
    ),
    ("simulate", "", &["dermatome simulate -o seen.g2o --truth truth.csv --spacing-mm 4mm --outliers 0.1"]),
    (
        "summary",
        "",
        &[
            "dermatome build meshes/forearm.glb -o forearm --regions link",
            "dermatome touch forearm/map.glb -o touch.csv --presses 1 --rate-hz 20",
            "dermatome summary forearm/map.glb touch.csv -o sums.csv --over-time loads.csv",
        ],
    ),
    ("touch", "", &["dermatome touch meshes/forearm.glb -o touch.csv --truth touches.csv --sphere-mm 1cm"]),
    (
        "touches",
        "",
        &[
            "dermatome simulate --arm --taxels 100 -o log.csv --truth truth.csv --triangles triangles.csv",
            "dermatome touches log.csv -o contacts.csv",
            "dermatome calibrate contacts.csv -o skin.glb --truth truth.csv --triangles triangles.csv",
        ],
    ),
];

const OF_MAPS: &str = "\
Words:
  level            a mesh: level 0 is the skin, every further one is coarser
  field            a vertex above level 0 with the taxels that it stands for, each with a weight
  loop             a closed chain of edges with one face each: the rim of a patch or of a hole
  seam             the edges along which a surface is cut open to be mapped
  s1/s2            angle distortion of a face, the ratio of its stretches: mean and max; 1 is best
  area             area ratio, map over skin, as max(r, 1/r) at equal total areas: mean and max;
                   1 is best
  symm. Dirichlet  mean of s1^2 + s2^2 + 1/s1^2 + 1/s2^2 at the best scale; 4 is best
  flips            faces that the map mirrors or squeezes to nothing
  crossings        places where the map overlaps itself";

const OF_COSTS: &str = "\
Words:
  level    a mesh: level 0 is the skin, every further one is coarser
  interval between which distances the skin is, as a reactive answer says
  error    how far the middle of the interval is from the distance of the skin
  decides  share of the contacts for which the answer decides whether they are within 1, 2, 5,
           10 or 20 mm of the skin";

const OF_LEVELS: &str = "\
Words:
  level   a mesh: level 0 is the skin, every further one is coarser
  field   a vertex above level 0 with the taxels that it stands for, each with a weight
  loop    a closed chain of edges with one face each: the rim of a patch or of a hole";

const OF_PATCHES: &str = "\
Words:
  patch    one connected sheet of taxels on one link
  loop     a closed chain of edges with one face each: the rim of a patch or of a hole
  euler    vertices - edges + faces: 1 for a disk, 2 for a closed surface, 0 for a sleeve or torus
  spacing  the mean length of the edges
  present, absent, thermal   the content of a slot of the skin: a working taxel, none, a thermal pad
  modality                   what taxels sense: touch (force, pressure), thermal or another name";

const OF_ANSWERS: &str = "\
Words:
  level   a mesh: level 0 is the skin, every further one is coarser
  field   a vertex above level 0 with the taxels that it stands for, each with a weight
  b0..b2  weights of the three corners of the face, which give a point in it
  u, v    position on the map in m, v upwards; px, py its pixel, from the upper left corner";
