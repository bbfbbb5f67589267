//! `design`: modules on a surface, their wiring and their pattern.

use std::path::PathBuf;
use std::process::ExitCode;

use dermatome::Error;
use dermatome::design::{
    Design, DesignOptions, Module, PlacedModule, Plate, Strip, Wiring, skin_draft, strips,
};
use dermatome::id::IdVec;
use dermatome::io::{ModuleRow, write_chains, write_placed_modules, write_skin};
use dermatome::mesh::FillHoles;
use dermatome::pattern::{strip_drawing, write_dxf, write_svg};
use dermatome::plot::{DesignedPatch, plot_design};
use dermatome::remesh::keep_outer;
use dermatome::run::Run;
use dermatome::skin::{AssembleOptions, Draft, Patch, Sheet, Skin, assemble, link_names, world_pose};
use glam::DAffine3;
use serde::Serialize;

use crate::console::errors::advise;
use crate::console::notes::note;
use crate::console::print::{json, plain, print, print_json};
use crate::console::progress;
use crate::files::input::read_skin;
use crate::files::outputs::{self, write_bytes};
use crate::options::{Common, InPath, ModuleArg, OutFolder, PatchArgs, ReadArgs, module_arg, side_mm};

/// Design a skin: modules on a surface, their wiring, and their pattern at 1:1.
///
/// Modules do not stretch, bend as cylinders and lie within a tolerance of the surface. They grow across free edges from
/// the best of several first modules; chains go from edge to edge. A line a link says how many fit, and the side of a
/// triangle that would fit on 90 % and on half of its area.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The surface: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .urdf, .xml or .npz
    mesh: InPath,
    /// Folder for skin.csv, skin.triangles.csv, skin.glb, modules.csv, chains.csv, pattern.svg, pattern.dxf,
    /// design.png and design.json; created if it does not exist
    #[arg(short, long, value_name = "DIR")]
    output: OutFolder,
    /// What a module is: triangle:L, hexagon:L or rectangle:W:H, lengths of sides as in 32.2mm, or a table kind,x,y in m of
    /// its outline, taxels and ports
    #[arg(long, value_name = "MODULE", value_parser = module_arg)]
    module: ModuleArg,
    /// Largest distance of a module from the surface: what foam or glue takes up
    #[arg(long, value_name = "MM", value_parser = side_mm, default_value = "1mm")]
    tolerance: f64,
    /// Least radius to which a module bends [default: modules are rigid]
    #[arg(long, value_name = "MM", value_parser = side_mm)]
    bend_radius: Option<f64>,
    /// Most modules of a chain
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = chain)]
    chain: usize,
    /// Chains may branch: as few connected parts as are found
    #[arg(long)]
    branch: bool,
    /// Print design.json on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    chosen: PatchArgs,
}

/// Chains have at least one module.
fn chain(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|n| (1..=100_000).contains(n))
        .ok_or_else(|| "needed: a number from 1 to 100000".into())
}

