//! GPUs, by `gaitfit-cuda`.

use super::Device;
use crate::Error;
use gaitfit_cuda::fit::FitError;
use gaitfit_cuda::ppo::PpoError;
use gaitfit_cuda::rollout::{self, RolloutError};
use gaitfit_cuda::runtime::{self, CudaError, Found};
use gaitfit_learn::Training;
use gaitfit_learn::collect::{CollectOptions, Collected};
use gaitfit_learn::evaluate::{Crossing, DriftTrial, Subject, Trial};
use gaitfit_learn::task::Task;
use gaitfit_policy::Policy;
use gaitfit_policy::follow::{Job, Script, Track};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::Candidate;

pub use gaitfit_cuda::rollout::Trainer;
/// An opened GPU.
pub use gaitfit_cuda::runtime::Device as Gpu;

/// The device that `auto` means on this machine.
pub(super) fn automatic() -> Device {
    Device::among(&runtime::find())
}

/// The name of the GPU of this number.
pub(super) fn name(number: usize) -> Option<String> {
    runtime::find().gpus.into_iter().find(|gpu| gpu.ordinal == number).map(|gpu| gpu.name)
}

pub(super) fn open(number: usize) -> Result<Gpu, Error> {
    Gpu::open(number).map_err(|error| cuda_error(&error))
}

/// Whether a GPU trains this.
pub(super) fn check(scene: &Task, candidates: &[Candidate]) -> Result<(), Error> {
    rollout::check(scene, candidates).map_err(rollout_error)
}

impl Device {
    /// The first GPU that a search has found, if driver, GPU and compiler are there, else the processor.
    pub fn among(search: &Found) -> Self {
        // Without NVRTC no kernel can be compiled, even if driver and GPU are there.
        let usable = search.problems.is_empty() && search.nvrtc.is_some();
        search.gpus.first().filter(|_| usable).map_or(Self::Cpu, |gpu| Self::Found(gpu.ordinal))
    }
}

/// Trajectories with random commands; empty if `cancel` stopped them.
///
/// # Errors
/// A task that the GPU cannot do, or its failure.
pub fn trials(
    gpu: &Gpu,
    subject: &Subject<'_>,
    count: usize,
    seconds: f64,
    cancel: &dyn Fn() -> bool,
) -> Result<Vec<Trial>, Error> {
    rollout::run_trials(gpu, subject, count, seconds, cancel)
        .map(Option::unwrap_or_default)
        .map_err(rollout_error)
}

/// Constant commands, as [`gaitfit_learn::evaluate::drift`] gives them; empty if `cancel` stopped them.
///
/// # Errors
/// A task that the GPU cannot do, or its failure.
pub fn drift(
    gpu: &Gpu,
    subject: &Subject<'_>,
    robots: usize,
    speeds: Option<[f64; 3]>,
    cancel: &dyn Fn() -> bool,
) -> Result<Vec<DriftTrial>, Error> {
    rollout::drift(gpu, subject, robots, speeds, cancel).map(Option::unwrap_or_default).map_err(rollout_error)
}

/// Crossings of uneven ground, as [`gaitfit_learn::evaluate::crossings`] gives them; empty if `cancel` stopped them.
///
/// # Errors
/// A task that the GPU cannot do, or its failure.
pub fn crossings(
    gpu: &Gpu,
    subject: &Subject<'_>,
    robots: usize,
    speed: f64,
    cancel: &dyn Fn() -> bool,
) -> Result<Vec<Crossing>, Error> {
    rollout::crossings(gpu, subject, robots, speed, cancel)
        .map(Option::unwrap_or_default)
        .map_err(rollout_error)
}

/// Logs of walks under random commands; empty if `cancel` stopped them.
///
/// # Errors
/// A task that the GPU cannot do, or its failure.
pub fn collect(
    gpu: &Gpu,
    subject: &Subject<'_>,
    options: &CollectOptions,
    cancel: &dyn Fn() -> bool,
) -> Result<Vec<Collected>, Error> {
    rollout::collect(gpu, subject, options, cancel).map(Option::unwrap_or_default).map_err(rollout_error)
}

