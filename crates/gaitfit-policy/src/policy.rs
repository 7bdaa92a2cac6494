//! A policy: its interface, its networks, and where it came from.

use crate::network::{Memory, Network, Normaliser, Recurrent, Scratch};
use crate::{Front, Interface};
use serde::{Deserialize, Serialize};

/// A policy: what it sees, its networks, and where it came from. [`Policy::check`] says whether the parts fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// What the policy sees and what its outputs mean.
    pub interface: Interface,
    /// What stands between the (normalised) observation and the actor; none for most policies.
    pub front: Option<Front>,
    /// From the (normalised) observation, or from what the front gives, to the mean action; one output a joint, before
    /// scaling.
    pub actor: Network,
    /// Natural logarithm of the actions' standard deviation, one a joint.
    pub log_std: Vec<f32>,
    /// From the (normalised) critic observation, or from what the critic's memory gives, to the value; one output.
    pub critic: Option<Network>,
    /// Recurrent layers between the (normalised) critic observation and the critic.
    pub critic_memory: Option<Recurrent>,
    /// Normaliser of the actor's observation.
    pub normaliser: Option<Normaliser>,
    /// Normaliser of the critic's observation.
    pub critic_normaliser: Option<Normaliser>,
    /// Where it came from.
    pub provenance: Provenance,
    /// What was assumed when it was read, in words for people; files do not keep it.
    pub notes: Vec<String>,
}

/// Where a policy came from. Of policies trained elsewhere nothing is known: all zero and empty.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Seed of its training.
    pub seed: u64,
    /// SHA-256 of its training's configuration, hexadecimal.
    pub configuration_hash: String,
    /// Iterations it was trained.
    pub iteration: u32,
    /// Version of the program that trained it.
    pub program_version: String,
    /// Settings of the task it was trained on, as TOML.
    #[serde(default)]
    pub task: String,
    /// SHA-256 of the policy that its training began with, as `gaitfit_policy_files::weights::write` writes it, or
    /// `plain` there, where its file had no checksum, hexadecimal; empty where it began with new networks.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub parent: String,
    /// SHA-256 of the file of the fitted parameters (`theta.toml`) it was trained with, hexadecimal; empty where it
    /// was trained on the robot of the file.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub theta: String,
    /// The robot's file; absent where the robot was the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_file: Option<RobotFile>,
}

/// The robot file of a training.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotFile {
    /// Where it was: an absolute path.
    pub path: String,
    /// SHA-256 of it and of what it includes, hexadecimal.
    pub sha256: String,
    /// Whether what the engine cannot simulate was dropped from it.
    pub lenient: bool,
}

impl Policy {
    /// Mean actions, before scaling and clipping: `observation` is `rows × observation_width`, scaled as the
    /// interface's terms say, `actions` `rows × joints`; both row-major. The actor's normaliser is applied here.
    ///
    /// # Panics
    /// If a slice is shorter than its size, or the policy does not pass [`Policy::check`]: errors of the caller.
    ///
    /// A recurrent policy remembers nothing here: each row is an episode's first. [`Policy::act_with`] is for more.
    pub fn act(&self, rows: usize, observation: &[f32], actions: &mut [f32], scratch: &mut Scratch) {
        self.act_with(rows, observation, &mut self.memory(rows), actions, scratch);
    }

    /// The policy's memory for `environments` robots whose episodes begin.
    pub fn memory(&self, environments: usize) -> Memory {
        self.front.as_ref().map_or_else(Memory::default, |front| front.memory(environments))
    }

    /// As [`Policy::act`], with a memory of as many robots as there are rows, which takes up what the policy remembers.
    ///
    /// # Panics
    /// As there, or if the memory is of another number of robots.
    pub fn act_with(
        &self,
        rows: usize,
        observation: &[f32],
        memory: &mut Memory,
        actions: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let Some(front) = &self.front else {
            let normaliser = self.normaliser.as_ref();
            return self.actor.forward_normalised(normaliser, rows, observation, actions, scratch);
        };
        // The caller's array may have room for more rows.
        let observation = &observation[..rows * front.inputs()];
        // The normaliser stands before the front, so the actor behind it gets no further one.
        let mut normal = observation.to_vec();
        if let Some(normaliser) = &self.normaliser {
            normaliser.apply(observation, &mut normal);
        }
        let mut seen = Vec::new();
        front.step(rows, &normal, memory, &mut seen, scratch);
        self.actor.forward(rows, &seen, actions, scratch);
    }

    /// Why it cannot be trained on, in words, for example "an encoder before its actor"; `None` for a policy that can.
    pub fn untrainable(&self) -> Option<String> {
        if self.interface.reference.is_some() {
            return Some("a reference motion that it follows".to_owned());
        }
        match &self.front {
            Some(Front::Encoder(_)) => Some("an encoder before its actor".to_owned()),
            Some(Front::Function(_)) => Some("a function instead of a network".to_owned()),
            Some(Front::Graph(_)) => Some("a graph of operators instead of a plain network".to_owned()),
            Some(Front::Recurrent(_)) | None => {
                self.actor.untrainable().or_else(|| self.critic.as_ref()?.untrainable())
            }
        }
    }

    /// The recurrent layers before its actor.
    pub fn actor_memory(&self) -> Option<&Recurrent> {
        match &self.front {
            Some(Front::Recurrent(recurrent)) => Some(recurrent),
            _ => None,
        }
    }

    /// Whether it remembers what it observed.
    pub fn is_recurrent(&self) -> bool {
        match &self.front {
            Some(Front::Recurrent(_)) => true,
            Some(Front::Graph(graph)) => graph.is_recurrent(),
            _ => false,
        }
    }
}
