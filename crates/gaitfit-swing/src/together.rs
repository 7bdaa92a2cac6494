//! All groups together, with what the legs have in common: errors of the base's acceleration.
//!
//! An error of the base's acceleration pulls on every leg that is in the air at that moment, on hips and thighs more than on
//! calves, by masses and levers that are known. So residuals of one moment are Λ a + ε with an unknown a of known spread:
//! a linear mixed model, by generalised least squares, with spreads by expectation and maximisation (Laird & Ware 1982,
//! "Random-effects models for longitudinal data", Biometrics 38).

use crate::equations::Window;
use crate::moment::{Lag, Moment, Row};
use crate::regression::{Group, HUBER, Solution};
use gaitfit_log::MEDIAN_TO_DEVIATION;
use gaitfit_pool::share;
use nalgebra::{DMatrix, DVector, Vector3};
use std::collections::BTreeMap;

/// Rounds of expectation and maximisation.
const ROUNDS: usize = 10;
/// Parts of a pass over all rows, whatever the number of threads: their sums are added in a fixed order.
const PARTS: usize = 8;
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

/// All groups' equations.
struct Equations<'a> {
    groups: &'a [Group<'a>],
    /// The rows of each log and time, in this order.
    moments: Vec<Vec<Row<'a>>>,
    /// Unknowns that are 0.
    held: &'a [usize],
    current: Current,
    threads: usize,
}

/// Present values of the unknowns, and variances.
struct Current {
    /// All unknowns, the delay last.
    values: DVector<f64>,
    /// Variance of the residuals of each group.
    variances: Vec<f64>,
    /// Variance of the base's acceleration.
    shaking: Vector3<f64>,
    /// Number of delays that windows know.
    delays: usize,
}

/// Sums over all rows in one round.
struct Sums {
    /// Below the diagonal and on it.
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// Weighted squares and weights of each group.
    squares: Vec<[f64; 2]>,
    /// Squares of the base's acceleration.
    shakes: Vector3<f64>,
    /// Sizes of what is left in each group.
    sizes: Vec<Vec<f64>>,
}

impl Sums {
    fn add(&mut self, other: Self) {
        self.normal += other.normal;
        self.right += other.right;
        self.shakes += other.shakes;
        for (squares, others) in self.squares.iter_mut().zip(other.squares) {
            squares[0] += others[0];
            squares[1] += others[1];
        }
        for (sizes, others) in self.sizes.iter_mut().zip(other.sizes) {
            sizes.extend(others);
        }
    }
}

impl Current {
    fn lag(&self) -> Lag {
        Lag::from_values(&self.values, self.delays)
    }

