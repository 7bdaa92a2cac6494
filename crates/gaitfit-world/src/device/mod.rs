//! The device that computes: the processor or a GPU.

#[cfg(feature = "cuda")]
mod gpu;
#[cfg(not(feature = "cuda"))]
#[path = "no_gpu.rs"]
mod gpu;
mod several;

pub use gpu::{Gpu, Trainer, collect, crossings, drift, follow, start_training, store_training, trials};
#[cfg(feature = "cuda")]
pub use gpu::{cuda_error, fit_error, rollout_error};
pub use several::Devices;

use std::fmt;
use std::str::FromStr;

use crate::Error;
use gaitfit_learn::task::Task;
use gaitfit_run::watch::Watch;
use gaitfit_sim::Candidate;

/// Fewer trajectories than this are simulated on the processor, unless a GPU is asked for: they take less time there
/// than compiling the GPU's program.
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
            // `auto` is resolved when it is read, so that all messages name the device that computes.
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
        gpu::automatic()
    }

    /// The number of the GPU; none of the processor.
    pub fn gpu(self) -> Option<usize> {
        match self {
            Self::Cpu => None,
            Self::Cuda(number) | Self::Found(number) => Some(number),
        }
    }

    /// This device, marked as found by `auto`.
    #[must_use]
    pub fn as_found(self) -> Self {
        self.gpu().map_or(Self::Cpu, Self::Found)
    }

    /// Device that simulates this many trajectories. If `auto` found a GPU, the processor simulates few of them,
    /// because compiling the GPU's programs takes longer.
    #[must_use]
    pub fn for_trajectories(self, count: usize) -> Self {
        match self {
            Self::Found(_) if count < FEW => Self::Cpu,
            device => device,
        }
    }

    /// Names the device in a line that a command prints first.
    pub fn line(self) -> String {
        let Some(number) = self.gpu() else { return "device cpu".to_owned() };
        let name = gpu::name(number).map(|name| format!(", {name}"));
        format!("device {self}{}", name.unwrap_or_default())
    }

    /// Names the device of work that it does [for many robots](Self::for_trajectories) only, in a line that a command prints first.
    pub fn line_by_robots(self) -> String {
        match self {
            Self::Found(_) => format!("{} for {FEW} robots or more, else the CPU", self.line()),
            device => device.line(),
        }
    }

    /// Why the processor computes instead, if `auto` found this device and it does not do what is asked.
    pub fn instead(self, error: &Error) -> Option<String> {
        Devices::from(self).instead(error)
    }

    /// Runs `on_gpu` if this device is a GPU, else `on_cpu`. If `auto` found a GPU that does not do the work, `watch` gets a note and
    /// `on_cpu` runs.
    ///
    /// # Errors
    /// A GPU that is not there, and those of `on_gpu` and `on_cpu`.
    pub fn run<T>(
        self,
        watch: &Watch<'_>,
        on_gpu: impl FnOnce(&Gpu) -> Result<T, Error>,
        on_cpu: impl FnOnce() -> Result<T, Error>,
    ) -> Result<T, Error> {
        if let Some(gpu) = self.open()? {
            let error = match on_gpu(&gpu) {
                Ok(done) => return Ok(done),
                Err(error) => error,
            };
            match self.instead(&error) {
                Some(note) => watch.note(&note),
                None => return Err(error),
            }
        }
        on_cpu()
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
    /// A task that the GPU cannot do, if a GPU was asked for.
    pub fn for_training(
        self,
        scene: &Task,
        candidates: &[Candidate],
    ) -> Result<(Self, Option<String>), Error> {
        // The processor trains every task, so nothing is checked.
        if self == Self::Cpu {
            return Ok((self, None));
        }
        match gpu::check(scene, candidates) {
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
    /// [`Error::Missing`] without the driver or the GPU, or in a build without the feature `cuda`.
    pub fn open(self) -> Result<Option<Gpu>, Error> {
        self.gpu().map(gpu::open).transpose()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

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
