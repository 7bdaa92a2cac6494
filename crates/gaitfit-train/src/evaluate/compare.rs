//! How one policy differs from another where both walked: the difference trajectory by trajectory.

use super::{Evaluation, TrajectoryErrors};
use gaitfit_sim::stats;
use gaitfit_view::Estimate;
use serde::{Deserialize, Serialize};

/// Differences of one policy minus another, with half their 95 % confidence intervals. Errors are differences
/// of what lies below: a negative one is a smaller error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// The policy.
    pub policy: String,
    /// The policy that it is compared with.
    pub against: String,
    /// Where both walked.
    pub on: String,
    /// Whether differences are of the same trajectories one by one. If not, the intervals are those of independent means,
    /// which are wider.
    pub paired: bool,
    /// Trajectories that both have to their end or fall.
    pub trajectories: usize,
    /// Difference of the linear-velocity error, m/s.
    pub linear_velocity_error: Estimate,
    /// Difference of the angular-velocity error, rad/s.
    pub angular_velocity_error: Estimate,
    /// Difference of the sum of both errors, m/s and rad/s.
    pub tracking_error: Estimate,
    /// Difference of the joints' distance from the motion, rad, if both policies follow one. It counts then,
    /// and the errors above do not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion_error: Option<Estimate>,
    /// Difference of the share of falls.
    pub fall_rate: Estimate,
}

/// Compares two evaluations of the same place.
pub fn compare(on: &str, policy: &Evaluation, against: &Evaluation) -> Comparison {
    // Draws are functions of seed and number, so equal settings give equal trajectories one by one.
    let same = policy.seed == against.seed
        && policy.seconds == against.seconds
        && policy.drawn == against.drawn
        && !policy.errors.is_empty()
        && policy.errors.len() == against.errors.len();
    let comparison = if same { paired(policy, against) } else { independent(policy, against) };
    Comparison {
        policy: policy.policy.clone(),
        against: against.policy.clone(),
        on: on.to_owned(),
        ..comparison
    }
}

fn paired(policy: &Evaluation, against: &Evaluation) -> Comparison {
    let pairs = || policy.errors.iter().zip(&against.errors);
    // Each pair is the same trial under both policies, so chance that both share drops out of the difference.
    let both: Vec<([f64; 3], [f64; 3])> = pairs().filter_map(|(one, other)| (*one).zip(*other)).collect();
    let difference = |value: fn(&[f64; 3]) -> f64| {
        estimate(&both.iter().map(|(one, other)| value(one) - value(other)).collect::<Vec<_>>())
    };
    // A trajectory that diverged has no errors, and is a fall.
    let fell = |errors: &TrajectoryErrors| errors.map_or(1.0, |[_, _, fell]| fell);
    let falls: Vec<f64> = pairs().map(|(one, other)| fell(one) - fell(other)).collect();
    let mut fall_rate = estimate(&falls);
    if falls.iter().all(|&difference| difference == 0.0) {
        // No pair differs: as far as Wilson's interval of the share of pairs that do reaches.
        fall_rate.ci95 = stats::Estimate::share(0, falls.len())
            .and_then(|none| none.ci95)
            // Wilson's interval of 0 begins at 0, so it reaches twice its half.
            .map_or(f64::NAN, |half| 2.0 * half);
    }
    Comparison {
        policy: String::new(),
        against: String::new(),
        on: String::new(),
        paired: true,
        trajectories: both.len(),
        linear_velocity_error: difference(|errors| errors[0]),
        angular_velocity_error: difference(|errors| errors[1]),
        tracking_error: difference(|errors| errors[0] + errors[1]),
        motion_error: paired_motion(policy, against),
        fall_rate,
    }
}

