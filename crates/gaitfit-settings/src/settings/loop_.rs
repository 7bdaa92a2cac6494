//! The configuration of `gaitfit loop`: its settings and their defaults. `gaitfit config loop` prints them.

use super::finetune::FINETUNE_DEFAULTS;
use super::load::{Configuration, merge, taken};
use super::target::{TargetConfig, TargetKind};
use super::walking;
use super::{AdaptConfig, Base, ControlsConfig, FinetuneConfig, Preset, check};
use gaitfit_adapt::fit::Method;
use serde::{Deserialize, Deserializer, Serialize};
use std::borrow::Cow;
use std::path::Path;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table};

use crate::Error;

/// Max number of robots of a drift trial.
pub const MAX_DRIFT: usize = 100_000;

/// The defaults, as `gaitfit config loop` prints them.
pub const LOOP_DEFAULTS: &str = include_str!("loop.toml");

/// All settings of one loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoopConfig {
    /// Name of the run and of its folder; the configuration file's stem when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The policy that walks.
    pub policy: String,
    /// Robot file (MJCF or URDF); the built-in Go2 when empty.
    pub robot: String,
    /// Drop what the engine cannot simulate in the robot file instead of refusing it.
    pub lenient: bool,
    /// Folder that holds the run folders.
    pub runs: String,
    /// Logs of the first round; the target's when empty.
    pub logs: Vec<String>,
    /// One log of so many is not fitted but shows how well the fit predicts; 0: all are fitted.
    pub held_out: usize,
    /// Most rounds.
    pub rounds: u32,
    /// Share by which a round must lower the tracking error for a further one to begin.
    pub improvement: f64,
    /// Whether a policy is fine-tuned in the true simulator too.
    pub references: bool,
    /// What else it is fine-tuned in, to compare.
    pub controls: ControlsConfig,
    /// Seconds between checkpoints.
    pub checkpoint_seconds: f64,
    /// The robot, if it can be run from here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<TargetConfig>,
    /// What is fitted, and how.
    pub adapt: AdaptConfig,
    /// Training in the fitted simulator.
    pub finetune: FinetuneConfig,
    /// What is measured.
    pub evaluate: EvaluateConfig,
    /// Never there.
    #[serde(default, skip_serializing)]
    decided: Decided,
}

/// Refuses a setting that the loop decides itself; it stands for the setting's name.
#[derive(Clone, Debug, Default, PartialEq)]
struct Decided;

impl<'de> Deserialize<'de> for Decided {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Err(serde::de::Error::custom(format!("`{name}` cannot be set: the loop decides it")))
    }
}

/// How policies are measured: in a loop, and by `gaitfit.evaluate` as its `config`. Their defaults differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluateConfig {
    /// Trajectories with random commands.
    pub trajectories: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// Robots in each constant-command trial; 0 leaves them out.
    pub drift: usize,
    /// Speeds of these: ahead and to the side, m/s, and turning, rad/s; half of the task's greatest commands when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drift_speeds: Option<[f64; 3]>,
    /// Seed of commands, starts and noise.
    pub seed: u64,
    /// Solver effort in the simulator.
    #[serde(with = "super::preset")]
    pub preset: Preset,
}

/// Settings that do not change what a stage does.
pub const FREE: [&str; 8] = [
    "name",
    "runs",
    "rounds",
    "checkpoint_seconds",
    "target.timeout_seconds",
    "target.interface",
    "target.patience",
    "target.yes",
];

/// Search of a loop whose cost is not that of its defaults.
const SHORT: &str = "optimizer = { generations = 100, seeds = 2 }";

/// Settings of `[adapt]` and `[finetune]` that the loop decides.
const DECIDED: [(&str, &[&str]); 2] = [
    (
        "adapt",
        &[
            "name",
            "robot",
            "lenient",
            "base",
            "policy",
            "known",
            "logs",
            "validate",
            "validate_gains",
            "check",
            "runs",
            "checkpoint_seconds",
        ],
    ),
    (
        "finetune",
        &[
            "name",
            "policy",
            "policy_sha256",
            "theta",
            "theta_sha256",
            "robot",
            "lenient",
            "spring",
            "torque_noise",
            "runs",
            "checkpoint_seconds",
        ],
    ),
];

