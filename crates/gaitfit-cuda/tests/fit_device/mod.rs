//! Candidates of a fit on a GPU against the CPU's, and how long they take.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod several;

use std::sync::Mutex;
use std::time::Instant;

use crate::motions::{following, observing};
use gaitfit_cuda::fit::{Begin, Candidates, Compared, Measured, Parts, Subject, Tables, Tracks};
use gaitfit_cuda::runtime::Device;
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_model::Model;
use gaitfit_physics::{NETWORK_WEIGHTS, NetworkScales, Preset};
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::network::{Cell, Network, Recurrent, RecurrentShape, Shape};
use gaitfit_policy::{Front, MotionPlace, Policy, Quantity, Term};
use gaitfit_sim::{Candidate, JointNetworks, NetworkKind, Start};

fn asset(name: &str) -> String {
    format!("{}/../../assets/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn go2() -> Model {
    gaitfit_model::read(asset("go2.xml").as_ref(), &Default::default()).unwrap()
}

fn walking(substeps: usize) -> (Task, Policy) {
    let policy = gaitfit_policy_files::read(asset("go2-walk.safetensors").as_ref()).unwrap();
    (task_of(&policy, substeps), policy)
}

fn task_of(policy: &Policy, substeps: usize) -> Task {
    let mut settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
    settings.substeps = substeps;
    Task::with_interface(&go2(), &settings.calm(), policy.interface.clone(), Preset::Fast, 0.0).unwrap()
}

fn tracks(task: &Task, policy: &Policy, scripts: &[Script], jobs: &[Job]) -> Vec<Track> {
    let tracks = Mutex::new(vec![Track::default(); jobs.len() * scripts.len()]);
    let consume = |job: usize, script: usize, track: &Track| {
        tracks.lock().unwrap()[job * scripts.len() + script] = track.clone();
    };
    follow(&task.walker, policy, scripts, jobs, 16, &consume, &|| false).unwrap();
    tracks.into_inner().unwrap()
}

/// Recordings of the nominal robot under some commands, with its states.
fn scripts(task: &Task, policy: &Policy, count: usize, samples: usize) -> Vec<Script> {
    let walker = &task.walker;
    let angles: Vec<f64> = walker.default_pose.iter().map(|&angle| f64::from(angle)).collect();
    let bare: Vec<Script> = (0..count)
        .map(|number| {
            let x = number as f32 / count as f32;
            Script {
                commands: vec![[1.2 * x - 0.4, 0.3 - 0.5 * x, 0.6 * (7.0 * x).sin()]; samples - number % 3],
                start: walker.start_from_joints(&angles, &vec![0.0; angles.len()]),
                others: Vec::new(),
                motion: Vec::new(),
                turned_back: 0.0,
                states: Vec::new(),
                actions: Vec::new(),
            }
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
            let (base_position, base_linear) = (three(&track.base_position), three(&track.base_velocity));
            Start { base_position, base_linear, ..start }
        };
        let states = (0..script.commands.len()).map(state).collect();
        Script { states, actions: track.action.clone(), ..script }
    };
    bare.into_iter().zip(&tracks).map(with).collect()
}

fn networks(joints: &[usize], amount: f64) -> JointNetworks {
    let weights = (0..joints.len() * NETWORK_WEIGHTS).map(|k| amount * (0.7 * k as f64).sin()).collect();
    let scales = NetworkScales { position: 1.0, velocity: 0.05, output: 1.0 };
    let kind = NetworkKind::ResidAct;
    JointNetworks { kind, joints: joints.to_vec(), rest: vec![0.1; joints.len()], weights, scales }
}

const ALL: [usize; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

/// A candidate with networks on these joints, if there are some, and torque noise.
fn robot(number: usize, joints: &[usize]) -> Candidate {
    let mut candidate = Candidate::nominal(&go2());
    candidate.robot.frictionloss = vec![0.02 * number as f64; 12];
    candidate.robot.armature = vec![0.01 + 0.002 * number as f64; 12];
    if !joints.is_empty() {
        candidate.networks = vec![networks(joints, 0.02 * number as f64)];
        candidate.torque_noise = 0.4;
    }
    candidate
}

fn rows(track: &Track, width: usize) -> Vec<Vec<f32>> {
    let at = |all: &[f32], width: usize, row: usize| all[row * width..(row + 1) * width].to_vec();
    let row = |row: usize| {
        [
            at(&track.position, width, row),
            at(&track.velocity, width, row),
            at(&track.action, width, row),
            at(&track.base_position, 3, row),
            at(&track.base_velocity, 3, row),
        ]
        .concat()
    };
    (0..track.position.len() / width).map(row).collect()
}

/// The first samples agree but for rounding; with resets all do. Twice the same has the same bits.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_candidates_walk_as_the_cpus() {
    let device = Device::open(0).unwrap();
    for joints in [&[][..], &ALL, &[11]] {
        let (task, policy) = walking(4);
        let scripts = scripts(&task, &policy, 9, 60);
        let subject = Subject::Walk(&task.walker, &policy);
        let mut jobs: Vec<Job> = (0..5)
            .map(|number| Job { candidate: robot(number, joints), reset_every: None, seed: number as u64 })
            .collect();
        jobs[1].reset_every = Some(1);
        jobs[2].reset_every = Some(10);
        // It falls.
        jobs[3].candidate.robot.kp_scale = vec![0.15; 12];
        let wanted = tracks(&task, &policy, &scripts, &jobs);
        let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
        let mut candidates = Candidates::new(&device, tables, 4).unwrap();
        let run = |candidates: &mut Candidates| {
            let signals = Mutex::new(vec![(Vec::new(), None); jobs.len() * scripts.len()]);
            let consume = |job: usize, recording: usize, tracks: Tracks<'_>| {
                signals.lock().unwrap()[job * scripts.len() + recording] =
                    (tracks.rows.to_vec(), tracks.fell_at);
            };
            candidates.tracks(subject, &jobs, &consume, &|| false).unwrap();
            signals.into_inner().unwrap()
        };
        let first = run(&mut candidates);
        assert!(first == run(&mut candidates), "other bits the second time");
        let (mut steps, mut worst, mut fell) = (Vec::new(), [0.0f32; 2], 0);
        for (e, ((values, end), want)) in first.iter().zip(&wanted).enumerate() {
            let every = jobs[e / scripts.len()].reset_every;
            fell += usize::from(want.fell_at.is_some());
            if let Some(wanted) = want.fell_at {
                let end = end.unwrap_or_else(|| panic!("environment {e} has not fallen"));
                assert!(end.abs_diff(wanted) <= 3, "environment {e} fell at {end}, not {wanted}");
            }
            let dimensions = subject.dimensions();
            let wanted = rows(want, 12);
            assert_eq!(values.len(), wanted.len() * dimensions);
            for (sample, (row, want)) in values.chunks_exact(dimensions).zip(&wanted).enumerate() {
                if want.iter().any(|x| !x.is_finite()) {
                    continue;
                }
                let error = row.iter().zip(want).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
                match every {
                    Some(1) => steps.push(error),
                    Some(_) if sample <= 10 => worst[0] = worst[0].max(error),
                    None if sample <= 5 => worst[1] = worst[1].max(error),
                    _ => {}
                }
            }
        }
        // A foot that touches by rounding alone is another motion for a few steps: one of 540 was 0.08 apart.
        steps.sort_by(f32::total_cmp);
        let (most, largest) = (steps[steps.len() * 99 / 100], steps[steps.len() - 1]);
        println!(
            "networks on {joints:?}: {fell} falls; off by {most} (99 % of {} single steps; at most {largest}), {worst:?} (10, 5 steps)",
            steps.len()
        );
        assert!(fell > 0 && most < 1e-2 && largest < 0.5 && worst[1] < 1e-2, "{worst:?}");
        println!("{:?}", candidates.resources().unwrap());
    }
}

