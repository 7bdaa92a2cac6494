//! What logs say of their own sensors, without a robot: how late velocities are, what a gyro reads at rest, how coarse
//! and noisy readings are; and logs without it.

use crate::estimate::{BLOCK_S, Estimate};
use crate::stats::{median, rms};
use crate::{Signal, Trajectory};
use gaitfit_model::rotation::{Quat, Vec3, inverse, product, quat_of};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Fewer blocks do not say how sure an estimate is.
const ENOUGH: usize = 6;
/// Intervals longer than this many periods have a gap in them.
const GAP: f64 = 1.5;
/// Velocities later than this are worth correcting, s.
const LAG_S: f64 = 1e-3;
/// A reading of the gyro at rest worth correcting, rad/s.
const BIAS: f64 = 0.003;

/// Lags, biases and noise of the sensors, estimated from logs alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sensors {
    /// Lag of joint velocities behind positions, s.
    pub velocity_lag: Option<Estimate>,
    /// Bias: the gyro's reading less the rate at which the orientation turns, rad/s, base frame.
    pub gyro_bias: Option<[Estimate; 3]>,
    /// Smallest step of joint positions, rad.
    pub position_step: Option<f64>,
    /// Noise of joint velocities, rad/s: what changes from sample to sample while joints are slow. An upper bound.
    pub velocity_noise: Option<f64>,
    /// Noise of the gyro, rad/s, likewise.
    pub gyro_noise: Option<f64>,
}

/// Sums of a ratio's two sides by blocks of time, for its value and its error.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ratio(BTreeMap<u64, [f64; 2]>);

impl Ratio {
    fn add(&mut self, log: usize, time: f64, above: f64, below: f64) {
        if above.is_finite() && below.is_finite() {
            // The log's number above, the block's below: blocks of two logs never mix.
            let block = ((log as u64) << 32) + (time / BLOCK_S).clamp(0.0, f64::from(u32::MAX)) as u64;
            let sums = self.0.entry(block).or_default();
            *sums = [sums[0] + above, sums[1] + below];
        }
    }

    /// Above over below; the error is that of sums of independent blocks.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        let sum = |k: usize| self.0.values().map(|sums| sums[k]).sum::<f64>();
        let (above, below) = (sum(0), sum(1));
        if self.0.len() < ENOUGH || below.abs() < 1e-12 {
            return None;
        }
        let value = above / below;
        // Standard error of a ratio of sums (Cochran 1977, "Sampling Techniques", chapter 6).
        let square: f64 = self.0.values().map(|[above, below]| (above - value * below).powi(2)).sum();
        let blocks = self.0.len() as f64;
        Some(Estimate { value, error: (square * blocks / (blocks - 1.0)).sqrt() / below.abs() })
    }
}

impl Sensors {
    /// Estimates from logs of one robot.
    pub fn new(logs: &[&Trajectory]) -> Self {
        Self {
            velocity_lag: velocity_lag(logs),
            gyro_bias: gyro_bias(logs),
            position_step: position_step(logs),
            velocity_noise: smallest(logs, |log| {
                (0..log.joints.len()).filter_map(|joint| log.column_at(Signal::Velocity, joint)).collect()
            }),
            gyro_noise: smallest(logs, |log| {
                let rates = log.base.as_ref().and_then(|base| base.angular_velocity.as_deref());
                let column = |rates: &[f64], k: usize| rates.iter().skip(k).step_by(3).copied().collect();
                rates.map_or_else(Vec::new, |rates| (0..3).map(|k| column(rates, k)).collect())
            }),
        }
    }

