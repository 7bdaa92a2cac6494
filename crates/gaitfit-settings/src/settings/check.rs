//! Settings of `gaitfit fit` that do not go together, and what they mean to the optimiser.

use super::{AdaptConfig, Base, MIN_STRETCH_S};
use crate::Error;
use gaitfit_adapt::fit::{FallPenalty, FitOptions, Method};
use gaitfit_adapt::{NetworkStart, RobotNumber, RobotRule};
use gaitfit_log::PerJoint;
use gaitfit_model::{shown, shown_number};
use gaitfit_physics::JointParameter;
use std::path::Path;

/// Largest seed: whole numbers of TOML go no further.
pub const MAX_SEED: u64 = i64::MAX as u64;

/// Largest `simulation.starts`.
const MAX_STARTS: usize = 64;
/// Largest `simulation.timestep`, s.
const MAX_TIMESTEP_S: f64 = 0.02;

/// Whether settings break a rule, and what the rule says.
type Rule = (fn(&AdaptConfig) -> bool, &'static str);

/// Rules for the settings of a fit. The first broken rule is printed, so what a later rule needs comes first.
const RULES: &[Rule] = &[
    (
        |config| !walks(config) && config.robot.is_empty(),
        "`robot` names no robot file; if the robot walked, add base = \"free\" and `policy`",
    ),
    (|config| config.logs.is_empty(), "`logs` names no log to fit"),
    (
        // A later rule reads the first cost, so there must be one.
        |config| config.costs.is_empty(),
        "`costs` names no cost; take for example \"wass\" for walks or \"matcho\" for legs in the air (docs/costs.md)",
    ),
    (
        // Metrics and results tell costs apart by their names.
        |config| (1..config.costs.len()).any(|index| config.costs[..index].contains(&config.costs[index])),
        "`costs` names one cost twice",
    ),
    (
        |config| !walks(config) && config.costs.iter().any(|cost| cost.is_privileged()),
        "a cost in `costs` resets the base, and base = \"fixed\" has none to reset; take \"matcho\" or \
         \"wass\", or if the robot walked add base = \"free\" and `policy`",
    ),
    (
        |config| !walks(config) && config.costs.iter().any(|cost| cost.needs_imu()),
        "\"matchr…\" is for walking logs; if the robot walked, add base = \"free\" and `policy`; a \
         clamped robot's whole logs can be compared: take \"matcho\"",
    ),
    (
        |config| {
            config.costs.iter().any(|cost| cost.needs_imu())
                && config.number.iter().any(|rule| rule.kind == RobotNumber::TorqueNoise)
        },
        "[[number]] torque_noise cannot be estimated with \"matchr…\": noise only makes predictions \
         worse; leave it out",
    ),
    (
        |config| !walks(config) && config.simulation.robot_timestep.is_some(),
        "`simulation.robot_timestep` is for walking logs; add base = \"free\" if the robot walked: \
         replays of a clamped robot do not depend on the step to first order",
    ),
    (
        |config| config.simulation.robot_timestep.is_some_and(|step| !not_negative(step)),
        "`simulation.robot_timestep` must be at least 0 s",
    ),
    (
        |config| has_play(config) && config.optimizer.method == Method::LeastSquares,
        "least squares do not find `play`: a joint crosses it or does not, which derivatives do not \
         foresee. Set optimizer.method = \"cma-es\", with 500 generations or more",
    ),
    (
        |config| !walks(config) && config.policy.is_some(),
        "`policy` is for walking logs; add base = \"free\" if the robot walked",
    ),
    (
        |config| !(walks(config) || config.network.is_empty() && config.number.iter().all(of_joints)),
        "[[network]] and [[number]] (except velocity_lag) are for walking logs; add base = \"free\" if \
         the robot walked",
    ),
    (
        |config| walks(config) && config.policy.is_none(),
        "base = \"free\" needs `policy`, the file of the policy that walked",
    ),
    (
        |config| walks(config) && !config.validate_gains.is_empty(),
        "`validate_gains` are for logs of a clamped robot; the policy's file states the gains of a \
         walking one",
    ),
    (
        |config| {
            config.falls.margin_seconds.is_some_and(|margin| !not_negative(margin))
                || config.falls.penalty.is_some_and(|price| !not_negative(price))
        },
        "`falls.margin_seconds` and `falls.penalty` must be finite and at least 0",
    ),
    // Ranges of the search, of the simulation and of the checks.
    (|config| config.optimizer.generations == 0, "`optimizer.generations` must be at least 1"),
    (
        |config| config.optimizer.seeds > 1000,
        "`optimizer.seeds` must be 0 to 1000; 0 means three on a GPU and one on the CPU",
    ),
    (
        |config| {
            config
                .optimizer
                .seed
                .checked_add(config.optimizer.seeds as u64)
                .is_none_or(|last| last > MAX_SEED)
        },
        "`optimizer.seed`, and with it the last of `optimizer.seeds` seeds, must be below 2^63",
    ),
    (
        // One candidate has no spread from which a distribution could be learnt.
        |config| config.optimizer.population == 1 || config.optimizer.population > 10_000,
        "`optimizer.population` must be 0 (chosen by the number of parameters) or 2 to 10000",
    ),
    (
        |config| config.optimizer.replicates > 100,
        "`optimizer.replicates` must be 0 (no correction by simulated logs) to 100",
    ),
    (|config| !not_negative(config.optimizer.prior_weight), "`optimizer.prior_weight` must be at least 0"),
    (
        // Twenty restarts already end with a million times the population.
        |config| config.optimizer.restarts > 20,
        "`optimizer.restarts` must be 0 to 20: each doubles the population",
    ),
    (
        // The tolerance is relative to the first deviation, so a search with 1 would end at once.
        |config| !not_negative(config.optimizer.tolerance) || config.optimizer.tolerance >= 1.0,
        "`optimizer.tolerance` must be at least 0 and below 1",
    ),
    (|config| !not_negative(config.optimizer.max_seconds), "`optimizer.max_seconds` must be at least 0"),
    (|config| !not_negative(config.checkpoint_seconds), "`checkpoint_seconds` must be at least 0"),
    (
        |config| !config.simulation.timestep.is_finite() || config.simulation.timestep < 1e-6,
        "`simulation.timestep` must be at least 1e-6 s",
    ),
    (
        |config| config.simulation.timestep > MAX_TIMESTEP_S,
        "`simulation.timestep` must be at most 0.02 s: joints under PD control shake in longer physics \
         steps",
    ),
    (|config| !(1..=MAX_STARTS).contains(&config.simulation.starts), "`simulation.starts` must be 1 to 64"),
    (
        |config| !walks(config) && config.simulation.starts > 1,
        "`simulation.starts` is for walking logs; add base = \"free\" if the robot walked",
    ),
    (|config| !not_negative(config.skip_seconds()), "`simulation.skip_seconds` must be at least 0"),
    (
        |config| {
            config.simulation.horizon_seconds != 0.0
                && !(config.simulation.horizon_seconds >= MIN_STRETCH_S
                    && config.simulation.horizon_seconds.is_finite())
        },
        "`simulation.horizon_seconds` must be 0 (whole logs) or at least 1",
    ),
    (
        |config| !walks(config) && config.simulation.horizon_seconds != 0.0,
        "`simulation.horizon_seconds` is for walking logs; add base = \"free\" if the robot walked",
    ),
    (|config| config.runs.is_empty(), "`runs` names no folder; \".\" is the current one"),
    (
        |config| {
            [config.check.cost, config.check.validation_cost, config.check.rmse_rad]
                .into_iter()
                .flatten()
                .any(|limit| !not_negative(limit))
        },
        "`check.cost`, `check.validation_cost` and `check.rmse_rad` must be at least 0",
    ),
    (
        |config| {
            config.check.rmse_rad.or(config.check.validation_cost).is_some() && config.validate.is_empty()
        },
        "`check.rmse_rad` and `check.validation_cost` need logs in `validate`",
    ),
    (
        |config| {
            config.check.rmse_rad.is_some()
                && walks(config)
                && !config.costs.iter().any(|cost| cost.is_aligned())
        },
        "`check.rmse_rad` compares samples one by one, which \"wass\" does not; check the cost, or add \
         \"matcho\" to `costs`",
    ),
    (
        // The check ends at the first broken rule, so `costs` is not empty here.
        |config| config.check.validation_cost.is_some() && config.costs[0].is_privileged(),
        "`check.validation_cost` is of simulations that run freely, and the first cost resets them; put \
         \"wass\" or \"matcho\" first",
    ),
];

/// Refuses settings out of range, and those that a kind of log does not have.
pub fn check(config: &AdaptConfig, path: &Path) -> Result<(), Error> {
    let broken = || RULES.iter().find(|(broken, _)| broken(config)).map(|&(_, rule)| rule.to_owned());
    match wrong_gains(config).or_else(|| wrong_known(config)).or_else(broken) {
        Some(wrong) => Err(refused(path, &wrong)),
        None => Ok(()),
    }
}

/// Whether the logs are of a robot that walked.
fn walks(config: &AdaptConfig) -> bool {
    config.base == Base::Free
}

fn not_negative(value: f64) -> bool {
    value.is_finite() && value >= 0.0
}

fn refused(path: &Path, wrong: &str) -> Error {
    Error::settings(format!("{}: {wrong}. `gaitfit config` shows every setting.", path.display()))
}

/// A gain that cannot be, also one that no log needs.
fn wrong_gains(config: &AdaptConfig) -> Option<String> {
    let stated = [("gains.kp".to_owned(), &config.gains.kp), ("gains.kd".to_owned(), &config.gains.kd)];
    let of_files = config.validate_gains.iter().enumerate().flat_map(|(number, gains)| {
        let name = |key: &str| format!("validate_gains.{number}.{key}");
        [(name("kp"), &gains.kp), (name("kd"), &gains.kd)]
    });
    stated.into_iter().chain(of_files).find_map(|(name, gains)| {
        let values: Vec<f64> = match gains.as_ref()? {
            PerJoint::All(value) => vec![*value],
            PerJoint::List(values) => values.clone(),
            PerJoint::Named(entries) => entries.values().copied().collect(),
        };
        let wrong = values.into_iter().find(|value| !(value.is_finite() && *value >= 0.0))?;
        Some(format!("`{name}` has {}; gains are finite and not negative", shown_number(wrong)))
    })
}

/// A true or published value that is none.
fn wrong_known(config: &AdaptConfig) -> Option<String> {
    let truth = config.truth.iter().map(|(name, value)| (format!("truth.{name}"), *value));
    let published = config.published.iter().flat_map(|(name, ends)| {
        ends.iter().enumerate().map(move |(end, value)| (format!("published.{name}.{end}"), *value))
    });
    let (name, value) = truth.chain(published).find(|(_, value)| !value.is_finite())?;
    Some(format!("`{}` is {value}; give a finite number, or leave it out", shown(&name)))
}

/// Settings of the fit; the robot falls in the part `robot_rate` of the logs, as `robot_falls` falls show.
pub fn options(config: &AdaptConfig, robot_rate: f64, robot_falls: usize) -> FitOptions {
    let optimizer = &config.optimizer;
    FitOptions {
        method: method(config),
        population: optimizer.population,
        generations: optimizer.generations,
        restarts: optimizer.restarts,
        // 0 seeds means that the device chooses. Without a device yet there is one. A rule above keeps the
        // sum within range.
        seeds: (0..optimizer.seeds.max(1) as u64).map(|offset| optimizer.seed + offset).collect(),
        covariance: optimizer.covariance,
        bounds: optimizer.bounds,
        patience: optimizer.patience,
        tolerance: optimizer.tolerance,
        falls: FallPenalty {
            penalty: config.falls.penalty,
            robot_rate,
            robot_falls,
            ..FallPenalty::default()
        },
        random_numbers: optimizer.random_numbers,
    }
}

/// Whether a number of the whole robot shows in the joints of a clamped one.
fn of_joints(rule: &RobotRule) -> bool {
    rule.kind == RobotNumber::VelocityLag
}

/// Whether play is searched in logs of legs in the air.
fn has_play(config: &AdaptConfig) -> bool {
    config.base == Base::Fixed && config.parameter.iter().any(|rule| rule.kind == JointParameter::Play)
}

/// Returns the search's method. Networks whose hidden weights are searched begin where no derivative shows a
/// way; in replays of legs in the air a joint crosses its play or does not, which derivatives do not foresee.
fn method(config: &AdaptConfig) -> Method {
    let hidden = config.network.iter().any(|rule| rule.start != NetworkStart::Features);
    if (hidden || has_play(config)) && config.optimizer.method == Method::Auto {
        Method::CmaEs
    } else {
        config.optimizer.method
    }
}