fn independent(policy: &Evaluation, against: &Evaluation) -> Comparison {
    let difference = |one: Estimate, other: Estimate| Estimate {
        mean: one.mean - other.mean,
        // Variances of independent means add.
        ci95: one.ci95.hypot(other.ci95),
    };
    let linear = difference(policy.linear_velocity_error, against.linear_velocity_error);
    let angular = difference(policy.angular_velocity_error, against.angular_velocity_error);
    Comparison {
        policy: String::new(),
        against: String::new(),
        on: String::new(),
        paired: false,
        trajectories: policy.trajectories.min(against.trajectories),
        linear_velocity_error: linear,
        angular_velocity_error: angular,
        // Errors of one trajectory go together: at most their intervals add.
        tracking_error: Estimate { mean: linear.mean + angular.mean, ci95: linear.ci95 + angular.ci95 },
        motion_error: policy
            .motion_error
            .zip(against.motion_error)
            .map(|(one, other)| difference(one, other)),
        fall_rate: difference(policy.fall_rate, against.fall_rate),
    }
}

/// The difference of the distances from the motion, trajectory by trajectory; `None` unless both policies follow one.
fn paired_motion(policy: &Evaluation, against: &Evaluation) -> Option<Estimate> {
    policy.motion_error.zip(against.motion_error)?;
    let pairs = policy.motion_errors.iter().zip(&against.motion_errors);
    let both = pairs.filter_map(|(one, other)| Some(one.as_ref()? - other.as_ref()?));
    Some(estimate(&both.collect::<Vec<f64>>()))
}

/// Mean and half the 95 % confidence interval of a few independent values; what is unknown is NaN.
pub fn of_few(values: &[f64]) -> Estimate {
    let estimate = stats::Estimate::of_few(values);
    estimate
        .map_or_else(Estimate::default, |one| Estimate { mean: one.mean, ci95: one.ci95.unwrap_or(f64::NAN) })
}

fn estimate(values: &[f64]) -> Estimate {
    let estimate = stats::Estimate::from_values(values);
    estimate
        .map_or_else(Estimate::default, |one| Estimate { mean: one.mean, ci95: one.ci95.unwrap_or(f64::NAN) })
}

/// The better of two policies, as far as an interval shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// The policy.
    Policy,
    /// The other one.
    Other,
    /// It cannot be told from chance.
    Neither,
}

impl Comparison {
    /// Returns which of both tracks better: the sign of the difference of both errors added, or of the
    /// distances from a motion that both follow, if its interval excludes zero.
    pub fn better(&self) -> Better {
        let Estimate { mean, ci95 } = self.motion_error.unwrap_or(self.tracking_error);
        // Without an interval nothing is known.
        if mean + ci95 < 0.0 {
            Better::Policy
        } else if mean - ci95 > 0.0 {
            Better::Other
        } else {
            Better::Neither
        }
    }

