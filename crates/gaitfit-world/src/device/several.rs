//! One device, or several GPUs of one host.

use super::{Device, Gpu};
use crate::Error;
use std::fmt;
use std::str::FromStr;

/// One device or several GPUs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Devices(Vec<Device>);

impl From<Device> for Devices {
    fn from(device: Device) -> Self {
        Self(vec![device])
    }
}

impl FromStr for Devices {
    type Err = String;

    /// What [`Device`] takes, and several GPUs: `cuda:0,1`.
    fn from_str(text: &str) -> Result<Self, String> {
        let Some((numbers, _)) = text.strip_prefix("cuda:").zip(text.split_once(',')) else {
            return text
                .parse::<Device>()
                .map(Self::from)
                .map_err(|wrong| format!("{wrong}; several GPUs are, for example, cuda:0,1"));
        };
        let mut devices = Vec::new();
        for number in numbers.split(',') {
            // By the reader of one device, so that a list takes the same numbers.
            let device = format!("cuda:{number}").parse()?;
            if devices.contains(&device) {
                return Err(format!("it names the GPU {number} twice: name each once, as in cuda:0,1"));
            }
            devices.push(device);
        }
        Ok(Self(devices))
    }
}

impl fmt::Display for Devices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.first().fmt(f)?;
        let mut others = self.0.iter().skip(1).filter_map(|device| device.gpu());
        others.try_for_each(|number| write!(f, ",{number}"))
    }
}

impl Devices {
    /// Several; one of them does what is not shared.
    pub fn new(first: Device, others: impl IntoIterator<Item = Device>) -> Self {
        Self(std::iter::once(first).chain(others).collect())
    }

    /// All of them, one at least.
    pub fn all(&self) -> &[Device] {
        &self.0
    }

    /// The first one, which does what is not shared.
    pub fn first(&self) -> Device {
        self.device(0)
    }

    /// The device of worker number `worker`: each in turn.
    pub fn device(&self, worker: usize) -> Device {
        self.0.get(worker % self.0.len().max(1)).copied().unwrap_or_default()
    }

    /// Devices that train each of `seeds` seeds: groups of equally many, as many seeds at a time as there are groups.
    /// Several GPUs of a group train one seed together.
    pub fn groups(&self, seeds: usize) -> Vec<Self> {
        let groups = seeds.clamp(1, self.0.len().max(1));
        // Groups of equal size: all seeds are then done at about the same time.
        let each = (self.0.len() / groups).max(1);
        // GPUs that do not fill a group stay idle.
        self.0.chunks_exact(each).take(groups).map(|group| Self(group.to_vec())).collect()
    }

    /// The devices that are in a group.
    #[must_use]
    pub fn in_groups(&self, seeds: usize) -> Self {
        Self(self.groups(seeds).into_iter().flat_map(|group| group.0).collect())
    }

    /// As many of them, from the first on, as can share `robots` evenly in each group.
    #[must_use]
    pub fn sharing(&self, seeds: usize, robots: usize) -> Self {
        let even = |count: &usize| {
            let some = Self(self.0.iter().copied().take(*count).collect()).in_groups(seeds);
            (some.groups(seeds).iter().all(|group| robots.is_multiple_of(group.0.len()))).then_some(some)
        };
        // The most devices first. One device can share any number of robots.
        (1..=self.0.len()).rev().find_map(|count| even(&count)).unwrap_or_else(|| self.first().into())
    }

    /// Whether GPUs compute.
    pub fn are_gpus(&self) -> bool {
        self.first().gpu().is_some()
    }

    /// Devices that a command computes on: those asked for; else `last`, the name of what the resumed run was on, if
    /// that is there; else what is [found](Device::found).
    pub fn choose(asked: Option<Self>, last: Option<&str>) -> Self {
        let last = || {
            let last: Self = last?.parse().ok()?;
            // `Found`, although it is named: where the GPU does not do the work, the processor may.
            let there = |device: &Device| match device.gpu() {
                None => Some(Device::Cpu),
                Some(number) => Device::Cuda(number).open().is_ok().then_some(Device::Found(number)),
            };
            last.0.iter().map(there).collect::<Option<Vec<_>>>().map(Self)
        };
        asked.or_else(last).unwrap_or_else(|| Device::found().into())
    }

