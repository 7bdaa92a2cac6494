//! Equations to which one column more is added: the added-variable regression of Frisch and Waugh 1933, "Partial time regressions
//! as compared with individual trends", Econometrica 1.

use crate::equations::Window;
use crate::regression::{Group, SHARED, solve};
use gaitfit_log::{BLOCK_S, Estimate};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Fewer blocks say nothing of an error.
const BLOCKS: usize = 8;

/// The equations of a group's swings at a delay.
pub(crate) struct Equations {
    rows: Vec<Vec<f64>>,
    /// The sides that are known, N·m.
    pub known: Vec<f64>,
    weights: Vec<f64>,
    blocks: Vec<u64>,
}

impl Equations {
    /// `steps`: the delay in steps. Absent if the windows do not determine the group's numbers.
    pub fn new(group: &Group<'_>, steps: f64) -> Option<Self> {
        let solution = solve(group, steps)?;
        // The delay is a number of the model too.
        let row = |window: &&Window| {
            let mut row = vec![0.0; group.columns()];
            group.row(window).iter().for_each(|&(place, factor)| row[place] += factor);
            row.push(window.torque(steps + 0.5) - window.torque(steps - 0.5));
            row
        };
        Some(Self {
            rows: group.windows.iter().map(row).collect(),
            known: group.windows.iter().map(|window| window.torque(steps)).collect(),
            weights: solution.weights,
            blocks: group.windows.iter().map(|window| block(window.log, window.at)).collect(),
        })
    }

    /// The equations solved; absent if they do not determine their unknowns.
    pub fn base(&self) -> Option<Base<'_>> {
        Base::new(&self.rows, &self.known, &self.weights, &self.blocks)
    }
}

/// A block of time of a log. The log has the upper half of the number, the block the lower one.
pub(crate) fn block(log: usize, at: f64) -> u64 {
    ((log as u64) << 32) + (at.max(0.0) / BLOCK_S) as u64
}

/// Equations that a model has anyway, solved, to which one column more is added.
pub(crate) struct Base<'a> {
    rows: &'a [Vec<f64>],
    weights: &'a [f64],
    blocks: &'a [u64],
    /// Inverse of the normal matrix.
    inverse: DMatrix<f64>,
    /// Residuals: the known side of each equation less what the solution explains of it.
    left: Vec<f64>,
}

impl<'a> Base<'a> {
    /// `None` where the equations do not determine their unknowns, or are of too few blocks.
    pub fn new(rows: &'a [Vec<f64>], known: &[f64], weights: &'a [f64], blocks: &'a [u64]) -> Option<Self> {
        let columns = rows.first()?.len();
        let distinct: std::collections::BTreeSet<u64> = blocks.iter().copied().collect();
        if distinct.len() < BLOCKS || rows.len() < 3 * (columns + SHARED) {
            return None;
        }
        let mut normal = DMatrix::zeros(columns, columns);
        for (row, weight) in rows.iter().zip(weights) {
            let row = DVector::from_column_slice(row);
            normal.ger(*weight, &row, &row, 1.0);
        }
        let inverse = normal.cholesky()?.inverse();
        let mut base = Self { rows, weights, blocks, inverse, left: Vec::new() };
        base.left = base.without(known);
        Some(base)
    }

    /// The unknowns if `column` were the known side.
    pub fn values(&self, column: &[f64]) -> DVector<f64> {
        let mut right = DVector::zeros(self.inverse.nrows());
        for ((row, value), weight) in self.rows.iter().zip(column).zip(self.weights) {
            right.axpy(weight * value, &DVector::from_column_slice(row), 1.0);
        }
        &self.inverse * right
    }

    /// A column less what the rows explain of it.
    fn without(&self, column: &[f64]) -> Vec<f64> {
        let values = self.values(column);
        let explained = |row: &Vec<f64>| row.iter().zip(values.iter()).map(|(a, b)| a * b).sum::<f64>();
        self.rows.iter().zip(column).map(|(row, value)| value - explained(row)).collect()
    }

    /// Root mean square of what the equations leave, with its error by the scatter of blocks.
    pub fn scatter(&self) -> Estimate {
        let mut sums: BTreeMap<u64, [f64; 2]> = BTreeMap::new();
        for ((left, weight), block) in self.left.iter().zip(self.weights).zip(self.blocks) {
            let sum = sums.entry(*block).or_default();
            sum[0] += weight * left * left;
            sum[1] += weight;
        }
        let total: f64 = sums.values().map(|[_, weight]| weight).sum();
        let mean = sums.values().map(|[square, _]| square).sum::<f64>() / total;
        let variance: f64 =
            sums.values().map(|[square, weight]| (square - mean * weight).powi(2)).sum::<f64>()
                / total.powi(2);
        let value = mean.max(0.0).sqrt();
        // The error of a root, to first order: half the error of the square over the root.
        Estimate { value, error: 0.5 * variance.sqrt() / value.max(1e-12) }
    }

    /// The unknown of `column` in the equations, and the part of what they leave that it explains.
    pub fn added(&self, column: &[f64]) -> Option<(Estimate, f64)> {
        // The added-variable regression: what the known columns explain is taken out of the new one, and what is
        // left of it is regressed on the residuals.
        let rest = self.without(column);
        let sum =
            |of: &dyn Fn(usize) -> f64| -> f64 { (0..rest.len()).map(|k| self.weights[k] * of(k)).sum() };
        let square = sum(&|k| rest[k] * rest[k]);
        let before = sum(&|k| self.left[k] * self.left[k]);
        let whole: f64 = column.iter().zip(self.weights).map(|(x, w)| w * x * x).sum();
        // What the rows explain already, but for rounding, says nothing.
        if !(square > 1e-6 * whole && before > 0.0) {
            return None;
        }
        let value = sum(&|k| rest[k] * self.left[k]) / square;
        // Errors within a block go together (Liang and Zeger 1986), so scores are summed by block before they are
        // squared.
        let mut scores: BTreeMap<u64, f64> = BTreeMap::new();
        for k in 0..rest.len() {
            let left = self.left[k] - value * rest[k];
            *scores.entry(self.blocks[k]).or_default() += self.weights[k] * rest[k] * left;
        }
        let count = scores.len() as f64;
        // The factor corrects for few blocks: the scores sum to 0, so one of them is not free.
        let variance =
            scores.values().map(|score| score * score).sum::<f64>() / square.powi(2) * count / (count - 1.0);
        let after = sum(&|k| (self.left[k] - value * rest[k]).powi(2));
        let size = Estimate { value, error: variance.sqrt() };
        size.value.is_finite().then_some((size, (1.0 - after / before).clamp(0.0, 1.0)))
    }
}
