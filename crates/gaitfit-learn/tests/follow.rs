//! A policy that follows the commands of its own log repeats the log.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::sync::Mutex;

use crate::task_common::{self, row};

use gaitfit_learn::collect::{CollectOptions, Collected, collect};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_learn::{Training, TrainingSettings, ppo};
use gaitfit_log::Trajectory;
use gaitfit_physics::Preset;
use gaitfit_policy::Policy;
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::predict::{self, Course, predict};
use gaitfit_sim::{Candidate, JointNetworks, NetworkKind};

fn scene() -> Task {
    let text = include_str!("../../../assets/go2.xml");
    let model = gaitfit_model::read_mjcf_str(text, &gaitfit_model::ReadOptions::default()).unwrap();
    let mut settings = TaskSettings::default().calm();
    (settings.start.yaw, settings.start.tilt, settings.start.joint_position) = (0.0, 0.0, 0.0);
    Task::new(&model, &settings, Preset::Fast).unwrap()
}

/// A policy that has learnt nothing, with outputs that move the legs.
fn policy(scene: &Task) -> Policy {
    let ppo = ppo::Settings {
        actor_hidden: vec![16],
        critic_hidden: vec![16],
        output_gain: 2.0,
        ..ppo::Settings::default()
    };
    let learner = Training::fresh_learner(scene, &ppo, 3).unwrap();
    let settings = TrainingSettings { environments: 1, steps: 1, iterations: 1 };
    Training::new(scene, None, &settings, learner, 3).unwrap().policy("", "")
}

fn logs(scene: &Task, policy: &Policy, candidate: &Candidate, count: usize) -> Vec<Collected> {
    let subject =
        Subject { task: scene, policy, candidate: Some(candidate), seed: 5, cancel: None, moved: None };
    let options = CollectOptions { count, seconds: 0.6, shift: [0.0; 2], privileged: true };
    collect(&subject, &options, 2).unwrap()
}

fn script(scene: &Task, log: &Trajectory) -> Script {
    let joints = log.joints.len();
    Script {
        start: scene.walker.start_from_joints(&log.position[..joints], &log.velocity[..joints]),
        ..task_common::script(log)
    }
}

fn tracks(scene: &Task, policy: &Policy, scripts: &[Script], job: Job, threads: usize) -> Vec<Track> {
    let tracks = Mutex::new(vec![Track::default(); scripts.len()]);
    let keep = |_: usize, script: usize, track: &Track| tracks.lock().unwrap()[script] = track.clone();
    follow(&scene.walker, policy, scripts, &[job], threads, &keep, &|| false).unwrap();
    tracks.into_inner().unwrap()
}

fn job(candidate: &Candidate, reset_every: Option<usize>) -> Job {
    Job { candidate: candidate.clone(), reset_every, seed: 0 }
}

