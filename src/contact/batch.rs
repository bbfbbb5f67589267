//! Many queries at once, in parallel.

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    contact::{ContactError, ContactIndex, Cursor, Hit, Query},
    numeric::along_curve,
};

/// Fewest contacts that one task answers: enough for the cache to hold what the next one needs.
const RUN: usize = 256;

impl ContactIndex {
    /// Answers many contacts, in parallel; the same hits in the same order as one by one.
    ///
    /// They are visited along a Morton curve, so that each search finds in the cache what the last
    /// one used.
    ///
    /// # Errors
    /// The first contact that cannot be answered.
    pub fn locate_all(&self, contacts: &[Query]) -> Result<Vec<Hit>, ContactError> {
        self.each_along_curve(contacts, |cursor, contact| self.answer_along(cursor, contact))?
            .into_iter()
            .collect()
    }

    /// The same for any other question: `answer` is called for each query, in parallel and along the same
    /// curve.
    ///
    /// ```
    /// # use dermatome::{contact::*, map::SkinMap, mesh::shapes, pyramid::LevelId};
    /// # use glam::DVec3;
    /// # let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
    /// let options = IndexOptions { levels: true, fields: true, ..IndexOptions::default() };
    /// let index = ContactIndex::with(&map, &options)?;
    /// let contacts = [0.01, 0.05, 0.02].map(|x| Query::from(DVec3::new(x, 0.03, 0.002)));
    /// let level = LevelId::new(0);
    /// for taxels in index.answer_all(&contacts, |contact| index.nearest_fields(*contact, 8, level))? {
    ///     assert_eq!(taxels?.len(), 8);
    /// }
    /// # Ok::<_, ContactError>(())
    /// ```
    ///
    /// # Errors
    /// The first query with a point that is not finite, or with a link that does not exist or carries no
    /// patch.
    pub fn answer_all<T: Clone + Send + Sync>(
        &self,
        queries: &[Query],
        answer: impl Fn(&Query) -> T + Sync,
    ) -> Result<Vec<T>, ContactError> {
        self.each_along_curve(queries, |_, query| answer(query))
    }

    fn each_along_curve<T: Clone + Send + Sync>(
        &self,
        queries: &[Query],
        answer: impl Fn(&mut Cursor, &Query) -> T + Sync,
    ) -> Result<Vec<T>, ContactError> {
        for (number, query) in queries.iter().enumerate() {
            self.check(number, query)?;
        }
        let points: Vec<DVec3> = queries.iter().map(|query| self.in_world(query)).collect();
        let order = along_curve(&points);
        let sorted: Vec<T> = order
            .par_iter()
            .with_min_len(RUN)
            .map_with(Cursor::default(), |cursor, &number| answer(cursor, &queries[number]))
            .collect();
        let mut places = vec![0_usize; queries.len()];
        order.iter().enumerate().for_each(|(place, &number)| places[number] = place);
        Ok(places.par_iter().map(|&place| sorted[place].clone()).collect())
    }
}
