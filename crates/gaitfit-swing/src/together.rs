//! All groups together, with what the legs have in common: errors of the base's acceleration.
//!
//! An error of the base's acceleration pulls on every leg that is in the air at that moment, on hips and thighs more than on
//! calves, by masses and levers that are known. So residuals of one moment are Λ a + ε with an unknown a of known spread:
//! a linear mixed model, by generalised least squares, with spreads by expectation and maximisation (Laird & Ware 1982,
//! "Random-effects models for longitudinal data", Biometrics 38).

use crate::equations::Window;
use crate::regression::{Factors, Group, HUBER, SHARED, Solution};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::collections::BTreeMap;

/// Rounds of expectation and maximisation.
const ROUNDS: usize = 10;
/// First spread of the base's acceleration, m/s².
const FIRST: f64 = 1.0;

/// Values of all groups, group after group, and the delay in steps at the end.
#[derive(Clone, Debug)]
pub(crate) struct Together {
    pub values: DVector<f64>,
    /// Size of what the equations of each group leave unexplained besides the base's acceleration, N·m.
    pub scales: Vec<f64>,
    /// How the values change with the motors' strength. `values` assume the torques that gains and limits state; for a motor
    /// that gives a share `s` of them, the values are `values + (s − 1) by_strength`.
    pub by_strength: DVector<f64>,
    /// How the values change with each group's friction under load, which the equations leave out. This friction is `c` N·m for
    /// each N·m of the motor's torque. A robot that has it has the values `values − c by_load`.
    pub by_load: Vec<DVector<f64>>,
    /// The motors' strength beyond 1, and its standard error.
    pub strength: [f64; 2],
    /// Covariances by each kind of clusters that was asked for; absent where there are too few.
    pub covariances: Vec<Option<DMatrix<f64>>>,
}

/// One window among all groups.
struct Row<'a> {
    window: &'a Window,
    group: usize,
    /// Factors of the group's unknowns, by their places among all.
    factors: Factors,
    weight: f64,
    /// Size of what is left beside the base's acceleration, N·m.
    left: f64,
}

impl Row<'_> {
    /// The motor's torque, N·m.
    fn motor(&self, values: &DVector<f64>) -> f64 {
        self.window.motor + self.driven(values)
    }

    /// The part of the motor's torque that follows the targets, N·m.
    fn driven(&self, values: &DVector<f64>) -> f64 {
        self.window.driven_at(values[values.len() - 1])
    }

    /// Residual and the factors of the unknowns, at these values.
    fn at(&self, values: &DVector<f64>) -> (f64, Unknowns) {
        let last = values.len() - 1;
        let delay = values[last];
        let mut residual = self.window.torque(delay);
        for &(place, factor) in &self.factors {
            residual -= factor * values[place];
        }
        let slope = -0.5 * (self.window.torque(delay + 1.0) - self.window.torque(delay - 1.0));
        let [friction, damping, armature, offset] = self.factors;
        (residual, Unknowns([friction, damping, armature, offset, (last, slope)]))
    }
}

/// The unknowns of a row and their factors: those of its group, then the delay.
struct Unknowns([(usize, f64); SHARED + 2]);

impl Unknowns {
    /// Adds the factors, `times` each, to the numbers of all unknowns.
    fn add(&self, times: f64, sum: &mut DVector<f64>) {
        for &(place, factor) in &self.0 {
            sum[place] += times * factor;
        }
    }

    /// Adds the factors' products, `times` each, to those of all unknowns: below the diagonal and on it.
    fn add_square(&self, times: f64, sum: &mut DMatrix<f64>) {
        for &(column, b) in &self.0 {
            for &(row, a) in &self.0 {
                if row >= column {
                    sum[(row, column)] += times * b * a;
                }
            }
        }
    }

    fn dot(&self, values: &DVector<f64>) -> f64 {
        self.0.iter().map(|&(place, factor)| factor * values[place]).sum()
    }
}

/// All groups' equations, and what is known of their unknowns so far.
struct Equations<'a> {
    groups: &'a [Group<'a>],
    /// The rows of each log and time.
    moments: BTreeMap<(usize, u64), Vec<Row<'a>>>,
    /// All unknowns, the delay last.
    values: DVector<f64>,
    /// Unknowns that are 0.
    held: &'a [usize],
    /// Variance of the residuals of each group.
    variances: Vec<f64>,
    /// Variance of the base's acceleration.
    shaking: Vector3<f64>,
}

