//! The result of a fit: values, their spread over seeds, and whether they are at their bounds.

use super::stop::Stop;
use super::{
    Alternative, Correction, FitError, Identification, MAX_SCANNED, MAX_TAKEN, NoiseSource, Problem,
    RandomNumbers, Regression, Uncertainty, Views, World, correct, identify, uncertainty,
};
use crate::cost::Cost;
use crate::{Cancel, Rollout, Simulator, Theta};
use gaitfit_sim::stats;
use serde::{Deserialize, Serialize};

/// The joint result of the runs of one cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CostOutcome {
    /// Cost name.
    pub cost: String,
    /// Cost of the parameters: the smallest of any run, or that of the corrected ones.
    pub best_cost: f64,
    /// θ of the best run, corrected or not, in the entries' order.
    pub parameters: Vec<ParameterOutcome>,
    /// The runs, in seed order.
    pub runs: Vec<RunOutcome>,
    /// Joint uncertainty of the parameters, where least squares found them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<Uncertainty>,
    /// How simulated logs moved the values, where they did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<Correction>,
    /// How simulated robots moved the values, where they did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regression: Option<Regression>,
    /// Simulations of the chosen values in the final comparison; `None` if there was none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redrawn: Option<Redrawn>,
    /// The cost of the values that simulated robots give ([`super::regress`]), if it is clearly larger than that of the
    /// search, whose values are then kept, and if robots with those values are no nearer to the logs: no simulated
    /// robot is like the real one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unlike: Option<f64>,
}

/// Simulations of the chosen values under draws that the search did not use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Redrawn {
    /// Number of simulations: draws × recordings.
    pub simulations: usize,
    /// Number of simulations in which the robot falls.
    pub falls: usize,
}

/// One entry of θ as found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterOutcome {
    /// Name.
    pub name: String,
    /// Value of the run with the smallest cost, corrected by simulated logs if [`Self::uncorrected`] is there.
    pub value: f64,
    /// The value before that correction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncorrected: Option<f64>,
    /// Unit.
    pub unit: String,
    /// Standard deviation of the runs' best values (n − 1); `None` with one run.
    pub spread: Option<f64>,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Where the search began.
    pub start: f64,
    /// Whether the value rests on a bound.
    pub at_bound: bool,
    /// Best value of each run.
    pub per_run: Vec<f64>,
    /// How well the data identify it, once [`CostOutcome::identify`] has measured that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identification: Option<Identification>,
}

impl ParameterOutcome {
    /// The longer side of the interval; absent where it was not measured.
    pub fn half(&self) -> Option<f64> {
        let identification = self.identification.as_ref()?;
        Some((self.value - identification.lower).max(identification.upper - self.value).max(0.0))
    }
}

/// The result of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunOutcome {
    /// Seed.
    pub seed: u64,
    /// Smallest cost.
    pub best_cost: f64,
    /// Its θ.
    pub values: Vec<f64>,
    /// Generations done.
    pub generations: usize,
    /// Why it ended; `None` if it was cut short.
    pub stop: Option<Stop>,
    /// Candidates whose simulation diverged.
    pub diverged: usize,
    /// Falls of candidates, over all recordings.
    #[serde(default)]
    pub falls: usize,
    /// Standard deviations of the search where it was left, in the entries' units: values between which it had not yet
    /// chosen. With restarts they are of the start that found the values, whose last ones count unless it converged.
    /// Empty of a search without restarts that came to its end, and of least squares.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub deviations: Vec<f64>,
    /// Mean of the search's distribution at its end, in the entries' units; with restarts of the start that found the
    /// values. Empty for least squares.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mean: Vec<f64>,
}

/// Values by simulated robots fit as well as those of a search if their cost is at most this many times as large, plus
/// [`AS_WELL_BY`]. A search prefers values whose cost is small by chance under its random draws; these values do not.
const AS_WELL: f64 = 1.5;
const AS_WELL_BY: f64 = 0.003;

