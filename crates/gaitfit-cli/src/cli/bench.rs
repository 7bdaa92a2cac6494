//! Arguments of `gaitfit bench`.

use super::Preset;
use clap::{Args, Subcommand, ValueEnum};

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Physics substeps a second of a trotting Go2
    Physics(BenchPhysics),
    /// Iterations of PPO on the default task
    Train(BenchTrain),
}

/// Arguments of `bench physics`.
#[derive(Debug, Args)]
pub struct BenchPhysics {
    /// Solver effort
    #[arg(long, value_enum, default_value_t = Preset::Fast)]
    pub preset: Preset,
    /// Which geoms may touch the ground
    #[arg(long, value_enum, default_value_t = Geoms::Feet)]
    pub geoms: Geoms,
    /// Threads
    #[arg(long, value_name = "N", default_value = "1")]
    pub threads: std::num::NonZeroUsize,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `bench train`.
#[derive(Debug, Args)]
pub struct BenchTrain {
    /// Robots at once
    #[arg(long, value_name = "N", default_value_t = 4096)]
    pub environments: usize,
    /// Control steps of a rollout
    #[arg(long, value_name = "N", default_value_t = 24)]
    pub steps: usize,
    /// Iterations that are measured, after two that are not
    #[arg(long, value_name = "N", default_value = "10")]
    pub iterations: std::num::NonZeroU32,
    /// Threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Which geoms may touch the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Geoms {
    /// The feet only
    Feet,
    /// Every collision geom
    All,
}
