//! A robot that can be run from here: asked for logs, and for how well a policy walks on it.

mod command;
mod group;
mod probe;
mod process;
mod robot;
mod simulated;

pub use command::Command;
pub use probe::{Presence, asks_for_python, probe};
pub use process::{Output, ProcessError, Program};
pub use robot::Robot;
pub use simulated::{Simulated, truth};

use crate::Error;
use crate::evaluate::{Evaluation, Plan};
use crate::log_folder::write_whole;
use crate::watch::Watch;
use gaitfit_policy::Policy;
use std::path::{Path, PathBuf};

/// A policy as the stages of a loop take it.
pub struct PolicyFiles {
    /// Its name, for example `π₁`.
    pub name: String,
    /// Its file.
    pub safetensors: PathBuf,
    /// The policy as ONNX.
    pub onnx: PathBuf,
    /// As read.
    pub policy: Policy,
}

/// The robot.
pub enum Target {
    /// In this engine, with other numbers.
    Simulated(Box<Simulated>),
    /// By another program.
    Command(Command),
    /// A Go2, beside which a person stands.
    Robot(Robot),
}

impl Target {
    /// Records logs of the policy, a new folder `into`, which has all of them or does not exist.
    pub fn collect(
        &self,
        policy: &PolicyFiles,
        seed: u64,
        into: &Path,
        watch: &Watch<'_>,
    ) -> Result<(), Error> {
        match self {
            Self::Simulated(target) => {
                // What a simulator left is made again, to the same bits.
                let remove = |folder: &Path| drop(std::fs::remove_dir_all(folder));
                write_whole(into, |folder| {
                    target.collect(policy, seed, folder, watch).inspect_err(|_| remove(folder))
                })
            }
            Self::Command(target) => write_whole(into, |folder| target.collect(policy, seed, folder, watch)),
            // It moves its logs into place itself: walks of a stopped session are kept beside them.
            Self::Robot(target) => target.collect(policy, seed, into, watch),
        }
    }

    /// Measures the policy; none where a command says nothing of it, and on a robot, which does not know how fast it is.
    pub fn evaluate(
        &self,
        policy: &PolicyFiles,
        plan: &Plan,
        watch: &Watch<'_>,
    ) -> Result<Option<Evaluation>, Error> {
        match self {
            Self::Simulated(target) => Ok(Some(target.evaluate(policy, plan, watch)?)),
            Self::Command(target) => target.evaluate(policy, plan, watch),
            Self::Robot(_) => Ok(None),
        }
    }

    /// Whether it can be measured how well a policy walks on it.
    pub fn measures(&self) -> bool {
        match self {
            Self::Simulated(_) => true,
            Self::Command(target) => target.measures(),
            Self::Robot(_) => false,
        }
    }

    /// The robot in a few words.
    pub fn description(&self) -> String {
        match self {
            Self::Simulated(target) => target.description(),
            Self::Command(target) => target.description(),
            Self::Robot(target) => target.description(),
        }
    }
}
