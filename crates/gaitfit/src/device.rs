//! What computes.

use std::fmt;
use std::str::FromStr;

use crate::Error;
use gaitfit_cuda::rollout::RolloutError;
use gaitfit_cuda::runtime::CudaError;
use gaitfit_learn::task::Task;

/// The processor or a GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// The processor.
    #[default]
    Cpu,
    /// The GPU of this number.
    Cuda(usize),
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
            Self::Cuda(number) => write!(f, "cuda:{number}"),
        }
    }
}

/// One device or several GPUs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Devices(Vec<Device>);

impl FromStr for Devices {
    type Err = String;

    /// What [`Device`] takes, and several GPUs: `cuda:0,1`.
    fn from_str(text: &str) -> Result<Self, String> {
        let Some((numbers, _)) = text.strip_prefix("cuda:").zip(text.split_once(',')) else {
            return text
                .parse()
                .map(|device| Self(vec![device]))
                .map_err(|wrong: String| format!("{wrong}; several GPUs are, for example, cuda:0,1"));
        };
        let mut all = Vec::new();
        for number in numbers.split(',') {
            let device = format!("cuda:{number}").parse()?;
            if all.contains(&device) {
                return Err(format!("it names the GPU {number} twice"));
            }
            all.push(device);
        }
        Ok(Self(all))
    }
}

impl Devices {
    /// All of them, one at least.
    pub fn all(&self) -> &[Device] {
        &self.0
    }

    /// The device of worker number `worker`: each in turn.
    pub fn of(&self, worker: usize) -> Device {
        self.0.get(worker % self.0.len().max(1)).copied().unwrap_or_default()
    }

    /// Whether all are there.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn check(&self) -> Result<(), Error> {
        self.0.iter().try_for_each(|device| device.check())
    }
}

impl Device {
    /// The first GPU if driver, GPU and compiler are there, else the processor: what `auto` means.
    pub fn found() -> Self {
        let found = gaitfit_cuda::runtime::find();
        let usable = found.problems.is_empty() && found.nvrtc.is_some();
        found.gpus.first().filter(|_| usable).map_or(Self::Cpu, |gpu| Self::Cuda(gpu.ordinal))
    }

    /// Whether it is there, before hours of work that come first.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn check(self) -> Result<(), Error> {
        self.open().map(drop)
    }

    /// Refuses a training on uneven ground on a GPU, before anything is written.
    ///
    /// # Errors
    /// Settings, with the remedy.
    pub fn check_ground(self, scene: &Task) -> Result<(), Error> {
        match self {
            Self::Cuda(_) if scene.walker.ground().is_some() => Err(Error::settings(
                "a training on uneven ground ([task.terrain], or boxes and height fields of the robot file) does not run \
                 on a GPU yet; use the CPU (--device cpu)",
            )),
            _ => Ok(()),
        }
    }

    /// The GPU, opened; none of the processor.
    ///
    /// # Errors
    /// [`Error::Missing`] without the driver or the GPU.
    pub fn open(self) -> Result<Option<gaitfit_cuda::runtime::Device>, Error> {
        match self {
            Self::Cpu => Ok(None),
            Self::Cuda(number) => {
                gaitfit_cuda::runtime::Device::open(number).map(Some).map_err(|error| cuda_error(&error))
            }
        }
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
        RolloutError::Unsupported(_) => Error::settings(error.to_string()),
        error => Error::failed(error),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn devices_have_names() {
        assert_eq!("cpu".parse(), Ok(Device::Cpu));
        assert_eq!("cuda".parse(), Ok(Device::Cuda(0)));
        assert_eq!("cuda:3".parse(), Ok(Device::Cuda(3)));
        assert_eq!([Device::Cpu, Device::Cuda(2)].map(|device| device.to_string()), ["cpu", "cuda:2"]);
        assert_eq!("auto".parse(), Ok(Device::found()));
        for wrong in ["gpu", "cuda:", "cuda:-1", "cuda:0,1", "cpu:0"] {
            assert!(wrong.parse::<Device>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn several_gpus_are_a_list() {
        let two: Devices = "cuda:2,0".parse().unwrap();
        assert_eq!([0, 1, 2].map(|worker| two.of(worker)), [2, 0, 2].map(Device::Cuda));
        assert_eq!("cuda".parse::<Devices>().unwrap().all(), [Device::Cuda(0)]);
        assert_eq!("cpu".parse::<Devices>().unwrap().of(3), Device::Cpu);
        for (wrong, what) in [("cuda:0,0", "twice"), ("cuda:0,", "cuda:N"), ("cpu,cuda:0", "cuda:0,1")] {
            let error = wrong.parse::<Devices>().unwrap_err();
            assert!(error.contains(what), "{wrong}: {error}");
        }
    }
}
