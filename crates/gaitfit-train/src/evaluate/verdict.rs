//! Whether a policy walks, in words: it stays up, follows commands far better than a robot that stands still does, and
//! stays where it is when it is told to stand.

use super::{DriftResult, Evaluation};
use crate::world::standing_error;
use gaitfit_learn::task::CommandSettings;

/// Share of the last episodes of a training, with its exploration, from which on a policy has not learnt to stay up.
pub const MANY_FALLS: f64 = 0.5;
/// Largest share of falls of a policy that walks.
const FEW_FALLS: f64 = 0.02;
/// Largest share of the error of a robot that stands still that a policy which walks has.
const FOLLOWS: f64 = 0.5;
/// Max distance (m) and turn (rad) from its start of a robot that is told to stand.
const STANDS: [f64; 2] = [0.2, 0.2];
/// Share of the error of a robot that stands still from which on it goes nowhere.
const NOWHERE: f64 = 0.8;

/// Verdict on a policy, by a measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Whether it walks.
    pub walks: bool,
    /// Distance from a policy that walks: falls and velocity error are each divided by the limit for a policy
    /// that walks, and the larger ratio counts.
    pub shortfall: f64,
    /// The evidence, in a sentence.
    pub text: String,
}

/// The verdict on a measurement under commands of these ranges; none where nothing can be said: some robots
/// diverge, or the task asks for no walking.
pub fn verdict(evaluation: &Evaluation, command: &CommandSettings) -> Option<Verdict> {
    let (error, falls) = (evaluation.linear_velocity_error.mean, evaluation.fall_rate.mean);
    // Documents of other programs may lack the share of falls: it is NaN then.
    if !falls.is_finite() {
        return None;
    }
    // Those that diverge count as falls.
    let or_not = if evaluation.diverged > 0 { " or diverge" } else { "" };
    let fallen = format!("{:.2} % of the trajectories end in a fall{or_not}", 100.0 * falls);
    // Falls are judged first: a robot that falls has errors of a part of its walk only.
    if falls > FEW_FALLS {
        let does = if evaluation.motion_error.is_some() { "follows its motion" } else { "walks" };
        let text = format!("{fallen}; a policy that {does} falls in at most {:.0} %.", 100.0 * FEW_FALLS);
        // A robot that falls early may also follow badly; the greater shortfall counts. A motion has no commands, so its
        // own distance counts. Without a commanded velocity only the falls count.
        let still = standing_error(command);
        let by_error = match (evaluation.motion_error, evaluation.motion_error_at_rest) {
            (Some(motion), Some(rest)) => {
                follows_motion(motion.mean, rest, &fallen).map_or(0.0, |verdict| verdict.shortfall)
            }
            (None, _) if still > 0.0 => error / (FOLLOWS * still),
            _ => 0.0,
        };
        return Some(Verdict { walks: false, shortfall: (falls / FEW_FALLS).max(by_error), text });
    }
    // Few enough robots diverge to pass the limit of falls. But their errors are in no mean, so the rest says
    // too little.
    if evaluation.diverged > 0 {
        return None;
    }
    // A motion has no commands, so its own distance is judged and the velocity is not.
    if let Some(motion) = evaluation.motion_error {
        let rest = evaluation.motion_error_at_rest?;
        return follows_motion(motion.mean, rest, &fallen);
    }
    let still = standing_error(command);
    // A task that commands no velocity has nothing to follow.
    if still == 0.0 || !error.is_finite() {
        return None;
    }
    // The gravest shortcoming is told, and only one.
    let against = goes_nowhere(error, command)
        .or_else(|| follows_badly(error, still))
        .or_else(|| drifts(&evaluation.drift));
    let shortfall = (falls / FEW_FALLS).max(error / (FOLLOWS * still));
    Some(match against {
        Some(text) => Verdict { walks: false, shortfall, text: format!("{text}.") },
        None => Verdict {
            walks: true,
            shortfall,
            text: format!(
                "Walks: its velocity error is {:.0} % of that of a robot that stands still ({still:.2} m/s), and {fallen}",
                100.0 * error / still
            ),
        },
    })
}

