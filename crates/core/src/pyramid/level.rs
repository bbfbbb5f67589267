//! Levels of receptive fields, and the rules for the levels of one patch.

use crate::id::{IdVec, VertexId};
use crate::mesh::{Adjacency, TriMesh};
use crate::pyramid::{LevelId, Prolongation, PyramidError, RemovalLog};

/// Smaller differences of weights are the rounding of other programs.
const SAME_WEIGHT: f64 = 1e-3;

/// One level of a pyramid: a mesh whose vertices are the centres of receptive fields.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Level {
    /// The mesh; level 0 is the patch itself.
    pub mesh: TriMesh,
    /// The level-0 vertex of each vertex.
    pub origins: IdVec<VertexId, VertexId>,
    /// Receptive areas in m^2, collected from level 0 by `to_finest`: `Q' a`.
    pub areas: IdVec<VertexId, f64>,
    /// This level's vertices in terms of the next coarser level; `None` on the coarsest. These are
    /// the rows of the next level's `to_finest` that belong to this level's vertices.
    pub from_coarser: Option<Prolongation>,
    /// Level 0's vertices in terms of this level; `None` on level 0. A row names the corners of the face in
    /// which the taxel lies, in the order of that face up to rotation; the row of a centre is itself with
    /// weight 1, then two neighbours with weight 0.
    pub to_finest: Option<Prolongation>,
}

/// A patch and its coarser levels, joined by prolongations.
#[derive(Debug, Clone, PartialEq)]
pub struct Pyramid {
    /// The levels, finest first; at least one.
    pub levels: IdVec<LevelId, Level>,
    /// The removals that turned each level into the next coarser one; none for the coarsest.
    pub removals: IdVec<LevelId, RemovalLog>,
}

impl Pyramid {
    /// Checks the rules of levels, and that every level is an oriented manifold whose vertices are
    /// vertices of the next finer one.
    ///
    /// # Errors
    /// The first broken rule, with its level.
    pub fn validate(&self) -> Result<(), PyramidError> {
        check_levels(&self.levels.iter().collect::<Vec<_>>())?;
        let (found, needed) = (self.removals.len(), self.levels.len() - 1);
        if found != needed {
            return Err(PyramidError::Length { what: "removals", found, needed });
        }
        let mut finer: Option<&Level> = None;
        for (id, level) in self.levels.enumerate() {
            let checked = self.check_step(id, level, finer);
            checked.map_err(|source| PyramidError::AtLevel { level: id, source: source.into() })?;
            finer = Some(level);
        }
        Ok(())
    }

    /// Checks the rules that a map need not keep: manifoldness, nesting, and the record of removals.
    fn check_step(&self, id: LevelId, level: &Level, finer: Option<&Level>) -> Result<(), PyramidError> {
        Adjacency::new(&level.mesh)?;
        if let Some(finer) = finer {
            level.finer_vertices(finer)?;
        }
        let Some(log) = self.removals.get(id) else { return Ok(()) };
        let coarser = &self.levels[LevelId::new(id.index() + 1)];
        let needed = level.mesh.positions.len().saturating_sub(coarser.mesh.positions.len());
        match log.len() {
            found if found == needed => Ok(()),
            found => Err(PyramidError::Length { what: "removals", found, needed }),
        }
    }
}

impl Level {
    /// Level 0 of a mesh with these receptive areas (m^2).
    #[doc(hidden)]
    pub fn finest(mesh: TriMesh, areas: IdVec<VertexId, f64>) -> Self {
        Self { origins: mesh.positions.ids().collect(), mesh, areas, from_coarser: None, to_finest: None }
    }

    /// The vertex of the next finer level for each vertex of this one.
    ///
    /// # Errors
    /// If one of them is not a vertex of that level.
    pub(crate) fn finer_vertices(&self, finer: &Self) -> Result<IdVec<VertexId, VertexId>, PyramidError> {
        let count = finer.origins.iter().map(|origin| origin.index() + 1).max().unwrap_or_default();
        let mut vertex_of = IdVec::<VertexId, Option<VertexId>>::filled(None, count);
        for (vertex, &origin) in finer.origins.enumerate() {
            vertex_of[origin] = Some(vertex);
        }
        let find = |(vertex, &found): (VertexId, &VertexId)| {
            let what = "the finer level";
            let count = finer.origins.len();
            let at = vertex_of.get(found).copied().flatten();
            at.ok_or(PyramidError::NotNested { vertex, what, found, count })
        };
        Ok(self.origins.enumerate().map(find).collect::<Result<Vec<_>, _>>()?.into())
    }

