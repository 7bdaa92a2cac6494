//! Steps of a rollout by the kernels, as C++, and by the CPU's environment, compared number by number.

use std::collections::HashMap;

use crate::host::{bytes, call, doubles, execute, fill, floats, keep, take};
use gaitfit_cuda::emit::Class;
use gaitfit_cuda::physics::Period;
use gaitfit_cuda::rollout::{Mode, Packed, Plan, Scene, Sizes, control, imu_rows};
use gaitfit_learn::ppo::Exploration;
use gaitfit_learn::task::{Ended, Environment, Snapshot, Task, TaskSettings, preset, reward};
use gaitfit_model::Model;
use gaitfit_physics::{Params, Parts, memory_of};
use gaitfit_policy::walker::TorqueNoise;
use gaitfit_policy::{Quantity, Term};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Candidate;

pub const SEED: u64 = (7 << 32) + 3;
pub const FIRST: u32 = 25;
/// No multiple of a tile's environments.
pub const ENVIRONMENTS: usize = 21;
pub const STEPS: usize = 40;
pub const NETWORKS: usize = 5;
pub const PROCESSORS: usize = 132;

pub fn go2() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    gaitfit_model::read(path.as_ref(), &Default::default()).unwrap()
}

/// A built-in task with every reward term, short episodes, and much that happens.
pub fn lively(name: &str) -> TaskSettings {
    let mut settings: TaskSettings = toml::from_str(preset(name).unwrap()).unwrap();
    for (number, term) in reward::TERMS.iter().enumerate() {
        settings.rewards.insert(term.name.to_owned(), 0.3 - 0.05 * number as f64);
    }
    settings.episode_seconds = 15.0 * settings.control_dt;
    settings.command.seconds = 4.0 * settings.control_dt;
    settings.push.seconds = 6.0 * settings.control_dt;
    settings.push.velocity = 0.7;
    settings.randomisation.delay = [0.0, 0.01];
    settings.policy.critic_observation.push(Term::new(Quantity::BaseHeight));
    settings
}

pub fn sizes() -> Sizes {
    Sizes {
        steps: STEPS,
        environments: ENVIRONMENTS,
        networks: NETWORKS,
        gamma: 0.97,
        remembered: 0,
        mode: Mode::Training,
    }
}

/// What the CPU did in one step.
struct Step {
    observation: Vec<f32>,
    critic: Vec<f32>,
    action: Vec<f32>,
    log_probability: Vec<f32>,
    /// After the physics, and after new episodes began.
    moved: Vec<Snapshot>,
    begun: Vec<Snapshot>,
    reward: Vec<f32>,
    ended: Vec<Ended>,
    /// The critic's observations before new episodes.
    reached: Vec<f32>,
}

/// All environments; `returns` are the runner's.
pub fn snapshots(environment: &mut Environment<'_>, returns: &[[f32; 2]]) -> Vec<Snapshot> {
    let one = |index: usize| Snapshot { returns: returns[index], ..environment.snapshot(index) };
    (0..ENVIRONMENTS).map(one).collect()
}

/// The step of the rollout in which a simulation comes apart, and whose.
const BROKEN: (usize, usize) = (2, 3);