/// A policy with a memory on candidates: the first samples are the CPU's.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_candidates_remember_as_the_cpus() {
    let device = Device::open(0).unwrap();
    let (task, policy) = walking(4);
    for (cell, hidden) in [(Cell::Lstm, vec![256]), (Cell::Gru, vec![64, 128])] {
        let shape = RecurrentShape { cell, inputs: policy.actor.shape.inputs, hidden };
        let actor = Shape { inputs: shape.outputs(), ..policy.actor.shape.clone() };
        let policy = Policy {
            front: Some(Front::Recurrent(Recurrent::random(&shape, 5, 0))),
            actor: Network::random(actor, 5, 1, 1.0).unwrap(),
            ..policy.clone()
        };
        let scripts = scripts(&task, &policy, 9, 30);
        let subject = Subject::Walk(&task.walker, &policy);
        let jobs: Vec<Job> = (0..40)
            .map(|number| Job { candidate: robot(number % 5, &[]), reset_every: None, seed: number as u64 })
            .collect();
        let wanted = tracks(&task, &policy, &scripts, &jobs);
        let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
        let mut candidates = Candidates::new(&device, tables, 4).unwrap();
        let start = Instant::now();
        let signals = signals(&mut candidates, subject, &jobs, scripts.len());
        println!("{}: {:.2} s", cell.name(), start.elapsed().as_secs_f64());
        let dimensions = subject.dimensions();
        for (values, want) in signals.iter().zip(&wanted) {
            for (row, want) in values.chunks_exact(dimensions).zip(&rows(want, 12)).take(6) {
                let error = row.iter().zip(want).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
                assert!(error < 1e-2, "{}: off by {error}", cell.name());
            }
        }
    }
}

