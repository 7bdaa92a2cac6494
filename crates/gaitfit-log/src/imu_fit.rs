//! Orientation and rates of a log against each other: which reading of the rates makes them the derivative of the
//! orientation.
//!
//! Over a short span the base turns by a (from the orientation at both ends) and by c (the integral of the rates). If both
//! are of one body, a = c. Other readings of the same columns (the other order of the quaternion, rates in the world frame,
//! negated, in degrees, about other axes) are a = ± s P c with a signed permutation P, of a as that order and frame have it.
//! What a reading leaves unexplained is the root of Σ|a − ± s P c|² / Σ|a|², about the means: a constant bias is no wrong
//! reading.

use crate::imu_settings::{ImuSettings, QuaternionOrder, RateFrame, RateUnit};
use crate::scale::{GAP, typical_step};
use crate::{BaseState, Trajectory};
use gaitfit_model::rotation::{Quat, Vec3, inverse, normalize, product, quat_of};

/// Length of a span, s: long against the noise of attitude filters, short against a step.
const SPAN_S: f64 = 0.04;
/// Min number of spans that say something.
const ENOUGH: usize = 40;
/// Length of the shortest log that says something, s.
const MIN_S: f64 = 0.8;
/// RMS rate, rad/s, below which noise is most of it: slow walks have 0.19.
const MOVES: f64 = 0.1;
/// Where one of the two is below [`MOVES`], they are compared only if the other is at least this many times [`MOVES`].
const FIVE_TIMES: f64 = 5.0;
/// Unexplained part up to which a reading is right. Walks of simulated robots at 50 Hz leave 0.14, of a real Go2 0.10.
pub(crate) const FITS: f64 = 0.25;
/// A reading that leaves more than this part of what the columns' names leave is no improvement.
const BETTER: f64 = 0.5;
/// Unexplained part from which on orientation and rates do not belong together.
pub(crate) const APART: f64 = 0.6;
/// Part of the spans, those in which most turns, that do not count.
const TRIMMED: f64 = 0.03;
/// A reading counts as decided if every other one leaves so many times as much.
const CLEAR: f64 = 1.5;
/// A reading with turned axes must leave less than this part of what simpler ones leave: each of 24 turns may fit by chance.
const SIMPLER: f64 = 0.6;

/// One reading of the columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    pub order: QuaternionOrder,
    pub frame: RateFrame,
    pub unit: RateUnit,
    pub negated: bool,
    /// Base axis (0 to 2) and sign of the rates' x, y and z.
    pub axes: [(usize, f64); 3],
}

/// Rates about the base's own axes.
const BASE_AXES: [(usize, f64); 3] = [(0, 1.0), (1, 1.0), (2, 1.0)];

impl Reading {
    const AS_NAMED: Reading = Reading {
        order: QuaternionOrder::Wxyz,
        frame: RateFrame::Body,
        unit: RateUnit::Radians,
        negated: false,
        axes: BASE_AXES,
    };

    /// Whether the rates are about the axes that their names say.
    pub fn base_axes(&self) -> bool {
        self.axes == BASE_AXES
    }

    /// The settings that say it, where it has the rates' own axes.
    pub fn settings(&self) -> ImuSettings {
        let named = Self::AS_NAMED;
        ImuSettings {
            order: (self.order != named.order).then_some(self.order),
            frame: (self.frame != named.frame).then_some(self.frame),
            unit: (self.unit != named.unit).then_some(self.unit),
            negated: self.negated.then_some(true),
            mounting: None,
        }
    }
}

/// Result of comparing a log's orientation with its rates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Verdict {
    /// Unexplained part of the columns as they are named.
    pub as_named: f64,
    /// The reading that explains more, if one does.
    pub better: Option<(Reading, f64)>,
    /// Whether no other reading explains nearly as much.
    pub decided: bool,
    /// RMS of the base's turning rate by orientation, and by the rates as they are named, rad/s.
    pub rms: [f64; 2],
}

/// Sums over all spans, about the means.
struct Moments {
    /// Σ a cᵀ.
    both: [[f64; 3]; 3],
    /// Σ|a|², Σ|c|².
    turned: f64,
    integrated: f64,
    count: usize,
}

impl Moments {
    fn unexplained(&self, reading: &Reading) -> f64 {
        let mut scale = reading.unit.radians();
        if reading.negated {
            scale = -scale;
        }
        let along: f64 =
            reading.axes.iter().enumerate().map(|(of, (axis, sign))| sign * self.both[*axis][of]).sum();
        let left = self.turned - 2.0 * scale * along + scale * scale * self.integrated;
        // Rounding may leave less than 0, and a base that does not turn must not divide by 0.
        (left.max(0.0) / self.turned.max(f64::MIN_POSITIVE)).sqrt()
    }
}

