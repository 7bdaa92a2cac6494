//! Evaluation of policies whose walk is known beforehand: they stand, or they fall.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::task_common;

use gaitfit_learn::collect::{CollectOptions, collect};
use gaitfit_learn::evaluate::{
    Subject, Trial, crossing_size, crossings, drift, drift_periods, record_gait, run_trials, summarise,
};
use gaitfit_learn::task::{Kinds, Task, TaskError, TaskSettings, TerrainKind, TerrainSettings};
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use gaitfit_sim::stats::Estimate;
use std::sync::atomic::{AtomicUsize, Ordering};
use task_common::{calm, constant_policy, random_policy, scene};

const STILL: [f32; 12] = [0.0; 12];

fn subject<'a>(scene: &'a Task, policy: &'a Policy) -> Subject<'a> {
    Subject { task: scene, policy, candidate: None, seed: 11, cancel: None, moved: None }
}

/// Hind legs stretch, front legs fold: onto the nose.
fn nose_dive() -> [f32; 12] {
    let mut action = STILL;
    for (leg, [thigh, calf]) in [[3.0, -4.0], [3.0, -4.0], [-2.0, 4.0], [-2.0, 4.0]].into_iter().enumerate() {
        (action[3 * leg + 1], action[3 * leg + 2]) = (thigh, calf);
    }
    action
}

fn mean(estimate: Option<Estimate>) -> f64 {
    estimate.unwrap().mean
}

fn half_width(estimate: Option<Estimate>) -> f64 {
    estimate.unwrap().ci95.unwrap()
}

#[test]
fn robots_that_diverge_are_falls_and_told() {
    let scene = scene(&calm());
    let policy = constant_policy(&scene, &[f32::NAN; 12]);
    let trials = run_trials(&subject(&scene, &policy), 3, 0.2, 1).unwrap();
    let summary = summarise(&trials);
    assert_eq!((summary.trajectories, summary.diverged, mean(summary.fall_rate)), (3, 3, 1.0));
    assert_eq!((summary.reward, summary.linear_velocity_error), (None, None));
    for trial in drift(&subject(&scene, &policy), 2, None, 1).unwrap() {
        assert_eq!((trial.diverged, mean(trial.fall_rate), trial.x), (2, 1.0, None), "{}", trial.name);
    }
}

#[test]
fn a_standing_policy_misses_its_commands_by_all_of_them() {
    let scene = scene(&calm());
    let policy = constant_policy(&scene, &STILL);
    let trials = run_trials(&subject(&scene, &policy), 12, 2.0, 1).unwrap();
    assert_eq!(trials.len(), 12);
    for trial in &trials {
        let [x, y, yaw] = trial.command.map(f64::from);
        assert!(!trial.fell && !trial.diverged && trial.steps == 100);
        assert_eq!(trial.action_rate, 0.0);
        // It sinks into its stance in the first tenths of a second: a few centimetres a second on average.
        assert!((trial.linear_velocity_error - x.hypot(y)).abs() < 0.03, "{trial:?}");
        assert!((trial.angular_velocity_error - yaw.abs()).abs() < 0.03, "{trial:?}");
    }
    let speeds: Vec<f64> = trials.iter().map(|trial| f64::from(trial.command[0])).collect();
    assert!(speeds.iter().any(|&x| x > 0.3) && speeds.iter().any(|&x| x < -0.3), "{speeds:?}");
    let summary = summarise(&trials);
    assert_eq!((summary.trajectories, summary.diverged, mean(summary.fall_rate)), (12, 0, 0.0));
}

#[test]
fn a_falling_policy_is_counted_up_to_its_fall() {
    let task = calm();
    let scene = scene(&task);
    let nose_dive = nose_dive();
    let policy = constant_policy(&scene, &nose_dive);
    let subject = subject(&scene, &policy);
    let long = run_trials(&subject, 3, 2.0, 1).unwrap();
    for (index, trial) in long.iter().enumerate() {
        assert!(trial.fell && !trial.diverged && trial.steps < 100, "{trial:?}");
        // Nothing after the fall counts.
        let short = run_trials(&subject, 3, f64::from(trial.steps) * 0.02, 1).unwrap();
        assert_eq!(short[index], *trial);
        // From zero to the constant action in the first step, and no change after.
        let square: f32 = nose_dive.iter().map(|a| a * a).sum();
        let wanted = f64::from((square / 12.0).sqrt()) / f64::from(trial.steps);
        assert!((trial.action_rate - wanted).abs() < 1e-6, "{}, by hand {wanted}", trial.action_rate);
    }
    assert_eq!(mean(summarise(&long).fall_rate), 1.0);
}