impl Configuration for LoopConfig {
    const PRINTED_BY: &'static str = "gaitfit config loop";
    const EXAMPLE: &'static str = "adapt.optimizer.generations=50";

    /// Lays the settings upon the defaults. A setting that the loop decides itself is put in their place, so that it is
    /// refused when the table is read.
    fn complete(table: &mut DeTable<'_>) {
        // Taken out, because `table` is built anew from the defaults with the given settings upon them.
        let given = std::mem::take(table);
        for (section, keys) in DECIDED {
            let Some(DeValue::Table(inner)) = given.get(section).map(Spanned::get_ref) else { continue };
            if let Some((key, _)) = inner.iter().find(|(key, _)| keys.contains(&key.get_ref().as_ref())) {
                let name = Cow::Owned(format!("{section}.{}", key.get_ref()));
                let name = Spanned::new(key.span(), DeValue::String(name));
                // With the place of the key in the file, for the message of [`Decided`].
                let key = Spanned::new(key.span(), Cow::Borrowed("decided"));
                *table = DeTable::from_iter([(key, name)]);
                return;
            }
        }
        // The text is a part of the program and is read by a test, so parsing it does not fail.
        let mut defaults = DeTable::parse(LOOP_DEFAULTS).map(Spanned::into_inner).unwrap_or_default();
        // Of a simulated target the loop knows the period of the motor boards; logs do not state it.
        let logs = given.get("logs").map(Spanned::get_ref);
        let has_logs = matches!(logs, Some(DeValue::Array(logs)) if !logs.is_empty());
        if let Some(DeValue::Table(fitted)) =
            defaults.get_mut("adapt").map(Spanned::get_mut).filter(|_| has_logs)
        {
            walking::set_motor_board_period(fitted);
        }
        if let (Some(DeValue::Table(fitted)), Some(DeValue::Table(given))) =
            (defaults.get_mut("adapt").map(Spanned::get_mut), given.get("adapt").map(Spanned::get_ref))
        {
            let distributions = walking::searches_distributions(given);
            // As in a fit: whoever chooses the parameters or the cost does not get the defaults of the
            // others.
            walking::trim(fitted, given);
            // The user's groups replace the default ones; they are not added to them.
            if given.contains_key("groups") {
                fitted.remove("groups");
            }
            if !distributions {
                let short = DeTable::parse(SHORT).map(Spanned::into_inner).unwrap_or_default();
                merge(fitted, short);
            }
        }
        // The loop's own table of fine-tuning lies upon the defaults of fine-tuning, because it names only what
        // differs.
        if let Some(finetune) = defaults.get_mut("finetune") {
            let mut whole = DeTable::parse(FINETUNE_DEFAULTS).map(Spanned::into_inner).unwrap_or_default();
            let span = finetune.span();
            if let DeValue::Table(changes) = taken(finetune.get_mut()) {
                merge(&mut whole, changes);
            }
            *finetune = Spanned::new(span, DeValue::Table(whole));
        }
        merge(&mut defaults, given);
        *table = defaults;
    }
}

