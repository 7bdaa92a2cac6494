//! The kernels of a fit, run on the CPU as C++, against `gaitfit_policy::follow`; and NVIDIA's compiler.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::candidates;
use crate::host;

use std::path::Path;
use std::sync::Mutex;

use candidates::{apart, asset, files_of, of, tiled};
use gaitfit_cuda::emit::Class;
use gaitfit_cuda::fit::{Begin, Numbers, Plan, Scene, Sizes, Subject, Tables};
use gaitfit_cuda::physics::Period;
use gaitfit_cuda::runtime::{Nvrtc, compile};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_model::Model;
use gaitfit_physics::trace::Input;
use gaitfit_physics::{NETWORK_WEIGHTS, NetworkScales, Preset};
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::observation::Layout;
use gaitfit_policy::walker::TorqueNoise;
use gaitfit_policy::{FrameOrder, MotionPlace, Policy};
use gaitfit_sim::{Candidate, JointNetworks, NetworkKind, RobotState, Sensors, Start};
use host::{bytes, call, execute, fill, floats, keep, take};

pub fn go2() -> Model {
    gaitfit_model::read(asset("go2.xml").as_ref(), &Default::default()).unwrap()
}

/// The policy on its robot, as a fit simulates it.
pub fn walking(robot_timestep: Option<f64>, change: fn(&mut Policy)) -> (Task, Policy) {
    let mut policy = gaitfit_policy_files::read(asset("go2-walk.safetensors").as_ref()).unwrap();
    change(&mut policy);
    let mut settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
    settings.robot_timestep = robot_timestep;
    let interface = policy.interface.clone();
    let task = Task::with_interface(&go2(), &settings.calm(), interface, Preset::Fast, 0.03).unwrap();
    (task, policy)
}

/// Recordings of unlike lengths: what the nominal robot did under changing commands, with its states.
pub fn scripts(task: &Task, policy: &Policy, lengths: &[usize]) -> Vec<Script> {
    let walker = &task.walker;
    let joints = walker.default_pose.len();
    let angles: Vec<f64> = walker.default_pose.iter().map(|&angle| f64::from(angle) + 0.03).collect();
    let bare: Vec<Script> = lengths
        .iter()
        .enumerate()
        .map(|(number, &length)| Script {
            commands: (0..length)
                .map(|row| [0.5 - 0.3 * number as f32, 0.1 * (row / 9) as f32, 0.2 * number as f32])
                .collect(),
            start: walker.start_from_joints(&angles, &vec![0.1 * number as f64; joints]),
            // The middle recording has one start, the others three: both occur in one simulation.
            others: (0..if number == 1 { 0 } else { 2 })
                .map(|other| walker.start_from_joints(&angles, &vec![0.5 - f64::from(other); joints]))
                .collect(),
            // Every recording begins elsewhere in the motion that the policy follows, if it follows one.
            motion: (0..if walker.observation.follows() { length } else { 0 })
                .map(|row| MotionPlace {
                    time: 0.02 * row as f64 - 0.07 + 0.1 * number as f64,
                    heading: 0.4 - 0.9 * number as f64,
                })
                .collect(),
            turned_back: 0.3 * number as f64 - 0.2,
            states: Vec::new(),
            actions: Vec::new(),
        })
        .collect();
    let job = Job { candidate: Candidate::nominal(walker.model()), reset_every: None, seed: 0 };
    let tracks = tracks(task, policy, &bare, &[job]);
    let with = |(script, track): (Script, &Track)| {
        let width = walker.joints.len();
        let state = |row: usize| {
            let three = |all: &[f32]| [all[3 * row], all[3 * row + 1], all[3 * row + 2]];
            let mut start = script.start.clone();
            for (k, &joint) in walker.joints.iter().enumerate() {
                start.joint_position[joint] = track.position[row * width + k];
                start.joint_velocity[joint] = track.velocity[row * width + k];
            }
            Start {
                base_position: three(&track.base_position),
                base_linear: three(&track.base_velocity),
                base_angular: [0.01 * row as f32, -0.02, 0.1],
                ..start
            }
        };
        let states = (0..script.commands.len()).map(state).collect();
        Script { states, actions: track.action.clone(), ..script }
    };
    bare.into_iter().zip(&tracks).map(with).collect()
}

