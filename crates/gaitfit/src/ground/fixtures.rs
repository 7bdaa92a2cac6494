//! What the tests of this folder share: a policy that has learnt nothing, and logs of it.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_learn::collect::{CollectOptions, collect};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::policy::Policy;
use gaitfit_learn::task::{Scene, TaskSettings};
use gaitfit_learn::{Training, TrainingSettings, ppo};
use gaitfit_log::Trajectory;
use gaitfit_physics::Preset;

/// The Go2 at the built-in task.
pub fn scene() -> Scene {
    let model = crate::robot::go2().unwrap();
    Scene::new(&model, &TaskSettings::default().calm(), Preset::Fast).unwrap()
}

/// A policy that has learnt nothing, with outputs that move the legs.
pub fn policy(scene: &Scene, seed: u64) -> Policy {
    let ppo = ppo::Settings {
        actor_hidden: vec![16],
        critic_hidden: vec![16],
        output_gain: 1.0,
        ..ppo::Settings::default()
    };
    let learner = Training::fresh_learner(scene, &ppo, seed).unwrap();
    let settings = TrainingSettings { environments: 1, steps: 1, iterations: 1 };
    Training::new(scene, None, &settings, learner, seed).unwrap().policy("", "")
}

/// Eight logs of up to a second, joints only or with the base's state.
pub fn logs(scene: &Scene, policy: &Policy, privileged: bool) -> Vec<Trajectory> {
    let subject = Subject { scene, policy, candidate: None, seed: 5 };
    let options = CollectOptions { count: 8, seconds: 1.0, shift: [0.0; 2], privileged };
    collect(&subject, &options, 1).unwrap().into_iter().map(|log| log.trajectory).collect()
}
