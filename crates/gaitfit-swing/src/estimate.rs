//! Friction, damping, armature and delay from legs in the air.

use crate::SwingError;
use crate::count::{Count, Progress};
use crate::equations::{Window, windows};
use crate::feet::Ground;
use crate::fit::Fit;
use crate::report::{FrictionLaw, GroupEstimate, SwingReport, SwingSettings};
use crate::torques::Drag;
use crate::walk::Walk;
use gaitfit_log::{Estimate, Trajectory};
use gaitfit_model::Model;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

/// Passes before the last one. Each judges with the joints of the one before which feet stand.
const PASSES: usize = 2;
/// An early pass tries one of this many clearances. It gives the next pass a delay and the joints' drag, for
/// which a coarse choice is enough.
const CLEARANCE_STRIDE: usize = 3;
/// Delay of the first pass, s. A real Go2 shows 5 to 6 ms (docs/results/swings.md). The first pass only judges with
/// it which feet stand.
const FIRST_DELAY_S: f64 = 0.005;
/// Windows of these lengths are tried too, as parts of the usual length. Errors then hold how much the length
/// changes the numbers.
const LENGTHS: [f64; 2] = [0.75, 1.5];
/// Another choice of swings counts for the error if its own error is at most this many times that of the best. A
/// choice that is less sure differs mainly by its own noise.
const AS_SURE: f64 = 2.0;
/// Swings of each group that are enough.
const SWINGS: usize = 40;
/// No number is known better than this share of itself: links' masses and lengths, gains.
const KNOWN: f64 = 0.02;
/// Readings are from times that are known to this, s: a feedback that is late by it damps less by kp times it. Delays of
/// robots in MuJoCo came out up to 0.5 ms off.
const CLOCK_S: f64 = 4e-4;

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
    let walks = Walk::all(model, logs, settings.threads)?;
    estimate_walks(model, &walks, settings, &mut |_, _| ControlFlow::Continue(()))
}

