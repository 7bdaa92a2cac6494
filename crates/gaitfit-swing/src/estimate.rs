//! Friction, damping, armature and delay from legs in the air.

use crate::SwingError;
use crate::count::{Count, Progress};
use crate::equations::{Window, windows};
use crate::feet::Ground;
use crate::lowest::lowest;
use crate::regression::{Group, Named, SHARED, groups, solve};
use crate::report::{FrictionLaw, GroupEstimate, SwingReport, SwingSettings, usual_groups};
use crate::together::{Together, together};
use crate::torques::Drag;
use crate::walk::Walk;
use gaitfit_log::{Estimate, Trajectory};
use gaitfit_model::Model;
use nalgebra::DVector;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

/// Passes before the last one. Each judges with the joints of the one before which feet stand.
const PASSES: usize = 2;
/// An early pass tries one of this many clearances.
const CLEARANCE_STRIDE: usize = 3;
/// Delay of the first pass, s.
const FIRST_DELAY_S: f64 = 0.005;
/// Windows of these lengths too are tried, over the usual length.
const LENGTHS: [f64; 2] = [0.75, 1.5];
/// Another choice of swings counts for the error if its own error is at most this many times that of the best.
const AS_SURE: f64 = 2.0;
/// Swings of each group that are enough.
const SWINGS: usize = 40;
/// No number is known better than this share of itself: links' masses and lengths, gains.
const KNOWN: f64 = 0.02;
/// Readings are from times that are known to this, s: a feedback that is late by it damps less by kp times it. Delays of
/// robots in MuJoCo came out up to 0.5 ms off.
const CLOCK_S: f64 = 4e-4;
/// Logs from which errors are also judged by how logs differ.
const LOGS: usize = 8;
/// Samples nearer than this are not independent, s.
const BLOCK_S: f64 = 0.5;

/// Estimates from the logs of one robot. Give them as they were recorded: rates above the policy's help. Nothing that a
/// robot does not measure itself is used; position and velocity of the base in a log are not looked at.
///
/// # Errors
/// Logs without what is needed, see [`SwingError`].
pub fn estimate(
    model: &Model,
    logs: &[&Trajectory],
    settings: &SwingSettings,
) -> Result<SwingReport, SwingError> {
    estimate_counted(model, logs, settings, &mut |_, _| ControlFlow::Continue(()))
}

/// As [`estimate`]. Before each regression and after the last, `progress` gets how many are done and how many there are, and
/// can stop the work.
///
/// # Errors
/// As [`estimate`], and [`SwingError::Stopped`].
pub fn estimate_counted(
    model: &Model,
    logs: &[&Trajectory],
    settings: &SwingSettings,
    progress: &mut Progress<'_>,
) -> Result<SwingReport, SwingError> {
    let mut count = Count::new(regressions(settings), progress);
    let walks = walks(model, logs, settings.threads)?;
    let mut grounds: Vec<Ground> = Vec::new();
    let mut drag = vec![Drag::default(); model.joints.len()];
    let mut delay = FIRST_DELAY_S;
    let none = || SwingError::NoSwings {
        logs: logs.len(),
        least_ms: 1e3 * (settings.window_s + 2.0 * settings.margin_s),
    };
    for pass in 0..=PASSES {
        let next = |log: usize| Ground::new(model, &walks[log], delay, &drag, grounds.get(log));
        grounds = gaitfit_pool::map(walks.len(), settings.threads, next);
        let all = |length: f64| -> Vec<Window> {
            let of_log =
                |log: usize| windows(model, &walks[log], &grounds[log], settings, length, delay, log);
            gaitfit_pool::map(walks.len(), settings.threads, of_log).concat()
        };
        let seen = all(settings.window_s);
        let last = pass == PASSES;
        let around = (pass > 0).then_some(delay);
        let best = Choice::best(model, &seen, settings, around, last, &mut count);
        count.check()?;
        let best = best.ok_or_else(none)?;
        if last {
            let lengths: &[f64] = if settings.others { &LENGTHS } else { &[] };
            let other: Vec<_> = lengths.iter().map(|factor| all(factor * settings.window_s)).collect();
            let report = best.report(model, &seen, &other, settings, &mut count);
            return count.finish().map(|()| report);
        }
        delay = best.fit.delay(settings);
        for (group, (_, joints)) in best.fit.estimates(model).iter().zip(&best.fit.names) {
            joints.iter().for_each(|&joint| drag[joint] = group.drag());
        }
    }
    Err(none())
}

/// Max number of regressions of an estimate.
fn regressions(settings: &SwingSettings) -> usize {
    let clearances = settings.clearances_m.len();
    let laws = if settings.law.is_none() { FrictionLaw::ALL.len() } else { 1 };
    let lengths = if settings.others { LENGTHS.len() } else { 0 };
    // The last pass compares its best choice with two neighbouring clearances, other lengths and the other law.
    PASSES * clearances.div_ceil(CLEARANCE_STRIDE) + laws * clearances + 2 + lengths + (laws - 1)
}