/// A rollout of the CPU as its runner does it, with means that are noise; the sums of the runner's tally. One robot is
/// made faster than any can be.
fn rollout(
    environment: &mut Environment<'_>,
    task: &Task,
    mean: &[f32],
    log_std: &[f32],
) -> (Vec<Step>, Vec<f64>) {
    let actions = task.walker.joints.len();
    let interface = &task.walker.interface;
    let mut exploration = Exploration::new(SEED, 0);
    let mut returns = vec![[0.0f32; 2]; ENVIRONMENTS];
    let mut sums = [0.0f64; 7];
    let (mut diverged, mut lost, mut levels) = (0.0, 0.0, 0.0);
    let mut steps = Vec::new();
    for t in 0..STEPS {
        let number = FIRST + t as u32;
        let mut step = Step {
            observation: vec![0.0; ENVIRONMENTS * interface.observation_width()],
            critic: vec![0.0; ENVIRONMENTS * interface.critic_width()],
            action: vec![0.0; ENVIRONMENTS * actions],
            log_probability: vec![0.0; ENVIRONMENTS],
            moved: Vec::new(),
            begun: Vec::new(),
            reward: vec![0.0; ENVIRONMENTS],
            ended: vec![Ended::No; ENVIRONMENTS],
            reached: vec![0.0; ENVIRONMENTS * interface.critic_width()],
        };
        environment.observe(number, &mut step.observation);
        environment.observe_critic(&mut step.critic);
        let means = &mean[t * ENVIRONMENTS * actions..(t + 1) * ENVIRONMENTS * actions];
        exploration.draw(log_std, number, means, &mut step.action, &mut step.log_probability);
        if t == BROKEN.0 {
            let mut broken = environment.snapshot(BROKEN.1);
            broken.robot.state[7] = 2e3;
            environment.set_snapshot(BROKEN.1, &broken).unwrap();
        }
        environment.step(number, &step.action, &mut step.reward, &mut step.ended);
        step.moved = snapshots(environment, &returns);
        environment.observe_critic(&mut step.reached);
        for (index, so_far) in returns.iter_mut().enumerate() {
            let broken = step.ended[index] == Ended::Diverged;
            diverged += f64::from(u8::from(broken));
            levels += environment.cell(index).map_or(0.0, |cell| cell.level as f64);
            let errors = if broken { [0.0; 2] } else { environment.tracking_error(index) };
            let [velocity, yaw] = errors.map(f64::from);
            so_far[0] += step.reward[index];
            so_far[1] += 1.0;
            let ended = f64::from(u8::from(step.ended[index] != Ended::No));
            let fell = f64::from(u8::from(matches!(step.ended[index], Ended::Fall | Ended::Diverged)));
            let [sum, length] = so_far.map(f64::from);
            lost += fell * f64::from(environment.steps_left(index));
            let added =
                [f64::from(step.reward[index]), velocity, yaw, ended, fell, ended * length, ended * sum];
            sums.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
            if ended > 0.0 {
                *so_far = [0.0; 2];
            }
        }
        environment.begin_episodes(number, &step.ended);
        step.begun = snapshots(environment, &returns);
        steps.push(step);
    }
    let [reward, rest @ ..] = sums;
    assert_eq!((steps[BROKEN.0].ended[BROKEN.1], diverged), (Ended::Diverged, 1.0));
    // The first divergence, by its step from 1, is of no reward term.
    let last = vec![diverged, lost, levels, BROKEN.0 as f64 + 1.0, 0.0];
    (steps, [vec![reward], environment.take_terms(), rest.to_vec(), last].concat())
}

/// Parameters of all robots in the physics' tiles.
pub fn params(period: &Period, robots: &[Params<f64>]) -> Vec<f32> {
    let layout = period.layout();
    let (size, per_tile) = (layout.size(Class::Params), layout.environments());
    let mut all = vec![0.0; ENVIRONMENTS.div_ceil(per_tile) * size];
    for (e, robot) in robots.iter().enumerate() {
        let mut numbers = Vec::new();
        robot.visit(|_, &number| numbers.push(number as f32));
        let places = layout.inputs.iter().filter(|place| place.class == Class::Params);
        for (place, number) in places.zip(numbers) {
            all[e / per_tile * size + layout.offset(*place, e % per_tile)] = number;
        }
    }
    all
}

/// Random torques from the physics' tiles: `substeps × environments × joints`.
pub fn disturbances(period: &Period, numbers: &[f32]) -> Vec<f32> {
    let layout = period.layout();
    let (size, per_tile) = (layout.size(Class::Disturbance), layout.environments());
    let places: Vec<_> = layout.inputs.iter().filter(|place| place.class == Class::Disturbance).collect();
    let mut all = Vec::new();
    for substep in numbers.chunks_exact(ENVIRONMENTS.div_ceil(per_tile) * size) {
        for e in 0..ENVIRONMENTS {
            all.extend(
                places
                    .iter()
                    .map(|place| substep[e / per_tile * size + layout.offset(**place, e % per_tile)]),
            );
        }
    }
    all
}

/// Largest difference relative to max(1, value).
pub fn apart(got: &[f32], want: &[f32]) -> f32 {
    assert_eq!(got.len(), want.len());
    got.iter().zip(want).fold(0.0, |worst, (got, want)| {
        let error = (got - want).abs() / want.abs().max(1.0);
        if error.is_nan() { f32::INFINITY } else { worst.max(error) }
    })
}

pub fn flat(snapshot: &Snapshot) -> Vec<f32> {
    let robot = &snapshot.robot;
    let feet: Vec<f32> = snapshot.feet.iter().flatten().copied().collect();
    [&robot.state, &robot.targets, &robot.memory, &robot.normal_force, &robot.tracked, &robot.torque]
        .into_iter()
        .chain([&snapshot.command.to_vec(), &snapshot.last_action, &feet, &snapshot.returns.to_vec()])
        .chain([&snapshot.way.to_vec(), &snapshot.past[0], &snapshot.past[1]])
        .flatten()
        .copied()
        .chain([snapshot.steps as f32, f32::from(u8::from(robot.fresh)), snapshot.turned])
        .collect()
}

