//! Prescribed positions of the outer loop: on a circle as large as the skin, or given one by one (eq. 2 of
//! `(cannata)`, where the `m_j` of the boundary are given).

use std::f64::consts::{PI, TAU};

use glam::DVec2;

use crate::{
    flatten::{Boundary, FlattenError, crossings::boundary_crossings, domain::Disk},
    id::{IdVec, VertexId},
    mesh::TriMesh,
    skin::TaxelId,
};

impl Boundary {
    /// The boundary through these positions (m) of taxels, each given by its id; `ids` are those of the
    /// vertices of the mesh.
    ///
    /// # Errors
    /// If no taxel or several have one of the ids, or a taxel has two positions.
    pub fn through(
        ids: &IdVec<VertexId, TaxelId>,
        places: impl IntoIterator<Item = (TaxelId, DVec2)>,
    ) -> Result<Self, FlattenError> {
        let vertices = Vertices::new(ids);
        let mut at = IdVec::filled(None, ids.len());
        for (id, place) in places {
            if at[vertices.of(id)?].replace(place).is_some() {
                return Err(FlattenError::BoundaryTaxel { id, taxels: 1, places: 2 });
            }
        }
        Ok(Self::Places(at))
    }
}

/// The vertices of taxels, by id.
struct Vertices(Vec<(TaxelId, VertexId)>);

impl Vertices {
    fn new(ids: &IdVec<VertexId, TaxelId>) -> Self {
        let mut sorted: Vec<_> = ids.enumerate().map(|(v, &id)| (id, v)).collect();
        sorted.sort_unstable();
        Self(sorted)
    }

    fn of(&self, id: TaxelId) -> Result<VertexId, FlattenError> {
        let from = self.0.partition_point(|entry| entry.0 < id);
        let found = self.0[from..].iter().take_while(|entry| entry.0 == id).count();
        if found == 1 {
            Ok(self.0[from].1)
        } else {
            Err(FlattenError::BoundaryTaxel { id, taxels: found, places: 1 })
        }
    }
}

/// Positions (m) of the vertices of the outer loop, around the origin; none for a free boundary.
pub(crate) fn prescribed(
    mesh: &TriMesh,
    boundary: &Boundary,
) -> Result<Option<IdVec<VertexId, Option<DVec2>>>, FlattenError> {
    if *boundary == Boundary::Free {
        return Ok(None);
    }
    let disk = Disk::new(mesh)?;
    let walk = &disk.loops[0];
    let places = match *boundary {
        Boundary::Free => Vec::new(),
        Boundary::Places(ref places) => given_places(walk, places)?,
        Boundary::Circle => {
            let radius = (mesh.area() / PI).sqrt();
            shares(mesh, walk).iter().map(|&s| radius * DVec2::from_angle(TAU * s)).collect()
        }
    };
    let mut fixed = IdVec::filled(None, mesh.positions.len());
    for (&v, at) in walk.iter().zip(places) {
        fixed[v] = Some(at);
    }
    Ok(Some(fixed))
}

/// Length from the first vertex of a loop to each one, over the whole length.
fn shares(mesh: &TriMesh, walk: &[VertexId]) -> Vec<f64> {
    let mut along = 0.0;
    let mut shares: Vec<f64> = Vec::with_capacity(walk.len());
    for (k, &v) in walk.iter().enumerate() {
        shares.push(along);
        along += mesh.positions[v].distance(mesh.positions[walk[(k + 1) % walk.len()]]);
    }
    shares.iter_mut().for_each(|s| *s /= along);
    shares
}

/// The given positions of the vertices of the loop.
fn given_places(
    walk: &[VertexId],
    given: &IdVec<VertexId, Option<DVec2>>,
) -> Result<Vec<DVec2>, FlattenError> {
    let mut left = given.clone();
    let mut take = |&vertex: &VertexId| {
        let place = left.get_mut(vertex).and_then(Option::take).filter(|place| place.is_finite());
        place.ok_or(FlattenError::BoundaryPlace { vertex })
    };
    let places: Vec<DVec2> = walk.iter().map(&mut take).collect::<Result<_, _>>()?;
    if let Some((vertex, _)) = left.enumerate().find(|(_, place)| place.is_some()) {
        return Err(FlattenError::BoundaryPlace { vertex });
    }
    let corner = |k: usize| places[k % places.len()] - places[0];
    let doubled: f64 = (1..places.len()).map(|k| corner(k).perp_dot(corner(k + 1))).sum();
    let edges: Vec<[VertexId; 2]> = (0..walk.len()).map(|k| [walk[k], walk[(k + 1) % walk.len()]]).collect();
    let crossings = boundary_crossings(&edges, &given.map(|place| place.unwrap_or_default()));
    if crossings > 0 || !(doubled > 0.0 && doubled.is_finite()) {
        return Err(FlattenError::BoundaryShape { crossings, area: 0.5 * doubled });
    }
    Ok(places)
}
