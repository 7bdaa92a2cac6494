//! What computes.

mod several;

pub use several::Devices;

use std::fmt;
use std::str::FromStr;

use crate::Error;
use gaitfit_cuda::fit::FitError;
use gaitfit_cuda::ppo::PpoError;
use gaitfit_cuda::rollout::RolloutError;
use gaitfit_cuda::runtime::{CudaError, Found};
use gaitfit_learn::ppo::Learner;
use gaitfit_learn::task::Task;
use gaitfit_sim::Candidate;

/// Fewer trajectories than this are simulated on the processor, unless a GPU is asked for.
const FEW: usize = 1000;

/// The processor or a GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// The processor.
    #[default]
    Cpu,
    /// The GPU of this number, as it was asked for.
    Cuda(usize),
    /// The GPU of this number, which `auto` found: what it does not do the processor does.
    Found(usize),
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "it must be cpu, cuda or cuda:N, for example cuda:0, or auto".to_owned();
        match text.split_once(':') {
            None if text == "cpu" => Ok(Self::Cpu),
            None if text == "cuda" => Ok(Self::Cuda(0)),
            None if text == "auto" => Ok(Self::found()),
            Some(("cuda", number)) => number.parse().map(Self::Cuda).map_err(|_| wrong()),
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Cuda(number) | Self::Found(number) => write!(f, "cuda:{number}"),
        }
    }
}

impl Device {
    /// The first GPU if driver, GPU and compiler are there, else the processor: what `auto` means.
    pub fn found() -> Self {
        Self::among(&gaitfit_cuda::runtime::find())
    }

    /// The same of what a search has found.
    pub fn among(found: &Found) -> Self {
        let usable = found.problems.is_empty() && found.nvrtc.is_some();
        found.gpus.first().filter(|_| usable).map_or(Self::Cpu, |gpu| Self::Found(gpu.ordinal))
    }

    /// The number of the GPU; none of the processor.
    pub fn gpu(self) -> Option<usize> {
        match self {
            Self::Cpu => None,
            Self::Cuda(number) | Self::Found(number) => Some(number),
        }
    }

    /// The same device, as if `auto` had found it.
    #[must_use]
    pub fn as_found(self) -> Self {
        self.gpu().map_or(Self::Cpu, Self::Found)
    }

    /// What simulates this many trajectories: of a GPU that `auto` found, the processor where they are few, for the programs'
    /// compilation takes longer.
    #[must_use]
    pub fn for_trajectories(self, count: usize) -> Self {
        match self {
            Self::Found(_) if count < FEW => Self::Cpu,
            device => device,
        }
    }

    /// What computes, one line to begin with.
    pub fn line(self) -> String {
        let Some(number) = self.gpu() else { return "device cpu".to_owned() };
        let name = gaitfit_cuda::runtime::find().gpus.into_iter().find(|gpu| gpu.ordinal == number);
        format!("device {self}{}", name.map(|gpu| format!(", {}", gpu.name)).unwrap_or_default())
    }

    /// Why the processor computes instead, if `auto` found this device and it does not do what is asked.
    pub fn instead(self, error: &Error) -> Option<String> {
        Devices::from(self).instead(error)
    }

    /// Whether it is there, before hours of work that come first.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn check(self) -> Result<(), Error> {
        self.open().map(drop)
    }

    /// This device, if it trains what is asked for; the processor, and why, if `auto` found a GPU that does not.
    ///
    /// # Errors
    /// Of a GPU that was asked for, what it does not do.
    pub fn for_training(
        self,
        scene: &Task,
        candidates: &[Candidate],
        learner: &Learner,
    ) -> Result<(Self, Option<String>), Error> {
        if self == Self::Cpu {
            return Ok((self, None));
        }
        match gaitfit_cuda::rollout::check(scene, candidates, learner).map_err(rollout_error) {
            Ok(()) => Ok((self, None)),
            Err(error) => match self.instead(&error) {
                Some(note) => Ok((Self::Cpu, Some(note))),
                None => Err(error),
            },
        }
    }

    /// The GPU, opened; none of the processor.
    ///
    /// # Errors
    /// [`Error::Missing`] without the driver or the GPU.
    pub fn open(self) -> Result<Option<gaitfit_cuda::runtime::Device>, Error> {
        let open = |number| gaitfit_cuda::runtime::Device::open(number).map_err(|error| cuda_error(&error));
        self.gpu().map(open).transpose()
    }
}

/// A missing driver, GPU or compiler is told apart from a failure.
pub fn cuda_error(error: &CudaError) -> Error {
    if error.is_missing() { Error::Missing(error.to_string()) } else { Error::failed(error) }
}

