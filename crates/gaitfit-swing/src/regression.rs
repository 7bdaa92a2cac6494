//! Robust least squares of the averaged equations of one group.

use crate::equations::Window;
use crate::estimate::offsets;
use gaitfit_log::MEDIAN_TO_DEVIATION;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Residuals beyond so many standard deviations count less (Huber 1964). At 2 an estimate from normal residuals
/// loses 1 % of its precision.
pub(crate) const HUBER: f64 = 2.0;
/// Rounds of reweighting.
const ROUNDS: usize = 4;

/// Unknowns that all windows of a group share: friction, damping, armature.
pub(crate) const SHARED: usize = 3;

/// Places of unknowns, and what each is multiplied by.
pub(crate) type Factors = [(usize, f64); SHARED + 1];

/// One group's windows; its unknowns are friction, damping, armature and an offset for each joint.
pub(crate) struct Group<'a> {
    pub windows: Vec<&'a Window>,
    offsets: BTreeMap<usize, usize>,
    pub law: usize,
}

impl<'a> Group<'a> {
    /// A group of some windows, with a friction law by its place.
    pub fn new(windows: Vec<&'a Window>, law: usize) -> Self {
        Self { offsets: offsets(&windows), windows, law }
    }

    /// Number of unknowns.
    pub fn columns(&self) -> usize {
        SHARED + self.offsets.len()
    }

    /// The place of a joint's offset among the unknowns; absent if no window is of the joint.
    pub fn offset(&self, joint: usize) -> Option<usize> {
        self.offsets.get(&joint).map(|place| SHARED + place)
    }

    /// Factors of the unknowns in a window. Unknowns that it does not name have a factor of 0.
    pub fn row(&self, window: &Window) -> Factors {
        let offset = self.offset(window.joint).map_or((0, 0.0), |place| (place, 1.0));
        [(0, window.signs[self.law]), (1, window.rates[0]), (2, window.rates[1]), offset]
    }
}

/// A group's solution at one delay.
#[derive(Clone, Debug)]
pub(crate) struct Solution {
    pub values: DVector<f64>,
    /// Root of the mean weighted square residual, N·m.
    pub scale: f64,
    pub weights: Vec<f64>,
}

/// Robust least squares of a group at a delay (in steps). `None` where the equations do not determine the unknowns.
pub(crate) fn solve(group: &Group<'_>, delay: f64) -> Option<Solution> {
    let (count, columns) = (group.windows.len(), group.columns());
    // Fewer than three equations for each unknown mostly fit their own noise.
    if count < 3 * columns {
        return None;
    }
    let rows: Vec<Factors> = group.windows.iter().map(|window| group.row(window)).collect();
    let known: Vec<f64> = group.windows.iter().map(|window| window.torque(delay)).collect();
    // Iteratively reweighted least squares: the first round has equal weights, each later one Huber's (Huber
    // 1964).
    let mut weights = vec![1.0; count];
    let mut best = None;
    for _ in 0..ROUNDS {
        let mut normal = DMatrix::zeros(columns, columns);
        let mut right = DVector::zeros(columns);
        for ((row, known), weight) in rows.iter().zip(&known).zip(&weights) {
            accumulate(&mut normal, row, *weight);
            for &(place, value) in row {
                right[place] += weight * value * known;
            }
        }
        // Cholesky fails if the equations do not determine an unknown.
        let values = normal.cholesky()?.solve(&right);
        let residuals: Vec<f64> =
            rows.iter().zip(&known).map(|(row, known)| known - product(row, &values)).collect();
        let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
        let middle = count / 2;
        // Few large residuals do not change the median.
        let spread = MEDIAN_TO_DEVIATION * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let scale = (residuals.iter().zip(&weights).map(|(r, w)| w * r * r).sum::<f64>()
            / weights.iter().sum::<f64>())
        .sqrt();
        // 1e-300 stands for a residual of 0, which has the full weight.
        weights = residuals.iter().map(|r| (HUBER * spread / r.abs().max(1e-300)).min(1.0)).collect();
        if !scale.is_finite() {
            return None;
        }
        best = Some(Solution { values, scale, weights: weights.clone() });
    }
    best
}

/// Adds a weighted row's square.
fn accumulate(normal: &mut DMatrix<f64>, row: &Factors, weight: f64) {
    for &(i, a) in row {
        for &(j, b) in row {
            normal[(i, j)] += weight * a * b;
        }
    }
}

fn product(row: &Factors, values: &DVector<f64>) -> f64 {
    row.iter().map(|&(place, factor)| factor * values[place]).sum()
}

/// A joint group: its name and the indices of its joints.
pub(crate) type Named = (String, Vec<usize>);

/// The groups of joints whose swings with more clearance than `above` determine them.
pub(crate) fn groups<'a>(
    windows: &'a [Window],
    named: &[Named],
    above: f64,
    law: usize,
) -> (Vec<Named>, Vec<Group<'a>>) {
    let (mut groups, mut names) = (Vec::new(), Vec::new());
    for (name, joints) in named {
        let group = Group::new(
            windows
                .iter()
                .filter(|window| window.clearance > above && joints.contains(&window.joint))
                .collect(),
            law,
        );
        // The delay changes the known side alone, so any delay tells whether the unknowns are determined.
        if solve(&group, 0.0).is_some() {
            groups.push(group);
            names.push((name.clone(), joints.clone()));
        }
    }
    (names, groups)
}