/// The verdict on joints that are `off` rad off a motion on average, where those of a robot that stays in its first pose are
/// `rest` rad off; none for a motion that rests.
fn follows_motion(off: f64, rest: f64, fallen: &str) -> Option<Verdict> {
    if !off.is_finite() || rest <= 0.0 {
        return None;
    }
    // The same share as for commands: half of the error of a robot that does nothing.
    let walks = off < FOLLOWS * rest;
    let share = 100.0 * off / rest;
    let than =
        format!("{share:.0} % of the distance of a robot that stays in its first pose ({rest:.3} rad)");
    let text = match walks {
        true => {
            format!("Follows its motion: joints are {off:.3} rad off it on average, {than}, and {fallen}.")
        }
        false => format!(
            "Its joints are {off:.3} rad off the motion on average, {than}; a policy that follows it has less than {:.0} %.",
            100.0 * FOLLOWS
        ),
    };
    Some(Verdict { walks, shortfall: off / (FOLLOWS * rest), text })
}

/// States that a mean velocity error, m/s, is nearly that of a robot that stands still; `None` if it is not.
pub fn goes_nowhere(error: f64, command: &CommandSettings) -> Option<String> {
    let still = standing_error(command);
    (still > 0.0 && error >= NOWHERE * still).then(|| {
        format!("Its velocity error is {error:.2} m/s, where a robot that stands still has {still:.2} m/s")
    })
}

/// States that a mean velocity error, m/s, is a large part of `still`, the error of a robot that stands
/// still; `None` if it is not.
fn follows_badly(error: f64, still: f64) -> Option<String> {
    (error >= FOLLOWS * still).then(|| {
        format!(
            "Its velocity error is {error:.2} m/s, {:.0} % of that of a robot that stands still ({still:.2} m/s); a policy \
             that walks has less than {:.0} %",
            100.0 * error / still,
            100.0 * FOLLOWS
        )
    })
}

