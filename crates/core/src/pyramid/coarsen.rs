//! Makes the pyramid of one patch, level by level; see the [module](crate::pyramid) for the steps.

use std::iter;

use glam::DVec3;

use crate::cut::{CutMesh, PlaceId};
use crate::id::{IdVec, VertexId};
use crate::mesh::{Adjacency, AlongCurve, HalfedgeMesh, Rings, TriMesh};
use crate::pyramid::centres::{
    ALPHA, Candidates, measured_spacing, priorities, scaled_spacing, wanted_spacing,
};
use crate::pyramid::removal::{Remover, SeamRole, SeamedLevel, TaxelLocations};
use crate::pyramid::{Level, LevelId, Prolongation, Pyramid, PyramidError, RemovalLog};
use crate::run::{Cancelled, Run};
use crate::skin::Taxels;

/// A level must have this many times fewer vertices than the next finer one, or the pyramid ends.
const LEAST_RATIO: f64 = 1.5;

/// Ratio of a level to the next with [`ALPHA`], to predict whether a further level would be too coarse.
const USUAL_RATIO: f64 = 4.0;

/// How to coarsen.
#[derive(Debug, Clone, PartialEq)]
pub struct CoarsenOptions {
    /// Vertices of a level over those of the next coarser one, at least 1.5. `None`: a separation
    /// `alpha` of 1.35, which gives about 4; a number is met by bisecting `alpha`.
    pub ratio: Option<f64>,
    /// At most this many levels above level 0; `None`: as many as `coarsest` allows.
    pub levels: Option<usize>,
    /// Stop at about this many vertices: if a further level would be farther from this number.
    pub coarsest: usize,
}

impl Default for CoarsenOptions {
    fn default() -> Self {
        Self { ratio: None, levels: None, coarsest: 32 }
    }
}

/// The pyramid of one patch, from its mesh and taxels.
///
/// ```
/// use dermatome::{id::VertexId, mesh::shapes, pyramid::{LevelId, CoarsenOptions, coarsen}, run::Run, skin::Taxels};
///
/// let mesh = shapes::cap(2000, 0.1, 1.9);
/// let pyramid = coarsen(&mesh, &Taxels::from(&mesh), &CoarsenOptions::default(), Run::default())?;
///
/// // Push on one taxel: the force arrives whole at the receptive fields of level 1.
/// let skin = &pyramid.levels[LevelId::new(0)];
/// let mut force = skin.areas.map(|_| 0.0);
/// force[VertexId::new(7)] = 1.0;
/// let felt = skin.from_coarser.as_ref().map(|p| p.restrict(&force));
/// assert!(felt.is_some_and(|f| (f.iter().sum::<f64>() - 1.0).abs() < 1e-12));
/// # Ok::<(), dermatome::pyramid::PyramidError>(())
/// ```
///
/// # Errors
/// If the patch is not an oriented manifold or an array has another length than its mesh, an area
/// is negative, a density not positive, the ratio below 1.5, or the run is cancelled.
pub fn coarsen(
    mesh: &TriMesh,
    taxels: &Taxels,
    options: &CoarsenOptions,
    run: Run<'_>,
) -> Result<Pyramid, PyramidError> {
    check(mesh, taxels, options)?;
    let curve = AlongCurve::new(mesh);
    let (mut coarsener, rings) = Coarsener::new(mesh, taxels, options, &curve, None)?;
    let (mut levels, mut removals) = (IdVec::default(), IdVec::default());
    coarsener.run(rings, run, |level, log, _| {
        levels.push(level);
        removals.push(log);
    })?;
    levels.push(coarsener.level);
    Ok(Pyramid { levels, removals })
}

