//! What a clamped robot's fit leaves unexplained, and which other parameters would explain it.
//!
//! A fit of few parameters finds the values that serve its errors best, whatever is wrong with the logs: gains that are
//! stated twice too large come out as armature and friction. So the errors are tested for memory, which noise of
//! sensors does not have, and a few other parameters are fitted besides, to see whether they explain the rest much
//! better.

mod seldom;
mod step;
mod suspects;

pub use suspects::Suspect;

use super::audit::Audit;
use super::parameter::Parameter;
use super::score::Robot;
use super::setup::Setup;
use crate::Error;
use gaitfit_adapt::fit::{Problem, descend, unexplained};
use gaitfit_adapt::{Cancel, Resets};
use gaitfit_view::{Doubt, DoubtKind};
use seldom::ramped;
use serde::{Deserialize, Serialize};
use step::finer;
use suspects::{STEPS, TOLERANCE, better, suspicions};

/// A simulator lacks something if the correlation between an error and the next sample's error is at least this.
/// Simulated robots that differ only in fitted parameters have 0.06, with encoders of 20 mrad 0.08, with lost rows
/// 0.22; a real Go2 has 0.76, logs with wrong gains or filtered velocities have 0.99.
const REMEMBERS: f64 = 0.3;
/// Two simulators of the same robot differ by errors below this (in units in which the robot's range is 2), so a
/// correlation of such small errors is no reason for doubt. An A1 that MuJoCo simulates without any noise, with steps
/// of another length, leaves 0.0018; all its values are then within 2 %.
const QUIET: f64 = 2.5e-3;
/// Intervals widen by this share of the reach of the unexplained errors. Wrong values hide a part of the errors; this
/// part is assumed to be as large as the visible one. With filtered sensors values were off by up to 0.74 of the reach
/// (`tools/mutate_logs.py`).
const HIDDEN: f64 = 1.0;
/// A suspect that lowers the cost to this share shows that the fit is wrong.
const PROVEN: f64 = 0.5;
/// Intervals reach beyond a suspect's values by this share of the way to them, because a suspect explains the errors
/// only roughly.
const FURTHER: f64 = 0.25;

/// Errors that a fit leaves, and their likely cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Leftover {
    /// Root mean square of the errors of free simulations, where the robot's range is 2.
    pub error: f64,
    /// Correlation of an error with the next sample's error: 0 for noise, near 1 if the simulator lacks something.
    pub memory: f64,
    /// How far off each parameter would be, in its unit, if it alone caused all correlated errors; absent if the logs
    /// do not show the parameter.
    pub reach: Vec<Option<f64>>,
    /// Values at which least squares ends if it continues from the fit. The other numbers belong to these values.
    pub end: Vec<f64>,
    /// The cost there.
    pub cost: f64,
    /// Whether the intervals contain noise alone, as those of least squares do. They assume that the simulator has no
    /// errors.
    pub noise_alone: bool,
    /// The motions with which errors of velocities correlate; absent if successive errors are not correlated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<Audit>,
    /// The suspect that explains most of the errors, if one explains enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suspect: Option<Suspect>,
}

impl Leftover {
    /// Whether the errors are more than noise.
    pub(super) fn remembers(&self) -> bool {
        self.memory > REMEMBERS && self.error > QUIET
    }

    /// The doubt that the simulator lacks something.
    pub(super) fn doubt(&self) -> Option<Doubt> {
        // Smooth targets are tried even if the errors forget, so a suspect may stand alone.
        let mut text = match (self.remembers(), &self.suspect) {
            (false, None) => return None,
            (false, Some(_)) => String::new(),
            (true, _) => format!(
                "The errors are not sensor noise: errors of successive samples have a correlation of {:.2}.",
                self.memory
            ),
        };
        if let Some(audit) = &self.audit {
            text +=
                &format!(" They depend most on {}, above all at {}.", audit.strongest.0, audit.worst_joint.0);
        }
        let kind = match &self.suspect {
            None => {
                text += " The intervals are widened for it. Fit further parameters, and check the log with `gaitfit \
                         inspect`.";
                DoubtKind::Unexplained
            }
            Some(suspect) => {
                text += &format!(
                    " With {}{} the cost is {:.5} instead of {:.5}: {}. The intervals reach to the values with them.",
                    suspect.what,
                    suspect.shown(),
                    suspect.cost,
                    self.cost,
                    suspect.remedy
                );
                if suspect.cost < PROVEN * self.cost { DoubtKind::Misfit } else { DoubtKind::Unexplained }
            }
        };
        Some(Doubt::new(kind, text.trim_start()))
    }

