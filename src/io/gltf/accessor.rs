//! Accessors: typed rows in a view of a buffer, checked against the bytes that are really there,
//! then decoded.
//!
//! The readers of the crate are not used: they know no quantized positions and no attributes of
//! other programs, and its iterators of rows, which do, take 1.7 times as long for a million
//! triangles.

use gltf::{
    accessor::{
        DataType, Dimensions,
        sparse::{IndexType, Sparse},
    },
    buffer::View,
    json::buffer::{MAX_BYTE_STRIDE, MIN_BYTE_STRIDE, Target},
};

use crate::io::{
    IoError,
    error::Result,
    gltf::document::{Document, QUANTIZATION, Role},
};

/// An accessor that keeps every rule of glTF 2.0 about types, counts, offsets, strides and lengths.
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
    pub(super) fn accessor(&self, index: usize, role: Role, asked_by: &str) -> Result<Accessor<'_>> {
        let gltf = self.gltf.accessors().nth(index).ok_or_else(|| {
            let needed = format!("one of the file's {}", self.gltf.accessors().len());
            self.invalid(asked_by, format!("accessor {index}"), needed)
        })?;
        self.notes.check(self, "accessors", index)?;
        let mut accessor = Accessor { document: self, gltf, base: None, replaced: None };
        accessor.load(role)?;
        Ok(accessor)
    }
}

