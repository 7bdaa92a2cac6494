//! The kernels of short predictions, run on the CPU as C++, against `gaitfit_policy::predict`.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::candidates;
use crate::host;

use std::sync::Mutex;

use candidates::{apart, asset, files_of, of, tiled};
use gaitfit_cuda::emit::Class;
use gaitfit_cuda::fit::{Numbers, Plan, PredictionInput, Scene, Sizes, Subject, Tables};
use gaitfit_cuda::runtime::{Nvrtc, compile};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_physics::Preset;
use gaitfit_policy::follow::{self, Script, Track, follow};
use gaitfit_policy::predict::{Course, Job, Stepped, predict, robots};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::{Candidate, RobotState, Sensors};
use host::{bytes, call, execute, floats, keep, take};

/// The Go2's policy on its robot. `centred`: velocities are read at another moment than the simulation has them.
fn walking(centred: bool) -> (Task, gaitfit_policy::Policy) {
    let policy = gaitfit_policy_files::read(asset("go2-walk.safetensors").as_ref()).unwrap();
    let mut settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
    settings.robot_timestep = centred.then_some(0.001);
    let model = gaitfit_model::read(asset("go2.xml").as_ref(), &Default::default()).unwrap();
    let interface = policy.interface.clone();
    let task = Task::with_interface(&model, &settings.calm(), interface, Preset::Fast, 0.03).unwrap();
    (task, policy)
}

/// What the sensors of a robot read that walks for `lengths` samples, with errors that corrections have to undo.
fn courses(task: &Task, policy: &gaitfit_policy::Policy, lengths: &[usize]) -> Vec<Course> {
    let walker = &task.walker;
    let angles: Vec<f64> = walker.default_pose.iter().map(|&angle| f64::from(angle) + 0.03).collect();
    let script = |(number, &length): (usize, &usize)| Script {
        commands: vec![[0.6 - 0.4 * number as f32, 0.1, 0.3 * number as f32]; length],
        start: walker.start_from_joints(&angles, &vec![0.1; angles.len()]),
        others: Vec::new(),
        motion: Vec::new(),
        turned_back: 0.0,
        states: Vec::new(),
        actions: Vec::new(),
    };
    let scripts: Vec<Script> = lengths.iter().enumerate().map(script).collect();
    let made = Mutex::new(vec![Track::default(); scripts.len()]);
    let keep = |_: usize, script: usize, track: &Track| made.lock().unwrap()[script] = track.clone();
    let job = follow::Job { candidate: Candidate::nominal(walker.model()), reset_every: None, seed: 0 };
    follow(walker, policy, &scripts, &[job], 1, &keep, &|| false).unwrap();
    let off = |values: &[f32], by: f32| -> Vec<f32> {
        values.iter().enumerate().map(|(k, &value)| value + by * (1.7 * k as f32).sin()).collect()
    };
    let course = |track: &Track| {
        let mut targets = vec![0.0; track.action.len() / walker.joints.len() * walker.default_pose.len()];
        walker.targets(&track.action, &mut targets);
        let quaternion = track.base_quaternion.chunks_exact(4).map(|q| q.try_into().unwrap()).collect();
        let rates = off(&track.base_rates, 0.05).chunks_exact(3).map(|w| w.try_into().unwrap()).collect();
        let (position, velocity) = (off(&track.position, 0.01), off(&track.velocity, 0.2));
        Course::new(walker, targets, position, velocity, quaternion, rates).unwrap()
    };
    made.into_inner().unwrap().iter().map(course).collect()
}

fn tracks(walker: &Walker, courses: &[Course], jobs: &[Job]) -> Vec<Track> {
    let tracks = Mutex::new(vec![Track::default(); jobs.len() * courses.len()]);
    let consume = |job: usize, course: usize, track: &Track| {
        tracks.lock().unwrap()[job * courses.len() + course] = track.clone();
    };
    predict(walker, courses, jobs, 2, &consume, &|| false).unwrap();
    tracks.into_inner().unwrap()
}

