//! Short predictions, made on a GPU.

#[cfg(feature = "cuda")]
pub use with_cuda::GpuPredictions;

/// A build without the feature `cuda` has no GPUs.
#[cfg(not(feature = "cuda"))]
pub use without_cuda::GpuPredictions;

#[cfg(feature = "cuda")]
mod with_cuda {
    use crate::walk::walking::Walking;
    use gaitfit_adapt::SimulatorError;
    use gaitfit_cuda::fit::{FitError, Predictions, Tracks};
    use gaitfit_policy::follow::Track;
    use gaitfit_policy::predict::{Course, Job};
    use std::sync::{Arc, Mutex, PoisonError};

    /// Predicts the logs of all simulators of a walking robot, on the first GPU of a fit.
    #[derive(Default)]
    pub struct GpuPredictions(Mutex<Option<Predictions>>);

    impl GpuPredictions {
        /// Has every job predict every course and calls `consume(job, course, track)` once for each, from any thread. Of a
        /// track there are the joints' signals. `Ok(false)`: the fit has no GPU, or its GPU cannot do it, and nothing was consumed.
        ///
        /// # Errors
        /// A candidate that is no robot; a failure of the GPU; [`SimulatorError::Cancelled`].
        pub fn predict(
            &self,
            walking: &Walking,
            courses: &Arc<[Course]>,
            jobs: &[Job],
            consume: &(dyn Fn(usize, usize, &Track) + Sync),
            cancel: &(dyn Fn() -> bool + Sync),
        ) -> Result<bool, SimulatorError> {
            let Some(gpu) = walking.gpus.first() else { return Ok(false) };
            let mut predictions = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let predictions = predictions.get_or_insert_with(|| Predictions::new(gpu, walking.threads));
            let joints = walking.task.walker.joints.len();
            let pass = |job: usize, course: usize, tracks: Tracks<'_>| {
                consume(job, course, &track(joints, &tracks));
            };
            match predictions.run(&walking.task.walker, courses, jobs, &pass, cancel) {
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
    use std::sync::Arc;

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
            _: &Arc<[Course]>,
            _: &[Job],
            _: &(dyn Fn(usize, usize, &Track) + Sync),
            _: &(dyn Fn() -> bool + Sync),
        ) -> Result<bool, SimulatorError> {
            Ok(false)
        }
    }
}
