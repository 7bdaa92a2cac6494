//! Memories on the GPU, run on the CPU as C++, against the CPU's learner.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::host;
use crate::ppo_functions::{compare_foreign, foreign};
use crate::ppo_host::{
    BATCH, LIMITS, WIDTHS, arrays, compare, compare_on, distance, problem, remembered, samples_for, settings,
};

use gaitfit_cuda::ppo::{Array, Id, Kind, Limits, Precision, Prepared, Value};
use gaitfit_learn::ppo::{Learner, MemorySettings, Samples, Settings};
use gaitfit_policy::network::{Activation, Cell, Memory};
use host::{bytes, floats};

#[test]
#[ignore = "needs g++"]
fn cxx_update_with_a_memory_is_the_cpus() {
    with_memory(Cell::Lstm, 2);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_update_with_other_memories_is_the_cpus() {
    with_memory(Cell::Gru, 1);
    with_memory(Cell::Gru, 2);
}

fn with_memory(cell: Cell, layers: usize) {
    let memory = Some(MemorySettings { cell, width: 10, layers });
    compare(Settings { memory, ..settings() }, 3, [0, 0], Precision::F32, 2e-5);
}

/// Behind a memory the derivatives by the first layer's input follow those that hidden layers keep.
#[test]
#[ignore = "needs g++"]
fn cxx_update_with_a_memory_silu_and_a_bounded_output_is_the_cpus() {
    let memory = Some(MemorySettings { cell: Cell::Gru, width: 10, layers: 1 });
    let settings = Settings { memory, activation: Activation::Silu, ..settings() };
    compare_foreign(foreign(settings, Activation::Silu, Some(Activation::Tanh)), Precision::F32, 2e-5);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_warm_up_moves_the_critic_and_its_memory_alone() {
    let memory = Some(MemorySettings { cell: Cell::Lstm, width: 9, layers: 1 });
    let warm = Settings { memory, critic_warmup: Some(4), minibatches: 3, ..settings() };
    compare(warm.clone(), 3, [1, 0], Precision::F32, 2e-5);
    compare(warm, 4, [0, 1], Precision::F32, 2e-5);
}

/// A learner with a memory before the actor alone, or before the critic alone.
fn one_sided(cell: Cell, before_actor: bool) -> Learner {
    let memory = Some(MemorySettings { cell, width: 10, layers: 2 });
    let with = Learner::new(Settings { memory, ..settings() }, WIDTHS, 5).unwrap();
    let without = Learner::new(settings(), WIDTHS, 5).unwrap();
    let (actor, critic) = if before_actor { (&with, &without) } else { (&without, &with) };
    let networks = [actor.actor().clone(), critic.critic().clone()];
    let memories = [actor.actor_memory().cloned(), critic.critic_memory().cloned()];
    Learner::with_memories(settings(), WIDTHS, 5, networks, memories, vec![-0.5; WIDTHS.action]).unwrap()
}

const TILES: [usize; 2] = [BATCH.tile, BATCH.environments - BATCH.tile];

#[test]
#[ignore = "needs g++"]
fn cxx_update_with_a_memory_before_the_actor_alone_is_the_cpus() {
    compare_on(samples_for(one_sided(Cell::Lstm, true), TILES), 3, [0, 0], Precision::F32, 2e-5);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_update_with_a_memory_before_the_critic_alone_is_the_cpus() {
    compare_on(samples_for(one_sided(Cell::Gru, false), TILES), 3, [0, 0], Precision::F32, 2e-5);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_memories_before_one_network_along_a_rollout_are_the_cpus() {
    for before_actor in [true, false] {
        along_a_rollout(samples_for(one_sided(Cell::Lstm, before_actor), TILES));
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_memories_along_a_rollout_are_the_cpus() {
    let memory = Some(MemorySettings { cell: Cell::Lstm, width: 10, layers: 2 });
    along_a_rollout(problem(&Settings { memory, ..settings() }));
}

/// A rollout of a few steps as the learner does it: memories go on from step to step, and forget where episodes end.
fn along_a_rollout((learner, tiles): (Learner, Vec<Samples>)) {
    const CUTS: usize = 1;
    const STEPS: usize = 4;
    let mut prepared = Prepared::new(&learner, BATCH, Precision::F32, LIMITS).unwrap();
    let environments = BATCH.environments;
    // The caller's arrays: where episodes were cut off, what the critic then remembered, states and their values.
    let width = learner.critic_memory().map_or(0, |memory| memory.shape().remembered());
    let rows = (1 + CUTS) * environments;
    let sizes = [
        ("cut", Kind::U32, CUTS * environments),
        ("tail_memory", Kind::F32, CUTS * environments * width),
        ("tail", Kind::F32, rows * WIDTHS.critic_observation),
        ("tail_value", Kind::F32, rows),
    ];
    let first = prepared.plan.arrays.len();
    prepared.plan.arrays.extend(sizes.map(|(name, kind, length)| Array { name, kind, length }));
    let own = |number: usize| Value::Array(Id(first + number));
    let mut launches = Vec::new();
    for step in 0..STEPS {
        launches.extend(prepared.plan.remember(step));
        launches.push(prepared.plan.foresee(step * environments, environments).unwrap());
        let (mut forget, [cut, to]) = prepared.plan.forget(step, CUTS).unwrap();
        (forget.arguments[cut], forget.arguments[to]) = (own(0), own(1));
        launches.push(forget);
    }
    for part in 0..=CUTS {
        let (tail, seen, before) = prepared.plan.remember_tail(part).unwrap();
        for (number, mut launch) in tail.into_iter().enumerate() {
            if number == 0 {
                launch.arguments[seen] = own(2);
            }
            if let (Some(before), 1..) = (before, part) {
                launch.arguments[before] = own(1);
            }
            launches.push(launch);
        }
        let (mut values, [_, out]) = prepared.plan.foresee_values(part * environments, environments).unwrap();
        values.arguments[out] = own(3);
        launches.push(values);
    }
    prepared.plan.launches = launches;
    let mut arrays = arrays(&learner, &tiles, &prepared, [0; 5]);
    // Episodes end after the second step, by time where the number is odd.
    let mut done = vec![0.0f32; BATCH.rows()];
    let mut cut = vec![0u32; environments];
    for e in (0..environments).step_by(3) {
        done[environments + e] = 1.0;
        cut[e] = if e % 2 == 1 { 2 } else { 0 };
    }
    let tail: Vec<f32> = (0..rows * WIDTHS.critic_observation).map(|k| (k as f32 * 0.7).cos()).collect();
    let start = |tiles: &[Samples], of: fn(&Samples) -> &Memory| floats(&remembered(tiles, of));
    let starts = [start(&tiles, |tile| &tile.actor_memory), start(&tiles, |tile| &tile.critic_memory)];
    arrays.insert("done", bytes(&done, f32::to_ne_bytes));
    arrays.insert("cut", bytes(&cut, u32::to_ne_bytes));
    arrays.insert("tail", bytes(&tail, f32::to_ne_bytes));
    arrays.insert("actor_memory", bytes(&starts[0], f32::to_ne_bytes));
    arrays.insert("critic_memory", bytes(&starts[1], f32::to_ne_bytes));
    let [old_actor, old_critic] = ["actor_start", "critic_start"].map(|name| arrays.remove(name).unwrap());
    let out = host::run(&prepared.program.text, &prepared.plan, &arrays, &["packed", "tail_memory"]);
    // What was remembered before the rollout is kept for the update.
    assert!(out["actor_start"] == old_actor && out["critic_start"] == old_critic);

    let [mut actor, mut critic] = learner.blank_memories(environments);
    for (memory, rows) in [(&mut actor, &starts[0]), (&mut critic, &starts[1])] {
        if rows.is_empty() {
            continue;
        }
        for (e, row) in rows.chunks_exact(rows.len() / environments).enumerate() {
            assert!(memory.set_row(e, row));
        }
    }
    let mut scratch = gaitfit_policy::network::Scratch::new();
    let (seen, critic_seen) = (floats(&arrays["observation"]), floats(&arrays["critic_observation"]));
    let (means, values) = (floats(&out["mean"]), floats(&out["value"]));
    let mut at_cut = critic.clone();
    for step in 0..STEPS {
        let range = |width: usize| step * environments * width..(step + 1) * environments * width;
        let mut mean = vec![0.0; environments * WIDTHS.action];
        let mut value = vec![0.0; environments];
        learner.means_with(
            environments,
            &seen[range(WIDTHS.observation)],
            &mut actor,
            &mut mean,
            &mut scratch,
        );
        let rows = &critic_seen[range(WIDTHS.critic_observation)];
        learner.values_with(environments, rows, &mut critic, &mut value, &mut scratch);
        assert!(distance(&means[range(WIDTHS.action)], &mean) < 1e-5, "means of step {step}");
        assert!(distance(&values[range(1)], &value) < 1e-5, "values of step {step}");
        if step == 1 {
            at_cut.clone_from(&critic);
            for e in (0..environments).step_by(3) {
                actor.begin(e);
                critic.begin(e);
            }
        }
    }
    let memory_of = |name: &str| floats(&out[name]);
    let flat = |memory: &Memory| -> Vec<f32> {
        let mut rows = Vec::new();
        (0..environments).for_each(|e| memory.append_row(e, &mut rows));
        rows
    };
    for (name, wanted) in [("actor_memory", flat(&actor)), ("critic_memory", flat(&critic))] {
        let found = memory_of(name);
        assert!(found == wanted || distance(&found, &wanted) < 1e-5, "{name}");
    }
    let (tail_values, width) = (floats(&out["tail_value"]), environments * WIDTHS.critic_observation);
    for (part, memory) in [&mut critic, &mut at_cut].into_iter().enumerate() {
        let mut value = vec![0.0; environments];
        learner.values_with(
            environments,
            &tail[part * width..(part + 1) * width],
            memory,
            &mut value,
            &mut scratch,
        );
        for e in 0..environments {
            // Only what was cut off counts in the second part.
            let estimate = tail_values[part * environments + e];
            if part == 0 || cut[e] != 0 {
                assert!((estimate - value[e]).abs() < 1e-5, "part {part}, {e}: {estimate} {}", value[e]);
            }
        }
    }
}

#[test]
fn memories_that_the_kernels_do_not_take_are_refused() {
    let of = |width: usize, minibatches: usize, limits: Limits| {
        let memory = Some(MemorySettings { cell: Cell::Lstm, width, layers: 1 });
        let learner = Learner::new(Settings { memory, minibatches, ..settings() }, WIDTHS, 1).unwrap();
        Prepared::new(&learner, BATCH, Precision::F32, limits).unwrap_err().to_string()
    };
    let narrow = Limits { shared_memory: 101_376, ..LIMITS };
    let text = of(1024, 2, narrow);
    assert!(text.contains("lstm of 1024 units") && text.contains("train on the CPU"), "{text}");
    assert!(of(10, 14, LIMITS).contains("13 robots cannot fill 14 minibatches"));
}
