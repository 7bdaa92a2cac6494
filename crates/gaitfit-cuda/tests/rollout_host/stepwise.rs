//! Steps one by one under actions from outside by the kernels, as C++, and by the CPU's environments.

use std::collections::HashMap;

use super::along::{ENVIRONMENTS, PROCESSORS, SEED, apart, go2, inputs, lively, params, snapshots};
use crate::host::{bytes, call, doubles, execute, fill, floats, keep, take};
use gaitfit_cuda::rollout::{Mode, Packed, Plan, Scene, Sizes, before_rows, control};
use gaitfit_learn::task::{Ended, Environment, Snapshot, Task};
use gaitfit_physics::Preset;
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Candidate;

const STEPS: usize = 56;
/// From this step on robots whose episode ended stay as they are.
const HELD: usize = 40;
/// Before this step all robots begin anew.
const RESTART: usize = 27;
/// The step in which a simulation comes apart, and whose.
const BROKEN: (usize, usize) = (2, 3);
/// The step before which an action is refused, and its place.
const REFUSED: (usize, usize) = (5, 4 * 12 + 7);
/// After this step the state is read.
const READ: usize = 11;
/// So many steps follow it where the state is taken up again.
const AGAIN: usize = 6;

/// What robots show after a step, or before the first.
struct Shown {
    observation: Vec<f32>,
    critic: Vec<f32>,
    commands: Vec<[f32; 3]>,
}

/// What the CPU did in one step.
struct Step {
    action: Vec<f32>,
    /// After the physics.
    moved: Vec<Snapshot>,
    reward: Vec<f32>,
    ended: Vec<Ended>,
    /// Sums of the reward terms over all robots.
    terms: Vec<f64>,
    /// What robots observed before new episodes.
    last: Vec<f32>,
    after: Shown,
}

fn shown(environment: &mut Environment<'_>, task: &Task, number: u32) -> Shown {
    let interface = &task.walker.interface;
    let mut observation = vec![0.0; ENVIRONMENTS * interface.observation_width()];
    let mut critic = vec![0.0; ENVIRONMENTS * interface.critic_width()];
    environment.observe(number, &mut observation);
    environment.observe_critic(&mut critic);
    Shown { observation, critic, commands: environment.commands().to_vec() }
}

/// One step of the CPU as `gaitfit.Robots` does it; `held`: without `autoreset`.
fn advance(
    environment: &mut Environment<'_>,
    task: &Task,
    number: u32,
    action: Vec<f32>,
    held: bool,
) -> Step {
    let (mut reward, mut ended) = (vec![0.0; ENVIRONMENTS], vec![Ended::No; ENVIRONMENTS]);
    environment.step(number, &action, &mut reward, &mut ended);
    let moved = snapshots(environment, &[[0.0; 2]; ENVIRONMENTS]);
    let width = task.walker.interface.observation_width();
    let mut last = shown(environment, task, number + 1).observation;
    for (row, ended) in last.chunks_exact_mut(width).zip(&ended) {
        if *ended == Ended::Diverged {
            row.fill(0.0);
        }
    }
    let begins = |ended: &Ended| if held && *ended != Ended::Diverged { Ended::No } else { *ended };
    environment.begin_episodes(number, &ended.iter().map(begins).collect::<Vec<_>>());
    let after = shown(environment, task, number + 1);
    Step { action, moved, reward, ended, terms: environment.take_terms(), last, after }
}

/// How all robots move, in the order of the array `motion`.
fn motion(environment: &Environment<'_>, task: &Task) -> Vec<f32> {
    let (motion, joints) = (environment.motion(), task.walker.default_pose.len());
    let of_joints = [&motion.joint_position, &motion.joint_velocity, &motion.torque].map(|values| {
        let rows = values.chunks_exact(joints);
        rows.flat_map(|row| task.walker.joints.iter().map(|&joint| row[joint])).collect()
    });
    [&motion.base_position, &motion.base_quaternion, &motion.base_linear, &motion.base_angular]
        .into_iter()
        .cloned()
        .chain(of_joints)
        .collect::<Vec<Vec<f32>>>()
        .concat()
}