/// The logs as walks.
pub(crate) fn walks(model: &Model, logs: &[&Trajectory], threads: usize) -> Result<Vec<Walk>, SwingError> {
    gaitfit_pool::map(logs.len(), threads, |log| Walk::new(model, logs[log])).into_iter().collect()
}

/// One way of choosing swings, and what it gives.
struct Choice {
    /// Place of the clearance in the settings.
    clearance: usize,
    law: usize,
    fit: Fit,
}

impl Choice {
    /// The lowest clearance whose numbers are those of higher ones, with the law that leaves less unexplained.
    /// `around`: the known delay, s. `all`: it tries every clearance and law; else one of [`CLEARANCE_STRIDE`] clearances and
    /// one law.
    fn best(
        model: &Model,
        windows: &[Window],
        settings: &SwingSettings,
        around: Option<f64>,
        all: bool,
        count: &mut Count<'_, '_>,
    ) -> Option<Self> {
        let groups = if settings.groups.is_empty() { usual_groups(model) } else { settings.groups.clone() };
        let laws = match settings.law {
            Some(FrictionLaw::Coulomb) => 0..1,
            Some(FrictionLaw::Engine) => 1..2,
            None if all => 0..2,
            None => 1..2,
        };
        let every = if all { 1 } else { CLEARANCE_STRIDE };
        let tried: Vec<(usize, usize)> = (0..settings.clearances_m.len())
            .step_by(every)
            .flat_map(|clearance| laws.clone().map(move |law| (clearance, law)))
            .collect();
        let fits = count.map(tried.len(), settings.threads, |number| {
            let (clearance, law) = tried[number];
            Fit::new(windows, &groups, settings, clearance, law, around)
        });
        let mut choices: Vec<Self> = Vec::new();
        for (&(clearance, law), fit) in tried.iter().zip(fits) {
            let Some(fit) = fit else { continue };
            match choices.last_mut().filter(|last| last.clearance == clearance) {
                Some(last) if fit.cost.total_cmp(&last.fit.cost).is_lt() => (last.law, last.fit) = (law, fit),
                Some(_) => {}
                None => choices.push(Self { clearance, law, fit }),
            }
        }
        // Low feet may touch: from high feet, of which there must be enough, to lower ones as long as they agree.
        let logs = choices.iter().map(|choice| choice.fit.logs).max()?;
        let seen = choices.iter().map(|choice| choice.fit.names.len()).max()?;
        choices.retain(|choice| choice.fit.names.len() == seen);
        let enough = |choice: &Self| {
            3 * choice.fit.logs >= 2 * logs && choice.fit.counts.iter().all(|[swings, _]| *swings >= SWINGS)
        };
        let mut best = choices.iter().rposition(enough).unwrap_or_default();
        let highest = best;
        while best > 0 && (best..=highest).all(|high| choices[best - 1].fit.agrees(&choices[high].fit)) {
            best -= 1;
        }
        Some(choices.swap_remove(best))
    }