/// The rows of each job on each of so many recordings, job by job.
fn signals(
    candidates: &mut Candidates,
    subject: Subject<'_>,
    jobs: &[Job],
    recordings: usize,
) -> Vec<Vec<f32>> {
    let signals = Mutex::new(vec![Vec::new(); jobs.len() * recordings]);
    let consume = |job: usize, recording: usize, tracks: Tracks<'_>| {
        signals.lock().unwrap()[job * recordings + recording] = tracks.rows.to_vec();
    };
    candidates.tracks(subject, jobs, &consume, &|| false).unwrap();
    signals.into_inner().unwrap()
}

/// Policies that follow a motion, and one that also observes the action before the last: the first samples are the
/// CPU's. One robot is reset.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_candidates_walk_along_a_motion_as_the_cpus() {
    let device = Device::open(0).unwrap();
    let (_, walk) = walking(4);
    let motion = following(&walk, 37.0, 30);
    let earlier = observing(&motion, vec![Term::new(Quantity::EarlierAction)]);
    for (label, policy, reset_every) in [("motion", motion, Some(1)), ("earlier action", earlier, None)] {
        let task = task_of(&policy, 4);
        let mut scripts = scripts(&task, &policy, 9, 40);
        for (number, script) in scripts.iter_mut().enumerate() {
            let place = |row: usize| MotionPlace { time: 0.02 * row as f64 - 0.1, heading: number as f64 };
            script.motion = (0..script.commands.len()).map(place).collect();
            script.turned_back = 0.3;
        }
        let subject = Subject::Walk(&task.walker, &policy);
        let job = |number: usize| Job {
            candidate: robot(number, &[]),
            reset_every: if number == 0 { reset_every } else { None },
            seed: number as u64,
        };
        let jobs: Vec<Job> = (0..5).map(job).collect();
        let wanted = tracks(&task, &policy, &scripts, &jobs);
        let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
        let mut candidates = Candidates::new(&device, tables, 4).unwrap();
        let signals = signals(&mut candidates, subject, &jobs, scripts.len());
        let dimensions = subject.dimensions();
        for (e, (values, want)) in signals.iter().zip(&wanted).enumerate() {
            for (row, want) in values.chunks_exact(dimensions).zip(&rows(want, 12)).take(6) {
                let error = row.iter().zip(want).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
                assert!(error < 1e-2, "{label}: environment {e} is off by {error}");
            }
        }
    }
}

