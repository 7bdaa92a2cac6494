//! Results of a loop: the one document that `--json` prints, `result.json` keeps, and table and report show.

use super::walked::Walked;
use crate::adapt::AdaptResults;
use crate::evaluate::{Comparison, Evaluation};
use crate::train;
use gaitfit_view::{Doubt, DoubtKind};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// The result of a loop.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// Name of the run.
    pub name: String,
    /// Robot name.
    pub robot: String,
    /// The target in a few words; absent where it cannot be run from here.
    pub target: Option<String>,
    /// The repetitions.
    pub rounds: Vec<RoundResult>,
    /// Every policy in every simulator it was measured in, the same commands for all.
    pub evaluations: Vec<Measurement>,
    /// The best policy beside the others, where all were measured: on the target, or else in the last adapted simulator.
    #[serde(default)]
    pub comparisons: Vec<Comparison>,
    /// Results of the robot's own sensors for the policies that walked on it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub walked: Vec<Walked>,
    /// Gain of the fit over training without logs, in a sentence; absent without such policies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bought: Option<String>,
    /// Name of the policy it began with.
    pub before: String,
    /// Name of the best policy it found.
    pub after: String,
    /// That policy's file.
    pub policy: String,
    /// That policy's ONNX file.
    pub onnx: String,
    /// Why there was no further round.
    pub stopped_because: String,
    /// Next step, if the user has to take it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
    /// Why the robot was not there, as the programs reported it that were to find it; absent if it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub absent_because: Option<String>,
    /// Why the fit that the best policy was trained in must not be taken as it stands, the worst first.
    #[serde(default)]
    pub doubts: Vec<Doubt>,
    /// What to know before trusting the numbers, the most important first.
    pub warnings: Vec<String>,
    /// Where the files are.
    pub run_folder: String,
    /// Wall time of all stages, over all sessions, s.
    pub wall_seconds: f64,
    /// Wall time by stage, s.
    pub stage_seconds: IndexMap<String, f64>,
}

/// One repetition.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RoundResult {
    /// Its number, from 1.
    pub round: u32,
    /// The policy that walked.
    pub before: String,
    /// The policy that came out.
    pub after: String,
    /// The fit.
    pub adapt: AdaptResults,
    /// The file of the parameters that the policy was trained with: those of the fit, unless `fallback` says otherwise.
    pub theta: String,
    /// Why the policy was trained in another simulator than the fit's, and in which; absent if it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fallback: Option<String>,
    /// The training.
    pub finetune: train::Results,
    /// The seed of it whose policy was taken; absent in results of earlier versions.
    #[serde(default)]
    pub seed: Option<u64>,
}

/// One policy in one simulator.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measurement {
    /// Where it was measured: [`TARGET`], or the adapted simulator of a round.
    pub on: String,
    /// What was measured.
    #[serde(flatten)]
    pub evaluation: Evaluation,
}

/// [`Measurement::on`] of the target.
pub const TARGET: &str = "target";
/// Name of a policy that was fine-tuned in the true simulator.
pub const REFERENCE: &str = "fine-tuned on the target";

/// Note on what intervals of comparisons do not cover.
pub const ONE_TRAINING: &str = "Intervals cover the trajectories. Each policy was trained once; another training seed \
                                would change the result too.";
/// Name of the policy that was fine-tuned in the simulator of the robot's file.
pub const NOMINAL: &str = "fine-tuned, nominal";
/// Name of the policy that was fine-tuned in simulators that differ at random.
pub const RANDOMISED: &str = "fine-tuned, randomised";
/// Name of the policy that was fine-tuned in fitted simulators, each with other numbers of the joint intervals.
pub const DRAWN: &str = "fine-tuned, draws of the fit";
/// Name of the policy that was fine-tuned in the simulator of the robot's known numbers.
pub const KNOWN: &str = "fine-tuned, known numbers";

/// [`Measurement::on`] of a round's fitted simulator; of `rounds` in all.
pub fn adapted(round: u32, rounds: u32) -> String {
    if rounds == 1 { "adapted".to_owned() } else { format!("adapted, round {round}") }
}

/// Name of the policy after so many rounds.
pub fn policy_name(round: u32) -> String {
    let digits = round.to_string();
    // Subscripts: U+2080 is ₀.
    let below = digits.chars().filter_map(|digit| char::from_u32(0x2080 + digit.to_digit(10)?));
    format!("π{}", below.collect::<String>())
}

impl Measurement {
    /// Without what single trajectories did.
    pub fn summary(mut self) -> Self {
        // Thousands of rows, which would fill the printed document.
        self.evaluation.errors = Vec::new();
        self
    }
}

impl Results {
    /// States that robots diverged while a policy was measured, in sentences; `None` if none did.
    pub fn divergence(&self) -> Option<String> {
        divergence(&self.evaluations)
    }

    /// The round that trained the best policy; without such a round the last one.
    pub fn best_round(&self) -> Option<&RoundResult> {
        self.rounds.iter().find(|round| round.after == self.after).or_else(|| self.rounds.last())
    }

    /// States that the best policy was not trained in its round's fit, and why; `None` if it was.
    pub fn fallback(&self) -> Option<String> {
        let round = self.best_round()?;
        round.fallback.as_ref().map(|why| format!("round {}: {why}", round.round))
    }

    /// Doubt that the policies were measured, but not on the robot; `None` if they were.
    pub fn absence(&self) -> Option<Doubt> {
        // Without any measurement there is nothing that stands in for the robot.
        if self.evaluations.is_empty() || self.evaluations.iter().any(|one| one.on == TARGET) {
            return None;
        }
        let text = format!(
            "The policies walked in the fitted simulator, in which {} was trained. {}",
            self.after,
            self.next.as_deref().unwrap_or_default()
        );
        let details = self.absent_because.as_deref().unwrap_or_default();
        Some(Doubt::new(DoubtKind::RobotAbsent, text.trim_end()).with_details(details))
    }

    /// Evaluation of a policy in a simulator.
    pub fn measured(&self, policy: &str, on: &str) -> Option<&Evaluation> {
        let measurement = self.evaluations.iter().find(|one| one.on == on && one.evaluation.policy == policy);
        measurement.map(|one| &one.evaluation)
    }
}

/// See [`Results::divergence`].
pub(super) fn divergence(evaluations: &[Measurement]) -> Option<String> {
    let note = |one: &Measurement| {
        let divergence = one.evaluation.divergence()?;
        Some(format!("{} on {}: {divergence}", one.evaluation.policy, one.on))
    };
    let divergences: Vec<String> = evaluations.iter().filter_map(note).collect();
    (!divergences.is_empty()).then(|| divergences.join(". "))
}

/// Sum of both tracking errors, m/s and rad/s.
pub fn tracking_error(evaluation: &Evaluation) -> f64 {
    evaluation.linear_velocity_error.mean + evaluation.angular_velocity_error.mean
}
