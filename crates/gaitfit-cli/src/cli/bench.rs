//! Arguments of `gaitfit bench`.

use super::{Device, Devices, Preset};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Physics steps per second of a trotting Go2
    Physics(BenchPhysics),
    /// PPO iterations per second, of the default training or of your own
    Train(BenchTrain),
}

/// Arguments of `bench physics`.
#[derive(Debug, Args)]
pub struct BenchPhysics {
    /// Accuracy of the contact solver
    #[arg(long, value_enum, default_value_t = Preset::Fast)]
    pub preset: Preset,
    /// Which geoms may touch the ground
    #[arg(long, value_enum, default_value_t = Geoms::Feet)]
    pub geoms: Geoms,
    /// Self-contact
    #[arg(long, value_enum, default_value_t = OwnParts::Off)]
    pub self_contact: OwnParts,
    /// Threads
    #[arg(long, value_name = "N", default_value = "1")]
    pub threads: std::num::NonZeroUsize,
    /// Device: cpu, cuda (the first GPU), cuda:N, or auto (a GPU if one can be used)
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: Device,
    /// Number of robots that are simulated together [default: 1024 on the CPU, 4096 on a GPU]
    #[arg(long, value_name = "N")]
    pub environments: Option<std::num::NonZeroUsize>,
    /// GPU: physics steps per kernel launch
    #[arg(long, value_name = "N", default_value = "4")]
    pub substeps: std::num::NonZeroUsize,
    /// GPU: threads per robot, 1, 2 or 4 [default: depends on the number of robots]
    #[arg(long, value_name = "N", value_parser = lanes)]
    pub lanes: Option<usize>,
    /// GPU: guarded parts of fewer operations than this are always computed
    #[arg(long, value_name = "N", hide = true)]
    pub min_guarded: Option<usize>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

fn lanes(text: &str) -> Result<usize, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err("it must be 1, 2 or 4".to_owned()),
    }
}

/// Arguments of `bench train`.
#[derive(Debug, Args)]
pub struct BenchTrain {
    /// A training's configuration (TOML): its robot, task, networks and PPO [default: the default training]
    pub config: Option<PathBuf>,
    /// Number of robots that are simulated together [default: as in the training]
    #[arg(long, value_name = "N")]
    pub environments: Option<usize>,
    /// Control steps per rollout [default: as in the training]
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// Number of measured iterations; two more come first and do not count
    #[arg(long, value_name = "N", default_value = "10")]
    pub iterations: std::num::NonZeroU32,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
    /// Device: cpu, cuda (the first GPU), cuda:N, cuda:0,1 (several GPUs together), or auto (a GPU if one can be used)
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: Devices,
    /// GPU: precision of matrix products [default: as in a training]
    #[arg(long, value_name = "PRECISION")]
    pub precision: Option<Products>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// How exactly a GPU multiplies matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Products {
    /// 8 significant bits
    Bf16,
    /// 11 significant bits
    Tf32,
    /// About as exactly as f32
    F32,
}

/// Self-contact of the benchmark's robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OwnParts {
    /// None
    Off,
    /// All pairs of geoms that the robot file lets touch
    File,
    /// The ends of the limbs only
    Limbs,
}

/// Which geoms may touch the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Geoms {
    /// The feet only
    Feet,
    /// Every collision geom
    All,
}
