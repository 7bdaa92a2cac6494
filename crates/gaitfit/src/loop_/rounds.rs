//! The loop itself: what follows what, and when it ends.
//!
//! A further round begins only if the last one helped. Where the target can be measured, that is its tracking error
//! under commands that are the same for all policies: it is what the loop is for, and costs of two rounds compare
//! logs of different policies, each scaled by its own range. Where only logs can be had, it is the cost of the fit.

use super::controls;
use super::fallback::{self, Model};
use super::files;
use super::presence;
use super::results::{self, Measurement, REFERENCE, Results, RoundResult, TARGET, adapted, policy_name};
use super::setup::Setup;
use super::stages::{Stages, measurement};
use super::training_robot::TrainingRobot;
use super::walked::{NOT_MEASURED, Walked};
use crate::Error;
use crate::adapt;
use crate::evaluate::{Better, Comparison, Evaluation, compare};
use crate::run::RunFolder;
use crate::settings::{AdaptConfig, TargetConfig, TargetKind};
use crate::target::{PolicyFiles, Target};
use crate::watch::Watch;
use gaitfit_adapt::ThetaFile;
use gaitfit_log::csv_files;
use std::path::PathBuf;

/// A finished loop, with what its report needs besides the results.
pub struct Done {
    /// The results.
    pub results: Results,
    /// The fits' inputs, one a round.
    pub fits: Vec<adapt::Setup>,
    /// The policies before the first round and after each.
    pub policies: Vec<PolicyFiles>,
    /// The robot, if it can be run from here.
    pub target: Option<Target>,
}

/// Runs all rounds that there are to be, and the reference.
pub fn run(setup: &Setup, folder: &RunFolder, watch: &Watch<'_>) -> Result<Done, Error> {
    // The robot is looked for first: whether it is there decides how many rounds there can be.
    let (target, absent) = presence::target(setup, folder, watch)?;
    // A further round needs logs of the new policy, which only the robot can make.
    let max = if absent.is_some() { 1 } else { setup.config.rounds };
    if max < setup.config.rounds {
        watch.note("without the robot there is one round");
    }
    let mut stages = Stages::new(setup, folder, target, watch)?;
    // For the person who waits: each stage says which one of how many it is.
    let stage_count = count(setup, max, stages.target.as_ref());
    stages = stages.counted(stage_count);
    // Policy 0 is measured first, so that every round has something to be better than.
    let first = stages.keep(&policy_name(0), "policy-0", &setup.policy_bytes)?;
    let mut evaluations = Vec::new();
    evaluations.extend(measurement(TARGET, stages.on_target("policy-0", &first)?));
    // By other trajectories than those that are reported, where there is anything to choose.
    let mut choices = Vec::new();
    if max > 1 {
        choices.extend(measurement(TARGET, stages.for_choice("policy-0", &first)?));
    }
    let mut policies = vec![first];
    let mut rounds: Vec<RoundResult> = Vec::new();
    let mut fits = Vec::new();
    let mut stopped_because = "all rounds are done".to_owned();
    for number in 1..=max {
        let (round, fit) = one_round(&mut stages, number, &rounds, &mut policies, &mut evaluations)?;
        rounds.push(round);
        fits.push(fit);
        if let (true, Some(after)) = (max > 1, policies.last()) {
            choices.extend(measurement(TARGET, stages.for_choice(&format!("policy-{number}"), after)?));
        }
        // With one round nothing is chosen, so the reported trajectories will do.
        let judged = if choices.is_empty() { &evaluations } else { &choices };
        let (helped, why) = helped(setup, &rounds, judged);
        if !helped {
            stopped_because = why;
            break;
        }
    }
    // After the last round: the robot walks once more under the policy that came out.
    last_walk(&mut stages, &policies)?;
    reference(&mut stages, &policies, &mut evaluations)?;
    let number = best(&policies, if choices.is_empty() { &evaluations } else { &choices });
    let after = &policies[number];
    let chosen = rounds.get(number.max(1) - 1);
    // Controls get as many trainings as the chosen policy had, so they come after the choice.
    controls::run(&mut stages, &policies, chosen, number.max(1), &mut evaluations)?;
    let comparisons = controls::comparisons(&after.name, &evaluations);
    let results = Results {
        name: folder.name(),
        robot: setup.model.name.clone(),
        target: stages.target.as_ref().map(Target::description),
        before: policies.first().map(|policy| policy.name.clone()).unwrap_or_default(),
        after: after.name.clone(),
        policy: after.safetensors.display().to_string(),
        onnx: after.onnx.display().to_string(),
        stopped_because,
        walked: walked(&stages, &policies)?,
        next: next(stages.target.as_ref(), absent.is_some(), after),
        absent_because: absent,
        doubts: chosen.map(|round| round.adapt.doubts.clone()).unwrap_or_default(),
        warnings: warnings(&rounds, chosen, &fits, &evaluations, &comparisons),
        bought: controls::bought(&comparisons, &evaluations),
        comparisons,
        run_folder: folder.path().display().to_string(),
        wall_seconds: stages.times.all().values().sum(),
        stage_seconds: stages.times.all().clone(),
        rounds,
        // Trajectory by trajectory they stand in files of their own.
        evaluations: evaluations.into_iter().map(Measurement::summary).collect(),
    };
    Ok(Done { results, fits, policies, target: stages.target })
}