    /// The log as sensors without the lag and the bias would have recorded it, and what was taken out, each in a sentence.
    /// What does not matter stays.
    pub fn corrected(&self, log: &Trajectory) -> (Trajectory, Vec<String>) {
        let mut better = log.clone();
        let mut said = Vec::new();
        // A lag that is no larger than its error is left alone.
        let lag = self.velocity_lag.filter(|lag| lag.matters(LAG_S));
        let late = log.known_lag() + lag.map_or(0.0, |lag| lag.value);
        // A simulator's known lag is always taken out, the estimated one on top of it.
        if late != 0.0 {
            better.velocity = earlier(log, late);
            // Later corrections see velocities at their positions' times.
            better.simulated_step = None;
        }
        if log.known_lag() > 0.0 {
            said.push(format!(
                "joint velocities of the simulator belong to {:.2} ms before their positions; they are shifted",
                1e3 * log.known_lag()
            ));
        }
        if let Some(lag) = lag {
            let late = if lag.value > 0.0 { "late" } else { "early" };
            said.push(format!(
                "joint velocities are {:.1} ± {:.1} ms {late} against positions; they are shifted",
                1e3 * lag.value.abs(),
                1e3 * lag.error
            ));
        }
        let bias =
            self.gyro_bias.map(|bias| bias.map(|axis| if axis.matters(BIAS) { axis.value } else { 0.0 }));
        if let Some(bias) = bias.filter(|bias| bias.iter().any(|axis| *axis != 0.0))
            && let Some(rates) = better.base.as_mut().and_then(|base| base.angular_velocity.as_mut())
        {
            rates.iter_mut().enumerate().for_each(|(k, rate)| *rate -= bias[k % 3]);
            let [x, y, z] = bias;
            said.push(format!(
                "the gyro reads {x:.4}, {y:.4}, {z:.4} rad/s beyond what the orientation turns by; this is subtracted"
            ));
        }
        (better, said)
    }
}

/// Whether the samples from `first` to `last` follow each other without a gap.
fn whole(log: &Trajectory, first: usize, last: usize) -> bool {
    let span = log.time[last] - log.time[first];
    span > 0.0 && span < GAP * (last - first) as f64 * log.dt()
}

/// How late velocities are behind positions, s, beyond what is known of a simulator's ([`Trajectory::known_lag`]).
///
/// Over one interval h, Δq − h·mean(q̇) = lag·Δq̇. Δq̇ is noisy, which pulls a regression on it towards 0; so the change of
/// the positions' slopes from the interval before to the one after stands in for it, whose noise is independent of both sides
/// (an instrumental variable).
/// Between coarse samples the mean of two velocities is not that of the motion, above all if every sample brings a new
/// target. The data then scatter about the lag, and a part of this scatter counts as error.
pub fn velocity_lag(logs: &[&Trajectory]) -> Option<Estimate> {
    let mut sums = LagSums::default();
    for (number, log) in logs.iter().enumerate() {
        let joints: Vec<usize> = (0..log.joints.len()).collect();
        sums.add(number, log, &joints);
    }
    let Estimate { value, error } = sums.estimate()?;
    Some(Estimate { value, error: error.hypot(COARSE * sums.scatter(value)) })
}

/// Part of the scatter that counts as error. Exact velocities of simulated walks at 50 Hz show a lag of 0.17 to
/// 0.31 of the scatter.
const COARSE: f64 = 0.2;

/// Sums of [`velocity_lag`].
#[derive(Clone, Debug, Default)]
pub(crate) struct LagSums {
    ratio: Ratio,
    /// Σm², Σm·Δq̇ and Σ(Δq̇)², m: what the mean of two velocities lacks.
    squares: [f64; 3],
}

impl LagSums {
    /// Adds `joints` (columns) of log number `number`.
    pub(crate) fn add(&mut self, number: usize, log: &Trajectory, joints: &[usize]) {
        let width = log.joints.len();
        for sample in 1..log.len().saturating_sub(2) {
            // Four samples in a row are needed: the interval itself and one on each side.
            if !whole(log, sample - 1, sample + 2) {
                continue;
            }
            let time = |k: usize| log.time[k];
            let step = time(sample + 1) - time(sample);
            for joint in joints {
                let q = |k: usize| log.position[k * width + joint];
                let dq = |k: usize| log.velocity[k * width + joint];
                let change = dq(sample + 1) - dq(sample);
                // What the mean of two velocities lacks of the position's change goes with the lag times their
                // difference.
                let missing = q(sample + 1)
                    - q(sample)
                    - step * (dq(sample) + dq(sample + 1)) / 2.0
                    - log.known_lag() * change;
                let bend = (q(sample + 2) - q(sample + 1)) / (time(sample + 2) - time(sample + 1))
                    - (q(sample) - q(sample - 1)) / (time(sample) - time(sample - 1));
                // Instrument: the change of slopes, whose noise is that of other samples.
                self.ratio.add(number, time(sample) - time(0), missing * bend, change * bend);
                if missing.is_finite() && change.is_finite() {
                    let products = [missing * missing, missing * change, change * change];
                    self.squares.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
                }
            }
        }
    }

    /// The lag and its statistical error; `None` if the logs are too short.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        self.ratio.estimate()
    }

    /// Root mean square of m − `lag`·Δq̇ over that of Δq̇, s.
    fn scatter(&self, lag: f64) -> f64 {
        let [missing, both, change] = self.squares;
        let rest = (missing - 2.0 * lag * both + lag * lag * change).max(0.0);
        if change > 0.0 { (rest / change).sqrt() } else { 0.0 }
    }
}

