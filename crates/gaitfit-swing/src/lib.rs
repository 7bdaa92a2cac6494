//! What logs of a walking robot say of its joints and its sensors, without a simulation.
//!
//! A leg in the air touches nothing: its motors' torques, which the PD law gives from targets, positions and velocities, go
//! into its inertia, gravity and what its joints take. [`estimate`] reads Coulomb friction, damping and armature of joint
//! groups from that, and the delay of targets, each with an error. It needs no policy, no ground model and no motion capture:
//! the base turns as the inertial unit says, and moves as [`Ground`] works out from feet that stand and the forces on them.
//! [`Standing`] says how the inertial unit is tilted. [`gaitfit_log::Sensors`] are what logs say without a robot.
//!
//! Logs need targets, gains, and orientation and body rates of the base; legs of a clamped robot in the air need no
//! inertial unit. Rates of 50 Hz do, higher ones are better.

mod added;
mod count;
pub mod dynamics;
mod effect;
mod effects;
mod equations;
mod error;
mod estimate;
mod feet;
mod fit;
mod lowest;
mod moment;
mod odd;
mod poses;
mod regression;
mod report;
mod scene;
mod singles;
mod stance;
mod standing;
mod together;
mod torques;
mod walk;

pub use count::Progress;
pub use effect::{Effect, EffectKind};
pub use effects::{effects, tilt_beside_twist};
pub use error::SwingError;
pub use estimate::{estimate, estimate_walks};
pub use feet::{Foot, Ground};
pub use gaitfit_log::Estimate;
pub use odd::{Judged, Measured};
pub use report::{FrictionLaw, GroupEstimate, SwingReport, SwingSettings, usual_group, usual_groups};
pub use standing::Standing;
pub use torques::Drag;
pub use walk::Walk;
