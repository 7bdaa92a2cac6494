//! `gaitfit bench physics`: substeps a second.

use crate::cli;
use crate::exit::Failure;
use crate::output;
use gaitfit_model::SelfContact;
use gaitfit_sim::bench::{self, PhysicsBench};
use serde::Serialize;

/// Environments at once: enough to keep every thread in work, small enough for the caches.
const ENVIRONMENTS: usize = 1024;
/// Measured repetitions of ten control periods.
const REPETITIONS: usize = 200;

#[derive(Serialize)]
struct Document {
    substeps_per_second: f64,
    best_substeps_per_second: f64,
    threads: usize,
    lanes: usize,
    isa: &'static str,
    preset: &'static str,
    geoms: &'static str,
    own_pairs: usize,
    environments: usize,
    contacts: f64,
    base_height_m: f64,
}

/// Measures and prints.
pub fn run(args: &cli::BenchPhysics) -> Result<(), Failure> {
    let geoms = match args.geoms {
        cli::Geoms::Feet => bench::Geoms::Feet,
        cli::Geoms::All => bench::Geoms::All,
    };
    let pairs = match args.self_contact {
        cli::OwnParts::Off => SelfContact::Off,
        cli::OwnParts::File => SelfContact::File,
        cli::OwnParts::Limbs => SelfContact::Limbs,
    };
    // What is left out of the pairs is of no interest for a benchmark.
    let (model, _) = gaitfit::robot::go2()?.touching_itself(&pairs).map_err(Failure::failed)?;
    // A GPU needs another size and prints other numbers, so it has a file of its own.
    if let Some(ordinal) = args.device.gpu() {
        return super::physics_cuda::run(args, &model, geoms, ordinal);
    }
    let preset: gaitfit_physics::Preset = args.preset.into();
    let threads = args.threads.get();
    let what = PhysicsBench {
        preset,
        geoms,
        threads,
        // `--isa` is selected for the whole process already.
        isa: None,
        environments: args.environments.map_or(ENVIRONMENTS, std::num::NonZeroUsize::get),
        repetitions: REPETITIONS,
    };
    let speed = bench::physics(&model, &what).map_err(Failure::failed)?;
    let document = Document {
        substeps_per_second: speed.substeps_per_second,
        best_substeps_per_second: speed.best_substeps_per_second,
        threads: speed.threads,
        lanes: speed.lanes,
        isa: speed.isa.name(),
        preset: preset.name(),
        geoms: geoms.name(),
        own_pairs: model.self_pairs.len(),
        environments: speed.environments,
        contacts: speed.contacts,
        base_height_m: speed.base_height,
    };
    if args.json {
        return output::print_json(&document);
    }
    output::print(&format!(
        "{:.2} M substeps/s (median; best {:.2} M): {} preset, {} geoms, {} thread{}, {} lanes ({})\n\
         {} trotting robots, {:.1} contacts each, {} pairs of own parts, base at {:.2} m\n",
        1e-6 * document.substeps_per_second,
        1e-6 * document.best_substeps_per_second,
        document.preset,
        document.geoms,
        document.threads,
        if document.threads == 1 { "" } else { "s" },
        document.lanes,
        document.isa,
        document.environments,
        document.contacts,
        document.own_pairs,
        document.base_height_m
    ))
}
