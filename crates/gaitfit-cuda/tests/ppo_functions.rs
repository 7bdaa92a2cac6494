//! Updates of policies with functions of their own, run on the CPU as C++, against the CPU's learner.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::host::{self, floats};
use crate::ppo_host::{
    BATCH, LIMITS, WIDTHS, arrays, compare, compare_on, distance, once, samples_for, settings,
};
use crate::reference;

use gaitfit_cuda::ppo::{Batch, Precision, Prepared};
use gaitfit_learn::ppo::{Learner, Settings, bench::synthetic};
use gaitfit_policy::network::Activation;

/// A policy from elsewhere: its actor has functions of its own, and its new critic has the settings' activation.
pub fn foreign(settings: Settings, hidden: Activation, output: Option<Activation>) -> Learner {
    let settings = Settings { normalise_observations: false, ..settings };
    let learner = Learner::new(settings.clone(), WIDTHS, 5).unwrap();
    let mut actor = learner.actor().clone();
    (actor.shape.activation, actor.output) = (hidden, output);
    let (networks, log_std) = ([actor, learner.critic().clone()], vec![-0.5; WIDTHS.action]);
    let memories = [learner.actor_memory().cloned(), learner.critic_memory().cloned()];
    Learner::with_memories(settings, WIDTHS, 5, networks, memories, log_std).unwrap()
}

/// An update of a learner from elsewhere is the CPU's.
pub fn compare_foreign(learner: Learner, precision: Precision, limit: f64) {
    let problem = samples_for(learner, [BATCH.tile, BATCH.environments - BATCH.tile]);
    compare_on(problem, 3, [0, 0], precision, limit);
}

#[test]
#[ignore = "needs g++"]
fn cxx_update_of_a_critic_with_another_activation_is_the_cpus() {
    compare_foreign(foreign(settings(), Activation::Tanh, None), Precision::F32, 2e-5);
}

/// Derivatives that do not follow from layers' outputs: of both networks, of the actor alone and of the critic alone.
#[test]
#[ignore = "needs g++"]
fn cxx_update_with_silu_is_the_cpus() {
    let silu = || Settings { activation: Activation::Silu, ..settings() };
    compare(silu(), 3, [0, 0], Precision::F32, 2e-5);
    compare_foreign(foreign(settings(), Activation::Silu, Some(Activation::Tanh)), Precision::F32, 2e-5);
    compare_foreign(foreign(silu(), Activation::Elu, None), Precision::F32, 2e-5);
}

#[test]
#[ignore = "needs g++"]
fn cxx_update_with_gelu_is_the_cpus() {
    for activation in [Activation::Gelu, Activation::GeluTanh] {
        compare(Settings { activation, ..settings() }, 3, [0, 0], Precision::F32, 2e-5);
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_update_with_a_function_of_the_output_is_the_cpus() {
    for output in [Activation::Tanh, Activation::Silu] {
        compare_foreign(foreign(settings(), Activation::Elu, Some(output)), Precision::F32, 2e-5);
    }
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_update_with_other_functions_of_the_output_is_the_cpus() {
    for output in [Activation::Gelu, Activation::GeluTanh, Activation::Selu, Activation::LeakyRelu(0.2)] {
        compare_foreign(foreign(settings(), Activation::Relu, Some(output)), Precision::F32, 2e-5);
    }
    // Actor and critic.
    let learner = foreign(settings(), Activation::Gelu, Some(Activation::Tanh));
    let mut critic = learner.critic().clone();
    critic.output = Some(Activation::EluOf(3.0));
    let networks = [learner.actor().clone(), critic];
    let log_std = vec![-0.5; WIDTHS.action];
    let both = Learner::with_memories(learner.settings().clone(), WIDTHS, 5, networks, [None, None], log_std);
    compare_foreign(both.unwrap(), Precision::F32, 2e-5);
}

/// Policies of Brax and MuJoCo Playground in less exact products, which keep derivatives as they keep layers' outputs.
#[test]
#[ignore = "needs g++"]
fn cxx_silu_and_a_bounded_output_are_near_in_other_precisions() {
    let learner = || {
        let settings = Settings { activation: Activation::Silu, ..settings() };
        foreign(settings, Activation::Silu, Some(Activation::Tanh))
    };
    compare_foreign(learner(), Precision::Tf32, 2e-2);
    compare_foreign(learner(), Precision::Bf16, 4e-2);
}

/// The gradient of a first step, without the CPU's learner: by plain formulas in `f64`.
#[test]
#[ignore = "needs g++"]
fn cxx_gradient_is_that_of_f64() {
    for activation in [Activation::Silu, Activation::Gelu] {
        let learner = foreign(Settings { activation, ..once() }, activation, Some(Activation::Tanh));
        let batch = Batch { tile: BATCH.environments, ..BATCH };
        let mut tiles = synthetic(&learner, 1, batch.environments, batch.steps, 3);
        let prepared = Prepared::new(&learner, batch, Precision::F32, LIMITS).unwrap();
        let arrays = arrays(&learner, &tiles, &prepared, [3, 0, 0, 5, 0]);
        let out = host::run(&prepared.program.text, &prepared.plan, &arrays, &["packed"]);
        (tiles[0].advantage, tiles[0].returns) = (floats(&out["advantage"]), floats(&out["returns"]));
        let wanted: Vec<f32> =
            reference::gradient(&learner, &tiles[0]).into_iter().map(|g| g as f32).collect();
        let far = distance(&floats(&out["gradient"]), &wanted);
        println!("{activation}: {far:.1e}");
        assert!(far < 3e-6, "{activation}: {far}");
    }
}
