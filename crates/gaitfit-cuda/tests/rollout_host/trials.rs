//! Steps of a policy's trajectories by the kernels, as C++, and by the CPU's environment.

use super::along::{ENVIRONMENTS, NETWORKS, PROCESSORS, SEED, apart, go2, inputs, lively, params};
use crate::host::{bytes, call, execute, fill, floats, keep, take};
use gaitfit_cuda::rollout::{Mode, Packed, Plan, Scene, Sizes, control};
use gaitfit_learn::evaluate::{Subject, Trials, trial_environments};
use gaitfit_learn::task::{Ended, Snapshot, Task};
use gaitfit_physics::Preset;
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Candidate;

const STEPS: usize = 30;
/// No multiple of anything.
const FIRST: u32 = 1037;

/// What the CPU did in one step.
struct Step {
    moved: Vec<Snapshot>,
    observation: Vec<f32>,
    reward: Vec<f32>,
    ended: Vec<Ended>,
    errors: Vec<[f32; 2]>,
    /// Distances from the motion, where the policy follows one.
    off: Vec<Option<f32>>,
}

/// Environments that are not the first, commands that stay though the task draws new ones every four steps, episodes of
/// fifteen steps that go on, noise and pushes; actions are the means.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_of_trajectories_are_the_cpus() {
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    compare(&Task::new(&go2(), &settings, Preset::Fast).unwrap());
}

