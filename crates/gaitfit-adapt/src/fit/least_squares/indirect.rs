//! Indirect inference (Gourieroux, Monfort and Renault 1993): simulated logs show how far off a fit is.
//!
//! Short predictions start from sensor readings. If motors also give torques that were not commanded (noise), the next
//! reading differs from the prediction. A prediction starts from a reading, so their errors correlate, and the estimate of
//! dry friction is too low. A physics step that is longer than the robot's causes a further
//! error. Logs of a simulated robot with known values have the same two errors. So logs are simulated as the robot
//! would have made them, and compared in the same way.
//!
//! The comparison is one Gauss–Newton step from the end of the fit. A fit of the simulated logs would start close to
//! its own end, so one step is nearly such a fit. The values of the simulated robot are changed until its logs give the
//! same step as the real logs do (no step, if the search converged). Bounds do not limit the step: it shows how far
//! beyond a bound the logs pull, and the correction of a value at a bound depends on that.
//!
//! All rounds together show how a fit responds to a change of the robot ([`Response`]), because values that compensate
//! each other are hard to separate. Rounds continue until the remaining difference is within the scatter of the noise.
//! If fits respond weakly to some change of the robot, the remaining difference shows little about that change; some
//! rounds then change the robot much in this direction, to measure the response.
//!
//! The noise of the simulated motors follows from the residual of the fit: it is chosen so that simulated logs have the
//! same residual. The squared median of the residual is about affine in the square of the noise, and ignores rare
//! events, for example legs that hit each other.

use super::correction::{Correction, Round, mean};
use super::normal::{Loss, Normal};
use super::question::{Comparison, Failure, Question, Slope, World};
use super::residuals::Problem;
use super::response::{Response, Shown};
use super::uncertainty::{RIDGE, silent};
use super::{Around, around, size};
use crate::fit::FitError;

/// Min and max number of rounds of simulated logs. Each round corrects the values by the difference that the last one
/// left.
const ROUNDS: [usize; 2] = [4, 8];
/// Rounds end if each value is off by at most this many standard deviations of the mean over a round's sets,
const MISSED: f64 = 2.5;
/// or by at most this share of the entry's deviation.
const SETTLED: f64 = 2e-3;
/// Number of last rounds whose fits show the spread; rounds that went far are left out.
const LAST: usize = 2;
/// If the values have not settled after these rounds, the next robot is changed in the direction to which fits respond
/// least, until an entry has moved by its deviation,
const FAR: [usize; 2] = [4, 6];
/// provided that fits respond with less than this share of the change.
const WEAK: f64 = 0.5;
/// Number of rounds that measure the residual of a robot without noise; later rounds change it little.
const MEASURED: usize = 2;
/// Standard deviation of the torque noise in the first trial, N·m.
const FIRST_NOISE: f64 = 1.0;
/// Number of sets of logs that measure the residual without noise, and with the first trial's noise.
const TRIALS: usize = 2;
/// Smallest noise, as a share of the first trial's, that shows the effect of noise.
const TELLING: f64 = 0.3;
/// Max number of steps to the minimum of the loss.
const FURTHER: usize = 3;
/// They end with a step that is shorter than this, in the entries' deviations.
const SHORT: f64 = 2e-3;
/// A step that increases the loss by more than this share is not taken.
const RISE: f64 = 0.01;
/// Max torque noise, N·m.
const MAX_NOISE: f64 = 30.0;

/// Max number of sets of logs that a correction simulates, with `replicates` sets a round.
pub fn sets(replicates: u32) -> usize {
    ROUNDS[1] * replicates as usize + (MEASURED + 1) * TRIALS
}