/// A patch, and the modules on it.
struct Designed<'a> {
    patch: &'a Patch,
    link: String,
    pose: DAffine3,
    design: Design,
    /// The numbers of its first module and its first chain, from 1.
    first: [usize; 2],
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let folder: PathBuf = (&args.output).into();
    let files: Vec<PathBuf> = FILES.into_iter().map(|name| folder.join(name)).collect();
    outputs::guard(&files, &common.outputs)?;
    let module = args.module.read()?;
    let options = DesignOptions {
        tolerance: args.tolerance,
        bend_radius: args.bend_radius,
        wiring: Wiring { most: args.chain, has_branches: args.branch },
    };
    let assemble_options =
        AssembleOptions { fill_holes: FillHoles::PinHoles, ..args.read.options(&[&args.mesh]) };
    let skin = read_skin(&args.mesh, &args.read, &args.chosen, &assemble_options, common)?;
    if !args.read.outer {
        note_inner_sides(&skin, common);
    }
    let bar = progress::bar(common);
    bar.set_message("designing");
    let designed = design_all(&skin, &module, &options, common)?;
    bar.finish_and_clear();

    let made = skin_of(&skin, &designed, &module)?;
    outputs::make_folder(&folder)?;
    files.iter().try_for_each(|path| outputs::check_file(path))?;
    let out = |name: &str| common.outputs.file(folder.join(name));
    let rows = rows(&designed, &module);
    write_placed_modules(out(MODULES), &rows).map_err(Error::from)?;
    write_chains(out(CHAINS), &rows).map_err(Error::from)?;
    for name in SKINS {
        write_skin(out(name), &made).map_err(Error::from)?;
    }
    let drawn = designed.iter().map(|d| DesignedPatch {
        name: &d.patch.name,
        mesh: &d.patch.mesh,
        pose: d.pose,
        design: &d.design,
    });
    let patches: Vec<DesignedPatch<'_>> = drawn.collect();
    let picture = plot_design(&patches, &module).map_err(Error::from)?;
    write_bytes(&out(PICTURE), &picture.to_png().map_err(Error::from)?).map_err(Error::from)?;
    let drawing = pattern(&designed, &module);
    let title = format!("chains of {} at 1:1", args.mesh.display());
    write_bytes(&out(PATTERNS[0]), write_svg(&drawing, &title).as_bytes()).map_err(Error::from)?;
    write_bytes(&out(PATTERNS[1]), write_dxf(&drawing).as_bytes()).map_err(Error::from)?;
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        input: args.mesh.display().to_string(),
        tolerance: args.tolerance,
        bend_radius: args.bend_radius,
        chain: args.chain,
        taxels_per_module: module.taxels.len(),
        block: module.block(),
        patches: designed.iter().map(|d| PatchDesign::new(d, module.taxels.len())).collect(),
    };
    write_bytes(&out(REPORT), json(SCHEMA, &report)?.as_bytes()).map_err(Error::from)?;
    outputs::publish(common)?;
    if args.json {
        print_json(SCHEMA, &report)?;
    } else if !common.quiet {
        let lines: Vec<String> = report.patches.iter().map(PatchDesign::sentence).collect();
        print(&(lines.join("\n") + "\n"))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Designs patch by patch. One on which nothing fits is left out if there are others.
fn design_all<'a>(
    skin: &'a Skin,
    module: &Module,
    options: &DesignOptions,
    common: &Common,
) -> anyhow::Result<Vec<Designed<'a>>> {
    let links = link_names(&skin.links);
    let (mut all, mut failed) = (Vec::new(), Vec::new());
    let mut first = [1, 1];
    for patch in &skin.patches {
        // What closes pin-holes is no skin, but modules may lie over it.
        match dermatome::design::design(&patch.mesh, module, options, Run::default().counting(&common.steps))
        {
            Ok(design) => {
                let next = [first[0] + design.modules.len(), first[1] + design.chains.len()];
                let (link, pose) = (links[patch.link].clone(), world_pose(&skin.links, patch.link));
                all.push(Designed { patch, link, pose, design, first });
                first = next;
            }
            Err(error) => failed.push((patch, error)),
        }
    }
    if all.is_empty() {
        let Some((patch, error)) = failed.into_iter().next() else {
            return Err(advise("the file has no surface", "give one with triangles"));
        };
        let source = Box::new(Error::from(error));
        return Err(Error::Patch { patch: patch.name.clone(), source }.into());
    }
    for (patch, error) in failed {
        note!(common, "{}: left out, {error}", plain(&patch.name));
    }
    Ok(all)
}

/// Hints at the inner sides of shells, which modules would cover, too.
fn note_inner_sides(skin: &Skin, common: &Common) {
    let sheet = |patch: &Patch| Sheet {
        name: patch.name.clone(),
        link: Some(patch.link),
        positions: patch.mesh.positions.iter().copied().collect(),
        triangles: patch.mesh.triangles.iter().map(|t| t.map(|v| v.raw())).collect(),
        ..Sheet::default()
    };
    let mut draft = Draft {
        links: skin.links.clone(),
        sheets: skin.patches.iter().map(sheet).collect(),
        ..Draft::default()
    };
    let left_out = keep_outer(&mut draft);
    let dropped = left_out.faces + left_out.parts;
    if dropped > 0 {
        note!(
            common,
            "{dropped} faces are inside the body, as the inner sides of shells, or partly; --outer leaves them out"
        );
    }
}

