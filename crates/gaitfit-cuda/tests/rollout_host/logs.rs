//! What the kernels record of a policy's walks, as C++, and what the CPU does.

use super::along::{ENVIRONMENTS, NETWORKS, PROCESSORS, SEED, go2, inputs, lively, params};
use crate::host::{bytes, call, execute, fill, floats, keep, take};
use gaitfit_cuda::rollout::{Mode, Packed, Plan, Scene, Sizes, control};
use gaitfit_learn::collect::{CollectOptions, Recorder, sensed, sensed_width};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::{Ended, Environment, Snapshot, Task};
use gaitfit_physics::Preset;
use gaitfit_policy::{ActionClip, MotionPlace};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::{Candidate, Sensors};

const STEPS: usize = 30;
/// No multiple of anything.
const FIRST: u32 = 1037;

/// Logs that begin later, commands that are drawn anew every four steps, episodes of fifteen steps that go on, falls,
/// pushes and torque noise; joints in another order, clipped actions, biased encoders, a tilted unit, slow sensors of
/// velocity, another physics step.
#[test]
#[ignore = "needs g++"]
fn cxx_logs_are_the_cpus() {
    let (task, candidate) = fitted();
    compare(&task, &candidate);
}

/// A robot with errors of its sensors, and its task.
fn fitted() -> (Task, Candidate) {
    let model = go2();
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    settings.robot_timestep = Some(0.001);
    let mut interface = Task::new(&model, &settings, Preset::Fast).unwrap().walker.interface;
    interface.joints.reverse();
    interface.default_pose.reverse();
    interface.action_clip = Some(ActionClip::All(0.8));
    let task = Task::with_interface(&model, &settings, interface, Preset::Fast, 0.03).unwrap();
    let mut candidate = Candidate { torque_noise: 0.4, ..Candidate::nominal(&model) };
    candidate.robot.encoder_bias = (0..12).map(|j| 0.01 * f64::from(j) - 0.05).collect();
    candidate.robot.velocity_lag = 0.004;
    candidate.robot.imu_delay = 0.007;
    candidate.sensors = Sensors { imu_tilt: [0.06, -0.04], gyro_bias: [0.1, -0.15, 0.05] };
    (task, candidate)
}

