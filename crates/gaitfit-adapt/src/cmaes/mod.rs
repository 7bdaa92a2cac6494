//! CMA-ES: minimisation of a black box by sampling from an adapted normal distribution.
//!
//! The algorithm and the equation numbers are those of Hansen, "The CMA Evolution Strategy: A Tutorial"
//! (arXiv 1604.00772, 2016); the separable form is Ros and Hansen, "A simple modification in CMA-ES achieving
//! linear time and space complexity" (PPSN 2008). Where the texts leave a choice, the Python package `cmaes` 0.13
//! decides; given the same normal draws the distributions agree generation by generation.
//!
//! A caller asks for a whole generation of candidates, and reports (tells) the costs of all of them. Draws are
//! addressed, not streamed (`gaitfit-random`), so [`Cma`] has no generator state: [`Cma::state`] with the settings
//! resumes to the same bits, and asking twice gives the same population.
//!
//! ```
//! use gaitfit_adapt::cmaes::{Cma, Settings};
//! # fn main() -> Result<(), gaitfit_adapt::cmaes::CmaError> {
//! let mut cma = Cma::new(Settings::new(vec![3.0, -2.0], vec![1.0, 0.1], 7))?;
//! while cma.stop().is_none() {
//!     let population = cma.ask();
//!     let cost: Vec<f64> = population.x().iter().map(|x| x[0].powi(2) + 100.0 * x[1].powi(2)).collect();
//!     cma.tell(&population, &cost)?;
//! }
//! assert!(cma.best().unwrap().cost < 1e-9);
//! # Ok(()) }
//! ```

mod algorithm;
mod begun;
mod constants;
mod covariance;
mod error;
mod normals;
mod restart;
mod settings;
mod state;
mod stop;

pub use algorithm::{Cma, Population};
pub use begun::Begun;
pub use constants::{Constants, default_population};
pub use covariance::Covariance;
pub use error::CmaError;
pub use normals::{AddressedNormals, NormalSource};
pub use restart::{RestartPlan, RestartStart, RunSummary, Search, SearchState};
pub use settings::{BoundHandling, CovarianceKind, Settings};
pub use state::{Best, State};
pub use stop::{StopReason, Tolerances};
