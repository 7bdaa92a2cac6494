//! A policy that follows a motion repeats its log, from a start that is turned and after resets to logged states.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::task_common;

use std::sync::Mutex;

use gaitfit_learn::collect::{CollectOptions, collect};
use gaitfit_learn::evaluate::{Subject, run_trials, summarise};
use gaitfit_learn::task::Environment;
use gaitfit_log::Trajectory;
use gaitfit_model::rotation::{heading, product, turn};
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::{MotionPlace, Quantity, Reference, Term};
use gaitfit_sim::{Candidate, Start};
use task_common::{calm, random_policy, scene_with, script};

/// Two seconds in which all joints swing about the pose, at 100 Hz, facing to the left.
fn motion(joints: &[String], pose: &[f64]) -> Reference {
    let time = |sample: usize| sample as f64 / 100.0;
    let rows = |of: &dyn Fn(f64, usize) -> f64| -> Vec<f32> {
        (0..=200)
            .flat_map(|k| (0..joints.len()).map(move |j| (k, j)))
            .map(|(k, j)| of(time(k), j) as f32)
            .collect()
    };
    let swing = |joint: usize| if joint.is_multiple_of(2) { 0.1 } else { -0.1 };
    Reference {
        rate_hz: 100.0,
        position: rows(&|t, joint| pose[joint] + swing(joint) * (6.0 * t).sin()),
        velocity: rows(&|t, joint| 6.0 * swing(joint) * (6.0 * t).cos()),
        orientation: turn(2, 1.2).map(|x| x as f32).repeat(201),
        anchor: Vec::new(),
        anchor_body: None,
    }
}

#[test]
fn it_repeats_its_log() {
    repeats(0.0);
}

#[test]
fn it_repeats_its_log_from_a_turned_start_and_after_resets() {
    repeats(180.0);
}

/// Logs of robots that start up to `yaw` degrees from ahead.
fn repeats(yaw: f64) {
    let mut task = calm();
    (task.start.yaw, task.start.tilt, task.start.joint_position) = (yaw, 0.0, 0.0);
    let scene = scene_with(&task, |interface| {
        interface.reference = Some(motion(&interface.joints, &interface.default_pose));
        interface.critic_observation.clear();
        interface.observation.extend([
            Term::new(Quantity::ReferenceJointPosition).with_history(2),
            Term { ahead: 3, ..Term::new(Quantity::ReferenceJointVelocity).scaled(&[0.1]) },
            Term::new(Quantity::ReferenceOrientation).scaled(&[2.0]),
            Term::new(Quantity::ReferencePhase),
        ]);
    });
    let policy = random_policy(&scene);
    let subject =
        Subject { task: &scene, policy: &policy, candidate: None, seed: 8, cancel: None, moved: None };
    let options = CollectOptions { count: 2, seconds: 0.6, shift: [0.0; 2], privileged: true };
    for log in collect(&subject, &options, 1).unwrap().into_iter().map(|log| log.trajectory) {
        let script = turned_script(&log);
        // The simulated robot faces ahead, the log's does not.
        assert_eq!(script.turned_back.abs() > 0.1, yaw > 0.0);
        let action: Vec<f32> = log.action.as_ref().unwrap().iter().map(|&x| x as f32).collect();
        assert!(action.iter().any(|x| x.abs() > 0.1));
        for reset_every in [None, Some(1), Some(7)] {
            let job = Job { candidate: Candidate::nominal(scene.walker.model()), reset_every, seed: 0 };
            let kept = Mutex::new(Track::default());
            let keep = |_: usize, _: usize, track: &Track| *kept.lock().unwrap() = track.clone();
            follow(&scene.walker, &policy, std::slice::from_ref(&script), &[job], 1, &keep, &|| false)
                .unwrap();
            let track = kept.into_inner().unwrap();
            assert_eq!(track.action.len(), action.len());
            let off = |(a, b): (&f32, &f32)| (a - b).abs();
            let worst = track.action.iter().zip(&action).map(off).fold(0.0, f32::max);
            // In the turned world numbers are rounded otherwise, and contacts let the difference grow.
            let limit = if yaw > 0.0 && reset_every != Some(1) { 1e-2 } else { 1e-5 };
            assert!(worst < limit, "{reset_every:?}: {worst}");
            let first = track.action.iter().zip(&action).take(12).map(off).fold(0.0, f32::max);
            assert!(first < 1e-5, "{reset_every:?}: {first}");
        }
        // With the motion a control period late the actions are others.
        let mut late = script.clone();
        late.motion.iter_mut().for_each(|place| place.time += 0.02);
        let kept = Mutex::new(Track::default());
        let keep = |_: usize, _: usize, track: &Track| *kept.lock().unwrap() = track.clone();
        let job = Job { candidate: Candidate::nominal(scene.walker.model()), reset_every: Some(1), seed: 0 };
        follow(&scene.walker, &policy, &[late], &[job], 1, &keep, &|| false).unwrap();
        let track = kept.into_inner().unwrap();
        let worst = track.action.iter().zip(&action).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst > 1e-3, "{worst}");
    }
    if yaw == 0.0 {
        return;
    }
    let error = summarise(&run_trials(&subject, 4, 0.4, 1).unwrap()).motion_error.unwrap();
    assert!(error.mean > 0.0 && error.mean < 1.0, "{error:?}");
    // A robot's state carries the angle of its motion.
    let mut environments = [3, 4].map(|seed| Environment::new(&scene, None, seed, 0, 1).unwrap());
    let [one, other] = &mut environments;
    assert_ne!(one.motion_place(0), other.motion_place(0));
    let state = one.snapshot(0);
    other.set_snapshot(0, &state).unwrap();
    assert_eq!(one.motion_place(0), other.motion_place(0));
}

/// A log's commands, states and places in the motion, from its first state turned to face ahead.
fn turned_script(log: &Trajectory) -> Script {
    let script = script(log);
    let attitude = script.start.base_quaternion.map(f64::from);
    let turned_back = heading(attitude);
    let places = log.motion.as_ref().unwrap().chunks_exact(2);
    Script {
        start: Start {
            base_quaternion: product(turn(2, -turned_back), attitude).map(|x| x as f32),
            ..script.start
        },
        motion: places.map(|place| MotionPlace { time: place[0], heading: place[1] }).collect(),
        turned_back,
        ..script
    }
}