/// Gyro less the rate at which the orientation turns, rad/s, base frame.
pub fn gyro_bias(logs: &[&Trajectory]) -> Option<[Estimate; 3]> {
    let mut ratios = [Ratio::default(), Ratio::default(), Ratio::default()];
    for (number, log) in logs.iter().enumerate() {
        let base = log.base.as_ref();
        let Some((quaternions, rates)) =
            base.and_then(|base| Some((base.quaternion.as_ref()?, base.angular_velocity.as_ref()?)))
        else {
            continue;
        };
        for sample in (0..log.len().saturating_sub(1)).filter(|&sample| whole(log, sample, sample + 1)) {
            let step = log.time[sample + 1] - log.time[sample];
            let quaternion = |k: usize| quat_of(&quaternions[4 * k..]);
            let turned = turn_between(quaternion(sample), quaternion(sample + 1));
            for (k, ratio) in ratios.iter_mut().enumerate() {
                // The gyro's mean over the interval, as the orientation turns over the same interval.
                let gyro = (rates[3 * sample + k] + rates[3 * sample + 3 + k]) / 2.0;
                ratio.add(number, log.time[sample] - log.time[0], step * gyro - turned[k], step);
            }
        }
    }
    let [x, y, z] = ratios.map(|ratio| ratio.estimate());
    Some([x?, y?, z?])
}

/// The turn from one orientation to a near one, rad about the axes of the body.
fn turn_between(from: Quat, to: Quat) -> Vec3 {
    let [w, x, y, z] = product(inverse(from), to);
    let sine = (x * x + y * y + z * z).sqrt();
    // q and −q are the same turn. The sign of w makes it the shorter one.
    let angle = 2.0 * sine.atan2(w.abs()) * w.signum();
    let scale = if sine > 1e-12 { angle / sine } else { 2.0 };
    [scale * x, scale * y, scale * z]
}

/// Smallest step between positions of one joint, rad: of an encoder, or of the digits in the file.
fn position_step(logs: &[&Trajectory]) -> Option<f64> {
    let mut smallest = f64::INFINITY;
    for log in logs {
        for joint in 0..log.joints.len() {
            let column = log.column_at(Signal::Position, joint).unwrap_or_default();
            let steps = column.windows(2).map(|pair| (pair[1] - pair[0]).abs());
            // Smaller steps are rounding of one number.
            smallest = steps.filter(|step| *step > 1e-9).fold(smallest, f64::min);
        }
    }
    smallest.is_finite().then_some(smallest)
}

/// Noise of signals: the lower quarter, over half seconds of all columns, of the RMS of third differences over √20, which is
/// what independent noise of RMS 1 has.
fn smallest(logs: &[&Trajectory], columns: impl Fn(&Trajectory) -> Vec<Vec<f64>>) -> Option<f64> {
    let mut levels = Vec::new();
    for log in logs {
        // Eight samples have five third differences.
        let half = (0.5 * log.rate_hz).ceil().max(8.0) as usize;
        for column in columns(log) {
            for part in column.chunks_exact(half) {
                let third: Vec<f64> = part
                    .windows(4)
                    // Third differences remove a motion that is a parabola in time. 1 + 9 + 9 + 1 = 20.
                    .map(|x| x[3] - 3.0 * x[2] + 3.0 * x[1] - x[0])
                    .filter(|x| x.is_finite())
                    .collect();
                if third.len() > half / 2 {
                    levels.push(rms(&third) / 20f64.sqrt());
                }
            }
        }
    }
    levels.sort_by(f64::total_cmp);
    // The median of the lower half: in the other parts fast motion adds to the noise.
    levels.truncate((levels.len() / 2).max(1));
    median(&mut levels)
}

