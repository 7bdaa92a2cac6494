//! How a fit is opened.

use super::setup::Setup;
use crate::Error;
use crate::device::{Device, Devices};
use crate::settings::AdaptConfig;
use crate::watch::Watch;
use gaitfit_policy::Policy;
use std::path::Path;

/// Settings and what belongs to them. [`Opening::open`] makes a [`Setup`] from it. By default the CPU simulates with the number
/// of threads in the settings, and the policy that walked is read from the file that they name.
#[derive(Clone)]
pub struct Opening<'a> {
    config: &'a AdaptConfig,
    config_path: &'a Path,
    threads: Option<usize>,
    devices: Devices,
    policy: Option<&'a Policy>,
    watch: Option<&'a Watch<'a>>,
}

impl<'a> Opening<'a> {
    /// A fit with these settings. `config_path`: the file that has them; relative paths can start from its folder.
    pub fn new(config: &'a AdaptConfig, config_path: &'a Path) -> Self {
        Self { config, config_path, threads: None, devices: Device::Cpu.into(), policy: None, watch: None }
    }

    /// Simulates with this number of threads; `None`: the number in the settings.
    #[must_use]
    pub fn threads(self, threads: impl Into<Option<usize>>) -> Self {
        Self { threads: threads.into(), ..self }
    }

    /// `devices` share the candidates and simulate them. If `auto` chose a GPU that cannot do this fit, the CPU does it.
    #[must_use]
    pub fn devices(self, devices: &Devices) -> Self {
        Self { devices: devices.clone(), ..self }
    }

    /// The policy that walked, if it is given. Then the settings have only its name.
    #[must_use]
    pub fn policy(self, policy: Option<&'a Policy>) -> Self {
        Self { policy, ..self }
    }

    /// Reports the progress of simulations before the fit to `watch`, which may stop them.
    #[must_use]
    pub fn watch(self, watch: &'a Watch<'a>) -> Self {
        Self { watch: Some(watch), ..self }
    }

    /// Reads robot, policy and logs and checks the settings.
    ///
    /// # Errors
    /// Settings that contradict each other; files that are missing or unusable, each by name; a GPU that is missing or cannot do
    /// this fit; an interruption.
    pub fn open(self) -> Result<Setup, Error> {
        let read = |devices: &Devices| {
            let silent = Watch::silent();
            let watch = self.watch.unwrap_or(&silent);
            Setup::read_all(self.config, self.config_path, self.threads, devices, self.policy, watch)
        };
        let error = match read(&self.devices) {
            Err(error) => error,
            opened => return opened,
        };
        // The CPU stands in only where `auto` chose the GPU. One that was asked for must do the fit.
        let Some(note) = self.devices.instead(&error) else { return Err(error) };
        let mut setup = read(&Device::Cpu.into())?;
        // First, because it explains why the CPU simulates although there is a GPU.
        setup.warnings.insert(0, note);
        Ok(setup)
    }
}
