//! Accessors: typed rows in a view of a buffer, checked against the bytes that are really there.

use gltf::json::{
    self,
    accessor::{ComponentType, GenericComponentType, IndexComponentType, Type, sparse::Sparse},
    buffer::{MAX_BYTE_STRIDE, MIN_BYTE_STRIDE, Target, View},
    validation::{Checked, USize64},
};

use crate::io::{
    IoError,
    gltf::document::{Document, QUANTIZATION, Role, ViewUse, position},
};

/// The name of a type in a file.
pub(super) fn kind_name(kind: Type) -> String {
    format!("{kind:?}").to_uppercase()
}

/// Columns of a row, and components of each; matrices are stored by columns.
fn shape(kind: Type) -> (usize, usize) {
    let columns = match kind {
        Type::Scalar | Type::Vec2 | Type::Vec3 | Type::Vec4 => 1,
        Type::Mat2 => 2,
        Type::Mat3 => 3,
        Type::Mat4 => 4,
    };
    (columns, kind.multiplicity() / columns)
}

/// Rows `stride` bytes apart; the last one is known to end inside `bytes`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) stride: usize,
}

/// Rows that replace others: strictly increasing numbers below the accessor's count, and as many
/// values.
#[derive(Debug, Clone)]
pub(super) struct Replaced<'a> {
    pub(super) rows: Vec<usize>,
    pub(super) values: Rows<'a>,
}

/// An accessor that keeps every rule of glTF 2.0 about types, counts, offsets, strides and lengths.
///
/// Its rows are read in `decode.rs`.
#[derive(Debug, Clone)]
pub(super) struct Accessor<'a> {
    /// Its number in the document.
    pub(super) index: usize,
    pub(super) json: &'a json::Accessor,
    pub(super) kind: Type,
    pub(super) component: ComponentType,
    pub(super) count: usize,
    /// `None`: zeros.
    pub(super) base: Option<Rows<'a>>,
    pub(super) replaced: Option<Replaced<'a>>,
}

impl Accessor<'_> {
    /// What it is called in errors.
    pub(super) fn name(&self) -> String {
        format!("accessor {}", self.index)
    }

    /// Whether it stands for zeros alone, which the validator does not look at either.
    pub(super) fn is_blank(&self) -> bool {
        self.base.is_none() && self.replaced.is_none()
    }
}