impl LoopConfig {
    /// Refuses settings out of range, and those that do not go together.
    pub fn check(&self, path: &Path) -> Result<(), Error> {
        let evaluate = &self.evaluate;
        let length = |seconds: f64| seconds > 0.0 && seconds <= 3600.0;
        let wrong = if self.policy.is_empty() {
            "`policy` names no policy; give the file of the policy that walks".to_owned()
        } else if self.logs.is_empty() && self.target.is_none() {
            "there are neither `logs` of a robot nor a [target] to record them on".to_owned()
        } else if self.logs.is_empty()
            && self
                .target
                .as_ref()
                .is_some_and(|target| target.kind == TargetKind::Command && !target.probe.is_empty())
        {
            "`target.probe` lets a loop continue without the robot, which needs `logs` to fit; leave it out if the \
             robot must be there"
                .to_owned()
        } else if self.held_out == 1 || self.held_out > 1000 {
            // With 1, every log would be held out and none fitted.
            "`held_out` must be 0 (all logs are fitted) or 2 to 1000 (one log of so many is not)".to_owned()
        } else if self.rounds == 0 || self.rounds > 100 {
            "`rounds` must be 1 to 100".to_owned()
        } else if self.rounds > 1 && self.target.is_none() {
            "`rounds` above 1 needs a [target]: without one, record the logs of the next round by hand"
                .to_owned()
        } else if !(0.0..1.0).contains(&self.improvement) {
            // A share of 1 would ask for a policy without any error.
            "`improvement` must be at least 0 and below 1".to_owned()
        } else if self.runs.is_empty() {
            "`runs` names no folder; \".\" is the current one".to_owned()
        } else if !(self.checkpoint_seconds >= 0.0 && self.checkpoint_seconds.is_finite()) {
            "`checkpoint_seconds` must be at least 0".to_owned()
        } else if self.finetune.seeds.is_empty() {
            "`finetune.seeds` is empty; give one or more".to_owned()
        } else if evaluate.trajectories == 0 || evaluate.trajectories > 10_000_000 {
            "`evaluate.trajectories` must be 1 to 10000000".to_owned()
        } else if evaluate.drift > MAX_DRIFT {
            format!("`evaluate.drift` must be at most {MAX_DRIFT} robots")
        } else if !length(evaluate.seconds) {
            "`evaluate.seconds` must be above 0 and at most 3600".to_owned()
        } else if let Some(wrong) = self.target.as_ref().and_then(TargetConfig::wrong) {
            wrong
        } else if evaluate.drift_speeds.is_some()
            && self.target.as_ref().is_some_and(TargetConfig::has_no_drift_speeds)
        {
            "`evaluate.drift_speeds` is set, and `target.evaluate` has no {drift_speeds} for them; add it, or leave the \
             setting out"
                .to_owned()
        } else if let Some(wrong) = self.controls.wrong() {
            wrong
        } else if (self.controls.draws || self.finetune.randomise_theta) && !self.has_draws() {
            "`controls.draws` and `finetune.randomise_theta` draw from the joint intervals of least squares: fit the cost \
             `matchr1` first, without `optimizer.method = \"cma-es\"`, or set them to false"
                .to_owned()
        } else {
            return self.check_adapt(path);
        };
        Err(Error::settings(format!(
            "{}: {wrong}. `gaitfit config loop` shows every setting.",
            path.display()
        )))
    }

    /// Whether the fit finds joint intervals.
    fn has_draws(&self) -> bool {
        let (method, first) = (self.adapt.optimizer.method, self.adapt.costs.first());
        // Only least squares has joint intervals. `auto` takes it for costs of short predictions.
        method != Method::CmaEs
            && first.is_some_and(|cost| cost.needs_imu() || method == Method::LeastSquares)
    }

    /// Holds `[adapt]` to the rules of `gaitfit fit`, before there are logs.
    fn check_adapt(&self, path: &Path) -> Result<(), Error> {
        // The rules ask only whether there are a policy and a log, which no round has made yet.
        let mut adapt = self.adapt(1, String::new(), vec!["recorded.csv".to_owned()]);
        // The loop gives each round its folder; the rule against an empty name is not for it.
        adapt.runs = ".".to_owned();
        check::check(&adapt, path).map_err(|error| error.within("[adapt]"))
    }

    /// The adaptation of a round, to be written into `runs`.
    pub fn adapt(&self, round: u32, policy: String, logs: Vec<String>) -> AdaptConfig {
        let mut adapt = AdaptConfig {
            name: Some("adapt".to_owned()),
            robot: self.robot.clone(),
            lenient: self.lenient,
            base: Base::Free,
            policy: Some(policy),
            known: None,
            logs,
            validate: Vec::new(),
            validate_gains: Vec::new(),
            checkpoint_seconds: self.checkpoint_seconds,
            ..self.adapt.clone()
        };
        // Rounds draw different candidates, but not with `seeds = 0`: the device chooses their number later.
        // Rounds count from 1.
        let offset = u64::from(round - 1).saturating_mul(adapt.optimizer.seeds as u64);
        adapt.optimizer.seed = adapt.optimizer.seed.saturating_add(offset).min(check::MAX_SEED);
        adapt
    }