/// The state of a job's robot whose sensors read `reading`.
fn placed(job: &Job, reading: &Start) -> Start {
    job.candidate.sensors.imu().map_or_else(|| reading.clone(), |imu| imu.state(reading))
}

/// What the CPU finds, job after job.
fn tracks(task: &Task, policy: &Policy, scripts: &[Script], jobs: &[Job]) -> Vec<Track> {
    let tracks = Mutex::new(vec![Track::default(); jobs.len() * scripts.len()]);
    let consume = |job: usize, script: usize, track: &Track| {
        tracks.lock().unwrap()[job * scripts.len() + script] = track.clone();
    };
    follow(&task.walker, policy, scripts, jobs, 2, &consume, &|| false).unwrap();
    tracks.into_inner().unwrap()
}

/// The same motion again, for all that a track does not tell: every robot after each control period.
fn robots(task: &Task, scripts: &[Script], job: &Job, tracks: &[Track]) -> Vec<Vec<RobotState>> {
    let walker = &task.walker;
    let (count, joints) = (scripts.len(), walker.default_pose.len());
    let params = walker.robot(&job.candidate).params(walker.model()).unwrap();
    let mut tile = walker.engine.tile(&walker.batch, &vec![params; count], &job.candidate.networks).unwrap();
    for (index, script) in scripts.iter().enumerate() {
        let start = if job.reset_every.is_some() { &script.states[0] } else { script.begins(job.seed) };
        tile.place(index, &placed(job, start));
    }
    let mut motion = walker.batch.motion(count);
    let mut noise = TorqueNoise::default();
    let longest = scripts.iter().map(|script| script.commands.len()).max().unwrap();
    let mut steps = Vec::new();
    for sample in 0..longest - 1 {
        let mut actions = Vec::new();
        for (index, (script, track)) in scripts.iter().zip(tracks).enumerate() {
            let inside = sample < script.commands.len();
            if inside && sample > 0 && job.reset_every.is_some_and(|every| sample % every == 0) {
                tile.place(index, &placed(job, &script.states[sample]));
            }
            // Behind its recording's end nobody looks at a robot.
            let row = sample.min(script.commands.len() - 1) * walker.joints.len();
            actions.extend_from_slice(&track.action[row..row + walker.joints.len()]);
        }
        let mut targets = vec![0.0; count * joints];
        walker.targets(&actions, &mut targets);
        let torques = noise.torques(walker, &job.candidate, job.seed, 0, sample as u32, count);
        tile.step(&targets, torques, &mut motion);
        steps.push((0..count).map(|index| tile.robot(index)).collect());
    }
    steps
}

/// `script` with `earlier` more samples under its first command at the beginning.
fn earlier(script: &Script, earlier: usize) -> Script {
    let mut script = script.clone();
    script.commands.splice(0..0, std::iter::repeat_n(script.commands[0], earlier));
    if let Some(&first) = script.motion.first() {
        let before = |k: usize| MotionPlace { time: first.time - (earlier - k) as f64 * 0.02, ..first };
        script.motion.splice(0..0, (0..earlier).map(before));
    }
    script.start.base_linear[0] += 0.01 * earlier as f32;
    Script { others: Vec::new(), ..script }
}

/// Holds every kernel of a walk against the CPU: `jobs` of one structure on recordings of these lengths. Gives the falls.
pub fn compare(
    label: &str,
    walking: &(Task, Policy),
    jobs: &[Job],
    lengths: &[usize],
    blocks: [usize; 2],
) -> usize {
    compare_from(label, walking, jobs, lengths, blocks, None)
}

