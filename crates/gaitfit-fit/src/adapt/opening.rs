//! How a fit is opened.

use super::setup::Setup;
use crate::Error;
use crate::device::{Device, Devices};
use crate::settings::AdaptConfig;
use crate::watch::Watch;
use gaitfit_policy::Policy;
use std::path::Path;

/// Settings, and what goes with them: [`Opening::open`] makes a [`Setup`] of it. By default the CPU simulates on as many
/// threads as the settings say, and the policy that walked is read from the file that they name.
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
    /// A fit with these settings. `config_path`: where they were read, which relative paths may start from.
    pub fn new(config: &'a AdaptConfig, config_path: &'a Path) -> Self {
        Self { config, config_path, threads: None, devices: Device::Cpu.into(), policy: None, watch: None }
    }

    /// On so many threads; `None`: as the settings say.
    #[must_use]
    pub fn threads(self, threads: impl Into<Option<usize>>) -> Self {
        Self { threads: threads.into(), ..self }
    }

    /// `devices` simulate and share the candidates. The CPU does what a GPU that `auto` found does not do.
    #[must_use]
    pub fn devices(self, devices: &Devices) -> Self {
        Self { devices: devices.clone(), ..self }
    }

    /// The policy that walked, if it is given; then the settings say only what it is called.
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
    /// Settings that do not go together; files that are not there or not usable, each by name; a GPU that is not there, or
    /// that does not do what is asked; an interruption.
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
        let Some(note) = self.devices.instead(&error) else { return Err(error) };
        let mut setup = read(&Device::Cpu.into())?;
        setup.warnings.insert(0, note);
        Ok(setup)
    }
}
