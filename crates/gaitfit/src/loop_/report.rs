//! `report.html`: the whole loop on one page.

use super::controls;
use super::results::{REFERENCE, Results, TARGET};
use super::rounds::Done;
use super::setup::Setup;
use super::walked;
use crate::Error;
use crate::adapt;
use crate::evaluate::{Comparison, Evaluation};
use crate::gait;
use crate::machine::now;
use crate::pieces;
use crate::replay;
use crate::run::RunFolder;
use crate::target::{PolicyFiles, Target};
use crate::train;
use gaitfit_view::loop_report::{Difference, DriftTrials, Round, Tracking};
use gaitfit_view::{Doubt, DoubtKind, Link, LoopReport, Replay, Setting, loop_html};

/// Writes the page.
pub fn write(setup: &Setup, folder: &RunFolder, done: &Done) -> Result<(), Error> {
    let results = &done.results;
    let fact = |name: &str, value: String| Setting { name: name.to_owned(), value };
    let mut facts = vec![
        fact("Rounds", results.rounds.len().to_string()),
        fact("Stopped because", results.stopped_because.clone()),
    ];
    facts.extend(results.target.iter().map(|target| fact("Target", target.clone())));
    facts.extend(walked::sentences(&results.walked).into_iter().map(|said| fact("On the robot", said)));
    // Without the robot it is said in large print.
    let next = results.next.iter().filter(|_| results.absence().is_none());
    facts.extend(next.map(|next| fact("Next", next.clone())));
    let page = LoopReport {
        title: results.name.clone(),
        robot: results.robot.clone(),
        created: now(),
        wall_seconds: results.wall_seconds,
        doubts: divergence(results).into_iter().chain(results.doubts.clone()).chain(doubts(done)).collect(),
        before: results.before.clone(),
        after: results.after.clone(),
        measured: measured(done),
        // The first measurement is the one on the target, if it measures policies.
        target: results.evaluations.first().map(|one| one.on.clone()).unwrap_or_default(),
        rounds: rounds(folder, done)?,
        best: results
            .best_round()
            .and_then(|best| results.rounds.iter().position(|one| one.round == best.round)),
        tracking: tracking(results),
        differences: results.comparisons.iter().map(difference).collect(),
        bought: results.bought.clone().unwrap_or_default(),
        drift: drift(setup, results),
        replay: side_by_side(setup, done)?,
        facts,
        links: links(folder, results),
        warnings: results.warnings.clone(),
        settings: pieces::settings(&setup.config)?,
        versions: pieces::versions(),
    };
    let page = loop_html(&page)?;
    Ok(folder.write("report.html", page.as_bytes())?)
}

/// Doubt that robots diverged, which the page states first.
fn divergence(results: &Results) -> Option<Doubt> {
    results.divergence().map(|divergence| Doubt::new(DoubtKind::Diverged, format!("{divergence}.")))
}

/// Doubts that the robot was absent, or that it is the program's own simulator.
fn doubts(done: &Done) -> Vec<Doubt> {
    let simulated = matches!(done.target, Some(Target::Simulated(_))) && !done.results.evaluations.is_empty();
    let text = "The robot of this loop is the program's own simulator with other numbers. On another simulator or a robot \
                the policies can do worse.";
    let simulated = simulated.then(|| Doubt::new(DoubtKind::OwnSimulatorOnly, text));
    done.results.absence().into_iter().chain(simulated).collect()
}

/// Where the headline was measured, and on how much.
fn measured(done: &Done) -> String {
    let Some(first) = done.results.evaluations.first() else { return String::new() };
    let place = match &done.target {
        _ if first.on != TARGET => "in the fitted simulator, not on the robot".to_owned(),
        Some(target @ Target::Simulated(_)) => format!("on the simulated target ({})", target.description()),
        Some(target) => format!("on the robot ({})", target.description()),
        None => format!("on the {TARGET}"),
    };
    let Evaluation { trajectories, seconds, .. } = &first.evaluation;
    let length = if *seconds > 0.0 { format!(" of {seconds} s") } else { String::new() };
    format!("{place}: {trajectories} trajectories{length}")
}

