//! Reward terms: small functions of one robot's moment, by name.
//!
//! A new term touches three files: its function in a file of this folder, its line in [`TERMS`], and its value worked
//! out by hand in `tests/rewards.rs`. A task that does not list it gives it no weight. Terms of a user need none of them:
//! they are expressions in the configuration ([`super::expression`]), or functions of a library's user
//! ([`super::Task::with_term`]).

mod biped;
mod effort;
mod gait;
mod list;
mod tracking;

use super::Moment;

pub use list::Value;
pub(super) use list::{WeightedTerm, listed};

/// A reward term.
pub struct Term {
    /// Name in the configuration and the metrics.
    pub name: &'static str,
    /// Its value; the configuration's weight has the sign.
    pub value: fn(&Moment<'_>) -> f32,
}

/// All terms. Those of weight zero cost nothing.
pub const TERMS: &[Term] = &[
    Term { name: "track_linear_velocity", value: tracking::linear_velocity },
    Term { name: "track_yaw_rate", value: tracking::yaw_rate },
    Term { name: "vertical_velocity", value: tracking::vertical_velocity },
    Term { name: "roll_pitch_rate", value: tracking::roll_pitch_rate },
    Term { name: "posture", value: tracking::posture },
    Term { name: "height", value: tracking::height },
    Term { name: "torque", value: effort::torque },
    Term { name: "joint_acceleration", value: effort::joint_acceleration },
    Term { name: "action_rate", value: effort::action_rate },
    Term { name: "air_time", value: gait::air_time },
    Term { name: "gait", value: gait::alternation },
    Term { name: "swing_height", value: gait::swing_height },
    Term { name: "foot_slip", value: gait::foot_slip },
    Term { name: "stand_still", value: effort::stand_still },
    Term { name: "joint_deviation", value: effort::joint_deviation },
    Term { name: "undesired_contact", value: gait::undesired_contact },
    Term { name: "upright", value: biped::upright },
    Term { name: "front_feet_height", value: biped::front_feet_height },
    Term { name: "front_contact", value: biped::front_contact },
    Term { name: "step_clock", value: biped::step_clock },
    Term { name: "fall", value: tracking::fall },
];
