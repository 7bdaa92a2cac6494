//! Whether a policy that falls walks under another arrangement.

use super::orders::Limbs;
use super::search::search;
use super::{Arrangement, Diagnosis};
use crate::watch::{Amount, Watch};
use crate::world::{World, longest_delay, standing_error};
use gaitfit_learn::evaluate::{Subject, run_trials};
use gaitfit_learn::task::Task;
use gaitfit_policy::Policy;
use gaitfit_sim::pool;
use std::convert::Infallible;

/// Robots of a trial, and its length, s.
const ROBOTS: usize = 12;
const SECONDS: f64 = 3.0;
/// Largest measure of an arrangement that walks: the share of falls, and the velocity error relative to that of a robot that
/// stands still.
const WALKS: f64 = 0.5;
/// A right arrangement has at most this share of the measure of a wrong one.
const CLEARLY: f64 = 0.5;
/// Measure that needs no further change.
const ENOUGH: f64 = 0.35;

/// Searches an arrangement with which the policy of `world` walks; `None` if none that is tried does. Policies that
/// gaitfit trained are as their files say, so they are not tried. Once `watch` asks to stop it returns soon, with
/// nothing.
pub fn of_walk(world: &World, seed: u64, threads: usize, watch: &Watch<'_>) -> Option<Diagnosis> {
    let policy = &world.policy;
    // Nor are those that follow a motion: they have no commands to judge them by.
    if policy.provenance.iteration > 0 || policy.interface.reference.is_some() {
        return None;
    }
    let joints = policy.interface.resolve(&world.model).ok()?;
    let limbs = Limbs::new(&world.model, &joints);
    let stop = || watch.stop();
    let measure = |tried: &[Arrangement]| {
        let one = |number: usize| trial(world, &tried[number], seed, &stop).unwrap_or(f64::INFINITY);
        // The given arrangement alone needs no progress bar.
        if tried.len() == 1 {
            return vec![one(0)];
        }
        let what = "order, signs and scales of joints: trial";
        let amount = Amount { what, parts: "trials", total: tried.len(), pieces: tried.len() };
        let measured = watch.shared(amount, |done| {
            Ok::<_, Infallible>(pool::map(tried.len(), threads, |number| {
                let measured = one(number);
                done(1);
                measured
            }))
        });
        let Ok(measured) = measured;
        measured
    };
    let none = |_: &Arrangement| Vec::new();
    let (best, measure) = search(&policy.interface, &limbs, [false, true], ENOUGH, &measure, &none);
    // The search takes the best of very many. Only a measure that is good by itself shows that the robot
    // walks.
    let is_right = measure[1] < WALKS && measure[1] < CLEARLY * measure[0];
    (!best.changes.is_empty() && is_right).then_some(Diagnosis {
        changes: best.changes,
        settings: best.settings,
        measure,
        measured: "share of falls plus relative velocity error",
    })
}

/// Falls and velocity error of a few robots; `None` for an arrangement that is no policy of this robot.
fn trial(
    world: &World,
    arrangement: &Arrangement,
    seed: u64,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<f64> {
    let interface = arrangement.interface.clone();
    let policy = Policy { interface: interface.clone(), ..world.policy.clone() };
    let settings = &world.scene.settings;
    let preset = world.scene.walker.batch.options().preset;
    let delay = longest_delay(&world.candidate);
    let task = Task::with_interface(&world.model, settings, interface, preset, delay).ok()?;
    let subject = Subject {
        task: &task,
        policy: &policy,
        candidate: Some(&world.candidate),
        seed,
        cancel: Some(cancel),
        moved: None,
    };
    let trials = run_trials(&subject, ROBOTS, SECONDS, 1).ok()?;
    let falls = trials.iter().filter(|trial| trial.fell).count() as f64 / trials.len() as f64;
    let errors: Vec<f64> =
        trials.iter().filter(|trial| !trial.diverged).map(|trial| trial.linear_velocity_error).collect();
    // Under commands of 0 a robot that stands still has no error; the bound keeps the quotient finite.
    let still = standing_error(&settings.command).max(1e-3);
    let error = errors.iter().sum::<f64>() / errors.len().max(1) as f64 / still;
    // An error beyond that of a robot that stands still says no more than that.
    Some(falls + error.min(2.0))
}