fn rounds(folder: &RunFolder, done: &Done) -> Result<Vec<Round>, Error> {
    let mut rounds = Vec::with_capacity(done.results.rounds.len());
    // Curves are read again from the folders, because the results have only their ends.
    for (result, fit) in done.results.rounds.iter().zip(&done.fits) {
        let within = folder.path().join(format!("round-{}", result.round));
        let course = adapt::metrics(&RunFolder::only(&within, "adapt")?)?;
        let round = adapt::round(fit, &result.adapt, &course)?;
        let held_out = result.adapt.held_out.as_ref();
        rounds.push(Round {
            name: format!("Round {}: {} → {}", result.round, result.before, result.after),
            wall_seconds: result.adapt.wall_seconds + result.finetune.wall_seconds,
            held_out: held_out.map(|held| adapt::held_out_shown(held, fit.method.model())),
            fine_tuning: train::curves(&RunFolder::only(&within, "finetune")?, &result.finetune)?,
            ..round
        });
    }
    Ok(rounds)
}

fn tracking(results: &Results) -> Vec<Tracking> {
    let row = |one: &super::results::Measurement| Tracking {
        policy: one.evaluation.policy.clone(),
        simulator: one.on.clone(),
        trajectories: one.evaluation.trajectories as u64,
        linear_velocity_error: one.evaluation.linear_velocity_error,
        angular_velocity_error: one.evaluation.angular_velocity_error,
        reward: one.evaluation.reward,
        fall_rate: one.evaluation.fall_rate,
    };
    results.evaluations.iter().map(row).collect()
}

fn difference(one: &Comparison) -> Difference {
    Difference {
        policy: one.policy.clone(),
        against: one.against.clone(),
        simulator: one.on.clone(),
        paired: one.paired,
        linear_velocity_error: one.linear_velocity_error,
        angular_velocity_error: one.angular_velocity_error,
        fall_rate: one.fall_rate,
    }
}

fn drift(setup: &Setup, results: &Results) -> Vec<DriftTrials> {
    let row = |one: &super::results::Measurement| DriftTrials {
        policy: one.evaluation.policy.clone(),
        simulator: one.on.clone(),
        trials: one.evaluation.drift.iter().map(|trial| trial.drawn(setup.config.evaluate.drift)).collect(),
    };
    results.evaluations.iter().filter(|one| !one.evaluation.drift.is_empty()).map(row).collect()
}

/// The first and the best policy under the same commands, on the target if it is simulated, or else in the last
/// adapted simulator.
fn side_by_side(setup: &Setup, done: &Done) -> Result<Option<Replay>, Error> {
    let results = &done.results;
    let named = |name: &str| done.policies.iter().find(|policy| policy.name == name);
    let (Some(before), Some(after), Some(round)) =
        (named(&results.before), named(&results.after), results.rounds.last())
    else {
        return Ok(None);
    };
    // The same commands and seed for both, so that the two robots can be watched side by side.
    let commands = gait::tour(&setup.task.command);
    let seed = setup.config.evaluate.seed;
    let record = |policy: &PolicyFiles| match &done.target {
        Some(Target::Simulated(target)) => target.record(policy, &commands, seed),
        _ => {
            let world = setup.adapted(policy, round.theta.clone().into())?;
            Ok(gaitfit_learn::evaluate::record_gait(&world.subject(seed), &commands)?)
        }
    };
    let on = if matches!(done.target, Some(Target::Simulated(_))) {
        "on the target"
    } else {
        "in the adapted simulator"
    };
    let (first, second) = (record(before)?, record(after)?);
    Ok(Some(Replay {
        title: results.name.clone(),
        note: format!("{} and {} under the same commands {on}.", before.name, after.name),
        dt: first.dt,
        robots: vec![
            replay::robot(&before.name, &setup.model, &first),
            replay::robot(&after.name, &setup.model, &second),
        ],
    }))
}

fn links(folder: &RunFolder, results: &Results) -> Vec<Link> {
    let link = |text: String, path: String| Link { text, path };
    let mut links = Vec::new();
    for round in &results.rounds {
        let number = round.round;
        links.push(link(format!("Policy {} (ONNX)", round.after), format!("policies/policy-{number}.onnx")));
        links.push(link(format!("Policy {}", round.after), format!("policies/policy-{number}.safetensors")));
        links.push(link(format!("Fit of round {number}"), format!("round-{number}/adapt/report.html")));
        links.push(link(
            format!("Training of round {number}"),
            format!("round-{number}/finetune/report.html"),
        ));
    }
    // Controls that were not trained left no folder.
    for (name, place) in controls::PLACES {
        if folder.path().join("controls").join(place).is_dir() {
            links.push(link(format!("Training: {name}"), format!("controls/{place}/finetune/report.html")));
        }
    }
    // A target that is a real robot has no reference.
    if folder.path().join("reference").is_dir() {
        links.push(link(format!("Training: {REFERENCE}"), "reference/finetune/report.html".to_owned()));
    }
    links
}