/// Holds the records of a task's walks against the CPU.
pub fn compare(task: &Task, candidate: &Candidate) {
    let candidates = std::slice::from_ref(candidate);
    let policy = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let policy = gaitfit_policy_files::read(policy.as_ref()).unwrap();
    let subject =
        Subject { task, policy: &policy, candidate: Some(candidate), seed: SEED, cancel: None, moved: None };
    let dt = task.walker.interface.control_dt;
    let options = CollectOptions {
        count: ENVIRONMENTS,
        seconds: (STEPS - 6) as f64 * dt,
        shift: [0.0, 6.0 * dt],
        privileged: true,
    };
    let period = Scene::period(task, candidates, ENVIRONMENTS, PROCESSORS).unwrap();
    let (networks, mode) = (NETWORKS, Mode::Logs);
    let sizes = Sizes { steps: STEPS, environments: ENVIRONMENTS, networks, gamma: 1.0, remembered: 0, mode };
    let scene = Scene::new(task, &period, sizes).unwrap();
    let plan = Plan::new(&scene);
    let actions = task.walker.joints.len();
    let (width, joints) = (ENVIRONMENTS * actions, task.walker.default_pose.len());
    let noise = Stream::new(5, Purpose::BOOTSTRAP);
    let mean: Vec<f32> = (0..STEPS * width).map(|k| 0.5 * noise.normal(k as u32) as f32).collect();
    let tiles = ENVIRONMENTS.div_ceil(period.layout().environments());

    // The CPU.
    let mut environment = Environment::new(task, Some(candidate), SEED, FIRST, ENVIRONMENTS).unwrap();
    let all = |environment: &mut Environment<'_>| -> Vec<Snapshot> {
        (0..ENVIRONMENTS).map(|index| environment.snapshot(index)).collect()
    };
    let start = Packed::new(&scene, &all(&mut environment), tiles);
    let start_place: Vec<_> = (0..ENVIRONMENTS).map(|index| environment.motion_place(index)).collect();
    let mut wanted = Recorder::new(&subject, &options, FIRST, ENVIRONMENTS);
    assert!(wanted.last() as usize <= STEPS && wanted.last() as usize > STEPS - 6);
    let (mut moved, mut row) = (Vec::new(), Vec::new());
    for (t, means) in mean.chunks_exact(width).enumerate() {
        let number = t as u32 + 1;
        for index in 0..ENVIRONMENTS {
            if wanted.records(index, number) {
                sensed(task, &environment, index, &mut row);
                wanted.sense(index, &row);
                wanted.follow(index, environment.motion_place(index));
            }
        }
        let (mut reward, mut ended) = (vec![0.0; ENVIRONMENTS], vec![Ended::No; ENVIRONMENTS]);
        environment.step(number, means, &mut reward, &mut ended);
        for (index, ended) in ended.iter().enumerate() {
            let fell = matches!(ended, Ended::Fall | Ended::Diverged);
            let own = &means[index * actions..][..actions];
            wanted.act(index, number, own, &environment.targets()[index * joints..][..joints], fell);
        }
        moved.push(all(&mut environment));
    }
    let wanted = wanted.finish();

    // The kernels, with the CPU's physics.
    let f = |numbers: &[f32]| bytes(numbers, f32::to_ne_bytes);
    let robots = task.robots(candidates, SEED, FIRST, ENVIRONMENTS).unwrap();
    let quiet = [vec![f32::NAN; NETWORKS], vec![-1e4; actions]].concat();
    let ranges = task.settings.command.ranges(1.0);
    let mut files = inputs(&start, &params(&period, &robots), candidate);
    for (name, bytes) in [
        ("mean", f(&mean)),
        ("parameters", f(&quiet)),
        ("control", bytes(&control(1, SEED, ranges, FIRST), u32::to_ne_bytes)),
    ] {
        files.insert(name.to_owned(), bytes);
    }
    let mut statements = fill(&plan.program, &mut files);
    statements.push_str(&call(&plan.begin()));
    for (t, moved) in moved.iter().enumerate() {
        let packed = Packed::new(&scene, moved, tiles);
        files.insert(format!("robot_state.moved{t}"), f(&packed.state));
        files.insert(format!("robot_report.moved{t}"), f(&packed.report));
        files.insert(format!("robot_memory.moved{t}"), f(&packed.memory));
        statements.push_str(&call(&plan.record(t).unwrap()));
        statements.push_str(&call(&plan.observe(t)));
        statements.push_str(&call(&plan.act(t)));
        statements.push_str(&take(&plan.arrays, "robot_state", &format!("moved{t}")));
        statements.push_str(&take(&plan.arrays, "robot_report", &format!("moved{t}")));
        statements.push_str(&take(&plan.arrays, "robot_memory", &format!("moved{t}")));
        statements.push_str(&call(&plan.finish(t)));
    }
    for name in ["records", "action", "done"] {
        statements.push_str(&keep(&plan.arrays, name, "out"));
    }
    let folder = execute(&plan.program.text, &plan.arrays, &files, &[], &statements);
    let out = |name: &str| floats(&std::fs::read(folder.path().join(format!("{name}.out"))).unwrap());
    let (records, action, done) = (out("records"), out("action"), out("done"));
    let row = sensed_width(actions);
    let mut recorder = Recorder::new(&subject, &options, FIRST, ENVIRONMENTS);
    let mut targets = vec![0.0; ENVIRONMENTS * joints];
    for t in 0..STEPS {
        let number = t as u32 + 1;
        task.walker.targets(&action[t * width..(t + 1) * width], &mut targets);
        for index in 0..ENVIRONMENTS {
            let at = t * ENVIRONMENTS + index;
            if recorder.records(index, number) {
                recorder.sense(index, &records[at * row..][..row]);
                // As `gaitfit_cuda::rollout::collect` does it: the motion is turned at a log's start.
                let time = t as f64 * dt;
                recorder.follow(index, MotionPlace { time, ..start_place[index] });
            }
            let own = &action[at * actions..][..actions];
            recorder.act(index, number, own, &targets[index * joints..][..joints], done[at] != 0.0);
        }
    }
    let mut changed = 0;
    for (index, (log, wanted)) in recorder.finish().iter().zip(&wanted).enumerate() {
        assert_eq!(log.trajectory.command, wanted.trajectory.command, "commands of robot {index}");
        assert_eq!(log, wanted, "robot {index}");
        let commands = wanted.trajectory.command.as_ref().unwrap();
        changed += usize::from(commands.chunks_exact(3).any(|command| command != &commands[..3]));
    }
    let falls = wanted.iter().filter(|log| log.fell).count();
    println!("{falls} of {ENVIRONMENTS} robots fell, {changed} got another command");
    assert!(falls > 2 && falls < ENVIRONMENTS && changed > 2, "{falls} falls, {changed} changed commands");
}