/// What a robot's networks remember before a control period: where its joints are, if it is new; the zeros of
/// its other parts, if it has some.
pub fn remembered(candidate: &Candidate, was: &Snapshot) -> Vec<f32> {
    if !was.robot.fresh {
        return was.robot.memory.clone();
    }
    let joints = candidate.networks.iter().flat_map(|one| one.joints.clone());
    let motion = |joint: usize| {
        let bias = candidate.robot.encoder_bias[joint] as f32;
        [was.robot.state[13 + joint] + bias, was.robot.state[13 + 12 + joint]]
    };
    let networks = joints.flat_map(|joint| [motion(joint), motion(joint)].concat());
    let parts = Parts::from_robot(&candidate.robot).modifications::<f32>(12);
    networks.chain(std::iter::repeat_n(0.0, memory_of(&parts))).collect()
}

/// The arrays of environments around `candidate` as they start, by their names on the device.
pub fn inputs(start: &Packed, params: &[f32], candidate: &Candidate) -> HashMap<String, Vec<u8>> {
    let f = |numbers: &[f32]| bytes(numbers, f32::to_ne_bytes);
    let w = |words: &[u32]| bytes(words, u32::to_ne_bytes);
    let files = [
        ("robot_state", f(&start.state)),
        ("robot_targets", f(&start.targets)),
        ("robot_report", f(&start.report)),
        ("robot_memory", f(&start.memory)),
        ("robot_params", f(params)),
        ("deviation", bytes(&[candidate.torque_noise; ENVIRONMENTS], f64::to_ne_bytes)),
        ("imu", f(&imu_rows(std::slice::from_ref(candidate), 0..ENVIRONMENTS))),
        ("steps", w(&start.steps)),
        ("fresh", w(&start.fresh)),
        ("command", f(&start.command)),
        ("last_action", f(&start.last_action)),
        ("feet", f(&start.feet)),
        ("returns", f(&start.returns)),
        ("past", f(&start.past)),
        ("critic_past", f(&start.critic_past)),
        ("ways", f(&start.ways)),
        ("turned", f(&start.turned)),
    ];
    files.map(|(name, bytes)| (name.to_owned(), bytes)).into()
}