/// Commands of a file, played by one robot: every script has its track, and its first samples are the CPU's.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_follows_scripts_as_the_cpu() {
    let device = Device::open(0).unwrap();
    let (task, policy) = walking(4);
    let scripts = scripts(&task, &policy, 7, 40);
    let mut job = Job { candidate: robot(2, &[]), reset_every: None, seed: 3 };
    let wanted = tracks(&task, &policy, &scripts, std::slice::from_ref(&job));
    let found = Mutex::new(vec![Track::default(); scripts.len()]);
    let keep = |script: usize, track: &Track| found.lock().unwrap()[script] = track.clone();
    gaitfit_cuda::fit::follow(&device, &task.walker, &policy, &scripts, &job, 4, &keep, &|| false).unwrap();
    for (found, wanted) in found.into_inner().unwrap().iter().zip(&wanted) {
        assert_eq!(
            (found.action.len(), found.base_rates.len()),
            (wanted.action.len(), wanted.base_rates.len())
        );
        assert_eq!(found.fell_at, wanted.fell_at);
        for (found, wanted) in rows(found, 12).iter().zip(&rows(wanted, 12)).take(6) {
            let error = found.iter().zip(wanted).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
            assert!(error < 1e-2, "off by {error}");
        }
    }
    job.reset_every = Some(5);
    let error =
        gaitfit_cuda::fit::follow(&device, &task.walker, &policy, &scripts, &job, 4, &|_, _| (), &|| false);
    assert!(error.unwrap_err().to_string().contains("resets"));
}

/// Robots walk for a while before their logs begin. The logs begin as on the CPU, and a second run gives the same bits.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_logs_begin_as_the_cpus() {
    let device = Device::open(0).unwrap();
    let (task, policy) = walking(4);
    let scripts = scripts(&task, &policy, 6, 40);
    let subject = Subject::Walk(&task.walker, &policy);
    let jobs: Vec<Job> = (0..3)
        .map(|number| Job { candidate: robot(number, &[]), reset_every: None, seed: number as u64 })
        .collect();
    let before = |recording: usize| recording % 4;
    let begins: Vec<Begin> = scripts
        .iter()
        .enumerate()
        .map(|(number, script)| Begin { earlier: before(number) as u32, start: script.start.clone() })
        .collect();
    let longer: Vec<Script> = scripts
        .iter()
        .enumerate()
        .map(|(number, script)| {
            let mut script = script.clone();
            script.commands.splice(0..0, std::iter::repeat_n(script.commands[0], before(number)));
            script
        })
        .collect();
    let wanted = tracks(&task, &policy, &longer, &jobs);
    let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap().for_logs(3);
    let dimensions = tables.dimensions(subject);
    let mut candidates = Candidates::new(&device, tables, 4).unwrap();
    let run = |candidates: &mut Candidates| {
        let signals = Mutex::new(vec![Vec::new(); jobs.len() * scripts.len()]);
        let consume = |job: usize, recording: usize, tracks: Tracks<'_>| {
            signals.lock().unwrap()[job * scripts.len() + recording] = tracks.rows.to_vec();
        };
        candidates.make_logs(subject, &jobs, &vec![begins.clone(); jobs.len()], &consume, &|| false).unwrap();
        signals.into_inner().unwrap()
    };
    let first = run(&mut candidates);
    assert!(first == run(&mut candidates), "other bits the second time");
    for (e, (values, want)) in first.iter().zip(&wanted).enumerate() {
        let (script, before) = (e % scripts.len(), before(e % scripts.len()));
        assert_eq!(values.len(), scripts[script].commands.len() * dimensions);
        let wanted = rows(want, 12);
        // Later samples of a walk are another motion: rounding alone decides when a foot touches.
        for sample in 0..4 - before.min(3) {
            let imu = [
                &want.base_quaternion[4 * (sample + before)..][..4],
                &want.base_rates[3 * (sample + before)..][..3],
            ];
            let want = [wanted[sample + before].clone(), imu.concat()].concat();
            let row = &values[sample * dimensions..][..dimensions];
            let error = row.iter().zip(&want).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
            assert!(error < 1e-2, "environment {e}, sample {sample}: off by {error}");
        }
    }
    // A robot may not walk more samples before a recording than the tables allow.
    let early = vec![vec![Begin { earlier: 4, ..begins[0].clone() }; scripts.len()]; jobs.len()];
    let error = candidates.make_logs(subject, &jobs, &early, &|_, _, _| (), &|| false).unwrap_err();
    assert!(error.to_string().contains("before a recording"), "{error}");
}