/// Sums over all rows in one round.
struct Sums {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// Weighted squares and weights of each group.
    squares: Vec<[f64; 2]>,
    /// Squares of the base's acceleration.
    shakes: Vector3<f64>,
    /// Sizes of what is left in each group.
    sizes: Vec<Vec<f64>>,
}

impl<'a> Equations<'a> {
    /// From the solutions of each group alone at `delay` (in steps).
    fn new(groups: &'a [Group<'a>], solutions: &[Solution], delay: f64, held: &'a [usize]) -> Self {
        let columns: usize = groups.iter().map(Group::columns).sum::<usize>() + 1;
        let mut values = DVector::zeros(columns);
        values[columns - 1] = delay;
        let mut moments: BTreeMap<(usize, u64), Vec<Row<'_>>> = BTreeMap::new();
        let mut first = 0;
        for (number, (group, solution)) in groups.iter().zip(solutions).enumerate() {
            values.rows_mut(first, group.columns()).copy_from(&solution.values);
            for (window, weight) in group.windows.iter().zip(&solution.weights) {
                let factors = group.row(window).map(|(place, factor)| {
                    let place = first + place;
                    (place, if held.contains(&place) { 0.0 } else { factor })
                });
                let row = Row { window, group: number, factors, weight: *weight, left: 0.0 };
                moments.entry((window.log, (window.at * 1e4).round() as u64)).or_default().push(row);
            }
            first += group.columns();
        }
        held.iter().for_each(|&place| values[place] = 0.0);
        let variances = solutions.iter().map(|solution| solution.scale.powi(2)).collect();
        Self { groups, moments, values, held, variances, shaking: Vector3::repeat(FIRST * FIRST) }
    }

    /// One pass over all rows at the present values, which keeps what is left of each row in it.
    fn sums(&mut self) -> Option<Sums> {
        let columns = self.values.len();
        let mut normal = DMatrix::zeros(columns, columns);
        let mut right = DVector::zeros(columns);
        let mut squares = vec![[0.0; 2]; self.groups.len()];
        let mut shakes = Vector3::zeros();
        let mut sizes: Vec<Vec<f64>> = vec![Vec::new(); self.groups.len()];
        for rows in self.moments.values_mut() {
            let seen: Vec<(f64, Unknowns)> = rows.iter().map(|row| row.at(&self.values)).collect();
            let known = (self.variances.as_slice(), &self.shaking);
            let Common { answer, spread } = Common::new(rows, &seen, known, columns)?;
            let mean = spread * answer.1;
            // (Xᵀ D⁻¹ X − Xᵀ D⁻¹ Λ C Λᵀ D⁻¹ X), and the same with residuals.
            for (row, (residual, unknowns)) in rows.iter().zip(&seen) {
                let precision = row.weight / self.variances[row.group];
                unknowns.add_square(precision, &mut normal);
                unknowns.add(precision * residual, &mut right);
            }
            let projected = &answer.0 * spread;
            // Columns of three slices: this is most of the work.
            let (across, projected_on) = (answer.0.as_slice(), projected.as_slice());
            for (column, below) in normal.as_mut_slice().chunks_exact_mut(columns).enumerate() {
                let [x, y, z] = [0, 1, 2].map(|axis| across[axis * columns + column]);
                let [along_x, along_y, along_z] =
                    [0, 1, 2].map(|axis| &projected_on[axis * columns..][..columns]);
                for row in column..columns {
                    below[row] -= along_x[row] * x + along_y[row] * y + along_z[row] * z;
                }
            }
            right -= &projected * answer.1;
            shakes += mean.component_mul(&mean) + spread.diagonal();
            for (row, (residual, _)) in rows.iter_mut().zip(&seen) {
                let lever = Vector3::from(row.window.lever);
                let left = residual - lever.dot(&mean);
                let square = left * left + (lever.transpose() * spread * lever)[0];
                squares[row.group][0] += row.weight * square;
                squares[row.group][1] += row.weight;
                sizes[row.group].push(left.abs());
                row.left = left.abs();
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        self.held.iter().for_each(|&place| normal[(place, place)] = 1.0);
        Some(Sums { normal, right, squares, shakes, sizes })
    }

    /// Moves values, weights and variances to those that the sums of a round ask for.
    fn improve(&mut self, mut sums: Sums) -> Option<()> {
        // A spread that single large residuals do not move.
        let spread = |sizes: &mut Vec<f64>| {
            let middle = sizes.len() / 2;
            1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let spreads: Vec<f64> = sums.sizes.iter_mut().map(spread).collect();
        for row in self.moments.values_mut().flatten() {
            row.weight = (HUBER * spreads[row.group] / row.left.max(1e-300)).min(1.0);
        }
        self.values += sums.normal.cholesky()?.solve(&sums.right);
        self.variances = sums.squares.iter().map(|[square, weight]| square / weight).collect();
        self.shaking = sums.shakes / self.moments.len() as f64;
        Some(())
    }

    /// What all rows of a moment say if `part` stands for the residual of each.
    fn score(
        &self,
        rows: &[Row<'_>],
        part: &dyn Fn(&Row<'_>, f64) -> f64,
        sum: &mut DVector<f64>,
    ) -> Option<()> {
        let one = |row: &Row<'_>| {
            let (residual, unknowns) = row.at(&self.values);
            (part(row, residual), unknowns)
        };
        let seen: Vec<(f64, Unknowns)> = rows.iter().map(one).collect();
        let Common { answer, spread } =
            Common::new(rows, &seen, (self.variances.as_slice(), &self.shaking), self.values.len())?;
        for (row, (part, unknowns)) in rows.iter().zip(&seen) {
            unknowns.add(row.weight / self.variances[row.group] * part, sum);
        }
        *sum -= &answer.0 * (spread * answer.1);
        Some(())
    }

    /// The values that explain only this part of the torque.
    fn explained(&self, bread: &DMatrix<f64>, part: &dyn Fn(&Row<'_>) -> f64) -> Option<DVector<f64>> {
        let mut right = DVector::zeros(self.values.len());
        for rows in self.moments.values() {
            self.score(rows, &|row, _| part(row), &mut right)?;
        }
        self.held.iter().for_each(|&place| right[place] = 0.0);
        Some(bread * right)
    }

    /// The motors' strength with its error: `by_strength` and `by_target` are the values that explain the motors' torque and
    /// its part that follows the targets.
    ///
    /// Noise moves the joint, and the motor's torque then acts against the noise, so least squares estimate too low a
    /// strength. The targets do not follow the noise, so they are an instrument (Söderström & Stoica 1983, "Instrumental
    /// Variable Methods for System Identification"), but on simulated robots this estimate is too high. The two bracket the
    /// strength.
    fn strength(
        &self,
        cluster: &dyn Fn(&Window) -> u64,
        by_strength: &DVector<f64>,
        by_target: &DVector<f64>,
    ) -> [f64; 2] {
        let by = |instrument: &dyn Fn(&Row<'_>, &Unknowns) -> f64| {
            let mut sums: BTreeMap<u64, [f64; 2]> = BTreeMap::new();
            for rows in self.moments.values() {
                let sums = sums.entry(cluster(rows[0].window)).or_default();
                for row in rows {
                    let (residual, unknowns) = row.at(&self.values);
                    let weight = row.weight / self.variances[row.group] * instrument(row, &unknowns);
                    sums[0] -= weight * residual;
                    sums[1] += weight * (row.motor(&self.values) - unknowns.dot(by_strength));
                }
            }
            ratio(&sums)
        };
        let [low, _] = by(&|row, unknowns| row.motor(&self.values) - unknowns.dot(by_strength));
        let [high, error] = by(&|row, unknowns| row.driven(&self.values) - unknowns.dot(by_target));
        let strength = Some([0.5 * (low + high), error.hypot(0.5 * (high - low))]);
        // Logs whose targets stand still do not show the strength.
        strength.filter(|one| one.iter().all(|part| part.is_finite())).unwrap_or([0.0, 1.0])
    }

    /// Covariance of the values if rows of one cluster may err together; `None` of few clusters.
    fn covariance(&self, bread: &DMatrix<f64>, cluster: &dyn Fn(&Window) -> u64) -> Option<DMatrix<f64>> {
        let columns = self.values.len();
        let mut scores: BTreeMap<u64, DVector<f64>> = BTreeMap::new();
        for rows in self.moments.values() {
            let score = scores.entry(cluster(rows[0].window)).or_insert_with(|| DVector::zeros(columns));
            self.score(rows, &|_, residual| residual, score)?;
        }
        let count = scores.len() as f64;
        if count < 4.0 {
            return None;
        }
        let mut meat = DMatrix::zeros(columns, columns);
        scores.values().for_each(|score| meat.ger(1.0, score, score, 1.0));
        Some((bread * meat * bread) * (count / (count - 1.0)))
    }
}

/// Solves all groups, from the solutions of each alone at `delay` (in steps), and gives covariances by `clusters`. The
/// unknowns `held` are 0.
pub(crate) fn together(
    groups: &[Group<'_>],
    solutions: &[Solution],
    delay: f64,
    clusters: &[&dyn Fn(&Window) -> u64],
    held: &[usize],
) -> Option<Together> {
    let mut equations = Equations::new(groups, solutions, delay, held);
    for _ in 0..ROUNDS {
        let sums = equations.sums()?;
        equations.improve(sums)?;
    }
    let bread = equations.sums()?.normal.try_inverse()?;
    let values = &equations.values;
    let by_strength = equations.explained(&bread, &|row| row.motor(values))?;
    let by_target = equations.explained(&bread, &|row| row.driven(values))?;
    let load = |group: usize| {
        equations.explained(&bread, &|row| {
            let sign = row.window.signs[groups[row.group].law];
            if row.group == group { sign * row.motor(values).abs() } else { 0.0 }
        })
    };
    let by_load = (0..groups.len()).map(load).collect::<Option<Vec<_>>>()?;
    let strength = equations.strength(clusters[clusters.len() - 1], &by_strength, &by_target);
    Some(Together {
        covariances: clusters.iter().map(|cluster| equations.covariance(&bread, cluster)).collect(),
        by_strength,
        by_load,
        strength,
        scales: equations.variances.iter().map(|variance| variance.sqrt()).collect(),
        values: equations.values,
    })
    .filter(|found| found.values.iter().all(|value| value.is_finite()))
}

/// A ratio of sums by clusters, and its standard error.
fn ratio(clusters: &BTreeMap<u64, [f64; 2]>) -> [f64; 2] {
    let sum = |k: usize| clusters.values().map(|sums| sums[k]).sum::<f64>();
    let value = sum(0) / sum(1);
    let square: f64 = clusters.values().map(|[above, below]| (above - value * below).powi(2)).sum();
    let count = clusters.len() as f64;
    [value, (square * count / (count - 1.0).max(1.0)).sqrt() / sum(1).abs()]
}

/// What the equations of one moment say of the base's acceleration.
struct Common {
    /// Xᵀ D⁻¹ Λ, and Λᵀ D⁻¹ r.
    answer: (nalgebra::OMatrix<f64, nalgebra::Dyn, nalgebra::U3>, Vector3<f64>),
    /// Covariance of the acceleration's error.
    spread: Matrix3<f64>,
}

impl Common {
    fn new(
        rows: &[Row<'_>],
        seen: &[(f64, Unknowns)],
        (variances, shaking): (&[f64], &Vector3<f64>),
        columns: usize,
    ) -> Option<Self> {
        let mut across = nalgebra::OMatrix::<f64, nalgebra::Dyn, nalgebra::U3>::zeros(columns);
        let mut pull = Vector3::zeros();
        let mut precision = Matrix3::from_diagonal(&shaking.map(|variance| 1.0 / variance.max(1e-12)));
        for (row, (residual, unknowns)) in rows.iter().zip(seen) {
            let lever = Vector3::from(row.window.lever);
            let weight = row.weight / variances[row.group];
            for &(place, factor) in &unknowns.0 {
                let mut place = across.row_mut(place);
                place += lever.transpose() * (weight * factor);
            }
            pull += lever * (weight * residual);
            precision += lever * lever.transpose() * weight;
        }
        Some(Self { answer: (across, pull), spread: precision.try_inverse()? })
    }
}
