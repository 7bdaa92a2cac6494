//! Policies that observe the past: rows, episodes, checkpoints, logs and files.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::task_common;

use std::sync::Mutex;

use gaitfit_learn::collect::{CollectOptions, collect};
use gaitfit_learn::evaluate::{Subject, run_trials};
use gaitfit_learn::task::{Ended, Environment, Task, TaskSettings};
use gaitfit_learn::{Origin, Training, TrainingSettings, ppo};
use gaitfit_physics::Preset;
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::{FrameOrder, History, Policy};
use gaitfit_policy_files::{onnx, weights};
use gaitfit_sim::Candidate;
use task_common::{go2, random_policy, script, single, step};

const FRAMES: usize = 5;

/// The walk of the Go2, its observations with five frames and the critic's with two.
fn settings(order: FrameOrder) -> TaskSettings {
    let mut task = TaskSettings { episode_seconds: 0.16, ..TaskSettings::default() };
    task.policy.history = History { order, ..History::default() };
    task.policy.observation.iter_mut().for_each(|term| term.history = FRAMES);
    task.policy.critic_observation.iter_mut().for_each(|term| term.history = 2);
    task
}

fn scene(task: &TaskSettings) -> Task {
    Task::new(&go2(), task, Preset::Fast).unwrap()
}

/// Rows with past frames are the rows without them, noise included, one behind the other; an episode begins with its
/// first.
#[test]
fn rows_stack_what_was_observed_since_the_episode_began() {
    let stacked = scene(&settings(FrameOrder::Frames));
    let mut plain = settings(FrameOrder::Frames);
    plain.policy.observation.iter_mut().for_each(|term| term.history = 1);
    plain.policy.critic_observation.iter_mut().for_each(|term| term.history = 1);
    let plain = scene(&plain);
    let count = 3;
    let mut environments = [&stacked, &plain].map(|task| Environment::new(task, None, 5, 0, count).unwrap());
    let (width, critic) = (plain.walker.observation.width(), plain.walker.critic_observation.width());
    assert_eq!(stacked.walker.observation.width(), FRAMES * width);
    let mut seen: Vec<[Vec<Vec<f32>>; 2]> = vec![[Vec::new(), Vec::new()]; count];
    let mut begun = 0;
    for number in 1..=20 {
        let [stacked, plain] = &mut environments;
        let (mut all, mut now) = (vec![f32::NAN; count * FRAMES * width], vec![f32::NAN; count * width]);
        let (mut two, mut one) = (vec![f32::NAN; count * 2 * critic], vec![f32::NAN; count * critic]);
        // Twice, as a learner asks for a critic's rows twice.
        for _ in 0..2 {
            stacked.observe(number, &mut all);
            stacked.observe_critic(&mut two);
        }
        plain.observe(number, &mut now);
        plain.observe_critic(&mut one);
        for (index, [rows, critics]) in seen.iter_mut().enumerate() {
            rows.push(now[index * width..(index + 1) * width].to_vec());
            critics.push(one[index * critic..(index + 1) * critic].to_vec());
            let last = |rows: &[Vec<f32>], frames: usize| -> Vec<f32> {
                let at = |back: usize| &rows[rows.len().saturating_sub(1 + back)];
                (0..frames).rev().flat_map(|back| at(back).clone()).collect()
            };
            assert!(all[index * FRAMES * width..][..FRAMES * width] == last(rows, FRAMES), "step {number}");
            assert!(two[index * 2 * critic..][..2 * critic] == last(critics, 2), "step {number}");
        }
        let (_, ended) = step(stacked, number, 0.1);
        assert_eq!(step(plain, number, 0.1).1, ended);
        stacked.begin_episodes(number, &ended);
        plain.begin_episodes(number, &ended);
        for (rows, _) in seen.iter_mut().zip(&ended).filter(|(_, ended)| **ended != Ended::No) {
            *rows = [Vec::new(), Vec::new()];
            begun += 1;
        }
    }
    assert!(begun >= 2 * count, "{begun} episodes ended");
}

