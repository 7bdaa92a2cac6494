//! `gaitfit doctor`: what this machine offers.

use serde::Serialize;

use crate::exit::Failure;
use crate::output;
use gaitfit::device::Device;
use gaitfit::machine::{Machine, machine};
use gaitfit_cuda::runtime::{Found, bytes, find};

/// The document that is printed as JSON.
#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    machine: Machine,
    cuda: Found,
    /// The device that `--device auto`, the default, takes.
    device: String,
}

/// Prints version, processor, vector instructions, threads and GPUs.
pub fn run(args: &crate::cli::Doctor) -> Result<(), Failure> {
    let (machine, cuda) = (machine(), find());
    let device = Device::among(&cuda).to_string();
    if args.json {
        return output::print_json(&Report { machine, cuda, device });
    }
    // Some systems report no name of the processor and no features.
    let named = |text: &str| if text.is_empty() { "unknown".to_owned() } else { text.to_owned() };
    output::print(&format!(
        "gaitfit    {}\nplatform   {}\nprocessor  {}\nfeatures   {}\nengine     {}\nthreads    {}\n{}device     \
         {device} (used by fits and trainings without --device)\n",
        machine.gaitfit,
        machine.platform,
        named(&machine.processor),
        named(&machine.features.join(", ")),
        machine.engine,
        machine.threads,
        gpus(&cuda),
    ))
}

/// One line a GPU, then driver and compiler, then what is missing.
fn gpus(cuda: &Found) -> String {
    let mut lines = Vec::new();
    for gpu in &cuda.gpus {
        let (major, minor) = gpu.capability;
        let memory = bytes(gpu.memory);
        let (number, name) = (gpu.ordinal, &gpu.name);
        lines.push(format!("GPU {number}      {name}, {memory}, compute capability {major}.{minor}"));
    }
    if let Some(driver) = &cuda.driver {
        lines.push(format!("CUDA       {driver} (driver)"));
    }
    if let (Some(version), Some(path)) = (&cuda.nvrtc, &cuda.nvrtc_path) {
        lines.push(format!("NVRTC      {version} ({path})"));
    }
    // Last: a machine without a GPU has these lines alone.
    lines.extend(cuda.problems.iter().map(|problem| format!("no GPU     {problem}")));
    lines.iter().map(|line| format!("{line}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gpus_and_what_is_missing_are_said() {
        let mut cuda = Found { problems: vec!["there is no NVIDIA driver".into()], ..Found::default() };
        assert_eq!(gpus(&cuda), "no GPU     there is no NVIDIA driver\n");
        cuda.problems.clear();
        cuda.driver = Some("13.0".into());
        cuda.gpus.push(gaitfit_cuda::runtime::DeviceInfo {
            ordinal: 0,
            name: "NVIDIA H200".into(),
            memory: 141 << 30,
            capability: (9, 0),
            processors: 132,
            shared_memory: 232_448,
            cache: 60 << 20,
        });
        let wanted = "GPU 0      NVIDIA H200, 141.0 GiB, compute capability 9.0\nCUDA       13.0 (driver)\n";
        assert_eq!(gpus(&cuda), wanted);
    }
}