/// Holds the kernels of trajectories of a task against the CPU.
pub fn compare(task: &Task) {
    let candidate = Candidate { torque_noise: 0.4, ..Candidate::nominal(&go2()) };
    let policy = gaitfit_policy_files::read(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors").as_ref(),
    );
    let subject = Subject {
        task,
        policy: &policy.unwrap(),
        candidate: Some(&candidate),
        seed: SEED,
        cancel: None,
        moved: None,
    };
    let candidates = std::slice::from_ref(&candidate);
    let period = Scene::period(task, candidates, ENVIRONMENTS, PROCESSORS).unwrap();
    let sizes = Sizes {
        steps: STEPS,
        environments: ENVIRONMENTS,
        networks: NETWORKS,
        gamma: 1.0,
        remembered: 0,
        mode: Mode::Trials,
    };
    let scene = Scene::new(task, &period, sizes).unwrap();
    let plan = Plan::new(&scene);
    let actions = task.walker.joints.len();
    let width = ENVIRONMENTS * actions;
    let noise = Stream::new(5, Purpose::BOOTSTRAP);
    let mean: Vec<f32> = (0..STEPS * width).map(|k| 0.5 * noise.normal(k as u32) as f32).collect();
    let tiles = ENVIRONMENTS.div_ceil(period.layout().environments());

    let mut environment = trial_environments(&subject, FIRST, ENVIRONMENTS).unwrap();
    let all = |environment: &mut gaitfit_learn::task::Environment<'_>| -> Vec<Snapshot> {
        (0..ENVIRONMENTS).map(|index| environment.snapshot(index)).collect()
    };
    let start = Packed::new(&scene, &all(&mut environment), tiles);
    let mut wanted = Trials::new(environment.commands(), actions);
    let mut steps = Vec::new();
    for (t, means) in mean.chunks_exact(width).enumerate() {
        let number = t as u32 + 1;
        let mut observation = vec![0.0; ENVIRONMENTS * task.walker.interface.observation_width()];
        let (mut reward, mut ended) = (vec![0.0; ENVIRONMENTS], vec![Ended::No; ENVIRONMENTS]);
        environment.observe(number, &mut observation);
        environment.step(number, means, &mut reward, &mut ended);
        let errors = (0..ENVIRONMENTS).map(|index| environment.tracking_error(index)).collect();
        let off = (0..ENVIRONMENTS).map(|index| environment.motion_error(index)).collect();
        let step = Step { moved: all(&mut environment), observation, reward, ended, errors, off };
        wanted.take(number, means, |index| (step.reward[index], step.ended[index], step.errors[index]));
        wanted.take_motion(|index| step.off[index]);
        steps.push(step);
    }
    let wanted = wanted.finish();

    let f = |numbers: &[f32]| bytes(numbers, f32::to_ne_bytes);
    let robots = task.robots(candidates, SEED, FIRST, ENVIRONMENTS).unwrap();
    let quiet = [vec![f32::NAN; NETWORKS], vec![-1e4; actions]].concat();
    let ranges = task.settings.command.ranges(1.0);
    let mut files = inputs(&start, &params(&period, &robots), &candidate);
    for (name, bytes) in [
        ("mean", f(&mean)),
        ("parameters", f(&quiet)),
        ("control", bytes(&control(1, SEED, ranges, FIRST), u32::to_ne_bytes)),
    ] {
        files.insert(name.to_owned(), bytes);
    }
    let mut statements = fill(&plan.program, &mut files);
    statements.push_str(&call(&plan.begin()));
    for (t, step) in steps.iter().enumerate() {
        let packed = Packed::new(&scene, &step.moved, tiles);
        files.insert(format!("robot_state.moved{t}"), f(&packed.state));
        files.insert(format!("robot_report.moved{t}"), f(&packed.report));
        statements.push_str(&call(&plan.observe(t)));
        statements.push_str(&call(&plan.act(t)));
        statements.push_str(&take(&plan.arrays, "robot_state", &format!("moved{t}")));
        statements.push_str(&take(&plan.arrays, "robot_report", &format!("moved{t}")));
        statements.push_str(&call(&plan.finish(t)));
    }
    let follows = task.walker.observation.follows();
    let of_motion = follows.then_some("motion_errors");
    for name in
        ["observation", "action", "reward", "done", "errors", "bases", "command"].into_iter().chain(of_motion)
    {
        statements.push_str(&keep(&plan.arrays, name, "out"));
    }
    let folder = execute(&plan.program.text, &plan.arrays, &files, &[], &statements);
    let out = |name: &str| floats(&std::fs::read(folder.path().join(format!("{name}.out"))).unwrap());
    let (action, reward, done, errors) = (out("action"), out("reward"), out("done"), out("errors"));
    let (bases, off) = (out("bases"), of_motion.map(out));
    assert!(action == mean, "actions are not the means");
    // Robots that have fallen begin anew here, which does not count.
    let seen = out("observation");
    let wide = task.walker.interface.observation_width();
    let (mut trials, mut fallen) = (Trials::new(environment.commands(), actions), vec![false; ENVIRONMENTS]);
    for (t, step) in steps.iter().enumerate() {
        for index in (0..ENVIRONMENTS).filter(|&index| !fallen[index]) {
            let row = (t * ENVIRONMENTS + index) * wide;
            let error = apart(&seen[row..row + wide], &step.observation[index * wide..(index + 1) * wide]);
            assert!(error <= 1e-6, "step {t}, robot {index}: observations differ by {error:e}");
        }
        // Places are those that robots reached, also of those that then began anew.
        for (index, moved) in step.moved.iter().enumerate() {
            let at = 7 * (t * ENVIRONMENTS + index);
            assert_eq!(bases[at..at + 7], moved.robot.state[..7], "step {t}, robot {index}");
        }
        let state = |index: usize| {
            let at = t * ENVIRONMENTS + index;
            let ended = if done[at] != 0.0 { Ended::Fall } else { Ended::No };
            (reward[at], ended, [errors[2 * at], errors[2 * at + 1]])
        };
        trials.take(t as u32 + 1, &action[t * width..(t + 1) * width], state);
        trials.take_motion(|index| off.as_ref().map(|off| off[t * ENVIRONMENTS + index]));
        step.ended.iter().zip(&mut fallen).for_each(|(ended, fallen)| *fallen |= *ended == Ended::Fall);
    }
    let near = |got: f64, want: f64| assert!((got - want).abs() < 1e-5 * want.abs().max(1.0), "{got} {want}");
    let mut falls = 0;
    for (got, want) in trials.finish().iter().zip(&wanted) {
        assert_eq!((got.command, got.steps, got.fell), (want.command, want.steps, want.fell));
        near(got.reward, want.reward);
        near(got.linear_velocity_error, want.linear_velocity_error);
        near(got.angular_velocity_error, want.angular_velocity_error);
        assert_eq!(got.action_rate, want.action_rate);
        assert_eq!((got.motion_error.is_some(), want.motion_error.is_some()), (follows, follows));
        near(got.motion_error.unwrap_or_default(), want.motion_error.unwrap_or_default());
        falls += usize::from(got.fell);
    }
    println!("{falls} of {ENVIRONMENTS} robots fell");
    assert!(falls > 2 && falls < ENVIRONMENTS, "{falls} falls");
}
