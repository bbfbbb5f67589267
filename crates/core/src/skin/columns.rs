//! Columns: arrays with one entry for each taxel; selecting entries and checking lengths treats all of them alike.

use crate::id::{Id, IdVec};

/// An optional array with one entry for each taxel.
pub(super) trait Column {
    /// The entries `kept`, in that order.
    fn selected(&self, kept: impl Iterator<Item = usize>) -> Self;

    /// Number of entries; `None` without the array.
    fn entries(&self) -> Option<usize>;
}

impl<T: Clone> Column for Vec<T> {
    fn selected(&self, kept: impl Iterator<Item = usize>) -> Self {
        kept.map(|k| self[k].clone()).collect()
    }

    fn entries(&self) -> Option<usize> {
        Some(self.len())
    }
}

impl<I: Id, T: Clone> Column for IdVec<I, T> {
    fn selected(&self, kept: impl Iterator<Item = usize>) -> Self {
        kept.map(|k| self[I::new(k)].clone()).collect()
    }

    fn entries(&self) -> Option<usize> {
        Some(self.len())
    }
}

impl<C: Column> Column for Option<C> {
    fn selected(&self, kept: impl Iterator<Item = usize>) -> Self {
        self.as_ref().map(|column| column.selected(kept))
    }

    fn entries(&self) -> Option<usize> {
        self.as_ref().and_then(Column::entries)
    }
}

/// Defines a struct of columns and other fields, with the functions that treat all columns alike.
macro_rules! columns {
    (
        $(#[$struct_doc:meta])*
        $name:ident { $($(#[$field_doc:meta])* $field:ident: $field_type:ty,)* }
        $($(#[$doc:meta])* $column:ident: $type:ty,)*
    ) => {
        $(#[$struct_doc])*
        #[derive(Debug, Clone, Default, PartialEq)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $field_type,)*
            $($(#[$doc])* pub $column: $type,)*
        }

        impl $name {
            /// The entries `kept` of every column, in that order; the other fields are empty.
            fn selected(&self, kept: impl Iterator<Item = usize> + Clone) -> Self {
                Self {
                    $($field: Default::default(),)*
                    $($column: $crate::skin::columns::Column::selected(&self.$column, kept.clone()),)*
                }
            }

            /// The first column with another length than `needed`, and its length.
            fn wrong_column(&self, needed: usize) -> Option<(&'static str, usize)> {
                let all = [$((stringify!($column), $crate::skin::columns::Column::entries(&self.$column))),*];
                all.into_iter().filter_map(|(what, n)| Some((what, n?))).find(|(_, n)| *n != needed)
            }
        }
    };
}
pub(super) use columns;
