//! Decoding: the rows of checked accessors become numbers.
//!
//! The readers of the `gltf` crate are not used here: they know no quantized positions and no
//! attributes of other programs, stop without a word where bytes end, and panic on indices that are
//! floats.

use std::array;

use gltf::json::accessor::ComponentType;

use crate::io::{
    IoError,
    gltf::{
        accessor::{Accessor, Rows, kind_name},
        document::Document,
    },
};

/// A number as it lies in a buffer.
trait Number: Copy {
    const SIZE: usize;
    /// What 1 is stored as when normalized.
    const ONE: f64;
    fn read(bytes: &[u8]) -> Self;
    fn real(self) -> f64;
}

macro_rules! number {
    ($type:ty, $one:expr, $($at:literal)+) => {
        impl Number for $type {
            const SIZE: usize = size_of::<$type>();
            const ONE: f64 = $one;
            #[inline]
            fn read(bytes: &[u8]) -> Self {
                <$type>::from_le_bytes([$(bytes[$at]),+])
            }
            #[inline]
            fn real(self) -> f64 {
                f64::from(self)
            }
        }
    };
}

number!(i8, 127.0, 0);
number!(u8, 255.0, 0);
number!(i16, 32767.0, 0 1);
number!(u16, 65535.0, 0 1);
number!(u32, 1.0, 0 1 2 3);
number!(f32, 1.0, 0 1 2 3);

impl Rows<'_> {
    /// `count` rows of `N` components.
    #[inline]
    fn numbers<C: Number, const N: usize>(&self, count: usize) -> impl Iterator<Item = [C; N]> {
        (0..count).map(|i| {
            let row = &self.bytes[i * self.stride..][..N * C::SIZE];
            array::from_fn(|k| C::read(&row[k * C::SIZE..][..C::SIZE]))
        })
    }

    /// The rows as real numbers; and the first one that is not finite.
    fn reals_of<C: Number, const N: usize>(
        &self,
        count: usize,
        normalized: bool,
    ) -> (Vec<[f64; N]>, Option<usize>) {
        let divisor = if normalized { C::ONE } else { 1.0 };
        // The smallest signed integer would come out below -1.
        let floor = if normalized { -1.0 } else { f64::NEG_INFINITY };
        let mut odd = None;
        let convert = |(i, row): (usize, [C; N])| {
            let row = row.map(|x| {
                let x = x.real() / divisor;
                if x < floor { floor } else { x }
            });
            if odd.is_none() && !row.iter().all(|x: &f64| x.is_finite()) {
                odd = Some(i);
            }
            row
        };
        (self.numbers(count).enumerate().map(convert).collect(), odd)
    }

    fn reals<const N: usize>(
        &self,
        component: ComponentType,
        count: usize,
        normalized: bool,
    ) -> (Vec<[f64; N]>, Option<usize>) {
        match component {
            ComponentType::I8 => self.reals_of::<i8, N>(count, normalized),
            ComponentType::U8 => self.reals_of::<u8, N>(count, normalized),
            ComponentType::I16 => self.reals_of::<i16, N>(count, normalized),
            ComponentType::U16 => self.reals_of::<u16, N>(count, normalized),
            ComponentType::U32 => self.reals_of::<u32, N>(count, normalized),
            ComponentType::F32 => self.reals_of::<f32, N>(count, normalized),
        }
    }

    /// The rows as unsigned integers; `None` for signed ones and floats.
    pub(super) fn uints<const N: usize>(
        &self,
        component: ComponentType,
        count: usize,
    ) -> Option<Vec<[u32; N]>> {
        match component {
            ComponentType::U8 => Some(self.numbers(count).map(|row: [u8; N]| row.map(u32::from)).collect()),
            ComponentType::U16 => Some(self.numbers(count).map(|row: [u16; N]| row.map(u32::from)).collect()),
            ComponentType::U32 => Some(self.numbers(count).collect()),
            ComponentType::I8 | ComponentType::I16 | ComponentType::F32 => None,
        }
    }
}

impl Document {
    /// All rows of an accessor, each through `convert`. Normalized integers arrive between -1 and
    /// 1.
    ///
    /// The accessor must have rows of `N` components, and no component may be NaN or infinite.
    pub(super) fn gather<const N: usize, T>(
        &self,
        accessor: &Accessor<'_>,
        convert: impl Fn([f64; N]) -> T,
    ) -> Result<Vec<T>, IoError> {
        // In place: a row has the size of what it becomes.
        Ok(self.reals(accessor)?.into_iter().map(convert).collect())
    }

    /// All rows of a scalar accessor.
    pub(super) fn gather_scalars(&self, accessor: &Accessor<'_>) -> Result<Vec<f64>, IoError> {
        self.gather(accessor, |[x]: [f64; 1]| x)
    }

    fn reals<const N: usize>(&self, accessor: &Accessor<'_>) -> Result<Vec<[f64; N]>, IoError> {
        self.prepare(accessor, N, size_of::<[f64; N]>())?;
        let (component, normalized) = (accessor.component, accessor.json.normalized);
        let refuse = |row: usize| {
            self.invalid(accessor.name(), format!("NaN or infinity in row {row}"), "finite numbers")
        };
        let (mut rows, odd) = match &accessor.base {
            Some(base) => base.reals(component, accessor.count, normalized),
            None => (vec![[0.0; N]; accessor.count], None),
        };
        if let Some(row) = odd {
            return Err(refuse(row));
        }
        if let Some(replaced) = &accessor.replaced {
            let (values, odd) = replaced.values.reals(component, replaced.rows.len(), normalized);
            if let Some(at) = odd {
                return Err(refuse(replaced.rows[at]));
            }
            for (&row, value) in replaced.rows.iter().zip(values) {
                rows[row] = value;
            }
        }
        Ok(rows)
    }

    /// The rows of an accessor as unsigned integers of at most 32 bits.
    pub(super) fn gather_uint<const N: usize>(
        &self,
        accessor: &Accessor<'_>,
    ) -> Result<Vec<[u32; N]>, IoError> {
        let refuse = || {
            let found =
                format!("componentType {}, signed, float or normalized", accessor.component.as_gl_enum());
            self.invalid(accessor.name(), found, "5121, 5123 or 5125")
        };
        let signed =
            [ComponentType::I8, ComponentType::I16, ComponentType::F32].contains(&accessor.component);
        if signed || accessor.json.normalized {
            return Err(refuse());
        }
        self.prepare(accessor, N, size_of::<[u32; N]>())?;
        let mut rows = match &accessor.base {
            Some(base) => base.uints(accessor.component, accessor.count).ok_or_else(refuse)?,
            None => vec![[0; N]; accessor.count],
        };
        if let Some(replaced) = &accessor.replaced {
            let values = replaced.values.uints(accessor.component, replaced.rows.len()).ok_or_else(refuse)?;
            for (&row, value) in replaced.rows.iter().zip(values) {
                rows[row] = value;
            }
        }
        Ok(rows)
    }

    /// Checks the number of components, and takes the memory of the rows from the budget.
    fn prepare(&self, accessor: &Accessor<'_>, components: usize, size: usize) -> Result<(), IoError> {
        let wanted = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][components];
        let kind = kind_name(accessor.kind);
        if kind != wanted {
            return Err(self.invalid(accessor.name(), format!("type {kind}"), wanted));
        }
        self.reserve(&accessor.name(), accessor.count, size)
    }
}
