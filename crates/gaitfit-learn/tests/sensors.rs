//! Errors of sensors: policies observe them, logs show them, and simulations that start from logs remove them.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::sync::Mutex;

use crate::task_common::{calm, go2, row, scene_with, script, single};
use gaitfit_learn::collect::{CollectOptions, collect, sensed};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::{Ended, Environment, Task};
use gaitfit_log::Trajectory;
use gaitfit_model::rotation::{from_rpy, product, quat_of, rotate_back, up, vec_of};
use gaitfit_physics::Preset;
use gaitfit_policy::Policy;
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::predict::{self, Course, predict};
use gaitfit_sim::{Candidate, Motion, Sensors};

const LAG: f64 = 0.006;
const SENSORS: Sensors = Sensors { imu_tilt: [0.05, -0.03], gyro_bias: [0.04, -0.02, 0.03] };

/// A task whose critic observes what its actor does.
fn scene() -> Task {
    let mut task = calm();
    task.start.tilt = 8.0;
    task.start.angular_velocity = 1.0;
    scene_with(&task, |interface| interface.critic_observation = interface.observation.clone())
}

fn turned(scene: &Task) -> Candidate {
    let mut candidate = Candidate { sensors: SENSORS, ..Candidate::nominal(scene.walker.model()) };
    candidate.robot.velocity_lag = LAG;
    candidate
}

/// The unit reads Rᵀ of gravity and rates, and its bias; velocities are read through a filter. All other
/// numbers of observations and logs stay the same.
#[test]
fn policies_and_logs_read_sensors_and_critics_the_robot() {
    let scene = scene();
    let count = 3;
    let turn = from_rpy(SENSORS.imu_tilt[0], SENSORS.imu_tilt[1], 0.0);
    let environment = |candidate: &Candidate| {
        let mut environment = Environment::new(&scene, Some(candidate), 5, 0, count).unwrap();
        let (mut reward, mut ended) = (vec![0.0; count], vec![Ended::No; count]);
        for number in 1..=3 {
            let actions: Vec<f32> = (0..12 * count).map(|k| 0.02 * k as f32 - 0.3).collect();
            environment.step(number, &actions, &mut reward, &mut ended);
        }
        environment
    };
    let [with, without] =
        [turned(&scene), Candidate::nominal(scene.walker.model())].map(|candidate| environment(&candidate));
    let motion = Motion { filtered_velocity: Vec::new(), ..with.motion().clone() };
    assert_eq!(&motion, without.motion(), "sensors change nothing of the motion under given actions");
    let velocities = with.motion().velocity_readings();
    let slow =
        velocities.iter().zip(&motion.joint_velocity).filter(|(read, own)| (*read - *own).abs() > 0.01);
    assert!(slow.count() > velocities.len() / 2);
    let width = scene.walker.interface.observation_width();
    let rows = |environment: &Environment<'_>| {
        let (mut actor, mut critic) = (vec![0.0; count * width], vec![0.0; count * width]);
        environment.observe(4, &mut actor);
        environment.observe_critic(&mut critic);
        (actor, critic)
    };
    let ((read, critic), (plain, same)) = (rows(&with), rows(&without));
    assert_eq!(critic, same);
    let (mut log, mut plain_log) = (Vec::new(), Vec::new());
    for (index, (read, plain)) in read.chunks_exact(width).zip(plain.chunks_exact(width)).enumerate() {
        // The velocity task's row begins with a quarter of the rates, then gravity.
        let rates = rotate_back(turn, vec_of(&plain[..3]).map(|w| f64::from(w) / 0.25));
        let gravity = rotate_back(turn, vec_of(&plain[3..6]).map(f64::from));
        for k in 0..3 {
            let rate = 0.25 * (rates[k] + SENSORS.gyro_bias[k]);
            assert!((f64::from(read[k]) - rate).abs() < 1e-6, "rate {k}: {} and {rate}", read[k]);
            assert!((f64::from(read[3 + k]) - gravity[k]).abs() < 1e-6, "gravity {k}");
            assert!((read[k] - plain[k]).abs() > 1e-4);
        }
        // The command and joint positions, a twentieth of the velocities, the action.
        let velocities = &velocities[12 * index..12 * (index + 1)];
        assert_eq!((&read[6..21], &read[33..]), (&plain[6..21], &plain[33..]));
        assert_eq!(read[21..33], velocities.iter().map(|velocity| 0.05 * velocity).collect::<Vec<_>>());
        sensed(&scene, &with, index, &mut log);
        sensed(&scene, &without, index, &mut plain_log);
        let base = 27..40;
        assert_eq!((&log[..12], &log[24..27]), (&plain_log[..12], &plain_log[24..27]));
        assert_eq!(log[12..24], *velocities);
        let (log, plain) = (&log[base.clone()], &plain_log[base]);
        assert_eq!((&log[..3], &log[7..10]), (&plain[..3], &plain[7..10]), "position and velocity");
        let attitude = product(quat_of(&plain[3..]).map(f64::from), turn);
        let rates = rotate_back(turn, vec_of(&plain[10..]).map(f64::from));
        for k in 0..4 {
            assert!((f64::from(log[3 + k]) - attitude[k]).abs() < 1e-6, "orientation {k}");
        }
        for k in 0..3 {
            let rate = rates[k] + SENSORS.gyro_bias[k];
            assert!((f64::from(log[10 + k]) - rate).abs() < 1e-6, "logged rate {k}");
        }
    }
}

