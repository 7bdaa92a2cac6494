//! What `gaitfit new` and `gaitfit excite` choose for a fit of legs in the air: bounds that follow the robot's motors, the
//! search and the physics step.

use gaitfit_model::{Joint, JointKind, Model};

/// Physics step, s. With 5 ms the error of the step is larger than the other differences between simulation and log.
pub const STEP_S: f64 = 0.0025;
/// The search as lines of `[optimizer]`. The simulator's derivatives are exact for legs in the air, so that least squares
/// needs tens of simulations where a search by draws needs thousands. Two starts show whether they agree.
pub const SEARCH: &str = "method = \"least-squares\"\nseeds = 2\n";
/// Dry friction over the largest torque limit; that of a real Go2 is 1 % of its torque limits.
const FRICTION_SHARE: f64 = 0.05;
/// Smallest bound of dry friction, N·m.
const MIN_FRICTION_NM: f64 = 0.5;
/// The bound of dry friction that the Go2 gets, N·m: other bounds grow with it.
const GO2_FRICTION_NM: f64 = 2.0;
/// Bounds over the robot file's own values, at least.
const OF_FILE: f64 = 2.0;

/// Upper bound of dry friction of hinges, N·m, or of slides, N, to one digit: 5 % of the largest torque limit, and at least
/// twice the file's values.
pub fn max_friction(model: &Model, kind: JointKind) -> f64 {
    let of_kind = |joint: &usize| model.joints[*joint].kind == kind;
    let efforts = (0..model.joints.len()).filter(of_kind).filter_map(|joint| model.effort(joint));
    let largest = efforts.filter(|effort| effort.is_finite()).fold(0.0, f64::max);
    let bound = (FRICTION_SHARE * largest).max(kind.like("N·m", MIN_FRICTION_NM));
    // One digit: the bound is a guess, and users read it in a configuration.
    let digit = 10_f64.powf(bound.log10().floor());
    twice_file(model, kind, |joint| joint.frictionloss).max((bound / digit).round() * digit)
}

/// Size of the robot's motors relative to the Go2's, at least 1.
pub fn motor_scale(model: &Model) -> f64 {
    (max_friction(model, JointKind::Hinge) / GO2_FRICTION_NM).max(1.0)
}

/// Twice the largest value of the robot file for its joints of this kind.
pub fn twice_file(model: &Model, kind: JointKind, value: fn(&Joint) -> f64) -> f64 {
    let of_kind = model.joints.iter().filter(|joint| joint.kind == kind);
    OF_FILE * of_kind.map(value).filter(|value| value.is_finite()).fold(0.0, f64::max)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn bounds_follow_the_motors() {
        let mut model = crate::robot::go2().unwrap();
        assert_eq!(
            (max_friction(&model, JointKind::Hinge), motor_scale(&model)),
            (2.0, 1.0),
            "5 % of the calves' 45.43 N·m"
        );
        for actuator in &mut model.actuators {
            (actuator.gear, actuator.ctrlrange, actuator.forcerange) = (1.0, None, Some([-80.0, 80.0]));
        }
        model.joints.iter_mut().for_each(|joint| joint.actuatorfrcrange = None);
        assert_eq!((max_friction(&model, JointKind::Hinge), motor_scale(&model)), (4.0, 2.0));
        model.joints[0].frictionloss = 3.0;
        assert_eq!(max_friction(&model, JointKind::Hinge), 6.0);
        assert_eq!(max_friction(&model, JointKind::Slide), 5.0, "N, without slides");
    }
}
