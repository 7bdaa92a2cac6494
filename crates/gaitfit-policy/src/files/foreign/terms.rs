//! Observation terms of Isaac Lab and its relatives that are not read.

use crate::Quantity;

/// What to say of a term without a quantity.
pub(super) fn unknown(name: &str) -> String {
    let known = Quantity::ALL.iter().filter_map(|quantity| quantity.foreign().last().copied());
    let known: Vec<&str> = known.filter(|name| Quantity::from_foreign(name).is_some()).collect();
    format!(
        "it observes `{}`, which gaitfit does not know. It knows {} of a velocity task",
        gaitfit_model::shown(name),
        known.join(", ")
    )
}
