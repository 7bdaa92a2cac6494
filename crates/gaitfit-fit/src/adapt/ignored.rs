//! Settings of CMA-ES that a fit by least squares does not look at.

use super::setup::Setup;
use crate::settings::{AdaptConfig, OptimizerConfig};

/// One sentence that names the settings which were changed in vain; `None` if a cost of the fit is searched by CMA-ES.
pub(super) fn ignored(setup: &Setup) -> Option<String> {
    let least_squares = |cost: &dyn gaitfit_adapt::cost::Cost| {
        setup.options.method.least_squares(cost, &setup.theta).unwrap_or(false)
    };
    if !setup.costs.iter().all(|cost| least_squares(cost.as_ref())) {
        return None;
    }
    let names = changed(&setup.config);
    (!names.is_empty()).then(|| {
        format!(
            "the search is least squares, which ignores {}; optimizer.method = \"cma-es\" uses them",
            names.join(", ")
        )
    })
}

/// Settings of CMA-ES that are not the defaults.
fn changed(config: &AdaptConfig) -> Vec<&'static str> {
    let (chosen, default) = (&config.optimizer, OptimizerConfig::default());
    // Generations, seeds and tolerance count for both searches, so they are not in this list.
    let settings = [
        ("optimizer.population", chosen.population != default.population),
        ("optimizer.patience", chosen.patience != default.patience),
        ("optimizer.restarts", chosen.restarts != default.restarts),
        ("optimizer.covariance", chosen.covariance != default.covariance),
        ("optimizer.bounds", chosen.bounds != default.bounds),
        ("optimizer.random_numbers", chosen.random_numbers != default.random_numbers),
        ("falls.penalty", config.falls.penalty.is_some()),
    ];
    settings.into_iter().filter_map(|(name, changed)| changed.then_some(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_the_other_search_are_named() {
        let mut config = AdaptConfig::default();
        config.optimizer.generations = 7;
        config.optimizer.seeds = 1;
        assert!(changed(&config).is_empty(), "least squares takes these");
        config.optimizer.population = 20;
        config.falls.penalty = Some(1.0);
        assert_eq!(changed(&config), ["optimizer.population", "falls.penalty"]);
    }
}
