//! A trained policy shown at work: ten seconds of commands on the robot that training varied.

use super::setup::Setup;
use crate::Error;
use crate::world::longest_delay;
use crate::{gait, replay};
use gaitfit_learn::evaluate::{GaitSummary, Subject, record_gait};
use gaitfit_learn::task::Task;
use gaitfit_policy::Policy;
use gaitfit_view::{GaitPicture, Replay};

/// A policy at work.
pub struct Shown {
    /// What its page plays.
    pub replay: Replay,
    /// Its gait.
    pub gait: GaitPicture,
    /// The gait in numbers.
    pub summary: GaitSummary,
    /// When it fell, s; the rest is not shown.
    pub fell: Option<f64>,
}

/// What [`Shown::gait`] shows.
pub const GAIT_CAPTION: &str = "standing, ahead and to the left, at the largest commands of its training";

/// Runs the policy's mean actions on the task without noise, pushes and variation, and records them.
pub fn show(setup: &Setup, policy: &Policy, title: &str) -> Result<Shown, Error> {
    let task = setup.scene.settings.calm();
    let interface = policy.interface.clone();
    let delay = setup.candidate.as_ref().map_or(0.0, longest_delay);
    let scene = Task::with_interface(&setup.model, &task, interface, setup.plan.preset, delay)?;
    let seed = policy.provenance.seed;
    let subject = Subject { task: &scene, policy, candidate: setup.candidate.as_ref(), seed, cancel: None };
    let record = record_gait(&subject, &gait::tour(&task.command))?;
    let fell = record.fell.then(|| record.steps() as f64 * record.dt);
    let ends = fell.map_or_else(String::new, |time| format!("; it fell after {time:.1} s"));
    let replay = Replay {
        title: title.to_owned(),
        note: format!(
            "{} iterations; standing, ahead, left, turning, back, standing{ends}",
            policy.provenance.iteration
        ),
        dt: record.dt,
        robots: vec![replay::robot_on(&setup.model.name, &scene.walker, &record)],
    };
    Ok(Shown { replay, gait: gait::picture(&record), summary: record.summary(&scene.gait_group), fell })
}