    /// With errors that hold how much neighbouring choices change the numbers.
    fn report(
        &self,
        model: &Model,
        windows: &[Window],
        lengths: &[Vec<Window>],
        settings: &SwingSettings,
        count: &mut Count<'_, '_>,
    ) -> SwingReport {
        let groups = &self.fit.names;
        let around = Some(self.fit.delay(settings));
        let mut choices: Vec<(&[Window], usize, usize)> =
            [self.clearance.wrapping_sub(1), self.clearance + 1]
                .into_iter()
                .filter(|&clearance| clearance < settings.clearances_m.len())
                .map(|clearance| (windows, clearance, self.law))
                .collect();
        choices.extend(lengths.iter().map(|windows| (windows.as_slice(), self.clearance, self.law)));
        if settings.law.is_none() {
            choices.push((windows, self.clearance, 1 - self.law));
        }
        let fits = count.map(choices.len(), settings.threads, |number| {
            let (windows, clearance, law) = choices[number];
            Fit::new(windows, groups, settings, clearance, law, around)
        });
        let others: Vec<Fit> =
            std::iter::once(self.fit.unbounded()).chain(fits.into_iter().flatten()).collect();
        let mut estimates = self.fit.estimates(model);
        let mut delay = self.fit.delay_estimate(settings);
        let others: Vec<(Vec<GroupEstimate>, Estimate)> = others
            .iter()
            .filter(|other| other.names.len() == groups.len())
            .map(|other| (other.estimates(model), other.delay_estimate(settings)))
            .collect();
        let widen = |known: &mut Estimate, others: &mut dyn Iterator<Item = Estimate>| {
            let sure: Vec<f64> = others
                .filter(|other| other.error < AS_SURE * known.error)
                .map(|other| (other.value - known.value).powi(2))
                .collect();
            if !sure.is_empty() {
                known.error = known.error.hypot((sure.iter().sum::<f64>() / sure.len() as f64).sqrt());
            }
        };
        widen(&mut delay, &mut others.iter().map(|(_, delay)| *delay));
        for (place, group) in estimates.iter_mut().enumerate() {
            let mut others_of = |number: fn(&mut GroupEstimate) -> &mut Estimate| {
                let mut values = others.iter().map(|(groups, _)| *number(&mut groups[place].clone()));
                widen(number(group), &mut values);
            };
            others_of(|group| &mut group.friction);
            others_of(|group| &mut group.damping);
            others_of(|group| &mut group.armature);
            let stiffest = self.fit.stiffest[place];
            for (number, min) in [
                (&mut group.friction, 0.0),
                (&mut group.damping, stiffest * CLOCK_S),
                (&mut group.armature, 0.0),
            ] {
                number.error = number.error.hypot(KNOWN * number.value).hypot(min);
            }
        }
        delay.error = delay.error.hypot(CLOCK_S);
        let named = if settings.groups.is_empty() { usual_groups(model) } else { settings.groups.clone() };
        let seen: BTreeSet<&str> = groups.iter().map(|(name, _)| name.as_str()).collect();
        SwingReport {
            groups: estimates,
            delay,
            delay_by_strength: self.fit.by_strength[self.fit.by_strength.len() - 1] * settings.delay_step_s,
            strength: Estimate { value: 1.0 + self.fit.strength[0], error: self.fit.strength[1] },
            law: FrictionLaw::ALL[self.law],
            clearance_m: settings.clearances_m[self.clearance],
            logs: self.fit.logs,
            unseen: named
                .into_iter()
                .map(|(name, _)| name)
                .filter(|name| !seen.contains(name.as_str()))
                .collect(),
        }
    }
}

/// A solution of all groups, and its variances.
#[derive(Clone)]
struct Fit {
    names: Vec<Named>,
    /// All unknowns, the delay in steps last; and without the bounds at 0.
    values: DVector<f64>,
    free: DVector<f64>,
    /// How all unknowns change with the motors' strength.
    by_strength: DVector<f64>,
    /// How they change with friction under load of each group.
    by_load: Vec<DVector<f64>>,
    strength: [f64; 2],
    scales: Vec<f64>,
    /// Largest position gain of each group, N·m/rad.
    stiffest: Vec<f64>,
    /// Swings and windows of each group.
    counts: Vec<[usize; 2]>,
    /// First unknown of each group in the covariance.
    first: Vec<usize>,
    /// Variances of all unknowns.
    variances: Vec<f64>,
    /// Logarithm of what is left unexplained.
    cost: f64,
    logs: usize,
    /// Variances without the bounds at 0.
    loose: Vec<f64>,
}