fn worst(track: &[f32], log: &[f64]) -> f64 {
    track.iter().zip(log).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

#[test]
fn the_true_robot_repeats_the_log_and_another_does_not() {
    let scene = scene();
    let policy = policy(&scene);
    let mut truth = Candidate::nominal(scene.walker.batch.model());
    truth.robot.frictionloss.fill(0.2);
    truth.robot.armature.fill(0.05);
    let logs = logs(&scene, &policy, &truth, 33);
    let scripts: Vec<Script> = logs.iter().map(|log| script(&scene, &log.trajectory)).collect();
    let same = tracks(&scene, &policy, &scripts, job(&truth, None), 2);
    for (track, log) in same.iter().zip(&logs) {
        assert_eq!(worst(&track.position, &log.trajectory.position), 0.0);
        assert_eq!(worst(&track.action, log.trajectory.action.as_ref().unwrap()), 0.0);
        assert_eq!(track.fell_at.is_some(), log.fell);
    }
    assert_eq!(same, tracks(&scene, &policy, &scripts, job(&truth, None), 1));
    let nominal = Candidate::nominal(scene.walker.batch.model());
    let other = tracks(&scene, &policy, &scripts, job(&nominal, None), 2);
    assert!(worst(&other[0].position, &logs[0].trajectory.position) > 0.01);

    // One-sample predictions: near the log with the true robot (the solver starts colder), less so with another.
    let of = |candidate: &Candidate| {
        let tracks = tracks(&scene, &policy, &scripts, job(candidate, Some(1)), 2);
        worst(&tracks[0].position, &logs[0].trajectory.position)
    };
    let (near, far) = (of(&truth), of(&nominal));
    assert!(near < 0.1 * far && far < 0.1, "{near} {far}");
}

#[test]
fn networks_and_noise_act_and_only_where_they_are() {
    let scene = scene();
    let policy = policy(&scene);
    let nominal = Candidate::nominal(scene.walker.batch.model());
    let logs = logs(&scene, &policy, &nominal, 2);
    let scripts: Vec<Script> = logs.iter().map(|log| script(&scene, &log.trajectory)).collect();
    let plain = tracks(&scene, &policy, &scripts, job(&nominal, None), 1);
    for kind in [NetworkKind::ActionDelta, NetworkKind::ResidAct] {
        let mut silent = nominal.clone();
        silent.networks = vec![JointNetworks {
            kind,
            joints: vec![11],
            rest: vec![-1.5],
            weights: vec![0.0; 97],
            scales: gaitfit_physics::NetworkScales { position: 1.0, velocity: 0.1, output: 1.0 },
        }];
        assert_eq!(tracks(&scene, &policy, &scripts, job(&silent, None), 1), plain);
        let mut loud = silent;
        loud.networks[0].weights[96] = 0.5;
        let changed = tracks(&scene, &policy, &scripts, job(&loud, None), 1);
        // The second sample has felt it in that joint at once.
        let joints = scene.walker.joints.len();
        let moved = |joint: usize| {
            let at = joints + joint;
            (changed[0].position[at] - plain[0].position[at]).abs()
        };
        assert!(moved(11) > 10.0 * moved(0) && moved(11) > 1e-4, "{} {}", moved(11), moved(0));
    }
    let mut noisy = nominal.clone();
    noisy.torque_noise = 1.0;
    let run = |seed| tracks(&scene, &policy, &scripts, Job { seed, ..job(&noisy, None) }, 1);
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn resets_without_a_logged_state_are_refused() {
    let scene = scene();
    let policy = policy(&scene);
    let nominal = Candidate::nominal(scene.walker.batch.model());
    let log = &logs(&scene, &policy, &nominal, 1)[0].trajectory;
    let script = Script { states: Vec::new(), ..script(&scene, log) };
    let error =
        follow(&scene.walker, &policy, &[script], &[job(&nominal, Some(20))], 1, &|_, _, _| {}, &|| false)
            .unwrap_err();
    assert!(error.to_string().contains("wass"), "{error}");
}

/// What the sensors of a log read.
fn course(scene: &Task, log: &Trajectory) -> Course {
    let single = |values: &[f64]| -> Vec<f32> { values.iter().map(|&x| x as f32).collect() };
    let base = log.base.as_ref().unwrap();
    let samples = 0..log.len();
    Course::new(
        &scene.walker,
        single(log.target.as_ref().unwrap()),
        single(&log.position),
        single(&log.velocity),
        samples.clone().map(|sample| row(&base.quaternion, sample)).collect(),
        samples.map(|sample| row(&base.angular_velocity, sample)).collect(),
    )
    .unwrap()
}

/// Joints and IMU alone keep the true robot near the log, also how its base moves, which they do not measure.
#[test]
fn sensors_keep_the_true_robot_near_the_log() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let policy = gaitfit_policy_files::read(std::path::Path::new(path)).unwrap();
    let plain = scene();
    let scene = Task::with_interface(
        plain.walker.model(),
        &plain.settings,
        policy.interface.clone(),
        Preset::Fast,
        0.0,
    )
    .unwrap();
    let mut truth = Candidate::nominal(scene.walker.model());
    truth.robot.frictionloss.fill(0.1);
    truth.robot.encoder_bias[4] = 0.02;
    let subject = Subject {
        task: &scene,
        policy: &policy,
        candidate: Some(&truth),
        seed: 5,
        cancel: None,
        moved: None,
    };
    let options = CollectOptions { count: 34, seconds: 1.5, shift: [0.3, 0.6], privileged: true };
    let logs = collect(&subject, &options, 2).unwrap();
    let courses: Vec<Course> = logs.iter().map(|log| course(&scene, &log.trajectory)).collect();
    let tracks = |candidate: &Candidate, every: usize, threads: usize| {
        let jobs =
            [predict::Job { candidate: candidate.clone(), every, feet_trust: predict::FEET_TRUST, seed: 0 }];
        let tracks = Mutex::new(vec![Track::default(); courses.len()]);
        let keep = |_: usize, course: usize, track: &Track| tracks.lock().unwrap()[course] = track.clone();
        predict(&scene.walker, &courses, &jobs, threads, &keep, &|| false).unwrap();
        tracks.into_inner().unwrap()
    };
    // Mean absolute errors after the first half second.
    let mean =
        |tracks: &[Track], of: &dyn Fn(&Track) -> Vec<f32>, logged: &dyn Fn(&Trajectory) -> Vec<f64>| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (track, log) in tracks.iter().zip(&logs) {
                let (simulated, read) = (of(track), logged(&log.trajectory));
                assert_eq!(simulated.len(), read.len());
                for (a, b) in simulated.iter().zip(&read).skip(simulated.len() / 3) {
                    sum += (f64::from(*a) - b).abs();
                    count += 1.0;
                }
            }
            sum / count
        };
    let velocity = |tracks: &[Track]| mean(tracks, &|t| t.velocity.clone(), &|log| log.velocity.clone());
    let base = |tracks: &[Track]| {
        let read = |log: &Trajectory| log.base.as_ref().unwrap().linear_velocity.clone().unwrap();
        mean(tracks, &|track| track.base_velocity.clone(), &read)
    };
    let walked = tracks(&truth, 1, 2);
    assert_eq!(walked, tracks(&truth, 1, 1));
    let mut other = truth.clone();
    other.robot.frictionloss.fill(0.3);
    let (near, far) = (velocity(&walked), velocity(&tracks(&other, 1, 2)));
    assert!(near < 0.4 * far, "joint velocities are off by {near} and {far} rad/s");
    assert!(base(&walked) < 0.02, "the base's velocity is off by {} m/s", base(&walked));
    // Longer predictions go further astray.
    assert!(velocity(&tracks(&truth, 5, 2)) > near);
    // Without the biased encoder's bias its leg is elsewhere.
    let mut unbiased = truth.clone();
    unbiased.robot.encoder_bias[4] = 0.0;
    assert!(velocity(&tracks(&unbiased, 1, 2)) > 1.2 * near);
}

