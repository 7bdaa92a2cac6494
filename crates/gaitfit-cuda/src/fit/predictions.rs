//! Short predictions on a GPU: what `gaitfit_policy::predict` does.

use std::sync::Arc;

use gaitfit_policy::follow;
use gaitfit_policy::predict::{Course, Job};
use gaitfit_policy::walker::Walker;

use super::{Candidates, FitError, Readings, Tables, Tracks};
use crate::runtime::Device;

/// Predicts logs by candidates on a GPU. The robot must be the same in all calls. The logs may change from call to call: what is compiled
/// and allocated for logs as many and as long stays.
pub struct Predictions {
    device: Device,
    threads: usize,
    /// The logs of the last call, and the candidates on them.
    last: Option<(Arc<[Course]>, Candidates)>,
}

impl Predictions {
    /// On `device`. `threads`: of the host, for what it prepares.
    pub fn new(device: &Device, threads: usize) -> Self {
        Self { device: device.clone(), threads, last: None }
    }

    /// Has every job predict every course and hands `consume(job, course, tracks)` the joint positions and velocities, once,
    /// from any thread.
    ///
    /// # Errors
    /// Candidates that cannot be simulated; a failure of the GPU; [`FitError::Cancelled`].
    pub fn run(
        &mut self,
        walker: &Walker,
        courses: &Arc<[Course]>,
        jobs: &[Job],
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), FitError> {
        if jobs.is_empty() || courses.is_empty() {
            return Ok(());
        }
        let candidates = match &mut self.last {
            Some((known, candidates)) => {
                if !Arc::ptr_eq(known, courses) {
                    candidates.set_tables(Tables::predict(walker, courses))?;
                    *known = Arc::clone(courses);
                }
                candidates
            }
            None => {
                let tables = Tables::predict(walker, courses);
                let candidates = Candidates::new(&self.device, tables, self.threads)?;
                &mut self.last.insert((Arc::clone(courses), candidates)).1
            }
        };
        let trust: Vec<f64> = jobs.iter().map(|job| job.feet_trust).collect();
        let followed = |job: &Job| follow::Job {
            candidate: job.candidate.clone(),
            reset_every: Some(job.every),
            seed: job.seed,
        };
        let followed: Vec<follow::Job> = jobs.iter().map(followed).collect();
        candidates.predict(&followed, Readings { walker, courses, trust: &trust }, consume, cancel)
    }
}
