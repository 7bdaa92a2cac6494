//! Clipped losses of PPO on a tile of rows, with their derivatives by the networks' outputs.

use super::Samples;
use gaitfit_policy::network::Scalar;

/// ½ ln 2π.
pub(super) const HALF_LOG_TAU: f64 = 0.918_938_533_204_672_8;

/// Numbers of a tile of gathered samples that the losses need; `rows` or `rows × action` each.
#[derive(Clone, Debug, Default)]
pub(super) struct Targets<T> {
    /// Actions drawn.
    pub(super) action: Vec<T>,
    /// Means that they were drawn around.
    pub(super) mean: Vec<T>,
    /// Their log-probability densities then.
    pub(super) log_probability: Vec<T>,
    /// Advantages.
    pub(super) advantage: Vec<T>,
    /// Values foreseen then.
    pub(super) value: Vec<T>,
    /// Values to learn.
    pub(super) returns: Vec<T>,
}

impl Targets<f32> {
    /// Takes what the policy's loss needs of these rows of tiles.
    pub(super) fn gather_for_policy<'a>(&mut self, rows: impl Iterator<Item = (&'a Samples, usize)>) {
        let Self { action, mean, log_probability, advantage, .. } = self;
        for numbers in [&mut *action, mean, log_probability, advantage] {
            numbers.clear();
        }
        for (tile, row) in rows {
            let width = tile.widths.action;
            action.extend_from_slice(&tile.action[row * width..(row + 1) * width]);
            mean.extend_from_slice(&tile.mean[row * width..(row + 1) * width]);
            log_probability.push(tile.log_probability[row]);
            advantage.push(tile.advantage[row]);
        }
    }

    /// Takes what the value's loss needs of these rows of tiles.
    pub(super) fn gather_for_value<'a>(&mut self, rows: impl Iterator<Item = (&'a Samples, usize)>) {
        self.value.clear();
        self.returns.clear();
        for (tile, row) in rows {
            self.value.push(tile.value[row]);
            self.returns.push(tile.returns[row]);
        }
    }
}

/// Numbers that hold for a whole minibatch.
#[derive(Clone, Debug)]
pub(super) struct Constants<T> {
    /// ε of both clips.
    pub(super) clip: T,
    /// Whether the value loss is clipped.
    pub(super) clipped_value_loss: bool,
    /// Factor on the value loss.
    pub(super) value_coefficient: T,
    /// 1 / rows of the minibatch.
    pub(super) weight: T,
    /// ln σ of the policy now.
    pub(super) log_std: Vec<T>,
    /// 1/σ of the policy now.
    pub(super) inverse_std: Vec<T>,
    /// Σ ln σ + ½ ln 2π: minus the log-density at the mean.
    pub(super) log_normaliser: T,
    /// Σ ln(σ/σ₀) + σ₀²/(2σ²) − ½: the KL divergence of equal means.
    pub(super) kl_of_std: T,
}

impl<T: Scalar> Constants<T> {
    /// The constants for the policy's `log_std` now and `old_log_std` when it drew the actions.
    pub(super) fn new(settings: &super::Settings, rows: usize, log_std: &[T], old_log_std: &[T]) -> Self {
        // In `f64` even where the losses are `f32`: these few numbers enter every row.
        let exp = |x: T| T::from_f64(x.to_f64().exp());
        let normaliser: f64 = log_std.iter().map(|s| s.to_f64() + HALF_LOG_TAU).sum();
        // KL divergence of two normal distributions with the same mean, by ln σ; the shift of the means is
        // added row by row.
        let kl = |(new, old): (&T, &T)| {
            let d = old.to_f64() - new.to_f64();
            0.5 * (2.0 * d).exp() - d - 0.5
        };
        Self {
            clip: T::from_f64(settings.clip),
            clipped_value_loss: settings.clipped_value_loss,
            value_coefficient: T::from_f64(settings.value_coefficient),
            weight: T::from_f64(1.0 / rows as f64),
            log_std: log_std.to_vec(),
            inverse_std: log_std.iter().map(|&s| exp(-s)).collect(),
            log_normaliser: T::from_f64(normaliser),
            kl_of_std: T::from_f64(log_std.iter().zip(old_log_std).map(kl).sum()),
        }
    }
}

/// Sums over rows, in a fixed order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    /// Σ max(−A r, −A clip(r)).
    pub(super) surrogate: f64,
    /// Σ of the value loss, without its coefficient.
    pub(super) value: f64,
    /// Σ KL(old ‖ new), in closed form.
    pub(super) kl: f64,
    /// Σ −ln r.
    pub(super) k1: f64,
    /// Σ (r − 1) − ln r.
    pub(super) k3: f64,
    /// Rows with |r − 1| > ε.
    pub(super) clipped: f64,
}

