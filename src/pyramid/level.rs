use crate::{
    id::{IdVec, VertexId, define_id},
    mesh::{Adjacency, TriMesh},
    pyramid::{Prolongation, PyramidError, RemovalLog},
};

define_id!(
    /// A level of one pyramid; 0 is the skin itself.
    LevelId, "L"
);

/// One level of a pyramid: a mesh whose vertices are the centres of receptive fields.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// The mesh; level 0 is the patch itself.
    pub mesh: TriMesh,
    /// The level-0 vertex that each vertex is.
    pub origins: IdVec<VertexId, VertexId>,
    /// The vertex of the next finer level that each vertex is; on level 0 itself.
    pub parents: IdVec<VertexId, VertexId>,
    /// Receptive areas in m^2, pushed down from level 0 by the prolongations: `a_c = P' a`.
    pub areas: IdVec<VertexId, f64>,
    /// This level's vertices in terms of the next coarser level; `None` on the coarsest. The rows of the next level's
    /// `direct` that belong to this level's vertices.
    pub up: Option<Prolongation>,
    /// Level 0's vertices in terms of this level; `None` on level 0. A row names the corners of the face that the
    /// taxel lies in, as they stand in that face up to rotation; a centre's row is itself with weight 1, then two
    /// neighbours with weight 0.
    pub direct: Option<Prolongation>,
    /// The removals that turned this level into the next coarser one; empty on the coarsest.
    pub removals: RemovalLog,
}

/// A patch and its coarser levels, joined by prolongations.
#[derive(Debug, Clone, PartialEq)]
pub struct Pyramid {
    /// The levels, finest first; at least one.
    pub levels: IdVec<LevelId, Level>,
}

impl Pyramid {
    /// Checks that every level is an oriented manifold, that vertices are nested, that arrays fit each other and
    /// that prolongations are convex combinations.
    ///
    /// # Errors
    /// The first broken rule, with its level.
    pub fn validate(&self) -> Result<(), PyramidError> {
        let Some(ground) = self.levels.iter().next() else { return Err(PyramidError::NoLevels) };
        for (id, level) in self.levels.enumerate() {
            let finer = (id.index() > 0).then(|| &self.levels[LevelId::new(id.index() - 1)]);
            let coarser = self.levels.get(LevelId::new(id.index() + 1));
            level
                .validate(ground, finer, coarser)
                .map_err(|source| PyramidError::AtLevel { level: id, source: Box::new(source) })?;
        }
        Ok(())
    }
}

impl Level {
    fn validate(
        &self,
        ground: &Self,
        finer: Option<&Self>,
        coarser: Option<&Self>,
    ) -> Result<(), PyramidError> {
        Adjacency::new(&self.mesh)?;
        let vertices = self.mesh.positions.len();
        let removed = coarser.map_or(0, |c| vertices.saturating_sub(c.mesh.positions.len()));
        let of = |p: &Option<Prolongation>, other: Option<&Self>| {
            let found = p.as_ref().map_or((0, 0), |p| (p.fine_len(), p.coarse_len));
            (found, other.map_or(0, |l| l.mesh.positions.len()))
        };
        let ((up_fine, up_coarse), coarser_len) = of(&self.up, coarser);
        let ((direct_fine, direct_coarse), ground_len) = of(&self.direct, finer.map(|_| ground));
        let lengths = [
            ("origins", self.origins.len(), vertices),
            ("parents", self.parents.len(), vertices),
            ("areas", self.areas.len(), vertices),
            ("removals", self.removals.len(), removed),
            ("up", up_fine, if coarser.is_some() { vertices } else { 0 }),
            ("up's coarse side", up_coarse, coarser_len),
            ("direct", direct_fine, ground_len),
            ("direct's coarse side", direct_coarse, if finer.is_some() { vertices } else { 0 }),
        ];
        if let Some(&(what, found, needed)) = lengths.iter().find(|(_, found, needed)| found != needed) {
            return Err(PyramidError::Length { what, found, needed });
        }
        for (what, names, count) in [
            ("level 0", &self.origins, ground.mesh.positions.len()),
            ("the finer level", &self.parents, finer.unwrap_or(self).mesh.positions.len()),
        ] {
            if let Some((vertex, &found)) = names.enumerate().find(|(_, v)| v.index() >= count) {
                return Err(PyramidError::NotNested { vertex, what, found, count });
            }
        }
        self.up.iter().chain(&self.direct).try_for_each(Prolongation::validate)
    }
}