/// Policies and logs have what a late unit reads; critics, rewards and falls have the robot.
#[test]
fn policies_and_logs_read_a_late_unit() {
    let scene = scene();
    let mut candidate = Candidate::nominal(scene.walker.model());
    candidate.robot.imu_delay = 0.015;
    let environment = |candidate: &Candidate| {
        let mut environment = Environment::new(&scene, Some(candidate), 5, 0, 1).unwrap();
        let (mut reward, mut ended) = ([0.0], [Ended::No]);
        for number in 1..=3 {
            let actions: Vec<f32> = (0..12).map(|k| 0.1 * k as f32 - 0.3).collect();
            environment.step(number, &actions, &mut reward, &mut ended);
        }
        (environment, reward)
    };
    let [(late, reward), (plain, same)] =
        [candidate, Candidate::nominal(scene.walker.model())].map(|one| environment(&one));
    assert_eq!(reward, same);
    assert_eq!(&Motion { late_imu: None, ..late.motion().clone() }, plain.motion());
    let (attitude, rates) = late.motion().imu_reading(0);
    assert!((rates[1] - plain.motion().base_angular[1]).abs() > 0.01, "{rates:?}");
    let width = scene.walker.interface.observation_width();
    let rows = |environment: &Environment<'_>| {
        let (mut actor, mut critic) = (vec![0.0; width], vec![0.0; width]);
        environment.observe(4, &mut actor);
        environment.observe_critic(&mut critic);
        (actor, critic)
    };
    let ((read, critic), (plain_read, plain_critic)) = (rows(&late), rows(&plain));
    assert_eq!((critic, &read[6..]), (plain_critic, &plain_read[6..]));
    let gravity = up(attitude).map(|x| -x);
    assert_eq!(read[..6], [rates.map(|rate| 0.25 * rate), gravity].concat());
    let mut log = Vec::new();
    sensed(&scene, &late, 0, &mut log);
    assert_eq!((&log[30..34], &log[37..40]), (&attitude[..], &rates[..]));
}

/// A policy that walks, and its task.
fn walking() -> (Task, Policy) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let policy = gaitfit_policy_files::read(std::path::Path::new(path)).unwrap();
    let scene = Task::with_interface(&go2(), &calm(), policy.interface.clone(), Preset::Fast, 0.0).unwrap();
    (scene, policy)
}

fn logs(scene: &Task, policy: &Policy, candidate: &Candidate) -> Vec<Trajectory> {
    let subject =
        Subject { task: scene, policy, candidate: Some(candidate), seed: 5, cancel: None, moved: None };
    let options = CollectOptions { count: 3, seconds: 0.5, shift: [0.0; 2], privileged: true };
    collect(&subject, &options, 1).unwrap().into_iter().map(|log| log.trajectory).collect()
}

