//! Finds joints that differ from their siblings. Siblings are the same joints of the other legs.
//!
//! On a healthy robot siblings behave alike: whatever the simulator lacks looks like the same spring on each of them. So each
//! joint is compared with the median of its siblings. Its difference counts if it is large for two scales: the usual difference
//! of this robot's joints (the median over all joints, which one odd joint does not move), and the error of its own estimate.

use gaitfit_log::MEDIAN_TO_DEVIATION;

/// An estimate for one joint: the stiffness of a spring, N·m/rad, or the strength of a motor, as a part of its torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured<'a> {
    /// The joint's group; joints of one are siblings.
    pub group: &'a str,
    /// The size.
    pub value: f64,
    /// Standard deviation of the estimate. If it is NaN the joint is not odd.
    pub deviation: f64,
    /// Difference from its siblings up to which the joint does not count as odd.
    pub min: f64,
}

/// Differences of joints from their siblings.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// Difference of each joint from the median of its siblings; from 0 where it has none.
    pub off: Vec<f64>,
    /// The smallest difference of each joint that counts.
    pub limit: Vec<f64>,
}

impl Judged {
    /// A joint is odd if it differs by more than so many deviations.
    pub const LIMIT: f64 = 6.0;

    /// Judges all joints.
    pub fn new(joints: &[Measured<'_>]) -> Self {
        let off: Vec<f64> = (0..joints.len()).map(|at| joints[at].value - usual(joints, at)).collect();
        let scatter = MEDIAN_TO_DEVIATION * median(off.iter().map(|off| off.abs()).collect()).unwrap_or(0.0);
        let limit = joints.iter().map(|joint| {
            let limit = Self::LIMIT * joint.deviation.hypot(scatter);
            // `f64::max` would take the smallest limit instead of NaN.
            if limit.is_nan() { f64::INFINITY } else { joint.min.max(limit) }
        });
        Self { limit: limit.collect(), off }
    }

    /// Places of the joints that are odd, the oddest first.
    pub fn odd(&self) -> Vec<usize> {
        let part = |at: usize| self.off[at].abs() / self.limit[at];
        let mut odd: Vec<usize> = (0..self.off.len()).filter(|&at| part(at) > 1.0).collect();
        odd.sort_by(|&a, &b| part(b).total_cmp(&part(a)));
        odd
    }
}

/// The usual size of the joint's siblings: their median. Of two in the middle it is the smaller one: one of them may be odd.
fn usual(joints: &[Measured<'_>], at: usize) -> f64 {
    let sibling = |(other, joint): &(usize, &Measured<'_>)| *other != at && joint.group == joints[at].group;
    let mut values: Vec<f64> =
        joints.iter().enumerate().filter(sibling).map(|(_, joint)| joint.value).collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => 0.0,
        odd if odd % 2 == 1 => values[middle],
        _ if values[middle - 1].abs() < values[middle].abs() => values[middle - 1],
        _ => values[middle],
    }
}

/// The median; absent without values.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    let upper = *values.get(middle)?;
    Some(if values.len() % 2 == 1 { upper } else { 0.5 * (values[middle - 1] + upper) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twelve joints of four legs: hips, thighs and calves with errors of the simulator that siblings share.
    fn legs(change: impl Fn(usize) -> f64) -> Vec<Measured<'static>> {
        let joint = |at: usize| Measured {
            group: ["hip", "thigh", "calf"][at % 3],
            value: [0.4, -1.5, 2.0][at % 3] + 0.1 * ((7 * at % 5) as f64 - 2.0) + change(at),
            deviation: 0.1,
            min: 0.5,
        };
        (0..12).map(joint).collect()
    }

    #[test]
    fn what_all_siblings_have_is_not_odd_and_what_one_has_is() {
        assert!(Judged::new(&legs(|_| 0.0)).odd().is_empty());
        assert_eq!(Judged::new(&legs(|at| if at == 11 { 75.0 } else { 0.0 })).odd(), [11]);
        assert_eq!(Judged::new(&legs(|at| if at == 1 { 5.0 } else { 0.0 })).odd(), [1]);
        let two = legs(|at| [0.0, 40.0, 0.0, 0.0, 0.0, -9.0].get(at).copied().unwrap_or(0.0));
        assert_eq!(Judged::new(&two).odd(), [1, 5]);
        let vague: Vec<_> = legs(|at| if at == 11 { 75.0 } else { 0.0 })
            .into_iter()
            .map(|joint| Measured { deviation: 20.0, ..joint })
            .collect();
        assert!(Judged::new(&vague).odd().is_empty(), "the logs do not show it");
        let unknown: Vec<_> =
            vague.into_iter().map(|joint| Measured { deviation: f64::NAN, ..joint }).collect();
        assert!(Judged::new(&unknown).odd().is_empty());
    }

    #[test]
    fn of_three_legs_the_one_with_the_spring_is_odd() {
        let leg = |value: f64| Measured { group: "calf", value, deviation: 0.1, min: 0.5 };
        let mut joints = legs(|_| 0.0);
        joints.extend([leg(0.1), leg(30.0), leg(-0.1)].map(|leg| Measured { group: "arm", ..leg }));
        assert_eq!(Judged::new(&joints).odd(), [13]);
    }

    #[test]
    fn a_joint_without_siblings_is_compared_with_none() {
        let alone = |value: f64| [Measured { group: "knee", value, deviation: 0.2, min: 0.5 }];
        let judged = Judged::new(&alone(30.0));
        assert_eq!(judged.off, [30.0]);
    }
}
