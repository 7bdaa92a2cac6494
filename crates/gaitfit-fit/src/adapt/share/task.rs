//! What helpers are asked, and what they answer, as JSON: numbers keep their bits.

use gaitfit_adapt::fit::{Comparison, Job, Question};
use gaitfit_adapt::{Rollout, SimulatorError, Theta};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// A task.
#[derive(Serialize, Deserialize)]
pub(super) struct Task {
    /// 0 for the fit's simulator, and from 1 for those that could stand in for it.
    pub simulator: usize,
    /// Meaning of the values of candidates.
    pub values: Values,
    /// The work to be done.
    pub work: Work,
}

/// Meaning of a candidate's values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Values {
    /// The candidate has no values: it is the robot before the fit.
    None,
    /// Values of the fit's θ, and of springs on these joints.
    Fitted { springs: Vec<String> },
}

/// Work that a helper does.
#[derive(Serialize, Deserialize)]
pub(super) enum Work {
    /// Costs of jobs, whose costs are numbers of the setup's: answered by [`gaitfit_adapt::fit::Evaluation`]s.
    Costs(Vec<Job>),
    /// Costs of rollouts in all views of cost number `cost`, or of all logs alone: answered by
    /// [`gaitfit_adapt::fit::Costs`].
    Views { cost: usize, whole: bool, rollouts: Vec<Rollout> },
    /// Signals, see [`super::signals`].
    Signals(Vec<Rollout>),
    /// A question to the set of simulated logs of `number`: answered by [`Answered`].
    Ask { cost: usize, draw: u64, question: Question, number: u32 },
}

/// Answer of a set of simulated logs.
#[derive(Clone, Serialize, Deserialize)]
pub(super) enum Answered {
    /// The comparison.
    Compared(Comparison),
    /// Why there is no comparison.
    Said(String),
}

impl Task {
    /// The task as bytes to be sent.
    pub fn bytes(&self) -> Result<Vec<u8>, SimulatorError> {
        bytes(self)
    }
}

impl Values {
    /// The values of `theta`. `entries`: names of the fit's own entries. `theta` may have more entries: they are
    /// springs of single joints.
    pub fn new(theta: &Theta, entries: &[String]) -> Self {
        // The robot before the fit is simulated with an empty θ.
        if theta.is_empty() {
            return Self::None;
        }
        let mut springs: Vec<String> = Vec::new();
        for entry in theta.entries().iter().filter(|entry| !entries.contains(&entry.name)) {
            // Stiffness and torque of one spring name the same joint, which is asked for once.
            springs.extend(
                entry.joints.iter().filter(|joint| !springs.contains(joint)).cloned().collect::<Vec<_>>(),
            );
        }
        Self::Fitted { springs }
    }
}

/// Bytes of a value that is sent.
pub(super) fn bytes<T: Serialize>(value: &T) -> Result<Vec<u8>, SimulatorError> {
    serde_json::to_vec(value).map_err(|error| SimulatorError::failed(format!("cannot be sent: {error}")))
}

/// A value from the bytes that were sent.
pub(super) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, SimulatorError> {
    serde_json::from_slice(bytes).map_err(|error| {
        SimulatorError::failed(format!(
            "what another process sent cannot be read, as if it were of another version: {error}"
        ))
    })
}
