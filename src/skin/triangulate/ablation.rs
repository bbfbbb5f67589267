//! What each heuristic contributes: a switch for each, and the table for the documentation of this module.

/// A heuristic that can be switched off, in tests alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Heuristic {
    MergeClose,
    SmoothSpacing,
    TwoSides,
    BentNormals,
    ModulePlanes,
    SteepLast,
    DeniedLast,
    SameSide,
    WideCircles,
    OneVote,
    SmallHoles,
    AttachIsolated,
    SplitFace,
}

#[cfg(not(test))]
pub(super) const fn is_on(_: Heuristic) -> bool {
    true
}

#[cfg(test)]
pub(super) use table::is_on;

#[cfg(test)]
mod table {
    #![allow(clippy::print_stdout, clippy::unwrap_used, reason = "it prints a table")]

    use std::{
        collections::BTreeSet,
        f64::consts::{PI, TAU},
        sync::atomic::{AtomicU8, Ordering},
    };

    use glam::{DAffine3, DQuat, DVec3};

    use super::Heuristic;
    use crate::{
        mesh::{Adjacency, TriMesh, shapes},
        numeric::Random,
        skin::{Draft, Presence, Sheet, Taxels, triangulate::triangulate_taxels},
    };

    const ALL: [Heuristic; 13] = [
        Heuristic::MergeClose,
        Heuristic::SmoothSpacing,
        Heuristic::TwoSides,
        Heuristic::BentNormals,
        Heuristic::ModulePlanes,
        Heuristic::SteepLast,
        Heuristic::DeniedLast,
        Heuristic::SameSide,
        Heuristic::WideCircles,
        Heuristic::OneVote,
        Heuristic::SmallHoles,
        Heuristic::AttachIsolated,
        Heuristic::SplitFace,
    ];

    /// One more than the number of the heuristic that is off; 0 if all are on.
    static OFF: AtomicU8 = AtomicU8::new(0);

    pub(in crate::skin::triangulate) fn is_on(heuristic: Heuristic) -> bool {
        OFF.load(Ordering::Relaxed) != heuristic as u8 + 1
    }

    fn taxels(mesh: &TriMesh) -> Sheet {
        Sheet { positions: mesh.positions.to_vec(), ..Sheet::default() }
    }

    fn with_normals(mesh: &TriMesh) -> Sheet {
        Sheet { normals: Some(Vec::from(Taxels::from(mesh).normals)), ..taxels(mesh) }
    }

    /// Every taxel moved by a normal deviation of `sigma` along each axis.
    fn shaken(mut sheet: Sheet, sigma: f64, seed: u64) -> Sheet {
        let mut random = Random::new(seed, 0);
        for p in &mut sheet.positions {
            *p += random.vector(sigma);
        }
        sheet
    }

    /// Two square lattices that meet in an edge, with the normals of their sides.
    fn fold(degrees: f64) -> Sheet {
        let (sin, cos) = f64::to_radians(degrees).sin_cos();
        let places = |from: u32| {
            (from..12).flat_map(|i| (0..12).map(move |j| (0.005 * f64::from(i), 0.005 * f64::from(j))))
        };
        let first = places(0).map(|(x, y)| (DVec3::new(x, y, 0.0), DVec3::Z));
        let second = places(1).map(|(x, y)| (DVec3::new(-x * cos, y, -x * sin), DVec3::new(-sin, 0.0, cos)));
        let (positions, normals) = first.chain(second).unzip();
        Sheet { positions, normals: Some(normals), ..Sheet::default() }
    }

    /// Two lattices of 5 mm, `thickness` apart, that face away from each other.
    fn plate(thickness: f64) -> Sheet {
        let side = shapes::lattice(12, 12, 0.005).positions;
        let below = side.iter().map(|&p| p - thickness * DVec3::Z);
        let normals = (0..288).map(|k| if k < 144 { DVec3::Z } else { DVec3::NEG_Z }).collect();
        Sheet {
            positions: side.iter().copied().chain(below).collect(),
            normals: Some(normals),
            ..Sheet::default()
        }
    }

