//! Accessors: typed rows in a view of a buffer, checked against the bytes that are really there,
//! then decoded.
//!
//! The readers of the crate are not used: they read no quantized positions and no attributes of
//! other programs, and its iterators of rows, which do, take 1.7 times as long for a million
//! triangles.

use gltf::accessor::sparse::{IndexType, Sparse};
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer::View;

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::gltf::document::Document;
use crate::io::gltf::json::check;

/// An accessor whose rows lie within the bytes that are there.
pub(super) struct Accessor<'a> {
    document: &'a Document,
    pub(super) gltf: gltf::Accessor<'a>,
    /// `None`: zeros.
    base: Option<Bytes<'a>>,
    /// Rows that replace others: strictly increasing numbers below the count, and as many values.
    replaced: Option<(Vec<usize>, Bytes<'a>)>,
}

/// Rows `stride` bytes apart; the last one is known to end inside `bytes`.
#[derive(Clone, Copy)]
struct Bytes<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl Bytes<'_> {
    /// Row `i`, component by component through `convert`.
    #[inline]
    fn read<const B: usize, T>(self, i: usize, row: &mut [T], mut convert: impl FnMut([u8; B]) -> T) {
        let (components, _) = self.bytes[i * self.stride..][..row.len() * B].as_chunks();
        for (x, &component) in row.iter_mut().zip(components) {
            *x = convert(component);
        }
    }
}

impl Document {
    /// Accessor `index`, wanted by `asked_by`, checked against the bytes that are really there.
    pub(super) fn accessor(&self, index: usize, asked_by: &str) -> Result<Accessor<'_>> {
        let gltf = self.gltf.accessors().nth(index).ok_or_else(|| {
            let needed = format!("one of the file's {}", self.gltf.accessors().len());
            self.invalid(asked_by, format!("accessor {index}"), needed)
        })?;
        // The crate's accessors look views and buffers up and panic where there are none.
        let root = self.root();
        let json = &root.accessors[index];
        check(self, root, ("accessors", index), json)?;
        let sparse = json.sparse.iter().flat_map(|s| [s.indices.buffer_view, s.values.buffer_view]);
        for view in json.buffer_view.into_iter().chain(sparse) {
            check(self, root, ("bufferViews", view.value()), &root.buffer_views[view.value()])?;
        }
        let mut accessor = Accessor { document: self, gltf, base: None, replaced: None };
        accessor.load()?;
        Ok(accessor)
    }
}

/// Rows of components in a view, from an offset on.
struct AccessorRows<'a> {
    element: String,
    view: View<'a>,
    offset: usize,
    /// Bytes of a row.
    size: usize,
    count: usize,
}

impl<'a> Accessor<'a> {
    pub(super) fn name(&self) -> String {
        format!("accessor {}", self.gltf.index())
    }

    pub(super) fn invalid(&self, found: impl Into<String>, needed: impl Into<String>) -> IoError {
        self.document.invalid(self.name(), found, needed)
    }

    /// Whether it stands for zeros alone.
    pub(super) fn is_blank(&self) -> bool {
        self.base.is_none() && self.replaced.is_none()
    }

    fn load(&mut self) -> Result<()> {
        let gltf = &self.gltf;
        if gltf.count() == 0 {
            return Err(self.invalid("count 0", "at least 1"));
        }
        let size = row_size(gltf);
        if let Some(view) = gltf.view() {
            let (element, offset, count) = (self.name(), gltf.offset(), gltf.count());
            self.base = Some(self.load_rows(&AccessorRows { element, view, offset, size, count })?);
        }
        self.replaced = gltf.sparse().map(|sparse| self.load_sparse(&sparse, size)).transpose()?;
        Ok(())
    }

