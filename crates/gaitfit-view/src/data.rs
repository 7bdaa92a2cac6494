//! Data that several pages show and results keep: settings, links, doubts, estimates and drift.

use serde::{Deserialize, Deserializer, Serialize};

/// The reason why no page came out.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The page template and the data disagree: a defect of this crate, not of the data.
    #[error("the report page could not be filled in ({0}); report this with the run's metrics file")]
    Template(Box<dyn std::error::Error + Send + Sync>),
}

/// A name and what it was set to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Setting {
    /// Name, dotted as in the configuration file.
    pub name: String,
    /// Value as text.
    pub value: String,
}

/// A file to look at.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Link {
    /// Text of the link.
    pub text: String,
    /// A relative path with `/` between its parts, e.g. `seed-1/replay.html`. Anything that leads elsewhere (a
    /// scheme, an absolute path, `..`) is shown as text only.
    pub path: String,
}

/// A reason for not trusting a result. A page says its doubts first, in large print, before any number.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Doubt {
    /// Kind of the problem.
    pub kind: DoubtKind,
    /// The evidence, in a sentence or two; empty: what the kind means in general.
    #[serde(default)]
    pub text: String,
    /// Details for whoever mends it, e.g. a program's error message; a page folds them away.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub details: String,
}

/// Problems of a result, in the order in which pages say them: what it was measured on, then the worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DoubtKind {
    /// The robot was not there: what it was to be asked was asked of its fitted simulator.
    RobotAbsent,
    /// Simulations did not come to their end.
    Diverged,
    /// The training left the policy as it was.
    Untrained,
    /// The training did not yet teach the robot to walk.
    NotLearnt,
    /// The robot falls, or does not go where it is told.
    NoWalk,
    /// A guess that needs no simulator predicts the logs better.
    Trivial,
    /// Simulated robots fall in logs that were not fitted, where the robot walks.
    Falls,
    /// The result is farther from the robot than what it began with.
    WorseThanNominal,
    /// The result is much farther from the robot than the robot is from itself.
    Misfit,
    /// Errors of the result go with what the robot does: the simulator lacks something.
    Unexplained,
    /// Parts of the data give different values, by more than their errors.
    Disagreement,
    /// The search or the training was still changing when it ended.
    NotConverged,
    /// Nothing but this project's own simulator judged the result.
    OwnSimulatorOnly,
}

impl Doubt {
    /// A doubt with its evidence.
    pub fn new(kind: DoubtKind, text: impl Into<String>) -> Doubt {
        Doubt { kind, text: text.into(), details: String::new() }
    }

    /// Adds details that a page folds away.
    #[must_use]
    pub fn with_details(self, details: impl Into<String>) -> Doubt {
        Doubt { details: details.into(), ..self }
    }
}

impl DoubtKind {
    /// The doubt in a few words, as pages and tables print it.
    pub fn headline(self) -> &'static str {
        match self {
            DoubtKind::RobotAbsent => "Not measured on the robot",
            DoubtKind::Diverged => "Diverged",
            DoubtKind::Untrained => "Not trained",
            DoubtKind::NotLearnt => "Has not learnt to walk yet",
            DoubtKind::NoWalk => "Does not walk",
            DoubtKind::Trivial => "Worse than a guess",
            DoubtKind::Falls => "Falls where the robot walks",
            DoubtKind::WorseThanNominal => "Worse than the nominal robot",
            DoubtKind::Misfit => "Misfit",
            DoubtKind::Unexplained => "The model lacks something",
            DoubtKind::Disagreement => "Parts of the data disagree",
            DoubtKind::NotConverged => "Not converged",
            DoubtKind::OwnSimulatorOnly => "Measured in gaitfit's own simulator only",
        }
    }

    /// Returns its meaning, for doubts that bring no evidence.
    pub fn meaning(self) -> &'static str {
        match self {
            DoubtKind::RobotAbsent => {
                "The robot was absent. The policies walked in the fitted simulator, which shows little about the robot."
            }
            DoubtKind::Diverged => {
                "Some simulations did not finish. The numbers below leave them out or count them as falls."
            }
            DoubtKind::Untrained => "The policy is the one that the training began with.",
            DoubtKind::NotLearnt => "The policy falls, or stands when it must walk. Train longer.",
            DoubtKind::NoWalk => "The robot falls, or stands when it must walk.",
            DoubtKind::Trivial => {
                "A guess that needs no simulator predicts the logs better. Do not use this fit."
            }
            DoubtKind::Falls => "The fitted robot falls where the real one walks. Do not use this fit.",
            DoubtKind::WorseThanNominal => {
                "The robot file without any fit is closer to the logs. Do not use this fit."
            }
            DoubtKind::Misfit => {
                "The simulator does not explain the logs. The fitted values compensate for what the simulator lacks: \
                 fit further parameters."
            }
            DoubtKind::Unexplained => {
                "The remaining errors depend on the motion. The values compensate for what the simulator lacks, and \
                 their intervals are too narrow: fit further parameters."
            }
            DoubtKind::Disagreement => {
                "Parts of the data give values that differ by more than their errors: the simulator lacks something."
            }
            DoubtKind::NotConverged => {
                "The search was still changing the values when it ended. They can be far from the best ones: \
                 give it more generations."
            }
            DoubtKind::OwnSimulatorOnly => {
                "Neither a robot nor another simulator judged this result. A simulator does not see its own errors."
            }
        }
    }

    /// Whether the result is of no use, rather than in need of another test.
    pub fn is_severe(self) -> bool {
        self != DoubtKind::OwnSimulatorOnly
    }
}

/// A mean and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Estimate {
    /// The mean.
    #[serde(deserialize_with = "null_is_nan")]
    pub mean: f64,
    /// Half-width of the mean's 95 % confidence interval.
    #[serde(deserialize_with = "null_is_nan")]
    pub ci95: f64,
}

/// JSON has `null` for NaN, which `serde_json` writes and does not read back.
fn null_is_nan<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::NAN))
}

impl Default for Estimate {
    fn default() -> Self {
        Estimate { mean: f64::NAN, ci95: f64::NAN }
    }
}

/// Stand, one constant command, stand: where the robot ends, compared with where the command leads.
#[derive(Clone, Debug, PartialEq)]
pub struct Drift {
    /// The command in words, e.g. `+x 0.5 m/s`.
    pub name: String,
    /// Forward and left (m/s), yaw rate (rad/s).
    pub command: [f64; 3],
    /// Trials averaged.
    pub trials: u32,
    /// Trials that ended in a fall.
    pub falls: u32,
    /// Mean final error in x (m), y (m), yaw (rad), in the frame of the start.
    pub error: [f64; 3],
    /// Half the width of the 95 % interval of each mean; NaN with one trial.
    pub ci95: [f64; 3],
    /// Base positions x, y of one trial over time, m, in the frame of the start.
    pub path: Vec<[f64; 2]>,
    /// Where the command leads, in the same frame.
    pub intended: Vec<[f64; 2]>,
}

impl Default for Drift {
    fn default() -> Self {
        Drift {
            name: String::new(),
            command: [f64::NAN; 3],
            trials: 0,
            falls: 0,
            error: [f64::NAN; 3],
            ci95: [f64::NAN; 3],
            path: Vec::new(),
            intended: Vec::new(),
        }
    }
}