/// Holds every kernel of a rollout against the CPU.
pub fn compare(label: &str, task: &Task, candidate: &Candidate) {
    let period = Scene::period(task, std::slice::from_ref(candidate), ENVIRONMENTS, PROCESSORS).unwrap();
    let scene = Scene::new(task, &period, sizes()).unwrap();
    let plan = Plan::new(&scene);
    let arrays = &plan.arrays;
    let actions = task.walker.joints.len();
    let noise = Stream::new(5, Purpose::BOOTSTRAP);
    let numbers = |count: usize, from: u32, size: f32| -> Vec<f32> {
        (0..count).map(|k| size * noise.normal(from + k as u32) as f32).collect()
    };
    let mean = numbers(STEPS * ENVIRONMENTS * actions, 0, 0.5);
    let log_std: Vec<f32> = (0..actions).map(|k| -0.3 - 0.05 * k as f32).collect();
    // Episodes also end at the edge of generated ground.
    let cuts = STEPS.div_ceil(task.episode_steps() as usize) + usize::from(task.course.is_some());
    let tails = (1 + cuts) * ENVIRONMENTS;
    let tail_value = numbers(tails, 1 << 20, 3.0);

    let mut environment = Environment::new(task, Some(candidate), SEED, 0, ENVIRONMENTS).unwrap();
    environment.stagger();
    // Half way, where commands grow.
    let ranges = task.settings.command.ranges(0.5);
    environment.set_command_ranges(ranges);
    environment.draw_commands();
    let tiles = ENVIRONMENTS.div_ceil(period.layout().environments());
    let start = Packed::new(&scene, &snapshots(&mut environment, &[[0.0; 2]; ENVIRONMENTS]), tiles);
    let (steps, sums) = rollout(&mut environment, task, &mean, &log_std);

    let f = |numbers: &[f32]| bytes(numbers, f32::to_ne_bytes);
    let robots = task.robots(std::slice::from_ref(candidate), SEED, 0, ENVIRONMENTS).unwrap();
    let mut files = inputs(&start, &params(&period, &robots), candidate);
    for (name, bytes) in [
        ("mean", f(&mean)),
        ("parameters", f(&[vec![f32::NAN; NETWORKS], log_std].concat())),
        ("control", bytes(&control(FIRST, SEED, ranges, 0), u32::to_ne_bytes)),
        ("tail_value", f(&tail_value)),
    ] {
        files.insert(name.to_owned(), bytes);
    }
    let kept = [
        "robot_state",
        "robot_targets",
        "robot_report",
        "robot_memory",
        "steps",
        "fresh",
        "command",
        "last_action",
        "feet",
        "returns",
        "past",
        "critic_past",
        "ways",
        "turned",
    ];
    let mut statements = fill(&plan.program, &mut files);
    statements.push_str(&call(&plan.begin()));
    for (t, step) in steps.iter().enumerate() {
        let packed = Packed::new(&scene, &step.moved, tiles);
        files.insert(format!("robot_state.moved{t}"), f(&packed.state));
        files.insert(format!("robot_report.moved{t}"), f(&packed.report));
        files.insert(format!("robot_memory.moved{t}"), f(&packed.memory));
        files.insert(format!("robot_targets.moved{t}"), f(&packed.targets));
        statements.push_str(&call(&plan.observe(t)));
        statements.push_str(&call(&plan.act(t)));
        if let Some(disturb) = plan.disturb(t, tiles) {
            statements.push_str(&call(&disturb));
            statements.push_str(&keep(arrays, "robot_disturbance", &format!("noise{t}")));
        }
        statements.push_str(&keep(arrays, "robot_state", &format!("pushed{t}")));
        statements.push_str(&keep(arrays, "robot_memory", &format!("pushed{t}")));
        statements.push_str(&keep(arrays, "robot_targets", &format!("pushed{t}")));
        statements.push_str(&take(arrays, "robot_state", &format!("moved{t}")));
        statements.push_str(&take(arrays, "robot_report", &format!("moved{t}")));
        statements.push_str(&take(arrays, "robot_memory", &format!("moved{t}")));
        // Networks correct targets in the physics.
        if !candidate.networks.is_empty() {
            statements.push_str(&take(arrays, "robot_targets", &format!("moved{t}")));
        }
        statements.push_str(&call(&plan.finish(t)));
        for name in kept.into_iter().filter(|name| plan.array(name).is_some()) {
            statements.push_str(&keep(arrays, name, &format!("begun{t}")));
        }
    }
    statements.push_str(&call(&plan.observe_end()));
    statements.push_str(&call(&plan.add_values()));
    statements.push_str(&call(&plan.total()));
    let results = [
        "observation",
        "critic_observation",
        "action",
        "log_probability",
        "reward",
        "done",
        "last_value",
        "tail",
        "cut",
        "totals",
    ];
    for name in results {
        statements.push_str(&keep(arrays, name, "out"));
    }
    let folder = execute(&plan.program.text, arrays, &files, &[], &statements);
    let read =
        |name: &str, suffix: &str| std::fs::read(folder.path().join(format!("{name}.{suffix}"))).unwrap();
    let out = |name: &str| floats(&read(name, "out"));

    let mut worst = 0.0f32;
    let mut check = |what: &str, t: usize, got: &[f32], want: &[f32], limit: f32| {
        let error = apart(got, want);
        assert!(error <= limit, "{label}, step {t}: {what} differs by {error:e}");
        worst = worst.max(error);
    };
    let all = |of: fn(&Step) -> &Vec<f32>| -> Vec<f32> { steps.iter().flat_map(|s| of(s).clone()).collect() };
    check("observation", 0, &out("observation"), &all(|s| &s.observation), 1e-6);
    check("critic's observation", 0, &out("critic_observation"), &all(|s| &s.critic), 1e-6);
    check("action", 0, &out("action"), &all(|s| &s.action), 1e-6);
    check("log probability", 0, &out("log_probability"), &all(|s| &s.log_probability), 1e-6);
    let mut rewards = all(|s| &s.reward);
    let (tail, cut) = (out("tail"), read("cut", "out"));
    let width = task.walker.interface.critic_width();
    let (mut cuts, mut falls) = (0, 0);
    let mut cut_before = [0; ENVIRONMENTS];
    for (t, step) in steps.iter().enumerate() {
        for (e, ended) in step.ended.iter().enumerate() {
            let slot = if task.course.is_some() { cut_before[e] } else { t / task.episode_steps() as usize };
            falls += usize::from(*ended == Ended::Fall);
            if *ended == Ended::TimeOut {
                cuts += 1;
                cut_before[e] += 1;
                let row = (1 + slot) * ENVIRONMENTS + e;
                rewards[t * ENVIRONMENTS + e] += sizes().gamma as f32 * tail_value[row];
                let reached = &step.reached[e * width..(e + 1) * width];
                check("cut-off row", t, &tail[row * width..(row + 1) * width], reached, 1e-6);
                assert_eq!(cut[4 * (slot * ENVIRONMENTS + e)], t as u8 + 1);
            }
        }
    }
    assert!(cuts > 10 && falls > 3, "{label}: {cuts} episodes cut off, {falls} falls");
    check("reward", 0, &out("reward"), &rewards, 3e-6);
    let ended = |s: &Step| s.ended.iter().map(|e| f32::from(u8::from(*e != Ended::No))).collect::<Vec<_>>();
    check("done", 0, &out("done"), &steps.iter().flat_map(ended).collect::<Vec<_>>(), 0.0);
    check("last values", 0, &out("last_value"), &tail_value[..ENVIRONMENTS], 0.0);
    let mut last = vec![0.0; ENVIRONMENTS * width];
    environment.observe_critic(&mut last);
    check("last rows", STEPS, &tail[..ENVIRONMENTS * width], &last, 1e-6);
    let totals = doubles(&read("totals", "out"));
    assert_eq!(totals.len(), sums.len());
    for (got, want) in totals.iter().zip(&sums) {
        assert!((got - want).abs() < 2e-6 * want.abs().max(1.0), "{label}: a sum is {got}, not {want}");
    }
    let mut before = start;
    for (t, step) in steps.iter().enumerate() {
        let suffix = format!("begun{t}");
        let numbers = |name: &str| floats(&read(name, &suffix));
        let words = |name: &str| numbers(name).iter().map(|x| x.to_bits()).collect();
        let packed = Packed {
            state: numbers("robot_state"),
            targets: numbers("robot_targets"),
            report: numbers("robot_report"),
            memory: numbers("robot_memory"),
            steps: words("steps"),
            fresh: words("fresh"),
            command: numbers("command"),
            last_action: numbers("last_action"),
            feet: numbers("feet"),
            returns: numbers("returns"),
            past: numbers("past"),
            critic_past: numbers("critic_past"),
            ways: numbers("ways"),
            turned: plan.array("turned").map_or_else(Vec::new, |_| numbers("turned")),
        };
        for (e, (got, want)) in packed.snapshots(&scene).iter().zip(&step.begun).enumerate() {
            check(&format!("environment {e}"), t, &flat(got), &flat(want), 3e-6);
        }
        // Pushes go into the base's linear velocity, numbers 7 and 8 of the state.
        let numbers = |name: &str| floats(&read(name, &format!("pushed{t}")));
        let pushed = Packed {
            state: numbers("robot_state"),
            memory: numbers("robot_memory"),
            targets: numbers("robot_targets"),
            ..before.clone()
        };
        let mut newest = vec![0.0; ENVIRONMENTS * 12];
        task.walker.targets(&step.action, &mut newest);
        for (e, (got, was)) in pushed.snapshots(&scene).iter().zip(before.snapshots(&scene)).enumerate() {
            let number = FIRST + t as u32;
            let due = (number + 7 * e as u32).is_multiple_of(6) && was.steps > 0;
            let mut want = was.robot.state.clone();
            let draws = Stream::new(SEED, Purpose::PUSH).environment(e as u32).step(number);
            for k in 0..if due { 2 } else { 0 } {
                want[7 + k] += (0.7 * (2.0 * draws.uniform(k as u32) - 1.0)) as f32;
            }
            check("pushed robot", t, &got.robot.state, &want, 1e-6);
            let newest = &newest[12 * e..12 * (e + 1)];
            let mut sent = newest.to_vec();
            while sent.len() < got.robot.targets.len() {
                let older = &was.robot.targets[sent.len() - 12..sent.len()];
                sent.extend_from_slice(if was.robot.fresh { newest } else { older });
            }
            check("targets", t, &got.robot.targets, &sent, 1e-6);
            check("memory", t, &got.robot.memory, &remembered(candidate, &was), 1e-6);
        }
        before = packed;
        if candidate.torque_noise > 0.0 {
            let torques = floats(&read("robot_disturbance", &format!("noise{t}")));
            let mut noise = TorqueNoise::default();
            let want = noise.torques(&task.walker, candidate, SEED, 0, FIRST + t as u32, ENVIRONMENTS);
            check("random torques", t, &disturbances(&period, &torques), want, 0.0);
        }
    }
    println!("{label}: {cuts} episodes cut off, {falls} falls, off by at most {worst:e}");
}
