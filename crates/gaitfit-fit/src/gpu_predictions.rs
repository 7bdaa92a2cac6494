//! Short predictions, made on a GPU.

#[cfg(feature = "cuda")]
pub use with_cuda::GpuPredictions;

/// A build without the feature `cuda` has no GPUs.
#[cfg(not(feature = "cuda"))]
pub use without_cuda::GpuPredictions;

use gaitfit_policy::predict::Course;

/// Readings of the sensors of some logs.
pub struct Readings {
    /// One for each log; the list ends before the first log that lacks the readings of an IMU.
    pub courses: Vec<Course>,
    /// The same as a GPU takes it, once it was asked for.
    #[cfg(feature = "cuda")]
    tables: std::sync::OnceLock<std::sync::Arc<gaitfit_cuda::fit::Tables>>,
}

impl Readings {
    /// The readings `courses`.
    pub fn new(courses: Vec<Course>) -> Self {
        Self {
            courses,
            #[cfg(feature = "cuda")]
            tables: std::sync::OnceLock::new(),
        }
    }
}

#[cfg(feature = "cuda")]
mod with_cuda {
    use super::Readings;
    use crate::walk::walking::Walking;
    use gaitfit_adapt::SimulatorError;
    use gaitfit_cuda::fit::{FitError, Predictions, Tables, Tracks};
    use gaitfit_policy::follow::Track;
    use gaitfit_policy::predict::Job;
    use std::sync::{Arc, OnceLock};

    /// Predicts the logs of all simulators of a walking robot, on the first GPU of a fit.
    #[derive(Default)]
    pub struct GpuPredictions(OnceLock<Predictions>);

    impl GpuPredictions {
        /// Has jobs predict every course and calls `consume(job, course, track)` once for each, from any thread. A track has the
        /// joints' signals. Returns the jobs that are left for the CPU; all, if the fit has no GPU.
        ///
        /// # Errors
        /// A candidate that is no robot; a failure of the GPU; [`SimulatorError::Cancelled`].
        pub fn predict(
            &self,
            walking: &Walking,
            readings: &Readings,
            jobs: &[Job],
            consume: &(dyn Fn(usize, usize, &Track) + Sync),
            cancel: &(dyn Fn() -> bool + Sync),
        ) -> Result<Vec<usize>, SimulatorError> {
            let Some(gpu) = walking.gpus.first() else { return Ok((0..jobs.len()).collect()) };
            let (walker, Readings { courses, tables }) = (&walking.task.walker, readings);
            let predictions = self.0.get_or_init(|| Predictions::new(gpu, walking.threads));
            let tables = tables.get_or_init(|| Arc::new(Tables::predict(walker, courses)));
            // A prediction is compared by its joints alone, so the track has neither base nor actions.
            let pass = |job: usize, course: usize, tracks: Tracks<'_>| {
                let (position, velocity) = tracks.joints();
                consume(job, course, &Track { position, velocity, ..Track::default() });
            };
            predictions.run(walker, (tables, courses), jobs, &pass, cancel).map_err(|error| match error {
                FitError::Cancelled => SimulatorError::Cancelled,
                error => SimulatorError::failed(error),
            })
        }
    }
}

#[cfg(not(feature = "cuda"))]
mod without_cuda {
    use super::Readings;
    use crate::walk::walking::Walking;
    use gaitfit_adapt::SimulatorError;
    use gaitfit_policy::follow::Track;
    use gaitfit_policy::predict::Job;

    /// It predicts nothing.
    #[derive(Default)]
    pub struct GpuPredictions;

    impl GpuPredictions {
        /// Returns all jobs.
        ///
        /// # Errors
        /// Never.
        pub fn predict(
            &self,
            _: &Walking,
            _: &Readings,
            jobs: &[Job],
            _: &(dyn Fn(usize, usize, &Track) + Sync),
            _: &(dyn Fn() -> bool + Sync),
        ) -> Result<Vec<usize>, SimulatorError> {
            Ok((0..jobs.len()).collect())
        }
    }
}