#[test]
fn a_pilot_that_senses_what_a_log_says_repeats_its_actions_bit_for_bit() {
    use gaitfit_policy::observation::Sensed;
    let scene = scene();
    let policy = policy(&scene);
    let candidate = Candidate::nominal(scene.walker.model());
    let log = logs(&scene, &policy, &candidate, 1).remove(0).trajectory;
    let base = log.base.as_ref().unwrap();
    let joints = log.joints.len();
    let mut pilot = gaitfit_policy::Pilot::new(&policy).unwrap();
    for _ in 0..2 {
        pilot.begin();
        let mut sensed = Sensed::new(joints);
        for sample in 0..log.len() {
            sensed.base_angular_velocity = row(&base.angular_velocity, sample);
            sensed.orient(row(&base.quaternion, sample));
            sensed.command = row(&log.command, sample);
            for joint in 0..joints {
                sensed.joint_position[joint] = log.position[sample * joints + joint] as f32;
                sensed.joint_velocity[joint] = log.velocity[sample * joints + joint] as f32;
            }
            let (action, targets) = pilot.step(&mut sensed);
            for (repeated, logged) in [(action, &log.action), (targets, &log.target)] {
                let logged = &logged.as_ref().unwrap()[sample * joints..(sample + 1) * joints];
                assert!(
                    repeated.iter().zip(logged).all(|(x, y)| f64::from(*x) == *y),
                    "{sample}: {repeated:?} {logged:?}"
                );
            }
        }
    }
}

#[test]
fn a_policy_that_observes_what_robots_do_not_measure_gets_no_pilot() {
    let scene = scene();
    let mut policy = policy(&scene);
    policy.interface.observation[0].quantity = gaitfit_policy::Quantity::BaseLinearVelocity;
    let error = gaitfit_policy::Pilot::new(&policy).err().unwrap().to_string();
    assert!(error.contains("base_linear_velocity"), "{error}");
}
