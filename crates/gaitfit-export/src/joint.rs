//! A joint's numbers as other simulators take them.

use gaitfit_log::Gains;
use gaitfit_model::{Model, shown};
use gaitfit_sim::Candidate;

/// A joint of the fitted robot.
#[derive(Clone, Debug)]
pub(super) struct JointNumbers {
    pub name: String,
    /// kg·m²
    pub armature: f64,
    /// N·m·s/rad
    pub damping: f64,
    /// N·m
    pub frictionloss: f64,
    /// Friction at rest above that, N·m.
    pub stiction: f64,
    /// Friction for each N·m of the motor's torque.
    pub load_friction: f64,
    /// Stiffness of all springs on the joint, N·m/rad.
    pub stiffness: f64,
    /// Their torque at angle 0, N·m.
    pub spring_torque: f64,
    /// Delivered gain, N·m/rad, with all factors of the fit; 0 without gains.
    pub kp: f64,
    /// Delivered gain, N·m·s/rad.
    pub kd: f64,
    /// Factors of the fit on stated gains.
    pub kp_factor: f64,
    pub kd_factor: f64,
    /// Encoder reading minus angle, rad.
    pub encoder_bias: f64,
    /// N·m
    pub torque_offset: f64,
    /// N·m; infinite where nothing bounds it.
    pub torque_limit: f64,
    /// rad/s; infinite where the torque does not fall with speed.
    pub no_load_speed: f64,
    /// N·m
    pub stall_torque: f64,
    /// s
    pub delay: f64,
    /// Whether springs differ from the robot file's.
    pub has_spring: bool,
    /// Whether it has a motor in the robot's file ([`has_motor`]), or gains.
    pub motor: bool,
    /// Whether it has a name in the robot's file; else other programs do not know the name that it has here.
    pub named: bool,
}

impl JointNumbers {
    /// Angle at which the springs give no torque, rad; none without a stiffness.
    pub fn springref(&self) -> Option<f64> {
        (self.stiffness != 0.0).then(|| self.spring_torque / self.stiffness)
    }

    /// Whether the springs give a torque without a stiffness, which a joint of MJCF has no place for.
    pub fn has_constant_torque(&self) -> bool {
        self.stiffness == 0.0 && self.spring_torque != 0.0
    }
}

/// Whether joint `index` has a motor in the robot's file. A file without any actuator does not say it, so all have one.
pub(super) fn has_motor(model: &Model, index: usize) -> bool {
    model.actuators.is_empty() || model.actuators.iter().any(|actuator| actuator.joint == index)
}

/// The joints of the fitted robot, in the model's order.
pub(super) fn numbers(model: &Model, candidate: &Candidate, gains: Option<&Gains>) -> Vec<JointNumbers> {
    let robot = &candidate.robot;
    let numbers = |(j, joint): (usize, &gaitfit_model::Joint)| {
        let (stiffness, rest) = (joint.stiffness, joint.springref);
        // A PD controller's torque is linear in both gains, so a factor on the torque is one on each gain.
        let scale = robot.torque_scale[j];
        let (kp_factor, kd_factor) = (scale * robot.kp_scale[j], scale * robot.kd_scale[j]);
        let (kp, kd) = gains.map_or((0.0, 0.0), |gains| (kp_factor * gains.kp[j], kd_factor * gains.kd[j]));
        JointNumbers {
            name: joint.name.clone(),
            armature: robot.armature[j],
            damping: robot.damping[j],
            frictionloss: robot.frictionloss[j],
            stiction: robot.stiction[j],
            load_friction: robot.load_friction[j],
            // Two springs on one joint add their stiffness and their torque at angle 0.
            stiffness: stiffness + robot.stiffness[j],
            spring_torque: stiffness * rest + robot.spring_torque[j],
            kp,
            kd,
            kp_factor,
            kd_factor,
            encoder_bias: robot.encoder_bias[j],
            torque_offset: robot.torque_offset[j],
            torque_limit: robot.torque_limit[j],
            no_load_speed: robot.no_load_speed[j],
            stall_torque: robot.stall_torque[j],
            delay: robot.delay[j],
            // The file's own springs are in its text already.
            has_spring: robot.stiffness[j] != 0.0 || robot.spring_torque[j] != 0.0,
            motor: has_motor(model, j) || kp != 0.0 || kd != 0.0,
            named: true,
        }
    };
    model.joints.iter().enumerate().map(numbers).collect()
}

/// That the robot's MJCF lacks torques of springs without a stiffness, with the joints and what to do; `None` without such.
pub(super) fn constant_torque_note(joints: &[JointNumbers]) -> Option<String> {
    let names: Vec<String> = joints
        .iter()
        .filter(|joint| joint.has_constant_torque())
        .map(|joint| format!("`{}`", shown(&joint.name)))
        .collect();
    (!names.is_empty()).then(|| {
        format!(
            "robot.xml does not have the spring_torque of {}: without stiffness a joint of MuJoCo has no place for a torque. Add the spring_torque of theta.json to data.qfrc_applied at every physics step",
            names.join(", ")
        )
    })
}