/// States that the robot moves when it is told to stand; `None` if it stands, or this was not measured.
fn drifts(trials: &[DriftResult]) -> Option<String> {
    let stand = trials.iter().find(|trial| trial.command == [0.0; 3])?;
    let (distance, turn) = (stand.distance(), stand.yaw.mean.abs());
    let [far, turned] = STANDS;
    (distance > far || turn > turned).then(|| {
        format!(
            "Commanded to stand, it drifts: it ends {distance:.2} m and {turn:.2} rad from its start; the limits are \
             {far} m and {turned} rad"
        )
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_view::Estimate;

    fn command(x: [f64; 2], y: [f64; 2], standing: f64) -> CommandSettings {
        CommandSettings { x, y, yaw: [-1.0, 1.0], seconds: 4.0, standing, curriculum: None }
    }

    #[test]
    fn who_falls_or_stands_does_not_walk() {
        let ranges = command([0.0, 2.0], [0.0, 0.0], 0.0);
        let estimate = |mean| Estimate { mean, ci95: 0.01 };
        let said = |error, falls, diverged| {
            let document = r#"{"trajectories": 10, "linear_velocity_error": {"mean": 0.0, "ci95": 0.0},
                "angular_velocity_error": {"mean": 0.0, "ci95": 0.0}, "fall_rate": {"mean": 0.0, "ci95": 0.0}}"#;
            let mut evaluation: Evaluation = serde_json::from_str(document).unwrap();
            (evaluation.linear_velocity_error, evaluation.fall_rate) = (estimate(error), estimate(falls));
            evaluation.diverged = diverged;
            verdict(&evaluation, &ranges)
        };
        let walks = said(0.2, 0.0125, 0).unwrap();
        assert!(walks.walks && walks.text.contains("20 %") && walks.text.contains("1.25 %"), "{walks:?}");
        let falls = said(0.2, 0.38, 0).unwrap();
        assert!((walks.shortfall - 0.625).abs() < 1e-12 && (falls.shortfall - 19.0).abs() < 1e-12);
        assert!(!falls.walks && falls.text.contains("38.00 %") && falls.text.contains("2 %"), "{falls:?}");
        let lags = said(0.6, 0.0, 0).unwrap();
        assert!(!lags.walks && lags.text.contains("60 %"), "{lags:?}");
        let stands = said(0.9, 0.0, 0).unwrap();
        assert!(
            !stands.walks && stands.text.contains("0.90 m/s") && stands.text.contains("1.00 m/s"),
            "{stands:?}"
        );
        assert_eq!(said(0.2, 0.0, 1), None);
        let diverged = said(f64::NAN, 1.0, 10).unwrap();
        assert!(!diverged.walks && diverged.text.contains("100.00 %") && diverged.text.contains("diverge"));
    }

    #[test]
    fn the_velocity_error_of_who_falls_counts_only_under_commands() {
        let shortfall = |motion: Option<[f64; 2]>, ranges: &CommandSettings| {
            let document = serde_json::json!({
                "trajectories": 10, "linear_velocity_error": { "mean": 3.0, "ci95": 0.0 },
                "angular_velocity_error": { "mean": 0.0, "ci95": 0.0 }, "fall_rate": { "mean": 0.04, "ci95": 0.0 },
                "motion_error": motion.map(|[off, _]| serde_json::json!({ "mean": off, "ci95": 0.0 })),
                "motion_error_at_rest": motion.map(|[_, rest]| rest),
            });
            verdict(&serde_json::from_value(document).unwrap(), ranges).unwrap().shortfall
        };
        let (walking, still) = (command([0.0, 2.0], [0.0; 2], 0.0), command([0.0; 2], [0.0; 2], 0.0));
        let near = |one: f64, other: f64| assert!((one - other).abs() < 1e-12, "{one} {other}");
        near(shortfall(None, &walking), 6.0);
        near(shortfall(None, &still), 2.0);
        for ranges in [&walking, &still] {
            near(shortfall(Some([0.1, 0.25]), ranges), 2.0);
            near(shortfall(Some([0.5, 0.25]), ranges), 4.0);
        }
    }

    #[test]
    fn who_rests_does_not_follow_a_motion() {
        let said = |off, rest| follows_motion(off, rest, "0.00 % of the trajectories end in a fall");
        let follows = said(0.05, 0.25).unwrap();
        assert!(follows.walks && follows.text.contains("20 % of the distance"), "{follows:?}");
        let rests = said(1.245, 0.3).unwrap();
        assert!(!rests.walks && rests.text.contains("less than 50 %"), "{rests:?}");
        assert_eq!(said(0.01, 0.0), None, "the motion rests");
        assert_eq!(said(f64::NAN, 0.3), None);
    }

    #[test]
    fn a_robot_that_drifts_when_told_to_stand_does_not_walk() {
        let trial = |x: f64, yaw: f64| -> Vec<DriftResult> {
            let estimate = |mean: f64| serde_json::json!({ "mean": mean, "ci95": 0.01 });
            let document = serde_json::json!([{
                "name": "stand", "command": [0.0, 0.0, 0.0], "x": estimate(x), "y": estimate(0.0), "yaw": estimate(yaw),
                "fall_rate": estimate(0.0), "diverged": 0, "path": [],
            }]);
            serde_json::from_value(document).unwrap()
        };
        assert_eq!(drifts(&trial(0.05, 0.02)), None);
        assert!(drifts(&trial(0.5, 0.0)).unwrap().contains("0.50 m"));
        assert!(drifts(&trial(0.0, -0.4)).unwrap().contains("0.40 rad"));
        assert_eq!(drifts(&[]), None, "it was not measured");
    }
}
