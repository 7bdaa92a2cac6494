//! Joints' signals as a page shows them: over time, and as distributions.

/// Positions of one joint over one log, rad, of a slide m. The series share `time_s`; an empty series is not drawn. The page
/// thins them out by itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointTrace {
    /// Joint name.
    pub joint: String,
    /// The log shown.
    pub file: String,
    /// Sample times, s, ascending.
    pub time_s: Vec<f64>,
    /// The robot's encoder.
    pub measured: Vec<f64>,
    /// The fitted simulator.
    pub fitted: Vec<f64>,
    /// The simulator before the fit.
    pub nominal: Vec<f64>,
    /// The position target sent, held until the next sample.
    pub target: Vec<f64>,
    /// Whether the joint slides.
    pub slides: bool,
}

impl JointTrace {
    /// The unit of its positions.
    pub(crate) fn unit(&self) -> &'static str {
        if self.slides { Signal::Position.unit_of_slides() } else { Signal::Position.unit() }
    }
}

/// The unit of the positions of all `joints` together, for a heading.
pub(crate) fn unit_of_positions(joints: &[JointTrace]) -> &'static str {
    match (joints.iter().any(|joint| joint.slides), joints.iter().all(|joint| joint.slides)) {
        (false, _) => "rad",
        (true, true) => "m",
        (true, false) => "rad, slides: m",
    }
}

/// The unit of a number about the positions of all `joints` together, behind the number.
pub(crate) fn unit_in_sentence(joints: &[JointTrace]) -> &'static str {
    match unit_of_positions(joints) {
        unit @ ("rad" | "m") => unit,
        _ => "rad (slides: m)",
    }
}

/// Distribution of one joint's signal, as quantiles at equal steps of probability (0, 1/n, …, 1).
#[derive(Clone, Debug, PartialEq)]
pub struct SignalDistribution {
    /// Joint name.
    pub joint: String,
    /// Whether the joint slides: its positions are in m.
    pub slides: bool,
    /// The signal.
    pub signal: Signal,
    /// Quantiles of the robot's log, in the signal's unit, ascending.
    pub log: Vec<f64>,
    /// Quantiles of the nominal simulator; may be empty.
    pub nominal: Vec<f64>,
    /// Quantiles of the fitted simulator; may be empty.
    pub fitted: Vec<f64>,
    /// Wasserstein-1 distance from nominal to log in the signal's unit, when known.
    pub distance_nominal: f64,
    /// Wasserstein-1 distance from fitted to log in the signal's unit, when known.
    pub distance_fitted: f64,
}

/// A signal of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Signal {
    /// Joint position, rad.
    #[default]
    Position,
    /// Joint velocity, rad/s.
    Velocity,
    /// The policy's action for the joint, without a unit.
    Action,
}

/// Steps of probability in [`SignalDistribution::from_samples`].
const STEPS: usize = 200;

impl SignalDistribution {
    /// Quantiles of samples in the signal's unit, any counts; what is not finite is not counted. The distances stay
    /// unknown.
    pub fn from_samples(joint: &str, signal: Signal, log: &[f64], nominal: &[f64], fitted: &[f64]) -> Self {
        SignalDistribution {
            joint: joint.to_string(),
            signal,
            log: quantiles(log),
            nominal: quantiles(nominal),
            fitted: quantiles(fitted),
            ..SignalDistribution::default()
        }
    }
}

/// Empirical quantiles at `STEPS + 1` probabilities, interpolated between the samples next to them.
fn quantiles(samples: &[f64]) -> Vec<f64> {
    let mut sorted: Vec<f64> = samples.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    // Without a finite sample there are no quantiles, and no curve is drawn.
    let Some(last) = sorted.len().checked_sub(1) else { return Vec::new() };
    let at = |i: usize| {
        // The first quantile is the smallest sample and the last one the largest. Between them ranks are
        // interpolated.
        let exact = i as f64 / STEPS as f64 * last as f64;
        let below = (exact as usize).min(last);
        let share = exact - below as f64;
        sorted[below] * (1.0 - share) + sorted[(below + 1).min(last)] * share
    };
    (0..=STEPS).map(at).collect()
}

impl Signal {
    /// The unit of its samples of hinges; empty when it has none.
    pub fn unit(self) -> &'static str {
        match self {
            Signal::Position => "rad",
            Signal::Velocity => "rad/s",
            Signal::Action => "",
        }
    }

    /// Returns the unit of its samples of slides; empty when it has none.
    pub fn unit_of_slides(self) -> &'static str {
        match self {
            Signal::Position => "m",
            Signal::Velocity => "m/s",
            Signal::Action => "",
        }
    }
}

impl Default for SignalDistribution {
    fn default() -> Self {
        SignalDistribution {
            joint: String::new(),
            slides: false,
            signal: Signal::Position,
            log: Vec::new(),
            nominal: Vec::new(),
            fitted: Vec::new(),
            distance_nominal: f64::NAN,
            distance_fitted: f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_of_slides_are_in_metres() {
        let joint = |slides| JointTrace { slides, ..JointTrace::default() };
        assert_eq!((joint(false).unit(), joint(true).unit()), ("rad", "m"));
        assert_eq!(unit_of_positions(&[]), "rad");
        assert_eq!(unit_of_positions(&[joint(true)]), "m");
        assert_eq!(unit_of_positions(&[joint(false), joint(true)]), "rad, slides: m");
        assert_eq!(unit_in_sentence(&[joint(false), joint(true)]), "rad (slides: m)");
        assert_eq!(unit_in_sentence(&[joint(true)]), "m");
    }

    #[test]
    fn quantiles_lie_between_the_samples() {
        let samples: Vec<f64> = (0..=1000).rev().map(f64::from).chain([f64::NAN]).collect();
        let values = quantiles(&samples);
        assert_eq!((values[0], values[STEPS / 2], values[STEPS]), (0.0, 500.0, 1000.0));
        assert_eq!(quantiles(&[3.0]), [3.0; STEPS + 1]);
        let two = quantiles(&[1.0, 2.0]);
        assert!((two[STEPS / 4] - 1.25).abs() < 1e-12);
        assert!(quantiles(&[f64::INFINITY]).is_empty());
    }
}