    /// Checks that rows lie within the bytes that are there. Returns their bytes.
    fn load_rows(&self, rows: &AccessorRows<'a>) -> Result<Bytes<'a>> {
        let AccessorRows { element, view, offset, size, count } = rows;
        let (document, offset) = (self.document, *offset);
        let buffer = document.buffer(view.buffer().index())?;
        let (start, length) = (view.offset(), view.length());
        let end = start.checked_add(length).filter(|&end| end <= buffer.len());
        let bytes = end.map(|end| &buffer[start..end]).ok_or_else(|| {
            let needed = format!("a range of buffer {}, byteLength {}", view.buffer().index(), buffer.len());
            let found = format!("{length} bytes from byte {start} on");
            document.invalid(format!("bufferView {}", view.index()), found, needed)
        })?;
        let stride = view.stride().unwrap_or(*size);
        if stride < *size {
            let found = format!("byteStride {stride}, used by {element}");
            let needed = format!("at least the {size} bytes of a row");
            return Err(document.invalid(format!("bufferView {}", view.index()), found, needed));
        }
        let last = (count - 1).checked_mul(stride).and_then(|last| last.checked_add(*size));
        let end = last.and_then(|last| last.checked_add(offset)).filter(|&end| end <= bytes.len());
        end.map(|end| Bytes { bytes: &bytes[offset..end], stride }).ok_or_else(|| {
            let found = format!("{count} rows, {stride} bytes apart, from byte {offset} on");
            let needed = format!("rows inside bufferView {}, byteLength {length}", view.index());
            document.invalid(element, found, needed)
        })
    }

    /// The numbers of the rows that are replaced, and their values.
    fn load_sparse(&self, sparse: &Sparse<'a>, size: usize) -> Result<(Vec<usize>, Bytes<'a>)> {
        let (count, total) = (sparse.count(), self.gltf.count());
        let element = format!("{} sparse", self.name());
        if count == 0 || count > total {
            return Err(self.document.invalid(element, format!("count {count}"), format!("1 to {total}")));
        }
        let (indices, values) = (sparse.indices(), sparse.values());
        let (view, offset) = (values.view(), values.offset());
        let values = AccessorRows { element: element.clone(), view, offset, size, count };
        let values = self.load_rows(&values)?;
        let kind = indices.index_type();
        let (view, offset, size) = (indices.view(), indices.offset(), kind.size());
        let rows = AccessorRows { element: element.clone(), view, offset, size, count };
        let numbers = self.load_rows(&rows)?;
        self.document.reserve(&element, count, size_of::<usize>())?;
        let mut rows = vec![0; count];
        for (i, row) in rows.chunks_exact_mut(1).enumerate() {
            match kind {
                IndexType::U8 => numbers.read(i, row, |x| u8::from_le_bytes(x).into()),
                IndexType::U16 => numbers.read(i, row, |x| u16::from_le_bytes(x).into()),
                IndexType::U32 => numbers.read(i, row, |x| u32::from_le_bytes(x) as usize),
            }
        }
        if let Some(at) = (0..count).find(|&i| rows[i] >= total || (i > 0 && rows[i] <= rows[i - 1])) {
            let found = format!("index {} at row {at}", rows[at]);
            let needed = format!("strictly increasing indices below {total}");
            return Err(self.document.invalid(element, found, needed));
        }
        Ok((rows, values))
    }

    /// All rows as finite numbers through `build`; normalized integers arrive between -1 and 1.
    pub(super) fn reals<const N: usize, T>(&self, build: impl Fn([f64; N]) -> T) -> Result<Vec<T>> {
        // In place: a row has the size of what it becomes.
        Ok(self.real_rows()?.into_iter().map(build).collect())
    }

    fn real_rows<const N: usize>(&self) -> Result<Vec<[f64; N]>> {
        let is_normalized = self.gltf.normalized() && self.gltf.data_type() != DataType::F32;
        // The smallest signed integer would come out below -1.
        let scaled = |x: f64, one: f64| if is_normalized { (x / one).max(-1.0) } else { x };
        let mut is_finite = true;
        let rows = match self.gltf.data_type() {
            DataType::I8 => self.rows(|x| scaled(i8::from_le_bytes(x).into(), 127.0)),
            DataType::U8 => self.rows(|x| scaled(u8::from_le_bytes(x).into(), 255.0)),
            DataType::I16 => self.rows(|x| scaled(i16::from_le_bytes(x).into(), 32767.0)),
            DataType::U16 => self.rows(|x| scaled(u16::from_le_bytes(x).into(), 65535.0)),
            DataType::U32 => self.rows(|x| u32::from_le_bytes(x).into()),
            DataType::F32 => self.rows(|x| {
                let x = f32::from_le_bytes(x);
                is_finite &= x.is_finite();
                x.into()
            }),
        }?;
        let odd = |row: &[f64; N]| !row.iter().all(|x| x.is_finite());
        // A row that is not finite may have been replaced.
        if !is_finite && let Some(row) = rows.iter().position(odd) {
            return Err(self.invalid(format!("NaN or infinity in row {row}"), "finite numbers"));
        }
        Ok(rows)
    }

    /// All rows as unsigned integers of at most 32 bits.
    pub(super) fn integers<const N: usize>(&self) -> Result<Vec<[u32; N]>> {
        match self.gltf.data_type() {
            _ if self.gltf.normalized() => Err(self.invalid("normalized integers", "integers as they are")),
            DataType::U8 => self.rows(|x| u8::from_le_bytes(x).into()),
            DataType::U16 => self.rows(|x| u16::from_le_bytes(x).into()),
            DataType::U32 => self.rows(u32::from_le_bytes),
            other => {
                let found = format!("componentType {}, signed or float", other.as_gl_enum());
                Err(self.invalid(found, "5121, 5123 or 5125"))
            }
        }
    }

    /// All rows, component by component through `convert`, which takes zeros to the default; their
    /// length and memory are checked first.
    fn rows<const B: usize, const N: usize, T: Copy + Default>(
        &self,
        mut convert: impl FnMut([u8; B]) -> T,
    ) -> Result<Vec<[T; N]>> {
        let kind = self.gltf.dimensions();
        let wanted = [Dimensions::Scalar, Dimensions::Vec2, Dimensions::Vec3, Dimensions::Vec4];
        let wanted = wanted.get(N - 1).copied().unwrap_or(Dimensions::Mat4);
        if kind != wanted {
            return Err(self.invalid(format!("type {}", kind_name(kind)), kind_name(wanted)));
        }
        let count = self.gltf.count();
        self.document.reserve(&self.name(), count, size_of::<[T; N]>())?;
        let mut rows = vec![[T::default(); N]; count];
        if let Some(base) = self.base {
            for (i, row) in rows.iter_mut().enumerate() {
                base.read(i, row, &mut convert);
            }
        }
        if let Some((places, values)) = &self.replaced {
            for (i, &row) in places.iter().enumerate() {
                values.read(i, &mut rows[row], &mut convert);
            }
        }
        Ok(rows)
    }
}

/// The name of a type in a file.
fn kind_name(kind: Dimensions) -> String {
    format!("{kind:?}").to_uppercase()
}

/// Bytes of a row; columns of a matrix start at multiples of four bytes.
fn row_size(accessor: &gltf::Accessor<'_>) -> usize {
    let columns = match accessor.dimensions() {
        Dimensions::Mat2 => 2,
        Dimensions::Mat3 => 3,
        Dimensions::Mat4 => 4,
        _ => return accessor.size(),
    };
    columns * (columns * accessor.data_type().size()).next_multiple_of(4)
}
