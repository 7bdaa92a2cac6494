//! A robust loss and its normal equations.
//!
//! The loss is Huber's (1964): quadratic up to an elbow, linear beyond, so that a few samples in which the robot does
//! what no candidate can, legs that hit each other for one, hardly count.
//!
//! A foot that touches the ground in one candidate and not in its neighbour makes a derivative of any size, which says
//! nothing. So each derivative is limited to what nine of ten of the same number reach: the bounded influence of
//! Mallows (1975). Without it friction came out 10 to 45 % low on logs of another simulator.

use super::residuals::Residuals;
use gaitfit_sim::pool;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Where the loss turns linear, in medians of the absolute differences: two deviations of normal ones.
const ELBOW: f64 = 3.0;
/// Smallest elbow, where the robot's range is 2: rounding of single-precision signals.
const ROUNDING: f64 = 1e-7;
/// Part of the derivatives of a number that are left as they are.
const LIMITED: f64 = 0.9;

/// Huber's loss of a difference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Loss {
    elbow: f64,
}

impl Loss {
    /// With the elbow that suits `residuals`.
    pub fn new(residuals: &Residuals) -> Self {
        let mut sizes: Vec<f32> =
            residuals.recordings.iter().flatten().map(|residual| residual.abs()).collect();
        let median = quantile(&mut sizes, 0.5);
        Self { elbow: (ELBOW * f64::from(median)).max(ROUNDING) }
    }

    /// The loss of plain least squares: every difference counts in full.
    pub fn square() -> Self {
        Self { elbow: f64::INFINITY }
    }

    /// The squared median of the absolute differences for which [`Self::new`] makes it: few differences of any size do
    /// not change it.
    pub fn bulk(&self) -> f64 {
        (self.elbow / ELBOW).powi(2)
    }

    /// Its mean over all differences.
    pub fn mean(&self, residuals: &Residuals) -> f64 {
        let huber = |residual: &f32| {
            let off = f64::from(*residual).abs();
            if off <= self.elbow { 0.5 * off * off } else { self.elbow * (off - 0.5 * self.elbow) }
        };
        let count: usize = residuals.recordings.iter().map(Vec::len).sum();
        residuals.recordings.iter().map(|one| one.iter().map(huber).sum::<f64>()).sum::<f64>()
            / count.max(1) as f64
    }

    /// Weight of a difference in the normal equations.
    fn weight(&self, residual: f64) -> f64 {
        let off = residual.abs();
        // The slope of Huber's loss over the difference: a square with this weight has the same slope.
        if off <= self.elbow { 1.0 } else { self.elbow / off }
    }
}

/// The value below which the part `part` of `values` lies; 0 of nothing.
fn quantile(values: &mut [f32], part: f64) -> f32 {
    let at = (values.len() as f64 * part) as usize;
    if values.is_empty() {
        return 0.0;
    }
    // The part 1 would lead past the end.
    let at = at.min(values.len() - 1);
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}

/// The derivative of every difference by every entry of θ: one vector an entry and recording.
pub(super) struct Jacobian {
    columns: Vec<Vec<Vec<f32>>>,
    /// Numbers a sample.
    pub width: usize,
}

impl Jacobian {
    /// From candidates moved up and down in one entry each, and the distance between the two, on `threads` threads.
    pub fn new(moved: Vec<(Residuals, Residuals, f64)>, width: usize, threads: usize) -> Self {
        let column = |(up, down, step): (Residuals, Residuals, f64)| {
            // An entry without room to move has no derivative.
            let inverse = if step == 0.0 { 0.0 } else { (1.0 / step) as f32 };
            // Reuses the memory of `up`.
            let mut recordings = up.recordings;
            for (up, down) in recordings.iter_mut().zip(&down.recordings) {
                up.iter_mut().zip(down).for_each(|(up, down)| *up = (*up - down) * inverse);
            }
            limit(&mut recordings, width);
            recordings
        };
        Self { columns: pool::map_each(moved.into_iter(), (threads, threads), column), width }
    }

    /// From the simulator's own derivatives. They are not limited: it has them where nothing touches and makes them
    /// jump.
    pub fn exact(columns: Vec<Vec<Vec<f32>>>, width: usize) -> Self {
        Self { columns, width }
    }

    pub fn entries(&self) -> usize {
        self.columns.len()
    }
}

