//! From results to the report's plain data.

use super::files::Trained;
use super::metrics::{Metric, diagnostics};
use super::results::{LAST, Results, SeedResult};
use super::seed::Files;
use super::setup::Setup;
use super::show::Shown as AtWork;
use crate::machine::{machine, now};
use crate::{Error, gait, replay};
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_view::training::{SeedCurve, SeedResult as Shown, Series};
use gaitfit_view::{Link, Replay, Setting, TrainingReport, training_report};

/// Caption of the gait's picture.
const GAIT_CAPTION: &str = "standing, ahead and to the left, at the largest commands of its training";

/// The page of a finished run. `configuration`: the resolved one.
pub fn page(
    configuration: &str,
    setup: &Setup,
    results: &Results,
    trained: &[Trained],
) -> Result<String, Error> {
    let first = trained.first();
    let report = TrainingReport {
        title: results.name.clone(),
        robot: format!("{}, task {}", results.robot, results.task),
        created: now(),
        wall_seconds: results.wall_seconds,
        measured_on: format!(
            "the last {LAST} iterations of training, with its noise, pushes and varied robots"
        ),
        seeds: trained.iter().map(|seed| curve(&seed.result, &seed.metrics)).collect(),
        // Picture, caption and replay are of the first seed; links lead to the others.
        gait: first.map(|seed| gait::picture(&seed.shown.record)),
        gait_caption: first
            .map(|seed| format!("Seed {}, {GAIT_CAPTION}.", seed.result.seed))
            .unwrap_or_default(),
        links: trained.iter().flat_map(|seed| links(seed.result.seed)).collect(),
        facts: facts(setup, results),
        doubts: results.doubts.clone(),
        replay: first.map(|seed| seed.replay.clone()),
        warnings: results.warnings.iter().cloned().chain(trained.iter().filter_map(warning)).collect(),
        configuration: configuration.to_owned(),
        versions: versions(results),
    };
    Ok(training_report(&report)?)
}

/// Replay on the page of a seed's policy.
pub fn replay(title: &str, model: &Model, policy: &Policy, shown: &AtWork) -> Replay {
    let ends = shown.fell().map_or_else(String::new, |time| format!("; it fell after {time:.1} s"));
    Replay {
        title: title.to_owned(),
        note: format!(
            "{} iterations; standing, ahead, left, turning, back, standing{ends}",
            policy.provenance.iteration
        ),
        dt: shown.record.dt,
        robots: vec![replay::robot_on(&model.name, &shown.scene.walker, &shown.record)],
    }
}

fn unknown(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

fn result(seed: &SeedResult) -> Shown {
    Shown {
        reward: unknown(seed.episode_return),
        linear_velocity_error: seed.linear_velocity_error,
        angular_velocity_error: seed.angular_velocity_error,
        fall_rate: unknown(seed.fall_rate),
        iterations: seed.iterations,
        wall_seconds: seed.wall_seconds,
        samples_per_second: seed.samples_per_second,
    }
}

/// The learning curves of a seed.
pub fn curve(outcome: &SeedResult, metrics: &[Metric]) -> SeedCurve {
    let series = |name: &str, unit: &str, value: &dyn Fn(&Metric) -> f64| Series {
        name: name.to_owned(),
        unit: unit.to_owned(),
        values: metrics.iter().map(value).collect(),
        ..Series::default()
    };
    let mut progress = vec![
        series("reward of a step", "", &|metric| metric.reward),
        series("episode return", "", &|metric| unknown(metric.episode_return)),
        series("linear velocity error", "m/s", &|metric| metric.linear_velocity_error),
        series("angular velocity error", "rad/s", &|metric| metric.angular_velocity_error),
        series("episode length", "s", &|metric| unknown(metric.episode_seconds)),
        series("falls", "share of episodes", &|metric| unknown(metric.fall_rate)),
    ];
    // Curves of a curriculum are there only if the task has one.
    if metrics.iter().any(|metric| metric.terrain_level.is_some()) {
        progress.push(series("mean level of the ground", "", &|metric| unknown(metric.terrain_level)));
    }
    if metrics.iter().any(|metric| metric.command_level.is_some()) {
        progress.push(series("commands", "share of the way to the final ranges", &|metric| {
            unknown(metric.command_level)
        }));
    }
    let names = metrics.first().map(|metric| metric.rewards.keys().cloned().collect::<Vec<_>>());
    let rewards = names.unwrap_or_default().into_iter().map(|name| {
        series(&name.replace('_', " "), "1/s", &|metric| unknown(metric.rewards.get(&name).copied()))
    });
    // Names come from the first iteration: all have the same.
    let names = metrics.first().map(|metric| diagnostics(&metric.ppo).map(|(name, _)| name));
    let learner = names.into_iter().flatten().enumerate().map(|(index, name)| Series {
        // The adaptive learning rate is multiplied by factors, which a logarithmic axis shows evenly.
        log: name == "learning_rate",
        ..series(&name.replace('_', " "), "", &|metric| diagnostics(&metric.ppo)[index].1)
    });
    SeedCurve {
        seed: outcome.seed,
        result: result(outcome),
        iteration: metrics.iter().map(|metric| metric.iteration).collect(),
        progress,
        rewards: rewards.collect(),
        diagnostics: learner
            .chain([series("samples per second", "1/s", &|metric| metric.times.samples_per_second)])
            .collect(),
    }
}

fn links(seed: u64) -> [Link; 2] {
    let files = Files::new(seed);
    [
        Link { text: format!("Watch seed {seed}"), path: files.replay },
        Link { text: format!("Policy of seed {seed}"), path: files.policy },
    ]
}

fn facts(setup: &Setup, results: &Results) -> Vec<Setting> {
    let fact = |name: &str, value: String| Setting { name: name.to_owned(), value };
    let rate = setup.scene.walker.interface.control_dt.recip();
    let mut facts = vec![
        fact("Robots", results.environments.to_string()),
        fact("Steps an iteration", results.steps.to_string()),
        fact("Control", format!("{rate:.0} Hz, {} physics steps each", setup.scene.settings.substeps)),
        fact("Threads", setup.threads.to_string()),
    ];
    if let Some(parent) = &results.parent {
        facts.push(fact("Goes on from", parent.policy.clone()));
        facts.push(fact("Simulator", parent.simulator.clone()));
    }
    if let Some(gait) = results.seeds.first().map(|seed| &seed.gait) {
        facts.push(fact("Action rate", format!("{:.2} a step", gait.action_rate)));
        facts.push(fact(
            "Torque power above 10 Hz",
            format!("{:.1} %", 100.0 * gait.torque_power_above_10_hz),
        ));
        facts.push(fact("Foot lift", format!("{:.3} m", gait.foot_lift)));
        facts.push(fact("Step frequency", format!("{:.1} Hz", gait.step_frequency)));
    }
    facts
}

fn warning(seed: &Trained) -> Option<String> {
    let time = seed.shown.fell()?;
    Some(format!("The policy of seed {} falls {time:.1} s into its replay.", seed.result.seed))
}

fn versions(results: &Results) -> Vec<Setting> {
    let machine = machine();
    [
        ("gaitfit", machine.gaitfit.to_owned()),
        ("platform", machine.platform),
        ("processor", machine.processor),
        ("engine", machine.engine.to_owned()),
        ("settings (SHA-256)", results.configuration_hash.clone()),
    ]
    .into_iter()
    .map(|(name, value)| Setting { name: name.to_owned(), value })
    .collect()
}