/// Stages of so many rounds, if none ends the loop.
fn count(setup: &Setup, rounds: u32, target: Option<&Target>) -> usize {
    let measured = usize::from(target.is_some_and(Target::measures));
    // Logs, fit, training, the new policy on the target, both in the fitted simulator.
    let round = 5 + measured;
    // A training, and a measurement where the target measures.
    let reference = if has_reference(setup) { 1 + measured } else { 0 };
    // The first policy and the policy of each round.
    let chosen = if rounds > 1 { measured * (rounds as usize + 1) } else { 0 };
    let controls = controls::count(setup, target) + usize::from(walks_last(setup));
    // Logs that are given need no stage in the first round.
    rounds as usize * round - usize::from(!setup.logs.is_empty()) + measured + reference + chosen + controls
}

fn one_round(
    stages: &mut Stages<'_>,
    number: u32,
    rounds: &[RoundResult],
    policies: &mut Vec<PolicyFiles>,
    evaluations: &mut Vec<Measurement>,
) -> Result<(RoundResult, adapt::Setup), Error> {
    let setup = stages.setup;
    let round = format!("round-{number}");
    stages.folder.make(&round)?;
    // Each round begins with the policy of the last one.
    let Some(before) = policies.last() else {
        return Err(Error::failed("a round without a policy to begin with"));
    };
    // Given logs are those of the first policy; a later one must walk itself.
    let logs = if number == 1 && !setup.logs.is_empty() {
        setup.logs.clone()
    } else {
        vec![stages.collect(&logs_of(number), before, seed(setup, number))?]
    };
    let (logs, held) = split(logs, setup.config.held_out)?;
    let shown = |logs: &[PathBuf]| logs.iter().map(|path| path.display().to_string()).collect();
    let mut config = setup.config.adapt(number, before.safetensors.display().to_string(), shown(&logs));
    config.validate = shown(&held);
    // The fit is a run of its own within the loop's folder.
    config.runs = stages.path(&round).display().to_string();
    add_truth(setup, &mut config);
    let (fit, adapt, theta) = stages.adapt(&round, &config)?;
    let Model { robot, theta, fallback } = fallback::model(stages, &round, &adapt, &theta, rounds)?;
    if let Some(fallback) = &fallback {
        stages.note(&format!("{round}: {fallback}"));
    }
    let (finetune, seed, bytes) = stages.finetune(&round, before, &robot)?;
    let stem = |number: u32| format!("policy-{number}");
    let after = stages.keep(&policy_name(number), &stem(number), &bytes)?;
    // The policy before is measured in the new simulator too: both numbers must be of one simulator.
    let on = adapted(number, setup.config.rounds);
    evaluations.extend(measurement(TARGET, stages.on_target(&stem(number), &after)?));
    evaluations.extend(measurement(&on, stages.on_adapted(&stem(number - 1), before, number, &theta)?));
    evaluations.extend(measurement(&on, stages.on_adapted(&stem(number), &after, number, &theta)?));
    let result = RoundResult {
        round: number,
        before: before.name.clone(),
        after: after.name.clone(),
        adapt,
        theta: theta.display().to_string(),
        fallback,
        finetune,
        seed: Some(seed),
    };
    // Pushed last: `before` is borrowed from the list until here.
    policies.push(after);
    Ok((result, fit))
}