    /// Widens the interval of parameter number `at` for it, and to where a search that was left early would have ended.
    pub(super) fn widen(&self, at: usize, parameter: &mut Parameter) {
        let hidden = self.reach.get(at).copied().flatten().map(|reach| HIDDEN * reach);
        let margin = hidden.unwrap_or(0.0);
        let value = parameter.found.value;
        // Within the margin the interval covers the other end already.
        if let Some(end) = self.end.get(at).filter(|end| (*end - value).abs() > margin) {
            parameter.reach(end - margin);
            parameter.reach(end + margin);
        }
        // Least squares knows no error of the simulator, so its intervals always widen. Others widen if the
        // errors remember.
        if let Some(hidden) = hidden.filter(|_| self.memory > REMEMBERS || self.noise_alone) {
            parameter.blur(hidden);
        }
        if let Some(moved) = self.suspect.as_ref().and_then(|suspect| suspect.moved.get(at)) {
            let end = self.end.get(at).unwrap_or(moved);
            // The way is counted from where the search without the suspect ended, because `moved` was found
            // from there.
            parameter.reach(moved + FURTHER * (moved - end));
        }
    }
}

/// Examines the errors of the fit by cost number `number` at `values`, where its cost is `cost`; absent of walks,
/// and where samples are not compared one by one. `noise_alone`: see [`Leftover`].
pub(super) fn leftover(
    setup: &Setup,
    number: usize,
    values: &[f64],
    cost: f64,
    noise_alone: bool,
    cancel: &Cancel<'_>,
) -> Result<Option<Leftover>, Error> {
    let compared = setup.costs[number].as_ref();
    let applies = setup.method.walking().is_none()
        && compared.resets() == Resets::Never
        && compared.differences().is_some();
    if !applies {
        return Ok(None);
    }
    let problem = Problem {
        simulator: setup.fit.simulator.as_ref(),
        theta: &setup.theta,
        cost: compared,
        draw: 0,
        cancel,
    };
    // A search that was left early must not look like a simulator that lacks something.
    let end = descend(problem, values, STEPS, TOLERANCE).map_err(Error::failed)?;
    // The better of the two ends is examined.
    let (end, min) = end.filter(|(_, min)| *min < cost).unwrap_or((values.to_vec(), cost));
    let Some(unexplained) = unexplained(problem, &end).map_err(Error::failed)? else { return Ok(None) };
    let mut left = Leftover {
        error: unexplained.error,
        memory: unexplained.memory,
        reach: unexplained.reach,
        end: end.clone(),
        cost: min,
        noise_alone,
        audit: None,
        suspect: None,
    };
    // Tried before the others, because it decides whether the step is tried; weighed last.
    let smooth = ramped(setup, number, problem, &end)?;
    let explains = smooth.as_ref().is_some_and(|suspect| better(None, suspect.clone(), min).is_some());
    // The step comes first: it is no property of the robot, and smooth targets also shorten the simulation's steps.
    if (left.remembers() || explains)
        && let Some(suspect) = finer(setup, problem, &end)?
    {
        left.suspect = better(left.suspect, suspect, min);
    }
    // Errors that forget are sensor noise, which no parameter explains.
    if left.remembers() {
        let robot = Robot { theta: &setup.theta, values: &end };
        let predicted = robot.simulate(problem.simulator, compared.resets())?;
        left.audit = Audit::new(&setup.fit, &predicted, 0);
        for suspicion in suspicions(setup) {
            let Some(suspect) = suspicion.tried(setup, problem, &end)? else { continue };
            left.suspect = better(left.suspect, suspect, min);
        }
    }
    if let Some(suspect) = smooth {
        left.suspect = better(left.suspect, suspect, min);
    }
    Ok(Some(left))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::adapt::log_set::LogSet;
    use crate::adapt::method::Method;
    use crate::adapt::opening::Opening;
    use crate::settings;
    use std::path::Path;

    const TRUTH: [f64; 10] = [0.21, 0.17, 0.62, 0.015, 0.019, 0.047, 0.19, 0.22, 0.31, 0.007];

    /// What is left of the first seconds of the demo's log, header and rows changed by `edit`, where the parameters
    /// have their true values.
    fn left(edit: impl Fn(&str) -> String, delay: bool) -> Leftover {
        let setup = setup(edit, delay, &[]);
        leftover(&setup, 0, &TRUTH[..setup.theta.len()], 1.0, false, &gaitfit_adapt::never).unwrap().unwrap()
    }

    /// The fit of such a log; `more`: further settings.
    fn setup(edit: impl Fn(&str) -> String, delay: bool, more: &[&str]) -> Setup {
        let place = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let text = std::fs::read_to_string(place.join("examples/go2-demo/fit.csv")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let lines: Vec<String> = text.lines().take(800).map(|line| edit(line) + "\n").collect();
        std::fs::write(&path, lines.concat()).unwrap();
        let file = place.join("examples/go2-demo/adapt.toml");
        let mut changes = vec![
            format!("logs=[{:?}]", path.display().to_string()),
            format!("robot={:?}", place.join("assets/go2.xml").display().to_string()),
            "validate=[]".to_owned(),
            "check={}".to_owned(),
        ];
        if !delay {
            let kinds =
                ["frictionloss", "armature", "damping"].map(|kind| format!("{{kind={kind:?},upper=1.5}}"));
            changes.push(format!("parameter=[{}]", kinds.join(",")));
        }
        changes.extend(more.iter().map(|&change| change.to_owned()));
        Opening::new(&settings::load(Some(&file), &changes).unwrap(), &file).threads(2).open().unwrap()
    }

    /// A robot at 50 Hz as fine steps simulate it, fitted with one step a sample.
    #[test]
    fn a_physics_step_that_is_too_long_is_named() {
        let rows = std::cell::Cell::new(0);
        let seldom = |line: &str| {
            let number = line.starts_with(|first: char| first.is_ascii_digit());
            rows.set(rows.get() + usize::from(number));
            match number && rows.get() % 4 != 1 {
                true => String::new(),
                false => line.replace("rate_hz = 200", "rate_hz = 50"),
            }
        };
        let mut coarse = setup(seldom, true, &["simulation.timestep=0.02"]);
        let Method::Replay(clamped) = &coarse.method else { unreachable!() };
        let fine = clamped.finer(coarse.base.clone(), &coarse.fit.logs, 16).unwrap();
        let robot = Robot { theta: &coarse.theta, values: &TRUTH };
        let walked = robot.simulate(&fine, Resets::Never).unwrap();
        let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect::<Vec<f64>>();
        let mut logs = coarse.fit.logs.clone();
        logs[0].trajectory.position = wide(&walked[0].position);
        logs[0].trajectory.velocity = wide(&walked[0].velocity);
        coarse.fit = LogSet::new(&coarse.config, &coarse.method, &coarse.base, logs).unwrap();
        coarse.costs = coarse.fit.costs(&coarse.config).unwrap();
        let left = leftover(&coarse, 0, &TRUTH, 1.0, false, &gaitfit_adapt::never).unwrap().unwrap();
        let doubt = left.doubt().unwrap();
        assert!(
            doubt.text.contains("physics steps of 5.00 ms") && doubt.text.contains("simulation.timestep"),
            "{doubt:?} {left:?}"
        );
    }

    #[test]
    fn a_simulator_that_lacks_nothing_leaves_noise() {
        let left = left(str::to_owned, true);
        assert!(left.memory < 0.15 && left.doubt().is_none() && left.suspect.is_none(), "{left:?}");
        let off = left.end.iter().zip(TRUTH).map(|(value, truth)| (value / truth - 1.0).abs());
        assert!(off.fold(0.0, f64::max) < 0.1, "{:?}", left.end);
    }

    #[test]
    #[ignore = "takes long: `.ci/run long` runs it"]
    fn long_targets_that_the_log_has_too_seldom_are_named() {
        let (row, held) = (std::cell::Cell::new(0), std::cell::RefCell::new(Vec::new()));
        let seldom = |line: &str| {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            if cells.len() < 30 || cells[0].parse::<f64>().is_err() {
                return line.to_owned();
            }
            if row.get() % 4 == 0 {
                *held.borrow_mut() = cells[25..].to_vec();
            }
            row.set(row.get() + 1);
            cells.splice(25.., held.borrow().iter().cloned());
            cells.join(",")
        };
        let left = left(seldom, true);
        let doubt = left.doubt().unwrap();
        assert!(doubt.text.contains("targets that move smoothly"), "{doubt:?} {left:?}");
        let moved = left.suspect.unwrap().moved;
        let off = |values: &[f64]| (values[3] / TRUTH[3] - 1.0).abs();
        assert!(off(&moved) < 0.1 && off(&left.end) > 0.4, "{moved:?} {:?}", left.end);
    }

    #[test]
    fn gains_that_are_stated_too_large_are_named() {
        let doubled = |line: &str| match line.strip_prefix("# kp = ") {
            Some(_) => "# kp = { \"*_hip\" = 40, \"*_thigh\" = 40, \"*_calf\" = 80 }".to_owned(),
            None => line.to_owned(),
        };
        let left = left(doubled, true);
        let doubt = left.doubt().unwrap();
        assert!(doubt.kind == DoubtKind::Misfit && doubt.text.contains("check kp and kd"), "{}", doubt.text);
        let suspect = left.suspect.unwrap();
        let scales = suspect.values.iter().filter(|(name, _)| name.starts_with("kp_scale"));
        assert!(scales.clone().count() == 3 && scales.clone().all(|(_, scale)| (scale - 0.5).abs() < 0.02));
    }

    #[test]
    fn a_missing_delay_is_named_and_intervals_reach_to_the_values_with_it() {
        let left = left(str::to_owned, false);
        let suspect = left.suspect.clone().unwrap();
        assert_eq!(suspect.what, "a delay");
        assert!((suspect.values[0].1 - 0.007).abs() < 5e-4, "{suspect:?}");
        assert!((suspect.moved[3] / 0.015 - 1.0).abs() < 0.1, "armature of hips: {suspect:?}");
        assert!((left.end[3] / 0.015 - 1.0).abs() > 0.3, "without it: {left:?}");
        assert!(left.doubt().unwrap().text.contains("kind \"delay\""));
    }

    /// A log whose cells from number `from` on, twelve of them, are `change`d from row to row; each has the row's
    /// before.
    fn cells(from: usize, change: impl Fn(&[f64], &[f64]) -> Vec<f64>) -> impl Fn(&str) -> String {
        let before = std::cell::RefCell::new(Vec::<f64>::new());
        move |line: &str| {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            if cells.len() < 30 || cells[0].parse::<f64>().is_err() {
                return line.to_owned();
            }
            let now: Vec<f64> = cells[from..from + 12].iter().map(|cell| cell.parse().unwrap()).collect();
            let mut before = before.borrow_mut();
            let last = if before.is_empty() { now.clone() } else { before.clone() };
            *before = change(&last, &now);
            cells.iter_mut().skip(from).zip(before.iter()).for_each(|(cell, new)| *cell = new.to_string());
            cells.join(",")
        }
    }

    #[test]
    #[ignore = "takes long: `.ci/run long` runs it"]
    fn long_velocities_that_are_filtered_are_named() {
        // 75 % of the new value at 200 Hz: 1.7 ms late, too little for a finding.
        let filter = |last: &[f64], now: &[f64]| -> Vec<f64> {
            last.iter().zip(now).map(|(last, now)| last + 0.75 * (now - last)).collect()
        };
        let left = left(cells(13, filter), true);
        let doubt = left.doubt().unwrap();
        assert!(left.memory > 0.5 && doubt.text.contains("of kind \"velocity_lag\""), "{}", doubt.text);
        let suspect = left.suspect.unwrap();
        assert!((suspect.values[0].1 - 0.005 / 3.0).abs() < 2e-4, "{:?}", suspect.values);
        for (at, truth) in TRUTH.iter().enumerate() {
            let [without, with] = [left.end[at], suspect.moved[at]].map(|value| (value / truth - 1.0).abs());
            assert!(with < 0.1, "{at}: {with} {without}");
        }
    }

    #[test]
    fn errors_that_nothing_explains_widen_the_intervals() {
        // Encoders that are not round.
        let wobble = |_: &[f64], now: &[f64]| -> Vec<f64> {
            now.iter().map(|angle| angle + 0.003 * (25.0 * angle).sin()).collect()
        };
        let left = left(cells(1, wobble), true);
        let doubt = left.doubt().unwrap();
        assert!(left.memory > 0.5 && doubt.kind == DoubtKind::Unexplained, "{left:?}");
        for (at, truth) in TRUTH.iter().enumerate() {
            let hidden = HIDDEN * left.reach[at].unwrap();
            assert!((left.end[at] - truth).abs() < hidden, "{at}: {} {truth} {hidden}", left.end[at]);
        }
    }
}
