use crate::io::{
    IoError,
    gltf::{
        document::Document,
        schema::{self, Whole},
    },
};

/// Type of a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: Whole) -> Option<Self> {
        Some(match code.0 {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    /// Bytes of one component.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// Number of components of a row, by the name of its type; matrices are stored by columns.
fn shape(kind: &str) -> Option<(usize, usize)> {
    Some(match kind {
        "SCALAR" => (1, 1),
        "VEC2" => (1, 2),
        "VEC3" => (1, 3),
        "VEC4" => (1, 4),
        "MAT2" => (2, 2),
        "MAT3" => (3, 3),
        "MAT4" => (4, 4),
        _ => return None,
    })
}

/// What an accessor is read for; a view may serve one role only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// One row per vertex.
    Vertex,
    /// Corners of triangles.
    Index,
    /// Anything else.
    Plain,
}

/// What a view has been used for so far.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewUse {
    role: Role,
    accessor: usize,
}

/// Rows `stride` bytes apart; the last one is known to end inside `bytes`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) stride: usize,
}

/// Rows that replace others: strictly increasing numbers below the accessor's count, and as many values.
#[derive(Debug, Clone)]
pub(super) struct Replaced<'a> {
    pub(super) rows: Vec<usize>,
    pub(super) values: Rows<'a>,
}