/// The arrays that hold a state.
const STATE: [&str; 14] = [
    "robot_state",
    "robot_targets",
    "robot_memory",
    "robot_report",
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

/// The state in the files of a run, by their reader. `follows`: whether the policy follows a motion.
fn state(read: &dyn Fn(&str) -> Vec<u8>, follows: bool) -> Packed {
    let f = |name: &str| floats(&read(name));
    let w = |name: &str| -> Vec<u32> {
        read(name).chunks_exact(4).map(|b| u32::from_ne_bytes(b.try_into().unwrap())).collect()
    };
    Packed {
        state: f("robot_state"),
        targets: f("robot_targets"),
        memory: f("robot_memory"),
        report: f("robot_report"),
        steps: w("steps"),
        fresh: w("fresh"),
        command: f("command"),
        last_action: f("last_action"),
        feet: f("feet"),
        returns: f("returns"),
        past: f("past"),
        critic_past: f("critic_past"),
        ways: f("ways"),
        turned: if follows { f("turned") } else { Vec::new() },
    }
}

/// With `again` the state is also taken to the CPU amid the steps, and back to the kernels, which go on from there.
pub fn compare(label: &str, task: &Task, candidate: &Candidate, again: bool) {
    let candidates = std::slice::from_ref(candidate);
    let period = Scene::period(task, candidates, ENVIRONMENTS, PROCESSORS).unwrap();
    let sizes = Sizes {
        steps: 1,
        environments: ENVIRONMENTS,
        networks: 0,
        gamma: 1.0,
        remembered: 0,
        mode: Mode::Steps,
    };
    let scene = Scene::new(task, &period, sizes).unwrap();
    let plan = Plan::new(&scene);
    let arrays = &plan.arrays;
    let tiles = ENVIRONMENTS.div_ceil(period.layout().environments());
    let width = task.walker.joints.len();
    let noise = Stream::new(5, Purpose::BOOTSTRAP);

    let mut environment = Environment::new(task, Some(candidate), SEED, 0, ENVIRONMENTS).unwrap();
    let one = environment.snapshot(0);
    environment.stagger();
    let ages: Vec<u32> = (0..ENVIRONMENTS).map(|index| environment.snapshot(index).steps).collect();
    let before = shown(&mut environment, task, 0);
    let mut restarted = None;
    let mut number = 0;
    let mut steps = Vec::new();
    for t in 0..STEPS {
        if t == RESTART {
            environment.begin_episodes(number, &[Ended::TimeOut; ENVIRONMENTS]);
            number += 1;
            restarted = Some(shown(&mut environment, task, number));
        }
        if t == BROKEN.0 {
            let mut broken = environment.snapshot(BROKEN.1);
            broken.robot.state[7] = 2e3;
            environment.set_snapshot(BROKEN.1, &broken).unwrap();
        }
        let draw = |k: usize| 0.5 * noise.normal((t * ENVIRONMENTS * width + k) as u32) as f32;
        let action = (0..ENVIRONMENTS * width).map(draw).collect();
        steps.push(advance(&mut environment, task, number, action, t >= HELD));
        number += 1;
    }
    let moved = motion(&environment, task);
    // Every third robot begins anew.
    let chosen = |e: usize| e.is_multiple_of(3);
    let begins: Vec<Ended> =
        (0..ENVIRONMENTS).map(|e| if chosen(e) { Ended::TimeOut } else { Ended::No }).collect();
    environment.begin_episodes(number, &begins);
    let renewed = shown(&mut environment, task, number + 1);

    let f = |numbers: &[f32]| bytes(numbers, f32::to_ne_bytes);
    let w = |words: &[u32]| bytes(words, u32::to_ne_bytes);
    let robots = task.robots(candidates, SEED, 0, ENVIRONMENTS).unwrap();
    let start = Packed::new(&scene, &vec![one; ENVIRONMENTS], tiles);
    let mut files = inputs(&start, &params(&period, &robots), candidate);
    let ranges = task.settings.command.ranges(1.0);
    for (name, bytes) in [
        ("parameters", f(&vec![-1e4; width])),
        ("control", w(&control(u32::MAX, SEED, ranges, 0))),
        ("refused", w(&[u32::MAX])),
        ("refused.none", w(&[u32::MAX])),
        ("held", w(&[0])),
        ("held.now", w(&[1])),
        ("chosen", w(&[1; ENVIRONMENTS])),
        ("chosen.some", w(&(0..ENVIRONMENTS).map(|e| u32::from(chosen(e))).collect::<Vec<_>>())),
        ("steps.ages", w(&ages)),
    ] {
        files.insert(name.to_owned(), bytes);
    }
    let rows = ["observation", "critic_observation", "command"];
    let keep_all = |statements: &mut String, names: &[&str], suffix: &str| {
        names.iter().for_each(|name| statements.push_str(&keep(arrays, name, suffix)));
    };
    // The physics of a step is the CPU's.
    let after = ["reward", "ends", "last_observation", "totals", "refused", "action"];
    let step_once = |statements: &mut String, files: &mut HashMap<String, Vec<u8>>, t: usize, step: &Step| {
        let packed = Packed::new(&scene, &step.moved, tiles);
        files.insert(format!("mean.given{t}"), f(&step.action));
        for (name, numbers) in [
            ("robot_state", &packed.state),
            ("robot_report", &packed.report),
            ("robot_memory", &packed.memory),
            ("robot_targets", &packed.targets),
        ] {
            files.insert(format!("{name}.moved{t}"), f(numbers));
        }
        statements.push_str(&take(arrays, "mean", &format!("given{t}")));
        statements.push_str(&call(&plan.take()));
        statements.extend(plan.before(tiles).iter().map(call));
        keep_all(statements, &["robot_targets"], &format!("sent{t}"));
        for name in ["robot_state", "robot_report", "robot_memory", "robot_targets"] {
            statements.push_str(&take(arrays, name, &format!("moved{t}")));
        }
        statements.extend(plan.after().iter().map(call));
        keep_all(statements, &[&rows[..], &after].concat(), &format!("after{t}"));
    };
    let mut statements = fill(&plan.program, &mut files);
    statements.extend(plan.restart().iter().map(call));
    statements.push_str(&take(arrays, "steps", "ages"));
    statements.push_str(&call(&plan.observe(0)));
    keep_all(&mut statements, &rows, "before");
    for (t, step) in steps.iter().enumerate() {
        if t == RESTART {
            statements.extend(plan.restart().iter().map(call));
            keep_all(&mut statements, &rows, "restarted");
        }
        if t == REFUSED.0 {
            let mut wrong = step.action.clone();
            (wrong[REFUSED.1], wrong[REFUSED.1 + 30]) = (f32::NAN, f32::INFINITY);
            files.insert("mean.wrong".to_owned(), f(&wrong));
            statements.push_str(&take(arrays, "mean", "wrong"));
            statements.push_str(&call(&plan.take()));
            statements.push_str(&keep(arrays, "refused", "wrong"));
            statements.push_str(&take(arrays, "refused", "none"));
        }
        if t == HELD {
            statements.push_str(&take(arrays, "held", "now"));
        }
        step_once(&mut statements, &mut files, t, step);
        if t == READ {
            let there: Vec<&str> = STATE.into_iter().filter(|name| plan.array(name).is_some()).collect();
            keep_all(&mut statements, &there, "read");
        }
    }
    statements.push_str(&call(&plan.motion()));
    statements.push_str(&keep(arrays, "motion", "out"));
    statements.push_str(&take(arrays, "chosen", "some"));
    statements.extend(plan.restart().iter().map(call));
    keep_all(&mut statements, &[&rows[..], &["steps", "reward", "ends"]].concat(), "renewed");
    statements.push_str(&call(&plan.clear()));
    keep_all(&mut statements, &["reward", "ends"], "cleared");
    let folder = execute(&plan.program.text, arrays, &files, &[], &statements);
    let read =
        |name: &str, suffix: &str| std::fs::read(folder.path().join(format!("{name}.{suffix}"))).unwrap();
    let out = |name: &str, suffix: &str| floats(&read(name, suffix));
    let same = |what: &str, when: &str, got: &[f32], want: &[f32]| {
        let error = apart(got, want);
        assert!(error <= 1e-6, "{label}, {when}: {what} differs by {error:e}");
    };
    let check = |want: &Shown, suffix: &str| {
        same("observation", suffix, &out("observation", suffix), &want.observation);
        same("critic's observation", suffix, &out("critic_observation", suffix), &want.critic);
        let commands = (0..3).flat_map(|k| want.commands.iter().map(move |command| command[k]));
        assert_eq!(out("command", suffix), commands.collect::<Vec<_>>(), "{label}, {suffix}");
    };
    check(&before, "before");
    check(&restarted.unwrap(), "restarted");
    assert_eq!(read("refused", "wrong"), w(&[REFUSED.1 as u32]));
    let seen = task.walker.interface.observation_width();
    same("motion", "out", &out("motion", "out"), &moved);
    // Robots that were not chosen still observe what they did.
    let last = format!("after{}", STEPS - 1);
    let ages = read("steps", "renewed");
    for e in 0..ENVIRONMENTS {
        for (name, wanted) in [("observation", &renewed.observation), ("critic_observation", &renewed.critic)]
        {
            let width = wanted.len() / ENVIRONMENTS;
            let row = |all: &[f32]| all[e * width..(e + 1) * width].to_vec();
            let (got, before) = (row(&out(name, "renewed")), row(&out(name, &last)));
            match chosen(e) {
                true => same(name, "renewed", &got, &row(wanted)),
                false => assert_eq!(got, before, "{label}: {name} of {e}"),
            }
        }
        let command = |suffix: &str| [0, 1, 2].map(|k| out("command", suffix)[k * ENVIRONMENTS + e]);
        assert_eq!(command("renewed"), renewed.commands[e], "{label}: command of {e}");
        assert_eq!(ages[4 * e..4 * e + 4] == [0; 4], chosen(e), "{label}: age of {e}");
    }
    // Their last step pays and ends nothing any more; that of others does what it did.
    let (paid, cleared) = (out("reward", "renewed"), out("reward", "cleared"));
    let (ends, without) = (read("ends", "renewed"), read("ends", "cleared"));
    assert_eq!(
        (&paid, &ends),
        (&out("reward", &last), &read("ends", &last)),
        "{label}: beginning anew keeps the step"
    );
    for e in 0..ENVIRONMENTS {
        assert_eq!(cleared[e], if chosen(e) { 0.0 } else { paid[e] }, "{label}: reward of {e}");
        for list in 0..3 {
            let place = list * scene.ends_apart() + e;
            assert_eq!(without[place], if chosen(e) { 0 } else { ends[place] }, "{label}: end {list} of {e}");
        }
    }
    let mut counts = [0; 3];
    let mut held = 0;
    for (t, step) in steps.iter().enumerate() {
        let suffix = &format!("after{t}");
        check(&step.after, suffix);
        assert_eq!(read("refused", suffix), w(&[u32::MAX]));
        assert_eq!(out("action", suffix), step.action);
        let error = apart(&out("reward", suffix), &step.reward);
        assert!(error <= 3e-6, "{label}, step {t}: rewards differ by {error:e}");
        let of = |kinds: &[Ended]| step.ended.iter().map(|ended| u8::from(kinds.contains(ended))).collect();
        let (fallen, late): (Vec<u8>, Vec<u8>) = (of(&[Ended::Fall, Ended::Diverged]), of(&[Ended::TimeOut]));
        let any = of(&[Ended::Fall, Ended::Diverged, Ended::TimeOut]);
        let ends = read("ends", suffix);
        let lists = ends.chunks_exact(scene.ends_apart()).map(|list| &list[..ENVIRONMENTS]);
        assert!(lists.eq([&fallen, &late, &any]), "{label}, step {t}: {ends:?}");
        let last = out("last_observation", suffix);
        if t >= HELD {
            held += step.ended.iter().filter(|ended| **ended != Ended::No).count();
        }
        let begun = step.ended.iter().enumerate().filter(|(_, ended)| t < HELD && **ended != Ended::No);
        for (e, ended) in begun {
            let row = e * seen..(e + 1) * seen;
            same("last observation", suffix, &last[row.clone()], &step.last[row]);
            counts[match ended {
                Ended::TimeOut => 0,
                Ended::Diverged => 1,
                _ => 2,
            }] += 1;
        }
        let totals = doubles(&read("totals", suffix));
        let terms = task.reward_names().len();
        let diverged = step.ended.iter().filter(|ended| **ended == Ended::Diverged).count();
        let ends = any.iter().map(|&one| f64::from(one)).sum::<f64>();
        assert_eq!((totals[terms + 3], totals[terms + 7]), (ends, diverged as f64), "{label}, step {t}");
        for (k, (got, want)) in totals[1..=terms].iter().zip(&step.terms).enumerate() {
            let error = (got - want).abs();
            assert!(
                error <= 2e-5 * want.abs().max(1.0),
                "{label}, step {t}: reward term {k} is {got}, not {want}"
            );
        }
        // The newest targets are those of the actions.
        if candidate.networks.is_empty() {
            let mut wanted = vec![0.0; ENVIRONMENTS * task.walker.default_pose.len()];
            task.walker.targets(&step.action, &mut wanted);
            let sent = Packed { targets: out("robot_targets", &format!("sent{t}")), ..start.clone() };
            let joints = task.walker.default_pose.len();
            for (e, robot) in sent.snapshots(&scene).iter().enumerate() {
                same(
                    "targets",
                    suffix,
                    &robot.robot.targets[..joints],
                    &wanted[e * joints..(e + 1) * joints],
                );
            }
        }
    }
    println!("{label}: {counts:?} episodes ended by time, by divergence, by falls");
    assert!(counts[0] > 10 && counts[1] == 1 && counts[2] > 0, "{label}: {counts:?}");
    assert!(held > 10, "{label}: {held} robots were held");
    if !again {
        return;
    }

    // The CPU's environments take up the state, as `Stepper::state` gives it, and observe what the kernels did.
    let mut read_state = state(&|name| read(name, "read"), plan.array("turned").is_some()).snapshots(&scene);
    read_state.iter_mut().for_each(|one| before_rows(task, one));
    let mut mirror = Environment::new(task, Some(candidate), SEED, 0, ENVIRONMENTS).unwrap();
    for (index, one) in read_state.iter().enumerate() {
        mirror.set_snapshot(index, one).unwrap();
    }
    mirror.refresh();
    let number = READ as u32 + 1;
    let of_mirror = shown(&mut mirror, task, number);
    check(&of_mirror, &format!("after{READ}"));
    // The kernels go on from the CPU's state. Their steps have the bits of the undisturbed ones.
    let returned = snapshots(&mut mirror, &[[0.0; 2]; ENVIRONMENTS]);
    let packed = Packed::new(&scene, &returned, tiles);
    let mut files = inputs(&packed, &params(&period, &robots), candidate);
    for (name, bytes) in [
        ("parameters", f(&vec![-1e4; width])),
        ("control", w(&control(number, SEED, ranges, 0))),
        ("refused", w(&[u32::MAX])),
        ("held", w(&[0])),
    ] {
        files.insert(name.to_owned(), bytes);
    }
    let mut statements = fill(&plan.program, &mut files);
    statements.push_str(&call(&plan.observe(0)));
    keep_all(&mut statements, &rows, "again");
    for (t, step) in steps.iter().enumerate().skip(READ + 1).take(AGAIN) {
        step_once(&mut statements, &mut files, t, step);
    }
    let second = execute(&plan.program.text, arrays, &files, &[], &statements);
    let reread =
        |name: &str, suffix: &str| std::fs::read(second.path().join(format!("{name}.{suffix}"))).unwrap();
    for name in rows {
        assert!(reread(name, "again") == read(name, &format!("after{READ}")), "{label}: {name}");
        for t in READ + 1..=READ + AGAIN {
            let suffix = &format!("after{t}");
            assert!(reread(name, suffix) == read(name, suffix), "{label}, step {t}: {name}");
            assert!(reread("reward", suffix) == read("reward", suffix), "{label}, step {t}: rewards");
        }
    }
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_steps_under_given_actions_are_the_cpus() {
    let task = Task::new(&go2(), &lively("velocity"), Preset::Fast).unwrap();
    compare("trot", &task, &Candidate::nominal(&go2()), true);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_steps_under_given_actions_on_hind_legs_are_the_cpus() {
    let mut settings = lively("biped");
    settings.fall.tilt = 12.0;
    let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
    compare("biped", &task, &Candidate::nominal(&go2()), false);
}

/// On levels of small cells, with past frames.
#[test]
#[ignore = "needs g++"]
fn long_cxx_steps_under_given_actions_on_uneven_ground_are_the_cpus() {
    let mut settings = super::on_levels(true);
    settings.policy.observation.iter_mut().for_each(|term| term.history = 3);
    settings.policy.critic_observation[1].history = 2;
    let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
    compare("levels", &task, &Candidate::nominal(&go2()), true);
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_under_given_actions_of_a_fitted_robot_are_the_cpus() {
    let (task, candidate) = super::fitted();
    compare("fitted", &task, &candidate, true);
}