    /// Why the processor computes instead, if `auto` found these devices and they do not do what is asked.
    pub fn instead(&self, error: &Error) -> Option<String> {
        // Who asked for a GPU gets an error and not the processor in silence.
        let automatic = self.0.iter().all(|device| matches!(device, Device::Found(_)));
        let reason = error.refusal().filter(|_| automatic)?;
        Some(format!("the CPU computes, not {self}: {reason}"))
    }

    /// Whether all are there.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn check(&self) -> Result<(), Error> {
        self.open().map(drop)
    }

    /// The GPUs, opened; none of the processor.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn open(&self) -> Result<Vec<Gpu>, Error> {
        self.0.iter().filter_map(|device| device.open().transpose()).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::run::manifest::last_devices;

    #[test]
    fn a_run_goes_on_on_its_devices_unless_told_otherwise() {
        let runs = tempfile::tempdir().unwrap();
        let write = |folder: &str, device: &str| {
            let folder = runs.path().join(folder);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("manifest.json"), format!("{{\"device\": \"{device}\"}}")).unwrap();
        };
        write("walk", "cuda:0");
        write("walk-2", "cpu");
        let resumed = |asked, name| Devices::choose(asked, last_devices(runs.path(), name).as_deref());
        assert_eq!(resumed(None, "walk"), Device::Cpu.into());
        assert_eq!(resumed(Some(Device::Cuda(3).into()), "walk"), Device::Cuda(3).into());
        // Not there: as if nothing was said.
        write("walk-3", "cuda:4000");
        assert_eq!(resumed(None, "walk"), Device::found().into());
        write("walk-4", "cuda:0,4000");
        assert_eq!(resumed(None, "walk"), Device::found().into());
        assert_eq!(resumed(None, "trot"), Device::found().into());
        let last: Devices = last_devices(runs.path(), "walk").unwrap().parse().unwrap();
        assert_eq!(last.all(), [Device::Cuda(0), Device::Cuda(4000)]);
    }

    #[test]
    fn several_gpus_are_a_list() {
        let two: Devices = "cuda:2,0".parse().unwrap();
        assert_eq!(two.to_string(), "cuda:2,0");
        let names = |all: Vec<Devices>| all.iter().map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(names(two.groups(1)), ["cuda:2,0"]);
        assert_eq!(names(two.groups(9)), ["cuda:2", "cuda:0"]);
        let five: Devices = "cuda:0,1,2,3,4".parse().unwrap();
        assert_eq!(names(five.groups(2)), ["cuda:0,1", "cuda:2,3"]);
        assert_eq!(five.in_groups(2).to_string(), "cuda:0,1,2,3");
        assert_eq!(five.sharing(1, 4096).to_string(), "cuda:0,1,2,3");
        assert_eq!(five.sharing(2, 4095).to_string(), "cuda:0,1");
        assert_eq!(names(Devices::from(Device::Cpu).groups(3)), ["cpu"]);
        assert_eq!([0, 1, 2].map(|worker| two.device(worker)), [2, 0, 2].map(Device::Cuda));
        assert_eq!("cuda".parse::<Devices>().unwrap().all(), [Device::Cuda(0)]);
        assert_eq!("cpu".parse::<Devices>().unwrap().device(3), Device::Cpu);
        for (wrong, what) in [("cuda:0,0", "twice"), ("cuda:0,", "cuda:N"), ("cpu,cuda:0", "cuda:0,1")] {
            let error = wrong.parse::<Devices>().unwrap_err();
            assert!(error.contains(what), "{wrong}: {error}");
        }
    }
}
