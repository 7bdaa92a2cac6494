//! Description of this machine: for `doctor` and the run's manifest.

use serde::Serialize;

/// Processor, threads and program version.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Version of the program.
    pub gaitfit: &'static str,
    /// Operating system and architecture.
    pub platform: String,
    /// Processor name; empty where the system does not tell.
    pub processor: String,
    /// Threads that can run at once.
    pub threads: usize,
    /// Vector instructions found, strongest first.
    pub features: Vec<&'static str>,
    /// Instruction set the engine takes.
    pub engine: &'static str,
}

/// Looks at the machine.
pub fn machine() -> Machine {
    Machine {
        gaitfit: env!("CARGO_PKG_VERSION"),
        platform: format!("{}-{}", std::env::consts::OS, std::env::consts::ARCH),
        processor: processor(),
        threads: threads(),
        features: features(),
        engine: gaitfit_isa::current().name(),
    }
}

pub use gaitfit_pool::threads;

fn processor() -> String {
    // Only Linux has this file. Elsewhere the name is empty.
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with("model name"));
    line.and_then(|line| line.split_once(':')).map(|(_, name)| name.trim().to_owned()).unwrap_or_default()
}

#[cfg(target_arch = "x86_64")]
fn features() -> Vec<&'static str> {
    let flags = [
        ("avx512f", is_x86_feature_detected!("avx512f")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
    ];
    flags.iter().filter(|(_, present)| *present).map(|(name, _)| *name).collect()
}

#[cfg(target_arch = "aarch64")]
fn features() -> Vec<&'static str> {
    vec!["neon"]
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn features() -> Vec<&'static str> {
    Vec::new()
}

/// The present time, UTC, ISO 8601.
pub fn now() -> String {
    humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string()
}
