//! Steps of policies that observe more than their sensors and their last action.

use super::along::{compare, go2, lively};
use super::stepwise;
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_physics::Preset;
use gaitfit_policy::{FrameOrder, History, HistoryStart, Quantity, Term};
use gaitfit_sim::Candidate;

/// Actor and critic observe the action before the last: the actor behind the last one, the critic before it.
fn with_earlier_actions(frames: usize, order: FrameOrder) -> TaskSettings {
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    settings.policy.history = History { order, start: HistoryStart::First };
    let policy = &mut settings.policy;
    let scaled = policy.observation.iter_mut().chain(&mut policy.critic_observation);
    let last = scaled.filter(|term| term.quantity == Quantity::LastAction);
    // Powers of two, so that factors that are divided out leave no trace.
    last.for_each(|term| term.scale = vec![0.5]);
    policy.observation.push(Term::new(Quantity::EarlierAction).scaled(&[2.0]));
    policy.critic_observation.insert(1, Term::new(Quantity::EarlierAction));
    let scales: Vec<f32> = (0..12).map(|k| [1.0, -0.25, 4.0][k % 3]).collect();
    policy.critic_observation.insert(3, Term::new(Quantity::EarlierAction).scaled(&scales));
    policy.observation.iter_mut().for_each(|term| term.history = frames);
    settings
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_with_the_action_before_the_last_are_the_cpus() {
    for (frames, order) in [(1, FrameOrder::Terms), (3, FrameOrder::NewestFirst)] {
        let mut settings = with_earlier_actions(frames, order);
        if order != FrameOrder::Terms {
            settings.policy.critic_observation.iter_mut().for_each(|term| term.history = 2);
        }
        let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
        compare(&format!("earlier actions, {frames} frames"), &task, &Candidate::nominal(&go2()));
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_under_given_actions_with_the_action_before_the_last_are_the_cpus() {
    let task = Task::new(&go2(), &with_earlier_actions(1, FrameOrder::Terms), Preset::Fast).unwrap();
    stepwise::compare("earlier actions", &task, &Candidate::nominal(&go2()), true);
}
