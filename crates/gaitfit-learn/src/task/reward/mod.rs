//! Reward terms: expressions over one robot's moment, by name.
//!
//! A new built-in term touches two files: its line in [`TERMS`], and its value worked out by hand in `tests/rewards.rs`. A
//! task that does not list it gives it no weight. The CPU computes all terms of a task together
//! ([`super::expression`]), and the kernels of GPUs are written from the same lines. Terms of a user need neither file:
//! they are expressions in the configuration, or functions of a library's user ([`super::Task::with_term`]).

mod list;
mod payment;

pub use list::Value;
pub(super) use list::{WeightedTerm, listed};
pub(super) use payment::{Rewards, Scratch};

/// A built-in reward term.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// Name in the configuration and the metrics.
    pub name: &'static str,
    /// Its value, an expression; the configuration's weight has the sign.
    pub text: &'static str,
}

macro_rules! terms {
    ($($(#[doc = $doc:literal])+ $name:ident = $text:literal;)*) => {
        /// All terms. Those of weight zero cost nothing.
        ///
        $(#[doc = concat!("- `", stringify!($name), "`:", $($doc),+)])*
        pub const TERMS: &[Term] = &[$(Term { name: stringify!($name), text: $text },)*];
    };
}

// A foot that is up or down for longer than twice the wanted swing time is out of step: a robot that stands, or holds a
// foot up, must not be paid for a gait. An event (a landing, a fall) is divided by dt, because a step pays by its duration.
terms! {
    /// exp(−|v − c|²/w²) of the horizontal velocity, heading frame.
    track_linear_velocity =
        r#"exp(-sum(square(velocity["x", "y"] - command["x", "y"])) / square(tracking_width))"#;
    /// exp(−(ω − c)²/w²) of the yaw rate.
    track_yaw_rate = r#"exp(-square(yaw_rate - command["yaw"]) / square(yaw_tracking_width))"#;
    /// Square of the vertical velocity, m²/s².
    vertical_velocity = r#"square(velocity["z"])"#;
    /// Squared angular velocity about the horizontal axes, rad²/s².
    roll_pitch_rate = "sum(square(angular_velocity)) - square(yaw_rate)";
    /// Squared sine of the angle between actual and wanted posture.
    posture = "max(1 - square(uprightness), 0)";
    /// exp(−(h − h*)²/(0.1 m)²) of the base's height.
    height = "exp(-square((height - wanted_height) / 0.1))";
    /// Squared motor torques, N²·m².
    torque = "sum(square(tau))";
    /// Mechanical power of the motors, as much where they brake, W (`energy` of Isaac Lab and walk-these-ways).
    power = "sum(abs(tau * qvel))";
    /// Squared joint accelerations, rad²/s⁴.
    joint_acceleration = "sum(square(qacc))";
    /// Squared change of the action since the last step.
    action_rate = "sum(square(action - last_action))";
    /// Σ (min(t, T)/T)²/control step over feet that land in this step after the time t in the air, while walking; T is
    /// the wanted swing time. Square, so that a few long steps are worth more than many short ones.
    air_time = "select(walking, sum(landed * square(min(last_air_time / swing_seconds, 1))) / dt, 0)";
    /// Share of pairs of feet in the gait that agree: feet of one group are both on the ground or both off it, feet
    /// of different groups are not, and neither has been where it is for longer than twice the wanted swing time.
    /// 1 in a trot; 0 in a robot that stands, on four legs or on two. Zero while standing is asked for.
    gait = "select(walking, sum(first(gait_group) >= 0 and second(gait_group) >= 0 \
            and max(first(max(air_time, contact_time)), second(max(air_time, contact_time))) <= 2 * swing_seconds \
            and (first(contact) == second(contact)) == (first(gait_group) == second(gait_group))) \
            / max(sum(first(gait_group) >= 0 and second(gait_group) >= 0), 1), 0)";
    /// Mean over the gait's feet of min(z/z*, 1) in the air, z the height of a foot's centre and z* the wanted one, while
    /// walking; feet that stay up longer than twice the wanted swing time earn nothing.
    swing_height = "select(walking, sum(select(gait_group < 0 or contact or air_time > 2 * swing_seconds, 0, \
            clamp(foot_height / swing_height, 0, 1))) / max(sum(gait_group >= 0), 1), 0)";
    /// Σ v² of feet on the ground, m²/s².
    foot_slip = "sum(contact * square(foot_speed))";
    /// Squared distance from the default pose while the command asks for standing (norm up to 0.1), rad².
    stand_still = "select(walking, 0, sum(square(qpos - default_pose)))";
    /// Squared distance from the default pose, rad².
    joint_deviation = "sum(square(qpos - default_pose))";
    /// Parts other than feet that touch the ground.
    undesired_contact = "body_contacts";
    /// How far the robot is in the wanted posture: ((1 + cos)/2)², 1 in it, 0 upside down.
    upright = "square(0.5 * (1 + uprightness))";
    /// Height of the feet that are not in the gait, up to 0.25 m each, m.
    front_feet_height = "sum(select(gait_group < 0, clamp(foot_height, 0, 0.25), 0))";
    /// Feet outside the gait that touch the ground.
    front_contact = "sum(gait_group < 0 and contact)";
    /// Share of the gait's feet that are on the ground in their half of the clock and off it in the other; even groups
    /// stand in the first half.
    step_clock = "sum(gait_group >= 0 and contact == ((clock < 0.5) == (gait_group / 2 == floor(gait_group / 2)))) \
            / max(sum(gait_group >= 0), 1)";
    /// 1/dt in the step of a fall, else 0, 1/s.
    fall = "fallen / dt";
}