/// As [`estimate`], from walks. They may come from a model that differs in its springs only. Before each regression and after the last,
/// `progress` gets how many are done and how many there are, and can stop the work.
///
/// # Errors
/// Walks without swings, see [`SwingError`], and [`SwingError::Stopped`].
pub fn estimate_walks(
    model: &Model,
    walks: &[Walk],
    settings: &SwingSettings,
    progress: &mut Progress<'_>,
) -> Result<SwingReport, SwingError> {
    let mut count = Count::new(regressions(settings), progress);
    let settings = &settings.of_walks(walks);
    let mut grounds: Vec<Ground> = Vec::new();
    let mut drag = vec![Drag::default(); model.joints.len()];
    let mut delay = FIRST_DELAY_S;
    // Names the shortest swing that would have been enough.
    let none = || SwingError::NoSwings {
        logs: walks.len(),
        // A window and its margins on both sides must fit into a swing.
        least_ms: 1e3 * (settings.window_s + 2.0 * settings.margin_s),
    };
    // Which feet stand depends on delay and drag, and these on the swings. So each pass uses the last one's
    // numbers.
    for pass in 0..=PASSES {
        let next = |log: usize| Ground::new(model, &walks[log], delay, &drag, grounds.get(log));
        grounds = gaitfit_pool::map(walks.len(), settings.threads, next);
        let all = |length: f64| -> Vec<Window> {
            // Logs do not depend on each other; `map` keeps their order, so results do not depend on the threads.
            let of_log =
                |log: usize| windows(model, &walks[log], &grounds[log], settings, length, delay, log);
            gaitfit_pool::map(walks.len(), settings.threads, of_log).concat()
        };
        let seen = all(settings.window_s);
        let last = pass == PASSES;
        // The first pass knows no delay and looks for it over the whole range.
        let around = (pass > 0).then_some(delay);
        let best = Choice::best(model, &seen, settings, around, last, &mut count);
        count.check()?;
        let best = best.ok_or_else(none)?;
        // Shorter and longer windows are solved for the error only: a number that depends on the length is not
        // sure.
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
    PASSES * clearances.div_ceil(CLEARANCE_STRIDE) + clearances + 2 + lengths + (laws - 1)
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
        let groups = settings.groups_of(model);
        let laws = match settings.law {
            Some(FrictionLaw::Coulomb) => 0..1,
            Some(FrictionLaw::Engine) => 1..2,
            None if all => 0..2,
            None => 1..2,
        };
        let every = if all { 1 } else { CLEARANCE_STRIDE };
        let tried: Vec<usize> = (0..settings.clearances_m.len()).step_by(every).collect();
        let fits = count.map(tried.len(), settings.threads, |number| {
            let clearance = tried[number];
            let (law, fit) = Fit::best(windows, &groups, settings, clearance, laws.clone(), around)?;
            Some(Self { clearance, law, fit })
        });
        let mut choices: Vec<Self> = fits.into_iter().flatten().collect();
        // Low feet may touch: from high feet, of which there must be enough, to lower ones as long as they agree.
        let logs = choices.iter().map(|choice| choice.fit.logs).max()?;
        let seen = choices.iter().map(|choice| choice.fit.names.len()).max()?;
        // A choice in which a group is missing has other numbers and cannot be compared.
        choices.retain(|choice| choice.fit.names.len() == seen);
        let enough = |choice: &Self| {
            3 * choice.fit.logs >= 2 * logs && choice.fit.counts.iter().all(|[swings, _]| *swings >= SWINGS)
        };
        // Without enough swings anywhere the lowest clearance is taken: it has the most.
        let mut best = choices.iter().rposition(enough).unwrap_or_default();
        // A lower clearance must agree with all between it and the first one, or a slow drift from one to the
        // next would pass.
        let highest = best;
        while best > 0 && (best..=highest).all(|high| choices[best - 1].fit.agrees(&choices[high].fit)) {
            best -= 1;
        }
        Some(choices.swap_remove(best))
    }

    /// The report of this choice, with errors that hold how much neighbouring choices change the numbers.
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
        // Neighbouring choices of clearance, window and law: how far they move a number is an error that no
        // scatter shows.
        let mut choices: Vec<(&[Window], usize, usize)> =
            // Below the first clearance this wraps to a huge number, which the filter removes.
            [self.clearance.wrapping_sub(1), self.clearance + 1]
                .into_iter()
                .filter(|&clearance| clearance < settings.clearances_m.len())
                .map(|clearance| (windows, clearance, self.law))
                .collect();
        choices.extend(lengths.iter().map(|windows| (windows.as_slice(), self.clearance, self.law)));
        if settings.law.is_none() {
            // There are two laws; this is the other one.
            choices.push((windows, self.clearance, 1 - self.law));
        }
        let fits = count.map(choices.len(), settings.threads, |number| {
            let (windows, clearance, law) = choices[number];
            Fit::best(windows, groups, settings, clearance, law..law + 1, around)
        });
        let fits = fits.into_iter().flatten().map(|(_, fit)| fit);
        // The bounds at 0 are a choice too: a value that they hold moves the others.
        let others: Vec<Fit> = std::iter::once(self.fit.unbounded()).chain(fits).collect();
        let mut estimates = self.fit.estimates(model);
        let mut delay = self.fit.delay_estimate(settings);
        let others: Vec<(Vec<GroupEstimate>, Estimate)> = others
            .iter()
            .filter(|other| other.names.len() == groups.len())
            .map(|other| (other.estimates(model), other.delay_estimate(settings)))
            .collect();
        // Choices with much larger errors scatter by chance, so they do not count.
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
                // Floors of the errors: no estimate is surer than the model's numbers and the clock allow.
                number.error = number.error.hypot(KNOWN * number.value).hypot(min);
            }
        }
        delay.error = delay.error.hypot(CLOCK_S);
        let named = settings.groups_of(model);
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

/// Offsets of a group's joints: the place of each joint's among them.
pub(crate) fn offsets(windows: &[&Window]) -> BTreeMap<usize, usize> {
    let joints: BTreeSet<usize> = windows.iter().map(|window| window.joint).collect();
    joints.into_iter().enumerate().map(|(place, joint)| (joint, place)).collect()
}