impl CostOutcome {
    /// Puts the runs of one cost together; `None` without a run that has a finite cost.
    pub fn new(cost: String, theta: &Theta, runs: Vec<RunOutcome>) -> Option<Self> {
        // The values are those of one run, never a mean: parameters that compensate each other go together.
        let best = runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost))?;
        let parameters = theta
            .entries()
            .iter()
            .enumerate()
            .map(|(index, entry)| {
                let per_run: Vec<f64> = runs.iter().map(|run| run.values[index]).collect();
                ParameterOutcome {
                    name: entry.name.clone(),
                    value: best.values[index],
                    uncorrected: None,
                    unit: entry.unit.clone(),
                    spread: stats::deviation(&per_run),
                    lower: entry.lower,
                    upper: entry.upper,
                    start: entry.start,
                    at_bound: entry.at_bound(best.values[index]),
                    per_run,
                    identification: None,
                }
            })
            .collect();
        Some(Self {
            cost,
            best_cost: best.best_cost,
            parameters,
            runs,
            uncertainty: None,
            correction: None,
            regression: None,
            redrawn: None,
            unlike: None,
        })
    }

    /// Measures how well the data identify each parameter around the best run's values and notes it with them. `cost`
    /// is the outcome's; `alternatives` could stand in for the simulator. False, and nothing noted, if θ has more than
    /// [`MAX_SCANNED`] entries.
    ///
    /// # Errors
    /// As [`identify`].
    pub fn identify(
        &mut self,
        simulator: &dyn Simulator,
        theta: &Theta,
        cost: &dyn Cost,
        alternatives: &[Alternative<'_>],
        draw: u64,
        cancel: &Cancel<'_>,
    ) -> Result<bool, FitError> {
        if theta.len() > MAX_SCANNED {
            return Ok(false);
        }
        let identifications = identify(simulator, theta, cost, &self.values(), alternatives, draw, cancel)?;
        for (parameter, identification) in self.parameters.iter_mut().zip(identifications) {
            parameter.identification = Some(identification);
        }
        Ok(true)
    }

    /// Widens the intervals to all of `others` that fit as well: whose costs are at most `error` above the smallest. If
    /// a cost has many minima, the curvature at one of them shows too little of what the logs leave open. If a search
    /// was stopped before its end, the intervals also reach two of its deviations to both sides. `others`: costs and
    /// values that the search tried.
    pub fn widen<'a>(&mut self, theta: &Theta, others: impl Iterator<Item = (f64, &'a [f64])>, error: f64) {
        // The smallest cost of the search itself: `best_cost` may be that of corrected values.
        let best = self.runs.iter().map(|run| run.best_cost).fold(f64::INFINITY, f64::min);
        for (_, values) in others.filter(|(cost, _)| *cost <= best + error) {
            self.reach(theta, values);
        }
        let run = self.runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost));
        // Empty for a search that came to its end: then no interval changes below.
        let left = run.map(|run| run.deviations.clone()).unwrap_or_default();
        // About 95 % of the candidates that the search would still draw lie within two deviations.
        for side in [-2.0, 2.0] {
            let moved =
                self.values().iter().zip(&left).map(|(value, left)| value + side * left).collect::<Vec<_>>();
            self.reach(theta, &moved);
        }
    }

    /// Widens the intervals to those of `regression`, and to two of its standard deviations on both sides of the
    /// values. The regression fits all parameters together. A scan of one parameter at a time gives narrower intervals.
    pub fn widen_by(&mut self, theta: &Theta, regression: &Regression) {
        let shown = regression.deviation.iter().zip(&regression.interval);
        for ((parameter, entry), (deviation, interval)) in
            self.parameters.iter_mut().zip(theta.entries()).zip(shown)
        {
            let value = parameter.value;
            if let Some(identification) = &mut parameter.identification {
                // Two standard deviations hold about 95 % of normal errors.
                identification.widen(entry, value, 2.0 * deviation);
                for end in *interval {
                    identification.reach(entry, end);
                }
            }
        }
    }

    /// Extends every interval to `values`, one an entry.
    fn reach(&mut self, theta: &Theta, values: &[f64]) {
        let entries = theta.entries().iter().zip(values);
        for (parameter, (entry, &value)) in self.parameters.iter_mut().zip(entries) {
            if let Some(identification) = &mut parameter.identification {
                identification.reach(entry, value);
            }
        }
    }

    /// The random draws of the best run, by which least squares compares.
    pub fn draw(&self) -> u64 {
        let best = self.runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost));
        // The address that the search used, so that later comparisons see the same draws.
        RandomNumbers::Run.draw(best.map_or(0, |run| run.seed), 0, 0)
    }

    /// Corrects values that least squares of `problem` found by logs of `world`, see [`correct`]. Returns why it does
    /// not, if it does not.
    ///
    /// # Errors
    /// As [`correct`].
    pub fn correct(
        &mut self,
        problem: Problem<'_>,
        world: &dyn World,
        replicates: u32,
    ) -> Result<Option<String>, FitError> {
        let correction = match correct(problem, &self.values(), world, replicates)? {
            Ok(correction) => correction,
            Err(reason) => return Ok(Some(reason)),
        };
        // The cost of the corrected values is not known yet.
        let Some(residuals) = problem.residuals(std::slice::from_ref(&correction.corrected))?.pop().flatten()
        else {
            return Ok(Some("The simulation of the corrected values diverges.".to_owned()));
        };
        // Without the price of priors, which the cost of a search contains.
        self.best_cost = residuals.cost;
        self.take(problem.theta, &correction.corrected);
        self.correction = Some(correction);
        Ok(None)
    }

    /// Takes the intervals that simulated robots give ([`super::regress`]) for the search of `problem`. Takes their
    /// values too if they cost less or if θ has at most [`MAX_TAKEN`] entries. Takes nothing and returns the reason if
    /// their simulation diverges. It does the same if θ has more entries, the values cost more than `AS_WELL` and
    /// `AS_WELL_BY` allow, and the logs are no nearer to robots with these values ([`Regression::is_nearer`]). A cost
    /// alone does not decide: a fall in one walk of a biped makes true values costly.
    ///
    /// # Errors
    /// As [`Simulator::views`].
    pub fn adopt(
        &mut self,
        problem: Problem<'_>,
        regression: &Regression,
    ) -> Result<Option<String>, FitError> {
        // Only the cost on all recordings is compared, so no parts are needed.
        let views = Views::whole(problem.cost, problem.simulator.recordings());
        let values = regression.corrected.clone();
        let rollout = Rollout { values, resets: problem.cost.resets(), draw: problem.draw };
        let (costs, _) =
            problem.simulator.views(problem.theta, &views, &[rollout], &|| (), problem.cancel)?;
        // Without a cost the corrected robot cannot be compared with the search's.
        let Some(&cost) = costs.first().and_then(Option::as_ref).and_then(|costs| costs.first()) else {
            return Ok(Some("The simulation of the corrected values diverges.".to_owned()));
        };
        // The cost of a search contains the price of the distance from priors.
        let charged = cost + problem.theta.prior_cost(&regression.corrected);
        let max_cost = AS_WELL * self.best_cost + AS_WELL_BY;
        if charged > max_cost && problem.theta.len() > MAX_TAKEN && !regression.is_nearer() {
            self.unlike = Some(cost);
            return Ok(Some("No simulated robot is like the real one.".to_owned()));
        }
        let taken = charged <= self.best_cost || problem.theta.len() <= MAX_TAKEN;
        if taken {
            // Without the price of priors, as after a correction by simulated logs.
            self.best_cost = cost;
            self.take(problem.theta, &regression.corrected);
        }
        // Intervals from simulated robots replace the intervals of the scan, also if the search keeps its values.
        let entries = problem.theta.entries().iter().zip(&regression.interval);
        for (parameter, (entry, interval)) in self.parameters.iter_mut().zip(entries) {
            let mut identification = Identification::of_interval(entry, *interval, NoiseSource::Robots);
            // A value of the search that is kept may lie outside the interval of the robots.
            identification.reach(entry, parameter.value);
            parameter.identification = Some(identification);
        }
        self.regression = Some(Regression { taken, ..regression.clone() });
        Ok(None)
    }

    /// Takes corrected values.
    fn take(&mut self, theta: &Theta, corrected: &[f64]) {
        let entries = theta.entries().iter().zip(corrected);
        for (parameter, (entry, &value)) in self.parameters.iter_mut().zip(entries) {
            parameter.uncorrected = Some(parameter.value);
            parameter.value = value;
            parameter.at_bound = entry.at_bound(value);
        }
    }

    /// Measures the joint uncertainty of values that least squares of `problem` found, corrected or not, and notes it,
    /// also with each parameter.
    ///
    /// # Errors
    /// As [`uncertainty`].
    pub fn trust(&mut self, problem: Problem<'_>, alternatives: &[Alternative<'_>]) -> Result<(), FitError> {
        let correction = self.correction.as_ref();
        // It is measured where the search ended; the correction carries it from there.
        let values = correction.map_or_else(|| self.values(), |correction| correction.uncorrected.clone());
        self.uncertainty = uncertainty(problem, alternatives, &values, correction)?;
        let Some(uncertainty) = &self.uncertainty else { return Ok(()) };
        let theta = problem.theta;
        let entries = theta.entries().iter().zip(&uncertainty.interval);
        for (parameter, (entry, interval)) in self.parameters.iter_mut().zip(entries) {
            parameter.identification =
                Some(Identification::of_interval(entry, *interval, NoiseSource::Refits));
        }
        Ok(())
    }

    /// θ of the best run.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.value).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::ParameterRule;

    #[test]
    fn intervals_reach_to_values_that_fit_as_well_and_no_further() {
        let joints = ["FL_hip".to_owned()];
        let groups = [("hip".to_owned(), vec!["*_hip".to_owned()])];
        let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups, &joints).unwrap();
        let run = RunOutcome {
            seed: 1,
            best_cost: 0.5,
            values: vec![0.2, 0.1],
            generations: 9,
            stop: None,
            diverged: 0,
            falls: 0,
            deviations: Vec::new(),
            mean: Vec::new(),
        };
        let mut outcome = CostOutcome::new("wass".into(), &theta, vec![run]).unwrap();
        for (parameter, entry) in outcome.parameters.iter_mut().zip(theta.entries()) {
            let interval = [parameter.value - 0.01, parameter.value + 0.01];
            let identification = Identification::of_interval(entry, interval, NoiseSource::Recordings);
            parameter.identification = Some(identification);
        }
        let others = [(0.55, [0.3, 0.1]), (0.51, [0.2, 0.4]), (0.7, [0.0, 0.0])];
        outcome.widen(&theta, others.iter().map(|(cost, values)| (*cost, &values[..])), 0.1);
        let identification = |at: usize| outcome.parameters[at].identification.clone().unwrap();
        let reaches = |at: usize, lower: f64, upper: f64| {
            (identification(at).lower - lower).abs() < 1e-12
                && (identification(at).upper - upper).abs() < 1e-12
        };
        assert!(reaches(0, 0.19, 0.3) && identification(0).identified, "{:?}", identification(0));
        assert!(reaches(1, 0.09, 0.4) && !identification(1).identified, "{:?}", identification(1));
        outcome.runs[0].deviations = vec![0.08, 0.001];
        outcome.widen(&theta, std::iter::empty(), 0.1);
        let identification = outcome.parameters[0].identification.clone().unwrap();
        assert!(
            (identification.lower - 0.04).abs() < 1e-12 && (identification.upper - 0.36).abs() < 1e-12,
            "two deviations: {identification:?}"
        );
    }

    #[test]
    fn the_best_runs_value_and_the_spread_over_all() {
        let joints = ["FL_hip".to_owned()];
        let groups = [("hip".to_owned(), vec!["*_hip".to_owned()])];
        let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups, &joints).unwrap();
        let run = |seed, best_cost, value| RunOutcome {
            seed,
            best_cost,
            values: vec![value, 0.0],
            generations: 9,
            stop: None,
            diverged: 0,
            falls: 0,
            deviations: Vec::new(),
            mean: Vec::new(),
        };
        let runs = vec![run(1, 0.5, 0.1), run(2, 0.2, 0.2), run(3, 0.4, 0.3)];
        let outcome = CostOutcome::new("matcho".into(), &theta, runs).unwrap();
        assert_eq!((outcome.best_cost, outcome.values()), (0.2, vec![0.2, 0.0]));
        assert!((outcome.parameters[0].spread.unwrap() - 0.1).abs() < 1e-12);
        assert!(!outcome.parameters[0].at_bound && outcome.parameters[1].at_bound);
        assert!(CostOutcome::new("matcho".into(), &theta, Vec::new()).is_none());
    }
}