/// The correction of `values`, which a search of least squares of `problem` found with its random draws, from
/// `replicates` sets of simulated logs a round. `Ok(Err)`: why there is no correction, in a sentence.
///
/// # Errors
/// [`FitError::Cancelled`], and what else keeps the fit's own simulator from simulating `values`.
pub fn correct(
    problem: Problem<'_>,
    values: &[f64],
    world: &dyn World,
    replicates: u32,
) -> Result<Result<Correction, String>, FitError> {
    let Some(here) = around(&problem, values)? else {
        return Ok(Err("The simulation of the values found diverges.".to_owned()));
    };
    let loss = Loss::new(&here.residuals);
    let silent = silent(problem.theta, &here, loss, problem.simulator.threads());
    let entries = problem.theta.entries().iter().zip(silent);
    // Values that the logs do not show, or that no simulated robot has, cannot be corrected.
    let moving: Vec<bool> = entries.map(|(entry, silent)| !silent && world.shares(entry)).collect();
    let Some((reference, real)) = further(problem, values, here, loss, &moving)? else {
        return Ok(Err("The logs do not say which way the values found could move.".to_owned()));
    };
    match (Inference { problem, world, fitted: values, values: &reference, loss, moving, real, replicates })
        .rounds()
    {
        // A cancelled run may also end with an error of its own; being cancelled comes first.
        _ if (problem.cancel)() => Err(FitError::Cancelled),
        Err(Failure::Fit(error @ FitError::Cancelled)) => Err(error),
        Err(Failure::Fit(error)) => Ok(Err(format!("A comparison with simulated logs failed: {error}."))),
        Err(Failure::Said(reason)) => Ok(Err(reason)),
        Ok(correction) => Ok(Ok(correction)),
    }
}

/// Follows the slope of the loss to its end, and asks the logs there: kinks of the loss can hold a search before it.
/// `None` if the equations of the first step cannot be solved.
fn further(
    problem: Problem<'_>,
    values: &[f64],
    here: Around,
    loss: Loss,
    moving: &[bool],
) -> Result<Option<(Vec<f64>, Comparison)>, FitError> {
    let compared = |here: &Around| {
        let step = Normal::whole(&here.jacobian, &here.residuals, loss, problem.simulator.threads())
            .step(RIDGE, moving)?;
        Some(Comparison { left: Loss::new(&here.residuals).bulk(), step: step.as_slice().to_vec() })
    };
    let Some(mut real) = compared(&here) else { return Ok(None) };
    let max = loss.mean(&here.residuals) * (1.0 + RISE);
    let mut at = values.to_vec();
    for _ in 0..FURTHER {
        let entries = problem.theta.entries().iter().zip(&at).zip(real.step.iter());
        let next: Vec<f64> = entries
            .map(|((entry, from), by)| {
                // Slopes hold nearby: no entry moves further than its deviation at once.
                let by = by.clamp(-entry.deviation, entry.deviation);
                (from + by).clamp(entry.lower, entry.upper)
            })
            .collect();
        if size(problem.theta, &at, &next) < SHORT {
            break;
        }
        let there = around(&problem, &next)?.filter(|there| loss.mean(&there.residuals) <= max);
        let Some(there) = there.as_ref().and_then(compared) else { break };
        (at, real) = (next, there);
    }
    Ok(Some((at, real)))
}

struct Inference<'a> {
    /// The real logs.
    problem: Problem<'a>,
    world: &'a dyn World,
    /// Values of their fit.
    fitted: &'a [f64],
    /// The end of the slope of their loss, see [`further`].
    values: &'a [f64],
    loss: Loss,
    /// Entries that have an effect.
    moving: Vec<bool>,
    /// The answer of the real logs.
    real: Comparison,
    replicates: u32,
}

