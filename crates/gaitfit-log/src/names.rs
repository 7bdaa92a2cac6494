//! Lists of names in messages.

use gaitfit_model::shown;

/// Max number of names of a list.
const MAX_NAMES: usize = 12;

/// The names, each safe and short; of a long list the first twelve and how many more there are.
pub(crate) fn names<'a>(mut names: impl Iterator<Item = &'a str>) -> String {
    let first: Vec<String> = names.by_ref().take(MAX_NAMES).map(shown).collect();
    let text = first.join(", ");
    match names.count() {
        0 => text,
        more => format!("{text} and {more} more"),
    }
}