    /// The differences in words.
    pub fn numbers(&self) -> String {
        let shown = |of: Estimate, unit: &str| match of.ci95.is_finite() {
            true => format!("{:+.4} ± {:.4} {unit}", of.mean, of.ci95),
            false => format!("{:+.4} {unit}", of.mean),
        };
        let how = if self.paired { "paired" } else { "not paired" };
        // Policies that follow a motion have no commands, so their velocity errors mean nothing.
        if let Some(motion) = self.motion_error {
            let count = self.trajectories;
            return format!(
                "distance from the motion {} ({how}, {count} trajectories)",
                shown(motion, "rad")
            );
        }
        format!(
            "linear error {}, angular error {} ({how}, {} trajectories)",
            shown(self.linear_velocity_error, "m/s"),
            shown(self.angular_velocity_error, "rad/s"),
            self.trajectories
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_random::{Purpose, Stream};

    /// Trajectories whose difficulty both policies share.
    fn evaluation(name: &str, gain: f64, errors: bool) -> Evaluation {
        let stream = Stream::new(3, Purpose(99));
        let rows: Vec<TrajectoryErrors> = (0..400)
            .map(|k| {
                let hard = stream.uniform(k);
                let noise = 0.01 * stream.step((gain * 1000.0) as u32).normal(k);
                Some([0.1 + hard + gain + noise, 0.2 + hard, f64::from(k % 100 == 0)])
            })
            .collect();
        let column =
            |index: usize| estimate(&rows.iter().flatten().map(|row| row[index]).collect::<Vec<_>>());
        Evaluation {
            policy: name.to_owned(),
            simulator: String::new(),
            seconds: 4.0,
            seed: 7,
            trajectories: 400,
            reward: Estimate::default(),
            linear_velocity_error: column(0),
            angular_velocity_error: column(1),
            motion_error: None,
            motion_error_at_rest: None,
            motion_seconds: None,
            fall_rate: column(2),
            action_rate: Estimate::default(),
            diverged: 0,
            drift: Vec::new(),
            gait: None,
            ground: Vec::new(),
            drawn: Some("a".to_owned()),
            errors: if errors { rows } else { Vec::new() },
            motion_errors: Vec::new(),
        }
    }

    #[test]
    fn pairs_show_a_difference_that_independent_means_hide() {
        let (one, other) = (evaluation("a", 0.0, true), evaluation("b", 0.02, true));
        let comparison = compare("target", &one, &other);
        assert!(comparison.paired && comparison.trajectories == 400);
        assert!((comparison.linear_velocity_error.mean + 0.02).abs() < 0.003, "{comparison:?}");
        assert!(
            comparison.linear_velocity_error.ci95 < 0.002 && comparison.better() == Better::Policy,
            "{comparison:?}"
        );
        assert_eq!(compare("target", &other, &one).better(), Better::Other);
        let same = compare("target", &one, &one);
        assert_eq!(same.better(), Better::Neither);
        // No pair differs in 400: up to 3.84 / 403.84 of them may.
        assert!((same.fall_rate.ci95 - 0.009512).abs() < 1e-5 && same.fall_rate.mean == 0.0, "{same:?}");
        let plain = compare("target", &one, &Evaluation { errors: Vec::new(), ..other.clone() });
        assert!(!plain.paired && plain.better() == Better::Neither, "{plain:?}");
        assert!((plain.linear_velocity_error.mean - comparison.linear_velocity_error.mean).abs() < 1e-12);
        // Other trajectories are no pairs.
        assert!(!compare("target", &one, &Evaluation { seed: 8, ..other.clone() }).paired);
        // Commands or starts that another task drew are no pairs either.
        assert!(
            !compare("target", &one, &Evaluation { drawn: Some("b".to_owned()), ..other.clone() }).paired
        );
        assert!(!compare("target", &one, &Evaluation { drawn: None, ..other }).paired);
    }

    #[test]
    fn policies_that_follow_a_motion_are_compared_by_their_distance_from_it() {
        let follower = |name: &str, distance: f64| {
            let distances: Vec<Option<f64>> =
                (0..400).map(|k| Some(distance + 0.001 * f64::from(k % 7))).collect();
            let mean = estimate(&distances.iter().flatten().copied().collect::<Vec<_>>());
            // Its velocity errors say the opposite, and mean nothing.
            let plain = evaluation(name, -distance, true);
            Evaluation { motion_error: Some(mean), motion_errors: distances, ..plain }
        };
        let (near, far) = (follower("near", 0.05), follower("far", 0.09));
        let comparison = compare("target", &near, &far);
        assert!(
            (comparison.motion_error.map_or(f64::NAN, |one| one.mean) + 0.04).abs() < 1e-9,
            "{comparison:?}"
        );
        assert_eq!(comparison.better(), Better::Policy);
        assert!(
            comparison.numbers().starts_with("distance from the motion -0.0400"),
            "{}",
            comparison.numbers()
        );
        let walker = evaluation("walks", 0.0, true);
        assert_eq!(compare("target", &near, &walker).motion_error, None);
    }

    #[test]
    fn what_diverged_counts_as_a_fall_and_in_no_error() {
        let (mut one, other) = (evaluation("a", 0.0, true), evaluation("b", 0.0, true));
        one.errors[1] = None;
        let comparison = compare("target", &one, &other);
        assert_eq!(comparison.trajectories, 399);
        assert!((comparison.fall_rate.mean - 1.0 / 400.0).abs() < 1e-12, "{comparison:?}");
    }
}
