//! One cost's fit as pages show it: its parameters and how the search found them.

use super::Fit;
use super::parameters::{self, ParameterTable};
use super::runs::{self, Level, Runs};
use crate::chart::Look;
use crate::format::clean;
use serde::Serialize;

/// Fits shown at most.
const MOST_FITS: usize = 6;

/// A fit as the template sees it.
#[derive(Serialize)]
pub(crate) struct FitView {
    name: String,
    pub parameters: Option<ParameterTable>,
    pub runs: Option<Runs>,
}

/// The first fits in full.
pub(crate) fn build(fits: &[Fit]) -> Vec<FitView> {
    fits.iter().take(MOST_FITS).map(view).collect()
}

fn view(fit: &Fit) -> FitView {
    let levels = [
        Level { text: "nominal simulator", look: Look::NOMINAL, cost: fit.nominal_cost },
        Level { text: "as low as it gets", look: Look::FLOOR, cost: fit.floor_cost },
    ];
    FitView {
        name: match (fit.name.is_empty(), fit.cost_name.is_empty()) {
            (false, _) => clean(&fit.name),
            (true, false) => format!("Cost {}", clean(&fit.cost_name)),
            (true, true) => String::new(),
        },
        parameters: parameters::build(&fit.parameters),
        runs: runs::build(&fit.runs, &fit.cost_unit, &levels),
    }
}