#[test]
fn threads_change_no_bit() {
    let scene = scene(&TaskSettings::default());
    let policy = random_policy(&scene);
    let noisy = Candidate { torque_noise: 2.0, ..Candidate::nominal(scene.walker.batch.model()) };
    let subject = Subject { candidate: Some(&noisy), ..subject(&scene, &policy) };
    // More than one tile of 256.
    let once = run_trials(&subject, 261, 0.1, 1).unwrap();
    assert!(once == run_trials(&subject, 261, 0.1, 3).unwrap());
    let drifted = drift(&subject, 2, None, 1).unwrap();
    assert!(drifted == drift(&subject, 2, None, 3).unwrap());
    // Nor do robots beside the first two, in two lots.
    let lots = drift(&subject, 258, Some([0.1; 3]), 2).unwrap();
    let few = drift(&subject, 2, Some([0.1; 3]), 2).unwrap();
    assert!(lots.len() == 7 && lots.iter().zip(&few).all(|(lots, few)| lots.path == few.path));
    // All robots count.
    let whole = |share: f64| ((share * 258.0).round() / 258.0 - share).abs() < 1e-12;
    assert!(lots.iter().all(|trial| trial.fall_rate.is_some_and(|rate| whole(rate.mean))));
    // Nor do the trajectories beside it; noise and seed do.
    assert!(once[..20] == run_trials(&subject, 20, 0.1, 1).unwrap());
    let other = Subject { candidate: None, ..subject };
    assert!(once[..20] != run_trials(&other, 20, 0.1, 1).unwrap());
    let other = Subject { seed: 12, ..subject };
    assert!(once[0].command != run_trials(&other, 20, 0.1, 1).unwrap()[0].command);
}