/// As `compare`. `before`: for robots that make logs, the number of samples that they walk before each recording.
pub fn compare_from(
    label: &str,
    (task, policy): &(Task, Policy),
    jobs: &[Job],
    lengths: &[usize],
    [rows, group]: [usize; 2],
    before: Option<&[usize]>,
) -> usize {
    let recordings = scripts(task, policy, lengths);
    let scripts: Vec<Script> = match before {
        Some(before) => {
            recordings.iter().zip(before).map(|(script, &before)| earlier(script, before)).collect()
        }
        None => recordings.clone(),
    };
    let walker = &task.walker;
    let subject = Subject::Walk(walker, policy);
    let period = subject.period(&jobs[0].candidate).unwrap();
    let scene = Scene::new(subject, &period);
    let mut tables = Tables::walk(walker, policy, &recordings).unwrap();
    if let Some(before) = before {
        tables = tables.for_logs(*before.iter().max().unwrap());
    }
    let dimensions = tables.dimensions(subject);
    let environments = jobs.len() * scripts.len();
    let tiles = environments.div_ceil(period.layout().environments());
    let sizes = Sizes {
        candidates: jobs.len(),
        recordings: scripts.len(),
        samples: tables.samples,
        tiles,
        rows,
        group,
    };
    let plan = Plan::new(&scene, &tables, sizes);
    let mut numbers = Numbers::new(subject, jobs, tables.starts, 1).unwrap();
    if let Some(before) = before {
        let begin = |(script, &before): (&Script, &usize)| Begin {
            earlier: before as u32,
            start: script.start.clone(),
        };
        let begins: Vec<Begin> = scripts.iter().zip(before).map(begin).collect();
        numbers = numbers.beginning(&vec![begins.as_slice(); jobs.len()]);
    }
    let wanted = tracks(task, policy, &scripts, jobs);
    let own = |job: usize| &wanted[job * scripts.len()..(job + 1) * scripts.len()];
    let motion: Vec<_> = (0..jobs.len()).map(|job| robots(task, &scripts, &jobs[job], own(job))).collect();

    let mut files = files_of(&tables, &numbers);
    let mut statements = fill(&plan.program, &mut files);
    statements.push_str(&call(&plan.spread()));
    let f = |numbers: Vec<f32>| bytes(&numbers, f32::to_ne_bytes);
    for sample in 0..plan.steps {
        statements.push_str(&call(&plan.step(sample)));
        for name in ["robot_state", "robot_targets", "robot_memory"] {
            statements.push_str(&keep(&plan.arrays, name, &format!("at{sample}")));
        }
        if let Some(disturb) = plan.disturb(sample) {
            statements.push_str(&call(&disturb));
            statements.push_str(&keep(&plan.arrays, "robot_disturbance", &format!("at{sample}")));
        }
        if sample + 1 == plan.steps {
            break;
        }
        let after = |class: Class, of: fn(&RobotState) -> Vec<f32>| {
            let all: Vec<Vec<f32>> =
                motion.iter().flat_map(|job| job[sample.min(job.len() - 1)].iter().map(of)).collect();
            f(tiled(&period, class, tiles, &all))
        };
        files.insert(format!("robot_state.moved{sample}"), after(Class::State, |one| one.state.clone()));
        let report = after(Class::Report, |one| [one.torque.clone(), one.normal_force.clone()].concat());
        files.insert(format!("robot_report.moved{sample}"), report);
        if jobs[0].candidate.robot.velocity_lag > 0.0 {
            let memory = after(Class::Memory, |one| one.memory.clone());
            files.insert(format!("robot_memory.moved{sample}"), memory);
            statements.push_str(&take(&plan.arrays, "robot_memory", &format!("moved{sample}")));
        }
        statements.push_str(&take(&plan.arrays, "robot_state", &format!("moved{sample}")));
        statements.push_str(&take(&plan.arrays, "robot_report", &format!("moved{sample}")));
    }
    for name in ["signals", "ends", "robot_params"] {
        statements.push_str(&keep(&plan.arrays, name, "out"));
    }
    let folder = execute(&plan.program.text, &plan.arrays, &files, &["robot_targets"], &statements);
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let signals = floats(&read("signals.out"));
    let ends: Vec<u32> = floats(&read("ends.out")).iter().map(|x| x.to_bits()).collect();
    let params = floats(&read("robot_params.out"));

    let (mut worst, mut falls) = (0.0f32, 0);
    let width = walker.joints.len();
    for (e, track) in wanted.iter().enumerate() {
        let (job, script) = (&jobs[e / scripts.len()], &scripts[e % scripts.len()]);
        let length = script.commands.len();
        let before = before.map_or(0, |before| before[e % scripts.len()]);
        let end = track.fell_at.map_or(length - before, |sample| sample.saturating_sub(before));
        assert_eq!(ends[e] as usize, end, "{label}: end of environment {e}");
        falls += usize::from(end < length - before);
        let mut want = Vec::new();
        walker.robot(&job.candidate).params(walker.model()).unwrap().visit(|_, &x| want.push(x as f32));
        assert_eq!(of(&period, Class::Params, &params, e), want, "{label}: parameters of environment {e}");
        let size = tables.samples * dimensions;
        let rows = signals[e * size..][..(length - before) * dimensions].chunks_exact(dimensions);
        for (sample, row) in (before..).zip(rows) {
            let at = |all: &[f32], width: usize| all[sample * width..(sample + 1) * width].to_vec();
            let exact = [&row[..2 * width], &row[3 * width..]].concat();
            let want = [
                at(&track.position, width),
                at(&track.velocity, width),
                at(&track.base_position, 3),
                at(&track.base_velocity, 3),
                if tables.earlier.is_some() { at(&track.base_quaternion, 4) } else { Vec::new() },
                if tables.earlier.is_some() { at(&track.base_rates, 3) } else { Vec::new() },
            ];
            assert_eq!(apart(&exact, &want.concat()), 0.0, "{label}: environment {e}, sample {sample}");
            let error = apart(&row[2 * width..3 * width], &at(&track.action, width));
            assert!(error < 2e-6, "{label}: action of environment {e} at sample {sample} off by {error:e}");
            worst = worst.max(error);
            let reset = job.reset_every.is_some_and(|every| sample % every == 0);
            let kept = |name: &str| floats(&read(&format!("{name}.at{sample}")));
            if reset || sample == 0 {
                let start = placed(job, if reset { &script.states[sample] } else { script.begins(job.seed) });
                let parts: [&[f32]; 6] = [
                    &start.base_position,
                    &start.base_quaternion,
                    &start.base_linear,
                    &start.base_angular,
                    &start.joint_position,
                    &start.joint_velocity,
                ];
                let mut want = parts.concat();
                want.resize(want.len() + width + 6, 0.0);
                assert_eq!(of(&period, Class::State, &kept("robot_state"), e), want, "{label}: start of {e}");
                let memory = of(&period, Class::Memory, &kept("robot_memory"), e);
                for (place, &value) in memory.iter().enumerate() {
                    // Gears begin in the middle of their play, sensors with the truth.
                    let Some(joint) = period_memory(&period)[place] else {
                        assert_eq!(value, 0.0, "{label}: memory {place} of environment {e}");
                        continue;
                    };
                    let bias = job.candidate.robot.encoder_bias[joint] as f32;
                    let angle = start.joint_position[joint] + bias;
                    let want = if place % 2 == 0 { angle } else { start.joint_velocity[joint] };
                    assert_eq!(value, want, "{label}: memory {place} of environment {e}");
                }
            }
            if sample < motion[e / scripts.len()].len() {
                let targets = of(&period, Class::Targets, &kept("robot_targets"), e);
                let want = &motion[e / scripts.len()][sample][e % scripts.len()].targets;
                // An ActionDelta changes targets in the physics.
                if job.candidate.networks.is_empty() {
                    assert!(apart(&targets, want) < 2e-6, "{label}: targets of {e} at {sample}");
                }
            }
        }
        if job.candidate.torque_noise > 0.0 {
            let tile = period.layout().size(Class::Disturbance) * tiles;
            for sample in 0..length {
                let torques = floats(&read(&format!("robot_disturbance.at{sample}")));
                let mut noise = TorqueNoise::default();
                let count = scripts.len();
                let want = noise.torques(walker, &job.candidate, job.seed, 0, sample as u32, count);
                for (substep, lanes) in torques.chunks_exact(tile).enumerate() {
                    let row = (substep * count + e % count) * width;
                    let values = of(&period, Class::Disturbance, lanes, e);
                    assert_eq!(values, want[row..row + width], "{label}: noise of {e} at {sample}");
                }
            }
        }
    }
    println!("{label}: {environments} environments, {falls} falls, actions off by at most {worst:e}");
    falls
}