impl Inference<'_> {
    fn rounds(&self) -> Result<Correction, Failure> {
        let mut simulated = self.values.to_vec();
        // Each set of logs of all rounds has a number, and with it random draws of its own.
        let mut numbers = 0..u32::MAX;
        let (mut slope, mut quiet) = (None, 0.0);
        let (mut done, mut far) = (Vec::<Round>::with_capacity(ROUNDS[1]), Vec::new());
        for round in 0..ROUNDS[1] {
            if round < MEASURED {
                quiet = self.left(&simulated, 0.0, &mut numbers)?;
            }
            let rise = match slope {
                Some(slope) => slope,
                None => {
                    let left = self.left(&simulated, FIRST_NOISE, &mut numbers)?;
                    // The squared median that is left is about quiet + rise · noise², see the head of the file.
                    *slope.insert((left - quiet) / FIRST_NOISE.powi(2))
                }
            };
            if rise.is_nan() || rise <= 0.0 {
                let said = "Noise on the simulated robot's torques does not make its logs harder to predict.";
                return Err(Failure::Said(said.to_owned()));
            }
            // Logs that leave less than those of a robot without noise show none.
            let torque_noise = ((self.real.left - quiet) / rise).max(0.0).sqrt().min(MAX_NOISE);
            // Logs of the robot as it is assumed now, each set with draws that no other set has.
            let drawn: Vec<u32> = numbers.by_ref().take(self.replicates as usize).collect();
            let compared = self.compared(&simulated, torque_noise, &drawn)?;
            // What little noise adds to the differences would be lost in the differences of sets.
            if torque_noise > TELLING * FIRST_NOISE {
                let left = compared.iter().map(|one| one.left).sum::<f64>() / compared.len().max(1) as f64;
                slope = Some((left - quiet) / torque_noise.powi(2)).filter(|slope| *slope > 0.0).or(slope);
            }
            let fits = compared.iter().map(|one| self.fit(one)).collect();
            let here = Round { values: simulated.clone(), torque_noise, fits };
            let settled = self.settled(&here);
            done.push(here);
            if settled && done.len() >= ROUNDS[0] {
                break;
            }
            let response = self.response(&done)?;
            simulated = self.next(&simulated, &response.robot_of(self.values));
            if FAR.contains(&done.len())
                && let Some(moved) = self.far(&simulated, &response)
            {
                // The next round gets this number.
                far.push(done.len());
                simulated = moved;
            }
        }
        // The last round teaches the response too.
        let response = self.response(&done)?;
        Ok(self.correction(done, &far, &response))
    }

    /// The answer of fits to changes of the robot, from all rounds.
    fn response(&self, rounds: &[Round]) -> Result<Response, Failure> {
        let shown: Vec<Shown> = rounds
            .iter()
            .map(|round| Shown { robot: round.values.clone(), fit: round.mean(), noise: round.noise() })
            .collect();
        let scale: Vec<f64> = self.problem.theta.entries().iter().map(|entry| entry.deviation).collect();
        let said = || Failure::Said("Fits of simulated logs have no end.".to_owned());
        Response::learnt(&shown, &scale).ok_or_else(said)
    }

    /// Whether what a round misses is not worth another one.
    fn settled(&self, round: &Round) -> bool {
        // What the fit of the real logs has beyond the mean of this round's fits.
        let missed: Vec<f64> = self.values.iter().zip(round.mean()).map(|(value, fit)| value - fit).collect();
        let noise = round.noise();
        let entries = self.problem.theta.entries().iter().zip(&self.moving);
        let each = entries.zip(missed.iter().zip(&noise));
        each.filter(|((_, moving), _)| **moving).all(|((entry, _), (missed, noise))| {
            missed.abs() <= (MISSED * noise).max(SETTLED * entry.deviation)
        })
    }

    /// The correction by `rounds`. Those with the numbers `far` were far from the estimate.
    fn correction(&self, rounds: Vec<Round>, far: &[usize], response: &Response) -> Correction {
        // Rounds far from the estimate taught the response only; the numbers of the estimate come from the last
        // near ones.
        let entries = self.problem.theta.entries().iter().enumerate();
        let robot = response.robot_of(self.values);
        let near = rounds.iter().enumerate().filter(|(number, _)| !far.contains(number));
        let last: Vec<&Round> = near.map(|(_, round)| round).rev().take(LAST).collect();
        // Entries that did not move keep the fit's value: no round has tried to correct them.
        let corrected = entries.map(|(at, entry)| {
            if self.moving[at] { robot[at].clamp(entry.lower, entry.upper) } else { self.fitted[at] }
        });
        let spread = |at: usize| {
            let variance = |round: &&Round| {
                let values: Vec<f64> = round.fits.iter().map(|fit| fit[at]).collect();
                gaitfit_sim::stats::deviation(&values).unwrap_or(0.0).powi(2)
            };
            mean(last.iter().map(variance)).sqrt()
        };
        Correction {
            uncorrected: self.fitted.to_vec(),
            corrected: corrected.collect(),
            spread: (0..self.fitted.len()).map(spread).collect(),
            torque_noise: mean(last.iter().map(|round| round.torque_noise)),
            replicates: last.iter().map(|round| round.fits.len()).sum(),
            response: response.rows(),
            rounds,
        }
    }

    /// The values of the next round: the estimate, or as far on the way to it as no entry moves by more than its
    /// deviation, within the bounds.
    fn next(&self, simulated: &[f64], estimate: &[f64]) -> Vec<f64> {
        let entries = self.problem.theta.entries();
        let moving = entries.iter().zip(simulated.iter().zip(estimate)).zip(&self.moving);
        let far = moving
            .filter(|(_, moving)| **moving)
            .map(|((entry, (from, to)), _)| ((to - from) / entry.deviation).abs());
        // At most 1: an estimate that is near is taken as it is.
        let part = 1.0 / far.fold(1.0, f64::max);
        let moved = entries.iter().zip(simulated.iter().zip(estimate)).zip(&self.moving);
        let moved = moved.map(|((entry, (from, to)), moving)| {
            if *moving { (from + part * (to - from)).clamp(entry.lower, entry.upper) } else { *from }
        });
        moved.collect()
    }

    /// A robot that is moved from `simulated` along the change that fits answer least to, on the way that the rounds
    /// went; `None` if no answer is weak.
    fn far(&self, simulated: &[f64], response: &Response) -> Option<Vec<f64>> {
        let (part, change) = response.weakest();
        if part >= WEAK {
            return None;
        }
        let entries = self.problem.theta.entries();
        let scaled = entries.iter().zip(simulated.iter().zip(self.values)).zip(&change);
        // Its sign says which way the rounds have gone along the change.
        let gone: f64 =
            scaled.map(|((entry, (to, from)), by)| (to - from) * by / entry.deviation.powi(2)).sum();
        let moved: Vec<f64> =
            simulated.iter().zip(&change).map(|(from, by)| from + by * 1f64.copysign(gone)).collect();
        Some(self.next(simulated, &moved))
    }

    /// The end of a fit of simulated logs, less the step that the real logs still ask for at the same values.
    fn fit(&self, compared: &Comparison) -> Vec<f64> {
        let steps = compared.step.iter().zip(self.real.step.iter());
        self.values.iter().zip(steps).map(|(value, (step, real))| value + step - real).collect()
    }

    /// The answers of some sets of logs of the robot `simulated` about the fitted values.
    fn ask(
        &self,
        simulated: &[f64],
        noise: f64,
        step: Option<Slope>,
        numbers: &[u32],
    ) -> Result<Vec<Comparison>, Failure> {
        let (simulated, values) = (simulated.to_vec(), self.values.to_vec());
        self.world.ask(self.problem, &Question { simulated, noise, values, step }, numbers)
    }

    /// The same as [`Self::ask`], with the step that each set asks for.
    fn compared(&self, simulated: &[f64], noise: f64, numbers: &[u32]) -> Result<Vec<Comparison>, Failure> {
        let slope = Slope { loss: self.loss, moving: self.moving.clone() };
        self.ask(simulated, noise, Some(slope), numbers)
    }

    /// The squared median of the differences that the values found leave of logs of the robot `simulated`, mean over
    /// some sets.
    fn left(
        &self,
        simulated: &[f64],
        noise: f64,
        numbers: &mut impl Iterator<Item = u32>,
    ) -> Result<f64, Failure> {
        let drawn: Vec<u32> = numbers.take(TRIALS).collect();
        let said = self.ask(simulated, noise, None, &drawn)?;
        Ok(mean(said.into_iter().map(|one| one.left)))
    }
}
