//! The kernels of a replay's candidates, run on the CPU as C++, against the CPU's replay.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::candidates;
use crate::host;

use std::sync::Mutex;

use candidates::{apart, asset, files_of, of, tiled};
use gaitfit_cuda::emit::Class;
use gaitfit_cuda::fit::{Numbers, Plan, Scene, Sizes, Subject, Tables};
use gaitfit_policy::follow::Job;
use gaitfit_sim::{Candidate, Cpu, Engine, JointSignals, Recording, Replay, ReplayOptions};
use host::{bytes, call, execute, floats, keep, take};

#[test]
#[ignore = "needs g++"]
fn cxx_replays_are_the_cpus() {
    let model = gaitfit_model::read(
        asset("go2.xml").as_ref(),
        &gaitfit_model::ReadOptions { root: Some(gaitfit_model::Root::Fixed), ..Default::default() },
    )
    .unwrap();
    let joints = model.joints.len();
    let recording = |number: usize, length: usize| Recording {
        dt: 0.01,
        q0: (0..joints).map(|j| 0.1 * j as f64 - 0.3).collect(),
        dq0: (0..joints).map(|j| 0.05 * (j + number) as f64).collect(),
        target: (0..length * joints).map(|k| (0.13 * k as f64 + number as f64).sin()).collect(),
        kp: vec![20.0 + number as f64; joints],
        kd: vec![0.5 + 0.1 * number as f64; joints],
    };
    let options = ReplayOptions { substeps: 2, max_delay: 0.03, ..Default::default() };
    let replay = Replay::new(&model, vec![recording(0, 20), recording(1, 33)], options).unwrap();
    let candidate = |number: usize| {
        let mut one = Candidate::nominal(&model);
        one.robot.delay = vec![0.004 * number as f64; joints];
        one.robot.encoder_bias = (0..joints).map(|j| 0.01 * (j * number) as f64).collect();
        one.robot.kp_scale = vec![1.0 + 0.1 * number as f64; joints];
        one.robot.kd_scale = vec![1.3; joints];
        one.robot.velocity_lag = 0.002 * (1 + number) as f64;
        one
    };
    let jobs: Vec<Job> =
        (0..3).map(|number| Job { candidate: candidate(number), reset_every: None, seed: 0 }).collect();
    let subject = Subject::Replay(&replay);
    let period = subject.period(&jobs[0].candidate).unwrap();
    let scene = Scene::new(subject, &period);
    let tables = Tables::replay(&replay).unwrap();
    let tiles = 6usize.div_ceil(period.layout().environments());
    let sizes = Sizes { candidates: 3, recordings: 2, samples: tables.samples, tiles, rows: 4, group: 4 };
    let plan = Plan::new(&scene, &tables, sizes);
    let numbers = Numbers::new(subject, &jobs, 1, 1).unwrap();
    let robots: Vec<_> = jobs.iter().map(|job| job.candidate.robot.clone()).collect();
    let tracks = Mutex::new(vec![JointSignals::default(); 6]);
    let consume = |candidate: usize, recording: usize, signals: &JointSignals| {
        tracks.lock().unwrap()[2 * candidate + recording] = signals.clone();
    };
    Cpu { threads: 1 }.replay(&replay, &robots, &consume, &|| false).unwrap();
    let wanted = tracks.into_inner().unwrap();

    // Each sample the CPU's positions and velocities go in as a state, parts of these as accelerations and as what slow
    // sensors read beyond the velocity.
    let beyond = 0.125;
    let memory = tiled(&period, Class::Memory, tiles, &vec![vec![beyond; joints]; 6]);
    let mut files = files_of(&tables, &numbers);
    let mut statements = call(&plan.spread());
    let mut rest = tables.singles.iter().find(|(name, _)| *name == "rest").unwrap().1.clone();
    for sample in 0..tables.samples {
        statements.push_str(&call(&plan.step(sample)));
        for name in ["robot_state", "robot_targets"] {
            statements.push_str(&keep(&plan.arrays, name, &format!("at{sample}")));
        }
        if sample + 1 == tables.samples {
            break;
        }
        let state = |e: usize| {
            let (signals, bias) = (&wanted[e], &robots[e / 2].encoder_bias);
            let row = (sample + 1).min(signals.position.len() / joints - 1) * joints;
            for j in 0..joints {
                rest[13 + j] = signals.position[row + j] - bias[j] as f32;
                rest[13 + joints + j] = signals.velocity[row + j] - 0.25 - beyond;
                rest[13 + 2 * joints + j] = 0.25 / (0.5 * 0.005);
            }
            rest.clone()
        };
        let all: Vec<Vec<f32>> = (0..6).map(state).collect();
        let moved = tiled(&period, Class::State, tiles, &all);
        files.insert(format!("robot_state.moved{sample}"), bytes(&moved, f32::to_ne_bytes));
        statements.push_str(&take(&plan.arrays, "robot_state", &format!("moved{sample}")));
        files.insert(format!("robot_memory.moved{sample}"), bytes(&memory, f32::to_ne_bytes));
        statements.push_str(&take(&plan.arrays, "robot_memory", &format!("moved{sample}")));
    }
    for name in ["signals", "ends", "robot_params"] {
        statements.push_str(&keep(&plan.arrays, name, "out"));
    }
    let folder = execute(&plan.program.text, &plan.arrays, &files, &[], &statements);
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let signals = floats(&read("signals.out"));
    let params = floats(&read("robot_params.out"));
    for (e, want) in wanted.iter().enumerate() {
        let (candidate, recording) = (&robots[e / 2], &replay.recordings()[e % 2]);
        let length = want.position.len() / joints;
        assert_eq!(floats(&read("ends.out"))[e].to_bits() as usize, length);
        for sample in 0..length {
            let row = &signals[(e * tables.samples + sample) * 2 * joints..][..2 * joints];
            let at = sample * joints..(sample + 1) * joints;
            assert!(apart(&row[..joints], &want.position[at.clone()]) < 3e-7, "positions of {e} at {sample}");
            assert!(apart(&row[joints..], &want.velocity[at]) < 3e-6, "velocities of {e} at {sample}");
            let targets =
                of(&period, Class::Targets, &floats(&read(&format!("robot_targets.at{sample}"))), e);
            for (tap, targets) in targets.chunks_exact(joints).enumerate() {
                let from = sample.saturating_sub(tap) * joints;
                let sent: Vec<f32> =
                    recording.target[from..from + joints].iter().map(|&x| x as f32).collect();
                assert_eq!(targets, sent, "targets of {e} at {sample}");
            }
        }
        let numbers = of(&period, Class::Params, &params, e);
        let wanted = |factor: f64, gain: f64| (factor * gain) as f32;
        assert!(numbers.contains(&wanted(candidate.kp_scale[0], recording.kp[0])), "gains of {e}");
        assert!(numbers.contains(&wanted(candidate.kd_scale[0], recording.kd[0])), "gains of {e}");
    }
}
