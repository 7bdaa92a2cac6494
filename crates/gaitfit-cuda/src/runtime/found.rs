//! GPUs, driver and compiler of this machine, for `gaitfit doctor`.

use serde::Serialize;

use super::device::{DeviceInfo, count, describe};
use super::driver::Driver;
use super::nvrtc::Nvrtc;

/// GPUs, driver and compiler of this machine, and why not.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Found {
    /// Newest CUDA that the driver runs, for example "13.0"; none without a driver.
    pub driver: Option<String>,
    /// GPUs that the driver shows.
    pub gpus: Vec<DeviceInfo>,
    /// Version of the compiler NVRTC; `None` if it was not found.
    pub nvrtc: Option<String>,
    /// Path or name under which it was found.
    pub nvrtc_path: Option<String>,
    /// Things that are missing for a use of the GPU, a sentence each; empty if nothing is.
    pub problems: Vec<String>,
}

/// Looks for GPUs, driver and compiler. Never fails: what is missing is said.
pub fn find() -> Found {
    let mut report = Found::default();
    match Driver::get() {
        Err(error) => report.problems.push(error.to_string()),
        // Each part is asked on its own: a machine may have a driver and no compiler, or the reverse.
        Ok(driver) => {
            let mut version = 0;
            // SAFETY: the driver stores one int.
            if unsafe { (driver.driver_version)(&raw mut version) } == 0 {
                // CUDA has 1000 major + 10 minor.
                report.driver = Some(format!("{}.{}", version / 1000, version % 1000 / 10));
            }
            match count(driver) {
                Ok(0) => report.problems.push("the NVIDIA driver shows no GPU".into()),
                Ok(count) => {
                    for ordinal in 0..count {
                        match describe(driver, ordinal) {
                            Ok(info) => report.gpus.push(info),
                            Err(error) => report.problems.push(error.to_string()),
                        }
                    }
                }
                Err(error) => report.problems.push(error.to_string()),
            }
        }
    }
    match Nvrtc::get() {
        Ok(nvrtc) => {
            report.nvrtc = Some(format!("{}.{}", nvrtc.version.0, nvrtc.version.1));
            report.nvrtc_path = Some(nvrtc.path.display().to_string());
            for gpu in &report.gpus {
                if nvrtc.architecture(gpu.capability).is_none() {
                    let (major, minor) = gpu.capability;
                    let name = &gpu.name;
                    report.problems.push(format!(
                        "NVRTC does not compile for {name}, compute capability {major}.{minor}"
                    ));
                }
            }
        }
        Err(error) => report.problems.push(error.to_string()),
    }
    report
}
