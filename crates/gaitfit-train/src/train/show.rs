//! A trained policy shown at work: ten seconds of commands on the robot that training varied.

use super::setup::Setup;
use crate::Error;
use crate::gait;
use crate::world::longest_delay;
use gaitfit_learn::evaluate::{GaitRecord, GaitSummary, Subject, record_gait};
use gaitfit_learn::task::Task;
use gaitfit_policy::Policy;

/// A policy at work.
pub struct Shown {
    /// The task that it did.
    pub scene: Task,
    /// What it did; the time after a fall is not recorded.
    pub record: GaitRecord,
}

/// Runs the policy's mean actions on the task without noise, pushes and variation, and records them.
pub fn show(setup: &Setup, policy: &Policy) -> Result<Shown, Error> {
    let settings = &setup.scene.settings;
    // A fine-tuning shows its fitted robot as it is; a training from nothing adds the rotor inertia that all
    // its robots had.
    let task = if setup.candidate.is_some() { settings.calm() } else { settings.nominal() };
    let interface = policy.interface.clone();
    // The simulator keeps as many past targets as the fitted robot's delay needs.
    let delay = setup.candidate.as_ref().map_or(0.0, longest_delay);
    let scene = Task::with_interface(&setup.model, &task, interface, setup.plan.preset, delay)?;
    let seed = policy.provenance.seed;
    let subject = Subject {
        task: &scene,
        policy,
        candidate: setup.candidate.as_ref(),
        seed,
        cancel: None,
        moved: None,
    };
    let record = record_gait(&subject, &gait::tour(&task.command))?;
    Ok(Shown { scene, record })
}

impl Shown {
    /// The gait in numbers.
    pub fn summary(&self) -> GaitSummary {
        self.record.summary(&self.scene.gait_group)
    }

    /// Time of its fall, s.
    pub fn fell(&self) -> Option<f64> {
        self.record.fell.then(|| self.record.steps() as f64 * self.record.dt)
    }
}
