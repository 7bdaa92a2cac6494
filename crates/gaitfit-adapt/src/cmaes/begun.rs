//! The settings of a run at its beginning. A state is resumed only with the same settings: with others the search would differ
//! from what the results state.

use super::{BoundHandling, CmaError, Settings};
use crate::checksum::of_numbers;
use serde::{Deserialize, Serialize};

/// The settings that the numbers of a state depend on; vectors as SHA-256. Form and size of the covariance are in the state
/// itself, and when to stop may change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Begun {
    start: String,
    deviation: String,
    bounds: String,
    bound_handling: BoundHandling,
    max_resampling: u32,
    sigma: f64,
    population: usize,
    seed: u64,
}

impl Begun {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            start: of_numbers(&settings.start),
            deviation: of_numbers(&settings.deviation),
            // Both lists have one entry a coordinate, so one sum of the two together is unambiguous.
            bounds: of_numbers(&[settings.lower.as_slice(), &settings.upper].concat()),
            bound_handling: settings.bound_handling,
            max_resampling: settings.max_resampling,
            sigma: settings.sigma,
            population: settings.population,
            seed: settings.seed,
        }
    }

    /// Refuses settings that the run was not begun with.
    ///
    /// # Errors
    /// [`CmaError::State`] that names the first one.
    pub(super) fn check(&self, settings: &Settings) -> Result<(), CmaError> {
        let now = Self::new(settings);
        let differs = if self.start != now.start {
            "it was begun at another start".to_owned()
        } else if self.deviation != now.deviation {
            "it was begun with other deviations".to_owned()
        } else if self.bounds != now.bounds {
            "it was begun with other bounds".to_owned()
        } else if self.seed != now.seed {
            format!("it was begun with seed {}, the settings say {}", self.seed, now.seed)
        } else if self.population != now.population {
            format!("it was begun with population {}, the settings say {}", self.population, now.population)
        } else if self.sigma.to_bits() != now.sigma.to_bits() {
            format!("it was begun with sigma {}, the settings say {}", self.sigma, now.sigma)
        } else if (self.bound_handling, self.max_resampling) != (now.bound_handling, now.max_resampling) {
            "it was begun with another treatment of draws outside the bounds".to_owned()
        } else {
            return Ok(());
        };
        Err(CmaError::State(differs))
    }
}