/// The pyramid of a patch that is mapped cut open, and the same levels cut open.
#[derive(Debug, Clone, PartialEq)]
#[doc(hidden)]
pub struct CutPyramid {
    /// The pyramid of the uncut patch, with a centre at every end and branching of the seam.
    #[doc(hidden)]
    pub pyramid: Pyramid,
    /// The levels cut open, to be mapped: level 0 is the patch after its cut, and vertices and
    /// origins count those of cut levels. Each place has the area of its whole taxel.
    #[doc(hidden)]
    pub opened: Pyramid,
    /// How each level of the pyramid is cut into the one to be mapped.
    #[doc(hidden)]
    pub cuts: IdVec<LevelId, CutMesh>,
}

/// The pyramid of a patch that is mapped after the cut `cut`. Every level has the same seam: it is coarsened
/// like a boundary, both sides together.
///
/// # Errors
/// As [`coarsen`].
#[doc(hidden)]
pub fn coarsen_cut(
    mesh: &TriMesh,
    taxels: &Taxels,
    cut: &CutMesh,
    options: &CoarsenOptions,
    run: Run<'_>,
) -> Result<CutPyramid, PyramidError> {
    check(mesh, taxels, options)?;
    let curve = AlongCurve::new(mesh);
    let seam = SeamedLevel::new(&curve.mesh, cut.along(&curve))?;
    let (mut coarsener, rings) = Coarsener::new(mesh, taxels, options, &curve, Some(seam))?;
    let (mut levels, mut cuts) = (IdVec::<LevelId, Level>::default(), IdVec::default());
    let mut removals = [IdVec::default(), IdVec::default()];
    // For each place of the next level its place of level 0.
    let mut origins: IdVec<PlaceId, PlaceId> =
        cut.unsplit.ids().map(|place| cut.moved(place, |v| curve.given(v))).collect();
    let mut all_origins = vec![cut.unsplit.ids().collect()];
    cuts.push(cut.clone());
    coarsener.run(rings, run, |level, log, seam| {
        levels.push(level);
        removals[0].push(log);
        if let Some((opened, places, cut)) = seam {
            removals[1].push(opened);
            origins = places.map(|&place| origins[place]);
            all_origins.push(origins.clone());
            cuts.push(cut);
        }
    })?;
    levels.push(coarsener.level);
    let opened = open_levels(&levels, &cuts, all_origins);
    let [removals, opened_removals] = removals;
    Ok(CutPyramid {
        pyramid: Pyramid { levels, removals },
        opened: Pyramid { levels: opened, removals: opened_removals },
        cuts,
    })
}

/// The levels after their cuts; `origins` has the place of level 0 of each of their places.
fn open_levels(
    levels: &IdVec<LevelId, Level>,
    cuts: &IdVec<LevelId, CutMesh>,
    origins: Vec<IdVec<PlaceId, PlaceId>>,
) -> IdVec<LevelId, Level> {
    let CutMesh { unsplit: finest, .. } = &cuts[LevelId::new(0)];
    let mut opened = IdVec::<LevelId, Level>::default();
    for ((level, cut), origins) in levels.iter().zip(cuts).zip(origins) {
        let to_finest = level.to_finest.as_ref().map(|rows| {
            let mut indices = finest.map(|&v| rows.indices[v]);
            // A copy that is still a vertex is its own field.
            for (place, &origin) in origins.enumerate() {
                indices[origin][0] = place.opened();
            }
            let weights = finest.map(|&v| rows.weights[v]).reindexed();
            Prolongation { indices: indices.reindexed(), weights, coarse_len: origins.len() }
        });
        if let (Some(rows), Some(finer)) = (&to_finest, opened.iter_mut().last()) {
            finer.from_coarser = Some(Prolongation {
                indices: finer.origins.map(|&origin| rows.indices[origin]),
                weights: finer.origins.map(|&origin| rows.weights[origin]),
                coarse_len: rows.coarse_len,
            });
        }
        opened.push(Level {
            mesh: cut.mesh(&level.mesh.positions),
            origins: origins.map(|place| place.opened()).reindexed(),
            areas: cut.unsplit.map(|&v| level.areas[v]).reindexed(),
            from_coarser: None,
            to_finest,
        });
    }
    opened
}

