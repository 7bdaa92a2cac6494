//! Names of the files of a run, and of the run itself.

use crate::files;
use std::path::Path;

/// All settings of a run.
pub const CONFIG: &str = "config.toml";
/// The result, written last.
pub const RESULT: &str = "result.json";

/// The name of the run in a folder: `walk-2024` may be a run of that name, or run 2024 of `walk`.
pub(super) fn own_name(folder: &Path) -> Option<String> {
    // A file that is missing or damaged gives no name.
    let text = files::read_text(&folder.join(CONFIG), files::MAX_BYTES).unwrap_or_default();
    let settings: toml::Table = toml::from_str(&text).unwrap_or_default();
    settings.get("name").and_then(toml::Value::as_str).map(str::to_owned)
}