/// Velocities as they were recorded `lag` s later, by straight lines between samples.
fn earlier(log: &Trajectory, lag: f64) -> Vec<f64> {
    let width = log.joints.len();
    let mut velocity = Vec::with_capacity(log.velocity.len());
    for time in &log.time {
        let at = time + lag;
        // Beyond the ends the interval at that end is used, and the fraction below is cut to 0 or 1.
        let after =
            log.time.partition_point(|known| *known <= at).clamp(1, log.len().saturating_sub(1).max(1));
        let before = after - 1;
        let after = after.min(log.len() - 1);
        let span = log.time[after] - log.time[before];
        let fraction = if span > 0.0 { ((at - log.time[before]) / span).clamp(0.0, 1.0) } else { 0.0 };
        for joint in 0..width {
            let (here, there) = (log.velocity[before * width + joint], log.velocity[after * width + joint]);
            velocity.push(here + fraction * (there - here));
        }
    }
    velocity
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::BaseState;
    use gaitfit_model::rotation::{axis_angle, normalize};

    /// Two joints at 200 Hz whose velocities are `lag` s late, with noise, and a base that rocks under a biased gyro.
    fn log(lag: f64, noise: f64, bias: Vec3, seed: u64) -> Trajectory {
        let mut state = seed;
        let mut draw = || {
            // Sums of twelve numbers of a linear congruential generator are nearly Gaussian.
            let mut sum = -6.0;
            for _ in 0..12 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 11) as f64 / (1u64 << 53) as f64;
            }
            sum
        };
        let time: Vec<f64> = (0..1600).map(|k| 0.005 * k as f64).collect();
        let (mut position, mut velocity, mut quaternion, mut rates) = (vec![], vec![], vec![], vec![]);
        let mut turn = [1.0, 0.0, 0.0, 0.0];
        let rate = |t: f64| [0.8 * (9.0 * t).sin(), 0.5 * (12.0 * t).cos(), 0.3 * (5.0 * t).sin()];
        for t in &time {
            for (k, tempo) in [(0.0, 14.0), (1.0, 31.0)] {
                position.push((tempo * t + k).sin() + 1e-4 * noise * draw());
                velocity.push(tempo * (tempo * (t - lag) + k).cos() + 0.1 * noise * draw());
            }
            quaternion.extend(turn);
            rates.extend((0..3).map(|k| rate(*t)[k] + bias[k] + 0.02 * noise * draw()).collect::<Vec<f64>>());
            let middle = rate(t + 0.0025);
            let speed = middle.iter().map(|x| x * x).sum::<f64>().sqrt();
            turn = normalize(product(turn, axis_angle(middle.map(|x| x / speed), 0.005 * speed)));
        }
        Trajectory {
            base: Some(BaseState {
                quaternion: Some(quaternion),
                angular_velocity: Some(rates),
                ..BaseState::default()
            }),
            ..Trajectory::of_joints(vec!["hip".into(), "calf".into()], 200.0, time, position, velocity)
        }
    }

    #[test]
    fn a_lag_and_a_bias_are_seen_through_noise_and_taken_out() {
        for lag in [0.0, 0.0039, -0.002] {
            let log = log(lag, 1.0, [0.02, 0.0, -0.013], 7);
            let sensors = Sensors::new(&[&log]);
            let estimate = sensors.velocity_lag.unwrap();
            assert!((estimate.value - lag).abs() < 3.0 * estimate.error + 5e-5, "{lag}: {estimate:?}");
            assert!(estimate.error < 3e-4, "{estimate:?}");
            for (estimate, bias) in sensors.gyro_bias.unwrap().iter().zip([0.02, 0.0, -0.013]) {
                assert!((estimate.value - bias).abs() < 3.0 * estimate.error + 1e-5, "{bias}: {estimate:?}");
                assert!(estimate.error < 0.002, "{estimate:?}");
            }
            assert!((sensors.velocity_noise.unwrap() / 0.1 - 1.0).abs() < 0.5, "{sensors:?}");
            let (better, said) = sensors.corrected(&log);
            assert_eq!(said.len(), if lag == 0.0 { 1 } else { 2 }, "{said:?}");
            let again = Sensors::new(&[&better]);
            assert!(again.velocity_lag.unwrap().value.abs() < 4e-4, "{again:?}");
            assert!(again.gyro_bias.unwrap().iter().all(|axis| axis.value.abs() < 0.003), "{again:?}");
        }
    }

    #[test]
    fn good_logs_stay_as_they_are() {
        let log = log(0.0, 0.2, [0.0; 3], 3);
        let (same, said) = Sensors::new(&[&log]).corrected(&log);
        assert_eq!((same, said), (log, vec![]));
    }

    #[test]
    fn short_logs_say_nothing() {
        let short = log(0.0, 1.0, [0.0; 3], 1).slice(0..2).unwrap();
        let sensors = Sensors::new(&[&short]);
        assert_eq!((sensors.velocity_lag, sensors.gyro_bias, sensors.velocity_noise), (None, None, None));
        let empty = short.slice(0..0).unwrap();
        assert_eq!(Sensors::new(&[&empty]), Sensors::default());
        assert_eq!(Sensors::default().corrected(&empty).0, empty);
    }
}