    /// Twelve taxels on half a ball of 6 mm.
    fn fingertip() -> Sheet {
        let on_ball = |k: usize| {
            let (z, turn) = (1.0 - (k as f64 + 0.5) / 12.0, k as f64 * PI * (3.0 - 5.0_f64.sqrt()));
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * turn.cos(), r * turn.sin(), z)
        };
        let normals: Vec<DVec3> = (0..12).map(on_ball).collect();
        Sheet {
            positions: normals.iter().map(|n| 0.006 * *n).collect(),
            normals: Some(normals),
            ..Sheet::default()
        }
    }

    /// Rigid triangles of ten taxels around a cylinder, as on an arm of the iCub.
    fn arm() -> Sheet {
        let (spacing, row) = (0.0065, 0.0065 * 0.75_f64.sqrt());
        let mut sheet = Sheet::default();
        let mut modules = Vec::new();
        for module in 0..32_u32 {
            let (i, j) = (module % 8, module / 8);
            let turn = 300_f64.to_radians() * f64::from(i) / 8.0;
            let at = DVec3::new(0.032 * turn.cos(), 0.032 * turn.sin(), 0.026 * f64::from(j));
            let frame = DAffine3::from_rotation_translation(DQuat::from_rotation_z(turn), at);
            let flip = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
            for (k, l) in (0..4).flat_map(|l| (0..4 - l).map(move |k| (f64::from(k), f64::from(l)))) {
                let (x, y) = (spacing * (k + 0.5 * l - 1.5), row * (l - 1.0));
                sheet.positions.push(frame.transform_point3(DVec3::new(0.0, flip * x, flip * y)));
                modules.push(module);
            }
        }
        sheet.modules = Some(modules);
        sheet
    }

    /// A part of the iCub, without the check of its file; `None` without the data outside the repository.
    fn icub(part: &str) -> Option<Sheet> {
        let folder = std::env::var_os("DERMATOME_DATA")?;
        let text =
            std::fs::read_to_string(std::path::Path::new(&folder).join(format!("icub/{part}.txt"))).ok()?;
        let rows = text
            .split("[calibration]")
            .nth(1)?
            .lines()
            .map(|line| line.split_whitespace().filter_map(|x| x.parse().ok()).collect::<Vec<f64>>());
        let rows: Vec<Vec<f64>> = rows.filter(|row| row.len() >= 6).collect();
        let is_empty = |row: &Vec<f64>| row[..6].iter().all(|x| *x == 0.0);
        Some(Sheet {
            positions: rows.iter().map(|row| DVec3::new(row[0], row[1], row[2])).collect(),
            normals: Some(rows.iter().map(|row| DVec3::new(row[3], row[4], row[5])).collect()),
            presence: Some(
                rows.iter()
                    .map(|row| if is_empty(row) { Presence::Absent } else { Presence::Present })
                    .collect(),
            ),
            modules: Some((0..).take(rows.len()).map(|slot: u32| slot / 12).collect()),
            ..Sheet::default()
        })
    }

    /// Random places on a ball of 5 cm, none closer to another than about half the mean spacing.
    fn scattered(count: usize, seed: u64) -> Sheet {
        let mut random = Random::new(seed, 1);
        let least = 0.05 * (2.0 * PI / count as f64).sqrt();
        let mut sheet = Sheet::default();
        for _ in 0..4 * count {
            let p = 0.05 * random.direction();
            if sheet.positions.iter().all(|q| p.distance(*q) > least) {
                sheet.positions.push(p);
            }
        }
        sheet
    }

    /// A cover of which a tenth of the normals point inward or are missing.
    fn wrong(mesh: &TriMesh) -> Sheet {
        let mut sheet = with_normals(mesh);
        for (k, n) in sheet.normals.iter_mut().flatten().enumerate().filter(|(k, _)| k % 10 == 0) {
            *n = if k % 20 == 0 { -*n } else { DVec3::ZERO };
        }
        sheet
    }

    fn covers() -> Vec<(&'static str, Vec<Sheet>)> {
        let lattice = || taxels(&shapes::lattice(20, 20, 0.005));
        let cap = shapes::cap(700, 0.05, 1.2);
        let tube = || taxels(&shapes::tube(24, 12, 0.005 * 24.0 / TAU, 0.055));
        let thin_tube = || with_normals(&shapes::tube(8, 12, 0.005 * 8.0 / TAU, 0.055));
        let mut dense = lattice();
        let fine = shapes::lattice(12, 12, 0.001).positions;
        dense.positions.extend(fine.iter().map(|&p| p + DVec3::new(0.0312, 0.031, 0.0)));
        let mut copies = lattice();
        copies.positions.extend(copies.positions.clone().iter().step_by(9).map(|&p| p + 2e-5 * DVec3::X));
        let mut above = shaken(taxels(&shapes::lattice(10, 10, 0.005)), 0.0003, 0);
        above.positions.extend([0, 5, 44].map(|k| above.positions[k] + DVec3::new(0.0011, 0.0004, 0.0024)));
        let many = |of: &dyn Fn(u64) -> Sheet| (0..10).map(of).collect::<Vec<_>>();
        let mut all = vec![
            ("flat", vec![lattice()]),
            ("noise", many(&|seed| shaken(lattice(), 0.001, seed))),
            ("rough", many(&|seed| shaken(lattice(), 0.0015, seed))),
            ("cap", many(&|seed| shaken(taxels(&cap), 0.0005, seed))),
            ("wrong", many(&|seed| shaken(wrong(&cap), 0.0005, seed))),
            ("ball", many(&|seed| scattered(600, seed))),
            ("dense", vec![dense]),
            ("copies", vec![copies]),
            ("above", vec![above]),
            ("sleeve", many(&|seed| shaken(tube(), 0.0007, seed))),
            ("tube", many(&|seed| shaken(thin_tube(), 0.0004, seed))),
            ("fold", (0..7).map(|k| fold(40.0 + 10.0 * f64::from(k))).collect()),
            ("noisy fold", many(&|seed| shaken(fold(100.0), 0.0005, seed))),
            ("plate", (1..9).map(|k| plate(0.001 * f64::from(k))).collect()),
            ("noisy plate", many(&|seed| shaken(plate(0.004), 0.0005, seed))),
            ("tip", many(&|seed| shaken(fingertip(), 0.0004, seed))),
            ("modules", many(&|seed| shaken(arm(), 0.0002, seed))),
        ];
        let parts = [
            ("arm", "left_arm"),
            ("forearm", "left_forearm_V2"),
            ("hand", "left_hand_V2_1"),
            ("torso", "torso"),
        ];
        all.extend(parts.into_iter().filter_map(|(name, part)| Some((name, vec![icub(part)?]))));
        all
    }

    /// Pieces, holes and taxels left out, and the edges.
    type Counts = ([usize; 3], BTreeSet<[u32; 2]>);

    /// What triangulating makes of a sheet; nothing if it refuses it.
    fn result(sheet: &Sheet) -> Option<Counts> {
        let draft = Draft { sheets: vec![sheet.clone()], ..Draft::default() };
        let ids: Vec<_> = (0..).take(sheet.positions.len()).map(crate::skin::TaxelId).collect();
        let draft = Draft { sheets: vec![Sheet { ids: Some(ids), ..draft.sheets[0].clone() }], ..draft };
        let made = triangulate_taxels(&draft, 2.5, None).ok()?;
        let made = &made.sheets[0];
        let mesh = TriMesh::from_arrays(made.positions.clone(), &made.triangles);
        let topology = Adjacency::new(&mesh).unwrap().topology();
        let name = |v: u32| made.ids.as_ref().unwrap()[v as usize].0;
        let sides = made.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let edges = sides.map(|ends| ends.map(name)).map(|[a, b]| [a.min(b), a.max(b)]).collect();
        let holes = topology.loops.saturating_sub(topology.components);
        Some(([topology.components, holes, sheet.positions.len() - made.positions.len()], edges))
    }

    #[test]
    #[ignore = "prints the ablation table; takes some ten seconds"]
    fn table() {
        let covers = covers();
        let results = |sheets: &[Sheet]| sheets.iter().map(result).collect::<Vec<_>>();
        let whole: Vec<_> = covers.iter().map(|(_, sheets)| results(sheets)).collect();
        // Sums over the sheets of a cover; a sheet that is refused counts as left out.
        let show = |found: &[Option<Counts>]| {
            let sum = |k: usize| found.iter().flatten().map(|f| f.0[k]).sum::<usize>();
            let refused = found.iter().filter(|f| f.is_none()).count();
            format!(
                "{}/{}/{}{}",
                sum(0),
                sum(1),
                sum(2),
                if refused > 0 { format!(" {refused} refused") } else { String::new() }
            )
        };
        for ((name, sheets), found) in covers.iter().zip(&whole) {
            println!("{name:12} {:2} {}", sheets.len(), show(found));
        }
        for off in ALL {
            OFF.store(off as u8 + 1, Ordering::Relaxed);
            print!("{:16}", format!("{off:?}"));
            for ((name, sheets), whole) in covers.iter().zip(&whole) {
                let found = results(sheets);
                let edges =
                    |found: &Option<(_, BTreeSet<[u32; 2]>)>| found.clone().map_or(BTreeSet::new(), |f| f.1);
                let other: usize = found
                    .iter()
                    .zip(whole)
                    .map(|(a, b)| edges(a).symmetric_difference(&edges(b)).count())
                    .sum();
                if other > 0 || show(&found) != show(whole) {
                    print!("  {name} {} ({other})", show(&found));
                }
            }
            println!();
        }
        OFF.store(0, Ordering::Relaxed);
    }
}
