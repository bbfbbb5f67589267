//! Decoding: rows of checked accessors become vectors.

use std::array;

use crate::io::{
    IoError,
    gltf::{
        accessor::{Accessor, Component, Rows},
        document::Document,
    },
};

/// A number as it lies in a buffer.
trait Number: Copy {
    const SIZE: usize;
    /// What 1 is stored as when normalized.
    const ONE: f64;
    fn read(bytes: &[u8]) -> f64;
}

macro_rules! number {
    ($type:ty, $one:expr, $($at:literal)+) => {
        impl Number for $type {
            const SIZE: usize = size_of::<$type>();
            const ONE: f64 = $one;
            #[inline]
            fn read(bytes: &[u8]) -> f64 {
                f64::from(<$type>::from_le_bytes([$(bytes[$at]),+]))
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
    /// `count` rows of `N` components, each through `convert`; and the first row that is not finite.
    fn convert<C: Number, const N: usize, T>(
        &self,
        count: usize,
        normalized: bool,
        convert: &impl Fn([f64; N]) -> T,
    ) -> (Vec<T>, Option<usize>) {
        let divisor = if normalized { C::ONE } else { 1.0 };
        // The smallest signed integer would come out below -1.
        let floor = if normalized { -1.0 } else { f64::NEG_INFINITY };
        let mut odd = None;
        let rows = (0..count)
            .map(|i| {
                let row = &self.bytes[i * self.stride..][..N * C::SIZE];
                let row = array::from_fn(|k| {
                    let x = C::read(&row[k * C::SIZE..][..C::SIZE]) / divisor;
                    if x < floor { floor } else { x }
                });
                if odd.is_none() && !row.iter().all(|x: &f64| x.is_finite()) {
                    odd = Some(i);
                }
                convert(row)
            })
            .collect();
        (rows, odd)
    }

    /// The same for the component type `component`.
    fn read<const N: usize, T>(
        &self,
        component: Component,
        count: usize,
        normalized: bool,
        convert: &impl Fn([f64; N]) -> T,
    ) -> (Vec<T>, Option<usize>) {
        match component {
            Component::I8 => self.convert::<i8, N, T>(count, normalized, convert),
            Component::U8 => self.convert::<u8, N, T>(count, normalized, convert),
            Component::I16 => self.convert::<i16, N, T>(count, normalized, convert),
            Component::U16 => self.convert::<u16, N, T>(count, normalized, convert),
            Component::U32 => self.convert::<u32, N, T>(count, normalized, convert),
            Component::F32 => self.convert::<f32, N, T>(count, normalized, convert),
        }
    }

    /// `count` unsigned integers.
    pub(super) fn whole(&self, component: Component, count: usize) -> Vec<usize> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "unsigned integers of at most 32 bits, exact in f64"
        )]
        let convert = |[x]: [f64; 1]| x as usize;
        self.read(component, count, false, &convert).0
    }
}

impl Document {
    /// All rows of an accessor, each through `convert`. Normalized integers arrive between -1 and 1.
    ///
    /// The accessor must have rows of `N` components, and no component may be NaN or infinite.
    pub(super) fn gather<const N: usize, T: Clone>(
        &self,
        accessor: &Accessor<'_>,
        convert: impl Fn([f64; N]) -> T,
    ) -> Result<Vec<T>, IoError> {
        let wanted = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        if accessor.json.kind != wanted {
            return Err(self.invalid(accessor.name(), format!("type {}", accessor.json.kind), wanted));
        }
        self.reserve(&accessor.name(), accessor.count, size_of::<T>())?;
        let (component, normalized) = (accessor.component, accessor.json.normalized);
        let refuse = |row: usize| {
            self.invalid(accessor.name(), format!("NaN or infinity in row {row}"), "finite numbers")
        };
        let (mut rows, odd) = match &accessor.base {
            Some(base) => base.read(component, accessor.count, normalized, &convert),
            None => (vec![convert([0.0; N]); accessor.count], None),
        };
        if let Some(row) = odd {
            return Err(refuse(row));
        }
        if let Some(replaced) = &accessor.replaced {
            let (values, odd) = replaced.values.read(component, replaced.rows.len(), normalized, &convert);
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
    pub(super) fn gather_whole<const N: usize>(
        &self,
        accessor: &Accessor<'_>,
    ) -> Result<Vec<[u32; N]>, IoError> {
        if matches!(accessor.component, Component::I8 | Component::I16 | Component::F32)
            || accessor.json.normalized
        {
            let found =
                format!("componentType {}, signed, float or normalized", accessor.json.component_type);
            return Err(self.invalid(accessor.name(), found, "5121, 5123 or 5125"));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "unsigned integers of at most 32 bits, exact in f64"
        )]
        let convert = |row: [f64; N]| row.map(|x| x as u32);
        self.gather(accessor, convert)
    }
}
