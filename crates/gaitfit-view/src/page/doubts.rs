//! The first thing a page says when its result is in doubt.

use crate::Doubt;
use crate::format::clean_prose;
use serde::Serialize;

/// Doubts a page shows at most.
const MAX_DOUBTS: usize = 12;

/// A doubt as the template sees it.
#[derive(Serialize)]
pub(crate) struct ShownDoubt {
    headline: &'static str,
    text: String,
    details: String,
    severe: bool,
}

/// The doubts, the worst first.
pub(crate) fn doubts(list: &[Doubt]) -> Vec<ShownDoubt> {
    let mut sorted: Vec<&Doubt> = list.iter().collect();
    sorted.sort_by_key(|doubt| doubt.kind);
    // After sorting, so that the least serious ones are cut.
    sorted.truncate(MAX_DOUBTS);
    let shown = |doubt: &Doubt| ShownDoubt {
        headline: doubt.kind.headline(),
        text: if doubt.text.is_empty() { doubt.kind.meaning().to_string() } else { clean_prose(&doubt.text) },
        details: clean_prose(&doubt.details),
        severe: doubt.kind.is_severe(),
    };
    sorted.into_iter().map(shown).collect()
}

/// Whether any doubt leaves nothing to praise.
pub(crate) fn is_severe(list: &[Doubt]) -> bool {
    list.iter().any(|doubt| doubt.kind.is_severe())
}