    /// Puts the rows of a moment in `moment`; see [`Moment::fill`].
    fn fill(&self, moment: &mut Moment, rows: &[Row<'_>], lag: &Lag) -> Option<()> {
        moment.fill(rows, &self.values, lag, &self.variances, &self.shaking)
    }

    /// Sums over these rows at the present values. It keeps what is left of each row in it.
    fn sums(&self, groups: usize, moments: &mut [Vec<Row<'_>>]) -> Option<Sums> {
        let columns = self.values.len();
        let mut normal = DMatrix::zeros(columns, columns);
        let mut right = DVector::zeros(columns);
        let mut squares = vec![[0.0; 2]; groups];
        let mut shakes = Vector3::zeros();
        let mut sizes: Vec<Vec<f64>> = vec![Vec::new(); groups];
        let lag = self.lag();
        let mut seen = Moment::empty(columns);
        for rows in moments {
            self.fill(&mut seen, rows, &lag)?;
            // The best estimate of the base's acceleration error at this moment, given all rows of it.
            let pull = seen.pull(&|row| seen.residuals[row]);
            let mean = seen.spread * pull;
            // (Xᵀ D⁻¹ X − Xᵀ D⁻¹ Λ C Λᵀ D⁻¹ X), and the same with residuals.
            for (row, unknowns) in seen.unknowns.iter().enumerate() {
                unknowns.add_square(seen.precisions[row], &mut normal);
                unknowns.add(seen.precisions[row] * seen.residuals[row], &mut right);
            }
            // Columns of three slices: this is most of the work.
            let (across, projected) = (seen.across.as_slice(), seen.projected.as_slice());
            for (column, below) in normal.as_mut_slice().chunks_exact_mut(columns).enumerate() {
                let [x, y, z] = [0, 1, 2].map(|axis| across[axis * columns + column]);
                // Most unknowns have no row in a moment, so their columns are 0.
                if (x, y, z) == (0.0, 0.0, 0.0) {
                    continue;
                }
                let [along_x, along_y, along_z] =
                    [0, 1, 2].map(|axis| &projected[axis * columns..][..columns]);
                // The lower half alone: the matrix is symmetric.
                for row in column..columns {
                    below[row] -= along_x[row] * x + along_y[row] * y + along_z[row] * z;
                }
            }
            right -= &seen.projected * pull;
            // Expectation: the second moment of the acceleration's error is that of its mean plus what is not known
            // of it.
            shakes += mean.component_mul(&mean) + seen.spread.diagonal();
            for (row, residual) in rows.iter_mut().zip(&seen.residuals) {
                // Residuals without the estimated acceleration show each group's own noise.
                let lever = Vector3::from(row.window.lever);
                let left = residual - lever.dot(&mean);
                // The same for the residual that is left.
                let square = left * left + lever.dot(&(seen.spread * lever));
                squares[row.group][0] += row.weight * square;
                squares[row.group][1] += row.weight;
                sizes[row.group].push(left.abs());
                row.left = left.abs();
            }
        }
        Some(Sums { normal, right, squares, shakes, sizes })
    }
}

impl<'a> Equations<'a> {
    /// Equations around the solutions of each group alone at `delay` (in steps).
    fn new(
        groups: &'a [Group<'a>],
        solutions: &[Solution],
        delay: f64,
        held: &'a [usize],
        threads: usize,
    ) -> Self {
        let columns: usize = groups.iter().map(Group::columns).sum::<usize>() + 1;
        let mut values = DVector::zeros(columns);
        values[columns - 1] = delay;
        let mut moments: BTreeMap<(usize, u64), Vec<Row<'_>>> = BTreeMap::new();
        let mut first = 0;
        // Each group's solution alone is the start; the joint rounds refine it.
        for (number, (group, solution)) in groups.iter().zip(solutions).enumerate() {
            values.rows_mut(first, group.columns()).copy_from(&solution.values);
            // Windows of all joints have common middles. In units of 0.1 ms these times are whole numbers, which a
            // map can order.
            for (window, weight) in group.windows.iter().zip(&solution.weights) {
                let factors = group.row(window).map(|(place, factor)| {
                    let place = first + place;
                    // Without its factor a held unknown leaves the equations.
                    (place, if held.contains(&place) { 0.0 } else { factor })
                });
                let row = Row { window, group: number, factors, weight: *weight, left: 0.0 };
                moments.entry((window.log, (window.at * 1e4).round() as u64)).or_default().push(row);
            }
            first += group.columns();
        }
        // Held unknowns keep the value 0, whatever the group alone had.
        held.iter().for_each(|&place| values[place] = 0.0);
        let variances = solutions.iter().map(|solution| solution.scale.powi(2)).collect();
        let moments: Vec<Vec<Row<'_>>> = moments.into_values().collect();
        let delays = moments.first().and_then(|rows| rows.first()).map_or(0, |row| row.window.driven.len());
        let current = Current { values, variances, shaking: Vector3::repeat(FIRST * FIRST), delays };
        Self { groups, moments, held, current, threads }
    }

    /// Solves all groups, and gives covariances by `clusters`.
    fn solve(mut self, clusters: &[&dyn Fn(&Window) -> u64]) -> Option<Together> {
        for _ in 0..ROUNDS {
            let sums = self.sums()?;
            self.improve(sums)?;
        }
        // The bread of a sandwich for clustered errors (Liang and Zeger 1986): it goes on both sides of the scores'
        // products, the meat.
        let bread = self.sums()?.normal.try_inverse()?;
        let seen = self.seen()?;
        let lag = self.current.lag();
        let groups = self.groups;
        // Part 0 is the motor's torque, 1 the target's share of it, each further one a group's friction under
        // load.
        let mut explained = self.explained(&seen, &bread, 2 + groups.len(), &|row, part| match part {
            0 => row.motor(&lag),
            1 => row.driven(&lag),
            load if row.group == load - 2 => row.window.signs[groups[row.group].law] * row.motor(&lag).abs(),
            _ => 0.0,
        });
        let by_load = explained.split_off(2);
        let [by_strength, by_target] = <[_; 2]>::try_from(explained).ok()?;
        // The last clusters are the coarsest: logs, if there are enough of them.
        let strength = self.strength(&seen, clusters[clusters.len() - 1], &by_strength, &by_target);
        Some(Together {
            covariances: clusters.iter().map(|cluster| self.covariance(&seen, &bread, cluster)).collect(),
            by_strength,
            by_load,
            strength,
            scales: self.current.variances.iter().map(|variance| variance.sqrt()).collect(),
            values: self.current.values,
        })
        .filter(|together| together.values.iter().all(|value| value.is_finite()))
    }

    /// One pass over all rows at the present values, which keeps what is left of each row in it.
    fn sums(&mut self) -> Option<Sums> {
        let length = self.moments.len().div_ceil(PARTS).max(1);
        // Whatever the number of threads, the parts are the same and are added in the same order: so are the last
        // bits.
        let mut parts: Vec<Option<Sums>> = self.moments.chunks(length).map(|_| None).collect();
        let mut workers = vec![(); self.threads.clamp(1, PARTS)];
        let jobs = self.moments.chunks_mut(length).zip(&mut parts);
        let (current, groups) = (&self.current, self.groups.len());
        share(&mut workers, jobs, |(), (moments, sums)| *sums = current.sums(groups, moments));
        let mut parts = parts.into_iter();
        let mut sums = parts.next()??;
        for part in parts {
            sums.add(part?);
        }
        sums.normal.fill_upper_triangle_with_lower_triangle();
        // The row of a held unknown is empty; 1 on the diagonal keeps the matrix invertible and its step 0.
        self.held.iter().for_each(|&place| sums.normal[(place, place)] = 1.0);
        Some(sums)
    }

    /// Moves values, weights and variances to those that the sums of a round ask for.
    fn improve(&mut self, mut sums: Sums) -> Option<()> {
        // A spread that single large residuals do not move.
        let spread = |sizes: &mut Vec<f64>| {
            let middle = sizes.len() / 2;
            MEDIAN_TO_DEVIATION * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let spreads: Vec<f64> = sums.sizes.iter_mut().map(spread).collect();
        for row in self.moments.iter_mut().flatten() {
            // 1e-300 stands for a residual of 0, which has the full weight.
            row.weight = (HUBER * spreads[row.group] / row.left.max(1e-300)).min(1.0);
        }
        self.current.values += sums.normal.cholesky()?.solve(&sums.right);
        // Maximisation: the variances under which the expected squares of this round are the most likely.
        self.current.variances = sums.squares.iter().map(|[square, weight]| square / weight).collect();
        self.current.shaking = sums.shakes / self.moments.len() as f64;
        Some(())
    }

    /// All moments at the present values.
    fn seen(&self) -> Option<Vec<Moment>> {
        let lag = self.current.lag();
        let seen = |rows: &Vec<Row<'_>>| {
            let mut seen = Moment::empty(self.current.values.len());
            self.current.fill(&mut seen, rows, &lag)?;
            Some(seen)
        };
        self.moments.iter().map(seen).collect()
    }

    /// The values that explain only a part of the torque, for each of `count` parts.
    fn explained(
        &self,
        seen: &[Moment],
        bread: &DMatrix<f64>,
        count: usize,
        part: &dyn Fn(&Row<'_>, usize) -> f64,
    ) -> Vec<DVector<f64>> {
        let mut rights = vec![DVector::zeros(self.current.values.len()); count];
        for (rows, seen) in self.moments.iter().zip(seen) {
            for (number, right) in rights.iter_mut().enumerate() {
                seen.score(&|row| part(&rows[row], number), right);
            }
        }
        for right in &mut rights {
            self.held.iter().for_each(|&place| right[place] = 0.0);
            *right = bread * &*right;
        }
        rights
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
        seen: &[Moment],
        cluster: &dyn Fn(&Window) -> u64,
        by_strength: &DVector<f64>,
        by_target: &DVector<f64>,
    ) -> [f64; 2] {
        let lag = self.current.lag();
        // By the motor's torque, and by its part that follows the targets.
        let mut sums: [BTreeMap<u64, [f64; 2]>; 2] = Default::default();
        for (rows, seen) in self.moments.iter().zip(seen) {
            // All rows of a moment belong to one log and time, so the first one names the cluster.
            let [low, high] = sums.each_mut().map(|sums| sums.entry(cluster(rows[0].window)).or_default());
            // For each instrument z: Σ z·residual over Σ z·torque.
            for (number, row) in rows.iter().enumerate() {
                let unknowns = &seen.unknowns[number];
                let unexplained = row.motor(&lag) - unknowns.dot(by_strength);
                let instruments = [unexplained, row.driven(&lag) - unknowns.dot(by_target)];
                for (sums, instrument) in [&mut *low, &mut *high].into_iter().zip(instruments) {
                    let weight = seen.precisions[number] * instrument;
                    sums[0] -= weight * seen.residuals[number];
                    sums[1] += weight * unexplained;
                }
            }
        }
        let ([low, _], [high, error]) = (ratio(&sums[0]), ratio(&sums[1]));
        // The truth may be anywhere between the two, so half of their distance counts as an error too.
        let strength = Some([0.5 * (low + high), error.hypot(0.5 * (high - low))]);
        // Logs whose targets stand still do not show the strength.
        strength.filter(|one| one.iter().all(|part| part.is_finite())).unwrap_or([0.0, 1.0])
    }

    /// Covariance of the values if rows of one cluster may err together; `None` of few clusters.
    fn covariance(
        &self,
        seen: &[Moment],
        bread: &DMatrix<f64>,
        cluster: &dyn Fn(&Window) -> u64,
    ) -> Option<DMatrix<f64>> {
        let columns = self.current.values.len();
        let mut scores: BTreeMap<u64, DVector<f64>> = BTreeMap::new();
        for (rows, seen) in self.moments.iter().zip(seen) {
            // All rows of a moment belong to one log and time, so the first one names the cluster.
            let score = scores.entry(cluster(rows[0].window)).or_insert_with(|| DVector::zeros(columns));
            seen.score(&|row| seen.residuals[row], score);
        }
        let count = scores.len() as f64;
        // The scatter of fewer clusters says nothing.
        if count < 4.0 {
            return None;
        }
        let mut meat = DMatrix::zeros(columns, columns);
        scores.values().for_each(|score| meat.ger(1.0, score, score, 1.0));
        // The factor corrects for few clusters: the scores sum to 0, so one of them is not free.
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
    threads: usize,
) -> Option<Together> {
    Equations::new(groups, solutions, delay, held, threads).solve(clusters)
}

/// A ratio of sums by clusters, and its standard error.
fn ratio(clusters: &BTreeMap<u64, [f64; 2]>) -> [f64; 2] {
    let sum = |k: usize| clusters.values().map(|sums| sums[k]).sum::<f64>();
    let value = sum(0) / sum(1);
    let square: f64 = clusters.values().map(|[above, below]| (above - value * below).powi(2)).sum();
    let count = clusters.len() as f64;
    [value, (square * count / (count - 1.0).max(1.0)).sqrt() / sum(1).abs()]
}