/// Rows of components in a view, from an offset on.
struct Rows<'a> {
    element: String,
    view: View<'a>,
    offset: usize,
    component: usize,
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

    /// Whether it stands for zeros alone, which the validator does not look at either.
    pub(super) fn is_blank(&self) -> bool {
        self.base.is_none() && self.replaced.is_none()
    }

    fn load(&mut self, role: Role) -> Result<()> {
        let gltf = &self.gltf;
        let component = gltf.data_type();
        if gltf.normalized() && matches!(component, DataType::F32 | DataType::U32) {
            let fault = self.invalid("normalized floats or 32-bit integers", "8 or 16 bits");
            if component == DataType::U32 {
                return Err(fault);
            }
            self.document.notes.pass(fault)?;
        }
        if gltf.count() == 0 {
            return Err(self.invalid("count 0", "at least 1"));
        }
        if gltf.extension_value(QUANTIZATION).is_some() {
            let found = "a KHR_mesh_quantization object";
            self.document.notes.pass(self.invalid(found, "none: it is declared at the top only"))?;
        }
        let (component, size) = (component.size(), row_size(gltf));
        if let Some(view) = gltf.view() {
            let (element, offset, count) = (self.name(), gltf.offset(), gltf.count());
            let rows = Rows { element, view, offset, component, size, count };
            self.base = Some(self.load_rows(role, &rows)?);
        }
        let replaced = gltf.sparse().map(|sparse| self.load_sparse(&sparse, component, size));
        self.replaced = replaced.transpose()?;
        Ok(())
    }

    /// Checks that rows are aligned and lie within the bytes that are there. Returns their bytes.
    fn load_rows(&self, role: Role, rows: &Rows<'a>) -> Result<Bytes<'a>> {
        let Rows { element, view, offset, component, size, count } = rows;
        let (document, offset) = (self.document, *offset);
        document.notes.check(document, "bufferViews", view.index())?;
        let buffer = document.buffer(view.buffer().index())?;
        let (start, length) = (view.offset(), view.length());
        let end = start.checked_add(length).filter(|&end| end <= buffer.len());
        let bytes = end.map(|end| &buffer[start..end]).ok_or_else(|| {
            let needed = format!("a range of buffer {}, byteLength {}", view.buffer().index(), buffer.len());
            let found = format!("{length} bytes from byte {start} on");
            document.invalid(format!("bufferView {}", view.index()), found, needed)
        })?;
        let stride = self.check_view_use(role, rows)?;
        let align = if role == Role::Vertex { 4 } else { *component };
        if !offset.is_multiple_of(align) || !stride.is_multiple_of(align) {
            let found = format!("byteOffset {offset} and rows {stride} bytes apart");
            document.notes.pass(document.invalid(element, found, format!("multiples of {align}")))?;
        }
        if !(start % 4 + offset % 4).is_multiple_of(*component) {
            let found = format!("offset {start} of its view plus its own {offset}");
            document.notes.pass(document.invalid(element, found, format!("a multiple of {component}")))?;
        }
        let last = (count - 1).checked_mul(stride).and_then(|last| last.checked_add(*size));
        let end = last.and_then(|last| last.checked_add(offset)).filter(|&end| end <= bytes.len());
        end.map(|end| Bytes { bytes: &bytes[offset..end], stride }).ok_or_else(|| {
            let found = format!("{count} rows, {stride} bytes apart, from byte {offset} on");
            let needed = format!("rows inside bufferView {}, byteLength {length}", view.index());
            document.invalid(element, found, needed)
        })
    }

    /// The distance of the rows of a view, whose stride and target fit its role, its only one.
    fn check_view_use(&self, role: Role, Rows { element, view, size, .. }: &Rows<'_>) -> Result<usize> {
        let fault = |found: String, needed: &str| {
            self.document.invalid(format!("bufferView {}", view.index()), found, needed)
        };
        let pass = |found, needed: &str| self.document.notes.pass(fault(found, needed));
        let wanted = match role {
            Role::Vertex => Some(Target::ArrayBuffer),
            Role::Index => Some(Target::ElementArrayBuffer),
            Role::Plain => None,
        };
        if let Some(target) = view.target().filter(|target| wanted.is_some_and(|wanted| wanted != *target)) {
            let code = if target == Target::ArrayBuffer { 34962 } else { 34963 };
            let found = format!("target {code}, used by {element}");
            pass(found, "34962 for attributes, 34963 for indices")?;
        }
        // The crate takes a stride of 0 for none.
        let stride = self.document.root().buffer_views[view.index()].byte_stride.map(|stride| stride.0);
        if let Some(stride) = stride {
            if role != Role::Vertex {
                return Err(fault("byteStride".into(), "no byteStride but for vertex attributes"));
            }
            if !(MIN_BYTE_STRIDE..=MAX_BYTE_STRIDE).contains(&stride) || stride % 4 != 0 || stride < *size {
                let row = format!("a multiple of 4, at most 252 and at least the {size} bytes of a row");
                let found = format!("byteStride {stride}, used by {element}");
                if stride < *size {
                    return Err(fault(found, &row));
                }
                pass(found, &row)?;
            }
        }
        let used = (role, self.gltf.index());
        let first = *self.document.views.borrow_mut().entry(view.index()).or_insert(used);
        if first.0 != role {
            let found = format!("used by accessor {} and {element} for different purposes", first.1);
            pass(found, "either vertex attributes or indices or other data")?;
        }
        if role == Role::Vertex && first != used && stride.is_none() {
            let found = format!("no byteStride, used by accessor {} and {element}", first.1);
            pass(found, "a byteStride where several attributes share a view")?;
        }
        Ok(stride.unwrap_or(*size))
    }

    /// The numbers of the rows that are replaced, and their values.
    fn load_sparse(
        &self,
        sparse: &Sparse<'a>,
        component: usize,
        size: usize,
    ) -> Result<(Vec<usize>, Bytes<'a>)> {
        let (count, total) = (sparse.count(), self.gltf.count());
        let element = format!("{} sparse", self.name());
        if count == 0 || count > total {
            return Err(self.document.invalid(element, format!("count {count}"), format!("1 to {total}")));
        }
        let (indices, values) = (sparse.indices(), sparse.values());
        let (view, offset) = (values.view(), values.offset());
        let values = Rows { element: element.clone(), view, offset, component, size, count };
        let values = self.load_rows(Role::Plain, &values)?;
        let kind = indices.index_type();
        let (view, offset, size) = (indices.view(), indices.offset(), kind.size());
        let rows = Rows { element: element.clone(), view, offset, component: size, size, count };
        let numbers = self.load_rows(Role::Plain, &rows)?;
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
            let found = format!("index {} at place {at}", rows[at]);
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
pub(super) fn kind_name(kind: Dimensions) -> String {
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
