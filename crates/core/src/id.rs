//! Typed indices, and arrays that are indexed by one of them.
//!
//! An index has a type for what it counts: a [`FaceId`] cannot be used instead of a [`VertexId`]. Other ids
//! are defined, by `define_id!`, in the module of the thing that they count.

use std::{fmt, marker::PhantomData, ops};

/// A dense index that counts one kind of thing.
pub trait Id: Copy + Eq + Ord + fmt::Debug {
    /// The id of the `index`-th thing.
    ///
    /// # Panics
    /// If `index` does not fit into 32 bits.
    fn new(index: usize) -> Self;
    /// Position in an [`IdVec`].
    fn index(self) -> usize;
}

/// Defines a dense index that counts one kind of thing, an [`Id`].
macro_rules! define_id {
    ($(#[$doc:meta])* $vis:vis $name:ident, $letter:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
        $vis struct $name(u32);

        impl $name {
            /// The id of the `index`-th thing.
            ///
            /// # Panics
            /// If `index` does not fit into 32 bits; readers of files refuse such sizes first.
            #[inline]
            $vis fn new(index: usize) -> Self {
                Self(u32::try_from(index).expect("more than 2^32 elements"))
            }

            /// Position in an [`IdVec`](crate::id::IdVec).
            #[inline]
            $vis const fn index(self) -> usize {
                self.0 as usize
            }

            /// The number of the id in files.
            #[inline]
            $vis const fn raw(self) -> u32 {
                self.0
            }
        }

        impl From<u32> for $name {
            #[inline]
            fn from(raw: u32) -> Self {
                Self(raw)
            }
        }

        impl From<$name> for u32 {
            #[inline]
            fn from(id: $name) -> Self {
                id.0
            }
        }

        impl $crate::id::Id for $name {
            #[inline]
            fn new(index: usize) -> Self {
                Self::new(index)
            }
            #[inline]
            fn index(self) -> usize {
                self.index()
            }
        }

        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, concat!($letter, "{}"), self.0)
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                self.0.fmt(f)
            }
        }
    };
}

define_id!(
    /// A vertex of one mesh.
    pub VertexId, "v"
);
define_id!(
    /// A triangle of one mesh.
    pub FaceId, "f"
);
pub(crate) use define_id;

/// A vector whose elements are indexed by one kind of [`Id`] alone.
///
/// ```
/// use dermatome::id::{IdVec, VertexId};
///
/// let mut heights = IdVec::from(vec![0.25, 0.5]);
/// let highest: VertexId = heights.push(0.75);
/// assert_eq!(heights[highest], 0.75);
/// assert_eq!(heights.iter().sum::<f64>() / heights.len() as f64, 0.5);
/// assert_eq!(Vec::from(heights), [0.25, 0.5, 0.75]);
/// ```
///
/// A position is not an index, nor is an id of something else:
///
/// ```compile_fail
/// # use dermatome::id::{IdVec, VertexId};
/// # let heights: IdVec<VertexId, f64> = IdVec::from(vec![0.25, 0.5]);
/// let height = heights[1];
/// ```
///
/// ```compile_fail
/// # use dermatome::id::{FaceId, IdVec, VertexId};
/// # let heights: IdVec<VertexId, f64> = IdVec::from(vec![0.25, 0.5]);
/// let of_faces: IdVec<FaceId, f64> = heights;
/// ```
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct IdVec<I, T> {
    raw: Vec<T>,
    id: PhantomData<fn(I) -> I>,
}

impl<I: Id, T> IdVec<I, T> {
    /// `count` copies of `value`.
    #[doc(hidden)]
    pub fn filled(value: T, count: usize) -> Self
    where
        T: Clone,
    {
        vec![value; count].into()
    }

    /// Appends `value` and returns its id.
    pub fn push(&mut self, value: T) -> I {
        let id = I::new(self.raw.len());
        self.raw.push(value);
        id
    }

    /// Removes the elements; keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.raw.clear();
    }

    /// The element of `id`, if it exists.
    #[inline]
    pub fn get(&self, id: I) -> Option<&T> {
        self.raw.get(id.index())
    }

    /// The element of `id`, to be changed, if it exists.
    pub(crate) fn get_mut(&mut self, id: I) -> Option<&mut T> {
        self.raw.get_mut(id.index())
    }

    /// The element of the first id.
    #[inline]
    pub fn first(&self) -> Option<&T> {
        self.raw.first()
    }

    /// The ids, in order.
    pub fn ids(&self) -> impl DoubleEndedIterator<Item = I> + ExactSizeIterator + Clone + use<I, T> {
        (0..self.raw.len()).map(I::new)
    }

    /// Ids and elements, in order.
    pub fn enumerate(&self) -> impl DoubleEndedIterator<Item = (I, &T)> + ExactSizeIterator + Clone {
        self.raw.iter().enumerate().map(|(i, x)| (I::new(i), x))
    }

    /// A vector with the same ids and `f` of each element.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> IdVec<I, U> {
        self.raw.iter().map(f).collect()
    }
}

impl<I, T> IdVec<I, T> {
    /// How many elements there are.
    #[inline]
    pub fn len(&self) -> usize {
        self.raw.len()
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.raw.is_empty()
    }

    /// The elements, in the order of their ids.
    #[inline]
    pub fn iter(&self) -> std::slice::Iter<'_, T> {
        self.raw.iter()
    }

    /// The elements, in the order of their ids, to be changed.
    #[inline]
    pub fn iter_mut(&mut self) -> std::slice::IterMut<'_, T> {
        self.raw.iter_mut()
    }

    /// The elements without their ids.
    #[inline]
    pub fn as_slice(&self) -> &[T] {
        &self.raw
    }

    /// The elements without their ids, to be changed.
    #[inline]
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.raw
    }

    /// The same elements, indexed by another kind of id.
    #[inline]
    pub fn reindexed<J>(self) -> IdVec<J, T> {
        self.raw.into()
    }
}

impl<I, T> Default for IdVec<I, T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<I, T> From<Vec<T>> for IdVec<I, T> {
    fn from(raw: Vec<T>) -> Self {
        Self { raw, id: PhantomData }
    }
}

impl<I, T> From<IdVec<I, T>> for Vec<T> {
    fn from(values: IdVec<I, T>) -> Self {
        values.raw
    }
}

impl<I: Id, T> FromIterator<T> for IdVec<I, T> {
    fn from_iter<It: IntoIterator<Item = T>>(iter: It) -> Self {
        Vec::from_iter(iter).into()
    }
}

impl<I: Id, T> IntoIterator for IdVec<I, T> {
    type Item = T;
    type IntoIter = std::vec::IntoIter<T>;
    fn into_iter(self) -> Self::IntoIter {
        self.raw.into_iter()
    }
}

impl<'a, I, T> IntoIterator for &'a IdVec<I, T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.raw.iter()
    }
}

impl<'a, I, T> IntoIterator for &'a mut IdVec<I, T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.raw.iter_mut()
    }
}

impl<I: Id, T> ops::Index<I> for IdVec<I, T> {
    type Output = T;
    #[inline]
    fn index(&self, id: I) -> &T {
        &self.raw[id.index()]
    }
}

impl<I: Id, T> ops::IndexMut<I> for IdVec<I, T> {
    #[inline]
    fn index_mut(&mut self, id: I) -> &mut T {
        &mut self.raw[id.index()]
    }
}

impl<I, T: fmt::Debug> fmt::Debug for IdVec<I, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.raw.fmt(f)
    }
}
