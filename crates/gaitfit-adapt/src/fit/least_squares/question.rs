//! Questions to simulated logs for a correction, and their answers. Each set of logs answers alone, so that any process
//! with the same robot can answer.

use super::around;
use super::normal::{Loss, Normal};
use super::residuals::Problem;
use super::uncertainty::RIDGE;
use crate::cost::Cost;
use crate::fit::FitError;
use crate::{Entry, SharedSimulator};
use gaitfit_sim::pool;
use serde::{Deserialize, Serialize};

/// Simulated logs, and what compares them with predictions.
pub struct Replicate {
    /// Simulates predictions of the logs, as the fit does of the real ones.
    pub simulator: Box<SharedSimulator>,
    /// The fit's cost, against the simulated logs in the scaling of the real ones.
    pub cost: Box<dyn Cost>,
}

/// The robot, simulated as it makes logs.
pub trait World {
    /// Whether a value of `entry` means the same for the simulated robot as for the fit. Values that do not are left
    /// unchanged.
    fn shares(&self, _entry: &Entry) -> bool {
        true
    }

    /// A set of logs for each of `numbers`, which select random draws: logs of the robot with `values` of θ, whose
    /// joints are disturbed by normal torques of the deviation `noise`, N·m. `Err`: why there are no logs, in a
    /// sentence.
    fn replicates(&self, values: &[f64], noise: f64, numbers: &[u32]) -> Result<Vec<Replicate>, String>;

    /// The answers of the sets of logs with these `numbers`, in order. By default the sets are made and compared here.
    ///
    /// # Errors
    /// As [`answers`].
    fn ask(
        &self,
        problem: Problem<'_>,
        question: &Question,
        numbers: &[u32],
    ) -> Result<Vec<Comparison>, Failure> {
        answers(self, problem, question, numbers)
    }
}

/// A question to simulated logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// The values of the simulated robot.
    pub simulated: Vec<f64>,
    /// Its torque noise, N·m.
    pub noise: f64,
    /// The values whose predictions are compared with its logs.
    pub values: Vec<f64>,
    /// The slope whose step is wanted; `None` if only the size of the differences is wanted.
    pub step: Option<Slope>,
}

/// How a step follows from differences.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// Loss of the differences.
    pub(super) loss: Loss,
    /// Entries that may move.
    pub(super) moving: Vec<bool>,
}

/// The answer of logs about the fitted values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// The squared median of the differences that they leave.
    pub(super) left: f64,
    /// The step that they ask for; empty if none was asked for.
    pub(super) step: Vec<f64>,
}

/// Why there is no answer.
#[derive(Debug)]
pub enum Failure {
    /// A simulation failed, or was asked to give up.
    Fit(FitError),
    /// Anything else, in a sentence.
    Said(String),
}

impl From<FitError> for Failure {
    fn from(error: FitError) -> Self {
        Self::Fit(error)
    }
}

/// Makes a set of logs for each of `numbers` and compares them as `question` asks: what [`World::ask`] does by default.
/// This function does not use the simulator and the cost of `problem`.
///
/// # Errors
/// Logs that cannot be made or compared.
pub fn answers<W: World + ?Sized>(
    world: &W,
    problem: Problem<'_>,
    question: &Question,
    numbers: &[u32],
) -> Result<Vec<Comparison>, Failure> {
    let diverged = || Failure::Said("A prediction of simulated logs diverged.".to_owned());
    let answer = |logs: &Replicate| {
        let problem = Problem { simulator: logs.simulator.as_ref(), cost: logs.cost.as_ref(), ..problem };
        // Only the size of the differences is wanted: one simulation instead of one and two for each entry.
        let Some(Slope { loss, moving }) = &question.step else {
            let residuals = problem.residuals(std::slice::from_ref(&question.values))?.pop().flatten();
            let left = residuals.map(|residuals| Loss::new(&residuals).bulk()).ok_or_else(diverged)?;
            return Ok(Comparison { left, step: Vec::new() });
        };
        let here = around(&problem, &question.values)?.ok_or_else(diverged)?;
        // The loss is that of the real logs, so that both sides weigh their differences alike.
        let normal = Normal::whole(&here.jacobian, &here.residuals, *loss, problem.simulator.threads());
        let flat = || Failure::Said("Simulated logs do not say which way values could move.".to_owned());
        let step = normal.step(RIDGE, moving).ok_or_else(flat)?;
        Ok(Comparison { left: Loss::new(&here.residuals).bulk(), step: step.as_slice().to_vec() })
    };
    let logs = world.replicates(&question.simulated, question.noise, numbers).map_err(Failure::Said)?;
    // A step simulates the values and two neighbours of each entry.
    let candidates = 2 * problem.theta.len() + 1;
    // The threads are divided: each set of logs compares with its share of them.
    let threads = logs.first().map_or(1, |logs| logs.simulator.threads());
    // Each set at work holds the differences of all its candidates, so memory limits how many work at once.
    let at_once = logs.first().map_or(1, |logs| Problem::at_once(logs.cost.as_ref(), candidates));
    let at_once = at_once.min(threads);
    pool::map_each(logs.iter(), (at_once, threads), answer).into_iter().collect()
}