/// Three searches with the parameters of a default fit that cost the most time.
const DEFAULT_FIT: &str = "play, friction under load, noise; three searches";

/// How long the candidates of a generation take: a line for each, and what of it the parts take.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_generations_are_timed() {
    let device = Device::open(0).unwrap();
    let recordings = [4, 20].map(|substeps| {
        let (task, policy) = walking(substeps);
        scripts(&task, &policy, 64, 200)
    });
    let (none, all, one) = (&[][..], &ALL[..], &[11][..]);
    for (label, substeps, population, joints) in [
        ("200 Hz", 4, 24, none),
        ("200 Hz, eight searches", 4, 192, none),
        ("200 Hz, one ResidAct and noise", 4, 17, one),
        ("200 Hz, 12 ResidAct and noise", 4, 25, all),
        ("1 kHz", 20, 24, none),
        ("1 kHz, 12 ResidAct and noise", 20, 25, all),
        ("1 kHz, 12 ResidAct and noise, eight searches", 20, 200, all),
        (DEFAULT_FIT, 4, 96, none),
    ] {
        let (task, policy) = walking(substeps);
        let scripts = recordings[usize::from(substeps > 4)].clone();
        let subject = Subject::Walk(&task.walker, &policy);
        let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
        let jobs: Vec<Job> = (0..population)
            .map(|number| {
                let mut candidate = robot(number % 25, joints);
                if label == DEFAULT_FIT {
                    candidate.robot.play = vec![0.004; 12];
                    candidate.robot.load_friction = vec![0.1; 12];
                    candidate.torque_noise = 0.4;
                }
                Job { candidate, reset_every: None, seed: 1 }
            })
            .collect();
        let start = Instant::now();
        let mut candidates = Candidates::new(&device, tables, 16).unwrap();
        let dimensions = subject.dimensions();
        let nominal = Job { candidate: robot(1, joints), reset_every: None, seed: 2 };
        candidates.measure(pretend(candidates.tables(), dimensions), dimensions).unwrap();
        let first: Vec<Parts> =
            candidates.parts(subject, &jobs, &vec![Compared::Distances; population], &|| false).unwrap();
        let ready = start.elapsed().as_secs_f64();
        let time = |candidates: &mut Candidates, compared: Compared| {
            let start = Instant::now();
            let again = candidates.parts(subject, &jobs, &vec![compared; population], &|| false).unwrap();
            (1e3 * start.elapsed().as_secs_f64(), again)
        };
        let (_, again) = time(&mut candidates, Compared::Distances);
        assert!(first == again, "other bits the second time");
        let distances = (0..3).map(|_| time(&mut candidates, Compared::Distances).0).fold(1e9, f64::min);
        let squares = (0..3).map(|_| time(&mut candidates, Compared::Squares).0).fold(1e9, f64::min);
        let (kernels, bytes) = candidates.resources().unwrap();
        let parts: Vec<String> = candidates
            .breakdown()
            .unwrap()
            .iter()
            .map(|(part, seconds)| format!("{part} {:.2}", 1e3 * seconds))
            .collect();
        println!(
            "{label}: {population} candidates x 64 x 4 s: wass {distances:.2} ms, matcho {squares:.2} ms; ready in \
             {ready:.1} s; {} MiB; alone, ms: {}; {kernels:?}",
            bytes >> 20,
            parts.join(", ")
        );
        // Numbering the candidates otherwise changes nothing.
        let alone =
            candidates.parts(subject, &[jobs[3].clone(), nominal], &[Compared::Distances; 2], &|| false);
        assert!(alone.unwrap()[0] == first[3], "a candidate's distances depend on the others");
    }
}

/// Some robot's side.
fn pretend(tables: &Tables, dimensions: usize) -> Measured {
    let counted: usize = tables.lengths.iter().map(|&length| length as usize).sum();
    let sorted = (0..dimensions * counted).map(|k| (k % counted) as f64 / counted as f64 - 0.5).collect();
    let size = tables.recordings() * tables.samples * dimensions;
    let samples = (0..size).map(|k| (0.37 * k as f64).sin()).collect();
    Measured { skip: 0, sorted, samples }
}
