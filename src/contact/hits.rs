//! [`Hits`]: the answers to many queries, in columns.

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    contact::{ContactError, ContactIndex, Hit, Query, index::Cursor},
    id::FaceId,
    mesh::SurfacePoint,
    numeric::along_curve,
    skin::{LinkId, PatchId},
};

/// Fewest queries of a batch that one task answers: enough for the cache to hold what the next one needs.
const RUN: usize = 256;

/// The hits of a batch in columns, one entry for each query in their order: see the fields of [`Hit`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Hits {
    /// The patch of each hit.
    pub patch: Vec<PatchId>,
    /// The link of that patch.
    pub link: Vec<LinkId>,
    /// The face on level 0 of that patch.
    pub face: Vec<FaceId>,
    /// The barycentric coordinates in that face.
    pub barycentric: Vec<[f64; 3]>,
    /// The signed distance from the skin, in m.
    pub distance: Vec<f64>,
    /// The nearest point, in m, in the frame of its query.
    pub position: Vec<DVec3>,
    /// The outward unit normal there, in the same frame.
    pub normal: Vec<DVec3>,
}

impl Hits {
    /// The hit of the query with a number.
    #[must_use]
    pub fn get(&self, number: usize) -> Option<Hit> {
        Some(Hit {
            patch: *self.patch.get(number)?,
            link: *self.link.get(number)?,
            point: SurfacePoint {
                face: *self.face.get(number)?,
                barycentric: *self.barycentric.get(number)?,
            },
            distance: *self.distance.get(number)?,
            position: *self.position.get(number)?,
            normal: *self.normal.get(number)?,
        })
    }

    /// All hits in their order.
    pub fn iter(&self) -> impl Iterator<Item = Hit> + '_ {
        (0..self.patch.len()).map_while(|number| self.get(number))
    }

    /// Columns of the hits of `sorted`, the one for the query `k` at `places[k]`.
    fn gather(sorted: &[Hit], places: &[usize]) -> Self {
        let count = places.len();
        let mut hits = Self {
            patch: vec![PatchId::default(); count],
            link: vec![LinkId::default(); count],
            face: vec![FaceId::default(); count],
            barycentric: vec![[0.0; 3]; count],
            distance: vec![0.0; count],
            position: vec![DVec3::ZERO; count],
            normal: vec![DVec3::ZERO; count],
        };
        let Self { patch, link, face, barycentric, distance, position, normal } = &mut hits;
        let rows = (patch, link, face, barycentric, distance, position, normal, places).into_par_iter();
        rows.with_min_len(RUN).for_each(
            |(patch, link, face, barycentric, distance, position, normal, &place)| {
                let hit = &sorted[place];
                (*patch, *link, *face) = (hit.patch, hit.link, hit.point.face);
                (*barycentric, *distance) = (hit.point.barycentric, hit.distance);
                (*position, *normal) = (hit.position, hit.normal);
            },
        );
        hits
    }
}

impl ContactIndex {
    /// Answers many queries, in parallel; the same hits in the same order as one by one.
    ///
    /// They are visited along a Morton curve, so that each search finds in the cache what the last
    /// one used.
    ///
    /// # Errors
    /// The first query that cannot be answered.
    pub fn locate_all(&self, queries: &[Query]) -> Result<Hits, ContactError> {
        for (number, query) in queries.iter().enumerate() {
            self.links.check(number, query)?;
        }
        let points: Vec<DVec3> = queries.iter().map(|query| self.links.in_world(query)).collect();
        let order = along_curve(&points);
        let sorted: Vec<Hit> = order
            .par_iter()
            .with_min_len(RUN)
            .map_with(Cursor::default(), |cursor, &number| self.answer_along(cursor, &queries[number]))
            .collect::<Result<_, _>>()?;
        let mut places = vec![0_usize; queries.len()];
        order.iter().enumerate().for_each(|(place, &number)| places[number] = place);
        Ok(Hits::gather(&sorted, &places))
    }
}
