//! A policy that acts in many environments of a GPU.

use gaitfit_policy::Policy;

use super::{Blocks, Networks, unknown_policy};
use crate::ppo::{Array, Id, Kind, Launch, Limits, Storage, Value};
use crate::runtime::{Argument, CudaError, Device, Kernel, Program, Shape, Stream};
use crate::words::Words;

/// Why a GPU cannot run a policy.
#[derive(Debug, thiserror::Error)]
pub enum ActorError {
    /// A policy that only the CPU runs.
    #[error("{0}")]
    Unsupported(&'static str),
    /// Layers that do not fit into a multiprocessor's memory.
    #[error(
        "a policy whose layers need {needed} bytes of a multiprocessor's memory (this GPU has {available})"
    )]
    TooWide {
        /// Bytes needed.
        needed: usize,
        /// Bytes there are.
        available: usize,
    },
}

/// The program of a policy and its arrays, made without a GPU.
#[derive(Clone, Debug)]
pub struct ActorPlan {
    /// The kernel.
    pub program: Program,
    /// What the kernel takes: numbers of the networks, observations and mean actions of all steps, and what the policy remembers.
    pub arrays: [Array; 4],
    /// The networks' numbers, the first of the arrays.
    pub numbers: Vec<f32>,
    environments: usize,
    shape: Shape,
}

impl ActorPlan {
    /// For rollouts of `steps` steps in `environments` environments.
    ///
    /// # Errors
    /// [`ActorError::Unsupported`] for a policy without networks, [`ActorError::TooWide`].
    pub fn new(
        policy: &Policy,
        environments: usize,
        steps: usize,
        limits: Limits,
    ) -> Result<Self, ActorError> {
        if let Some(what) = unknown_policy(policy) {
            return Err(ActorError::Unsupported(what));
        }
        let networks = Networks::new(policy);
        let available = limits.shared_memory.saturating_sub(Blocks::DECLARED);
        let wanted = [Blocks::new(environments, limits.processors.max(1)), Blocks::SMALLEST];
        let Some(blocks) = wanted.into_iter().find(|blocks| networks.shared(blocks.rows) <= available) else {
            return Err(ActorError::TooWide { needed: networks.shared(Blocks::SMALLEST.rows), available });
        };
        let (observation, actions) = (policy.interface.observation_width(), policy.interface.joints.len());
        let mut text = String::from(include_str!("../common.cuh"));
        text.push_str(include_str!("../rollout/kernels/structs.cu"));
        let mut words = Words { text };
        words.define("OBSERVATION", observation);
        words.define("ACTIONS", actions);
        networks.write(&mut words, policy, blocks);
        words.text.push_str(include_str!("../activations.cuh"));
        words.text.push_str(include_str!("kernels/network.cu"));
        words.text.push_str(include_str!("kernels/decide.cu"));
        let rows = environments * steps;
        let array = |name, length| Array { name, kind: Kind::F32, length };
        let shared = u32::try_from(networks.shared(blocks.rows)).unwrap_or(u32::MAX);
        Ok(Self {
            program: Program::new("policy", words.text).option("-fmad=false"),
            arrays: [
                array("network", networks.numbers.len()),
                array("observation", rows * observation),
                array("recurrent", environments * networks.remembered),
                array("mean", rows * actions),
            ],
            numbers: networks.numbers,
            environments,
            shape: Shape { shared, ..Shape::new(blocks.count(environments), blocks.threads()) },
        })
    }

    /// The launch that fills the mean actions of step `step` from its observations.
    pub fn decide(&self, step: usize) -> Launch {
        let word = |number: usize| Value::U32(u32::try_from(number).unwrap_or(u32::MAX));
        let arrays = (0..self.arrays.len()).map(|number| Value::Array(Id(number)));
        let numbers = [word(step * self.environments), word(self.environments)];
        Launch { kernel: "decide", shape: self.shape, arguments: numbers.into_iter().chain(arrays).collect() }
    }
}

/// A policy that acts in many environments of a GPU.
pub struct Actor {
    plan: ActorPlan,
    kernels: [(&'static str, Kernel); 1],
    network: Storage,
    recurrent: Storage,
}

impl Actor {
    /// The policy of a plan on a GPU. It remembers nothing.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn new(device: &Device, stream: &Stream, plan: ActorPlan) -> Result<Self, CudaError> {
        let module = device.load(&plan.program)?;
        let [network, recurrent] =
            [&plan.arrays[0], &plan.arrays[2]].map(|array| Storage::new(device, array));
        let actor = Self {
            kernels: [("decide", module.kernel("decide")?)],
            network: network?,
            recurrent: recurrent?,
            plan,
        };
        actor.network.write(stream, &actor.plan.numbers)?;
        Ok(actor)
    }

    /// All episodes begin: the policy remembers nothing.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn forget(&self, stream: &Stream) -> Result<(), CudaError> {
        self.recurrent.write(stream, &vec![0.0f32; self.plan.arrays[2].length])
    }

    /// Starts the work that fills the rows of step `step` of `mean` from those of `observation`. It can be recorded in a graph.
    ///
    /// # Errors
    /// [`CudaError::Launch`].
    pub fn decide(
        &self,
        stream: &Stream,
        step: usize,
        observation: Argument,
        mean: Argument,
    ) -> Result<(), CudaError> {
        let arguments = [self.network.argument(), observation, self.recurrent.argument(), mean];
        self.plan.decide(step).start(stream, &self.kernels, |number| arguments.get(number).cloned())
    }
}
