//! A policy that is a function of the caller: a network of another library, or anything else that acts.

use crate::error::invalid;
use crate::network::Network;
use crate::{Front, Interface, Policy, PolicyError, Provenance};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What acts: `call(rows, observation, actions)` fills `actions`, `rows × joints`, from `observation`, `rows ×
/// observation_width`, both row-major and as [`Policy::act`] has them. False says that it failed. It is called from any
/// thread, and remembers nothing from one call to the next.
pub type Act = dyn Fn(usize, &[f32], &mut [f32]) -> bool + Send + Sync;

/// A function of the caller in a policy's place ([`Policy::of_function`]). It is no network: files do not hold it, GPUs
/// do not run it, and it cannot be trained on.
#[derive(Clone)]
pub struct Function {
    call: Arc<Act>,
    /// Set by the first call that fails; nothing is asked of the function from then on.
    failed: Arc<AtomicBool>,
    inputs: usize,
    outputs: usize,
}

impl Function {
    /// Width of the observation that it takes.
    pub(crate) fn inputs(&self) -> usize {
        self.inputs
    }

    /// Actions that it gives.
    pub(crate) fn outputs(&self) -> usize {
        self.outputs
    }

    /// Whether a call has failed: what was computed since means nothing.
    pub(crate) fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Acquire)
    }

    /// The actions of `rows` robots; zeros where a call failed, now or before.
    pub(crate) fn act(&self, rows: usize, observation: &[f32], actions: &mut Vec<f32>) {
        actions.clear();
        actions.resize(rows * self.outputs, 0.0);
        let sound = !self.has_failed()
            && (self.call)(rows, observation, actions)
            // A NaN would become a target of a motor.
            && actions.iter().all(|action| action.is_finite());
        if !sound {
            self.failed.store(true, Ordering::Release);
            actions.fill(0.0);
        }
    }
}

impl fmt::Debug for Function {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Function({} → {})", self.inputs, self.outputs)
    }
}

impl PartialEq for Function {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.call, &other.call)
    }
}

impl Policy {
    /// A policy that acts by `call`. One that fails, or gives what is not finite, ends whatever uses the policy, with an
    /// error; who calls keeps the reason.
    ///
    /// # Errors
    /// An interface that contradicts itself or observes nothing.
    pub fn of_function(interface: Interface, call: Arc<Act>) -> Result<Self, PolicyError> {
        // The interface is checked before its widths are read.
        interface.check()?;
        let (inputs, joints) = (interface.observation_width(), interface.joints.len());
        let function = Function { call, failed: Arc::default(), inputs, outputs: joints };
        let policy = Self {
            front: Some(Front::Function(function)),
            // The function's actions pass through the identity unchanged.
            actor: Network::identity(joints)?,
            // A function has no σ, but `check` wants one number for each joint.
            log_std: vec![0.0; joints],
            critic: None,
            normaliser: None,
            critic_memory: None,
            critic_normaliser: None,
            provenance: Provenance::default(),
            notes: Vec::new(),
            interface: Interface { critic_observation: Vec::new(), ..interface },
        };
        policy.check()?;
        Ok(policy)
    }

    /// Whether a function of the caller's failed: what it acted since means nothing. Simulations ask after each step.
    pub fn has_failed(&self) -> bool {
        matches!(&self.front, Some(Front::Function(function)) if function.has_failed())
    }

    /// Refuses a policy that is a function, of which there is no `what`: for writers of files.
    ///
    /// # Errors
    /// As it says.
    pub fn refuse_function(&self, what: &str) -> Result<(), PolicyError> {
        match self.front {
            Some(Front::Function(_)) => Err(invalid(format!(
                "the policy is a function of the caller's, and {what} holds networks: export it from where it is from"
            ))),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::network::Scratch;
    use crate::{Quantity, Term};

    fn interface() -> Interface {
        Interface {
            robot: String::new(),
            joints: vec!["a".to_owned(), "b".to_owned()],
            default_pose: vec![0.0; 2],
            action_scale: vec![0.5; 2],
            action_clip: None,
            kp: vec![20.0; 2],
            kd: vec![0.5; 2],
            velocity_joints: Vec::new(),
            held: Vec::new(),
            control_dt: 0.02,
            gait_frequency: None,
            reference: None,
            history: Default::default(),
            observation: vec![Term::new(Quantity::JointPosition), Term::new(Quantity::Command)],
            critic_observation: Vec::new(),
        }
    }

    #[test]
    fn actions_are_the_functions_bit_for_bit() {
        let call = |rows: usize, seen: &[f32], actions: &mut [f32]| {
            for row in 0..rows {
                actions[2 * row] = seen[5 * row] * 1.1;
                actions[2 * row + 1] = -seen[5 * row + 4] / 3.0;
            }
            true
        };
        let policy = Policy::of_function(interface(), Arc::new(call)).unwrap();
        let seen: Vec<f32> = (0..35).map(|number| (number as f32 * 0.37).sin()).collect();
        let (mut action, mut wanted) = (vec![0.0; 14], vec![0.0; 14]);
        policy.act(7, &seen, &mut action, &mut Scratch::default());
        call(7, &seen, &mut wanted);
        assert_eq!(action, wanted);
        assert!(!policy.has_failed());
        assert!(policy.untrainable().is_some());
        assert!(policy.refuse_function("a file").unwrap_err().to_string().contains("function"));
        let blind = Interface { observation: Vec::new(), ..interface() };
        assert!(Policy::of_function(blind, Arc::new(call)).is_err());
    }

    #[test]
    fn a_failure_lasts_and_nothing_is_asked_any_more() {
        for bad in [None, Some(f32::NAN), Some(f32::INFINITY)] {
            let calls = Arc::new(AtomicBool::new(false));
            let again = calls.clone();
            let call = move |_: usize, _: &[f32], actions: &mut [f32]| {
                assert!(!again.swap(true, Ordering::Relaxed), "asked twice");
                actions.fill(bad.unwrap_or(3.0));
                bad.is_some()
            };
            let policy = Policy::of_function(interface(), Arc::new(call)).unwrap();
            let mut action = vec![7.0; 2];
            for _ in 0..2 {
                policy.act(1, &[0.1; 5], &mut action, &mut Scratch::default());
                assert_eq!(action, [0.0; 2]);
                assert!(policy.clone().has_failed());
            }
        }
    }
}