/// Holds every kernel against the CPU, the physics aside, whose results go in after each control period.
fn compare(label: &str, task: &Task, courses: &[Course], jobs: &[Job], rows: usize) {
    let walker = &task.walker;
    let subject = Subject::Predict(walker);
    let period = subject.period(&jobs[0].candidate).unwrap();
    let tables = Tables::predict(walker, courses);
    let environments = jobs.len() * courses.len();
    let tiles = environments.div_ceil(period.layout().environments());
    let (recordings, samples) = (courses.len(), tables.samples);
    let sizes = Sizes { candidates: jobs.len(), recordings, samples, tiles, rows, group: 4 };
    let plan = Plan::new(&Scene::new(subject, &period), &tables, sizes);
    let followed = |job: &Job| follow::Job {
        candidate: job.candidate.clone(),
        reset_every: Some(job.every),
        seed: job.seed,
    };
    let followed: Vec<follow::Job> = jobs.iter().map(followed).collect();
    let trust: Vec<f64> = jobs.iter().map(|job| job.feet_trust).collect();
    let input = PredictionInput { walker, courses, trust: &trust };
    let numbers = Numbers::new(subject, &followed, 1, 1).unwrap().predicting(&followed, &input, 2);
    let wanted = tracks(walker, courses, jobs);
    let motion: Vec<Vec<Vec<Stepped>>> =
        jobs.iter().map(|job| robots(walker, courses, job).unwrap()).collect();
    let stepped = |e: usize, sample: usize| &motion[e / recordings][sample][e % recordings];

    let mut files = files_of(&tables, &numbers);
    files.insert("trust".to_owned(), bytes(&numbers.trust, f64::to_ne_bytes));
    let mut statements = call(&plan.spread());
    for sample in 0..plan.steps {
        statements.push_str(&call(&plan.step(sample)));
        for name in ["robot_state", "robot_targets", "robot_memory"] {
            statements.push_str(&keep(&plan.arrays, name, &format!("at{sample}")));
        }
        if sample + 1 == plan.steps {
            break;
        }
        let mut moved = |name: &str, class: Class, of: fn(&RobotState) -> Vec<f32>| {
            let all: Vec<Vec<f32>> = (0..environments).map(|e| of(&stepped(e, sample)[1])).collect();
            let numbers = bytes(&tiled(&period, class, tiles, &all), f32::to_ne_bytes);
            files.insert(format!("{name}.moved{sample}"), numbers);
            statements.push_str(&take(&plan.arrays, name, &format!("moved{sample}")));
        };
        moved("robot_state", Class::State, |one| one.state.clone());
        moved("robot_report", Class::Report, |one| [one.torque.clone(), one.normal_force.clone()].concat());
        if jobs[0].candidate.robot.velocity_lag > 0.0 {
            moved("robot_memory", Class::Memory, |one| one.memory.clone());
        }
    }
    statements.push_str(&keep(&plan.arrays, "signals", "out"));
    statements.push_str(&keep(&plan.arrays, "ends", "out"));
    let folder = execute(&plan.program.text, &plan.arrays, &files, &["robot_targets"], &statements);
    let read = |name: &str| floats(&std::fs::read(folder.path().join(name)).unwrap());
    let (signals, ends, width) = (read("signals.out"), read("ends.out"), walker.joints.len());
    for (e, want) in wanted.iter().enumerate() {
        let length = courses[e % recordings].samples();
        assert_eq!(ends[e].to_bits() as usize, length, "{label}: end of {e}");
        for sample in 0..length {
            let row = &signals[(e * samples + sample) * 2 * width..][..2 * width];
            let at = sample * width..(sample + 1) * width;
            let want = [&want.position[at.clone()], &want.velocity[at]].concat();
            assert_eq!(apart(row, &want), 0.0, "{label}: environment {e}, sample {sample}");
            if sample + 1 == samples {
                continue;
            }
            let before = &stepped(e, sample)[0];
            let kept = |name: &str, class| of(&period, class, &read(&format!("{name}.at{sample}")), e);
            let state = kept("robot_state", Class::State);
            assert_eq!(apart(&state, &before.state), 0.0, "{label}: state of {e} at {sample}");
            let joints = walker.default_pose.len();
            let sent = &courses[e % recordings].targets;
            for (tap, targets) in kept("robot_targets", Class::Targets).chunks_exact(joints).enumerate() {
                let from = sample.saturating_sub(tap) * joints;
                assert_eq!(targets, &sent[from..from + joints], "{label}: targets of {e} at {sample}");
            }
        }
    }
}