    /// All settings as a table that reads as themselves.
    ///
    /// # Errors
    /// A number that TOML cannot have.
    pub fn resolved(&self) -> Result<Table, toml::ser::Error> {
        let mut table = Table::try_from(self)?;
        for (section, keys) in DECIDED {
            if let Some(toml::Value::Table(inner)) = table.get_mut(section) {
                // With these keys the text would be refused when it is read again.
                inner.retain(|key, _| !keys.contains(&key));
            }
        }
        Ok(table)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::settings::load;
    use std::io::Write;

    fn read(text: &str) -> Result<LoopConfig, Error> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        load(Some(file.path()), &[])
    }

    const TARGET: &str =
        "[target]\nkind = \"simulated\"\n[[target.parameter]]\nkind = \"armature\"\nvalue = 0.1\n";

    #[test]
    fn a_loop_with_logs_has_the_defaults_of_a_fit_of_walks() {
        let step = |text: &str| read(text).unwrap().adapt.simulation.robot_timestep;
        let fit = crate::settings::walk_defaults().simulation.robot_timestep;
        assert!(fit.is_some());
        assert_eq!(step("policy = \"p\"\nlogs = [\"l\"]\n"), fit);
        assert_eq!(
            step("policy = \"p\"\nlogs = [\"l\"]\n[adapt.simulation]\nrobot_timestep = 0.002\n"),
            Some(0.002)
        );
        assert_eq!(step("policy = \"p\"\nlogs = []\n"), None, "without logs the target is a simulated robot");
        let chosen = "policy = \"p\"\nlogs = [\"l\"]\n[[adapt.parameter]]\nkind = \"armature\"\n";
        assert_eq!(step(chosen), None, "chosen parameters come without the default step");
    }

    #[test]
    fn the_printed_settings_are_the_defaults_and_complete() {
        let defaults: LoopConfig = load(None, &[]).unwrap();
        assert_eq!(read(LOOP_DEFAULTS).unwrap(), defaults);
        let printed: Table = toml::from_str(LOOP_DEFAULTS).unwrap();
        for (section, value) in defaults.resolved().unwrap() {
            let printed = printed.get(&section).unwrap_or_else(|| panic!("`{section}` is missing"));
            if section == "finetune" {
                continue;
            }
            for (key, _) in value.as_table().into_iter().flatten() {
                assert!(printed.get(key).is_some(), "`{section}.{key}` is missing");
            }
        }
        for (key, _) in Table::try_from(read(TARGET).unwrap().target.unwrap()).unwrap() {
            assert!(
                LOOP_DEFAULTS.contains(&format!("# {key} =")) || key == "parameter",
                "`target.{key}` is missing"
            );
        }
        let finetune: FinetuneConfig = load(None, &[]).unwrap();
        assert_eq!(defaults.finetune, finetune);
    }

    #[test]
    fn resolved_settings_read_as_themselves() {
        for text in ["", TARGET, "[finetune.ppo]\nclip = 0.1\n[finetune.task.rewards]\ngait = 2.0\n"] {
            let config = read(text).unwrap();
            let resolved = toml::to_string_pretty(&config.resolved().unwrap()).unwrap();
            assert_eq!(read(&resolved).unwrap(), config, "{resolved}");
        }
    }

    #[test]
    fn what_the_loop_decides_is_refused_at_its_place() {
        let error = read("[adapt]\nlogs = [\"a.csv\"]\n").unwrap_err();
        assert!(
            error.to_string().contains(":2:1:") && error.to_string().contains("the loop decides it"),
            "{error}"
        );
        let error = read("[finetune]\n\ntheta = \"t.toml\"\n").unwrap_err();
        assert!(
            error.to_string().contains(":3:1:") && error.to_string().contains("finetune.theta"),
            "{error}"
        );
        let error = read("[evaluate]\nsecs = 1.0\n").unwrap_err();
        assert!(
            error.to_string().contains(":2:1:") && error.to_string().contains("Did you mean `seconds`?"),
            "{error}"
        );
    }
}