fn check(mesh: &TriMesh, taxels: &Taxels, options: &CoarsenOptions) -> Result<(), PyramidError> {
    mesh.validate()?;
    let needed = mesh.positions.len();
    let lengths =
        [("ids", taxels.ids.len()), ("areas", taxels.areas.len()), ("presence", taxels.presence.len())];
    if let Some(&(what, found)) = lengths.iter().find(|(_, found)| *found != needed) {
        return Err(PyramidError::Length { what, found, needed });
    }
    if let Some((vertex, &found)) = taxels.areas.enumerate().find(|(_, a)| !a.is_finite() || **a < 0.0) {
        return Err(PyramidError::Area { vertex, found });
    }
    taxels.check_demands(needed)?;
    match options.ratio {
        Some(found) if !found.is_finite() || found < LEAST_RATIO => {
            Err(PyramidError::Ratio { found, least: LEAST_RATIO })
        }
        _ => Ok(()),
    }
}

/// The coarsest level so far, which becomes the next one.
struct Coarsener<'a> {
    taxels: &'a Taxels,
    options: &'a CoarsenOptions,
    level: Level,
    /// The numbering of vertices and taxels in the following members.
    curve: &'a AlongCurve,
    /// The level's mesh, from which vertices are removed.
    surface: HalfedgeMesh,
    positions: IdVec<VertexId, DVec3>,
    /// The taxel of each vertex.
    origins: IdVec<VertexId, VertexId>,
    /// The locations of the taxels of level 0 on it.
    locations: TaxelLocations,
    /// The seam along which it is cut for its map.
    seam: Option<SeamedLevel>,
    /// The spacing that follows from densities and acuities at each vertex of level 0, in its order, in m.
    wanted_spacing: Option<IdVec<VertexId, f64>>,
}

/// How the next coarser level is cut: the removals from the cut level, for each of its places the place of
/// that level, and the cut itself.
type CutStep = (RemovalLog, IdVec<PlaceId, PlaceId>, CutMesh);

impl<'a> Coarsener<'a> {
    /// At level 0, whose rings are returned too.
    fn new(
        mesh: &TriMesh,
        taxels: &'a Taxels,
        options: &'a CoarsenOptions,
        curve: &'a AlongCurve,
        seam: Option<SeamedLevel>,
    ) -> Result<(Self, Rings), PyramidError> {
        // An error names vertices of the given mesh.
        let (surface, rings) =
            HalfedgeMesh::new(&curve.mesh).map_err(|error| Adjacency::new(mesh).err().unwrap_or(error))?;
        let locations = TaxelLocations::new(mesh.positions.len(), mesh.triangles.len());
        let level = Level::finest(mesh.clone(), taxels.areas.clone());
        let positions = curve.mesh.positions.clone();
        let origins: IdVec<_, _> = positions.ids().collect();
        let wanted_spacing = wanted_spacing(taxels, || {
            let spacing = measured_spacing(&rings, &positions);
            curve.numbers.map(|&taxel| spacing[taxel])
        });
        let this = Self {
            taxels,
            options,
            level,
            curve,
            surface,
            positions,
            origins,
            locations,
            seam,
            wanted_spacing,
        };
        Ok((this, rings))
    }

    /// Coarsens to the coarsest level, and passes on every finer level with the removals from it and the cut
    /// of the next one.
    fn run(
        &mut self,
        rings: Rings,
        run: Run<'_>,
        mut done: impl FnMut(Level, RemovalLog, Option<CutStep>),
    ) -> Result<(), Cancelled> {
        let mut finest_rings = Some(rings);
        let mut count = 0;
        while count < self.options.levels.unwrap_or(usize::MAX) && self.wants_coarser() {
            let rings = finest_rings.take().unwrap_or_else(|| self.surface.rings());
            let Some((level, log, cut)) = self.step(rings, run)? else { break };
            done(level, log, cut);
            count += 1;
        }
        Ok(())
    }