impl Document {
    /// Accessor `index`, wanted by `asked_by` in the role `role`, checked against the bytes that
    /// are really there.
    pub(super) fn accessor(&self, index: usize, role: Role, asked_by: &str) -> Result<Accessor<'_>, IoError> {
        let all = &self.root.accessors;
        let json = all.get(index).ok_or_else(|| {
            self.invalid(asked_by, format!("accessor {index}"), format!("one of the file's {}", all.len()))
        })?;
        let element = format!("accessor {index}");
        let (Checked::Valid(GenericComponentType(component)), Checked::Valid(kind)) =
            (json.component_type, json.type_)
        else {
            return Err(self.invalid(element, "an unknown type", "a type of glTF 2.0"));
        };
        let (columns, rows) = shape(kind);
        if json.normalized && matches!(component, ComponentType::F32 | ComponentType::U32) {
            return Err(self.invalid(element, "normalized floats or 32-bit integers", "8 or 16 bits"));
        }
        let count = position(json.count);
        if count == 0 {
            return Err(self.invalid(element, "count 0", "at least 1"));
        }
        if json.extensions.as_ref().is_some_and(|e| e.others.contains_key(QUANTIZATION)) {
            let found = "a KHR_mesh_quantization object";
            return Err(self.invalid(element, found, "none: it is declared at the top only"));
        }
        // Columns of a matrix start at multiples of four bytes.
        let column = rows * component.size();
        let size = if columns == 1 { column } else { columns * column.next_multiple_of(4) };
        let base = match (json.buffer_view, json.byte_offset) {
            (Some(view), offset) => {
                let view = ViewAsked {
                    view: view.value(),
                    offset: offset.unwrap_or_default().0,
                    role,
                    accessor: index,
                };
                Some(self.rows(&element, view, component, size, count)?)
            }
            (None, None) => None,
            (None, Some(_)) => {
                return Err(self.invalid(element, "byteOffset without bufferView", "both or neither"));
            }
        };
        let mut accessor = Accessor { index, json, kind, component, count, base, replaced: None };
        if let Some(sparse) = &json.sparse {
            accessor.replaced = Some(self.replaced(&accessor, sparse, size)?);
        }
        Ok(accessor)
    }

    /// The rows of a view, from an offset on.
    fn rows(
        &self,
        element: &str,
        asked: ViewAsked,
        component: ComponentType,
        size: usize,
        count: usize,
    ) -> Result<Rows<'_>, IoError> {
        let bytes = self.view_bytes(asked.view)?;
        let view = &self.root.buffer_views[asked.view];
        let stride = self.check_view_use(element, &asked, view, size)?;
        let offset = usize::try_from(asked.offset).unwrap_or(usize::MAX);
        let align = if asked.role == Role::Vertex { 4 } else { component.size() };
        if !offset.is_multiple_of(align) || !stride.is_multiple_of(align) {
            let found = format!("byteOffset {offset} and rows {stride} bytes apart");
            return Err(self.invalid(element, found, format!("multiples of {align}")));
        }
        let before = view.byte_offset.unwrap_or_default().0;
        if !(before % 4).wrapping_add(asked.offset % 4).is_multiple_of(component.size() as u64) {
            let found = format!("offset {before} of its view plus its own {offset}");
            return Err(self.invalid(element, found, format!("a multiple of {}", component.size())));
        }
        let end = (count - 1)
            .checked_mul(stride)
            .and_then(|last| last.checked_add(size))
            .and_then(|length| length.checked_add(offset));
        if end.is_none_or(|end| end > bytes.len()) {
            let found = format!("{count} rows, {stride} bytes apart, from byte {offset} on");
            let needed = format!("rows inside the {} bytes of bufferView {}", bytes.len(), asked.view);
            return Err(self.invalid(element, found, needed));
        }
        Ok(Rows { bytes: &bytes[offset..], stride })
    }

    /// The bytes of a view.
    fn view_bytes(&self, index: usize) -> Result<&[u8], IoError> {
        let view = &self.root.buffer_views[index];
        let name = format!("bufferView {index}");
        let bytes = self.buffer(view.buffer.value())?;
        let (start, length) = (position(view.byte_offset.unwrap_or_default()), position(view.byte_length));
        if length == 0 {
            return Err(self.invalid(name, "byteLength 0", "at least 1"));
        }
        start.checked_add(length).and_then(|end| bytes.get(start..end)).ok_or_else(|| {
            let found = format!("{length} bytes from byte {start} on");
            self.invalid(
                name,
                found,
                format!("a range of the {} bytes of buffer {}", bytes.len(), view.buffer),
            )
        })
    }

    /// Checks stride and target of a view against the role it is used in, and that it has one role
    /// only. Returns the distance of its rows.
    fn check_view_use(
        &self,
        element: &str,
        asked: &ViewAsked,
        view: &View,
        size: usize,
    ) -> Result<usize, IoError> {
        let name = || format!("bufferView {}", asked.view);
        let target = match view.target {
            Some(Checked::Valid(target)) => Some(target),
            _ => None,
        };
        let wanted = match asked.role {
            Role::Vertex => Some(Target::ArrayBuffer),
            Role::Index => Some(Target::ElementArrayBuffer),
            Role::Plain => None,
        };
        if let (Some(target), Some(wanted)) = (target, wanted)
            && target != wanted
        {
            let code = if target == Target::ArrayBuffer { 34962 } else { 34963 };
            let needed = "34962 for attributes, 34963 for indices";
            return Err(self.invalid(name(), format!("target {code}, used by {element}"), needed));
        }
        let stride = view.byte_stride.map(|stride| stride.0);
        if let Some(stride) = stride {
            if asked.role != Role::Vertex || target == Some(Target::ElementArrayBuffer) {
                return Err(self.invalid(name(), "byteStride", "no byteStride but for vertex attributes"));
            }
            if !(MIN_BYTE_STRIDE..=MAX_BYTE_STRIDE).contains(&stride) || stride % 4 != 0 || stride < size {
                let needed = format!(
                    "a multiple of 4, at most 252 and at least the {size} bytes of a row of {element}"
                );
                return Err(self.invalid(name(), format!("byteStride {stride}"), needed));
            }
        }
        let mut views = self.views.borrow_mut();
        let used = ViewUse { role: asked.role, accessor: asked.accessor };
        let first = *views.entry(asked.view).or_insert(used);
        if first.role != asked.role {
            let found = format!("used by accessor {} and {element} for different purposes", first.accessor);
            return Err(self.invalid(name(), found, "either vertex attributes or indices or other data"));
        }
        if asked.role == Role::Vertex && first.accessor != asked.accessor && stride.is_none() {
            let found = format!("no byteStride, used by accessor {} and {element}", first.accessor);
            return Err(self.invalid(name(), found, "a byteStride where several attributes share a view"));
        }
        Ok(stride.unwrap_or(size))
    }

    /// The rows that a sparse accessor replaces.
    fn replaced<'a>(
        &'a self,
        accessor: &Accessor<'_>,
        sparse: &Sparse,
        size: usize,
    ) -> Result<Replaced<'a>, IoError> {
        let element = format!("{} sparse", accessor.name());
        let count = position(sparse.count);
        if count == 0 || count > accessor.count {
            let needed = format!("1 to {}", accessor.count);
            return Err(self.invalid(element, format!("count {count}"), needed));
        }
        let (indices, values) = (&sparse.indices, &sparse.values);
        let Checked::Valid(IndexComponentType(component)) = indices.component_type else {
            return Err(self.invalid(element, "indices of an unknown type", "5121, 5123 or 5125"));
        };
        let asked = |view: json::Index<View>, offset: USize64| ViewAsked {
            view: view.value(),
            offset: offset.0,
            role: Role::Plain,
            accessor: accessor.index,
        };
        let numbers = asked(indices.buffer_view, indices.byte_offset);
        let numbers = self.rows(&element, numbers, component, component.size(), count)?;
        let values = asked(values.buffer_view, values.byte_offset);
        let values = self.rows(&element, values, accessor.component, size, count)?;
        self.reserve(&element, count, size_of::<usize>())?;
        let rows = numbers.uints::<1>(component, count).unwrap_or_default();
        let rows: Vec<usize> = rows.into_iter().map(|[row]| row as usize).collect();
        if let Some(at) = (0..count).find(|&i| rows[i] >= accessor.count || (i > 0 && rows[i] <= rows[i - 1]))
        {
            let found = format!("index {} at place {at}", rows[at]);
            let needed = format!("strictly increasing indices below {}", accessor.count);
            return Err(self.invalid(element, found, needed));
        }
        Ok(Replaced { rows, values })
    }
}

/// A view, from where on in it, what for, and for which accessor.
#[derive(Debug, Clone, Copy)]
struct ViewAsked {
    view: usize,
    offset: u64,
    role: Role,
    accessor: usize,
}
