//! Networks of policies in the kernels of a fit, run on the CPU as C++, against `gaitfit_policy::follow`.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_cuda::fit::{Plan, Scene, Sizes, Subject, Tables};
use gaitfit_cuda::networks::ActorPlan;
use gaitfit_cuda::ppo::Limits;
use gaitfit_cuda::runtime::{Nvrtc, compile};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_physics::Preset;
use gaitfit_policy::follow::{Job, Track, follow};
use gaitfit_policy::network::{
    Activation, Cell, LayerNorm, Network, Normaliser, Recurrent, RecurrentShape, Scratch, Shape,
};
use gaitfit_policy::{Encoder, Front, Latent, Policy, Quantity, Term};
use gaitfit_sim::Sensors;

use crate::candidates::apart;
use crate::fit_host::{compare, compare_from, friction, go2, scripts, walking};
use crate::host::{bytes, call, execute, floats, keep};
use crate::motions::{following, observing};

/// The policy with recurrent layers and a new actor behind them.
fn remembering(policy: &Policy, cell: Cell, hidden: Vec<usize>) -> Policy {
    let shape = RecurrentShape { cell, inputs: policy.actor.shape.inputs, hidden };
    let front = Some(Front::Recurrent(Recurrent::random(&shape, 5, 0)));
    let actor = Shape { inputs: shape.outputs(), ..policy.actor.shape.clone() };
    Policy { front, actor: Network::random(actor, 5, 1, 1.0).unwrap(), ..policy.clone() }
}

/// The policy with an encoder, whose actor sees a third of the observation beside the latent.
fn two_part(policy: &Policy, latent: Latent, activation: Activation) -> Policy {
    let inputs = policy.actor.shape.inputs;
    let passed: Vec<usize> = (0..inputs).rev().step_by(3).collect();
    let shape = Shape { inputs, hidden: vec![30, 18], outputs: 7, activation };
    let network = Network::random(shape, 7, 0, 1.0).unwrap();
    let actor = Shape { inputs: passed.len() + 7, ..policy.actor.shape.clone() };
    let front = Some(Front::Encoder(Encoder { network, passed, latent }));
    Policy { front, actor: Network::random(actor, 7, 1, 1.0).unwrap(), ..policy.clone() }
}

/// Policies with a memory: what they remember stays with each robot, and a log's earlier samples count.
#[test]
#[ignore = "needs g++"]
fn cxx_walks_of_policies_with_a_memory_are_the_cpus() {
    for (cell, hidden) in [(Cell::Lstm, vec![22]), (Cell::Gru, vec![9, 31])] {
        let (task, policy) = walking(None, |_| ());
        let policy = remembering(&policy, cell, hidden);
        let job = |amount, seed| Job { candidate: friction(amount), reset_every: None, seed };
        let walking = (task, policy);
        match cell {
            Cell::Lstm => compare(cell.name(), &walking, &[job(0.1, 3), job(0.3, 1)], &[24, 19, 24], [8, 4]),
            Cell::Gru => compare_from(cell.name(), &walking, &[job(0.1, 3)], &[14, 9], [4, 4], Some(&[0, 7])),
        };
        // Nobody knows what the policy remembered where the log would put the robot.
        let scripts = scripts(&walking.0, &walking.1, &[9]);
        let jobs = [Job { reset_every: Some(3), ..job(0.1, 1) }];
        let consume = |_: usize, _: usize, _: &Track| ();
        let error =
            follow(&walking.0.walker, &walking.1, &scripts, &jobs, 1, &consume, &|| false).unwrap_err();
        assert!(error.to_string().contains("the policy is recurrent"), "{error}");
    }
}

