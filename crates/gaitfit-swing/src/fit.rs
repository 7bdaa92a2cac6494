//! Solves the equations of all groups for one choice of swings.

use crate::added::block;
use crate::equations::Window;
use crate::lowest::lowest;
use crate::regression::{Group, Named, SHARED, Solution, groups, solve};
use crate::report::{GroupEstimate, SwingSettings};
use crate::together::{Together, together};
use gaitfit_log::Estimate;
use gaitfit_model::Model;
use nalgebra::DVector;
use std::collections::BTreeSet;
use std::ops::Range;

/// Logs from which on errors are also judged by how logs differ. The scatter of fewer clusters is too uncertain
/// itself.
const LOGS: usize = 8;

/// Each group alone at the delay that leaves least unexplained.
struct Alone<'a> {
    names: Vec<Named>,
    groups: Vec<Group<'a>>,
    law: usize,
    /// The delay, in steps of the delays.
    delay: f64,
    solutions: Vec<Solution>,
    /// Mean logarithm of the residuals' scale over all windows.
    cost: f64,
}

impl<'a> Alone<'a> {
    fn new(
        windows: &'a [Window],
        named: &[Named],
        settings: &SwingSettings,
        clearance: usize,
        law: usize,
        around: Option<f64>,
    ) -> Option<Self> {
        let (names, groups) = groups(windows, named, settings.clearances_m[clearance], law);
        if groups.is_empty() {
            return None;
        }
        // Minus the log-likelihood of normal residuals, each group with its own scale: a group with large torques
        // does not outweigh the others.
        let cost = |delay: f64| -> f64 {
            let log_likelihood =
                |group: &Group<'_>| Some(group.windows.len() as f64 * solve(group, delay)?.scale.ln());
            groups.iter().map(log_likelihood).sum::<Option<f64>>().unwrap_or(f64::INFINITY)
        };
        let last = settings.delays().count() as f64 - 1.0;
        // A known delay is only refined: its place in the table of delays is the start.
        let near = match around {
            Some(delay) => ((delay - settings.delay_range_s[0]) / settings.delay_step_s).clamp(0.0, last),
            None => {
                // Every second delay is enough, because `lowest` looks between them.
                (0..=last as usize)
                    .step_by(2)
                    .map(|step| (step as f64, cost(step as f64)))
                    .min_by(|a, b| a.1.total_cmp(&b.1))?
                    .0
            }
        };
        let delay = lowest(&cost, near, last);
        let solutions = groups.iter().map(|group| solve(group, delay)).collect::<Option<Vec<_>>>()?;
        let cost = cost(delay) / groups.iter().map(|group| group.windows.len() as f64).sum::<f64>();
        Some(Self { names, groups, law, delay, solutions, cost })
    }
}

/// A solution of all groups, and its variances.
#[derive(Clone)]
pub(crate) struct Fit {
    pub names: Vec<Named>,
    /// All unknowns, the delay in steps last; and without the bounds at 0.
    values: DVector<f64>,
    free: DVector<f64>,
    /// Change of all unknowns with the motors' strength, per 1.
    pub by_strength: DVector<f64>,
    /// Change of all unknowns with friction under load of each group, per 1.
    by_load: Vec<DVector<f64>>,
    pub strength: [f64; 2],
    scales: Vec<f64>,
    /// Largest position gain of each group, N·m/rad.
    pub stiffest: Vec<f64>,
    /// Swings and windows of each group.
    pub counts: Vec<[usize; 2]>,
    /// First unknown of each group in the covariance.
    first: Vec<usize>,
    /// Variances of all unknowns.
    variances: Vec<f64>,
    pub logs: usize,
    /// Variances without the bounds at 0.
    loose: Vec<f64>,
}

impl Fit {
    /// Fits the windows with the friction law among `laws` that leaves less unexplained; returns that law too.
    pub fn best(
        windows: &[Window],
        named: &[Named],
        settings: &SwingSettings,
        clearance: usize,
        laws: Range<usize>,
        around: Option<f64>,
    ) -> Option<(usize, Self)> {
        let alone = |law: usize| Alone::new(windows, named, settings, clearance, law, around);
        let mut tried: Vec<Alone<'_>> = laws.filter_map(alone).collect();
        tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        // If the better law has no solution, the other one is taken.
        tried.into_iter().find_map(|alone| Some((alone.law, Self::new(alone, settings)?)))
    }

