//! The averaged equations of one moment, and what they say together of the base's acceleration.

use crate::equations::{Delay, Window};
use crate::regression::{Factors, SHARED};
use nalgebra::{DMatrix, DVector, Dyn, Matrix3, OMatrix, U3, Vector3};

/// One equation (a window) with the unknowns of its group.
pub(crate) struct Row<'a> {
    pub window: &'a Window,
    pub group: usize,
    /// Factors of the group's unknowns, by their places among all.
    pub factors: Factors,
    pub weight: f64,
    /// Size of what is left beside the base's acceleration, N·m.
    pub left: f64,
}

impl Row<'_> {
    /// The motor's torque, N·m.
    pub fn motor(&self, lag: &Lag) -> f64 {
        self.window.motor + self.driven(lag)
    }

    /// The part of the motor's torque that follows the targets, N·m.
    pub fn driven(&self, lag: &Lag) -> f64 {
        lag.at.driven(self.window)
    }

    /// Residual and the factors of the unknowns, at these values and their delay.
    fn at(&self, values: &DVector<f64>, lag: &Lag) -> (f64, Unknowns) {
        let driven = self.driven(lag);
        let mut residual = self.window.known + driven;
        for &(place, factor) in &self.factors {
            residual -= factor * values[place];
        }
        // A later delay changes the known side. As the factor of an unknown, this slope stands on the other side,
        // hence the minus.
        let slope = -0.5 * (lag.after.driven(self.window) - lag.before.driven(self.window));
        let [friction, damping, armature, offset] = self.factors;
        (residual, Unknowns([friction, damping, armature, offset, (values.len() - 1, slope)]))
    }
}

/// A delay, and those a step shorter and longer.
pub(crate) struct Lag {
    before: Delay,
    at: Delay,
    after: Delay,
}

impl Lag {
    /// From the values of all unknowns, of which the last one is the delay in steps. `delays`: the number of delays at which a window
    /// has a torque.
    pub fn from_values(values: &DVector<f64>, delays: usize) -> Self {
        let steps = values[values.len() - 1];
        let [before, at, after] = [-1.0, 0.0, 1.0].map(|by| Delay::new(steps + by, delays));
        Self { before, at, after }
    }
}

/// The unknowns of a row and their factors: those of its group, then the delay. A list without zeros: with all
/// unknowns of all groups (22 of a quadruped), sums over zeros took half of the time of an examination.
pub(crate) struct Unknowns([(usize, f64); SHARED + 2]);

impl Unknowns {
    /// Adds the factors, `times` each, to the numbers of all unknowns.
    pub fn add(&self, times: f64, sum: &mut DVector<f64>) {
        for &(place, factor) in &self.0 {
            sum[place] += times * factor;
        }
    }

    /// Adds the factors' products, `times` each, to those of all unknowns: below the diagonal and on it.
    pub fn add_square(&self, times: f64, sum: &mut DMatrix<f64>) {
        for &(column, b) in &self.0 {
            for &(row, a) in &self.0 {
                if row >= column {
                    sum[(row, column)] += times * b * a;
                }
            }
        }
    }

    pub fn dot(&self, values: &DVector<f64>) -> f64 {
        self.0.iter().map(|&(place, factor)| factor * values[place]).sum()
    }
}

/// All rows of a moment at some values of the unknowns.
pub(crate) struct Moment {
    pub unknowns: Vec<Unknowns>,
    /// Residual of each row, N·m.
    pub residuals: Vec<f64>,
    /// Weight over variance of each row: the diagonal of D⁻¹.
    pub precisions: Vec<f64>,
    /// Change of each row's torque with an error of the base's acceleration, kg·m: Λ.
    levers: Vec<Vector3<f64>>,
    /// Xᵀ D⁻¹ Λ.
    pub across: OMatrix<f64, Dyn, U3>,
    /// The same times the covariance.
    pub projected: OMatrix<f64, Dyn, U3>,
    /// Covariance of the acceleration's error.
    pub spread: Matrix3<f64>,
}

impl Moment {
    /// Without rows, of so many unknowns.
    pub fn empty(columns: usize) -> Self {
        Self {
            unknowns: Vec::new(),
            residuals: Vec::new(),
            precisions: Vec::new(),
            levers: Vec::new(),
            across: OMatrix::<f64, Dyn, U3>::zeros(columns),
            projected: OMatrix::<f64, Dyn, U3>::zeros(columns),
            spread: Matrix3::zeros(),
        }
    }

    /// Replaces the rows. `variances`: of each group's residuals; `shaking`: of the base's acceleration. `None` if the
    /// covariance of the acceleration cannot be computed.
    pub fn fill(
        &mut self,
        rows: &[Row<'_>],
        values: &DVector<f64>,
        lag: &Lag,
        variances: &[f64],
        shaking: &Vector3<f64>,
    ) -> Option<()> {
        // The buffers are used again: a moment is filled thousands of times.
        self.unknowns.clear();
        self.residuals.clear();
        self.precisions.clear();
        self.levers.clear();
        // Woodbury's identity: Σ⁻¹ = D⁻¹ − D⁻¹ Λ C Λᵀ D⁻¹ with C = (Ψ⁻¹ + Λᵀ D⁻¹ Λ)⁻¹, Ψ the variances of the
        // acceleration. So only a 3 × 3 matrix is inverted. The bound stands for an axis without any shaking.
        self.across.fill(0.0);
        let mut precision = Matrix3::from_diagonal(&shaking.map(|variance| 1.0 / variance.max(1e-12)));
        // Adds this row to Xᵀ D⁻¹ Λ and to the precision of the acceleration.
        for row in rows {
            let (residual, unknowns) = row.at(values, lag);
            let lever = Vector3::from(row.window.lever);
            let weight = row.weight / variances[row.group];
            for &(place, factor) in &unknowns.0 {
                for axis in 0..3 {
                    self.across[(place, axis)] += lever[axis] * (weight * factor);
                }
            }
            precision += lever * lever.transpose() * weight;
            self.unknowns.push(unknowns);
            self.residuals.push(residual);
            self.precisions.push(weight);
            self.levers.push(lever);
        }
        // C of Woodbury's identity.
        self.spread = precision.try_inverse()?;
        self.across.mul_to(&self.spread, &mut self.projected);
        Some(())
    }

    /// Λᵀ D⁻¹ r, for rows that leave these torques.
    pub fn pull(&self, left: &dyn Fn(usize) -> f64) -> Vector3<f64> {
        let terms = self.levers.iter().zip(&self.precisions).enumerate();
        terms.fold(Vector3::zeros(), |sum, (row, (lever, precision))| sum + lever * (precision * left(row)))
    }

    /// Adds what all rows say of the unknowns if they leave these torques.
    pub fn score(&self, left: &dyn Fn(usize) -> f64, sum: &mut DVector<f64>) {
        for (row, (unknowns, precision)) in self.unknowns.iter().zip(&self.precisions).enumerate() {
            unknowns.add(precision * left(row), sum);
        }
        sum.gemv(-1.0, &self.projected, &self.pull(left), 1.0);
    }
}