/// Two-part policies with the latent behind or before what the actor sees of the observation. Each has three functions of layers, and
/// one has a layer norm.
#[test]
#[ignore = "needs g++"]
fn cxx_walks_of_two_part_policies_with_any_activation_are_the_cpus() {
    for (latent, [of_encoder, of_actor, of_output]) in [
        (Latent::Last, [Activation::Silu, Activation::Relu, Activation::Tanh]),
        (Latent::First, [Activation::LeakyRelu(0.2), Activation::Selu, Activation::EluOf(0.7)]),
        (Latent::Last, [Activation::Gelu, Activation::GeluTanh, Activation::Silu]),
    ] {
        let (task, policy) = walking(None, |_| ());
        let mut policy = two_part(&policy, latent, of_encoder);
        policy.actor.shape.activation = of_actor;
        policy.actor.output = Some(of_output);
        if latent == Latent::First {
            let numbers =
                |scale: f32, count: usize| (0..count).map(|k| 0.8 + scale * (k as f32).sin()).collect();
            let width = policy.actor.shape.hidden[0];
            let (weight, bias) = (numbers(0.3, width), numbers(-0.5, width));
            policy.actor.norms = vec![Some(LayerNorm { weight, bias, epsilon: LayerNorm::EPSILON })];
        }
        let jobs =
            [0.1, 0.3].map(|amount| Job { candidate: friction(amount), reset_every: Some(5), seed: 2 });
        compare(&format!("{of_encoder}"), &(task, policy), &jobs, &[14, 9], [8, 4]);
    }
}

/// Evaluations run a policy for all robots of a step at once: a plain one, a two-part policy with a normaliser, and one with a memory.
#[test]
#[ignore = "needs g++"]
fn cxx_actions_of_an_evaluation_are_the_cpus() {
    const ROBOTS: usize = 37;
    const STEPS: usize = 3;
    let (_, plain) = walking(None, |_| ());
    let width = plain.actor.shape.inputs;
    let mut normaliser = Normaliser::new(width);
    normaliser.mean.iter_mut().enumerate().for_each(|(k, mean)| *mean = 0.02 * k as f64 - 0.3);
    normaliser.variance.iter_mut().enumerate().for_each(|(k, variance)| *variance = 0.5 + 0.1 * k as f64);
    let normaliser = Some(normaliser);
    let two_part = Policy { normaliser, ..two_part(&plain, Latent::First, Activation::Silu) };
    let memory = remembering(&plain, Cell::Lstm, vec![17, 10]);
    for (label, policy) in [("plain", &plain), ("two-part", &two_part), ("memory", &memory)] {
        let limits = Limits { processors: 2, shared_memory: 200_000 };
        let plan = ActorPlan::new(policy, ROBOTS, STEPS, limits).unwrap();
        let noise = gaitfit_random::Stream::new(5, gaitfit_random::Purpose::BOOTSTRAP);
        let seen: Vec<f32> = (0..STEPS * ROBOTS * width).map(|k| noise.normal(k as u32) as f32).collect();
        let zeros = vec![0.0; plan.arrays[2].length];
        let files = [("network", &plan.numbers), ("observation", &seen), ("recurrent", &zeros)]
            .map(|(name, numbers)| (name.to_owned(), bytes(numbers, f32::to_ne_bytes)));
        let mut statements: String = (0..STEPS).map(|step| call(&plan.decide(step))).collect();
        statements.push_str(&keep(&plan.arrays, "mean", "out"));
        let folder = execute(&plan.program.text, &plan.arrays, &files.into(), &[], &statements);
        let got = floats(&std::fs::read(folder.path().join("mean.out")).unwrap());
        let (mut memory, mut scratch) = (policy.memory(ROBOTS), Scratch::default());
        let mut wanted = Vec::new();
        for seen in seen.chunks_exact(ROBOTS * width) {
            let mut actions = vec![0.0; ROBOTS * 12];
            policy.act_with(ROBOTS, seen, &mut memory, &mut actions, &mut scratch);
            wanted.extend(actions);
        }
        let error = apart(&got, &wanted);
        println!("{label}: {error:e}");
        assert!(error < 5e-6, "{label}: {error:e}");
    }
    let narrow = Limits { processors: 2, shared_memory: 2_000 };
    let error = ActorPlan::new(&plain, ROBOTS, STEPS, narrow).unwrap_err().to_string();
    assert!(error.contains("bytes of a multiprocessor's memory"), "{error}");
}