fn worst(track: &[f32], log: &[f64]) -> f64 {
    track.iter().zip(log).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

/// A start and resets are what sensors read, and so is a track: the true robot repeats its log.
#[test]
fn walks_of_the_true_unit_repeat_the_log_and_others_do_not() {
    let (scene, policy) = walking();
    let nominal = Candidate::nominal(scene.walker.model());
    let off = |truth: &Candidate, candidate: &Candidate, reset_every| {
        let logs = logs(&scene, &policy, truth);
        let scripts: Vec<Script> = logs.iter().map(script).collect();
        let tracks = Mutex::new(vec![Track::default(); scripts.len()]);
        let keep = |_: usize, script: usize, track: &Track| tracks.lock().unwrap()[script] = track.clone();
        let job = Job { candidate: candidate.clone(), reset_every, seed: 0 };
        follow(&scene.walker, &policy, &scripts, &[job], 1, &keep, &|| false).unwrap();
        let tracks = tracks.into_inner().unwrap();
        let signals = tracks.iter().zip(&logs).map(|(track, log)| {
            let base = log.base.as_ref().unwrap();
            [
                worst(&track.action, log.action.as_ref().unwrap()),
                worst(&track.position, &log.position).max(worst(&track.velocity, &log.velocity)),
                worst(&track.base_quaternion, base.quaternion.as_ref().unwrap()),
                worst(&track.base_rates, base.angular_velocity.as_ref().unwrap()),
            ]
        });
        signals.fold([0.0f64; 4], |all, one| std::array::from_fn(|k| all[k].max(one[k])))
    };
    let truth = turned(&scene);
    let (near, far) = (off(&truth, &truth, None), off(&truth, &nominal, None));
    assert!(near.iter().zip(&far).all(|(near, far)| *near < 0.05 * far), "{near:?} {far:?}");
    // A reset sets the true velocities to the log's readings.
    let truth = Candidate { sensors: SENSORS, ..nominal.clone() };
    let (near, far) = (off(&truth, &truth, Some(1)), off(&truth, &nominal, Some(1)));
    // After a reset to every sample the policy observes what the log read, whoever the candidate is; the motion differs.
    assert!(near[0] < 1e-5 && far[0] < 1e-5, "{near:?} {far:?}");
    assert!((1..4).all(|k| near[k] < 0.05 * far[k]), "{near:?} {far:?}");
}

/// Short predictions start from the base, not from the readings of its unit.
#[test]
fn predictions_take_the_units_errors_out_of_what_they_start_from() {
    let (scene, policy) = walking();
    let logs = logs(&scene, &policy, &turned(&scene));
    let courses: Vec<Course> = logs
        .iter()
        .map(|log| {
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
        })
        .collect();
    // Mean errors of rates and joint velocities.
    let mean = |candidate: Candidate| {
        let jobs = [predict::Job { candidate, every: 1, feet_trust: predict::FEET_TRUST, seed: 0 }];
        let off = Mutex::new([[0.0; 2]; 2]);
        let keep = |_: usize, course: usize, track: &Track| {
            let read = logs[course].base.as_ref().unwrap().angular_velocity.as_ref().unwrap();
            let signals = [(&track.base_rates, read), (&track.velocity, &logs[course].velocity)];
            for (sums, (found, read)) in off.lock().unwrap().iter_mut().zip(signals) {
                // After the base's velocity has been found.
                for (found, read) in found.iter().zip(read).skip(read.len() / 3) {
                    sums[0] += (f64::from(*found) - read).abs();
                    sums[1] += 1.0;
                }
            }
        };
        predict(&scene.walker, &courses, &jobs, 1, &keep, &|| false).unwrap();
        off.into_inner().unwrap().map(|[sum, count]| sum / count)
    };
    let truth = turned(&scene);
    let [near, far] = [truth.clone(), Candidate::nominal(scene.walker.model())].map(mean);
    assert!(near[0] < 0.8 * far[0] && near[1] < 0.8 * far[1], "off by {near:?} and {far:?} rad/s");
    let quick = mean(Candidate { sensors: SENSORS, ..Candidate::nominal(scene.walker.model()) });
    assert!(
        near[1] < 0.8 * quick[1],
        "velocities without the lag are off by {quick:?}, with it by {near:?} rad/s"
    );
}
