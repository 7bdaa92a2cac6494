//! Short predictions, made on a GPU.

#[cfg(feature = "cuda")]
pub use with_cuda::{GpuPredictions, Readings};

/// A build without the feature `cuda` has no GPUs.
#[cfg(not(feature = "cuda"))]
pub use without_cuda::{GpuPredictions, Readings};

#[cfg(feature = "cuda")]
mod with_cuda {
    use crate::walk::walking::Walking;
    use gaitfit_adapt::SimulatorError;
    use gaitfit_cuda::fit::{FitError, Predictions, Tables, Tracks};
    use gaitfit_policy::follow::Track;
    use gaitfit_policy::predict::{Course, Job};
    use std::sync::{Arc, OnceLock};

    /// What the sensors of some logs read.
    pub struct Readings {
        /// One for each log; empty if a log lacks the readings of an IMU.
        pub courses: Vec<Course>,
        /// The same for a GPU.
        tables: OnceLock<Arc<Tables>>,
    }

    impl Readings {
        /// Of some logs.
        pub fn new(courses: Vec<Course>) -> Self {
            Self { courses, tables: OnceLock::new() }
        }
    }

    /// Predicts the logs of all simulators of a walking robot, on the first GPU of a fit.
    #[derive(Default)]
    pub struct GpuPredictions(OnceLock<Predictions>);

    impl GpuPredictions {
        /// Has every job predict every course and calls `consume(job, course, track)` once for each, from any thread. Of a
        /// track there are the joints' signals. `Ok(false)`: the fit has no GPU, or its GPU cannot do it, and nothing was consumed.
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
        ) -> Result<bool, SimulatorError> {
            let Some(gpu) = walking.gpus.first() else { return Ok(false) };
            let (walker, Readings { courses, tables }) = (&walking.task.walker, readings);
            let predictions = self.0.get_or_init(|| Predictions::new(gpu, walking.threads));
            if !predictions.is_worth(jobs) {
                return Ok(false);
            }
            let tables = tables.get_or_init(|| Arc::new(Tables::predict(walker, courses)));
            let joints = walker.joints.len();
            let pass = |job: usize, course: usize, tracks: Tracks<'_>| {
                consume(job, course, &track(joints, &tracks));
            };
            match predictions.run(walker, (tables, courses), jobs, &pass, cancel) {
                Ok(()) => Ok(true),
                Err(FitError::Unsupported(_)) => Ok(false),
                Err(FitError::Cancelled) => Err(SimulatorError::Cancelled),
                Err(error) => Err(SimulatorError::failed(error)),
            }
        }
    }

    fn track(joints: usize, tracks: &Tracks<'_>) -> Track {
        let mut track = Track::default();
        for row in tracks.rows.chunks_exact(tracks.dimensions) {
            track.position.extend_from_slice(&row[..joints]);
            track.velocity.extend_from_slice(&row[joints..]);
        }
        track
    }
}

#[cfg(not(feature = "cuda"))]
mod without_cuda {
    use crate::walk::walking::Walking;
    use gaitfit_adapt::SimulatorError;
    use gaitfit_policy::follow::Track;
    use gaitfit_policy::predict::{Course, Job};

    /// What the sensors of some logs read.
    pub struct Readings {
        /// One for each log; empty if a log lacks the readings of an IMU.
        pub courses: Vec<Course>,
    }

    impl Readings {
        /// Of some logs.
        pub fn new(courses: Vec<Course>) -> Self {
            Self { courses }
        }
    }

    /// It predicts nothing.
    #[derive(Default)]
    pub struct GpuPredictions;

    impl GpuPredictions {
        /// Always `Ok(false)`.
        ///
        /// # Errors
        /// None.
        pub fn predict(
            &self,
            _: &Walking,
            _: &Readings,
            _: &[Job],
            _: &(dyn Fn(usize, usize, &Track) + Sync),
            _: &(dyn Fn() -> bool + Sync),
        ) -> Result<bool, SimulatorError> {
            Ok(false)
        }
    }
}