/// A row for each module, in the world.
fn rows(designed: &[Designed<'_>], module: &Module) -> Vec<ModuleRow> {
    let edges = module.outline.len();
    let mut rows = Vec::new();
    for Designed { patch, link, pose, design, first, .. } in designed {
        for (number, chain) in design.chains.iter().enumerate() {
            for (place, &own) in chain.modules.iter().enumerate() {
                let before = place.checked_sub(1).map(|k| chain.steps[k]);
                // The first of a chain is turned by the edge to the next.
                let entry =
                    before.map(|step| step.edges[1]).or_else(|| chain.steps.first().map(|s| s.edges[0]));
                let placed = design.modules[own];
                let plate = Plate { frame: *pose * placed.plate.frame, ..placed.plate };
                rows.push(ModuleRow {
                    placed: PlacedModule {
                        number: count(first[0] + own),
                        plate,
                        patch: patch.name.clone(),
                        link: None,
                    },
                    link: link.clone(),
                    chain: [count(first[1] + number), count(place + 1)],
                    gap: placed.gap,
                    first_corner: entry.map_or(1, |edge| count((edges - edge - 1) % edges + 1)),
                    before: before.map(|step| {
                        [
                            count(first[0] + step.modules[0]),
                            count(step.edges[0] + 1),
                            count(step.edges[1] + 1),
                        ]
                    }),
                });
            }
        }
    }
    rows
}

/// A number of modules, of which there are at most a million.
fn count(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// The skin of the taxels of all modules, on the links of the surface; each piece is a patch.
fn skin_of(skin: &Skin, designed: &[Designed<'_>], module: &Module) -> anyhow::Result<Skin> {
    let mut placed = Vec::new();
    for Designed { patch, design, first, .. } in designed {
        for (k, own) in design.modules.iter().enumerate() {
            let name = if design.pieces > 1 {
                format!("{}.{}", patch.name, own.piece + 1)
            } else {
                patch.name.clone()
            };
            let number = count(first[0] + k);
            placed.push(PlacedModule { number, plate: own.plate, patch: name, link: Some(patch.link) });
        }
    }
    let links = skin.links.iter().cloned().collect::<IdVec<_, _>>();
    let draft = skin_draft(module, &placed, links);
    let assembled = assemble(&draft, &AssembleOptions::default());
    let assembled = assembled.map_err(|error| {
        let why = format!("the taxels of these modules make no skin: {error}");
        advise(why, "give a --module whose taxels are not on one line, or a smaller one, of which more fit")
    });
    Ok(assembled?.skin)
}

/// The pattern of all chains.
fn pattern(designed: &[Designed<'_>], module: &Module) -> dermatome::pattern::Drawing {
    let mut all: Vec<(String, Strip)> = Vec::new();
    for Designed { patch, design, first, .. } in designed {
        for mut strip in strips(design, module) {
            let name = format!("chain {}, {}", first[1] + strip.chain, patch.name);
            strip.modules.iter_mut().for_each(|(m, _)| *m += first[0]);
            all.push((name, strip));
        }
    }
    strip_drawing(&all, module, |m| m.to_string())
}

/// What `design.json` holds; lengths in m.
#[derive(Debug, Serialize)]
struct Report {
    version: &'static str,
    input: String,
    tolerance: f64,
    bend_radius: Option<f64>,
    chain: usize,
    taxels_per_module: usize,
    /// Ids of module m are m * block + 1 and so on.
    block: u32,
    patches: Vec<PatchDesign>,
}

/// The modules of a patch.
#[derive(Debug, Serialize)]
struct PatchDesign {
    patch: String,
    link: String,
    area_m2: f64,
    modules: usize,
    taxels: usize,
    covered: f64,
    largest_gap: f64,
    least_radius: Option<f64>,
    pieces: usize,
    chains: usize,
    least_chains: usize,
    /// `None` where the surface can be unrolled.
    side_for_90_percent: Option<f64>,
    side_for_50_percent: Option<f64>,
}

impl PatchDesign {
    fn new(of: &Designed<'_>, taxels: usize) -> Self {
        let design = &of.design;
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        Self {
            patch: of.patch.name.clone(),
            link: of.link.clone(),
            area_m2: design.area,
            modules: design.modules.len(),
            taxels: design.modules.len() * taxels,
            covered: design.covered,
            largest_gap: design.gap(),
            least_radius: finite(design.radius()),
            pieces: design.pieces,
            chains: design.chains.len(),
            least_chains: design.bound,
            side_for_90_percent: finite(design.sides[0]),
            side_for_50_percent: finite(design.sides[1]),
        }
    }

    fn sentence(&self) -> String {
        let mm = |x: Option<f64>| x.map_or_else(|| "any".to_owned(), |x| format!("{:.1} mm", 1e3 * x));
        format!(
            "{}: {} modules on {:.0} % of {:.0} cm2, pieces {}, chains {} (at least {}), largest gap {:.2} mm, least radius {}; \
             a triangle that would fit: {} on 90 % of the area, {} on half",
            plain(&self.patch),
            self.modules,
            100.0 * self.covered,
            1e4 * self.area_m2,
            self.pieces,
            self.chains,
            self.least_chains,
            1e3 * self.largest_gap,
            self.least_radius.map_or_else(|| "none, flat".into(), |x| format!("{:.0} mm", 1e3 * x)),
            mm(self.side_for_90_percent),
            mm(self.side_for_50_percent),
        )
    }
}

const MODULES: &str = "modules.csv";
const CHAINS: &str = "chains.csv";
const SKINS: [&str; 2] = ["skin.csv", "skin.glb"];
const PICTURE: &str = "design.png";
const PATTERNS: [&str; 2] = ["pattern.svg", "pattern.dxf"];
const REPORT: &str = "design.json";

/// All of them.
const FILES: [&str; 9] =
    [MODULES, CHAINS, SKINS[0], "skin.triangles.csv", SKINS[1], PICTURE, PATTERNS[0], PATTERNS[1], REPORT];

/// What the keys of [`REPORT`] mean.
const SCHEMA: &str = "dermatome.design/1";