/// Where the logs of a round's robot are.
fn logs_of(round: u32) -> String {
    format!("round-{round}/logs")
}

/// Seed of a round's commands: that of the round, or on a robot always the same, so that its policies can be compared.
fn seed(setup: &Setup, round: u32) -> u64 {
    let Some(target) = &setup.config.target else { return 0 };
    let more = if target.kind.is_robot() { 0 } else { u64::from(round - 1) };
    target.seed.saturating_add(more)
}

/// Whether the last policy walks though nothing is fitted to it.
fn walks_last(setup: &Setup) -> bool {
    setup.config.target.as_ref().is_some_and(|target| target.kind.is_robot() && target.last_walk)
}

/// The last policy walks on the robot; a further round finds its logs made.
fn last_walk(stages: &mut Stages<'_>, policies: &[PolicyFiles]) -> Result<(), Error> {
    if let (true, [.., last]) = (walks_last(stages.setup), policies) {
        let round = policies.len() as u32;
        stages.collect(&logs_of(round), last, seed(stages.setup, round))?;
    }
    Ok(())
}

/// Returns what a robot's sensors measured of the policies that walked on it.
fn walked(stages: &Stages<'_>, policies: &[PolicyFiles]) -> Result<Vec<Walked>, Error> {
    let Some(target) = stages.setup.config.target.as_ref().filter(|target| target.kind.is_robot()) else {
        return Ok(Vec::new());
    };
    // The logs of a round are those of the policy with which it begins, so both lists go together.
    let logs = (1..).map(|round| stages.path(&logs_of(round)));
    let walked = policies.iter().zip(logs).filter(|(_, logs)| logs.is_dir());
    walked.map(|(policy, logs)| Walked::read(&policy.name, &logs, target.seconds)).collect()
}

/// The logs to fit, and those that show how well the fit predicts: one of every `every`, the last of them. Of fewer than
/// two times as many logs none is spared.
pub(super) fn split(logs: Vec<PathBuf>, every: usize) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Error> {
    if every == 0 {
        return Ok((logs, Vec::new()));
    }
    let mut files = Vec::new();
    for path in &logs {
        // Held out are single logs, so folders are opened first.
        if path.is_dir() { files.extend(csv_files(path)?) } else { files.push(path.clone()) }
    }
    // From here on at least two logs are held out.
    if files.len() < 2 * every {
        return Ok((logs, Vec::new()));
    }
    let numbered = files.into_iter().enumerate();
    let (held, fitted): (Vec<_>, Vec<_>) = numbered.partition(|(number, _)| (number + 1) % every == 0);
    let paths = |numbered: Vec<(usize, PathBuf)>| numbered.into_iter().map(|(_, path)| path).collect();
    Ok((paths(fitted), paths(held)))
}

/// Gives a fit the true values that a simulated target has for its parameters.
pub fn add_truth(setup: &Setup, config: &mut AdaptConfig) {
    let Some(ThetaFile { parameter, .. }) = &setup.truth else { return };
    let joints: Vec<String> = setup.model.joints.iter().map(|joint| joint.name.clone()).collect();
    // Rest angles are for networks, which have no true values.
    let rest = vec![0.0; joints.len()];
    let rules = config.by_kind(&setup.model).map(|config| config.rules());
    let theta = rules.and_then(|rules| rules.theta(&config.groups(&joints), &joints, &rest));
    let Ok(theta) = theta else { return };
    for entry in theta.entries() {
        // A fitted entry has a truth only if all its joints have the same one.
        let covers = |joints: &[String]| entry.joints.iter().all(|joint| joints.contains(joint));
        // Later numbers win, as in the file.
        let known = parameter.iter().rev().find(|one| one.kind == entry.kind && covers(&one.joints));
        if let Some(known) = known {
            // Values that the configuration states win.
            config.truth.entry(entry.name.clone()).or_insert(known.value);
        }
    }
}

