//! `gaitfit bench physics --device cuda`: speed and accuracy on a GPU.

use crate::cli;
use crate::exit::Failure;
use crate::output;
use gaitfit_cuda::emit::EmitOptions;
use gaitfit_cuda::physics::DeviceError;
use gaitfit_cuda::physics::bench::{self, BenchError, PhysicsBench};
use gaitfit_cuda::runtime::{CudaError, Device, bytes};
use gaitfit_model::Model;
use gaitfit_sim::bench::Geoms;
use serde::Serialize;

/// Robots at once.
const ENVIRONMENTS: usize = 4096;
/// Measured repetitions of about eighty physics steps.
const REPETITIONS: usize = 9;

#[derive(Serialize)]
struct Document {
    substeps_per_second: f64,
    best_substeps_per_second: f64,
    device: String,
    lanes: usize,
    preset: &'static str,
    geoms: &'static str,
    own_pairs: usize,
    environments: usize,
    substeps: usize,
    registers: i32,
    local_bytes: i32,
    compile_seconds: f64,
    cached: bool,
    memory_bytes: usize,
    checked_robots: usize,
    velocity_error_median: f64,
    velocity_error_largest: f64,
    position_error_largest: f64,
    same_bits: bool,
    base_height_m: f64,
}

/// Measures and prints.
pub fn run(args: &cli::BenchPhysics, model: &Model, geoms: Geoms, ordinal: usize) -> Result<(), Failure> {
    let preset: gaitfit_physics::Preset = args.preset.into();
    let device = Device::open(ordinal).map_err(cuda)?;
    let mut emit = EmitOptions::default();
    // Only for those who tune the emitter; the default is the one that trainings use.
    if let Some(min) = args.min_guarded {
        emit.min_guarded = min;
    }
    let what = PhysicsBench {
        preset,
        geoms,
        environments: args.environments.map_or(ENVIRONMENTS, std::num::NonZeroUsize::get),
        substeps: args.substeps.get(),
        lanes: args.lanes,
        emit,
        repetitions: REPETITIONS,
    };
    // A missing GPU or driver has an exit code of its own, so it is told apart.
    let speed = bench::physics(&device, model, &what).map_err(|error| match error {
        BenchError::Device(DeviceError::Cuda(error)) => cuda(error),
        error => Failure::failed(error),
    })?;
    let document = Document {
        substeps_per_second: speed.substeps_per_second,
        best_substeps_per_second: speed.best_substeps_per_second,
        device: device.info().name.clone(),
        lanes: speed.lanes,
        preset: preset.name(),
        geoms: geoms.name(),
        own_pairs: model.self_pairs.len(),
        environments: what.environments,
        substeps: what.substeps,
        registers: speed.registers,
        local_bytes: speed.local_bytes,
        compile_seconds: speed.compile_seconds,
        cached: speed.cached,
        memory_bytes: speed.bytes,
        checked_robots: speed.checked,
        velocity_error_median: speed.velocity_error[0],
        velocity_error_largest: speed.velocity_error[1],
        position_error_largest: speed.position_error,
        same_bits: speed.same_bits,
        base_height_m: speed.base_height,
    };
    if args.json {
        return output::print_json(&document);
    }
    output::print(&format!(
        "{:.0} M substeps/s (median; best {:.0} M): {}, {} preset, {} geoms, {} substeps a launch\n\
         {} trotting robots, {} thread{} each, {} registers, {} of the GPU's memory, base at {:.2} m\n\
         one control period of {} robots: velocities within {:.1e} of f64 (m/s, rad/s), {}\n",
        1e-6 * document.substeps_per_second,
        1e-6 * document.best_substeps_per_second,
        document.device,
        document.preset,
        document.geoms,
        document.substeps,
        document.environments,
        document.lanes,
        if document.lanes == 1 { "" } else { "s" },
        document.registers,
        bytes(document.memory_bytes as u64),
        document.base_height_m,
        document.checked_robots,
        document.velocity_error_largest,
        if document.same_bits { "the same bits twice" } else { "OTHER BITS the second time" },
    ))
}

fn cuda(error: CudaError) -> Failure {
    gaitfit::device::cuda_error(&error).into()
}