/// Compares orientation and rates; `None` where one is missing or the base hardly turns.
pub(crate) fn judge(log: &Trajectory) -> Option<Verdict> {
    let base = log.base.as_ref()?;
    let (quaternion, rates) = (base.quaternion.as_ref()?, base.angular_velocity.as_ref()?);
    let mut spans = Spans::new(log, rates)?;
    spans.trim(quaternion);
    let named = Reading::AS_NAMED;
    // The named reading first: it is the measure for all others.
    let moments = spans.moments(quaternion, named.order, named.frame)?;
    let rms = |sum: f64| (sum / moments.count as f64).sqrt() / spans.seconds;
    let rms = [rms(moments.turned), rms(moments.integrated)];
    // One of them may stand still for a reason; not beside much of the other.
    if rms[0].min(rms[1]) < MOVES && rms[0].max(rms[1]) < FIVE_TIMES * MOVES {
        return None;
    }
    // All orders, frames, units and signs; turned axes only with the named order and frame, as more combinations would
    // fit by chance.
    let as_named = moments.unexplained(&named);
    let mut readings: Vec<(Reading, f64)> = Vec::new();
    for order in [QuaternionOrder::Wxyz, QuaternionOrder::Xyzw] {
        for frame in [RateFrame::Body, RateFrame::World] {
            let Some(moments) = spans.moments(quaternion, order, frame) else { continue };
            for unit in [RateUnit::Radians, RateUnit::Degrees] {
                for negated in [false, true] {
                    let reading = Reading { order, frame, unit, negated, axes: BASE_AXES };
                    readings.push((reading, moments.unexplained(&reading)));
                }
            }
            if (order, frame) == (named.order, named.frame) {
                for unit in [RateUnit::Radians, RateUnit::Degrees] {
                    for axes in turns().into_iter().filter(|axes| *axes != BASE_AXES) {
                        for negated in [false, true] {
                            let reading = Reading { order, frame, unit, negated, axes };
                            // The handicap of [`SIMPLER`].
                            readings.push((reading, moments.unexplained(&reading) / SIMPLER));
                        }
                    }
                }
            }
        }
    }
    readings.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (reading, left) = *readings.first()?;
    // Another reading counts only if the named one does not fit and the other one clearly does.
    let improves = reading != named && as_named > FITS && left < BETTER * as_named && left < APART * BETTER;
    // A base that keeps its heading at 0 has the same rates in both frames, and either reading is right; negated, the other
    // frame means an orientation that is the inverse of what it should be.
    let same = |other: &Reading| !reading.negated && Reading { frame: reading.frame, ..*other } == reading;
    let inverse = reading.negated && reading.frame == RateFrame::World;
    let decided = !inverse && readings[1..].iter().all(|(other, value)| same(other) || *value > CLEAR * left);
    let better = improves.then_some((reading, left));
    Some(Verdict { as_named, better, decided: decided && reading.base_axes() && left < FITS * CLEAR, rms })
}

/// The 24 turns of the axes by right angles, as signed permutations.
fn turns() -> Vec<[(usize, f64); 3]> {
    // The first three are even permutations, the others odd ones.
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let mut turns = Vec::with_capacity(24);
    for (number, order) in orders.into_iter().enumerate() {
        for signs in 0..8u32 {
            let sign = |axis: u32| if signs >> axis & 1 == 1 { -1.0 } else { 1.0 };
            // A turn keeps handedness: an even permutation has an even number of signs.
            if (signs.count_ones() % 2 == 0) == (number < 3) {
                turns.push([(order[0], sign(0)), (order[1], sign(1)), (order[2], sign(2))]);
            }
        }
    }
    turns
}

/// The spans of a log, and the integral of its rates over each.
struct Spans {
    /// First samples.
    starts: Vec<usize>,
    /// Samples in one.
    length: usize,
    /// Length of one, s.
    seconds: f64,
    /// Integral of the rates, rad.
    integrated: Vec<Vec3>,
}

impl Spans {
    fn new(log: &Trajectory, rates: &[f64]) -> Option<Self> {
        let typical = typical_step(&log.time)?;
        // At low rates one interval is longer than a span.
        let length = ((SPAN_S / typical).round() as usize).max(1);
        let samples = log.len();
        if log.duration() < MIN_S || samples < length + ENOUGH {
            return None;
        }
        let seconds = length as f64 * typical;
        let (mut starts, mut integrated) = (Vec::new(), Vec::new());
        // Spans may overlap; each sample begins one.
        for start in 0..samples - length {
            let part = log.time[start + length] - log.time[start];
            // Over a gap the rates between the samples are not known.
            if !(part > 0.0 && part <= GAP * seconds) {
                continue;
            }
            let mut sum = [0.0; 3];
            for i in start..start + length {
                // Trapezoidal rule.
                let step = log.time[i + 1] - log.time[i];
                for axis in 0..3 {
                    sum[axis] += 0.5 * step * (rates[3 * i + axis] + rates[3 * i + 3 + axis]);
                }
            }
            if sum.iter().all(|x| x.is_finite()) {
                starts.push(start);
                integrated.push(sum);
            }
        }
        (starts.len() >= ENOUGH).then_some(Self { starts, length, seconds, integrated })
    }