/// Limits the derivatives by one entry; see the head of the file.
fn limit(recordings: &mut [Vec<f32>], width: usize) {
    let mut column = Vec::new();
    for at in 0..width {
        column.clear();
        column.extend(recordings.iter().flat_map(|one| one.chunks_exact(width)).map(|row| row[at].abs()));
        let max = quantile(&mut column, LIMITED);
        // `clamp` panics at bounds that are NaN.
        if max.is_nan() {
            continue;
        }
        for row in recordings.iter_mut().flat_map(|one| one.chunks_exact_mut(width)) {
            row[at] = row[at].clamp(-max, max);
        }
    }
}

/// Curvature and slope of the loss (its sum, not its mean).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Normal {
    /// Σ w J Jᵀ.
    pub curvature: DMatrix<f64>,
    /// Σ w J r.
    pub slope: DVector<f64>,
}

impl Normal {
    /// The normal equations of the samples `rows` of recording number `recording`.
    pub fn new(
        jacobian: &Jacobian,
        residuals: &Residuals,
        loss: Loss,
        recording: usize,
        rows: Range<usize>,
    ) -> Self {
        let (entries, width) = (jacobian.entries(), jacobian.width);
        let of_recording = &residuals.recordings[recording];
        let (mut row, mut slope) = (vec![0.0f64; entries], vec![0.0; entries]);
        // The lower triangle, row by row.
        let mut lower = vec![0.0; entries * (entries + 1) / 2];
        for at in rows.start * width..rows.end * width {
            let off = f64::from(of_recording[at]);
            let weight = loss.weight(off);
            for (number, column) in row.iter_mut().zip(&jacobian.columns) {
                *number = f64::from(column[recording][at]);
            }
            // `rest` shrinks by a row of the triangle each round, so no index is computed in the inner loop.
            let mut rest = lower.as_mut_slice();
            for (i, slope) in slope.iter_mut().enumerate() {
                let weighted = weight * row[i];
                *slope += weighted * off;
                let (sums, others) = rest.split_at_mut(i + 1);
                sums.iter_mut().zip(&row).for_each(|(sum, number)| *sum += weighted * number);
                rest = others;
            }
        }
        let curvature = DMatrix::from_fn(entries, entries, |i, j| {
            let (row, column) = (i.max(j), i.min(j));
            lower[row * (row + 1) / 2 + column]
        });
        Self { curvature, slope: DVector::from_vec(slope) }
    }

    pub fn zero(entries: usize) -> Self {
        Self { curvature: DMatrix::zeros(entries, entries), slope: DVector::zeros(entries) }
    }

    pub fn add(&mut self, other: &Self) {
        self.curvature += &other.curvature;
        self.slope += &other.slope;
    }

    /// The equations of all samples, computed on `threads` threads.
    pub fn whole(jacobian: &Jacobian, residuals: &Residuals, loss: Loss, threads: usize) -> Self {
        let of_recording = |recording: usize| {
            let rows = residuals.recordings[recording].len() / jacobian.width.max(1);
            Self::new(jacobian, residuals, loss, recording, 0..rows)
        };
        let mut sum = Self::zero(jacobian.entries());
        let parts = pool::map(residuals.recordings.len(), threads, of_recording);
        // In the order of the recordings, so that the sum does not depend on the number of threads.
        parts.iter().for_each(|part| sum.add(part));
        sum
    }

    /// The step that lowers the loss of the local quadratic model most, with `damping` times the diagonal added
    /// (Marquardt 1963), entries that are not `free` held; `None` where the equations cannot be solved.
    pub fn step(&self, damping: f64, free: &[bool]) -> Option<DVector<f64>> {
        // Copies: trials with other dampings use the same equations.
        let mut matrix = self.curvature.clone();
        let mut slope = self.slope.clone();
        let largest = matrix.diagonal().iter().copied().fold(0.0, f64::max);
        for i in 0..free.len() {
            let diagonal = matrix[(i, i)];
            // An entry without any effect stays where it is.
            if !free[i] || diagonal <= 1e-300 || !diagonal.is_finite() {
                matrix.fill_row(i, 0.0);
                matrix.fill_column(i, 0.0);
                // The row, the column and the slope are 0, so any positive number keeps the entry where it is.
                matrix[(i, i)] = largest.max(1e-300);
                slope[i] = 0.0;
            } else {
                matrix[(i, i)] = diagonal * (1.0 + damping);
            }
        }
        // Entries have units that differ by orders of magnitude.
        let scale = matrix.diagonal().map(|value| 1.0 / value.sqrt());
        let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| matrix[(i, j)] * scale[i] * scale[j]);
        let solved = scaled.cholesky()?.solve(&slope.component_mul(&scale));
        let step = -solved.component_mul(&scale);
        step.iter().all(|part| part.is_finite()).then_some(step)
    }
}