impl Sums {
    /// Adds the sums of other rows.
    pub(super) fn add(&mut self, other: &Self) {
        self.surrogate += other.surrogate;
        self.value += other.value;
        self.kl += other.kl;
        self.k1 += other.k1;
        self.k3 += other.k3;
        self.clipped += other.clipped;
    }
}

/// Policy part: with z = (a − μ)/σ and r = exp(ln π(a) − ln π₀(a)), the loss max(−A r, −A clip(r, 1 ± ε)) (Schulman
/// et al. 2017, equation 7) has ∂/∂ln π = −A r where the first is the greater, else 0; ∂ln π/∂μ = z/σ and
/// ∂ln π/∂ln σ = z² − 1. `mean` and `mean_derivative` are `rows × action`; adds to `log_std_derivative`. Approximate
/// KL divergences: Schulman, "Approximating KL divergence" (2020).
pub(super) fn policy<T: Scalar>(
    constants: &Constants<T>,
    targets: &Targets<T>,
    mean: &[T],
    mean_derivative: &mut [T],
    log_std_derivative: &mut [T],
    sums: &mut Sums,
) {
    let width = constants.log_std.len();
    let half = T::from_f64(0.5);
    let (low, high) = (T::ONE - constants.clip, T::ONE + constants.clip);
    let old = targets.action.chunks_exact(width).zip(targets.mean.chunks_exact(width));
    let now = mean.chunks_exact(width).zip(mean_derivative.chunks_exact_mut(width));
    for (row, ((action, old_mean), (mean, derivative))) in old.zip(now).enumerate() {
        // `derivative` keeps z until the slope of the whole row is known.
        let (mut squares, mut shift) = (T::ZERO, T::ZERO);
        for c in 0..width {
            let z = (action[c] - mean[c]) * constants.inverse_std[c];
            let moved = (old_mean[c] - mean[c]) * constants.inverse_std[c];
            squares += z * z;
            shift += moved * moved;
            derivative[c] = z;
        }
        let log_probability = -half * squares - constants.log_normaliser;
        let log_ratio = log_probability - targets.log_probability[row];
        let ratio = log_ratio.exponential::<false>();
        let advantage = targets.advantage[row];
        // Comparisons and not `min` and `max`, which would replace a NaN by a bound and hide it.
        let clipped = if ratio < low { low } else { ratio };
        let clipped = if clipped > high { high } else { clipped };
        let (plain, bounded) = (-advantage * ratio, -advantage * clipped);
        // Written so that a NaN takes the plain branch and shows in the loss.
        let (loss, slope) =
            if bounded > plain { (bounded, T::ZERO) } else { (plain, plain * constants.weight) };
        for c in 0..width {
            let z = derivative[c];
            derivative[c] = slope * z * constants.inverse_std[c];
            log_std_derivative[c] += slope * (z * z - T::ONE);
        }
        sums.surrogate += loss.to_f64();
        // `kl` is exact for normal distributions and steers the learning rate. k1 and k3 are estimates from
        // the samples, for comparison with other trainers.
        sums.kl += (half * shift + constants.kl_of_std).to_f64();
        sums.k1 -= log_ratio.to_f64();
        sums.k3 += (ratio - T::ONE - log_ratio).to_f64();
        sums.clipped += if ratio < low || ratio > high { 1.0 } else { 0.0 };
    }
}

/// Value part: (V − R)², or the greater of it and (V₀ + clip(V − V₀, ± ε) − R)². `value` and `value_derivative` are
/// `rows`; the derivative includes the coefficient and 1 / rows.
pub(super) fn value<T: Scalar>(
    constants: &Constants<T>,
    targets: &Targets<T>,
    value: &[T],
    value_derivative: &mut [T],
    sums: &mut Sums,
) {
    let clip = constants.clip;
    // The derivative of the square is twice the error; coefficient and mean over the rows are constants.
    let factor = T::from_f64(2.0) * constants.value_coefficient * constants.weight;
    for row in 0..value.len() {
        let (old, target) = (targets.value[row], targets.returns[row]);
        let moved = value[row] - old;
        // As above, a NaN passes through.
        let bounded = if moved < -clip { -clip } else { moved };
        let bounded = if bounded > clip { clip } else { bounded };
        let (plain_error, bounded_error) = (value[row] - target, old + bounded - target);
        let (plain, clipped) = (plain_error * plain_error, bounded_error * bounded_error);
        let (loss, slope) = if constants.clipped_value_loss && clipped > plain {
            // The clip is in force (else the two were equal), and its output does not move.
            (clipped, if bounded == moved { bounded_error } else { T::ZERO })
        } else {
            (plain, plain_error)
        };
        sums.value += loss.to_f64();
        value_derivative[row] = factor * slope;
    }
}