/// Whether the last round helped, and if not, why there is no further one.
fn helped(setup: &Setup, rounds: &[RoundResult], evaluations: &[Measurement]) -> (bool, String) {
    let share = setup.config.improvement;
    let Some(last) = rounds.last() else { return (true, String::new()) };
    let error = |policy: &str| measured(evaluations, policy).map(results::tracking_error);
    let percent = 100.0 * share;
    // Where the target measures policies, their errors decide; else the costs of the fits.
    if let (Some(before), Some(after)) = (error(&last.before), error(&last.after)) {
        let why = format!(
            "round {} did not lower the tracking error on the target by {percent:.0} %: {before:.4} before, {after:.4} \
             after (m/s and rad/s added)",
            last.round
        );
        return (after <= (1.0 - share) * before, why);
    }
    let fitted = |round: &RoundResult| round.adapt.fits.first().map(|fit| fit.cost);
    let nominal = last.adapt.fits.first().and_then(|fit| fit.nominal_cost);
    let earlier =
        // The first round is compared with the robot before its fit.
        rounds.len().checked_sub(2).and_then(|index| rounds.get(index)).and_then(fitted).or(nominal);
    match (earlier, fitted(last)) {
        (Some(before), Some(after)) => {
            let why = format!(
                "round {} did not lower the cost by {percent:.0} %: {before:.5} before, {after:.5} after",
                last.round
            );
            // A comparison with NaN is false: if all robots fell, the round did not help.
            (after <= (1.0 - share) * before, why)
        }
        _ => (true, String::new()),
    }
}

fn measured<'a>(evaluations: &'a [Measurement], policy: &str) -> Option<&'a Evaluation> {
    let measurement = evaluations.iter().find(|one| one.on == TARGET && one.evaluation.policy == policy);
    measurement.map(|one| &one.evaluation)
}

fn has_reference(setup: &Setup) -> bool {
    let simulated = |target: &TargetConfig| target.kind == TargetKind::Simulated;
    setup.config.references && setup.config.target.as_ref().is_some_and(simulated)
}

/// The first policy fine-tuned in the true simulator, where there is one.
fn reference(
    stages: &mut Stages<'_>,
    policies: &[PolicyFiles],
    evaluations: &mut Vec<Measurement>,
) -> Result<(), Error> {
    let setup = stages.setup;
    let (true, Some(target), Some(first)) =
        (has_reference(setup), setup.config.target.as_ref(), policies.first())
    else {
        return Ok(());
    };
    let robot = TrainingRobot::target(files::truth(stages.folder), target);
    let (_, _, bytes) = stages.finetune("reference", first, &robot)?;
    let policy = stages.keep(REFERENCE, "reference", &bytes)?;
    evaluations.extend(measurement(TARGET, stages.on_target("reference", &policy)?));
    Ok(())
}

/// Number of the trained policy with the smallest tracking error on the target; the last one where that is not known.
fn best(policies: &[PolicyFiles], evaluations: &[Measurement]) -> usize {
    let error = |number: &usize| {
        measured(evaluations, &policies[*number].name).map_or(f64::INFINITY, results::tracking_error)
    };
    let trained = usize::from(policies.len() > 1)..policies.len();
    // The first policy is no result of the loop. Backwards, because of equal errors the later policy counts.
    trained.rev().min_by(|a, b| error(a).total_cmp(&error(b))).unwrap_or_default()
}