fn job(friction: f64, every: usize, feet_trust: f64, seed: u64) -> Job {
    let model = gaitfit_model::read(asset("go2.xml").as_ref(), &Default::default()).unwrap();
    let mut candidate = Candidate::nominal(&model);
    candidate.robot.frictionloss = vec![friction; 12];
    Job { candidate, every, feet_trust, seed }
}

#[test]
#[ignore = "needs g++"]
fn cxx_predictions_are_the_cpus() {
    let (task, policy) = walking(false);
    let courses = courses(&task, &policy, &[30, 23]);
    compare("plain", &task, &courses, &[job(0.1, 1, 0.5, 0), job(0.3, 3, 1.0, 0)], 4);
}

/// Velocities of another moment, encoder errors, slow sensors, a tilted unit, delays, and torque noise.
#[test]
#[ignore = "needs g++"]
fn cxx_predictions_of_fitted_robots_are_the_cpus() {
    let (task, policy) = walking(true);
    let courses = courses(&task, &policy, &[26, 17, 20]);
    let fitted = |amount: f64, every: usize| {
        let mut job = job(amount, every, 0.5, 5 + every as u64);
        let candidate = &mut job.candidate;
        candidate.torque_noise = 0.2 + amount;
        for j in 0..12 {
            candidate.robot.delay[j] = 0.002 * j as f64;
            candidate.robot.encoder_bias[j] = 0.01 * j as f64 - 0.05;
        }
        candidate.robot.velocity_lag = 0.002 + 0.02 * amount;
        candidate.sensors = Sensors { imu_tilt: [0.3 * amount, -0.05], gyro_bias: [0.1, amount, -0.07] };
        job
    };
    compare("fitted", &task, &courses, &[fitted(0.1, 1), fitted(0.2, 2)], 8);
}

/// A session repeats the numbers of what it is asked for until its room is full.
#[test]
fn numbers_are_repeated() {
    let (task, policy) = walking(false);
    let courses = courses(&task, &policy, &[4, 3]);
    let walker = &task.walker;
    let numbers = |frictions: &[f64]| {
        let jobs: Vec<follow::Job> = frictions
            .iter()
            .map(|&friction| follow::Job {
                candidate: job(friction, 1, 0.5, 0).candidate,
                reset_every: Some(1),
                seed: (friction * 100.0) as u64,
            })
            .collect();
        let trust = frictions.to_vec();
        let input = PredictionInput { walker, courses: &courses, trust: &trust };
        let numbers = Numbers::new(Subject::Predict(walker), &jobs, 1, 1).unwrap();
        numbers.predicting(&jobs, &input, 1)
    };
    let three = numbers(&[0.1, 0.2, 0.3]);
    assert_eq!(*three.repeated(3, 5), numbers(&[0.1, 0.2, 0.3, 0.1, 0.2]));
    assert_eq!(*three.repeated(3, 3), three);
    assert_eq!(*three.repeated(3, 2), numbers(&[0.1, 0.2]));
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_predictions() {
    let (task, policy) = walking(true);
    let courses = courses(&task, &policy, &[12]);
    let mut candidate = job(0.1, 1, 0.5, 0).candidate;
    candidate.robot.velocity_lag = 0.002;
    candidate.torque_noise = 1.0;
    let subject = Subject::Predict(&task.walker);
    let period = subject.period(&candidate).unwrap();
    let sizes = Sizes { candidates: 32, recordings: 1, samples: 12, tiles: 4, rows: 16, group: 4 };
    let plan = Plan::new(&Scene::new(subject, &period), &Tables::predict(&task.walker, &courses), sizes);
    compile(Nvrtc::get().unwrap(), &plan.program, (9, 0), None).unwrap();
}