    /// The first vertex at the position of its taxel on `finest` whose row of `from_coarser` has other
    /// weights than that taxel's row in the `to_finest` of the next coarser level. The lengths of all arrays
    /// must be valid.
    pub(crate) fn contradiction(&self, coarser: &Self, finest: &Self) -> Option<VertexId> {
        let (up, direct) = (self.from_coarser.as_ref()?, coarser.to_finest.as_ref()?);
        let differ = |(v, &origin): (VertexId, &VertexId)| {
            let weight = |rows: &Prolongation, row, of| -> f64 {
                rows.row(row).filter(|(at, _)| *at == of).map(|(_, w)| w).sum()
            };
            let both = up.row(v).chain(direct.row(origin));
            let mut gaps = both.map(|(of, _)| (weight(up, v, of) - weight(direct, origin, of)).abs());
            gaps.any(|gap| gap > SAME_WEIGHT)
        };
        let is_there =
            |v: VertexId, origin: VertexId| self.mesh.positions[v] == finest.mesh.positions[origin];
        self.origins
            .enumerate()
            .find(|&(v, origin)| is_there(v, *origin) && differ((v, origin)))
            .map(|(v, _)| v)
    }

    /// Checks the arrays of one level against its neighbours; `finest` and `finer` are `None` on
    /// level 0.
    fn check(&self, finest: Option<&Self>, coarser: Option<&Self>) -> Result<(), PyramidError> {
        self.mesh.validate()?;
        let count = |level: &Self| level.mesh.positions.len();
        let vertices = count(self);
        for (what, found) in [("origins", self.origins.len()), ("areas", self.areas.len())] {
            if found != vertices {
                return Err(PyramidError::Length { what, found, needed: vertices });
            }
        }
        if let Some((vertex, &found)) = self.areas.enumerate().find(|(_, a)| !a.is_finite() || **a < 0.0) {
            return Err(PyramidError::Area { vertex, found });
        }
        let finest_count = finest.map_or(vertices, count);
        let is_wrong = |vertex, origin: VertexId| match finest {
            None => origin != vertex,
            Some(_) => origin.index() >= finest_count,
        };
        if let Some((vertex, &found)) = self.origins.enumerate().find(|&(v, &origin)| is_wrong(v, origin)) {
            return Err(PyramidError::NotNested { vertex, what: "level 0", found, count: finest_count });
        }
        check_rows("from_coarser", self.from_coarser.as_ref(), vertices, coarser.map(count))?;
        check_rows("to_finest", self.to_finest.as_ref(), finest_count, finest.map(|_| vertices))
    }
}

/// Checks the rules for the levels of one patch in a pyramid and in a map, in time linear in their size:
/// meshes of finite triangles, one entry per vertex, centres on level 0, and prolongations that fit and are
/// convex combinations.
///
/// # Errors
/// The first broken rule, with its level.
pub(crate) fn check_levels(levels: &[&Level]) -> Result<(), PyramidError> {
    let Some(finest) = levels.first() else { return Err(PyramidError::NoLevels) };
    for (k, level) in levels.iter().enumerate() {
        let coarser = levels.get(k + 1).copied();
        let checked = level.check((k > 0).then_some(finest), coarser);
        checked.map_err(|source| PyramidError::AtLevel { level: LevelId::new(k), source: source.into() })?;
    }
    Ok(())
}

/// Checks a prolongation of `rows` rows into `coarse` vertices; `coarse` is `None` where there must
/// be none.
fn check_rows(
    what: &'static str,
    given: Option<&Prolongation>,
    rows: usize,
    coarse: Option<usize>,
) -> Result<(), PyramidError> {
    let (fine_len, coarse_len) = given.map_or((0, 0), |p| (p.indices.len(), p.coarse_len));
    let needed = coarse.map_or((0, 0), |coarse| (rows, coarse));
    if fine_len != needed.0 {
        return Err(PyramidError::Length { what, found: fine_len, needed: needed.0 });
    }
    if coarse_len != needed.1 {
        return Err(PyramidError::Columns { what, found: coarse_len, needed: needed.1 });
    }
    let wrong = |source| PyramidError::Rows { what, source: Box::new(source) };
    given.map_or(Ok(()), |p| p.validate().map_err(wrong))
}
