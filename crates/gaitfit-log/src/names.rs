//! Lists of names in messages.

use gaitfit_model::{listed, shown};

/// Max number of names of a list.
const MAX_NAMES: usize = 12;

/// The names, each safe and short; of a long list the first twelve and how many more there are.
pub(crate) fn names<'a>(names: impl Iterator<Item = &'a str>) -> String {
    listed(names.map(shown), MAX_NAMES)
}