/// Next step, which only the user can do.
fn next(target: Option<&Target>, absent: bool, after: &PolicyFiles) -> Option<String> {
    match (target, absent) {
        (Some(Target::Robot(_)), _) => Some(NOT_MEASURED.to_owned()),
        (Some(_), _) => None,
        (None, true) => Some(
            "The robot was absent, so the policies were not measured on it. When it is present, start this loop \
             afresh to measure them."
                .to_owned(),
        ),
        (None, false) => Some(format!(
            "Run {} (or {}) on the robot under commands over its whole range, record joint positions, velocities, \
             actions and commands, and give these logs and this policy to the next loop.",
            after.onnx.display(),
            after.safetensors.display()
        )),
    }
}

/// Warnings to read before trusting the numbers: what policies do on the target, then their training, the
/// fits, and the logs. The results themselves have the doubts about the fit of the `chosen` policy's round.
fn warnings(
    rounds: &[RoundResult],
    chosen: Option<&RoundResult>,
    fits: &[adapt::Setup],
    evaluations: &[Measurement],
    comparisons: &[Comparison],
) -> Vec<String> {
    let mut warnings = Vec::from_iter(results::divergence(evaluations));
    let elsewhere =
        |round: &RoundResult| round.fallback.as_ref().map(|why| format!("round {}: {why}", round.round));
    warnings.extend(rounds.iter().filter_map(elsewhere));
    warnings.extend(comparisons.iter().filter_map(controls::warning));
    for round in rounds {
        let (before, after) = (measured(evaluations, &round.before), measured(evaluations, &round.after));
        // Only on a target that measures; the fitted simulators have their own numbers in the table.
        let (Some(before), Some(after)) = (before, after) else { continue };
        if compare(TARGET, after, before).better() != Better::Policy {
            warnings.push(format!("{} tracks no better than {} on the target", round.after, round.before));
        }
        let (falls, fell) = (after.fall_rate, before.fall_rate);
        // Only where the intervals do not touch.
        if falls.mean - falls.ci95 > fell.mean + fell.ci95 {
            warnings.push(format!("{} falls more often than {} on the target", round.after, round.before));
        }
    }
    // With one round its number would say nothing.
    let which = |round: &RoundResult| match rounds.len() {
        1 => String::new(),
        _ => format!("round {}: ", round.round),
    };
    for round in rounds {
        let said = round.finetune.doubts.iter();
        warnings
            .extend(said.map(|doubt| format!("{}{}: {}", which(round), doubt.kind.headline(), doubt.text)));
        warnings.extend(round.finetune.warnings.iter().map(|warning| format!("{}{warning}", which(round))));
    }
    let chosen = chosen.map(|round| round.round);
    for round in rounds.iter().filter(|round| Some(round.round) != chosen) {
        let doubts = &round.adapt.doubts;
        let said =
            doubts.iter().map(|doubt| format!("{}{}: {}", which(round), doubt.kind.headline(), doubt.text));
        warnings.extend(said);
    }
    // First what is said of the fits; what their logs showed before any fit comes last.
    for of_logs in [false, true] {
        for (round, fit) in rounds.iter().zip(fits) {
            let about = round.adapt.warnings.iter().filter(|one| fit.warnings.contains(one) == of_logs);
            warnings.extend(about.map(|warning| format!("{}{warning}", which(round))));
        }
    }
    warnings
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn every_fourth_log_is_held_out_where_there_are_enough() {
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<PathBuf> = (0..9).map(|k| folder.path().join(format!("{k}.csv"))).collect();
        names.iter().for_each(|name| std::fs::write(name, "").unwrap());
        let (fitted, held) = split(vec![folder.path().to_owned()], 4).unwrap();
        assert_eq!(held, [names[3].clone(), names[7].clone()]);
        assert!(fitted.len() == 7 && held.iter().all(|name| !fitted.contains(name)));
        let (fitted, held) = split(names[..7].to_vec(), 4).unwrap();
        assert!(fitted == names[..7] && held.is_empty(), "seven logs are too few to spare any");
        let whole = vec![folder.path().to_owned()];
        assert_eq!(split(whole.clone(), 0).unwrap(), (whole, Vec::new()));
    }
}