/// The joint of each number that networks remember, and nothing for those of gears.
fn period_memory(period: &Period) -> Vec<Option<usize>> {
    let joints = period.inputs().filter_map(|input| match input {
        Input::Memory { zero: true, .. } => Some(None),
        Input::Memory { owner: gaitfit_physics::Owner::Joint(joint), .. } => Some(Some(*joint)),
        _ => None,
    });
    joints.collect()
}

pub fn friction(amount: f64) -> Candidate {
    let mut candidate = Candidate::nominal(&go2());
    candidate.robot.frictionloss = vec![amount; 12];
    candidate.robot.armature = vec![0.01 + 0.02 * amount; 12];
    candidate
}

#[test]
#[ignore = "needs g++"]
fn cxx_walks_are_the_cpus() {
    let walking = walking(None, |_| ());
    let job = |candidate, reset_every, seed| Job { candidate, reset_every, seed };
    // A robot that can hardly move falls.
    let mut weak = friction(0.1);
    weak.robot.kp_scale = vec![0.2; 12];
    let jobs = [
        job(friction(0.2), None, 3),
        job(weak, None, 1),
        job(friction(0.1), Some(1), 1),
        job(friction(0.3), Some(20), 1),
        job(friction(0.3), Some(usize::MAX), 1),
    ];
    let falls = compare("free", &walking, &jobs, &[60, 43, 60], [8, 4]);
    assert!(falls > 0);
}