    /// Whether a further level would be nearer to the coarsest count, as a factor, than this one.
    fn wants_coarser(&self) -> bool {
        let ratio = self.options.ratio.unwrap_or(USUAL_RATIO);
        self.level.mesh.positions.len() as f64 > self.options.coarsest as f64 * ratio.sqrt()
    }

    /// Makes the next coarser level; returns the one before, with its `from_coarser`, and the removals
    /// between them. `None` if the level would not shrink enough.
    fn step(
        &mut self,
        rings: Rings,
        run: Run<'_>,
    ) -> Result<Option<(Level, RemovalLog, Option<CutStep>)>, Cancelled> {
        let (kept, order) = self.choose(&rings);
        drop(rings);
        let Self { level, curve, surface, positions, origins, locations, seam, .. } = self;
        let count = positions.len();
        let is_small = |vertices: usize| vertices as f64 * LEAST_RATIO <= count as f64;
        if !is_small(kept.iter().filter(|k| **k).count()) {
            return Ok(None);
        }
        let remover = Remover { mesh: surface, locations, positions, origins, seam: seam.as_mut() };
        let mut removals = remover.remove(&kept, &order, run)?;
        if !is_small(count - removals.len()) {
            return Ok(None);
        }
        let compacted = surface.compact();
        locations.compact(&compacted.new_faces, compacted.mesh.face_count());
        let parents = compacted.old_vertices;
        let mut cut = seam.as_mut().map(|seam| {
            let (log, places) = seam.compact(&parents, |face| surface.is_alive(face));
            (log, places, seam.cut.clone())
        });
        if level.to_finest.is_none() {
            // Level 0 is passed on in its own order.
            let logs = iter::once(&mut removals).chain(cut.as_mut().map(|(log, ..)| log));
            logs.for_each(|log| log.renumber(|v| curve.given(v)));
        }
        *surface = compacted.mesh;
        *positions = parents.map(|&v| positions[v]);
        *origins = parents.map(|&v| origins[v]);
        let mesh = TriMesh { positions: positions.clone(), triangles: surface.triangles() };
        let origins = origins.map(|&taxel| curve.given(taxel));
        let (indices, weights) = locations.rows(surface, &curve.numbers, &origins);
        let coarse_len = parents.len();
        let from_coarser = Prolongation {
            indices: level.origins.map(|&taxel| indices[taxel]),
            weights: level.origins.map(|&taxel| weights[taxel]),
            coarse_len,
        };
        level.from_coarser = Some(from_coarser);
        let to_finest = Prolongation { indices, weights, coarse_len };
        let areas = to_finest.restrict(&self.taxels.areas);
        let next = Level { mesh, origins, areas, from_coarser: None, to_finest: Some(to_finest) };
        Ok(Some((std::mem::replace(level, next), removals, cut)))
    }

    /// Which vertices are kept, and the order in which the others are removed.
    fn choose(&self, rings: &Rings) -> (IdVec<VertexId, bool>, Vec<VertexId>) {
        let Self { taxels, positions, .. } = self;
        let origins = self.origins.map(|&taxel| self.curve.given(taxel));
        let mut spacing = measured_spacing(rings, positions);
        if let Some(wanted) = &self.wanted_spacing {
            spacing = scaled_spacing(&origins.map(|&taxel| wanted[taxel]), &spacing);
        }
        let roles = self.seam.as_ref().map(|seam| &seam.roles);
        let order = priorities(rings, positions, &origins, taxels, roles);
        let fixed = &|v: VertexId| roles.is_some_and(|roles| roles[v] == SeamRole::Fixed);
        let loops = rings.boundary_loops();
        let is_live = &|v: VertexId| taxels.presence[origins[v]].reads_pressure();
        let candidates = Candidates {
            rings,
            loops: &loops,
            positions,
            spacing: &spacing,
            priorities: &order,
            fixed,
            is_live,
        };
        let kept = match self.options.ratio {
            Some(ratio) => candidates.choose_about(positions.len() as f64 / ratio),
            None => candidates.choose(ALPHA),
        };
        (kept, order)
    }
}
