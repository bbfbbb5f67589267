//! [`Field`]: one receptive field of a level.

use crate::id::{IdVec, VertexId};
use crate::pyramid::Level;

/// A receptive field: a vertex of a level with the taxels that it represents.
///
/// These are the taxels with a weight in its column of the level's direct prolongation `Q`
/// ([`Level::to_finest`]): those on the faces around the vertex, whose weight falls from 1 at the centre to 0 at
/// the neighbours. A taxel lies in up to three fields of every level, and its weights there have the sum 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// The taxel at its centre.
    pub centre: VertexId,
    /// The taxels in it, ascending.
    pub members: Vec<VertexId>,
    /// The share of each member that belongs to it.
    pub weights: Vec<f64>,
    /// Its receptive area, in m^2: the sum of those of its members by their weights.
    pub area: f64,
    /// The fields next to it: the neighbours of its vertex on the level, ascending.
    pub neighbours: Vec<VertexId>,
    /// The share of its area that also belongs to each neighbour: `sum a_i w_i v_i / area` with the weights
    /// `v_i` of the neighbour. With its own share, `sum a_i w_i^2 / area`, they have the sum 1.
    pub overlap: Vec<f64>,
}

impl Level {
    /// The receptive fields of this level, one for each vertex; `finest` is level 0 of the same pyramid, where
    /// each taxel is a field of its own.
    ///
    /// ```
    /// use dermatome::{
    ///     mesh::shapes,
    ///     pyramid::{CoarsenOptions, LevelId, coarsen},
    ///     run::Run,
    ///     skin::Taxels,
    /// };
    ///
    /// let mesh = shapes::lattice(20, 20, 0.005);
    /// let pyramid = coarsen(&mesh, &Taxels::from(&mesh), &CoarsenOptions::default(), Run::default())?;
    /// let [finest, level] = [0, 1].map(|k| &pyramid.levels[LevelId::new(k)]);
    /// for field in &level.fields(finest) {
    ///     let at = field.members.binary_search(&field.centre).expect("the centre lies in its field");
    ///     assert_eq!(field.weights[at], 1.0);
    ///     println!("{} taxels on {:.0} mm2", field.members.len(), 1e6 * field.area);
    /// }
    /// # Ok::<(), dermatome::pyramid::PyramidError>(())
    /// ```
    ///
    /// # Panics
    /// If `finest` is level 0 of another pyramid.
    pub fn fields(&self, finest: &Self) -> IdVec<VertexId, Field> {
        let mut neighbours = self.origins.map(|_| Vec::new());
        for &[a, b, c] in &self.mesh.triangles {
            for (v, w) in [(a, b), (b, c), (c, a)] {
                neighbours[v].push(w);
                neighbours[w].push(v);
            }
        }
        let empty = |(v, &centre): (VertexId, &VertexId)| {
            let mut neighbours = std::mem::take(&mut neighbours[v]);
            neighbours.sort_unstable();
            neighbours.dedup();
            let (members, weights, overlap) = (Vec::new(), Vec::new(), vec![0.0; neighbours.len()]);
            Field { centre, members, weights, area: self.areas[v], neighbours, overlap }
        };
        let mut fields: IdVec<VertexId, Field> = self.origins.enumerate().map(empty).collect();
        for (taxel, &area) in finest.areas.enumerate() {
            let row: Vec<(VertexId, f64)> = match &self.to_finest {
                Some(direct) => direct.row(taxel).collect(),
                None => vec![(taxel, 1.0)],
            };
            for &(field, weight) in &row {
                let Field { members, weights, area: of, neighbours, overlap, .. } = &mut fields[field];
                members.push(taxel);
                weights.push(weight);
                for &(other, share) in &row {
                    if let Ok(k) = neighbours.binary_search(&other) {
                        overlap[k] += if *of > 0.0 { area * weight * share / *of } else { 0.0 };
                    }
                }
            }
        }
        fields
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::shapes;
    use crate::pyramid::{CoarsenOptions, LevelId, coarsen};
    use crate::run::Run;
    use crate::skin::Taxels;

    #[test]
    fn fields_share_the_skin_and_nothing_is_lost() {
        let mesh = shapes::cap(3000, 0.1, 1.0);
        let pyramid =
            coarsen(&mesh, &Taxels::from(&mesh), &CoarsenOptions::default(), Run::default()).unwrap();
        let finest = &pyramid.levels[LevelId::new(0)];
        assert!(pyramid.levels.len() > 2);
        for level in &pyramid.levels {
            let mut weight_of = finest.areas.map(|_| 0.0);
            for field in &level.fields(finest) {
                let parts = field.members.iter().zip(&field.weights);
                let area: f64 = parts.clone().map(|(&v, w)| w * finest.areas[v]).sum();
                let own: f64 = parts.clone().map(|(&v, w)| w * w * finest.areas[v]).sum();
                let shares = own / field.area + field.overlap.iter().sum::<f64>();
                assert!((area / field.area - 1.0).abs() < 1e-12, "{area} of {field:?}");
                assert!((shares - 1.0).abs() < 1e-12, "{shares} of {field:?}");
                parts.for_each(|(&v, w)| weight_of[v] += w);
            }
            assert!(weight_of.iter().all(|w: &f64| (w - 1.0).abs() < 1e-12), "each taxel belongs to fields");
        }
    }
    /// A field of no area overlaps nothing.
    #[test]
    fn fields_without_area_have_finite_shares() {
        let mesh = shapes::lattice(12, 12, 0.01);
        let mut pyramid =
            coarsen(&mesh, &Taxels::from(&mesh), &CoarsenOptions::default(), Run::default()).unwrap();
        pyramid.levels.iter_mut().for_each(|level| level.areas.iter_mut().for_each(|area| *area = 0.0));
        let [finest, level] = [0, 1].map(|k| &pyramid.levels[LevelId::new(k)]);
        assert!(level.fields(finest).iter().flat_map(|field| &field.overlap).all(|share| *share == 0.0));
    }
}