/// Delays, biased encoders, tilted inertial units, slow sensors of velocity, torque noise, another physics step, joints in another order, clipped actions.
#[test]
#[ignore = "needs g++"]
fn long_cxx_walks_of_fitted_robots_are_the_cpus() {
    let walking = walking(Some(0.001), |policy| {
        policy.interface.action_clip = Some(gaitfit_policy::ActionClip::All(0.8));
        for (k, scale) in policy.interface.action_scale.iter_mut().enumerate() {
            *scale += 0.01 * k as f64;
        }
    });
    let job = |amount: f64, seed: u64, reset_every| {
        let mut candidate = friction(amount);
        candidate.torque_noise = 0.3 + amount;
        for j in 0..12 {
            candidate.robot.delay[j] = 0.002 * j as f64;
            candidate.robot.encoder_bias[j] = 0.01 * j as f64 - 0.05;
        }
        candidate.robot.velocity_lag = 0.002 + 0.02 * amount;
        candidate.robot.imu_delay = 0.001 + 0.1 * amount;
        candidate.sensors = Sensors { imu_tilt: [0.3 * amount, -0.05], gyro_bias: [0.1, amount, -0.07] };
        Job { candidate, reset_every, seed }
    };
    compare("fitted", &walking, &[job(0.1, 7, None), job(0.2, (5 << 32) + 1, Some(10))], &[40, 31], [4, 4]);
}

fn networks(kind: NetworkKind, amount: f64) -> JointNetworks {
    let weights = (0..12 * NETWORK_WEIGHTS).map(|k| amount * (0.7 * k as f64).sin()).collect();
    let scales = NetworkScales { position: 1.0, velocity: 0.05, output: 0.1 };
    JointNetworks { kind, joints: (0..12).collect(), rest: vec![0.1; 12], weights, scales }
}

/// Each robot walks for a while before a recording begins, and its inertial unit is tilted.
#[test]
#[ignore = "needs g++"]
fn cxx_logs_are_the_cpus() {
    let walking = walking(None, |_| ());
    let job = |kp_scale: f64, torque_noise, seed| {
        let mut candidate = Candidate { torque_noise, ..friction(0.2) };
        candidate.robot.kp_scale = vec![kp_scale; 12];
        candidate.sensors = Sensors { imu_tilt: [0.03, -0.05], gyro_bias: [0.02, -0.01, 0.005] };
        Job { candidate, reset_every: None, seed }
    };
    // One of them falls.
    let jobs = [job(1.0, 0.3, 3), job(0.2, 0.2, 7)];
    let falls = compare_from("logs", &walking, &jobs, &[30, 43, 25], [8, 4], Some(&[0, 7, 20]));
    assert!(falls > 0);
}

#[test]
#[ignore = "needs g++"]
fn cxx_walks_with_networks_are_the_cpus() {
    let walking = walking(None, |_| ());
    let job = |amount: f64, reset_every| {
        let mut candidate = friction(0.1);
        candidate.robot.encoder_bias = vec![0.02; 12];
        candidate.robot.play = vec![0.02; 12];
        candidate.networks =
            vec![networks(NetworkKind::ActionDelta, amount), networks(NetworkKind::ResidAct, 3.0 * amount)];
        Job { candidate, reset_every, seed: 1 }
    };
    compare("networks", &walking, &[job(0.1, None), job(0.3, Some(5))], &[25, 30], [16, 16]);
    let on = |joint: usize, whole: JointNetworks| JointNetworks {
        joints: vec![joint],
        rest: vec![0.1],
        weights: whole.weights[..NETWORK_WEIGHTS].to_vec(),
        ..whole
    };
    let job = |amount: f64, reset_every| {
        let mut job = job(amount, reset_every);
        let [delta, torque] = [0, 1].map(|k| job.candidate.networks[k].clone());
        job.candidate.networks = vec![on(2, delta), on(11, torque)];
        job
    };
    compare("one leg's", &walking, &[job(0.1, None), job(0.3, Some(5))], &[12, 9], [4, 4]);
}