/// The task of a policy, calm.
fn task_of(policy: &Policy) -> Task {
    let settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
    Task::with_interface(&go2(), &settings.calm(), policy.interface.clone(), Preset::Fast, 0.03).unwrap()
}

/// The action before the last stays with each robot, and a log's earlier samples count.
#[test]
#[ignore = "needs g++"]
fn cxx_walks_with_the_action_before_the_last_are_the_cpus() {
    let (_, plain) = walking(None, |_| ());
    let policy = observing(&plain, vec![Term::new(Quantity::EarlierAction).scaled(&[0.5])]);
    let walking = (task_of(&policy), policy);
    let job = |amount, seed| Job { candidate: friction(amount), reset_every: None, seed };
    compare("earlier action", &walking, &[job(0.1, 3), job(0.3, 1)], &[24, 19], [8, 4]);
    compare_from("earlier action in logs", &walking, &[job(0.1, 3)], &[14, 9], [4, 4], Some(&[0, 7]));
}

/// Walks have no critic, so what it observed is not kept.
#[test]
#[ignore = "needs g++"]
fn cxx_walks_without_the_critics_past_are_the_cpus() {
    let walking = walking(None, |policy| {
        assert!(!policy.interface.critic_observation.is_empty());
        policy.interface.critic_observation.iter_mut().for_each(|term| term.history = 3);
    });
    let job = Job { candidate: friction(0.1), reset_every: None, seed: 3 };
    compare("the critic's past", &walking, &[job], &[9, 7], [4, 4]);
}

/// Policies that follow a motion: each recording has its places in it, also before it begins, and robots that are reset
/// have the motion where the log has it.
#[test]
#[ignore = "needs g++"]
fn cxx_walks_along_a_motion_are_the_cpus() {
    let (_, plain) = walking(None, |_| ());
    for (rate_hz, samples) in [(50.0, 12), (37.0, 9)] {
        let policy = following(&plain, rate_hz, samples);
        let walking = (task_of(&policy), policy);
        let job = |amount: f64, reset_every, seed| {
            let mut candidate = friction(amount);
            candidate.robot.encoder_bias = vec![0.02; 12];
            (candidate.robot.velocity_lag, candidate.robot.imu_delay) = (0.004, 0.007);
            candidate.sensors = Sensors { imu_tilt: [0.3 * amount, -0.05], gyro_bias: [0.1, amount, -0.07] };
            Job { candidate, reset_every, seed }
        };
        let jobs = [job(0.1, None, 3), job(0.3, Some(5), 1)];
        compare("motion", &walking, &jobs, &[24, 19, 17], [8, 4]);
        compare_from("motion in logs", &walking, &jobs[..1], &[14, 9], [4, 4], Some(&[0, 7]));
    }
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_fits_of_other_policies() {
    let (_, plain) = walking(None, |_| ());
    let policy = observing(&following(&plain, 50.0, 100), vec![Term::new(Quantity::EarlierAction)]);
    let task = task_of(&policy);
    let subject = Subject::Walk(&task.walker, &policy);
    let period = subject.period(&friction(0.1)).unwrap();
    let scripts = scripts(&task, &policy, &[10]);
    let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
    for tables in [tables.clone(), tables.for_logs(3)] {
        let sizes = Sizes { candidates: 24, recordings: 1, samples: 10, tiles: 3, rows: 8, group: 4 };
        let plan = Plan::new(&Scene::new(subject, &period), &tables, sizes);
        let program = plan.program.option("--ptxas-options=-v");
        let compiled = compile(Nvrtc::get().unwrap(), &program, (9, 0), None).unwrap();
        println!("{}", compiled.image.log);
    }
}

#[test]
fn policies_that_the_kernels_do_not_know_are_refused() {
    let (task, policy) = walking(None, |_| ());
    let act = std::sync::Arc::new(|_: usize, _: &[f32], _: &mut [f32]| true);
    let policy = Policy::of_function(policy.interface, act).unwrap();
    let error = Tables::walk(&task.walker, &policy, &[]).unwrap_err().to_string();
    assert!(error.contains("a policy that is a function"), "{error}");
}
