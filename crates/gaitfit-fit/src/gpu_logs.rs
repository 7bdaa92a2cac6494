//! Logs of simulated robots, made on a GPU.

#[cfg(feature = "cuda")]
pub use with_cuda::GpuLogs;

/// A build without the feature `cuda` has no GPUs.
#[cfg(not(feature = "cuda"))]
pub use without_cuda::GpuLogs;

/// How a robot begins a recording: the number of samples that it walks before under the first command, and its state at the
/// start of them.
pub type Beginning = (usize, gaitfit_sim::Start);

#[cfg(feature = "cuda")]
mod with_cuda {
    use super::Beginning;
    use crate::walk::walking::Walking;
    use gaitfit_cuda::fit::{Begin, Candidates, Subject, Tables, Tracks};
    use gaitfit_policy::follow::{Job, Script, Track};
    use std::sync::{Mutex, PoisonError};

    /// Simulates walks under the commands of recordings, on the first GPU of a fit.
    pub struct GpuLogs(Mutex<Candidates>);

    impl GpuLogs {
        /// `earlier`: the max number of samples that a robot walks before a recording begins. `None` if the fit has no GPU, or
        /// if its GPU cannot run the policy.
        pub fn new(walking: &Walking, scripts: &[Script], earlier: usize) -> Option<Self> {
            let gpu = walking.gpus.first()?;
            let tables = Tables::walk(&walking.task.walker, &walking.policy, scripts).ok()?;
            Candidates::new(gpu, tables.for_logs(earlier), walking.threads).ok().map(Mutex::new).map(Self)
        }

        /// Calls `keep(job, tracks)` once for each job, from any thread, with the job's tracks on all recordings. Returns the
        /// jobs whose logs are missing, because of a cancellation or because the GPU could not simulate them.
        pub fn make(
            &self,
            walking: &Walking,
            jobs: &[Job],
            begins: &[Vec<Beginning>],
            keep: &(dyn Fn(usize, Vec<Track>) + Sync),
            cancel: &(dyn Fn() -> bool + Sync),
        ) -> Vec<usize> {
            let subject = Subject::Walk(&walking.task.walker, &walking.policy);
            let joints = walking.task.walker.joints.len();
            let begin = |(earlier, start): &Beginning| Begin {
                earlier: u32::try_from(*earlier).unwrap_or(u32::MAX),
                start: start.clone(),
            };
            let begins: Vec<Vec<Begin>> = begins.iter().map(|all| all.iter().map(begin).collect()).collect();
            // A job's logs may come from different threads, and are passed on once all are there.
            let made: Vec<Mutex<Vec<Option<Track>>>> =
                begins.iter().map(|all| Mutex::new(vec![None; all.len()])).collect();
            let consume = |job: usize, recording: usize, tracks: Tracks<'_>| {
                let track = tracks.log(joints);
                let mut of_job = made[job].lock().unwrap_or_else(PoisonError::into_inner);
                of_job[recording] = Some(track);
                if of_job.iter().all(Option::is_some) {
                    // Taken out under the lock, passed on without it: `keep` may take long.
                    let whole = std::mem::take(&mut *of_job);
                    drop(of_job);
                    keep(job, whole.into_iter().flatten().collect());
                }
            };
            // The GPU makes one batch at a time.
            let mut candidates = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            // The CPU makes the logs that the GPU did not make.
            let _ = candidates.make_logs(subject, jobs, &begins, &consume, cancel);
            // `consume` emptied the lists of the jobs that it passed on.
            let is_left = |job: &usize| !made[*job].lock().unwrap_or_else(PoisonError::into_inner).is_empty();
            (0..jobs.len()).filter(is_left).collect()
        }
    }
}

#[cfg(not(feature = "cuda"))]
mod without_cuda {
    use super::Beginning;
    use crate::walk::walking::Walking;
    use gaitfit_policy::follow::{Job, Script, Track};

    /// This type has no values.
    pub enum GpuLogs {}

    impl GpuLogs {
        /// Always `None`.
        pub fn new(_: &Walking, _: &[Script], _: usize) -> Option<Self> {
            None
        }

        /// Cannot be called.
        pub fn make(
            &self,
            _: &Walking,
            _: &[Job],
            _: &[Vec<Beginning>],
            _: &(dyn Fn(usize, Vec<Track>) + Sync),
            _: &(dyn Fn() -> bool + Sync),
        ) -> Vec<usize> {
            match *self {}
        }
    }
}