fn training(task: &Task) -> Training<'_> {
    let ppo = ppo::Settings {
        actor_hidden: vec![16],
        critic_hidden: vec![16],
        normalise_observations: true,
        ..ppo::Settings::default()
    };
    let learner = Training::fresh_learner(task, &ppo, 7).unwrap();
    let settings = TrainingSettings { environments: 40, steps: 6, iterations: 4 };
    Training::new(task, None, &settings, learner, 7).unwrap()
}

#[test]
fn a_training_with_history_is_taken_up_again_with_the_same_bits_and_its_policy_is_read_back() {
    let scene = scene(&settings(FrameOrder::Terms));
    let origin = Origin { robot: "go2".to_owned(), model: "m".to_owned(), settings: "s".to_owned(), seed: 7 };
    let mut whole = training(&scene);
    whole.iterate(2).unwrap();
    let saved = whole.save(&origin, 0.0).unwrap();
    let mut resumed = training(&scene);
    resumed.restore(&saved, &origin).unwrap();
    while !whole.finished() {
        assert_eq!(whole.iterate(1).unwrap().tally, resumed.iterate(2).unwrap().tally);
    }
    let policy = whole.policy("", "");
    assert_eq!(policy, resumed.policy("", ""));
    assert_eq!(weights::read(&weights::write(&policy).unwrap()).unwrap(), policy);
    let graph = onnx::read(&onnx::write(&policy).unwrap()).unwrap();
    assert_eq!((&graph.actor, &graph.interface), (&policy.actor, &policy.interface));
    let subject =
        Subject { task: &scene, policy: &policy, candidate: None, seed: 3, cancel: None, moved: None };
    let trials = run_trials(&subject, 4, 0.5, 1).unwrap();
    assert!(trials.iter().all(|trial| trial.steps > 0 && trial.reward.is_finite()));
}

fn tracks(scene: &Task, policy: &Policy, script: &Script, reset_every: Option<usize>) -> Track {
    let job = Job { candidate: Candidate::nominal(scene.walker.model()), reset_every, seed: 0 };
    let kept = Mutex::new(Track::default());
    let keep = |_: usize, _: usize, track: &Track| *kept.lock().unwrap() = track.clone();
    follow(&scene.walker, policy, std::slice::from_ref(script), &[job], 1, &keep, &|| false).unwrap();
    kept.into_inner().unwrap()
}

#[test]
fn followed_it_repeats_its_log_and_after_a_reset_it_remembers_the_log() {
    for order in [FrameOrder::Terms, FrameOrder::Frames, FrameOrder::NewestFirst] {
        let mut task = settings(order).calm();
        (task.start.yaw, task.start.tilt, task.start.joint_position) = (0.0, 0.0, 0.0);
        let scene = scene(&task);
        let policy = random_policy(&scene);
        let subject =
            Subject { task: &scene, policy: &policy, candidate: None, seed: 5, cancel: None, moved: None };
        let options = CollectOptions { count: 1, seconds: 0.4, shift: [0.0; 2], privileged: true };
        let log = collect(&subject, &options, 1).unwrap().remove(0).trajectory;
        let script = Script {
            start: scene.walker.start_from_joints(&log.position[..12], &log.velocity[..12]),
            ..script(&log)
        };
        let action = single(log.action.as_ref().unwrap());
        assert!(action.iter().any(|x| x.abs() > 0.05));
        let worst =
            |track: &Track| track.action.iter().zip(&action).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert_eq!(worst(&tracks(&scene, &policy, &script, None)), 0.0, "{order:?}");
        // Put into the logged state at every sample, it observes what it observed then.
        let reset = worst(&tracks(&scene, &policy, &script, Some(1)));
        assert!(reset < 1e-5, "{order:?}: {reset}");
    }
}
