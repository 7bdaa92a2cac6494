//! One cost's fit as pages show it: its parameters and how the search found them.

use super::Fit;
use super::parameters::{self, ParameterTable};
use super::runs::{self, Runs};
use crate::format::clean;
use serde::Serialize;

/// Fits shown at most.
const MAX_FITS: usize = 6;

/// A fit as the template sees it.
#[derive(Serialize)]
pub(crate) struct FitView {
    name: String,
    pub parameters: Option<ParameterTable>,
    pub runs: Option<Runs>,
}

/// The first fits in full.
pub(crate) fn build(fits: &[Fit]) -> Vec<FitView> {
    fits.iter().take(MAX_FITS).map(view).collect()
}

fn view(fit: &Fit) -> FitView {
    let name =
        if fit.cost_name.is_empty() { String::new() } else { format!("Cost {}", clean(&fit.cost_name)) };
    FitView {
        name,
        parameters: parameters::build(&fit.parameters),
        runs: runs::build(&fit.runs, fit.nominal_cost),
    }
}