    fn new(alone: Alone<'_>, settings: &SwingSettings) -> Option<Self> {
        let Alone { names, groups, delay, solutions, .. } = alone;
        let block = |window: &Window| block(window.log, window.at);
        let logs: BTreeSet<usize> =
            groups.iter().flat_map(|group| group.windows.iter().map(|window| window.log)).collect();
        let log = |window: &Window| window.log as u64;
        // Few logs give no usable scatter between logs, so only blocks of time count then.
        let kinds: &[&dyn Fn(&Window) -> u64] = if logs.len() >= LOGS { &[&block, &log] } else { &[&block] };
        let threads = settings.threads;
        let free = together(&groups, &solutions, delay, kinds, &[], threads)?;
        // Each group has its own number of unknowns (three and an offset a joint), so places are sums.
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
        // A second solution, with the negative unknowns held at 0, moves the others to where they belong.
        let held = if negative.is_empty() {
            None
        } else {
            together(&groups, &solutions, delay, kinds, &negative, threads)
        };
        // What errs for longer than a block shows between logs only, so the larger variance counts.
        let larger = |of: &Together, place: usize| {
            of.covariances
                .iter()
                .flatten()
                .map(|covariance| covariance[(place, place)])
                .fold(f64::NAN, f64::max)
        };
        let loose: Vec<f64> = (0..free.values.len()).map(|place| larger(&free, place)).collect();
        // The fit that holds a value at 0 has no variance for it.
        let variance = |place: usize| {
            let bounded = if negative.contains(&place) { &free } else { held.as_ref().unwrap_or(&free) };
            larger(bounded, place)
        };
        let variances: Vec<f64> = (0..free.values.len()).map(variance).collect();
        // A variance that is not positive means that an unknown is not determined; then nothing of this fit can
        // be used.
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
        // The bounded solution gives the values; the free one stays for comparison.
        let chosen = held.as_ref().unwrap_or(&free);
        Some(Self {
            counts: groups.iter().map(count).collect(),
            stiffest: groups.iter().map(stiffest).collect(),
            logs: logs.len(),
            loose,
            names,
            first,
            variances,
            scales: chosen.scales.clone(),
            by_strength: chosen.by_strength.clone(),
            by_load: chosen.by_load.clone(),
            strength: chosen.strength,
            values: chosen.values.clone(),
            free: free.values.clone(),
        })
    }

    /// Whether the numbers are those of a fit with fewer of the same swings, within what the others bring (Hausman 1978,
    /// "Specification tests in econometrics": the variance of the difference is the difference of variances).
    pub fn agrees(&self, fewer: &Self) -> bool {
        let shared = self.names.len();
        (0..shared).flat_map(|group| (0..SHARED).map(move |k| (group, k))).all(|(group, k)| {
            let (mine, theirs) = (self.first[group] + k, fewer.first[group] + k);
            // The difference of two estimated variances can be negative by chance, so it is at least a quarter of
            // the larger one.
            let spread = (fewer.loose[theirs] - self.loose[mine]).max(0.25 * fewer.loose[theirs]);
            (self.free[mine] - fewer.free[theirs]).abs() < 2.0 * spread.sqrt()
        })
    }

    /// The same without the bounds at 0.
    pub fn unbounded(&self) -> Self {
        Self { values: self.free.clone(), ..self.clone() }
    }

    pub fn delay(&self, settings: &SwingSettings) -> f64 {
        settings.delay_range_s[0] + self.values[self.values.len() - 1] * settings.delay_step_s
    }

    pub fn delay_estimate(&self, settings: &SwingSettings) -> Estimate {
        let variance = self.variances.last().copied().unwrap_or(f64::INFINITY);
        Estimate { value: self.delay(settings), error: variance.sqrt() * settings.delay_step_s }
    }

    pub fn estimates(&self, model: &Model) -> Vec<GroupEstimate> {
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
