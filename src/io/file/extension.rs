use std::path::Path;

/// The kind of a file: its extension in lower case, empty without one.
#[must_use]
pub fn kind(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