    /// Leaves out the spans in which most turns: a heading that is set anew, or a fall, must not decide.
    fn trim(&mut self, quaternion: &[f64]) {
        let turned = self.turned(quaternion, QuaternionOrder::Wxyz, RateFrame::Body);
        let square = |v: &Vec3| v.iter().map(|x| x * x).sum::<f64>();
        let much: Vec<f64> =
            turned.iter().zip(&self.integrated).map(|(a, c)| square(a) + square(c)).collect();
        let mut order: Vec<usize> = (0..much.len()).collect();
        order.sort_by(|a, b| much[*b].total_cmp(&much[*a]));
        let mut keep = vec![true; much.len()];
        order.iter().take((TRIMMED * much.len() as f64).ceil() as usize).for_each(|&at| keep[at] = false);
        // Both lists lose the same spans.
        let mut kept = keep.iter();
        self.starts.retain(|_| kept.next().copied().unwrap_or(true));
        let mut kept = keep.iter();
        self.integrated.retain(|_| kept.next().copied().unwrap_or(true));
    }

    /// How far the base turns over each span, rad; NaN where the orientation has no numbers.
    fn turned(&self, quaternion: &[f64], order: QuaternionOrder, frame: RateFrame) -> Vec<Vec3> {
        let at = |sample: usize| -> Quat {
            let mut q: Quat = quat_of(&quaternion[4 * sample..4 * sample + 4]);
            if order == QuaternionOrder::Xyzw {
                // x, y, z, w becomes w, x, y, z.
                q.rotate_right(1);
            }
            if q.iter().all(|x| x.is_finite()) { normalize(q) } else { [f64::NAN; 4] }
        };
        let turn = |&start: &usize| {
            let (from, to) = (at(start), at(start + self.length));
            match frame {
                RateFrame::Body => turn_of(product(inverse(from), to)),
                RateFrame::World => turn_of(product(to, inverse(from))),
            }
        };
        self.starts.iter().map(turn).collect()
    }

    fn moments(&self, quaternion: &[f64], order: QuaternionOrder, frame: RateFrame) -> Option<Moments> {
        let turned = self.turned(quaternion, order, frame);
        // Spans without an orientation are left out of means and moments alike.
        let whole = |pair: &(&Vec3, &Vec3)| pair.0.iter().all(|x| x.is_finite());
        let pairs = || turned.iter().zip(&self.integrated).filter(whole);
        let count = pairs().count();
        if count < ENOUGH {
            return None;
        }
        // Means are taken out, because a constant bias is no wrong reading.
        let (mut of_a, mut of_c) = ([0.0; 3], [0.0; 3]);
        for (a, c) in pairs() {
            for axis in 0..3 {
                of_a[axis] += a[axis] / count as f64;
                of_c[axis] += c[axis] / count as f64;
            }
        }
        let mut moments = Moments { both: [[0.0; 3]; 3], turned: 0.0, integrated: 0.0, count };
        for (a, c) in pairs() {
            for i in 0..3 {
                let (x, y) = (a[i] - of_a[i], c[i] - of_c[i]);
                moments.turned += x * x;
                moments.integrated += y * y;
                for k in 0..3 {
                    moments.both[i][k] += x * (c[k] - of_c[k]);
                }
            }
        }
        Some(moments)
    }
}

/// A small turn as axis times angle, rad.
fn turn_of(q: Quat) -> Vec3 {
    // q and −q are the same turn. The sign is that of the shorter one.
    let sign = if q[0] < 0.0 { -1.0 } else { 1.0 };
    let v = [sign * q[1], sign * q[2], sign * q[3]];
    let sine = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    // 2 is the limit of the quotient for small turns.
    let factor = if sine > 1e-12 { 2.0 * sine.atan2(sign * q[0]) / sine } else { 2.0 };
    v.map(|x| factor * x)
}

/// Bias and lag of rates that are read rightly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fine {
    /// Bias, rad/s, and its standard error.
    pub bias: f64,
    pub bias_error: f64,
    /// How much later the rates come than the orientation, s, and its standard error.
    pub lag: f64,
    pub lag_error: f64,
}