/// Why a training on a GPU cannot be, or stopped.
pub fn rollout_error(error: RolloutError) -> Error {
    match error {
        RolloutError::Cuda(error) => cuda_error(&error),
        RolloutError::Unsupported(_)
        | RolloutError::Trials(_)
        | RolloutError::Ppo(
            PpoError::Unsupported(_)
            | PpoError::TooWide(_)
            | PpoError::TooOld { .. }
            | PpoError::TooMany { .. },
        ) => Error::Refused(error.to_string()),
        error => Error::failed(error),
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
    use gaitfit_learn::ppo;
    use gaitfit_learn::task::TaskSettings;

    #[test]
    fn what_a_found_gpu_refuses_the_cpu_does() {
        let refused =
            Error::Refused("a fit with wings does not run on a GPU yet".to_owned()).within("x.toml:");
        let note = Device::Found(1).instead(&refused).unwrap();
        assert!(note.contains("the CPU computes, not cuda:1") && note.contains("wings"), "{note}");
        assert_eq!(Device::Cuda(1).instead(&refused), None);
        assert_eq!(Device::Found(1).instead(&Error::failed("the GPU has burnt")), None);
        assert_eq!(refused.kind(), crate::ErrorKind::Settings);
    }

    #[test]
    fn a_gpu_of_several_that_failed_is_named() {
        let on = |error: FitError| fit_error(FitError::On { ordinal: 1, error: Box::new(error) });
        let missing = on(CudaError::Ordinal { ordinal: 1, count: 1 }.into());
        assert!(
            matches!(missing, Error::Missing(_)) && missing.to_string().contains("cuda:1: "),
            "{missing}"
        );
        let wide = on(FitError::TooWide { needed: 9, rows: 4, available: 8 });
        assert!(wide.refusal().unwrap().contains("cuda:1: "), "{wide}");
    }

    #[test]
    fn a_gpu_by_default_leaves_unsupported_tasks_to_the_cpu() {
        let model = crate::robot::go2().unwrap();
        let settings =
            TaskSettings { self_contact: gaitfit_model::SelfContact::File, ..TaskSettings::default() };
        let task = Task::new(&model, &settings, gaitfit_physics::Preset::Fast).unwrap();
        let learner = gaitfit_learn::Training::fresh_learner(&task, &Default::default(), 1).unwrap();
        assert_eq!(Device::Found(0).for_training(&task, &[], &learner).unwrap(), (Device::Found(0), None));
        let ppo = ppo::Settings { memory: Some(ppo::MemorySettings::default()), ..Default::default() };
        let remembers = gaitfit_learn::Training::fresh_learner(&task, &ppo, 1).unwrap();
        let found = Device::Found(0).for_training(&task, &[], &remembers).unwrap();
        assert_eq!(found, (Device::Found(0), None));
        let own = task.with_term("own", 1.0, |_| 0.0).unwrap();
        let (device, note) = Device::Found(0).for_training(&own, &[], &learner).unwrap();
        assert_eq!(device, Device::Cpu);
        assert!(note.unwrap().contains("`own`"));
        let error = Device::Cuda(0).for_training(&own, &[], &learner).unwrap_err();
        assert!(error.refusal().unwrap().contains("`own`"), "{error}");
    }

    #[test]
    fn devices_have_names() {
        assert_eq!("cpu".parse(), Ok(Device::Cpu));
        assert_eq!("cuda".parse(), Ok(Device::Cuda(0)));
        assert_eq!("cuda:3".parse(), Ok(Device::Cuda(3)));
        let few = [Device::Cpu, Device::Cuda(2), Device::Found(1)].map(|device| device.for_trajectories(99));
        assert_eq!(few, [Device::Cpu, Device::Cuda(2), Device::Cpu]);
        assert_eq!(Device::Found(1).for_trajectories(10_000), Device::Found(1));
        assert_eq!([Device::Cpu, Device::Cuda(2)].map(Device::as_found), [Device::Cpu, Device::Found(2)]);
        let all = [Device::Cpu, Device::Cuda(2), Device::Found(1)];
        assert_eq!(all.map(|device| device.to_string()), ["cpu", "cuda:2", "cuda:1"]);
        assert_eq!("auto".parse(), Ok(Device::found()));
        for wrong in ["gpu", "cuda:", "cuda:-1", "cuda:0,1", "cpu:0"] {
            assert!(wrong.parse::<Device>().is_err(), "{wrong}");
        }
    }
}