/// Walks under the commands of `scripts`, as [`gaitfit_policy::follow::follow`] makes them.
///
/// # Errors
/// A policy that the GPU cannot run. A failure of the GPU.
pub fn follow(
    gpu: &Gpu,
    (walker, policy): (&Walker, &Policy),
    scripts: &[Script],
    job: &Job,
    threads: usize,
    consume: &(dyn Fn(usize, &Track) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<(), Error> {
    gaitfit_cuda::fit::follow(gpu, walker, policy, scripts, job, threads, consume, cancel).map_err(fit_error)
}

/// Continues `training` on a GPU, or on several together.
///
/// # Errors
/// A task that a GPU cannot do, or its failure.
pub fn start_training<'a>(gpus: &[Gpu], training: &mut Training<'a>) -> Result<Trainer<'a>, Error> {
    // From the learner, so that a training resumes with the precision that it began with.
    let precision = training.learner().settings().precision;
    Trainer::together(gpus, training, precision).map_err(rollout_error)
}

/// Brings the state of `trainer` back into `training`.
///
/// # Errors
/// A failure of the GPU.
pub fn store_training(trainer: &Trainer<'_>, training: &mut Training<'_>) -> Result<(), Error> {
    trainer.store(training).map_err(rollout_error)
}

/// A missing driver, GPU or compiler is told apart from a failure.
pub fn cuda_error(error: &CudaError) -> Error {
    if error.is_missing() { Error::Missing(error.to_string()) } else { Error::failed(error) }
}

/// Why a training on a GPU cannot be, or stopped.
pub fn rollout_error(error: RolloutError) -> Error {
    match error.cause() {
        // The cause decides the kind; the message keeps which of several GPUs it was.
        RolloutError::Cuda(cause) if cause.is_missing() => Error::Missing(error.to_string()),
        RolloutError::Unsupported(_)
        | RolloutError::Trials(_)
        | RolloutError::Uneven { .. }
        | RolloutError::Ppo(PpoError::TooWide(_) | PpoError::TooOld { .. } | PpoError::TooMany { .. }) => {
            Error::Refused(error.to_string())
        }
        _ => Error::failed(error),
    }
}

/// Why a fit on a GPU cannot be, or stopped.
pub fn fit_error(error: FitError) -> Error {
    match error.cause() {
        FitError::Cuda(cause) if cause.is_missing() => Error::Missing(error.to_string()),
        FitError::Unsupported(_) | FitError::TooWide { .. } => Error::Refused(error.to_string()),
        _ => Error::failed(error),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_learn::task::TaskSettings;

    #[test]
    fn a_gpu_of_several_that_failed_is_named() {
        let on = |error: FitError| fit_error(FitError::On { ordinal: 1, error: Box::new(error) });
        let missing = on(CudaError::Ordinal { ordinal: 1, count: 1 }.into());
        assert!(
            matches!(missing, Error::Missing(_)) && missing.to_string().contains("cuda:1: "),
            "{missing}"
        );
        let (what, gib) = ("samples".to_owned(), 1 << 30);
        let full = CudaError::Memory { what, ordinal: 1, needed: 9 * gib, free: gib, total: 80 * gib };
        let full = rollout_error(RolloutError::On { ordinal: 1, error: Box::new(full.into()) }).to_string();
        assert!(full.contains("cuda:1: `samples` needs 9.0 GiB"), "{full}");
        let uneven = rollout_error(RolloutError::Uneven { environments: 64, gpus: 3 });
        assert!(uneven.refusal().unwrap().contains("63 or 66"), "{uneven}");
        let wide = on(FitError::TooWide { needed: 9, rows: 4, available: 8 });
        assert!(wide.refusal().unwrap().contains("cuda:1: "), "{wide}");
    }

    #[test]
    fn a_gpu_by_default_leaves_unsupported_tasks_to_the_cpu() {
        let model = crate::robot::go2().unwrap();
        let settings =
            TaskSettings { self_contact: gaitfit_model::SelfContact::File, ..TaskSettings::default() };
        let task = Task::new(&model, &settings, gaitfit_physics::Preset::Fast).unwrap();
        assert_eq!(Device::Found(0).for_training(&task, &[]).unwrap(), (Device::Found(0), None));
        let own = task.with_term("own", 1.0, |_| 0.0).unwrap();
        let (device, note) = Device::Found(0).for_training(&own, &[]).unwrap();
        assert_eq!(device, Device::Cpu);
        assert!(note.unwrap().contains("`own`"));
        let error = Device::Cuda(0).for_training(&own, &[]).unwrap_err();
        assert!(error.refusal().unwrap().contains("`own`"), "{error}");
    }
}