/// An accessor that keeps every rule of glTF 2.0 about types, counts, offsets, strides and lengths.
///
/// Its rows are read in `gather.rs`.
#[derive(Debug, Clone)]
pub(super) struct Accessor<'a> {
    /// Its number in the document.
    pub(super) index: usize,
    pub(super) json: &'a schema::Accessor,
    pub(super) component: Component,
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
    /// Accessor `index`, wanted by `asked_by` in the role `role`, checked against the bytes that are really there.
    pub(super) fn accessor(&self, index: Whole, role: Role, asked_by: &str) -> Result<Accessor<'_>, IoError> {
        let json = self.get(&self.json.accessors, index, "accessor", || asked_by.into())?;
        let element = format!("accessor {index}");
        let component = Component::from_code(json.component_type).ok_or_else(|| {
            let found = format!("componentType {}", json.component_type);
            self.invalid(&element, found, "5120, 5121, 5122, 5123, 5125 or 5126")
        })?;
        let Some((columns, rows)) = shape(&json.kind) else {
            return Err(self.invalid(
                element,
                format!("type {:?}", json.kind),
                "SCALAR, VEC2 to VEC4, MAT2 to MAT4",
            ));
        };
        if json.normalized && matches!(component, Component::F32 | Component::U32) {
            return Err(self.invalid(element, "normalized floats or 32-bit integers", "8 or 16 bits"));
        }
        let count = json.count.index();
        if count == 0 {
            return Err(self.invalid(element, "count 0", "at least 1"));
        }
        if json.extensions.contains_key(super::document::QUANTIZATION) {
            let found = "a KHR_mesh_quantization object";
            return Err(self.invalid(element, found, "none: it is declared at the top only"));
        }
        // Columns of a matrix start at multiples of four bytes.
        let column = rows * component.size();
        let size = if columns == 1 { column } else { columns * column.next_multiple_of(4) };
        let base = match (json.buffer_view, json.byte_offset) {
            (Some(view), offset) => {
                let view =
                    ViewAsked { view, offset: offset.unwrap_or_default(), role, accessor: index.index() };
                Some(self.rows(&element, view, component, size, count)?)
            }
            (None, None) => None,
            (None, Some(_)) => {
                return Err(self.invalid(element, "byteOffset without bufferView", "both or neither"));
            }
        };
        let mut accessor = Accessor { index: index.index(), json, component, count, base, replaced: None };
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
        component: Component,
        size: usize,
        count: usize,
    ) -> Result<Rows<'_>, IoError> {
        let bytes = self.view_bytes(element, asked.view)?;
        let view = &self.json.buffer_views[asked.view.index()];
        let stride = self.check_view_use(element, &asked, view, size)?;
        let offset = asked.offset.index();
        let align = if asked.role == Role::Vertex { 4 } else { component.size() };
        if !offset.is_multiple_of(align) || !stride.is_multiple_of(align) {
            let found = format!("byteOffset {offset} and rows {stride} bytes apart");
            return Err(self.invalid(element, found, format!("multiples of {align}")));
        }
        if !(view.byte_offset.0 % 4).wrapping_add(asked.offset.0 % 4).is_multiple_of(component.size() as u64)
        {
            let found = format!("offset {} of its view plus its own {offset}", view.byte_offset);
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
    fn view_bytes(&self, element: &str, index: Whole) -> Result<&[u8], IoError> {
        let view = self.get(&self.json.buffer_views, index, "bufferView", || element.into())?;
        let name = format!("bufferView {index}");
        let bytes = self.buffer(view.buffer, &name)?;
        let (start, length) = (view.byte_offset.index(), view.byte_length.index());
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

    /// Checks stride and target of a view against the role it is used in, and that it has one role only. Returns the
    /// distance of its rows.
    fn check_view_use(
        &self,
        element: &str,
        asked: &ViewAsked,
        view: &schema::BufferView,
        size: usize,
    ) -> Result<usize, IoError> {
        const VERTICES: u64 = 34962;
        const INDICES: u64 = 34963;
        let name = || format!("bufferView {}", asked.view);
        if let Some(target) = view.target {
            let fits = match asked.role {
                Role::Vertex => target.0 == VERTICES,
                Role::Index => target.0 == INDICES,
                Role::Plain => target.0 == VERTICES || target.0 == INDICES,
            };
            if !fits {
                let needed = format!("{VERTICES} for attributes, {INDICES} for indices");
                return Err(self.invalid(name(), format!("target {target}, used by {element}"), needed));
            }
        }
        if let Some(stride) = view.byte_stride {
            if asked.role != Role::Vertex || view.target.is_some_and(|t| t.0 != VERTICES) {
                return Err(self.invalid(name(), "byteStride", "no byteStride but for vertex attributes"));
            }
            if !(4..=252).contains(&stride.0) || !stride.0.is_multiple_of(4) || stride.index() < size {
                let needed = format!(
                    "a multiple of 4, at most 252 and at least the {size} bytes of a row of {element}"
                );
                return Err(self.invalid(name(), format!("byteStride {stride}"), needed));
            }
        }
        let mut views = self.views.borrow_mut();
        let used = ViewUse { role: asked.role, accessor: asked.accessor };
        let first = *views.entry(asked.view.index()).or_insert(used);
        if first.role != asked.role {
            let found = format!("used by accessor {} and {element} for different purposes", first.accessor);
            return Err(self.invalid(name(), found, "either vertex attributes or indices or other data"));
        }
        if asked.role == Role::Vertex && first.accessor != asked.accessor && view.byte_stride.is_none() {
            let found = format!("no byteStride, used by accessor {} and {element}", first.accessor);
            return Err(self.invalid(name(), found, "a byteStride where several attributes share a view"));
        }
        Ok(view.byte_stride.map_or(size, Whole::index))
    }

    /// The rows that a sparse accessor replaces.
    fn replaced<'a>(
        &'a self,
        accessor: &Accessor<'_>,
        sparse: &schema::Sparse,
        size: usize,
    ) -> Result<Replaced<'a>, IoError> {
        let element = format!("{} sparse", accessor.name());
        let count = sparse.count.index();
        if count == 0 || count > accessor.count {
            let needed = format!("1 to {}", accessor.count);
            return Err(self.invalid(element, format!("count {count}"), needed));
        }
        let component = match Component::from_code(sparse.indices.component_type) {
            Some(c @ (Component::U8 | Component::U16 | Component::U32)) => c,
            _ => {
                let found = format!("indices of componentType {}", sparse.indices.component_type);
                return Err(self.invalid(element, found, "5121, 5123 or 5125"));
            }
        };
        let asked = |view: Whole, offset: Whole| ViewAsked {
            view,
            offset,
            role: Role::Plain,
            accessor: accessor.index,
        };
        let (indices, values) = (&sparse.indices, &sparse.values);
        let numbers = self.rows(
            &element,
            asked(indices.buffer_view, indices.byte_offset),
            component,
            component.size(),
            count,
        )?;
        let values = self.rows(
            &element,
            asked(values.buffer_view, values.byte_offset),
            accessor.component,
            size,
            count,
        )?;
        self.reserve(&element, count, size_of::<usize>())?;
        let rows = numbers.whole(component, count);
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
    view: Whole,
    offset: Whole,
    role: Role,
    accessor: usize,
}