impl Fit {
    fn new(
        windows: &[Window],
        named: &[Named],
        settings: &SwingSettings,
        clearance: usize,
        law: usize,
        around: Option<f64>,
    ) -> Option<Self> {
        let (names, groups) = groups(windows, named, settings.clearances_m[clearance], law);
        let cost = |delay: f64| -> f64 {
            let log_likelihood =
                |group: &Group<'_>| Some(group.windows.len() as f64 * solve(group, delay)?.scale.ln());
            groups.iter().map(log_likelihood).sum::<Option<f64>>().unwrap_or(f64::INFINITY)
        };
        let last = settings.delays().count() as f64 - 1.0;
        let near = match around {
            Some(delay) => ((delay - settings.delay_range_s[0]) / settings.delay_step_s).clamp(0.0, last),
            None => {
                (0..=last as usize)
                    .step_by(2)
                    .map(|step| (step as f64, cost(step as f64)))
                    .min_by(|a, b| a.1.total_cmp(&b.1))?
                    .0
            }
        };
        let delay = lowest(&cost, near, last);
        let solutions = groups.iter().map(|group| solve(group, delay)).collect::<Option<Vec<_>>>()?;
        if groups.is_empty() {
            return None;
        }
        let block = |window: &Window| ((window.log as u64) << 32) + (window.at / BLOCK_S) as u64;
        let logs: BTreeSet<usize> =
            groups.iter().flat_map(|group| group.windows.iter().map(|window| window.log)).collect();
        let log = |window: &Window| window.log as u64;
        let kinds: &[&dyn Fn(&Window) -> u64] = if logs.len() >= LOGS { &[&block, &log] } else { &[&block] };
        let free = together(&groups, &solutions, delay, kinds, &[])?;
        let mut first = vec![0];
        for group in &groups {
            first.push(first[first.len() - 1] + group.columns());
        }
        // No joint has less than no friction, damping or armature, and knowing that tells a delay from damping.
        let negative: Vec<usize> = first[..groups.len()]
            .iter()
            .flat_map(|first| *first..first + SHARED)
            .filter(|&place| settings.bounded && free.values[place] < 0.0)
            .collect();
        let held =
            if negative.is_empty() { None } else { together(&groups, &solutions, delay, kinds, &negative) };
        let larger = |of: &Together, place: usize| {
            of.covariances
                .iter()
                .flatten()
                .map(|covariance| covariance[(place, place)])
                .fold(f64::NAN, f64::max)
        };
        let loose: Vec<f64> = (0..free.values.len()).map(|place| larger(&free, place)).collect();
        let variance = |place: usize| {
            let bounded = if negative.contains(&place) { &free } else { held.as_ref().unwrap_or(&free) };
            larger(bounded, place)
        };
        let variances: Vec<f64> = (0..free.values.len()).map(variance).collect();
        if !variances.iter().all(|variance| *variance > 0.0) {
            return None;
        }
        let count = |group: &Group<'_>| {
            let swings: BTreeSet<_> =
                group.windows.iter().map(|window| (window.log, window.joint, window.swing)).collect();
            [swings.len(), group.windows.len()]
        };
        let stiffest =
            |group: &Group<'_>| group.windows.iter().map(|window| window.stiffness).fold(0.0, f64::max);
        Some(Self {
            counts: groups.iter().map(count).collect(),
            stiffest: groups.iter().map(stiffest).collect(),
            cost: cost(delay) / groups.iter().map(|group| group.windows.len() as f64).sum::<f64>(),
            logs: logs.len(),
            loose,
            names,
            first,
            variances,
            scales: held.as_ref().unwrap_or(&free).scales.clone(),
            by_strength: held.as_ref().unwrap_or(&free).by_strength.clone(),
            by_load: held.as_ref().unwrap_or(&free).by_load.clone(),
            strength: held.as_ref().unwrap_or(&free).strength,
            values: held.map_or_else(|| free.values.clone(), |held| held.values),
            free: free.values,
        })
    }

    /// Whether the numbers are those of a fit with fewer of the same swings, within what the others bring (Hausman 1978,
    /// "Specification tests in econometrics": the variance of the difference is the difference of variances).
    fn agrees(&self, fewer: &Self) -> bool {
        let shared = self.names.len();
        (0..shared).flat_map(|group| (0..SHARED).map(move |k| (group, k))).all(|(group, k)| {
            let (mine, theirs) = (self.first[group] + k, fewer.first[group] + k);
            let spread = (fewer.loose[theirs] - self.loose[mine]).max(0.25 * fewer.loose[theirs]);
            (self.free[mine] - fewer.free[theirs]).abs() < 2.0 * spread.sqrt()
        })
    }

    /// The same without the bounds at 0.
    fn unbounded(&self) -> Self {
        Self { values: self.free.clone(), ..self.clone() }
    }

    fn delay(&self, settings: &SwingSettings) -> f64 {
        settings.delay_range_s[0] + self.values[self.values.len() - 1] * settings.delay_step_s
    }

    fn delay_estimate(&self, settings: &SwingSettings) -> Estimate {
        let variance = self.variances.last().copied().unwrap_or(f64::INFINITY);
        Estimate { value: self.delay(settings), error: variance.sqrt() * settings.delay_step_s }
    }

    fn estimates(&self, model: &Model) -> Vec<GroupEstimate> {
        (0..self.names.len())
            .map(|place| {
                let (name, joints) = &self.names[place];
                let number = |unknown: usize| Estimate {
                    value: self.values[self.first[place] + unknown],
                    error: self.variances[self.first[place] + unknown].sqrt(),
                };
                GroupEstimate {
                    group: name.clone(),
                    joints: joints.iter().map(|&joint| model.joints[joint].name.clone()).collect(),
                    friction: number(0),
                    damping: number(1),
                    armature: number(2),
                    by_strength: std::array::from_fn(|unknown| self.by_strength[self.first[place] + unknown]),
                    by_load: std::array::from_fn(|unknown| self.by_load[place][self.first[place] + unknown]),
                    swings: self.counts[place][0],
                    windows: self.counts[place][1],
                    residual: self.scales[place],
                }
            })
            .collect()
    }
}

/// Offsets of a group's joints: the place of each joint's among them.
pub(crate) fn offsets(windows: &[&Window]) -> BTreeMap<usize, usize> {
    let joints: BTreeSet<usize> = windows.iter().map(|window| window.joint).collect();
    joints.into_iter().enumerate().map(|(place, joint)| (joint, place)).collect()
}