#[test]
fn who_is_asked_to_stop_does_so_at_the_next_control_period() {
    let scene = scene(&calm());
    let policy = constant_policy(&scene, &STILL);
    let logs = CollectOptions { count: 200, seconds: 10.0, shift: [0.0; 2], privileged: false };
    type Stage<'a> = &'a dyn Fn(&Subject<'_>) -> Result<(), TaskError>;
    let stages: [(&str, Stage<'_>); 4] = [
        ("trials", &|subject| run_trials(subject, 600, 10.0, 1).map(drop)),
        ("drift", &|subject| drift(subject, 100, None, 1).map(drop)),
        ("gait", &|subject| record_gait(subject, &[(10.0, [0.0; 3])]).map(drop)),
        ("logs", &|subject| collect(subject, &logs, 1).map(drop)),
    ];
    for (name, stage) in stages {
        let asked = AtomicUsize::new(0);
        let cancel = || asked.fetch_add(1, Ordering::Relaxed) >= 5;
        let ended = stage(&Subject { cancel: Some(&cancel), ..subject(&scene, &policy) });
        assert_eq!(ended, Err(TaskError::Interrupted), "{name}");
        assert_eq!(asked.into_inner(), 6, "{name}: five periods of the first tile, and no further tile");
    }
}

#[test]
fn every_control_period_of_a_robot_is_counted_once() {
    // Robots that stand never leave their cells. Robots that dive onto their noses fall at once; the rest of their time counts too.
    let terrain = TerrainSettings {
        levels: 2,
        columns: 2,
        ..TerrainSettings::with_kind(Kinds::One(TerrainKind::Rough))
    };
    let scene = scene(&TaskSettings { terrain: Some(terrain), ..calm() });
    let logs = CollectOptions { count: 70, seconds: 0.2, shift: [0.1; 2], privileged: false };
    type Stage<'a> = &'a dyn Fn(&Subject<'_>) -> Result<(), TaskError>;
    let stages: [(&str, usize, Stage<'_>); 4] = [
        ("trials", 70 * 5, &|subject| run_trials(subject, 70, 0.1, 2).map(drop)),
        ("drift", drift_periods(&scene, 2), &|subject| drift(subject, 2, None, 2).map(drop)),
        (
            "crossings",
            {
                let (count, steps) = crossing_size(&scene, 4, 2.0);
                count * steps as usize
            },
            &|subject| crossings(subject, 4, 2.0, 2).map(drop),
        ),
        ("logs", logs.periods(0.02), &|subject| collect(subject, &logs, 2).map(drop)),
    ];
    for policy in [constant_policy(&scene, &STILL), constant_policy(&scene, &nose_dive())] {
        for (name, wanted, stage) in &stages {
            let moved = AtomicUsize::new(0);
            let count = |robots: usize| {
                moved.fetch_add(robots, Ordering::Relaxed);
            };
            stage(&Subject { moved: Some(&count), ..subject(&scene, &policy) }).unwrap();
            assert_eq!(moved.into_inner(), *wanted, "{name}");
        }
    }
}

#[test]
fn summaries_by_hand() {
    let trial = |reward: f64, linear: f64, fell: bool| Trial {
        reward,
        linear_velocity_error: linear,
        angular_velocity_error: 0.5,
        fell,
        ..Trial::default()
    };
    let lost = Trial { diverged: true, ..trial(f64::NAN, 0.0, true) };
    let summary = summarise(&[trial(1.0, 0.1, false), trial(3.0, 0.1, true), lost, trial(5.0, 0.4, false)]);
    // What diverged is a fall, and in no other mean.
    // Mean 3, variance 4, standard error 2/√3.
    assert!((mean(summary.reward) - 3.0).abs() < 1e-12);
    assert!((half_width(summary.reward) - 1.96 * 2.0 / 3f64.sqrt()).abs() < 1e-4);
    // Mean 0.2, variance 0.03, standard error 0.1.
    assert!((mean(summary.linear_velocity_error) - 0.2).abs() < 1e-12);
    assert!((half_width(summary.linear_velocity_error) - 0.196).abs() < 1e-4);
    assert_eq!(summary.angular_velocity_error, Some(Estimate { mean: 0.5, ci95: Some(0.0) }));
    assert_eq!(summary.fall_rate, Estimate::share(2, 4));
    assert_eq!((summary.trajectories, summary.diverged), (4, 1));
    // Of nothing there is no statistic.
    let summary = summarise(&[lost, lost]);
    assert_eq!((summary.diverged, mean(summary.fall_rate)), (2, 1.0));
    assert_eq!((summary.reward, summary.linear_velocity_error, summary.action_rate), (None, None, None));
    assert_eq!(summarise(&[]).fall_rate, None);
}

#[test]
fn a_standing_policy_drifts_by_minus_the_command() {
    let mut task = calm();
    (task.command.x, task.command.y, task.command.yaw) = ([-0.5, 1.0], [-0.8, 0.6], [-1.0, 0.4]);
    task.start.tilt = 2.0;
    let scene = scene(&task);
    let policy = constant_policy(&scene, &STILL);
    let trials = drift(&subject(&scene, &policy), 4, None, 1).unwrap();
    let asked = drift(&subject(&scene, &policy), 1, Some([1.0, 0.5, 0.3925]), 2).unwrap();
    let commands: Vec<[f64; 3]> = asked.iter().map(|trial| trial.command).collect();
    assert_eq!(commands[1..4], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.5, 0.0]]);
    assert_eq!(commands[6], [0.0, 0.0, -0.3925]);
    // Half the greatest speeds for four seconds.
    let wanted = [
        ("stand", [0.0; 3]),
        ("+x", [0.5, 0.0, 0.0]),
        ("-x", [-0.25, 0.0, 0.0]),
        ("+y", [0.0, 0.3, 0.0]),
        ("-y", [0.0, -0.4, 0.0]),
        ("+yaw", [0.0, 0.0, 0.2]),
        ("-yaw", [0.0, 0.0, -0.5]),
    ];
    assert_eq!(trials.len(), wanted.len());
    // It sinks by centimetres while it settles, whatever it is told.
    let settled = &trials[0];
    assert!([settled.x, settled.y, settled.yaw].iter().all(|error| mean(*error).abs() < 0.05), "{settled:?}");
    for (trial, (name, command)) in trials.iter().zip(wanted) {
        assert_eq!(
            (trial.name, trial.command, mean(trial.fall_rate), trial.diverged),
            (name, command, 0.0, 0)
        );
        let errors = [(trial.x, settled.x), (trial.y, settled.y), (trial.yaw, settled.yaw)];
        for (axis, ((error, settled), speed)) in errors.into_iter().zip(command).enumerate() {
            let added = mean(error) - mean(settled);
            assert!((added + 4.0 * speed).abs() < 1e-9, "{name}, axis {axis}: {added}");
            assert!((half_width(error) - half_width(settled)).abs() < 1e-9, "{name}, axis {axis}: {error:?}");
        }
        // From the command's beginning to the end of the last stand: five seconds.
        assert!(trial.path.len() == 250 && trial.path == settled.path, "{name} walks");
    }
    assert!(half_width(settled.x) > 0.0, "robots that start differently end alike");
}

#[test]
fn the_gait_of_a_standing_policy_is_to_stand() {
    let scene = scene(&calm());
    let policy = constant_policy(&scene, &STILL);
    let subject = subject(&scene, &policy);
    let record = record_gait(&subject, &[(0.5, [0.0; 3]), (1.0, [0.4, 0.0, -0.2])]).unwrap();
    assert!(!record.fell && record.steps() == 75 && record.dt == 0.02);
    assert_eq!(record.command[3 * 24..3 * 26], [0.0, 0.0, 0.0, 0.4, 0.0, -0.2]);
    assert!(record.contact[4 * 25..].iter().all(|&touching| touching), "a foot leaves the ground");
    // Feet sink into the ground, which is soft.
    let heights = &record.foot_clearance[4 * 25..];
    assert!(heights.iter().all(|height| (-0.02..0.002).contains(height)), "{:?}", &heights[..4]);
    // It still settles, by centimetres a second.
    assert!(record.velocity[3 * 50..].iter().all(|v| v.abs() < 0.05));
    let summary = record.summary(&scene.gait_group);
    assert_eq!((summary.alternation, summary.step_frequency, summary.duty_factor), (0.0, 0.0, 1.0));
    assert_eq!((summary.action_rate, summary.foot_lift), (0.0, 0.0));
    // About 15 kg on bent legs.
    assert!(summary.torque > 1.0 && summary.torque < 10.0, "{}", summary.torque);
}
