//! Numbers, lists and lengths as text in sentences about a skin.

use std::fmt;

use crate::id::VertexId;

/// A number of things, with the words for one and for several.
pub(crate) fn count(number: usize, one: &str, several: &str) -> String {
    format!("{number} {}", if number == 1 { one } else { several })
}

/// The phrase for coincident taxels, up to `distance` (m) apart.
pub(super) fn coincident(taxels: usize, distance: f64) -> String {
    let near = if distance > 0.0 { format!(" (up to {distance:.1e} m from it)") } else { String::new() };
    format!("{} at the position of another one{near}", count(taxels, "taxel lies", "taxels lie"))
}

/// The sentence about a skin whose size (m) is implausible in metres.
pub(super) fn doubtful_unit(extent: f64) -> String {
    let across = if extent < 1e5 { format!("{extent:.0}") } else { format!("{extent:.0e}") };
    if extent < 1.0 {
        return format!("it is {} across: is the file in metres, but read in another unit?", length(extent));
    }
    format!(
        "it is {across} m across: is the file in millimetres? Lengths are read as metres, so divide them by 1000"
    )
}

/// A length in m, in mm where that is readable.
pub(super) fn length(metres: f64) -> String {
    if (1e-6..1e3).contains(&metres) { format!("{:.3} mm", 1e3 * metres) } else { format!("{metres:.3e} m") }
}

/// `1-5, 5-9 and 4 more`: the first few edges of a list.
pub(super) fn edge_list(edges: &[[VertexId; 2]]) -> String {
    first_few(&edges.iter().map(|[a, b]| format!("{a}-{b}")).collect::<Vec<_>>())
}

/// `1, 5, 9 and 4 more`: the first few of a list.
pub(crate) fn first_few<T: fmt::Display>(items: &[T]) -> String {
    /// Enough to find them in the file, and no more than fits on a line of a terminal.
    const SHOWN: usize = 8;
    let shown: Vec<String> = items.iter().take(SHOWN).map(ToString::to_string).collect();
    let rest = items.len() - shown.len();
    if rest == 0 { shown.join(", ") } else { format!("{} and {rest} more", shown.join(", ")) }
}