/// Parts of a log whose results are compared for the standard errors.
const PARTS: usize = 5;
/// Min number of spans of a part.
const OF_A_PART: usize = 20;

/// Bias and lag of the rates against the orientation: a = c + lag · dc/dt − bias · span, by least squares. The standard
/// errors are those of the mean over five parts of the log.
pub(crate) fn fine(log: &Trajectory) -> Option<Fine> {
    let base = log.base.as_ref()?;
    let BaseState { quaternion: Some(quaternion), angular_velocity: Some(rates), .. } = base else {
        return None;
    };
    // Rates and orientation as they are named: the coarse reading has been settled before.
    let spans = Spans::new(log, rates)?;
    let turned = spans.turned(quaternion, QuaternionOrder::Wxyz, RateFrame::Body);
    // Rates are composed in order here: turns about different axes do not quite add up, which would look like a bias.
    let integrated: Vec<Vec3> =
        spans.starts.iter().map(|start| composed(log, rates, *start, spans.length)).collect();
    // Bias and lag of one part of the log.
    let part = |range: std::ops::Range<usize>| -> Option<(Vec3, f64)> {
        let mut off = [0.0; 3];
        let mut count = 0.0;
        for i in range.clone() {
            let difference: Vec3 = std::array::from_fn(|k| (integrated[i][k] - turned[i][k]) / spans.seconds);
            if difference.iter().all(|x| x.is_finite()) {
                (0..3).for_each(|k| off[k] += difference[k]);
                count += 1.0;
            }
        }
        if count < OF_A_PART as f64 {
            return None;
        }
        off.iter_mut().for_each(|x| *x /= count);
        // y = (a − c) about its mean against c and dc/dt.
        let mut mean_c = [0.0; 3];
        range.clone().for_each(|i| (0..3).for_each(|k| mean_c[k] += integrated[i][k] / range.len() as f64));
        let (mut cc, mut cd, mut dd, mut cy, mut dy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        // A derivative needs a span on each side.
        for i in range.start.max(1)..range.end.min(integrated.len() - 1) {
            let (before, after) = (spans.starts[i - 1], spans.starts[i + 1]);
            // A gap: the difference would not be a derivative.
            if after - before != 2 {
                continue;
            }
            let time = log.time[after] - log.time[before];
            for k in 0..3 {
                let c = integrated[i][k] - mean_c[k];
                let d = (integrated[i + 1][k] - integrated[i - 1][k]) / time;
                let y = turned[i][k] - integrated[i][k] + off[k] * spans.seconds;
                if y.is_finite() && d.is_finite() {
                    (cc, cd, dd) = (cc + c * c, cd + c * d, dd + d * d);
                    (cy, dy) = (cy + c * y, dy + d * y);
                }
            }
        }
        // Normal equations of two unknowns: a factor on c, which takes an error of scale, and the lag.
        let determinant = cc * dd - cd * cd;
        (determinant > 0.0).then(|| (off, (cc * dy - cd * cy) / determinant))
    };
    let count = spans.starts.len();
    let (bias, lag) = part(0..count)?;
    // The scatter between parts gives the errors; each part needs samples of its own.
    let parts: Vec<(Vec3, f64)> =
        (0..PARTS).filter_map(|k| part(k * count / PARTS..(k + 1) * count / PARTS)).collect();
    if parts.len() < PARTS {
        return None;
    }
    let spread = |number: &dyn Fn(&(Vec3, f64)) -> f64| {
        let values: Vec<f64> = parts.iter().map(number).collect();
        let mean = values.iter().sum::<f64>() / PARTS as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        (squares / (PARTS - 1) as f64 / PARTS as f64).sqrt()
    };
    Some(Fine {
        bias: bias.iter().map(|x| x * x).sum::<f64>().sqrt(),
        bias_error: (0..3).map(|k| spread(&|part| part.0[k]).powi(2)).sum::<f64>().sqrt(),
        lag,
        lag_error: spread(&|part| part.1),
    })
}

/// The turn that the rates make from sample `start` over `length` samples, rad.
fn composed(log: &Trajectory, rates: &[f64], start: usize, length: usize) -> Vec3 {
    let mut q: Quat = [1.0, 0.0, 0.0, 0.0];
    for i in start..start + length {
        let step = log.time[i + 1] - log.time[i];
        let w: Vec3 = std::array::from_fn(|k| 0.5 * step * (rates[3 * i + k] + rates[3 * i + 3 + k]));
        let angle = w.iter().map(|x| x * x).sum::<f64>().sqrt();
        let factor = if angle > 1e-12 { (0.5 * angle).sin() / angle } else { 0.5 };
        q = product(q, [(0.5 * angle).cos(), factor * w[0], factor * w[1], factor * w[2]]);
    }
    turn_of(q)
}