/// A policy with past frames: its first layer sees the present ones as before, and a little of the others.
#[test]
#[ignore = "needs g++"]
fn long_cxx_walks_with_past_frames_are_the_cpus() {
    for order in [FrameOrder::NewestFirst, FrameOrder::Frames] {
        let mut policy = gaitfit_policy_files::read(asset("go2-walk.safetensors").as_ref()).unwrap();
        let plain = Layout::new(&policy.interface, &policy.interface.observation);
        policy.interface.history.order = order;
        policy.interface.observation.iter_mut().for_each(|term| term.history = 3);
        let layout = Layout::new(&policy.interface, &policy.interface.observation);
        let (width, outputs) = (plain.width(), policy.actor.shape.layers()[0].outputs);
        let (first, rest) = policy.actor.parameters.split_at(width * outputs);
        let mut weights = vec![0.0; layout.width() * outputs];
        for (old, new) in plain.slots().iter().zip(layout.slots()) {
            for (frame, &begin) in new.frames.iter().enumerate() {
                let share = [0.05, -0.1, 1.0][frame];
                for k in 0..new.present.len() * outputs {
                    weights[begin * outputs + k] = share * first[old.present.start * outputs + k];
                }
            }
        }
        weights.extend_from_slice(rest);
        policy.actor.parameters.resize(weights.len(), 0.0);
        policy.actor.parameters.copy_from_slice(&weights);
        policy.actor.shape.inputs = layout.width();
        policy.normaliser = None;
        let settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
        let interface = policy.interface.clone();
        let task = Task::with_interface(&go2(), &settings.calm(), interface, Preset::Fast, 0.03).unwrap();
        let jobs = [0.0, 0.2].map(|friction| {
            let mut candidate = Candidate::nominal(&go2());
            candidate.robot.frictionloss = vec![friction; 12];
            Job { candidate, reset_every: None, seed: 3 }
        });
        compare(&format!("{order:?}"), &(task, policy), &jobs, &[14, 9], [4, 4]);
    }
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_fits() {
    let (task, policy) = walking(None, |_| ());
    let subject = Subject::Walk(&task.walker, &policy);
    let scripts = scripts(&task, &policy, &[10]);
    let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
    let mut with = Candidate::nominal(&go2());
    with.networks = vec![networks(NetworkKind::ResidAct, 0.1)];
    with.torque_noise = 1.0;
    let mut slow = Candidate::nominal(&go2());
    slow.robot.velocity_lag = 0.004;
    slow.robot.imu_delay = 0.01;
    for (label, candidate) in
        [("plain", Candidate::nominal(&go2())), ("networks", with), ("slow sensors", slow)]
    {
        let period = subject.period(&candidate).unwrap();
        for rows in [8, 16] {
            let sizes = Sizes { candidates: 24, recordings: 1, samples: 10, tiles: 3, rows, group: 4 };
            let plan = Plan::new(&Scene::new(subject, &period), &tables, sizes);
            if let Some(folder) = std::env::var_os("GAITFIT_KEEP_TEXT") {
                let name = format!("fit_{label}_{rows}.cu");
                std::fs::write(Path::new(&folder).join(name), &plan.program.text).unwrap();
            }
            let programs = [Some(plan.program), (rows == 8).then(|| period.program())];
            for program in programs.into_iter().flatten() {
                let program = program.option("--ptxas-options=-v");
                let start = std::time::Instant::now();
                let compiled = compile(Nvrtc::get().unwrap(), &program, (9, 0), None).unwrap();
                println!("{label} {rows} {:.1} s\n{}", start.elapsed().as_secs_f64(), compiled.image.log);
            }
        }
    }
}
